"""The compiled part of the nearest-point search."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour._kernels import compiled


@compiled()
def _box_distance2(x: float, y: float, z: float, boxes: FloatArray, node: int) -> Any:
    """Squared distance from a point to box `node`."""
    dx = max(boxes[node, 0] - x, x - boxes[node, 3], 0.0)
    dy = max(boxes[node, 1] - y, y - boxes[node, 4], 0.0)
    dz = max(boxes[node, 2] - z, z - boxes[node, 5], 0.0)
    return dx * dx + dy * dy + dz * dz


@compiled()
def _point_distance2(p: FloatArray, g: FloatArray, u: float) -> float:
    """Squared distance from `p` to the point at distance `u` along segment `g`."""
    k = g[9]
    angle = k * u
    if abs(angle) > 1e-4:
        along = math.sin(angle) / k
        half = math.sin(angle / 2)
        inward = 2 * half * half / k
    else:  # series: exact to rounding here, and fit for lines
        along = u * (1 - angle * angle / 6)
        inward = u * angle / 2 * (1 - angle * angle / 12)
    total = 0.0
    for axis in range(3):
        gap = p[axis] - g[axis] - along * g[3 + axis] - inward * g[6 + axis]
        total += gap * gap
    return total


@compiled()
def _on_segment(p: FloatArray, g: FloatArray) -> tuple[float, float]:
    """Squared distance to segment `g`, and the distance along it of the nearest point."""
    along = 0.0
    inward = 0.0
    for axis in range(3):
        gap = p[axis] - g[axis]
        along += gap * g[3 + axis]
        inward += gap * g[6 + axis]
    k = g[9]
    length = g[10]
    if k == 0.0:
        u = min(max(along, 0.0), length)
        x = p[0] - g[0] - u * g[3]
        y = p[1] - g[1] - u * g[4]
        z = p[2] - g[2] - u * g[5]
        return x * x + y * y + z * z, u
    # The angle around the centre, written so that it stays accurate for a very large radius.
    angle = math.atan2(k * along, 1 - k * inward)
    u = angle / k
    if 0.0 <= u <= length:
        return _point_distance2(p, g, u), u
    if u < 0.0 and u + 2 * math.pi / k <= length:
        u += 2 * math.pi / k
        return _point_distance2(p, g, u), u
    at_start = _point_distance2(p, g, 0.0)
    at_end = _point_distance2(p, g, length)
    if at_end < at_start:
        return at_end, length
    return at_start, 0.0


@compiled()
def nearest(
    queries: FloatArray, geometry: FloatArray, pieces: IntArray, boxes: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Distance and arc length of the nearest point for each query, all in space."""
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
        # The last query's segment is a good first guess: queries mostly come along a motion.
        best2, best_u = _on_segment(p, geometry[best_segment])
        depth = 0
        stack[0] = 0
        bound[0] = _box_distance2(x, y, z, boxes, 0)
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
