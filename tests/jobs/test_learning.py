"""Learning of a job's run: errors, limits and gravity feed-forward."""

import dataclasses

import numpy as np
import pytest
from tests.corner_job import CORNER_JOB
from tests.loaded_robot import loaded_robot

import armcontour as ac
from armcontour.files import parse_job
from armcontour.jobs.run_learning import (
    LearnedRun,
    learn_logs,
    plan_run,
)


@pytest.fixture(scope="module")
def job():
    return parse_job(CORNER_JOB)


@pytest.fixture(scope="module")
def plan(job):
    return plan_run(job, None)


@pytest.fixture(scope="module")
def executed(job, plan):
    return ac.simulate(plan.set_points, loaded_robot(job, plan), resolution=1e-3)


@pytest.fixture(scope="module")
def job_result(job, plan, executed):
    lesson = learn_logs(job, plan, [executed])
    again = ac.simulate(lesson, loaded_robot(job, plan, 1), resolution=1e-3)
    lesson = learn_logs(job, plan, [again], set_points=lesson)
    return LearnedRun(job=job, plan=plan, lesson=lesson)


def test_errors_of_learning_are_computed_from_encoder_positions(job, plan, executed, job_result):
    run = job_result.lesson.runs[0]
    assert job_result.errors(0) == (run.contour_rms, run.contour_max)
    # Stiff links and little noise: encoders show what the tool does.
    error = ac.evaluate(executed, plan.path, limits=plan.run.limits).contour_error
    assert job_result.profile(0).rms == pytest.approx(error.rms, rel=0.02)
    assert job_result.errors(1)[0] < 0.2 * job_result.errors(0)[0]
    assert job_result.has_path and len(job_result.lesson.runs) == 2


def test_limits_exceeded_before_learning_are_reported(job, plan, job_result):
    assert not any("exceed limits" in x for x in dataclasses.replace(job_result, plan=plan).notes)
    rate = np.abs(np.diff(plan.set_points.q, axis=0)).max(axis=0) / plan.set_points.cycle
    trajectory = plan.trajectory.limited(plan.run.limits.replace(joint_velocity=0.9 * rate))
    set_points = dataclasses.replace(plan.set_points, trajectory=trajectory, rule=None)
    slow = dataclasses.replace(plan, trajectory=trajectory, set_points=set_points)
    notes = dataclasses.replace(job_result, plan=slow).notes
    assert sum("set-points before learning already exceed limits" in x for x in notes) == 1
    lesson = learn_logs(job, slow, [ac.simulate(slow.set_points, loaded_robot(job, plan))])
    assert not lesson.finished


def test_gravity_is_fed_forward_as_the_compensation_specifies(plan):
    """A run without an experiment, as for a real robot, says so by its compensation alone."""
    for feeds in (True, False):
        options = ac.InverseDynamics(gravity_feedforward=feeds)
        run = dataclasses.replace(plan.run, compensation=options, experiment=None)
        assert run.feeds_gravity_forward is feeds
        assert dataclasses.replace(run, compensation=ac.InverseDynamics()).feeds_gravity_forward
