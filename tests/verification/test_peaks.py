"""The largest errors are those of the motion between samples."""

from dataclasses import replace
from functools import cache
from itertools import product

import numpy as np
import pytest
from hypothesis import Phase, example, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import armcontour as ac
from armcontour.jobs.methods import COMPENSATIONS

# Errors are compared with those of so many times as many samples.
FINER = 50
# Largest relative difference between both; a sampled kink is smaller.
AGREE = 1e-6
CORNERS = ((0.350, 0.100), (0.410, 0.150), (0.280, 0.300), (0.350, 0.350))


@cache
def plan(arm_name, speed, tolerance, space):
    """An objective path, the path with rounded corners and a plan."""
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


def executions(trajectory, plant, cycle, method, resolution):
    """The same run with its results, and with results FINER times as often.

    Pole placement requires a servo of order "second", so for order "first" it is the inverse.
    """
    servo = plant.servo.replace(dead_time=0.0)
    if servo.order == "first" and method == "pole_placement":
        method = "inverse"
    set_points = ac.compensate(trajectory, servo, COMPENSATIONS[method](), cycle=cycle)
    return (ac.simulate(set_points, plant, resolution=resolution / k) for k in (1, FINER))


def figures(evaluation):
    """The largest errors of a run [m]."""
    e = (
        evaluation.contour_error,
        evaluation.objective_error,
        evaluation.coverage_error,
        evaluation.objective_coverage_error,
    )
    return [x.max for x in e]


def largest(executed, path, end_time=np.inf):
    """The largest distance of samples from a path that does not come near itself [m]."""
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


@example(
    speed=0.05, tolerance=2e-4, cycle=4e-3, resolution=2e-3, kp=37.354, kv=898.125,
    dead_time=4e-3, interpolation="cubic", order="second", method="inverse", saturates=False,
)  # fmt: skip
@example(
    speed=0.05, tolerance=0.0, cycle=1e-3, resolution=2e-3, kp=37.8073, kv=278.392,
    dead_time=4e-3, interpolation="linear", order="second", method="inverse", saturates=True,
)  # fmt: skip
@example(
    speed=0.15, tolerance=0.0, cycle=8e-3, resolution=2e-3, kp=27.4467, kv=791.382,
    dead_time=4e-3, interpolation="cubic", order="first", method="pole_placement", saturates=False,
)  # fmt: skip
# tests/slow has more examples.
@settings(max_examples=2, phases=[Phase.explicit, Phase.generate])
@given(**RUNS)
def test_the_reported_maximum_is_not_exceeded_between_samples(
    speed, tolerance, cycle, resolution, kp, kv, dead_time, interpolation, order, method, saturates
):
    arm, objective, path, trajectory = plan("pmk3s", speed, tolerance, False)
    second = order == "second"
    servo = ac.ServoModel(
        kp=[kp, 0.9 * kp],
        kv=kv if second else None,
        dead_time=dead_time,
        interpolation=interpolation,
        order=order,
    )
    high = arm.limits.replace(joint_acceleration=20.0)
    plant = ac.ServoPlant(arm, servo, high, saturation=None if saturates and second else "none")
    coarse, fine = executions(trajectory, plant, cycle, method, resolution)
    evaluation, finer = (ac.evaluate(x, path, objective=objective) for x in (coarse, fine))
    for error, reference_path in (
        (evaluation.contour_error, path),
        (evaluation.objective_error, objective),
    ):
        assert largest(fine, reference_path, evaluation.end_time) <= error.max * (1 + AGREE) + 1e-12
    np.testing.assert_allclose(figures(evaluation), figures(finer), rtol=AGREE, atol=1e-11)
    roundings = ([y.rounding for y in x.corners] for x in (evaluation, finer))
    np.testing.assert_allclose(*roundings, rtol=AGREE, atol=5e-9)


def test_the_orientation_error_of_a_tool_in_space_is_exact():
    arm, objective, path, trajectory = plan("ur5e", 0.2, 2e-3, True)
    plant = ac.ServoPlant(arm, ac.ServoModel(kp=30.0, kv=200.0, dead_time=0.0031))
    coarse, fine = executions(trajectory, plant, 8e-3, "none", 2e-3)
    evaluation, finer = (ac.evaluate(x, path, objective=objective) for x in (coarse, fine))
    assert evaluation.orientation_error.max == pytest.approx(finer.orientation_error.max, rel=AGREE)
    np.testing.assert_allclose(figures(evaluation), figures(finer), rtol=AGREE)


def test_motions_between_samples_agree_with_a_finer_simulation():
    arm, _, _, trajectory = plan("pmk3s", 0.15, 5e-3, False)
    for interpolation, order, saturates, dead_time in (
        ("linear", "second", True, 0.0037),
        ("step", "second", False, 0.013),
        ("step", "first", False, 0.0037),
        ("cubic", "second", False, 0.0),
    ):
        kv = [150.0, 900.0] if order == "second" else None
        servo = ac.ServoModel(
            kp=[25.0, 20.0], kv=kv, order=order, interpolation=interpolation, dead_time=dead_time
        )
        limits = arm.limits.replace(joint_acceleration=0.7)
        saturation = None if saturates else "none"
        plant = ac.ServoPlant(arm, servo, limits, saturation=saturation)
        coarse, fine = executions(trajectory, plant, 4e-3, "none", 1e-3)
        for i in (0, 1, 7, len(coarse.t) // 2, len(coarse.t) - 2):
            rows = np.searchsorted(fine.t, coarse.t[i] - 1e-9) + np.arange(FINER + 1)
            motion = plant.motion_between(coarse, np.array([i]))
            interpolated = motion(np.clip(fine.t[rows], motion.t[0], motion.t[-1]))
            np.testing.assert_allclose(interpolated, fine.q[rows], rtol=0, atol=1e-11)


def short_contours(length, resolution):
    """A program of two short contours, and its execution."""
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
    set_points = ac.compensate(trajectory, servo, ac.Inverse(), cycle=8e-3)
    return program, ac.simulate(set_points, ac.ServoPlant(arm, servo), resolution=resolution)


def test_contours_with_few_samples_have_the_errors_of_these_samples():
    for length, resolution in product((1e-2, 1e-4, 3e-6, 1e-7), (1e-3, 8e-3)):
        program, executed = short_contours(length, resolution)
        plain = replace(executed, plant=None)
        with_motion, sampled = (
            ac.evaluate(x, program, objective=program) for x in (executed, plain)
        )
        assert with_motion.contour_error.max >= sampled.contour_error.max, (length, resolution)
        # Samples outside the contours determine which points at their ends are missed.
        # Without a plant, the tool path between samples is assumed straight.
        share = with_motion.coverage_error.max / sampled.coverage_error.max
        assert 1 - 1e-6 <= share <= 1 + 1e-3, (length, resolution)
