"""Compiled nearest-point search, in a tree of boxes and in a grid of cells."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour._kernels import compiled


@compiled(inner=True)
def _box_distance2(x: float, y: float, z: float, boxes: FloatArray, node: int) -> Any:
    """Squared distance from a point to box `node`."""
    dx = max(boxes[node, 0] - x, x - boxes[node, 3], 0.0)
    dy = max(boxes[node, 1] - y, y - boxes[node, 4], 0.0)
    dz = max(boxes[node, 2] - z, z - boxes[node, 5], 0.0)
    return dx * dx + dy * dy + dz * dz


@compiled(inner=True)
def offsets(k: float, u: float) -> tuple[float, float]:
    """Tangential and normal coordinates of the point at distance u along a segment.

    Args:
        k: Curvature of the segment [1/m].
        u: Distance along the segment [m].
    """
    angle = k * u
    if abs(angle) > 1e-4:
        half = math.sin(angle / 2)
        return math.sin(angle) / k, 2 * half * half / k
    # This series is exact to rounding errors here, and covers lines.
    return u * (1 - angle * angle / 6), u * angle / 2 * (1 - angle * angle / 12)


@compiled(inner=True)
def point_distance2(p: FloatArray, g: FloatArray, u: float) -> float:
    """Squared distance from `p` to the point at distance `u` along segment `g`."""
    along, across = offsets(g[9], u)
    total = 0.0
    for axis in range(3):
        gap = p[axis] - g[axis] - along * g[3 + axis] - across * g[6 + axis]
        total += gap * gap
    return total


@compiled(inner=True)
def nearest_within(p: FloatArray, g: FloatArray, low: float, high: float) -> tuple[float, float]:
    """Squared distance to a part of segment `g`, and the distance along it of the nearest point.

    Args:
        p: The point, padded to space [m], (3,).
        g: The segment's row of `pack`, (12,).
        low: Distance along the segment at which the part starts [m].
        high: Distance along the segment at which the part ends [m].
    """
    along = 0.0
    across = 0.0
    for axis in range(3):
        gap = p[axis] - g[axis]
        along += gap * g[3 + axis]
        across += gap * g[6 + axis]
    k = g[9]
    if k == 0.0:
        u = min(max(along, low), high)
        x = p[0] - g[0] - u * g[3]
        y = p[1] - g[1] - u * g[4]
        z = p[2] - g[2] - u * g[5]
        return x * x + y * y + z * z, u
    # The angle around the centre, in a form that stays accurate for a very large radius.
    u = math.atan2(k * along, 1 - k * across) / k
    if u < low and u + 2 * math.pi / k <= high:
        u += 2 * math.pi / k
    if low <= u <= high:
        return point_distance2(p, g, u), u
    at_low = point_distance2(p, g, low)
    at_high = point_distance2(p, g, high)
    if at_high < at_low:
        return at_high, high
    return at_low, low


@compiled(inner=True)
def _on_segment(p: FloatArray, g: FloatArray) -> tuple[float, float]:
    """Squared distance to segment `g`, and the distance along it of the nearest point."""
    return nearest_within(p, g, 0.0, g[10])


@compiled()
def search_tree(
    queries: FloatArray, geometry: FloatArray, pieces: IntArray, boxes: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Distance and arc length of the nearest point for each query, by a tree.

    Args:
        queries: Query points, padded to space [m], (n, 3).
        geometry: Segments from `pack`, (segments, 12).
        pieces: Index of the segment of each piece, in tree order.
        boxes: Lower and upper corners of the nodes' boxes in heap order, (2 m - 1, 6).
    """
    n = len(queries)
    distance = np.empty(n)
    s = np.empty(n)
    leaves = (len(boxes) + 1) // 2
    stack = np.empty(128, np.intp)
    bound = np.empty(128)
    best_segment = pieces[0]
    for i in range(n):
        p = queries[i]
        x, y, z = p[0], p[1], p[2]
        # The segment of the last query is a good first guess, as queries mostly follow a motion.
        best2, best_u = _on_segment(p, geometry[best_segment])
        depth = 0
        stack[0] = 0
        # Not the number 0 itself: numba would compile the function for it once more.
        bound[0] = _box_distance2(x, y, z, boxes, stack[0])
        while depth >= 0:
            node = stack[depth]
            node_bound = bound[depth]
            depth -= 1
            if node_bound >= best2:
                continue
            if node >= leaves - 1:
                leaf = node - (leaves - 1)
                first = leaf * len(pieces) // leaves
                last = (leaf + 1) * len(pieces) // leaves
                previous = -1
                for j in range(first, last):
                    segment = pieces[j]
                    if segment == previous:
                        continue
                    previous = segment
                    d2, u = _on_segment(p, geometry[segment])
                    if d2 < best2:
                        best2, best_u, best_segment = d2, u, segment
                continue
            left = 2 * node + 1
            d_left = _box_distance2(x, y, z, boxes, left)
            d_right = _box_distance2(x, y, z, boxes, left + 1)
            near, far, d_near, d_far = left, left + 1, d_left, d_right
            if d_right < d_left:
                near, far, d_near, d_far = left + 1, left, d_right, d_left
            if d_far < best2:
                depth += 1
                stack[depth] = far
                bound[depth] = d_far
            if d_near < best2:
                depth += 1
                stack[depth] = near
                bound[depth] = d_near
        distance[i] = math.sqrt(best2)
        s[i] = geometry[best_segment, 11] + best_u
    return distance, s


