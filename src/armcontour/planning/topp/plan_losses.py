"""Compiled estimate of the time that a plan on a grid loses against the fastest motion."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.kernel_cache import FUSED, compiled
from armcontour.core.simd import choose, highest, load
from armcontour.motion.kernels import interval_time
from armcontour.planning.topp.acceleration_range import (
    AccelerationRange,
    LastRange,
    acceleration_range,
    joins_previous,
    no_range,
    range_at_start,
)
from armcontour.planning.topp.joint_derivatives import next_joint, path_slopes
from armcontour.planning.topp.limit_forms import BACKWARD, FORWARD, ROWS, GridLimits, Intervals
from armcontour.planning.topp.plan_rules import PlanArrays

# A plan loses no time where u is at its bound within this fraction of its range.
AT_BOUND_FOR_LOSSES = 0.02
# Lost share of the time of an interval per unused share of the range of u, inside the motion. The
# factor was measured against finer grids; it is too large where the range is small compared with u.
BY_GAP = 0.25
# The same factor for an interval that begins or ends at rest.
BY_GAP_AT_REST = 1.5
# Let u be at its lower bound at one end of an interval and at its upper bound at the other end,
# because of different limits. If at least this share of the range of u is then unused, x may be too
# low by an unknown factor, and the time to reach a higher x may be lost.
CROSSED = 0.4
# Such a time counts as lost only if x times this factor allows a range of u at both ends.
LARGER_X = 1.02
# This loss extends over this share of the length in which x changes by its own value.
VALLEY_REACH = 0.05
# A lost share of the time of an interval below this is not examined.
NEGLIGIBLE_LOSS = 1e-6
# A new grid point closer to an interval end than this share saves no time.
NO_GAIN_SHARE = 0.02


@compiled(inner=True, fastmath=FUSED)
def _largest_square(grid: Intervals, limits: GridLimits, i: int, end: int) -> float:
    """Return the largest x at one end of interval i that the limits of speed allow [m²/s²]."""
    steepest = 0.0
    joint = 0
    for group in range(len(limits.joints) // ROWS):
        a, _ = path_slopes(grid, i, joint, end)
        joint = next_joint(grid, joint)
        offset = ROWS * group
        back = load(limits.joints, offset + BACKWARD)
        forth = load(limits.joints, offset + FORWARD)
        steepest = max(steepest, highest(a * a * choose(a, 0.0, back, forth)))
    for r in range(limits.squares.largest.shape[1]):
        steepest = max(steepest, limits.squares.ends[i, end, r])
    return float(1.0 / steepest)


@compiled(inner=True)
def _shortest_time(
    w: float, x: tuple[float, float], rates: tuple[float, float], ceiling: float
) -> tuple[float, float]:
    """Return the shortest time through an interval [s], and the switch point as a fraction of it.

    - `w`: length of the interval.
    - `x`: values of x at its ends.
    - `rates`: largest u and largest -u.
    - `ceiling`: largest x between the ends.
    """
    # x rises by 2 u per metre up to the switch point, and then falls.
    up, down = 2 * rates[0], 2 * rates[1]
    first = min(max((x[1] - x[0] + down * w) / (up + down), 0.0), w)
    top = x[0] + up * first
    last_switch = first
    if top > ceiling:
        # x stays at the ceiling between two switch points.
        top = max(ceiling, x[0], x[1])
        first = min((top - x[0]) / up, w)
        last_switch = w - min((top - x[1]) / down, w)
    speeds = math.sqrt(x[0]), math.sqrt(top), math.sqrt(x[1])
    time = interval_time(first, speeds[0], speeds[1], 0.0) if first > 0.0 else 0.0
    if last_switch < w:
        time += interval_time(w - last_switch, speeds[1], speeds[2], 0.0)
    if last_switch > first:
        time += (last_switch - first) / speeds[1]
    share = first / w if first > NO_GAIN_SHARE * w else last_switch / w
    return time, share


class _Motion(NamedTuple):
    """Motion of a plan on one interval."""

    x: tuple[float, float]  # ds² at the start and the end [m²/s²]
    w: float  # Length of the interval [m]
    mean: float  # Mean u [m/s²]
    turn: float  # Half of the change of u [m/s²]
    time: float  # Duration [s]


class _Unused(NamedTuple):
    """Unused shares of the u ranges at both ends of an interval."""

    up: tuple[float, float]  # Up to the upper bound
    down: tuple[float, float]  # Down to the lower bound


@compiled(inner=True, allocates=True, fastmath=FUSED)
def estimate_losses(grid: Intervals, limits: GridLimits, plan: PlanArrays) -> float:
    """Estimate the time that a plan loses by its grid and its slopes; return its sum [s].

    The plan has its time law. `plan.loss` and `plan.point` are written.

    On each interval, half of the time that margins cost is added to one of three losses: a bound of
    u that only one end reaches, bounds of different limits that both ends reach, or the difference
    from the shortest time within the mean range of u. Near a ceiling of the speed, the loss is at
    most the time by which the ceiling would be passed faster.
    """
    valley = np.zeros(len(plan.k))
    previous = no_range()
    ceiling = math.inf
    for i in range(len(plan.k)):
        if not joins_previous(grid, limits, i):
            ceiling = _largest_square(grid, limits, i, 0)
        end_ceiling = _largest_square(grid, limits, i, 1)
        ceilings = min(limits.ceiling[i, 0], ceiling), min(limits.ceiling[i, 1], end_ceiling)
        previous = _write_loss(grid, limits, plan, i, ceilings, previous, valley)
        ceiling = end_ceiling
    total = 0.0
    for i in range(len(plan.k)):
        plan.loss[i] += valley[i]
        total += plan.loss[i]
    return total


@compiled(inner=True, fastmath=FUSED)
def _write_loss(
    grid: Intervals,
    limits: GridLimits,
    plan: PlanArrays,
    i: int,
    ceilings: tuple[float, float],
    previous: LastRange,
    valley: FloatArray,
) -> LastRange:
    """Write the loss of interval i and its point; where x may be too low, also write `valley`.

    `ceilings` are the largest x at both ends. Returns the range of u at the end, if it was needed.
    """
    motion = _motion_on(grid, plan, i)
    plan.point[i] = grid.s[i]
    loss = motion.time * plan.lost[i] / 2
    near = AT_BOUND_FOR_LOSSES + plan.lost[i]
    most = math.inf
    if _is_at_ceiling(motion, ceilings, near):
        # Margins, or u at its bound on the way to the ceiling, may explain a slower motion.
        most = motion.time * max(1 - _ceiling_use(motion, ceilings), 0.0)
        if most <= loss + NEGLIGIBLE_LOSS * motion.time:
            plan.loss[i] = most
            return previous
    first = range_at_start(grid, limits, i, motion.x[0], previous)
    last = acceleration_range(grid, limits, i, 1, motion.x[1])
    previous = LastRange(i, last)
    if not (first.narrowest < math.inf or last.narrowest < math.inf):
        plan.loss[i] = min(loss, most)
        return previous
    unused = _unused_shares(motion, first, last)
    rising = min(unused.up[0], unused.up[1]) < near
    falling = min(unused.down[0], unused.down[1]) < near
    up = (unused.up[0] + unused.up[1]) / 2
    down = (unused.down[0] + unused.down[1]) / 2
    by_gap = BY_GAP if motion.x[0] > 0.0 and motion.x[1] > 0.0 else BY_GAP_AT_REST
    if rising != falling:
        loss += by_gap * motion.time * max(up if rising else down, 0.0)
    else:
        # u switches between its bounds inside the interval.
        gap = min(up, down)
        crossed = first.above != last.below and first.below != last.above
        if rising and crossed and gap > CROSSED:
            _add_valley(grid, limits, i, motion, (first, last), by_gap * gap, valley)
        rates = (first.high + last.high) / 2, -(first.low + last.low) / 2
        if rates[0] > motion.mean and -rates[1] < motion.mean:
            shortest, share = _shortest_time(
                motion.w, motion.x, rates, max(ceilings[0], ceilings[1])
            )
            loss += max(motion.time - shortest, 0.0)
            if NO_GAIN_SHARE < share < 1 - NO_GAIN_SHARE:
                plan.point[i] += share * motion.w
    plan.loss[i] = min(loss, most)
    return previous


@compiled(inner=True, fastmath=FUSED)
def _motion_on(grid: Intervals, plan: PlanArrays, i: int) -> _Motion:
    """Return the motion of a plan on interval i."""
    w = grid.s[i + 1] - grid.s[i]
    x0 = plan.x[i]
    x1 = plan.x[i + 1]
    time = plan.breaks[i + 1] - plan.breaks[i]  # Subject to the rounding of the whole duration
    return _Motion((x0, x1), w, (x1 - x0) / (2 * w), plan.k[i] * w / 2, time)


@compiled(inner=True, fastmath=FUSED)
def _is_at_ceiling(motion: _Motion, ceilings: tuple[float, float], near: float) -> bool:
    """Return whether x moves at most the share `near` below its ceilings at both ends."""
    x0, x1 = motion.x
    top0, top1 = ceilings
    return x0 > 0.0 and x1 > 0.0 and x0 >= (1 - near) * top0 and x1 >= (1 - near) * top1


@compiled(inner=True, fastmath=FUSED)
def _ceiling_use(motion: _Motion, ceilings: tuple[float, float]) -> float:
    """Return the mean fraction of the largest speeds at both ends that a motion uses."""
    return (math.sqrt(motion.x[0] / ceilings[0]) + math.sqrt(motion.x[1] / ceilings[1])) / 2


@compiled(inner=True, fastmath=FUSED)
def _unused_shares(motion: _Motion, first: AccelerationRange, last: AccelerationRange) -> _Unused:
    """Return the unused shares of the range of u; without a limit of u, those of the other end."""
    mean = motion.mean
    turn = motion.turn
    up0 = (first.high - mean + turn) / first.narrowest
    up1 = (last.high - mean - turn) / last.narrowest
    down0 = (mean - turn - first.low) / first.narrowest
    down1 = (mean + turn - last.low) / last.narrowest
    if not first.narrowest < math.inf:
        up0, down0 = up1, down1
    if not last.narrowest < math.inf:
        up1, down1 = up0, down0
    return _Unused((up0, up1), (down0, down1))


@compiled(inner=True, fastmath=FUSED)
def _add_valley(
    grid: Intervals,
    limits: GridLimits,
    i: int,
    motion: _Motion,
    ends: tuple[AccelerationRange, AccelerationRange],
    share: float,
    valley: FloatArray,
) -> None:
    """Add the time that is lost around interval i because x is too low there, to `valley`, (n,).

    `share` is the lost share of the range of u, and `ends` are the ranges of u at both ends.
    """
    x0, x1 = motion.x
    first, last = ends
    s = grid.s
    higher_first = acceleration_range(grid, limits, i, 0, LARGER_X * x0)
    higher_last = acceleration_range(grid, limits, i, 1, LARGER_X * x1)
    if not (higher_first.low < higher_first.high and higher_last.low < higher_last.high):
        return
    rate = max(max(abs(first.low), abs(first.high)), max(abs(last.low), abs(last.high)))
    narrow = min(higher_first.high - higher_first.low, higher_last.high - higher_last.low)
    wrong = share * math.sqrt(x0) / narrow
    reach = max(VALLEY_REACH * min(x0, x1) / rate, motion.w)
    begin = end = i
    while begin > 0 and s[i] - s[begin] < reach:
        begin -= 1
    while end < len(valley) - 1 and s[end] - s[i] < reach:
        end += 1
    # Numba compiles an assigned slice for seconds.
    for j in range(begin, end + 1):
        valley[j] = max(valley[j], wrong)
