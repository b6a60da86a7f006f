"""Estimates of a joint's parameters with 95 % intervals."""

from __future__ import annotations

import math

import numpy as np

from armcontour._checks import FloatArray
from armcontour.identification.fitting import LOGARITHMIC, Fit
from armcontour.identification.results import UNITS, Estimate

# Standard deviations in half a 95 % interval.
REACH = 1.96
# Largest standard deviation of a determined parameter: this share of its value, or this.
DETERMINED = 0.1
ALSO = {"dead_time": 0.5e-3, "velocity_feedforward": 0.05, "acceleration_feedforward": 0.05}
# Correlations of residuals below this are chance.
UNCORRELATED = 0.05


def estimate_parameters(found: Fit) -> dict[str, Estimate]:
    """Estimates of the parameters of a fit, by name; no interval for those at a bound."""
    p, names = found.problem, found.problem.model.free
    low, high = found.at_bounds()
    n = len(found.x)
    active = [k for k in range(n) if k >= p.m or names[k] not in low | high]
    residuals, jacobian = p.linearize(found.x)
    scaled = jacobian[:, active] * p.scale[active]
    freedom = max(len(residuals) - len(active), 1)
    variance = float(np.sum(residuals**2)) / freedom * correlation_length(residuals)
    sd = np.full(n, math.nan)
    inverse = np.linalg.pinv(np.einsum("ki,kj->ij", scaled, scaled), hermitian=True)
    sd[active] = np.sqrt(np.maximum(np.diag(inverse), 0.0) * variance) * p.scale[active]
    servo = found.servo._asdict()
    return {x: _estimate(x, servo[x], float(sd[k]), p.model.order) for k, x in enumerate(names)}


def _estimate(name: str, value: float, sd: float, order: str) -> Estimate:
    """An estimate from its standard deviation, for LOGARITHMIC that of the logarithm."""
    if name in LOGARITHMIC:
        factor = math.exp(min(REACH * sd, 700.0)) if math.isfinite(sd) else math.nan
        ends, sd = (value / factor, value * factor), sd * value
    else:
        ends = max(value - REACH * sd, 0.0), value + REACH * sd
    lead = name == "acceleration_feedforward" and order == "first"
    return Estimate(
        name=name,
        unit="s" if lead else UNITS[name],
        value=value,
        sd=sd,
        low=ends[0],
        high=ends[1],
        determined=bool(sd <= max(DETERMINED * value, 0.0 if lead else ALSO.get(name, 0.0))),
    )


def correlation_length(residuals: FloatArray) -> float:
    """Number of residuals that are worth one independent one, at least 1."""
    n = len(residuals)
    power = np.abs(np.fft.rfft(residuals, 2 * n)) ** 2
    correlations = np.fft.irfft(power)[: max(n // 5, 1)]
    if correlations[0] <= 0:
        return 1.0
    correlations = correlations / correlations[0]
    below = np.flatnonzero(correlations < UNCORRELATED)
    end = int(below[0]) if len(below) else len(correlations)
    return float(max(1.0, 1 + 2 * np.sum(correlations[1:end])))
