"""Compiled plan on a grid, first without margins, then with margins that are proven to suffice.

On each interval u is linear in s with a slope k that is chosen in advance. With the mean m of u and
the half change t = k w / 2, u is m - t and m + t at the ends, and x at the end is x + 2 w m. All
limits of an interval are therefore half-planes and conics in the plane of x and m: `limit_lines`
writes them, and `reachability_passes` finds the largest x. docs/concepts/time_optimal.md has the
derivation.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray
from armcontour.core.kernel_cache import FUSED, compiled
from armcontour.motion.kernels import interval_time, write_law
from armcontour.planning.topp.acceleration_range import (
    LastRange,
    acceleration_range,
    no_range,
    range_at_start,
)
from armcontour.planning.topp.limit_forms import Friction, GridLimits, Intervals, MotionBounds
from armcontour.planning.topp.limit_lines import LimitLines, make_lines
from armcontour.planning.topp.plan_losses import estimate_losses
from armcontour.planning.topp.plan_rules import (
    END,
    FINER,
    FOUND,
    START,
    STUCK,
    UNLIMITED,
    PlanArrays,
    Rules,
)
from armcontour.planning.topp.reachability_passes import (
    Passes,
    backward_forward_pass,
    make_passes,
)

# Relative tolerance of x at the start and the end of the path.
END_SQUARE_TOLERANCE = 1e-7
# A slope is chosen if u is at its bound within this fraction of its range.
AT_BOUND_FOR_SLOPES = 0.01
# Above this fraction of its ceiling, x is limited by the ceiling only.
BELOW_CEILING = 1 - 1e-6
# Largest change of u by a slope, as a fraction of its range.
LARGEST_TURN = 0.25
# Margin reported for intervals without a plan, because a finer grid may have a plan.
NO_PLAN_MARGIN = 4e-2
# Intervals closer than this (in indices) to the one where the plan fails are refined.
REFINED_NEIGHBOURS = 10


class PlanOutcome(NamedTuple):
    """Whether a plan was found, or the reason why none exists."""

    outcome: int  # FOUND, or FINER, STUCK, START, END, UNLIMITED
    interval: int  # Interval at which the plan fails, or -1
    allowed: float  # With START and END: the largest feasible ds² at this end [m²/s²]


class TimedOutcome(NamedTuple):
    """A `PlanOutcome`, and what is known of the time law of a plan that was found."""

    outcome: int
    interval: int
    allowed: float
    resting: int  # First interval that begins and ends at rest, or -1
    lost_time: float  # Estimated loss of time by the grid and the slopes [s]


class GridPlan(NamedTuple):
    """A plan with its time law, or the reason why none exists.

    The first fields are those of `PlanArrays`, the last ones those of `TimedOutcome`. Without a
    plan, there is no law.
    """

    x: FloatArray
    k: FloatArray
    lost: FloatArray
    breaks: FloatArray
    ds: FloatArray
    dds: FloatArray
    loss: FloatArray
    point: FloatArray
    outcome: int
    interval: int
    allowed: float
    resting: int
    lost_time: float

    @property
    def duration(self) -> float:
        """Duration of the plan [s]."""
        return float(self.breaks[-1])


@compiled(inner=True, fastmath=FUSED)
def _choose_slopes(
    grid: Intervals, limits: GridLimits, cap: FloatArray, x: FloatArray, bounds: MotionBounds
) -> None:
    """Write slopes k with which u stays at its bound on the whole interval."""
    previous = no_range()
    for i in range(len(grid.piece)):
        w = grid.s[i + 1] - grid.s[i]
        x0 = x[i]
        x1 = x[i + 1]
        bounds.k[i] = 0.0
        if not (0.0 < x0 < cap[i] * BELOW_CEILING and 0.0 < x1 < cap[i + 1] * BELOW_CEILING):
            continue
        mean = (x1 - x0) / (2 * w)
        first = range_at_start(grid, limits, i, x0, previous)
        last = acceleration_range(grid, limits, i, 1, x1)
        previous = LastRange(i, last)
        to_low = min((mean - first.low) / first.narrowest, (mean - last.low) / last.narrowest)
        to_high = min((first.high - mean) / first.narrowest, (last.high - mean) / last.narrowest)
        turn = 0.0
        if to_high < AT_BOUND_FOR_SLOPES:
            turn = last.high - first.high
            if to_low < AT_BOUND_FOR_SLOPES:
                # If u is at both bounds, for example because of two joints, the mean change is
                # used.
                turn = (turn + last.low - first.low) / 2
        elif to_low < AT_BOUND_FOR_SLOPES:
            turn = last.low - first.low
        small = abs(turn) < LARGEST_TURN * min(first.narrowest, last.narrowest)
        # x must not fall far below its values at the ends.
        if small and 8 * turn * w <= x0 + x1:
            bounds.k[i] = turn / w


@compiled(inner=True, fastmath=FUSED)
def _motion_extent(
    width: FloatArray, x: FloatArray, k: FloatArray, i: int
) -> tuple[float, float, float]:
    """Return the largest x, the smallest x and the largest |u| of a motion on interval i."""
    w = width[i]
    first = x[i]
    last = x[i + 1]
    mean = (last - first) / (2 * w)
    turn = abs(k[i]) * w / 2
    sag = turn * w / 2
    return max(first, last) + sag, max(min(first, last) - sag, 0.0), abs(mean) + turn


@compiled(inner=True, allocates=True, fastmath=FUSED)
def _bound_motion(
    width: FloatArray, x: FloatArray, rules: Rules, headroom: float, bounds: MotionBounds
) -> None:
    """Write bounds of x and u around a plan."""
    # The bound of u includes the neighbours of an interval, because switching points move between
    # plans.
    n = len(width)
    fastest = 0.0
    rates = np.empty(n)
    for i in range(n):
        largest, smallest, rates[i] = _motion_extent(width, x, bounds.k, i)
        bounds.x[i] = headroom * largest
        bounds.x_min[i] = smallest / headroom
        fastest = max(fastest, rates[i])
    for i in range(n):
        largest_u = rules.floor * min(fastest, bounds.x[i] / width[i])
        for m in range(max(i - rules.window, 0), min(i + rules.window + 1, n)):
            largest_u = max(largest_u, headroom * rates[m])
        bounds.u[i] = largest_u


@compiled(inner=True, fastmath=FUSED)
def _prove_or_widen(
    width: FloatArray,
    x: FloatArray,
    rules: Rules,
    bounds: MotionBounds,
    has_friction: bool,
    changed: BoolArray,
) -> bool:
    """Test whether the plan is within its bounds, so that margins suffice; otherwise widen them."""
    holds = True
    for i in range(len(width)):
        largest, smallest, rate = _motion_extent(width, x, bounds.k, i)
        outside = largest > bounds.x[i] or rate > bounds.u[i]
        if has_friction and smallest < bounds.x_min[i]:
            outside = True
            bounds.x_min[i] = smallest / (rules.headroom * rules.headroom)
        if outside:
            bounds.x[i] = max(bounds.x[i], rules.headroom * largest)
            bounds.u[i] = max(bounds.u[i], 1.2 * rate)
        speeds = math.sqrt(x[i]) + math.sqrt(x[i + 1])
        # x would fall far below its values at the ends
        if 4 * bounds.k[i] * width[i] ** 2 > speeds**2:
            bounds.k[i] = 0.0
            outside = True
        changed[i] = outside
        holds &= not outside
    return holds


@compiled(inner=True)
def _largest_margin(lost: FloatArray) -> int:
    """Return the interval whose margins take the largest fraction of a limit."""
    worst = 0
    for i in range(len(lost)):
        if lost[i] > lost[worst]:
            worst = i
    return worst


@compiled(inner=True)
def _duration(width: FloatArray, x: FloatArray, k: FloatArray) -> float:
    """Return the duration [s] of a motion, from ds² at all grid points and the slopes k."""
    total = 0.0
    for i in range(len(width)):
        total += interval_time(width[i], math.sqrt(x[i]), math.sqrt(x[i + 1]), k[i])
    return total


@compiled(inner=True)
def _linearize_friction(x: FloatArray, bounds: MotionBounds, near: float) -> bool:
    """Linearize friction about a plan, and test whether the plan is close to the previous one."""
    is_near = True
    for i in range(len(bounds.x)):
        middle = (x[i] + x[i + 1]) / 2
        is_near &= abs(middle - bounds.x[i]) <= near * bounds.x[i]
        bounds.x[i] = bounds.x_min[i] = middle
    return is_near


@compiled(inner=True)
def _drop_slopes(
    bounds: MotionBounds, lost: FloatArray, max_margin: float, changed: BoolArray
) -> bool:
    """Set slopes to zero where margins exceed `max_margin`, and return whether any was set."""
    dropped = False
    for i in range(len(lost)):
        changed[i] = lost[i] > max_margin and bounds.k[i] != 0.0
        if changed[i]:
            bounds.k[i] = 0.0
            dropped = True
    return dropped


class _Work(NamedTuple):
    """Arrays that all phases of a plan change in place."""

    width: FloatArray  # Lengths of the intervals [m], (n,)
    bounds: MotionBounds
    lines: LimitLines
    passes: Passes
    changed: BoolArray  # True for intervals whose limits the next pass writes anew, (n,)


def plan_on_grid(grid: Intervals, limits: GridLimits, rules: Rules) -> GridPlan:
    """Plan without margins, then with margins for bounds of x and u that contain the plan.

    If `rules.tries` is 1, the result is the plan without margins, with the outcome FINER.
    """
    # Numba takes longer to return an array than NumPy to make one.
    n = len(grid.piece)
    arrays = PlanArrays(
        x=np.zeros(n + 1),
        k=np.zeros(n),
        lost=np.zeros(n),
        breaks=np.empty(n + 1),
        ds=np.empty(n),
        dds=np.empty(n),
        loss=np.empty(n),
        point=np.empty(n),
    )
    return GridPlan(*arrays, *write_plan(grid, limits, rules, arrays))


@compiled()
def write_plan(
    grid: Intervals, limits: GridLimits, rules: Rules, arrays: PlanArrays
) -> TimedOutcome:
    """Write a plan, its time law and its losses, if a plan is found; x, k and lost begin as zero.

    The phases are a plan without friction and margins, plans with friction that is linearized about
    the previous plan, and plans with margins. They share `rules.tries` passes.
    """
    found = _find_plan(grid, limits, rules, arrays)
    resting = -1
    lost_time = 0.0
    if found.outcome == FOUND:
        resting = write_law(grid.s, arrays.x, arrays.k, arrays.breaks, arrays.ds, arrays.dds)
        if rules.estimates_loss and resting < 0:
            lost_time = estimate_losses(grid, limits, arrays)
    return TimedOutcome(found.outcome, found.interval, found.allowed, resting, lost_time)


@compiled(inner=True, allocates=True)
def _find_plan(
    grid: Intervals, limits: GridLimits, rules: Rules, arrays: PlanArrays
) -> PlanOutcome:
    """Write x, k and lost of a plan; return whether it was found."""
    x = arrays.x
    has_friction = limits.friction.within.shape[1] > 0
    work = _make_work(grid, limits, arrays)
    found = _plan_free(grid, limits, rules, work)
    tries = rules.tries - 1
    if found.outcome == FOUND and has_friction:
        found, tries = _plan_with_friction(grid, limits, rules, work, tries)
    if found.outcome != FOUND:
        return found
    _choose_slopes(grid, limits, work.passes.cap, x, work.bounds)
    _bound_motion(work.width, x, rules, rules.headroom, work.bounds)
    found, tries = _plan_with_margins(grid, limits, rules, work, tries)
    if found.outcome == FOUND and has_friction:
        _shorten_plan(grid, limits, rules, work, tries)
    return found


@compiled(inner=True, allocates=True)
def _make_work(grid: Intervals, limits: GridLimits, arrays: PlanArrays) -> _Work:
    """Make the arrays; those of the plan are `work.passes.x`, `work.bounds.k`, `lines.lost`."""
    n = len(grid.piece)
    width = np.empty(n)
    for i in range(n):
        width[i] = grid.s[i + 1] - grid.s[i]
    bounds = MotionBounds(np.zeros(n), np.zeros(n), np.zeros(n), arrays.k)
    lines = make_lines(limits, arrays.lost)
    return _Work(width, bounds, lines, make_passes(arrays.x), np.ones(n, np.bool_))


@compiled(inner=True, allocates=True)
def _plan_free(grid: Intervals, limits: GridLimits, rules: Rules, work: _Work) -> PlanOutcome:
    """Plan without friction and without margins."""
    none = Friction(np.empty((len(grid.piece), 2, 0)), np.empty((len(grid.piece), 0, 3)))
    free = GridLimits(
        limits.rows, limits.squares, limits.rounds, none, limits.ceiling, limits.joints
    )
    return _run_passes(grid, free, rules, work, False)


@compiled(inner=True, allocates=True)
def _plan_with_friction(
    grid: Intervals, limits: GridLimits, rules: Rules, work: _Work, tries: int
) -> tuple[PlanOutcome, int]:
    """Plan with friction that is linearized about the previous plan, until both are close.

    Returns the outcome and the remaining tries.
    """
    found = PlanOutcome(FOUND, -1, 0.0)
    for _ in range(min(rules.tangents, tries)):
        if _linearize_friction(work.passes.x, work.bounds, rules.near):
            break
        found = _run_passes(grid, limits, rules, work, False)
        tries -= 1
        if found.outcome != FOUND:
            break
    return found, tries


@compiled(inner=True, allocates=True)
def _plan_with_margins(
    grid: Intervals, limits: GridLimits, rules: Rules, work: _Work, tries: int
) -> tuple[PlanOutcome, int]:
    """Plan with margins for bounds of x and u, which are widened until they contain the plan.

    Then the margins suffice. Slopes are set to zero where margins are too large; without slopes,
    the outcome is FINER. Returns the outcome and the remaining tries.
    """
    x = work.passes.x
    lost = work.lines.lost
    has_friction = limits.friction.within.shape[1] > 0
    work.changed[:] = True
    for remaining in range(tries - 1, -1, -1):
        found = _run_passes(grid, limits, rules, work, True)
        if found.outcome == UNLIMITED:
            return found, remaining
        worst = _largest_margin(lost)
        if lost[worst] > rules.max_margin:
            largest_kept = max(rules.max_margin, rules.steady)
            if _drop_slopes(work.bounds, lost, largest_kept, work.changed):
                if found.outcome != FOUND:
                    # Passes without a plan left nothing that the next passes can keep.
                    work.changed[:] = True
                continue
            return PlanOutcome(FINER, worst, 0.0), remaining
        if found.outcome != FOUND:
            if len(lost) > rules.enough:
                return found, remaining
            _mark_failure(lost, found.interval)
            return PlanOutcome(FINER, max(found.interval, 0), 0.0), remaining
        if _prove_or_widen(work.width, x, rules, work.bounds, has_friction, work.changed):
            return found, remaining
    if lost[_largest_margin(lost)] <= rules.max_margin:
        _mark_changed(lost, work.changed)
    return PlanOutcome(FINER, _largest_margin(lost), 0.0), 0


@compiled(inner=True, allocates=True)
def _shorten_plan(
    grid: Intervals, limits: GridLimits, rules: Rules, work: _Work, tries: int
) -> None:
    """Tighten the bounds about a proven plan with friction while this shortens the plan.

    Friction is linearized between the bounds of x, so tighter bounds allow a faster plan.
    """
    x = work.passes.x
    k = work.bounds.k
    lost = work.lines.lost
    shortest = math.inf
    x_best = x
    k_best = k
    lost_best = lost
    is_proven = True
    while is_proven:
        duration = _duration(work.width, x, k)
        gains = duration < shortest * (1 - rules.gain)
        if duration < shortest:
            shortest = duration
            x_best = x.copy()
            k_best = k.copy()
            lost_best = lost.copy()
        if not gains:
            break
        _bound_motion(work.width, x, rules, rules.close, work.bounds)
        found, tries = _plan_with_margins(grid, limits, rules, work, tries)
        is_proven = found.outcome == FOUND
    _copy_into(x, x_best)
    _copy_into(k, k_best)
    _copy_into(lost, lost_best)


@compiled(inner=True)
def _copy_into(values: FloatArray, new: FloatArray) -> None:
    """Replace all values of an array by those of an array of the same length."""
    # `values[:] = new` would make numba compile its handling of texts, for the error message.
    for i in range(len(values)):
        values[i] = new[i]


@compiled(inner=True, allocates=True)
def _run_passes(
    grid: Intervals, limits: GridLimits, rules: Rules, work: _Work, margins: bool
) -> PlanOutcome:
    """Run a backward and a forward pass, with or without margins; return whether x is a plan."""
    n = len(grid.piece)
    state = work.changed, margins
    reachable = work.passes.reachable
    last = work.passes.x
    stuck = backward_forward_pass(grid, limits, work.bounds, state, work.lines, rules, work.passes)
    if stuck >= n:
        return PlanOutcome(UNLIMITED, stuck - n, 0.0)
    smallest_start = rules.start * (1 - END_SQUARE_TOLERANCE)
    if rules.start < math.inf and min(rules.start, reachable[0]) < smallest_start:
        return PlanOutcome(START, stuck, reachable[0])
    if stuck >= 0:
        return PlanOutcome(STUCK, stuck, 0.0)
    if rules.end < math.inf and last[n] < rules.end * (1 - END_SQUARE_TOLERANCE):
        return PlanOutcome(END, stuck, last[n])
    return PlanOutcome(FOUND, stuck, 0.0)


@compiled(inner=True)
def _mark_failure(lost: FloatArray, stuck: int) -> None:
    """Request a finer grid around the interval without motion, or everywhere if it is -1."""
    for i in range(len(lost)):
        if stuck < 0 or abs(i - stuck) < REFINED_NEIGHBOURS:
            lost[i] = max(lost[i], NO_PLAN_MARGIN)


@compiled(inner=True)
def _mark_changed(lost: FloatArray, changed: BoolArray) -> None:
    """Request a finer grid where the last plan left its bounds."""
    for i in range(len(lost)):
        if changed[i]:
            lost[i] = NO_PLAN_MARGIN
