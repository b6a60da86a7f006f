"""A job_result equals its steps called one after the other; the chosen run; jobs out of reach."""

import dataclasses
import sys

import numpy as np
import pytest
import yaml
from scipy.integrate import trapezoid
from tests.corner_job import CORNER_JOB
from tests.geometry.tables import refused
from tests.jobs.making import a_run
from tests.properties.number_cases import PLANE, SPACE

import armcontour as ac
from armcontour.core.errors import NotRealizable
from armcontour.core.frames import from_rpy
from armcontour.files import parse_job
from armcontour.jobs import Experiment, Rounding, build_plant, prepare_program, round_program, run
from armcontour.jobs.job import choose_run
from armcontour.jobs.plan_quantities import angular_speed, planned_torques
from armcontour.planning.tracing.tracer import trace_all


@pytest.fixture(scope="module")
def job(arm, objective, servo, limits):
    proposed = a_run(
        "proposed",
        timing=ac.Paper(knots=60),
        compensation=ac.PolePlacement(poles=[-100.0, -100.0, -100.0]),
        limits=limits,
        rounding=Rounding(tolerance=5e-3),
        end_time=6.0,
    )
    slow = limits.replace(speed=0.04)
    methods = {"timing": ac.Conventional(), "compensation": ac.NoCompensation()}
    plant = ac.ServoModel(kp=[24.0, 26.0], kv=150.0)
    runs = (proposed, a_run("conventional", **methods, limits=slow, cycle=1e-2))
    values = {"servo": servo, "plant_servo": plant, "runs": runs}
    return ac.Job(name="paper", title="The paper's job", arm=arm, path=objective, **values)


@pytest.fixture(scope="module")
def job_result(job):
    return ac.run(job)


def with_runs(job, *runs, **values):
    return dataclasses.replace(job, runs=runs, **values)


def changed(run, **values):
    return dataclasses.replace(run, **values)


def test_the_results_of_run_equal_those_of_its_single_steps(job, job_result):
    assert list(job_result.runs) == ["proposed", "conventional"] and job_result.job is job
    for job_run in job.runs:
        path = job.path
        result = job_result.runs[job_run.name]
        if job_run.rounding is not None:
            path = ac.round_corners(path, tolerance=5e-3, acceleration=0.09)
        trajectory = ac.plan(ac.trace(path, job.arm), job.arm, job_run.limits, job_run.timing)
        set_points = ac.compensate(trajectory, job.servo, job_run.compensation, cycle=job_run.cycle)
        execution = ac.simulate(set_points, ac.ServoPlant(job.arm, job.plant_servo, job_run.limits))
        evaluation_options = {
            "objective": job.path,
            "limits": job_run.limits,
            "end_time": job_run.end_time,
        }
        evaluation = ac.evaluate(execution, path, **evaluation_options)
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


def test_the_configuration_of_a_run_is_traced(job):
    other = with_runs(job, job.runs[1], configuration="negative")
    assert run(other, simulate=False).runs["conventional"].trajectory(0.0)[1] < 0


def test_an_experiment_executes_the_same_set_points_on_rigid_bodies(job):
    experiment_run = changed(job.runs[0], experiment=Experiment(step=5e-4))
    job_result = ac.run(with_runs(job, experiment_run, job.runs[1]))
    result = job_result.runs["proposed"]
    plant = ac.RigidBodyPlant(job.arm, job.plant_servo, experiment_run.limits, step=5e-4)
    execution = ac.simulate(result.set_points, plant)
    evaluation_options = {
        "objective": job.path,
        "limits": experiment_run.limits,
        "end_time": experiment_run.end_time,
    }
    evaluation = ac.evaluate(execution, result.path, **evaluation_options)
    np.testing.assert_array_equal(result.experiment.execution.q, execution.q)
    assert result.experiment.evaluation.contour_error.rms == evaluation.contour_error.rms
    assert result.evaluation.contour_error.rms != evaluation.contour_error.rms
    assert job_result.runs["conventional"].experiment is None


