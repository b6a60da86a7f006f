"""How well a fit knows its parameters, also where residuals depend on each other."""

from __future__ import annotations

import math

import numpy as np

from armcontour._checks import BoolArray, FloatArray
from armcontour.identification import _joint
from armcontour.identification.correlation import WHITE, long_run, whiteness
from armcontour.identification.fitting import Fit

# Parameters of the servo, beside those of how the log began.
WANTED = ("kp", "kv", "delay", "limit")


def is_white(found: Fit) -> bool:
    """Whether the residuals are noise alone, as far as one can see."""
    return not found.period and whiteness(found.residuals) >= WHITE


def inflation(found: Fit) -> float:
    """How many samples tell as little as one, where residuals depend on each other; at least 1.

    The likelihood counts samples as independent: what it gains or loses is this many times less.
    """
    if is_white(found):
        return 1.0
    white, robust = (np.diag(covariance(found, white=x)[0]) for x in (True, False))
    wanted = np.array([x in WANTED for x in found.state.free])
    known = wanted & np.isfinite(white) & np.isfinite(robust) & (white > 0)
    return float(np.max(robust[known] / white[known], initial=1.0))


def covariance(found: Fit, *, white: bool) -> tuple[FloatArray, int]:
    """Covariance of the free parameters (logarithms of gains and limit), and its freedom.

    The covariance is the inverse of the Fisher information, the Cramér-Rao bound. If residuals are
    not white, or repeat, it takes their dependence into account.

    Args:
        found: The fit.
        white: Whether the residuals are independent of each other.

    Returns:
        The covariance, (free, free), and its degrees of freedom.
    """
    jacobian = found.jacobian
    scale = np.sqrt(np.sum(jacobian**2, axis=1))
    scale = np.where(scale > 0, scale, 1.0)
    unit = jacobian / scale[:, None]
    inverse, lost = _inverse(_joint.normal_equations(unit, found.residuals)[0])
    freedom = max(found.count - len(found.state.free), 1)
    if white:
        middle = inverse * found.variance
    else:
        wanted = [x in WANTED for x in found.state.free]
        weights = np.sum(unit[wanted] ** 2, axis=0)
        total, freedom = long_run(unit * found.residuals, weights, found.period)
        middle = inverse @ total @ inverse
    middle[lost, lost] = math.inf
    # A variance that overflows is infinite: the log does not determine that parameter.
    with np.errstate(over="ignore"):
        return np.asarray(middle / np.outer(scale, scale)), freedom


def _inverse(normal: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Pseudo-inverse, and whether each parameter has no inverse."""
    values, vectors = np.linalg.eigh(normal)
    good = values > 1e-13 * values.max(initial=0.0)
    inverse = (vectors[:, good] / values[good]) @ vectors[:, good].T
    lost = np.sum(vectors[:, ~good] ** 2, axis=1) > 1e-6
    return np.asarray(inverse), np.asarray(lost)
