"""Identify simulated joints and robots: do 95 % intervals contain the true values?

The logs come from a simulation that shares nothing with the estimator: Runge-Kutta steps far
shorter than a sample, with white noise. Another program of the same joint is also predicted.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

import armcontour as ac
from armcontour.motion import Log
from soak import Outcome

# Names that the parameters of `move` have in results.
NAMES = {
    "kp": "kp",
    "kv": "kv",
    "delay": "dead_time",
    "feed": "velocity_feedforward",
    "limit": "acceleration_limit",
}
LIMIT = 20.0  # rad/s²
# Standard deviation of the noise on measured positions of drawn logs [rad].
NOISE = 1e-5
# Time between samples, for each kind of log [s].
INTERVAL = 1e-3
# Time between samples of drawn logs [s].
SAMPLE = 2e-3


@njit(cache=True)
def _command(t, u, linear, before, lead, start):
    if start < t[0]:
        return before
    if start >= t[-1]:
        last = 0.0 if linear else lead * (u[-1] - u[-2]) / (t[-1] - t[-2])
        return u[-1] + last
    k = np.searchsorted(t, start, side="right") - 1
    if not linear:
        return u[k] + (lead * (u[k] - u[k - 1]) / (t[k] - t[k - 1]) if k > 0 else 0.0)
    return u[k] + (u[k + 1] - u[k]) * (lead + start - t[k]) / (t[k + 1] - t[k])


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
            q2 = q + h / 2 * w
            w2 = w + h / 2 * k1
            k2 = min(max(kv * (kp * (b - q2) - w2), -limit), limit)
            q3 = q + h / 2 * w2
            w3 = w + h / 2 * k2
            k3 = min(max(kv * (kp * (b - q3) - w3), -limit), limit)
            q4 = q + h * w3
            w4 = w + h * k3
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
    """Return a joint's positions at t [rad] for set-points u; `before` holds before the first.

    Dry friction brakes with a constant acceleration [rad/s²]; steps are to be fine with it.
    Velocity feed-forward `feed` adds to the command, over kp, the rate of lines, or that up to held
    ones.
    """
    before = u[0] if before is None else before
    q0 = before if q0 is None else q0
    return _run(t, u, linear, before, kp, kv, delay, limit, q0, dq0, steps, friction, feed)


def multisine(t, highest, seed, lowest=0.5):
    """Return a multisine with equal lines every 0.5 Hz, random phases and amplitude about 1."""
    rng = np.random.default_rng(seed)
    lines = np.arange(lowest, highest + 0.25, 0.5)
    u = np.zeros_like(t)
    for f, phase in zip(lines, rng.uniform(0, 2 * np.pi, len(lines)), strict=True):
        u += np.sin(2 * np.pi * f * t + phase)
    return u / np.abs(u).max()


def commands(kind, kp, kv, delay, seed):
    """Return times and set-points for a kind of log."""
    if kind == "multisine":
        t = np.arange(8000) * INTERVAL
        return t, 5e-3 * multisine(t, 25.0, seed)
    t = np.arange(4000) * INTERVAL
    if kind == "step":
        return t, np.where(t >= 0.3, 0.85 * LIMIT / (kp * kv), 0.0)
    if kind == "large step":
        return t, np.where(t >= 0.3, 0.5, 0.0)
    raise ValueError(kind)


def draw(seed):
    """Draw a joint: two logs with white noise, and its true parameters by name."""
    rng = np.random.default_rng([21, seed])
    servo = {
        "kp": math.exp(rng.uniform(math.log(12), math.log(45))),
        "kv": math.exp(rng.uniform(math.log(80), math.log(250))),
        "delay": rng.uniform(2e-3, 20e-3),
        "feed": float(rng.choice([0.0, 0.9])),
        "limit": float(rng.choice([math.inf, 12.0])),
    }
    logs = []
    for k in range(2):
        t = np.arange(5000) * SAMPLE
        u = 4e-3 * multisine(t, 20.0, 2 * seed + k)
        u -= u[0]
        q = move(t, u, **servo, steps=40)
        logs.append(Log(t=t, command=u, measured=q + NOISE * rng.normal(size=len(t))))
    return logs, servo


def run(seed: int) -> Outcome:
    """Identify a random joint."""
    (one, other), truth = draw(seed)
    identification = ac.identify(one)
    joint = identification.joints[0]
    notes = []
    if not joint.written:
        return Outcome(kind="joint", result="no model", notes=[joint.note], covered={})
    predicted = identification.predict(other)
    if predicted.rms[0] > 0.3 * predicted.tracking_rms[0]:
        notes.append(f"errs by {predicted.rms[0]:.3g} rad on another program")
    if not math.isnan(joint.acceleration_limit.value) and truth["limit"] == math.inf:
        notes.append("finds a limit where there is none")
    same = {NAMES[x] for x, y in truth.items() if y not in (0.0, math.inf)} == set(joint.parameters)
    covered = {
        f"joint, {NAMES[x]}": bool(
            getattr(joint, NAMES[x]).low <= y <= getattr(joint, NAMES[x]).high
        )
        for x, y in truth.items()
        if same and NAMES[x] in joint.parameters
    }
    return Outcome(kind="joint", result=joint.order, notes=notes, covered=covered)
