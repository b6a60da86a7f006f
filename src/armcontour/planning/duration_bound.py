"""Lower bound on the duration of any motion along a joint path, without a plan."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.core.kernel_cache import compiled
from armcontour.motion import JointPath
from armcontour.robot import Limits

# A joint path is divided into approximately this many equal parts.
EVEN_PARTS = 100
# A piece has one more part for each change of its direction by this angle [rad].
PART_TURN = 0.1


@compiled(inner=True, allocates=True)
def _count_parts(breaks: FloatArray, coefficients: FloatArray) -> IntArray:
    """Choose how many equal parts each piece has; limits are evaluated at their ends, (n,)."""
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
        parts[i] = (
            1 + int(EVEN_PARTS * (breaks[i + 1] - breaks[i]) / length) + int(turn / PART_TURN)
        )
    return parts


@compiled(inner=True)
def _ceiling(b: FloatArray, c: FloatArray, i: int, low: FloatArray, high: FloatArray) -> float:
    """Return the largest x = ds² for which some u = dds satisfies all joint limits [m²/s²].

    The limits are `low <= b u + c x <= high`, with row i of `b` and `c`.

    A joint with b = 0 limits x itself. Otherwise its bounds on u are lines in x, and x is largest
    where the lowest upper line meets the highest lower line.
    """
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
    """Return the largest u = dds that joint limits allow at x = ds²; with sign -1 that of -u."""
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
    """Return the shortest time [s] along `width` [m] from x = first to x = last.

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


class _PathParts(NamedTuple):
    """Parts of a joint path, and largest values of x = ds² at their m + 1 ends.

    Rows 2 i and 2 i + 1 of `b` and `c` are the start and the end of part i, because derivatives
    jump at breaks.
    """

    width: FloatArray  # Lengths [m], (m,)
    b: FloatArray  # dq_ds, (2 m, dof)
    c: FloatArray  # d2q_ds2, (2 m, dof)
    top: FloatArray  # The larger of the largest x at both ends of each part, (m,)
    x: FloatArray  # (m + 1,)


@compiled()
def least_duration(
    breaks: FloatArray,
    coefficients: FloatArray,
    rests: BoolArray,
    ceilings: FloatArray,
    bounds: FloatArray,
) -> float:
    """Bound the duration of any motion along a joint path from below [s]; 0 if no limit applies.

    The method is a forward and a backward pass over points of the path, as in `topp`. The result is
    a lower bound, because limits are evaluated at points only, and between two points ds² may
    change at the larger of the rates at both points.

    - `breaks`: arc lengths of the ends of the pieces [m], (n + 1,).
    - `coefficients`: coefficients of the quintics [rad], (n, 6, dof).
    - `rests`: true at breaks at which the motion rests, (n + 1,).
    - `ceilings`: largest ds² on each piece [m²/s²], (n,).
    - `bounds`: lower and upper bounds of the velocities [rad/s] and accelerations [rad/s²] of the
      joints, (4, dof).
    """
    parts = _sample_limits(breaks, coefficients, rests, ceilings, bounds)
    low = bounds[2]
    high = bounds[3]
    up = np.empty(len(parts.width))
    down = np.empty(len(parts.width))
    _limit_rises(parts, low, high, up)
    _limit_falls(parts, low, high, down)
    duration = 0.0
    for i in range(len(parts.width)):
        duration += _shortest_time(
            parts.width[i], parts.x[i], parts.x[i + 1], up[i], down[i], parts.top[i]
        )
    return duration if math.isfinite(duration) else 0.0


