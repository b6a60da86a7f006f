"""Robots of a box as rigid bodies, each as `RigidBodyPlant` and `evaluate` have it."""

import dataclasses
import pickle

import numpy as np
import pytest

import armcontour as ac
from armcontour.robustness import Box
from armcontour.robustness.bodies import BodyRuns, describe, spread_on_bodies
from armcontour.robustness.unknowns import Unknowns

LIMITS = ac.Limits(joint_torque=[40.0, 40.0])
# Drives with a long cycle, of which a run takes a moment.
COARSE = {"step": 1e-3}


@pytest.fixture(scope="module")
def runs(planar):
    arm, servo, path, taught = planar
    u = Unknowns.of(Box(gains=[[0.05], [0.0]], payload=[0.0, 0.4], payload_known=True), arm, servo)
    return BodyRuns(taught=taught, path=path, unknowns=u, limits=LIMITS, options=COARSE)


def test_a_spread_is_what_the_plant_does(planar, runs):
    arm, servo, path, taught = planar
    errors = np.array([[0.4, 0.05, -0.05]])
    found = spread_on_bodies(runs, errors)
    load = ac.Payload(mass=0.9, center=arm.chain.payload.center)
    known = arm.with_dynamics(payload=load)
    plant = ac.RigidBodyPlant(known, servo.replace(kp=[26.25, 23.75]), LIMITS, **COARSE)
    done = ac.execute(taught, plant, resolution=1e-3)
    # A spread is of samples.
    result = ac.evaluate(dataclasses.replace(done, plant=None), path)
    assert found.max[0] == pytest.approx(max(result.contour_error.max, result.missed.max), rel=1e-9)
    off = path.project(done.tool).distance
    assert found.rms[0] == pytest.approx(np.sqrt(np.mean(off**2)), rel=1e-9)
    assert found.worst_deviations == {"payload": 0.4, "kp of joint 1": 0.05, "kp of joint 2": -0.05}
    assert found.payload[0] == 0.4 and (found.kp[0] == [26.25, 23.75]).all()
    assert 0 < found.nominal_max < found.max[0]


def test_other_processes_find_the_same(runs, monkeypatch):
    """What is sent to them survives that."""
    errors = runs.unknowns.draw(4, 5)
    here = spread_on_bodies(runs, errors, seed=5, processes=1)

    def send(work, items, **_):
        return [pickle.loads(pickle.dumps(work))(x) for x in items]

    monkeypatch.setattr("armcontour.robustness.bodies.map_in_processes", send)
    np.testing.assert_array_equal(here.max, spread_on_bodies(runs, errors).max)
    assert here.seed == 5 and len(here) == 4


def test_a_robot_that_cannot_be_controlled_is_named(planar, runs):
    arm, servo, path, taught = planar
    wild = Unknowns.of(runs.unknowns.box, arm, servo.replace(kv=9e3))
    wrong = BodyRuns(taught=taught, path=path, unknowns=wild, limits=LIMITS, options={})
    with pytest.raises(ac.ExecutionError, match="The robot with no errors: .*unstable"):
        spread_on_bodies(wrong, wild.high[None])
    assert describe(wild, wild.high) == "payload +0.4 kg; kp +0.05"
