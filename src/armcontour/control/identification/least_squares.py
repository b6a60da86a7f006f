"""Least squares of both identifications: solver, covariance, tolerances of parameters."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray

# Largest standard deviation of a determined parameter, as a share of its value.
SHARE = 0.10
# Lowest lines of the spectrum of the scores, and samples for each line (Müller, Econometrica 2007).
LINES, PER_LINE = 24, 4
# Directions with less information than this share of the largest one are not determined.
DEPENDENT = 1e-14


def allowed_deviation(value: Any, also: Any = 0.0) -> Any:
    """Largest standard deviation of a determined parameter: a share of its value, or `also`."""
    return np.maximum(SHARE * np.abs(value), also)


def normalize(columns: FloatArray, shortest: float = 1e-150) -> tuple[FloatArray, FloatArray]:
    """Columns scaled to unit norm, 0 if their norm is at most `shortest`, and the norms used."""
    norms = np.maximum(np.sqrt(np.einsum("ki,ki->i", columns, columns)), shortest)
    return columns / norms * (norms > shortest), norms


def invert(square: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Inverse of products of normalized columns, and the columns that depend on others."""
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
    # An orthogonal transformation reduces the residuals to one number and zeros, so that the solver
    # does not decompose long matrices, which is slow with several BLAS threads. Residuals may be
    # nan. A reduction of the sum of squares by less than the share `near` ends the search.
    from scipy.optimize import least_squares

    def size(x: FloatArray) -> FloatArray:
        return np.append(np.sqrt(np.sum(residuals(x) ** 2)), np.zeros(len(x)))

    def triangle(x: FloatArray) -> FloatArray:
        columns, norms = normalize(np.column_stack(slopes(x)))
        values, vectors = np.linalg.eigh(np.einsum("ki,kj->ij", columns, columns))
        upper = np.linalg.qr(np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T)[1]
        return np.asarray(upper[:, 1:] * norms[1:] * np.copysign(1.0, upper[0, 0]))

    # Unknowns without any effect overflow in the solver's search for a step.
    with np.errstate(over="ignore"):
        return least_squares(
            size, start, triangle, bounds=bounds, x_scale="jac", max_nfev=evaluations,
            ftol=near, xtol=1e-10, gtol=1e-12,
        )  # fmt: skip


class Precision(NamedTuple):
    """Fisher information of the logs about the unknowns, scaled to 1 for each unknown."""

    information: FloatArray  # Products of the scaled derivatives, (unknowns, unknowns)
    scores: FloatArray  # Covariance of derivatives times residuals, (unknowns, unknowns)
    size: FloatArray  # Units, (unknowns,)
    freedom: float = math.inf  # Degrees of freedom of the covariance; infinite if it is known

    @classmethod
    def from_jacobian(cls, jacobian: FloatArray, variance: float = 1.0) -> Precision:
        """The precision of a fit whose residuals are independent."""
        # jacobian (samples, unknowns).
        unit, size = normalize(jacobian)
        information = np.einsum("ki,kj->ij", unit, unit)
        return cls(information, variance * information, size)

    @classmethod
    def correlated(cls, jacobian: FloatArray, residuals: FloatArray) -> Precision:
        """The precision of a fit whose residuals may be correlated."""
        # The covariance of the sum of the scores is that of the lowest lines of their spectrum.
        # jacobian (samples, dof, unknowns), residuals (samples, dof).
        independent = cls.from_jacobian(jacobian.reshape(-1, jacobian.shape[2]))
        unit = jacobian / independent.size
        # Samples without information take no time.
        weights = np.sum(unit**2, axis=(1, 2))
        clock = (np.cumsum(weights) - weights / 2) / max(float(np.sum(weights)), 1e-300)
        lines = max(min(LINES, len(clock) // PER_LINE), 2)
        waves = np.sqrt(2) * np.cos(np.pi * np.outer(clock, np.arange(1, lines + 1)))
        amplitudes = np.einsum("sjp,sj->ps", unit, residuals) @ waves
        return independent._replace(scores=amplitudes @ amplitudes.T / lines, freedom=lines)

    @property
    def quantile(self) -> float:
        """Half of the width of a 95 % interval, in standard deviations."""
        from scipy.special import stdtrit

        return float(stdtrit(self.freedom, 0.975))

    def covariance(self, free: BoolArray) -> FloatArray:
        """Covariance if only the free unknowns are estimated, else 0, (unknowns, unknowns)."""
        block, covariance = np.ix_(free, free), np.zeros_like(self.information)
        inverse, dependent = invert(self.information[block])
        part = inverse @ self.scores[block] @ inverse
        part[dependent, dependent] = math.inf
        covariance[block] = part / np.outer(self.size[free], self.size[free])
        return covariance

    def sd(self, free: BoolArray) -> FloatArray:
        """Standard deviations if only the free unknowns are estimated, (unknowns,)."""
        return np.asarray(np.sqrt(np.maximum(np.diag(self.covariance(free)), 0.0)))
