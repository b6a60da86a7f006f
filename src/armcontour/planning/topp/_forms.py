"""The compiled forms of the limits of joints, and of limits whose coefficients are sampled."""

from __future__ import annotations

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.kernels import FUSED, compiled
from armcontour.planning.topp.limits import (
    ALONE,
    BY_SLOPE,
    BY_U,
    BY_X,
    HIGH,
    LOW,
    A,
    B,
    Intervals,
    Rows,
)

ROUNDING = 2e-15  # of x, in differences of x


@compiled(inner=True, fastmath=FUSED)
def _slopes(c: FloatArray, k: int, j: int, x: float, scale: float) -> tuple[float, float]:
    """dq_ds and d2q_ds2 of joint j at a place x of piece k."""
    c1, c2, c3, c4, c5 = c[k, 1, j], c[k, 2, j], c[k, 3, j], c[k, 4, j], c[k, 5, j]
    first = c1 + x * (2 * c2 + x * (3 * c3 + x * (4 * c4 + x * 5 * c5)))
    second = 2 * c2 + x * (6 * c3 + x * (12 * c4 + x * 20 * c5))
    return scale * first, scale * scale * second


@compiled(inner=True, fastmath=FUSED)
def _largest(
    c: FloatArray, k: int, j: int, x: float, y: float, scale: float
) -> tuple[float, float]:
    """Bounds of |d3q_ds3| and |d4q_ds4| of joint j from place x to y of piece k."""
    c3, c4, c5 = c[k, 3, j], c[k, 4, j], c[k, 5, j]
    # By Taylor about the middle: the fifth derivative is constant.
    middle, half, cube = (x + y) / 2, (y - x) / 2, scale * scale * scale
    q5 = abs(120 * c5)
    q4 = abs(24 * c4 + middle * 120 * c5) + half * q5
    q3 = abs(6 * c3 + middle * (24 * c4 + middle * 60 * c5))
    return (q3 + half * (q4 - half * q5 / 2)) * cube, q4 * cube * scale


@compiled(fastmath=FUSED)
def derivatives(
    breaks: FloatArray,
    coefficients: FloatArray,
    grid: Intervals,
    ends: FloatArray,
    most: FloatArray,
) -> None:
    """Derivatives of a joint path on a grid.

    Args:
        breaks: Of the joint path [m], (pieces + 1,).
        coefficients: Of the joint path, (pieces, 6, dof).
        grid: The intervals.
        ends: Takes dq_ds and d2q_ds2 at the starts and ends of the intervals, (2, n, 2, dof).
        most: Takes bounds of |d3q_ds3| and |d4q_ds4| on the intervals, (2, n, dof).
    """
    for i in range(len(grid.piece)):
        k = grid.piece[i]
        scale = 1.0 / (breaks[k + 1] - breaks[k])
        x, y = (grid.s[i] - breaks[k]) * scale, (grid.s[i + 1] - breaks[k]) * scale
        for j in range(coefficients.shape[2]):
            ends[0, i, 0, j], ends[1, i, 0, j] = _slopes(coefficients, k, j, x, scale)
            ends[0, i, 1, j], ends[1, i, 1, j] = _slopes(coefficients, k, j, y, scale)
            most[0, i, j], most[1, i, j] = _largest(coefficients, k, j, x, y, scale)


@compiled(fastmath=FUSED)
def write_sampled(
    grid: Intervals,
    after: IntArray,
    terms: tuple[FloatArray, ...],
    bounds: tuple[FloatArray, ...],
    rows: Rows,
) -> None:
    """Write rows `low <= a u + b x + c <= high` whose coefficients are sampled.

    Args:
        grid: The intervals.
        after: Of `OnGrid`.
        terms: a, b and c at the places of `OnGrid`, (places, rows) each.
        bounds: low and high, (rows,) each.
        rows: Output.
    """
    a, b, c = terms
    low, high = bounds
    n, count = len(grid.piece), a.shape[1]
    bend = np.empty((n, 3, count))
    for i in range(n):
        w, last = grid.s[i + 1] - grid.s[i], after[i]
        # Twice what the middle is off the chord, over w².
        inverse = 2 / (w * w)
        for r in range(count):
            bend[i, 0, r] = inverse * abs(a[n + i, r] - (a[i, r] + a[last, r]) / 2)
            bend[i, 1, r] = inverse * abs(b[n + i, r] - (b[i, r] + b[last, r]) / 2)
            bend[i, 2, r] = inverse * abs(c[n + i, r] - (c[i, r] + c[last, r]) / 2)
    for i in range(n):
        w, last = grid.s[i + 1] - grid.s[i], after[i]
        before = i - 1 if i > 0 and grid.piece[i - 1] == grid.piece[i] else i
        behind = i + 1 if i < n - 1 and grid.piece[i + 1] == grid.piece[i] else i
        for r in range(count):
            for end in range(2):
                at = last if end else i
                rows.ends[i, end, r, A], rows.ends[i, end, r, B] = a[at, r], b[at, r]
                rows.ends[i, end, r, LOW] = low[r] - c[at, r]
                rows.ends[i, end, r, HIGH] = high[r] - c[at, r]
            a0, a1, b0, b1 = a[i, r], a[last, r], b[i, r], b[last, r]
            by_u = w * w * max(bend[before, 0, r], bend[i, 0, r], bend[behind, 0, r])
            by_x = w * w * max(bend[before, 1, r], bend[i, 1, r], bend[behind, 1, r])
            alone = w * w * max(bend[before, 2, r], bend[i, 2, r], bend[behind, 2, r])
            rows.rise[i, r, BY_U] = by_u + abs(b1 - b0) * w / 2
            rows.rise[i, r, BY_X] = by_x + ROUNDING * max(abs(a0), abs(a1)) / w
            rows.rise[i, r, BY_SLOPE] = w / 4 * (abs(a1 - a0) + w * max(abs(b0), abs(b1)))
            rows.rise[i, r, ALONE] = alone
