"""Check of samples by lower bounds of the peaks that every motion through them must reach."""

# Between samples, the mean of a derivative is known exactly, whatever the motion does there, and
# its peak is at least the mean. Divided differences are such means. If the derivatives at both
# samples are known, the smallest peak follows exactly, see `_smallest_factor` for accelerations
# and `_smallest_jerk`. The resolution of a column bounds the errors of its numbers.

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain, pairwise
from typing import TypeAlias

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.robot import Limits, SerialArm
from armcontour.robot.limit_use import STILL_TOOL, Quantity, States, across, angular, length
from armcontour.robot.limits import DIRECTED, JOINT_LIMITS, LIMITS
from armcontour.verification.limit_verdict import LimitUseAccumulator

# Fractions of a sample interval at which the distance of the cubic from the path is computed.
FRACTIONS_BETWEEN = np.arange(1, 8) / 8
# Between samples at which the direction of motion turns by more than this sine, the whole
# acceleration of the tool may be centripetal.
WIDEST_TURN = 0.2

# Number of steps of Newton's method for the smallest jerk. The first step determines the sign. The
# others leave a relative error below 1e-7, and their result is a lower bound.
JERK_NEWTON_STEPS = 5
ONE = np.ones(1)

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
    is_plan: bool = False  # True for points of a plan, between which no samples are missing
    lines: IntArray | None = None  # Lines of the samples in their file, (n,); None without a file

    def spans(self, k: int = 1) -> Column:
        """Return the time over every `k` intervals and a bound on its error [s], (n - k, 1)."""
        span = (self.t[k:] - self.t[:-k])[:, None]
        return span, (self.t_error[k:] + self.t_error[:-k])[:, None] + self.clock * span

    def middles(self, k: int = 1) -> tuple[FloatArray, FloatArray]:
        """Return middle times of every `k` intervals [s], and the nearest positions [rad]."""
        return (self.t[k:] + self.t[:-k]) / 2, self.q[k // 2 : len(self.q) - k + k // 2]

    def mean(self, column: Column, order: int, *, both_ways: bool = False) -> Column:
        """Return the mean derivative over every `order` intervals, and its error bound.

        - `column`: values, (n, columns), and bounds on their errors, (n, columns) or (n, 1).
        - `order`: order of the derivative.

        Unless `both_ways`, the error bounds only how much smaller the true mean can be.
        """
        y, error = column
        for j in range(1, order + 1):
            span, time_error = self.spans(j)
            y = j * (y[1:] - y[:-1]) / span
            size = np.abs(y) if error.shape[1] > 1 else np.linalg.norm(y, axis=1)[:, None]
            # The true time is positive, so its lower bound is positive too.
            shortest = np.maximum(span - time_error, 1e-6 * span)
            true = shortest if both_ways or j < order else span + time_error
            error = (j * (error[1:] + error[:-1]) + size * time_error) / true
        return y, error


def record_samples(log: SampledMotion, tally: LimitUseAccumulator) -> None:
    """Record the values at the samples, and lower bounds of the peaks between samples."""
    states = States(tally.arm, _known_derivatives(log), log.errors)
    tally.record_states(log.t, states)
    if log.dq is None and log.ddq is not None:
        tally.record_rates("joint_acceleration", log.t, log.ddq, log.q, log.errors[2])
    rows, joints, tool = _mean_rows(log, states, tally.limits)
    for name, column, order in rows:
        if len(log.t) > order:
            mean, error = log.mean(column, order)
            t, q = log.middles(order)
            tally.record_rates(name, t, mean, q, error)
    if tally.limits.angular_speed is not None and isinstance(tally.arm, SerialArm):
        _record_angular_speed(log, tally, tally.arm.pose(log.q)[1])
    if log.dq is not None:
        _record_peaks(log, tally, joints, ["joint_acceleration", "joint_jerk"])
        _record_peaks(log, tally, tool, ["tool_acceleration"])
    if log.dq is None or log.ddq is None:
        _record_centripetal(log, tally, tool)
    if tally.path is not None:
        from scipy.interpolate import CubicHermiteSpline

        tally.record_pose(log.t, log.q, log.errors[0])
        if log.dq is not None:
            # The weights of the velocities in the cubic sum to at most a quarter of the interval.
            position_error = log.errors[0] + np.diff(log.t).max() / 4 * log.errors[1]
            between = (log.t[:-1, None] + np.diff(log.t)[:, None] * FRACTIONS_BETWEEN).ravel()
            tally.record_pose(
                between, CubicHermiteSpline(log.t, log.q, log.dq)(between), position_error
            )


def _known_derivatives(log: SampledMotion) -> tuple[FloatArray, ...]:
    """Return the positions, and the derivatives up to the first one that the log does not have."""
    if log.dq is None:
        return (log.q,)
    if log.ddq is None:
        return (log.q, log.dq)
    return (log.q, log.dq, log.ddq)


def _mean_rows(
    log: SampledMotion, states: States, limits: Limits
) -> tuple[list[tuple[str, Column, int]], list[Column], list[Column]]:
    """Return the rates to check, and the columns of the joints and of the tool.

    A rate is the name of its limit, the column from which it is computed, and the order of the
    difference.
    """
    # A limited derivative follows from the highest known derivative below it. The columns of the
    # tool are positions, and velocities if joint velocities are known.
    arm = states.arm
    joints = {
        order: (x, np.tile(log.errors[order], (len(log.t), 1)))
        for order, x in enumerate((log.q, log.dq, log.ddq))
        if x is not None
    }
    vectors: dict[tuple[str, int], Quantity] = {("tool", 0): arm.tool_position}
    if log.dq is not None:
        vectors["tool", 1] = arm.tool_velocity
        if limits.angular_acceleration is not None and isinstance(arm, SerialArm):
            vectors["rotation", 1] = angular(arm.tool_twist)
    known: dict[str, dict[int, Column]] = {"joint": joints, "tool": {}, "rotation": {}}
    for (kind, order), function in vectors.items():
        values, error = states.bounded(function, order)
        known[kind][order] = values, error[:, None]
    rows = []
    for name, limit in LIMITS.items():
        columns = {order: x for order, x in known[limit.kind].items() if order < limit.order}
        if columns and limit.rate is None and getattr(limits, name) is not None:
            order = max(columns)
            rows.append((name, columns[order], limit.order - order))
    return rows, list(joints.values()), list(known["tool"].values())


def _record_angular_speed(
    log: SampledMotion, tally: LimitUseAccumulator, frames: FloatArray
) -> None:
    """Record mean angular speeds between samples.

    - `frames`: rotation matrices of the tool, (n, 3, 3).
    """
    span, time_error = (x[:, 0] for x in log.spans())
    step = np.linalg.norm(frames[1:] - frames[:-1], axis=(1, 2))
    # The shortest rotation between two orientations is a lower bound of the angle.
    angle = 2 * np.arcsin(np.minimum(step / np.sqrt(8), 1.0))
    # An error of a joint position turns the tool by at most the same angle.
    error = (2 * log.errors[0].sum() + angle / span * time_error) / (span + time_error)
    t, q = log.middles()
    tally.record_rates("angular_speed", t, (angle / span)[:, None], q, error)


def _record_centripetal(log: SampledMotion, tally: LimitUseAccumulator, tool: list[Column]) -> None:
    """Record mean tool accelerations normal to the motion.

    - `tool`: positions of the tool, and its velocities if they are known.
    """
    order = 3 - len(tool)
    if tally.limits.centripetal_acceleration is None or len(log.t) <= order:
        return
    t, q = log.middles(order)
    mean, error = log.mean(tool[2 - order], order)
    velocity, velocity_error = tool[1] if order == 1 else log.mean(tool[0], 1, both_ways=True)
    before = velocity[:-1]
    after = velocity[1:]
    error = error[:, 0]
    velocity_error = np.maximum(velocity_error[:-1], velocity_error[1:])[:, 0]
    speed_before = np.linalg.norm(before, axis=1)
    speed_after = np.linalg.norm(after, axis=1)
    slowest = np.minimum(speed_before, speed_after)
    size = np.linalg.norm(mean, axis=1)
    # If the direction turns between the samples, tangential acceleration has a component normal to
    # the middle direction. The component is at most the sine of the angle times the largest
    # tangential acceleration here and in the neighbouring intervals.
    cosine = np.einsum("ij,ij->i", before, after) / np.maximum(
        speed_before * speed_after, STILL_TOOL**2
    )
    sine = np.sqrt(np.maximum(0.0, 1 - np.minimum(cosine, 1.0) ** 2))
    moving = (slowest > STILL_TOOL) & (cosine > 0) & (sine < WIDEST_TURN)
    turned = np.minimum(1.0, sine + velocity_error / np.maximum(slowest, STILL_TOOL))
    middle = np.maximum(np.linalg.norm(before + after, axis=1), STILL_TOOL)
    along = np.abs(np.einsum("ij,ij->i", mean, before + after)) / middle
    padded = np.pad(along + error, 1, mode="edge")
    along = np.maximum.reduce([padded[:-2], padded[1:-1], padded[2:]])
    value = across(before + after, mean)
    bound = error + turned * along
    # Where the direction turns further, the whole acceleration may be normal to the motion.
    sharp = ~moving & (slowest > STILL_TOOL + velocity_error)
    value[sharp] = bound[sharp] = size[sharp]
    counts = moving | sharp
    name = "centripetal_acceleration"
    tally.record_rates(name, t[counts], value[counts], q[counts], bound[counts])


def _record_peaks(
    log: SampledMotion, tally: LimitUseAccumulator, columns: list[Column], names: list[str]
) -> None:
    """Record the peaks of acceleration and jerk that two neighbouring samples require.

    - `columns`: positions, velocities, ... of the joints or of the tool.
    - `names`: limits of the second and third derivatives of the first column.
    """
    limits = tally.limits
    of_joints = names[0] in JOINT_LIMITS
    if all(getattr(limits, x) is None for x in names):
        return
    span, time_error = log.spans()
    t, q = log.middles()
    # Of two neighbouring columns, the differences from the trapezoid rule and the changes.
    ends = []
    for (y, y_error), (rate, rate_error) in pairwise(columns):
        total = rate[1:] + rate[:-1]
        changed = rate_error[1:] + rate_error[:-1]
        size = np.abs(total) if of_joints else length(total)[:, None]
        error = y_error[1:] + y_error[:-1] + (changed * (span + time_error) + size * time_error) / 2
        shift = y[1:] - y[:-1] - span * total / 2
        ends.append([(shift, error), (rate[1:] - rate[:-1], changed)])
    if not of_joints:
        # The components of tool vectors in one direction bound their length.
        vectors = ends[0][0][0]
        along = vectors / np.maximum(length(vectors), np.finfo(np.float64).tiny)[:, None]
        ends = [_components(x, along) for x in ends]
    for name, ((shift, error), (change, changed)) in zip(names, ends, strict=False):
        if getattr(limits, name) is None:
            continue
        low, high = limits.bounds(name, log.q.shape[1]) if name in DIRECTED else (-ONE, ONE)
        factor = _smallest_factor(np.abs(shift), (change, 0 * ONE), span, low, high)
        least = np.maximum(np.abs(shift) - error, 0.0)
        certain = _smallest_factor(least, (change, changed), span + time_error, low, high)
        bound = np.where(change < 0, low, high)
        tally.record_rates(name, t, factor * bound, q, (factor - certain) * np.abs(bound))
    if of_joints and limits.joint_jerk is not None:
        stretch = span / np.maximum(span - time_error, 1e-6 * span)
        moments = list[Column]()
        parts = [ends[0][0], *chain.from_iterable(ends[1:])]
        for (x, error), scale, order in zip(parts, (16, 4, 2), (3, 2, 1), strict=False):
            moment = scale * x / span**order
            error = scale * error * (stretch / span) ** order
            moments.append((moment, error + np.abs(moment) * (stretch**order - 1)))
        # `highest` must not include these jerks, because with rounded positions they can be far
        # above the jerk of the recorded motion.
        tally.updates_highest = False
        jerk, error = _smallest_jerk(moments)
        tally.record_rates("joint_jerk", t, np.maximum(jerk, 0.0), q, error)
        tally.updates_highest = True


def _components(columns: list[Column], along: FloatArray) -> list[Column]:
    """Return the components of vectors along unit vectors, with the error bounds of the vectors."""
    return [(np.sum(x * along, axis=1, keepdims=True), error) for x, error in columns]


def _smallest_factor(
    shift: FloatArray, change: Column, span: FloatArray, low: FloatArray, high: FloatArray
) -> FloatArray:
    """Find the smallest factor of a rate's bounds for a shift and a change within its error.

    The integral of the rate is `change`, and its double integral differs from that of a constant
    rate by `shift`. Among all rates from f low to f high, the shift is largest if the rate is
    first f high and then f low:
        2 shift f (high - low) = (change - f low span) (f high span - change)
    The positive solution f is smallest for the change `middle`.
    """
    down = -1 / low
    up = 1 / high
    middle = 4 * shift * (down - up) / ((down + up) * span)
    gain = np.clip(middle, change[0] - change[1], change[0] + change[1]) * span
    b = 2 * shift * (down + up) - gain * (down - up)
    return np.asarray((b + np.sqrt(b**2 + 4 * down * up * gain**2)) / (2 * span**2))


def _smallest_jerk(moments: list[Column]) -> Column:
    """Return a lower bound of the largest jerk with these moments, and a bound on its error.

    - `moments`: scaled integrals of the jerk, the highest order first.
    """
    # With x from -1 to 1 in a window, the moments are the integrals of the jerk times x² - 1, -x
    # and 1. For every polynomial p(x), the integral of p times the jerk is at most the largest jerk
    # times the integral of |p|. Equality requires a bang-bang jerk with the sign of p. The smallest
    # jerk has at most two switches, so p is (x - middle)² - half². Its roots follow from the last
    # two moments and the largest bound so far. This is Newton's method for the smallest jerk.
    (bend, *others), errors = zip(*moments, strict=True)
    if not others:
        # If the accelerations are unknown, p is x² - 1.
        return np.abs(bend) * 0.75, errors[0] * 0.75
    tilt, change = others
    jerk = np.maximum((np.abs(tilt) + np.hypot(tilt, change)) / 2, np.finfo(np.float64).tiny)
    for step in range(JERK_NEWTON_STEPS):
        half = np.maximum(0.5 - change / (4 * jerk), 1e-12)
        middle = np.clip(tilt / (4 * jerk * half), half - 1, 1 - half)
        norm = 2 / 3 + 2 * (middle**2 - half**2) + 8 / 3 * half**3
        weights = 1 / norm, 2 * middle / norm, (1 + middle**2 - half**2) / norm
        bound = weights[0] * bend + weights[1] * tilt + weights[2] * change
        if step == 0:
            # For one sign of the jerk, the bound is not below that of the last two moments.
            sign = np.where(bound < jerk, -1.0, 1.0)
            bend = sign * bend
            tilt = sign * tilt
            change = sign * change
        else:
            jerk = np.maximum(jerk, bound)
    return bound, sum(np.abs(w) * e for w, e in zip(weights, errors, strict=True))
