"""Certificates of programs: every contour satisfies its goal."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

import armcontour as ac
from armcontour.core.render import number
from armcontour.files import certificate_page, parse_job
from armcontour.jobs import Uncertainty
from armcontour.program import Contour, Dwell, Event, Lead, Process, Program
from armcontour.report import render_report
from armcontour.studies.certification.derating_search import servo_with

JOB = """
name: parts
arm: pmk3s
path: {points: [[0.30, 0.10], [0.36, 0.10], [0.36, 0.14]]}
limits: {speed: 0.1 m/s, joint_acceleration: 0.72 rad/s^2, centripetal_acceleration: 0.09 m/s^2}
corners: {tolerance: 1 mm}
servo: {kp: 25 1/s, kv: 150 1/s}
runs:
  only: {compensation: {method: METHOD}}
"""
BEND = ac.Path.polyline([[0.30, 0.10], [0.33, 0.10], [0.33, 0.12]])
LINE = ac.Path.polyline([[0.36, 0.16], [0.33, 0.16]])
# Goal of the certificate of both contours [m].
GOAL = 2e-6
LEAD = 5e-3  # Length of leads [m]
MOVES = (Contour(path=BEND, name="bend"), Dwell(duration=0.011), Contour(path=LINE, name="line"))
LEADS = Process(
    lead_in=Lead(length=LEAD),
    lead_out=Lead(length=LEAD),
    events=(Event(name="tool", value=True),),
)


def job(method="inverse", moves=MOVES, process=LEADS):
    parsed = parse_job(JOB.replace("METHOD", method))
    return replace(parsed, path=Program(moves=moves), process=process)


@pytest.fixture(scope="module")
def certified():
    return ac.certify(job(), goal=ac.CertificateGoal(servo_error=GOAL))


def execute_independently(certificate, servo=None):
    """Simulate the whole program and evaluate it, without code of the search."""
    arm = certificate.job.arm
    limits = certificate.result.run.limits
    plant = ac.ServoPlant(arm, servo or certificate.job.plant_servo, limits)
    execution = ac.simulate(certificate.set_points, plant, resolution=1e-4)
    evaluation = ac.evaluate(
        execution, certificate.result.path, objective=certificate.result.objective, limits=limits
    )
    return execution, evaluation


@pytest.fixture(scope="module")
def independent(certified):
    """Execution and evaluation of the certified program, without code of the search."""
    return execute_independently(certified)


def test_every_certified_contour_satisfies_its_goal(certified, independent):
    _, evaluation = independent
    assert [x.name for x in certified.contours] == ["contour 1 (bend)", "contour 2 (line)"]
    for contour, error in zip(certified.contours, evaluation.contours, strict=True):
        assert error.max <= GOAL
        assert contour.error.max == contour.budget.executed
        assert contour.error.max == pytest.approx(error.max, rel=1e-9)
    assert certified.budget.executed == evaluation.contour_error.max


def test_every_certified_contour_is_almost_as_fast_as_without_a_goal(certified):
    for contour in certified.contours:
        assert contour.trajectory.duration == contour.duration < 1.05 * contour.optimum
    assert certified.cost < 0.1 * certified.duration


def test_no_joint_saturates_in_contours_or_rapids(independent):
    execution, evaluation = independent
    assert (execution.peak_demand <= 0.72 * (1 + 1e-6)).all()
    assert (evaluation.saturated == 0).all()


def test_the_certified_plan_satisfies_all_limits(certified):
    arm = certified.job.arm
    limits = certified.result.run.limits
    assert not ac.check(certified.trajectory, arm, limits, points=5, seed=1).violated


def test_certified_contours_have_their_leads_and_events(certified):
    assert [x.name for x in certified.trajectory.events] == ["tool", "tool"]
    for span, contour in zip(certified.contours, certified.result.path.contours, strict=True):
        assert contour.work[0] == pytest.approx(LEAD)
        assert span.t[0] < span.work[0] < span.work[1] < span.t[1]
        assert span.path is contour.path


def test_a_servo_that_lags_gets_a_pause_before_the_next_contour():
    """Without compensation the tool is millimetres behind when a rapid ends."""
    slow = job("none", process=Process())
    limits = slow.runs[0].limits.replace(speed=0.01)
    slow = replace(slow, runs=(replace(slow.runs[0], limits=limits),))
    certificate = ac.certify(slow, goal=ac.CertificateGoal(servo_error=0.1e-3, slowest=4.0))
    _, result = execute_independently(certificate)
    assert max(x.max for x in result.contours) <= 0.1e-3
    assert 0.02 < certificate.pauses < 0.5
    # Without that pause the tool would still be underway.
    (pause,) = (x for x in certificate.trajectory.spans if x.kind == "dwell" and x.move is None)
    assert pause.t[1] == pytest.approx(certificate.contours[1].t[0])
    arm = certificate.job.arm
    execution = ac.simulate(
        certificate.set_points, ac.ServoPlant(arm, certificate.job.servo, limits)
    )
    index = np.searchsorted(execution.t, pause.t[0])
    assert np.linalg.norm(execution.tool[index] - certificate.contours[1].path(0.0)) > 0.1e-3


def test_every_robot_of_the_box_satisfies_the_goal_on_every_contour():
    box = Uncertainty(gains=0.05)
    certificate = ac.certify(job(), goal=ac.CertificateGoal(servo_error=0.5e-3, box=box))
    servo = certificate.job.plant_servo.for_joints(2)
    for k, x in enumerate(certificate.contours):
        worst = float(x.robots.max.max())
        assert worst <= x.budget.executed == x.robots.largest <= 0.5e-3
        # The plant executes the worst robot. The box has no deviations of the dead time.
        gain_deviations = x.robots.deviations[int(x.robots.max.argmax())]
        dead_time_deviations = [0.0, 0.0]
        deviations = np.append(gain_deviations, dead_time_deviations)
        _, result = execute_independently(certificate, servo_with(servo, deviations))
        assert result.contours[k].max == pytest.approx(worst, rel=2e-3)


def test_a_refusal_names_the_contour(refuses):
    call = partial(ac.certify, job(), goal=ac.CertificateGoal(servo_error=1e-10, slowest=1.05))
    data = {"limit": "contour error", "allowed": 1e-10}
    refuses(call, ac.NotRealizable, "contour 1 (bend)", "largest contour error", **data)


def test_the_written_certificate_contains_every_contour(certified):
    data = certificate_page(certified)["certificate"]
    assert [x["name"] for x in data["contours"]] == ["contour 1 (bend)", "contour 2 (line)"]
    assert data["contours"][1]["budget"]["executed"] == certified.contours[1].budget.executed
    page = render_report(certified.job_result, certificate=certified)
    assert all(number(x.duration, "s") in page for x in certified.contours)


def test_off_drawing_bounds_the_distance_from_the_drawing(certified, independent):
    """Of all contours, the one with the largest sum of rounding and servo error counts."""
    _, evaluation = independent
    row = certified.to_data()["off_drawing"]
    budgets = [x.budget for x in certified.contours]
    coverage = ac.evaluate(
        certified.result.execution, certified.result.path, objective=certified.result.objective
    )
    largest = max(evaluation.objective_error.max, coverage.objective_coverage_error.max)
    assert 0.99 * row.value < largest <= row.value == max(x.total for x in budgets)
    assert row.value == pytest.approx(max(x.rounding for x in budgets) + budgets[0].executed)


def test_the_written_certificate_states_verdict_and_off_drawing_in_metres(certified):
    data = certified.to_data()
    row = data["off_drawing"]
    assert data["kept"].value is certified.kept is True
    page = certificate_page(certified)
    assert page["certificate"]["off_drawing"] == row.value >= page["runs"]["only"]["off_drawing"]
    assert page["units"]["budget.left"] == page["units"]["off_drawing"] == "m"


def test_a_certificate_names_the_limit_that_determines_the_duration(certified):
    data = certified.to_data()
    run = certified.result
    assert sum(x.time for x in run.explanation.shares) == pytest.approx(certified.duration)
    assert data["time_limit"].value == run.explanation.longest[0]
    assert run.to_data()["off_drawing"].value <= data["off_drawing"].value
    page = render_report(certified.job_result, certificate=certified)
    front = page[: page.index("Warnings and notes")]
    assert all(x in front for x in ("Where the time goes", data["time_limit"].value))
