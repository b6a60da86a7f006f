"""Stops of motions with limits of jerk: on the path, with a cubic speed in joint space.

The joints move through `q(tau(t))`, where q is the motion, tau is its time, and dtau/dt decreases
to 0. Therefore the tool stays on its path, and no speed exceeds that of the motion.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.motion import JointPath, Trajectory
from armcontour.motion.time_scaling import TimeScaling
from armcontour.planning.jerk.interior_point import NODES, WEIGHTS
from armcontour.robot import Arm, Limits
from armcontour.robot.limit_use import States

# Longest piece of the joint path over time [s]; its quintics are within 1e-10 rad of the plan.
MAX_PIECE = 2e-3
# Pieces shorter than this are rounding errors of the times of breaks [s].
SHORTEST_PIECE = MAX_PIECE * 1e-6
# Relative precision of the duration of a stop
PRECISION = 0.02
# Delays of a stop that are tried, as fractions of the time from the request to
# its end. If the jerk of the plan is at its limit, a stop that begins immediately can take many
# times longer.
DELAYS = (0.0, 0.25, 0.5)
# A plan is at rest if no joint is faster than this [rad/s].
REST_JOINT_SPEED = 1e-6
# Numbers of states in the first and the second check of a stop.
CHECKED_STATES = (40, 500)
# First duration that is tried [s].
FIRST_DURATION = 0.02
# Number of iterations of Newton's method for the time at a length of the path.
NEWTON_ITERATIONS = 2
# Rounding error of dtau/dt, of speeds as fractions of the initial speed of a stop, and of times as
# fractions of its duration.
STOP_ROUNDING = 1e-6


def next_rest(trajectory: Trajectory, t: float) -> float:
    """Return the first time after `t` at which the plan is at rest [s]."""
    times = trajectory.breaks
    times = np.append(times[times > t], trajectory.duration)
    speeds = np.abs(trajectory(times, 1, side="left")).max(axis=1)
    return float(times[np.argmax(speeds < REST_JOINT_SPEED)])


def path_over_time(
    trajectory: Trajectory, begin: float, end: float, smooth_breaks: FloatArray | None = None
) -> JointPath:
    """Return the motion between two times as a joint path over the time since `begin`.

    - `smooth_breaks`: times between which the motion is smooth [s], by default those of the
      trajectory.
    """
    inner = trajectory.smooth_breaks if smooth_breaks is None else smooth_breaks
    breaks = [begin, *inner[(inner > begin) & (inner < end)], end]
    counts = np.ceil(np.diff(breaks) / MAX_PIECE).astype(int)
    parts = [
        np.linspace(a, b, n, endpoint=False)
        for a, b, n in zip(breaks[:-1], breaks[1:], counts, strict=True)
    ]
    times = np.append(np.concatenate(parts), end)
    times = times[np.append(True, np.diff(times) > SHORTEST_PIECE)]
    after = np.stack(trajectory.motion(times[:-1], side="right"))
    before = np.stack(trajectory.motion(times[1:], side="left"))
    # Velocities of the paper's method jump slightly at knots. A joint path would have to rest
    # there, so the velocities of both sides are averaged.
    after[1, 1:] = before[1, :-1] = (after[1, 1:] + before[1, :-1]) / 2
    return JointPath.hermite(
        times - begin, (after[0], after[1], after[2]), (before[0], before[1], before[2])
    )


def smooth_stop(
    jumps: FloatArray, joint_path: JointPath, arm: Arm, limits: Limits
) -> TimeScaling | None:
    """Search for the earliest stop with a cubic speed; None if no stop is feasible.

    - `jumps`: times at which derivatives of the motion may be discontinuous [s], (n,).
    - `joint_path`: the motion over its time, as of `path_over_time`, which begins with the request.

    Returns the time of this motion over the time since the request.
    """
    lengths = _joint_lengths(joint_path)
    jump_lengths = _length_until(joint_path, lengths, jumps)

    def stop_in(duration: float, share: float) -> JointPath | None:
        """Make the stop that ends after `duration` [s] and begins after its fraction `share`."""
        if share * duration >= joint_path.length:
            return None
        speed = _cubic_speed(joint_path, lengths, share * duration, (1 - share) * duration)
        if speed is None:
            return None
        stopped = None
        for n, breaks in zip(CHECKED_STATES, (jump_lengths[:0], jump_lengths), strict=True):
            stopped = _slow_down(joint_path, lengths, speed, speed.times(n, breaks))
            if stopped is None or not _is_within(stopped, arm, limits):
                return None
        return stopped

    low = 0.0
    high = FIRST_DURATION
    stopped = None
    while stopped is None:
        for share in DELAYS:
            stopped = stop_in(high, share)
            if stopped is not None:
                break
        else:
            if high / 2 > joint_path.length:
                return None
            low = high
            high = 1.5 * high
    while high - low > PRECISION * high:
        middle = (low + high) / 2
        shorter = stop_in(middle, share)
        if shorter is None:
            low = middle
        else:
            high = middle
            stopped = shorter
    delay = share * high
    speed = _cubic_speed(joint_path, lengths, delay, high - delay)
    assert speed is not None
    times = speed.times(CHECKED_STATES[-1], jump_lengths)
    passage = _passage(joint_path, lengths, speed, times)
    assert passage is not None
    return passage.scaling.delayed(delay)


@dataclass(frozen=True, slots=True)
class _CubicSpeed:
    """Speed in joint space v(t) of a stop: a cubic polynomial that ends at rest.

    It begins with the speed v0 [rad/s] and the acceleration a0 [rad/s²] of the plan at `delay` [s],
    where the length of the path is `begin` [rad], and ends after `duration` [s].
    """

    delay: float
    begin: float
    duration: float
    v0: float
    a0: float

    def speed(self, t: FloatArray) -> FloatArray:
        """Return the speed in joint space [rad/s], (n,), at times t [s]."""
        x = t / self.duration
        return (1 - x) ** 2 * (self.v0 + (2 * self.v0 + self.a0 * self.duration) * x)

    def acceleration(self, t: FloatArray) -> FloatArray:
        """Return the derivative of the speed [rad/s²], (n,), at times t [s]."""
        x = t / self.duration
        return (1 - x) * (self.a0 * (1 - 3 * x) - 6 * self.v0 / self.duration * x)

    def length(self, t: FloatArray) -> FloatArray:
        """Return the length of the path in joint space [rad], (n,), up to times t [s]."""
        x = t / self.duration
        linear = self.v0 * x * (1 - x**2 * (1 - x / 2))
        rest = self.a0 * self.duration * x**2 * (1 / 2 - x * (2 / 3 - x / 4))
        return self.begin + self.duration * (linear + rest)

    def times(self, n: int, lengths: FloatArray) -> FloatArray:
        """Return n uniform times, and the times at lengths of the path [rad], as one array [s]."""
        t = np.linspace(0.0, self.duration, n)
        table = self.length(t)
        inner = lengths[(lengths > self.begin) & (lengths < table[-1])]
        x = np.interp(inner, table, t)
        for _ in range(NEWTON_ITERATIONS):
            x = x + (inner - self.length(x)) / np.maximum(self.speed(x), self.v0 * STOP_ROUNDING)
        t = np.unique(np.concatenate([t, np.clip(x, 0.0, self.duration)]))
        return np.asarray(t[np.append(True, np.diff(t) > STOP_ROUNDING * self.duration)])


def _cubic_speed(
    joint_path: JointPath, lengths: FloatArray, delay: float, duration: float
) -> _CubicSpeed | None:
    """Return the cubic speed of a stop; None if it is negative, or if the path is too short."""
    first, second = (joint_path(np.array([delay]), k, side="right")[0] for k in (1, 2))
    v0 = float(np.linalg.norm(first))
    begin = float(_length_until(joint_path, lengths, np.array([delay]))[0])
    speed = _CubicSpeed(delay, begin, duration, v0, float(first @ second) / v0)
    # The speed is the square (1 - x)² times a line, which has this value at the end.
    is_negative = 3 * v0 + speed.a0 * duration < 0
    end = float(speed.length(np.array([duration]))[0])
    return None if is_negative or end >= lengths[-1] else speed


def _length_until(joint_path: JointPath, lengths: FloatArray, t: FloatArray) -> FloatArray:
    """Return the length of the path in joint space up to the parameters t [rad], (n,)."""
    breaks = joint_path.breaks
    k = np.clip(np.searchsorted(breaks, t, side="right") - 1, 0, len(breaks) - 2)
    return np.asarray(lengths[k] + _integrate_speed(joint_path, breaks[k], t))


def _joint_lengths(joint_path: JointPath) -> FloatArray:
    """Return the length of the path in joint space up to each of its breaks [rad], (breaks,)."""
    breaks = joint_path.breaks
    pieces = _integrate_speed(joint_path, breaks[:-1], breaks[1:])
    return np.append(0.0, np.cumsum(pieces))


def _integrate_speed(joint_path: JointPath, begin: FloatArray, end: FloatArray) -> FloatArray:
    """Return lengths in joint space between two times on the same piece [rad], (n,)."""
    duration = end - begin
    t = begin[:, None] + duration[:, None] * NODES
    speed = np.linalg.norm(joint_path(t.ravel(), 1), axis=1).reshape(t.shape)
    return np.asarray(duration * (speed @ WEIGHTS))


def _time_at(joint_path: JointPath, lengths: FloatArray, length: FloatArray) -> FloatArray:
    """Return the times at lengths in joint space [s], (n,), by Newton's method."""
    k = np.clip(np.searchsorted(lengths, length, side="right") - 1, 0, len(lengths) - 2)
    begin = joint_path.breaks[k]
    end = joint_path.breaks[k + 1]
    tau = begin + (end - begin) * (length - lengths[k]) / (lengths[k + 1] - lengths[k])
    for _ in range(NEWTON_ITERATIONS):
        excess = lengths[k] + _integrate_speed(joint_path, begin, tau) - length
        speed = np.linalg.norm(joint_path(tau, 1), axis=1)
        tau = np.clip(tau - excess / speed, begin, end)
    return np.asarray(tau)


