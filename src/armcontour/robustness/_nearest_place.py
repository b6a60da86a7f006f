"""Compiled search for the nearest point on a path, in a window around the last nearest point."""

from __future__ import annotations

import math

from armcontour._checks import FloatArray
from armcontour._kernels import FUSED, compiled

# Beyond the window the search continues from vertex to vertex as long as the vertices are closer
# to the tool than this many times the tool's distance from the path.
REACH = 5.0


@compiled(inner=True, fastmath=FUSED)
def _to_segment(x: float, y: float, z: float, g: FloatArray, i: int) -> float:
    """Squared distance of a point from segment i of a table g, as `monte_carlo._table` makes it."""
    gx, gy, gz = x - g[i, 0], y - g[i, 1], z - g[i, 2]
    along = gx * g[i, 3] + gy * g[i, 4] + gz * g[i, 5]
    k = g[i, 9]
    if k == 0.0:
        if 0.0 <= along <= g[i, 10]:
            gx, gy, gz = gx - along * g[i, 3], gy - along * g[i, 4], gz - along * g[i, 5]
            return float(gx * gx + gy * gy + gz * gz)
    else:
        inward = gx * g[i, 6] + gy * g[i, 7] + gz * g[i, 8]
        a, b = k * along, 1 - k * inward  # sine and cosine of the angle around the centre
        before_end = a * g[i, 13] - b * g[i, 12] <= 0.0
        inside = (a >= 0.0 and before_end) if g[i, 14] < math.pi else (a >= 0.0 or before_end)
        if inside:
            # Distance from the centre minus the radius, without cancellation.
            around = 1 + math.sqrt(a * a + b * b)
            radial = (k * (along * along + inward * inward) - 2 * inward) / around
            gx -= along * g[i, 3] + inward * g[i, 6]
            gy -= along * g[i, 4] + inward * g[i, 7]
            gz -= along * g[i, 5] + inward * g[i, 8]
            return float(radial * radial + gx * gx + gy * gy + gz * gz)
    return min(_to_joint(x, y, z, g, i, 0), _to_joint(x, y, z, g, i, 15))


@compiled(inner=True, fastmath=FUSED)
def _to_joint(x: float, y: float, z: float, g: FloatArray, i: int, first: int) -> float:
    """Squared distance of a point from an end of segment i.

    `first` is the first column of the end's coordinates: 0 for the start, 15 for the end point.
    """
    gx, gy, gz = x - g[i, first], y - g[i, first + 1], z - g[i, first + 2]
    return float(gx * gx + gy * gy + gz * gz)


@compiled(inner=True, fastmath=FUSED, inline="always")
def _march(
    x: float,
    y: float,
    z: float,
    table: FloatArray,
    around: float,
    segment: int,
    forward: bool,
    stop: float,
    best: float,
) -> tuple[float, int]:
    """Search the nearest point from a segment on in one direction along the path.

    The search covers the arc lengths up to `stop`, and beyond it up to a vertex that is further
    away than `REACH` allows. A point that is closer than the best distance d is at least D - d
    further along the path than a vertex at the distance D, because arc length grows at least as
    fast as distance; segments before that are skipped.

    Args:
        x: Coordinate x of the tool point [m].
        y: Coordinate y of the tool point [m].
        z: Coordinate z of the tool point [m].
        table: The segments, as `monte_carlo._table` makes them.
        around: Length of a closed path, on which the search passes the start point; 0 for an open
            path [m].
        segment: The segment after which, or before which, the search starts.
        forward: Whether the search follows the direction of the path.
        stop: Arc length up to which all segments are searched [m].
        best: Squared distance of the nearest point so far [m²].

    Returns:
        The squared distance, and the segment of the nearest point.
    """
    n = len(table)
    sign = 1.0 if forward else -1.0
    first = 0 if forward else 15
    found, d, turn, free, j = segment, math.sqrt(best), 0.0, -math.inf, segment
    far2 = REACH * REACH * best
    for _ in range(n - 1):
        j += 1 if forward else -1
        if j == n or j < 0:
            if around == 0.0:
                break
            j = 0 if forward else n - 1
            turn += sign * around
        begin = sign * (turn + table[j, 11] + (0.0 if forward else table[j, 10]))
        inside = begin <= sign * stop
        if inside and begin + table[j, 10] <= free:
            continue
        gap2 = _to_joint(x, y, z, table, j, first)
        if not inside and gap2 > far2:
            break
        free = max(free, begin + math.sqrt(gap2) - d)
        if begin + table[j, 10] <= free:
            continue
        d2 = _to_segment(x, y, z, table, j)
        if d2 < best:
            best, found, d = d2, j, math.sqrt(d2)
    return best, found


@compiled(fastmath=FUSED, inline="always")
def find_nearest(
    x: float,
    y: float,
    z: float,
    table: FloatArray,
    around: float,
    segment: int,
    low: float,
    high: float,
) -> tuple[float, int]:
    """Squared distance of a point from the path, and the segment of the nearest point.

    Args:
        x: Coordinate x of the tool point [m].
        y: Coordinate y of the tool point [m].
        z: Coordinate z of the tool point [m].
        table: The segments, as `monte_carlo._table` makes them.
        around: Length of a closed path; 0 for an open path [m].
        segment: The segment at which the search starts.
        low: Smallest arc length that is searched [m]; `_march` may add segments.
        high: Largest arc length that is searched [m].
    """
    best = _to_segment(x, y, z, table, segment)
    found = segment
    far2 = REACH * REACH * best
    begin, end = table[segment, 11], table[segment, 11] + table[segment, 10]
    ahead = end <= high or _to_joint(x, y, z, table, segment, 15) <= far2
    after = begin >= low or _to_joint(x, y, z, table, segment, 0) <= far2
    if ahead:
        best, found = _march(x, y, z, table, around, segment, True, high, best)
    if after:
        less, other = _march(x, y, z, table, around, segment, False, low, best)
        if less < best:
            best, found = less, other
    return best, found
