"""Checks of how the tool is held along its path."""

from types import SimpleNamespace

import numpy as np
import pytest

import armcontour as ac
from armcontour.evaluation.angular_deviation import angle_off
from armcontour.frames import exp

POINTS = [(0.4, -0.1, 0.3), (0.45, 0.1, 0.3)]
DOWN = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]])


@pytest.fixture(scope="module")
def robot():
    return ac.load_arm("ur5e")


@pytest.fixture(scope="module")
def held():
    return ac.Path.polyline(POINTS).oriented(DOWN)


@pytest.fixture(scope="module")
def planned(robot, held):
    return ac.plan(held, robot, robot.limits)


# Random places per interval of a law: angles are the same at all of them.
FEW = 4


def sampled(planned, columns=("dq", "ddq")):
    x = planned.sample(4e-3)
    return SimpleNamespace(t=x.t, q=x.q, **{name: getattr(x, name) for name in columns})


def turned(angle, axis=(0.0, 0.0, 1.0)):
    return ac.Path.polyline(POINTS).oriented(DOWN @ exp(angle * np.array(axis)))


@pytest.mark.parametrize("angle", [np.pi, 0.02])
@pytest.mark.parametrize("columns", [None, ("dq", "ddq"), ("dq",), ()])
def test_a_tool_held_otherwise_is_found(robot, held, planned, angle, columns):
    given = planned if columns is None else sampled(planned, columns)
    allowed = {"deviation": 1e-4, "orientation_deviation": np.radians(0.5), "points": FEW}
    kept = ac.check(given, robot, robot.limits, held, **allowed)
    assert (
        kept["orientation_deviation"].value < 1e-4 and not kept["orientation_deviation"].ratio > 1
    )
    assert "orientation_deviation" not in kept.not_judged
    found = ac.check(given, robot, robot.limits, turned(angle), **allowed)
    use = found["orientation_deviation"]
    assert use in found.violations and use.joint is None and use.s is not None
    assert use.value == pytest.approx(angle, abs=1e-4)
    assert use.limit == pytest.approx(np.radians(0.5))
    assert found["path_deviation"].ratio < 1


def test_without_a_limit_the_orientation_is_not_judged(robot, held, planned):
    assert (
        "orientation_deviation"
        in ac.check(planned, robot, robot.limits, held, points=FEW).not_judged
    )
    bare = ac.Path.polyline(POINTS)
    assert (
        "orientation_deviation"
        not in ac.check(planned, robot, robot.limits, bare, points=FEW).not_judged
    )


def test_only_the_axis_counts_where_only_that_is_given(robot, planned):
    axis = ac.Path.polyline(POINTS).pointing((0, 0, -1))
    found = ac.check(planned, robot, robot.limits, axis, points=FEW, orientation_deviation=1e-3)
    assert found["orientation_deviation"].value < 1e-5
    tilted = ac.Path.polyline(POINTS).pointing((0.1, 0, -1))
    found = ac.check(planned, robot, robot.limits, tilted, points=FEW, orientation_deviation=1e-3)
    assert found["orientation_deviation"].value == pytest.approx(np.arctan(0.1), abs=1e-4)


def test_printed_digits_leave_the_angle_in_doubt(robot, planned):
    samples, coarse = sampled(planned, ()), {"q": 0.01}
    found = ac.check(
        samples, robot, robot.limits, turned(0.02), orientation_deviation=1e-3, resolution=coarse
    )
    use = found["orientation_deviation"]
    assert use.ratio > 1 and use.slack * use.limit == pytest.approx(6 * 0.005, rel=1e-6)
    assert use not in found.violations


def test_a_path_that_crosses_itself_may_hold_the_tool_in_two_ways(robot):
    """A tool that is a little off may be nearer to the other line; the one that fits counts."""
    cross = np.array([(0.4, -0.05, 0.3), (0.5, 0.05, 0.3), (0.5, -0.05, 0.3), (0.4, 0.05, 0.3)])

    def path(off):
        axes = [(0, 0, -1), (0.2, 0, -1), (0.2, 0, -1), (0.6, 0, -1)]
        sharp = ac.Path.polyline(cross + off).pointing(axes)
        return ac.round_corners(sharp, tolerance=2e-3, angular_tolerance=0.1)

    planned = ac.plan(path((5e-4, 5e-4, 0)), robot, robot.limits)
    q = planned(np.linspace(0, planned.duration, 20_001))
    nearest = path(0).project(robot.forward(q)).s
    assert angle_off(path(0).orientation, nearest, robot.pose(q)[1]).max() > 0.2
    found = ac.check(
        planned, robot, robot.limits, path(0), points=20, orientation_deviation=np.radians(1)
    )
    assert found.path_deviation.distance > 4e-4
    assert found["orientation_deviation"].value < np.radians(1)


def test_it_needs_a_path_that_says_how(robot, arm, mac, rounded, planned, refuses):
    for call in (
        lambda: ac.check(planned, robot, robot.limits, orientation_deviation=0.1),
        lambda: ac.check(
            planned, robot, robot.limits, ac.Path.polyline(POINTS), orientation_deviation=0.1
        ),
        lambda: ac.check(mac, arm, arm.limits, rounded, orientation_deviation=0.1),
    ):
        refuses(call, ac.InvalidInput, "needs a path with a tool orientation")
    refuses(
        lambda: ac.check(planned, robot, robot.limits, planned.path, orientation_deviation=0.0),
        ac.InvalidInput,
        "orientation_deviation",
        "above zero",
    )
