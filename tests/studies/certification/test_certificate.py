"""Certificates of jobs within tolerances, for the stated robot model."""

import re
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from soak.certificates import until_rest

import armcontour as ac
from armcontour.core.render import number
from armcontour.files import parse_job
from armcontour.jobs import CertificateGoal, Uncertainty
from armcontour.report import render_report
from armcontour.studies.certification import derating_search
from armcontour.studies.certification.case import Attempt, Move

OPTIMUM = 5.3262  # the paper's job with the method optimal, from tests/golden
PAPER = ("[0.350, 0.100], [0.410, 0.150], [0.280, 0.300], [0.350, 0.350]", "5 mm")
EXACT = "command_limits: {joint_acceleration: inf}"  # set-points of the exact inverse
SHORT = ("[0.350, 0.100], [0.380, 0.125], [0.350, 0.160]", "2 mm")
JOB = """
name: paper
arm: pmk3s
seed: [0, 1]
path: {{points: [{points}]}}
limits: {{speed: 0.15 m/s, joint_acceleration: 0.72 rad/s^2, centripetal_acceleration: 0.09 m/s^2}}
corners: {{tolerance: {tolerance}}}
servo: {{kp: 25 1/s, kv: 150 1/s{servo}}}
cycle: {cycle}
runs:
  certified: {{compensation: {{method: {method}}}}}
{more}
"""
LINE = """
name: line
arm: pmk3s
seed: [0, 1]
path: {points: [[0.30, 0.20], [0.40, 0.20]]}
limits: {speed: 0.15 m/s, joint_acceleration: 0.72 rad/s^2}
servo: {kp: 25 1/s, kv: 150 1/s}
runs:
  only: {compensation: {method: inverse}}
"""
LAG = """
name: lag
arm: pmk3s
seed: [0, 1]
path: {points: [[0.35, 0.2], [0.4216768, 0.1589672], [0.3311563, 0.1382437]]}
limits: {speed: 0.2914771, joint_acceleration: 5.5179714}
corners: {tolerance: 0.13197796 mm}
servo: {kp: 20.8143967, kv: 181.493, dead_time: 4 ms, interpolation: cubic}
cycle: 4 ms
certificate: {servo_error: 0.6866 mm}
runs:
  only: {compensation: {method: none}}
"""


def job(kind, cycle="4 ms", method="inverse", servo="", more=""):
    keys = {"points": kind[0], "tolerance": kind[1], "cycle": cycle, "method": method}
    return parse_job(JOB.format(**keys, servo=servo, more=more))


@pytest.fixture(scope="module")
def certified():
    more = f"certificate: {{servo_error: 2 um, rms: 0.5 um}}\nexperiment: {{}}\n{EXACT}"
    return ac.certify(job(PAPER, more=more))


def judged(certificate, loaded=False):
    """The certificate's set-points, executed and checked again by nothing of the search."""
    arm = certificate.job.arm
    limits = certificate.result.run.limits
    plant = ac.ServoPlant(arm, certificate.job.plant_servo, limits)
    executed = ac.simulate(certificate.set_points, plant, resolution=1e-4)
    result = ac.evaluate(
        executed, certificate.result.path.path, objective=certificate.job.path, limits=limits
    )
    assert not ac.check(certificate.trajectory, arm, limits, points=20, seed=1).violated
    assert result.contour_error.max <= certificate.goal.servo_error
    assert loaded or (executed.peak_demand <= 0.72 * (1 + 1e-6)).all()
    return result


def test_the_papers_job_is_certified_at_4_ms_with_the_parts_of_its_budget(certified):
    result = judged(certified)
    assert certified.duration <= 5.332
    assert certified.uncertified.duration == pytest.approx(OPTIMUM, abs=1e-4)
    assert certified.cost == certified.duration - certified.uncertified.duration > 0
    assert result.contour_error.rms <= 0.5e-6
    assert (result.saturated == 0).all() and result.speed <= 0.15 * (1 + 1e-3)
    # Nothing of that is there without a certificate.
    assert certified.uncertified.contour_error[0] > 1e-4
    budget = certified.budget
    certificate = certified
    assert budget.rounding == pytest.approx(5e-3)
    worst = max(
        certificate.result.evaluation.contour_error.max, certificate.contours[0].coverage_error.max
    )
    assert budget.executed == pytest.approx(worst, rel=1e-12)
    assert budget.left == pytest.approx(2e-6 - worst, rel=1e-9)
    # With set-points twenty times as often only the servo's part is left.
    options = certificate.result.run.compensation
    often = ac.compensate(certificate.trajectory, certificate.job.servo, options, cycle=2e-4)
    ideal = ac.ServoPlant(certificate.job.arm, certificate.job.servo, saturation="none")
    tool = ac.simulate(often, ideal, resolution=2e-4).tool
    # A third of a nanometre, up to rounding.
    distance = certificate.result.path.path.project(tool).distance.max()
    assert budget.servo == pytest.approx(distance, abs=1e-11)
    assert 0 < certificate.headroom.max() < 1
    # Limits of the set-points cost little.
    limited = ac.certify(job(PAPER), goal=certified.goal)
    judged(limited)
    assert certified.duration < limited.duration < 1.003 * certified.duration
    assert limited.result.set_points.limit_cost is not None


