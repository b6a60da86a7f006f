"""Compiled range of u at an end of an interval for a given x, and the limits that are active."""

from __future__ import annotations

import math
from typing import NamedTuple

from armcontour.core.kernel_cache import FUSED, compiled
from armcontour.core.simd import LANES, choose, higher, highest, load, lower, lowest, size
from armcontour.planning.topp.joint_derivatives import next_joint, path_slopes
from armcontour.planning.topp.limit_forms import (
    HIGH,
    HIGHEST,
    LANE,
    LOW,
    LOWEST,
    ROWS,
    A,
    B,
    GridLimits,
    Intervals,
    Rounds,
)
from armcontour.planning.topp.limit_lines import NEGLIGIBLE_COEFFICIENT


class AccelerationRange(NamedTuple):
    """Range of u at one end of an interval within all limits, for a given x.

    The active limits are coded as 2 r for the lower bound of row r and 2 r + 1 for its upper bound,
    where vector norms follow the rows; and as -2 - c for joint bounds, where c is twice the joint,
    plus 1 for an upper bound.
    """

    low: float  # Smallest u [m/s²]
    high: float  # Largest u [m/s²]
    narrowest: float  # Width of the range within the tightest single limit [m/s²]
    below: int  # Active limit at the smallest u; -1 for none
    above: int  # Active limit at the largest u; -1 for none


@compiled(inner=True, fastmath=FUSED)
def _round_range(rounds: Rounds, i: int, end: int, r: int, x: float) -> tuple[float, float]:
    """Return smallest and largest u at one end of interval i within limit r of a vector norm."""
    aa = ab = bb = 0.0
    for d in range(3):
        a = rounds.ends[i, end, r, A, d]
        b = rounds.ends[i, end, r, B, d] * x
        aa = aa + a * a
        ab = ab + a * b
        bb = bb + b * b
    if aa == 0.0:
        return -math.inf, math.inf
    root = math.sqrt(max(ab * ab - aa * (bb - rounds.radius[i, r] ** 2), 0.0))
    return (-ab - root) / aa, (-ab + root) / aa


@compiled(inner=True, fastmath=FUSED)
def _joint_acceleration_range(
    grid: Intervals, limits: GridLimits, location: tuple[int, int, int, int], x: float
) -> AccelerationRange:
    """Return the range of u within a group of joint bounds; its active limits are coded as c.

    `location` is interval, end, group and first joint.
    """
    i, end, group, joint = location
    offset = ROWS * group
    a, b = path_slopes(grid, i, joint, end)
    magnitude = size(a)
    inverse = 1.0 / choose(NEGLIGIBLE_COEFFICIENT, magnitude, a, 1.0)
    smallest = load(limits.joints, offset + LOWEST)
    largest = load(limits.joints, offset + HIGHEST)
    one = (smallest - x * b) * inverse
    other = (largest - x * b) * inverse
    bottom = choose(NEGLIGIBLE_COEFFICIENT, magnitude, lower(one, other), -math.inf)
    top = choose(NEGLIGIBLE_COEFFICIENT, magnitude, higher(one, other), math.inf)
    low = highest(bottom)
    high = lowest(top)
    # The active bounds are coded as twice the joint, plus one for an upper bound.
    lane = load(limits.joints, offset + LANE)
    below = highest(choose(bottom, low, -1.0, lane + choose(a, 0.0, 1.0, 0.0)))
    above = highest(choose(high, top, -1.0, lane + choose(a, 0.0, 0.0, 1.0)))
    narrowest = lowest(
        choose(NEGLIGIBLE_COEFFICIENT, magnitude, size((largest - smallest) * inverse), math.inf)
    )
    first = 2 * LANES * group
    return AccelerationRange(low, high, narrowest, int(below) + first, int(above) + first)


@compiled(inner=True, fastmath=FUSED)
def acceleration_range(
    grid: Intervals, limits: GridLimits, i: int, end: int, x: float
) -> AccelerationRange:
    """Return the range of u at one end of interval i, for the value x of ds² there."""
    rows = limits.rows.ends
    viscous = limits.friction.viscous
    rounds = limits.rounds
    low = -math.inf
    high = math.inf
    narrowest = math.inf
    below = -1
    above = -1
    joint = 0
    for group in range(len(limits.joints) // ROWS):
        joints = _joint_acceleration_range(grid, limits, (i, end, group, joint), x)
        joint = next_joint(grid, joint)
        narrowest = min(narrowest, joints.narrowest)
        if joints.low > low:
            low = joints.low
            below = -2 - joints.below
        if joints.high < high:
            high = joints.high
            above = -2 - joints.above
    for r in range(rows.shape[2]):
        a = rows[i, end, r, A]
        by_x = rows[i, end, r, B] * x
        if a == 0.0:
            continue
        if r < viscous.shape[2]:
            by_x += viscous[i, end, r] * math.sqrt(x)
        inverse = 1.0 / a
        narrowest = min(narrowest, (rows[i, end, r, HIGH] - rows[i, end, r, LOW]) * abs(inverse))
        first = (rows[i, end, r, LOW] - by_x) * inverse
        last = (rows[i, end, r, HIGH] - by_x) * inverse
        bottom = 2 * r
        top = 2 * r + 1
        if inverse < 0.0:
            first, last, bottom, top = last, first, top, bottom
        if first > low:
            low = first
            below = bottom
        if last < high:
            high = last
            above = top
    for r in range(rounds.radius.shape[1]):
        first, last = _round_range(rounds, i, end, r, x)
        narrowest = min(narrowest, last - first)
        if first > low:
            low = first
            below = 2 * (rows.shape[2] + r)
        if last < high:
            high = last
            above = 2 * (rows.shape[2] + r) + 1
    return AccelerationRange(low, high, narrowest, below, above)


class LastRange(NamedTuple):
    """Range of u at the end of the interval that was examined last."""

    interval: int  # Index of the interval
    range: AccelerationRange


@compiled(inner=True, fastmath=FUSED)
def no_range() -> LastRange:
    """Return the state before the first interval."""
    return LastRange(-2, AccelerationRange(-math.inf, math.inf, math.inf, -1, -1))


@compiled(inner=True, fastmath=FUSED)
def joins_previous(grid: Intervals, limits: GridLimits, i: int) -> bool:
    """Return whether limits at the start of interval i are those at the end of the previous one.

    The bounds of joints are continuous on a piece of the joint path. Limits that are written for
    each interval may jump at any grid point.
    """
    written = limits.rows.rise.shape[1] + limits.rounds.radius.shape[1]
    written += limits.squares.largest.shape[1] + limits.friction.within.shape[1]
    return written == 0 and i > 0 and grid.piece[i - 1] == grid.piece[i]


@compiled(inner=True, fastmath=FUSED)
def range_at_start(
    grid: Intervals, limits: GridLimits, i: int, x: float, last: LastRange
) -> AccelerationRange:
    """Return the range of u at the start of interval i; reuse that at the previous interval's end.

    The value x of ds² must be the one for which `last` was computed.
    """
    if last.interval == i - 1 and joins_previous(grid, limits, i):
        return last.range
    return acceleration_range(grid, limits, i, 0, x)