@dataclass(frozen=True, slots=True)
class _Passage:
    """Parameter tau of a joint path during a stop, at both ends of its pieces.

    - `t`: times at the ends of the pieces [s], (n + 1,).
    - `begin`, `end`: tau [s], its rate [-] and the slope of the rate [1/s] at the starts and ends
      of the pieces, (3, n) each.
    """

    t: FloatArray
    begin: FloatArray
    end: FloatArray

    @property
    def scaling(self) -> TimeScaling:
        """The parameter as a time scaling."""
        begin, end = ((x[0], x[1], x[2]) for x in (self.begin, self.end))
        return TimeScaling.hermite(self.t, begin, end)


def _passage(
    joint_path: JointPath, lengths: FloatArray, speed: _CubicSpeed, t: FloatArray
) -> _Passage | None:
    """Return how a stop passes a joint path; None if it would be faster than the plan."""
    tau = _time_at(joint_path, lengths, speed.length(t))
    tau[0] = speed.delay
    v = speed.speed(t)
    a = speed.acceleration(t)
    ends = []
    for part, side in ((slice(None, -1), "right"), (slice(1, None), "left")):
        first, second = (joint_path(tau[part], k, side=side) for k in (1, 2))
        planned = np.linalg.norm(first, axis=1)
        rate = v[part] / planned
        if rate.max() > 1 + STOP_ROUNDING:
            return None
        slope = (a[part] - rate**2 * np.einsum("nj,nj->n", first, second) / planned) / planned
        ends.append(np.stack([tau[part], rate, slope]))
    return _Passage(t, *ends)


def _slow_down(
    joint_path: JointPath, lengths: FloatArray, speed: _CubicSpeed, t: FloatArray
) -> JointPath | None:
    """Make the joint path of the stop over time; None if it would be faster than the plan."""
    passage = _passage(joint_path, lengths, speed, t)
    if passage is None:
        return None
    ends = []
    for (tau, rate, slope), side in ((passage.begin, "right"), (passage.end, "left")):
        q, first, second = (joint_path(tau, k, side=side) for k in range(3))
        rates = rate[:, None]
        ends.append((q, first * rates, second * rates**2 + first * slope[:, None]))
    return JointPath.hermite(t, *ends)


def _is_within(path: JointPath, arm: Arm, limits: Limits) -> bool:
    """Return whether a motion along a path is within the limits at both ends of every piece."""
    for t, side in ((path.breaks[:-1], "right"), (path.breaks[1:], "left")):
        states = States(arm, [path(t, k, side=side) for k in range(4)])
        if any((use.ratio > 1).any() for use in states.uses(limits)):
            return False
    return True
