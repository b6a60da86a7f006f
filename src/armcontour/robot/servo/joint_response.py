"""Compiled response of one joint to its command, exact from event to event."""

# A joint of second order follows `ddq = clip(kv (kp (u - q) - dq), lower, upper)`, (7); a joint of
# first order (kv = 0) follows `dq = kp (u - q)`. The command u is a cubic in time. Events are the
# starts and ends of saturation. Between events the motion has a closed form; the times of events
# are found by Newton's method, up to rounding errors.

from __future__ import annotations

import math
from typing import NamedTuple

from armcontour.core.kernels import FUSED, compiled

# Longest step of a free motion, as a multiple of the shortest time constant of the servo. Within
# it, the slope of the demand has at most one extremum, and the series below converge up to rounding
# errors.
LARGEST_STEP = 0.5
# Largest number of terms of the series in `_integrals`, the factors 1 / n in them, and the relative
# size below which terms are negligible.
TERMS = 20
INVERSE = tuple(1.0 / n for n in range(1, TERMS + 5))
NOTHING = 1e-18
# Argument below which hyperbolic functions are computed by series; seven terms are exact to 1e-15.
SERIES = 0.1
C = tuple(1 / math.factorial(n) for n in range(2, 14, 2))
S = tuple(1 / math.factorial(n) for n in range(3, 15, 2))
# Saturation shorter than this fraction of a time span is ignored.
SHORTEST_STAY = 1e-9
# The demand is kp kv times a difference of positions. If its excess over a bound is below this
# fraction of kp kv times the command, the excess is a rounding error and not saturation.
ROUNDING = 1e-14
# Newton's method ends with a step below this fraction of the interval, because the next step would
# be below 1e-12 of it.
NEAR = 1e-6
# Factor of `kp kv t²` in `_bound_free`. It must exceed 1/2, because 1 / (1 - x) exceeds 1 + x; 0.6
# suffices for steps up to LARGEST_STEP.
FALL = 0.6
# Largest number of free motions per time span; the gains of no servo require more.
MAX_STEPS = 1e5
# Largest number of phases (free or saturated) per step; with more, their durations round to 0.
MAX_PHASES = 100_000


# Functions that every step calls are inlined, because a call would double their time.


class Cubic(NamedTuple):
    """Coefficients of a command that is a cubic in time [rad, rad/s, rad/s², rad/s³]."""

    value: float
    rate: float
    second: float
    third: float


@compiled(inner=True, fastmath=FUSED)
def shift(u: Cubic, t: float) -> Cubic:
    """The same command with its time origin moved to t."""
    value = u.value + t * (u.rate + t * (u.second + t * u.third))
    rate = u.rate + t * (2 * u.second + t * 3 * u.third)
    return Cubic(value, rate, u.second + 3 * u.third * t, u.third)


class Servo(NamedTuple):
    """Gains [1/s] and acceleration bounds [rad/s²] of one joint."""

    # kv = 0 means first order, ki = 0 means no integrator.

    kp: float
    kv: float
    lower: float
    upper: float
    ki: float


class Motion(NamedTuple):
    """State of a joint, and results accumulated during its motion."""

    # q: position [rad]. w: velocity [rad/s]. held: the acceleration [rad/s²] or velocity that a
    # drive with a cycle holds; with an integrator the demand. saturated: time in saturation [s].
    # lowest, highest: extremes of the demand [rad/s²].

    q: float
    w: float
    held: float
    saturated: float
    lowest: float
    highest: float


class FreeMotionMap(NamedTuple):
    """Linear map of a free motion over a time span, from state and command to the final state."""

    # In the final q - u, `qq` and `qw` are the factors of the initial q - u and dq, and `q1`, `q2`,
    # `q3` are the factors of the command's coefficients. `wq`, `ww`, `w1`, `w2` and `w3` are the
    # corresponding factors in the final dq.

    time: float
    qq: float
    qw: float
    wq: float
    ww: float
    q1: float
    q2: float
    q3: float
    w1: float
    w2: float
    w3: float


