"""Certificates on rigid bodies: what they say holds on robots that the search has not seen."""

import json
import re
from dataclasses import replace
from functools import partial

import pytest

import armcontour as ac
from armcontour.core.render import number
from armcontour.files import certificate_json, parse_job
from armcontour.program import Contour, Rapid
from armcontour.report import render_report
from armcontour.simulation.robustness.rigid_body_runs import BodyRuns, spread_on_bodies
from armcontour.simulation.robustness.uncertainty import Unknowns

JOB = """
name: corner
arm: pmk3s
configuration: positive
path: {points: [[0.30, 0.20], [0.32, 0.20], [0.32, 0.21]]}
limits: {speed: 0.15 m/s, joint_acceleration: 2, joint_torque: 40}
corners: {tolerance: 1 mm}
servo: {kp: 25 1/s, kv: 150 1/s, dead_time: 2 ms}
certificate:
  plant: rigid_body
  servo_error: 0.3 mm
  samples: 500
  bodies: 3
  corners: 4
  box: {gains: 5 %, payload: [0 kg, 0.5 kg], viscous: 0.05 N m s/rad, coulomb: 0.01 N m}
# Drives with a long cycle, of which a run takes a moment.
experiment: {step: 1 ms}
runs:
  only: {compensation: {method: inverse_dynamics}}
"""


@pytest.fixture(scope="module")
def certified():
    return ac.certify(parse_job(JOB))


def runs_of(certified):
    job = certified.job
    return BodyRuns(
        set_points=certified.set_points,
        path=certified.path.path,
        unknowns=Unknowns.from_uncertainty(certified.goal.box, job.arm, job.plant_servo),
        limits=certified.run.limits.for_joints(2),
        options={"step": 1e-3},
    )


def test_robots_that_the_search_has_not_seen_keep_the_budget(certified):
    job, budget = certified.job, 0.3e-3
    runs = runs_of(certified)
    sampled = spread_on_bodies(runs, runs.unknowns.draw(4, 99))
    assert sampled.within(budget) == 1.0 and not sampled.saturated.any()
    # The nominal robot of the certificate is the same, looked at twice as often.
    assert sampled.nominal_max == pytest.approx(certified.evaluation.contour_error.max, rel=0.02)
    # And the plan had to pay for the box.
    assert certified.uncertified.box > budget and certified.cost > 0
    assert not ac.check(certified.trajectory, job.arm, certified.run.limits, points=9).violated


def test_corners_and_drawn_robots_are_stated(certified):
    corners = certified.worst.corners
    assert corners.max.max() <= 0.3e-3
    assert len(corners) == 4 and len(certified.worst.spread) == 3
    assert certified.budget.executed == pytest.approx(
        max(corners.max.max(), certified.worst.spread.max.max()), rel=1e-9
    )
    data = json.loads(certificate_json(certified))["certificate"]["contours"][0]
    assert data["corners"]["max"] == corners.max.max()
    # Who reads the certificate sees the worst robots.
    page = render_report(certified.study, certificate=certified)
    for x in (corners.max.max(), certified.worst.spread.max.max()):
        assert number(x, "m") in page


def test_the_executed_corners_are_the_worst_of_the_box(certified):
    """Four of 128 corners are executed: others are within the budget, too."""
    runs = runs_of(certified)
    others = spread_on_bodies(runs, runs.unknowns.corners()[::5], processes=1)
    assert others.within(0.3e-3) == 1.0
    assert others.quantile(0.5) < 0.9 * certified.worst.corners.max.min()


def test_a_nominal_robot_alone():
    job = parse_job(JOB)
    certificate = ac.certify(job, goal=replace(job.certificate, box=None, servo_error=0.1e-3))
    assert certificate.worst.corners is None and certificate.worst.spread is None
    assert certificate.evaluation.contour_error.max <= 0.1e-3


def test_what_the_budget_cannot_hold_is_refused_with_its_parts():
    job = parse_job(JOB)
    with pytest.raises(ac.NotRealizable) as raised:
        ac.certify(job, goal=replace(job.certificate, servo_error=0.02e-3, slowest=1.2))
    # The largest part first, which more knowledge of the robot would reduce.
    parts = re.search(r"Its parts are (\w+) ([0-9.]+) mm, (\w+) ([0-9.]+) mm", str(raised.value))
    assert {parts[1], parts[3]} <= {"payload", "friction", "kp", "kv", "sampling"}
    assert float(parts[2]) >= float(parts[4]) > 0
    assert raised.value.needed > raised.value.allowed == 0.02e-3


