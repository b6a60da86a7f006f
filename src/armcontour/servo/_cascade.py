"""Compiled response of a joint whose velocity loop has an integrator (P-PI cascade).

The joint follows `ddq = clip(z, lower, upper)`, `z = kv (kp (u - q) - dq + ki x)`,
`dx = kp (v - q) - dq - (z - ddq) / kv`, whose last term stops the integrator in saturation. The
command v has no friction and no acceleration feed-forward. Within a step the motion is its Taylor
series, which is exact up to rounding errors.
"""

from __future__ import annotations

import math

import numpy as np

from armcontour._checks import FloatArray
from armcontour._kernels import FUSED, compiled
from armcontour.servo._response import MOST_PHASES, MOST_STEPS, ROUNDING, Motion, Servo

# Times [s] that differ by less than this are equal, as in `march`.
NEAR = 4e-12
# Most terms of a Taylor series, the length of a step in bounds of the fastest time constant, and
# the size of terms that are left out, as a share of the first ones.
TERMS, LENGTH, NOTHING = 24, 0.5, 1e-17


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
def curvature_of(a: FloatArray, t: float) -> float:
    """Second derivative of a polynomial at time t."""
    value = 0.0
    for k in range(len(a) - 1, 1, -1):
        value = k * (k - 1) * a[k] + t * value
    return value


@compiled(inner=True, fastmath=FUSED)
def find_passage(a: FloatArray, low: float, high: float, level: float, slopes: bool) -> float:
    """Time at which a polynomial, or its slope, passes a level between two times."""
    rises = (slope_of(a, high) if slopes else evaluate(a, high)) > level
    near, t = 1e-15 * high, 0.5 * (low + high)
    for _ in range(100):
        value = (slope_of(a, t) if slopes else evaluate(a, t)) - level
        rate = curvature_of(a, t) if slopes else slope_of(a, t)
        if (value > 0.0) == rises:
            high = t
        else:
            low = t
        last, t = t, t - value / rate if rate != 0.0 else low
        if not low < t < high:
            t = 0.5 * (low + high)
        if high - low <= near or abs(t - last) <= near:
            break
    return t


@compiled(inner=True, fastmath=FUSED)
def count_terms(x: float) -> int:
    """Number of terms of a Taylor series whose terms fall like `x^k / k!`."""
    term, n = 1.0, 0
    while term > NOTHING and n < TERMS - 6:
        n += 1
        term *= x / n
    return n + 6


@compiled(inner=True, fastmath=FUSED)
def expand(
    servo: Servo, u: FloatArray, side: float, q: FloatArray, x: FloatArray, z: FloatArray
) -> None:
    """Write Taylor coefficients of position, integral and demand, from the first ones.

    Args:
        servo: Gains and bounds.
        u: Coefficients of both commands, (8,).
        side: 1 at the upper bound of the acceleration, -1 at the lower one, else 0.
        q: Position, with the first two coefficients, (n,).
        x: Integral, with the first coefficient, (n,).
        z: Output: demand, (n,).
    """
    kp, kv, ki = servo.kp, servo.kv, servo.ki
    for k in range(len(q) - 2):
        p, v = (u[k], u[4 + k]) if k < 4 else (0.0, 0.0)
        w = (k + 1) * q[k + 1]
        z[k] = kv * (kp * (p - q[k]) - w + ki * x[k])
        a = z[k]
        if side != 0.0:
            a = (servo.upper if side > 0.0 else servo.lower) if k == 0 else 0.0
        x[k + 1] = (kp * (v - q[k]) - w - (z[k] - a) / kv) / (k + 1)
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
    pieces: FloatArray,
    starts: FloatArray,
    times: FloatArray,
    motion: Motion,
    out: FloatArray,
) -> Motion:
    """Simulate one joint from times[0] on; as `march`, but with two commands per piece, (n + 1, 8).

    `held` is the demand [rad/s²] at the start and at the end. The integral follows from it.
    """
    kp, kv, ki = servo.kp, servo.kv, servo.ki
    q, w, z, saturated, lowest, highest = motion
    u, series = np.empty(8), np.zeros((3, TERMS))
    last, now, length = len(starts), times[0], -1.0
    position, integral, demand = series[0], series[1], series[2]
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
            if abs(h - length) > 1e-6 * h:
                length, n = h, count_terms(2 * rate * h)
                position, integral, demand = series[0, :n], series[1, :n], series[2, :n]
                series[2] = 0.0
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
            expand(servo, u, side, position, integral, demand)
            turn = h
            if slope_of(demand, 0.0) * slope_of(demand, h) < 0.0:
                turn = find_passage(demand, 0.0, h, 0.0, True)
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
                    end, final = find_passage(demand, begin, t, bound, False), False
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
