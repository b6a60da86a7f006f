"""Compiled points of lines and arcs, and their nearest points; a row of a table is a segment.

The rows are those of `nearest.pack`: start (3), tangent (3), normal (3), curvature, length, arc
length at the start, end (3), sine and cosine of the turn. Points are tuples of three coordinates.
"""

from __future__ import annotations

import math
from typing import NamedTuple, TypeAlias

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour._kernels import FUSED, compiled

Point: TypeAlias = tuple[float, float, float]
# Nodes of a tree that wait while another one is searched: one for each level.
STACK = 128
# A search along the path goes on beyond its window from vertex to vertex as long as they are closer
# to the point than this many times its distance from the first segment.
REACH = 5.0


class Foot(NamedTuple):
    """A point relative to a segment.

    Attributes:
        off2: Squared distance from the segment's line or full circle [m²].
        at: Nearest place on that line or circle, as a distance along the segment [m]; on a circle
            less than half a turn from the start.
        product: Product of the radii of circle and point [m²]; 0 for a line.
    """

    off2: float
    at: float
    product: float


@compiled(inner=True, fastmath=FUSED, inline="always")
def _see(p: Point, g: FloatArray) -> Point:
    """Squared distance of a point from the line or full circle of segment `g`, and its direction.

    The direction is the distance along a line [m] and 0; for a circle sine and cosine of the angle
    around the centre, times the ratio of the radii of point and circle.
    """
    x, y, z = p[0] - g[0], p[1] - g[1], p[2] - g[2]
    along, k = x * g[3] + y * g[4] + z * g[5], g[9]
    if k == 0.0:
        x, y, z = x - along * g[3], y - along * g[4], z - along * g[5]
        return x * x + y * y + z * z, along, 0.0
    across = x * g[6] + y * g[7] + z * g[8]
    a, b = k * along, 1 - k * across
    # The difference of both radii without cancellation.
    radial = (2 * across - k * (along * along + across * across)) / (1 + math.sqrt(a * a + b * b))
    x -= along * g[3] + across * g[6]
    y -= along * g[4] + across * g[7]
    z -= along * g[5] + across * g[8]
    return x * x + y * y + z * z + radial * radial, a, b


@compiled(inner=True, fastmath=FUSED)
def _gap2(p: Point, g: FloatArray) -> float:
    """Squared distance of a point from segment `g`, without evaluation of angles [m²]."""
    off2, a, b = _see(p, g)
    if g[9] == 0.0:
        inside = 0.0 <= a <= g[10]
    elif g[9] * g[10] < math.pi:
        inside = a >= 0.0 and a * g[16] <= b * g[15]
    else:
        inside = a >= 0.0 or a * g[16] <= b * g[15]
    return off2 if inside else min(_end_gap2(p, g, 0), _end_gap2(p, g, 12))


@compiled(inner=True, fastmath=FUSED)
def _end_gap2(p: Point, g: FloatArray, column: int) -> float:
    """Squared distance of a point from an end of segment `g`, whose first column is given [m²]."""
    x, y, z = p[0] - g[column], p[1] - g[column + 1], p[2] - g[column + 2]
    return float(x * x + y * y + z * z)


@compiled(inner=True, fastmath=FUSED)
def find_foot(p: Point, g: FloatArray) -> Foot:
    """The foot of a point on the line or circle of segment `g`."""
    off2, a, b = _see(p, g)
    k = g[9]
    if k == 0.0:
        return Foot(off2, a, 0.0)
    return Foot(off2, math.atan2(a, b) / k, math.sqrt(a * a + b * b) / (k * k))


@compiled(inner=True, fastmath=FUSED)
def distance2(foot: Foot, k: float, u: float) -> float:
    """Squared distance to the place at distance u along a segment of curvature k [m²]."""
    if k == 0.0:
        return foot.off2 + (u - foot.at) ** 2
    return foot.off2 + 4 * foot.product * math.sin(k * (u - foot.at) / 2) ** 2


@compiled(inner=True, fastmath=FUSED)
def nearest_within(p: Point, g: FloatArray, low: float, high: float) -> tuple[float, float]:
    """Squared distance to a part of segment `g`, and the distance along it of the nearest point.

    Args:
        p: The point [m].
        g: The segment's row of `pack`, (17,).
        low: Distance along the segment at which the part starts [m].
        high: Distance along the segment at which the part ends [m].
    """
    foot, k = find_foot(p, g), g[9]
    u = foot.at
    if k != 0.0 and u < low and u + 2 * math.pi / k <= high:
        u += 2 * math.pi / k
    if low <= u <= high:
        return foot.off2, u
    at_low, at_high = distance2(foot, k, low), distance2(foot, k, high)
    return (at_high, high) if at_high < at_low else (at_low, low)