class Signal(NamedTuple):
    """Sum of a cubic in time and a free motion of the servo."""

    # The cubic has coefficients c0 to c3; the free motion has value `free` and slope `slope` at 0.

    c0: float
    c1: float
    c2: float
    c3: float
    free: float
    slope: float


class Phase(NamedTuple):
    """A motion between two events."""

    # time: duration [s]. side: bound at which the joint is saturated (1 upper, -1 lower, 0 none).
    # following: bound of the next phase. q, w: final position and velocity. lowest, highest:
    # extremes of the demand [rad/s²].

    time: float
    side: float
    following: float
    q: float
    w: float
    lowest: float
    highest: float


@compiled(inner=True, fastmath=FUSED)
def fastest_rate(kp: float, kv: float) -> float:
    """Upper bound of the inverse of the shortest time constant [1/s]."""
    if kv == 0.0:
        return kp
    return kv if kv >= 4 * kp else math.sqrt(kp * kv)


@compiled(inner=True, fastmath=FUSED)
def modes(discriminant: float, decay: float, t: float) -> tuple[float, float]:
    """`exp(decay t) cosh(w t)` and `exp(decay t) sinh(w t) / w`, with `w² = discriminant`."""
    x = discriminant * t * t
    if abs(x) < SERIES:
        e = math.exp(decay * t)
        c = 1 + x * (C[0] + x * (C[1] + x * (C[2] + x * (C[3] + x * (C[4] + x * C[5])))))
        s = 1 + x * (S[0] + x * (S[1] + x * (S[2] + x * (S[3] + x * (S[4] + x * S[5])))))
        return e * c, e * t * s
    if x > 0.0:
        w = math.sqrt(discriminant)
        up = math.exp((decay + w) * t)
        down = math.exp((decay - w) * t)
        return (up + down) / 2, (up - down) / (2 * w)
    e = math.exp(decay * t)
    w = math.sqrt(-discriminant)
    return e * math.cos(w * t), e * math.sin(w * t) / w


@compiled(inner=True, fastmath=FUSED)
def transition(kp: float, kv: float, t: float, straight: bool) -> FreeMotionMap:
    """Map of the free motion over time t [s], at most about `LARGEST_STEP` time constants."""
    # A straight command has no terms in t² and t³, so their factors are not computed.
    if kv == 0.0:
        a = math.exp(-kp * t)
        y1, y2, y3 = _integrals(kp, 0.0, t)
        return FreeMotionMap(t, a, 0.0, -kp * a, 0.0, y1, y2, y3, 1 - a, 2 * y1, 3 * y2)
    c, s = modes(kv * kv / 4 - kp * kv, -kv / 2, t)
    a, b = c + kv / 2 * s, -kp * kv * s
    if straight:
        return FreeMotionMap(
            t, a, s, b, c - kv / 2 * s, t - (1 - a) / kp - s, 0.0, 0.0, 1 - a, 0.0, 0.0
        )
    y1, y2, y3 = _integrals(kp, kv, t)
    return FreeMotionMap(t, a, s, b, c - kv / 2 * s, y1, y2, y3, 1 - a, 2 * y1, 3 * y2)


@compiled(inner=True, fastmath=FUSED)
def _integrals(kp: float, kv: float, t: float) -> tuple[float, float, float]:
    """Responses from rest to the commands t, t² and t³ at time t, by Taylor series."""
    # Closed forms contain differences of terms in `1 / kp³`, which lose digits if cycles are short.
    # `term` is a term of the series of t times the impulse response; each follows from the two
    # previous terms.
    if kv == 0.0:
        damping, stiffness = kp * t, 0.0
        term, following = damping, -damping * damping
    else:
        damping, stiffness = kv * t, kp * kv * t * t
        term, following = 0.0, stiffness
    smallest = NOTHING * (abs(term) + abs(following))
    first = second = third = 0.0
    for m in range(TERMS):
        weight = term * INVERSE[m] * INVERSE[m + 1]
        first += weight
        weight *= INVERSE[m + 2]
        second += weight
        third += weight * INVERSE[m + 3]
        previous = term
        term = following
        following = -(damping * term + stiffness * previous * INVERSE[m]) * INVERSE[m + 1]
        if abs(term) + abs(following) <= smallest:
            break
    return first * t, 2 * second * t * t, 6 * third * t * t * t


