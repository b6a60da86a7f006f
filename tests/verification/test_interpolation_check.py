"""Set-points of controllers, compared with values of an independent program."""

import dataclasses

import numpy as np
import pytest

import armcontour as ac
from armcontour.files.exports import make_table
from armcontour.verification import check_interpolation

ARM = ac.load_arm("ur5e")
CORNERS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 0]])
SQUARE = ac.Path.polyline(np.array([0.45, 0.08, 0.2]) + 0.1 * CORNERS).pointing((0, 0, -1))
SERVO = ac.ServoModel(kp=25.0, kv=150.0)

# Largest deviation of the tool [um] and peak acceleration over the limit by the period [ms]: lines,
# clamped spline, cubics, quintics. From exported files, by another program with the law of
# joint_trajectory_controller 6.9.0, with its own kinematics.
PERIODS = {
    2: ("2.1", "0.5 1.23", "0.30 1.39", "0.24 1.25"),
    4: ("8.4", "1.9 1.27", "0.96 1.53", "0.57 1.20"),
    8: ("34", "8.3 1.29", "4.2 1.41", "2.7 1.19"),
    20: ("210", "60 1.19", "33 1.30", "18 1.19"),
    50: ("1306", "386 1.30", "145 1.25", "177 1.43"),
}
FORMS = ((0, "jtc"), (0, "jtc_spline"), (1, "jtc"), (2, "jtc"))
# Second differences of the commands over the limit at 100, 250, 500 and 1000 Hz for points every 4
# ms, by the derivatives of the points.
SECOND_DIFFERENCES = {
    ("none", 0): "1.04 1.00 2.0 4.0",
    ("none", 1): "1.00 1.00 1.09 1.18",
    ("none", 2): "1.00 1.00 1.06 1.10",
    ("inverse", 0): "6.0 27.2 54.4 109",
    ("inverse", 1): "6.0 27.2 37.3 43.7",
    ("inverse", 2): "6.0 27.2 37.3 43.7",
}


def agrees(value, printed, rel=0.01):
    """Equal to 1 %, or to the printed digits."""
    half = 0.5 * 10.0 ** -len(printed.partition(".")[2])
    return value == pytest.approx(float(printed), rel=rel, abs=half)


@pytest.fixture(scope="module")
def square():
    path = ac.round_corners(SQUARE, tolerance=2.5e-4)
    limits = ARM.limits.replace(joint_acceleration=6.4, speed=0.25)
    return path, limits, ac.plan(path, ARM, limits)


@pytest.mark.filterwarnings("ignore:Limits are above")
@pytest.mark.parametrize("period", PERIODS)
def test_the_interpolation_between_set_points_is_checked(square, period):
    _, limits, plan = square
    for (derivatives, controller), printed in zip(FORMS, PERIODS[period], strict=True):
        table = make_table(plan, name="square", cycle=period * 1e-3, derivatives=derivatives)
        found = check_interpolation(table, ARM, controller, 500.0, limits, reference=plan)
        deviation, *acceleration = printed.split()
        assert agrees(found.deviation * 1e6, deviation), (derivatives, controller)
        for x in acceleration:
            assert agrees(found.acceleration, x), (derivatives, controller)


@pytest.mark.filterwarnings("ignore:Limits are above")
@pytest.mark.parametrize(("method", "derivatives"), SECOND_DIFFERENCES)
def test_accelerations_of_commands_are_second_differences(square, method, derivatives):
    _, limits, plan = square
    options = ac.NoCompensation() if method == "none" else ac.Inverse()
    free = dataclasses.replace(plan, limits=None)
    set_points = ac.compensate(free, SERVO, options, cycle=4e-3)
    table = make_table(set_points, name="square", derivatives=derivatives)
    printed = SECOND_DIFFERENCES[method, derivatives].split()
    for rate, text in zip((100.0, 250.0, 500.0, 1000.0), printed, strict=True):
        found = check_interpolation(table, ARM, "jtc", rate, limits)
        assert agrees(found["joint_acceleration"].ratio, text), rate


@pytest.mark.filterwarnings("ignore:Limits are above")
def test_set_points_of_other_controllers_are_compared_with_the_path(square):
    path, limits, plan = square
    table = make_table(plan, name="square", derivatives=0)
    lines = check_interpolation(table, ARM, "jtc", 500.0, limits, path, deviation=8e-6)
    assert lines.verdict == "violated"
    # The spline through the points is near the plan.
    assert lines.deviation == pytest.approx(8.4e-6, rel=0.01)
    assert lines["path_deviation"].verdict == "kept"
    assert lines.path_deviation.distance == lines["path_deviation"].value < lines.deviation
    at_points = check_interpolation(table, ARM, "jtc", 250.0, limits, path)
    assert at_points.verdict == "kept"
    held = check_interpolation(table, ARM, "hold", 1000.0, limits)
    assert held["joint_velocity"].ratio > 3 * lines["joint_velocity"].ratio
    # A uniform B-spline misses its points by T² / 6 times the acceleration.
    spline = check_interpolation(table, ARM, "linuxcnc", 1000.0, limits, reference=plan)
    assert spline.joint_deviation == pytest.approx(4e-3**2 / 6 * 6.4, rel=0.02)
    with pytest.raises(ac.InvalidInput, match="joints"):
        check_interpolation(table, ac.load_arm("pmk3s"), "jtc", 500.0)
