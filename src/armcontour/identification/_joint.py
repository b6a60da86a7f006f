"""The compiled part: one joint, simulated exactly, with its derivatives by every parameter.

A state is an array (2, 7): position and velocity, and in column 1 to 6 their derivatives by
`kp, kv, delay, q0, dq0, limit`. The transition over any span in which the command is a straight
line is closed form, and so are its derivatives; spans end at samples, at set-points as the joint
sees them (`t + delay`), and where saturation starts or ends. There the acceleration is continuous,
so the derivatives are too; only where the command jumps does the derivative by the delay jump.
"""

from __future__ import annotations

import math

import numpy as np

from armcontour._checks import FloatArray
from armcontour._kernels import compiled

COLUMNS = 7
KP, KV, DELAY, Q0, DQ0, LIMIT = range(1, COLUMNS)
# Steps near saturation are at most this many of the shortest time constants, so that the
# acceleration has at most one extremum in a step.
LARGEST_STEP = 0.25
# More steps than this in one span come to no end: they round to nothing, or are not numbers.
MOST_STEPS = 100_000
# Spans that differ by less [s] share a transition: rounding of time stamps, no more.
SAME_SPAN = 1e-12
# A limit that is never reached: with it the demands are looked at, and nothing else changes.
UNREACHED = 1e300
# A demand that passes the limit by less than this part of it touches it only.
TOUCH = 1e-12
# Below this the hyperbolic functions are summed as series; seven terms are exact to 1e-15.
SERIES = 0.1


@compiled()
def _modes(d: float, decay: float, t: float) -> tuple[float, float, float]:
    """`C = e cosh(w t)`, `S = e sinh(w t) / w` and `dS/dd`; `w² = d`, `e = exp(decay t)`."""
    x = d * t * t
    if abs(x) < SERIES:
        e = math.exp(decay * t)
        c = 1 + x / 2 * (1 + x / 12 * (1 + x / 30 * (1 + x / 56 * (1 + x / 90 * (1 + x / 132)))))
        s = 1 + x / 6 * (1 + x / 20 * (1 + x / 42 * (1 + x / 72 * (1 + x / 110 * (1 + x / 156)))))
        ds = 1 / 6 + x * (1 / 60 + x * (1 / 1680 + x * (1 / 90720 + x / 7983360)))
        return e * c, e * t * s, e * t * t * t * ds
    if x > 0.0:
        w = math.sqrt(d)
        up = math.exp((decay + w) * t)
        down = math.exp((decay - w) * t)
        c = (up + down) / 2
        s = (up - down) / (2 * w)
    else:
        e = math.exp(decay * t)
        w = math.sqrt(-d)
        c = e * math.cos(w * t)
        s = e * math.sin(w * t) / w
    return c, s, (t * c - s) / (2 * d)


@compiled()
def _transition(kp: float, kv: float, t: float, out: FloatArray) -> None:
    """Fill (3, 4): the transition matrix by rows, its derivative by kp, and by kv."""
    c, s, sd = _modes(kv * kv / 4 - kp * kv, -kv / 2, t)
    out[0, 0] = c + kv / 2 * s
    out[0, 1] = s
    out[0, 2] = -kp * kv * s
    out[0, 3] = c - kv / 2 * s
    cp, sp = -kv * t * s / 2, -kv * sd
    out[1, 0] = cp + kv / 2 * sp
    out[1, 1] = sp
    out[1, 2] = -kv * s - kp * kv * sp
    out[1, 3] = cp - kv / 2 * sp
    dd = kv / 2 - kp
    cv, sv = -t * c / 2 + t * s / 2 * dd, -t * s / 2 + sd * dd
    out[2, 0] = cv + s / 2 + kv / 2 * sv
    out[2, 1] = sv
    out[2, 2] = -kp * s - kp * kv * sv
    out[2, 3] = cv - s / 2 - kv / 2 * sv