@compiled(inner=True, fastmath=FUSED)
def advance_freely(step: FreeMotionMap, u: Cubic, q: float, w: float) -> tuple[float, float]:
    """Position [rad] and velocity [rad/s] after a free motion under the command u."""
    s, e = step, q - u.value
    x = u.value + s.qq * e + s.qw * w + s.q1 * u.rate + s.q2 * u.second + s.q3 * u.third
    v = s.wq * e + s.ww * w + s.w1 * u.rate + s.w2 * u.second + s.w3 * u.third
    return x, v


@compiled(inner=True, fastmath=FUSED)
def _sample(servo: Servo, f: Signal, t: float) -> tuple[float, float]:
    """Value and slope of a signal at time t."""
    value = f.c0 + t * (f.c1 + t * (f.c2 + t * f.c3))
    slope = f.c1 + t * (2 * f.c2 + t * 3 * f.c3)
    if f.free == 0.0 and f.slope == 0.0:
        return value, slope
    kp, kv = servo.kp, servo.kv
    c, s = modes(kv * kv / 4 - kp * kv, -kv / 2, t)
    value += f.free * c + (f.slope + kv / 2 * f.free) * s
    slope += f.slope * c - (kp * kv * f.free + kv / 2 * f.slope) * s
    return value, slope


@compiled(inner=True, fastmath=FUSED)
def _excess_over(f: Signal, side: float, bound: float) -> Signal:
    """Excess of a signal over an upper bound (side 1), or below a lower bound (side -1)."""
    c0 = side * (f.c0 - bound)
    return Signal(c0, side * f.c1, side * f.c2, side * f.c3, side * f.free, side * f.slope)


@compiled(inner=True, fastmath=FUSED)
def _find_root(servo: Servo, f: Signal, low: float, high: float, t: float) -> float:
    """Time at which a signal that rises in [low, high] is 0, by Newton's method from guess t."""
    tolerance = NEAR * (high - low)
    for _ in range(200):
        value, slope = _sample(servo, f, t)
        if value < 0.0:
            low = t
        else:
            high = t
        step = value / slope if slope > 0.0 else math.inf
        if abs(step) <= tolerance:
            # Newton's method converges quadratically, so no further step is necessary.
            return min(max(t - step, low), high)
        t = t - step
        if not low < t < high:
            t = 0.5 * (low + high)
        if t == low or t == high:
            break
    return high


@compiled(inner=True, fastmath=FUSED)
def _find_extremum(servo: Servo, y: float, dy: float) -> float:
    """First time after 0 at which the slope of a free motion is 0; infinity if there is none."""
    kp, kv = servo.kp, servo.kv
    slope = -kv / 2 * dy - kp * kv * y
    if slope == 0.0:
        return math.inf
    a = -dy / slope  # tanh(w t) / w
    discriminant = kv * kv / 4 - kp * kv
    if discriminant > 0.0:
        w = math.sqrt(discriminant)
        return math.atanh(w * a) / w if 0.0 < w * a < 1.0 else math.inf
    if discriminant == 0.0:
        return a if a > 0.0 else math.inf
    w = math.sqrt(-discriminant)
    t = math.atan(w * a) / w
    return t if t > 0.0 else t + math.pi / w


