"""The compiled part of joint constraints: values at interval ends, and margins between them.

Numbers of intervals are in rows of blocks, see `timing._block`.
"""

from __future__ import annotations

import math

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour._kernels import compiled
from armcontour.timing._block import (
    A0,
    A1,
    B0,
    B1,
    ENDS,
    FOURTH,
    FROM,
    HALF,
    INTERVAL,
    LOST,
    LOW_END,
    LOW_START,
    MARGIN,
    OWN,
    PLAIN_END,
    PLAIN_START,
    ROOM,
    ROUNDED,
    SCALE,
    SHARE,
    SKEW,
    STEEPEST,
    THIRD,
    TO,
    WIDTH,
    B,
    U,
    X,
    take_rows,
    take_terms,
)

# Relative rounding error of x in differences of x.
ROUNDING = 2e-15


@compiled(inner=True)
def place_block(
    breaks: FloatArray, piece: IntArray, s: FloatArray, begin: int, of: FloatArray
) -> None:
    """Write width, HALF, FROM, TO and SCALE of the intervals of a block.

    Args:
        breaks: Of the joint path, (pieces + 1,).
        piece: Piece of each interval, (n,).
        s: Interval ends, (n + 1,).
        begin: First interval of the block.
        of: Rows of the intervals.
    """
    for m in range(B):
        i = min(begin + m, len(piece) - 1)
        k = piece[i]
        of[FROM + m], of[TO + m] = s[i] - breaks[k], s[i + 1] - breaks[k]
        of[WIDTH + m], of[SCALE + m] = s[i + 1] - s[i], breaks[k + 1] - breaks[k]
    for m in range(B):
        of[HALF + m], of[SCALE + m] = 0.5 / of[WIDTH + m], 1.0 / of[SCALE + m]
        of[FROM + m] *= of[SCALE + m]
        of[TO + m] *= of[SCALE + m]


@compiled(inner=True)
def take_coefficients(
    coefficients: FloatArray, piece: IntArray, begin: int, known: int, out: FloatArray
) -> int:
    """Write the coefficients of the joint path on the intervals of a block, row by row.

    Args:
        coefficients: Of the joint path, (pieces, 6, dof).
        piece: Piece of each interval, (n,).
        begin: First interval of the block.
        known: The piece whose coefficients all of `out` has, or -1.
        out: Output: coefficients from the first power on, (dof, 5 B).

    Returns:
        The piece of all intervals, or -1 if there are several.
    """
    end = min(begin + B, len(piece))
    alike = piece[begin] == piece[end - 1]
    if alike and piece[begin] == known:
        return known
    i = begin
    while i < end:
        first, k = i - begin, piece[i]
        while i < end and piece[i] == k:
            i += 1
        # The last interval fills up its block.
        count = i - begin - first if i < len(piece) else B - first
        for j in range(coefficients.shape[2]):
            for power in range(5):
                c = coefficients[k, power + 1, j]
                for m in range(first, first + count):
                    out[j, power * B + m] = c
    return piece[begin] if alike else -1


@compiled(inner=True)
def write_slopes(of: FloatArray, c: FloatArray, j: int, ends: FloatArray, row: int) -> None:
    """Write the first two of what `derivatives` gives for one joint.

    Args:
        of: Rows of the intervals: FROM, TO and SCALE.
        c: Coefficients of the joints, (dof, 5 B).
        j: The joint.
        ends: Output: A0, A1, B0, B1 of some rows.
        row: Which of these the joint has.
    """
    for m in range(B):
        a1, a2, a3 = c[j, m], c[j, B + m], c[j, 2 * B + m]
        a4, a5 = c[j, 3 * B + m], c[j, 4 * B + m]
        x0, x1, scale = of[FROM + m], of[TO + m], of[SCALE + m]
        square = scale * scale
        slope = a1 + x0 * (2 * a2 + x0 * (3 * a3 + x0 * (4 * a4 + x0 * 5 * a5)))
        bend = 2 * a2 + x0 * (6 * a3 + x0 * (12 * a4 + x0 * 20 * a5))
        ends[row, A0 + m], ends[row, B0 + m] = scale * slope, square * bend
        slope = a1 + x1 * (2 * a2 + x1 * (3 * a3 + x1 * (4 * a4 + x1 * 5 * a5)))
        bend = 2 * a2 + x1 * (6 * a3 + x1 * (12 * a4 + x1 * 20 * a5))
        ends[row, A1 + m], ends[row, B1 + m] = scale * slope, square * bend


