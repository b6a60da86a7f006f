"""The compiled part of smoothing: moving averages of the position along a path, exact."""

from __future__ import annotations

import numpy as np

from armcontour._checks import FloatArray
from armcontour._kernels import compiled
from armcontour.motion.laws import Rates

# Terms of the series below; they end at rounding for `|slope| t²` up to 10, which is more than half
# a turn of the circular law.
TERMS = 18
# Steps of a search that halves its bracket at least every second one.
STEPS = 110


@compiled()
def advance(rates: Rates, i: int, u: float) -> tuple[float, float, float, float, float]:
    """A law of path acceleration linear in s, `u` seconds after its interval `i` began.

    Returns:
        dds, ds, the way since then, and its first and second integral over time.
    """
    ds, dds, slope = rates.ds[i], rates.dds[i], rates.slope[i]
    z = slope * u * u
    # f_n = sum_j z^j / (2 j + n)!, of which hyperbolic and circular functions are made.
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
        ds * slope * u * f1 + dds * f0,
        ds * f0 + dds * u * f1,
        ds * u * f1 + dds * v * f2,
        ds * v * f2 + dds * v * u * f3,
        ds * v * u * f3 + dds * v * v * f4,
    )


@compiled()
def whole(breaks: FloatArray, rates: Rates) -> FloatArray:
    """First and second integral of the way over every interval, from its begin, (n, 2)."""
    n = len(breaks) - 1
    found = np.empty((n, 2))
    for i in range(n):
        found[i, 0], found[i, 1] = advance(rates, i, breaks[i + 1] - breaks[i])[3:]
    return found


@compiled()
def _from(
    breaks: FloatArray,
    s: FloatArray,
    rates: Rates,
    integrals: FloatArray,
    begin: float,
    ends: FloatArray,
) -> FloatArray:
    """At increasing times `ends`: dds, ds, way since `begin`, and its two integrals from there.

    Before its first break and after its last the law is at rest.
    """
    n = len(breaks) - 1
    found = np.zeros((len(ends), 5))
    i = -1 if begin < breaks[0] else min(int(np.searchsorted(breaks, begin, side="right")) - 1, n)
    # Time and way at the last event passed, and the integrals up to there.
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
        # From the begin of the interval, less what lies before `now`.
        own = advance(rates, i, ends[k] - breaks[i])
        lag = now - breaks[i]
        first = advance(rates, i, lag)
        here = s[i] - origin
        found[k, 0], found[k, 1], found[k, 2] = own[0], own[1], here + own[2]
        found[k, 3] = one + (own[3] - first[3]) + here * u
        found[k, 4] = two + one * u + (own[4] - first[4] - first[3] * u) + here * u * u / 2
    return found


@compiled()
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
    """Both integrals at the end of interval i, from those at `now` within it."""
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
    """The law averaged over the last `first` seconds, and that over the last `second` again.

    Integrals are taken from the window's begin, so that no digits are lost to what lies before it.

    Args:
        t: Times [s], (n,).
        breaks: Of the law [s], (m + 1,).
        s: At the breaks [m], (m + 1,).
        rates: Of every interval.
        integrals: Of `whole`, (m, 2).
        first: The longer window [s].
        second: The shorter one, or 0 [s].

    Returns:
        s, ds and dds, (n, 3).
    """
    found = np.empty((len(t), 3))
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
        else:
            area = first * second
            for c in range(3):
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
    """Times between `low` and `high` at which the averaged law, which never turns, is at `target`.

    Newton's steps, and halves of the bracket where they leave it or do not shorten it.
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
