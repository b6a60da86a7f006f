"""A study is the arrows one after the other, and nothing else."""

from __future__ import annotations

import dataclasses
import sys

import numpy as np
import pytest

import armcontour as ac
from armcontour.errors import Collision, CompensationError
from armcontour.frames import from_rpy, log
from armcontour.jobs import (
    STEPS,
    Experiment,
    Rounding,
    Run,
    build_plant,
    path_of,
    same_plan,
    steps_of,
    teach,
    warnings_of,
)
from armcontour.jobs.avoiding import Cleared
from armcontour.jobs.quantities import (
    angular_speed,
    planned_torques,
)
from armcontour.tracing.tracer import trace_all


@pytest.fixture(scope="module")
def job(arm, objective, servo, limits):
    proposed = Run(
        name="proposed",
        timing="mac",
        compensation="pole_placement",
        limits=limits,
        rounding=Rounding(tolerance=5e-3),
        period=4e-3,
        timing_options={"knots": 60},
        compensation_options={"poles": [-100.0, -100.0, -100.0]},
        until=6.0,
    )
    conventional = Run(
        name="conventional",
        timing="conventional",
        compensation="none",
        limits=limits.replace(speed=0.04),
        rounding=None,
        period=1e-2,
    )
    return ac.Job(
        name="paper",
        title="The paper's job",
        arm=arm,
        path=objective,
        servo=servo,
        plant_servo=ac.ServoModel(kp=[24.0, 26.0], kv=150.0),
        runs=(proposed, conventional),
    )


def by_hand(job, this):
    path = job.path
    if this.rounding is not None:
        path = ac.round_corners(path, tolerance=5e-3, acceleration=0.09)
    joint_path = ac.trace(path, job.arm)
    trajectory = ac.plan(
        joint_path, job.arm, this.limits, method=this.timing, **this.timing_options
    )
    taught = ac.compensate(
        trajectory,
        job.servo,
        method=this.compensation,
        period=this.period,
        **this.compensation_options,
    )
    execution = ac.execute(taught, ac.ServoPlant(job.arm, job.plant_servo, this.limits))
    evaluation = ac.evaluate(
        execution, path, objective=job.path, limits=this.limits, until=this.until
    )
    return path, trajectory, taught, execution, evaluation


def test_run_is_all_arrows_one_by_one(job):
    study = ac.run(job)
    assert list(study.runs) == ["proposed", "conventional"] and study.job is job
    for this in job.runs:
        found = study.runs[this.name]
        path, trajectory, taught, execution, evaluation = by_hand(job, this)
        assert found.run is this
        np.testing.assert_array_equal(found.path.path.breaks, path.breaks)
        assert found.trajectory.duration == trajectory.duration
        np.testing.assert_array_equal(found.taught.q, taught.q)
        np.testing.assert_array_equal(found.execution.q, execution.q)
        assert found.evaluation.contour_error.rms == evaluation.contour_error.rms
        assert found.evaluation.objective_error.max == evaluation.objective_error.max
        assert found.evaluation.corners == evaluation.corners
        assert found.evaluation.until == evaluation.until
        np.testing.assert_array_equal(found.evaluation.saturated, evaluation.saturated)


def test_what_flows_is_linked(job):
    found = ac.run(job).runs["proposed"]
    assert found.joint_path.tool_path is found.path.single_path
    assert found.path.path.objective is job.path is found.objective.path
    assert found.taught.trajectory is found.trajectory
    assert found.execution.taught is found.taught
    np.testing.assert_allclose(found.path.path.corners.speed, [0.03242, 0.03044], atol=1e-5)


def test_progress_is_told_before_every_step(job):
    told = []
    ac.run(job, progress=told.append)
    begun = [x for x in told if x.done is None]
    assert [x.names for x in begun] == [(x.name, step) for x in job.runs for step in STEPS]
    # The two runs trace and time one contour each.
    assert [x.done for x in told if x.done is not None] == [1.0] * 4


