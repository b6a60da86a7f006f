"""The methods of the paper with arms of six and seven joints, and limits they do not plan for."""

from __future__ import annotations

import numpy as np
import pytest

import armcontour as ac

pytest.importorskip("pinocchio")

POINTS = np.array([[0.45, -0.15, 0.4], [0.5, 0.15, 0.4], [0.4, 0.2, 0.55]])


def path(points=POINTS):
    held = ac.Path.polyline(points).oriented(np.diag([1.0, -1.0, -1.0]))
    return ac.round_corners(held, tolerance=0.01)


@pytest.mark.parametrize("name", ["ur5e", "ur10e", "panda"])
def test_six_and_seven_joints(name):
    robot = ac.load_arm(name)
    limits = robot.limits.replace(speed=0.2, centripetal_acceleration=0.5, joint_jerk=None)
    way = ac.trace(path(), robot)
    planned = ac.plan(way, robot, limits, method="mac")
    used = {x.name: x.ratio for x in ac.check(planned, robot, limits, points=5).uses}
    # Other joints' velocities step at knots, and the traced path has its play.
    assert used.pop("velocity_step") < 10
    assert max(used.values()) < 1 + 1e-4
    assert planned.duration >= ac.plan(way, robot, limits).duration * (1 - 1e-6)


def test_joints_that_hardly_move():
    """A line that two joints would do, seen by six."""
    robot = ac.load_arm("ur5e")
    limits = robot.limits.replace(speed=0.3)
    up = np.array([[0.4, 0.1333, 0.3], [0.4, 0.1333, 0.5]])
    planned = ac.plan(path(up), robot, limits, method="mac")
    found = ac.check(planned, robot, limits, points=5)
    assert found["joint_acceleration"].ratio == pytest.approx(1, abs=1e-6)


def test_torque_is_looked_at_afterwards(refuses):
    robot = ac.load_arm("ur5e")
    way = ac.trace(path(), robot)
    limits = robot.limits.replace(
        speed=0.2, centripetal_acceleration=0.5, joint_torque=[150, 28, 150, 28, 28, 28]
    )
    for method, words in (("mac", "On line 1 (MAC)"), ("conventional", "At uniform speed")):
        refuses(
            lambda method=method: ac.plan(way, robot, limits, method=method),
            ac.NotRealizable,
            words,
            "joint 2 would need",
            "N m, but its limit is 28 N m",
            joint=2,
            limit="joint_torque",
            allowed=28.0,
        )


@pytest.mark.parametrize("method", ["mac", "conventional"])
def test_what_is_broken_is_refused_where_and_when_it_is(method):
    robot = ac.load_arm("ur5e")
    turning = ac.Path.polyline(POINTS[:2]).pointing([(0, 0, -1), (0.5, 0, -1)])
    allowed = robot.limits.replace(speed=0.2, angular_speed=1e-3)
    with pytest.raises(ac.NotRealizable) as caught:
        ac.plan(turning, robot, allowed, method=method)
    found = caught.value
    assert found.s > 0 and found.t > 0 and f"at {found.s:.4g} m" in str(found)
    planned = ac.plan(turning, robot, allowed.replace(angular_speed=None), method=method)
    state = (planned([found.t], order) for order in (0, 1))
    tool = robot.tool_twist(*state)[0]
    assert np.linalg.norm(tool[3:]) == pytest.approx(found.needed, rel=1e-4)
    np.testing.assert_allclose(robot.forward(planned(found.t)), turning(found.s), atol=1e-7)


@pytest.mark.parametrize("name", ["angular_speed", "angular_acceleration"])
@pytest.mark.parametrize("method", ["mac", "conventional"])
def test_turning_is_looked_at_afterwards(name, method, arm, rounded, limits, refuses):
    robot = ac.load_arm("ur5e")
    turning = ac.Path.polyline(POINTS[:2]).pointing([(0, 0, -1), (0.5, 0, -1)])
    allowed = robot.limits.replace(speed=0.2, **{name: 1e-3})
    refuses(
        lambda: ac.plan(turning, robot, allowed, method=method),
        ac.NotRealizable,
        "the tool would need",
        "of turning",
        joint=None,
        limit=name,
    )
    planar = limits.replace(**{name: 1.0})
    with pytest.raises(ac.InvalidInput, match="a point without an orientation"):
        ac.plan(rounded, arm, planar, method=method)