@compiled(inner=True)
def write_derivatives(
    of: FloatArray, c: FloatArray, j: int, ends: FloatArray, own: FloatArray
) -> None:
    """Write what `derivatives` gives for one joint.

    Args:
        of: Rows of the intervals: FROM, TO and SCALE.
        c: Coefficients of the joints, (dof, 5 B).
        j: The joint.
        ends: Output: A0, A1, B0, B1 of the joints.
        own: Output: THIRD, FOURTH of the joints.
    """
    write_slopes(of, c, j, ends, j)
    for m in range(B):
        a3, a4, a5 = c[j, 2 * B + m], c[j, 3 * B + m], c[j, 4 * B + m]
        x0, x1, scale = of[FROM + m], of[TO + m], of[SCALE + m]
        square = scale * scale
        # Taylor about the middle: the fifth derivative is constant.
        middle, half = 0.5 * (x0 + x1), 0.5 * (x1 - x0)
        f3 = abs(6 * a3 + middle * (24 * a4 + middle * 60 * a5))
        f4 = abs(24 * a4 + middle * 120 * a5)
        f5 = abs(120 * a5)
        own[j, THIRD + m] = (f3 + half * (f4 + half * 0.5 * f5)) * (square * scale)
        own[j, FOURTH + m] = (f4 + half * f5) * (square * square)


@compiled()
def derivatives(
    coefficients: FloatArray,
    breaks: FloatArray,
    piece: IntArray,
    s: FloatArray,
    first: FloatArray,
    second: FloatArray,
    third: FloatArray,
    fourth: FloatArray,
) -> None:
    """dq_ds and d2q_ds2 at both ends of every interval, and bounds of the next two inside.

    Args:
        coefficients: Of the joint path, (pieces, 6, dof).
        breaks: Of the joint path, (pieces + 1,).
        piece: Piece of each interval, (n,).
        s: Interval ends, (n + 1,).
        first: Takes dq_ds, (2, n, dof).
        second: Takes d2q_ds2, (2, n, dof).
        third: Takes the bounds of |d3q_ds3|, (n, dof).
        fourth: Takes the bounds of |d4q_ds4|, (n, dof).
    """
    n, dof, known = len(piece), coefficients.shape[2], -1
    of, c = np.empty(INTERVAL), np.empty((dof, 5 * B))
    ends, own = np.empty((dof, ENDS)), np.empty((dof, OWN))
    for begin in range(0, n, B):
        place_block(breaks, piece, s, begin, of)
        known = take_coefficients(coefficients, piece, begin, known, c)
        for j in range(dof):
            write_derivatives(of, c, j, ends, own)
        for m in range(min(B, n - begin)):
            i = begin + m
            for j in range(dof):
                first[0, i, j], first[1, i, j] = ends[j, A0 + m], ends[j, A1 + m]
                second[0, i, j], second[1, i, j] = ends[j, B0 + m], ends[j, B1 + m]
                third[i, j], fourth[i, j] = own[j, THIRD + m], own[j, FOURTH + m]


@compiled(inner=True)
def start_margins(of: FloatArray) -> None:
    """Write SHARE and ROUNDED, and ceilings without any joint, from WIDTH and X."""
    for m in range(B):
        width = of[WIDTH + m]
        of[SHARE + m], of[ROUNDED + m] = width * width / 8, ROUNDING * of[X + m] / width
        of[LOW_START + m] = of[LOW_END + m] = math.inf
        of[PLAIN_START + m] = of[PLAIN_END + m] = math.inf


@compiled(inner=True)
def write_bulge(of: FloatArray, ends: FloatArray, own: FloatArray, j: int) -> None:
    """Write what `acceleration_bulge` gives for joint j into MARGIN."""
    for m in range(B):
        third = own[j, THIRD + m]
        bend = max(abs(ends[j, B0 + m]), abs(ends[j, B1 + m])) + of[WIDTH + m] * third
        slope = max(abs(ends[j, A0 + m]), abs(ends[j, A1 + m]))
        rise = 5.0 * third * of[U + m] + own[j, FOURTH + m] * of[X + m]
        rise += 4.0 * bend * abs(of[SKEW + m])
        own[j, MARGIN + m] = of[SHARE + m] * rise + of[ROUNDED + m] * slope


