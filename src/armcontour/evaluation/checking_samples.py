"""Check of samples: lower bounds of peaks that every motion through the samples must reach.

Over a window between two samples a mean is known exactly, whatever the motion does between them,
and the peak is at least the mean. Three means of the joint acceleration `a` over a window of
length T follow from the positions and velocities at its ends, and one from three positions:

    (v1 - v0) / T                           weight 1 / T
    2 (q1 - q0 - v0 T) / T²                 weight 2 (T - t) / T²
    2 (v1 T - q1 + q0) / T²                 weight 2 t / T²
    2 ((q2 - q1) / T2 - (q1 - q0) / T1) / (T1 + T2)    triangle

All weights are positive and integrate to 1. In wider windows the rounding of the numbers has less
effect, so windows of 1, 2, 4, ... samples are judged until rounding is negligible.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour._checks import FloatArray
from armcontour.arms import SerialArm
from armcontour.evaluation.sample_windows import Log, Windows, mean_rate, second_rate, third_rate
from armcontour.evaluation.tally import SLOWEST, States, Tally, angular

# Windows are not widened further once rounding is at most this share of every limit.
NEGLIGIBLE = 1e-7
# Parts of a sample interval at which the distance of the cubic from the path is computed.
BETWEEN = np.arange(1, 8) / 8
# Windows in which the direction of motion turns by more than this sine do not show centripetal
# acceleration.
WIDEST_TURN = 0.2


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _AngularMotion:
    """Tool orientation and angular velocity at the samples.

    Args:
        frames: The tool's axes as columns, (n, 3, 3).
        off: Bound on the error of the orientation [rad].
        rate: Angular velocity [rad/s], (n, 3), and a bound on the length of its error, (n,); None
            if not known.
    """

    frames: FloatArray
    off: float
    rate: tuple[FloatArray, FloatArray] | None

    @classmethod
    def of(cls, log: Log, tally: Tally) -> _AngularMotion | None:
        """Compute the angular motion; None without a limit of it, or without an orientation."""
        limits, arm = tally.limits, tally.arm
        limited = limits.angular_speed is not None or limits.angular_acceleration is not None
        if not limited or not isinstance(arm, SerialArm):
            return None
        rate = None
        if log.dq is not None:
            states = States(t=log.t, q=log.q, dq=log.dq, ddq=None, errors=log.errors)
            rate = tally.bounded(states, angular(arm.tool_twist), 1)
        # An error of a joint position turns the tool by at most the same angle.
        return cls(frames=arm.pose(log.q)[1], off=float(log.errors[0].sum()), rate=rate)

    def offer(self, log: Log, tally: Tally, k: int) -> float:
        """Offer the mean angular speed and acceleration over windows of `k` samples.

        Returns:
            Largest share of a limit that rounding may have made.
        """
        t, q = log.middles(k)
        limits, slack = tally.limits, 0.0
        span, late = (x[:, 0] for x in log.spans(k))
        if limits.angular_speed is not None:
            step = np.linalg.norm(self.frames[k:] - self.frames[:-k], axis=(1, 2))
            # The shortest rotation between two frames, which is a lower bound of the angle turned.
            angle = 2 * np.arcsin(np.minimum(step / np.sqrt(8), 1.0))
            error = (2 * self.off + angle / span * late) / (span + late)
            slack = tally.offer("angular_speed", t, angle / span, limits.angular_speed, q, error)
        if limits.angular_acceleration is None or self.rate is None:
            return slack
        rate, off = self.rate
        x = mean_rate(log, rate, off[:, None], k)
        size, limit = np.linalg.norm(x.mean, axis=1), limits.angular_acceleration
        return max(slack, tally.offer("angular_acceleration", t, size, limit, q, x.error[:, 0]))


def judge_samples(log: Log, tally: Tally) -> None:
    """Offer to the tally the values at the samples, and lower bounds of the peaks between them."""
    states = None
    if log.dq is not None:
        tally.states(States(t=log.t, q=log.q, dq=log.dq, ddq=log.ddq, errors=log.errors))
        states = States(t=log.t, q=log.q, dq=log.dq, ddq=None, errors=log.errors)
    else:
        tally.joint_range(log.t, log.q, log.errors[0])
        if log.ddq is not None:
            tally.joint_acceleration(log.t, log.ddq, log.q, log.errors[2])
    tool, tool_error = tally.tool(log.q, log.errors[0])
    turning, jerk = _AngularMotion.of(log, tally), JerkOfSamples.of(log, tally)
    velocity = None if states is None else tally.bounded(states, tally.arm.tool_velocity, 1)
    width = 1
    while width < len(log.t):
        tally.narrow = width == 1
        slack = max(
            _offer_velocities(log, tally, tool, tool_error, width),
            0.0 if turning is None else turning.offer(log, tally, width),
            jerk.offer(log, tally, width),
            _offer_from_positions(log, tally, tool, tool_error, width)
            if log.dq is None or velocity is None
            else _offer_from_velocities(log, log.dq, tally, *velocity, width),
        )
        if slack <= NEGLIGIBLE:
            break
        width *= 2
    tally.narrow = True
    if tally.path is not None:
        tally.pose(log.t, log.q, log.errors[0])
        if log.dq is not None:
            # The weights of dq sum to at most a quarter of the interval.
            off = log.errors[0] + np.diff(log.t).max() / 4 * log.errors[1]
            tally.pose(*_interpolate(log.t, log.q, log.dq), off)


def _offer_velocities(log: Log, tally: Tally, tool: FloatArray, off: FloatArray, k: int) -> float:
    """Offer the mean velocities of joints and tool over windows of `k` samples.

    Args:
        log: The samples.
        tally: Receives the values.
        tool: Tool points [m], (n, dimension).
        off: Bound on the length of their error [m], (n,).
        k: Number of samples per window.

    Returns:
        Largest share of a limit that rounding may have made.
    """
    t, q = log.middles(k)
    limits, slack = tally.limits, 0.0
    if limits.joint_velocity is not None:
        x = mean_rate(log, log.q, log.errors_of(0), k)
        slack = tally.joint_velocity(t, x.mean, q, x.error)
    if limits.speed is not None:
        x = mean_rate(log, tool, off[:, None], k)
        size = np.linalg.norm(x.mean, axis=1)
        slack = max(slack, tally.offer("speed", t, size, limits.speed, q, x.error[:, 0]))
    return slack


def _offer_from_velocities(
    log: Log, dq: FloatArray, tally: Tally, velocity: FloatArray, off: FloatArray, k: int
) -> float:
    """Offer mean accelerations over windows of `k` samples, from joint and tool velocities.

    Returns:
        Largest share of a limit that rounding may have made.
    """
    t, q = log.middles(k)
    span, late = log.spans(k)
    q_error, dq_error = log.errors[0], log.errors[1]
    x = mean_rate(log, dq, log.errors_of(1), k)
    slack = tally.joint_acceleration(t, x.mean, q, x.error)
    step = log.q[k:] - log.q[:-k]
    for v, sign in ((dq[:-k], 1.0), (dq[k:], -1.0)):
        rest = step - v * span
        off_rest = 2 * q_error + dq_error * (span + late) + np.abs(v) * late
        error = 2 * np.abs(rest) / span**2 - 2 * (np.abs(rest) - off_rest) / (span + late) ** 2
        tally.joint_acceleration(t, sign * 2 * rest / span**2, q, error)
    x = mean_rate(log, velocity, off[:, None], k)
    return max(
        slack,
        _offer_tool_acceleration(log, tally, (velocity[:-k], velocity[k:]), x, (t, q), off[k:], k),
    )


def _offer_from_positions(
    log: Log, tally: Tally, tool: FloatArray, off: FloatArray, k: int
) -> float:
    """Offer mean accelerations over windows of `2 k` samples; arguments of `_offer_velocities`."""
    if len(log.t) <= 2 * k:
        return 0.0
    t, q = log.t[k:-k], log.q[k:-k]
    _, _, x = second_rate(log, log.q, log.errors_of(0), k)
    slack = tally.joint_acceleration(t, x.mean, q, x.error)
    before, after, x = second_rate(log, tool, off[:, None], k)
    chord_error = np.maximum(before.error, after.error)[:, 0]
    found = _offer_tool_acceleration(
        log, tally, (before.mean, after.mean), x, (t, q), chord_error, k
    )
    return max(slack, found)


def _offer_tool_acceleration(
    log: Log,
    tally: Tally,
    velocities: tuple[FloatArray, FloatArray],
    x: Windows,
    at: tuple[FloatArray, FloatArray],
    velocity_error: FloatArray,
    k: int,
) -> float:
    """Offer the mean tool acceleration of each window, and its part normal to the motion.

    Args:
        log: The samples.
        tally: Receives the values.
        velocities: Those of the tool at the starts and at the ends of the windows [m/s],
            (windows, dimension) each.
        x: Mean tool accelerations [m/s²].
        at: Middle times of the windows [s], (windows,), and joint positions there [rad].
        velocity_error: Bound on the error of the velocities [m/s], (windows,).
        k: Number of samples per window.

    Returns:
        Largest share of a limit that rounding may have made.
    """
    from scipy.ndimage import maximum_filter1d

    limits, size, error = tally.limits, np.linalg.norm(x.mean, axis=1), x.error[:, 0]
    slack, (before, after), (t, q) = 0.0, velocities, at
    if limits.tool_acceleration is not None:
        slack = tally.offer("tool_acceleration", t, size, limits.tool_acceleration, q, error)
    if limits.centripetal_acceleration is None or (log.dq is not None and log.ddq is not None):
        return slack
    first, last = np.linalg.norm(before, axis=1), np.linalg.norm(after, axis=1)
    slowest = np.minimum(first, last)
    # If the direction turns by an angle within the window, tangential acceleration has a part
    # normal to the middle direction: the sine of the angle times its amount. The amount is the
    # largest one of this window and the windows next to it.
    cosine = np.einsum("ij,ij->i", before, after) / np.maximum(first * last, SLOWEST**2)
    sine = np.sqrt(np.maximum(0.0, 1 - np.minimum(cosine, 1.0) ** 2))
    moving = (slowest > SLOWEST) & (cosine > 0) & (sine < WIDEST_TURN)
    turned = np.minimum(1.0, sine + velocity_error / np.maximum(slowest, SLOWEST))
    middle = np.maximum(np.linalg.norm(before + after, axis=1), SLOWEST)
    along = np.abs(np.einsum("ij,ij->i", x.mean, before + after)) / middle
    along = maximum_filter1d(along + error, 2 * k + 1, mode="nearest") if len(along) else along
    total = error + turned * along
    # The returned slack contains rounding only: it decides whether wider windows are judged.
    tally.centripetal(t, before + after, x.mean, q, total, moving)
    # Where the direction turns by more, any part of the acceleration may be normal to the motion.
    sharp = ~moving & (slowest > SLOWEST + velocity_error)
    limit = limits.centripetal_acceleration
    tally.offer("centripetal_acceleration", t[sharp], size[sharp], limit, q[sharp], size[sharp])
    return max(slack, float(error.max()) / limits.centripetal_acceleration if len(error) else 0.0)


def _interpolate(t: FloatArray, q: FloatArray, dq: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Times [s] and joint positions [rad] between samples, on cubics through q and dq."""
    u, h = BETWEEN[None, :, None], np.diff(t)[:, None, None]
    at = (t[:-1, None] + np.diff(t)[:, None] * BETWEEN).ravel()
    found = (
        (1 + 2 * u) * (1 - u) ** 2 * q[:-1, None]
        + u**2 * (3 - 2 * u) * q[1:, None]
        + h * u * (1 - u) ** 2 * dq[:-1, None]
        - h * u**2 * (1 - u) * dq[1:, None]
    )
    return at, found.reshape(-1, q.shape[1])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Column:
    """The highest derivative of joints or tool that samples have.

    Args:
        order: 0 for positions, 1 for velocities, 2 for accelerations.
        values: Its values, (n, columns).
        off: Bound on their error, (n, columns), or on the length of the error, (n, 1).
    """

    order: int
    values: FloatArray
    off: FloatArray

    def jerk(self, log: Log, k: int) -> tuple[int, Windows]:
        """Mean jerks, with the number of samples of their windows, a multiple of k."""
        if self.order == 2:
            return k, mean_rate(log, self.values, self.off, k)
        if self.order == 1 and len(log.t) > 2 * k:
            return 2 * k, second_rate(log, self.values, self.off, k)[2]
        # Too few samples have no third differences either.
        return 3 * k, third_rate(log, self.values, self.off, k)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class JerkOfSamples:
    """What samples say about jerk.

    Args:
        joints: The joints, where their jerk is limited; or None.
        tool: The tool, where its jerk is limited; or None.
    """

    joints: _Column | None
    tool: _Column | None

    @classmethod
    def of(cls, log: Log, tally: Tally) -> JerkOfSamples:
        """Take the highest derivatives that samples have, as far as jerk is limited."""
        limits, joints = tally.limits, None
        if limits.joint_jerk is not None:
            given = [(k, x) for k, x in enumerate((log.q, log.dq, log.ddq)) if x is not None]
            order, values = given[-1]
            joints = _Column(order=order, values=values, off=log.errors_of(order))
        return cls(
            joints=joints, tool=None if limits.tool_jerk is None else _tool_column(log, tally)
        )

    def offer(self, log: Log, tally: Tally, k: int) -> float:
        """Offer mean jerks over windows of k, 2 k or 3 k samples.

        Returns:
            Largest share of a limit that rounding may have made.
        """
        limits, slack = tally.limits, 0.0
        if self.joints is not None and limits.joint_jerk is not None:
            width, x = self.joints.jerk(log, k)
            t, q = log.middles(width)
            size = np.abs(x.mean)
            slack = tally.offer("joint_jerk", t, size, limits.joint_jerk, q, x.error)
            if log.dq is not None:
                _offer_both(log, log.dq, tally, limits.joint_jerk, k)
        if self.tool is not None and limits.tool_jerk is not None:
            width, x = self.tool.jerk(log, k)
            t, q = log.middles(width)
            size = np.linalg.norm(x.mean, axis=1)
            off = x.error[:, 0]
            slack = max(slack, tally.offer("tool_jerk", t, size, limits.tool_jerk, q, off))
        return slack