@compiled(inner=True, fastmath=FUSED)
def _find_cubic_extrema(f: Signal, end: float) -> tuple[float, float]:
    """Times in (0, end) at which the slope of a cubic is 0, in order; `end` if there is none."""
    a, b, d = 3 * f.c3, f.c2, f.c1  # slope = a t² + 2 b t + d
    square = b * b - a * d
    if square < 0.0:
        return end, end
    # Roots of the slope without cancellation. One root is infinite if the slope is linear.
    s = -(b + math.copysign(math.sqrt(square), b))
    one = s / a if a != 0.0 else end
    two = d / s if s != 0.0 else end
    if not 0.0 < one < end:
        one = end
    if not 0.0 < two < end:
        two = end
    return min(one, two), max(one, two)


@compiled(inner=True, fastmath=FUSED)
def _find_extrema(servo: Servo, f: Signal, end: float) -> tuple[float, float]:
    """Times in (0, end) at which a signal has an extremum, in order; `end` if there is none."""
    # The signal is linear plus a free motion. The slope of a free motion is also a free motion,
    # with at most one extremum in a short time. So the signal has at most one extremum before and
    # one after the extremum of its slope.
    if f.c1 == 0.0:
        return min(_find_extremum(servo, f.free, f.slope), end), end
    curvature = -servo.kv * f.slope - servo.kp * servo.kv * f.free
    rate = Signal(f.c1, 0.0, 0.0, 0.0, f.slope, curvature)
    middle = min(_find_extremum(servo, f.slope, curvature), end)
    first, second = end, end
    start, between = f.c1 + f.slope, _sample(servo, rate, middle)[0]
    if start * between < 0.0:
        upward = _excess_over(rate, math.copysign(1.0, between), 0.0)
        first = _find_root(servo, upward, 0.0, middle, 0.5 * middle)
    if middle < end:
        last = _sample(servo, rate, end)[0]
        if between * last < 0.0:
            upward = _excess_over(rate, math.copysign(1.0, last), 0.0)
            second = _find_root(servo, upward, middle, end, 0.5 * (middle + end))
    return min(first, second), max(first, second)


@compiled(inner=True, fastmath=FUSED)
def demand(servo: Servo, u: Cubic, q: float, w: float) -> float:
    """Demand: acceleration of the servo before saturation [rad/s²]."""
    if servo.kv == 0.0:
        return servo.kp * (u.rate - w)
    return servo.kv * (servo.kp * (u.value - q) - w)


@compiled(inner=True, fastmath=FUSED)
def _saturated_side(servo: Servo, z: float, u: Cubic) -> float:
    """1 if the demand z is above its upper bound, -1 if z is below its lower bound, else 0."""
    # The sign of z does not decide, because both bounds may have the same sign.
    tolerance = ROUNDING * servo.kp * servo.kv * abs(u.value)
    if z > servo.upper + tolerance:
        return 1.0
    return -1.0 if z < servo.lower - tolerance else 0.0


@compiled(inner=True, fastmath=FUSED)
def _excess_in_saturation(servo: Servo, u: Cubic, q: float, w: float, side: float) -> Signal:
    """Excess of the demand over a bound, while the joint accelerates at the bound."""
    kp, kv = servo.kp, servo.kv
    bound = servo.upper if side > 0.0 else servo.lower
    return Signal(
        max(side * (kv * (kp * (u.value - q) - w) - bound), 0.0),
        side * kv * (kp * (u.rate - w) - bound),
        side * kv * kp * (u.second - bound / 2),
        side * kv * kp * u.third,
        0.0,
        0.0,
    )


@compiled(inner=True, fastmath=FUSED)
def _time_until_negative(servo: Servo, over: Signal, end: float) -> float:
    """First time in [0, end] at which a nonnegative cubic becomes negative; otherwise `end`."""
    if over.c3 == 0.0:
        square = over.c1 * over.c1 - 4.0 * over.c2 * over.c0
        if square < 0.0 or (over.c1 >= 0.0 and over.c2 >= 0.0):
            return end
        root = math.sqrt(square)
        t = (
            (over.c1 + root) / (-2.0 * over.c2)
            if over.c1 > 0.0
            else 2.0 * over.c0 / (root - over.c1)
        )
        return min(t, end)
    low = 0.0
    first, second = _find_cubic_extrema(over, end)
    for high in (first, second, end):
        if high > low and _sample(servo, over, high)[0] < 0.0:
            return _find_root(servo, _excess_over(over, -1.0, 0.0), low, high, 0.5 * (low + high))
        low = high
    return end