@compiled()
def acceleration_bulge(
    width: FloatArray,
    first: FloatArray,
    second: FloatArray,
    third: FloatArray,
    fourth: FloatArray,
    x: FloatArray,
    u: FloatArray,
    skew: FloatArray,
    bulge: FloatArray,
) -> None:
    """Write the largest rise of joint accelerations above their chords into `bulge`, (n, dof).

    The rounding error of u, which is a difference of x over the width, is added.

    With u linear in s, its second derivative is `5 q''' u + q'''' x + 4 q'' skew`; a function rises
    above its chord by at most width² / 8 times the largest amount of that.
    """
    n, dof = third.shape
    of, ends, own = np.empty(INTERVAL), np.empty((dof, ENDS)), np.empty((dof, OWN))
    for begin in range(0, n, B):
        _take_motion(width, x, u, skew, begin, of)
        take_terms(first, second, begin, ends)
        take_rows(third, begin, own, THIRD)
        take_rows(fourth, begin, own, FOURTH)
        for j in range(dof):
            write_bulge(of, ends, own, j)
        for m in range(min(B, n - begin)):
            for j in range(dof):
                bulge[begin + m, j] = own[j, MARGIN + m]


@compiled(inner=True)
def _take_motion(
    width: FloatArray, x: FloatArray, u: FloatArray, skew: FloatArray, begin: int, of: FloatArray
) -> None:
    """Write WIDTH, X, U and SKEW of a block, and what follows from them for margins."""
    for m in range(B):
        i = min(begin + m, len(width) - 1)
        of[WIDTH + m], of[X + m], of[U + m], of[SKEW + m] = width[i], x[i], u[i], skew[i]
    start_margins(of)


@compiled(inner=True)
def lower_u(of: FloatArray, ends: FloatArray, j: int, end: int, most: float) -> None:
    """Lower U to what the acceleration of one joint allows at one end, given X.

    Args:
        of: Rows of the intervals.
        ends: Derivatives of the joints.
        j: The joint.
        end: 0 for the starts of the intervals, 1 for their ends.
        most: Largest acceleration of the joint either way.
    """
    aside = B if end else 0
    for m in range(B):
        room = most + abs(ends[j, B0 + aside + m]) * of[X + m]
        size, least = abs(ends[j, A0 + aside + m]), of[U + m]
        of[U + m] = room / size if size * least > room else least


@compiled()
def path_acceleration_bound(
    first: FloatArray, second: FloatArray, low: FloatArray, high: FloatArray, x: FloatArray
) -> FloatArray:
    """Largest |u| that joint accelerations allow at either end of each interval, (n,).

    The lower one of both ends: where dq_ds vanishes at one of them, u is bounded by the other.
    """
    n, dof = len(x), first.shape[2]
    bound, of, ends = np.empty(n), np.empty(INTERVAL), np.empty((dof, ENDS))
    for begin in range(0, n, B):
        for m in range(B):
            of[X + m], of[U + m] = x[min(begin + m, n - 1)], math.inf
        take_terms(first, second, begin, ends)
        for end in range(2):
            for j in range(dof):
                lower_u(of, ends, j, end, max(high[j], -low[j]))
        for m in range(min(B, n - begin)):
            bound[begin + m] = of[U + m]
    return bound


@compiled(inner=True)
def raise_shares(of: FloatArray, ends: FloatArray, row: int, limit: float) -> None:
    """Raise LOW_START and LOW_END to the share of its limit that a joint takes at ds = 1."""
    inverse = 1.0 / limit
    for m in range(B):
        of[LOW_START + m] = max(of[LOW_START + m], abs(ends[row, A0 + m]) * inverse)
        of[LOW_END + m] = max(of[LOW_END + m], abs(ends[row, A1 + m]) * inverse)


@compiled(inner=True)
def ceil_by_shares(of: FloatArray) -> None:
    """Turn LOW_START and LOW_END from the largest shares of all joints into ceilings of x."""
    for m in range(2 * B):
        worst = of[LOW_START + m]
        of[LOW_START + m] = 1.0 / (worst * worst) if worst > 0.0 else math.inf


@compiled()
def velocity_ceiling_at_ends(first: FloatArray, limit: FloatArray) -> FloatArray:
    """Largest x at both ends of each interval under joint velocity limits there, (2, n)."""
    n, dof = first.shape[1], first.shape[2]
    ceiling, of, ends = np.empty((2, n)), np.empty(INTERVAL), np.empty((dof, ENDS))
    for begin in range(0, n, B):
        take_rows(first[0], begin, ends, A0)
        take_rows(first[1], begin, ends, A1)
        for m in range(2 * B):
            of[LOW_START + m] = 0.0
        for j in range(dof):
            raise_shares(of, ends, j, limit[j])
        ceil_by_shares(of)
        for m in range(min(B, n - begin)):
            ceiling[0, begin + m], ceiling[1, begin + m] = of[LOW_START + m], of[LOW_END + m]
    return ceiling


