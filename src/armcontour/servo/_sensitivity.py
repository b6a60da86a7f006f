"""Compiled response of one joint together with its derivatives with respect to the parameters.

A state is an array (2, 8): position and velocity in column 0, and their derivatives with respect to
`kp, kv, delay, q0, dq0, limit, feed` in columns 1 to 7; an array (2, 1) has no derivatives. The
command is a straight line `v + r t`; velocity feed-forward `feed` of a rate w of the set-points is
the part `feed w / kp` of v. The acceleration is continuous at the events of `_response.py`, and so
are the derivatives; only the derivative with respect to the delay jumps where the command jumps.
"""

from __future__ import annotations

import math

from armcontour._checks import FloatArray
from armcontour._kernels import compiled
from armcontour.servo._response import (
    LARGEST_STEP,
    MOST_PHASES,
    SERIES,
    Cubic,
    Servo,
    fastest_rate,
    modes,
    next_phase,
    progresses,
    transition,
)

COLUMNS = 8
KP, KV, DELAY, Q0, DQ0, LIMIT, FEED = range(1, COLUMNS)


@compiled(inner=True)
def differentiate_transition(kp: float, kv: float, t: float, out: FloatArray) -> None:
    """Factors of a free motion over time t, and their derivatives with respect to kp and kv.

    Args:
        kp: Position loop gain [1/s].
        kv: Velocity loop gain [1/s].
        t: Time [s].
        out: Output, (3, 4): factors qq, qw, wq, ww of `Step`; derivatives with respect to kp; with
            respect to kv.
    """
    d = kv * kv / 4 - kp * kv
    c, s = modes(d, -kv / 2, t)
    x = d * t * t
    # The derivative of s with respect to d.
    if abs(x) < SERIES:
        series = 1 / 6 + x * (1 / 60 + x * (1 / 1680 + x * (1 / 90720 + x / 7983360)))
        sd = math.exp(-kv / 2 * t) * t * t * t * series
    else:
        sd = (t * c - s) / (2 * d)
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


@compiled(inner=True)
def move_freely(
    x: FloatArray, f: FloatArray, kp: float, v: float, r: float, slopes: FloatArray, t: float
) -> None:
    """Advance the state by time t without saturation.

    Args:
        x: State, (2, 1), or (2, COLUMNS) with derivatives, changed in place.
        f: Factors from `differentiate_transition`, (3, 4).
        kp: Position loop gain [1/s].
        v: Command at the start [rad].
        r: Rate of the command [rad/s].
        slopes: Derivatives of the command by each parameter, (COLUMNS,).
        t: Time [s].
    """
    columns = x.shape[1]
    e = x[0, 0] - v + r / kp
    w = x[1, 0] - r
    for j in range(1, columns):
        a = x[0, j] - slopes[j]
        b = x[1, j]
        x[0, j] = f[0, 0] * a + f[0, 1] * b + slopes[j]
        x[1, j] = f[0, 2] * a + f[0, 3] * b
    x[0, 0] = v + r * t - r / kp + f[0, 0] * e + f[0, 1] * w
    x[1, 0] = r + f[0, 2] * e + f[0, 3] * w
    if columns > 1:
        g = r / (kp * kp)
        x[0, KP] += g - f[0, 0] * g + f[1, 0] * e + f[1, 1] * w
        x[1, KP] += -f[0, 2] * g + f[1, 2] * e + f[1, 3] * w
        x[0, KV] += f[2, 0] * e + f[2, 1] * w
        x[1, KV] += f[2, 2] * e + f[2, 3] * w


@compiled(inner=True)
def _move_saturated(x: FloatArray, side: float, t: float) -> None:
    """Advance the derivatives by time t in saturation at the upper (1) or lower (-1) limit."""
    for j in range(1, x.shape[1]):
        x[0, j] += t * x[1, j]
    x[0, LIMIT] += side * t * t / 2
    x[1, LIMIT] += side * t


@compiled()
def move_limited(
    x: FloatArray,
    f: FloatArray,
    servo: Servo,
    v: float,
    r: float,
    slopes: FloatArray,
    span: float,
    seen: FloatArray,
) -> None:
    """Advance the state by time `span` under an acceleration limit.

    Args:
        x: State, (2, 1) or (2, COLUMNS), changed in place; NaN if time steps make no progress.
        f: Work array, (3, 4).
        servo: Gains, and the limits of the acceleration.
        v: Command at the start [rad].
        r: Rate of the command [rad/s].
        slopes: Derivatives of the command by each parameter, (COLUMNS,).
        span: Time [s].
        seen: Largest demand [rad/s²] and time in saturation [s] so far, (2,), changed in place.
    """
    columns, kp, kv = x.shape[1], servo.kp, servo.kv
    if not progresses(kp, kv, span):
        x[:, :] = seen[0] = math.nan
        return
    step = transition(kp, kv, min(span, LARGEST_STEP / fastest_rate(kp, kv)), True)
    now = side = 0.0
    phases = 0
    while now < span:
        phases += 1
        if phases > MOST_PHASES:
            x[:, :] = seen[0] = math.nan
            return
        left, command = span - now, v + r * now
        u = Cubic(command, r, 0.0, 0.0)
        p = next_phase(servo, u, x[0, 0], x[1, 0], side, left, span, step)
        if columns > 1:
            if p.side != 0.0:
                _move_saturated(x, p.side, p.time)
            else:
                differentiate_transition(kp, kv, p.time, f)
                move_freely(x, f, kp, command, r, slopes, p.time)
        x[0, 0], x[1, 0], side = p.q, p.w, p.following
        seen[0] = max(seen[0], -p.lowest, p.highest)
        seen[1] += p.time if p.side != 0.0 else 0.0
        now = now + p.time if p.time < left else span