def test_a_certificate_that_fails_in_its_experiment_is_not_kept(certified):
    """On rigid bodies, the same set-points exceed 2 um, but not 5 mm."""
    error = certified.result.experiment.evaluation.contour_error.max
    assert error > 2e-6 > certified.budget.executed
    assert certified.kept is False and certified.experiment_error >= error
    note = certified.to_data()["kept"].note
    assert note.endswith(f"on rigid bodies {number(certified.experiment_error, 'm')}")
    wide = replace(
        certified,
        contours=tuple(
            replace(x, budget=replace(x.budget, servo_allowed=5e-3)) for x in certified.contours
        ),
    )
    assert wide.kept is True
    # Without a compensation, the certificate is for the servo, and a run is for its bodies.
    text = LINE.replace("only: {compensation: {method: inverse}}", "only: {}") + "experiment: {}\n"
    line = parse_job(text)
    assert line.runs[0].compensation.method == "inverse_dynamics"
    certificate = ac.certify(line, goal=ac.CertificateGoal(servo_error=2e-5))
    assert certificate.set_points.method == certificate.result.run.compensation.method == "inverse"


def test_a_certificate_states_that_rigid_bodies_are_not_covered(certified):
    certificate = ac.certify(parse_job(LINE), goal=ac.CertificateGoal(servo_error=2e-5))
    assert "independent servos" in certificate.to_data().title
    assert certificate.rigid_body_warning.startswith("Valid for independent joint servos only: ")
    assert certificate.warnings[-1] == certificate.rigid_body_warning
    page = render_report(certificate.job_result, certificate=certificate)
    assert "Valid for independent joint servos only" in page
    e = certified.result.experiment.evaluation
    error = number(max(e.contour_error.max, e.coverage_error.max), "m")
    assert f"the contour error is {error}" in certified.rigid_body_warning


def test_a_plan_without_compensation_is_derated_to_its_budget():
    # Slowly: what is derated at one place leaves the lag of what came before.
    certificate = ac.certify(parse_job(LAG))
    judged(certificate, loaded=True)
    assert certificate.duration < 1.14 * certificate.uncertified.duration


def test_the_papers_job_is_certified_at_10_ms():
    certificate = ac.certify(job(PAPER, cycle="10 ms"), goal=ac.CertificateGoal(servo_error=5e-6))
    assert certificate.duration <= 5.40 and judged(certificate).speed <= 0.15 * (1 + 1e-3)


def test_a_result_of_the_search_that_fails_the_proof_is_refused(monkeypatch):
    """The judge rejects the plan without derating, which a wrong search proposes."""
    ratios = []

    def propose(case):
        verdict = yield Attempt.joined(case, [Move.without_derating(case, case.traced.steps[0], 0)])
        ratios.append(verdict.ratios[0])
        raise ac.NotRealizable("wrong")

    monkeypatch.setattr(derating_search, "attempts", propose)
    box = Uncertainty(gains=0.1)
    with pytest.raises(ac.NotRealizable, match="wrong"):
        ac.certify(job(SHORT), goal=ac.CertificateGoal(servo_error=0.5e-3, box=box))
    assert ratios[0]["box"] > 4 and ratios[0]["acceleration"] > 1 > ratios[0]["error"]


@pytest.mark.parametrize("more", ["ki: 6 1/s", "ki: 6 1/s, drive_cycle: 4 ms"])
def test_certified_servo_with_integrator_stays_within_error_budget(more):
    line = LINE.replace("kv: 150 1/s", f"kv: 150 1/s, {more}")
    certificate = ac.certify(parse_job(line), goal=ac.CertificateGoal(servo_error=2e-5))
    assert 0 < judged(certificate).contour_error.max <= 2e-5


