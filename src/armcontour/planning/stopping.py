"""Stops on the path: a trajectory that ends early, at rest, within its limits.

The joints move through `q(tau(t))`, where q is the plan, tau is the time of the plan, and dtau/dt
decreases from 1 to 0. Therefore the tool stays on its path and all speeds decrease, and every plan
can be stopped: contours and rapids, with laws of any method.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.errors import NotRealizable
from armcontour.core.fields import checked
from armcontour.core.quantities import Time
from armcontour.motion import JointPath, Law, PathLaw, Trajectory
from armcontour.planning.constraints import (
    AngularAcceleration,
    Constraint,
    OnGrid,
    ToolAcceleration,
)
from armcontour.planning.law_checks import with_reserve
from armcontour.planning.optimal import plan_optimal
from armcontour.planning.options import Optimal
from armcontour.planning.topp.limit_forms import Ceiling, Form
from armcontour.robot import Arm, Limits
from armcontour.robot.limit_use import States

# Longest piece of the joint path over time [s]; its quintics are within 1e-10 rad of the plan.
MAX_PIECE = 2e-3
# Precision of the duration of a stop with limits of jerk [s]
PRECISION = 1e-3
# A plan is at rest if no joint is faster than this [rad/s].
REST_SPEED = 1e-6
# Share of the limits that a stop uses of the plan's reserve at first, because the grid of the stop
# has other margins than the grid of the plan.
MARGIN = 0.01
# Number of grid intervals of a stop without limits of jerk
INTERVALS = 200
# Stop with limits of jerk: number of times at which states are checked, and first duration that is
# tried [s]
CHECKED_STATES = 500
FIRST_DURATION = 0.02


@checked
def stop(trajectory: Trajectory, t: Time) -> Trajectory:
    """Stop a trajectory on its path within its limits, from a given time on.

    With limits of jerk, `dtau/dt` falls along one smooth curve; without, the stop is the fastest
    one.

    Args:
        trajectory: A plan with arm and limits. With a reserve below 1 %, a stop that begins where a
            limit is active may be impossible until the plan leaves that limit.
        t: Time at which the stop begins [s].

    Returns:
        The laws until `t` and a law that ends at rest, without spans and events. Where the limits
        allow no earlier stop, the plan until it rests by itself.

    Raises:
        InvalidInput: The trajectory has no arm.
    """
    arm, limits = trajectory.require_arm(), trajectory.limits_for(None)
    rest = _next_rest(trajectory, t)
    if np.abs(trajectory(min(t, rest), 1)).max() < REST_SPEED:
        return _cut_at(trajectory, min(t, rest))
    joint_path = _path_over_time(trajectory, t, rest)
    find = _smooth_stop if limits.jerk_limits else _fastest_stop
    begin = _cut_at(trajectory, t)
    # A part of the reserve is used first, then all of it.
    for reserve in sorted({max(trajectory.reserve - MARGIN, 0.0), 0.0}, reverse=True):
        law = find(joint_path, arm, with_reserve(limits, reserve))
        if law is not None and law.breaks[-1] < rest - t:
            return replace(begin, laws=(*begin.laws, law))
    return _cut_at(trajectory, rest)


def _next_rest(trajectory: Trajectory, t: float) -> float:
    """First time after `t` at which the plan is at rest [s]."""
    times = trajectory.breaks
    times = np.append(times[times > t], trajectory.duration)
    speeds = np.abs(trajectory(times, 1, side="left")).max(axis=1)
    return float(times[np.argmax(speeds < REST_SPEED)])


def _cut_at(trajectory: Trajectory, t: float) -> Trajectory:
    """Cut a trajectory at a time; the result has no spans and no events."""
    plain = replace(trajectory, stretches=(), spans=(), events=())
    if t >= trajectory.duration:
        return plain
    k = max(int(np.searchsorted(trajectory.starts, t)) - 1, 0)
    end = t - float(trajectory.starts[k])
    if not end:
        return plain
    return replace(plain, laws=(*trajectory.laws[:k], ShortenedLaw.cut(trajectory.laws[k], end)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ShortenedLaw(Law):
    """The beginning of another law.

    Args:
        law: The law.
            breaks: Breaks of `law` before the end, from 0, and the end [s], (n + 1,).
    """

    law: Law
    breaks: FloatArray

    @classmethod
    def cut(cls, law: Law, end: float) -> ShortenedLaw:
        """Shorten a law to end at a time [s]."""
        return cls(law=law, breaks=np.append(law.breaks[law.breaks < end], end))

    def on_interval(self, i: IntArray, t: FloatArray, order: int) -> FloatArray:
        """Joint positions of the law or their derivative of the given order."""
        return self.law.on_interval(i, t, order)


def _path_over_time(trajectory: Trajectory, begin: float, end: float) -> JointPath:
    """The motion between two times as a joint path whose parameter is the time from `begin`."""
    inner = trajectory.smooth_breaks
    breaks = [begin, *inner[(inner > begin) & (inner < end)], end]
    counts = np.ceil(np.diff(breaks) / MAX_PIECE).astype(int)
    parts = [
        np.linspace(a, b, n, endpoint=False)
        for a, b, n in zip(breaks[:-1], breaks[1:], counts, strict=True)
    ]
    times = np.append(np.concatenate(parts), end)
    times = times[np.append(True, np.diff(times) > MAX_PIECE * 1e-6)]
    after = np.stack(trajectory.motion(times[:-1], side="right"))
    before = np.stack(trajectory.motion(times[1:], side="left"))
    # Velocities of the paper's method jump slightly at knots. A joint path would have to rest
    # there, so the velocities of both sides are averaged.
    after[1, 1:] = before[1, :-1] = (after[1, 1:] + before[1, :-1]) / 2
    return JointPath.hermite(
        times - begin, (after[0], after[1], after[2]), (before[0], before[1], before[2])
    )


class _PlanSpeed(Constraint):
    """Limit of the speed to the speed of the plan, dtau/dt <= 1."""

    name = "speed of the plan"

    def discretize(self, path: OnGrid) -> tuple[Form, ...]:
        """Upper bound 1 of (dtau/dt)² at both ends of every interval."""
        return (Ceiling(np.ones((len(path.grid.s) - 1, 2))),)


def _fastest_stop(joint_path: JointPath, arm: Arm, limits: Limits) -> Law | None:
    """Fastest stop on the shortest feasible beginning of a path; None if none is feasible."""
    constraints: list[Constraint] = [_PlanSpeed()]
    if limits.tool_acceleration is not None:
        constraints.append(ToolAcceleration(limits.tool_acceleration, arm))
    if limits.angular_acceleration is not None:
        constraints.append(AngularAcceleration(limits.angular_acceleration, arm))
    options = Optimal(constraints=tuple(constraints), start_speed=1.0, intervals=INTERVALS)
    law, low, high = None, 0, len(joint_path.breaks) - 1
    while high - low > 1:
        middle = (low + high) // 2
        part = JointPath(
            breaks=joint_path.breaks[: middle + 1], coefficients=joint_path.coefficients[:middle]
        )
        try:
            (law,) = plan_optimal(part, arm, limits.of_joints, options).laws
            high = middle
        except NotRealizable:
            low = middle
    return law


def _smooth_stop(joint_path: JointPath, arm: Arm, limits: Limits) -> Law | None:
    """Shortest smooth stop that satisfies all limits; None if the path is too short."""
    low, high = 0.0, FIRST_DURATION
    while True:
        # A stop advances the time of the plan by half of the duration of the stop.
        if high / 2 > joint_path.length:
            return None
        if _is_within(_slow_down(joint_path, high), arm, limits):
            break
        low, high = high, 1.5 * high
    while high - low > PRECISION:
        middle = (low + high) / 2
        if _is_within(_slow_down(joint_path, middle), arm, limits):
            high = middle
        else:
            low = middle
    return PathLaw.over_time(_slow_down(joint_path, high))


def _slow_down(joint_path: JointPath, duration: float) -> JointPath:
    """Stop in a given duration [s], as a joint path whose parameter is the time.

    `dtau/dt = 1 - S(t / duration)` with `S(x) = 10 x³ - 15 x⁴ + 6 x⁵`, so tau has no jerk at both
    ends.
    """
    # Breaks of the plan are also breaks of the stop, because accelerations may jump there.
    x = np.linspace(0.0, 1.0, CHECKED_STATES)
    tau = duration * (x - x**4 * (2.5 - x * (3.0 - x)))
    inner = joint_path.breaks[joint_path.breaks < tau[-1]]
    x = np.unique(np.concatenate([x, np.interp(inner, tau, x)]))
    x = x[np.append(True, np.diff(x) > 1e-9)]
    tau = duration * (x - x**4 * (2.5 - x * (3.0 - x)))
    rate = (1 - x**3 * (10 - x * (15 - 6 * x)))[:, None]
    slope = (-30 * x**2 * (1 - x) ** 2 / duration)[:, None]
    ends = []
    for part, side in ((slice(None, -1), "right"), (slice(1, None), "left")):
        q, first, second = (joint_path(tau[part], k, side=side) for k in range(3))
        v, a = rate[part], slope[part]
        ends.append((q, first * v, second * v**2 + first * a))
    begin, end = (tuple(x) for x in ends)
    return JointPath.hermite(duration * x, begin, end)


def _is_within(path: JointPath, arm: Arm, limits: Limits) -> bool:
    """True if a motion along a path over time is within the limits at both ends of its pieces."""
    for t, side in ((path.breaks[:-1], "right"), (path.breaks[1:], "left")):
        states = States(arm, [path(t, k, side=side) for k in range(4)])
        if any((use.ratio > 1).any() for use in states.uses(limits)):
            return False
    return True
