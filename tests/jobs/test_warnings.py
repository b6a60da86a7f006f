"""Warnings of runs."""

import dataclasses

import numpy as np
import pytest
from tests.geometry.tables import arc, line, path_of
from tests.jobs.making import ARM, a_job, a_run

import armcontour as ac
from armcontour.jobs import Experiment, Rounding, run
from armcontour.program import Contour, Program

LINES = [(0.3, 0.1), (0.36, 0.1), (0.36, 0.14)]
LIMITS = ARM.limits.replace(speed=0.1, centripetal_acceleration=0.09)


def job(path, *, arm=ARM, process=None, **values):
    run_defaults = {"rounding": Rounding(tolerance=0.25e-3), "timing": ac.Optimal(reserve=0.1)}
    run_options = {"limits": LIMITS, **run_defaults, **values}
    return a_job(path, a_run(**run_options), arm=arm, process=process)


def drawn(speed=0.1, tolerance=0.25e-3, lift=0.0):
    """Two lines with a speed and a tolerance of their own."""
    points = np.array(LINES) + [0.0, lift]
    return ac.Path.polyline(
        points, segment_limits=ac.SegmentLimits(speed=speed, tolerance=tolerance)
    )


def warnings_of(job_case):
    return run(job_case, simulate=False).runs["one"].warnings


def only(job_case):
    return ac.run(job_case).runs["one"]


def test_a_segment_speed_or_tolerance_above_that_of_the_run_is_reported_once():
    values = (0.15, 0.5e-3), (0.05, 0.1e-3, 0.05), (0.12, 0.5e-3, 0.1)
    names = "MARK 1", "CUT 1", "MARK 2"
    moves = (Contour(path=drawn(*x), name=y) for x, y in zip(values, names, strict=True))
    speed, tolerance = warnings_of(job(Program(moves=tuple(moves))))
    capped = "of contour 1 (MARK 1), contour 3 (MARK 2) is reduced to "
    assert f"speed of up to 150 mm/s {capped}100 mm/s by limits.speed. " in speed
    assert f"tolerance of up to 0.5 mm {capped}0.25 mm by corners.tolerance. " in tolerance
    (speed,) = warnings_of(job(drawn(0.15, 0.1e-3)))
    assert "of contour 1 is reduced" in speed


def test_segment_limits_without_effect_cause_no_warning():
    assert warnings_of(job(drawn(0.1))) == warnings_of(job(drawn(0.02))) == ()
    # No corner tolerance is capped where there is no corner.
    single = ac.Path.polyline(
        [(0.3, 0.2), (0.34, 0.2)], segment_limits=ac.SegmentLimits(tolerance=0.5e-3)
    )
    assert warnings_of(job(single)) == ()
    half = arc((0.3, 0.2), (0.3, 0.21), np.pi, segment_limits=ac.SegmentLimits(tolerance=0.5e-3))
    assert warnings_of(job(path_of(half))) == ()
    # A corner has the smaller tolerance of its two segments.
    first = line((0.3, 0.2), (0.34, 0.2), tolerance=0.5e-3)
    assert warnings_of(job(path_of(first, line((0.34, 0.2), (0.34, 0.24), tolerance=1e-4)))) == ()


def test_a_warning_states_the_cause_of_a_demand_far_above_the_limit():
    slow_job = job(drawn())
    assert only(slow_job).warnings == ()
    result = only(dataclasses.replace(slow_job, servo=ac.ServoModel(kp=15.0, kv=40.0)))
    ratio = result.evaluation.demand_ratio
    assert ratio.max() > 1.5
    (warning,) = result.warnings
    joint = int(ratio.argmax())
    assert f"the demand of joint {joint + 1} is " in warning
    assert f"{ratio[joint]:.3g} times its acceleration limit at " in warning
    assert f"{result.evaluation.contour_error.max * 1e3:.3g} mm." in warning


def test_a_warning_states_the_cause_of_a_truncated_transient():
    feeds = ac.ServoModel(kp=1.0, kv=150.0, velocity_feedforward=0.5)
    integrates = ac.ServoModel(kp=25.0, kv=150.0, ki=0.5, velocity_feedforward=0.5)
    for servo, cause, other in ((feeds, "feed-forward", "ki"), (integrates, "ki", "feed-forward")):
        result = only(dataclasses.replace(job(drawn()), servo=servo))
        assert result.set_points.truncated is not None
        (warning,) = (x for x in result.warnings if "truncated" in x)
        assert cause in warning and other not in warning


def test_a_specified_duration_is_met():
    plan = run(job(drawn(), timing=ac.Optimal(reserve=0.1, duration=4.0)), simulate=False).runs[
        "one"
    ]
    assert plan.trajectory.duration == pytest.approx(4.0, rel=1e-12)


def test_set_points_of_inverse_dynamics_are_judged_on_rigid_bodies():
    options = {"compensation": ac.InverseDynamics(), "limits": LIMITS.replace(joint_jerk=20.0)}
    straight = ac.Path.polyline(LINES[:2])
    bare = only(job(straight, **options))
    (warning,) = bare.warnings
    deviation = bare.evaluation.contour_error.max * 1e3
    assert (
        f"(with the servo model, the contour error is up to {deviation:.3g} mm)" in warning
        and "experiment: {}" in warning
    )
    result = only(job(straight, **options, experiment=Experiment()))
    contour_error = result.experiment.evaluation.contour_error.max * 1e3
    assert contour_error < 0.01 * deviation
    assert result.warnings == () and result.judged is result.experiment.evaluation


def test_a_warning_names_a_compensation_that_is_worse_than_none_on_bodies():
    experiment = Experiment(payload=ac.Payload(mass=0.1))
    result = only(job(ac.Path.polyline(LINES), compensation=ac.Inverse(), experiment=experiment))
    judged = result.experiment.evaluation
    plain = result.experiment.uncompensated
    assert plain.contour_error.rms > judged.contour_error.rms > 0
    for evaluation, uncompensated in ((judged, judged), (judged, None), (plain, judged)):
        other = dataclasses.replace(
            result.experiment, evaluation=evaluation, uncompensated=uncompensated
        )
        anew = dataclasses.replace(result, experiment=other).warnings
        warnings = [x for x in anew if "bodies" in x]
        assert len(warnings) == (evaluation is plain)
    for value in (plain.contour_error.rms, judged.contour_error.rms):
        assert f"{value * 1e3:.3g} " in warnings[0]
    assert "method: inverse_dynamics" in warnings[0] and "a payload of 0.1 kg" in warnings[0]
    assert (
        only(
            job(ac.Path.polyline(LINES), compensation=ac.NoCompensation(), experiment=experiment)
        ).warnings
        == ()
    )


def test_a_corner_tolerance_larger_than_the_path_causes_a_warning():
    def doubts(tolerance):
        warnings = warnings_of(job(ac.Path.polyline(LINES), rounding=Rounding(tolerance=tolerance)))
        return [x for x in warnings if "larger than the path" in x]

    assert doubts(0.05) == []
    (doubt,) = doubts(0.5)
    assert "0.5 m" in doubt and "tolerance: 0.5 mm" in doubt
