"""A study is the arrows one after the other, and nothing else."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import armcontour as ac
from armcontour.study import STEPS, Rounding, Run


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
        np.testing.assert_array_equal(found.path.breaks, path.breaks)
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
    assert found.joint_path.tool_path is found.path
    assert found.path.objective is job.path
    assert found.taught.trajectory is found.trajectory
    assert found.execution.taught is found.taught
    np.testing.assert_allclose(found.path.corners.speed, [0.03242, 0.03044], atol=1e-5)


def test_progress_is_told_before_every_step(job):
    told = []
    ac.run(job, progress=lambda run, step: told.append((run, step)))
    assert told == [(x.name, step) for x in job.runs for step in STEPS]


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