def test_the_robot_of_an_experiment_has_a_payload_unknown_to_its_controller():
    arm = ac.load_arm("ur5e")
    servo = ac.ServoModel(kp=25.0, kv=150.0)
    load = ac.Payload(mass=2.0)
    plant = build_plant(Experiment(payload=load), arm, servo, arm.limits, True)
    assert plant.chain.payload is load and plant.controller_chain is arm.chain
    np.testing.assert_array_equal(plant.chain.masses, arm.chain.masses)
    bare = ac.RigidBodyPlant(arm, servo)
    np.testing.assert_array_equal(plant.nominal_inertia, bare.nominal_inertia)
    # It replaces the payload that the controller knows, and leaves out what is not given.
    nominal = arm.with_tool(arm.chain.tool, ac.Payload(mass=3.0))
    none = Experiment(payload=ac.Payload(mass=0.0))
    empty = build_plant(none, nominal, servo, arm.limits, True)
    assert empty.chain.payload.mass == 0.0 and empty.controller_chain.payload.mass == 3.0
    rigid = build_plant(Experiment(), arm, servo, arm.limits, False)
    assert rigid.chain is arm.chain and Experiment().unknown == ""
    assert not rigid.gravity_feedforward


def test_invalid_jobs_runs_and_experiments_are_refused(job, in_space):
    first, second = job.runs
    fast = changed(first, limits=first.limits.replace(speed=np.inf))
    refused(
        (lambda: ac.run(with_runs(job, fast)), "paper needs an assigned velocity"),
        (lambda: Rounding(tolerance=5e-3, acceleration=0.0), "acceleration of a rounding", "zero"),
        (lambda: with_runs(job, first, first), "runs must differ in name"),
        (lambda: dataclasses.replace(in_space, seed=np.zeros(2)), "seed has 2 values"),
    )


def test_invalid_runs_are_refused_by_name_before_any_run_starts(job, in_space, monkeypatch):
    started = []

    def work(job, **values):
        return lambda: ac.run(dataclasses.replace(job, **values), progress=started.append)

    (only_run,) = in_space.runs
    jerky = only_run.limits.replace(joint_jerk=100.0).for_joints(6)
    by_mac = changed(only_run, name="two", limits=jerky, timing=ac.Paper())
    free = changed(only_run, limits=jerky, rounding=Rounding(shape="free", tolerance=1e-3))
    bodies = changed(job.runs[1], experiment=Experiment())
    lag = ac.ServoModel(kp=25.0, order="first")
    words = "Run conventional: experiment: "
    refused(
        (work(in_space, runs=(only_run, by_mac)), "Run two: The method paper", "joint_jerk"),
        (work(in_space, runs=(free,)), "shaped path"),
        (
            lambda: ac.certify(with_runs(in_space, free), goal=ac.CertificateGoal(tolerance=2e-3)),
            "shaped path",
        ),
        kind=NotRealizable,
    )
    refused((work(job, runs=(bodies,), plant_servo=lag), words, "rigid-body plant"))
    monkeypatch.setitem(sys.modules, "mujoco", None)
    refused((work(job, runs=(job.runs[0], bodies)), words, "armcontour[experiment]"))
    assert not started


def test_a_failed_experiment_does_not_affect_other_results(job, monkeypatch):
    def fails(*_, **__):
        raise ac.ExecutionError("Joint 1 does not rest.", joint=0)

    monkeypatch.setattr("armcontour.jobs.run_job.simulate_rigid_bodies", fails)
    experiment_run = changed(job.runs[0], experiment=Experiment())
    results = ac.run(with_runs(job, experiment_run, job.runs[1])).runs
    assert results["proposed"].experiment is None
    assert str(results["proposed"].failure) == "experiment: Joint 1 does not rest."
    assert results["proposed"].failure.joint == 0
    assert results["proposed"].evaluation.contour_error.rms > 0
    assert results["conventional"].failure is None


def test_warnings_name_demands_and_set_points_above_limits(job_result):
    result = job_result.runs["proposed"]
    # The gains of the plant differ, so the demand exceeds the limit by far.
    (overload,) = result.warnings
    assert "times its acceleration limit" in overload
    coarse = dataclasses.replace(result, run=changed(result.run, cycle=1.0))
    warning, same = coarse.warnings
    assert "cycle of 1 s" in warning and same == overload


