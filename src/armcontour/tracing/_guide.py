"""Compiled elimination for splines."""

from __future__ import annotations

from armcontour._checks import FloatArray
from armcontour._kernels import compiled


@compiled()
def solve_tridiagonal(
    below: FloatArray, own: FloatArray, above: FloatArray, right: FloatArray
) -> None:
    """Solve tridiagonal equations in place by elimination without pivoting.

    Args:
        below: The matrix below its diagonal, (n - 1,).
        own: Its diagonal, (n,), overwritten.
        above: Above its diagonal, (n - 1,).
        right: The right sides, (n, values); they become the solutions.
    """
    n, values = right.shape
    for i in range(1, n):
        factor = below[i - 1] / own[i - 1]
        own[i] -= factor * above[i - 1]
        for j in range(values):
            right[i, j] -= factor * right[i - 1, j]
    for i in range(n - 1, -1, -1):
        for j in range(values):
            if i + 1 < n:
                right[i, j] -= above[i] * right[i + 1, j]
            right[i, j] /= own[i]
