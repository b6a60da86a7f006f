"""Linear algebra of least squares, and the bounded solver."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Literal

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray

# The data do not determine the parameters along an eigenvector of the Gram matrix whose eigenvalue
# is below this fraction of the largest eigenvalue.
DEPENDENT = 1e-14
# A column is dependent if the eigenvectors that the data do not determine contain more than this
# fraction of it.
DEPENDENT_SHARE = 1e-6
# The solver also ends if a step changes the unknowns by less than this fraction.
STEP_TOLERANCE = 1e-10
# The solver also ends if the scaled gradient is below this value.
GRADIENT_TOLERANCE = 1e-12


def normalize(columns: FloatArray, shortest: float = 1e-150) -> tuple[FloatArray, FloatArray]:
    """Scale columns to unit norm.

    - `columns`: (samples, n).
    - `shortest`: columns with at most this norm become 0.

    Returns the scaled columns and their divisors, (n,).
    """
    norms = np.maximum(np.sqrt(np.einsum("ki,ki->i", columns, columns)), shortest)
    return columns / norms * (norms > shortest), norms


def invert(square: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Invert the Gram matrix `AᵀA` of normalized columns A, without its dependent directions.

    Returns the pseudo-inverse and a mask of the columns that depend on others, (n,).
    """
    values, vectors = np.linalg.eigh(square)
    good = values > DEPENDENT * values.max(initial=0.0)
    inverse = vectors[:, good] / values[good] @ vectors[:, good].T
    return inverse, np.sum(vectors[:, ~good] ** 2, axis=1) > DEPENDENT_SHARE


def solve(
    residuals: Callable[[FloatArray], FloatArray],
    slopes: Callable[[FloatArray], tuple[FloatArray, FloatArray]],
    start: FloatArray,
    bounds: tuple[FloatArray, FloatArray],
    evaluations: int,
    method: Literal["trf", "dogbox"] = "trf",
    cost_tolerance: float = 1e-9,
) -> Any:
    """Solve a bounded least-squares problem by `scipy.optimize.least_squares`.

    The solver gets a problem with the same sum of squares, gradient and Gauss-Newton steps, but
    only n + 1 rows for n unknowns. With the residuals r and derivatives J, (samples, n),

        [r J] = Q R,  R = [‖r‖ R₁; 0 R₂]

    where Q has orthonormal columns and R is triangular, the residuals are `[‖r‖, 0]` and the
    derivatives `[R₁; R₂]`. Decompositions of long matrices would be slow with several BLAS threads.

    - `residuals`: function from the unknowns to the residuals, (samples,), which may be nan.
    - `slopes`: function from the unknowns to residuals and derivatives.
    - `start`: initial unknowns, (n,).
    - `bounds`: lower and upper bounds, (n,) each.
    - `evaluations`: largest number of evaluations.
    - `method`: solver of scipy: the interior "trf", which finds the valley of the minimum from far
      away, or "dogbox", which is fast along a valley and next to a bound.
    - `cost_tolerance`: the search ends if an iteration reduces the sum of squares by less than this
      fraction.

    Returns the solution of scipy.
    """
    from scipy.optimize import least_squares

    def reduced_residuals(x: FloatArray) -> FloatArray:
        """Return `[‖r‖, 0]`, (n + 1,)."""
        return np.append(np.sqrt(np.sum(residuals(x) ** 2)), np.zeros(len(x)))

    def reduced_slopes(x: FloatArray) -> FloatArray:
        """Return `[R₁; R₂]`, (n + 1, n)."""
        columns, norms = normalize(np.column_stack(slopes(x)))
        upper = _triangle(np.einsum("ki,kj->ij", columns, columns))
        # The reduced residual ‖r‖ is positive, so R is negated if its first element is negative.
        return np.asarray(upper[:, 1:] * norms[1:] * np.copysign(1.0, upper[0, 0]))

    # Unknowns without an effect cause overflow in the step computation of the solver.
    with np.errstate(over="ignore"):
        return least_squares(
            reduced_residuals,
            start,
            reduced_slopes,
            bounds=bounds,
            method=method,
            x_scale="jac",
            max_nfev=evaluations,
            ftol=cost_tolerance,
            xtol=STEP_TOLERANCE,
            gtol=GRADIENT_TOLERANCE,
        )


def _triangle(square: FloatArray) -> FloatArray:
    """Return the triangular factor R with `RᵀR = AᵀA` of a Gram matrix AᵀA.

    With `AᵀA = V Λ Vᵀ`, R is the factor of `sqrt(Λ) Vᵀ = Q R`. Cholesky's factorization would fail
    if columns are dependent.
    """
    values, vectors = np.linalg.eigh(square)
    root = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T
    return np.asarray(np.linalg.qr(root)[1])


def standard_deviations(jacobian: FloatArray, variance: float, free: BoolArray) -> FloatArray:
    """Return the standard deviations of the unknowns, (n,), from the covariance `s² (JᵀJ)⁻¹`.

    - `jacobian`: derivatives J of the residuals, (samples, n).
    - `variance`: variance s² of the residuals.
    - `free`: mask of the unknowns that are not at a bound; the others have the deviation 0.
    """
    columns, sizes = normalize(jacobian[:, free])
    inverse, dependent = invert(np.einsum("ki,kj->ij", columns, columns))
    variances = np.where(dependent, math.inf, variance * np.diag(inverse))
    deviations = np.zeros(len(free))
    deviations[free] = np.sqrt(np.maximum(variances, 0.0)) / sizes
    return deviations
