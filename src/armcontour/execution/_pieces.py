"""The compiled part of the servo plant for commands that come late, bend, or meet changing limits.

Like `_servo.py` it is exact from event to event.
"""

from __future__ import annotations

import math

import numpy as np

from armcontour._checks import BoolArray, FloatArray, IntArray
from armcontour._kernels import compiled
from armcontour.execution._servo import (
    LARGEST_STEP,
    MOST_STEPS,
    SHORTEST_STAY,
    _extremum,
    _free,
    advance_joint,
)

# Terms of a Taylor series over such a step, down to rounding.
TERMS = 16


@compiled()
def _cubic(c: FloatArray, t: float) -> float:
    value: float = c[0] + t * (c[1] + t * (c[2] + t * c[3]))
    return value


@compiled()
def _bends(c: FloatArray, end: float) -> tuple[float, float]:
    """Places in (0, end) where a cubic has a zero slope, in order; `end` for each there is not."""
    a, b, d = 3 * c[3], c[2], c[1]  # slope = a t² + 2 b t + d
    root = b * b - a * d
    if root < 0.0:
        return end, end
    # Without cancellation; one of the two is at infinity if the cubic is none.
    s = -(b + math.copysign(math.sqrt(root), b))
    one = s / a if a != 0.0 else end
    two = d / s if s != 0.0 else end
    if not 0.0 < one < end:
        one = end
    if not 0.0 < two < end:
        two = end
    return min(one, two), max(one, two)


@compiled()
def _stay(c: FloatArray, end: float) -> float:
    """First time in [0, end] behind which a cubic, not below zero at 0, falls below; else `end`."""
    low = 0.0
    first, second = _bends(c, end)
    for high in (first, second, end):
        if high > low and _cubic(c, high) < 0.0:
            for _ in range(200):
                middle = 0.5 * (low + high)
                if middle <= low or middle >= high:
                    break
                if _cubic(c, middle) < 0.0:
                    high = middle
                else:
                    low = middle
            return high
        low = high
    return end


@compiled()
def _excess(
    kp: float, kv: float, mode: float, bound: float, u: FloatArray, q: float, w: float
) -> FloatArray:
    """By what the demand exceeds `bound`, on the side `mode`, while the joint accelerates by it."""
    c = np.empty(4)
    c[0] = max(mode * (kv * (kp * (u[0] - q) - w) - bound), 0.0)
    c[1] = mode * kv * (kp * (u[1] - w) - bound)
    c[2] = mode * kv * kp * (u[2] - bound / 2)
    c[3] = mode * kv * kp * u[3]
    return c


@compiled()
def _moved(
    kp: float, kv: float, u: FloatArray, q: float, w: float, t: float
) -> tuple[float, float]:
    """Position and velocity after a linear motion of a short `t` under the cubic command u.

    By the Taylor series of the motion: its closed form takes differences of terms in `u''' / K_p³`,
    which are large where set-points follow each other closely.
    """
    if t == 0.0:
        return q, w
    this, following = q, w * t
    power = 1.0
    x, v = q + following, following
    for n in range(TERMS):
        source = u[n] * power if n < 4 else 0.0
        power *= t
        pull = kp * kv * t * t / (n + 1) * (source - this)
        this, following = following, (pull - kv * t * following) / (n + 2)
        x += following
        v += (n + 2) * following
    return x, v / t


@compiled()
def _demand(
    kp: float, kv: float, alpha: float, beta: float, h: float, dh: float, t: float
) -> float:
    return alpha + beta * t + _free(kp, kv, h, dh, t)


@compiled()
def _turns(kp: float, kv: float, beta: float, h: float, dh: float, end: float) -> FloatArray:
    """Times in [0, end] between which `beta t + h(t)`, h a free response, is monotone, and `end`.

    The slope of h is a free response too, with at most one extremum in a short step: on either
    side of it the slope is monotone, and has at most one zero.
    """
    ddh = -kv * dh - kp * kv * h
    middle = min(_extremum(kp, kv, dh, ddh), end)
    found = np.full(3, end)
    count = 0
    low = 0.0
    for stop in (middle, end):
        high = stop
        rising = beta + _free(kp, kv, dh, ddh, low) > 0.0
        if high > low and (beta + _free(kp, kv, dh, ddh, high) > 0.0) != rising:
            for _ in range(200):
                at = 0.5 * (low + high)
                if at <= low or at >= high:
                    break
                if (beta + _free(kp, kv, dh, ddh, at) > 0.0) == rising:
                    low = at
                else:
                    high = at
            found[count] = high
            count += 1
        low = stop
    return found


