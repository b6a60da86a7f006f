"""Parameters of a fit, with intervals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from armcontour.control.identification.candidate_models import ACCELERATION
from armcontour.control.identification.estimate import LOGARITHMIC, Estimate
from armcontour.control.identification.joint_fit import Fit
from armcontour.control.identification.least_squares import standard_deviations
from armcontour.control.identification.residual_tests import correlation_length
from armcontour.core.checks import FloatArray
from armcontour.robot.servo.simulation import JointServo

# Half-width of a 95 % interval of a normal distribution [standard deviations].
HALF_INTERVAL = 1.96
# Parameters with at most this standard deviation are determined, however small their value is.
SUFFICIENT_SD = {
    "dead_time": 0.5e-3,
    "velocity_feedforward": 0.05,
    "acceleration_feedforward": 0.05,
}
# Lower bound of a gain in logarithms [1/s].
LEAST_GAIN = 1e-9
# A drive cycle has at most this multiple of the effect that a first-order approximation has.
CYCLE_EFFECT = 1.2


def estimate_parameters(
    fit: Fit,
    without: Sequence[JointServo] = (),
    longest_cycle: float = 0.0,
    rivals: Sequence[JointServo] = (),
) -> dict[str, Estimate]:
    """Estimate the parameters of a fit, by name; parameters at a bound have no interval.

    With the derivatives D of the residuals, the covariance is `(DᵀD)⁻¹ s² n`, where s² is the
    variance of the residuals and n their correlation length. A standard deviation is at least the
    scatter of the other servos.

    - `without`: servos, each fitted without one part of the logs. Their scatter includes the
      effects that are not modelled, such as other joints.
    - `longest_cycle`: longest possible drive cycle [s]; 0 if the drive cycle is known.
    - `rivals`: servos of other models with nearly the same error, if the residuals of the best
      model are not white.
    """
    servo = fit.servo
    cycled = add_drive_cycle(servo, longest_cycle)
    model = fit.problem.model
    estimates = {}
    for name, sd in zip(model.free, _parameter_deviations(fit).tolist(), strict=True):
        value = getattr(servo, name)
        if math.isfinite(sd):
            jackknife = _jackknife_deviation(name, without)
            sd = max(sd, jackknife, _rival_deviation(name, value, rivals))
        shift = _shift(name, value, getattr(cycled, name))
        low = min(shift, 0.0) - HALF_INTERVAL * sd
        high = max(shift, 0.0) + HALF_INTERVAL * sd
        if name not in LOGARITHMIC:
            low = max(low, -value)
        options: dict[str, Any] = {"also": SUFFICIENT_SD.get(name, 0.0)}
        if name == ACCELERATION and model.order == "first":
            options = {"unit": "s"}
        estimates[name] = Estimate.from_interval(name, value, sd, (low, high), **options)
    return estimates


def _parameter_deviations(fit: Fit) -> FloatArray:
    """Return the standard deviations of a fit's parameters, (m,); nan for those at a bound."""
    problem = fit.problem
    count = problem.parameter_count
    bounds = set().union(*fit.at_bounds())
    free = np.full(len(fit.x), True)
    free[:count] = [x not in bounds for x in problem.model.free]
    residuals, jacobian = problem.linearize(fit.x)
    freedom = max(len(residuals) - int(np.sum(free)), 1)
    variance = float(np.sum(residuals**2)) / freedom * correlation_length(residuals)
    deviations = standard_deviations(jacobian, variance, free)
    return np.where(free, deviations, math.nan)[:count]


def _jackknife_deviation(name: str, without: Sequence[JointServo]) -> float:
    """Return the standard deviation of a parameter from fits without one of k parts each.

    It is `sqrt(k - 1)` times the scatter of the fits (B. Efron, The Jackknife, the Bootstrap and
    Other Resampling Plans, 1982, section 3.2).
    """
    if not without:
        return 0.0
    values = _scaled(name, np.array([getattr(x, name) for x in without]))
    return float(np.std(values) * math.sqrt(len(values) - 1))


def _rival_deviation(name: str, value: float, rivals: Sequence[JointServo]) -> float:
    """Return a parameter's standard deviation over the best and the rival models that have it.

    - `value`: value of the parameter in the best model.
    """
    values = np.array([getattr(x, name) for x in rivals])
    return float(np.std(_scaled(name, np.append(values[np.isfinite(values)], value))))


def _shift(name: str, value: float, other: float) -> float:
    """Return how much another value of a parameter is larger, in the logarithm for LOGARITHMIC."""
    return math.log(other / value) if name in LOGARITHMIC else other - value


def _scaled(name: str, values: Any) -> Any:
    """Return the values of a parameter, or their logarithms for LOGARITHMIC."""
    return np.log(np.maximum(values, LEAST_GAIN)) if name in LOGARITHMIC else values


def add_drive_cycle(servo: JointServo, drive_cycle: float) -> JointServo:
    """Return the servo with a drive cycle [s] that moves, to first order, as the given servo.

    Held values and differences over a drive cycle are delayed by half of the cycle.
    """
    half = CYCLE_EFFECT * drive_cycle / 2
    kp = servo.kp / (1 + servo.kp * half)
    ki = servo.ki / (1 + servo.ki * half)
    slow = 1 - (kp + ki) * half
    return servo._replace(
        kp=kp,
        ki=ki,
        kv=servo.kv / (slow + servo.kv * half) if math.isfinite(servo.kv) else servo.kv,
        velocity_feedforward=servo.velocity_feedforward * slow / (1 + kp * half),
        dead_time=max(servo.dead_time - half * (1 + servo.velocity_feedforward), 0.0),
    )
