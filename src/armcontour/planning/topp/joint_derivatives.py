"""Compiled derivatives of LANES joints in the arc length, at ends of intervals and on them."""

from __future__ import annotations

from typing import Any

from armcontour.core.kernel_cache import FUSED, compiled
from armcontour.core.simd import LANES, load, size
from armcontour.planning.topp.limit_forms import Intervals

Vector = Any  # SIMD vector of LANES numbers


@compiled(inner=True)
def _coefficients(grid: Intervals, i: int, joint: int, power: int) -> Vector:
    """Load the coefficients of x^power for LANES joints on the interval's piece."""
    return load(grid.coefficients, (6 * grid.piece[i] + power) * grid.dof + joint)


@compiled(inner=True, fastmath=FUSED)
def path_slopes(grid: Intervals, i: int, joint: int, end: int) -> tuple[Vector, Vector]:
    """Return dq_ds and d2q_ds2 of LANES joints at an end of an interval."""
    k = grid.piece[i]
    scale = 1.0 / (grid.breaks[k + 1] - grid.breaks[k])
    x = (grid.s[i + end] - grid.breaks[k]) * scale
    c1 = _coefficients(grid, i, joint, 1)
    c2 = _coefficients(grid, i, joint, 2)
    c3 = _coefficients(grid, i, joint, 3)
    c4 = _coefficients(grid, i, joint, 4)
    c5 = _coefficients(grid, i, joint, 5)
    first = c1 + x * (2.0 * c2 + x * (3.0 * c3 + x * (4.0 * c4 + (5.0 * x) * c5)))
    second = 2.0 * c2 + x * (6.0 * c3 + x * (12.0 * c4 + (20.0 * x) * c5))
    return scale * first, (scale * scale) * second


@compiled(inner=True, fastmath=FUSED)
def derivative_bounds(grid: Intervals, i: int, joint: int) -> tuple[Vector, Vector]:
    """Bound |d3q_ds3| and |d4q_ds4| on an interval by Taylor expansion about its middle."""
    k = grid.piece[i]
    scale = 1.0 / (grid.breaks[k + 1] - grid.breaks[k])
    begin = grid.breaks[k]
    middle = ((grid.s[i] + grid.s[i + 1]) / 2 - begin) * scale
    half = (grid.s[i + 1] - grid.s[i]) / 2 * scale
    cube = scale * scale * scale
    c3 = _coefficients(grid, i, joint, 3)
    c4 = _coefficients(grid, i, joint, 4)
    c5 = _coefficients(grid, i, joint, 5)
    q5 = 120.0 * size(c5)
    q4 = size(24.0 * c4 + (120.0 * middle) * c5) + half * q5
    q3 = size(6.0 * c3 + middle * (24.0 * c4 + (60.0 * middle) * c5))
    return cube * (q3 + half * (q4 - (half / 2) * q5)), (cube * scale) * q4


@compiled(inner=True)
def next_joint(grid: Intervals, joint: int) -> int:
    """Return the first joint of the next group of joint bounds; 0 after the last group."""
    return joint + LANES if joint + LANES < grid.dof else 0
