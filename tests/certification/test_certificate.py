"""Certificates: the paper's job within stated tolerances, on the model that is named."""

import json
from dataclasses import replace

import numpy as np
import pytest
from soak.certificates import until_rest

import armcontour as ac
from armcontour.certification._derating import Derating, plan_derated
from armcontour.io import certificate_json, derating_csv, parse_job
from armcontour.jobs import Goal, Published
from armcontour.motion.command_limits import refuse_commands
from armcontour.report import render_report
from armcontour.robustness.monte_carlo import Box, spread

OPTIMUM = 5.3262  # the paper's job with the method optimal, from tests/golden
JOB = """
name: paper
arm: pmk3s
path: {{points: [[0.350, 0.100], [0.410, 0.150], [0.280, 0.300], [0.350, 0.350]]}}
limits: {{speed: 0.15 m/s, joint_acceleration: 0.72 rad/s^2, centripetal_acceleration: 0.09 m/s^2}}
corners: {{tolerance: 5 mm}}
servo: {{kp: 25 1/s, kv: 150 1/s{servo}}}
command_interval: {period}
runs:
  certified: {{compensation: {{method: {method}}}}}
{more}
"""
LINE = """
name: line
arm: pmk3s
path: {points: [[0.30, 0.20], [0.40, 0.20]]}
limits: {speed: 0.15 m/s, joint_acceleration: 0.72 rad/s^2}
servo: {kp: 25 1/s, kv: 150 1/s}
runs:
  only: {compensation: {method: inverse}}
"""


def job(period="4 ms", method="inverse", servo="", more=""):
    return parse_job(JOB.format(period=period, method=method, servo=servo, more=more))


@pytest.fixture(scope="module")
def certified():
    more = "certificate: {servo: 2 um, rms: 0.5 um}\nexperiment: {}"
    return ac.certify(job(more=more))


def judged(found):
    """The certificate's taught data, executed and checked again by nothing of the search."""
    arm, limits = found.job.arm, found.run.limits
    plant = ac.ServoPlant(arm, found.job.plant_servo, limits)
    executed = ac.execute(found.taught, plant, resolution=1e-4)
    evaluation = ac.evaluate(executed, found.path.path, objective=found.job.path, limits=limits)
    check = ac.check(found.trajectory, arm, limits, points=20, seed=1)
    assert not check.violated
    return executed, evaluation


def test_four_milliseconds(certified):
    executed, result = judged(certified)
    assert certified.duration <= 5.332 and certified.windows == ()
    assert certified.uncertified.duration == pytest.approx(OPTIMUM, abs=1e-4)
    assert certified.cost == certified.duration - certified.uncertified.duration > 0
    assert result.contour_error.rms <= 0.5e-6
    assert result.contour_error.max <= 2e-6
    assert (executed.peak_demand <= 0.72 * (1 + 1e-6)).all() and (result.saturated == 0).all()
    assert result.speed <= 0.15 * (1 + 1e-3)
    # Nothing of that is there without a certificate.
    assert certified.uncertified.contour_error[0] > 1e-4


def test_the_parts_of_the_budget_are_what_they_say(certified):
    budget, found = certified.budget, certified
    assert budget.rounding == pytest.approx(5e-3)
    worst = max(found.evaluation.contour_error.max, found.contours[0].missed.max)
    assert budget.executed == pytest.approx(worst, rel=1e-12)
    assert budget.left == pytest.approx(2e-6 - worst, rel=1e-9)
    # With set-points twenty times as often only the servo's part is left.
    often = ac.compensate(found.trajectory, found.job.servo, method="inverse", period=2e-4)
    ideal = ac.ServoPlant(found.job.arm, found.job.servo, saturation="none")
    tool = ac.execute(often, ideal, resolution=2e-4).tool
    # A third of a nanometre, up to rounding.
    distance = found.path.path.project(tool).distance.max()
    assert budget.servo == pytest.approx(distance, abs=1e-11)
    assert 0 < found.headroom.max() < found.largest_headroom.max() < 1


def test_without_compensation_a_tool_is_slowed_until_it_keeps_its_budget():
    # Slowly: what is derated at one place leaves the lag of what came before.
    found = ac.certify(
        parse_job(
            """
name: lag
arm: pmk3s
path: {points: [[0.35, 0.2], [0.4216768, 0.1589672], [0.3311563, 0.1382437]]}
limits: {speed: 0.2914771, joint_acceleration: 5.5179714}
corners: {tolerance: 0.13197796 mm}
servo: {kp: 20.8143967, kv: 181.493, dead_time: 4 ms, interpolation: cubic}
command_interval: 4 ms
certificate: {servo: 0.6866 mm}
runs:
  only: {compensation: {method: none}}
"""
        )
    )
    assert judged(found)[1].contour_error.max <= 0.6866e-3
    assert found.duration < 1.14 * found.uncertified.duration