@compiled(inner=True)
def point_at(g: FloatArray, u: float) -> Point:
    """The point at distance u along segment `g` [m]."""
    along, across, k = u, 0.0, g[9]
    if k != 0.0:
        half = math.sin(k * u / 2)
        along, across = math.sin(k * u) / k, 2 * half * half / k
    return (
        g[0] + along * g[3] + across * g[6],
        g[1] + along * g[4] + across * g[7],
        g[2] + along * g[5] + across * g[8],
    )


@compiled(inner=True)
def _box_gap2(p: Point, boxes: FloatArray, node: int) -> float:
    """Squared distance from a point to box `node`."""
    x = max(boxes[node, 0] - p[0], p[0] - boxes[node, 3], 0.0)
    y = max(boxes[node, 1] - p[1], p[1] - boxes[node, 4], 0.0)
    z = max(boxes[node, 2] - p[2], p[2] - boxes[node, 5], 0.0)
    return float(x * x + y * y + z * z)


@compiled()
def search_tree(
    queries: FloatArray, rows: FloatArray, pieces: IntArray, boxes: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Distance and arc length of the nearest point for each query, by a tree.

    Args:
        queries: Query points, padded to space [m], (n, 3).
        rows: Segments from `pack`, (segments, 17).
        pieces: Index of the segment of each piece, in tree order.
        boxes: Lower and upper corners of the nodes' boxes in heap order, (2 m - 1, 6).
    """
    n, leaves = len(queries), (len(boxes) + 1) // 2
    distance, s = np.empty(n), np.empty(n)
    stack, bound = np.empty(STACK, np.intp), np.empty(STACK)
    found = pieces[0]
    for i in range(n):
        p = queries[i, 0], queries[i, 1], queries[i, 2]
        # The segment of the last query is a good first guess, as queries mostly follow a motion.
        best = _gap2(p, rows[found])
        depth, stack[0], bound[0] = 0, 0, _box_gap2(p, boxes, 0)
        while depth >= 0:
            node = stack[depth]
            depth -= 1
            if bound[depth + 1] >= best:
                continue
            if node >= leaves - 1:
                leaf, previous = node - (leaves - 1), -1
                for j in range(leaf * len(pieces) // leaves, (leaf + 1) * len(pieces) // leaves):
                    if pieces[j] != previous:
                        previous = pieces[j]
                        d2 = _gap2(p, rows[previous])
                        if d2 < best:
                            best, found = d2, previous
                continue
            # The nearer one of both halves is searched first.
            near = 2 * node + 1
            gap2, other = _box_gap2(p, boxes, near), _box_gap2(p, boxes, near + 1)
            step = 1
            if other < gap2:
                near, step, gap2, other = near + 1, -1, other, gap2
            if other < best:
                depth += 1
                stack[depth], bound[depth] = near + step, other
            if gap2 < best:
                depth += 1
                stack[depth], bound[depth] = near, gap2
        distance[i] = math.sqrt(best)
        s[i] = rows[found, 11] + nearest_within(p, rows[found], 0.0, rows[found, 10])[1]
    return distance, s


@compiled(fastmath=FUSED)
def search_along(
    p: Point, rows: FloatArray, around: float, segment: int, low: float, high: float
) -> tuple[float, int]:
    """Squared distance of a point from the path near a segment, and the segment of the place.

    The search covers a window of arc lengths, and beyond it goes up to a vertex that is further
    away than `REACH` allows. A point that is closer than the best distance d is at least D - d
    further along the path than a vertex at the distance D, because arc length grows at least as
    fast as distance; segments before that are skipped.

    Args:
        p: The point [m].
        rows: Segments from `pack`, (n, 17).
        around: Length of a closed path, on which the search passes the start point; 0 for an open
            path [m].
        segment: The segment at which the search starts.
        low: Smallest arc length of the window [m].
        high: Largest arc length of the window [m].
    """
    n = len(rows)
    best = _gap2(p, rows[segment])
    found, far2 = segment, REACH * REACH * best
    for ahead in (True, False):
        stop, near, far = (high, 0, 12) if ahead else (-low, 12, 0)
        end = rows[segment, 11] + rows[segment, 10] if ahead else -rows[segment, 11]
        if end > stop and _end_gap2(p, rows[segment], far) > far2:
            continue
        j, turn, free, d = segment, 0.0, -math.inf, math.sqrt(best)
        for _ in range(n - 1):
            j += 1 if ahead else -1
            if j == n or j < 0:
                if around == 0.0:
                    break
                j = 0 if ahead else n - 1
                turn += around
            length = rows[j, 10]
            begin = turn + (rows[j, 11] if ahead else -rows[j, 11] - length)
            if begin <= stop and begin + length <= free:
                continue
            gap2 = _end_gap2(p, rows[j], near)
            if begin > stop and gap2 > far2:
                break
            free = max(free, begin + math.sqrt(gap2) - d)
            if begin + length <= free:
                continue
            d2 = _gap2(p, rows[j])
            if d2 < best:
                best, found, d = d2, j, math.sqrt(d2)
    return best, found
