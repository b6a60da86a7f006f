"""Compiled moving averages of the arc length over time, exact."""

from __future__ import annotations

import numpy as np

from armcontour._checks import FloatArray
from armcontour._kernels import compiled
from armcontour.motion.laws import Rates

# Terms of the series below. They converge to rounding errors for `|slope| t²` up to 10, more than a
# half period of a law with circular functions.
TERMS = 18


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


@compiled()
def average(
    t: FloatArray,
    breaks: FloatArray,
    s: FloatArray,
    rates: Rates,
    integrals: FloatArray,
    windows: tuple[float, float],
) -> FloatArray:
    """Moving average of a law over the last seconds of one window, then of another.

    Integrals start at the window's start, so that the motion before it costs no digits. The law is
    at rest before its first and after its last break.

    Args:
        t: Times [s], (n,).
        breaks: Breaks of the law [s], (m + 1,).
        s: Arc lengths at the breaks [m], (m + 1,).
        rates: Rates of the law's intervals.
        integrals: Integrals from `whole`, (m, 2).
        windows: Lengths of the longer window, and of the shorter window or 0 [s].

    Returns:
        s, ds, dds and ddds of the averaged law, (n, 4).
    """
    first, second = windows
    found, last, rest = np.empty((len(t), 4)), len(breaks) - 1, (0.0, 0.0, 0.0, 0.0, 0.0)
    # At the ends of the windows: dds, ds, the distance from the position at the window's start, and
    # the first and second integral of that distance over time.
    x, ends = np.empty((4, 5)), np.empty(4)
    for k in range(len(t)):
        now = t[k] - first - second
        ends[0], ends[1], ends[2], ends[3] = now, now + second, now + first, t[k]
        i = int(np.searchsorted(breaks, now, side="right")) - 1
        # Integrals of interval i up to time `now`, and of all before since the window's start.
        begun = advance(rates, i, now - breaks[i]) if 0 <= i < last else rest
        origin, one, two = s[max(i, 0)] + begun[2], 0.0, 0.0
        for e in range(4):
            while i < last and ends[e] >= breaks[i + 1]:
                u, here = breaks[i + 1] - now, s[max(i, 0)] - origin
                two += one * u + here * u * u / 2
                one += here * u
                if i >= 0:
                    one += integrals[i, 0] - begun[3]
                    two += integrals[i, 1] - begun[4] - begun[3] * u
                i += 1
                now, begun = breaks[i], rest
            u, here = ends[e] - now, s[max(i, 0)] - origin
            own = advance(rates, i, ends[e] - breaks[i]) if 0 <= i < last else rest
            x[e, 0], x[e, 1], x[e, 2] = own[0], own[1], here + own[2]
            x[e, 3] = one + (own[3] - begun[3]) + here * u
            x[e, 4] = two + one * u + (own[4] - begun[4] - begun[3] * u) + here * u * u / 2
        for c in range(4):
            if second == 0.0:
                found[k, c] = (x[3, 3 - c] - x[0, 3 - c]) / first
            else:
                area = first * second
                found[k, c] = (x[3, 4 - c] - x[2, 4 - c] - x[1, 4 - c] + x[0, 4 - c]) / area
        found[k, 0] += origin
    return found