def test_the_papers_compensator_at_the_full_limit():
    found = ac.certify(job(method="pole_placement"), servo=5e-6, saturation="report")
    _, result = judged(found)
    assert result.contour_error.max <= 5e-6
    assert found.duration <= 5.33
    assert result.settled <= 5.40
    assert result.saturated.max() > 0.1  # and that is said
    assert found.evaluation.saturated.max() == pytest.approx(result.saturated.max(), rel=1e-9)
    assert found.trials == 1


@pytest.mark.parametrize(
    ("period", "slowest", "budget"), [("1 ms", 5.345, 2e-6), ("10 ms", 5.40, 5e-6)]
)
def test_other_intervals(period, slowest, budget):
    found = ac.certify(job(period=period), servo=budget)
    executed, result = judged(found)
    assert found.duration <= slowest
    assert result.contour_error.max <= budget
    assert (executed.peak_demand <= 0.72 * (1 + 1e-6)).all()
    assert result.speed <= 0.15 * (1 + 1e-3)


def test_limits_of_jerk_are_kept():
    base = job()
    run = base.runs[0]
    run = replace(run, limits=run.limits.replace(joint_jerk=36.0))
    found = ac.certify(replace(base, runs=(run,)), servo=2e-6)
    executed, result = judged(found)
    assert found.windows == ()
    # Slower by what linear interpolation adds to a uniform acceleration, 0.25 % at 4 ms.
    assert 0 < found.cost < 6e-3 and (found.largest_headroom < 0.01).all()
    assert result.contour_error.max <= 2e-7
    assert (executed.peak_demand <= 0.72 * (1 + 1e-6)).all()
    # The taught data of the plan itself, by differences.
    q = found.trajectory(np.arange(0.0, found.duration, 1e-3))
    for order, limit in ((2, 0.72), (3, 36.0)):
        assert np.abs(np.diff(q, order, axis=0)).max() / 1e-3**order <= limit * (1 + 1e-4)


def test_held_set_points():
    held = job(period="1 ms", servo=", interpolation: step")
    found = ac.certify(held, servo=1e-5, saturation="report")
    _, result = judged(found)
    assert result.contour_error.max <= 1e-5
    assert result.saturated.max() > 0
    assert found.duration <= 6.5
    assert found.budget.sampling > 100 * found.budget.servo


def test_gains_ten_percent_off():
    box = Box(gains=0.1)
    found = ac.certify(job(), servo=1e-3, box=box, samples=2000)
    assert found.duration <= 5.55
    assert found.uncertified.box > 5e-3
    shared = (found.taught, found.path.path, found.job.arm, found.job.plant_servo, found.run.limits)
    # Other robots of the box than those that the certificate was made with.
    drawn = spread(*shared, box, samples=500, seed=7)
    assert drawn.max.max() <= 1e-3
    assert len(found.spread) == 2000 and found.spread.within(1e-3) == 1.0
    assert found.budget.executed == max(found.spread.max.max(), found.corners.max.max())


@pytest.fixture(scope="module")
def late():
    return job(servo=", dead_time: 40 ms")


def test_a_dead_time_that_all_joints_share_costs_nothing(late):
    found = ac.certify(late, servo=2e-6, box=Box(dead_time=2e-3), samples=200)
    assert found.duration <= 5.36
    assert found.spread.within(2e-6) == 1.0


def test_dead_times_that_err_by_themselves(late, refuses):
    box = Box(dead_time=2e-3, dead_time_shared=False)
    found = ac.certify(late, servo=0.6e-3, box=box, samples=200)
    assert found.duration <= 5.40
    assert found.spread.within(0.6e-3) == 1.0
    with pytest.raises(ac.NotRealizable) as caught:
        ac.certify(late, servo=0.05e-3, box=box, slowest=1.5)
    error = caught.value
    assert error.limit == "contour error" and error.allowed == 0.05e-3
    # What can be reached in that time is between the two.
    assert 0.05e-3 < error.needed < 0.6e-3
    for words in ("1.5 times", "worst robot of the box", f"{error.needed * 1e3:.4g} mm", "slowest"):
        assert words in str(error)


def test_a_box_that_does_not_fit_the_robot_is_refused_before_the_search(refuses):
    def search(**box):
        return lambda: ac.certify(job(), servo=2e-6, box=Box(**box), progress=pytest.fail)

    refuses(search(payload=0.5), ac.InvalidInput, "payload of the box", "carries only 0 kg")
    refuses(search(jitter=2e-3), ac.InvalidInput, "jitter of 0.002 s", "half the command interval")
    refuses(search(dead_time=1e-3), ac.InvalidInput, "dead time cannot be negative")


