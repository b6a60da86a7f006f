"""The compiled part of laws along joint paths: the way over time, and the joints along the way."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.kernels import compiled

# Below this angle, hyperbolic and circular functions are computed by their series.
SMALL = 1e-2


class Motion(NamedTuple):
    """Joint positions and their derivatives over time, (n, dof) each; (0, dof) if not asked for."""

    q: FloatArray
    dq: FloatArray
    ddq: FloatArray
    dddq: FloatArray


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
        # The solution of `dds = dds_j + slope (s - s_j)` has cosh(w u), sinh(w u) / w and
        # (cosh(w u) - 1) / w² with `w² = slope`, which are circular functions if it is negative.
        z = slope[j] * u * u
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
        h, p = u * h, u * u * p
        way = s[j] + ds[j] * h + dds[j] * p + jerk[j] * u**3 / 6
        # Rounding errors must not move s past a break, at which derivatives may jump.
        found[0, k] = min(max(way, s[j]), s[j + 1])
        speed = ds[j] * c + dds[j] * h + jerk[j] * u**2 / 2
        found[1, k] = speed
        found[2, k] = ds[j] * slope[j] * h + dds[j] * c + jerk[j] * u
        found[3, k] = slope[j] * speed + jerk[j]
    return found


@compiled(inner=True, inline="always")
def value_and_slopes(
    a0: float, a1: float, a2: float, a3: float, a4: float, a5: float, x: float
) -> tuple[float, float, float]:
    """The polynomial with these coefficients at x, and its first and second derivative."""
    # Horner's rule for all three.
    slope, value, bend = a5, a5 * x + a4, 0.0
    bend, slope, value = bend * x + 2 * slope, slope * x + value, value * x + a3
    bend, slope, value = bend * x + 2 * slope, slope * x + value, value * x + a2
    bend, slope, value = bend * x + 2 * slope, slope * x + value, value * x + a1
    bend, slope, value = bend * x + 2 * slope, slope * x + value, value * x + a0
    return value, slope, bend


@compiled()
def joint_motions(
    along: FloatArray,
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
        end: End of the law's interval at each place [m], (n,): a break of the joint path there
            ends the piece of the place.
        law: The law of each place, (n,).
        rows: Indices of the first breaks of the laws' joint paths, and the number of all breaks,
            (laws + 1,).
        breaks: Breaks of all joint paths [m], each counted from its own start, (m,).
        coefficients: The coefficients of the interval after each break, (m, 6, dof); those after
            the last break of a joint path are not read, and may be missing.
        out: Where the results go; what has no rows is not computed.
    """
    orders = len(out.q) > 0, len(out.dq) > 0, len(out.ddq) > 0, len(out.dddq) > 0
    piece = 0
    for k in range(along.shape[1]):
        s, ds, dds, ddds = along[0, k], along[1, k], along[2, k], along[3, k]
        low, high = rows[law[k]], rows[law[k] + 1] - 2
        # The last piece that begins before s, mostly that of the place before.
        if low <= piece <= high and breaks[piece] <= s and breaks[piece] < end[k]:
            low = piece
        if s < breaks[low + 1] or end[k] <= breaks[low + 1]:
            high = low
        while low < high:
            middle = (low + high + 1) // 2
            if breaks[middle] <= s and breaks[middle] < end[k]:
                low = middle
            else:
                high = middle - 1
        piece = low
        width = breaks[piece + 1] - breaks[piece]
        x = (s - breaks[piece]) / width
        for j in range(coefficients.shape[2]):
            c0, c1, c2 = (
                coefficients[piece, 0, j],
                coefficients[piece, 1, j],
                coefficients[piece, 2, j],
            )
            c3, c4, c5 = (
                coefficients[piece, 3, j],
                coefficients[piece, 4, j],
                coefficients[piece, 5, j],
            )
            value, slope, bend = value_and_slopes(c0, c1, c2, c3, c4, c5, x)
            slope, bend = slope / width, bend / (width * width)
            if orders[0]:
                out.q[k, j] = value
            if orders[1]:
                out.dq[k, j] = slope * ds
            if orders[2]:
                out.ddq[k, j] = bend * (ds * ds) + slope * dds
            if orders[3]:
                third = (((60 * c5) * x + 24 * c4) * x + 6 * c3) / (width * width * width)
                out.dddq[k, j] = third * (ds * ds * ds) + 3 * bend * ds * dds + slope * ddds
