"""Certificates with corners of shape free, whose tolerance shape and servo share."""

from dataclasses import replace

import pytest

import armcontour as ac
from armcontour.core.render import number
from armcontour.files import certificate_page, parse_job
from armcontour.report import render_report

JOB = """
name: bend
arm: pmk3s
path: {points: [[0.30, 0.16], [0.34, 0.16], [0.34, 0.20]]}
limits: {speed: 0.15 m/s, joint_acceleration: 0.72 rad/s^2, centripetal_acceleration: 0.09 m/s^2}
corners: {shape: free, tolerance: 2 mm}
servo: {kp: 25 1/s, kv: 150 1/s}
runs:
  only: {compensation: {method: inverse}}
"""
TOLERANCE = 2e-3


def with_arcs(job):
    run = job.runs[0]
    return replace(job, runs=(replace(run, rounding=run.rounding.with_arcs),))


@pytest.fixture(scope="module")
def job():
    return parse_job(JOB)


@pytest.fixture(scope="module")
def certified(job):
    return ac.certify(job, goal=ac.CertificateGoal(tolerance=TOLERANCE))


def test_shape_and_servo_together_stay_within_the_tolerance(certified):
    """Judged against the objective, in both directions, by nothing of the search."""
    certificate = certified
    arm = certificate.job.arm
    limits = certificate.result.run.limits
    plant = ac.ServoPlant(arm, certificate.job.plant_servo, limits)
    executed = ac.simulate(certificate.set_points, plant, resolution=1e-4)
    result = ac.evaluate(
        executed, certificate.result.path, objective=certificate.job.path, limits=limits
    )
    assert max(result.objective_error.max, result.objective_coverage_error.max) <= TOLERANCE
    assert result.contour_error.max <= certificate.budget.servo_allowed
    assert (result.demand_ratio <= 1 + 1e-6).all()
    planned = ac.check(
        certificate.trajectory,
        arm,
        limits,
        certificate.job.path,
        deviation=TOLERANCE,
        coverage_error=TOLERANCE,
    )
    assert planned.verdict == "kept"
    # Hardly anything is left: the shape got what the servo did not need.
    shaped = certificate.result.path.path
    assert 0.98 * TOLERANCE < certificate.budget.rounding == shaped.deviation <= shaped.tolerance
    assert shaped.tolerance + certificate.budget.servo_allowed == pytest.approx(TOLERANCE)


def test_a_note_states_if_shaping_is_not_faster_than_arcs(job, certified):
    arcs = ac.certify(with_arcs(job), goal=ac.CertificateGoal(tolerance=TOLERANCE))
    assert arcs.shapes == {} and arcs.contours[0].shape == "arc"
    assert certified.duration <= arcs.duration
    shape = certified.contours[0].shape
    assert certified.result.run.rounding.shape == shape
    assert certified.shapes[shape] == certified.duration == min(certified.shapes.values())
    data = certificate_page(certified)["certificate"]
    assert data["contours"][0]["shape"] == shape
    assert data["shapes"] == certified.shapes
    row = certified.to_data()["shape"]
    shown = number(certified.shapes["arc"], "s")
    assert row.value == data["shape"] == shape and shown in row.note
    assert shown in render_report(certified.job_result, certificate=certified)
