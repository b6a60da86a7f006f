"""The compiled part of brackets: bounds of x and u around a plan, and whether a plan keeps them."""

from __future__ import annotations

import math

import numpy as np

from armcontour._checks import BoolArray, FloatArray, IntArray
from armcontour._kernels import compiled

# Margins in brackets change by about so many times the share by which the brackets move.
SENSITIVE = 10.0


@compiled(inner=True)
def sag(skew: float, width: float) -> float:
    """Largest distance of x from its chord on an interval, where u has a slope over s."""
    return abs(skew) * width**2 / 4


@compiled(inner=True)
def turn(skew: float, width: float) -> float:
    """Change of u over an interval, where u has a slope over s."""
    return abs(skew) * width


@compiled()
def spread(
    x: FloatArray, slope: FloatArray, of: IntArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The larger and the smaller x of both ends, and the slope, of coarse intervals on fine ones.

    Args:
        x: A plan on the coarse grid [m²/s²], (coarse n + 1,).
        slope: Its slopes of u over s [1/s²], (coarse n,).
        of: The coarse interval that each fine interval lies in, (n,).

    Returns:
        Three arrays, (n,) each.
    """
    n = len(of)
    most, least, slopes = np.empty(n), np.empty(n), np.empty(n)
    for i in range(n):
        k = of[i]
        most[i], least[i] = max(x[k], x[k + 1]), min(x[k], x[k + 1])
        slopes[i] = slope[k]
    return most, least, slopes


@compiled()
def bound_x(
    most: FloatArray, least: FloatArray, reach: FloatArray, skew: FloatArray, width: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Largest and smallest x of brackets on every interval [m²/s²], (n,) each.

    Args:
        most: The larger x of both interval ends, (n,).
        least: The smaller x of both interval ends, (n,).
        reach: Ratio by which the brackets extend beyond both, (n,).
        skew: Slope of u over s [1/s²], (n,).
        width: Interval lengths [m], (n,).
    """
    n = len(width)
    high, low = np.empty(n), np.empty(n)
    for i in range(n):
        off = sag(skew[i], width[i])
        high[i] = reach[i] * most[i] + off
        low[i] = max(least[i] / reach[i] - off, 0.0)
    return high, low


@compiled()
def bound_u(
    allowed: FloatArray,
    high: FloatArray,
    low: FloatArray,
    skew: FloatArray,
    width: FloatArray,
    bracketed: bool,
) -> FloatArray:
    """Largest |u| on every interval [m/s²], (n,), with the skew of a plan.

    Args:
        allowed: Largest |u| that the limits allow at the ends, (n,).
        high: Largest x, (n,).
        low: Smallest x, (n,).
        skew: Slope of u over s [1/s²], (n,).
        width: Interval lengths [m], (n,).
        bracketed: Whether x stays between `low` and `high`; u is then at most what takes x from
            one to the other.
    """
    n = len(width)
    u = np.empty(n)
    for i in range(n):
        change = turn(skew[i], width[i])
        u[i] = allowed[i] + change
        if bracketed:
            u[i] = min(u[i], (high[i] - low[i]) / (2 * width[i]) + 1.5 * change)
    return u


@compiled()
def judge(
    x: FloatArray,
    skew: FloatArray,
    width: FloatArray,
    high: FloatArray,
    low: FloatArray,
    bracketed: bool,
    largest_dip: float,
    dips: BoolArray,
    left: BoolArray,
) -> tuple[bool, bool]:
    """Mark the intervals on which a plan dips, and those on which it leaves its bounds.

    Args:
        x: The plan [m²/s²], (n + 1,).
        skew: Slope of u over s [1/s²], (n,).
        width: Interval lengths [m], (n,).
        high: Largest x of the bounds, (n,).
        low: Smallest x of the bounds, (n,).
        bracketed: Whether `low` counts.
        largest_dip: The share of x by which it may dip between the ends because u grows there.
        dips: Output: whether x may come near 0 inside, (n,).
        left: Output: whether x is outside the bounds, (n,).

    Returns:
        Whether any interval dips, and whether any is left.
    """
    any_dips = any_left = False
    for i in range(len(width)):
        off = sag(skew[i], width[i])
        dips[i] = left[i] = False
        if skew[i] > 0:
            speed = math.sqrt(x[i]) + math.sqrt(x[i + 1])
            dips[i] = 4 * off > largest_dip * speed**2
        left[i] = max(x[i], x[i + 1]) > high[i] - off
        if bracketed:
            left[i] |= max(min(x[i], x[i + 1]) - off, 0.0) < low[i]
        any_dips |= dips[i]
        any_left |= left[i]
    return any_dips, any_left


@compiled()
def gain_left(
    times: FloatArray,
    lost: FloatArray,
    x: FloatArray,
    most: FloatArray,
    least: FloatArray,
    reach: FloatArray,
    close: float,
) -> float:
    """About the largest share of the duration that a plan in brackets around this one gains.

    Margins cost about the share of the limits that they take; brackets of other places and of the
    same reach have other margins only as far as the places differ.

    Args:
        times: The plan's times at the grid points [s], (n + 1,).
        lost: Largest share of any limit that margins take on each interval, (n,).
        x: The plan [m²/s²], (n + 1,).
        most: The larger x of both ends that the brackets of the plan were around, (n,).
        least: The smaller x, (n,).
        reach: Ratio by which these brackets extended beyond both, (n,).
        close: That ratio of the brackets around this plan.
    """
    n, total = len(lost), 0.0
    for i in range(n):
        share = 1.0
        if reach[i] <= close:
            high, low = max(x[i], x[i + 1]), min(x[i], x[i + 1])
            moved = max(abs(high - most[i]), abs(low - least[i]))
            known = most[i] if low == least[i] else least[i]
            if moved < known:
                share = min(1.0, SENSITIVE * moved / known)
        total += (times[i + 1] - times[i]) * lost[i] * share
    return float(total / times[n])
