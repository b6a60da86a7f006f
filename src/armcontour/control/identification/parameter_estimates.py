"""Estimates of the parameters of a fit, with intervals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from armcontour.control.identification.estimate import LOGARITHMIC, Estimate
from armcontour.control.identification.joint_fit import Fit
from armcontour.control.identification.least_squares import standard_deviations
from armcontour.control.identification.residual_tests import correlation_length
from armcontour.robot.servo.simulation import JointServo

# Half-width of a 95 % interval of a normal distribution [standard deviations].
HALF_INTERVAL = 1.96
# Parameters with at most this standard deviation are determined, however small their value is.
SUFFICIENT_SD = {
    "dead_time": 0.5e-3,
    "velocity_feedforward": 0.05,
    "acceleration_feedforward": 0.05,
}
# Largest ratio of the effect of a drive cycle to its first-order approximation.
CYCLE_EFFECT = 1.2


def estimate_parameters(
    fit: Fit,
    without: Sequence[JointServo] = (),
    longest_cycle: float = 0.0,
    rivals: Sequence[JointServo] = (),
) -> dict[str, Estimate]:
    """Estimates of the parameters of a fit by name; parameters at a bound have no interval.

    - `without`: servos, each fitted without one part of the logs. Their scatter includes the
      effects that are not modelled, such as other joints.
    - `rivals`: servos of other models with nearly the same error, if the residuals of the best
      model are not white.
    - `longest_cycle`: longest possible drive cycle [s]; 0 if the drive cycle is known.
    """
    p = fit.problem
    names = fit.problem.model.free
    bounds = set().union(*fit.at_bounds())
    free = np.full(len(fit.x), True)
    free[: p.m] = [x not in bounds for x in names]
    residuals, jacobian = p.linearize(fit.x)
    freedom = max(len(residuals) - int(np.sum(free)), 1)
    variance = float(np.sum(residuals**2)) / freedom * correlation_length(residuals)
    deviations = np.where(free, standard_deviations(jacobian, variance, free), math.nan)
    servo = fit.servo
    estimates = {}
    cycled = add_drive_cycle(servo, longest_cycle)
    for name, sd in zip(names, deviations.tolist(), strict=False):
        value = getattr(servo, name)
        other = getattr(cycled, name)
        every = np.array([getattr(x, name) for x in without])
        others = np.array([getattr(x, name) for x in rivals])
        others = np.append(others[np.isfinite(others)], value)
        shift = other - value
        if name in LOGARITHMIC:
            every, others = (np.log(np.maximum(y, 1e-9)) for y in (every, others))
            shift = math.log(other / value)
        if math.isfinite(sd):
            jackknife = float(np.std(every) * math.sqrt(len(every) - 1)) if len(every) else 0.0
            sd = max(sd, jackknife, float(np.std(others)))
        low = min(shift, 0.0) - HALF_INTERVAL * sd
        high = max(shift, 0.0) + HALF_INTERVAL * sd
        if name not in LOGARITHMIC:
            low = max(low, -value)
        options: dict[str, Any] = {"also": SUFFICIENT_SD.get(name, 0.0)}
        if name == "acceleration_feedforward" and p.model.order == "first":
            options = {"unit": "s"}
        estimates[name] = Estimate.from_interval(name, value, sd, (low, high), **options)
    return estimates


def add_drive_cycle(servo: JointServo, drive_cycle: float) -> JointServo:
    """The servo with a drive cycle [s] that is equivalent, to first order, to the given servo."""
    # Held values and differences over a drive cycle are delayed by half a drive cycle.
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
