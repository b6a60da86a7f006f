"""Lower bound on the duration of any motion along a joint path, without a plan."""

from __future__ import annotations

import math

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.core.kernel_cache import compiled
from armcontour.motion import JointPath
from armcontour.robot import Limits

# A joint path is divided into approximately this many equal parts.
EVEN_PARTS = 100
# A piece has one more part for each change of its direction by this angle [rad].
TURN = 0.1


@compiled(inner=True, allocates=True)
def _count_parts(breaks: FloatArray, coefficients: FloatArray) -> IntArray:
    """Number of equal parts of each piece, at whose ends the limits are evaluated, (n,)."""
    n = len(coefficients)
    dof = coefficients.shape[2]
    parts = np.empty(n, dtype=np.intp)
    previous = np.empty(dof)
    direction = np.empty(dof)
    length = breaks[n] - breaks[0]
    for i in range(n):
        turn = 0.0
        for sample in range(3):
            share = 0.5 * sample
            square = 0.0
            change = 0.0
            for j in range(dof):
                direction[j] = 0.0
                for k in range(5, 0, -1):
                    direction[j] = direction[j] * share + k * coefficients[i, k, j]
                square += direction[j] ** 2
            size = math.sqrt(square) if square > 0.0 else 1.0
            for j in range(dof):
                direction[j] /= size
                change += (direction[j] - previous[j]) ** 2
                previous[j] = direction[j]
            turn += math.sqrt(change) if sample else 0.0
        parts[i] = 1 + int(EVEN_PARTS * (breaks[i + 1] - breaks[i]) / length) + int(turn / TURN)
    return parts


@compiled(inner=True)
def _ceiling(b: FloatArray, c: FloatArray, i: int, low: FloatArray, high: FloatArray) -> float:
    """Largest x = ds² for which some u = dds gives `low <= b u + c x <= high` for all joints."""
    ceiling = math.inf
    for j in range(len(low)):
        p = b[i, j]
        q = c[i, j]
        if p == 0.0:
            if q != 0.0:
                ceiling = min(ceiling, (high[j] if q > 0.0 else low[j]) / q)
            continue
        top = (high[j] if p > 0.0 else low[j]) / p
        for k in range(len(low)):
            # The upper bound of joint j meets the lower bound of joint k.
            r = b[i, k]
            if r != 0.0 and k != j:
                falls = q / p - c[i, k] / r
                if falls > 0.0:
                    ceiling = min(ceiling, (top - (low[k] if r > 0.0 else high[k]) / r) / falls)
    return ceiling


@compiled(inner=True)
def _largest_u(
    b: FloatArray, c: FloatArray, i: int, low: FloatArray, high: FloatArray, x: float, sign: float
) -> float:
    """Largest u = dds that joint limits allow at x = ds²; with sign -1 the largest -u."""
    largest = math.inf
    for j in range(len(low)):
        slope = sign * b[i, j]
        limit = high[j] if slope > 0.0 else low[j]
        if slope != 0.0 and math.isfinite(limit):
            largest = min(largest, (limit - c[i, j] * x) / slope)
    return largest


@compiled(inner=True)
def _shortest_time(
    width: float, first: float, last: float, up: float, down: float, ceiling: float
) -> float:
    """Shortest time [s] along `width` [m] from x = first to x = last.

    x rises, is constant, and falls. `first`, `last`, `ceiling`: x at the ends and its upper bound
    [m²/s²]; `up`, `down`: largest acceleration and deceleration [m/s²].
    """
    top = max(first, last)
    if up > 0.0 and down > 0.0:
        met = (up * last + down * first + 2.0 * up * down * width) / (up + down)
        top = max(top, min(met, ceiling))
    root = math.sqrt(top)
    if root == 0.0 or top == math.inf:
        return 0.0
    rise = min((top - first) / (2.0 * up) if up > 0.0 else 0.0, width)
    fall = min((top - last) / (2.0 * down) if down > 0.0 else 0.0, width - rise)
    return (
        2.0 * rise / (math.sqrt(first) + root)
        + 2.0 * fall / (math.sqrt(last) + root)
        + (width - rise - fall) / root
    )


