"""Quintics between given values and derivatives, and the banded equations of splines."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any, TypeAlias

import numpy as np

from armcontour.core.checks import FloatArray, kernel_array
from armcontour.core.kernel_cache import compiled
from armcontour.core.simd import LANES

# Value, first and second derivative of n curves, (n, dof) each.
Derivatives: TypeAlias = tuple[FloatArray, FloatArray, FloatArray]
# Rounding error of positions from inverse kinematics, relative to 1 plus their magnitudes.
IK_ROUNDING = 2e-15


def quintic(
    width: FloatArray,
    begin: Iterable[FloatArray],
    end: Iterable[FloatArray],
    width_error: float = 0.0,
) -> FloatArray:
    """Return the quintics with given values and derivatives at both ends of intervals.

    With x = u / h, the quintic p(x) = a0 + a1 x + ... + a5 x⁵ on an interval of length h has the
    values q0, q1, slopes q0', q1' and second derivatives q0'', q1'' at u = 0 and h:
    a0 = q0, a1 = h q0', a2 = h² q0'' / 2, and with v = q1 - a0 - a1 - a2, w = h q1' - a1 - 2 a2,
    c = h² q1'' - 2 a2: a3 = 10 v - 4 w + c / 2, a4 = -15 v + 7 w - c, a5 = 6 v - 3 w + c / 2.

    Args:
        width: Lengths of the intervals, (n,).
        begin: Value, first and second derivative at the start of each interval, (n, dof) each.
        end: Value, first and second derivative at the end of each interval, (n, dof) each.
        width_error: Rounding error of the widths, which are differences of arc lengths.

    Returns:
        Coefficients a0 to a5, (n, 6, dof).
    """
    first, last = (tuple(map(kernel_array, x)) for x in (begin, end))
    n, dof = first[0].shape
    # Kernels that load LANES numbers read beyond the last quintic, see `before_zeros`.
    memory = np.zeros(6 * n * dof + LANES)
    coefficients = memory[:-LANES].reshape(n, 6, dof)
    kernel: Any = _fill_coefficients
    kernel(kernel_array(width), first, last, width_error, coefficients)
    return coefficients


def before_zeros(coefficients: FloatArray) -> FloatArray:
    """Return the coefficients, flat, followed by LANES zeros.

    Coefficients that `quintic` has made are not copied.
    """
    memory = coefficients.base
    size = coefficients.size
    if isinstance(memory, np.ndarray) and memory.flags.writeable and memory.dtype == np.float64:
        begins = memory.ctypes.data == coefficients.ctypes.data
        if begins and memory.shape == (size + LANES,) and not memory[size:].any():
            return memory
    memory = np.zeros(size + LANES)
    memory[:size] = coefficients.ravel()
    return memory


def to_bernstein(degree: int) -> FloatArray:
    """Return the matrix from power coefficients to Bernstein points, (degree + 1, degree + 1)."""
    rows = range(degree + 1)
    return np.array([[math.comb(k, m) / math.comb(degree, m) for m in rows] for k in rows])


@compiled()
def _fill_coefficients(
    width: FloatArray,
    begin: Derivatives,
    end: Derivatives,
    width_error: float,
    coefficients: FloatArray,
) -> None:
    """Write the coefficients for `quintic`."""
    q0, d0, c0 = begin
    q1, d1, c1 = end
    n, dof = q0.shape
    for i in range(n):
        h = width[i]
        for j in range(dof):
            a0 = q0[i, j]
            a1 = d0[i, j] * h
            a2 = c0[i, j] * (h * h) / 2
            value = q1[i, j] - a0 - a1 - a2
            slope = d1[i, j] * h - a1 - 2 * a2
            curvature = c1[i, j] * (h * h) - 2 * a2
            # On a very short interval `value` consists of rounding errors, which the derivatives of
            # the quintic would magnify. The quartic with the given derivatives then ends at the
            # given value up to rounding errors, and replaces the quintic.
            cubic = slope - curvature / 3
            quartic = (curvature - 2 * slope) / 4
            rounding = IK_ROUNDING * (1 + abs(a0) + abs(q1[i, j])) + width_error * abs(d0[i, j])
            short = abs(value - cubic - quartic) <= rounding
            coefficients[i, 0, j] = a0
            coefficients[i, 1, j] = a1
            coefficients[i, 2, j] = a2
            coefficients[i, 3, j] = cubic if short else 10 * value - 4 * slope + curvature / 2
            coefficients[i, 4, j] = quartic if short else -15 * value + 7 * slope - curvature
            coefficients[i, 5, j] = 0.0 if short else 6 * value - 3 * slope + curvature / 2


def evaluate(coefficients: FloatArray, width: FloatArray, u: FloatArray, order: int) -> FloatArray:
    """Return a derivative of quintics at distances u from their starts, (n, values).

    Args:
        coefficients: Coefficients of 1 to x⁵ with x = u / width, (n, 6, values).
        width: Lengths of the intervals, (n,).
        u: Distances from the starts of the intervals, (n,).
        order: Order of the derivative with respect to u; 0 for the value.
    """
    x = u / width
    result = np.zeros(np.shape(x) + (coefficients.shape[-1],))
    for k in range(5, order - 1, -1):
        # The derivative of x^k has the factor k (k - 1) ... (k - order + 1).
        factor = float(math.perm(k, order))
        result = result * x[..., None] + factor * coefficients[..., k, :]
    return np.asarray(result / width[..., None] ** order)


def rescale(coefficients: FloatArray, begin: FloatArray, factor: FloatArray) -> FloatArray:
    """Substitute x = begin + factor y in polynomials p(x); return their coefficients in y.

    `coefficients`, (n, degree + 1, values), belong to the powers 1, x, x², ...; a negative factor
    reverses the polynomials.
    """
    expanded = np.empty_like(coefficients)
    size = coefficients.shape[1]
    for k in range(size):
        term = np.zeros_like(coefficients[:, 0])
        for j in range(size - 1, k - 1, -1):
            term = term * begin[:, None] + math.comb(j, k) * coefficients[:, j]
        expanded[:, k] = term * factor[:, None] ** k
    return expanded


@compiled()
def solve_banded(bands: FloatArray, right: FloatArray) -> None:
    """Solve symmetric banded equations in place; `right`, (m, n), becomes the solution.

    Gaussian elimination without pivoting, for diagonally dominant or positive definite matrices.
    `bands[i]` is row i of the matrix from the diagonal to the right; `bands`, (m, width), is
    overwritten.
    """
    m, width = bands.shape
    sides = right.shape[1]
    for i in range(m):
        for k in range(1, min(width, m - i)):
            factor = bands[i, k] / bands[i, 0]
            for j in range(k, min(width, m - i)):
                bands[i + k, j - k] -= factor * bands[i, j]
            for c in range(sides):
                right[i + k, c] -= right[i, c] * factor
    for i in range(m - 1, -1, -1):
        for c in range(sides):
            value = right[i, c] / bands[i, 0]
            for k in range(1, min(width, m - i)):
                value -= right[i + k, c] * (bands[i, k] / bands[i, 0])
            right[i, c] = value
