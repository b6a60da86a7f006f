"""Acceleration and jerk of joints on parts of cells, as polynomials in Bernstein form."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.kernels import compiled
from armcontour.planning.topp.limit_forms import Intervals

# Highest degree of a joint path.
HIGHEST = 5


class Basis(NamedTuple):
    """ds², dds and slope on parts of cells, as rows of the three control points of a cell."""

    # Coefficients of ds² in powers of x, from 0 to 1 on each part, (m, 3 control points, 3)
    square: FloatArray
    rate: FloatArray  # Coefficients of dds in powers of x, (m, 3 control points, 2)
    slope: FloatArray  # Derivative of dds in s, (m, 3 control points)

    @property
    def points(self) -> FloatArray:
        """Control points of ds² on each part, (m, 3, 3 control points of the cell)."""
        return raised(self, 2)

    def at_end(self, end: int) -> tuple[FloatArray, FloatArray]:
        """Rows of ds² and dds at the start (0) or the end (1) of each part, (m, 3) each."""
        if end == 0:
            return self.square[..., 0], self.rate[..., 0]
        return self.square.sum(axis=-1), self.rate.sum(axis=-1)


def basis(start: FloatArray, share: FloatArray, width: FloatArray) -> Basis:
    """Make the basis from start and length of parts in their cell (0 to 1) and cell width [m]."""
    x, second = start[:, None], np.array([2.0, -4.0, 2.0])
    value = np.concatenate([(1 - x) ** 2, 2 * x * (1 - x), x**2], axis=1)
    first = np.concatenate([-2 * (1 - x), 2 - 4 * x, 2 * x], axis=1)
    y, h = share[:, None], width[:, None]
    square = np.stack([value, y * first, np.broadcast_to(y**2 * second / 2, value.shape)], axis=2)
    rate = np.stack([first, np.broadcast_to(y * second, first.shape)], axis=2) / (2 * h[..., None])
    return Basis(square, rate, second / (2 * h**2))


def to_bernstein(degree: int) -> FloatArray:
    """Matrix that converts coefficients of powers to control points, (degree + 1, degree + 1)."""
    return np.array(
        [
            [math.comb(k, m) / math.comb(degree, m) for m in range(degree + 1)]
            for k in range(degree + 1)
        ]
    )


def raised(basis: Basis, degree: int) -> FloatArray:
    """Control points of ds² as a polynomial of a degree of at least 2, (m, degree + 1, 3)."""
    return np.asarray(np.einsum("cm,pbm->pcb", to_bernstein(degree)[:, :3], basis.square))


@compiled()
def motion_rows(
    grid: Intervals,
    basis: Basis,
    degree: int,
    of_powers: tuple[FloatArray, FloatArray],
    joints: tuple[IntArray, IntArray],
    rows: tuple[FloatArray, FloatArray],
) -> None:
    """Write acceleration, and jerk divided by ds, as rows of the control points of ds²."""
    # The acceleration is `q'' a + q' dds`, and the jerk divided by ds is `q''' a + 3 q'' dds + q'
    # slope`, with `a = ds²`. `grid`: the n parts of cells; `of_powers`: `to_bernstein` of the
    # degrees of acceleration, `degree`, and of jerk, one less; `joints`: joints with rows of
    # acceleration, and joints with rows of jerk; `rows`: output in the order of the joints, (n,
    # joints (degree + 1), 3) and (n, joints degree, 3).
    taylor = np.empty((3, HIGHEST + 1))
    powers = np.empty(2 * HIGHEST)
    t = np.empty(HIGHEST + 1)
    for i in range(len(grid.piece)):
        k = grid.piece[i]
        scale = 1.0 / (grid.breaks[k + 1] - grid.breaks[k])
        x0 = (grid.s[i] - grid.breaks[k]) * scale
        h = grid.s[i + 1] - grid.s[i]
        dx = h * scale
        for kind in range(2):
            count = degree + 1 - kind
            for position in range(len(joints[kind])):
                j = joints[kind][position]
                factor = 1.0
                for m in range(HIGHEST + 1):
                    # `total` is the m-th derivative at the start of the part, divided by m!.
                    total = 0.0
                    for n in range(HIGHEST, m - 1, -1):
                        choose = 1.0
                        for c in range(m):
                            choose *= (n - c) / (c + 1.0)
                        total = total * x0 + choose * grid.coefficients[(6 * k + n) * grid.dof + j]
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
                                powers[m + n] += taylor[1, m] * basis.square[i, b, n]
                            else:
                                powers[m + n] += taylor[2, m] * basis.square[i, b, n]
                        for n in range(2):
                            if kind == 0:
                                powers[m + n] += taylor[0, m] * basis.rate[i, b, n]
                            else:
                                powers[m + n] += 3.0 * taylor[1, m] * basis.rate[i, b, n]
                        if kind == 1:
                            powers[m] += taylor[0, m] * basis.slope[i, b]
                    for c in range(count):
                        total = 0.0
                        for m in range(c + 1):
                            total += of_powers[kind][c, m] * powers[m]
                        rows[kind][i, position * count + c, b] = total
