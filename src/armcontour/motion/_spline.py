"""The compiled cubic spline through joint positions."""

from __future__ import annotations

import numpy as np

from armcontour._checks import FloatArray
from armcontour._kernels import compiled


@compiled()
def spline_pieces(at: FloatArray, points: FloatArray, clamped: bool) -> FloatArray:
    """Coefficients of the cubic spline through points as those of a `JointPath`, (n, 6, dof).

    Second derivatives solve a tridiagonal system; its diagonal outweighs the rest of every row, so
    it is solved from one end to the other and back.

    Args:
        at: Parameters of the points, which increase, (n + 1,).
        points: The points, (n + 1, dof).
        clamped: Whether the slopes are zero at both ends, where otherwise the second derivatives
            are.
    """
    n, dof = len(at) - 1, points.shape[1]
    found, bend, own = np.zeros((n, 6, dof)), np.zeros((n + 1, dof)), np.empty(n + 1)
    # The second derivatives at these points are not known to be zero.
    first, last = (0, n) if clamped else (1, n - 1)
    for i in range(first, last + 1):
        before = at[i] - at[i - 1] if i > 0 else 0.0
        after = at[i + 1] - at[i] if i < n else 0.0
        share = before / own[i - 1] if i > first else 0.0
        own[i] = 2 * (before + after) - share * before
        for j in range(dof):
            # Beyond a clamped end the spline goes on without slope.
            slope = (points[i, j] - points[i - 1, j]) / before if i > 0 else 0.0
            next_ = (points[i + 1, j] - points[i, j]) / after if i < n else 0.0
            bend[i, j] = 6 * (next_ - slope) - share * bend[i - 1, j]
    for i in range(last, first - 1, -1):
        after = at[i + 1] - at[i] if i < last else 0.0
        for j in range(dof):
            bend[i, j] = (bend[i, j] - after * bend[min(i + 1, n), j]) / own[i]
    for i in range(n):
        width = at[i + 1] - at[i]
        for j in range(dof):
            slope = (points[i + 1, j] - points[i, j]) / width
            start, end = bend[i, j], bend[i + 1, j]
            found[i, 0, j] = points[i, j]
            found[i, 1, j] = (slope - width * (2 * start + end) / 6) * width
            found[i, 2, j] = start / 2 * width**2
            found[i, 3, j] = (end - start) / 6 * width**2
    return found
