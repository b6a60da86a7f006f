"""Set-points for a servo with feed-forward, and tails of set-points after a motion.

See docs/concepts/compensation.md.
"""

from __future__ import annotations

import numpy as np

from armcontour.control.compensation.set_points import SETTLING, integrator_tail, longest_tail
from armcontour.core.checks import FloatArray
from armcontour.robot.servo import ServoModel
from armcontour.robot.servo.model import integrator_filter
from armcontour.robot.servo.simulation import ServoSimulation, polynomials

# What a set-point leaves of the end of the motion after its tail [rad].
SETTLED = 1e-10
# Time constants for which the response to a cut-off is simulated after it.
SETTLING_OF_INTEGRATORS = 3.0
# Corrections of the first solution for cubics, of which each leaves a small share of the error, and
# the error at which they end [rad].
MOST_CORRECTIONS = 50
EXACT = 1e-13


def for_feedforward(
    plain: FloatArray, cycle: float, servo: ServoModel, duration: float
) -> tuple[FloatArray, FloatArray | None]:
    """Set-points to which a servo responds as one without feed-forward responds to others.

    In every cycle the mean of the command with what feed-forward adds is that of the
    command without feed-forward. These equations are solved forward from rest, which is stable for
    any feed-forward. The transient that remains after the motion is cut off if it is too long:
    set-points then fade to the end of the plan.

    Args:
        plain: Set-points for the servo without feed-forward [rad], (n, dof); at rest before the
            first and after the last one.
        cycle: Cycle [s].
        servo: Servo model with values per joint.
        duration: Duration of the motion [s].

    Returns:
        Set-points [rad], (m, dof), with m >= n: their difference to the last one decays with the
        time constant `velocity_feedforward / kp`. And the largest error of each joint because the
        transient is cut off [rad], (dof,); None if it is not.
    """
    allowed = max(int(longest_tail(duration) / cycle), 1)
    done = len(plain) - integrator_tail(servo, duration, cycle)
    rows = int(np.ceil(min(tail_duration(servo, duration) / cycle, allowed) + SETTLING))
    # What compensates friction is a part of the set-points.
    frictionless = servo.replace(friction=0.0)
    prompt = frictionless.without_feedforward().for_joints(plain.shape[1])
    want = _means(np.concatenate([plain, np.tile(plain[-1], (rows, 1))]), cycle, prompt)
    start = plain[0]
    set_points = _solved(want - start, cycle, servo) + start
    if servo.interpolation == "cubic":
        for _ in range(MOST_CORRECTIONS):
            error = want - _means(set_points, cycle, frictionless)
            set_points += _solved(error, cycle, servo)
            if np.abs(error).max() <= EXACT:
                break
    moves = np.flatnonzero((np.abs(set_points - plain[-1]) > SETTLED).any(axis=1))
    length = max(done, moves[-1] + 2 if len(moves) else 0)
    if length > done + allowed:
        set_points = set_points[: done + allowed]
        return set_points, _fade(set_points[done:], plain[-1], cycle, servo)
    set_points = set_points[:length]
    set_points[-1] = plain[-1]
    return np.asarray(set_points), None


def tail_duration(servo: ServoModel, duration: float) -> float:
    """Longest time for which set-points go on after a motion because of feed-forward [s].

    Args:
        servo: Servo model with values per joint.
        duration: Duration of the motion [s].
    """
    longest = longest_tail(duration)
    return longest if servo.ki.any() else min(SETTLING * float(servo.lead[0].max()), longest)


def _fade(tail: FloatArray, last: FloatArray, cycle: float, servo: ServoModel) -> FloatArray:
    """Fade set-points to the last one, in place; bounds of the errors of the joints [rad].

    The exact tail moves no joint, so the error is the response to what is left out of it. After it
    the set-points hold, so the error only decays.
    """
    share = 0.5 - 0.5 * np.cos(np.pi * np.arange(1, len(tail) + 1) / len(tail))
    left_out = np.pad((last - tail) * share[:, None], ((1, 0), (0, 0)))
    tail += left_out[1:]
    if servo.ki.any():
        # An integrator overshoots afterwards.
        extra = int(np.ceil(SETTLING_OF_INTEGRATORS / (servo.slowest * cycle)))
        left_out = np.pad(left_out, ((0, extra), (0, 0)), mode="edge")
    still = np.zeros(tail.shape[1])
    prompt = servo.replace(dead_time=still, friction=still)
    run = ServoSimulation(left_out, cycle, prompt).run(0, len(left_out) - 1, still, still)
    q, dq, _ = np.abs(run.states).T
    change = np.abs(np.diff(left_out, axis=0)).max(axis=0)
    # Between results, after the last one, and as friction changes its sign.
    between = dq.max(axis=0) * cycle / 2 + servo.velocity_feedforward * change
    after = 0.0 if servo.kv is None else dq[-1] / servo.kv
    return np.asarray(q.max(axis=0) + between + after + 2 * servo.friction)


def _means(q: FloatArray, cycle: float, servo: ServoModel) -> FloatArray:
    """Means of the command over the intervals that end at each set-point [rad], (n, dof)."""
    pieces = polynomials(q, cycle, servo)[:, :-1]
    return np.asarray((pieces @ (cycle ** np.arange(4) / np.arange(1, 5))).T)


def _solved(means: FloatArray, cycle: float, servo: ServoModel) -> FloatArray:
    """Set-points of which the command has given means over the intervals that end there."""
    from scipy.signal import lfilter

    set_points = np.empty_like(means)
    held = servo.interpolation == "step"
    for j, (a, b) in enumerate(zip(*servo.lead, strict=True)):
        # Shares of the velocity and acceleration of the command, in differences of set-points.
        first, second = a / cycle, b / cycle**2
        if held:
            # The interval that ends at a set-point holds the one before it.
            set_points[:-1, j] = lfilter([1.0], [1 + first, -first], means[1:, j])
            set_points[-1, j] = means[-1, j]
            continue
        line, curvature = np.array([0.5 + first, 0.5 - first]), second * np.array([1.0, -2.0, 1.0])
        shares = np.ones(1)
        if servo.ki[j]:
            # The integrator acts against acceleration feed-forward.
            share, shares = integrator_filter(servo.ki[j], cycle, servo.drive_cycle)
            line, curvature = np.convolve(line, shares), np.convolve(curvature, share)
        set_points[:, j] = lfilter(
            shares, np.polynomial.polynomial.polyadd(line, curvature), means[:, j]
        )
    return set_points
