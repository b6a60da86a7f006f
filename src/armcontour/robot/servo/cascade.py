"""Compiled response of a joint whose velocity loop has an integrator (P-PI cascade)."""

# The joint follows `ddq = clip(z, lower, upper)`, `z = kv (kp (u - q) - dq + ki x)`,
# `dx = kp (v - q) - dq - (z - ddq) / kv`. The last term of dx stops the integrator in saturation. z
# is the demand, x the integral. The command v excludes friction and acceleration feed-forward.
# Within a step the motion is a Taylor series, exact up to rounding errors.

from __future__ import annotations

import math

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.kernels import FUSED, compiled
from armcontour.robot.servo.joint_response import MAX_PHASES, MAX_STEPS, ROUNDING, Motion, Servo

# Times [s] that differ by less than this are equal, as in `march`.
NEAR = 4e-12
# Largest number of Taylor terms, longest step as a multiple of the shortest time constant, and
# relative size below which terms are negligible.
TERMS, LENGTH, NOTHING = 24, 0.5, 1e-17
# Number of cached maps; number of inputs of a map (position minus second command, velocity,
# integral, first minus second command, slopes of both commands); number of its Taylor terms, and
# its longest step, as a multiple of the shortest time constant.
KEPT, INPUTS, MAP_TERMS, MAP_LENGTH = 4, 6, 16, 0.25


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
    """Time at which a polynomial, or its slope, crosses `level` between two times."""
    rises = (slope_of(a, high) if slopes else evaluate(a, high)) > level
    tolerance, t = 1e-15 * high, 0.5 * (low + high)
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
        if high - low <= tolerance or abs(t - last) <= tolerance:
            break
    return t


@compiled(inner=True, fastmath=FUSED)
def count_terms(x: float) -> int:
    """Number of Taylor terms if the terms decrease like `x^k / k!`."""
    term, n = 1.0, 0
    while term > NOTHING and n < TERMS - 6:
        n += 1
        term *= x / n
    return n + 6


@compiled(inner=True, fastmath=FUSED)
def expand(
    servo: Servo, u: FloatArray, side: float, q: FloatArray, x: FloatArray, z: FloatArray
) -> None:
    """Compute the remaining Taylor coefficients of position, integral and demand."""
    # u: coefficients of both commands, (8,). q: (n,), the first two are input. x: (n,), the first
    # is input. z: demand, (n,), output. `side` is 1 at the upper bound of the acceleration, -1 at
    # the lower bound, otherwise 0.
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
    pieces: FloatArray, starts: FloatArray, piece: int, now: float, u: FloatArray
) -> None:
    """Write the coefficients of both commands with the time origin at `now` [s], (8,)."""
    t = now - starts[piece - 1] if 0 < piece < len(starts) else 0.0
    for i in (0, 4):
        a, b, c, d = (
            pieces[piece, i],
            pieces[piece, i + 1],
            pieces[piece, i + 2],
            pieces[piece, i + 3],
        )
        u[i], u[i + 1] = a + t * (b + t * (c + t * d)), b + t * (2 * c + t * 3 * d)
        u[i + 2], u[i + 3] = c + 3 * d * t, d


@compiled(inner=True, allocates=True, fastmath=FUSED)
def series_of_map(servo: Servo) -> FloatArray:
    """Taylor coefficients of the map of a free motion under linear commands, (MAP_TERMS, 18)."""
    # The map has the outputs position, velocity and integral, each with INPUTS columns.
    coefficients, series = np.empty((MAP_TERMS, 3 * INPUTS)), np.zeros((3, TERMS))
    for i in range(INPUTS):
        unit, u = np.zeros(INPUTS), np.zeros(8)
        unit[i] = 1.0
        series[0, 0], series[0, 1], series[1, 0] = unit[0], unit[1], unit[2]
        u[0], u[1], u[5] = unit[3], unit[4], unit[5]
        expand(servo, u, 0.0, series[0], series[1], series[2])
        for k in range(MAP_TERMS):
            coefficients[k, i], coefficients[k, INPUTS + i] = (
                series[0, k],
                (k + 1) * series[0, k + 1],
            )
            coefficients[k, 2 * INPUTS + i] = series[1, k]
    return coefficients


@compiled(inner=True, allocates=True, fastmath=FUSED)
def write_map(series: FloatArray, rate: float, span: float, out: FloatArray) -> None:
    """Write into `out`, (19,), the map of a free motion over a time span, then the span [s]."""
    # rate: upper bound of the inverse of the shortest time constant [1/s].
    halvings, h = 0, span
    while h * rate > MAP_LENGTH:
        h, halvings = h / 2, halvings + 1
    out[:-1] = series[-1]
    for k in range(MAP_TERMS - 2, -1, -1):
        for i in range(3 * INPUTS):
            out[i] = series[k, i] + h * out[i]
    out[-1] = span
    matrix, last = out[:-1].reshape((3, INPUTS)), np.empty((3, INPUTS))
    for _ in range(halvings):
        last[:] = matrix
        for k in range(3):
            a, b, c = last[k, 0], last[k, 1], last[k, 2]
            for i in range(INPUTS):
                matrix[k, i] = a * last[0, i] + b * last[1, i] + c * last[2, i]
            matrix[k, 3] += last[k, 3]
            # The value of the second command is subtracted from position and first command.
            matrix[k, 4] += last[k, 4] + h * last[k, 3]
            matrix[k, 5] += last[k, 5] - h * (last[k, 0] + last[k, 3])
            if k == 0:
                matrix[k, 5] += h
        h *= 2


