"""Compiled lower bound on the duration of any motion along a joint path, without a plan."""

from __future__ import annotations

import math

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.core.kernels import compiled

# A joint path is looked at in about this many places, and in more where the joints change their
# direction, by this angle from place to place [rad].
EVEN_PARTS = 100
TURN = 0.1


@compiled(inner=True, allocates=True)
def _count_parts(breaks: FloatArray, coefficients: FloatArray) -> IntArray:
    """Number of equal parts of each piece at whose ends limits are kept, (n,)."""
    n, dof = len(coefficients), coefficients.shape[2]
    parts = np.empty(n, dtype=np.intp)
    before, here = np.empty(dof), np.empty(dof)
    length = breaks[n] - breaks[0]
    for i in range(n):
        turn = 0.0
        for place in range(3):
            share, square, far = 0.5 * place, 0.0, 0.0
            for j in range(dof):
                here[j] = 0.0
                for k in range(5, 0, -1):
                    here[j] = here[j] * share + k * coefficients[i, k, j]
                square += here[j] ** 2
            size = math.sqrt(square) if square > 0.0 else 1.0
            for j in range(dof):
                here[j] /= size
                far += (here[j] - before[j]) ** 2
                before[j] = here[j]
            turn += math.sqrt(far) if place else 0.0
        parts[i] = 1 + int(EVEN_PARTS * (breaks[i + 1] - breaks[i]) / length) + int(turn / TURN)
    return parts


@compiled(inner=True)
def _ceiling(b: FloatArray, c: FloatArray, i: int, low: FloatArray, high: FloatArray) -> float:
    """The largest x = ds² at which some u = dds keeps `low <= b u + c x <= high` for all joints.

    Args:
        b: dq_ds of many places, (n, dof).
        c: d2q_ds2 of many places, (n, dof).
        i: The place.
        low: Smallest acceleration of each joint, below zero, (dof,).
        high: Largest acceleration of each joint, (dof,).
    """
    found = math.inf
    for j in range(len(low)):
        p, q = b[i, j], c[i, j]
        if p == 0.0:
            if q != 0.0:
                found = min(found, (high[j] if q > 0.0 else low[j]) / q)
            continue
        top = (high[j] if p > 0.0 else low[j]) / p
        for k in range(len(low)):
            # The most that joint j allows meets the least that joint k asks for.
            r = b[i, k]
            if r != 0.0 and k != j:
                falls = q / p - c[i, k] / r
                if falls > 0.0:
                    found = min(found, (top - (low[k] if r > 0.0 else high[k]) / r) / falls)
    return found


@compiled(inner=True)
def _largest_u(
    b: FloatArray,
    c: FloatArray,
    i: int,
    low: FloatArray,
    high: FloatArray,
    x: float,
    sign: float,
) -> float:
    """The largest u = dds at x = ds² within the joints' accelerations; of `-u` with sign -1."""
    found = math.inf
    for j in range(len(low)):
        slope = sign * b[i, j]
        limit = high[j] if slope > 0.0 else low[j]
        if slope != 0.0 and math.isfinite(limit):
            found = min(found, (limit - c[i, j] * x) / slope)
    return found


@compiled(inner=True)
def _time_on(
    width: float, first: float, last: float, up: float, down: float, ceiling: float
) -> float:
    """The least time on a part from x = first to x = last: x rises, stays, and falls [s].

    Args:
        width: Length of the part [m].
        first: ds² at its start [m²/s²].
        last: ds² at its end [m²/s²].
        up: Largest dds [m/s²].
        down: Largest deceleration [m/s²].
        ceiling: Largest ds² [m²/s²].
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
    breaks: FloatArray,
    coefficients: FloatArray,
    rests: BoolArray,
    ceilings: FloatArray,
    bounds: FloatArray,
) -> float:
    """A duration that no motion along a joint path falls below.

    Limits are kept at points only, and between two points ds² may grow as fast as at either, so
    that a plan takes longer.

    Args:
        breaks: Arc lengths of the ends of the pieces [m], (n + 1,).
        coefficients: Coefficients of the quintics [rad], (n, 6, dof).
        rests: Whether the motion rests at a break, (n + 1,).
        ceilings: Largest ds² on each piece [m²/s²], (n,).
        bounds: Lower and upper bounds of the velocities [rad/s] and accelerations [rad/s²] of the
            joints, (4, dof).

    Returns:
        The duration [s]; 0 if nothing limits the motion.
    """
    n, dof = len(coefficients), coefficients.shape[2]
    slow, fast, low, high = bounds[0], bounds[1], bounds[2], bounds[3]
    parts = _count_parts(breaks, coefficients)
    size = 0
    for i in range(n):
        size += parts[i]
    # Rows 2 i and 2 i + 1 are the start and the end of part i: the derivatives jump at breaks.
    b, c = np.empty((2 * size, dof)), np.empty((2 * size, dof))
    widths, tops = np.empty(size), np.empty(size)
    x, at = np.empty(size + 1), 0
    for i in range(size + 1):
        x[i] = math.inf
    for i in range(n):
        width = breaks[i + 1] - breaks[i]
        if rests[i]:
            x[at] = 0.0
        for p in range(parts[i]):
            widths[at], tops[at] = width / parts[i], 0.0
            for end in range(2):
                share, row, most = (p + end) / parts[i], 2 * at + end, ceilings[i]
                for j in range(dof):
                    first = second = 0.0
                    for k in range(5, 0, -1):
                        second = second * share + first
                        first = first * share + k * coefficients[i, k, j]
                    b[row, j], c[row, j] = first / width, second / (width * width)
                    if first != 0.0:
                        velocity = fast[j] if first > 0.0 else slow[j]
                        most = min(most, (velocity / b[row, j]) ** 2)
                most = min(most, _ceiling(b, c, row, low, high))
                x[at + end] = min(x[at + end], most)
                tops[at] = max(tops[at], most)
            at += 1
    if rests[n]:
        x[size] = 0.0
    steepest = np.empty((size, 2))
    for backward in range(2):
        sign = 1.0 - 2.0 * backward
        for step in range(size):
            i = size - 1 - step if backward else step
            here, there = i + backward, i + 1 - backward
            near, far = 2 * i + backward, 2 * i + 1 - backward
            u = max(
                _largest_u(b, c, near, low, high, x[here], sign),
                _largest_u(b, c, far, low, high, x[here], sign),
            )
            reached = max(x[here] + 2.0 * widths[i] * u, 0.0)
            u = max(u, _largest_u(b, c, far, low, high, reached, sign))
            steepest[i, backward] = u
            x[there] = min(x[there], max(x[here] + 2.0 * widths[i] * u, 0.0))
    duration = 0.0
    for i in range(size):
        duration += _time_on(widths[i], x[i], x[i + 1], steepest[i, 0], steepest[i, 1], tops[i])
    return duration if math.isfinite(duration) else 0.0
