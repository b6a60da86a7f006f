"""Compiled backward and forward pass: the largest feasible x at all points of a grid."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.core.kernel_cache import FUSED, compiled
from armcontour.core.simd import LANES, choose, higher, highest, load, lower, lowest
from armcontour.planning.topp.friction_rows import MIN_DIVISOR
from armcontour.planning.topp.limit_forms import GridLimits, Intervals, MotionBounds
from armcontour.planning.topp.limit_lines import INSIDE_FACTOR, LimitLines, write_interval_limits
from armcontour.planning.topp.plan_rules import FOUND, STUCK, UNLIMITED, Rules

# Initial x of Newton's method without a ceiling.
LARGEST_X = 1e100
# A Newton step to less than this fraction of x has the rounding error FAR_STEP_ROUNDING, because
# its result is a small difference of large numbers.
FAR_STEP = 1e-3
# Rounding error of such a step, as a fraction of x before the step.
FAR_STEP_ROUNDING = 1e-12
# Relative rounding error of the ends of a range of u.
RANGE_ROUNDING = 1e-9
# Newton steps to the largest x of an interval.
MAX_NEWTON_STEPS = 100
# Numbers of the lanes of a vector.
LANE_NUMBERS = np.arange(float(LANES))
# A number above them, for a lane that is not chosen.
NO_LANE = float(LANES)


class Passes(NamedTuple):
    """Results of a backward and a forward pass, which the next passes change in place.

    The first three are ds² at the grid points [m²/s²], (n + 1,) each.
    """

    cap: FloatArray  # The smaller of the caps on both sides of a point
    reachable: FloatArray  # Largest value from which the end can be reached
    x: FloatArray  # The plan
    largest_mean: FloatArray  # Largest mean u on each interval from the reachable value, (n,)
    # Line of each interval that limits the mean u from below; negative if none, (n,)
    below: IntArray
    # True for intervals that the backward pass has computed again, because their limits or what
    # lies behind them have changed, (n,)
    renewed: BoolArray


@compiled(inner=True, allocates=True)
def make_passes(x: FloatArray) -> Passes:
    """Make the arrays of the passes, before the first one; `x` is the array of the plan."""
    n = len(x) - 1
    return Passes(
        np.empty(n + 1),
        np.empty(n + 1),
        x,
        np.empty(n),
        np.empty(n, np.intp),
        np.empty(n, np.bool_),
    )


@compiled(inner=True, fastmath=FUSED)
def _mean_range(lines: LimitLines, i: int, x: float) -> tuple[float, float]:
    """Return the smallest and the largest mean u on interval i, for x at its start."""
    table = lines.table
    count = lines.width
    slot = i & (len(lines.slot_interval) - 1)
    first = 3 * count * slot
    tilted = x * load(table, first)
    bottom = load(table, first + count) - tilted
    top = load(table, first + 2 * count) - tilted
    for line in range(first + LANES, first + count, LANES):
        tilted = x * load(table, line)
        bottom = higher(bottom, load(table, line + count) - tilted)
        top = lower(top, load(table, line + 2 * count) - tilted)
    low = highest(bottom)
    high = lowest(top)
    for k in range(lines.conics.shape[1]):
        p, q, d0, d1, d2 = lines.conics[slot, k]
        root = math.sqrt(max(d0 + x * (2 * d1 - d2 * x), MIN_DIVISOR))
        low = max(low, -p * x - q - root)
        high = min(high, -p * x - q + root)
    return low, high


class _MeanRange(NamedTuple):
    """Range of the mean u on an interval for x at its start, and how it changes with x."""

    low: float
    high: float
    low_tilt: float  # Negative slope of `low` in x
    high_tilt: float  # Negative slope of `high` in x
    below: int  # Line of the interval that limits the mean u from below; negative if none


class _Start(NamedTuple):
    """Largest x at the start of an interval."""

    x: float
    mean: float  # The largest mean u for this x
    below: int  # Line of the interval that limits the mean u from below; negative if none
    outcome: int  # FOUND, STUCK or UNLIMITED


@compiled(inner=True, fastmath=FUSED)
def _mean_range_slopes(lines: LimitLines, i: int, x: float) -> _MeanRange:
    """Return the mean-u range at x, its negative slopes in x, and the index of its lower line."""
    table = lines.table
    count = lines.width
    slot = i & (len(lines.slot_interval) - 1)
    first = 3 * count * slot
    low = -math.inf
    high = math.inf
    low_tilt = 0.0
    high_tilt = 0.0
    below = -1
    numbers = load(LANE_NUMBERS, 0)
    for line in range(first, first + count, LANES):
        tilted = x * load(table, line)
        bottoms = load(table, line + count) - tilted
        tops = load(table, line + 2 * count) - tilted
        bottom = highest(bottoms)
        top = lowest(tops)
        if bottom > low:
            low = bottom
            lane = int(lowest(choose(bottoms, low, NO_LANE, numbers)))
            below = line - first + lane
            low_tilt = table[line + lane]
        if top < high:
            high = top
            lane = int(lowest(choose(high, tops, NO_LANE, numbers)))
            high_tilt = table[line + lane]
    for k in range(lines.conics.shape[1]):
        p, q, d0, d1, d2 = lines.conics[slot, k]
        root = math.sqrt(max(d0 + x * (2 * d1 - d2 * x), MIN_DIVISOR))
        tilt = (d1 - d2 * x) / root
        bottom = -p * x - q - root
        top = -p * x - q + root
        if top < high:
            high = top
            high_tilt = p - tilt
        if bottom > low:
            low = bottom
            low_tilt = p + tilt
            below = -1
    return _MeanRange(low, high, low_tilt, high_tilt, below)


@compiled(inner=True)
def _fastest_start(lines: LimitLines, w: float, ceiling: FloatArray) -> float:
    """Return the start value of ds² with which the first interval is fastest.

    It is free if dq_ds vanishes at the start, because then the joints rest there at any ds.
    """
    # A ds² slightly below the largest one may allow a far larger u, because dq_ds is rounded.
    best = ceiling[0]
    fastest = 0.0
    for k in range(60, -1, -1):
        first = ceiling[0] * (1 - 0.5**k) if k < 60 else ceiling[0]
        _, high = _mean_range(lines, 0, first)
        last = min(first + 2 * w * high, ceiling[1])
        speeds = math.sqrt(first) + math.sqrt(max(last, 0.0))
        if speeds > fastest:
            best = first
            fastest = speeds
    return float(best)


@compiled(inner=True, fastmath=FUSED)
def _largest_start(
    lines: LimitLines, i: int, w: float, ceiling: float, last: float, below: int
) -> _Start:
    """Find the largest x at the start of interval i from which x at its end is at most `last`.

    The range of the mean u is concave in x and not empty for x = 0, so Newton steps from the
    ceiling converge to the largest x with a range.

    - `w`: length of the interval.
    - `below`: the line that limits the mean u from below on interval i + 1, or -1.
    """
    steep = 0.5 / w
    x = ceiling
    high = 0.0
    # The same line on interval i and the largest x at its end give a first upper bound of x.
    if below >= 0:
        line = 3 * lines.width * (i & (len(lines.slot_interval) - 1)) + below
        tilt = lines.table[line]
        bottom = lines.table[line + lines.width]
        if tilt < steep and last * steep - bottom < (steep - tilt) * x:
            x = max((last * steep - bottom) / (steep - tilt) * INSIDE_FACTOR, 0.0)
    for _ in range(MAX_NEWTON_STEPS):
        low, high = _mean_range(lines, i, x)
        if low == -math.inf or high == math.inf:
            return _Start(x, high, below, UNLIMITED)
        high = min(high, (last - x) * steep)
        if max(low, -x * steep) <= high:
            return _Start(x, high, below, FOUND)
        # Newton step, also within the limits `0 <= x at the end <= last`
        low, high, low_tilt, high_tilt, below = _mean_range_slopes(lines, i, x)
        if (last - x) * steep < high:
            high = (last - x) * steep
            high_tilt = steep
        if -x * steep > low:
            low = -x * steep
            low_tilt = steep
        following = x - (low - high) / (high_tilt - low_tilt)
        # Near zero, x is a difference of large numbers, so a step ends slightly above the root.
        if following > FAR_STEP * x:
            x = following * INSIDE_FACTOR
        else:
            x = max(following, 0.0) + FAR_STEP_ROUNDING * x
    return _Start(x, high, below, STUCK)


@compiled(inner=True, fastmath=FUSED)
def backward_forward_pass(
    grid: Intervals,
    limits: GridLimits,
    bounds: MotionBounds,
    state: tuple[BoolArray, bool],
    lines: LimitLines,
    rules: Rules,
    passes: Passes,
) -> int:
    """Write the limits and the largest feasible x, by a backward and a forward pass.

    The method is that of TOPP-RA (Pham and Pham, IEEE Trans. Robotics 34, 645-659, 2018), with
    intervals on which u is linear in s; docs/concepts/time_optimal.md, "Reachability".

    Returns -1 if a plan was found, the index of an interval on which no motion is allowed, or n
    plus the index of an interval without limits.

    - `state`: mask of the intervals whose limits have changed since the previous pass, (n,), and
      true for limits with margins. If the previous pass found no plan, all must count as changed.
    - `passes`: results of the previous pass, and output. Where neither the limits nor the
      neighbouring values change, the previous results are kept, because they would be the same.
    """
    stuck = _backward_pass(grid, limits, bounds, state, lines, rules, passes)
    if stuck < 0:
        stuck = _forward_pass(grid, limits, bounds, state, lines, rules, passes)
    return stuck


@compiled(inner=True, fastmath=FUSED)
def _backward_pass(
    grid: Intervals,
    limits: GridLimits,
    bounds: MotionBounds,
    state: tuple[BoolArray, bool],
    lines: LimitLines,
    rules: Rules,
    passes: Passes,
) -> int:
    """Write the largest x from which the end can be reached, and its largest mean u."""
    changed, margins = state
    cap = passes.cap
    reachable = passes.reachable
    n = len(grid.piece)
    stuck = -1
    slots = len(lines.slot_interval) - 1
    # True if x at the end of the interval, or the line that limits u behind it, has changed
    moved = False
    # The limits of interval i - 1 are computed one step early, to hide memory latency.
    for i in range(n, -1, -1):
        renew = moved
        if i < n:
            renew |= changed[i]
        if i > 0 and changed[i - 1]:
            write_interval_limits(grid, limits, bounds, i - 1, margins, lines)
            renew = True
        if i < n:
            passes.renewed[i] = renew
        if not renew:
            continue
        # The ceiling of x at point i is the smaller one of both adjacent intervals.
        ceiling = math.inf
        if i > 0:
            ceiling = lines.cap[i - 1, 1]
        if i < n:
            ceiling = min(ceiling, lines.cap[i, 0])
        cap[i] = ceiling
        if i == n:
            last = min(rules.end, ceiling, LARGEST_X)
            moved = last != reachable[n]
            reachable[n] = last
            continue
        if lines.slot_interval[i & slots] != i:
            write_interval_limits(grid, limits, bounds, i, margins, lines)
        # Once stuck, the pass only searches for an interval without limits.
        if stuck >= n:
            low, high = _mean_range(lines, i, 0.0)
            if low > -math.inf and high < math.inf:
                break
            stuck = n + i
        if stuck >= 0:
            continue
        w = grid.s[i + 1] - grid.s[i]
        below = passes.below[i + 1] if i < n - 1 else -1
        start = _largest_start(lines, i, w, min(ceiling, LARGEST_X), reachable[i + 1], below)
        moved = start.x != reachable[i] or start.below != passes.below[i]
        reachable[i] = start.x
        passes.largest_mean[i] = start.mean
        passes.below[i] = start.below
        if start.outcome != FOUND:
            stuck = i if start.outcome == STUCK else n + i
            moved = True
            if i > 0:
                # A pass that is stuck does not limit x at the start.
                reachable[0] = math.inf
    return stuck


@compiled(inner=True, fastmath=FUSED)
def _forward_pass(
    grid: Intervals,
    limits: GridLimits,
    bounds: MotionBounds,
    state: tuple[BoolArray, bool],
    lines: LimitLines,
    rules: Rules,
    passes: Passes,
) -> int:
    """Write the largest x that can be reached from the start, at most the reachable one."""
    _, margins = state
    reachable = passes.reachable
    x = passes.x
    slots = len(lines.slot_interval) - 1
    # True if x at the start of the interval has changed
    moved = False
    if passes.renewed[0]:
        first = min(rules.start, reachable[0])
        if rules.start == math.inf:
            first = _fastest_start(lines, grid.s[1] - grid.s[0], reachable)
        moved = first != x[0]
        x[0] = first
    for i in range(len(grid.piece)):
        if not (moved or passes.renewed[i]):
            continue
        w = grid.s[i + 1] - grid.s[i]
        mean = passes.largest_mean[i]
        if x[i] < reachable[i]:
            if lines.slot_interval[i & slots] != i:
                write_interval_limits(grid, limits, bounds, i, margins, lines)
            low, high = _mean_range(lines, i, x[i])
            steep = 0.5 / w
            mean = min(high, (reachable[i + 1] - x[i]) * steep)
            if low > mean + RANGE_ROUNDING * (abs(low) + abs(mean) + reachable[i + 1] * steep):
                return i
        last = min(max(x[i] + 2 * w * mean, 0.0), reachable[i + 1])
        moved = last != x[i + 1]
        x[i + 1] = last
    return -1