def test_the_studys_runs_cannot_be_changed(job):
    study = ac.run(dataclasses.replace(job, runs=job.runs[1:]))
    with pytest.raises(TypeError):
        study.runs["other"] = study.runs["conventional"]


def test_the_branch_reaches_the_tracer(job):
    other = dataclasses.replace(job, branch="negative", runs=job.runs[1:])
    assert (ac.run(other).runs["conventional"].trajectory(0.0)[1]) < 0


def test_a_run_that_fails_says_why(job, refuses):
    fast = dataclasses.replace(job.runs[0], limits=job.runs[0].limits.replace(speed=None))
    refuses(
        lambda: ac.run(dataclasses.replace(job, runs=(fast,))),
        ac.InvalidInput,
        "mac needs an assigned velocity",
    )


def test_a_rounding_of_the_run_is_not_silently_replaced(job, refuses):
    bad = dataclasses.replace(job.runs[0], rounding=Rounding(tolerance=5e-3, acceleration=0.0))
    refuses(
        lambda: ac.run(dataclasses.replace(job, runs=(bad,))),
        ac.InvalidInput,
        "corner acceleration must be above zero",
    )


def test_runs_of_the_same_name_are_refused(job, refuses):
    for runs in ((), (job.runs[0], job.runs[0])):
        refuses(
            lambda runs=runs: dataclasses.replace(job, runs=runs),
            ac.InvalidInput,
            "at least one run",
            "every run its own name",
        )


def test_an_experiment_is_the_same_set_points_on_rigid_bodies(job):
    settings = Experiment(noise=1e-6, seed=3)
    this = dataclasses.replace(job.runs[0], experiment=settings)
    told = []
    study = ac.run(
        dataclasses.replace(job, runs=(this, job.runs[1])),
        progress=told.append,
    )
    found = study.runs["proposed"]
    plant = ac.RigidBodyPlant(job.arm, job.plant_servo, this.limits, noise=1e-6, seed=3)
    execution = ac.execute(found.taught, plant)
    evaluation = ac.evaluate(
        execution, found.path, objective=job.path, limits=this.limits, until=this.until
    )
    assert found.experiment is not None
    np.testing.assert_array_equal(found.experiment.execution.q, execution.q)
    assert found.experiment.evaluation.contour_error.rms == evaluation.contour_error.rms
    assert found.evaluation.contour_error.rms != evaluation.contour_error.rms
    assert (found.experiment.plant.noise, found.experiment.plant.seed) == (1e-6, 3)
    assert study.runs["conventional"].experiment is None
    assert [x.names for x in told if x.done is None] == [
        *(("proposed", x) for x in STEPS),
        *(("conventional", x) for x in STEPS),
        # It goes on beside the other run.
        ("proposed", "experiment"),
    ]
    assert steps_of(this) == (*STEPS, "experiment")


UNKNOWN = Experiment(
    payload=ac.Payload(mass=2.0), armature=0.1, viscous=8.0, coulomb=[6, 6, 4, 1.5, 1.5, 1.5]
)


