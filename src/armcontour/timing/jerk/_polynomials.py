"""Joint acceleration and jerk on cells of a path as polynomials in Bernstein form; compiled."""

from __future__ import annotations

import math

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour._kernels import compiled

# Highest degree of a joint path.
HIGHEST = 5
# Of the three control points of a on a cell of width 1: the powers of a, of dds and of its slope.
SQUARE = np.array([[1.0, -2.0, 1.0], [0.0, 2.0, -2.0], [0.0, 0.0, 1.0]])
RATE = np.array([[-1.0, 1.0], [1.0, -2.0], [0.0, 1.0]])
SLOPE = np.array([1.0, -2.0, 1.0])


def to_bernstein(degree: int) -> FloatArray:
    """The matrix that turns coefficients of powers into control points."""
    return np.array(
        [
            [math.comb(k, m) / math.comb(degree, m) for m in range(degree + 1)]
            for k in range(degree + 1)
        ]
    )


def raised(degree: int) -> FloatArray:
    """Control points of a quadratic as a polynomial of a higher degree, (degree + 1, 3)."""
    return np.asarray(to_bernstein(degree)[:, :3] @ SQUARE.T)


@compiled()
def motion_rows(
    coefficients: FloatArray,
    breaks: FloatArray,
    piece: IntArray,
    s: FloatArray,
    degree: int,
    of_powers: tuple[FloatArray, FloatArray],
    joints: tuple[IntArray, IntArray],
    found: tuple[FloatArray, FloatArray],
) -> None:
    """Control points of acceleration, and of jerk over ds, as rows of the control points of a.

    The acceleration is `q'' a + q' dds`, and the jerk over ds is `q''' a + 3 q'' dds + q' slope`.

    Args:
        coefficients: Of the joint path, (pieces, 6, dof).
        breaks: Of the joint path, (pieces + 1,).
        piece: Piece of each cell, (n,).
        s: Ends of the cells, (n + 1,).
        degree: Of the joint path.
        of_powers: `to_bernstein` of the degrees of acceleration, `degree`, and jerk, one less.
        joints: Joints whose accelerations, and whose jerks are wanted.
        found: Takes the rows, joint after joint, (n, joints (degree + 1), 3) and (n, joints
            degree, 3).
    """
    taylor = np.empty((3, HIGHEST + 1))
    powers = np.empty(2 * HIGHEST)
    t = np.empty(HIGHEST + 1)
    for i in range(len(piece)):
        k = piece[i]
        scale = 1.0 / (breaks[k + 1] - breaks[k])
        x0 = (s[i] - breaks[k]) * scale
        h = s[i + 1] - s[i]
        dx = h * scale
        for kind in range(2):
            count = degree + 1 - kind
            for place in range(len(joints[kind])):
                j = joints[kind][place]
                factor = 1.0
                for m in range(HIGHEST + 1):
                    # The m-th derivative over m!, at the start of the cell.
                    total = 0.0
                    for n in range(HIGHEST, m - 1, -1):
                        choose = 1.0
                        for c in range(m):
                            choose *= (n - c) / (c + 1.0)
                        total = total * x0 + choose * coefficients[k, n, j]
                    t[m] = total * factor
                    factor *= dx
                for m in range(HIGHEST + 1):
                    taylor[0, m] = (m + 1) * t[m + 1] / h if m < HIGHEST else 0.0
                    taylor[1, m] = (m + 2) * (m + 1) * t[m + 2] / h**2 if m < HIGHEST - 1 else 0.0
                    taylor[2, m] = (
                        (m + 3) * (m + 2) * (m + 1) * t[m + 3] / h**3 if m < HIGHEST - 2 else 0.0
                    )
                for b in range(3):
                    powers[:] = 0.0
                    for m in range(HIGHEST):
                        for n in range(3):
                            if kind == 0:
                                powers[m + n] += taylor[1, m] * SQUARE[b, n]
                            else:
                                powers[m + n] += taylor[2, m] * SQUARE[b, n]
                        for n in range(2):
                            if kind == 0:
                                powers[m + n] += taylor[0, m] * RATE[b, n] / h
                            else:
                                powers[m + n] += 3.0 * taylor[1, m] * RATE[b, n] / h
                        if kind == 1:
                            powers[m] += taylor[0, m] * SLOPE[b] / h**2
                    for c in range(count):
                        total = 0.0
                        for m in range(c + 1):
                            total += of_powers[kind][c, m] * powers[m]
                        found[kind][i, place * count + c, b] = total