@compiled()
def _free(
    x: FloatArray,
    columns: int,
    f: FloatArray,
    kp: float,
    v: float,
    r: float,
    t: float,
) -> None:
    """Advance the state by `t` under the command `v + r t`, far from saturation."""
    e = x[0, 0] - v + r / kp
    w = x[1, 0] - r
    for j in range(1, columns):
        # By the delay, the command itself changes by -r.
        a = x[0, j] + (r if j == DELAY else 0.0)
        b = x[1, j]
        x[0, j] = f[0, 0] * a + f[0, 1] * b
        x[1, j] = f[0, 2] * a + f[0, 3] * b
    x[0, 0] = v + r * t - r / kp + f[0, 0] * e + f[0, 1] * w
    x[1, 0] = r + f[0, 2] * e + f[0, 3] * w
    if columns > 1:
        g = r / (kp * kp)
        x[0, KP] += g - f[0, 0] * g + f[1, 0] * e + f[1, 1] * w
        x[1, KP] += -f[0, 2] * g + f[1, 2] * e + f[1, 3] * w
        x[0, KV] += f[2, 0] * e + f[2, 1] * w
        x[1, KV] += f[2, 2] * e + f[2, 3] * w
        x[0, DELAY] -= r


@compiled()
def _extremum(kp: float, kv: float, z: float, dz: float) -> float:
    """First time above 0 at which the free demand z has a zero slope; infinity if never."""
    slope = -kv * dz / 2 - kp * kv * z
    if slope == 0.0:
        return math.inf
    a = -dz / slope  # tanh(w t) / w
    d = kv * kv / 4 - kp * kv
    if d > 0.0:
        w = math.sqrt(d)
        return math.atanh(w * a) / w if 0.0 < w * a < 1.0 else math.inf
    if d == 0.0:
        return a if a > 0.0 else math.inf
    w = math.sqrt(-d)
    t = math.atan(w * a) / w
    return t if t > 0.0 else t + math.pi / w


@compiled()
def _at(kp: float, kv: float, z: float, dz: float, t: float) -> float:
    """The free demand after `t`."""
    c, s, _ = _modes(kv * kv / 4 - kp * kv, -kv / 2, t)
    return (c + kv / 2 * s) * z + s * dz


@compiled()
def _crossing(
    kp: float, kv: float, z: float, dz: float, limit: float, low: float, high: float
) -> float:
    """Time in [low, high] at which the free demand rises through `limit`."""
    for _ in range(60):
        middle = 0.5 * (low + high)
        if middle <= low or middle >= high or high - low < 1e-15:
            break
        if _at(kp, kv, z, dz, middle) < limit:
            low = middle
        else:
            high = middle
    return high


@compiled()
def _entry(kp: float, kv: float, z: float, dz: float, limit: float, t: float) -> float:
    """When within `t` the free demand leaves the limits; infinity if it does not."""
    if abs(z) + t * abs(dz) <= limit:
        return math.inf
    previous = 0.0
    for stop in (min(_extremum(kp, kv, z, dz), t), t):
        value = _at(kp, kv, z, dz, stop)
        if abs(value) > limit * (1 + TOUCH):
            sign = math.copysign(1.0, value)
            return _crossing(kp, kv, sign * z, sign * dz, limit, previous, stop)
        previous = stop
    return math.inf


@compiled()
def _saturated(x: FloatArray, columns: int, acceleration: float, t: float) -> None:
    """Advance the state by `t` at a constant acceleration, which is one limit or the other."""
    x[0, 0] += t * (x[1, 0] + acceleration * t / 2)
    x[1, 0] += acceleration * t
    if columns > 1:
        for j in range(1, columns):
            x[0, j] += t * x[1, j]
        sign = math.copysign(1.0, acceleration)
        x[0, LIMIT] += sign * t * t / 2
        x[1, LIMIT] += sign * t


@compiled()
def _limited(
    x: FloatArray,
    columns: int,
    f: FloatArray,
    kp: float,
    kv: float,
    limit: float,
    v: float,
    r: float,
    span: float,
    seen: FloatArray,
) -> None:
    """Advance the state by `span` under the command `v + r t`, the acceleration limited.

    `seen` collects the largest demand [rad/s²] and the time in saturation [s]. The position is NaN
    where the motion comes to no end in MOST_STEPS.
    """
    now = 0.0
    longest = LARGEST_STEP / (kv if kv >= 4 * kp else math.sqrt(kp * kv))
    bend = kv * kp * limit / 2
    mode = 0.0
    count = 0
    while now < span:
        count += 1
        if count > MOST_STEPS:
            x[0, 0] = math.nan
            return
        left = span - now
        command = v + r * now
        z = kv * (kp * (command - x[0, 0]) - x[1, 0])
        seen[0] = max(seen[0], abs(z))
        if mode == 0.0 and abs(z) > limit:
            mode = math.copysign(1.0, z)
        if mode != 0.0:
            # Over the limit by excess + z1 t - bend t², until that is 0 again.
            excess = max(mode * z - limit, 0.0)
            z1 = kv * (kp * mode * (r - x[1, 0]) - limit)
            t = max((z1 + math.sqrt(z1 * z1 + 4.0 * bend * excess)) / (2.0 * bend), 0.0)
            ends = t < left
            t = min(t, left)
            if 0.0 < z1 < 2.0 * bend * t:
                seen[0] = max(seen[0], limit + excess + z1 * z1 / (4.0 * bend))
            _saturated(x, columns, mode * limit, t)
            seen[1] += t
            now = now + t if ends else span
            if not ends:
                break
            # It leaves with the demand falling: rounding must not hold it at the limit.
            left = span - now
            command = v + r * now
            z = mode * limit
            mode = 0.0
        if left <= 0.0:
            break
        t = min(left, longest)
        dz = kv * (kp * (r - x[1, 0]) - z)
        entry = _entry(kp, kv, z, dz, limit, t)
        if entry < math.inf:
            t = entry
            mode = math.copysign(1.0, _at(kp, kv, z, dz, t))
        _transition(kp, kv, t, f)
        _free(x, columns, f, kp, command, r, t)
        now = now + t if t < left else span
    z = kv * (kp * (v + r * span - x[0, 0]) - x[1, 0])
    seen[0] = max(seen[0], abs(z))


