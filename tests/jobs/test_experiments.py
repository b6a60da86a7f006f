"""Experiments of runs: the same set-points, executed on rigid bodies."""

import dataclasses

import numpy as np

import armcontour as ac
from armcontour.jobs import Experiment, build_plant


def with_experiment(job, experiment):
    """Return the job with an experiment in its first run."""
    first, *others = job.runs
    return dataclasses.replace(
        job, runs=(dataclasses.replace(first, experiment=experiment), *others)
    )


def test_experiment_executes_the_run_s_set_points_on_rigid_bodies(paper_job):
    job = with_experiment(paper_job, Experiment(step=5e-4))
    results = ac.run(job).runs
    result = results["proposed"]
    limits = job.runs[0].limits
    plant = ac.RigidBodyPlant(job.arm, job.plant_servo, limits, step=5e-4)
    execution = ac.simulate(result.set_points, plant)
    evaluation = ac.evaluate(
        execution, result.path, objective=job.path, limits=limits, end_time=job.runs[0].end_time
    )
    np.testing.assert_array_equal(result.experiment.execution.q, execution.q)
    assert result.experiment.evaluation.contour_error.rms == evaluation.contour_error.rms
    # The servo model without masses has another error.
    assert result.evaluation.contour_error.rms != evaluation.contour_error.rms
    assert results["conventional"].experiment is None


def test_failed_experiment_does_not_affect_other_results(paper_job, monkeypatch):
    def fail(*_, **__):
        raise ac.ExecutionError("Joint 1 does not rest.", joint=0)

    monkeypatch.setattr("armcontour.jobs.run_job.simulate_rigid_bodies", fail)
    results = ac.run(with_experiment(paper_job, Experiment())).runs
    failed = results["proposed"]
    assert failed.experiment is None
    assert str(failed.failure) == "experiment: Joint 1 does not rest."
    assert failed.failure.joint == 0
    assert failed.evaluation.contour_error.rms > 0
    assert results["conventional"].failure is None


SERVO = ac.ServoModel(kp=25.0, kv=150.0)


def test_experiment_has_a_payload_that_its_controller_does_not_know():
    arm = ac.load_arm("ur5e")
    payload = ac.Payload(mass=2.0)
    plant = build_plant(Experiment(payload=payload), arm, SERVO, arm.limits, True)
    assert plant.chain.payload is payload
    assert plant.controller_chain is arm.chain
    np.testing.assert_array_equal(plant.chain.masses, arm.chain.masses)
    without_payload = ac.RigidBodyPlant(arm, SERVO)
    np.testing.assert_array_equal(plant.nominal_inertia, without_payload.nominal_inertia)


def test_payload_of_an_experiment_replaces_the_one_that_the_controller_knows():
    arm = ac.load_arm("ur5e")
    loaded = arm.with_tool(arm.chain.tool, ac.Payload(mass=3.0))
    removed = Experiment(payload=ac.Payload(mass=0.0))
    plant = build_plant(removed, loaded, SERVO, arm.limits, True)
    assert plant.chain.payload.mass == 0.0
    assert plant.controller_chain.payload.mass == 3.0


def test_experiment_without_keys_moves_the_nominal_arm():
    arm = ac.load_arm("ur5e")
    plant = build_plant(Experiment(), arm, SERVO, arm.limits, False)
    assert plant.chain is arm.chain
    assert not plant.gravity_feedforward
    assert Experiment().unknown == ""
