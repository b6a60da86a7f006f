"""The distance from the drawing of runs that are smoothed for jerk limits, in all places."""

import re
from dataclasses import replace

import numpy as np
import pytest
import yaml
from tests.dynamics_extra import needs_dynamics

import armcontour as ac
from armcontour.core.render import plain
from armcontour.files import parse_job
from armcontour.jobs.advice import with_advice
from armcontour.jobs.verdict import Errors

# A line, a quarter of a circle and a line that meet without a corner: a jerk limit smooths them.
SLOT = {
    "name": "slot",
    "arm": {
        "name": "fr3",
        "tool": {"position": [0, 0, "120 mm"]},
        "work": {"position": [0.40, -0.04, 0.1]},
    },
    "path": {
        "start": [0, 0, 0],
        "segments": [
            {"to": [0.08, 0, 0]},
            {"center": [0.08, 0.02, 0], "angle": "90 deg", "normal": [0, 0, 1]},
            {"to": [0.1, 0.08, 0]},
        ],
        "orientation": {"axis": [0, 0, -1]},
    },
    "accuracy": "2 um",
    "limits": {"speed": 0.1, "joint_jerk": 4000},
    "corners": {"tolerance": "0.2 mm"},
    "servo": {"kp": 40, "kv": 200},
    # The exact inverse, whose error is small compared with that of smoothing.
    "command_limits": {"joint_acceleration": "inf"},
    "cycle": "1 ms",
    "runs": {"one": {"timing": {"reserve": 0.05}}},
}
CENTRE = np.array([0.08, 0.02, 0.0])


def job_result_of(**changes):
    return ac.run(parse_job(yaml.safe_dump({**SLOT, **changes})))


def distance_to_slot(points):
    """Distance of points from the two lines and the quarter of a circle."""
    x, y, z = np.moveaxis(points, -1, 0)
    first = np.hypot(np.maximum(x - 0.08, 0.0), np.hypot(y, z))
    last = np.hypot(np.maximum(0.02 - y, 0.0), np.hypot(x - 0.1, z))
    radius = np.hypot(x - CENTRE[0], y - CENTRE[1])
    arc = np.where((x >= 0.08) & (y <= 0.02), np.hypot(radius - 0.02, z), np.inf)
    return np.minimum(np.minimum(first, last), arc)


@pytest.fixture(scope="module")
def job_result():
    return with_advice(job_result_of())


@pytest.fixture(scope="module")
def result(job_result):
    return job_result.runs["one"]


@needs_dynamics
def test_smoothing_for_jerk_limits_is_a_part_of_the_distance_from_the_drawing(result):
    data = result.to_data()
    measured = float(distance_to_slot(result.execution.tool).max())
    assert 9e-6 < measured
    assert data["off_drawing"].value == pytest.approx(measured, abs=1e-8)
    assert data["off_drawing"].value == result.evaluation.off_drawing
    assert result.evaluation.contour_error.max < 1e-6
    # The accuracy is 2 um.
    assert result.kept is False and result.verdict.requirement == "accuracy"
    assert "smoothing 0.0098" in data["off_drawing"].note
    assert plain(data)["smoothing_error"] == result.path.path.smoothing
    # The path knows a proven bound, for errors that are known without a tool.
    (deviation,) = result.deviations
    assert measured <= deviation.total < measured * 1.01
    assert result.judge({"measured": Errors(contour=[1e-6])}).off_drawing == 1e-6 + deviation.total
    assert plain(data)["contour_error_allowed"] == 0.0


@needs_dynamics
def test_a_remedy_for_smoothing_that_exceeds_the_accuracy_works(result):
    (change, *_) = result.advice.improvements
    ((key, tolerance),) = change.edits
    assert key == "corners.tolerance" and change.kept
    repaired = job_result_of(corners={"tolerance": tolerance}).runs["one"]
    assert repaired.kept is True
    assert repaired.verdict.off_drawing == pytest.approx(change.off_drawing, rel=1e-9)


@needs_dynamics
def test_a_certificate_guarantees_the_distance_with_smoothing(job_result):
    # The tolerance is between the servo's error and that of smoothing.
    for tolerance in (4e-6, 50e-6):
        certificate = ac.certify(job_result.job, goal=ac.CertificateGoal(tolerance=tolerance))
        measured = float(distance_to_slot(certificate.result.execution.tool).max())
        budget = certificate.budget
        assert budget.smoothing > 0.5e-6
        assert measured <= budget.total <= tolerance and certificate.kept
        data = certificate.to_data()
        assert data["off_drawing"].value == budget.total
        assert certificate.result.verdict.off_drawing == pytest.approx(measured, abs=1e-8)


@needs_dynamics
def test_a_path_that_was_smoothed_before_the_job_is_its_drawing(job_result):
    from armcontour.program import smooth_curvature

    drawn = smooth_curvature(job_result.job.path, tolerance=1e-4)
    assert 5e-5 < drawn.smoothing <= 1e-4
    moved = ac.Frame([0.1, 0.0, 0.0])
    assert drawn.placed(moved, scale=2.0).smoothing == 2.0 * drawn.smoothing
    sharp = replace(job_result.job.runs[0], rounding=None)
    again = ac.run(replace(job_result.job, path=drawn, runs=(sharp,))).runs["one"]
    (deviation,) = again.deviations
    assert deviation.total == 0.0 and again.verdict.off_drawing < 1e-6


@needs_dynamics
@pytest.mark.parametrize("arm", ["fr3", "panda"])
def test_a_job_whose_arm_has_a_jerk_limit_that_is_not_kept_has_one_note(arm):
    robot = {**SLOT["arm"], "name": arm}
    job = {"arm": robot, "limits": {"speed": 0.1}, "accuracy": 1e-3}

    def notes_of(**limits):
        run = job_result_of(**{**job, "limits": {"speed": 0.1, **limits}}).runs["one"]
        return run, [x for x in run.to_data().notes if "jerk" in x]

    run, (note,) = notes_of()
    assert not [x for x in run.warnings if "jerk" in x]
    # The note is valid YAML, and removes itself.
    limits = yaml.safe_load(re.search(r"\{joint_jerk: \[.*?\]\}", note).group())
    published = ac.load_arm(arm).unused_limits.joint_jerk
    assert limits["joint_jerk"] == published.tolist()
    kept, none = notes_of(**limits)
    assert none == [] and kept.run.limits.limits_jerk
    assert notes_of(joint_jerk="inf")[1] == []


@needs_dynamics
def test_arms_without_a_published_jerk_limit_have_no_note():
    run = job_result_of(arm={**SLOT["arm"], "name": "ur5e"}, limits={"speed": 0.1}).runs["one"]
    assert ac.load_arm("ur5e").unused_limits is None
    assert not [x for x in run.to_data().notes if "jerk" in x]


@needs_dynamics
def test_the_note_counts_external_axes_which_stay_without_a_limit():
    rail = {"axis": [0, 1, 0], "lower": -1, "upper": 1, "velocity": 0.5, "acceleration": 1}
    job = {"arm": {**SLOT["arm"], "rail": rail}, "accuracy": 1e-3}
    (note,) = (x for x in job_result_of(**job, limits={}).runs["one"].remarks if "jerk" in x)
    limits = yaml.safe_load(re.search(r"\{joint_jerk: \[.*?\]\}", note).group())
    kept = job_result_of(**job, limits=limits).runs["one"]
    assert kept.run.limits.joint_jerk.tolist() == [np.inf, *7 * [5000.0]]
    assert not [x for x in kept.remarks if "jerk" in x]
