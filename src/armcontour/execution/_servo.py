"""The compiled part of the servo plant: exact from event to event."""

from __future__ import annotations

import math

import numpy as np

from armcontour._checks import FloatArray
from armcontour._kernels import compiled

# Steps are at most this many of the servo's shortest time constants, so that the acceleration has
# at most one extremum in a step.
LARGEST_STEP = 0.5
# Saturation that would last less than this part of a step is not entered.
SHORTEST_STAY = 1e-9
# More steps than this in one span come to no end: they round to nothing, or are not numbers.
MOST_STEPS = 100_000


@compiled()
def _modes(discriminant: float, decay: float, t: float) -> tuple[float, float]:
    """`exp(decay t) cosh(w t)` and `exp(decay t) sinh(w t) / w`, `w² = discriminant`."""
    x = discriminant * t * t
    if x > 1e-6:
        w = math.sqrt(discriminant)
        up = math.exp((decay + w) * t)
        down = math.exp((decay - w) * t)
        return (up + down) / 2, (up - down) / (2 * w)
    e = math.exp(decay * t)
    if x < -1e-6:
        w = math.sqrt(-discriminant)
        return e * math.cos(w * t), e * math.sin(w * t) / w
    return e * (1 + x / 2 + x * x / 24), e * t * (1 + x / 6 + x * x / 120)


@compiled()
def _free(kp: float, kv: float, y: float, dy: float, t: float) -> float:
    """`y(t)` of `y'' + kv y' + kp kv y = 0`."""
    c, s = _modes(kv * kv / 4 - kp * kv, -kv / 2, t)
    return y * c + (dy + kv / 2 * y) * s


@compiled()
def _extremum(kp: float, kv: float, z: float, dz: float) -> float:
    """First time above 0 at which the free response z has a zero slope; infinity if never."""
    ddz = -kv * dz - kp * kv * z
    slope = ddz + kv / 2 * dz
    if slope == 0.0:
        return math.inf
    a = -dz / slope  # tanh(w t) / w
    discriminant = kv * kv / 4 - kp * kv
    if discriminant > 0.0:
        w = math.sqrt(discriminant)
        return math.atanh(w * a) / w if 0.0 < w * a < 1.0 else math.inf
    if discriminant == 0.0:
        return a if a > 0.0 else math.inf
    w = math.sqrt(-discriminant)
    t = math.atan(w * a) / w
    return t if t > 0.0 else t + math.pi / w


@compiled()
def _crossing(
    kp: float, kv: float, z: float, dz: float, limit: float, low: float, high: float
) -> float:
    """Time in [low, high] at which the free response z reaches `limit`, by bisection."""
    below = _free(kp, kv, z, dz, low) < limit
    for _ in range(200):
        middle = 0.5 * (low + high)
        if middle <= low or middle >= high:
            break
        if (_free(kp, kv, z, dz, middle) < limit) == below:
            low = middle
        else:
            high = middle
    return high


@compiled()
def _slope(kp: float, kv: float, q: float, w: float, u: float, r: float, t: float) -> float:
    """Velocity after a linear motion of `t` under the command `u + r t`."""
    c, s = _modes(kv * kv / 4 - kp * kv, -kv / 2, t)
    return r + (w - r) * c - (kp * kv * (q - u + r / kp) + kv / 2 * (w - r)) * s


