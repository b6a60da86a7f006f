"""Compiled response of a joint whose velocity loop has an integrator (P-PI cascade).

The joint follows `ddq = clip(kv (kp (u - q) - dq + ki x), lower, upper)`, `dx = kp (v - q) - dq`.
The command v has no friction and no acceleration feed-forward. Within a step the motion is its
Taylor series, which is exact up to rounding errors.
"""

from __future__ import annotations

import math

import numpy as np

from armcontour._checks import FloatArray
from armcontour._kernels import FUSED, compiled
from armcontour.servo._response import MOST_PHASES, MOST_STEPS, ROUNDING, Motion, Servo

# Times [s] that differ by less than this are equal, as in `march`.
NEAR = 4e-12
# Terms of a Taylor series, and the length of a step in bounds of the fastest time constant: the
# terms that are left out are below 1e-16 of the first ones.
TERMS, LENGTH = 20, 0.5


@compiled(inner=True, fastmath=FUSED)
def evaluate(a: FloatArray, t: float) -> float:
    """Value of a polynomial at time t."""
    value = 0.0
    for k in range(len(a) - 1, -1, -1):
        value = a[k] + t * value
    return value


@compiled(inner=True, fastmath=FUSED)
def slope_of(a: FloatArray, t: float) -> float:
    """Slope of a polynomial at time t."""
    value = 0.0
    for k in range(len(a) - 1, 0, -1):
        value = k * a[k] + t * value
    return value


@compiled(inner=True, fastmath=FUSED)
def bisect(a: FloatArray, low: float, high: float, level: float, slopes: bool) -> float:
    """Time at which a polynomial, or its slope, passes a level between two times."""
    rises = (slope_of(a, high) if slopes else evaluate(a, high)) > level
    for _ in range(60):
        middle = 0.5 * (low + high)
        value = slope_of(a, middle) if slopes else evaluate(a, middle)
        if (value > level) == rises:
            high = middle
        else:
            low = middle
        if high - low <= 1e-15 * high:
            break
    return high


@compiled(inner=True, fastmath=FUSED)
def expand(
    servo: Servo, ki: float, u: FloatArray, side: float, q: FloatArray, x: FloatArray, z: FloatArray
) -> None:
    """Write Taylor coefficients of position, integral and demand, from the first ones.

    Args:
        servo: Gains and bounds.
        ki: Integral gain [1/s].
        u: Coefficients of both commands, (8,).
        side: 1 at the upper bound of the acceleration, -1 at the lower one, else 0.
        q: Position, with the first two coefficients, (TERMS,).
        x: Integral, with the first coefficient, (TERMS,).
        z: Output: demand, (TERMS,).
    """
    kp, kv = servo.kp, servo.kv
    for k in range(TERMS - 2):
        p, v = (u[k], u[4 + k]) if k < 4 else (0.0, 0.0)
        w = (k + 1) * q[k + 1]
        z[k] = kv * (kp * (p - q[k]) - w + ki * x[k])
        x[k + 1] = (kp * (v - q[k]) - w) / (k + 1)
        a = z[k]
        if side != 0.0:
            a = (servo.upper if side > 0.0 else servo.lower) if k == 0 else 0.0
        q[k + 2] = a / ((k + 1) * (k + 2))


@compiled(inner=True, fastmath=FUSED)
def move_command(
    pieces: FloatArray, starts: FloatArray, at: int, now: float, u: FloatArray
) -> None:
    """Write the coefficients of both commands from time `now` [s] on, (8,)."""
    t = now - starts[at - 1] if 0 < at < len(starts) else 0.0
    for i in (0, 4):
        a, b, c, d = pieces[at, i], pieces[at, i + 1], pieces[at, i + 2], pieces[at, i + 3]
        u[i], u[i + 1] = a + t * (b + t * (c + t * d)), b + t * (2 * c + t * 3 * d)
        u[i + 2], u[i + 3] = c + 3 * d * t, d


