"""Compiled simulation of joints under piecewise polynomial commands.

One loop describes every joint. With the demand z, the position q, the velocity w, the integral x
and the command u, joints of second order follow

    z = kv (kp (u - q) - w + ki x),  dw = clip(z, lower, upper),
    dx = kp (u - lead - q) - w - (z - dw) / kv.

The last term of dx stops the integrator in saturation. `lead` is the part of the command that
bypasses the integrator. Joints of first order (kv = 0) follow `dq = kp (u - q)`. The command is a
cubic in time. A step without saturation is a linear map, which is a matrix exponential. Other steps
are Taylor series, whose crossings of the bounds are found by Newton's method.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.core.kernel_cache import FUSED, compiled

# Kinds of simulations. COMPLETE and HELD record the extremes of the demand, SATURATING does not.
# LINEAR ignores the bounds of the acceleration, and its only results are states. HELD is for drives
# that hold their acceleration or velocity in each piece of the command.
COMPLETE, SATURATING, LINEAR, HELD = range(4)
# Longest step that may saturate, as a multiple of the shortest time constant of the servo. Within
# it, the slope of the demand has at most one extremum, and the series converge up to rounding
# errors.
LARGEST_SATURATING_STEP = 1.0
# Factor for the number of steps in a time span, so that rounding errors do not add a step.
STEP_COUNT_FACTOR = 1 - 1e-9
# Largest number of Taylor coefficients of a step.
MAX_TERMS = 28
# Taylor terms below this fraction of the first term are negligible.
NEGLIGIBLE_TERM = 1e-15
# Reciprocals 1 / n, from n = 1.
INVERSE = tuple(1.0 / n for n in range(1, MAX_TERMS + 2))
# Columns of a linear map: position minus command, velocity, the three coefficients of the command
# from its rate on, integral, and lead of the command. Only with an integrator, a map has the last
# two columns. The rows are position minus command, velocity and integral.
RATE_COLUMN = 2
INTEGRAL_COLUMN = 5
LEAD_COLUMN = 6
COLUMNS = 7
# Number of Taylor coefficients of a map.
MAP_TERMS = 16
# Longest time of a map before it is squared, as a multiple of the shortest time constant.
MAP_LENGTH = 0.25
# Number of cached maps of a joint.
KEPT_MAPS = 4
# Times and time spans [s] that differ by less than this are equal; rounding errors are smaller.
SAME_INSTANT = 4e-12
# The demand is kp kv times a difference of positions. If its excess over a bound is below this
# fraction of kp kv times these positions, the excess is a rounding error and not saturation.
DEMAND_ROUNDING = 1e-14
# Fraction of the curvature of the demand in a step by which a cubic through both ends may differ.
CUBIC_ERROR = 0.005
THIRD = 1 / 3
# Precision of the times at which bounds are crossed, relative to the step.
PASSAGE = 1e-15
# Largest number of iterations of Newton's method for such a time.
MAX_PASSAGE_ITERATIONS = 100
# Precision of the times at which extrema are reached, relative to the step.
EXTREMUM = 1e-8
# Largest number of steps per time span; more are never necessary.
MAX_STEPS_PER_SPAN = 1e5
# Largest number of phases (free or saturated) per step; more are never necessary, and would have
# durations that round to 0.
MAX_PHASES = 100_000


class Joints(NamedTuple):
    """Gains [1/s] and acceleration bounds [rad/s²] of all joints, (rows,) each."""

    kp: FloatArray  # Position gains; infinite for a pure delay
    kv: FloatArray  # Velocity gains; 0 for joints of first order
    ki: FloatArray  # Integral gains; 0 without an integrator
    lower: FloatArray
    upper: FloatArray


class JointMotions(NamedTuple):
    """Simulated motion of all joints; (rows,) each except for `states`."""

    states: FloatArray  # Position, velocity and demand at n results, (rows, n, 3)
    saturated: FloatArray  # Time in saturation [s]
    lowest: FloatArray  # Smallest demand [rad/s²]
    highest: FloatArray  # Largest demand [rad/s²]
    # Acceleration or velocity that a drive with a cycle holds at the end; with an integrator the
    # demand
    held: FloatArray
    stuck: BoolArray  # True if the simulation failed


class Servo(NamedTuple):
    """Gains and bounds of one joint, as in `Joints`."""

    kp: float
    kv: float
    ki: float
    lower: float
    upper: float


class Command(NamedTuple):
    """Coefficients of a command that is a cubic in time [rad, rad/s, ...], and its lead [rad]."""

    value: float
    rate: float
    second: float
    third: float
    lead: float


class Motion(NamedTuple):
    """State of a joint, and results accumulated during its motion."""

    q: float  # Position [rad]
    w: float  # Velocity [rad/s]
    x: float  # Integral [rad]
    saturated: float  # Time in saturation [s]
    lowest: float  # Smallest demand [rad/s²]
    highest: float  # Largest demand [rad/s²]


class LinearMaps(NamedTuple):
    """Linear maps of the motion over KEPT_MAPS time spans, the last of which are kept."""

    series: FloatArray  # Taylor coefficients, from `series_of_map`
    maps: FloatArray  # (KEPT_MAPS + 1, 3, COLUMNS); the last map is a work array
    spans: FloatArray  # Time span of each map [s]; -1 if the slot is free, (KEPT_MAPS,)
    oldest: IntArray  # Slot whose map is replaced next, (1,)


@compiled(inner=True, fastmath=FUSED)
def shift(u: Command, t: float) -> Command:
    """Return the same command with its time origin moved to t."""
    value = u.value + t * (u.rate + t * (u.second + t * u.third))
    rate = u.rate + t * (2 * u.second + t * 3 * u.third)
    return Command(value, rate, u.second + 3 * u.third * t, u.third, u.lead)


@compiled(inner=True, fastmath=FUSED)
def command_at(pieces: FloatArray, starts: FloatArray, piece: int, now: float) -> Command:
    """Return the command of a piece, with its time origin at `now` [s]."""
    # Without views of rows, because counting references to arrays takes time.
    u = Command(
        pieces[piece, 0], pieces[piece, 1], pieces[piece, 2], pieces[piece, 3], pieces[piece, 4]
    )
    # The command is constant before the first set-point and after the last one.
    return shift(u, now - starts[piece - 1] if 0 < piece < len(starts) else 0.0)


@compiled(inner=True, fastmath=FUSED)
def fastest_rate(servo: Servo) -> float:
    """Bound the fastest rate of a servo, 1 / shortest time constant, from above [1/s]."""
    kp = servo.kp
    kv = servo.kv
    ki = servo.ki
    if kv == 0.0:
        return kp
    return max(kv, math.sqrt(kv * (kp + ki)), math.pow(kv * kp * ki, 1 / 3))


@compiled(inner=True, fastmath=FUSED)
def demand(servo: Servo, u: Command, q: float, w: float, x: float) -> tuple[float, float]:
    """Return the demand z before saturation [rad/s²], and its slope without saturation [rad/s³].

    Joints of first order have the demand `z = ddq = kp (du - dq)`.
    """
    kp = servo.kp
    kv = servo.kv
    ki = servo.ki
    if kv == 0.0:
        z = kp * (u.rate - kp * (u.value - q))
        return z, kp * (2 * u.second - z)
    error = kp * (u.value - q) - w
    z = kv * (error + ki * x)
    return z, kv * (kp * (u.rate - w) - z + ki * (error - kp * u.lead))


@compiled(inner=True, allocates=True, fastmath=FUSED)
def series_of_map(servo: Servo) -> FloatArray:
    """Return the Taylor coefficients in t of a motion's linear map, (MAP_TERMS, 3, COLUMNS).

    The state `(q - u, w, du, d2u / 2, d3u / 6, x, lead)` has the derivative `matrix state`, so its
    map over t is the matrix exponential with the coefficients `matrix^k / k!`.
    """
    kp = servo.kp
    kv = servo.kv
    ki = servo.ki
    matrix = np.zeros((COLUMNS, COLUMNS))
    series = np.zeros((MAP_TERMS, 3, COLUMNS))
    matrix[0, RATE_COLUMN] = -1.0
    matrix[RATE_COLUMN, RATE_COLUMN + 1] = 2.0
    matrix[RATE_COLUMN + 1, RATE_COLUMN + 2] = 3.0
    if kv == 0.0:
        matrix[0, 0] = -kp
    else:
        matrix[0, 1] = 1.0
        matrix[1, 0] = -kp * kv
        matrix[1, 1] = -kv
        matrix[1, INTEGRAL_COLUMN] = kv * ki
        matrix[INTEGRAL_COLUMN, 0] = -kp
        matrix[INTEGRAL_COLUMN, 1] = -1.0
        matrix[INTEGRAL_COLUMN, LEAD_COLUMN] = -kp
    series[0, 0, 0] = series[0, 1, 1] = series[0, 2, INTEGRAL_COLUMN] = 1.0
    for k in range(1, MAP_TERMS):
        for i in range(COLUMNS):
            for j in range(COLUMNS):
                if matrix[i, j] != 0.0:
                    factor = matrix[i, j] * INVERSE[k - 1]
                    for row in range(3):
                        series[k, row, j] += series[k - 1, row, i] * factor
    return series


@compiled(inner=True, fastmath=FUSED)
def write_map(
    series: FloatArray, integrates: bool, rate: float, span: float, maps: FloatArray, slot: int
) -> None:
    """Write the linear map of a motion over a time span [s] into maps[slot], (3, COLUMNS).

    The method is scaling and squaring: the series gives the map over a short time h, and each
    squaring doubles the time. The last map is overwritten.
    """
    rows, columns = (3, COLUMNS) if integrates else (2, INTEGRAL_COLUMN)
    squarings = 0
    h = span
    while h * rate > MAP_LENGTH:
        h = h / 2
        squarings = squarings + 1
    # Series of the short time
    for i in range(rows):
        for j in range(columns):
            value = 0.0
            for k in range(MAP_TERMS - 1, -1, -1):
                value = series[k, i, j] + h * value
            maps[slot, i, j] = value
    # Squarings
    for _ in range(squarings):
        for i in range(rows):
            for j in range(columns):
                maps[KEPT_MAPS, i, j] = maps[slot, i, j]
        for i in range(rows):
            a, b = maps[KEPT_MAPS, i, 0], maps[KEPT_MAPS, i, 1]
            for j in range(columns):
                maps[slot, i, j] = a * maps[KEPT_MAPS, 0, j] + b * maps[KEPT_MAPS, 1, j]
            # The command at the half time.
            r = maps[KEPT_MAPS, i, RATE_COLUMN]
            s = maps[KEPT_MAPS, i, RATE_COLUMN + 1]
            maps[slot, i, RATE_COLUMN] += r
            maps[slot, i, RATE_COLUMN + 1] += s + 2 * h * r
            maps[slot, i, RATE_COLUMN + 2] += maps[KEPT_MAPS, i, RATE_COLUMN + 2] + 3 * h * (
                s + h * r
            )
            if integrates:
                for j in range(columns):
                    maps[slot, i, j] += maps[KEPT_MAPS, i, INTEGRAL_COLUMN] * maps[KEPT_MAPS, 2, j]
                maps[slot, i, LEAD_COLUMN] += maps[KEPT_MAPS, i, LEAD_COLUMN]
        h *= 2


@compiled(inner=True, fastmath=FUSED)
def apply_map(
    servo: Servo, f: FloatArray, i: int, u: Command, end: Command, q: float, w: float, x: float
) -> tuple[float, float, float]:
    """Return position, velocity and integral after a step without saturation, by the map f[i].

    `end` is the command at the end.
    """
    e = q - u.value
    p = f[i, 0, 0] * e + f[i, 0, 1] * w
    p += f[i, 0, 2] * u.rate + f[i, 0, 3] * u.second + f[i, 0, 4] * u.third
    v = f[i, 1, 0] * e + f[i, 1, 1] * w
    v += f[i, 1, 2] * u.rate + f[i, 1, 3] * u.second + f[i, 1, 4] * u.third
    if servo.kv == 0.0:
        return p + end.value, -servo.kp * p, 0.0
    if servo.ki > 0.0:
        y = f[i, 2, 0] * e + f[i, 2, 1] * w + f[i, 2, 5] * x + f[i, 2, 6] * u.lead
        y += f[i, 2, 2] * u.rate + f[i, 2, 3] * u.second + f[i, 2, 4] * u.third
        p += f[i, 0, 5] * x + f[i, 0, 6] * u.lead
        v += f[i, 1, 5] * x + f[i, 1, 6] * u.lead
        x = y
    return p + end.value, v, x


@compiled(inner=True, fastmath=FUSED)
def evaluate(a: FloatArray, terms: int, order: int, t: float) -> float:
    """Evaluate a polynomial's derivative of a given order at time t."""
    value = 0.0
    for k in range(terms - 1, order - 1, -1):
        factor = a[k]
        for i in range(order):
            factor *= k - i
        value = factor + t * value
    return value


