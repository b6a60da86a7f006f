"""The compiled part of grids: points merged with breaks, and points left out."""

from __future__ import annotations

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour._kernels import compiled


@compiled()
def merge(points: FloatArray, breaks: FloatArray, close: float) -> tuple[FloatArray, IntArray]:
    """All breaks, and the points that are not close to a break or to the point before.

    Args:
        points: Increasing numbers from the first to the last break, (m,).
        breaks: Increasing numbers, (pieces + 1,).
        close: Distances below this are none.

    Returns:
        The ends of the intervals, (n + 1,), and the piece of each interval, (n,).
    """
    s, piece = np.empty(len(points) + len(breaks)), np.empty(len(points) + len(breaks), np.intp)
    n, k = 0, 0
    for i in range(len(breaks)):
        s[n], piece[n] = breaks[i], i
        n += 1
        if i == len(breaks) - 1:
            break
        while k < len(points) and points[k] < breaks[i + 1]:
            if points[k] - s[n - 1] >= close and breaks[i + 1] - points[k] >= close:
                s[n], piece[n] = points[k], i
                n += 1
            k += 1
    return s[:n].copy(), piece[: n - 1].copy()


@compiled()
def thin(s: FloatArray, piece: IntArray, by: int) -> tuple[FloatArray, IntArray, IntArray]:
    """Keep every `by`-th point, both ends of pieces, and all points of pieces with few of them.

    Args:
        s: Ends of the intervals, (n + 1,).
        piece: Piece of each interval, (n,).
        by: Pieces of at most this many intervals keep all.

    Returns:
        The kept ends, their pieces, and for each old interval the new one it lies in, (n,).
    """
    n = len(piece)
    ends, pieces, of = np.empty(n + 1), np.empty(n, np.intp), np.empty(n, np.intp)
    count = length = 0
    for i in range(n):
        if i == 0 or piece[i] != piece[i - 1]:
            first = True
            length = 1
            while length <= by and i + length < n and piece[i + length] == piece[i]:
                length += 1
        else:
            first = False
        if first or length <= by or i % by == 0:
            ends[count], pieces[count] = s[i], piece[i]
            count += 1
        of[i] = count - 1
    ends[count] = s[n]
    return ends[: count + 1].copy(), pieces[:count].copy(), of