@pytest.fixture(scope="module")
def in_space():
    """A short line of the UR5e, which plans quickly."""
    arm = ac.load_arm("ur5e")
    path = ac.Path.polyline([[0.4, 0.0, 0.2], [0.5, 0.05, 0.2]]).oriented([1.0, 0.0, 0.0, 0.0])
    line_run = a_run(compensation=ac.NoCompensation(), limits=arm.limits.replace(speed=0.25))
    servo = ac.ServoModel(kp=25.0, kv=150.0).for_joints(6)
    return ac.Job(name="line", title="A line", arm=arm, path=path, servo=servo, runs=(line_run,))


def test_runs_with_equal_planning_options_share_their_plan(in_space):
    (only_run,) = in_space.runs
    grid = ac.Optimal(intervals=100)
    others = {
        "slow": {"limits": only_run.limits.replace(speed=0.1)},
        "spared": {"timing": ac.Optimal(reserve=0.1)},
        "late": {"timing": ac.Optimal(duration=5.0)},
        "gridded": {"timing": grid},
    }
    again = changed(only_run, name="again", compensation=ac.PolePlacement())
    runs = (only_run, again, *(changed(only_run, name=k, **x) for k, x in others.items()))
    results = ac.run(with_runs(in_space, *runs)).runs
    assert results["again"].trajectory is results["one"].trajectory
    for name in others:
        assert results[name].trajectory is not results["one"].trajectory
    # Runs with the same joint path are traced once.
    assert results["again"].traced is results["one"].traced
    assert results["slow"].traced is not results["one"].traced


def test_configuration_seed_and_angular_tolerance_are_used(in_space):
    (only_run,) = in_space.runs
    assert in_space.plant_servo is in_space.servo  # default: the nominal servo
    trajectory = run(in_space, simulate=False).runs["one"].trajectory
    planned = ac.plan(in_space.path, in_space.arm, only_run.limits)
    np.testing.assert_array_equal(trajectory(0.0), planned(0.0))
    assert trajectory.duration == planned.duration
    others = trace_all(in_space.path, in_space.arm)
    other = next(x for x in others if np.abs(x(0.0) - trajectory(0.0)).max() > 0.5)
    seeded = dataclasses.replace(in_space, seed=other(0.0) + 0.01)
    np.testing.assert_allclose(
        run(seeded, simulate=False).runs["one"].trajectory(0.0), other(0.0), atol=1e-6
    )
    corner = ac.Path.polyline([[0.4, 0, 0.2], [0.5, 0, 0.2], [0.5, 0.1, 0.2]])
    turned = corner.oriented(from_rpy([[np.pi, 0, 0], [np.pi, 0, 0], [np.pi, 0, 0.5]]))
    only_run = changed(in_space.runs[0], rounding=Rounding(tolerance=1e-2, angular_tolerance=1e-3))
    bent = dataclasses.replace(in_space, path=turned)
    corners = round_program(bent, only_run, prepare_program(bent, only_run)).path.corners
    assert corners.angular_error[0] == pytest.approx(1e-3, rel=1e-6)
    assert corners.shrunk[0]


def test_reported_torques_and_angular_speed_are_those_of_the_arm(job, job_result, in_space):
    result = job_result.runs["proposed"]
    torques = planned_torques(result.arm, result.trajectory)
    plan = result.trajectory
    arm = job.arm
    t = 1.234
    torque_of_arm = [np.interp(t, torques.t, x) for x in torques.values.T]
    np.testing.assert_allclose(
        torque_of_arm, arm.torque(plan(t), plan(t, 1), plan(t, 2)), rtol=1e-3
    )
    states = ([plan(plan.breaks[1:-1], k, side=x) for k in range(3)] for x in ("left", "right"))
    both = [np.abs(arm.torque(*x)) for x in states]
    assert (torques.peak >= np.maximum(*both).max(axis=0)).all()
    arm = job.arm
    links = (job.arm.link1, job.arm.link2)
    bodiless = ac.PlanarTwoLink(name="bare", base=arm.base, links=links, limits=arm.limits)
    bare = with_runs(job, job.runs[1], arm=bodiless)
    result = ac.run(bare).runs["conventional"]
    assert planned_torques(result.arm, result.trajectory) is None
    assert angular_speed(result.execution) is None
    assert not bare.arm.has_bodies and result.evaluation.orientation_error is None
    turned = in_space.path.oriented(from_rpy([[np.pi, 0, 0], [np.pi, 0, 0.4]]))
    result = ac.run(dataclasses.replace(in_space, path=turned)).runs["one"]
    angle = trapezoid(angular_speed(result.execution), result.execution.t)
    assert angle == pytest.approx(0.4, rel=1e-3)


