"""Shaped paths of arms in space: whole jobs with few iterations, and what cannot be shaped."""

import numpy as np
import pytest

import armcontour as ac
from armcontour.core.frames import angle_between
from armcontour.planning import shape

TOLERANCE = 1e-3  # m
# The third iteration gains the first half percent, the fifth much more.
ITERATIONS = 5
POINTS = [(0.45, 0.08, 0.20), (0.51, 0.08, 0.20), (0.51, 0.13, 0.22)]
DOWN = np.diag([1.0, -1.0, -1.0])
TILTED = np.array([[1.0, 0.0, 0.0], [0.0, -0.98, 0.2], [0.0, -0.2, -0.98]])
TILTED[:, 1:] /= np.hypot(0.98, 0.2)


@pytest.fixture(scope="module")
def ur5e():
    return ac.load_arm("ur5e")


def shaped(path, arm, limits=None, **options):
    options = {"tolerance": TOLERANCE, "iterations": ITERATIONS} | options
    return shape(path, arm, limits, ac.Shaped(**options))


def check_outcome(path):
    outcome = path.outcome
    starts = [x for name, x in outcome.durations.items() if name != "shaped"]
    assert outcome.durations["shaped"] <= min(starts)
    assert (np.diff(outcome.history) <= 0).all()


@pytest.mark.parametrize("name", ["ur5e", "panda"])
def test_a_corner_is_faster_and_the_tool_keeps_its_orientation(name):
    arm = ac.load_arm(name)
    objective = ac.Path.polyline(POINTS).oriented(DOWN)
    # Torques take most of the time; one arm is enough for them.
    limits = arm.limits if name == "ur5e" else arm.limits.replace(joint_torque=np.inf)
    seed = ac.trace(objective, arm)(0.0)
    outcome = shaped(objective, arm, limits, seed=seed)
    check_outcome(outcome)
    assert outcome.outcome.gain > 0.005 and outcome.outcome.note is None
    planned = ac.plan(outcome, arm, limits, ac.Optimal(seed=seed))
    assert planned.duration == pytest.approx(outcome.outcome.durations["shaped"], rel=1e-9)
    points, rotations = arm.pose(planned(np.linspace(0, planned.duration, 200)))
    np.testing.assert_allclose(rotations, np.broadcast_to(DOWN, rotations.shape), atol=1e-6)
    assert objective.project(points).distance.max() <= TOLERANCE


def test_a_turning_tool_stays_within_the_angular_tolerance(ur5e):
    objective = ac.Path.polyline(POINTS).oriented([DOWN, TILTED, DOWN])
    limits = ur5e.limits.replace(angular_speed=1.0, angular_acceleration=8.0, joint_torque=np.inf)
    seed = ac.trace(objective, ur5e)(0.0)
    outcome = shaped(objective, ur5e, limits, angular_tolerance=0.02, seed=seed)
    check_outcome(outcome)
    assert outcome.outcome.note is None
    s = np.linspace(0, outcome.length, 301)
    place = np.interp(s, outcome.places[:, 1], outcome.places[:, 0])
    axes = outcome.orientation(s)[:, :, 2], objective.orientation(place)[:, :, 2]
    assert angle_between(*axes).max() <= 0.02
    report = ac.check(ac.plan(outcome, ur5e, limits, ac.Optimal(seed=seed)), ur5e, limits, outcome)
    assert report.verdict == "kept"


def test_paths_that_cannot_be_shaped_keep_the_fastest_start(ur5e):
    following = ac.Path.polyline(POINTS).following_tangent((0.0, 0.0, 1.0))
    exact = {"tolerance": 0.0}
    for objective, options, start in (
        (following, {"angular_tolerance": 0.05}, None),
        (ac.Path.polyline(POINTS).oriented(DOWN), exact, "stops"),
    ):
        outcome = shaped(objective, ur5e, **options)
        check_outcome(outcome)
        assert outcome.outcome.note.startswith("not shaped")
        # All starts take the same time here, but for rounding.
        times = outcome.outcome.durations
        assert start is None or times[start] == pytest.approx(min(times.values()), rel=1e-12)