def test_a_total_tolerance_is_split_and_given_back():
    found = ac.certify(job(), tolerance=5e-3)
    budget, result = found.budget, found.evaluation
    assert budget.total <= 5e-3 and result.objective_error.max <= 5e-3
    # Hardly anything is left: the corners got what the servo did not need.
    assert budget.rounding > 4.99e-3
    assert found.path.path.corners.error.max() == budget.rounding
    assert found.duration <= 5.36


def test_a_command_keeps_to_joint_velocities(refuses):
    slow = parse_job(LINE)
    run = slow.runs[0]
    plan = ac.plan(slow.path, slow.arm, run.limits)
    t = np.linspace(0, plan.duration, 2000)
    fastest = np.abs(plan(t, 1)).max(axis=0)
    # The plan may just be run, but the command that leads it exceeds the limit.
    limits = run.limits.replace(joint_velocity=fastest)
    slow = replace(slow, runs=(replace(run, limits=limits),))
    taught = ac.compensate(plan, slow.servo, method="inverse")
    refuses(lambda: refuse_commands(taught, limits), ac.CompensationError, "joint_velocity")
    found = ac.certify(slow, servo=2e-6)
    refuse_commands(found.taught, limits)
    assert found.duration > plan.duration
    assert found.evaluation.contour_error.max <= 2e-6


def test_stops_at_sharp_corners_stay():
    sharp = parse_job(LINE.replace("[0.40, 0.20]]", "[0.40, 0.20], [0.40, 0.25]]"))
    found = ac.certify(sharp, servo=2e-6)
    assert found.trajectory.speed_at([0.1]) < 1e-8
    assert found.budget.rounding == 0.0
    assert found.evaluation.contour_error.max <= 2e-6
    assert found.evaluation.demand_ratio.max() <= 1 + 1e-6


def test_what_binds_is_said(refuses):
    held = job(period="4 ms", servo=", interpolation: step")
    refuses(
        lambda: ac.certify(held, servo=1e-3, slowest=1.05),
        ac.NotRealizable,
        "a joint's acceleration limit",
        "are held",
        "linear interpolation",
        "saturation: report",
        limit="joint_acceleration",
    )
    refuses(
        lambda: ac.certify(job(), servo=1e-9, slowest=1.05),
        ac.NotRealizable,
        "contour error comes down to",
        "shorter command interval",
        limit="contour error",
        allowed=1e-9,
    )
    lags = parse_job(LINE.replace("inverse", "none"))
    refuses(
        lambda: ac.certify(lags, servo=1e-6, slowest=1.05),
        ac.NotRealizable,
        "contour error comes down to",
        "compensate the lag of the servo",
        limit="contour error",
    )
    refuses(
        lambda: ac.certify(job(), servo=1e-3, slowest=1.0001),
        ac.NotRealizable,
        "acceleration limit",
        "larger slowest",
        limit="joint_acceleration",
    )


def test_what_cannot_be_asked_is_refused(refuses):
    this = parse_job(LINE)
    refuses(lambda: ac.certify(this), ac.InvalidInput, "tolerance", "servo")
    refuses(lambda: ac.certify(this, servo=1e-3, speed=1.0), ac.InvalidInput, "'speed'")
    refuses(lambda: ac.certify(this, "other", servo=1e-3), ac.InvalidInput, "'other'", "only")
    two = replace(this, runs=(this.runs[0], replace(this.runs[0], name="second")))
    refuses(lambda: ac.certify(two, servo=1e-3), ac.InvalidInput, "only, second")
    refuses(
        lambda: Goal(servo=1e-3, tolerance=1e-3), ac.InvalidInput, "must be below the tolerance"
    )
    refuses(lambda: Goal(servo=1e-3, slowest=1.0), ac.InvalidInput, "slowest must be above 1")
    refuses(lambda: Goal(servo=1e-3, saturation="maybe"), ac.InvalidInput, "refuse, report")