@compiled()
def least_duration(
    breaks: FloatArray,  # Arc lengths of the ends of the pieces [m], (n + 1,)
    coefficients: FloatArray,  # Coefficients of the quintics [rad], (n, 6, dof)
    rests: BoolArray,  # True at breaks at which the motion rests, (n + 1,)
    ceilings: FloatArray,  # Largest ds² on each piece [m²/s²], (n,)
    bounds: FloatArray,
) -> float:
    """Lower bound of the duration of any motion along a joint path [s]; 0 if no limit applies.

    The result is a lower bound, because limits are evaluated at points only, and between two points
    ds² may change at the larger of the rates at both points.

    `bounds` are lower and upper bounds of the velocities [rad/s] and accelerations [rad/s²] of the
    joints, (4, dof).
    """
    n = len(coefficients)
    dof = coefficients.shape[2]
    slow = bounds[0]
    fast = bounds[1]
    low = bounds[2]
    high = bounds[3]
    parts = _count_parts(breaks, coefficients)
    size = 0
    for i in range(n):
        size += parts[i]
    # Rows 2 i and 2 i + 1 are the start and the end of part i, because derivatives jump at breaks.
    b = np.empty((2 * size, dof))
    c = np.empty((2 * size, dof))
    widths = np.empty(size)
    tops = np.empty(size)
    x = np.empty(size + 1)
    part = 0
    for i in range(size + 1):
        x[i] = math.inf
    for i in range(n):
        width = breaks[i + 1] - breaks[i]
        if rests[i]:
            x[part] = 0.0
        for p in range(parts[i]):
            widths[part] = width / parts[i]
            tops[part] = 0.0
            for end in range(2):
                share = (p + end) / parts[i]
                row = 2 * part + end
                ceiling = ceilings[i]
                for j in range(dof):
                    first = second = 0.0
                    for k in range(5, 0, -1):
                        second = second * share + first
                        first = first * share + k * coefficients[i, k, j]
                    b[row, j] = first / width
                    c[row, j] = second / (width * width)
                    if first != 0.0:
                        velocity = fast[j] if first > 0.0 else slow[j]
                        ceiling = min(ceiling, (velocity / b[row, j]) ** 2)
                ceiling = min(ceiling, _ceiling(b, c, row, low, high))
                x[part + end] = min(x[part + end], ceiling)
                tops[part] = max(tops[part], ceiling)
            part += 1
    if rests[n]:
        x[size] = 0.0
    steepest = np.empty((size, 2))
    for backward in range(2):
        sign = 1.0 - 2.0 * backward
        for step in range(size):
            i = size - 1 - step if backward else step
            begin = i + backward
            finish = i + 1 - backward
            near_row = 2 * i + backward
            far_row = 2 * i + 1 - backward
            u = max(
                _largest_u(b, c, near_row, low, high, x[begin], sign),
                _largest_u(b, c, far_row, low, high, x[begin], sign),
            )
            reached = max(x[begin] + 2.0 * widths[i] * u, 0.0)
            u = max(u, _largest_u(b, c, far_row, low, high, reached, sign))
            steepest[i, backward] = u
            x[finish] = min(x[finish], max(x[begin] + 2.0 * widths[i] * u, 0.0))
    duration = 0.0
    for i in range(size):
        duration += _shortest_time(
            widths[i], x[i], x[i + 1], steepest[i, 0], steepest[i, 1], tops[i]
        )
    return duration if math.isfinite(duration) else 0.0


def bound_duration(joint_path: JointPath, limits: Limits) -> float:
    """Lower bound of the duration of any motion from rest to rest along a joint path [s]."""
    # The bound includes joint velocities and accelerations, tool speed, and the centripetal
    # acceleration on arcs. Torques and all other limits are ignored.
    breaks = joint_path.breaks
    dof = joint_path.dof
    rests = np.isin(breaks, joint_path.stops)
    rests[[0, -1]] = True
    ceilings = np.full(len(breaks) - 1, np.inf)
    path = joint_path.tool_path
    if path is not None:
        segment = path.locate((breaks[:-1] + breaks[1:]) / 2)
        tool_limits = [limits.centripetal_acceleration, limits.tool_acceleration]
        acceleration = min((x for x in tool_limits if x is not None), default=np.inf)
        curvature = np.where(path.segments.is_transition, 0.0, path.curvatures)
        with np.errstate(divide="ignore"):
            allowed = np.minimum(path.assigned_speeds(limits.speed) ** 2, acceleration / curvature)
        ceilings = allowed[segment]
    bounds = np.stack([*limits.velocity_bounds(dof), *limits.acceleration_bounds(dof)])
    return float(least_duration(breaks, joint_path.coefficients, rests, ceilings, bounds))
