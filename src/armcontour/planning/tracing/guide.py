"""Guide of a redundant arm: the null-space reference that makes its joint path unique.

If the arm has more joints than the task dimension, the rows `w(s) (q - g(s)) = 0` are added to the
equations of the tool pose. g is a spline through joint positions of a short joint path away from
the ends of the joint ranges; the rows of w span the null space. Both are C² between stops, so that
dq_ds and d2q_ds2 are exact.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour.core.checks import FloatArray, IntArray, kernel_array
from armcontour.core.kernel_cache import compiled
from armcontour.core.pchip import monotone_slopes
from armcontour.core.quintics import solve_banded
from armcontour.motion import quintic

# Largest deviation of a spline from a chord, as a fraction of the largest neighbouring step, in
# addition to SWING_FLOOR.
SWING = 0.1
# Deviation of a spline from a chord that is always allowed [rad].
SWING_FLOOR = 0.01
# Fractions of an interval at which this deviation is computed, (3, 1, 1).
QUARTERS = np.array([0.25, 0.5, 0.75])[:, None, None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Guide:
    """Splines of the reference g and the null-space rows w, one per section between stops."""

    s: FloatArray  # Arc lengths of the knots [m], (n,)
    # Coefficients of g and then of the rows of w in powers of the distance from the previous knot,
    # from 1 to u⁵, (n - 1, 6, values)
    coefficients: FloatArray
    dof: int

    @classmethod
    def through(cls, s: FloatArray, q: FloatArray, w: FloatArray, stops: FloatArray) -> Guide:
        """Make the guide through given joint positions.

        The splines are cubic, or quintics where a cubic spline overshoots because the tool turns
        much faster on a short part of the path than next to it.

        - `s`: arc lengths [m], (n,).
        - `q`: joint positions [rad], (n, dof).
        - `w`: bases of the null space, (n, free, dof).
        - `stops`: those arc lengths in `s` at which the tool stops [m].
        """
        n, free, dof = w.shape
        turned = np.empty((n, free, free))
        turned[0] = np.eye(free)
        turns = _basis_rotations(w)
        if free == 1:
            turned[1:] = np.cumprod(turns, axis=0)
        else:
            for k, turn in enumerate(turns):
                turned[k + 1] = turned[k] @ turn
        values = np.concatenate([q, (turned @ w).reshape(n, free * dof)], axis=1)
        cuts = [0, *np.searchsorted(s, stops).tolist(), n - 1]
        # Sections of one interval are lines.
        coefficients = np.zeros((n - 1, 6, values.shape[1]))
        coefficients[:, 0] = values[:-1]
        coefficients[:, 1] = np.diff(values, axis=0) / np.diff(s)[:, None]
        for i, last in zip(cuts[:-1], cuts[1:], strict=True):
            if last > i + 1:
                coefficients[i:last] = _spline(s[i : last + 1], values[i : last + 1])
        return cls(s=s, coefficients=coefficients, dof=dof)

    def evaluate(self, s: FloatArray, middle: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return w and g with two derivatives along s, (n, 3, free, dof) and (n, 3, dof).

        - `s`: arc lengths [m], (n,).
        - `middle`: arc lengths inside the intervals that `s` belong to [m], (n,); at a knot they
          select the interval.
        """
        n = len(s)
        free = self.coefficients.shape[2] // self.dof - 1
        g = np.empty((n, 3, self.dof))
        w = np.empty((n, 3, free * self.dof))
        # Compiled code would load scipy.linalg, which takes 0.1 s, to call searchsorted.
        intervals = np.searchsorted(self.s, middle) - 1
        _write_splines(self.s, self.coefficients, kernel_array(s), intervals, g, w)
        return w.reshape(n, 3, free, self.dof), g