def test_the_summary_repeats_it(certified):
    """From summary.json and derating.csv alone the same plan is made, without a search."""
    data = json.loads(certificate_json(certified, ["derating.csv"]))["certificate"]
    rows = derating_csv(certified).splitlines()[1:]
    values = [[float(x) if x else np.inf for x in row.split(",")] for row in rows]
    table = np.array(values)
    assert (table[:, 0] == 1).all()
    table = table[:, 1:]
    derating = Derating(
        cells=np.append(table[:, 0], table[-1, 1]), share=table[:, 2:-1], cap=table[:, -1]
    )
    repeat = data["repeat"]
    given = {name: x for name, x in repeat["limits"].items() if x is not None}
    path = ac.round_corners(certified.job.path, tolerance=repeat["rounding"]["tolerance"])
    joint_path = ac.trace(path, certified.job.arm)
    arm = ac.load_arm("pmk3s")
    _, again = plan_derated(
        joint_path, arm, ac.Limits(**given), derating, tuple(data["contours"][0]["windows"])
    )
    assert again.duration == certified.duration
    servo = ac.ServoModel(**{k: v for k, v in repeat["servo"].items() if v is not None})
    taught = ac.compensate(again, servo, method=repeat["compensation"], period=repeat["period"])
    np.testing.assert_array_equal(taught.q, certified.taught.q)
    assert data["goal"]["servo"] == 2e-6 and "kp 25 1/s and kv 150 1/s" in data["model"]
    assert data["duration"] == certified.duration


def test_it_comes_out_the_same_again(certified):
    this = replace(certified.job.runs[0], experiment=None)
    again = ac.certify(replace(certified.job, runs=(this,)))
    np.testing.assert_array_equal(again.taught.q, certified.taught.q)
    # Time is measured in benchmarks; a round is about a trial.
    assert again.trials < 30


def test_a_corner_that_smoothing_carries_to_its_neighbours():
    slot = job().path.polyline([(0.30, 0.15), (0.40, 0.15), (0.40, 0.25), (0.30, 0.25)])
    found = ac.certify(replace(job(), path=slot), servo=1e-5)
    executed, evaluation = judged(found)
    assert evaluation.contour_error.max <= 1e-5
    assert (evaluation.demand_ratio <= 1 + 1e-6).all()
    assert found.cost < 0.03


def test_rigid_bodies_stand_beside_it(certified):
    """The bodies were never looked at: their error is not the certificate's, and is not hidden."""
    seen = certified.experiment.evaluation.contour_error.max
    assert 10 * certified.budget.executed < seen < 1e-4
    assert "on rigid bodies" in render_report(certified.study, certificate=certified)


def test_the_report_begins_with_it(certified):
    page = render_report(certified.study, certificate=certified)
    assert page.index('id="certificate"') < page.index('id="overview"')
    assert f"{certified.duration:.4f} s" in page
    assert "independent joint servos" in page and "command interval" in page


def test_its_report_compares_nothing_with_published_figures(certified):
    """They are of the job's runs as they are, and of runs that are not certified."""
    published = Published(
        source="a paper",
        runs={"certified": {"duration": 5.0}, "other": {"duration": 6.0}},
        time_stamps=(0.0, 1.0),
        time_stamps_of="other",
    )
    found = replace(certified, job=replace(certified.job, published=published))
    page = render_report(found.study, certificate=found)
    assert 'id="certificate"' in page and 'id="published"' not in page


def test_goals_of_job_files(refuses):
    keys = "certificate: {tolerance: 5 mm, servo: 2 um, run: only, samples: 50, seed: 3, box: {"
    text = LINE + keys + "gains: 10 %, dead_time: 2 ms, shared: false, jitter: 0.1 ms}}\n"
    goal = parse_job(text).certificate
    assert (goal.tolerance, goal.servo, goal.run) == (5e-3, pytest.approx(2e-6), "only")
    assert (goal.samples, goal.seed, goal.saturation) == (50, 3, "refuse")
    box = goal.box
    assert float(box.gains) == pytest.approx(0.1) and not box.dead_time_shared
    assert (float(box.dead_time), box.jitter) == (2e-3, pytest.approx(1e-4))
    per_joint = parse_job(text.replace("10 %", "[[10 %, 0.2], [5 %, 0]]")).certificate.box.gains
    np.testing.assert_allclose(per_joint, [[0.1, 0.2], [0.05, 0.0]])
    for wrong, words in (
        (text.replace("run: only", "run: none"), "certificate.run"),
        (text.replace("10 %", "10 mm"), "percentage"),
        (text.replace("10 %", "100 %"), "0 to below 1"),
        (LINE + "certificate: {}\n", "needs a tolerance"),
    ):
        refuses(lambda wrong=wrong: parse_job(wrong), ac.InvalidInput, words)


def test_errors_of_one_path_count_until_the_tool_rests():
    # A late drive is still on its way when the plan has ended.
    found = ac.certify(job(servo=", dead_time: 4 ms", method="pole_placement"), servo=1e-4)
    (contour,) = found.contours
    of_contour, of_all = contour.error, found.evaluation.contour_error
    assert (of_contour.max, of_contour.rms) == (of_all.max, of_all.rms)


@pytest.mark.parametrize("seed", [1, 16])
def test_no_error_exceeds_the_certified_one_until_all_joints_rest(seed):
    """The tool leaves the path while it is slower than 1 mm/s."""
    assert until_rest(seed) == []
