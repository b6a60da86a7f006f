"""The compiled part of sampled constraints: how far quantities rise above their chords."""

from __future__ import annotations

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour._kernels import compiled
from armcontour.timing._block import (
    A0,
    A1,
    B0,
    B1,
    ENDS,
    INTERVAL,
    MARGIN,
    OWN,
    RISE_A,
    RISE_B,
    RISE_C,
    RISES,
    ROUNDED,
    SKEW,
    WIDTH,
    B,
    U,
    X,
    take_rows,
    take_terms,
)
from armcontour.timing.constraints._rows import start_margins


@compiled()
def places(piece: IntArray, s: FloatArray) -> tuple[IntArray, FloatArray, IntArray]:
    """The ends of all intervals, each once: an end is the start of the next in the same piece.

    Args:
        piece: Piece of the joint path that holds each interval, (n,).
        s: Interval ends [m], (n + 1,).

    Returns:
        Piece and arc length [m] of each place, and the place of the start of each interval; the
        following place is its end.
    """
    n = len(piece)
    count = n + 1
    for i in range(1, n):
        if piece[i] != piece[i - 1]:
            count += 1
    of, at, starts = np.empty(count, np.intp), np.empty(count), np.empty(n, np.intp)
    k = 0
    for i in range(n):
        starts[i], of[k], at[k] = k, piece[i], s[i]
        k += 1
        if i == n - 1 or piece[i + 1] != piece[i]:
            of[k], at[k] = piece[i], s[i + 1]
            k += 1
    return of, at, starts


@compiled()
def ends_of(values: FloatArray, starts: IntArray) -> FloatArray:
    """Values at the starts and ends of all intervals, (2, n, rows), of those at all `places`."""
    n, rows = len(starts), values.shape[1]
    found = np.empty((2, n, rows))
    for end in range(2):
        for i in range(n):
            for k in range(rows):
                found[end, i, k] = values[starts[i] + end, k]
    return found


@compiled()
def rises(
    width: FloatArray,
    piece: IntArray,
    ends: FloatArray,
    middle: FloatArray,
    safety: float,
    found: FloatArray,
) -> None:
    """Write bounds of the distances of quantities from their chords on all intervals.

    Args:
        width: Lengths of the intervals, (n,).
        piece: Piece of the joint path that holds each interval, (n,).
        ends: Values at the starts and ends, (2, n, k).
        middle: Values in the middles, (n, k).
        safety: Factor of the bound.
        found: Takes the bounds, (n, k).
    """
    n, rows = middle.shape
    bend = np.empty((n, rows))
    # One row after the other, for vector instructions.
    starts, stops = ends[0].reshape(-1), ends[1].reshape(-1)
    middles, bends = middle.reshape(-1), bend.reshape(-1)
    for m in range(len(bends)):
        bends[m] = safety * abs(middles[m] - (starts[m] + stops[m]) / 2)
    for i in range(n):
        inverse = 1 / width[i] ** 2
        for k in range(rows):
            bend[i, k] *= inverse
    for i in range(n):
        square = width[i] ** 2
        before = i - 1 if i > 0 and piece[i - 1] == piece[i] else i
        after = i + 1 if i < n - 1 and piece[i + 1] == piece[i] else i
        for k in range(rows):
            found[i, k] = max(bend[i, k], bend[before, k], bend[after, k]) * square


@compiled()
def bulges(
    width: FloatArray,
    a: FloatArray,
    b: FloatArray,
    rise_a: FloatArray,
    rise_b: FloatArray,
    rise_c: FloatArray,
    x: FloatArray,
    u: FloatArray,
    skew: FloatArray,
    found: FloatArray,
) -> None:
    """Write bounds of the rise of `a u + b x + c` above its chord on all intervals.

    Args:
        width: Lengths of the intervals, (n,).
        a: Coefficients of u at the starts and ends, (2, n, rows).
        b: Coefficients of x there, (2, n, rows).
        rise_a: Bounds of the distance of a from its chord, (n, rows).
        rise_b: The same of b.
        rise_c: The same of c.
        x: Largest x on each interval, (n,).
        u: Largest |u|, (n,).
        skew: Slope of u over s, (n,).
        found: Takes the bounds, (n, rows).
    """
    n, rows = rise_a.shape
    of, ends, own = np.empty(INTERVAL), np.empty((rows, ENDS)), np.empty((rows, OWN))
    rises = np.empty((rows, RISES))
    for begin in range(0, n, B):
        for m in range(B):
            i = min(begin + m, n - 1)
            of[WIDTH + m], of[X + m], of[U + m], of[SKEW + m] = width[i], x[i], u[i], skew[i]
        start_margins(of)
        take_terms(a, b, begin, ends)
        take_rises(rise_a, rise_b, rise_c, begin, rises)
        for k in range(rows):
            write_sampled_bulge(of, ends, rises, own, k)
        for m in range(min(B, n - begin)):
            for k in range(rows):
                found[begin + m, k] = own[k, MARGIN + m]


@compiled(inner=True)
def take_rises(
    rise_a: FloatArray, rise_b: FloatArray, rise_c: FloatArray, begin: int, rises: FloatArray
) -> None:
    """Write rises of three coefficients on a block, each (n, rows), into `rises`, (rows, 3 B)."""
    take_rows(rise_a, begin, rises, RISE_A)
    take_rows(rise_b, begin, rises, RISE_B)
    take_rows(rise_c, begin, rises, RISE_C)


@compiled(inner=True)
def write_sampled_bulge(
    of: FloatArray, ends: FloatArray, rises: FloatArray, own: FloatArray, k: int
) -> None:
    """Write what `bulges` gives for row k of a block into MARGIN."""
    for m in range(B):
        a0, a1, b0, b1 = ends[k, A0 + m], ends[k, A1 + m], ends[k, B0 + m], ends[k, B1 + m]
        x, u, width, turn = of[X + m], of[U + m], of[WIDTH + m], abs(of[SKEW + m] * of[WIDTH + m])
        value = rises[k, RISE_A + m] * u + rises[k, RISE_B + m] * x + rises[k, RISE_C + m]
        # The products of two slopes, and the error of u from rounding of x.
        value += abs(b1 - b0) * width / 2 * u
        value += turn / 4 * (abs(a1 - a0) + max(abs(b0), abs(b1)) * width)
        own[k, MARGIN + m] = value + of[ROUNDED + m] * max(abs(a0), abs(a1))