@compiled(inner=True, fastmath=FUSED)
def find_passage(
    a: FloatArray, terms: int, order: int, low: float, high: float, level: float
) -> float:
    """Return when a polynomial's derivative crosses `level`; `high` if it does not.

    Newton's method, which bisects the bracket from `low` to `high` if a step leaves it.
    """
    start = evaluate(a, terms if low > 0.0 else order + 1, order, low) - level
    end = evaluate(a, terms, order, high) - level
    if start * end >= 0.0:
        return high
    # The value at an extremum is more accurate than its time.
    tolerance = high * (PASSAGE if order == 0 else EXTREMUM)
    t = low + (high - low) * start / (start - end)
    for _ in range(MAX_PASSAGE_ITERATIONS):
        value = evaluate(a, terms, order, t) - level
        slope = evaluate(a, terms, order + 1, t)
        if (value > 0.0) == (end > 0.0):
            high = t
        else:
            low = t
        last = t
        t = t - value / slope if slope != 0.0 else low
        if not low < t < high:
            t = 0.5 * (low + high)
        if min(high - low, abs(t - last)) <= tolerance:
            break
    return t


@compiled(inner=True, fastmath=FUSED)
def count_terms(x: float) -> int:
    """Count the Taylor terms that matter if they decrease like `x^k / k!`."""
    term = 1.0
    n = 0
    while term > NEGLIGIBLE_TERM and n < MAX_TERMS - 3:
        term *= x * INVERSE[n]
        n += 1
    return n + 3


