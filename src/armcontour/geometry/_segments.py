"""Compiled points of lines and arcs, and their nearest points; a row of a table is a segment.

The rows are those of `nearest.pack`: start (3), tangent (3), normal (3), curvature, length, arc
length at the start, end (3). Points are tuples of three coordinates.
"""

from __future__ import annotations

import math
from typing import NamedTuple, TypeAlias

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.kernels import FUSED, compiled

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
        along: Distance of the nearest place along a line [m]; for a circle the sine of the angle
            around the centre, times the ratio of the radii of point and circle.
        across: 0 for a line; for a circle the cosine of this angle, times the same ratio.
    """

    off2: float
    along: float
    across: float


@compiled(inner=True, fastmath=FUSED, forceinline=True)
def find_foot(p: Point, g: FloatArray) -> Foot:
    """The foot of a point on the line or full circle of segment `g`."""
    x, y, z = p[0] - g[0], p[1] - g[1], p[2] - g[2]
    along, k = x * g[3] + y * g[4] + z * g[5], g[9]
    if k == 0.0:
        x, y, z = x - along * g[3], y - along * g[4], z - along * g[5]
        return Foot(x * x + y * y + z * z, along, 0.0)
    across = x * g[6] + y * g[7] + z * g[8]
    a, b = k * along, 1 - k * across
    # The difference of both radii without cancellation.
    radial = (2 * across - k * (along * along + across * across)) / (1 + math.sqrt(a * a + b * b))
    x -= along * g[3] + across * g[6]
    y -= along * g[4] + across * g[7]
    z -= along * g[5] + across * g[8]
    return Foot(x * x + y * y + z * z + radial * radial, a, b)


@compiled(inner=True, fastmath=FUSED)
def distance2(foot: Foot, k: float, away: float) -> float:
    """Squared distance to the place of a segment of curvature k that is so far from the foot [m²].

    Args:
        foot: The foot.
        k: The curvature [1/m].
        away: Distance along the segment from the foot [m].
    """
    if k == 0.0:
        return foot.off2 + away**2
    # The product of the radii of circle and point.
    product = math.sqrt(foot.along * foot.along + foot.across * foot.across) / (k * k)
    return foot.off2 + 4 * product * math.sin(k * away / 2) ** 2


@compiled(inner=True, fastmath=FUSED, forceinline=True)
def nearest_within(
    p: Point, g: FloatArray, low: float, high: float, most: float
) -> tuple[float, float]:
    """Squared distance to a part of segment `g`, and the distance along it of the nearest point.

    Args:
        p: The point [m].
        g: The segment's row of `pack`, (15,).
        low: Distance along the segment at which the part starts [m].
        high: Distance along the segment at which the part ends [m].
        most: Squared distance from which on any distance at least as large is a result [m²].
    """
    foot, k = find_foot(p, g), g[9]
    if foot.off2 >= most:
        return foot.off2, low
    u = foot.along
    if k != 0.0:
        u = math.atan2(foot.along, foot.across) / k
        if u < low and u + 2 * math.pi / k <= high:
            u += 2 * math.pi / k
    if low <= u <= high:
        return foot.off2, u
    at_low, at_high = distance2(foot, k, u - low), distance2(foot, k, u - high)
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


@compiled(inner=True, forceinline=True)
def box_gap2(p: Point, boxes: FloatArray, k: int) -> float:
    """Squared distance of a point to box k [m²], 0 inside it."""
    x: float = max(boxes[k, 0] - p[0], p[0] - boxes[k, 3], 0.0)
    y: float = max(boxes[k, 1] - p[1], p[1] - boxes[k, 4], 0.0)
    z: float = max(boxes[k, 2] - p[2], p[2] - boxes[k, 5], 0.0)
    return x * x + y * y + z * z


@compiled()
def search_tree(
    queries: FloatArray, rows: FloatArray, pieces: IntArray, boxes: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Distance and arc length of the nearest point for each query, by a tree.

    Args:
        queries: Query points, padded to space [m], (n, 3).
        rows: Segments from `pack`, (segments, 15).
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
        best, u = nearest_within(p, rows[found], 0.0, rows[found, 10], math.inf)
        depth, stack[0], bound[0] = 0, 0, 0.0
        while depth >= 0:
            node, gap2 = stack[depth], bound[depth]
            depth -= 1
            # Down to the nearest leaf; the other half of each node waits.
            while node < leaves - 1 and gap2 < best:
                node, other = 2 * node + 1, 2 * node + 2
                gap2, far2 = box_gap2(p, boxes, node), box_gap2(p, boxes, other)
                if far2 < gap2:
                    node, gap2, other, far2 = other, far2, node, gap2
                if far2 < best:
                    depth += 1
                    stack[depth], bound[depth] = other, far2
            if gap2 >= best:
                continue
            leaf, previous = node - (leaves - 1), -1
            for j in range(leaf * len(pieces) // leaves, (leaf + 1) * len(pieces) // leaves):
                if pieces[j] != previous:
                    previous = pieces[j]
                    g = rows[previous]
                    d2, at = nearest_within(p, g, 0.0, g[10], best)
                    if d2 < best:
                        best, u, found = d2, at, previous
        distance[i], s[i] = math.sqrt(best), rows[found, 11] + u
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
        rows: Segments from `pack`, (n, 15).
        around: Length of a closed path, on which the search passes the start point; 0 for an open
            path [m].
        segment: The segment at which the search starts.
        low: Smallest arc length of the window [m].
        high: Largest arc length of the window [m].
    """
    n = len(rows)
    best, _ = nearest_within(p, rows[segment], 0.0, rows[segment, 10], math.inf)
    found, far2 = segment, REACH * REACH * best
    for ahead in (True, False):
        stop, near = (high, 0) if ahead else (-low, 12)
        j, turn, free, d = segment, 0.0, -math.inf, math.sqrt(best)
        for _ in range(n - 1):
            j += 1 if ahead else -1
            if not 0 <= j < n:
                if around == 0.0:
                    break
                j = 0 if ahead else n - 1
                turn += around
            g = rows[j]
            begin = turn + (g[11] if ahead else -g[11] - g[10])
            end = begin + g[10]
            if begin <= stop and end <= free:
                continue
            x, y, z = p[0] - g[near], p[1] - g[near + 1], p[2] - g[near + 2]
            gap2 = x * x + y * y + z * z
            if begin > stop and gap2 > far2:
                break
            free = max(free, begin + math.sqrt(gap2) - d)
            if end <= free:
                continue
            d2, _ = nearest_within(p, g, 0.0, g[10], best)
            if d2 < best:
                best, found, d = d2, j, math.sqrt(d2)
    return best, found