@compiled(inner=True, allocates=True, fastmath=FUSED)
def march_cascade(
    servo: Servo,
    ki: float,
    pieces: FloatArray,
    starts: FloatArray,
    times: FloatArray,
    motion: Motion,
    out: FloatArray,
) -> Motion:
    """Simulate one joint from times[0] on; as `march`, but with two commands per piece, (n + 1, 8).

    `held` is the demand [rad/s²] at the start and at the end. The integral follows from it.
    """
    kp, kv = servo.kp, servo.kv
    q, w, z, saturated, lowest, highest = motion
    u, series = np.empty(8), np.zeros((3, TERMS))
    position, integral, demand = series
    last, now = len(starts), times[0]
    at = 0
    while at < last and starts[at] < now - NEAR:
        at += 1
    move_command(pieces, starts, at, now, u)
    x = (z / kv - kp * (u[0] - q) + w) / ki
    rate = max(kv, math.sqrt(kv * (kp + ki)), (kv * kp * ki) ** (1 / 3))
    longest = LENGTH / rate
    if not (times[-1] - now) < MOST_STEPS * longest * len(times):
        return Motion(math.nan, math.nan, z, saturated, lowest, highest)
    for row in range(1, len(times)):
        until, side, phases = times[row], 0.0, 0
        while until - now > NEAR:
            phases += 1
            if phases > MOST_PHASES:
                return Motion(math.nan, math.nan, z, saturated, lowest, highest)
            if at < last and starts[at] - now <= NEAR:
                at, side = at + 1, 0.0
                continue
            stop = starts[at] if at < last and starts[at] < until - NEAR else until
            h = stop - now
            final = h <= longest
            if not final:
                h /= math.ceil(h / longest)
            move_command(pieces, starts, at, now, u)
            # Relative to the command, so that large positions lose no digits.
            origin = u[4]
            u[0] -= origin
            u[4] = 0.0
            position[0], position[1], integral[0] = q - origin, w, x
            z = kv * (kp * (u[0] - position[0]) - w + ki * x)
            least = ROUNDING * kp * kv * (abs(origin) + abs(q) + abs(x)) + ROUNDING * abs(z)
            if side == 0.0 and z > servo.upper + least:
                side = 1.0
            elif side == 0.0 and z < servo.lower - least:
                side = -1.0
            if abs(side) == 2.0:  # A bound has just been left.
                side = 0.0
            expand(servo, ki, u, side, position, integral, demand)
            turn = h
            if slope_of(demand, 0.0) * slope_of(demand, h) < 0.0:
                turn = bisect(demand, 0.0, h, 0.0, True)
            lowest, highest = min(lowest, z), max(highest, z)
            end, begin, following = h, 0.0, side
            for t in (turn, h):
                if t <= begin and t < h:
                    continue
                value = evaluate(demand, t)
                bound = 0.0
                if side == 0.0 and value > servo.upper + least:
                    bound, following = servo.upper, 1.0
                elif side == 0.0 and value < servo.lower - least:
                    bound, following = servo.lower, -1.0
                elif side > 0.0 and value < servo.upper:
                    bound, following = servo.upper, 2.0
                elif side < 0.0 and value > servo.lower:
                    bound, following = servo.lower, 2.0
                if following != side:
                    end, final = bisect(demand, begin, t, bound, False), False
                    break
                lowest, highest = min(lowest, value), max(highest, value)
                begin = t
            saturated += end if side != 0.0 else 0.0
            q, w = evaluate(position, end) + origin, slope_of(position, end)
            x, z = evaluate(integral, end), evaluate(demand, end)
            side = following
            now = stop if final else now + end
        now = until
        out[row - 1, 0], out[row - 1, 1], out[row - 1, 2] = q, w, z
        lowest, highest = min(lowest, z), max(highest, z)
    return Motion(q, w, z, saturated, lowest, highest)