@compiled()
def _clipped(value: float, limit: float) -> float:
    return min(max(value, -limit), limit)


@compiled()
def second_order(
    t: FloatArray,
    u: FloatArray,
    linear: bool,
    first: int,
    last: int,
    rest: bool,
    kp: float,
    kv: float,
    delay: float,
    limit: float,
    q0: float,
    dq0: float,
    columns: int,
) -> tuple[FloatArray, FloatArray]:
    """Positions at the samples, and their derivatives.

    Args:
        t: Sample times [s], at which the set-points are given too, (n,).
        u: Set-points [rad], (n,).
        linear: Interpolate between set-points; else hold the earlier one.
        first: The sample at which the state is q0, dq0, unless `rest`.
        last: The sample behind the last one.
        rest: The joint stays at q0 until the first set-point reaches it, at t[0] + delay. Otherwise
            the first set-point holds before.
        kp: Position loop gain [1/s].
        kv: Velocity loop gain [1/s].
        delay: Dead time [s].
        limit: Acceleration limit [rad/s²], or infinity.
        q0: Position at the first sample [rad].
        dq0: Velocity there [rad/s].
        columns: 1, or 7 with derivatives.

    Returns:
        Positions and derivatives, (columns, last - first); largest demand and time in saturation.
    """
    n = len(t)
    out = np.zeros((columns, last - first))
    x = np.zeros((2, columns))
    x[0, 0], x[1, 0] = q0, 0.0 if rest else dq0
    if columns > 1:
        x[0, Q0] = 1.0
        x[1, DQ0] = 0.0 if rest else 1.0
    seen = np.zeros(2)
    spans = np.full(3, -1.0)
    kept = np.zeros((3, 3, 4))
    scratch = np.zeros((3, 4))
    oldest = 0
    now = t[0] + delay if rest else t[first]
    k = -1
    while k + 1 < n and t[k + 1] + delay <= now and not rest:
        k += 1
    old = q0 if rest else u[0]
    for i in range(first, last):
        while now < t[i] or (k + 1 < n and t[k + 1] + delay <= now):
            if k + 1 < n and t[k + 1] + delay <= now:
                k += 1
                before = old if k == 0 else (u[k] if linear else u[k - 1])
                if before != u[k]:
                    z = kv * (kp * (before - x[0, 0]) - x[1, 0])
                    jump = kv * kp * (u[k] - before)
                    if columns > 1:
                        x[1, DELAY] += _clipped(z, limit) - _clipped(z + jump, limit)
                continue
            end = t[i]
            if k + 1 < n:
                end = min(end, t[k + 1] + delay)
            span = end - now
            r = 0.0
            v = u[max(k, 0)]
            if linear and 0 <= k < n - 1:
                r = (u[k + 1] - u[k]) / (t[k + 1] - t[k])
                v += r * (now - delay - t[k])
            if limit < math.inf:
                longest = LARGEST_STEP / (kv if kv >= 4 * kp else math.sqrt(kp * kv))
                z = kv * (kp * (v - x[0, 0]) - x[1, 0])
                dz = kv * (kp * (r - x[1, 0]) - z)
                # A free demand stays below |z| + t |dz|. For its peak alone, look closely.
                if (limit == UNREACHED and span > longest) or abs(z) + span * abs(dz) > limit:
                    _limited(x, columns, scratch, kp, kv, limit, v, r, span, seen)
                    now = end
                    continue
                seen[0] = max(seen[0], abs(z))
            slot = -1
            for m in range(3):
                if abs(spans[m] - span) <= SAME_SPAN:
                    slot = m
            if slot < 0:
                slot, oldest = oldest, (oldest + 1) % 3
                spans[slot] = span
                _transition(kp, kv, span, kept[slot])
            _free(x, columns, kept[slot], kp, v, r, span)
            now = end
        for j in range(columns):
            out[j, i - first] = x[0, j]
    return out, seen


