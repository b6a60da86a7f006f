"""The compiled search for places at which dq_ds of all joints vanishes."""

from __future__ import annotations

import math
from math import comb

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray
from armcontour.core.kernels import compiled

# A piece that leaves its line by more than this [rad], and than this share, is surely bent.
BENT = 1e-6
# Coefficients of dq/dx, of the powers 0 to 4 of x, to those of Bernstein: their least and largest
# values enclose dq/dx on the piece.
BERNSTEIN = np.array([[comb(i, k) / comb(4, k) for k in range(5)] for i in range(5)])


@compiled()
def moves_on(coefficients: FloatArray, vanished: float, small: float, moving: BoolArray) -> bool:
    """Whether some joint moves one way on every piece, so that dq_ds cannot vanish.

    Args:
        coefficients: Of the joint path, (n, 6, dof).
        vanished: As in `standing_breaks`, for pieces that are surely bent.
        small: A larger share of the same kind, for all others.
        moving: Written: whether a joint moves so on each piece, (n,).
    """
    n, dof = coefficients.shape[0], coefficients.shape[2]
    everywhere = True
    for i in range(n):
        sizes, longest, k0 = 0.0, 0.0, 1
        for k in range(1, 6):
            square = 0.0
            for j in range(dof):
                square += coefficients[i, k, j] ** 2
            sizes += k * math.sqrt(square)
            if square > longest:
                longest, k0 = square, k
        off = 0.0
        for k in range(1, 6):
            along = 0.0
            for j in range(dof):
                along += coefficients[i, k, j] * coefficients[i, k0, j]
            for j in range(dof):
                beside = coefficients[i, k, j] * longest - along * coefficients[i, k0, j]
                off = max(off, abs(beside))
        is_bent = off > BENT * longest * (1.0 + math.sqrt(longest))
        least = (vanished if is_bent else small) * sizes
        moving[i] = False
        for j in range(dof):
            low, high = math.inf, -math.inf
            for row in range(5):
                value = 0.0
                for k in range(row + 1):
                    value += BERNSTEIN[row, k] * (k + 1) * coefficients[i, k + 1, j]
                low, high = min(low, value), max(high, value)
            if max(low, -high) > least:
                moving[i] = True
                break
        everywhere &= moving[i]
    return everywhere


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
