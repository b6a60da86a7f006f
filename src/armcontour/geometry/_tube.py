"""Compiled distances within windows of a tube; bounds of them over all points of a path."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from armcontour._checks import BoolArray, FloatArray, IntArray
from armcontour._kernels import compiled
from armcontour.geometry._nearest import nearest_within, offsets

# A part is halved at most this often, and into at most this many parts.
DEPTH = 48
PARTS = 20_000
# Where the tolerance is exceeded, a bound within this fraction of it above what was found is close
# enough. Elsewhere a bound is made as close as rounding allows, as long as there are fewer halvings
# than this per given part.
CLOSE = 1e-6
FINE = 50


@compiled()
def find_room(
    points: FloatArray,
    windows: IntArray,
    pieces: FloatArray,
    tolerance: FloatArray,
    given_up: BoolArray,
) -> FloatArray:
    """Largest tolerance less distance over the pieces of each point's window [m], (n,).

    Args:
        points: Points, padded to space [m], (n, 3).
        windows: First and last piece for each point, (n, 2).
        pieces: Pieces from `pack`, (m, 12).
        tolerance: Tolerances of the pieces [m], (m,).
        given_up: Whether each piece gives up its start, and its end, to a neighbour, (m, 2).
    """
    room = np.full(len(points), -np.inf)
    for i in range(len(points)):
        for j in range(windows[i, 0], windows[i, 1] + 1):
            d2, u = nearest_within(points[i], pieces[j], 0.0, pieces[j, 10])
            if _owns(u, pieces[j], given_up[j]):
                room[i] = max(room[i], tolerance[j] - math.sqrt(d2))
    return room


@compiled(inner=True)
def _owns(u: float, g: FloatArray, given_up: BoolArray) -> Any:
    """Whether a piece has the point at distance u along it, and not its neighbour."""
    return not ((given_up[0] and u <= 0.0) or (given_up[1] and u >= g[10]))


@compiled()
def nearest_in_range(
    points: FloatArray, ranges: FloatArray, windows: IntArray, rows: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Distance and arc length of the nearest place within a range of a path, for each point.

    Args:
        points: Points, padded to space [m], (n, 3).
        ranges: Arc lengths at which the range of each point starts and ends [m], (n, 2).
        windows: First and last segment of that range, (n, 2).
        rows: Segments of the path from `pack`, (m, 12).
    """
    distance = np.full(len(points), np.inf)
    s = np.zeros(len(points))
    for i in range(len(points)):
        for j in range(windows[i, 0], windows[i, 1] + 1):
            g = rows[j]
            low = min(max(ranges[i, 0] - g[11], 0.0), g[10])
            high = min(max(ranges[i, 1] - g[11], low), g[10])
            d2, u = nearest_within(points[i], g, low, high)
            if math.sqrt(d2) < distance[i]:
                distance[i], s[i] = math.sqrt(d2), g[11] + u
    return distance, s


@compiled(inner=True)
def _put_point(g: FloatArray, u: float, p: FloatArray) -> None:
    """Write the point at distance u along segment g into p."""
    along, across = offsets(g[9], u)
    for axis in range(3):
        p[axis] = g[axis] + along * g[3 + axis] + across * g[6 + axis]


@compiled(inner=True)
def _own_part(g: FloatArray, place: float, reach: float) -> tuple[float, float]:
    """Part of a piece within reach of a place, as distances along it; empty if low > high."""
    return max(place - reach - g[11], 0.0), min(place + reach - g[11], g[10])


@compiled(inner=True)
def _normal_gap(g: FloatArray, u: float, h: FloatArray, v: float) -> Any:
    """Distance between the unit normals of two arcs at distances u and v along them."""
    cg, sg = math.cos(g[9] * u), math.sin(g[9] * u)
    ch, sh = math.cos(h[9] * v), math.sin(h[9] * v)
    total = 0.0
    for axis in range(3):
        gap = cg * g[6 + axis] - sg * g[3 + axis] - ch * h[6 + axis] + sh * h[3 + axis]
        total += gap * gap
    return math.sqrt(total)


