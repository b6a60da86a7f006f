"""The compiled part of grids: where points are needed, and points in between."""

from __future__ import annotations

import math

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.kernels import compiled
from armcontour.motion._laws import value_and_slopes


@compiled()
def turning_of(breaks: FloatArray, coefficients: FloatArray, at_rest: float) -> FloatArray:
    """How fast a joint path turns on each of its pieces, as a mean of its ends and its middle.

    Args:
        breaks: Of the joint path [m], (pieces + 1,).
        coefficients: Of its pieces [rad], (pieces, 6, dof).
        at_rest: Below this share of the largest dq_ds no joint moves, and the path has no
            direction.

    Returns:
        |d2q_ds2| over |dq_ds| [1/m], (pieces,); (0,) if no joint moves.
    """
    n, dof = len(breaks) - 1, coefficients.shape[2]
    size, bend = np.empty((n, 3)), np.empty((n, 3))
    most = 0.0
    for i in range(n):
        width, c = breaks[i + 1] - breaks[i], coefficients[i]
        for k in range(3):
            middle = (breaks[i] + breaks[i + 1]) / 2
            s = breaks[i] if k == 0 else middle if k == 1 else breaks[i + 1]
            x = (s - breaks[i]) / width
            first = second = 0.0
            for j in range(dof):
                c0, c1, c2, c3, c4, c5 = c[0, j], c[1, j], c[2, j], c[3, j], c[4, j], c[5, j]
                _, slope, curve = value_and_slopes(c0, c1, c2, c3, c4, c5, x)
                slope, curve = slope / width, curve / (width * width)
                first += slope * slope
                second += curve * curve
            size[i, k], bend[i, k] = math.sqrt(first), math.sqrt(second)
            most = max(most, size[i, k])
    if most == 0.0:
        return np.empty(0)
    found = np.empty(n)
    for i in range(n):
        total, count = 0.0, 0
        for k in range(3):
            if size[i, k] > at_rest * most:
                total += bend[i, k] / size[i, k]
                count += 1
        found[i] = total / max(count, 1)
    return found


@compiled()
def cut(s: FloatArray, count: IntArray) -> tuple[FloatArray, IntArray]:
    """Points that cut intervals into equal parts, and the interval that each part lies in.

    Args:
        s: Ends of the intervals, (n + 1,).
        count: Number of parts of each interval, (n,).
    """
    total = 0
    for i in range(len(count)):
        total += count[i]
    points, of = np.empty(total + 1), np.empty(total, np.intp)
    part = 0
    for i in range(len(count)):
        width = s[i + 1] - s[i]
        for k in range(count[i]):
            points[part], of[part] = s[i] + width * k / count[i], i
            part += 1
    points[total] = s[len(count)]
    return points, of


@compiled()
def merge(points: FloatArray, breaks: FloatArray, close: float) -> tuple[FloatArray, IntArray, int]:
    """All breaks, and the points that are not close to a break or to the point before.

    Args:
        points: Increasing numbers from the first to the last break, (m,).
        breaks: Increasing numbers, (pieces + 1,).
        close: Distances below this are none.

    Returns:
        The ends of the intervals, (n + 1,), the piece of each interval, (n,), and the smallest
        number of intervals of a piece.
    """
    most, last = len(points) + len(breaks), len(breaks) - 1
    s, piece = np.empty(most), np.empty(most, np.intp)
    n, k, fewest = 0, 0, most
    for i in range(last):
        first = n
        s[n], piece[n] = breaks[i], i
        n += 1
        while k < len(points) and points[k] < breaks[i + 1]:
            if points[k] - s[n - 1] >= close and breaks[i + 1] - points[k] >= close:
                s[n], piece[n] = points[k], i
                n += 1
            k += 1
        fewest = min(fewest, n - first)
    s[n] = breaks[last]
    return s[: n + 1].copy(), piece[:n].copy(), fewest
