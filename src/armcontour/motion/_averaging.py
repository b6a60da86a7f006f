"""Compiled moving averages of the arc length over time, exact."""

from __future__ import annotations

import numpy as np

from armcontour._checks import FloatArray
from armcontour._kernels import compiled
from armcontour.motion.laws import Rates

# Terms of the series below. They converge to rounding errors for `|slope| t²` up to 10, more than a
# half period of a law with circular functions.
TERMS = 18
# Steps of a search whose bracket is halved at least in every second step.
STEPS = 110


@compiled(inner=True)
def advance(rates: Rates, i: int, u: float) -> tuple[float, float, float, float, float]:
    """State of a law at time u after the start of interval i; its dds is linear in s or time.

    Returns:
        dds, ds, the distance from the start of the interval, and the first and second integral of
        that distance over time.
    """
    ds, dds, slope, jerk = rates.ds[i], rates.dds[i], rates.slope[i], rates.jerk[i]
    z = slope * u * u
    # f_n = sum_j z^j / (2 j + n)!, which hyperbolic and circular functions are made of.
    f0, f1, f2, f3, f4 = 1.0, 1.0, 0.5, 1.0 / 6.0, 1.0 / 24.0
    a0, a1, a2, a3, a4 = f0, f1, f2, f3, f4
    for j in range(1, TERMS):
        n = 2.0 * j
        a0 *= z / ((n - 1) * n)
        a1 *= z / (n * (n + 1))
        a2 *= z / ((n + 1) * (n + 2))
        a3 *= z / ((n + 2) * (n + 3))
        a4 *= z / ((n + 3) * (n + 4))
        f0 += a0
        f1 += a1
        f2 += a2
        f3 += a3
        f4 += a4
        if abs(a0) < 1e-18:
            break
    v = u * u
    return (
        ds * slope * u * f1 + dds * f0 + jerk * u,
        ds * f0 + dds * u * f1 + jerk * v / 2.0,
        ds * u * f1 + dds * v * f2 + jerk * v * u / 6.0,
        ds * v * f2 + dds * v * u * f3 + jerk * v * v / 24.0,
        ds * v * u * f3 + dds * v * v * f4 + jerk * v * v * u / 120.0,
    )


@compiled()
def whole(breaks: FloatArray, rates: Rates) -> FloatArray:
    """Integrals over each interval of the distance from its start: first and second, (n, 2)."""
    n = len(breaks) - 1
    found = np.empty((n, 2))
    for i in range(n):
        found[i, 0], found[i, 1] = advance(rates, i, breaks[i + 1] - breaks[i])[3:]
    return found


@compiled(inner=True, allocates=True)
def _from(
    breaks: FloatArray,
    s: FloatArray,
    rates: Rates,
    integrals: FloatArray,
    begin: float,
    ends: FloatArray,
) -> FloatArray:
    """State of a law at increasing times `ends`, with integrals from time `begin`, (n, 5).

    The columns are dds, ds, the distance from the position at `begin`, and the first and second
    integral of that distance over time. The law is at rest before its first and after its last
    break.
    """
    n = len(breaks) - 1
    found = np.zeros((len(ends), 5))
    i = -1 if begin < breaks[0] else min(int(np.searchsorted(breaks, begin, side="right")) - 1, n)
    # Time of the last break passed, arc length at `begin`, and the integrals up to that time.
    now, origin = begin, s[0]
    if i >= n:
        origin = s[n]
    elif i >= 0:
        origin = s[i] + advance(rates, i, begin - breaks[i])[2]
    one, two = 0.0, 0.0
    for k in range(len(ends)):
        while i < n and ends[k] >= breaks[i + 1]:
            one, two = _advance_integrals(breaks, s, rates, integrals, i, now, origin, one, two)
            i += 1
            now = breaks[i]
        u, here = ends[k] - now, s[0] - origin
        if i >= n:
            here = s[n] - origin
        if i < 0 or i >= n:
            found[k, 2] = here
            found[k, 3], found[k, 4] = one + here * u, two + one * u + here * u * u / 2
            continue
        # Integrals from the start of the interval, less those up to `now`.
        own = advance(rates, i, ends[k] - breaks[i])
        lag = now - breaks[i]
        first = advance(rates, i, lag)
        here = s[i] - origin
        found[k, 0], found[k, 1], found[k, 2] = own[0], own[1], here + own[2]
        found[k, 3] = one + (own[3] - first[3]) + here * u
        found[k, 4] = two + one * u + (own[4] - first[4] - first[3] * u) + here * u * u / 2
    return found


