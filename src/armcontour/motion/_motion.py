"""The compiled motion along a joint path: positions and their derivatives at many places."""

from __future__ import annotations

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour._kernels import compiled


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
            # Horner's rule for the value and both derivatives; `bend` is the second derivative.
            value = slope = bend = 0.0
            for power in range(5, -1, -1):
                bend = bend * x + 2 * slope
                slope = slope * x + value
                value = value * x + coefficients[k, power, j]
            q[i, j], first[i, j], second[i, j] = value, slope / width, bend / (width * width)
    return q, first, second