def test_the_robot_of_an_experiment_has_what_its_controller_does_not_know():
    arm, servo = ac.load_arm("ur5e"), ac.ServoModel(kp=25.0, kv=150.0)
    plant = build_plant(UNKNOWN, arm, servo)
    assert plant.chain.payload is UNKNOWN.payload and plant.known_chain is arm.chain
    assert (plant.chain.armature == 0.1).all() and (plant.chain.viscous == 8.0).all()
    np.testing.assert_array_equal(plant.chain.coulomb, UNKNOWN.coulomb)
    np.testing.assert_array_equal(plant.chain.masses, arm.chain.masses)
    bare = ac.RigidBodyPlant(arm, servo)
    np.testing.assert_array_equal(plant.nominal_inertia, bare.nominal_inertia)
    # It replaces the payload that the controller knows, and leaves out what is not given.
    told = arm.with_tool(arm.chain.tool, ac.Payload(mass=3.0))
    empty = build_plant(Experiment(payload=ac.Payload(mass=0.0)), told, servo)
    assert empty.chain.payload.mass == 0.0 and empty.known_chain.payload.mass == 3.0
    assert build_plant(Experiment(), arm, servo).chain is arm.chain
    assert Experiment().unknown == ""
    words = (
        "a payload of 2 kg; drive inertias of 0.1 kg m²; viscous friction of 8 N m s/rad; "
        "Coulomb friction of 6, 6, 4, 1.5, 1.5, 1.5 N m"
    )
    assert UNKNOWN.unknown == words == UNKNOWN.for_joints(6).unknown


def test_the_joints_of_an_experiment_can_be_springs():
    arm, servo = ac.load_arm("ur5e"), ac.ServoModel(kp=25.0, kv=150.0)
    springs = Experiment(armature=0.1, joint_stiffness=[2e4] * 3 + [1e4] * 3)
    plant = build_plant(springs, arm, servo)
    np.testing.assert_array_equal(plant.joint_stiffness, springs.joint_stiffness)
    np.testing.assert_allclose(plant.joint_damping, 1e-4 * plant.joint_stiffness)
    damped = build_plant(dataclasses.replace(springs, joint_damping=3.0), arm, servo)
    assert (damped.joint_damping == 3.0).all()
    assert springs.for_joints(6).unknown.endswith(
        "a stiffness of joints of 20000, 20000, 20000, 10000, 10000, 10000 N m/rad"
    )
    rigid = build_plant(Experiment(), arm, servo)
    assert rigid.joint_stiffness is None and rigid.joint_damping is None


def test_experiments_that_cannot_be_are_refused(refuses):
    def is_refused(words, dof=None, **options):
        make = lambda: Experiment(**options)  # noqa: E731
        refuses(make if dof is None else lambda: make().for_joints(dof), ac.InvalidInput, words)

    is_refused("coulomb must not be negative", coulomb=[1.0, -1.0])
    is_refused("armature must be numbers in kg m²", armature="heavy")
    is_refused("viscous must be finite", viscous=np.nan)
    is_refused("viscous has 2 values, but the arm has 6 joints", dof=6, viscous=[1.0, 2.0])
    is_refused("joint_stiffness must be above zero", joint_stiffness=[1e4, 0.0])
    is_refused("give their joint_stiffness too", joint_damping=1.0)
    is_refused("joint_damping must not be negative", joint_stiffness=1e4, joint_damping=-1.0)
    is_refused("friction (viscous or coulomb) and leaves it out", friction=False, coulomb=1.0)


def test_an_experiment_with_slow_drives_has_as_many_results_as_there_are(job):
    this = dataclasses.replace(job.runs[0], experiment=Experiment(step=2e-3))
    found = ac.run(dataclasses.replace(job, runs=(this,))).runs["proposed"]
    assert np.diff(found.experiment.execution.t).max() == pytest.approx(2e-3)


def test_an_experiment_that_does_not_rest_leaves_the_other_results(job, monkeypatch):
    def fails(*_, **__):
        raise ac.ExecutionError("Joint 1 does not rest.", joint=1)

    monkeypatch.setattr("armcontour.jobs.study.on_bodies", fails)
    this = dataclasses.replace(job.runs[0], experiment=Experiment())
    found = ac.run(dataclasses.replace(job, runs=(this, job.runs[1]))).runs
    assert found["proposed"].experiment is None
    assert str(found["proposed"].failure) == "experiment: Joint 1 does not rest."
    assert found["proposed"].failure.joint == 1
    assert found["proposed"].evaluation.contour_error.rms > 0
    assert found["conventional"].failure is None


