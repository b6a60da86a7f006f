"""Compiled simulation of one joint over a log, with its derivatives by every parameter.

Spans end at samples and at set-points as the joint sees them (`t + delay`).
"""

from __future__ import annotations

import math

import numpy as np

from armcontour._checks import FloatArray
from armcontour._kernels import compiled
from armcontour.servo._response import LARGEST_STEP, Servo, fastest_rate
from armcontour.servo._sensitivity import (
    COLUMNS,
    DELAY,
    DQ0,
    FEED,
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


@compiled(inner=True)
def _rate(t: FloatArray, u: FloatArray, linear: bool, k: int) -> float:
    """Rate that feed-forward sees from set-point k on [rad/s]; held ones have that up to them."""
    if not linear:
        k -= 1
    if k < 0 or k > len(t) - 2:
        return 0.0
    return float((u[k + 1] - u[k]) / (t[k + 1] - t[k]))


@compiled()
def second_order(
    t: FloatArray,
    u: FloatArray,
    linear: bool,
    first: int,
    last: int,
    rest: bool,
    given: FloatArray,
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
        given: Gains kp and kv [1/s], dead time [s], position q0 [rad] and velocity dq0 [rad/s] at
            the first sample, acceleration limit [rad/s²] or infinity, and velocity feed-forward,
            (COLUMNS - 1,).
        columns: 1, or COLUMNS with derivatives by what is given.

    Returns:
        Positions and derivatives, (columns, last - first); largest demand (NaN if time steps make
        no progress) and time in saturation.
    """
    kp, kv, delay, q0, dq0, limit, feed = given
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
    slopes = np.zeros(COLUMNS)
    oldest = 0
    servo = Servo(kp, kv, -limit, limit)
    now = t[0] + delay if rest else t[first]
    k = -1
    while k + 1 < n and t[k + 1] + delay <= now and not rest:
        k += 1
    rate = _rate(t, u, linear, k)
    old = q0 if rest else u[0]
    for i in range(first, last):
        while now < t[i] or (k + 1 < n and t[k + 1] + delay <= now):
            if k + 1 < n and t[k + 1] + delay <= now:
                k += 1
                before = old if k == 0 else (u[k] if linear else u[k - 1])
                before += feed * rate / kp
                rate = _rate(t, u, linear, k)
                after = u[k] + feed * rate / kp
                if before != after:
                    z = kv * (kp * (before - x[0, 0]) - x[1, 0])
                    jump = kv * kp * (after - before)
                    if columns > 1:
                        x[1, DELAY] += _clipped(z, limit) - _clipped(z + jump, limit)
                continue
            end = t[i]
            if k + 1 < n:
                end = min(end, t[k + 1] + delay)
            span = end - now
            r = 0.0
            v = u[max(k, 0)] + feed * rate / kp
            if linear and 0 <= k < n - 1:
                r = rate
                v += r * (now - delay - t[k])
            slopes[KP], slopes[DELAY], slopes[FEED] = -feed * rate / (kp * kp), -r, rate / kp
            if limit < math.inf:
                longest = LARGEST_STEP / fastest_rate(kp, kv)
                z = kv * (kp * (v - x[0, 0]) - x[1, 0])
                dz = kv * (kp * (r - x[1, 0]) - z)
                # A free demand stays below |z| + t |dz|. For its peak alone, look closely.
                if (limit == UNREACHED and span > longest) or abs(z) + span * abs(dz) > limit:
                    move_limited(x, scratch, servo, v, r, slopes, span, seen)
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
            move_freely(x, kept[slot], kp, v, r, slopes, span)
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
    given: FloatArray,
    columns: int,
) -> FloatArray:
    """As `second_order`, for `dq = kp (u - q) + feed du`; columns kv, dq0 and limit stay zero."""
    kp, _, delay, q0, _, _, feed = given
    n = len(t)
    out = np.zeros((columns, last - first))
    x = np.zeros(COLUMNS)
    x[0] = q0
    x[Q0] = 1.0
    now = t[0] + delay if rest else t[first]
    k = -1
    while k + 1 < n and t[k + 1] + delay <= now and not rest:
        k += 1
    rate = _rate(t, u, linear, k)
    old = q0 if rest else u[0]
    for i in range(first, last):
        while now < t[i] or (k + 1 < n and t[k + 1] + delay <= now):
            if k + 1 < n and t[k + 1] + delay <= now:
                k += 1
                before = old if k == 0 else (u[k] if linear else u[k - 1])
                step, was = u[k] - before, rate
                rate = _rate(t, u, linear, k)
                x[DELAY] -= kp * step + feed * (rate - was)
                continue
            end = t[i]
            if k + 1 < n:
                end = min(end, t[k + 1] + delay)
            span = end - now
            r = 0.0
            v = u[max(k, 0)] + feed * rate / kp
            if linear and 0 <= k < n - 1:
                r = rate
                v += r * (now - delay - t[k])
            f = math.exp(-kp * span)
            e = x[0] - v + r / kp
            own = -feed * rate / (kp * kp)
            x[KP] = own + f * (x[KP] - own) + r / (kp * kp) * (1 - f) - span * f * e
            x[DELAY] = f * (x[DELAY] + r) - r
            x[FEED] = rate / kp + f * (x[FEED] - rate / kp)
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
        trials: What is given, (m, COLUMNS - 1); an infinite kv is the first-order model.

    Returns:
        Sums [rad²], (m,).
    """
    sums = np.empty(len(trials))
    for m in range(len(trials)):
        if trials[m, 1] < math.inf:
            q = second_order(t, u, linear, first, last, rest, trials[m], 1)[0]
        else:
            q = first_order(t, u, linear, first, last, rest, trials[m], 1)
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
