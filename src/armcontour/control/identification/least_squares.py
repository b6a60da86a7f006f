"""Linear algebra of least squares, and the bounded solver."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray

# The data do not determine the parameters along an eigenvector of the Gram matrix whose eigenvalue
# is below this fraction of the largest eigenvalue.
DEPENDENT = 1e-14


def normalize(columns: FloatArray, shortest: float = 1e-150) -> tuple[FloatArray, FloatArray]:
    """Columns scaled to unit norm, 0 if their norm is at most `shortest`, and the divisors."""
    norms = np.maximum(np.sqrt(np.einsum("ki,ki->i", columns, columns)), shortest)
    return columns / norms * (norms > shortest), norms


def invert(square: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Pseudo-inverse of a Gram matrix of normalized columns, and the mask of dependent columns."""
    values, vectors = np.linalg.eigh(square)
    good = values > DEPENDENT * values.max(initial=0.0)
    inverse = vectors[:, good] / values[good] @ vectors[:, good].T
    return inverse, np.sum(vectors[:, ~good] ** 2, axis=1) > 1e-6


def solve(
    residuals: Callable[[FloatArray], FloatArray],
    slopes: Callable[[FloatArray], tuple[FloatArray, FloatArray]],
    start: FloatArray,
    bounds: tuple[FloatArray, FloatArray],
    evaluations: int,
    near: float = 1e-9,
) -> Any:
    """Solve a bounded least-squares problem by `scipy.optimize.least_squares`.

    slopes(x): residuals and their derivatives. An orthogonal transformation reduces the residuals
    to their norm and zeros, so that the solver does not decompose long matrices, which is slow with
    several BLAS threads. Residuals may be nan. The search ends when an iteration reduces the sum of
    squares by less than the fraction `near`.
    """
    from scipy.optimize import least_squares

    def size(x: FloatArray) -> FloatArray:
        return np.append(np.sqrt(np.sum(residuals(x) ** 2)), np.zeros(len(x)))

    def triangle(x: FloatArray) -> FloatArray:
        columns, norms = normalize(np.column_stack(slopes(x)))
        values, vectors = np.linalg.eigh(np.einsum("ki,kj->ij", columns, columns))
        upper = np.linalg.qr(np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T)[1]
        return np.asarray(upper[:, 1:] * norms[1:] * np.copysign(1.0, upper[0, 0]))

    # Unknowns without an effect cause overflow in the step computation of the solver.
    with np.errstate(over="ignore"):
        return least_squares(
            size, start, triangle, bounds=bounds, x_scale="jac", max_nfev=evaluations,
            ftol=near, xtol=1e-10, gtol=1e-12,
        )  # fmt: skip


def standard_deviations(jacobian: FloatArray, variance: float, free: BoolArray) -> FloatArray:
    """Standard deviations of the free unknowns, 0 for the others, (unknowns,).

    - `jacobian`: derivatives of the residuals, (samples, unknowns).
    - `variance`: variance of residuals.
    """
    columns, sizes = normalize(jacobian[:, free])
    inverse, dependent = invert(np.einsum("ki,kj->ij", columns, columns))
    variances = np.where(dependent, math.inf, variance * np.diag(inverse))
    deviations = np.zeros(len(free))
    deviations[free] = np.sqrt(np.maximum(variances, 0.0)) / sizes
    return deviations