@compiled(inner=True, fastmath=FUSED)
def expand(
    servo: Servo, u: Command, side: float, terms: int, q: FloatArray, x: FloatArray, z: FloatArray
) -> None:
    """Compute the Taylor coefficients of position minus command value, integral and demand.

    `side` is 1 at the upper bound of the acceleration, -1 at the lower bound, otherwise 0.

    - `q`: the first two are input.
    - `x`: the first is input.
    - `z`: `terms` coefficients, output.
    """
    kp = servo.kp
    kv = servo.kv
    ki = servo.ki
    bound = servo.upper if side > 0.0 else servo.lower
    if kv == 0.0:
        q[1] = -kp * q[0]
    command = (0.0, u.rate, u.second, u.third, 0.0)
    for k in range(terms):
        p = command[min(k, 4)]
        w = (k + 1) * q[k + 1]
        if kv == 0.0:
            z[k] = kp * ((k + 1) * command[min(k + 1, 4)] - w)
        else:
            z[k] = kv * (kp * (p - q[k]) - w + ki * x[k])
        a = z[k]
        if side != 0.0:
            a = bound if k == 0 else 0.0
        q[k + 2] = a * INVERSE[k] * INVERSE[k + 1]
        if ki > 0.0:
            p -= u.lead if k == 0 else 0.0
            x[k + 1] = (kp * (p - q[k]) - w - (z[k] - a) / kv) * INVERSE[k]


