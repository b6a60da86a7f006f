"""Limits of how the tool turns, on paths in space."""

import functools

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import armcontour as ac

DOWN, ASLANT = (0.0, 0.0, -1.0), (0.4, 0.3, -1.0)


@pytest.fixture(scope="module")
def robot():
    return ac.load_arm("ur5e")


@pytest.fixture(scope="module")
def way(robot):
    points = [(0.4, -0.2, 0.4), (0.5, 0.2, 0.35), (0.45, 0.3, 0.5), (0.3, 0.3, 0.6)]
    held = ac.Path.polyline(points).pointing([DOWN, ASLANT, (0.3, 0.4, -1.0), (0.0, 0.6, -1.0)])
    return ac.trace(ac.round_corners(held, tolerance=0.01), robot)


def test_kept_between_the_points(way, robot):
    limits = robot.limits.replace(
        speed=0.5, angular_speed=0.6, angular_acceleration=2.0, joint_acceleration=None
    )
    for intervals in (200, 4000):
        planned = ac.plan(way, robot, limits, intervals=intervals)
        found = ac.check(planned, robot, limits, points=30)
        assert not found.violated, found.worst
        assert found["angular_speed"].ratio == pytest.approx(1, abs=1e-4)
        assert 0.998 < found["angular_acceleration"].ratio <= 1 + 1e-9
        names = {x.name for x in ac.explain(planned, robot, limits).bindings}
        assert {"angular speed", "angular acceleration"} <= names


def test_an_even_turn_takes_the_time_it_must(robot):
    """Rest to rest by 2 sqrt(angle / limit); the polygon costs 0.06 % of it at most."""
    angle, down = 0.6, Rotation.from_matrix(np.diag([1.0, -1.0, -1.0]))
    turned = Rotation.from_rotvec([0.0, angle * 0.6, angle * 0.8]) * down
    line = ac.Path.polyline([(0.4, -0.1, 0.4), (0.4, 0.1, 0.4)]).oriented(
        Rotation.concatenate([down, turned])
    )
    limits = ac.Limits(angular_acceleration=1.5)
    planned = ac.plan(line, robot, limits)
    bare = 2 * np.sqrt(angle / 1.5)
    assert bare * (1 - 1e-9) < planned.duration < bare * (1 + 7e-4)


def test_a_tool_that_keeps_its_direction_is_not_limited(robot):
    line = ac.Path.polyline([(0.4, -0.1, 0.4), (0.4, 0.1, 0.4)]).pointing(DOWN)
    slow = robot.limits.replace(angular_speed=0.01, angular_acceleration=0.01)
    # Turning about the tool axis is free, so the tool may turn all the same: hold it.
    held = line.oriented(np.diag([1.0, -1.0, -1.0]))
    free = ac.plan(held, robot, robot.limits)
    assert ac.plan(held, robot, slow).duration == pytest.approx(free.duration, rel=1e-6)


def test_refused_without_an_orientation(arm, rounded, limits, robot, refuses):
    joints = ac.JointPath.spline([np.zeros(6), np.ones(6)])
    for path, own, bare in ((rounded, arm, limits), (joints, robot, robot.limits)):
        for name in ("angular_speed", "angular_acceleration"):
            own_limits = bare.replace(**{name: 1.0})
            call = functools.partial(ac.plan, path, own, own_limits)
            refuses(call, ac.InvalidInput)