def _tool_column(log: Log, tally: Tally) -> _Column:
    """The highest derivative of the tool point that samples have."""
    if log.dq is None:
        values, off = tally.tool(log.q, log.errors[0])
        return _Column(order=0, values=values, off=off[:, None])
    x = States(t=log.t, q=log.q, dq=log.dq, ddq=log.ddq, errors=log.errors)
    order, arm = 1 if x.ddq is None else 2, tally.arm
    values, off = tally.bounded(x, (arm.tool_velocity, arm.tool_acceleration)[order - 1], order)
    return _Column(order=order, values=values, off=off[:, None])


def _offer_both(log: Log, dq: FloatArray, tally: Tally, limit: FloatArray, k: int) -> None:
    """Offer the mean jerks that follow from positions and velocities at both ends of windows."""
    span, late = log.spans(k)
    total = dq[k:] + dq[:-k]
    rest = np.abs(total * span - 2 * (log.q[k:] - log.q[:-k]))
    off = 4 * log.errors[0] + 2 * log.errors[1] * (span + late) + np.abs(total) * late
    mean = 6 * rest / span**3
    # As numbers of positions are rounded, this says nothing about the motion as it stands.
    narrow, tally.narrow = tally.narrow, False
    error = mean - 6 * (rest - off) / (span + late) ** 3
    t, q = log.middles(k)
    tally.offer("joint_jerk", t, mean, limit, q, error)
    tally.narrow = narrow