# Bodies overshoot the assigned velocity after the corner.
OVERSHOOT = """
name: overshoot
arm: pmk3s
configuration: positive
path: {points: [[0.30, 0.20], [0.34, 0.20], [0.34, 0.24]]}
limits: {speed: 0.05 m/s, joint_acceleration: 2}
corners: {tolerance: 0.25 mm}
servo: {kp: 25 1/s, kv: 150 1/s}
certificate: {servo_error: 0.5 mm, plant: rigid_body}
runs:
  only: {compensation: {method: inverse_dynamics}}
"""
# An arm in space whose controller does not hold it against gravity.
SAGGING = """
name: sagging
arm: ur5e
path: {orientation: {axis: [0, 0, -1]}, points: [[0.45, 0, 0.2], [0.5, 0, 0.2]]}
limits: {speed: 0.05 m/s, joint_acceleration: 6.4}
servo: {kp: 25 1/s, kv: 150 1/s}
certificate: {servo_error: 0.5 mm, plant: rigid_body}
experiment: {gravity_feedforward: false}
runs:
  only: {compensation: {method: pole_placement}}
"""
EARLY = "process: {events: [{name: gas, at: 0 mm, lead_time: 0.1 s}]}\n"
CASCADE = JOB.replace("kv: 150 1/s", "kv: 150 1/s, ki: 5 1/s")
FIRST_ORDER = JOB.replace("kv: 150 1/s", "order: first").replace("inverse_dynamics", "inverse")


def test_what_refuses_a_job_is_found_before_the_search(monkeypatch, refuses):
    name = "armcontour.studies.certification.certification.search_plan"
    monkeypatch.setattr(name, lambda case: pytest.fail("the search has begun"))
    job = parse_job(JOB)
    there = ac.Path.polyline([(0.32, 0.22), (0.30, 0.22)])
    two = ac.Program(moves=(Contour(path=job.path), Rapid(), Contour(path=there)))
    named = ac.Program(moves=(ac.Event(name="gas"), ac.Dwell(duration=0.1), two.moves[0]))
    for call, words in (
        (partial(replace, job.certificate, saturation="report"), "saturation"),
        (partial(replace, job.certificate, plant="servo"), "plant: rigid_body"),
        (partial(ac.certify, parse_job(FIRST_ORDER)), "order second"),
        (partial(ac.certify, parse_job(CASCADE)), "A box of rigid bodies requires"),
        (partial(ac.certify, replace(job, path=two)), "one contour"),
        (partial(ac.certify, replace(job, path=named)), "1 contour, 1 dwell, 1 event"),
        (partial(ac.certify, parse_job(OVERSHOOT + EARLY)), "event gas would be switched 0.1 s"),
    ):
        refuses(call, ac.InvalidInput, words)
    with pytest.raises(ac.NotRealizable, match="At rest, the tool must be within") as raised:
        ac.certify(parse_job(SAGGING))
    assert raised.value.needed > raised.value.allowed == 0.5e-3


@pytest.fixture(scope="module")
def overshooting():
    return ac.certify(parse_job(OVERSHOOT))


def test_a_dwell_changes_little_but_the_time(overshooting):
    # Bodies rest before the contour, at the same phase of the cycle; rounding changes
    # which plans the search tries.
    waiting = ac.certify(parse_job(OVERSHOOT + "process: {dwell: 100 ms}\n"))
    assert [x.kind for x in waiting.trajectory.spans] == ["dwell", "contour"]
    later = overshooting.trajectory.duration + 0.1
    assert waiting.trajectory.duration == pytest.approx(later, rel=1e-2)
    one, other = (x.evaluation.contour_error.max for x in (overshooting, waiting))
    assert max(one, other) <= 0.5e-3


def test_an_overshoot_at_one_place_lowers_the_speed_there_only(overshooting):
    certificate = overshooting
    (contour,) = certificate.contours
    # It holds; lowering the speed everywhere took 1.7957 s.
    assert contour.speed_ratio <= 1.001 and not certificate.check.violated
    assert certificate.duration < 1.78
    (tool,) = (x for x in contour.lowered if x.cause == "tool")
    assert tool.what == "speed" and 0.001 < tool.share < 0.1
    assert tool.s == pytest.approx(0.04, abs=5e-3) and tool.length < 0.15 * contour.path.length
    assert certificate.trajectory.s(tool.t) == pytest.approx(tool.s, abs=1e-4)
    # Far from the corner the tool has the whole assigned velocity.
    assert certificate.trajectory.speed_at([0.015, 0.065]) == pytest.approx([0.05, 0.05], rel=1e-6)
    (lowered,) = certificate.derating_clauses
    assert lowered.startswith("speed by up to ") and "mm of 79.74 mm, most at s = " in lowered
    assert number(tool.s, "m") in lowered
    data = json.loads(certificate_json(certificate))["certificate"]
    causes = {x["cause"] for x in data["contours"][0]["lowered"]}
    assert causes == {"tool"} and data["rigid_body_warning"] is None
    assert "Reduced: speed by up to " in render_report(certificate.study, certificate=certificate)


def test_a_servo_certificate_states_that_rigid_bodies_are_not_covered():
    job = OVERSHOOT.replace(", plant: rigid_body", "").replace("inverse_dynamics", "inverse")
    certificate = ac.certify(parse_job(job))
    assert certificate.rigid_body_warning.startswith("Valid for independent joint servos only: ")
    page = render_report(certificate.study, certificate=certificate)
    assert (
        f"{len(certificate.warnings)} warnings," in page
        and certificate.warnings[-1] == certificate.rigid_body_warning
    )
    assert "Valid for independent joint servos only" in page
    tried = ac.certify(parse_job(job + "experiment: {}\n"))
    e = tried.experiment.evaluation
    error = max(e.contour_error.max, e.coverage_error.max) * 1e3
    assert f"the contour error is {error:.4g} mm" in tried.rigid_body_warning