class Phase(NamedTuple):
    """Part of a step in which the demand stays on one side of the bounds."""

    duration: float  # [s]
    following: float  # Side after the phase; the same side at the end of the step
    lowest: float  # Smallest demand at the extrema in the phase [rad/s²]
    highest: float  # Largest demand at the extrema in the phase [rad/s²]


@compiled(inner=True, fastmath=FUSED)
def side_of(servo: Servo, z: float, tolerance: float) -> float:
    """Return 1 if the demand z is above the upper bound, -1 if below the lower one, otherwise 0."""
    if z < servo.lower - tolerance:
        return -1.0
    return 1.0 if z > servo.upper + tolerance else 0.0


@compiled(inner=True, fastmath=FUSED)
def find_extrema(demands: FloatArray, n: int, end: float) -> tuple[float, float]:
    """Find the times of up to two extrema of the demand; `end` in place of missing ones.

    The slope of the demand has at most one extremum in a step.
    """
    first = find_passage(demands, n, 1, 0.0, end, 0.0)
    if first != end:
        return first, end
    turn = find_passage(demands, n, 2, 0.0, end, 0.0)
    first = find_passage(demands, n, 1, 0.0, turn, 0.0)
    return first, find_passage(demands, n, 1, turn, end, 0.0)


@compiled(inner=True, fastmath=FUSED)
def find_phase(
    servo: Servo, demands: FloatArray, n: int, side: float, tolerance: float, end: float
) -> Phase:
    """Find when the demand first leaves its side of the bounds, at the latest at `end`.

    - `demands`, `n`: Taylor coefficients of the demand, and their number.
    - `tolerance`: rounding error of the demand [rad/s²].
    """
    first, second = find_extrema(demands, n, end)
    lowest = math.inf
    highest = -math.inf
    begin = 0.0
    for t in (first, second, end):
        value = evaluate(demands, n, 0, t)
        if side == 0.0 and value > servo.upper + tolerance:
            bound = servo.upper
            following = 1.0
        elif side == 0.0 and value < servo.lower - tolerance:
            bound = servo.lower
            following = -1.0
        elif side > 0.0 and value < servo.upper:
            bound = servo.upper
            following = 0.0
        elif side < 0.0 and value > servo.lower:
            bound = servo.lower
            following = 0.0
        else:
            lowest = min(lowest, value)
            highest = max(highest, value)
            begin = t
            continue
        crossing = find_passage(demands, n, 0, begin, t, bound)
        return Phase(crossing, following, lowest, highest)
    return Phase(end, side, lowest, highest)


