"""Least squares for both identifications: solver, covariance and tolerances of parameters."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray

# Largest standard deviation of a determined parameter, relative to its value.
RELATIVE_SD = 0.10
# Long-run covariance of the scores (Müller, Econometrica 2007): largest number of spectral lines
# that are averaged, and smallest number of samples per line.
LINES, SAMPLES_PER_LINE = 24, 4
# The data do not determine the parameters along an eigenvector of the Gram matrix whose eigenvalue
# is below this share of the largest eigenvalue.
DEPENDENT = 1e-14


def allowed_deviation(value: Any, also: Any = 0.0) -> Any:
    """Largest standard deviation of a determined parameter: share of its value, at least `also`."""
    return np.maximum(RELATIVE_SD * np.abs(value), also)


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
    """Solve a bounded least-squares problem by `scipy.optimize.least_squares`."""
    # slopes(x): residuals and their derivatives. An orthogonal transformation reduces the residuals
    # to their norm and zeros, so that the solver does not decompose long matrices, which is slow
    # with several BLAS threads. Residuals may be nan. The search ends when an iteration reduces the
    # sum of squares by less than the share `near`.
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


class Precision(NamedTuple):
    """Fisher information about the unknowns, scaled so that its diagonal is 1."""

    # information: Gram matrix of the normalized derivatives of the residuals, (unknowns, unknowns).
    information: FloatArray
    # scores: covariance of the scores (sums of derivatives times residuals), (unknowns, unknowns).
    scores: FloatArray
    size: FloatArray  # Norms of the derivatives before normalization, (unknowns,)
    freedom: float = math.inf  # Degrees of freedom of the covariance; infinite if it is exact

    @classmethod
    def from_jacobian(cls, jacobian: FloatArray, variance: float = 1.0) -> Precision:
        """Precision of a fit with independent residuals; jacobian (samples, unknowns)."""
        unit, size = normalize(jacobian)
        information = np.einsum("ki,kj->ij", unit, unit)
        return cls(information, variance * information, size)

    @classmethod
    def correlated(cls, jacobian: FloatArray, residuals: FloatArray) -> Precision:
        """Precision of a fit whose residuals may be correlated."""
        # The covariance of the sum of the scores is the mean over the lowest lines in the cosine
        # spectrum of the scores. jacobian (samples, dof, unknowns), residuals (samples, dof).
        independent = cls.from_jacobian(jacobian.reshape(-1, jacobian.shape[2]))
        unit = jacobian / independent.size
        # The cosines are functions of the accumulated information instead of time.
        weights = np.sum(unit**2, axis=(1, 2))
        clock = (np.cumsum(weights) - weights / 2) / max(float(np.sum(weights)), 1e-300)
        lines = max(min(LINES, len(clock) // SAMPLES_PER_LINE), 2)
        waves = np.sqrt(2) * np.cos(np.pi * np.outer(clock, np.arange(1, lines + 1)))
        amplitudes = np.einsum("sjp,sj->ps", unit, residuals) @ waves
        return independent._replace(scores=amplitudes @ amplitudes.T / lines, freedom=lines)

    @property
    def quantile(self) -> float:
        """Half-width of a 95 % interval [standard deviations]."""
        from scipy.special import stdtrit

        return float(stdtrit(self.freedom, 0.975))

    def covariance(self, free: BoolArray) -> FloatArray:
        """Covariance of the free unknowns, 0 for the others, (unknowns, unknowns)."""
        block, covariance = np.ix_(free, free), np.zeros_like(self.information)
        inverse, dependent = invert(self.information[block])
        part = inverse @ self.scores[block] @ inverse
        part[dependent, dependent] = math.inf
        covariance[block] = part / np.outer(self.size[free], self.size[free])
        return covariance

    def sd(self, free: BoolArray) -> FloatArray:
        """Standard deviations of the free unknowns, 0 for the others, (unknowns,)."""
        return np.asarray(np.sqrt(np.maximum(np.diag(self.covariance(free)), 0.0)))