@compiled(inner=True, allocates=True)
def _sample_limits(
    breaks: FloatArray,
    coefficients: FloatArray,
    rests: BoolArray,
    ceilings: FloatArray,
    bounds: FloatArray,
) -> _PathParts:
    """Divide all pieces into parts, and evaluate derivatives and limits of x at their ends."""
    counts = _count_parts(breaks, coefficients)
    n = len(coefficients)
    dof = coefficients.shape[2]
    size = 0
    for i in range(n):
        size += counts[i]
    parts = _PathParts(
        np.empty(size),
        np.empty((2 * size, dof)),
        np.empty((2 * size, dof)),
        np.empty(size),
        np.empty(size + 1),
    )
    for i in range(size + 1):
        parts.x[i] = math.inf
    part = 0
    for i in range(n):
        width = breaks[i + 1] - breaks[i]
        if rests[i]:
            parts.x[part] = 0.0
        for p in range(counts[i]):
            parts.width[part] = width / counts[i]
            parts.top[part] = 0.0
            for end in range(2):
                row = 2 * part + end
                share = (p + end) / counts[i]
                _write_slopes(coefficients, i, share, width, parts, row)
                largest = min(ceilings[i], _ceiling_of_speeds(parts.b, row, bounds))
                largest = min(largest, _ceiling(parts.b, parts.c, row, bounds[2], bounds[3]))
                parts.x[part + end] = min(parts.x[part + end], largest)
                parts.top[part] = max(parts.top[part], largest)
            part += 1
    if rests[n]:
        parts.x[size] = 0.0
    return parts


@compiled(inner=True)
def _write_slopes(
    coefficients: FloatArray, i: int, share: float, width: float, parts: _PathParts, row: int
) -> None:
    """Write dq_ds and d2q_ds2 at the fraction `share` of piece i, by Horner's method."""
    for j in range(coefficients.shape[2]):
        first = second = 0.0
        for k in range(5, 0, -1):
            second = second * share + first
            first = first * share + k * coefficients[i, k, j]
        parts.b[row, j] = first / width
        parts.c[row, j] = second / (width * width)


@compiled(inner=True)
def _ceiling_of_speeds(b: FloatArray, row: int, bounds: FloatArray) -> float:
    """Return the largest x = ds² that the joints' velocity bounds allow [m²/s²]."""
    ceiling = math.inf
    for j in range(b.shape[1]):
        slope = b[row, j]
        if slope != 0.0:
            velocity = bounds[1, j] if slope > 0.0 else bounds[0, j]
            ceiling = min(ceiling, (velocity / slope) ** 2)
    return ceiling


@compiled(inner=True)
def _largest_rate(
    parts: _PathParts,
    rows: tuple[int, int],
    low: FloatArray,
    high: FloatArray,
    x: float,
    sign: float,
) -> float:
    """Return the largest u at either end of a part, from x at its first end.

    With sign -1, return the largest -u.
    """
    # `rows`: first and last end in the direction of the pass
    near, far = rows
    width = parts.width[near // 2]
    u = max(
        _largest_u(parts.b, parts.c, near, low, high, x, sign),
        _largest_u(parts.b, parts.c, far, low, high, x, sign),
    )
    reached = max(x + 2.0 * width * u, 0.0)
    return max(u, _largest_u(parts.b, parts.c, far, low, high, reached, sign))


@compiled(inner=True)
def _limit_rises(parts: _PathParts, low: FloatArray, high: FloatArray, up: FloatArray) -> None:
    """Reduce x, part by part, so that it rises by the largest u at most; write this u, (m,)."""
    x = parts.x
    for i in range(len(parts.width)):
        up[i] = _largest_rate(parts, (2 * i, 2 * i + 1), low, high, x[i], 1.0)
        x[i + 1] = min(x[i + 1], max(x[i] + 2.0 * parts.width[i] * up[i], 0.0))


@compiled(inner=True)
def _limit_falls(parts: _PathParts, low: FloatArray, high: FloatArray, down: FloatArray) -> None:
    """Reduce x, from the end, so that it falls by the largest -u at most; write this -u, (m,)."""
    x = parts.x
    for i in range(len(parts.width) - 1, -1, -1):
        down[i] = _largest_rate(parts, (2 * i + 1, 2 * i), low, high, x[i + 1], -1.0)
        x[i] = min(x[i], max(x[i + 1] + 2.0 * parts.width[i] * down[i], 0.0))


def bound_duration(joint_path: JointPath, limits: Limits) -> float:
    """Bound the duration of any motion from rest to rest along a joint path from below [s]."""
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
