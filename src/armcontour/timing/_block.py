"""Blocks of intervals of a grid, with which compiled code uses vector instructions.

A row holds one number of every interval of a block, and an array one row after the other: of
several arrays LLVM would have to find out whether they overlap. The places of the rows in their
arrays are below.
"""

from __future__ import annotations

import numpy as np

from armcontour._checks import FloatArray
from armcontour._kernels import compiled

# Intervals of a block.
B = 32
# Of the intervals: width and 1 over twice the width; ds² and u at most, the slope of u over s and
# that times width², how much ds² may lie above its chord; the share of limits that margins take;
# ceilings of ds² at both ends with margins and without them; the parameters in the piece of the
# joint path at both ends and their slope over s; and terms of the margins.
WIDTH, HALF, X, U, SKEW, SHIFT, ABOVE, LOST = range(0, 8 * B, B)
LOW_START, LOW_END, PLAIN_START, PLAIN_END = range(8 * B, 12 * B, B)
FROM, TO, SCALE, SHARE, ROUNDED, ROOM, STEEPEST = range(12 * B, 19 * B, B)
INTERVAL = 19 * B
# Of a row of limits at the ends of the intervals: the coefficient of u at starts and ends, which
# for a joint is dq_ds, and that of x, which is d2q_ds2.
A0, A1, B0, B1 = range(0, 4 * B, B)
ENDS = 4 * B
# Of the same row: lower and upper bounds at starts and ends, the margin; and for a joint bounds of
# the third and fourth derivatives.
LOW0, LOW1, HIGH0, HIGH1, MARGIN, THIRD, FOURTH = range(0, 7 * B, B)
OWN = 7 * B
# Of a row whose coefficients are sampled: bounds of the distances of those of u and of x, and of
# what depends on the place only, from their chords.
RISE_A, RISE_B, RISE_C = range(0, 3 * B, B)
RISES = 3 * B


@compiled(inner=True)
def count_blocks(n: int) -> int:
    """Number of blocks that hold n intervals."""
    return (n + B - 1) // B


@compiled(inner=True, allocates=True)
def filled(n: int, value: float) -> FloatArray:
    """An array of n equal numbers; `np.full` and `np.zeros` take longer to compile."""
    found = np.empty(n)
    for i in range(n):
        found[i] = value
    return found


@compiled(inner=True, allocates=True)
def widths_of(s: FloatArray) -> FloatArray:
    """Lengths of intervals with these ends, (n,)."""
    found = np.empty(len(s) - 1)
    for i in range(len(found)):
        found[i] = s[i + 1] - s[i]
    return found


@compiled(inner=True)
def take_rows(values: FloatArray, begin: int, out: FloatArray, at: int) -> None:
    """Write numbers of the intervals of a block row by row; those of the last one fill it up.

    Args:
        values: Numbers of all intervals, (n, rows).
        begin: First interval of the block.
        out: Output, one line for each row.
        at: Where the row begins in its line.
    """
    # Of parts of arrays numba knows that no index is negative, which halves the time.
    part = values[begin : begin + B]
    count = len(part)
    for k in range(values.shape[1]):
        row = out[k, at : at + B]
        for m in range(count):
            row[m] = part[m, k]
        for m in range(count, B):
            row[m] = part[count - 1, k]


@compiled(inner=True)
def take_terms(a: FloatArray, b: FloatArray, begin: int, ends: FloatArray) -> None:
    """Write the coefficients of limits on a block into A0, A1, B0, B1.

    Args:
        a: Coefficients of u at starts and ends of all intervals, (2, n, rows).
        b: Coefficients of x there.
        begin: First interval of the block.
        ends: Output, (rows, 4 B).
    """
    take_rows(a[0], begin, ends, A0)
    take_rows(a[1], begin, ends, A1)
    take_rows(b[0], begin, ends, B0)
    take_rows(b[1], begin, ends, B1)


def memory_of_blocks(n: int, rows: int) -> FloatArray:
    """Memory for rows of n intervals, as the kernels take it."""
    return np.empty((-(-n // B), rows, 4 * B))
