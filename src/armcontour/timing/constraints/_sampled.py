"""The compiled part of sampled constraints: how far quantities rise above their chords."""

from __future__ import annotations

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour._kernels import compiled
from armcontour.timing.constraints._rows import ROUNDING


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
    for i in range(n):
        square = width[i] ** 2
        for k in range(rows):
            chord = (ends[0, i, k] + ends[1, i, k]) / 2
            bend[i, k] = safety * abs(middle[i, k] - chord) / square
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
    for i in range(n):
        turn, rounding = abs(skew[i] * width[i]) / 4, ROUNDING * x[i] / width[i]
        for k in range(rows):
            a0, a1, b0, b1 = a[0, i, k], a[1, i, k], b[0, i, k], b[1, i, k]
            value = rise_a[i, k] * u[i] + rise_b[i, k] * x[i] + rise_c[i, k]
            # The products of two slopes, and the error of u from rounding of x.
            value += abs(b1 - b0) * width[i] / 2 * u[i]
            value += turn * (abs(a1 - a0) + max(abs(b0), abs(b1)) * width[i])
            found[i, k] = value + rounding * max(abs(a0), abs(a1))