@compiled(inner=True, fastmath=FUSED, inline="always")
def _saturate(servo: Servo, over: Signal, q: float, w: float, side: float, t: float) -> Phase:
    """Saturated motion of duration t, during which the demand exceeds a bound."""
    bound = servo.upper if side > 0.0 else servo.lower
    last = over.c0 + t * (over.c1 + t * (over.c2 + t * over.c3))
    lowest, highest = min(over.c0, last), max(over.c0, last)
    if over.c1 * (over.c1 + t * (2 * over.c2 + t * 3 * over.c3)) < 0.0 or over.c3 != 0.0:
        for extremum in _find_cubic_extrema(over, t):
            value = over.c0 + extremum * (over.c1 + extremum * (over.c2 + extremum * over.c3))
            lowest, highest = min(lowest, value), max(highest, value)
    if side < 0.0:
        lowest, highest = -highest, -lowest
    x, v = q + t * (w + bound * t / 2), w + bound * t
    return Phase(t, side, 0.0, x, v, bound + lowest, bound + highest)


@compiled(inner=True, fastmath=FUSED)
def _guess_crossing(z: float, dz: float, last: float, dlast: float, bound: float) -> float:
    """Fraction of a step at which the demand reaches a bound, approximated by a cubic."""
    if last == z:
        return 0.0
    second, third = 3 * (last - z) - 2 * dz - dlast, dz + dlast - 2 * (last - z)
    x = min(max((bound - z) / (last - z), 0.0), 1.0)
    for _ in range(3):
        slope = dz + x * (2 * second + 3 * third * x)
        if slope * (last - z) <= 0.0:
            break
        x -= (z + x * (dz + x * (second + x * third)) - bound) / slope
        x = min(max(x, 0.0), 1.0)
    return x


@compiled(inner=True, fastmath=FUSED)
def _move_freely(
    servo: Servo, u: Cubic, q: float, w: float, z: float, step: FreeMotionMap, span: float
) -> Phase:
    """Free motion up to the start of saturation, or over the whole step."""
    kp, kv, t = servo.kp, servo.kv, step.time
    straight = u.second == 0.0 and u.third == 0.0
    c1 = 6 * u.third
    c0 = 2 * u.second - c1 / kp
    dz = kv * (kp * (u.rate - w) - z)
    f = Signal(c0, c1, 0.0, 0.0, z - c0, dz - c1)
    x, v = advance_freely(step, u, q, w)
    end = shift(u, t)
    last = demand(servo, end, x, v)
    dlast = kv * (kp * (end.rate - v) - last)
    first, second = (t, t) if straight and dz * dlast >= 0.0 else _find_extrema(servo, f, t)
    lowest, highest, low, before, slope = z, z, 0.0, z, dz
    for stop in (first, second, t):
        if stop <= low:
            continue
        value, after = _sample(servo, f, stop) if stop < t else (last, dlast)
        side = _saturated_side(servo, value, u)
        if side != 0.0:
            bound = servo.upper if side > 0.0 else servo.lower
            h = stop - low
            guess = low + h * _guess_crossing(before, h * slope, value, h * after, bound)
            crossing = _find_root(servo, _excess_over(f, side, bound), low, stop, guess)
            p, r = advance_freely(transition(kp, kv, crossing, straight), u, q, w)
            ahead = _excess_in_saturation(servo, shift(u, crossing), p, r, side)
            if _time_until_negative(servo, ahead, span) > SHORTEST_STAY * span:
                return Phase(crossing, 0.0, side, p, r, min(lowest, bound), max(highest, bound))
        lowest, highest = min(lowest, value), max(highest, value)
        low, before, slope = stop, value, after
    return Phase(t, 0.0, 0.0, x, v, lowest, highest)


