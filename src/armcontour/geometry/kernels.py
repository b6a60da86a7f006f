"""Compiled functions: nearest points of lines and arcs, and distances within a tube.

Segments are rows of `projection.pack_segments`: start (3), tangent (3), normal (3), curvature,
length, arc length at the start, end (3). Points are tuples of three coordinates. In the formulas, a
segment has the start `a`, unit tangent `T` and unit normal `N` there, curvature `k` and, if it is
an arc, the radius `R = 1/k`.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.core.kernel_cache import FUSED, compiled

Point: TypeAlias = tuple[float, float, float]
# Stack size for a tree search, in which at most one node per level waits.
STACK = 128
# A part of a path is halved at most DEPTH times, and at most PARTS of its parts are evaluated.
DEPTH = 48
PARTS = 20_000
# Where the tolerance is exceeded, a bound is accepted if it exceeds the largest value at points by
# less than CLOSE times the tolerance. Elsewhere a bound is refined up to rounding errors, with at
# most FINE halvings per part on average.
CLOSE = 1e-6
FINE = 50


class Foot(NamedTuple):
    """Position of a point relative to the line or full circle of a segment; see `find_foot`."""

    off2: float  # Squared distance from the segment's line or full circle [m²]
    # Distance of the nearest point along a line [m]; for a circle the sine of the angle around the
    # centre, times R_p / R
    along: float
    across: float  # 0 for a line; for a circle the cosine of this angle, times the same ratio


@compiled(inner=True, fastmath=FUSED, forceinline=True)
def find_foot(p: Point, g: FloatArray) -> Foot:
    """Return the position of a point p relative to the line or full circle of segment `g`.

    With v = p - a, for a line

        along = v . T,  off² = |v - along T|²

    and for a circle, with A = k v . T and B = 1 - k v . N, the point is at the angle atan2(A, B)
    from the start, at the distance R_p = R sqrt(A² + B²) from the axis of the circle, and

        off² = |v - (v . T) T - (v . N) N|² + (R - R_p)²
    """
    # Components of the vector from the start.
    x = p[0] - g[0]
    y = p[1] - g[1]
    z = p[2] - g[2]
    along = x * g[3] + y * g[4] + z * g[5]
    k = g[9]
    if k == 0.0:
        # Line: remove the component along it.
        x = x - along * g[3]
        y = y - along * g[4]
        z = z - along * g[5]
        return Foot(x * x + y * y + z * z, along, 0.0)
    across = x * g[6] + y * g[7] + z * g[8]
    a = k * along
    b = 1 - k * across
    # R - R_p = (1 - A² - B²) / (k (1 + sqrt(A² + B²))), without cancellation.
    radial = (2 * across - k * (along * along + across * across)) / (1 + math.sqrt(a * a + b * b))
    # Component perpendicular to the circle's plane.
    x -= along * g[3] + across * g[6]
    y -= along * g[4] + across * g[7]
    z -= along * g[5] + across * g[8]
    return Foot(x * x + y * y + z * z + radial * radial, a, b)


@compiled(inner=True, fastmath=FUSED)
def distance2(foot: Foot, k: float, away: float) -> float:
    """Return the squared distance from p to the point of the segment at `away` from its foot [m²].

    For a line this is off² + away², and for a circle, by the law of cosines,

        off² + 4 R R_p sin²(k away / 2)

    - `k`: the curvature [1/m].
    - `away`: distance along the line or circle from the foot [m].
    """
    if k == 0.0:
        return foot.off2 + away**2
    # R R_p
    product = math.sqrt(foot.along * foot.along + foot.across * foot.across) / (k * k)
    return foot.off2 + 4 * product * math.sin(k * away / 2) ** 2


@compiled(inner=True, fastmath=FUSED, forceinline=True)
def nearest_within(
    p: Point, g: FloatArray, low: float, high: float, limit: float
) -> tuple[float, float]:
    """Return the squared distance from p to a part of `g` [m²], and where its nearest point is.

    The second result is the distance of this point along `g` [m]. The nearest point is the foot if
    it lies in the part. Else it is the nearer end, because the distance along a line or an arc of
    at most a full turn has no other local minimum.

    `low`, `high`: ends of the part along the segment [m]. A squared distance that is at least
    `limit` [m²] is only a lower bound.
    """
    # Foot on the line or circle.
    foot = find_foot(p, g)
    k = g[9]
    if foot.off2 >= limit:
        return foot.off2, low
    # Its distance along the segment; on a circle, modulo a full turn.
    u = foot.along
    if k != 0.0:
        u = math.atan2(foot.along, foot.across) / k
        if u < low and u + 2 * math.pi / k <= high:
            u += 2 * math.pi / k
    if low <= u <= high:
        return foot.off2, u
    # The nearer end.
    at_low = distance2(foot, k, u - low)
    at_high = distance2(foot, k, u - high)
    return (at_high, high) if at_high < at_low else (at_low, low)


@compiled(inner=True)
def point_at(g: FloatArray, u: float) -> Point:
    """Return the point at distance u along segment `g` [m].

    It is a + u T on a line, and a + sin(k u) / k T + (1 - cos(k u)) / k N on an arc, where
    1 - cos(k u) = 2 sin²(k u / 2) has no cancellation.
    """
    along = u
    across = 0.0
    k = g[9]
    if k != 0.0:
        half = math.sin(k * u / 2)
        along = math.sin(k * u) / k
        across = 2 * half * half / k
    return (
        g[0] + along * g[3] + across * g[6],
        g[1] + along * g[4] + across * g[7],
        g[2] + along * g[5] + across * g[8],
    )


@compiled(inner=True, forceinline=True)
def box_gap2(p: Point, boxes: FloatArray, k: int) -> float:
    """Return the squared distance from a point to the box `boxes[k]` [m²], 0 inside the box."""
    x: float = max(boxes[k, 0] - p[0], p[0] - boxes[k, 3], 0.0)
    y: float = max(boxes[k, 1] - p[1], p[1] - boxes[k, 4], 0.0)
    z: float = max(boxes[k, 2] - p[2], p[2] - boxes[k, 5], 0.0)
    return x * x + y * y + z * z


@compiled()
def search_tree(
    queries: FloatArray, rows: FloatArray, pieces: IntArray, boxes: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the distance and arc length of the nearest point for each query [m], (n,) each.

    A depth-first search with pruning (Roussopoulos, Kelley and Vincent, "Nearest neighbor queries",
    SIGMOD 1995): it visits the nearer child first, and skips nodes whose boxes are farther than the
    nearest point found so far.

    - `queries`: points in space [m], (n, 3).
    - `rows`: segments from `pack_segments`.
    - `pieces`: index of each piece's segment, in tree order.
    - `boxes`: lower and upper corners of the nodes' boxes in heap order [m], (2 m - 1, 6) for m
      leaves.
    """
    n = len(queries)
    leaves = (len(boxes) + 1) // 2
    distance = np.empty(n)
    s = np.empty(n)
    stack = np.empty(STACK, np.intp)
    bound = np.empty(STACK)
    segment = pieces[0]
    for i in range(n):
        p = queries[i, 0], queries[i, 1], queries[i, 2]
        # The segment of the last query is a good first guess, because queries are sorted.
        best, u = nearest_within(p, rows[segment], 0.0, rows[segment, 10], math.inf)
        depth = 0
        stack[0] = 0
        bound[0] = 0.0
        while depth >= 0:
            # Take the last waiting node.
            node = stack[depth]
            gap2 = bound[depth]
            depth -= 1
            # Descend to the nearest leaf; push the other child of each node on the stack.
            while node < leaves - 1 and gap2 < best:
                node, other = 2 * node + 1, 2 * node + 2
                gap2 = box_gap2(p, boxes, node)
                far2 = box_gap2(p, boxes, other)
                if far2 < gap2:
                    node, gap2, other, far2 = other, far2, node, gap2
                if far2 < best:
                    depth += 1
                    stack[depth] = other
                    bound[depth] = far2
            if gap2 >= best:
                continue
            # Compare the segments of the leaf; consecutive pieces can belong to one segment.
            leaf = node - (leaves - 1)
            previous = -1
            for j in range(leaf * len(pieces) // leaves, (leaf + 1) * len(pieces) // leaves):
                if pieces[j] != previous:
                    previous = pieces[j]
                    g = rows[previous]
                    d2, along = nearest_within(p, g, 0.0, g[10], best)
                    if d2 < best:
                        best = d2
                        u = along
                        segment = previous
        distance[i] = math.sqrt(best)
        s[i] = rows[segment, 11] + u
    return distance, s


class TubePieces(NamedTuple):
    """The m pieces of a tube with their tolerances."""

    rows: FloatArray  # The pieces from `pack_segments`, (m, 15)
    tolerance: FloatArray  # Tolerance of each piece [m], (m,)
    # True if points at the start, and at the end, of each piece belong to a neighbour with a
    # smaller tolerance, (m, 2)
    excluded_ends: BoolArray


@compiled(inner=True)
def _excess(p: Point, pieces: TubePieces, j: int, low: float, high: float) -> tuple[float, float]:
    """Return the distance of p from a part of piece j minus the tolerance [m].

    The second result is the distance of the nearest point along the piece [m]. The first result
    is infinite if the part is empty or the point belongs to a neighbouring piece.

    - `low`, `high`: ends of the part along the piece [m].
    """
    if low > high:
        return math.inf, 0.0
    g = pieces.rows[j]
    d2, u = nearest_within(p, g, low, high, math.inf)
    if (pieces.excluded_ends[j, 0] and u <= 0.0) or (pieces.excluded_ends[j, 1] and u >= g[10]):
        return math.inf, u
    return math.sqrt(d2) - pieces.tolerance[j], u


@compiled()
def find_excess(
    points: FloatArray, ranges: FloatArray, windows: IntArray, pieces: TubePieces
) -> tuple[FloatArray, FloatArray]:
    """Return the smallest distance minus tolerance in each point's range, and its arc length.

    All pieces of a range are compared, because a range has few.

    - `points`: points in space [m], (n, 3).
    - `ranges`: arc lengths at which each point's range starts and ends [m], (n, 2).
    - `windows`: indices of the first and last piece of each range, (n, 2).
    """
    excess = np.full(len(points), np.inf)
    s = np.zeros(len(points))
    for i in range(len(points)):
        p = points[i, 0], points[i, 1], points[i, 2]
        for j in range(windows[i, 0], windows[i, 1] + 1):
            # The part of the piece within the range.
            g = pieces.rows[j]
            low = min(max(ranges[i, 0] - g[11], 0.0), g[10])
            high = min(max(ranges[i, 1] - g[11], low), g[10])
            candidate, u = _excess(p, pieces, j, low, high)
            if candidate < excess[i]:
                excess[i] = candidate
                s[i] = g[11] + u
    return excess, s


@compiled()
def bound_bulge(g: FloatArray, u0: float, u1: float, h: FloatArray, v0: float, v1: float) -> Any:
    """Bound the distance between matched parts, minus the larger distance at their ends [m].

    One part runs evenly from u0 to u1 along `g`, and the other from v0 to v1 along `h`. With their
    lengths l and l', the second derivative of their difference, divided by 8, is at most

        (|k l² - k' l'²| + min(k l², k' l'²) max |n - n'|) / 8

    where max |n - n'| is at most its larger value at the ends plus the smaller of
    ((k l)² + (k' l')²) / 8 and 2 k' l' |b - b'|; see tube.py. Without a useful bound of |n - n'| it
    is (k l² + k' l'²) / 8.
    """
    # Turns k l and second derivatives k l² of both parts.
    turn_g = g[9] * (u1 - u0)
    turn_h = h[9] * (v1 - v0)
    bend_g = turn_g * (u1 - u0)
    bend_h = turn_h * (v1 - v0)
    if bend_g == 0.0 or bend_h == 0.0 or abs(turn_g) + abs(turn_h) > 1.0:
        return (bend_g + bend_h) / 8
    # Squared difference |n - n'|² of the unit normals, the larger one of both ends.
    apart2 = 0.0
    # Squared difference |b - b'|² of the axes about which the tangents turn.
    plane2 = 0.0
    for u, v in ((u0, v0), (u1, v1)):
        cg = math.cos(g[9] * u)
        sg = math.sin(g[9] * u)
        ch = math.cos(h[9] * v)
        sh = math.sin(h[9] * v)
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


class PartBound(NamedTuple):
    """Distance minus tolerance on a part of a path [m]."""

    at_ends: float  # Larger of the values at both ends
    bound: float  # Upper bound of the values on the whole part
    tolerance: float  # Tolerance of the piece to which the bound belongs [m]


@compiled(inner=True)
def _bound_part(
    g: FloatArray, part: FloatArray, first: int, last: int, pieces: TubePieces
) -> PartBound:
    """Bound distance minus tolerance on a part of segment `g` [m].

    For every piece, the bound is the larger value at the ends plus `bound_bulge`; the part has the
    smallest of these bounds.

    - `part`: as in `bound_excess`, (6,).
    - `first`, `last`: first and last piece within reach.
    """
    u0 = part[0]
    u1 = part[3]
    p = point_at(g, u0)
    q = point_at(g, u1)
    at_start = np.inf
    at_end = np.inf
    bound = np.inf
    tolerance = 0.0
    for j in range(first, last + 1):
        # The piece's parts within reach of both ends.
        h = pieces.rows[j]
        low = max(part[1] - part[2] - h[11], 0.0), max(part[4] - part[5] - h[11], 0.0)
        high = min(part[1] + part[2] - h[11], h[10]), min(part[4] + part[5] - h[11], h[10])
        # Values at the start and at the end.
        d0, v0 = _excess(p, pieces, j, low[0], high[0])
        d1, v1 = _excess(q, pieces, j, low[1], high[1])
        at_start = min(at_start, d0)
        at_end = min(at_end, d1)
        # Bound between them.
        if max(d0, d1) < bound:
            candidate = max(d0, d1) + bound_bulge(g, u0, u1, h, v0, v1)
            if candidate < bound:
                bound = candidate
                tolerance = pieces.tolerance[j]
    return PartBound(max(at_start, at_end), bound, tolerance)


@compiled(inner=True)
def _halve(stack: FloatArray, top: int, part: FloatArray) -> None:
    """Write the halves of `part`, which is `stack[top + 1]`, to the stack: the first one on top."""
    for c in range(3):
        middle = (part[c] + part[3 + c]) / 2
        stack[top + 2, c] = part[c]
        stack[top + 2, 3 + c] = middle
        stack[top + 1, c] = middle


@compiled()
def bound_excess(
    rows: FloatArray,  # Segments of the path from `pack_segments`, (n, 15)
    segment: IntArray,  # Index of the segment of each part, (k,)
    parts: FloatArray,
    windows: IntArray,  # First and last piece within reach of each part, (k, 2)
    pieces: TubePieces,
    slack: float,  # A bound up to this is not refined [m]
) -> FloatArray:
    """Return upper bounds of distance minus tolerance on parts of a path [m], (k,).

    Adaptive bisection: a part is halved until its bound is proven, that is not above `slack` or the
    largest value found at points so far, or near enough to the value at its ends. The bound and its
    proof are in tube.py.

    `parts` are the distance along the segment, arc length on the objective and reach at the start
    of each part, then at its end [m], (k, 6).
    """
    n = len(parts)
    bounds = np.full(n, -np.inf)
    stack = np.empty((DEPTH + 2, 6))
    depths = np.empty(DEPTH + 2, np.intp)
    enough = slack
    remaining = FINE * (n + 1000)
    for i in range(n):
        g = rows[segment[i]]
        # Start with the whole part. Numba compiles an assigned row for seconds.
        for c in range(6):
            stack[0, c] = parts[i, c]
        depths[0] = 0
        top = 0
        count = 0
        while top >= 0:
            # Take the last waiting part, and bound it.
            part = stack[top]
            depth = depths[top]
            top -= 1
            count += 1
            found = _bound_part(g, part, windows[i, 0], windows[i, 1], pieces)
            # Accept its bound, or halve the part.
            enough = max(enough, found.at_ends)
            remaining -= 1
            fine = found.at_ends <= slack / 2 and remaining > 0
            close = found.bound - found.at_ends <= (slack / 2 if fine else CLOSE * found.tolerance)
            if found.bound <= enough or close or depth == DEPTH or count > PARTS:
                bounds[i] = max(bounds[i], found.bound)
                continue
            _halve(stack, top, part)
            depths[top + 1] = depths[top + 2] = depth + 1
            top += 2
    return bounds