@compiled()
def _shifted(a: FloatArray, t: float) -> FloatArray:
    """A cubic in powers of the time behind t."""
    u = np.empty(4)
    u[0] = _cubic(a, t)
    u[1] = a[1] + t * (2 * a[2] + t * 3 * a[3])
    u[2] = a[2] + 3 * a[3] * t
    u[3] = a[3]
    return u


@compiled()
def _entry(
    kp: float,
    kv: float,
    lower: float,
    upper: float,
    u: FloatArray,
    q: float,
    w: float,
    t: float,
    span: float,
) -> tuple[float, float, float, float]:
    """The linear motion for at most `t`, up to where saturation starts.

    Returns:
        Time until then, which bound saturates (1 for the upper, -1 for the lower one, 0 for none),
        lowest and highest demand.
    """
    beta = 6 * u[3]
    alpha = 2 * u[2] - beta / kp
    z = kv * (kp * (u[0] - q) - w)
    h, dh = z - alpha, kv * (kp * (u[1] - w) - z) - beta
    lowest = highest = z
    low = 0.0
    for stop in _turns(kp, kv, beta, h, dh, t):
        value = _demand(kp, kv, alpha, beta, h, dh, stop)
        if stop > low and not lower <= value <= upper:
            # Both bounds may lie on one side of 0: what counts is which one is passed.
            sign = 1.0 if value > upper else -1.0
            bound = upper if sign > 0.0 else lower
            high = stop
            for _ in range(200):
                middle = 0.5 * (low + high)
                if middle <= low or middle >= high:
                    break
                if sign * (_demand(kp, kv, alpha, beta, h, dh, middle) - bound) < 0.0:
                    low = middle
                else:
                    high = middle
            x, v = _moved(kp, kv, u, q, w, high)
            ahead = _excess(kp, kv, sign, bound, _shifted(u, high), x, v)
            # Saturation shorter than this is a touch of the limit, not a stay.
            if _stay(ahead, span) > SHORTEST_STAY * span:
                return high, sign, min(lowest, bound), max(highest, bound)
        lowest, highest = min(lowest, value), max(highest, value)
        low = stop
    return t, 0.0, lowest, highest


@compiled()
def advance_under_cubic(
    kp: float,
    kv: float,
    lower: float,
    upper: float,
    command: FloatArray,
    q: float,
    w: float,
    span: float,
) -> tuple[float, float, float, float, float]:
    """As `advance_joint`, but under a command that is a cubic in time.

    The two accelerations may have the same sign.
    """
    now = 0.0
    saturated = 0.0
    lowest = highest = kv * (kp * (command[0] - q) - w)
    mode = 0.0
    count = 0
    fast = kv if kv >= 4 * kp else math.sqrt(kp * kv)
    while now < span:
        count += 1
        if count > MOST_STEPS:
            return math.nan, math.nan, math.nan, lowest, highest
        left = span - now
        u = _shifted(command, now)
        z = kv * (kp * (u[0] - q) - w)
        if mode == 0.0 and not lower <= z <= upper:
            sign = 1.0 if z > upper else -1.0
            over = _excess(kp, kv, sign, upper if sign > 0.0 else lower, u, q, w)
            if _stay(over, left) > SHORTEST_STAY * span:
                mode = sign
        if mode == 0.0:
            longest = min(left, LARGEST_STEP / fast)
            t, mode, low, high = _entry(kp, kv, lower, upper, u, q, w, longest, span)
            lowest, highest = min(lowest, low), max(highest, high)
            q, w = _moved(kp, kv, u, q, w, t)
            now = now + t if t < left else span
            continue
        bound = upper if mode > 0.0 else lower
        over = _excess(kp, kv, mode, bound, u, q, w)
        t = _stay(over, left)
        first, second = _bends(over, t)
        for at in (0.0, first, second, t):
            z = bound + mode * _cubic(over, at)
            lowest, highest = min(lowest, z), max(highest, z)
        q += t * (w + bound * t / 2)
        w += bound * t
        saturated += t
        mode = 0.0
        now = now + t if t < left else span
    return q, w, saturated, lowest, highest


@compiled()
def _lagged(kp: float, u: FloatArray, q: float, t: float) -> float:
    """Position of a joint of first order after a short `t`, by its Taylor series."""
    this = q
    power = 1.0
    x = q
    for n in range(TERMS):
        source = u[n] * power if n < 4 else 0.0
        power *= t
        this = kp * t / (n + 1) * (source - this)
        x += this
    return x