@compiled(inner=True, fastmath=FUSED, inline="always")
def next_phase(
    servo: Servo,
    u: Cubic,
    q: float,
    w: float,
    side: float,
    remaining: float,
    span: float,
    step: FreeMotionMap,
) -> Phase:
    """Motion of a second-order joint under command u up to the next event."""
    # `side` is the bound that the previous phase reached: 1 upper, -1 lower, 0 none. The phase
    # lasts at most `remaining` [s]. `step` is the map of the free motion over the longest step.
    z = demand(servo, u, q, w)
    active_side = side if side != 0.0 else _saturated_side(servo, z, u)
    if active_side != 0.0:
        over = _excess_in_saturation(servo, u, q, w, active_side)
        t = _time_until_negative(servo, over, remaining)
        if side != 0.0 or t > SHORTEST_STAY * span:
            return _saturate(servo, over, q, w, active_side, t)
    if step.time > remaining:
        step = transition(servo.kp, servo.kv, remaining, u.second == 0.0 and u.third == 0.0)
    return _move_freely(servo, u, q, w, z, step, span)


@compiled(fastmath=FUSED)
def progresses(kp: float, kv: float, span: float) -> bool:
    """True if steps over `span` [s] change a floating-point time, and are not too many."""
    step = LARGEST_STEP / fastest_rate(kp, kv)
    return step >= span or (span + step > span and span < MAX_STEPS * step)


@compiled(inner=True, fastmath=FUSED)
def _respond_by_events(servo: Servo, step: FreeMotionMap, u: Cubic, m: Motion) -> Motion:
    """Simulate a joint of second order over a step, event by event."""
    q, w, _, saturated, lowest, highest = m
    now = side = 0.0
    span = step.time
    phases = 0
    while now < span:
        phases += 1
        if phases > MAX_PHASES:
            return Motion(math.nan, math.nan, 0.0, saturated, lowest, highest)
        remaining = span - now
        p = next_phase(servo, shift(u, now), q, w, side, remaining, span, step)
        q, w, side = p.q, p.w, p.following
        lowest, highest = min(lowest, p.lowest), max(highest, p.highest)
        if p.side != 0.0:
            saturated += p.time
        now = now + p.time if p.time < remaining else span
    return Motion(q, w, 0.0, saturated, lowest, highest)


@compiled(inner=True, fastmath=FUSED)
def _bound_free(
    servo: Servo, z: float, dz: float, last: float, dlast: float, t: float
) -> tuple[float, float]:
    """Bounds on a free motion within a step, from its values and slopes at both ends."""
    # If the motion has an extremum within the step, the extremum exceeds the start value or 0 by at
    # most t times the start slope. After the extremum, where the slope is 0, the motion falls by at
    # most the fraction `kp kv t² / 2` of the extremum.
    low, high = min(z, last), max(z, last)
    if dz * dlast < 0.0:
        factor = 1 + FALL * servo.kp * servo.kv * t * t
        if dz > 0.0:
            high = max(high, min(max(z, 0.0) + t * dz, max(last, 0.0) * factor))
        else:
            low = min(low, max(min(z, 0.0) + t * dz, min(last, 0.0) * factor))
    return low, high


@compiled(inner=True, fastmath=FUSED)
def _bound_demand(
    servo: Servo, u: Cubic, z: float, dz: float, last: float, dlast: float, t: float
) -> tuple[float, float]:
    """Bounds on the demand within a step without saturation, by `_bound_free`."""
    if u.second == 0.0 and u.third == 0.0:
        return _bound_free(servo, z, dz, last, dlast, t)
    rate = 6 * u.third
    line = 2 * u.second - rate / servo.kp
    end = line + t * rate
    low, high = _bound_free(servo, z - line, dz - rate, last - end, dlast - rate, t)
    return min(line, end) + low, max(line, end) + high


