"""Compiled selection of the points of a line that are drawn."""

from __future__ import annotations

import math

from armcontour.core.checks import BoolArray, FloatArray
from armcontour.core.kernel_cache import compiled


@compiled(inner=True)
def distance_from_segment(
    points: FloatArray,  # Points, (n, dimension)
    k: int,  # Index of the point
    begin: int,  # Index of the start of the segment
    end: int,  # Index of the end of the segment
) -> float:
    """Return the distance of one point from the line segment between two others."""
    square = 0.0
    along = 0.0
    for axis in range(points.shape[1]):
        chord = points[end, axis] - points[begin, axis]
        square += chord * chord
        along += (points[k, axis] - points[begin, axis]) * chord
    fraction = min(max(along / square, 0.0), 1.0) if square > 0.0 else 0.0
    total = 0.0
    for axis in range(points.shape[1]):
        chord = points[end, axis] - points[begin, axis]
        offset = points[k, axis] - points[begin, axis] - fraction * chord
        total += offset * offset
    return math.sqrt(total)


@compiled()
def keep_error(
    points: FloatArray,  # Points, (n, dimension)
    error: float,  # Largest distance from a line to an omitted point
    finest: float,  # Ratios of distances to the error are multiples of it
    mask: BoolArray,  # Drawn points, (n,), with the ends of all lines; output too
    ratio: FloatArray,  # Output: work space, (n,)
) -> None:
    """Mark points until no omitted point is farther from its line than an error.

    Between two drawn points, the points with the largest distance are drawn. All of them are, so
    that the choice does not depend on rounding when the path is moved.
    """
    begin = 0
    n = len(points)
    while begin < n - 1:
        end = begin + 1
        while not mask[end]:
            end += 1
        worst = 0.0
        for k in range(begin + 1, end):
            distance = distance_from_segment(points, k, begin, end)
            ratio[k] = round(distance / error / finest) * finest
            worst = max(worst, ratio[k])
        if worst > 1.0:
            for k in range(begin + 1, end):
                mask[k] = ratio[k] == worst
        else:
            begin = end
