"""Evaluation and check of paths that run over themselves: each part is judged by itself."""

import numpy as np
import pytest

import armcontour as ac
from armcontour.frames import exp

DOWN = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]])
SERVO = ac.ServoModel(kp=25.0, kv=150.0)


def run(arm, path, limits, method="none", objective=None, resolution=1e-3):
    planned = ac.plan(path, arm, limits)
    taught = ac.compensate(planned, SERVO, method=method, period=4e-3)
    executed = ac.execute(taught, ac.ServoPlant(arm, SERVO, limits), resolution=resolution)
    return planned, executed, ac.evaluate(executed, path, objective=objective, limits=limits)


@pytest.fixture(scope="module")
def tilting():
    """A line out and back, on which the tool tilts on, and its plan on a UR5e."""
    arm = ac.load_arm("ur5e")
    line = ac.Path.polyline([(0.40, -0.10, 0.30), (0.45, 0.00, 0.30), (0.40, -0.10, 0.30)])
    path = line.oriented([DOWN @ exp(angle * np.array([1.0, 0, 0])) for angle in (0.0, 0.2, 0.4)])
    limits = arm.limits.replace(speed=0.1)
    return arm, path, limits, run(arm, path, limits, "inverse")


def test_the_orientation_is_that_of_the_way_on_which_the_tool_is(tilting):
    arm, path, _, (_, executed, result) = tilting
    assert result.orientation_error.max < 1e-3
    # Not because nothing is found: half of the tilt off, half of the tilt is reported.
    wrong = path.oriented([DOWN @ exp(angle * np.array([1.0, 0, 0])) for angle in (0.0, 0.2, 0.2)])
    found = ac.evaluate(executed, wrong).orientation_error
    assert found.max == pytest.approx(0.2, abs=2e-3) and found.s_max > 0.99 * path.length


def test_a_turn_back_is_no_violation_of_the_orientation(tilting):
    arm, path, limits, (planned, _, _) = tilting
    for allowed in (1e-6, 1e-2):
        found = ac.check(planned, arm, limits, path, orientation_deviation=allowed, points=8)
        use = found["orientation_deviation"]
        assert use.verdict == "kept" and use.value < 1e-7


def test_corners_of_a_square_that_is_run_twice(arm):
    square = [(0.30, 0.15), (0.36, 0.15), (0.36, 0.21), (0.30, 0.21)]
    # The last side is an overlap of 20 mm over the seam.
    objective = ac.Path.polyline([*square, *square, square[0], (0.32, 0.15)])
    rounded = ac.round_corners(objective, tolerance=1e-3)
    limits = arm.limits.replace(speed=0.15, joint_acceleration=3.0)
    _, _, result = run(arm, rounded, limits, "pole_placement", objective)
    assert len(result.corners) == 8
    for corner in result.corners:
        assert corner.rounding == pytest.approx(1e-3, abs=5e-5)
        assert corner.overshoot < 5e-5


@pytest.mark.parametrize("method", ["none", "pole_placement"])
def test_a_tip_that_the_tool_does_not_reach_is_missed(arm, method):
    path = ac.Path.polyline([(0.30, 0.2), (0.36, 0.2), (0.30, 0.2)])
    limits = arm.limits.replace(speed=0.15, joint_acceleration=3.0)
    _, executed, result = run(arm, path, limits, method, path)
    finer = ac.execute(executed.taught, executed.plant, resolution=1e-5)
    tip = np.linalg.norm(finer.tool - [0.36, 0.2], axis=1)
    assert result.missed.max == pytest.approx(tip.min(), rel=1e-6)
    assert result.missed.s_max == pytest.approx(0.06, abs=1e-9)
    assert abs(result.missed.t_max - finer.t[tip.argmin()]) < 0.02
    # The other direction does not show it.
    assert result.contour_error.max < tip.min() / 5
    assert result.corners[0].rounding == pytest.approx(tip.min(), rel=1e-6)
