"""Joint acceleration and jerk on parts of cells as polynomials in Bernstein form; compiled."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.kernels import compiled

# Highest degree of a joint path.
HIGHEST = 5


class Basis(NamedTuple):
    """ds² and its rates on parts of cells, by the three control points of ds² on each cell.

    Args:
        square: Powers of x, from 0 to 1 on each part, of ds², (m, 3 control points, 3).
        rate: Powers of x of dds, (m, 3, 2).
        slope: The slope of dds over s, (m, 3).
    """

    square: FloatArray
    rate: FloatArray
    slope: FloatArray

    @property
    def points(self) -> FloatArray:
        """Control points of ds² on each part, (m, 3, 3 control points of the cell)."""
        return raised(self, 2)

    def at_end(self, end: int) -> tuple[FloatArray, FloatArray]:
        """ds² and dds at the start (0) or the end (1) of each part, (m, 3) each."""
        if end == 0:
            return self.square[..., 0], self.rate[..., 0]
        return self.square.sum(axis=-1), self.rate.sum(axis=-1)


def basis(start: FloatArray, share: FloatArray, width: FloatArray) -> Basis:
    """The basis on parts of cells.

    Args:
        start: Where each part starts in its cell, from 0 to 1, (m,).
        share: Its share of the cell, (m,).
        width: Length of the cell [m], (m,).
    """
    x, second = start[:, None], np.array([2.0, -4.0, 2.0])
    value = np.concatenate([(1 - x) ** 2, 2 * x * (1 - x), x**2], axis=1)
    first = np.concatenate([-2 * (1 - x), 2 - 4 * x, 2 * x], axis=1)
    y, h = share[:, None], width[:, None]
    square = np.stack([value, y * first, np.broadcast_to(y**2 * second / 2, value.shape)], axis=2)
    rate = np.stack([first, np.broadcast_to(y * second, first.shape)], axis=2) / (2 * h[..., None])
    return Basis(square, rate, second / (2 * h**2))


def to_bernstein(degree: int) -> FloatArray:
    """The matrix that turns coefficients of powers into control points."""
    return np.array(
        [
            [math.comb(k, m) / math.comb(degree, m) for m in range(degree + 1)]
            for k in range(degree + 1)
        ]
    )


def raised(on: Basis, degree: int) -> FloatArray:
    """Control points of ds² as a polynomial of a degree of at least two, (m, degree + 1, 3)."""
    return elevated(on.square, degree)


def elevated(powers: FloatArray, degree: int) -> FloatArray:
    """Control points of polynomials of a lower degree, given by powers, (m, degree + 1, 3)."""
    own = to_bernstein(degree)[:, : powers.shape[2]]
    return np.asarray(np.einsum("cm,pbm->pcb", own, powers))


@compiled()
def motion_rows(
    coefficients: FloatArray,
    breaks: FloatArray,
    piece: IntArray,
    s: FloatArray,
    on: Basis,
    degree: int,
    of_powers: tuple[FloatArray, FloatArray],
    joints: tuple[IntArray, IntArray],
    found: tuple[FloatArray, FloatArray],
) -> None:
    """Control points of acceleration, and of jerk over ds, as rows of the control points of ds².

    The acceleration is `q'' a + q' dds`, and the jerk over ds is `q''' a + 3 q'' dds + q' slope`.

    Args:
        coefficients: Of the joint path, (pieces, 6, dof).
        breaks: Of the joint path, (pieces + 1,).
        piece: Piece of each part, (n,).
        s: Ends of the parts, (n + 1,).
        on: The basis on the parts.
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
                    # The m-th derivative over m!, at the start of the part.
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
                                powers[m + n] += taylor[1, m] * on.square[i, b, n]
                            else:
                                powers[m + n] += taylor[2, m] * on.square[i, b, n]
                        for n in range(2):
                            if kind == 0:
                                powers[m + n] += taylor[0, m] * on.rate[i, b, n]
                            else:
                                powers[m + n] += 3.0 * taylor[1, m] * on.rate[i, b, n]
                        if kind == 1:
                            powers[m] += taylor[0, m] * on.slope[i, b]
                    for c in range(count):
                        total = 0.0
                        for m in range(c + 1):
                            total += of_powers[kind][c, m] * powers[m]
                        found[kind][i, place * count + c, b] = total
