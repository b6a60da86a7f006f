"""Checks of coverage, of the tool orientation, and of samples of a program."""

from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

import armcontour as ac
from armcontour.core.frames import exp
from armcontour.verification.error_profile import orientation_angles

ERROR = 5e-3
LIMITS = ac.Limits.only(speed=0.15, joint_acceleration=0.72)


@pytest.fixture(scope="module")
def rounded_motion(arm, objective):
    return ac.plan(ac.round_corners(objective, tolerance=ERROR), arm, LIMITS)


def test_the_coverage_error_of_a_rounded_corner_is_its_corner_error(arm, objective, rounded_motion):
    # The middles of the arcs are nearer to the lines than to the corners, so the tool alone is
    # within less than the corner error.
    check = partial(ac.check, arm=arm, limits=LIMITS, path=objective)
    checked = check(rounded_motion, deviation=4e-3, coverage_error=ERROR)
    assert checked.verdict == "kept"
    coverage_error = checked["coverage_error"]
    assert coverage_error.value == pytest.approx(ERROR, rel=1e-6)
    assert np.abs(objective.breaks[1:3] - coverage_error.s).min() < 1.1 * ERROR
    (use,) = check(rounded_motion, coverage_error=0.99 * ERROR).violations
    assert use.name == "coverage_error"
    # Its own path misses nothing.
    rounded_check = ac.check(rounded_motion, arm, LIMITS, rounded_motion.path, coverage_error=1e-6)
    assert rounded_check.verdict == "kept"
    # Samples are judged as laws are.
    checked = check(rounded_motion.sample(4e-3), coverage_error=1.001 * ERROR)
    assert (
        checked["coverage_error"].value == pytest.approx(ERROR, rel=1e-3) and not checked.violated
    )
    assert check(rounded_motion.sample(4e-3), coverage_error=0.9 * ERROR).violated


def test_the_coverage_error_of_a_missed_tip_equals_a_hand_calculation(arm):
    """Out and back along a line, but only to 3 mm before its end."""
    path = ac.Path.polyline([[0.30, 0.20], [0.36, 0.20], [0.30, 0.20]])
    x = np.concatenate([np.linspace(0.30, 0.357, 200), np.linspace(0.357, 0.30, 200)[1:]])
    q = arm.joint_position(np.stack([x, np.full_like(x, 0.20)], axis=1))
    log = SimpleNamespace(t=np.linspace(0.0, 4.0, len(x)), q=q)
    check = ac.check(log, arm, ac.Limits.only(), path, deviation=1e-6, coverage_error=2e-3)
    assert check.path_deviation is not None and check.path_deviation.distance < 1e-9
    assert check["coverage_error"].value == pytest.approx(3e-3, rel=1e-9)
    assert check.verdict == "violated"


def test_the_coverage_error_of_a_program_counts_all_contours(arm):
    corner = [[0.30, 0.20], [0.36, 0.20], [0.36, 0.26]]
    other = [[0.30, 0.26], [0.33, 0.26], [0.33, 0.29]]
    moves = [ac.Contour(path=ac.Path.polyline(x)) for x in (corner, other)]
    objective = ac.Program(moves=(moves[0], ac.Rapid(), moves[1]))
    motion = ac.plan(ac.round_corners(objective, tolerance=1e-3), arm, LIMITS)
    check = ac.check(motion, arm, LIMITS, objective, coverage_error=1e-3)
    assert check.verdict == "kept"
    assert check["coverage_error"].value == pytest.approx(1e-3, rel=1e-6)


LINE = ac.Path.polyline([(0.4, -0.1, 0.3), (0.45, 0.1, 0.3)])
DOWN = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]])
HELD = LINE.oriented(DOWN)
ROBOT = ac.load_arm("ur5e")
# Few random times per interval of a law suffice, because angles are equal at all of them.
check = partial(ac.check, arm=ROBOT, limits=ROBOT.limits, points=4)


