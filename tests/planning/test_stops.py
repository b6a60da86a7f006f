"""Stops and pauses on the path, within the limits, with the plan unchanged before the stop."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
import pytest

import armcontour as ac
from armcontour.planning.constraints import FROM_LIMITS, Constraint, ToolAcceleration
from armcontour.planning.override_ramps import override_of
from armcontour.planning.topp.limit_forms import Form
from armcontour.planning.topp.sampled_joint_path import SampledJointPath

POINTS = np.array([(0.350, 0.100), (0.410, 0.150), (0.280, 0.300), (0.350, 0.350)])
TIMES = np.linspace(0.02, 0.98, 17)
# The paper's method may exceed a limit by 1e-5 itself.
ROUNDING = 1e-5


CYCLE = 1e-3


class Stopped(NamedTuple):
    """A motion that stops, and the time at which its plan is where it ends [s]."""

    trajectory: ac.Trajectory
    end: float


def stopped_at(plan: ac.Trajectory, t: float) -> Stopped:
    """The motion that is played if a stop is requested at a time [s]."""
    override = override_of(plan, CYCLE, for_play=False)
    pace = override.begin(1.0, delay=t)
    paused = override.change(pace, t, 0.0) if t < pace.scaling.end else pace
    return Stopped(paused.scaling.trajectory(plan), paused.end_of_plan)


def _plan(method: str) -> ac.Trajectory:
    arm = ac.load_arm("pmk3s")
    limits = arm.limits.replace(speed=0.15, centripetal_acceleration=0.09)
    continuity = "curvature" if method == "jerk" else "tangent"
    path = ac.round_corners(ac.Path.polyline(POINTS), tolerance=5e-3, continuity=continuity)
    if method == "jerk":
        limits = limits.replace(joint_jerk=40.0)
    if method == "tool":
        limits = limits.replace(tool_acceleration=0.3)
    options = ac.Paper(knots=600, reserve=0.05) if method == "paper" else ac.Optimal(reserve=0.05)
    return ac.plan(path, arm, limits, options)


@pytest.mark.parametrize("method", ["optimal", "tool", "jerk", "paper"])
def test_a_stop_stays_on_the_path_within_the_limits_and_ends_at_rest(method: str) -> None:
    """At 17 times of the plan, by `check`, which shares no code with the planner."""
    plan = _plan(method)
    assert plan.arm is not None and plan.limits is not None and plan.path is not None
    for t in TIMES * plan.duration:
        early = stopped_at(plan, float(t))
        stopped = early.trajectory
        assert t <= stopped.duration <= plan.duration + 1e-9
        # The stop ends where the plan is at a time that is not after the end of the stop.
        assert t <= early.end <= stopped.duration + 1e-9
        np.testing.assert_allclose(stopped(stopped.duration), plan(early.end), atol=1e-8)
        before = np.linspace(0, t, 50, endpoint=False)
        np.testing.assert_allclose(stopped(before, 0), plan(before, 0), rtol=0, atol=1e-12)
        result = ac.check(stopped, plan.arm, plan.limits, plan.path)
        assert max(x.ratio for x in result.uses) < 1 + ROUNDING, (t, result)
        assert result.end_speeds[1] < 1e-9
        own = ac.check(plan, plan.arm, plan.limits, plan.path)
        assert result.path_deviation is not None and own.path_deviation is not None
        assert result.path_deviation.distance < own.path_deviation.distance + 1e-8


def test_the_stop_brakes_with_the_joint_limit_less_the_reserve() -> None:
    """On a straight line at uniform speed, one joint brakes with its limit less the reserve."""
    plan = _plan("optimal")
    line = ac.JointPath.spline([[0.0, 0.0], [1.0, 0.5], [2.0, 1.0]], [0.0, 1.0, 2.0])
    limits = ac.Limits(joint_velocity=1.0, joint_acceleration=2.0)
    motion = ac.plan(line, plan.arm, limits, ac.Optimal(reserve=0.01))
    stopped = stopped_at(motion, motion.duration / 2).trajectory
    assert stopped.duration - motion.duration / 2 == pytest.approx(0.5, rel=0.01)


def _fastest_duration(v: float, a: float, limit: float, jerk: float) -> float:
    """Duration of the fastest stop of one joint: jerk -J, acceleration -A, jerk +J [s]."""
    peak = np.sqrt(jerk * v + a**2 / 2)
    if peak <= limit:
        return (a + 2 * peak) / jerk
    return (a + 2 * limit) / jerk + (v + a**2 / (2 * jerk) - limit**2 / jerk) / limit


def test_a_stop_with_jerk_limits_takes_at_most_twice_the_fastest_time() -> None:
    """While the plan accelerates, at uniform speed, and while it brakes, on a straight line."""
    arm = ac.load_arm("pmk3s")
    line = ac.JointPath.spline([[0.0, 0.0], [1.0, 0.5], [2.0, 1.0]], [0.0, 1.0, 2.0])
    limits = ac.Limits(joint_velocity=0.5, joint_acceleration=0.5, joint_jerk=1.0)
    motion = ac.plan(line, arm, limits, ac.Optimal(reserve=0.02))
    for t in np.linspace(0.01, 0.99, 40) * motion.duration:
        v, _ = motion(float(t), 1)
        a, _ = motion(float(t), 2)
        fastest = _fastest_duration(v, a, 0.5, 1.0)
        stopped = stopped_at(motion, float(t)).trajectory
        duration = stopped.duration - t
        assert fastest - 1e-6 < duration < max(2 * fastest, 0.03), (t, duration, fastest)
        # As a controller with a cycle of 4 ms sees it.
        step = 4e-3
        acceleration = stopped.motion(np.arange(0.0, stopped.duration, step), 2)[2]
        assert np.abs(acceleration).max() < 0.5 * (1 + ROUNDING)
        assert np.abs(np.diff(acceleration, axis=0)).max() / step < 1.0 * (1 + ROUNDING)


def test_a_stop_at_a_rest_or_end_of_a_program_takes_no_time() -> None:
    """Rapids and dwells stop like contours; a stop at rest is no motion."""
    arm = ac.load_arm("pmk3s")
    contours = [
        ac.Contour(path=ac.Path.polyline([(0.30, 0.20), (0.35, 0.20)])),
        ac.Rapid(),
        ac.Contour(path=ac.Path.polyline([(0.35, 0.25), (0.30, 0.25)])),
    ]
    program = ac.Program(moves=contours)
    limits = arm.limits.replace(speed=0.15)
    plan = ac.plan(program, arm, limits, ac.Optimal(reserve=0.05))
    rapid = next(x for x in plan.spans if x.kind == "rapid")
    inside = sum(rapid.t) / 2
    stopped = stopped_at(plan, inside).trajectory
    assert inside < stopped.duration < rapid.t[1]
    result = ac.check(stopped, arm, limits)
    assert not result.violated and result.end_speeds[1] < 1e-9
    for t in (rapid.t[0], plan.duration):
        stopped, end = stopped_at(plan, t)
        # A change of the override takes a cycle.
        assert t - 1e-9 < end < t + CYCLE
        assert t - 1e-9 < stopped.duration < t + 3 * CYCLE


class OwnToolAcceleration(Constraint):
    """A limit of the tool's acceleration that says nothing about stops."""

    serves = ("tool_acceleration",)
    name = "own acceleration"

    def __init__(self, kept: ToolAcceleration) -> None:
        self.kept = kept

    @classmethod
    def from_limits(
        cls, joint_path: ac.JointPath, arm: ac.Arm, limits: ac.Limits
    ) -> Constraint | None:
        kept = ToolAcceleration.from_limits(joint_path, arm, limits)
        return None if kept is None else cls(kept)

    def discretize(self, path: SampledJointPath) -> Iterable[Form]:
        return self.kept.discretize(path)


def test_stop_keeps_the_limit_of_an_added_constraint(monkeypatch: pytest.MonkeyPatch) -> None:
    """A new constraint restricts stops unless it says that they need not consider it."""
    kinds = [OwnToolAcceleration if x is ToolAcceleration else x for x in FROM_LIMITS]
    monkeypatch.setattr("armcontour.planning.override.FROM_LIMITS", tuple(kinds))
    plan = _plan("tool")
    for t in TIMES * plan.duration:
        stopped = stopped_at(plan, float(t)).trajectory
        times = np.linspace(0.0, stopped.duration, 2001)
        tool = plan.arm.tool_position(stopped(times))
        step = times[1] - times[0]
        acceleration = np.linalg.norm(np.diff(tool, 2, axis=0), axis=1) / step**2
        assert acceleration.max() < 0.3 * (1 + 1e-3)
