"""Set-points for a servo with feed-forward, and their transient after the motion."""

# See docs/concepts/compensation.md.

from __future__ import annotations

import numpy as np

from armcontour.control.compensation.set_point_times import SETTLING, integrator_tail, longest_tail
from armcontour.core.checks import FloatArray
from armcontour.robot.servo import ServoModel
from armcontour.robot.servo.model import integrator_filter
from armcontour.robot.servo.simulation import ServoSimulation, add_feedforward, command_pieces

# A set-point has settled if it differs from the last set-point by at most this [rad].
SETTLED_DISTANCE = 1e-10
# Simulated time after a truncated transient of an integrator [time constants of the servo].
INTEGRATOR_SETTLING = 3.0
# Cubic interpolation: largest number of iterations.
MAX_CORRECTIONS = 50
# Cubic interpolation: error at which the iterations end [rad].
CORRECTION_TOLERANCE = 1e-13


def invert_feedforward(
    plain: FloatArray, cycle: float, servo: ServoModel, duration: float
) -> tuple[FloatArray, FloatArray | None]:
    """Compute set-points for a servo with feed-forward, and bounds of truncation errors.

    The servo with feed-forward responds to the returned set-points like a servo without
    feed-forward to `plain` [rad], (n, dof). In every cycle, the mean of the command including
    feed-forward equals the mean of the command without it. These equations are solved forward from
    rest, which is stable for any feed-forward. Returns set-points [rad], (m, dof) with m >= n, and
    bounds of the joint errors due to truncation [rad], (dof,), None without truncation. After the
    motion, the set-points approach the last one with the time constant `velocity_feedforward / kp`.
    If this transient is too long, it is truncated, and the set-points fade to the end of the plan.
    """
    allowed = max(int(longest_tail(duration) / cycle), 1)
    motion_count = len(plain) - integrator_tail(servo, duration, cycle)
    extra = int(np.ceil(min(tail_duration(servo, duration) / cycle, allowed) + SETTLING))
    # `plain` already contains the friction compensation.
    frictionless = servo.replace(friction=0.0)
    without_feedforward = frictionless.without_feedforward().for_joints(plain.shape[1])
    extended = np.concatenate([plain, np.tile(plain[-1], (extra, 1))])
    required_means = _means(extended, cycle, without_feedforward)
    start = plain[0]
    set_points = _solve_means(required_means - start, cycle, servo) + start
    if servo.interpolation == "cubic":
        for _ in range(MAX_CORRECTIONS):
            error = required_means - _means(set_points, cycle, frictionless)
            set_points += _solve_means(error, cycle, servo)
            if np.abs(error).max() <= CORRECTION_TOLERANCE:
                break
    unsettled = np.flatnonzero((np.abs(set_points - plain[-1]) > SETTLED_DISTANCE).any(axis=1))
    length = max(motion_count, unsettled[-1] + 2 if len(unsettled) else 0)
    if length > motion_count + allowed:
        set_points = set_points[: motion_count + allowed]
        return set_points, _fade(set_points[motion_count:], plain[-1], cycle, servo)
    set_points = set_points[:length]
    set_points[-1] = plain[-1]
    return np.asarray(set_points), None


def has_transient(servo: ServoModel) -> bool:
    """Return whether set-points change after the motion, due to feed-forward or an integrator."""
    return servo.has_feedforward or bool(servo.ki.any())


def tail_duration(servo: ServoModel, duration: float) -> float:
    """Return how long set-points change after a motion [s], at most `longest_tail`."""
    longest = longest_tail(duration)
    return longest if servo.ki.any() else min(SETTLING * float(servo.lead[0].max()), longest)


def _fade(tail: FloatArray, last: FloatArray, cycle: float, servo: ServoModel) -> FloatArray:
    """Fade set-points to the last one, in place; return bounds of joint errors [rad], (dof,).

    - `tail`: set-points after the motion [rad], (n, dof).
    - `last`: last set-point, at the end of the plan [rad], (dof,).
    """
    # The exact tail moves no joint, so the error is the response to the removed part of the tail.
    # After the tail, the set-points are constant, so the error decays.
    weight = 0.5 - 0.5 * np.cos(np.pi * np.arange(1, len(tail) + 1) / len(tail))
    removed = np.pad((last - tail) * weight[:, None], ((1, 0), (0, 0)))
    tail += removed[1:]
    if servo.ki.any():
        # With an integrator, joints overshoot after the tail.
        extra = int(np.ceil(INTEGRATOR_SETTLING / (servo.slowest * cycle)))
        removed = np.pad(removed, ((0, extra), (0, 0)), mode="edge")
    zeros = np.zeros(tail.shape[1])
    linear = servo.replace(dead_time=zeros, friction=zeros)
    response = ServoSimulation(removed, cycle, linear).run(0, len(removed) - 1, zeros, zeros)
    q, dq, _ = np.abs(response.states).T
    change = np.abs(np.diff(removed, axis=0)).max(axis=0)
    # between, after: bounds of the additional errors between the samples and after the last sample.
    # The friction term bounds the effect of reversals.
    between = dq.max(axis=0) * cycle / 2 + servo.velocity_feedforward * change
    after = 0.0 if servo.kv is None else dq[-1] / servo.kv
    return np.asarray(q.max(axis=0) + between + after + 2 * servo.friction)


def _means(q: FloatArray, cycle: float, servo: ServoModel) -> FloatArray:
    """Return the command's means over the interval before each set-point [rad], (n, dof)."""
    pieces = add_feedforward(command_pieces(q, cycle, servo.interpolation), servo)[:, :-1, :4]
    return np.asarray((pieces @ (cycle ** np.arange(4) / np.arange(1, 5))).T)


def _solve_means(means: FloatArray, cycle: float, servo: ServoModel) -> FloatArray:
    """Return set-points for which the command has the given means [rad], (n, dof).

    - `means`: means over the interval before each set-point [rad], (n, dof).

    Set-points and means are relative to the position before the first set-point. Cubic
    interpolation is approximated by linear interpolation.
    """
    from scipy.signal import lfilter

    set_points = np.empty_like(means)
    for j, (velocity_lead, acceleration_lead) in enumerate(zip(*servo.lead, strict=True)):
        # Weights of first and second differences of set-points in the command.
        first = velocity_lead / cycle
        second = acceleration_lead / cycle**2
        if servo.interpolation == "step":
            # In the cycle that ends at set-point k, the command is set-point k - 1.
            set_points[:-1, j] = lfilter([1.0], [1 + first, -first], means[1:, j])
            set_points[-1, j] = means[-1, j]
            continue
        line = np.array([0.5 + first, 0.5 - first])
        curvature = second * np.array([1.0, -2.0, 1.0])
        denominator = np.ones(1)
        if servo.ki[j]:
            # Acceleration feed-forward bypasses the integrator.
            numerator, denominator = integrator_filter(servo.ki[j], cycle, servo.drive_cycle)
            line = np.convolve(line, denominator)
            curvature = np.convolve(curvature, numerator)
        response = np.polynomial.polynomial.polyadd(line, curvature)
        set_points[:, j] = lfilter(denominator, response, means[:, j])
    return set_points
