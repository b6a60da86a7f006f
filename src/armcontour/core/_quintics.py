"""Quintics between places with given values and derivatives, in joint space or tool space."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np

from armcontour.core.checks import FloatArray, kernel_array
from armcontour.core.kernels import compiled

# Rounding error of positions from inverse kinematics, relative to 1 or to their size.
ROUNDING = 2e-15


def quintic(
    width: FloatArray,
    begin: Iterable[FloatArray],
    end: Iterable[FloatArray],
    play: float = 0.0,
) -> FloatArray:
    """Coefficients of quintics with given values and derivatives at both ends of intervals.

    Args:
        width: Lengths of the intervals, (n,).
        begin: Value, first and second derivative at the start of each interval, (n, dof) each.
        end: Value, first and second derivative at the end of each interval, (n, dof) each.
        play: Rounding error of the widths, which are differences of arc lengths.

    Returns:
        Coefficients of powers of x = u / width, from 1 to x⁵, (n, 6, dof).
    """
    own: Any = map(kernel_array, (width, *begin, *end))
    kernel: Any = _fill
    return np.asarray(kernel(*own, play))


@compiled()
def _fill(
    width: FloatArray,
    q0: FloatArray,
    d0: FloatArray,
    c0: FloatArray,
    q1: FloatArray,
    d1: FloatArray,
    c1: FloatArray,
    play: float,
) -> FloatArray:
    """What `quintic` returns."""
    n, dof = q0.shape
    found = np.empty((n, 6, dof))
    for i in range(n):
        h = width[i]
        for j in range(dof):
            a0, a1, a2 = q0[i, j], d0[i, j] * h, c0[i, j] * (h * h) / 2
            value = q1[i, j] - a0 - a1 - a2
            slope = d1[i, j] * h - a1 - 2 * a2
            bend = c1[i, j] * (h * h) - 2 * a2
            # On a very short interval `value` consists of rounding errors of positions, which the
            # derivatives of the quintic would magnify. The quartic with the given derivatives then
            # ends at the given value up to rounding errors, and is used instead.
            cubic, quartic = slope - bend / 3, (bend - 2 * slope) / 4
            rounding = ROUNDING * (1 + abs(a0) + abs(q1[i, j])) + play * abs(d0[i, j])
            short = abs(value - cubic - quartic) <= rounding
            found[i, 0, j], found[i, 1, j], found[i, 2, j] = a0, a1, a2
            found[i, 3, j] = cubic if short else 10 * value - 4 * slope + bend / 2
            found[i, 4, j] = quartic if short else -15 * value + 7 * slope - bend
            found[i, 5, j] = 0.0 if short else 6 * value - 3 * slope + bend / 2
    return found


def evaluate(coefficients: FloatArray, width: FloatArray, u: FloatArray, order: int) -> FloatArray:
    """Values of polynomials of degree 5, or their derivatives, (n, values).

    Args:
        coefficients: Coefficients of powers of x = u / width, (n, 6, values).
        width: Lengths of the intervals, (n,).
        u: Distances from the starts of the intervals, (n,).
        order: Order of the derivative, 0 for the value.
    """
    x = u / width
    result = np.zeros(np.shape(x) + (coefficients.shape[-1],))
    for k in range(5, order - 1, -1):
        factor = float(np.prod(np.arange(k, k - order, -1)))
        result = result * x[..., None] + factor * coefficients[..., k, :]
    return np.asarray(result / width[..., None] ** order)


def re_expand(coefficients: FloatArray, begin: FloatArray, factor: FloatArray) -> FloatArray:
    """Coefficients in y of polynomials p(x) with x = begin + factor y, of the same shape.

    Args:
        coefficients: Coefficients of powers of x, from 1 on, (n, degree + 1, values).
        begin: Where y is 0, (n,).
        factor: Derivative of x by y, (n,); below zero reverses the polynomials.
    """
    found = np.empty_like(coefficients)
    size = coefficients.shape[1]
    for k in range(size):
        term = np.zeros_like(coefficients[:, 0])
        for j in range(size - 1, k - 1, -1):
            term = term * begin[:, None] + math.comb(j, k) * coefficients[:, j]
        found[:, k] = term * factor[:, None] ** k
    return found