@compiled(inner=True)
def _plane_point(g: FloatArray, u: float) -> tuple[float, float]:
    """The point at distance u along segment g, in the plane."""
    along, across = offsets(g[9], u)
    return g[0] + along * g[3] + across * g[6], g[1] + along * g[4] + across * g[7]


@compiled()
def fill_cells(
    geometry: FloatArray, low: FloatArray, size: float, columns: int, rows: int
) -> tuple[IntArray, IntArray]:
    """Lists of the segments that run through each cell of a grid.

    Args:
        geometry: Segments from `pack`, (n, 12).
        low: Lower corner of the grid [m], (2,).
        size: Edge length of a cell [m].
        columns: Number of cells along x.
        rows: Number of cells along y.

    Returns:
        Index at which the list of each cell starts, (cells + 1,), and all lists in one array.
    """
    cells = columns * rows
    first = np.zeros(cells + 1, np.intp)
    last_seen = np.full(cells, -1, np.intp)
    entries = np.empty(0, np.intp)
    for write in range(2):
        if write:
            # Counts become start indices; during writing, first[c + 1] is the next free index of
            # cell c.
            total = 0
            for c in range(cells):
                count = first[c + 1]
                first[c + 1] = total
                total += count
                last_seen[c] = -1
            entries = np.empty(total, np.intp)
        for i in range(len(geometry)):
            g = geometry[i]
            pieces = max(int(math.ceil(g[10] / size)), int(math.ceil(g[10] * g[9])), 1)
            step = g[10] / pieces
            # Sagitta of the arc, plus rounding errors.
            margin = step * math.tan(g[9] * step / 4) / 2 + 1e-12 * size
            x0, y0 = _plane_point(g, 0.0)
            for piece in range(1, pieces + 1):
                x1, y1 = _plane_point(g, piece * step)
                left = max(int((min(x0, x1) - margin - low[0]) / size), 0)
                right = min(int((max(x0, x1) + margin - low[0]) / size), columns - 1)
                down = max(int((min(y0, y1) - margin - low[1]) / size), 0)
                up = min(int((max(y0, y1) + margin - low[1]) / size), rows - 1)
                for row in range(down, up + 1):
                    for column in range(left, right + 1):
                        c = row * columns + column
                        if last_seen[c] == i:
                            continue
                        last_seen[c] = i
                        if write:
                            entries[first[c + 1]] = i
                        first[c + 1] += 1
                x0, y0 = x1, y1
    return first, entries


@compiled()
def search_cells(
    queries: FloatArray,
    geometry: FloatArray,
    low: FloatArray,
    size: float,
    columns: int,
    rows: int,
    first: IntArray,
    entries: IntArray,
) -> tuple[FloatArray, FloatArray]:
    """Distance and arc length of the nearest point for each query, by a grid.

    Args:
        queries: Query points, padded to space [m], (n, 3).
        geometry: Segments from `pack`, (segments, 12).
        low: Lower corner of the grid [m], (2,).
        size: Edge length of a cell [m].
        columns: Number of cells along x.
        rows: Number of cells along y.
        first: Index in `entries` at which the list of each cell starts, (cells + 1,).
        entries: Indices of segments, cell by cell.
    """
    n = len(queries)
    distance = np.empty(n)
    s = np.empty(n)
    segment = entries[0]
    for i in range(n):
        p = queries[i]
        best2, best_u = _on_segment(p, geometry[segment])
        column = min(max(int((p[0] - low[0]) / size), 0), columns - 1)
        row = min(max(int((p[1] - low[1]) / size), 0), rows - 1)
        for ring in range(max(columns, rows)):
            # All points outside the earlier rings are at least as far as the border of these rings.
            if ring > 0:
                gap = math.inf
                if column - ring >= 0:
                    gap = min(gap, p[0] - low[0] - (column - ring + 1) * size)
                if column + ring < columns:
                    gap = min(gap, (column + ring) * size - (p[0] - low[0]))
                if row - ring >= 0:
                    gap = min(gap, p[1] - low[1] - (row - ring + 1) * size)
                if row + ring < rows:
                    gap = min(gap, (row + ring) * size - (p[1] - low[1]))
                if gap > 0.0 and gap * gap >= best2:
                    break
            for r in range(max(row - ring, 0), min(row + ring, rows - 1) + 1):
                # Rows between the first and the last of a ring have two cells: left and right.
                edge = r == row - ring or r == row + ring
                step = 1 if edge or ring == 0 else 2 * ring
                for k in range(column - ring, column + ring + 1, step):
                    if k < 0 or k >= columns:
                        continue
                    c = r * columns + k
                    for j in range(first[c], first[c + 1]):
                        d2, u = _on_segment(p, geometry[entries[j]])
                        if d2 < best2:
                            best2, best_u, segment = d2, u, entries[j]
        distance[i] = math.sqrt(best2)
        s[i] = geometry[segment, 11] + best_u
    return distance, s