@compiled(inner=True, fastmath=FUSED)
def _demand_extremum(
    servo: Servo, u: Cubic, z: float, dz: float, last: float, dlast: float, t: float
) -> float:
    """Extremum of the demand within a step with slopes of opposite sign at its ends."""
    # The time is the extremum of a cubic through both ends, improved by one step of Newton's
    # method. The value is more accurate than the time, because the slope is 0 at the extremum.
    a, b = t * dz, t * dlast
    second, third = 3 * (last - z) - 2 * a - b, 3 * (2 * (z - last) + a + b)
    root = math.sqrt(max(second * second - third * a, 0.0))
    s = -(second + math.copysign(root, second))
    x = s / third if third != 0.0 else 2.0
    if not 0.0 < x < 1.0:
        x = a / s if s != 0.0 else 0.5
    c1 = 6 * u.third
    c0 = 2 * u.second - c1 / servo.kp
    f = Signal(c0, c1, 0.0, 0.0, z - c0, dz - c1)
    time = t * min(max(x, 0.0), 1.0)
    value, slope = _sample(servo, f, time)
    curvature = -servo.kv * (slope - c1) - servo.kp * servo.kv * (value - c0 - c1 * time)
    return value - slope * slope / (2 * curvature) if curvature != 0.0 else value


@compiled(inner=True, fastmath=FUSED)
def _respond_first_order(servo: Servo, step: FreeMotionMap, u: Cubic, m: Motion) -> Motion:
    """Simulate a first-order joint over a step; the demand is the joint's acceleration."""
    kp, t = servo.kp, step.time
    q, _ = advance_freely(step, u, m.q, 0.0)
    end = shift(u, t)
    w = kp * (end.value - q)
    z, last = kp * (u.rate - kp * (u.value - m.q)), kp * (end.rate - w)
    lowest, highest = min(m.lowest, z, last), max(m.highest, z, last)
    # The acceleration is line + rate t + (z - line) exp(-kp t).
    rate = 6 * u.third
    line = 2 * u.second - rate / kp
    if (z - line) * rate > 0.0:
        turn = math.log(kp * (z - line) / rate) / kp
        if 0.0 < turn < t:
            peak = line + rate * turn + rate / kp
            lowest, highest = min(lowest, peak), max(highest, peak)
    return Motion(q, w, 0.0, 0.0, lowest, highest)


@compiled(inner=True, fastmath=FUSED, inline="always")
def respond(servo: Servo, step: FreeMotionMap, u: Cubic, m: Motion) -> Motion:
    """Simulate a joint over a step under command u; not finite if there are too many phases."""
    kp, kv, t = servo.kp, servo.kv, step.time
    if kv == 0.0:
        return _respond_first_order(servo, step, u, m)
    z = demand(servo, u, m.q, m.w)
    if not servo.lower <= z <= servo.upper:
        return _respond_by_events(servo, step, u, m)
    q, w = advance_freely(step, u, m.q, m.w)
    end = shift(u, t)
    last = demand(servo, end, q, w)
    dz, dlast = kv * (kp * (u.rate - m.w) - z), kv * (kp * (end.rate - w) - last)
    low, high = min(m.lowest, z, last), max(m.highest, z, last)
    bottom, top = _bound_demand(servo, u, z, dz, last, dlast, t)
    # Most steps return here, without saturation and without a new extreme of the demand.
    if max(servo.lower, low) <= bottom and top <= min(servo.upper, high):
        return Motion(q, w, 0.0, m.saturated, low, high)
    if dz * dlast < 0.0:
        peak = _demand_extremum(servo, u, z, dz, last, dlast, t)
        low, high = min(low, peak), max(high, peak)
        if servo.lower <= min(last, peak) and max(last, peak) <= servo.upper:
            return Motion(q, w, 0.0, m.saturated, low, high)
    return _respond_by_events(servo, step, u, m)
