"""Runs of a job: equal to their single steps, planned once, refused before any run starts."""

import dataclasses
import sys
from contextlib import nullcontext

import numpy as np
import pytest
from scipy.integrate import trapezoid
from tests.corner_job import CORNER_JOB
from tests.geometry.tables import refused

import armcontour as ac
from armcontour.core.errors import NotRealizable
from armcontour.core.frames import from_rpy
from armcontour.files import parse_job
from armcontour.jobs import Experiment, Rounding, prepare_program, round_program, run
from armcontour.jobs.job import choose_run
from armcontour.jobs.plan_quantities import angular_speed, peak_torques
from armcontour.planning.tracing.tracer import trace_all


@pytest.fixture(scope="module")
def paper_result(paper_job):
    return ac.run(paper_job)


def with_runs(job, *runs):
    """Return the job with other runs."""
    return dataclasses.replace(job, runs=runs)


def with_only_run(job, **values):
    """Return the job of one run, with other values in this run."""
    (only_run,) = job.runs
    return with_runs(job, dataclasses.replace(only_run, **values))


def planned_by(job):
    """Plan the job's only run, without a simulation, and return its trajectory."""
    (result,) = run(job, simulate=False).runs.values()
    return result.trajectory


@pytest.mark.parametrize("number", [0, 1])
def test_run_equals_its_single_steps(paper_job, paper_result, number):
    job_run = paper_job.runs[number]
    path = paper_job.path
    if job_run.rounding is not None:
        path = ac.round_corners(path, tolerance=5e-3, acceleration=0.09)
    joint_path = ac.trace(path, paper_job.arm)
    trajectory = ac.plan(joint_path, paper_job.arm, job_run.limits, job_run.timing)
    # The conventional plan has corners at which its velocity jumps.
    expected = nullcontext() if job_run.compensation.compensates else pytest.warns(UserWarning)
    with expected:
        set_points = ac.compensate(
            trajectory, paper_job.servo, job_run.compensation, cycle=job_run.cycle
        )
    plant = ac.ServoPlant(paper_job.arm, paper_job.plant_servo, job_run.limits)
    execution = ac.simulate(set_points, plant)
    evaluation = ac.evaluate(
        execution,
        path,
        objective=paper_job.path,
        limits=job_run.limits,
        end_time=job_run.end_time,
    )
    result = paper_result.runs[job_run.name]
    assert result.run is job_run
    np.testing.assert_array_equal(result.path.path.breaks, path.breaks)
    assert result.trajectory.duration == trajectory.duration
    np.testing.assert_array_equal(result.set_points.q, set_points.q)
    np.testing.assert_array_equal(result.execution.q, execution.q)
    assert result.evaluation.contour_error.rms == evaluation.contour_error.rms
    assert result.evaluation.objective_error.max == evaluation.objective_error.max
    assert result.evaluation.corners == evaluation.corners
    assert result.evaluation.end_time == evaluation.end_time
    np.testing.assert_array_equal(result.evaluation.saturated, evaluation.saturated)


def test_results_are_in_the_order_of_the_runs(paper_job, paper_result):
    assert list(paper_result.runs) == ["proposed", "conventional"]
    assert paper_result.job is paper_job


def test_configuration_of_a_job_is_traced(paper_job):
    other = dataclasses.replace(paper_job, runs=paper_job.runs[1:], configuration="negative")
    assert planned_by(other)(0.0)[1] < 0


def test_invalid_runs_and_jobs_are_refused(paper_job, line_job):
    first = paper_job.runs[0]
    unlimited = dataclasses.replace(first, limits=first.limits.replace(speed=np.inf))
    refused(
        (lambda: ac.run(with_runs(paper_job, unlimited)), "paper needs an assigned velocity"),
        (lambda: Rounding(tolerance=5e-3, acceleration=0.0), "acceleration of a rounding", "zero"),
        (lambda: with_runs(paper_job, first, first), "runs must differ in name"),
        (lambda: dataclasses.replace(line_job, seed=np.zeros(2)), "seed has 2 values"),
    )


