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
        speed = ds[j] * c + dds[j] * h + jerk[j] * u**2 / 2
        found[1, k] = speed
        found[2, k] = ds[j] * slope[j] * h + dds[j] * c + jerk[j] * u
        found[3, k] = slope[j] * speed + jerk[j]
    return found


@compiled(inner=True)
def _find_piece(breaks: FloatArray, s: float, piece: int, begin: float, end: float) -> int:
    """The interval of a joint path that has the place s, within an interval of a law.

    Args:
        breaks: Of the joint path, (m + 1,).
        s: The place.
        piece: A guess.
        begin: Start of the law's interval: its place at a break is after the break.
        end: End of the law's interval: its place at a break is before the break.
    """
    last = len(breaks) - 2
    if breaks[piece] <= begin < end <= breaks[piece + 1]:
        return piece
    first = min(max(int(np.searchsorted(breaks, begin, side="right")) - 1, 0), last)
    final = min(max(int(np.searchsorted(breaks, end)) - 1, 0), last)
    here = min(max(int(np.searchsorted(breaks, s, side="right")) - 1, 0), last)
    return min(max(here, first), final)


@compiled()
def joint_motions(
    along: FloatArray,
    begin: FloatArray,
    end: FloatArray,
    breaks: FloatArray,
    coefficients: FloatArray,
    out: Motion,
) -> None:
    """Joint positions and their derivatives over time along a joint path, by the chain rule.

    Args:
        along: s and its derivatives over time up to the third, (4, n).
        begin: Start of the law's interval at each place [m], (n,).
        end: Its end [m], (n,).
        breaks: Of the joint path, (m + 1,).
        coefficients: Of the joint path, (m, 6, dof).
        out: Where the results go; what has no rows is not computed.
    """
    dof = coefficients.shape[2]
    orders = len(out.q) > 0, len(out.dq) > 0, len(out.ddq) > 0, len(out.dddq) > 0
    piece = 0
    for k in range(along.shape[1]):
        s, ds = along[0, k], along[1, k]
        dds, ddds = along[2, k], along[3, k]
        piece = _find_piece(breaks, s, piece, begin[k], end[k])
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
