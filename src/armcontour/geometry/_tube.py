"""Compiled distances within windows of a tube; bounds of them over all points of a path."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.core.kernels import compiled
from armcontour.geometry._segments import Point, nearest_within, point_at

# A part is halved at most this often, and into at most this many parts.
DEPTH = 48
PARTS = 20_000
# Where the tolerance is exceeded, a bound within this fraction of it above what was found is close
# enough. Elsewhere a bound is made as close as rounding allows, as long as there are fewer halvings
# than this per given part.
CLOSE = 1e-6
FINE = 50


class Pieces(NamedTuple):
    """The m pieces of a tube.

    Attributes:
        rows: The pieces from `pack`, (m, 15).
        tolerance: Their tolerances [m], (m,).
        given_up: Whether each piece gives up its start, and its end, to a neighbour, (m, 2).
    """

    rows: FloatArray
    tolerance: FloatArray
    given_up: BoolArray


@compiled(inner=True)
def _excess(p: Point, pieces: Pieces, j: int, low: float, high: float) -> tuple[float, float]:
    """Distance of a point from a part of piece j, less its tolerance, and the nearest place [m].

    The distance is infinite if the part is empty or a neighbour has the nearest point.
    """
    if low > high:
        return math.inf, 0.0
    g = pieces.rows[j]
    d2, u = nearest_within(p, g, low, high, math.inf)
    if (pieces.given_up[j, 0] and u <= 0.0) or (pieces.given_up[j, 1] and u >= g[10]):
        return math.inf, u
    return math.sqrt(d2) - pieces.tolerance[j], u


@compiled()
def find_excess(
    points: FloatArray, ranges: FloatArray, windows: IntArray, pieces: Pieces
) -> tuple[FloatArray, FloatArray]:
    """Least distance less tolerance within a range of the path, and its arc length, per point.

    Args:
        points: Points, padded to space [m], (n, 3).
        ranges: Arc lengths at which the range of each point starts and ends [m], (n, 2).
        windows: First and last piece of that range, (n, 2).
        pieces: The pieces.
    """
    excess, s = np.full(len(points), np.inf), np.zeros(len(points))
    for i in range(len(points)):
        p = points[i, 0], points[i, 1], points[i, 2]
        for j in range(windows[i, 0], windows[i, 1] + 1):
            g = pieces.rows[j]
            low = min(max(ranges[i, 0] - g[11], 0.0), g[10])
            high = min(max(ranges[i, 1] - g[11], low), g[10])
            off, u = _excess(p, pieces, j, low, high)
            if off < excess[i]:
                excess[i], s[i] = off, g[11] + u
    return excess, s


@compiled()
def bulge(g: FloatArray, u0: float, u1: float, h: FloatArray, v0: float, v1: float) -> Any:
    """How far two matched parts of segments can be farther apart inside than at their ends.

    One part runs from u0 to u1 along g, the other from v0 to v1 along h, both evenly. It is an
    eighth of the largest second derivative of their difference over the share of the way; see
    tube.py.
    """
    turn_g, turn_h = g[9] * (u1 - u0), h[9] * (v1 - v0)
    bend_g, bend_h = turn_g * (u1 - u0), turn_h * (v1 - v0)
    if bend_g == 0.0 or bend_h == 0.0 or abs(turn_g) + abs(turn_h) > 1.0:
        return (bend_g + bend_h) / 8
    # Distances of the unit normals at both ends, and of the axes about which the tangents turn.
    apart2, plane2 = 0.0, 0.0
    for u, v in ((u0, v0), (u1, v1)):
        cg, sg, ch, sh = (
            math.cos(g[9] * u),
            math.sin(g[9] * u),
            math.cos(h[9] * v),
            math.sin(h[9] * v),
        )
        total = 0.0
        for a in range(3):
            total += (cg * g[6 + a] - sg * g[3 + a] - ch * h[6 + a] + sh * h[3 + a]) ** 2
        apart2 = max(apart2, total)
    if apart2 > 1.0:
        return (bend_g + bend_h) / 8
    for axis in range(3):
        a, b = (axis + 1) % 3, (axis + 2) % 3
        gap = g[3 + a] * g[6 + b] - g[3 + b] * g[6 + a] - h[3 + a] * h[6 + b] + h[3 + b] * h[6 + a]
        plane2 += gap * gap
    apart = math.sqrt(apart2)
    apart += min((turn_g * turn_g + turn_h * turn_h) / 8, 2 * abs(turn_h) * math.sqrt(plane2))
    return (abs(bend_g - bend_h) + min(bend_g, bend_h) * apart) / 8


@compiled()
def bound_excess(
    rows: FloatArray,
    segment: IntArray,
    parts: FloatArray,
    windows: IntArray,
    pieces: Pieces,
    slack: float,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Bounds of distance less tolerance over parts of a path, and the largest values found.

    Args:
        rows: Segments of the path from `pack`, (n, 15).
        segment: The segment of each part, (k,).
        parts: Distance along the segment, place and reach at the start of each part, then at its
            end [m], (k, 6).
        windows: First and last piece within reach of any of its places, (k, 2).
        pieces: The pieces.
        slack: A bound up to this is not made any closer [m].

    Returns:
        The bounds and the values found [m], and where these are, as arc lengths on the path [m],
        (k,) each.
    """
    n = len(parts)
    bounds, found, where = np.full(n, -np.inf), np.full(n, -np.inf), np.zeros(n)
    stack, depths = np.empty((DEPTH + 2, 6)), np.empty(DEPTH + 2, np.intp)
    enough, left = slack, FINE * (n + 1000)
    for i in range(n):
        g = rows[segment[i]]
        stack[0], depths[0] = parts[i], 0
        top, count = 0, 0
        while top >= 0:
            part = stack[top]
            depth = depths[top]
            top -= 1
            count += 1
            # The excess at both ends, a bound over the whole part and the tolerance of its piece.
            u0, u1 = part[0], part[3]
            p, q = point_at(g, u0), point_at(g, u1)
            at_start, at_end, bound, own = np.inf, np.inf, np.inf, 0.0
            for j in range(windows[i, 0], windows[i, 1] + 1):
                h = pieces.rows[j]
                low = max(part[1] - part[2] - h[11], 0.0), max(part[4] - part[5] - h[11], 0.0)
                high = min(part[1] + part[2] - h[11], h[10]), min(part[4] + part[5] - h[11], h[10])
                d0, v0 = _excess(p, pieces, j, low[0], high[0])
                d1, v1 = _excess(q, pieces, j, low[1], high[1])
                at_start, at_end = min(at_start, d0), min(at_end, d1)
                if max(d0, d1) < bound:
                    more = max(d0, d1) + bulge(g, u0, u1, h, v0, v1)
                    if more < bound:
                        bound, own = more, pieces.tolerance[j]
            at_ends = max(at_start, at_end)
            if at_ends > found[i]:
                found[i] = at_ends
                where[i] = g[11] + (u0 if at_start >= at_end else u1)
            enough = max(enough, at_ends)
            left -= 1
            fine = at_ends <= slack / 2 and left > 0
            close = bound - at_ends <= (slack / 2 if fine else CLOSE * own)
            if bound <= enough or close or depth == DEPTH or count > PARTS:
                bounds[i] = max(bounds[i], bound)
                continue
            # The second half takes the place of the whole, the first one goes on top.
            for c in range(3):
                middle = (part[c] + part[3 + c]) / 2
                stack[top + 2, c], stack[top + 2, 3 + c] = part[c], middle
                stack[top + 1, c] = middle
            depths[top + 1] = depths[top + 2] = depth + 1
            top += 2
    return bounds, found, where
