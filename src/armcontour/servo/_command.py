"""Compiled cubic commands of a joint, and the parts of a command interval with a dead time."""

from __future__ import annotations

import math
from typing import NamedTuple

from armcontour._checks import FloatArray, IntArray
from armcontour._kernels import FUSED, compiled

# Times that differ by less than this many command intervals count as equal.
SNAP = 1e-9


class Cubic(NamedTuple):
    """Coefficients of a command that is a cubic in time [rad, rad/s, rad/s², rad/s³]."""

    value: float
    rate: float
    second: float
    third: float


@compiled(inner=True, fastmath=FUSED)
def evaluate(u: Cubic, t: float) -> float:
    """Value of the command at time t [rad]."""
    return u.value + t * (u.rate + t * (u.second + t * u.third))


@compiled(inner=True, fastmath=FUSED)
def shift(u: Cubic, t: float) -> Cubic:
    """The same command, with time counted from t."""
    rate = u.rate + t * (2 * u.second + t * 3 * u.third)
    return Cubic(evaluate(u, t), rate, u.second + 3 * u.third * t, u.third)


@compiled(inner=True, fastmath=FUSED)
def divide_interval(
    period: float,
    steps: int,
    dead_time: float,
    width: FloatArray,
    local: FloatArray,
    late: IntArray,
    due: IntArray,
) -> int:
    """Divide a command interval at result times and where a delayed set-point reaches the joint.

    The parts are the same in all intervals, as set-points and results are periodic.

    Args:
        period: Command interval [s].
        steps: Number of results per interval.
        dead_time: Dead time of the joint [s].
        width: Output: lengths of the parts [s], (steps + 1,).
        local: Output: time from the active set-point's arrival to the start of each part [s].
        late: Output: delay of the active set-point of each part, in intervals.
        due: Output: 1 if a result is due at the end of the part, else 0.

    Returns:
        Number of parts.
    """
    whole = int(math.floor(dead_time / period + SNAP))
    rest = max(dead_time - whole * period, 0.0)
    span, near = period / steps, SNAP * period
    count, start = 0, 0.0
    for i in range(steps):
        end = (i + 1) * span
        for last in (0, 1):
            if last == 0 and not start + near < rest < end - near:
                continue
            stop = end if last else rest
            before = start < rest - near
            width[count] = stop - start
            local[count] = start + period - rest if before else max(start - rest, 0.0)
            late[count] = whole + 1 if before else whole
            due[count] = last
            start = stop
            count += 1
    return count
