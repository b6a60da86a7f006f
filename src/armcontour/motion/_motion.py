"""The compiled motion along a joint path: positions and their derivatives at many places."""

from __future__ import annotations

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour._kernels import compiled


@compiled(inner=True, inline="always")
def value_and_slopes(
    a0: float, a1: float, a2: float, a3: float, a4: float, a5: float, x: float
) -> tuple[float, float, float]:
    """The polynomial with these coefficients at x, and its first and second derivative."""
    # Horner's rule for all three.
    slope, value, bend = a5, a5 * x + a4, 0.0
    bend, slope, value = bend * x + 2 * slope, slope * x + value, value * x + a3
    bend, slope, value = bend * x + 2 * slope, slope * x + value, value * x + a2
    bend, slope, value = bend * x + 2 * slope, slope * x + value, value * x + a1
    bend, slope, value = bend * x + 2 * slope, slope * x + value, value * x + a0
    return value, slope, bend


@compiled()
def motion(
    breaks: FloatArray, coefficients: FloatArray, piece: IntArray, s: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """q, dq_ds and d2q_ds2 at all places, (n, dof) each.

    Args:
        breaks: Ends of the pieces [m], (pieces + 1,).
        coefficients: Of the quintics over each piece, (pieces, 6, dof).
        piece: Piece of each place, (n,).
        s: Arc length of each place [m], (n,).
    """
    n, dof = len(s), coefficients.shape[2]
    q, first, second = np.empty((n, dof)), np.empty((n, dof)), np.empty((n, dof))
    for i in range(n):
        k = piece[i]
        width = breaks[k + 1] - breaks[k]
        x = (s[i] - breaks[k]) / width
        for j in range(dof):
            a0, a1, a2 = coefficients[k, 0, j], coefficients[k, 1, j], coefficients[k, 2, j]
            a3, a4, a5 = coefficients[k, 3, j], coefficients[k, 4, j], coefficients[k, 5, j]
            value, slope, bend = value_and_slopes(a0, a1, a2, a3, a4, a5, x)
            q[i, j], first[i, j], second[i, j] = value, slope / width, bend / (width * width)
    return q, first, second