def test_a_run_is_chosen_by_its_name_and_the_only_run_by_default():
    job = parse_job(CORNER_JOB + "  other: {compensation: {method: none}}\n")
    only, other = job.runs
    assert choose_run(job, "other", "learned") is other
    assert choose_run(job, None, "learned", [only]) is only
    refused(
        (lambda: choose_run(job, None, "placed"), "be placed. Choose it with --run (only, o"),
        (lambda: choose_run(job, "cut", "placed"), "no run 'cut'", "only, other"),
    )


# A square of 40 mm near the base of the planar arm (reach 465 mm), and one far from it.
SQUARE = [[0, 0], [0.04, 0], [0.04, 0.04], [0, 0.04], [0, 0]]


def set_points(base, **changed):
    return run(parse_job(yaml.safe_dump(base | changed)), simulate=False).runs


def refusal(base, **changed):
    with pytest.raises(ac.Unreachable) as caught:
        set_points(base, **changed)
    return caught.value, str(caught.value)


def in_place(points, *position, **more):
    return {"points": points, "frame": {"position": [float(x) for x in position]}, **more}


def test_the_worst_point_is_reported_in_the_coordinates_of_the_drawing():
    error, message = refusal(PLANE, path=in_place(SQUARE, 0.6, 0.0, 0.0))
    # The corner that is farthest from the base, at (135, 0) mm, and nothing before it.
    far = np.hypot(0.64 - 0.135, 0.04)
    assert error.point == pytest.approx((0.64, 0.04)) and error.s == pytest.approx(0.08)
    assert error.needed == pytest.approx(far - 0.465) and error.limit == "reach"
    assert f"by up to {(far - 0.465) * 1e3:.3g} mm, most at (640, 40) mm" in message
    assert "which is (40, 40) mm before path.frame" in message


def test_a_contour_out_of_reach_is_refused_before_the_rapid_to_it():
    def approached(x, height):
        path = in_place([[*p, 0.0] for p in SQUARE], x, 0.0, 0.2, orientation={"axis": [0, 0, -1]})
        process = {"approach": height}
        return refusal(SPACE, path=path, process=process, corners="sharp", seed=None)

    error, message = approached(0.9, 0.3)
    assert "Run one: The path is out of reach" in message or "contour 1 is out" in message.lower()
    assert error.point[2] == pytest.approx(0.2)
    _, message = approached(0.45, 1.0)
    assert "Rapid to contour 1 is out of reach" in message and "Use a smaller approach" in message


def test_the_largest_error_among_very_many_contours_is_found():
    near, far = (ac.Path.polyline([(x, 0.2), (x + 0.01, 0.2)]) for x in (0.3, 0.8))
    moves = (*[ac.Contour(path=near)] * 299, ac.Contour(path=far), *[ac.Contour(path=near)] * 100)
    job = parse_job(yaml.safe_dump(PLANE | {"corners": "sharp"}))
    with pytest.raises(ac.Unreachable, match="Contour 300 is out of reach"):
        run(dataclasses.replace(job, path=ac.Program(moves=moves)), simulate=False)


def test_a_torque_limit_names_the_masses_that_it_uses():
    text = """
name: t
arm: ur5e
path: {orientation: {axis: [0, 0, -1]}, points: [[0.45, 0, 0.2], [0.6, 0, 0.2]]}
limits: {speed: 3 m/s, joint_acceleration: 100, joint_torque: TORQUE}
servo: {kp: 25 1/s, kv: 150 1/s}
runs:
  only: {compensation: {method: inverse}}
"""
    for torque, named in (("60", True), ("1000", False)):
        result = ac.run(parse_job(text.replace("TORQUE", torque))).runs["only"]
        assert named == any("masses of UR5e (source: " in x for x in result.remarks)
