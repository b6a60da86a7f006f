"""The compiled part of grids: where points are needed, points in between, and points left out."""

from __future__ import annotations

import math

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour._kernels import compiled
from armcontour.motion._motion import value_and_slopes


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
def cut_near(
    s: FloatArray, piece: IntArray, rests: IntArray, parts: int
) -> tuple[FloatArray, IntArray]:
    """Points of a grid that is finer next to rests, and the pieces of its intervals.

    Args:
        s: Ends of the intervals, (n + 1,).
        piece: Piece of each interval, (n,).
        rests: As in `count_near`.
        parts: As in `count_near`.
    """
    points, of = cut(s, count_near(len(piece), rests, parts))
    for i in range(len(of)):
        of[i] = piece[of[i]]
    return points, of


@compiled(inner=True, allocates=True)
def count_near(n: int, rests: IntArray, parts: int) -> IntArray:
    """Into how many parts each interval is cut: the square of parts next to a rest, then fewer.

    Args:
        n: Number of intervals.
        rests: The points at rest, increasing, (m,).
        parts: Number of parts of the interval after the first one.
    """
    found = np.empty(n, np.intp)
    after = 0
    for i in range(n):
        while after < len(rests) and rests[after] <= i:
            after += 1
        away = n
        if after > 0:
            away = min(away, i - rests[after - 1])
        if after < len(rests):
            away = min(away, rests[after] - 1 - i)
        found[i] = parts**2 if away == 0 else int(math.ceil(parts / math.sqrt(max(away, 1))))
    return found


@compiled()
def parts_at_rests(n: int, rests: int, share: float, most: int) -> int:
    """Into how many parts the interval after the first one at a rest is cut; below 2 for none.

    Args:
        n: Number of intervals.
        rests: Number of rests.
        share: All rests together get at most this share of the intervals.
        most: Largest number of parts.
    """
    return min(most, int(math.sqrt(share * n / max(3 * rests, 1))))


@compiled()
def grids_from_rest(
    breaks: FloatArray,
    count: IntArray,
    ceiling: FloatArray,
    share: float,
    most: int,
    by: int,
    few: int,
) -> tuple[FloatArray, IntArray, FloatArray, FloatArray, IntArray, FloatArray, IntArray]:
    """The grid of a motion from rest to rest, finer at both ends, and a coarser one of it.

    Args:
        breaks: Of the joint path [m], (pieces + 1,).
        count: Number of intervals of each piece before the ends are refined, (pieces,).
        ceiling: A ceiling of ds² on each piece, (pieces,), or (0,) for none.
        share: As in `parts_at_rests`.
        most: As in `parts_at_rests`.
        by: The coarse grid keeps about every so-manieth point.
        few: With fewer intervals than this the coarse grid is the grid itself.

    Returns:
        Of the grid: its points, (n + 1,), their pieces, (n,), and ceilings at the starts and ends
        of the intervals, (2, n), or (2, 0); the same of the coarse grid; and the coarse interval
        of each interval, (n,).
    """
    s, piece = cut(breaks, count)
    n = len(piece)
    parts = parts_at_rests(n, 2, share, most)
    if parts >= 2:
        ends = np.empty(2, np.intp)
        ends[0], ends[1] = 0, n
        s, of = cut(s, count_near(n, ends, parts))
        n = len(of)
        for i in range(n):
            of[i] = piece[of[i]]
        piece = of
    if n >= few:
        coarse, coarse_piece, of = thin(s, piece, by)
    else:
        coarse, coarse_piece, of = s, piece, np.empty(n, np.intp)
        for i in range(n):
            of[i] = i
    limited = len(ceiling) > 0
    fixed = np.empty((2, n if limited else 0))
    coarse_fixed = np.empty((2, len(coarse_piece) if limited else 0))
    for end in range(2):
        for i in range(fixed.shape[1]):
            fixed[end, i] = ceiling[piece[i]]
        for i in range(coarse_fixed.shape[1]):
            coarse_fixed[end, i] = ceiling[coarse_piece[i]]
    return s, piece, fixed, coarse, coarse_piece, coarse_fixed, of


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
    # The pieces are kept with the memory that they do not need.
    return s[: n + 1].copy(), piece[:n], fewest


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
