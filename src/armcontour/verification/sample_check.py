"""Check of samples by lower bounds of the peaks that every motion through them must reach."""

# Over a window between samples, the mean of a derivative is known exactly, whatever the motion does
# between the samples, and its peak is at least the mean. Divided differences are such means. Two
# more means of the joint acceleration follow from the positions q0, q1 and velocities v0, v1 at the
# ends of a window of length T:
#
#     2 (q1 - q0 - v0 T) / T²                 weight 2 (T - t) / T²
#     2 (v1 T - q1 + q0) / T²                 weight 2 t / T²
#
# All weights are positive and integrate to 1. The resolution of a column bounds the errors of its
# numbers. Errors have less effect in wider windows, so windows of 1, 2, 4, ... samples are checked
# until the effect is negligible.

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.robot import Limits, SerialArm
from armcontour.robot.limit_use import SLOWEST, States, across, angular
from armcontour.verification.limit_verdict import LimitUseAccumulator

# Windows are widened until rounding is at most this fraction of every limit.
NEGLIGIBLE = 1e-7
# Fractions of a sample interval at which the distance of the cubic from the path is computed.
BETWEEN = np.arange(1, 8) / 8
# In windows in which the direction of motion turns by more than this sine, the whole acceleration
# of the tool may be centripetal.
WIDEST_TURN = 0.2

