"""Calls that users guess work, or the error states the right form."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import armcontour as ac

DRAWING = Path(__file__).parents[1] / "examples" / "drawings" / "gasket.dxf"
ARM = ac.load_arm("pmk3s")
LIMITS = ARM.limits.replace(speed=0.1)
CORNER = ac.Path.polyline([(0.30, 0.20), (0.33, 0.20), (0.33, 0.23)])
ROUNDED = ac.round_corners(CORNER, 1e-3)
SERVO = ac.ServoModel(25.0, 150.0)
PLANNED = ac.plan(ROUNDED, ARM, LIMITS)


def test_paths_consist_of_lines_and_all_forms_of_arcs() -> None:
    line = ac.Path.line((0.0, 0.0), (0.3, 0.4))
    arc = ac.Path.arc((0, 0), (2, 0), via=(1, 1))
    circle = ac.Path.circle((0.1, 0.2, 0.3), 0.05)
    assert line.length == pytest.approx(0.5)
    assert arc.length == pytest.approx(np.pi)
    assert circle.length == pytest.approx(0.1 * np.pi)
    assert circle.start == pytest.approx([0.15, 0.2, 0.3])
    assert circle(circle.length / 4) == pytest.approx([0.1, 0.25, 0.3])
    with pytest.raises(ac.InvalidInput, match="radius"):
        ac.Path.circle((0.1, 0.2), -0.05)


def test_paths_are_made_from_segments_and_closed_polylines() -> None:
    lines = [ac.Line((0.0, 0.0), (0.3, 0.0)), ac.Line((0.3, 0.0), (0.3, 0.4))]
    assert ac.Path(lines).length == pytest.approx(0.7)
    assert ac.Path.polyline([x.start for x in lines] + [lines[1].end], closed=True).length == 1.2


def test_arguments_accept_texts_with_units() -> None:
    limits = ac.Limits(speed="100 mm/s", joint_velocity=["90 deg/s", 1.0])  # type: ignore
    assert limits.speed == 0.1
    assert limits.joint_velocity == pytest.approx([np.pi / 2, 1.0])
    assert ac.Limits(joint_velocity=[["-1 rad/s", "90 deg/s"]]).joint_velocity[0, 0] == -1.0  # type: ignore
    assert LIMITS.replace(speed="inf").removed >= {"speed"}
    assert ac.Optimal(reserve="5 %").reserve == 0.05  # type: ignore
    assert ac.ServoModel(25.0, 150.0, dead_time="4 ms").dead_time == 4e-3  # type: ignore
    assert ac.round_corners(CORNER, "1 mm").length == ROUNDED.length
    assert len(PLANNED.sample("0.1 s").t) == len(PLANNED.sample(0.1).t)  # type: ignore
    for wrong, words in (
        ("5", "has no unit"),
        ("1 kg", "must be a quantity in m/s"),
        ("-1 m/s", "must be above zero, but is -1 m/s"),
    ):
        with pytest.raises(ac.InvalidInput, match=words):
            ac.Limits(speed=wrong)  # type: ignore


def test_a_drawing_and_a_cell_are_a_job() -> None:
    job = ac.read_job(DRAWING, cell="ur5e")
    assert job.arm.name == "UR5e"
    assert job.program.length == ac.read_path(DRAWING).length


def test_a_two_link_arm_has_its_first_joint_at_the_origin() -> None:
    arm = ac.PlanarTwoLink(name="own", links=(0.3, 0.2), limits=LIMITS)
    assert arm.forward([0.0, 0.0])[:2, 3] == pytest.approx([0.0, 0.5])


def test_a_trajectory_can_be_sampled_and_explained() -> None:
    sampled = PLANNED.sample(4e-3)
    for name in ("t", "q", "dq", "ddq"):
        assert np.array_equal(getattr(PLANNED, name), getattr(sampled, name))
    assert PLANNED.explain().kinds == ac.explain(PLANNED, ARM, LIMITS).kinds


def test_functions_use_the_arm_of_the_motion_by_default() -> None:
    joints = ac.JointPath.spline([[0.0, 0.0], [0.3, 0.2], [0.5, 0.1]])
    bare = ac.plan(joints, limits=ac.Limits(joint_velocity=1.0, joint_acceleration=3.0))
    assert ac.check(PLANNED).verdict == ac.check(PLANNED, ARM).verdict
    assert ac.check_clearance(PLANNED).satisfied
    for use in (ac.check, ac.explain, ac.check_clearance):
        with pytest.raises(ac.InvalidInput, match="no arm"):
            use(bare)


def test_servos_execute_set_points_of_a_planned_arm() -> None:
    set_points = ac.compensate(PLANNED, SERVO)
    plant = ac.ServoPlant(ARM, SERVO)
    assert np.array_equal(ac.simulate(set_points, SERVO).q, ac.simulate(set_points, plant).q)


def test_an_export_format_can_be_named(tmp_path: Path) -> None:
    set_points = ac.compensate(PLANNED, SERVO)
    ac.export(set_points, tmp_path / "named.txt", "csv")
    ac.export(set_points, tmp_path / "ending.csv")
    assert (tmp_path / "named.txt").read_text() == (tmp_path / "ending.csv").read_text()


def test_the_distance_from_the_drawing_covers_both_directions() -> None:
    executed = ac.simulate(ac.compensate(PLANNED, SERVO), ac.ServoPlant(ARM, SERVO))
    evaluated = ac.evaluate(executed, ROUNDED, objective=CORNER)
    assert evaluated.objective_error and evaluated.objective_coverage_error
    both = evaluated.objective_error.max, evaluated.objective_coverage_error.max
    assert evaluated.off_drawing == max(both)
    assert both[0] < 0.8 * both[1]
    assert ac.evaluate(executed, ROUNDED).off_drawing is None


def test_a_path_is_certified_with_an_arm_a_servo_and_a_goal() -> None:
    goal = ac.CertificateGoal(tolerance=1e-3)
    run = ac.Run(name="only", limits=LIMITS, rounding=ac.Rounding(tolerance=1e-3))
    job = ac.Job(name="corner", arm=ARM, path=CORNER, servo=SERVO, runs=(run,))
    certificate = ac.certify(CORNER, ARM, SERVO, LIMITS, goal=goal)
    assert certificate.trajectory.duration == ac.certify(job, goal=goal).trajectory.duration
    with pytest.raises(ac.InvalidInput, match="an arm, a servo and a goal"):
        ac.certify(CORNER, ARM, goal=goal)
    with pytest.raises(ac.InvalidInput, match="Remove these arguments"):
        ac.certify(job, ARM, goal=goal)


@pytest.mark.parametrize(
    ("call", "form"),
    [
        (lambda: ac.plan(ROUNDED, ARM, speed=0.1), "limits=Limits(speed=...)"),
        (lambda: ac.plan(ROUNDED, ARM, reserve=0.1), "options=Optimal(reserve=...)"),
        (lambda: ac.compensate(PLANNED, kp=25.0), "servo=ServoModel(kp=...)"),
        (lambda: ac.plan(ROUNDED, ARM, method="paper"), "options=Optimal()"),
        (lambda: ac.compensate(PLANNED, SERVO, method="inverse"), "options=Inverse()"),
        (lambda: ac.ServoModel(25.0, 150.0, delay=0.004), "did you mean dead_time?"),
        (lambda: ac.PlanarTwoLink(0.3, 0.2), "PlanarTwoLink(name=..., links=..., limits=...)"),
        (
            lambda: ac.certify(CORNER, ARM, SERVO, tolerance=1e-3),
            "goal=CertificateGoal(tolerance=...)",
        ),
    ],
)
def test_wrong_arguments_are_refused_with_the_accepted_form(call: object, form: str) -> None:
    with pytest.raises(ac.InvalidInput, match=re.escape(form)):
        call()  # type: ignore[operator]