def test_unsupported_limits_are_refused_before_any_run_starts(line_job):
    (only_run,) = line_job.runs
    jerk_limits = only_run.limits.replace(joint_jerk=100.0).for_joints(6)
    by_paper = dataclasses.replace(only_run, name="two", limits=jerk_limits, timing=ac.Paper())
    free_corners = Rounding(shape="free", tolerance=1e-3)
    shaped = with_only_run(line_job, limits=jerk_limits, rounding=free_corners)
    goal = ac.CertificateGoal(tolerance=2e-3)
    started = []
    refused(
        (
            lambda: ac.run(with_runs(line_job, only_run, by_paper), progress=started.append),
            "Run two: The method paper",
            "joint_jerk",
        ),
        (lambda: ac.run(shaped, progress=started.append), "shaped path"),
        (lambda: ac.certify(shaped, goal=goal), "shaped path"),
        kind=NotRealizable,
    )
    assert not started


def test_impossible_experiments_are_refused_before_any_run_starts(paper_job, monkeypatch):
    proposed, conventional = paper_job.runs
    bodies = dataclasses.replace(conventional, experiment=Experiment())
    job = with_runs(paper_job, proposed, bodies)
    first_order = dataclasses.replace(job, plant_servo=ac.ServoModel(kp=25.0, order="first"))
    words = "Run conventional: experiment: "
    started = []
    refused(
        (lambda: ac.run(first_order, progress=started.append), words, "rigid-body plant"),
    )
    monkeypatch.setitem(sys.modules, "mujoco", None)
    refused(
        (lambda: ac.run(job, progress=started.append), words, "armcontour[experiment]"),
    )
    assert not started


def test_warnings_name_demands_and_set_points_above_limits(paper_result):
    result = paper_result.runs["proposed"]
    # The gains of the plant differ, so the demand exceeds the limit by far.
    (overload,) = result.warnings
    assert "times its acceleration limit" in overload
    coarse = dataclasses.replace(result, run=dataclasses.replace(result.run, cycle=1.0))
    long_cycle, same_overload = coarse.warnings
    assert "cycle of 1 s" in long_cycle
    assert same_overload == overload


def test_runs_with_equal_planning_options_share_their_plan(line_job):
    (only_run,) = line_job.runs
    same_plan = dataclasses.replace(only_run, name="same", compensation=ac.PolePlacement())
    changes = {
        "slow": {"limits": only_run.limits.replace(speed=0.1)},
        "reserved": {"timing": ac.Optimal(reserve=0.1)},
        "late": {"timing": ac.Optimal(duration=5.0)},
        "coarse": {"timing": ac.Optimal(intervals=100)},
    }
    others = [dataclasses.replace(only_run, name=name, **x) for name, x in changes.items()]
    results = ac.run(with_runs(line_job, only_run, same_plan, *others)).runs
    assert results["same"].trajectory is results["one"].trajectory
    for name in changes:
        assert results[name].trajectory is not results["one"].trajectory
    # Runs with the same joint path are traced once.
    assert results["same"].traced is results["one"].traced
    assert results["slow"].traced is not results["one"].traced


def test_plan_of_a_run_equals_the_plan_of_its_path(line_job):
    (only_run,) = line_job.runs
    trajectory = planned_by(line_job)
    planned = ac.plan(line_job.path, line_job.arm, only_run.limits)
    np.testing.assert_array_equal(trajectory(0.0), planned(0.0))
    assert trajectory.duration == planned.duration


def test_plant_has_the_nominal_servo_by_default(line_job):
    assert line_job.plant_servo is line_job.servo


def test_seed_chooses_the_nearest_configuration(line_job):
    default = planned_by(line_job)(0.0)
    starts = [x(0.0) for x in trace_all(line_job.path, line_job.arm)]
    other = next(q for q in starts if np.abs(q - default).max() > 0.5)
    seeded = dataclasses.replace(line_job, seed=other + 0.01)
    np.testing.assert_allclose(planned_by(seeded)(0.0), other, atol=1e-6)


