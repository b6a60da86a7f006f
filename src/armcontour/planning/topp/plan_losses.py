"""Compiled estimate of the time that a plan on a grid loses against the fastest motion."""

from __future__ import annotations

import math

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.kernel_cache import FUSED, compiled
from armcontour.core.simd import choose, highest, load
from armcontour.motion.kernels import interval_time
from armcontour.planning.topp.acceleration_range import acceleration_range
from armcontour.planning.topp.grid_plan import GridPlan
from armcontour.planning.topp.joint_derivatives import next_joint, path_slopes
from armcontour.planning.topp.limit_forms import BACKWARD, FORWARD, ROWS, GridLimits, Intervals

AT_BOUND = 0.02  # u is at its bound within this fraction of its range
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
REACH = 0.05  # this loss extends over this share of the length in which x changes by its own value
INSIDE = 0.02  # a new grid point closer to an interval end than this share saves no time


@compiled(inner=True, fastmath=FUSED)
def _ceiling(grid: Intervals, limits: GridLimits, i: int, end: int) -> float:
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
    return float(min(limits.ceiling[i, end], 1.0 / steepest))


@compiled(inner=True)
def _shortest_time(
    w: float, x: tuple[float, float], rates: tuple[float, float], ceiling: float
) -> tuple[float, float]:
    """Shortest time [s] through an interval, and the switch point as a fraction of the interval.

    - `w`: length of the interval.
    - `x`: values of x at its ends.
    - `rates`: largest u and largest -u.
    - `ceiling`: largest x between the ends.
    """
    up, down = 2 * rates[0], 2 * rates[1]
    first = min(max((x[1] - x[0] + down * w) / (up + down), 0.0), w)
    top = x[0] + up * first
    last_switch = first
    if top > ceiling:
        top = max(ceiling, x[0], x[1])
        first = min((top - x[0]) / up, w)
        last_switch = w - min((top - x[1]) / down, w)
    speeds = math.sqrt(x[0]), math.sqrt(top), math.sqrt(x[1])
    time = interval_time(first, speeds[0], speeds[1], 0.0) if first > 0.0 else 0.0
    if last_switch < w:
        time += interval_time(w - last_switch, speeds[1], speeds[2], 0.0)
    if last_switch > first:
        time += (last_switch - first) / speeds[1]
    share = first / w if first > INSIDE * w else last_switch / w
    return time, share


@compiled(fastmath=FUSED)
def estimate_losses(
    grid: Intervals, limits: GridLimits, plan: GridPlan
) -> tuple[float, FloatArray, FloatArray]:
    """Estimate the time that a plan loses by its grid and its slopes.

    Returns the duration of the plan [s]; the time lost on each interval [s], (n,); and the point in
    each interval at which a new grid point saves most [m], (n,), or the start of the interval.
    """
    s = grid.s
    x = plan.x
    k = plan.k
    lost = plan.lost
    n = len(plan.k)
    duration = 0.0
    loss = np.empty(n)
    point = np.empty(n)
    valley = np.zeros(n)
    for i in range(n):
        w = s[i + 1] - s[i]
        x0 = x[i]
        x1 = x[i + 1]
        time = interval_time(w, math.sqrt(x0), math.sqrt(x1), k[i])
        duration += time
        loss[i] = time * lost[i] / 2
        point[i] = s[i]
        near = AT_BOUND + lost[i]
        by_gap = BY_GAP if x0 > 0.0 and x1 > 0.0 else BY_GAP_AT_REST
        top0 = _ceiling(grid, limits, i, 0)
        top1 = _ceiling(grid, limits, i, 1)
        if x0 > 0.0 and x1 > 0.0 and x0 >= (1 - near) * top0 and x1 >= (1 - near) * top1:
            use = (math.sqrt(x0 / top0) + math.sqrt(x1 / top1)) / 2
            loss[i] = time * max(1 - use, 0.0)
            continue
        mean = (x1 - x0) / (2 * w)
        turn = k[i] * w / 2
        low0, high0, wide0, below0, above0 = acceleration_range(grid, limits, i, 0, x0)
        low1, high1, wide1, below1, above1 = acceleration_range(grid, limits, i, 1, x1)
        if not (wide0 < math.inf or wide1 < math.inf):
            continue
        # Unused share of the range up to each bound. An end that does not limit u gets the shares
        # of the other end.
        up0 = (high0 - mean + turn) / wide0
        up1 = (high1 - mean - turn) / wide1
        down0 = (mean - turn - low0) / wide0
        down1 = (mean + turn - low1) / wide1
        if not wide0 < math.inf:
            up0, down0 = up1, down1
        if not wide1 < math.inf:
            up1, down1 = up0, down0
        rising = min(up0, up1) < near
        falling = min(down0, down1) < near
        up = (up0 + up1) / 2
        down = (down0 + down1) / 2
        if rising and falling:
            gap = min(up, down)
            if gap > CROSSED and above0 != below1 and below0 != above1:
                rate = max(max(abs(low0), abs(high0)), max(abs(low1), abs(high1)))
                low0, high0, _, _, _ = acceleration_range(grid, limits, i, 0, LARGER_X * x0)
                low1, high1, _, _, _ = acceleration_range(grid, limits, i, 1, LARGER_X * x1)
                if low0 < high0 and low1 < high1:
                    wrong = by_gap * gap * math.sqrt(x0) / min(high0 - low0, high1 - low1)
                    reach = max(REACH * min(x0, x1) / rate, w)
                    first = last = i
                    while first > 0 and s[i] - s[first] < reach:
                        first -= 1
                    while last < n - 1 and s[last] - s[i] < reach:
                        last += 1
                    # Numba compiles an assigned slice for seconds.
                    for j in range(first, last + 1):
                        valley[j] = max(valley[j], wrong)
            loss[i] += by_gap * max(gap, 0.0) * time
        elif rising or falling:
            loss[i] += by_gap * time * max(up if rising else down, 0.0)
        else:
            rates = (high0 + high1) / 2, -(low0 + low1) / 2
            if rates[0] > mean and -rates[1] < mean:
                shortest, share = _shortest_time(w, (x0, x1), rates, max(top0, top1))
                loss[i] += max(time - shortest, 0.0)
                if INSIDE < share < 1 - INSIDE:
                    point[i] += share * w
    for i in range(n):
        loss[i] += valley[i]
    return duration, loss, point