@compiled()
def advance_first_order(
    kp: float, u: FloatArray, q: float, span: float
) -> tuple[float, float, float]:
    """Run a joint of first order for `span` under a cubic command; its acceleration's range."""
    a = 1 / kp
    d1, d2, d3 = u[1], 2 * u[2], 6 * u[3]
    # Its acceleration is alpha + beta t + rest exp(-kp t).
    beta = d3
    alpha = d2 - a * d3
    e = q - (u[0] - a * d1 + a * a * d2 - a**3 * d3)
    rest = kp * kp * e
    begin, end = alpha + rest, alpha + beta * span + rest * math.exp(-kp * span)
    lowest, highest = min(begin, end), max(begin, end)
    if rest * beta > 0.0:
        turn = math.log(kp * rest / beta) / kp
        if 0.0 < turn < span:
            most = alpha + beta * turn + beta / kp
            lowest, highest = min(lowest, most), max(highest, most)
    if not kp * span <= LARGEST_STEP * MOST_STEPS:
        return math.nan, lowest, highest
    steps = int(math.ceil(kp * span / LARGEST_STEP))
    t = span / steps
    for i in range(steps):
        q = _lagged(kp, _shifted(u, i * t), q, t)
    return q, lowest, highest


@compiled()
def _advance_any(
    kp: float,
    kv: float,
    lower: float,
    upper: float,
    u: FloatArray,
    q: float,
    w: float,
    span: float,
) -> tuple[float, float, float, float, float]:
    """As `advance_under_cubic`, by what is fastest; a servo of first order, too, whose kv is 0."""
    if kv == 0.0:
        q, low, high = advance_first_order(kp, u, q, span)
        return q, kp * (_cubic(u, span) - q), 0.0, low, high
    if u[2] == 0.0 and u[3] == 0.0 and lower < 0.0 < upper:
        return advance_joint(kp, kv, lower, upper, u[0], u[1], q, w, span)
    return advance_under_cubic(kp, kv, lower, upper, u, q, w, span)


@compiled()
def run_joint(
    command: FloatArray,
    begin: int,
    count: int,
    width: FloatArray,
    source: IntArray,
    local: FloatArray,
    result: BoolArray,
    kp: float,
    kv: float,
    lower: float,
    upper: float,
    q: float,
    w: float,
) -> tuple[FloatArray, float, float, float]:
    """Run one joint through command intervals.

    Args:
        command: `servo.command.polynomials` of this joint, (n + 1, 4).
        begin: First interval, from 0 at the first set-point.
        count: Number of intervals.
        width: `dead_time.Pattern` of this joint, as are the next three.
        source: Which interval's command.
        local: At what time in it.
        result: Where results are due.
        kp: Position loop gain [1/s].
        kv: Velocity loop gain [1/s]; 0 for a servo of first order, which does not saturate.
        lower: Acceleration bound [rad/s²].
        upper: Acceleration bound [rad/s²].
        q: Position at the beginning [rad].
        w: Velocity there [rad/s].

    Returns:
        q, dq, demand and ddq at the results, (number, 4); time in saturation [s]; lowest and
        highest demand. Where the motion comes to no end, q is NaN and nothing follows.
    """
    states = np.zeros((count * int(result.sum()), 4))
    saturated = lowest = highest = 0.0
    row = 0
    last = len(command) - 1
    for k in range(begin, begin + count):
        for i in range(len(width)):
            which = min(max(k + source[i] + 1, 0), last)
            # Constant before the first set-point and behind the last, whatever the time there.
            u = _shifted(command[which], local[i] if 0 < which < last else 0.0)
            span = width[i]
            q, w, time, low, high = _advance_any(kp, kv, lower, upper, u, q, w, span)
            if math.isnan(q):
                # This part may end without a result, which is due behind a later one.
                states[row, 0] = math.nan
                return states, saturated, lowest, highest
            saturated += time
            lowest, highest = min(lowest, low), max(highest, high)
            if result[i]:
                end = _shifted(u, span)
                z = kp * (end[1] - w) if kv == 0.0 else kv * (kp * (end[0] - q) - w)
                states[row, 0], states[row, 1], states[row, 2] = q, w, z
                states[row, 3] = min(max(z, lower), upper)
                row += 1
    return states, saturated, lowest, highest