def test_coarse_set_points_are_said(job):
    found = ac.run(job).runs["proposed"]
    # The plant's gains are others, so the demand is far above the limit.
    (overload,) = found.warnings
    assert "times its acceleration limit" in overload
    coarse = dataclasses.replace(found, run=dataclasses.replace(found.run, period=1.0))
    (warning, same) = coarse.warnings
    assert warning.startswith("Run proposed: the command interval of 1 s is more than a tenth")
    assert same == overload


def test_gains_that_are_probably_exchanged_are_said_once(job):
    weak = ac.ServoModel(kp=150.0, kv=25.0)
    (this,) = (x for x in job.runs if x.name == "proposed")
    runs = (
        this,
        dataclasses.replace(this, name="again", compensation="none", compensation_options={}),
    )
    found = ac.run(dataclasses.replace(job, servo=weak, runs=runs))
    said = [x for x in warnings_of(found.runs.values()) if "exchanged" in x]
    assert len(said) == 1
    assert said[0].startswith("Runs proposed, again: the servo has kp = 150 1/s and kv = 25 1/s")
    # A clock that no controller has, in a motion that is long beside it.
    slow = dataclasses.replace(runs[1], period=0.2)
    of_clock = ac.run(dataclasses.replace(job, runs=(slow,))).runs["again"].warnings
    assert any("0.2 s is longer than that of any controller" in x for x in of_clock)


def test_plans_are_the_same_where_runs_differ_only_behind_them(in_space):
    (this,) = in_space.runs
    again = dataclasses.replace(this, name="again", compensation="pole_placement")
    slow = dataclasses.replace(this, name="slow", limits=this.limits.replace(speed=0.1))
    spared = dataclasses.replace(this, name="spared", reserve=0.1)
    late = dataclasses.replace(this, name="late", duration=5.0)
    gridded = dataclasses.replace(
        this, name="gridded", timing_options={"grid": np.arange(0.0, 0.1, 0.01)}
    )
    runs = (this, again, slow, spared, late, gridded)
    found = ac.run(dataclasses.replace(in_space, runs=runs)).runs
    assert same_plan(found["one"], found["again"])
    assert found["again"].trajectory is found["one"].trajectory
    for name in ("slow", "spared", "late", "gridded"):
        assert not same_plan(found["one"], found[name])
        assert found[name].trajectory is not found["one"].trajectory


def test_an_experiment_that_cannot_be_says_so_with_its_run_before_any_work(job, refuses):
    told = []
    this = dataclasses.replace(job.runs[0], experiment=Experiment())
    lag = ac.ServoModel(kp=25.0, order="first")
    refuses(
        lambda: ac.run(
            dataclasses.replace(job, runs=(this,), plant_servo=lag), progress=told.append
        ),
        ac.InvalidInput,
        "Run proposed: experiment: The drives of the rigid-body plant",
    )
    assert told == []


@pytest.fixture(scope="module")
def in_space():
    """A line of the UR5e, as quick as it gets."""
    arm = ac.load_arm("ur5e")
    limits = arm.limits.replace(speed=0.25)
    path = ac.Path.polyline([[0.4, 0.0, 0.2], [0.5, 0.05, 0.2]]).oriented([1.0, 0.0, 0.0, 0.0])
    this = Run(
        name="one",
        timing="optimal",
        compensation="none",
        limits=limits,
        rounding=None,
        period=4e-3,
    )
    servo = ac.ServoModel(kp=25.0, kv=150.0).for_joints(6)
    return ac.Job(
        name="line",
        title="A line",
        arm=arm,
        path=path,
        servo=servo,
        runs=(this,),
    )


