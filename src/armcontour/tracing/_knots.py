"""The compiled part of first knots."""

from __future__ import annotations

import math

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour._kernels import compiled


@compiled()
def cut_cells(
    u0: FloatArray,
    u1: FloatArray,
    s0: FloatArray,
    turning: FloatArray,
    finer: int,
    step: float,
    turn: float,
) -> tuple[IntArray, FloatArray]:
    """Cut cells of a path into equal intervals that are short and turn little.

    Args:
        u0: Distances along the segments at the starts of the cells [m], (cells,).
        u1: Distances at their ends.
        s0: Arc lengths at their starts [m].
        turning: How fast the path or the tool turns on them [rad/m].
        finer: Factor by which the intervals are shorter than they need to be.
        step: Largest length of an interval [m].
        turn: Largest angle by which an interval turns [rad].

    Returns:
        The cell of every interval, (n,), and distances at its start and end and the arc length at
        its start, (3, n).
    """
    cells = len(u0)
    count, total = np.empty(cells, np.intp), 0
    for i in range(cells):
        width = u1[i] - u0[i]
        most = max(math.ceil(finer * width / step), math.ceil(finer * width * turning[i] / turn))
        count[i] = max(1, int(most))
        total += count[i]
    cell, at, k = np.empty(total, np.intp), np.empty((3, total)), 0
    for i in range(cells):
        share = (u1[i] - u0[i]) / count[i]
        for number in range(count[i]):
            cell[k] = i
            at[0, k] = u0[i] + share * number
            at[1, k] = u1[i] if number + 1 == count[i] else u0[i] + share * (number + 1)
            at[2, k] = s0[i] if number == 0 else s0[i] + share * number
            k += 1
    return cell, at


@compiled()
def find_ends(
    segment: IntArray, piece: IntArray, u0: FloatArray, u1: FloatArray
) -> tuple[IntArray, FloatArray, IntArray]:
    """Places of the starts of intervals, and of those ends that are not starts of others.

    Args:
        segment: Segment of every interval, (n,).
        piece: Piece of the orientation of every interval, (n,).
        u0: Distances along the segments at the starts [m], (n,).
        u1: Distances at the ends [m], (n,).

    Returns:
        The interval of every place, (m,); the distances there [m], (m,); and the place of the end
        of every interval, (n,).
    """
    n = len(u0)
    row, u, ends = np.empty(2 * n, np.intp), np.empty(2 * n), np.empty(n, np.intp)
    count = n
    for i in range(n):
        row[i], u[i] = i, u0[i]
        same = i + 1 < n and segment[i + 1] == segment[i] and piece[i + 1] == piece[i]
        if same and u0[i + 1] == u1[i]:
            ends[i] = i + 1
        else:
            row[count], u[count], ends[i] = i, u1[i], count
            count += 1
    return row[:count].copy(), u[:count].copy(), ends
