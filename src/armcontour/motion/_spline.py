"""The compiled cubic spline through joint positions."""

from __future__ import annotations

import numpy as np

from armcontour._checks import FloatArray
from armcontour._kernels import compiled


@compiled()
def spline_pieces(at: FloatArray, points: FloatArray, clamped: bool) -> tuple[FloatArray, bool]:
    """The pieces of the cubic spline through points.

    Second derivatives solve a tridiagonal system; its diagonal outweighs the rest of every row, so
    it is solved from one end to the other and back.

    Args:
        at: Parameters of the points, (n + 1,).
        points: The points, (n + 1, dof).
        clamped: Whether the slopes are zero at both ends, where otherwise the second derivatives
            are.

    Returns:
        Coefficients of the pieces as those of a `JointPath`, (n, 6, dof), and whether the
        parameters increase; if not, the coefficients are nothing.
    """
    n, dof = len(at) - 1, points.shape[1]
    found, bend, own = np.empty((n, 6, dof)), np.empty((n + 1, dof)), np.empty(n + 1)
    for i in range(n):
        if not at[i + 1] > at[i]:
            return found, False
    # The second derivatives at these points are not known to be zero.
    first, last = (0, n) if clamped else (1, n - 1)
    for i in range(n + 1):
        before = at[i] - at[i - 1] if i > 0 else 0.0
        after = at[i + 1] - at[i] if i < n else 0.0
        own[i] = 2 * (before + after)
        share = before / own[i - 1] if i > first else 0.0
        own[i] -= share * before
        for j in range(dof):
            # Beyond a clamped end the spline goes on without slope.
            slope = (points[i, j] - points[i - 1, j]) / before if i > 0 else 0.0
            next_ = (points[i + 1, j] - points[i, j]) / after if i < n else 0.0
            bend[i, j] = 6 * (next_ - slope) if first <= i <= last else 0.0
            if first < i <= last:
                bend[i, j] -= share * bend[i - 1, j]
    for i in range(last, first - 1, -1):
        for j in range(dof):
            if i < last:
                bend[i, j] -= (at[i + 1] - at[i]) * bend[i + 1, j]
            bend[i, j] /= own[i]
    for i in range(n):
        width = at[i + 1] - at[i]
        for j in range(dof):
            slope = (points[i + 1, j] - points[i, j]) / width
            start, end = bend[i, j], bend[i + 1, j]
            found[i, 0, j] = points[i, j]
            found[i, 1, j] = (slope - width * (2 * start + end) / 6) * width
            found[i, 2, j] = start / 2 * width**2
            found[i, 3, j] = (end - start) / 6 * width**2
            found[i, 4, j] = found[i, 5, j] = 0.0
    return found, True