@compiled(inner=True)
def _advance_integrals(
    breaks: FloatArray,
    s: FloatArray,
    rates: Rates,
    integrals: FloatArray,
    i: int,
    now: float,
    origin: float,
    one: float,
    two: float,
) -> tuple[float, float]:
    """First and second integral at the end of interval i, from those at time `now` inside it."""
    u = breaks[i + 1] - now
    here = s[max(i, 0)] - origin
    if i < 0:
        return one + here * u, two + one * u + here * u * u / 2
    if now == breaks[i]:
        add, more = integrals[i, 0], integrals[i, 1]
    else:
        first = advance(rates, i, now - breaks[i])
        add = integrals[i, 0] - first[3]
        more = integrals[i, 1] - first[4] - first[3] * u
    return one + add + here * u, two + one * u + more + here * u * u / 2


@compiled()
def average(
    t: FloatArray,
    breaks: FloatArray,
    s: FloatArray,
    rates: Rates,
    integrals: FloatArray,
    first: float,
    second: float,
) -> FloatArray:
    """Moving average of a law over the last `first` seconds, then over the last `second` seconds.

    Integrals start at the window's start, so that the motion before it costs no digits.

    Args:
        t: Times [s], (n,).
        breaks: Breaks of the law [s], (m + 1,).
        s: Arc lengths at the breaks [m], (m + 1,).
        rates: Rates of the law's intervals.
        integrals: Integrals from `whole`, (m, 2).
        first: Length of the longer window [s].
        second: Length of the shorter window, or 0 [s].

    Returns:
        s, ds, dds and ddds of the averaged law, (n, 4).
    """
    found = np.empty((len(t), 4))
    last = len(breaks) - 1
    for k in range(len(t)):
        begin = t[k] - first - second
        origin = s[0]
        if begin >= breaks[last]:
            origin = s[last]
        elif begin > breaks[0]:
            i = min(int(np.searchsorted(breaks, begin, side="right")) - 1, last - 1)
            origin = s[i] + advance(rates, i, begin - breaks[i])[2]
        ends = np.array([begin, begin + second, begin + first, t[k]])
        x = _from(breaks, s, rates, integrals, begin, ends)
        if second == 0.0:
            found[k, 0] = origin + x[3, 3] / first
            found[k, 1] = x[3, 2] / first
            found[k, 2] = (x[3, 1] - x[0, 1]) / first
            found[k, 3] = (x[3, 0] - x[0, 0]) / first
        else:
            area = first * second
            for c in range(4):
                found[k, c] = (x[3, 4 - c] - x[2, 4 - c] - x[1, 4 - c] + x[0, 4 - c]) / area
            found[k, 0] += origin
    return found


@compiled()
def crossings(
    target: FloatArray,
    low: FloatArray,
    high: FloatArray,
    breaks: FloatArray,
    s: FloatArray,
    rates: Rates,
    integrals: FloatArray,
    first: float,
    second: float,
) -> FloatArray:
    """Times between `low` and `high` at which the averaged law, never moving back, is at `target`.

    By Newton's method; the bracket is halved if a step leaves it, and in every second step. The
    other arguments are those of `average`.
    """
    found = np.empty(len(target))
    at = np.empty(1)
    for k in range(len(target)):
        a, b = low[k], high[k]
        at[0] = 0.5 * (a + b)
        for step in range(STEPS):
            x = average(at, breaks, s, rates, integrals, first, second)
            off = x[0, 0] - target[k]
            if off < 0.0:
                a = at[0]
            else:
                b = at[0]
            new = at[0] - off / x[0, 1] if x[0, 1] > 0.0 else a
            if step % 2 == 1 or not a < new < b:
                new = 0.5 * (a + b)
            if new <= a or new >= b or new == at[0]:
                break
            at[0] = new
        found[k] = b
    return found
