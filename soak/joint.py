"""A joint that shares nothing with the estimator: Runge and Kutta's steps, far below a sample."""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True)
def _command(t, u, linear, before, lead, at):
    if at < t[0]:
        return before
    if at >= t[-1]:
        last = 0.0 if linear else lead * (u[-1] - u[-2]) / (t[-1] - t[-2])
        return u[-1] + last
    k = np.searchsorted(t, at, side="right") - 1
    if not linear:
        return u[k] + (lead * (u[k] - u[k - 1]) / (t[k] - t[k - 1]) if k > 0 else 0.0)
    return u[k] + (u[k + 1] - u[k]) * (lead + at - t[k]) / (t[k + 1] - t[k])


@njit(cache=True)
def _run(t, u, linear, before, kp, kv, delay, limit, q0, dq0, steps, friction, feed):
    out = np.empty(len(t))
    out[0] = q = q0
    w = dq0
    for i in range(len(t) - 1):
        h = (t[i + 1] - t[i]) / steps
        for m in range(steps):
            now = t[i] + m * h
            # Right of the start, left of the end: a set-point that arrives there acts there.
            a = _command(t, u, linear, before, feed / kp, now + 1e-12 - delay)
            b = _command(t, u, linear, before, feed / kp, now + h / 2 - delay)
            c = _command(t, u, linear, before, feed / kp, now + h - 1e-12 - delay)
            k1 = min(max(kv * (kp * (a - q) - w), -limit), limit)
            q2, w2 = q + h / 2 * w, w + h / 2 * k1
            k2 = min(max(kv * (kp * (b - q2) - w2), -limit), limit)
            q3, w3 = q + h / 2 * w2, w + h / 2 * k2
            k3 = min(max(kv * (kp * (b - q3) - w3), -limit), limit)
            q4, w4 = q + h * w3, w + h * k3
            k4 = min(max(kv * (kp * (c - q4) - w4), -limit), limit)
            q += h / 6 * (w + 2 * w2 + 2 * w3 + w4)
            w += h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
            # Dry friction takes up to this much of the velocity in a step, and stops it at most.
            w = math.copysign(max(abs(w) - h * friction, 0.0), w)
        out[i + 1] = q
    return out


def move(
    t,
    u,
    *,
    kp,
    kv,
    delay=0.0,
    limit=math.inf,
    linear=True,
    before=None,
    q0=None,
    dq0=0.0,
    steps=10,
    friction=0.0,
    feed=0.0,
):
    """Positions at t [rad] of a joint under the set-points u; `before` holds before the first.

    Dry friction brakes with a constant acceleration [rad/s²]; steps are to be fine with it.
    Velocity feed-forward `feed` adds to the command, over kp, the rate of lines, or that up to held
    ones.
    """
    before = u[0] if before is None else before
    q0 = before if q0 is None else q0
    return _run(t, u, linear, before, kp, kv, delay, limit, q0, dq0, steps, friction, feed)
