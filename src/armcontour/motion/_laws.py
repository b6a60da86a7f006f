"""The compiled part of laws along joint paths: the way over time, and the joints along the way."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour._kernels import compiled

# Below this angle, hyperbolic and circular functions are computed by their series.
SMALL = 1e-2


class Motion(NamedTuple):
    """Joint positions and their derivatives over time, (n, dof) each; (0, dof) if not asked for."""

    q: FloatArray
    dq: FloatArray
    ddq: FloatArray
    dddq: FloatArray


@compiled(inner=True)
def linear_motion(slope: float, t: float) -> tuple[float, float, float]:
    """cosh(k t), sinh(k t) / k and (cosh(k t) - 1) / k² with `k² = slope`, of either sign."""
    z = slope * t * t
    size = math.sqrt(abs(z))
    if size < SMALL:
        c = 1 + z / 2 * (1 + z / 12 * (1 + z / 30))
        h = 1 + z / 6 * (1 + z / 20 * (1 + z / 42))
        p = 0.5 * (1 + z / 12 * (1 + z / 30 * (1 + z / 56)))
    elif z > 0.0:
        c, h = math.cosh(size), math.sinh(size) / size
        p = 2 * (math.sinh(size / 2) / size) ** 2
    else:
        c, h = math.cos(size), math.sin(size) / size
        p = 2 * (math.sin(size / 2) / size) ** 2
    return c, t * h, t * t * p


@compiled(inner=True)
def speed_after(ds: float, dds: float, jerk: float, c: float, h: float, t: float) -> float:
    """The path speed a time t after the start of an interval; c and h as `linear_motion` has them.

    Args:
        ds: Of the interval's `Rates`, as are dds and jerk.
        dds: Of the rates.
        jerk: Of the rates.
        c: The hyperbolic or circular cosine.
        h: The sine, over its factor.
        t: The time [s].
    """
    return ds * c + dds * h + jerk * t**2 / 2


@compiled()
def path_motions(
    i: IntArray,
    t: FloatArray,
    breaks: FloatArray,
    s: FloatArray,
    ds: FloatArray,
    dds: FloatArray,
    slope: FloatArray,
    jerk: FloatArray,
) -> FloatArray:
    """The arc length s and its first three derivatives at times of intervals, (4, n).

    Args:
        i: The interval of each time, (n,).
        t: Times [s], (n,).
        breaks: Of the law [s], (m + 1,).
        s: Arc lengths there [m], (m + 1,).
        ds: Of the law's `Rates`, as are dds, slope and jerk, (m,).
        dds: Of the rates.
        slope: Of the rates.
        jerk: Of the rates.
    """
    found = np.empty((4, len(t)))
    for k in range(len(t)):
        j = i[k]
        u = t[k] - breaks[j]
        # The solution of `dds = dds_j + slope (s - s_j)`: hyperbolic or circular functions.
        c, h, p = linear_motion(slope[j], u)
        way = s[j] + ds[j] * h + dds[j] * p + jerk[j] * u**3 / 6
        # Rounding errors must not move s past a break, at which derivatives may jump.
        found[0, k] = min(max(way, s[j]), s[j + 1])
        speed = speed_after(ds[j], dds[j], jerk[j], c, h, u)
        found[1, k] = speed
        found[2, k] = ds[j] * slope[j] * h + dds[j] * c + jerk[j] * u
        found[3, k] = slope[j] * speed + jerk[j]
    return found


@compiled(inner=True)
def _find_before(values: FloatArray, x: float, low: int, high: int, side: int) -> int:
    """The last of some increasing values that is below x, or not above it; low if there is none.

    Args:
        values: The values.
        x: The number.
        low: The first of them that may be found.
        high: The last of them that may be found.
        side: 1 for a value that is not above x, 0 for one that is below it.
    """
    while low < high:
        middle = (low + high + 1) // 2
        if values[middle] < x or (side == 1 and values[middle] == x):
            low = middle
        else:
            high = middle - 1
    return low


@compiled()
def place_times(
    law: IntArray,
    t: FloatArray,
    side: int,
    starts: FloatArray,
    rows: IntArray,
    breaks: FloatArray,
    local: FloatArray,
) -> IntArray:
    """Intervals of times, among those of laws whose breaks are in one row, (n,).

    Args:
        law: The law of each time, (n,).
        t: Times [s], (n,).
        side: At a break, 1 for the interval after it and 0 for the one before it.
        starts: Start times of the laws [s], (laws,).
        rows: Indices of the laws' first breaks, and the number of all breaks, (laws + 1,).
        breaks: Breaks of all laws, each counted from its start [s].
        local: Where the times since the starts of the laws go [s], (n,).
    """
    found = np.empty(len(t), np.intp)
    row = 0
    for k in range(len(t)):
        first, last, start = rows[law[k]], rows[law[k] + 1] - 2, starts[law[k]]
        # A time less the start is rounded, to either side of the law's break. So times are
        # compared with the very sums that `Trajectory.breaks` has.
        low, high = first, last
        if first <= row <= last and start + breaks[row] < t[k]:
            low = row
            if row == last or t[k] < start + breaks[row + 1]:
                high = row
        while low < high:
            middle = (low + high + 1) // 2
            at = start + breaks[middle]
            if at < t[k] or (side == 1 and at == t[k]):
                low = middle
            else:
                high = middle - 1
        row = low
        found[k] = row
        local[k] = min(max(t[k] - start, breaks[row]), breaks[row + 1])
    return found


@compiled()
def joint_motions(
    along: FloatArray,
    begin: FloatArray,
    end: FloatArray,
    law: IntArray,
    rows: IntArray,
    breaks: FloatArray,
    coefficients: FloatArray,
    out: Motion,
) -> None:
    """Joint positions and their derivatives over time along joint paths, by the chain rule.

    Args:
        along: s and its derivatives over time up to the third, (4, n).
        begin: Start of the law's interval at each place [m]: a place at a break of the joint path
            is after the break if the interval is, (n,).
        end: Its end [m], (n,).
        law: The law of each place, (n,).
        rows: Indices of the first breaks of the laws' joint paths, and the number of all breaks,
            (laws + 1,).
        breaks: Breaks of all joint paths [m], each counted from its own start, (m,).
        coefficients: The coefficients of the interval after each break, (m, 6, dof); those after
            the last break of a joint path are not read, and may be missing.
        out: Where the results go; what has no rows is not computed.
    """
    dof = coefficients.shape[2]
    orders = len(out.q) > 0, len(out.dq) > 0, len(out.ddq) > 0, len(out.dddq) > 0
    piece = 0
    for k in range(along.shape[1]):
        s, ds = along[0, k], along[1, k]
        dds, ddds = along[2, k], along[3, k]
        low, high = rows[law[k]], rows[law[k] + 1] - 2
        inside = low <= piece <= high and breaks[piece] <= begin[k] < end[k] <= breaks[piece + 1]
        if not inside:
            first = _find_before(breaks, begin[k], low, high, 1)
            final = max(_find_before(breaks, end[k], low, high, 0), first)
            piece = _find_before(breaks, s, first, final, 1)
        width = breaks[piece + 1] - breaks[piece]
        x = (s - breaks[piece]) / width
        for j in range(dof):
            c1, c2 = coefficients[piece, 1, j], coefficients[piece, 2, j]
            c3, c4 = coefficients[piece, 3, j], coefficients[piece, 4, j]
            c5 = coefficients[piece, 5, j]
            slope = ((((5 * c5) * x + 4 * c4) * x + 3 * c3) * x + 2 * c2) * x + c1
            slope /= width
            if orders[0]:
                low = coefficients[piece, 0, j]
                out.q[k, j] = ((((c5 * x + c4) * x + c3) * x + c2) * x + c1) * x + low
            if orders[1]:
                out.dq[k, j] = slope * ds
            if not (orders[2] or orders[3]):
                continue
            bend = (((20 * c5) * x + 12 * c4) * x + 6 * c3) * x + 2 * c2
            bend /= width * width
            if orders[2]:
                out.ddq[k, j] = bend * (ds * ds) + slope * dds
            if orders[3]:
                third = ((60 * c5) * x + 24 * c4) * x + 6 * c3
                third /= width * width * width
                out.dddq[k, j] = third * (ds * ds * ds) + 3 * bend * ds * dds + slope * ddds
