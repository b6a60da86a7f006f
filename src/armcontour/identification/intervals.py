"""Estimates of a joint's parameters with 95 % intervals."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from armcontour._checks import FloatArray
from armcontour.identification.fitting import LOGARITHMIC, Fit, noise_of
from armcontour.identification.results import UNITS, Estimate
from armcontour.servo.simulation import JointServo

# Standard deviations in half a 95 % interval.
REACH = 1.96
# Largest standard deviation of a determined parameter: this share of its value, or this.
DETERMINED = 0.1
ALSO = {"dead_time": 0.5e-3, "velocity_feedforward": 0.05, "acceleration_feedforward": 0.05}
# Correlations of residuals below this are chance.
UNCORRELATED = 0.05
# Effects of a cycle are larger than those of first order by up to this factor.
HIGHER = 1.2
# Residuals with this chance are not white; the fewest lines of a spectrum that are compared.
CHANCE, FEWEST_LINES = 0.01, 8
# Rounding of positions as a share of their range, and of multiples of an encoder's step; variance
# of an encoder's resolution may be larger by this share.
ROUNDED, STEP_ROUNDING, SLACK = 1e-9, 0.01, 0.2


def estimate_parameters(
    found: Fit,
    without: Sequence[JointServo] = (),
    longest_cycle: float = 0.0,
    rivals: Sequence[JointServo] = (),
) -> dict[str, Estimate]:
    """Estimates of the parameters of a fit, by name; no interval for those at a bound.

    Args:
        found: The fit.
        without: Servos that are fitted without one part of the logs each. Their scatter shows
            what a model does not have, such as other joints.
        longest_cycle: Longest cycle of the drive, if it is unknown [s].
        rivals: Servos of other models that are as good, where none is complete.
    """
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
    servo = found.servo
    cycled = cycled_servo(servo, longest_cycle)._asdict()
    estimates = {}
    for k, x in enumerate(names):
        value, every = getattr(servo, x), np.array([getattr(y, x) for y in without])
        others = np.array([getattr(y, x) for y in (servo, *rivals)])
        others, other = others[np.isfinite(others)], cycled[x] - value
        if x in LOGARITHMIC:
            every, others = (np.log(np.maximum(y, 1e-9)) for y in (every, others))
            other = math.log(cycled[x] / value)
        deviation = float(sd[k])
        if math.isfinite(deviation):
            jackknife = float(np.std(every) * math.sqrt(len(every) - 1)) if len(every) else 0.0
            deviation = max(deviation, jackknife, float(np.std(others)))
        estimates[x] = _estimate(x, value, deviation, other, p.model.order)
    return estimates


def cycled_servo(servo: JointServo, cycle: float) -> JointServo:
    """The servo with a cycle [s] that moves as a continuous one, to first order in the cycle.

    What a drive holds for a cycle, and differences of commands over a cycle, are late by half of
    it.
    """
    half = HIGHER * cycle / 2
    kp, ki = servo.kp / (1 + servo.kp * half), servo.ki / (1 + servo.ki * half)
    slow = 1 - (kp + ki) * half
    return servo._replace(
        kp=kp,
        ki=ki,
        kv=servo.kv / (slow + servo.kv * half) if math.isfinite(servo.kv) else servo.kv,
        velocity_feedforward=servo.velocity_feedforward * slow / (1 + kp * half),
        dead_time=max(servo.dead_time - half * (1 + servo.velocity_feedforward), 0.0),
    )


def _estimate(name: str, value: float, sd: float, shift: float, order: str) -> Estimate:
    """An estimate from its standard deviation and the shift by an unknown cycle.

    For LOGARITHMIC these are those of the logarithm.
    """
    reach = REACH * sd
    below, above = -reach + min(shift, 0.0), reach + max(shift, 0.0)
    if name in LOGARITHMIC:
        ends = [value * math.exp(min(max(x, -700.0), 700.0)) for x in (below, above)]
        ends, sd = ends if math.isfinite(sd) else [math.nan] * 2, sd * value
    else:
        ends = [max(value + below, 0.0), value + above]
    lead = name == "acceleration_feedforward" and order == "first"
    small = max(DETERMINED * value, 0.0 if lead else ALSO.get(name, 0.0))
    unit, low, high = "s" if lead else UNITS[name], ends[0], ends[1]
    sure = bool(sd <= small)
    return Estimate(name=name, unit=unit, value=value, sd=sd, low=low, high=high, determined=sure)


def is_white(residuals: FloatArray, step: float) -> bool:
    """Whether residuals are white noise, apart from what an encoder's resolution explains.

    The power of the lowest frequencies is compared with that of the others, for 8, 16, ... lines of
    the spectrum.

    Args:
        residuals: Residuals [rad], (n,).
        step: Resolution of the encoder [rad], 0 if it is not seen.
    """
    from scipy.stats import f

    # More variance than that of the noise from sample to sample.
    if np.var(residuals) - noise_of(residuals) ** 2 <= (1 + SLACK) * step**2 / 12:
        return True
    power = np.abs(np.fft.rfft(residuals - np.mean(residuals))[1:]) ** 2
    n = len(power)
    chances: list[float] = []
    while (m := FEWEST_LINES << len(chances)) <= n / 2:
        ratio = np.mean(power[:m]) / max(float(np.mean(power[m:])), 1e-300)
        chances.append(float(f.sf(ratio, 2 * m, 2 * (n - m))))
    return not chances or min(chances) * len(chances) > CHANCE


def resolution(y: FloatArray) -> float:
    """Resolution of an encoder [rad]: the step of which all differences are multiples, else 0."""
    steps = np.diff(np.unique(y))
    steps = steps[steps > ROUNDED * max(float(np.ptp(y)), 1e-12)]
    if len(steps) < 2:
        return 0.0
    step = float(np.min(steps))
    off = np.abs(steps / step - np.rint(steps / step))
    return step if np.all(off < STEP_ROUNDING * np.maximum(steps / step, 1.0)) else 0.0


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
