"""Compiled points of a path with their derivatives, written beside the tool's orientation."""

from __future__ import annotations

import math

from armcontour._checks import FloatArray, IntArray
from armcontour._kernels import compiled


@compiled()
def write_points(
    segments: FloatArray,
    quintics: FloatArray,
    i: IntArray,
    u: FloatArray,
    poses: FloatArray,
    rates: FloatArray,
) -> None:
    """Write points of a path in space, and their first two derivatives, as `Segments.at` has them.

    Args:
        segments: Start, tangent, normal, curvature and length of every segment, (n, 11).
        quintics: Coefficients of the transitions, NaN for lines and arcs, (n, 6, 3); (0, 6, 3) for
            a path without transitions.
        i: Indices of segments, (m,).
        u: Distances from their starts [m], (m,).
        poses: Output: the points in [:, :, 3], (m, 3, 4).
        rates: Output: the derivatives in [:, 0] and [:, 1], (m, 4, 3); (0, 4, 3) for none.
    """
    derived = len(rates) > 0
    for m in range(len(u)):
        row = i[m]
        curvature, at = segments[row, 9], u[m]
        if len(quintics) > 0 and quintics[row, 0, 0] == 0.0:
            length = segments[row, 10]
            x = at / length
            for k in range(3):
                value = slope = bend = 0.0
                for j in range(5, -1, -1):
                    bend = bend * x + 2.0 * slope
                    slope = slope * x + value
                    value = value * x + quintics[row, j, k]
                poses[m, k, 3] = segments[row, k] + value
                if derived:
                    rates[m, 0, k], rates[m, 1, k] = slope / length, bend / (length * length)
            continue
        angle = curvature * at
        sine, cosine, along, across = 0.0, 1.0, at, 0.0
        if angle != 0.0:
            sine, cosine = math.sin(angle), math.cos(angle)
            half = math.sin(angle / 2.0) / (angle / 2.0)
            along, across = at * (sine / angle), at * (angle / 2.0) * (half * half)
        for k in range(3):
            tangent, normal = segments[row, 3 + k], segments[row, 6 + k]
            poses[m, k, 3] = segments[row, k] + along * tangent + across * normal
            if derived:
                rates[m, 0, k] = cosine * tangent + sine * normal
                rates[m, 1, k] = curvature * (cosine * normal - sine * tangent)