@compiled()
def advance_joint(
    kp: float,
    kv: float,
    lower: float,
    upper: float,
    u: float,
    r: float,
    q: float,
    w: float,
    span: float,
) -> tuple[float, float, float, float, float]:
    """Run one joint for `span` under the command `u + r t`, (7), between two accelerations.

    The lower one must be below 0 and the upper one above it.

    Returns:
        Position, velocity, time in saturation, lowest and highest demand. The first three are NaN
        where the motion comes to no end in MOST_STEPS.
    """
    now = 0.0
    count = 0
    saturated = 0.0
    lowest = highest = kv * (kp * (u - q) - w)
    fast = kv if kv >= 4 * kp else math.sqrt(kp * kv)
    z = kv * (kp * (u - q) - w)
    mode = 0.0 if lower <= z <= upper else math.copysign(1.0, z)
    while now < span:
        count += 1
        if count > MOST_STEPS:
            return math.nan, math.nan, math.nan, lowest, highest
        left = span - now
        command = u + r * now
        z = kv * (kp * (command - q) - w)
        lowest, highest = min(lowest, z), max(highest, z)
        if mode != 0.0:
            limit = upper if mode > 0.0 else -lower
            bend = kv * kp * limit / 2
            # Over the limit by excess + z1 t - bend t², until that is 0 again.
            excess = max(mode * z - limit, 0.0)
            z1 = kv * (kp * mode * (r - w) - limit)
            t = (z1 + math.sqrt(z1 * z1 + 4.0 * bend * excess)) / (2.0 * bend)
            ends = t < left
            t = min(t, left)
            top = z1 / (2 * bend)
            if 0.0 < top < t:
                most = mode * (limit + excess + z1 * top - bend * top * top)
                lowest, highest = min(lowest, most), max(highest, most)
            q += t * (w + mode * limit * t / 2)
            w += mode * limit * t
            saturated += t
            now = now + t if ends else span
            if ends:
                mode = 0.0
            continue
        t = min(left, LARGEST_STEP / fast)
        dz = kv * (kp * (r - w) - z)
        end = t
        previous = 0.0
        for stop in (min(_extremum(kp, kv, z, dz), t), t):
            value = _free(kp, kv, z, dz, stop)
            if not lower <= value <= upper:
                sign = math.copysign(1.0, value)
                limit = upper if sign > 0.0 else -lower
                bend = kv * kp * limit / 2
                at = _crossing(kp, kv, sign * z, sign * dz, limit, previous, stop)
                # Saturation shorter than this is a touch of the limit, not a stay.
                rise = kv * (kp * sign * (r - _slope(kp, kv, q, w, command, r, at)) - limit)
                if rise > bend * SHORTEST_STAY * span:
                    mode = sign
                    end = at
                    lowest, highest = min(lowest, sign * limit), max(highest, sign * limit)
                    break
            lowest, highest = min(lowest, value), max(highest, value)
            previous = stop
        e = q - command + r / kp
        de = w - r
        c, s = _modes(kv * kv / 4 - kp * kv, -kv / 2, end)
        q = command + r * end - r / kp + e * c + (de + kv / 2 * e) * s
        w = r + de * c - (kp * kv * e + kv / 2 * de) * s
        now = now + end if end < left else span
    return q, w, saturated, lowest, highest


@compiled()
def simulate(
    commands: FloatArray,
    period: float,
    steps: int,
    linear: bool,
    kp: FloatArray,
    kv: FloatArray,
    limit: FloatArray,
    q: FloatArray,
    dq: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Run all joints through the intervals between commands.

    Args:
        commands: Set-points, (n + 1, dof) [rad]; the last one ends the last interval.
        period: Time between them [s].
        steps: Results per interval.
        linear: Interpolate between set-points; else hold the earlier one.
        kp: Position loop gains, (dof,) [1/s].
        kv: Velocity loop gains, (dof,) [1/s].
        limit: Acceleration limits, (dof,) [rad/s²].
        q: Positions at the first command, (dof,) [rad].
        dq: Velocities there, (dof,) [rad/s].

    Returns:
        q, dq and demand at n * steps times, the first one step behind the first command,
        (n * steps, dof); time in saturation, (dof,); lowest and highest demand, (2, dof). A joint
        whose motion comes to no end has a NaN there, and the joints behind it are not run.
    """
    n = len(commands) - 1
    dof = len(kp)
    position = np.zeros((n * steps, dof))
    velocity = np.zeros((n * steps, dof))
    demand = np.zeros((n * steps, dof))
    saturated = np.zeros(dof)
    extremes = np.zeros((2, dof))
    span = period / steps
    for j in range(dof):
        x, w = q[j], dq[j]
        for k in range(n):
            u = commands[k, j]
            r = (commands[k + 1, j] - u) / period if linear else 0.0
            for i in range(steps):
                begin = u + r * span * i
                x, w, time, low, high = advance_joint(
                    kp[j], kv[j], -limit[j], limit[j], begin, r, x, w, span
                )
                if math.isnan(x):
                    position[k * steps + i, j] = math.nan
                    return position, velocity, demand, saturated, extremes
                saturated[j] += time
                extremes[0, j] = min(extremes[0, j], low)
                extremes[1, j] = max(extremes[1, j], high)
                position[k * steps + i, j] = x
                velocity[k * steps + i, j] = w
                demand[k * steps + i, j] = kv[j] * (kp[j] * (begin + r * span - x) - w)
    return position, velocity, demand, saturated, extremes