@pytest.fixture(scope="module")
def planned():
    return ac.plan(HELD, ROBOT, ROBOT.limits)


def sampled(planned, *columns):
    x = planned.sample(4e-3)
    return SimpleNamespace(t=x.t, q=x.q, **{name: getattr(x, name) for name in columns})


def turned(angle):
    return LINE.oriented(DOWN @ exp(angle * np.array([0.0, 0.0, 1.0])))


def test_a_wrong_tool_orientation_is_found(planned):
    allowed = {"deviation": 1e-4, "orientation_deviation": np.radians(0.5)}
    columns = (("dq", "ddq"), ("dq",), ())
    for motion in (planned, *(sampled(planned, *x) for x in columns)):
        held_check = check(motion, path=HELD, **allowed)
        use = held_check["orientation_deviation"]
        assert use.value < 1e-4 and not use.ratio > 1
        assert "orientation_deviation" not in held_check.not_judged
        for angle in (np.pi, 0.02):
            turned_check = check(motion, path=turned(angle), **allowed)
            use = turned_check["orientation_deviation"]
            assert use in turned_check.violations and use.joint is None and use.s is not None
            assert use.value == pytest.approx(angle, abs=1e-4)
            assert use.limit == pytest.approx(np.radians(0.5))
            assert turned_check["path_deviation"].ratio < 1


def test_only_the_specified_part_of_the_orientation_is_checked_within_rounding(planned):
    assert "orientation_deviation" in check(planned, path=HELD).not_judged
    assert "orientation_deviation" not in check(planned, path=LINE).not_judged
    for x, near, angle in ((0.0, 1e-5, 0.0), (0.1, 1e-4, np.arctan(0.1))):
        report = check(planned, path=LINE.pointing((x, 0, -1)), orientation_deviation=1e-3)
        assert report["orientation_deviation"].value == pytest.approx(angle, abs=near)
    options = {"path": turned(0.02), "orientation_deviation": 1e-3, "resolution": {"q": 0.01}}
    report = check(sampled(planned), **options)
    use = report["orientation_deviation"]
    assert use.ratio > 1 and use.slack * use.limit == pytest.approx(6 * 0.005, rel=1e-6)
    assert use not in report.violations


def test_a_path_may_have_two_orientations_at_its_crossing():
    """A tool that is a little off may be nearer to the other line; the one that fits counts."""
    cross = np.array([(0.4, -0.05, 0.3), (0.5, 0.05, 0.3), (0.5, -0.05, 0.3), (0.4, 0.05, 0.3)])

    def path(lateral):
        axes = [(0, 0, -1), (0.2, 0, -1), (0.2, 0, -1), (0.6, 0, -1)]
        sharp = ac.Path.polyline(cross + lateral).pointing(axes)
        return ac.round_corners(sharp, tolerance=2e-3, angular_tolerance=0.1)

    planned = ac.plan(path((5e-4, 5e-4, 0)), ROBOT, ROBOT.limits)
    q = planned(np.linspace(0, planned.duration, 20_001))
    nearest = path(0).project(ROBOT.tool_position(q)).s
    assert orientation_angles(path(0).orientation, nearest, ROBOT.pose(q)[1]).max() > 0.2
    report = check(planned, path=path(0), points=20, orientation_deviation=np.radians(1))
    assert report.path_deviation.distance > 4e-4
    assert report["orientation_deviation"].value < np.radians(1)


def test_an_orientation_deviation_needs_a_path_with_orientation(
    arm, mac, rounded, planned, refuses
):
    for call, words in (
        (partial(check, planned, orientation_deviation=0.1), "a path with a tool orientation"),
        (partial(check, planned, path=LINE, orientation_deviation=0.1), "a tool orientation"),
        (
            partial(ac.check, mac, arm, arm.limits, rounded, orientation_deviation=0.1),
            "tool orient",
        ),
        (partial(check, planned, path=HELD, orientation_deviation=0.0), "above zero"),
    ):
        refuses(call, ac.InvalidInput, words)