@compiled()
def first_order(
    t: FloatArray,
    u: FloatArray,
    linear: bool,
    first: int,
    last: int,
    rest: bool,
    kp: float,
    delay: float,
    q0: float,
    columns: int,
) -> FloatArray:
    """As `second_order`, for `dq = kp (u - q)`; the columns kv, dq0 and limit stay zero."""
    n = len(t)
    out = np.zeros((columns, last - first))
    x = np.zeros(COLUMNS)
    x[0] = q0
    x[Q0] = 1.0
    now = t[0] + delay if rest else t[first]
    k = -1
    while k + 1 < n and t[k + 1] + delay <= now and not rest:
        k += 1
    old = q0 if rest else u[0]
    for i in range(first, last):
        while now < t[i] or (k + 1 < n and t[k + 1] + delay <= now):
            if k + 1 < n and t[k + 1] + delay <= now:
                k += 1
                before = old if k == 0 else (u[k] if linear else u[k - 1])
                x[DELAY] -= kp * (u[k] - before)
                continue
            end = t[i]
            if k + 1 < n:
                end = min(end, t[k + 1] + delay)
            span = end - now
            r = 0.0
            v = u[max(k, 0)]
            if linear and 0 <= k < n - 1:
                r = (u[k + 1] - u[k]) / (t[k + 1] - t[k])
                v += r * (now - delay - t[k])
            f = math.exp(-kp * span)
            e = x[0] - v + r / kp
            x[KP] = f * x[KP] + r / (kp * kp) * (1 - f) - span * f * e
            x[DELAY] = f * (x[DELAY] + r) - r
            x[Q0] *= f
            x[0] = v + r * span - r / kp + f * e
            now = end
        for j in range(columns):
            out[j, i - first] = x[j]
    return out


@compiled()
def scan(
    t: FloatArray,
    u: FloatArray,
    y: FloatArray,
    linear: bool,
    first: int,
    last: int,
    rest: bool,
    trials: FloatArray,
    q0: float,
    dq0: float,
) -> FloatArray:
    """Sums of squared errors of trial parameters.

    Args:
        t: As in `second_order`, like all that is not told here.
        u: Set-points.
        y: Measured positions [rad], (n,).
        linear: Whether to interpolate.
        first: First sample.
        last: The one behind the last.
        rest: Whether it begins at rest.
        trials: kp, kv, delay and limit, (m, 4); an infinite kv is the first-order model.
        q0: Position at the first sample.
        dq0: Velocity there.

    Returns:
        Sums [rad²], (m,).
    """
    sums = np.empty(len(trials))
    for m in range(len(trials)):
        kp, kv, delay, limit = trials[m]
        if kv < math.inf:
            q = second_order(t, u, linear, first, last, rest, kp, kv, delay, limit, q0, dq0, 1)[0]
        else:
            q = first_order(t, u, linear, first, last, rest, kp, delay, q0, 1)
        total = 0.0
        for i in range(first, last):
            e = y[i] - q[0, i - first]
            total += e * e
        sums[m] = total
    return sums


@compiled()
def normal_equations(
    jacobian: FloatArray, residuals: FloatArray
) -> tuple[FloatArray, FloatArray, float]:
    """`J Jᵀ`, `J e` and `e e` of a wide J; threads of a library would only wait for each other.

    Args:
        jacobian: (free, n).
        residuals: (n,).
    """
    m, n = jacobian.shape
    normal = np.zeros((m, m))
    slope = np.zeros(m)
    for a in range(m):
        for b in range(a + 1):
            total = 0.0
            for i in range(n):
                total += jacobian[a, i] * jacobian[b, i]
            normal[a, b] = total
            normal[b, a] = total
        total = 0.0
        for i in range(n):
            total += jacobian[a, i] * residuals[i]
        slope[a] = total
    square = 0.0
    for i in range(n):
        square += residuals[i] * residuals[i]
    return normal, slope, square