def test_certified_plans_satisfy_jerk_limits():
    base = job(SHORT)
    limits = base.runs[0].limits.replace(joint_jerk=36.0)
    certificate = ac.certify(
        replace(base, runs=(replace(base.runs[0], limits=limits),)),
        goal=ac.CertificateGoal(servo_error=2e-6),
    )
    result = judged(certificate)
    # Slower by what linear interpolation adds to a uniform acceleration, 0.25 % at 4 ms.
    assert 0 < certificate.cost < 6e-3 and (certificate.headroom < 0.01).all()
    assert result.contour_error.max <= 2e-7
    # The set-points of the plan itself, by differences.
    q = certificate.trajectory(np.arange(0.0, certificate.duration, 1e-3))
    for order, limit in ((2, 0.72), (3, 36.0)):
        assert np.abs(np.diff(q, order, axis=0)).max() / 1e-3**order <= limit * (1 + 1e-4)


# tests/slow has boxes of the paper's job.
def test_gains_with_an_error_of_ten_percent_are_certified():
    box = Uncertainty(gains=0.1)
    certificate = ac.certify(job(SHORT), goal=ac.CertificateGoal(servo_error=0.5e-3, box=box))
    assert (
        certificate.uncertified.box > 2e-3
        and certificate.duration <= 1.02 * certificate.uncertified.duration
    )
    robots = certificate.worst.robots
    assert robots.names == ("kp of joint 1", "kp of joint 2", "kv of joint 1", "kv of joint 2")
    # The bound is that of a robot that was found, and little more.
    assert robots.max.max() <= certificate.budget.executed == robots.bound <= 0.5e-3
    assert robots.bound <= 1.01 * robots.max.max()
    # Executed again, and other robots of the box than those of the certificate.
    arm = certificate.job.arm
    servo = certificate.job.plant_servo.for_joints(2)
    random = np.random.default_rng(7)
    for deviations, expected in (
        (robots.deviations[int(robots.max.argmax())], robots.max.max()),
        *((0.1 * random.uniform(-1, 1, 4), None) for _ in range(20)),
    ):
        real = servo.replace(kp=servo.kp * (1 + deviations[:2]), kv=servo.kv * (1 + deviations[2:]))
        plant = ac.ServoPlant(arm, real, certificate.result.run.limits)
        result = ac.evaluate(
            ac.simulate(certificate.set_points, plant), certificate.result.path.path
        )
        error = max(result.contour_error.max, result.coverage_error.max)
        assert error <= 0.5e-3
        if expected is not None:
            assert error == pytest.approx(expected, rel=1e-3)


def test_errors_of_the_dead_time_are_certified():
    delayed = job(SHORT, servo=", dead_time: 40 ms", more=EXACT)
    # Shared by all joints, it costs nothing.
    shared = Uncertainty(dead_time=2e-3, dead_time_shared=True)
    certificate = ac.certify(delayed, goal=ac.CertificateGoal(servo_error=2e-6, box=shared))
    assert "dead time ±2 ms (the same error for all joints)" in certificate.model
    assert certificate.duration <= 1.002 * certificate.uncertified.duration
    assert certificate.worst.robots.max.max() <= 2e-6
    assert certificate.worst.robots.names == ("dead time",)
    box = Uncertainty(dead_time=2e-3)
    certificate = ac.certify(delayed, goal=ac.CertificateGoal(servo_error=0.06e-3, box=box))
    data = certificate.to_data()
    assert "dead time ±2 ms (independent for each joint)" in data["model"].value
    # The robots of the box are what slows the plan down, and the report names them.
    assert certificate.duration > 1.005 * certificate.uncertified.duration
    limit = "contour error of robots of the box"
    assert limit in certificate.result.explanation.kinds and data["time_limit"].value != limit
    assert certificate.worst.robots.max.max() <= 0.06e-3 < certificate.uncertified.box
    with pytest.raises(ac.NotRealizable) as caught:
        ac.certify(delayed, goal=ac.CertificateGoal(servo_error=0.03e-3, box=box, slowest=1.2))
    error = caught.value
    assert error.limit == "contour error" and error.allowed == 0.03e-3
    # What can be reached in that time is between the two.
    assert 0.03e-3 < error.needed < 0.06e-3
    assert "worst robot of the box" in str(error) and f"{error.needed * 1e3:.3g} mm" in str(error)
    assert "slowest derated plan" in str(error)