@compiled(inner=True)
def _matters(of: FloatArray, ends: FloatArray, own: FloatArray, j: int, v2: float) -> bool:
    """Whether a joint lowers any ceiling of a block; write ROOM (infinite if not) and STEEPEST."""
    lowers = 0
    for m in range(B):
        share, curve, width = of[SHARE + m], own[j, THIRD + m], of[WIDTH + m]
        slope = max(abs(ends[j, A0 + m]), abs(ends[j, A1 + m])) + share * curve
        bend = max(abs(ends[j, B0 + m]), abs(ends[j, B1 + m])) + width * curve
        rate = 8 * of[U + m] * slope * bend + 2 * of[X + m] * (bend * bend + slope * curve)
        room = v2 - share * (rate + 2 * abs(of[SKEW + m]) * slope * slope)
        low = max(of[LOW_START + m], of[LOW_END + m])
        plain = max(of[PLAIN_START + m], of[PLAIN_END + m])
        enough = room >= max(low, plain) * slope * slope
        of[ROOM + m], of[STEEPEST + m] = math.inf if enough else room, slope
        lowers |= int(not enough)
    return lowers != 0


@compiled(inner=True)
def lower_by_velocity(
    of: FloatArray, ends: FloatArray, own: FloatArray, j: int, limit: float
) -> None:
    """Lower the ceilings of a block by the velocity limit of joint j, see `velocity_ceiling`."""
    v2 = limit * limit
    # A joint that lowers nothing by either of the rules below needs no divisions.
    if limit == np.inf or not _matters(of, ends, own, j, v2):
        return
    for m in range(B):
        room, slope = of[ROOM + m], of[STEEPEST + m]
        start, end = abs(ends[j, A0 + m]), abs(ends[j, A1 + m])
        # Take either both ends with the bulge, or both ends slow enough for the largest dq_ds of
        # the interval. A mix of the two rules would prove nothing.
        # Without a slope these are infinite: one end has room for any x, if there is any room.
        by_start, by_end, tight = 1.0 / (start * start), 1.0 / (end * end), v2 / (slope * slope)
        at_start = room * by_start if room > 0.0 else 0.0
        at_end = room * by_end if room > 0.0 else 0.0
        if at_start + at_end < 2 * tight:
            at_start = at_end = tight
        of[LOW_START + m] = min(of[LOW_START + m], at_start)
        of[LOW_END + m] = min(of[LOW_END + m], at_end)
        of[PLAIN_START + m] = min(of[PLAIN_START + m], v2 * by_start)
        of[PLAIN_END + m] = min(of[PLAIN_END + m], v2 * by_end)


@compiled(inner=True)
def write_lost(of: FloatArray) -> None:
    """Write the share of ceilings that margins have taken into LOST."""
    for m in range(B):
        lost = 0.0
        if of[LOW_START + m] < of[PLAIN_START + m]:
            lost = 1.0 - of[LOW_START + m] / of[PLAIN_START + m]
        if of[LOW_END + m] < of[PLAIN_END + m]:
            lost = max(lost, 1.0 - of[LOW_END + m] / of[PLAIN_END + m])
        of[LOST + m] = lost


@compiled()
def velocity_ceiling(
    width: FloatArray,
    first: FloatArray,
    second: FloatArray,
    third: FloatArray,
    limit: FloatArray,
    x: FloatArray,
    u: FloatArray,
    skew: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Largest x at both ends of each interval for joint velocity limits to hold all along it.

    Between the ends `h = x q'²` can rise above its chord by width² / 8 times the largest
    `|h''| <= 8 |u q' q''| + 2 x (q''² + |q' q'''|) + 2 |skew| q'²`, bounded with the largest values
    on the interval.

    Returns:
        The ceiling, (2, n), and the share of it that margins have taken, (n,).
    """
    n, dof = third.shape
    ceiling, lost = np.empty((2, n)), np.empty(n)
    of, ends, own = np.empty(INTERVAL), np.empty((dof, ENDS)), np.empty((dof, OWN))
    for begin in range(0, n, B):
        _take_motion(width, x, u, skew, begin, of)
        take_terms(first, second, begin, ends)
        take_rows(third, begin, own, THIRD)
        for j in range(dof):
            lower_by_velocity(of, ends, own, j, limit[j])
        write_lost(of)
        for m in range(min(B, n - begin)):
            ceiling[0, begin + m], ceiling[1, begin + m] = of[LOW_START + m], of[LOW_END + m]
            lost[begin + m] = of[LOST + m]
    return ceiling, lost
