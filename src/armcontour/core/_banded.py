"""Symmetric banded equations: those of splines, of interpolation and of smooth motions."""

from __future__ import annotations

from armcontour.core.checks import FloatArray
from armcontour.core.kernels import compiled


@compiled()
def solve_banded(bands: FloatArray, right: FloatArray) -> None:
    """Solve symmetric banded equations in place; `right` becomes the solution.

    By elimination without pivots, as for diagonally dominant or positive definite equations.

    Args:
        bands: Row i has the entries of row i of the matrix from its diagonal to the right, and
            anything beyond the last column, (m, width), overwritten.
        right: Right sides, one a column, (m, n).
    """
    m, width = bands.shape
    sides = right.shape[1]
    for i in range(m):
        for k in range(1, min(width, m - i)):
            factor = bands[i, k] / bands[i, 0]
            for j in range(k, min(width, m - i)):
                bands[i + k, j - k] -= factor * bands[i, j]
            for c in range(sides):
                right[i + k, c] -= right[i, c] * factor
    for i in range(m - 1, -1, -1):
        for c in range(sides):
            value = right[i, c] / bands[i, 0]
            for k in range(1, min(width, m - i)):
                value -= right[i + k, c] * (bands[i, k] / bands[i, 0])
            right[i, c] = value