@compiled(inner=True, fastmath=FUSED)
def respond_by_events(servo: Servo, taylor: FloatArray, h: float, u: Command, m: Motion) -> Motion:
    """Simulate a step from event to event, where events are starts and ends of saturation.

    - `taylor`: work array, (3, MAX_TERMS + 2).
    - `h`: duration of the step [s].
    - `u`: command from the start of the step on.
    - `m`: motion at the start of the step.
    """
    q, w, x, saturated, lowest, highest = m
    position = taylor[0]
    integral = taylor[1]
    demands = taylor[2]
    now = side = 0.0
    known = False  # True if the last event determines the side.
    for _ in range(MAX_PHASES):
        v = shift(u, now)
        end = h - now
        z, _ = demand(servo, v, q, w, x)
        scale = abs(v.value) + abs(q) + servo.ki * abs(x)
        tolerance = DEMAND_ROUNDING * (servo.kp * servo.kv * scale + abs(z))
        if not known:
            side = side_of(servo, z, tolerance)
        # Taylor series of the motion on this side
        position[0] = q - v.value
        position[1] = w
        integral[0] = x
        # In saturation without an integrator, the demand is a cubic.
        n = 4 if side != 0.0 and servo.ki == 0.0 else count_terms(2 * fastest_rate(servo) * end)
        expand(servo, v, side, n, position, integral, demands)
        # Motion up to the next event, or to the end of the step
        phase = find_phase(servo, demands, n, side, tolerance, end)
        end = phase.duration
        lowest = min(lowest, z, phase.lowest)
        highest = max(highest, z, phase.highest)
        saturated += end if side != 0.0 else 0.0
        q = evaluate(position, n + 2, 0, end) + v.value
        w = evaluate(position, n + 2, 1, end)
        x = evaluate(integral, n + 1, 0, end)
        known = phase.following != side
        side = phase.following
        now += end
        if not known:
            return Motion(q, w, x, saturated, lowest, highest)
    return Motion(math.nan, math.nan, x, saturated, lowest, highest)


