"""Compiled plan on a grid, first without margins, then with margins that are proven to suffice.

On each interval u is linear in s with a slope k that is chosen in advance. `limit_lines` writes the
limits of an interval in the plane of x and the mean u, and `reachability` finds the largest x.
docs/guides/optimal.md has the derivation.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray
from armcontour.core.kernel_cache import FUSED, compiled
from armcontour.motion.kernels import interval_time
from armcontour.planning.topp.acceleration_range import acceleration_range
from armcontour.planning.topp.limit_forms import Friction, GridLimits, Intervals, MotionBounds
from armcontour.planning.topp.limit_lines import make_lines
from armcontour.planning.topp.plan_rules import (
    END,
    FINER,
    FOUND,
    START,
    STUCK,
    UNLIMITED,
    Rules,
)
from armcontour.planning.topp.reachability import PassSquares, backward_forward_pass

END_TOLERANCE = 1e-7  # relative tolerance of x at the start and the end of the path
NEAR = 0.01  # u is at its bound within this fraction of its range
BELOW_CEILING = 1 - 1e-6  # above this fraction of its ceiling, x is limited by the ceiling only
LARGEST_TURN = 0.25  # largest change of u by a slope, as a fraction of its range
NO_PLAN_MARGIN = (
    4e-2  # margin reported for intervals without a plan, because a finer grid may have a plan
)
# intervals closer than this (in indices) to the one where the plan fails are refined
REFINED_NEIGHBOURS = 10
# plans of a grid: without friction and margins, with friction, and also with margins
FREE, WITH_FRICTION, WITH_MARGINS = range(3)


class GridPlan(NamedTuple):
    """A plan, or the reason why none exists."""

    x: FloatArray  # ds² at the ends of the intervals, (n + 1,)
    k: FloatArray  # Derivatives of dds in s, (n,)
    lost: FloatArray  # Fraction of limits that margins take, (n,)
    outcome: int  # FOUND, or FINER, STUCK, START, END, UNLIMITED
    interval: int
    allowed: float  # With START and END: the largest feasible ds² at this end [m²/s²]


@compiled(inner=True, fastmath=FUSED)
def _choose_slopes(
    grid: Intervals, limits: GridLimits, cap: FloatArray, x: FloatArray, bounds: MotionBounds
) -> None:
    """Write slopes k with which u stays at its bound on the whole interval."""
    for i in range(len(grid.piece)):
        w = grid.s[i + 1] - grid.s[i]
        x0 = x[i]
        x1 = x[i + 1]
        bounds.k[i] = 0.0
        if not (0.0 < x0 < cap[i] * BELOW_CEILING and 0.0 < x1 < cap[i + 1] * BELOW_CEILING):
            continue
        mean = (x1 - x0) / (2 * w)
        low0, high0, wide0, _, _ = acceleration_range(grid, limits, i, 0, x0)
        low1, high1, wide1, _, _ = acceleration_range(grid, limits, i, 1, x1)
        falling = min((mean - low0) / wide0, (mean - low1) / wide1) < NEAR
        turn = 0.0
        if min((high0 - mean) / wide0, (high1 - mean) / wide1) < NEAR:
            turn = high1 - high0
            if falling:
                # If u is at both bounds, for example because of two joints, the mean change is
                # used.
                turn = (turn + low1 - low0) / 2
        elif falling:
            turn = low1 - low0
        small = abs(turn) < LARGEST_TURN * min(wide0, wide1)
        # x must not fall far below its values at the ends.
        if small and 8 * turn * w <= x0 + x1:
            bounds.k[i] = turn / w


@compiled(inner=True, fastmath=FUSED)
def _motion_extent(
    width: FloatArray, x: FloatArray, k: FloatArray, i: int
) -> tuple[float, float, float]:
    """Largest and smallest x, and largest |u|, of a motion on interval i."""
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
    """Index of the interval whose margins take the largest fraction of a limit."""
    worst = 0
    for i in range(len(lost)):
        if lost[i] > lost[worst]:
            worst = i
    return worst


@compiled(inner=True)
def _duration(width: FloatArray, x: FloatArray, k: FloatArray) -> float:
    """Duration of a motion with ds² at the ends of the intervals and slopes k [s]."""
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
def _pass_outcome(
    stuck: int, rules: Rules, reachable: FloatArray, x: FloatArray
) -> tuple[int, float]:
    """Outcome of a pass, and the largest ds² at an end whose speed is too high."""
    n = len(x) - 1
    if rules.start < math.inf and min(rules.start, reachable[0]) < rules.start * (
        1 - END_TOLERANCE
    ):
        return START, reachable[0]
    if stuck >= 0:
        return STUCK, 0.0
    if rules.end < math.inf and x[n] < rules.end * (1 - END_TOLERANCE):
        return END, x[n]
    return FOUND, 0.0


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


def plan_on_grid(grid: Intervals, limits: GridLimits, rules: Rules) -> GridPlan:
    """Plan without margins, then with margins for bounds of x and u that contain the plan."""
    # If `rules.tries` is 1, the result is the plan without margins, with the outcome FINER.
    # Numba takes longer to return an array than NumPy to make one.
    n = len(grid.piece)
    x = np.zeros(n + 1)
    k = np.zeros(n)
    lost = np.zeros(n)
    return GridPlan(x, k, lost, *write_plan(grid, limits, rules, x, k, lost))


@compiled()
def write_plan(
    grid: Intervals,
    limits: GridLimits,
    rules: Rules,
    x: FloatArray,
    k: FloatArray,
    lost: FloatArray,
) -> tuple[int, int, float]:
    """Write x, k and lost of a `GridPlan`, initially zero; return its other fields."""
    n = len(grid.piece)
    friction_rows = limits.friction.within.shape[1]
    width = np.empty(n)
    cap = np.empty(n + 1)
    reachable = np.empty(n + 1)
    squares = PassSquares(cap, reachable, x)
    bounds = MotionBounds(np.zeros(n), np.zeros(n), np.zeros(n), k)
    changed = np.ones(n, np.bool_)
    lines = make_lines(limits, lost)
    x_best = x
    k_best = k
    lost_best = lost
    shortest = math.inf
    stage = FREE
    tangents = 0
    none = Friction(np.empty((n, 2, 0)), np.empty((n, 0, 3)))
    free = GridLimits(
        limits.rows, limits.squares, limits.rounds, none, limits.ceiling, limits.joints
    )
    for i in range(n):
        width[i] = grid.s[i + 1] - grid.s[i]
    for _ in range(rules.tries):
        used_limits = free if stage == FREE else limits
        margins = stage == WITH_MARGINS
        stuck = backward_forward_pass(
            grid, used_limits, bounds, (changed, margins), lines, rules, squares
        )
        if stuck >= n:
            return UNLIMITED, stuck - n, 0.0
        worst = _largest_margin(lines.lost)
        if margins and lines.lost[worst] > rules.max_margin:
            if _drop_slopes(bounds, lines.lost, max(rules.max_margin, rules.steady), changed):
                continue
            break
        outcome, allowed = _pass_outcome(stuck, rules, reachable, x)
        if outcome != FOUND:
            if shortest < math.inf:
                break
            if margins and n <= rules.enough:
                # A finer grid is needed around the failure, or everywhere if the speed at an end is
                # too high.
                for i in range(n):
                    if stuck < 0 or abs(i - stuck) < REFINED_NEIGHBOURS:
                        lines.lost[i] = max(lines.lost[i], NO_PLAN_MARGIN)
                return FINER, max(stuck, 0), 0.0
            return outcome, stuck, allowed
        if not margins:
            near = _linearize_friction(x, bounds, rules.near)
            stage = WITH_FRICTION
            if friction_rows and not near and tangents < rules.tangents:
                tangents += 1
                continue
            _choose_slopes(grid, limits, cap, x, bounds)
            _bound_motion(width, x, rules, rules.headroom, bounds)
            changed[:] = True
            stage = WITH_MARGINS
        elif _prove_or_widen(width, x, rules, bounds, friction_rows > 0, changed):
            if not friction_rows:
                return FOUND, -1, 0.0
            duration = _duration(width, x, bounds.k)
            better = duration < shortest * (1 - rules.gain)
            if duration < shortest:
                shortest = duration
                x_best = x.copy()
                k_best = k.copy()
                lost_best = lost.copy()
            if not better:
                break
            _bound_motion(width, x, rules, rules.close, bounds)
            changed[:] = True
    if shortest < math.inf:
        x[:] = x_best
        k[:] = k_best
        lost[:] = lost_best
        return FOUND, -1, 0.0
    worst = _largest_margin(lines.lost)
    if lines.lost[worst] <= rules.max_margin:
        for i in range(n):
            if changed[i]:
                lines.lost[i] = NO_PLAN_MARGIN
        worst = _largest_margin(lines.lost)
    return FINER, worst, 0.0
