"""The methods of the paper with arms of six and seven joints, and limits they do not plan for."""

import numpy as np
import pytest

import armcontour as ac

POINTS = np.array([[0.45, -0.15, 0.4], [0.5, 0.15, 0.4], [0.4, 0.2, 0.55]])
TURNING = ac.Path.polyline(POINTS[:2]).pointing([(0, 0, -1), (0.5, 0, -1)])


@pytest.fixture(scope="module")
def robot():
    return ac.load_arm("ur5e")


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


def test_joints_that_hardly_move(robot):
    """A line that two joints would do, seen by six."""
    limits = robot.limits.replace(speed=0.3)
    up = np.array([[0.4, 0.1333, 0.3], [0.4, 0.1333, 0.5]])
    planned = ac.plan(path(up), robot, limits, method="mac")
    found = ac.check(planned, robot, limits, points=5)
    assert found["joint_acceleration"].ratio == pytest.approx(1, abs=1e-6)


@pytest.mark.parametrize("method", ["mac", "conventional"])
def test_torque_and_turning_are_looked_at_afterwards(method, robot, refuses, arm, rounded, limits):
    fast, weak = robot.limits.replace(speed=0.2), [150, 28, 150, 28, 28, 28]
    strong = fast.replace(centripetal_acceleration=0.5, joint_torque=weak)
    data = {"joint": 2, "limit": "joint_torque", "allowed": 28.0}

    def call(way, own):
        return lambda: ac.plan(way, robot, own, method=method)

    refuses(
        call(ac.trace(path(), robot), strong),
        ac.NotRealizable,
        "N m, but its limit is 28 N m",
        **data,
    )
    for name in ("angular_speed", "angular_acceleration"):
        allowed, data = fast.replace(**{name: 1e-3}), {"joint": None, "limit": name}
        refuses(call(TURNING, allowed), ac.NotRealizable, "of turning", **data)
        planar = limits.replace(**{name: 1.0})
        with pytest.raises(ac.InvalidInput, match="a point without an orientation"):
            ac.plan(rounded, arm, planar, method=method)
    # Where and when it is.
    allowed = fast.replace(angular_speed=1e-3)
    with pytest.raises(ac.NotRealizable) as caught:
        ac.plan(TURNING, robot, allowed, method=method)
    found = caught.value
    assert found.s > 0 and found.t > 0 and f"at {found.s:.4g} m" in str(found)
    planned = ac.plan(TURNING, robot, fast, method=method)
    state = (planned([found.t], order) for order in (0, 1))
    tool = robot.tool_twist(*state)[0]
    assert np.linalg.norm(tool[3:]) == pytest.approx(found.needed, rel=1e-4)
    np.testing.assert_allclose(robot.forward(planned(found.t)), TURNING(found.s), atol=1e-7)