@compiled(inner=True, fastmath=FUSED)
def respond(
    servo: Servo,
    f: FloatArray,
    i: int,
    taylor: FloatArray,
    h: float,
    u: Command,
    end: Command,
    m: Motion,
) -> Motion:
    """Simulate a step of duration h [s], during which saturation may start or end.

    A step of one kind is a map or a parabola. Steps in which the demand may cross a bound, or may
    have a new extreme, are simulated by events.

    - `f`, `i`: the linear map of the step is f[i].
    - `taylor`: work array, (3, MAX_TERMS + 2).
    - `u`, `end`: command from the start and from the end of the step on.
    - `m`: motion at the start. The result is not finite with too many events.
    """
    z, slope = demand(servo, u, m.q, m.w, m.x)
    ddq = min(max(z, servo.lower), servo.upper)
    if z != ddq and servo.ki > 0.0:
        return respond_by_events(servo, taylor, h, u, m)
    # Motion that stays on its side of the bounds, and range of the demand on this side
    saturated = m.saturated
    least = servo.lower
    most = servo.upper
    if z == ddq:
        q, w, x = apply_map(servo, f, i, u, end, m.q, m.w, m.x)
    else:
        q = m.q + h * (m.w + h / 2 * ddq)
        w = m.w + h * ddq
        x = 0.0
        saturated += h
        least, most = (servo.upper, math.inf) if z > ddq else (-math.inf, servo.lower)
    last, after = demand(servo, end, q, w, x)
    # The slope in saturation.
    slope = slope + servo.kv * (z - ddq)
    after = after + servo.kv * (last - ddq) * (z != ddq)
    low = min(m.lowest, z, last)
    high = max(m.highest, z, last)
    # The demand is between its values at both ends and the inner control points of a cubic.
    rise = last - z
    a = h * slope
    b = h * after
    margin = CUBIC_ERROR * (abs(a - rise) + abs(b - rise))
    first = z + a * THIRD
    second = last - b * THIRD
    bottom = min(first, second) - margin
    top = max(first, second) + margin
    # Most steps return here, without a start or end of saturation and without a new extreme.
    if least <= min(last, bottom) and max(last, top) <= most and low <= bottom and top <= high:
        return Motion(q, w, x, saturated, low, high)
    return respond_by_events(servo, taylor, h, u, m)


@compiled(inner=True, fastmath=FUSED)
def find_piece(starts: FloatArray, now: float) -> int:
    """Count the command's pieces that have begun before `now` [s], by bisection."""
    piece = 0
    high = len(starts)
    while piece < high:
        middle = (piece + high) // 2
        if starts[middle] < now - SAME_INSTANT:
            piece = middle + 1
        else:
            high = middle
    return piece


@compiled(inner=True, fastmath=FUSED)
def begins(starts: FloatArray, piece: int, now: float) -> bool:
    """Return whether the next piece of the command begins at `now` [s].

    `piece` is the number of pieces that have begun.
    """
    return piece < len(starts) and starts[piece] - now <= SAME_INSTANT


@compiled(inner=True, fastmath=FUSED)
def stop_before(starts: FloatArray, piece: int, until: float) -> float:
    """Return when the command's next piece starts, or the earlier time `until` [s]."""
    if piece < len(starts) and starts[piece] < until - SAME_INSTANT:
        return float(starts[piece])
    return until


