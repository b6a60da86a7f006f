"""Constraints are passed to the planner: as kinds that serve limits, or as objects."""

from __future__ import annotations

import math

import numpy as np
import pytest

import armcontour as ac
from armcontour.planning.constraints import (
    FROM_LIMITS,
    CommandVelocity,
    Constraint,
    ToolAcceleration,
    ToolPace,
)
from armcontour.planning.topp.limit_forms import Ceiling

LINE = ac.Path.polyline([(0.4, -0.15, 0.2), (0.6, -0.15, 0.2)]).pointing((0, 0, -1))
# Speed of the experiment below, less than any limit allows [m/s].
CRAWL = 0.05


@pytest.fixture(scope="module")
def robot():
    return ac.load_arm("ur5e")


@pytest.fixture(scope="module")
def bounds(robot):
    return robot.limits.replace(speed=0.5, tool_acceleration=2.0)


def define_experiment():
    """Define a constraint as in a cell of a notebook; the class is new at each call."""

    class Crawl(ToolAcceleration):
        serves = ("tool_acceleration",)

        def discretize(self, path):
            return (Ceiling(np.full((len(path), 2), CRAWL**2)),)

    return Crawl


def test_defining_a_class_changes_no_plan(robot, bounds):
    before = ac.plan(LINE, robot, bounds)
    kinds = [define_experiment(), define_experiment()]
    after = ac.plan(LINE, robot, bounds)
    assert after.duration == before.duration
    t = np.linspace(0.0, before.duration, 101)
    np.testing.assert_array_equal(after(t), before(t))
    assert len({*kinds}) == 2


def test_own_constraint_class_replaces_built_in_one(robot, bounds):
    own = define_experiment()
    kinds = [own if kind is ToolAcceleration else kind for kind in FROM_LIMITS]
    planned = ac.plan(LINE, robot, bounds, ac.Optimal(from_limits=kinds))
    assert planned.duration == pytest.approx(LINE.length / CRAWL, rel=0.02)


@pytest.mark.parametrize("limit", ["joint_acceleration", "tool_acceleration", "angular_speed"])
def test_limit_without_constraint_is_refused(robot, bounds, limit):
    kinds = [kind for kind in FROM_LIMITS if limit not in kind.serves]
    options = ac.Optimal(from_limits=kinds)
    limited = bounds.replace(angular_speed=1.0)
    with pytest.raises(ac.InvalidInput, match=f"{limit} is limited, but no constraint"):
        ac.plan(LINE, robot, limited, options)


def test_removing_limit_without_constraint_makes_plan_possible(robot, bounds):
    kinds = [kind for kind in FROM_LIMITS if kind is not ToolAcceleration]
    free = bounds.replace(tool_acceleration=math.inf)
    planned = ac.plan(LINE, robot, free, ac.Optimal(from_limits=kinds))
    assert planned.duration == ac.plan(LINE, robot, free).duration


def test_speed_of_a_segment_is_refused_without_its_kind(robot, bounds):
    kinds = [kind for kind in FROM_LIMITS if kind is not ToolPace]
    free = bounds.replace(speed=math.inf, centripetal_acceleration=math.inf)
    options = ac.Optimal(from_limits=kinds)
    assert ac.plan(LINE, robot, free, options).duration > 0
    slow = ac.Path.polyline(LINE.vertices, segment_limits=ac.SegmentLimits(speed=CRAWL)).pointing(
        (0, 0, -1)
    )
    with pytest.raises(ac.InvalidInput, match="assigned velocity"):
        ac.plan(slow, robot, free, options)


@pytest.mark.parametrize("wrong", [Constraint, int, 3, "JointMotion"])
def test_constraints_from_limits_must_be_constraint_classes(wrong):
    with pytest.raises(ac.InvalidInput, match="from_limits must contain subclasses"):
        ac.Optimal(from_limits=[wrong])


def test_command_velocity_is_kept_and_reached_with_limits_of_torque(robot, bounds):
    dof = robot.dof
    # The lead of joint 3 is 0, so that its set-points are those of the plan.
    lead = np.array([0.1, 0.1, 0.0, 0.1, 0.1, 0.1])
    fastest = np.full(dof, 0.6)
    command = CommandVelocity(lead, -fastest, fastest)
    torque = bounds.replace(joint_torque=np.full(dof, 60.0), speed=math.inf)
    planned = ac.plan(LINE, robot, torque, ac.Optimal(constraints=[command]))
    t = np.linspace(0.0, planned.duration, 20_001)
    velocity = np.abs(planned(t, 1) + lead * planned(t, 2)).max(axis=0)
    assert velocity[lead > 0].max() == pytest.approx(0.6, rel=1e-2)
    assert velocity[lead > 0].max() <= 0.6 * (1 + 1e-9)
    assert velocity[2] > 0.6
    assert np.abs(robot.dynamics.torque(planned(t), planned(t, 1), planned(t, 2))).max() <= 60.0
    names = {x.name for x in ac.explain(planned, constraints=[command]).bindings}
    assert any(x.endswith("command velocity") for x in names)
    assert "joint 3 command velocity" not in names


@pytest.mark.parametrize("wrong", [([0.1], [-1.0, -1.0], [1.0, 1.0]), ([0.1], [0.0], [1.0])])
def test_wrong_bounds_of_command_velocity_are_refused(wrong):
    with pytest.raises(ac.InvalidInput, match="command velocity"):
        CommandVelocity(*wrong)
