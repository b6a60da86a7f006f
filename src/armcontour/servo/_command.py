"""The compiled part of commands: cubics in time, and when they reach a joint."""

from __future__ import annotations

import math
from typing import NamedTuple

from armcontour._checks import FloatArray, IntArray
from armcontour._kernels import FUSED, compiled

# Instants closer than this many command intervals are one.
SNAP = 1e-9


class Cubic(NamedTuple):
    """A command in powers of the time [rad, rad/s, rad/s², rad/s³]."""

    value: float
    rate: float
    second: float
    third: float


@compiled(fastmath=FUSED)
def evaluate(u: Cubic, t: float) -> float:
    """The command at the time t."""
    return u.value + t * (u.rate + t * (u.second + t * u.third))


@compiled(fastmath=FUSED)
def shift(u: Cubic, t: float) -> Cubic:
    """The same command in powers of the time since t."""
    rate = u.rate + t * (2 * u.second + t * 3 * u.third)
    return Cubic(evaluate(u, t), rate, u.second + 3 * u.third * t, u.third)


@compiled(fastmath=FUSED)
def divide_interval(
    period: float,
    steps: int,
    dead_time: float,
    width: FloatArray,
    local: FloatArray,
    late: IntArray,
    due: IntArray,
) -> int:
    """Divide a command interval at its results and where a late set-point reaches the joint.

    Set-points come every period, as results do: the parts are the same in all intervals.

    Args:
        period: Command interval [s].
        steps: Results in it.
        dead_time: [s].
        width: Takes the parts' lengths [s], (steps + 1,).
        local: Takes the time since the set-point before each part [s].
        late: Takes by how many intervals that set-point is late.
        due: Takes 1 where a result is due at the part's end, else 0.

    Returns:
        Number of parts.
    """
    whole = int(math.floor(dead_time / period + SNAP))
    rest = max(dead_time - whole * period, 0.0)
    span, near = period / steps, SNAP * period
    count, begin = 0, 0.0
    for i in range(steps):
        end = (i + 1) * span
        for last in (0, 1):
            if last == 0 and not begin + near < rest < end - near:
                continue
            stop = end if last else rest
            before = begin < rest - near
            width[count] = stop - begin
            local[count] = begin + period - rest if before else max(begin - rest, 0.0)
            late[count] = whole + 1 if before else whole
            due[count] = last
            begin = stop
            count += 1
    return count
