"""Check of samples: lower bounds of peaks that every motion through the samples must reach.

Over a window between samples a mean of a derivative is known exactly, whatever the motion does
between them, and the peak is at least the mean. Divided differences are such means. Two more means
of the joint acceleration follow from the positions and velocities at the ends of a window T:

    2 (q1 - q0 - v0 T) / T²                 weight 2 (T - t) / T²
    2 (v1 T - q1 + q0) / T²                 weight 2 t / T²

All weights are positive and integrate to 1. The digits of a column bound the error of all of its
numbers alike. In wider windows the error has less effect, so windows of 1, 2, 4, ... samples are
judged until the error is negligible.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.robot import Limits, SerialArm
from armcontour.robot.limit_use import SLOWEST, States, across, angular
from armcontour.verification.tally import LimitUseAccumulator

# Windows are not widened further once rounding is at most this share of every limit.
NEGLIGIBLE = 1e-7
# Parts of a sample interval at which the distance of the cubic from the path is computed.
BETWEEN = np.arange(1, 8) / 8
# Windows in which the direction of motion turns by more than this sine do not show centripetal
# acceleration.
WIDEST_TURN = 0.2

# Values at the samples, (n, columns), and bounds on the errors, (n, columns), or on the length of
# the error, (n, 1).
Column: TypeAlias = tuple[FloatArray, FloatArray]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Log:
    """Samples that were checked, with bounds on their errors.

    Args:
        t: Times, increasing [s], (n,).
        q: Joint positions [rad], (n, dof).
        dq: Joint velocities [rad/s], (n, dof), or None.
        ddq: Joint accelerations [rad/s²], (n, dof), or None.
        errors: Bounds on the error of q, dq and ddq, (dof,) each.
        t_error: Bound on the error of every time [s], (n,).
        clock: Bound on the share by which all times may be stretched together.
    """

    t: FloatArray
    q: FloatArray
    dq: FloatArray | None
    ddq: FloatArray | None
    errors: tuple[FloatArray, FloatArray, FloatArray]
    t_error: FloatArray
    clock: float

    def spans(self, k: int) -> Column:
        """Length of every window of `k` samples, and a bound on its error, (windows, 1) each."""
        span = (self.t[k:] - self.t[:-k])[:, None]
        return span, (self.t_error[k:] + self.t_error[:-k])[:, None] + self.clock * span

    def middles(self, k: int) -> tuple[FloatArray, FloatArray]:
        """Middle times of windows of `k` samples [s], and joint positions near them [rad]."""
        return (self.t[k:] + self.t[:-k]) / 2, self.q[k // 2 : len(self.q) - k + k // 2]

    def mean(self, column: Column, order: int, k: int, *, both_ways: bool = False) -> Column:
        """Mean derivative of an order over windows of `order * k` samples, and its error.

        Unless `both_ways`, the error bounds only how much smaller the true mean may be.
        """
        y, off = column
        for j in range(1, order + 1):
            span, late = self.spans(j * k)
            y = j * (y[k:] - y[:-k]) / span
            size = np.abs(y) if off.shape[1] > 1 else np.linalg.norm(y, axis=1)[:, None]
            # The shortest true length of a window is never quite none.
            shortest = np.maximum(span - late, 1e-6 * span)
            true = shortest if both_ways or j < order else span + late
            off = (j * (off[k:] + off[:-k]) + size * late) / true
        return y, off


def judge_samples(log: Log, tally: LimitUseAccumulator) -> None:
    """Offer to the tally the values at the samples, and lower bounds of the peaks between them."""
    rates = () if log.dq is None else (log.dq,) if log.ddq is None else (log.dq, log.ddq)
    states = States(tally.arm, (log.q, *rates), log.errors)
    tally.states(log.t, states)
    if log.dq is None and log.ddq is not None:
        tally.rates("joint_acceleration", log.t, log.ddq, log.q, log.errors[2])
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
                slack = max(slack, tally.rates(name, t, mean, q, error))
        if frames is not None:
            slack = max(slack, _offer_angular_speed(log, tally, frames, k))
        if log.dq is not None:
            _offer_both(log, log.dq, tally, k)
        if tally.limits.centripetal_acceleration is not None and (
            log.dq is None or log.ddq is None
        ):
            slack = max(slack, _offer_centripetal(log, tally, tool, k))
        if slack <= NEGLIGIBLE:
            break
        k *= 2
    tally.narrow = True
    if tally.path is not None:
        from scipy.interpolate import CubicHermiteSpline

        tally.pose(log.t, log.q, log.errors[0])
        if log.dq is not None:
            # The weights of dq sum to at most a quarter of the interval.
            off = log.errors[0] + np.diff(log.t).max() / 4 * log.errors[1]
            between = (log.t[:-1, None] + np.diff(log.t)[:, None] * BETWEEN).ravel()
            tally.pose(between, CubicHermiteSpline(log.t, log.q, log.dq)(between), off)


def _mean_rows(
    log: Log, states: States, limits: Limits
) -> tuple[list[tuple[str, Column, int]], list[Column]]:
    """Limits of mean rates, with the columns and the orders of the differences that give them.

    Velocities follow from positions, accelerations from velocities if there are any, and jerks from
    the highest derivative.

    Returns:
        The rows; and positions of the tool, with its velocities if joints have them.
    """
    arm = states.arm
    joints = {
        order: (x, np.tile(log.errors[order], (len(log.t), 1)))
        for order, x in enumerate((log.q, log.dq, log.ddq))
        if x is not None
    }
    found = [states.bounded(arm.tool_position, 0)]
    if log.dq is not None:
        found.append(states.bounded(arm.tool_velocity, 1))
        if log.ddq is not None and limits.tool_jerk is not None:
            found.append(states.bounded(arm.tool_acceleration, 2))
    tool = [(values, off[:, None]) for values, off in found]
    own, last = 0 if log.dq is None else 1, max(joints)
    rows = [
        ("joint_velocity", joints[0], 1),
        ("joint_acceleration", joints[own], 2 - own),
        ("joint_jerk", joints[last], 3 - last),
        ("speed", tool[0], 1),
        ("tool_acceleration", tool[own], 2 - own),
        ("tool_jerk", tool[-1], 4 - len(tool)),
    ]
    if own and limits.angular_acceleration is not None and isinstance(arm, SerialArm):
        rate, off = states.bounded(angular(arm.tool_twist), 1)
        rows.append(("angular_acceleration", (rate, off[:, None]), 1))
    return [x for x in rows if getattr(limits, x[0]) is not None], tool


def _offer_angular_speed(log: Log, tally: LimitUseAccumulator, frames: FloatArray, k: int) -> float:
    """Offer the mean angular speed over windows of `k` samples, from the tool's axes, (n, 3, 3).

    Returns:
        Largest share of the limit that rounding may have made.
    """
    span, late = (x[:, 0] for x in log.spans(k))
    step = np.linalg.norm(frames[k:] - frames[:-k], axis=(1, 2))
    # The shortest rotation between two frames, which is a lower bound of the angle turned.
    angle = 2 * np.arcsin(np.minimum(step / np.sqrt(8), 1.0))
    # An error of a joint position turns the tool by at most the same angle.
    error = (2 * log.errors[0].sum() + angle / span * late) / (span + late)
    t, q = log.middles(k)
    return tally.rates("angular_speed", t, (angle / span)[:, None], q, error)


def _offer_centripetal(log: Log, tally: LimitUseAccumulator, tool: list[Column], k: int) -> float:
    """Offer the part of mean tool accelerations normal to the motion.

    Args:
        log: The samples.
        tally: Receives the values.
        tool: Positions of the tool, with its velocities if joints have them.
        k: Number of samples per window.

    Returns:
        Largest share of the limit that rounding may have made.
    """
    from scipy.ndimage import maximum_filter1d

    order, limit = 3 - min(len(tool), 2), tally.limits.centripetal_acceleration
    if limit is None or len(log.t) <= order * k:
        return 0.0
    t, q = log.middles(order * k)
    mean, error = log.mean(tool[2 - order], order, k)
    velocity, off = tool[1] if order == 1 else log.mean(tool[0], 1, k, both_ways=True)
    before, after = velocity[:-k], velocity[k:]
    error, off = error[:, 0], np.maximum(off[:-k], off[k:])[:, 0]
    first, last = np.linalg.norm(before, axis=1), np.linalg.norm(after, axis=1)
    slowest, size = np.minimum(first, last), np.linalg.norm(mean, axis=1)
    # If the direction turns by an angle within the window, tangential acceleration has a part
    # normal to the middle direction: the sine of the angle times its amount. The amount is the
    # largest one of this window and the windows next to it.
    cosine = np.einsum("ij,ij->i", before, after) / np.maximum(first * last, SLOWEST**2)
    sine = np.sqrt(np.maximum(0.0, 1 - np.minimum(cosine, 1.0) ** 2))
    moving = (slowest > SLOWEST) & (cosine > 0) & (sine < WIDEST_TURN)
    turned = np.minimum(1.0, sine + off / np.maximum(slowest, SLOWEST))
    middle = np.maximum(np.linalg.norm(before + after, axis=1), SLOWEST)
    along = np.abs(np.einsum("ij,ij->i", mean, before + after)) / middle
    along = maximum_filter1d(along + error, 2 * k + 1, mode="nearest")
    value, bound = across(before + after, mean), error + turned * along
    # Where the direction turns by more, any part of the acceleration may be normal to the motion.
    sharp = ~moving & (slowest > SLOWEST + off)
    value[sharp] = bound[sharp] = size[sharp]
    counts = moving | sharp
    name = "centripetal_acceleration"
    tally.rates(name, t[counts], value[counts], q[counts], bound[counts])
    return float(error.max()) / limit


def _offer_both(log: Log, dq: FloatArray, tally: LimitUseAccumulator, k: int) -> None:
    """Offer mean accelerations and jerks from positions and velocities at the ends of windows."""
    (span, late), (t, q) = log.spans(k), log.middles(k)
    step, total = log.q[k:] - log.q[:-k], dq[k:] + dq[:-k]
    off = 2 * log.errors[0] + log.errors[1] * (span + late)
    for v, sign in ((dq[:-k], 1.0), (dq[k:], -1.0)):
        rest = step - v * span
        least = np.abs(rest) - off - np.abs(v) * late
        error = 2 * np.abs(rest) / span**2 - 2 * least / (span + late) ** 2
        tally.rates("joint_acceleration", t, sign * 2 * rest / span**2, q, error)
    rest = np.abs(total * span - 2 * step)
    mean, least = 6 * rest / span**3, rest - 2 * off - np.abs(total) * late
    # As numbers of positions are rounded, this says nothing about the motion as it stands.
    narrow, tally.narrow = tally.narrow, False
    tally.rates("joint_jerk", t, mean, q, mean - 6 * least / (span + late) ** 3)
    tally.narrow = narrow