@compiled(inner=True)
def _plane_gap(g: FloatArray, h: FloatArray) -> Any:
    """Distance between the unit vectors about which the tangents of two arcs turn."""
    total = 0.0
    for axis in range(3):
        a, b = (axis + 1) % 3, (axis + 2) % 3
        gap = g[3 + a] * g[6 + b] - g[3 + b] * g[6 + a] - h[3 + a] * h[6 + b] + h[3 + b] * h[6 + a]
        total += gap * gap
    return math.sqrt(total)


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
    apart = max(_normal_gap(g, u0, h, v0), _normal_gap(g, u1, h, v1))
    if apart > 1.0:
        return (bend_g + bend_h) / 8
    tilt = 2 * abs(turn_h) * _plane_gap(g, h)
    apart += min((turn_g * turn_g + turn_h * turn_h) / 8, tilt)
    return (abs(bend_g - bend_h) + min(bend_g, bend_h) * apart) / 8


@compiled(inner=True)
def _judge(
    g: FloatArray,
    part: FloatArray,
    window: IntArray,
    pieces: FloatArray,
    tolerance: FloatArray,
    given_up: BoolArray,
    points: FloatArray,
) -> tuple[float, float, float, float]:
    """Excess at both ends of a part of a path segment, and a bound of it over the whole part.

    Args:
        g: The path segment's row of `pack`.
        part: Distance along the segment, place and reach at its start, then at its end [m], (6,).
        window: First and last piece within reach of any of its places, (2,).
        pieces: Pieces from `pack`, (m, 12).
        tolerance: Tolerances of the pieces [m], (m,).
        given_up: Whether each piece gives up its start, and its end, to a neighbour, (m, 2).
        points: Room for two points, (2, 3).

    Returns:
        Excess at the start, at the end, the bound, and the tolerance of its piece [m].
    """
    u0, u1 = part[0], part[3]
    _put_point(g, u0, points[0])
    _put_point(g, u1, points[1])
    at_start, at_end, bound, own = np.inf, np.inf, np.inf, 0.0
    for j in range(window[0], window[1] + 1):
        h = pieces[j]
        low0, high0 = _own_part(h, part[1], part[2])
        low1, high1 = _own_part(h, part[4], part[5])
        d0, v0, d1, v1 = np.inf, 0.0, np.inf, 0.0
        if low0 <= high0:
            d2, v0 = nearest_within(points[0], h, low0, high0)
            if _owns(v0, h, given_up[j]):
                d0 = math.sqrt(d2) - tolerance[j]
            at_start = min(at_start, d0)
        if low1 <= high1:
            d2, v1 = nearest_within(points[1], h, low1, high1)
            if _owns(v1, h, given_up[j]):
                d1 = math.sqrt(d2) - tolerance[j]
            at_end = min(at_end, d1)
        if low0 <= high0 and low1 <= high1 and max(d0, d1) < bound:
            found = max(d0, d1) + bulge(g, u0, u1, h, v0, v1)
            if found < bound:
                bound, own = found, tolerance[j]
    return at_start, at_end, bound, own


@compiled()
def bound_excess(
    rows: FloatArray,
    segment: IntArray,
    parts: FloatArray,
    windows: IntArray,
    pieces: FloatArray,
    tolerance: FloatArray,
    given_up: BoolArray,
    slack: float,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Bounds of distance less tolerance over parts of a path, and the largest values found.

    Args:
        rows: Segments of the path from `pack`, (n, 12).
        segment: The segment of each part, (k,).
        parts: As in `_judge`, (k, 6).
        windows: As in `_judge`, (k, 2).
        pieces: Pieces from `pack`, (m, 12).
        tolerance: Tolerances of the pieces [m], (m,).
        given_up: As in `_judge`, (m, 2).
        slack: A bound up to this is not made any closer [m].

    Returns:
        The bounds and the values found [m], and where these are, as arc lengths on the path [m],
        (k,) each.
    """
    n = len(parts)
    bounds, found, where = np.full(n, -np.inf), np.full(n, -np.inf), np.zeros(n)
    points = np.empty((2, 3))
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
            at_start, at_end, bound, own = _judge(
                g, part, windows[i], pieces, tolerance, given_up, points
            )
            at_ends = max(at_start, at_end)
            if at_ends > found[i]:
                found[i] = at_ends
                where[i] = g[11] + (part[0] if at_start >= at_end else part[3])
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