@compiled(inner=True, fastmath=FUSED)
def march_held(
    servo: Servo,
    pieces: FloatArray,
    starts: FloatArray,
    times: FloatArray,
    held: float,
    m: Motion,
    piece: int,
    out: FloatArray,
) -> tuple[Motion, float]:
    """Simulate a joint whose drive holds acceleration or velocity in each piece of the command.

    The arguments and the result are those of `march`, with `held` for the held value and `m` for
    the motion at the start, and with `piece`, the number of pieces that have begun before
    times[0]. The integral changes once per
    piece, by the equation above, before the demand is computed.
    """
    q, w, x, saturated, lowest, highest = m
    first_order = servo.kv == 0.0
    now = times[0]
    kp = servo.kp
    kv = servo.kv
    ki = servo.ki
    z = held
    drive_cycle = starts[1] - starts[0] if len(starts) > 1 else 0.0
    if ki > 0.0 and piece > 0:
        # The integral follows from the demand of the last cycle and the position at its start.
        held = min(max(z, servo.lower), servo.upper)
        t = now - starts[piece - 1]
        v = w - t * held
        p = q - t * (w + v) / 2
        x = (z / kv - kp * (pieces[piece, 0] - p) + v) / ki - drive_cycle * (z - held) / kv
    for row in range(1, len(times)):
        until = times[row]
        while until - now > SAME_INSTANT:
            # Cycle of the drive: new demand and held value
            if begins(starts, piece, now):
                piece += 1
                if first_order:
                    held = kp * (pieces[piece, 0] - q)
                    z = 0.0
                else:
                    if ki > 0.0:
                        x += drive_cycle * (kp * (pieces[piece, 0] - pieces[piece, 4] - q) - w)
                    z = kv * (kp * (pieces[piece, 0] - q) - w + ki * x)
                    held = min(max(z, servo.lower), servo.upper)
                    x -= drive_cycle * (z - held) / kv
                lowest = min(lowest, z)
                highest = max(highest, z)
                continue
            # Motion with the held value
            stop = stop_before(starts, piece, until)
            h = stop - now
            if first_order:
                q = q + h * held
                w = held
            else:
                q = q + h * (w + h / 2 * held)
                w = w + h * held
                saturated += h if z != held else 0.0
            now = stop
        now = until
        out[row - 1, 0] = q
        out[row - 1, 1] = w
        out[row - 1, 2] = z
    return Motion(q, w, x, saturated, lowest, highest), z if ki > 0.0 else held


@compiled(inner=True, fastmath=FUSED)
def march_delayed(
    pieces: FloatArray,
    starts: FloatArray,
    times: FloatArray,
    held: float,
    m: Motion,
    piece: int,
    out: FloatArray,
) -> tuple[Motion, float]:
    """Simulate a joint that follows its command exactly; arguments and result as `march_held`."""
    now = times[0]
    for row in range(1, len(times)):
        until = times[row]
        while until - now > SAME_INSTANT:
            if begins(starts, piece, now):
                piece += 1
            else:
                now = stop_before(starts, piece, until)
        now = until
        u = command_at(pieces, starts, piece, now)
        m = Motion(u.value, u.rate, 0.0, 0.0, m.lowest, m.highest)
        out[row - 1, 0] = u.value
        out[row - 1, 1] = u.rate
        out[row - 1, 2] = 2 * u.second
    return m, held


@compiled(inner=True, fastmath=FUSED)
def find_map(linear: LinearMaps, servo: Servo, h: float, slot: int) -> int:
    """Return the slot of the linear map over the time h [s]; compute the map if it is not kept.

    `slot` is the slot of the last step, whose map most often fits.
    """
    if abs(linear.spans[slot] - h) <= SAME_INSTANT:
        return slot
    found = -1
    for i in range(KEPT_MAPS):
        if abs(linear.spans[i] - h) <= SAME_INSTANT:
            found = i
    if found < 0:
        found = int(linear.oldest[0])
        linear.oldest[0] = (found + 1) % KEPT_MAPS
        write_map(linear.series, servo.ki > 0.0, fastest_rate(servo), h, linear.maps, found)
        linear.spans[found] = h
    return found


@compiled(inner=True, fastmath=FUSED)
def respond_linearly(
    servo: Servo, f: FloatArray, i: int, u: Command, end: Command, m: Motion
) -> Motion:
    """Simulate a step without saturation by the map f[i]; `u` and `end` as in `respond`."""
    q, w, x = apply_map(servo, f, i, u, end, m.q, m.w, m.x)
    return Motion(q, w, x, 0.0, 0.0, 0.0)


