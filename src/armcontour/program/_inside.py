"""Which points lie inside closed contours of lines and arcs, compiled and exact.

A point is inside a contour if its winding number is not zero. That is the winding number of the
polygon of chords, plus one turn for every arc between whose chord and curve the point lies.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from armcontour._checks import BoolArray, FloatArray
from armcontour._kernels import compiled

# Columns of a table of chords: start x, y, end x, y, centre x, y, radius, and turn: 1 for arcs to
# the left, -1 to the right, 0 for lines. Arcs turn by half a circle at most.
AX, AY, BX, BY, CX, CY, RADIUS, TURN = range(8)


@compiled(inner=True)
def winding(x: float, y: float, chords: FloatArray) -> int:
    """The winding number of a closed contour around a point."""
    found = 0
    for i in range(len(chords)):
        row = chords[i]
        ax, ay, bx, by = row[AX], row[AY], row[BX], row[BY]
        # Points on a chord count as if they were a little higher, then a little to the right.
        side = (bx - ax) * (y - ay) - (x - ax) * (by - ay)
        left = side > 0 or (side == 0 and (by < ay or (by == ay and bx > ax)))
        if ay <= y < by and left:
            found += 1
        elif by <= y < ay and not left:
            found -= 1
        turn = row[TURN]
        if turn != 0 and left == (turn < 0):
            distance = np.hypot(x - row[CX], y - row[CY])
            if distance < row[RADIUS]:
                found += 1 if turn > 0 else -1
    return found


@compiled()
def holders(points: FloatArray, chords: FloatArray, first: Any, boxes: FloatArray) -> BoolArray:
    """Which contours hold which points.

    Args:
        points: A point of every contour, (n, 2).
        chords: Chords of all closed contours, one after the other, (m, 8).
        first: Index of the first chord of every contour, and m, (n + 1,); open contours have none.
        boxes: Smallest and largest x, then y, of every closed contour, (n, 4).

    Returns:
        True in row i and column k if contour i holds the point of another contour k, (n, n).
    """
    n = len(points)
    found = np.zeros((n, n), dtype=np.bool_)
    for i in range(n):
        own = chords[first[i] : first[i + 1]]
        if len(own) == 0:
            continue
        for k in range(n):
            x, y = points[k, 0], points[k, 1]
            if i == k or x < boxes[i, 0] or x > boxes[i, 1] or y < boxes[i, 2] or y > boxes[i, 3]:
                continue
            found[i, k] = winding(x, y, own) != 0
    return found
