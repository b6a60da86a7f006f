"""The compiled part of the nearest-point search for tangled paths: a grid of cells in the plane."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour._kernels import compiled
from armcontour.geometry._nearest import _on_segment


@compiled()
def _place(g: FloatArray, u: float, axis: int) -> Any:
    """Coordinate of the point at distance u along segment g."""
    k = g[9]
    if k == 0.0:
        return g[axis] + u * g[3 + axis]
    half = math.sin(k * u / 2)
    return g[axis] + math.sin(k * u) / k * g[3 + axis] + 2 * half * half / k * g[6 + axis]


@compiled()
def fill_cells(
    geometry: FloatArray, low: FloatArray, size: float, columns: int, rows: int
) -> tuple[IntArray, IntArray]:
    """The segments that come through every cell.

    Args:
        geometry: Segments as in `SegmentIndex`, (n, 12).
        low: Lower corner of the grid, (2,).
        size: Edge of a cell.
        columns: Cells along x.
        rows: Cells along y.

    Returns:
        Where every cell's list begins, (cells + 1,), and the lists one behind the other.
    """
    cells = columns * rows
    first = np.zeros(cells + 1, np.intp)
    last_seen = np.full(cells, -1, np.intp)
    entries = np.empty(0, np.intp)
    for write in range(2):
        if write:
            # From counts to places; while writing, first[c + 1] is the next free place of cell c.
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
            # What an arc bulges over its chord, and rounding.
            margin = step * math.tan(g[9] * step / 4) / 2 + 1e-12 * size
            x0, y0 = _place(g, 0.0, 0), _place(g, 0.0, 1)
            for piece in range(1, pieces + 1):
                x1, y1 = _place(g, piece * step, 0), _place(g, piece * step, 1)
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
def nearest_in_cells(
    queries: FloatArray,
    geometry: FloatArray,
    low: FloatArray,
    size: float,
    columns: int,
    rows: int,
    first: IntArray,
    entries: IntArray,
) -> tuple[FloatArray, FloatArray]:
    """Distance and arc length of the nearest point for each query; all padded to space."""
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
            # Nothing outside the rings before this one is nearer than their border.
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
                # Inner rows of a ring have two cells: its left and its right one.
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