@compiled(inner=True, allocates=True, fastmath=FUSED)
def march(
    servo: Servo,
    kind: int,
    pieces: FloatArray,
    starts: FloatArray,
    times: FloatArray,
    state: FloatArray,
    out: FloatArray,
) -> tuple[Motion, float]:
    """Simulate one joint from times[0] on; return its motion and its held value.

    The joint moves in steps between the starts of the command's pieces and the times of the
    results. Steps that may saturate are divided into parts of at most LARGEST_SATURATING_STEP.

    The motion is not finite if the servo requires more than MAX_STEPS_PER_SPAN steps per result.

    - `kind`: COMPLETE, SATURATING, LINEAR or HELD. Without recorded extremes, `lowest` is -inf and
      `highest` inf; both are 0 with LINEAR.
    - `pieces`: coefficients of the command and its lead, (n + 1, 5), of which the first and the
      last are constant.
    - `starts`: times at which all pieces but the first reach the joint [s], (n,).
    - `times`: start, and times of the results [s], (m + 1,).
    - `state`: position, velocity and held value at the start, (3,).
    - `out`: position, velocity and demand, (m, 3).
    """
    extreme = 0.0 if kind in (COMPLETE, HELD) else math.inf
    m = Motion(state[0], state[1], 0.0, 0.0, 0.0 - extreme, extreme)
    held = state[2]
    now = times[0]
    piece = find_piece(starts, now)
    if math.isinf(servo.kp):
        return march_delayed(pieces, starts, times, held, m, piece, out)
    if kind == HELD:
        return march_held(servo, pieces, starts, times, held, m, piece, out)
    u = command_at(pieces, starts, piece, now)
    if servo.ki > 0.0:
        # The integral that gives the demand at the start
        x = (held / servo.kv - servo.kp * (u.value - m.q) + m.w) / servo.ki
        m = Motion(m.q, m.w, x, 0.0, m.lowest, m.highest)
    rate = fastest_rate(servo)
    if (times[-1] - now) * rate > MAX_STEPS_PER_SPAN * LARGEST_SATURATING_STEP * len(times):
        return Motion(math.nan, math.nan, 0.0, 0.0, 0.0, 0.0), held
    maps = np.empty((KEPT_MAPS + 1, 3, COLUMNS))
    spans = np.full(KEPT_MAPS, -1.0)
    linear = LinearMaps(series_of_map(servo), maps, spans, np.zeros(1, np.intp))
    slot = 0
    taylor = np.zeros((3, MAX_TERMS + 2))
    for row in range(1, len(times)):
        until = times[row]
        while until - now > SAME_INSTANT:
            if begins(starts, piece, now):
                piece += 1
                u = command_at(pieces, starts, piece, now)
                continue
            stop = stop_before(starts, piece, until)
            h = stop - now
            repeats = 1
            if kind != LINEAR:
                repeats = max(
                    int(math.ceil(h * rate / LARGEST_SATURATING_STEP * STEP_COUNT_FACTOR)), 1
                )
                h /= repeats
            slot = find_map(linear, servo, h, slot)
            for _ in range(repeats):
                end = shift(u, h)
                if kind == LINEAR:
                    m = respond_linearly(servo, maps, slot, u, end, m)
                else:
                    m = respond(servo, maps, slot, taylor, h, u, end, m)
                u = end
            now = stop
        now = until
        held, _ = demand(servo, u, m.q, m.w, m.x)
        out[row - 1, 0] = m.q
        out[row - 1, 1] = m.w
        out[row - 1, 2] = held
    return m, held


@compiled(fastmath=FUSED)
def run_joints(
    joints: Joints,
    kind: int,
    commands: FloatArray,
    starts: FloatArray,
    times: FloatArray,
    states: FloatArray,
) -> JointMotions:
    """Simulate all joints, or one joint with several sets of parameters, row by row.

    The arguments are those of `march`, with one row per joint, and states with one column per
    joint.
    """
    rows = len(joints.kp)
    out = np.empty((rows, len(times) - 1, 3))
    saturated, lowest, highest, held = np.empty((4, rows))
    stuck = np.empty(rows, np.bool_)
    for j in range(rows):
        lower, upper = joints.lower[j], joints.upper[j]
        servo = Servo(joints.kp[j], joints.kv[j], joints.ki[j], lower, upper)
        m, held[j] = march(servo, kind, commands[j], starts[j], times, states[:, j], out[j])
        saturated[j] = m.saturated
        lowest[j] = m.lowest
        highest[j] = m.highest
        stuck[j] = not math.isfinite(m.q + m.w)
    return JointMotions(out, saturated, lowest, highest, held, stuck)