def test_motion_is_slowed_down_evenly_where_derating_fails(monkeypatch):
    def give_up(case):
        raise derating_search.SearchEnded("derating ended")
        yield

    monkeypatch.setattr(derating_search, "attempts", give_up)
    box = Uncertainty(gains=0.02)
    goal = ac.CertificateGoal(servo_error=0.1e-3, box=box, slowest=2.5)
    certificate = ac.certify(job(SHORT), goal=goal)
    assert certificate.kept and certificate.budget.executed <= 0.1e-3
    judged(certificate)
    fastest = certificate.uncertified.duration
    assert 1 < certificate.duration / fastest <= 2.5
    # The same motion along the path, more slowly.
    s = np.linspace(0, certificate.contours[0].path.length, 50)[1:-1]
    contour = certificate.contours[0]
    limits = certificate.result.run.limits
    fast = ac.plan(contour.joint_path, certificate.job.arm, limits)
    rates = certificate.trajectory.speed_at(s) / fast.speed_at(s)
    assert rates == pytest.approx(fastest / certificate.duration, rel=1e-3)
    assert {x.cause for x in certificate.contours[0].derated} == {"even"}
    # Through a job file, and with a limit that no even motion keeps.
    keys = "servo_error: 0.1 mm, box: {gains: 2 %}, slowest: 2.5"
    same = ac.certify(job(SHORT, more=f"certificate: {{{keys}}}"))
    assert same.duration == certificate.duration
    with pytest.raises(ac.NotRealizable, match="derating ended"):
        ac.certify(job(SHORT), goal=replace(goal, slowest=1.01))


def test_each_remedy_of_a_refusal_is_enough_on_its_own():
    box = Uncertainty(gains=0.1)
    goal = ac.CertificateGoal(servo_error=0.05e-3, box=box, slowest=1.2)
    with pytest.raises(ac.NotRealizable) as caught:
        ac.certify(job(SHORT), goal=goal)
    found = re.search(
        r"slowest: ([\d.]+) .*servo_error: ([\d.]+) mm .*a box of (\d+) % of its size",
        str(caught.value),
    )
    slowest, error, percent = (float(x) for x in found.groups())
    assert 1.2 < slowest < 4 and 30 < percent < 100 and 0.05 < error < 0.1
    changes = (
        ({"slowest": slowest}, f"servo_error: 0.05 mm, box: {{gains: 10 %}}, slowest: {slowest}"),
        (
            {"box": Uncertainty(gains=percent / 1000)},
            f"servo_error: 0.05 mm, box: {{gains: {percent / 10} %}}, slowest: 1.2",
        ),
        (
            {"servo_error": error * 1e-3},
            f"servo_error: {error} mm, box: {{gains: 10 %}}, slowest: 1.2",
        ),
    )
    for change, keys in changes:
        certificate = ac.certify(job(SHORT), goal=replace(goal, **change))
        assert certificate.kept
        # The same through a job file.
        stated = ac.certify(job(SHORT, more=f"certificate: {{{keys}}}"))
        assert stated.duration == pytest.approx(certificate.duration)


def test_a_total_tolerance_is_divided_and_its_unused_part_returned():
    certificate = ac.certify(job(SHORT), goal=ac.CertificateGoal(tolerance=2e-3))
    budget = certificate.budget
    result = certificate.result.evaluation
    assert budget.total <= 2e-3 and result.objective_error.max <= 2e-3
    # Hardly anything is left: the corners got what the servo did not need.
    assert budget.rounding > 1.996e-3
    assert certificate.result.path.path.corners.error.max() == budget.rounding
    assert certificate.duration <= 1.01 * certificate.uncertified.duration


def test_the_refusal_names_the_limiting_requirement(refuses):
    held = job(SHORT, servo=", interpolation: step")
    lags = LINE.replace("inverse", "none")
    acceleration = {"limit": "joint_acceleration"}
    error = {"limit": "contour error"}
    for job_case, servo, slowest, words, data in (
        (held, 1e-3, 1.05, ("are held", "linear interpolation"), acceleration),
        (job(SHORT), 1e-9, 1.05, ("slowest derated plan", "servo_error: "), error),
        (parse_job(lags), 1e-6, 1.05, ("compensate the lag of the servo",), error),
        (job(SHORT), 1e-3, 1.0001, ("slowest: 1.",), acceleration),
    ):
        call = partial(
            ac.certify, job_case, goal=CertificateGoal(servo_error=servo, slowest=slowest)
        )
        refuses(call, ac.NotRealizable, *words, **data)