def test_the_configuration_is_the_fastest_or_the_one_that_is_asked_for(in_space):
    (this,) = in_space.runs
    assert in_space.plant_servo is in_space.servo  # the nominal one, as none is given
    found = ac.run(in_space).runs["one"].trajectory
    planned = ac.plan(in_space.path, in_space.arm, this.limits)
    np.testing.assert_array_equal(found(0.0), planned(0.0))
    assert found.duration == planned.duration
    others = trace_all(in_space.path, in_space.arm)
    other = next(x for x in others if np.abs(x(0.0) - found(0.0)).max() > 0.5)
    asked = dataclasses.replace(in_space, start=other(0.0) + 0.01)
    np.testing.assert_allclose(ac.run(asked).runs["one"].trajectory(0.0), other(0.0), atol=1e-6)


def test_runs_that_differ_behind_tracing_are_traced_once(in_space):
    (this,) = in_space.runs
    slow = dataclasses.replace(this, name="slow", limits=this.limits.replace(speed=0.1))
    again = dataclasses.replace(this, name="again", compensation="pole_placement")
    study = ac.run(dataclasses.replace(in_space, runs=(this, slow, again)))
    assert study.runs["again"].joint_path is study.runs["one"].joint_path
    assert study.runs["slow"].joint_path is not study.runs["one"].joint_path


def test_limits_of_jerk_are_refused_before_any_run_starts(in_space, refuses):
    (this,) = in_space.runs
    jerky = this.limits.replace(joint_jerk=100.0).for_joints(6)
    by_mac = dataclasses.replace(this, name="two", limits=jerky, timing="mac")
    started: list[object] = []
    refuses(
        lambda: ac.run(dataclasses.replace(in_space, runs=(this, by_mac)), progress=started.append),
        ac.NotRealizable,
        "Run two: The method mac keeps no limits of jerk, but there is joint_jerk",
        "timing: {method: optimal}",
        "limits: {joint_jerk: null}",
    )
    assert not started
    free = dataclasses.replace(this, limits=jerky, rounding=Rounding(shape="free", tolerance=1e-3))
    for work in (ac.run, lambda job: ac.certify(job, tolerance=2e-3)):
        refuses(
            lambda work=work: work(dataclasses.replace(in_space, runs=(free,))),
            ac.NotRealizable,
            "Along a shaped path accelerations jump",
            "corners: {shape: arc}",
        )


def test_a_start_for_another_arm_is_refused(in_space, refuses):
    refuses(
        lambda: dataclasses.replace(in_space, start=np.zeros(2)),
        ac.InvalidInput,
        "start has 2 values",
    )


def test_the_angular_tolerance_reaches_the_rounding(in_space):
    (this,) = in_space.runs
    turned = ac.Path.polyline([[0.4, 0, 0.2], [0.5, 0, 0.2], [0.5, 0.1, 0.2]]).oriented(
        from_rpy([[np.pi, 0, 0], [np.pi, 0, 0], [np.pi, 0, 0.5]])
    )
    rounding = Rounding(tolerance=1e-2, angular_tolerance=1e-3)
    job = dataclasses.replace(in_space, path=turned)
    corners = path_of(job, dataclasses.replace(this, rounding=rounding)).corners
    assert corners.angular_error[0] == pytest.approx(1e-3, rel=1e-6)
    assert corners.shrunk[0]