@compiled()
def _write_splines(
    knots: FloatArray,
    coefficients: FloatArray,
    s: FloatArray,
    intervals: IntArray,
    g: FloatArray,
    w: FloatArray,
) -> None:
    """Write g and the rows of w with two derivatives along s, (n, 3, dof) and (n, 3, free dof).

    - `knots`, `coefficients`: as in `Guide`.
    - `s`: as in `Guide.evaluate`.
    - `intervals`: index of the interval of each arc length, (n,).
    """
    dof = g.shape[2]
    for i in range(len(s)):
        interval = intervals[i]
        u = s[i] - knots[interval]
        for k in range(coefficients.shape[2]):
            # Horner's method for the value and half of the second derivative
            value = slope = half_curvature = 0.0
            for power in range(5, -1, -1):
                half_curvature = half_curvature * u + slope
                slope = slope * u + value
                value = value * u + coefficients[interval, power, k]
            if k < dof:
                g[i, 0, k] = value
                g[i, 1, k] = slope
                g[i, 2, k] = 2.0 * half_curvature
            else:
                w[i, 0, k - dof] = value
                w[i, 1, k - dof] = slope
                w[i, 2, k - dof] = 2.0 * half_curvature


def _basis_rotations(w: FloatArray) -> FloatArray:
    """Return the smallest rotations between neighbouring null-space bases, (n - 1, free, free)."""
    along = np.einsum("nik,njk->nij", w[:-1], w[1:])
    if w.shape[1] == 1:
        return np.where(along < 0, -1.0, 1.0)
    u, _, v = np.linalg.svd(along)
    return np.asarray(u @ v)


def _spline(s: FloatArray, values: FloatArray) -> FloatArray:
    """Return coefficients of a cubic spline, or quintics if it overshoots, (n - 1, 6, values)."""
    width = np.diff(s)[:, None]
    steps = np.diff(values, axis=0)
    slopes = _slopes(s, values)
    chord = steps / width
    curvature = (slopes[:-1] + slopes[1:] - 2 * chord) / width
    c = np.zeros((len(steps), 6, values.shape[1]))
    c[:, 0] = values[:-1]
    c[:, 1] = slopes[:-1]
    c[:, 3] = curvature / width
    c[:, 2] = (chord - slopes[:-1]) / width - curvature
    largest = np.pad(np.abs(steps).max(axis=1), 1)
    largest = np.maximum(np.maximum(largest[:-2], largest[2:]), largest[1:-1])
    u = QUARTERS * width
    deviation = np.abs(u * (c[:, 1] + u * (c[:, 2] + u * c[:, 3])) - QUARTERS * steps).max(
        axis=(0, 2)
    )
    return _pchip_quintics(s, values) if (deviation > SWING * largest + SWING_FLOOR).any() else c


def _slopes(s: FloatArray, values: FloatArray) -> FloatArray:
    """Return the slopes of the cubic spline through values at its knots, (n, values)."""
    # The third derivative is continuous at the second and last but one knot ("not a knot"). Through
    # three points the spline is a parabola.
    h = np.diff(s)[:, None]
    chord = np.diff(values, axis=0) / h
    first = h[0] + h[1]
    last = h[-1] + h[-2]
    if len(s) == 3:
        curvature = (chord[1] - chord[0]) / first
        return np.stack(
            [chord[0] - curvature * h[0], chord[0] + curvature * h[0], chord[1] + curvature * h[1]]
        )
    # Rows are scaled so that the matrix is symmetric.
    bands = np.zeros((len(s), 2))
    right = np.empty_like(values)
    bands[1:-1, 0] = 2 / h[:-1, 0] + 2 / h[1:, 0]
    bands[[0, -1], 0] = np.concatenate([h[1] / (first * h[0]), h[-2] / (last * h[-1])])
    bands[:-1, 1] = 1 / h[:, 0]
    right[1:-1] = 3 * (chord[:-1] / h[:-1] + chord[1:] / h[1:])
    right[0] = ((1 / first + 2 / h[0]) * h[1] * chord[0] + h[0] / first * chord[1]) / first
    right[-1] = (h[-1] / last * chord[-2] + (2 / h[-1] + 1 / last) * h[-2] * chord[-1]) / last
    solve_banded(bands, right)
    return right


def _pchip_quintics(s: FloatArray, values: FloatArray) -> FloatArray:
    """Return the quintics through values, with PCHIP slopes and no second derivative at knots."""
    # Returns coefficients of powers of the distance from the previous knot, (n - 1, 6, values).
    slopes = monotone_slopes(s, values)
    width = np.diff(s)
    zero = np.zeros_like(slopes[1:])
    start = (values[:-1], slopes[:-1], zero)
    end = (values[1:], slopes[1:], zero)
    return np.asarray(quintic(width, start, end) / width[:, None, None] ** np.arange(6)[:, None])