def test_error_budget_includes_error_that_servo_model_does_not_explain(refuses):
    short_job = job(SHORT, servo=", model_error: 0.1 mrad")
    certificate = ac.certify(short_job, goal=CertificateGoal(servo_error=0.2e-3))
    budget = certificate.budget
    result = judged(certificate)
    expected = ac.evaluate(certificate.result.execution, certificate.result.path.path).model_error[
        1
    ]
    assert budget.model_error == pytest.approx(expected, rel=1e-4) and expected > 3e-5
    assert result.contour_error.max + budget.model_error <= 0.2e-3
    assert budget.executed == budget.servo + budget.sampling + budget.model_error
    assert budget.left == 0.2e-3 - budget.executed >= 0
    more = ac.certify(job(SHORT), goal=CertificateGoal(servo_error=0.2e-3 - budget.model_error))
    assert more.duration == pytest.approx(certificate.duration, rel=1e-3)
    # The condition is stated, and the joint that exceeds the motion of the logs is named.
    assert "bounded for motion" in certificate.condition and "joint" not in certificate.condition
    assert not more.condition
    logged = "logged_velocity: [9, 1e-3], logged_acceleration: 9"
    beyond = ac.certify(
        job(SHORT, servo=f", model_error: 0.1 mrad, {logged}"), goal=certificate.goal
    )
    fastest = np.abs(beyond.trajectory(beyond.trajectory.breaks, 1)[:, 1]).max()
    assert f"joint 2 has {fastest / 1e-3:.3g} times" in beyond.condition
    call = partial(ac.certify, short_job, goal=CertificateGoal(servo_error=2e-5))
    words = "that the servo model does not explain", "Allow a larger error"
    refuses(call, ac.NotRealizable, *words, limit="contour error", allowed=2e-5)


def test_invalid_goals_are_refused_before_the_search(refuses):
    line_job = parse_job(LINE)
    two = replace(line_job, runs=(line_job.runs[0], replace(line_job.runs[0], name="second")))

    def certify(job, run=None, **of_goal):
        goal = CertificateGoal(servo_error=2e-6, **of_goal)
        ac.certify(job, run=run, goal=goal, progress=pytest.fail)

    for call, words in (
        (partial(ac.certify, line_job), "tolerance"),
        (partial(certify, line_job, "other"), "'other'"),
        (partial(certify, two), "only, second"),
        (partial(CertificateGoal, servo_error=1e-3, tolerance=1e-3), "must be below the tolerance"),
        (partial(CertificateGoal, servo_error=1e-3, slowest=1.0), "slowest must be above 1"),
        (
            partial(certify, job(SHORT), box=Uncertainty(dead_time=1e-3)),
            "must not exceed the dead time",
        ),
    ):
        refuses(call, ac.InvalidInput, words)


def test_a_job_file_can_state_the_goal_of_a_certificate(refuses):
    keys = "certificate: {tolerance: 5 mm, servo_error: 2 um, run: only, box: {"
    text = LINE + keys + "gains: 10 %, dead_time: 2 ms, shared: false}}\n"
    goal = parse_job(text).certificate
    assert (goal.tolerance, goal.servo_error, goal.run) == (5e-3, pytest.approx(2e-6), "only")
    box = goal.box
    assert float(box.gains) == pytest.approx(0.1) and not box.dead_time_shared
    assert float(box.dead_time) == pytest.approx(2e-3)
    per_joint = parse_job(text.replace("10 %", "[[10 %, 0.2], [5 %, 0]]")).certificate.box.gains
    np.testing.assert_allclose(per_joint, [[0.1, 0.2], [0.05, 0.0]])
    for wrong, words in (
        (text.replace("run: only", "run: none"), "certificate.run"),
        (text.replace("10 %", "10 mm"), "percentage"),
        (text.replace("10 %", "100 %"), "0 to below 1"),
        (LINE + "certificate: {}\n", "requires a tolerance"),
    ):
        refuses(partial(parse_job, wrong), ac.InvalidInput, words)


def test_without_a_goal_the_accuracy_of_the_job_is_the_tolerance():
    certificate = ac.certify(parse_job(LINE + "accuracy: 0.3 mm\n"))
    assert certificate.goal.tolerance == pytest.approx(0.3e-3) and certificate.kept


def test_errors_of_a_path_count_until_the_tool_is_at_rest():
    # A late drive is still on its way when the plan has ended.
    delayed = job(SHORT, servo=", dead_time: 4 ms", method="pole_placement")
    certificate = ac.certify(delayed, goal=ac.CertificateGoal(servo_error=1e-4))
    of_contour = certificate.contours[0].error
    of_all = certificate.result.evaluation.contour_error
    assert (of_contour.max, of_contour.rms) == (of_all.max, of_all.rms)
    # No error exceeds the certified one until all joints rest, although the tool leaves the path
    # while it is slower than 1 mm/s.
    assert until_rest(16) == []