class TestQuantities:
    def test_planned_torques_are_the_arms_on_both_sides_of_jumps(self, job):
        found = ac.run(job).runs["proposed"]
        torques = planned_torques(found)
        assert torques is not None
        plan, arm = found.trajectory, job.arm
        t = 1.234
        np.testing.assert_allclose(
            [np.interp(t, torques.t, x) for x in torques.values.T],
            arm.torque(plan(t), plan(t, 1), plan(t, 2)),
            rtol=1e-3,
        )
        both = [
            np.abs(arm.torque(*(plan(plan.breaks[1:-1], k, side=x) for k in range(3))))
            for x in ("left", "right")
        ]
        assert (torques.peak >= np.maximum(*both).max(axis=0)).all()

    def test_no_bodies_no_torques(self, job):
        bodiless = ac.PlanarTwoLink(
            name="bare",
            base=job.arm.base,
            links=(job.arm.link1, job.arm.link2),
            limits=job.arm.limits,
        )
        bare = dataclasses.replace(job, runs=job.runs[1:], arm=bodiless)
        found = ac.run(bare).runs["conventional"]
        assert planned_torques(found) is None
        assert not bare.arm.has_bodies
        assert angular_speed(found.execution) is None
        assert found.evaluation.orientation_error is None

    def test_orientation_error_is_the_angle_to_what_is_asked_for(self, in_space):
        found = ac.run(in_space).runs["one"]
        right = found.evaluation.orientation_error
        tilted = in_space.path.oriented(from_rpy([np.pi - 0.1, 0.0, 0.2]))
        wrong = ac.evaluate(found.execution, tilted).orientation_error
        assert right.max < 1e-4
        turn = from_rpy([np.pi, 0, 0]).T @ from_rpy([np.pi - 0.1, 0.0, 0.2])
        np.testing.assert_allclose(wrong.values, np.linalg.norm(log(turn)), atol=2e-4)
        axis = in_space.path.oriented(from_rpy([np.pi - 0.1, 0.0, 0.2]), axis_only=True)
        free = ac.evaluate(found.execution, axis).orientation_error
        np.testing.assert_allclose(free.values, 0.1, atol=2e-4)

    def test_angular_speed_is_the_turning_of_the_tool(self, in_space):
        turned = in_space.path.oriented(from_rpy([[np.pi, 0, 0], [np.pi, 0, 0.4]]))
        found = ac.run(dataclasses.replace(in_space, path=turned)).runs["one"]
        rates = angular_speed(found.execution)
        angle = np.trapezoid(rates, found.execution.t)
        assert angle == pytest.approx(0.4, rel=1e-3)


def test_an_experiment_without_mujoco_is_refused_before_any_run_starts(job, refuses, monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    bodies = dataclasses.replace(job.runs[1], experiment=Experiment())
    started: list[object] = []
    refuses(
        lambda: ac.run(
            dataclasses.replace(job, runs=(job.runs[0], bodies)), progress=started.append
        ),
        ac.InvalidInput,
        f"Run {bodies.name}: experiment: ",
        "armcontour[experiment]",
    )
    assert not started


@pytest.mark.parametrize("long", [0.0, 60.0])
def test_set_points_are_those_of_the_plan_that_keeps_clear(job, monkeypatch, long):
    monkeypatch.setattr("armcontour.jobs.study.LONG", long)
    one = dataclasses.replace(job, runs=job.runs[1:])
    slow = one.runs[0].limits.replace(speed=0.02)
    slower = ac.plan(one.path, one.arm, slow, method="conventional")

    def keep_clear(job, this, traced, trajectory, progress):
        return Cleared(traced=traced, trajectory=slower, clearance=None)

    monkeypatch.setattr("armcontour.jobs.study.keep_clear", keep_clear)
    plan = teach(one)["conventional"]
    assert plan.trajectory is slower
    wanted = ac.compensate(slower, one.servo, method="none", period=1e-2, arm=one.arm)
    assert np.array_equal(plan.taught.q, wanted.q)


@pytest.mark.parametrize("long", [0.0, 60.0])
def test_a_collision_is_said_before_set_points_that_cannot_be(job, monkeypatch, refuses, long):
    monkeypatch.setattr("armcontour.jobs.study.LONG", long)

    def refuse(*_):
        raise Collision("It touches.")

    def fail(*_):
        raise CompensationError("It cannot be compensated.")

    monkeypatch.setattr("armcontour.jobs.study.teach_run", fail)
    refuses(lambda: teach(job), CompensationError, "It cannot be compensated")
    monkeypatch.setattr("armcontour.jobs.study.keep_clear", refuse)
    refuses(lambda: teach(job), Collision, "It touches")
