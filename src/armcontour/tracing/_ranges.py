"""The compiled first look at joint ranges."""

from __future__ import annotations

from armcontour._checks import FloatArray
from armcontour._kernels import compiled


@compiled()
def is_surely_within(coefficients: FloatArray, lower: FloatArray, upper: FloatArray) -> bool:
    """Whether no polynomial leaves its range by the sizes of its coefficients.

    No value is farther from that at x = 0 than the sum of all other coefficients.

    Args:
        coefficients: Of powers of x from 0 to 1, (pieces, 6, dof).
        lower: Lower ends of the ranges, (dof,).
        upper: Upper ends, (dof,).
    """
    pieces, powers, dof = coefficients.shape
    for i in range(pieces):
        for j in range(dof):
            middle, spread = coefficients[i, 0, j], 0.0
            for k in range(1, powers):
                spread += abs(coefficients[i, k, j])
            if not (middle - spread >= lower[j] and middle + spread <= upper[j]):
                return False
    return True