@compiled(inner=True, allocates=True, fastmath=FUSED)
def march_lines(
    servo: Servo,
    pieces: FloatArray,
    starts: FloatArray,
    times: FloatArray,
    motion: Motion,
    out: FloatArray,
) -> Motion:
    """Variant of `march_cascade` for linear commands without saturation; outputs positions only."""
    kp, kv, ki = servo.kp, servo.kv, servo.ki
    q, w, z, saturated, lowest, highest = motion
    rate = max(kv, math.sqrt(kv * (kp + ki)), (kv * kp * ki) ** (1 / 3))
    series, oldest = series_of_map(servo), 0
    maps = np.full((KEPT, 3 * INPUTS + 1), -1.0)
    last, now, piece = len(starts), times[0], 0
    while piece < last and starts[piece] < now - NEAR:
        piece += 1
    t = now - starts[piece - 1] if 0 < piece < last else 0.0
    x = (z / kv - kp * (pieces[piece, 0] + t * pieces[piece, 1] - q) + w) / ki
    for row in range(1, len(times)):
        until = times[row]
        while until - now > NEAR:
            if piece < last and starts[piece] - now <= NEAR:
                piece += 1
                continue
            stop = starts[piece] if piece < last and starts[piece] < until - NEAR else until
            slot = -1
            for i in range(KEPT):
                if abs(maps[i, -1] - (stop - now)) <= NEAR:
                    slot = i
            if slot < 0:
                slot, oldest = oldest, (oldest + 1) % KEPT
                write_map(series, rate, stop - now, maps[slot])
            f, t = maps[slot], now - starts[piece - 1] if 0 < piece < last else 0.0
            now, a, b = stop, pieces[piece, 1], pieces[piece, 5]
            origin = pieces[piece, 4] + t * b
            e, lead = q - origin, pieces[piece, 0] + t * a - origin
            q = f[0] * e + f[1] * w + f[2] * x + f[3] * lead + f[4] * a + f[5] * b + origin
            v = f[6] * e + f[7] * w + f[8] * x + f[9] * lead + f[10] * a + f[11] * b
            x = f[12] * e + f[13] * w + f[14] * x + f[15] * lead + f[16] * a + f[17] * b
            w = v
        now = until
        out[row - 1, 0], out[row - 1, 1], out[row - 1, 2] = q, w, z
    return Motion(q, w, z, saturated, lowest, highest)


@compiled(inner=True, allocates=True, fastmath=FUSED)
def march_cascade(
    servo: Servo,
    pieces: FloatArray,
    starts: FloatArray,
    times: FloatArray,
    motion: Motion,
    out: FloatArray,
) -> Motion:
    """Simulate one joint from times[0] on, as `march` with two commands per piece, (n + 1, 8)."""
    # `held` is the demand [rad/s²] at the start and at the end. The initial integral follows from
    # it.
    kp, kv, ki = servo.kp, servo.kv, servo.ki
    q, w, z, saturated, lowest, highest = motion
    u, series = np.empty(8), np.zeros((3, TERMS))
    last, now, length = len(starts), times[0], -1.0
    position, integral, demand = series[0], series[1], series[2]
    piece = 0
    while piece < last and starts[piece] < now - NEAR:
        piece += 1
    move_command(pieces, starts, piece, now, u)
    x = (z / kv - kp * (u[0] - q) + w) / ki
    rate = max(kv, math.sqrt(kv * (kp + ki)), (kv * kp * ki) ** (1 / 3))
    longest = LENGTH / rate
    if not (times[-1] - now) < MAX_STEPS * longest * len(times):
        return Motion(math.nan, math.nan, z, saturated, lowest, highest)
    for row in range(1, len(times)):
        until, side, phases = times[row], 0.0, 0
        while until - now > NEAR:
            phases += 1
            if phases > MAX_PHASES:
                return Motion(math.nan, math.nan, z, saturated, lowest, highest)
            if piece < last and starts[piece] - now <= NEAR:
                piece, side = piece + 1, 0.0
                continue
            stop = starts[piece] if piece < last and starts[piece] < until - NEAR else until
            h = stop - now
            final = h <= longest
            if not final:
                h /= math.ceil(h / longest)
            if abs(h - length) > 1e-6 * h:
                length, n = h, count_terms(2 * rate * h)
                position, integral, demand = series[0, :n], series[1, :n], series[2, :n]
                series[2] = 0.0
            move_command(pieces, starts, piece, now, u)
            # Positions are relative to the command, to avoid cancellation if they are large.
            origin = u[4]
            u[0] -= origin
            u[4] = 0.0
            position[0], position[1], integral[0] = q - origin, w, x
            z = kv * (kp * (u[0] - position[0]) - w + ki * x)
            tolerance = ROUNDING * kp * kv * (abs(origin) + abs(q) + abs(x)) + ROUNDING * abs(z)
            if side == 0.0 and z > servo.upper + tolerance:
                side = 1.0
            elif side == 0.0 and z < servo.lower - tolerance:
                side = -1.0
            if abs(side) == 2.0:  # The joint left a bound in the previous step.
                side = 0.0
            expand(servo, u, side, position, integral, demand)
            extremum = h
            if slope_of(demand, 0.0) * slope_of(demand, h) < 0.0:
                extremum = find_passage(demand, 0.0, h, 0.0, True)
            lowest, highest = min(lowest, z), max(highest, z)
            end, begin, following = h, 0.0, side
            for t in (extremum, h):
                if t <= begin and t < h:
                    continue
                value = evaluate(demand, t)
                bound = 0.0
                if side == 0.0 and value > servo.upper + tolerance:
                    bound, following = servo.upper, 1.0
                elif side == 0.0 and value < servo.lower - tolerance:
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
