"""Certificates on rigid bodies: what they say holds on robots that the search has not seen."""

import json
from dataclasses import replace

import pytest

import armcontour as ac
from armcontour.cli.certifying import certified_rows
from armcontour.io import certificate_json, parse_job
from armcontour.program import Contour, Rapid
from armcontour.report import render_report
from armcontour.robustness.bodies import BodyRuns, spread_on_bodies
from armcontour.robustness.unknowns import Unknowns

JOB = """
name: corner
arm: pmk3s
path: {points: [[0.30, 0.20], [0.32, 0.20], [0.32, 0.21]]}
limits: {speed: 0.15 m/s, joint_acceleration: 2, joint_torque: 40}
corners: {tolerance: 1 mm}
servo: {kp: 25 1/s, kv: 150 1/s, dead_time: 2 ms}
certificate:
  plant: rigid_body
  servo: 0.3 mm
  samples: 500
  bodies: 3
  corners: 4
  box: {gains: 5 %, payload: [0 kg, 0.5 kg], viscous: 0.05 N m s/rad, coulomb: 0.01 N m}
# Drives with a long cycle, of which a run takes a moment.
experiment: {step: 1 ms}
runs:
  only: {compensation: {method: inverse_dynamics}, timing: {intervals: 200}}
"""


@pytest.fixture(scope="module")
def certified():
    return ac.certify(parse_job(JOB))


def test_robots_that_the_search_has_not_seen_keep_the_budget(certified):
    job, budget = certified.job, 0.3e-3
    u = Unknowns.of(certified.goal.box, job.arm, job.plant_servo)
    runs = BodyRuns(
        taught=certified.taught,
        path=certified.path.path,
        unknowns=u,
        limits=certified.run.limits.for_joints(2),
        options={"step": 1e-3},
    )
    found = spread_on_bodies(runs, u.draw(4, 99))
    assert found.within(budget) == 1.0 and not found.saturated.any()
    # The nominal robot of the certificate is the same, looked at twice as often.
    assert found.nominal_max == pytest.approx(certified.evaluation.contour_error.max, rel=0.02)
    # And the plan had to pay for the box.
    assert certified.uncertified.box > budget and certified.cost > 0
    assert not ac.check(certified.trajectory, job.arm, certified.run.limits, points=9).violated


def test_both_figures_and_the_part_of_each_unknown_are_stated(certified):
    linear, corners = certified.linear, certified.corners
    assert linear.bound <= 0.3e-3 and corners.max.max() <= 0.3e-3
    # MuJoCo's worst corner is near to what the linear model says of it.
    assert corners.max.max() == pytest.approx(linear.bound, rel=0.25)
    assert linear.drawn.max() <= linear.bound and len(linear.drawn) == 500
    assert sum(linear.shares.values()) == pytest.approx(linear.bound, rel=1e-9)
    assert set(linear.shares) == {"payload", "friction", "kp", "kv", "sampling"}
    assert len(corners) == 4 and len(certified.spread) == 3
    assert certified.budget.executed == pytest.approx(
        max(corners.max.max(), certified.spread.max.max()), rel=1e-9
    )
    assert "MuJoCo" in certified.model and "nominal payload fed forward" in certified.model
    data = json.loads(certificate_json(certified))["certificate"]["contours"][0]
    assert data["linear"]["bound"] == linear.bound
    assert data["linear"]["shares"] == linear.shares
    assert data["linear"]["drawn"]["within"] == 1.0
    rows = dict(certified_rows(certified))
    assert rows["executed by MuJoCo"] == "4 corners, 3 drawn robots"
    assert "friction" in rows["of it by"] and "torque / limit, of the box" in rows
    page = render_report(certified.study, certificate=certified)
    assert "MuJoCo, worst of 4 corners" in page and "gains of position loops" in page


def test_a_nominal_robot_alone():
    job = parse_job(JOB)
    found = ac.certify(job, box=None, servo=0.1e-3)
    assert found.corners is None and found.spread is None
    assert found.evaluation.contour_error.max <= 0.1e-3
    assert found.linear.bound == pytest.approx(found.linear.nominal)


def refusal(**goal):
    with pytest.raises(ac.ArmContourError) as raised:
        ac.certify(parse_job(JOB), **goal)
    return raised.value


def test_what_the_budget_cannot_hold_is_refused_with_its_parts():
    error = refusal(servo=0.02e-3, slowest=1.2)
    assert isinstance(error, ac.NotRealizable)
    assert "the linear model of the last plan has kp " in str(error) and "friction" in str(error)
    assert error.needed > error.allowed == 0.02e-3


def test_jobs_without_rigid_bodies_are_refused():
    assert "saturation" in str(refusal(saturation="report"))
    slow = JOB.replace(", kv: 150 1/s", "").replace("inverse_dynamics", "inverse")
    with pytest.raises(ac.InvalidInput, match="order second"):
        ac.certify(parse_job(slow))


def test_a_program_of_several_contours_is_refused():
    job = parse_job(JOB)
    there = ac.Path.polyline([(0.32, 0.22), (0.30, 0.22)])
    moves = (Contour(path=job.path), Rapid(), Contour(path=there))
    program = ac.Program(moves=moves)
    with pytest.raises(ac.InvalidInput, match="one contour"):
        ac.certify(replace(job, path=program))


def test_servos_know_no_friction():
    with pytest.raises(ac.InvalidInput, match="plant: rigid_body"):
        ac.certify(parse_job(JOB), plant="servo")
