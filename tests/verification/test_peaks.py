"""The largest errors are those of the motion between samples."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import Phase, assume, example, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import armcontour as ac
from armcontour.jobs.methods import COMPENSATIONS

# The finer simulation, which is the reference, has this multiple of the samples.
FINER = 50
# Largest relative difference between errors from coarse and from fine samples. The fine samples
# miss less than this of a kink between two of them.
AGREE = 1e-6
# Largest rounding errors of contour errors, of cornering deviations and of joint positions
# [m, rad].
ERROR_ROUNDING = 1e-11
CORNER_ROUNDING = 5e-9
POSITION_ROUNDING = 1e-11
# Corners of the paper's path [m].
CORNERS = ((0.350, 0.100), (0.410, 0.150), (0.280, 0.300), (0.350, 0.350))


@cache
def plan(arm_name, speed, tolerance, space):
    """Return the arm, an objective path, the path with rounded corners, and a plan.

    - `tolerance`: corner tolerance [m]; 0 for sharp corners, at which the tool stops.
    - `space`: whether the path rises and the tool orientation changes along it.
    """
    arm = ac.load_arm(arm_name)
    points = [(*p, 0.3 + 0.02 * k) for k, p in enumerate(CORNERS)] if space else CORNERS
    objective = ac.Path.polyline(points)
    if space:
        turns = Rotation.from_euler("yx", [(3.0, 0.2 * k) for k in range(len(points))])
        objective = objective.oriented(turns)
    path = ac.round_corners(objective, tolerance=tolerance) if tolerance else objective
    limits = arm.limits.replace(speed=speed)
    return (
        arm,
        objective,
        path,
        ac.plan(path, arm, limits, ac.Optimal(configuration=None if space else "positive")),
    )


def simulate_coarse_and_fine(trajectory, plant, cycle, method, resolution):
    """Simulate a run twice: with results every `resolution` [s], and FINER times as often."""
    servo = plant.servo.replace(dead_time=0.0)
    set_points = ac.compensate(trajectory, servo, COMPENSATIONS[method](), cycle=cycle)
    coarse = ac.simulate(set_points, plant, resolution=resolution)
    fine = ac.simulate(set_points, plant, resolution=resolution / FINER)
    return coarse, fine


def largest_errors(evaluation):
    """Return the largest errors of a run [m]."""
    errors = (
        evaluation.contour_error,
        evaluation.objective_error,
        evaluation.coverage_error,
        evaluation.objective_coverage_error,
    )
    return [error.max for error in errors]


def largest_distance(executed, path, end_time):
    """Return the largest distance of samples from a path that does not come near itself [m]."""
    return path.project(executed.tool[executed.t <= end_time]).distance.max()


RUNS = dict(
    speed=st.sampled_from([0.05, 0.15, 0.5]),
    tolerance=st.sampled_from([0.0, 2e-4, 5e-3]),
    cycle=st.sampled_from([1e-3, 4e-3, 8e-3]),
    resolution=st.sampled_from([1e-3, 2e-3]),
    kp=st.floats(15.0, 40.0),
    kv=st.floats(100.0, 1000.0),
    dead_time=st.sampled_from([0.0, 4e-3, 0.0137]),
    interpolation=st.sampled_from(["linear", "cubic", "step"]),
    order=st.sampled_from(["second", "second", "first"]),
    method=st.sampled_from(["none", "inverse", "pole_placement"]),
    saturates=st.booleans(),
)


# Cubic set-points with high gains and small rounded corners.
@example(
    speed=0.05,
    tolerance=2e-4,
    cycle=4e-3,
    resolution=2e-3,
    kp=37.354,
    kv=898.125,
    dead_time=4e-3,
    interpolation="cubic",
    order="second",
    method="inverse",
    saturates=False,
)
# The tool stops at sharp corners, and the servo may saturate.
@example(
    speed=0.05,
    tolerance=0.0,
    cycle=1e-3,
    resolution=2e-3,
    kp=37.8073,
    kv=278.392,
    dead_time=4e-3,
    interpolation="linear",
    order="second",
    method="inverse",
    saturates=True,
)
# Results are four times as frequent as set-points of a servo of first order.
@example(
    speed=0.15,
    tolerance=0.0,
    cycle=8e-3,
    resolution=2e-3,
    kp=27.4467,
    kv=791.382,
    dead_time=4e-3,
    interpolation="cubic",
    order="first",
    method="inverse",
    saturates=False,
)
# tests/slow has more examples.
@settings(max_examples=2, phases=[Phase.explicit, Phase.generate])
@given(**RUNS)
def test_reported_maximum_is_not_exceeded_between_samples(
    speed, tolerance, cycle, resolution, kp, kv, dead_time, interpolation, order, method, saturates
):
    second = order == "second"
    # Pole placement requires a servo of second order.
    assume(second or method != "pole_placement")
    arm, objective, path, trajectory = plan("pmk3s", speed, tolerance, False)
    servo = ac.ServoModel(
        kp=[kp, 0.9 * kp],
        kv=kv if second else None,
        dead_time=dead_time,
        interpolation=interpolation,
        order=order,
    )
    high_limits = arm.limits.replace(joint_acceleration=20.0)
    saturation = None if saturates and second else "none"
    plant = ac.ServoPlant(arm, servo, high_limits, saturation=saturation)
    coarse, fine = simulate_coarse_and_fine(trajectory, plant, cycle, method, resolution)
    evaluation, finer = (ac.evaluate(x, path, objective=objective) for x in (coarse, fine))
    for error, reference_path in (
        (evaluation.contour_error, path),
        (evaluation.objective_error, objective),
    ):
        distance = largest_distance(fine, reference_path, evaluation.end_time)
        assert distance <= error.max * (1 + AGREE) + ERROR_ROUNDING
    np.testing.assert_allclose(
        largest_errors(evaluation), largest_errors(finer), rtol=AGREE, atol=ERROR_ROUNDING
    )
    deviations, finer_deviations = (
        [corner.rounding for corner in x.corners] for x in (evaluation, finer)
    )
    np.testing.assert_allclose(deviations, finer_deviations, rtol=AGREE, atol=CORNER_ROUNDING)


def test_orientation_error_in_space_does_not_depend_on_the_samples():
    arm, objective, path, trajectory = plan("ur5e", 0.2, 2e-3, True)
    plant = ac.ServoPlant(arm, ac.ServoModel(kp=30.0, kv=200.0, dead_time=0.0031))
    coarse, fine = simulate_coarse_and_fine(trajectory, plant, 8e-3, "none", 2e-3)
    evaluation, finer = (ac.evaluate(x, path, objective=objective) for x in (coarse, fine))
    assert evaluation.orientation_error.max == pytest.approx(finer.orientation_error.max, rel=AGREE)
    np.testing.assert_allclose(largest_errors(evaluation), largest_errors(finer), rtol=AGREE)


@pytest.mark.parametrize(
    ("interpolation", "order", "saturates", "dead_time"),
    [
        ("linear", "second", True, 0.0037),
        ("step", "second", False, 0.013),
        ("step", "first", False, 0.0037),
        ("cubic", "second", False, 0.0),
    ],
)
def test_motion_between_samples_agrees_with_a_finer_simulation(
    interpolation, order, saturates, dead_time
):
    arm, _, _, trajectory = plan("pmk3s", 0.15, 5e-3, False)
    kv = [150.0, 900.0] if order == "second" else None
    servo = ac.ServoModel(
        kp=[25.0, 20.0], kv=kv, order=order, interpolation=interpolation, dead_time=dead_time
    )
    limits = arm.limits.replace(joint_acceleration=0.7)
    plant = ac.ServoPlant(arm, servo, limits, saturation=None if saturates else "none")
    coarse, fine = simulate_coarse_and_fine(trajectory, plant, 4e-3, "none", 1e-3)
    for sample in (0, 1, 7, len(coarse.t) // 2, len(coarse.t) - 2):
        first_row = np.searchsorted(fine.t, coarse.t[sample] - 1e-9)
        rows = first_row + np.arange(FINER + 1)
        motion = plant.motion_between(coarse, np.array([sample]))
        interpolated = motion(np.clip(fine.t[rows], motion.t[0], motion.t[-1]))
        np.testing.assert_allclose(interpolated, fine.q[rows], rtol=0, atol=POSITION_ROUNDING)


@pytest.mark.parametrize("acceleration", [0.7, 100.0])
def test_steps_are_smooth_where_the_motion_between_samples_is_one_quintic(acceleration):
    arm, _, _, trajectory = plan("pmk3s", 0.15, 5e-3, False)
    servo = ac.ServoModel(kp=25.0, kv=150.0)
    limits = arm.limits.replace(joint_acceleration=acceleration)
    set_points = ac.compensate(trajectory, servo, ac.NoCompensation(), cycle=4e-3)
    executed = ac.simulate(set_points, ac.ServoPlant(arm, servo, limits), resolution=1e-3)
    smooth = executed.smooth_steps()
    assert smooth.any()
    assert smooth.all() == (not executed.saturated_time.any())
    for sample in range(0, len(smooth), 7):
        motion = executed.between(np.array([sample]))
        assert (motion.ddq is not None) == smooth[sample], sample
    assert not replace(executed, plant=None).smooth_steps().any()


def short_contours(length, resolution):
    """Return a program of two contours of a length [m], and its execution."""
    arm = ac.load_arm("pmk3s")
    contours = [
        ac.Contour(path=ac.Path.polyline([(x, 0.2), (x + length, 0.2)])) for x in (0.3, 0.33)
    ]
    moves = (contours[0], ac.Rapid(), contours[1], ac.Dwell(duration=0.1))
    program = ac.Program(moves=moves)
    trajectory = ac.plan(
        program, arm, arm.limits.replace(speed=0.15), ac.Optimal(configuration="positive")
    )
    servo = ac.ServoModel(kp=25.0, kv=150.0)
    # Without limits of the set-points, a plan at full acceleration winds up the servos.
    raw = ac.Inverse(command_limits=ac.Limits(joint_acceleration=np.inf))
    set_points = ac.compensate(trajectory, servo, raw, cycle=8e-3)
    return program, ac.simulate(set_points, ac.ServoPlant(arm, servo), resolution=resolution)


@pytest.mark.parametrize("resolution", [1e-3, 8e-3])
@pytest.mark.parametrize("length", [1e-2, 1e-4, 3e-6, 1e-7])
def test_contours_with_few_samples_have_at_least_the_errors_of_these_samples(length, resolution):
    program, executed = short_contours(length, resolution)
    # Without a plant, the tool path between samples is assumed to be straight.
    without_plant = replace(executed, plant=None)
    with_motion, sampled = (
        ac.evaluate(x, program, objective=program) for x in (executed, without_plant)
    )
    assert with_motion.contour_error.max >= sampled.contour_error.max
    # Samples outside the contours determine which points at their ends are missed.
    ratio = with_motion.coverage_error.max / sampled.coverage_error.max
    assert 1 - 1e-6 <= ratio <= 1 + 1e-3