# Values at the samples, (n, columns), and bounds on the errors, (n, columns), or on the norm of the
# error, (n, 1).
Column: TypeAlias = tuple[FloatArray, FloatArray]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SampledMotion:
    """Checked samples, with bounds on their errors."""

    t: FloatArray  # Increasing times [s], (n,)
    q: FloatArray  # Joint positions [rad], (n, dof)
    dq: FloatArray | None  # Joint velocities [rad/s], (n, dof), or None
    ddq: FloatArray | None  # Joint accelerations [rad/s²], (n, dof), or None
    # Bounds on the error of q, dq and ddq, (dof,) each.
    errors: tuple[FloatArray, FloatArray, FloatArray]
    t_error: FloatArray  # Bound on the error of every time [s], (n,)
    clock: float  # Bound on the common relative error of all times

    def spans(self, k: int) -> Column:
        """Length [s] of each window of `k` samples, and a bound on its error, (windows, 1) each."""
        span = (self.t[k:] - self.t[:-k])[:, None]
        return span, (self.t_error[k:] + self.t_error[:-k])[:, None] + self.clock * span

    def middles(self, k: int) -> tuple[FloatArray, FloatArray]:
        """Middle times of windows of `k` samples [s], and joint positions near them [rad]."""
        return (self.t[k:] + self.t[:-k]) / 2, self.q[k // 2 : len(self.q) - k + k // 2]

    def mean(self, column: Column, order: int, k: int, *, both_ways: bool = False) -> Column:
        """Mean derivative of an order over windows of `order * k` samples, and its error bound."""
        # Unless `both_ways`, the error bounds only how much smaller the true mean can be.
        y, error = column
        for j in range(1, order + 1):
            span, time_error = self.spans(j * k)
            y = j * (y[k:] - y[:-k]) / span
            size = np.abs(y) if error.shape[1] > 1 else np.linalg.norm(y, axis=1)[:, None]
            # The true length of a window is positive, so its lower bound is positive too.
            shortest = np.maximum(span - time_error, 1e-6 * span)
            true = shortest if both_ways or j < order else span + time_error
            error = (j * (error[k:] + error[:-k]) + size * time_error) / true
        return y, error


def record_samples(log: SampledMotion, tally: LimitUseAccumulator) -> None:
    """Record the values at the samples, and lower bounds of the peaks between samples."""
    rates = () if log.dq is None else (log.dq,) if log.ddq is None else (log.dq, log.ddq)
    states = States(tally.arm, (log.q, *rates), log.errors)
    tally.record_states(log.t, states)
    if log.dq is None and log.ddq is not None:
        tally.record_rates("joint_acceleration", log.t, log.ddq, log.q, log.errors[2])
    rows, tool = _mean_rows(log, states, tally.limits)
    frames = None
    if tally.limits.angular_speed is not None and isinstance(tally.arm, SerialArm):
        frames = tally.arm.pose(log.q)[1]
    k = 1
    while k < len(log.t):
        tally.narrow = k == 1
        slack = 0.0
        for name, column, order in rows:
            if len(log.t) > order * k:
                t, q = log.middles(order * k)
                mean, error = log.mean(column, order, k)
                slack = max(slack, tally.record_rates(name, t, mean, q, error))
        if frames is not None:
            slack = max(slack, _record_angular_speed(log, tally, frames, k))
        if log.dq is not None:
            _record_windows(log, log.dq, tally, k)
        if tally.limits.centripetal_acceleration is not None and (
            log.dq is None or log.ddq is None
        ):
            slack = max(slack, _record_centripetal(log, tally, tool, k))
        if slack <= NEGLIGIBLE:
            break
        k *= 2
    tally.narrow = True
    if tally.path is not None:
        from scipy.interpolate import CubicHermiteSpline

        tally.record_pose(log.t, log.q, log.errors[0])
        if log.dq is not None:
            # The weights of the velocities in the cubic sum to at most a quarter of the interval.
            position_error = log.errors[0] + np.diff(log.t).max() / 4 * log.errors[1]
            between = (log.t[:-1, None] + np.diff(log.t)[:, None] * BETWEEN).ravel()
            tally.record_pose(
                between, CubicHermiteSpline(log.t, log.q, log.dq)(between), position_error
            )


def _mean_rows(
    log: SampledMotion, states: States, limits: Limits
) -> tuple[list[tuple[str, Column, int]], list[Column]]:
    """Rates to check (limit, column, difference order), and columns of the tool motion."""
    # Velocities follow from positions, accelerations from velocities if available, and jerks from
    # the highest derivative. The columns of the tool are positions; velocities if joint velocities
    # are known; and accelerations if joint accelerations are known, too, and tool jerk is limited.
    arm = states.arm
    joints = {
        order: (x, np.tile(log.errors[order], (len(log.t), 1)))
        for order, x in enumerate((log.q, log.dq, log.ddq))
        if x is not None
    }
    bounds = [states.bounded(arm.tool_position, 0)]
    if log.dq is not None:
        bounds.append(states.bounded(arm.tool_velocity, 1))
        if log.ddq is not None and limits.tool_jerk is not None:
            bounds.append(states.bounded(arm.tool_acceleration, 2))
    tool = [(values, off[:, None]) for values, off in bounds]
    base, last = 0 if log.dq is None else 1, max(joints)
    rows = [
        ("joint_velocity", joints[0], 1),
        ("joint_acceleration", joints[base], 2 - base),
        ("joint_jerk", joints[last], 3 - last),
        ("speed", tool[0], 1),
        ("tool_acceleration", tool[base], 2 - base),
        ("tool_jerk", tool[-1], 4 - len(tool)),
    ]
    if base and limits.angular_acceleration is not None and isinstance(arm, SerialArm):
        rate, error = states.bounded(angular(arm.tool_twist), 1)
        rows.append(("angular_acceleration", (rate, error[:, None]), 1))
    return [x for x in rows if getattr(limits, x[0]) is not None], tool


def _record_angular_speed(
    log: SampledMotion, tally: LimitUseAccumulator, frames: FloatArray, k: int
) -> float:
    """Record mean angular speeds over windows of `k` samples; return the largest ratio error."""
    span, time_error = (x[:, 0] for x in log.spans(k))
    step = np.linalg.norm(frames[k:] - frames[:-k], axis=(1, 2))
    # The shortest rotation between two orientations is a lower bound of the angle.
    angle = 2 * np.arcsin(np.minimum(step / np.sqrt(8), 1.0))
    # An error of a joint position turns the tool by at most the same angle.
    error = (2 * log.errors[0].sum() + angle / span * time_error) / (span + time_error)
    t, q = log.middles(k)
    return tally.record_rates("angular_speed", t, (angle / span)[:, None], q, error)


def _record_centripetal(
    log: SampledMotion, tally: LimitUseAccumulator, tool: list[Column], k: int
) -> float:
    """Record mean tool accelerations normal to the motion; return the largest ratio error."""
    from scipy.ndimage import maximum_filter1d

    order, limit = 3 - min(len(tool), 2), tally.limits.centripetal_acceleration
    if limit is None or len(log.t) <= order * k:
        return 0.0
    t, q = log.middles(order * k)
    mean, error = log.mean(tool[2 - order], order, k)
    velocity, velocity_error = tool[1] if order == 1 else log.mean(tool[0], 1, k, both_ways=True)
    before, after = velocity[:-k], velocity[k:]
    error, velocity_error = error[:, 0], np.maximum(velocity_error[:-k], velocity_error[k:])[:, 0]
    first, last = np.linalg.norm(before, axis=1), np.linalg.norm(after, axis=1)
    slowest, size = np.minimum(first, last), np.linalg.norm(mean, axis=1)
    # If the direction turns within the window, tangential acceleration has a component normal to
    # the middle direction. The component is at most the sine of the angle times the largest
    # tangential acceleration in this window and its neighbours.
    cosine = np.einsum("ij,ij->i", before, after) / np.maximum(first * last, SLOWEST**2)
    sine = np.sqrt(np.maximum(0.0, 1 - np.minimum(cosine, 1.0) ** 2))
    moving = (slowest > SLOWEST) & (cosine > 0) & (sine < WIDEST_TURN)
    turned = np.minimum(1.0, sine + velocity_error / np.maximum(slowest, SLOWEST))
    middle = np.maximum(np.linalg.norm(before + after, axis=1), SLOWEST)
    along = np.abs(np.einsum("ij,ij->i", mean, before + after)) / middle
    along = maximum_filter1d(along + error, 2 * k + 1, mode="nearest")
    value, bound = across(before + after, mean), error + turned * along
    # Where the direction turns further, the whole acceleration may be normal to the motion.
    sharp = ~moving & (slowest > SLOWEST + velocity_error)
    value[sharp] = bound[sharp] = size[sharp]
    counts = moving | sharp
    name = "centripetal_acceleration"
    tally.record_rates(name, t[counts], value[counts], q[counts], bound[counts])
    return float(error.max()) / limit


def _record_windows(log: SampledMotion, dq: FloatArray, tally: LimitUseAccumulator, k: int) -> None:
    """Record mean accelerations and jerks from positions and velocities at the ends of windows."""
    (span, time_error), (t, q) = log.spans(k), log.middles(k)
    step, total = log.q[k:] - log.q[:-k], dq[k:] + dq[:-k]
    position_error = 2 * log.errors[0] + log.errors[1] * (span + time_error)
    for v, sign in ((dq[:-k], 1.0), (dq[k:], -1.0)):
        residual = step - v * span
        smallest = np.abs(residual) - position_error - np.abs(v) * time_error
        error = 2 * np.abs(residual) / span**2 - 2 * smallest / (span + time_error) ** 2
        tally.record_rates("joint_acceleration", t, sign * 2 * residual / span**2, q, error)
    residual = np.abs(total * span - 2 * step)
    mean, smallest = (
        6 * residual / span**3,
        residual - 2 * position_error - np.abs(total) * time_error,
    )
    # `highest` must not include this mean jerk, because with rounded positions it can be far above
    # the jerk of the recorded motion.
    narrow, tally.narrow = tally.narrow, False
    tally.record_rates("joint_jerk", t, mean, q, mean - 6 * smallest / (span + time_error) ** 3)
    tally.narrow = narrow
