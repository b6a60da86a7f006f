"""Compiled simulation of one joint over a log, with its derivatives by every parameter.

Spans end at samples and at set-points as the joint sees them (`t + delay`).
"""

from __future__ import annotations

import math

import numpy as np

from armcontour._checks import FloatArray
from armcontour._kernels import compiled
from armcontour.servo._response import LARGEST_STEP, fastest_rate
from armcontour.servo._sensitivity import (
    COLUMNS,
    DELAY,
    DQ0,
    KP,
    Q0,
    differentiate_transition,
    move_freely,
    move_limited,
)

# Spans that differ by less [s] share a transition: rounding of time stamps, no more.
SAME_SPAN = 1e-12
# A limit that is never reached: with it the demands are looked at, and nothing else changes.
UNREACHED = 1e300


@compiled(inner=True)
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
        last: The sample after the last one.
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
        Positions and derivatives, (columns, last - first); largest demand (NaN if time steps make
        no progress) and time in saturation.
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
                longest = LARGEST_STEP / fastest_rate(kp, kv)
                z = kv * (kp * (v - x[0, 0]) - x[1, 0])
                dz = kv * (kp * (r - x[1, 0]) - z)
                # A free demand stays below |z| + t |dz|. For its peak alone, look closely.
                if (limit == UNREACHED and span > longest) or abs(z) + span * abs(dz) > limit:
                    move_limited(x, columns, scratch, kp, kv, limit, v, r, span, seen)
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
                differentiate_transition(kp, kv, span, kept[slot])
            move_freely(x, columns, kept[slot], kp, v, r, span)
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
        last: The one after the last.
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