def test_angular_tolerance_shrinks_a_rounded_corner(line_job):
    corner = ac.Path.polyline([[0.4, 0, 0.2], [0.5, 0, 0.2], [0.5, 0.1, 0.2]])
    turned = corner.oriented(from_rpy([[np.pi, 0, 0], [np.pi, 0, 0], [np.pi, 0, 0.5]]))
    rounding = Rounding(tolerance=1e-2, angular_tolerance=1e-3)
    job = with_only_run(dataclasses.replace(line_job, path=turned), rounding=rounding)
    rounded = round_program(job, job.runs[0], prepare_program(job, job.runs[0]))
    assert rounded.path.corners.angular_error[0] == pytest.approx(1e-3, rel=1e-6)
    assert rounded.path.corners.shrunk[0]


def test_peak_torques_are_those_of_the_arm(paper_job, paper_result):
    result = paper_result.runs["proposed"]
    plan = result.trajectory
    peak = peak_torques(result.arm, plan)
    # The peak includes both sides of each jump of the acceleration.
    largest = np.zeros(2)
    times = {"left": plan.breaks[1:], "right": plan.breaks[:-1]}
    for side, t in times.items():
        states = [plan(t, order, side=side) for order in range(3)]
        largest = np.maximum(largest, np.abs(paper_job.arm.torque(*states)).max(axis=0))
    assert (peak >= largest).all()
    dense = np.linspace(0.0, plan.duration, 40_001)
    states = [plan(dense, order) for order in range(3)]
    largest = np.maximum(largest, np.abs(paper_job.arm.torque(*states)).max(axis=0))
    np.testing.assert_allclose(peak, largest, rtol=1e-4)


def test_arm_without_masses_has_no_torques(paper_job):
    arm = paper_job.arm
    without_masses = ac.PlanarTwoLink(
        name="bare", base=arm.base, links=(arm.link1, arm.link2), limits=arm.limits
    )
    job = dataclasses.replace(paper_job, arm=without_masses, runs=paper_job.runs[1:])
    result = ac.run(job).runs["conventional"]
    assert not job.arm.has_bodies
    assert peak_torques(result.arm, result.trajectory) is None


def test_angular_speed_integrates_to_the_turned_angle(line_job):
    turned = line_job.path.oriented(from_rpy([[np.pi, 0, 0], [np.pi, 0, 0.4]]))
    result = ac.run(dataclasses.replace(line_job, path=turned)).runs["one"]
    angle = trapezoid(angular_speed(result.execution), result.execution.t)
    assert angle == pytest.approx(0.4, rel=1e-3)


def test_planar_arm_has_no_orientation(paper_result):
    result = paper_result.runs["conventional"]
    assert angular_speed(result.execution) is None
    assert result.evaluation.orientation_error is None


def test_run_is_chosen_by_name_and_the_only_run_by_default():
    job = parse_job(CORNER_JOB + "  other: {compensation: {method: none}}\n")
    only, other = job.runs
    assert choose_run(job, "other", "learned") is other
    assert choose_run(job, None, "learned", [only]) is only
    refused(
        (lambda: choose_run(job, None, "placed"), "be placed. Choose it with --run (only, o"),
        (lambda: choose_run(job, "cut", "placed"), "no run 'cut'", "only, other"),
    )


TORQUE_JOB = """
name: t
arm: ur5e
path: {orientation: {axis: [0, 0, -1]}, points: [[0.45, 0, 0.2], [0.6, 0, 0.2]]}
limits: {speed: 3 m/s, joint_acceleration: 100, joint_torque: TORQUE}
servo: {kp: 25 1/s, kv: 150 1/s}
runs:
  only: {compensation: {method: inverse}}
"""


@pytest.mark.parametrize(("torque", "limits_the_plan"), [("60", True), ("1000", False)])
def test_torque_limit_that_acts_names_the_masses_it_uses(torque, limits_the_plan):
    result = ac.run(parse_job(TORQUE_JOB.replace("TORQUE", torque))).runs["only"]
    names_masses = any("masses of UR5e (source: " in x for x in result.remarks)
    assert names_masses == limits_the_plan
