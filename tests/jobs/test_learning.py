"""Learning of a job's run: on simulated robots, and what a study says of its runs."""

import dataclasses

import numpy as np
import pytest
from tests.corner_job import CORNER_JOB
from tests.geometry.tables import refused

import armcontour as ac
from armcontour.io import parse_job
from armcontour.jobs.learning import (
    LearningStudy,
    feeds_gravity_forward,
    learn_run,
    plan_run,
    simulate_learning,
)
from armcontour.jobs.unknown_robot import unknown_robot

EXPERIMENT = "experiment: {payload: {mass: 0.2 kg}, seed: 7, noise: 1e-5 rad}\n"


@pytest.fixture(scope="module")
def job():
    return parse_job(CORNER_JOB)


@pytest.fixture(scope="module")
def plan(job):
    return plan_run(job, None)


@pytest.fixture(scope="module")
def study(job, plan):
    robot, about = unknown_robot(job, plan)
    told = []
    found = simulate_learning(job, plan, robot, about, runs=1, progress=told.append)
    steps = [f"only: {x} {k}" for k in (1, 2) for x in ("run", "learning from run")]
    assert [str(x).removesuffix(" of 2") for x in told] == steps
    return found


def test_errors_are_those_of_links_or_of_encoders(job, plan, study):
    robot, _ = unknown_robot(job, plan)
    executed = ac.execute(plan.taught, robot(0))
    error = ac.evaluate(executed, plan.path, limits=plan.run.limits).contour_error
    assert study.errors(0) == (error.rms, error.max)
    assert study.profile(0).rms == error.rms
    assert study.errors(1)[0] < 0.2 * study.errors(0)[0]
    assert study.has_path and len(study.lesson.runs) == 2
    real = LearningStudy(job=job, plan=plan, lesson=study.lesson)
    run = study.lesson.runs[0]
    assert real.errors(0) == (run.contour_rms, run.contour_max)
    # Stiff links and little noise: encoders show what the tool does.
    assert real.profile(0).rms == pytest.approx(study.errors(0)[0], rel=0.02)
    assert not any("simulated" in x for x in real.notes)


def test_the_robot_of_the_job_is_taken_where_it_differs(job):
    given = parse_job(CORNER_JOB + EXPERIMENT)
    plan = plan_run(given, None)
    build, about = unknown_robot(given, plan)
    assert about == "a payload of 0.2 kg"
    robot = build(2)
    assert robot.seed == 9 and unknown_robot(given, plan, 3)[0](1).seed == 4
    assert robot.chain.payload.mass == 0.2 and robot.known_chain.payload is None
    np.testing.assert_array_equal(robot.servo.kp, given.servo.kp)
    plant = parse_job(CORNER_JOB + "plant: {kp: [25, 24]}\n")
    robot, about = unknown_robot(plant, plan_run(plant, None))
    assert about == "kp of the job's plant"
    np.testing.assert_array_equal(robot(0).servo.kp, [25, 24])


def test_the_assumed_robot(job, plan):
    build, about = unknown_robot(job, plan, 1)
    robot = build(0)
    off = robot.servo.kp / job.servo.kp - 1
    assert (np.abs(off) <= 0.05).all() and np.ptp(off) > 0
    np.testing.assert_array_equal(unknown_robot(job, plan, 1)[0](3).servo.kp, robot.servo.kp)
    assert unknown_robot(job, plan, 2)[1] != about
    chain = robot.chain
    assert chain.payload.mass == pytest.approx(0.1 * job.arm.chain.masses.sum(), rel=0.05)
    nominal = ac.RigidBodyPlant(job.arm, job.servo, plan.run.limits)
    assert (chain.coulomb <= 0.042 * nominal.torque_limit).all() and (chain.coulomb > 0).all()
    assert robot.noise == 1e-5
    np.testing.assert_array_equal(robot.nominal_inertia, nominal.nominal_inertia)
    bare = dataclasses.replace(job, arm=job.arm._copy(chain=None))
    refused((lambda: unknown_robot(bare, plan), "has no masses"))


def test_limits_that_are_exceeded_before_learning_are_not_kept_but_said(job, plan, study):
    assert not any("exceed limits" in x for x in dataclasses.replace(study, plan=plan).notes)
    rate = np.abs(np.diff(plan.taught.q, axis=0)).max(axis=0) / plan.taught.period
    trajectory = plan.trajectory.limited(plan.run.limits.replace(joint_velocity=0.9 * rate))
    taught = dataclasses.replace(plan.taught, trajectory=trajectory)
    slow = dataclasses.replace(plan, trajectory=trajectory, taught=taught)
    told = dataclasses.replace(study, plan=slow).notes
    assert sum("exceed limits of the joints already before learning" in x for x in told) == 1
    robot, _ = unknown_robot(job, plan)
    lesson = learn_run(job, slow, slow.taught, ac.execute(slow.taught, robot(0)))
    assert not lesson.finished


def test_gravity_is_fed_forward_as_the_compensation_says(plan):
    """A run without an experiment, as for a real robot, says so by its compensation alone."""
    for feeds in (True, False):
        options = {"gravity_feedforward": feeds}
        run = dataclasses.replace(plan.run, compensation_options=options, experiment=None)
        assert feeds_gravity_forward(run) is feeds
        assert feeds_gravity_forward(dataclasses.replace(run, compensation_options={}))
