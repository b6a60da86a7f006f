"""The compiled search for places at which dq_ds of all joints vanishes."""

from __future__ import annotations

import math

import numpy as np

from armcontour._checks import BoolArray, FloatArray
from armcontour._kernels import compiled


@compiled()
def standing_breaks(coefficients: FloatArray, vanished: float) -> BoolArray:
    """Whether dq_ds of all joints vanishes at each break of a joint path, on both sides, (n + 1,).

    Args:
        coefficients: Of the joint path, (n, 6, dof).
        vanished: A dq_ds counts as zero below this share of the sum of its terms.
    """
    n, dof = coefficients.shape[0], coefficients.shape[2]
    found = np.empty(n + 1, np.bool_)
    for i in range(n + 1):
        found[i] = True
    for i in range(n):
        sizes = 0.0
        for k in range(1, 6):
            square = 0.0
            for j in range(dof):
                square += (k * coefficients[i, k, j]) ** 2
            sizes += math.sqrt(square)
        start = end = 0.0
        for j in range(dof):
            slope = 0.0
            for k in range(1, 6):
                slope += k * coefficients[i, k, j]
            start += coefficients[i, 1, j] ** 2
            end += slope**2
        found[i] &= math.sqrt(start) <= vanished * sizes
        found[i + 1] &= math.sqrt(end) <= vanished * sizes
    return found
