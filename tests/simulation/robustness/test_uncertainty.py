"""Boxes of errors, and their spread on rigid bodies."""

import dataclasses
import pickle

import numpy as np
import pytest

import armcontour as ac
from armcontour.simulation.robustness import Uncertainty
from armcontour.simulation.robustness.rigid_body_runs import (
    BodyRuns,
    describe_errors,
    spread_on_bodies,
    trace_on_bodies,
)
from armcontour.simulation.robustness.uncertainty import Unknowns

SERVO = ac.ServoModel(kp=25.0, kv=150.0)
ALL = Uncertainty(
    gains=[[0.1], [0.05]],
    payload=[-0.2, 0.6],
    viscous=[2.0, 1.0],
    coulomb=0.5,
    friction=[0.0, 1.0],
    armature=0.2,
    dead_time=[1e-3, 2e-3],
    dead_time_shared=True,
)


def test_a_box_its_columns_and_their_ranges(planar):
    np.testing.assert_array_equal(Uncertainty(payload=0.4).payload, [-0.4, 0.4])
    np.testing.assert_array_equal(Uncertainty(payload=[0.0, 2.0]).payload, [0.0, 2.0])
    np.testing.assert_array_equal(Uncertainty().friction, [0.0, 1.0])
    assert Uncertainty().of_bodies == ()
    box = Uncertainty(viscous=1.0, armature=0.1, payload_known=True)
    assert box.of_bodies == ("viscous", "armature", "payload_known")
    arm, servo, _, _ = planar
    u = Unknowns.from_uncertainty(ALL, arm, servo)
    assert u.names[:4] == ("payload", "friction of joint 1", "friction of joint 2", "kp of joint 1")
    assert u.names[-1] == "dead time" and len(u) == 10
    corners = u.corners()
    assert len(np.unique(corners, axis=0)) == 2**10
    assert (corners.min(axis=0) == u.low).all() and (corners.max(axis=0) == u.high).all()
    drawn = u.draw(500, 1)
    assert ((u.low <= drawn) & (drawn <= u.high)).all()
    assert (np.ptp(drawn, axis=0) > 0.95 * (u.high - u.low)).all()
    shared = Unknowns.from_uncertainty(Uncertainty(viscous=1.0, friction_shared=True), arm, servo)
    assert shared.names == ("friction",)
    assert len(Unknowns.from_uncertainty(Uncertainty(), arm, servo)) == 0


def test_refusals(planar, refuses):
    for wrong in (
        *({"payload": x} for x in ([2.0, 0.0], [0.0, 1.0, 2.0], -1.0)),
        *({"gains": x} for x in (-0.1, 1.0)),
        {"friction": [1.0, 0.5]},
        {"viscous": -1.0},
        {"coulomb": [[1.0]]},
        {"armature": 1.0},
        {"dead_time": -1e-3},
    ):
        with pytest.raises(ac.InvalidInput):
            Uncertainty(**wrong)
    # Boxes that do not fit the arm or the servo.
    arm, servo, _, _ = planar
    first = ac.ServoModel(kp=25.0, order="first")
    for box, uncertain_arm, model, *words in (
        (Uncertainty(jitter=1e-3), arm, servo),
        (Uncertainty(gains=[0.1] * 3), arm, servo, "2 numbers (one per joint)"),
        (Uncertainty(dead_time=3e-3), arm, servo, "must not exceed the dead time"),
        (Uncertainty(payload=1.0), arm, servo, "0.5 kg"),
        (Uncertainty(viscous=1.0, friction=0.5), arm, servo),
        (Uncertainty(armature=0.1), ac.load_arm("pmk3s"), servo),
        (Uncertainty(), arm, first),
    ):
        refuses(
            lambda x=(box, uncertain_arm, model): Unknowns.from_uncertainty(*x),
            ac.InvalidInput,
            *words,
        )


def test_a_robot_has_its_errors(planar):
    arm, servo, _, _ = planar
    u = Unknowns.from_uncertainty(ALL, arm, servo)
    true, controller_arm, robot_servo = u.make_robot(u.high)
    for actual, expected in (
        (true.chain.payload.mass, 1.1),
        (true.chain.viscous, [2.0, 1.0]),
        (true.chain.coulomb, [0.5, 0.5]),
        (true.chain.armature, 0.06),
        (robot_servo.kp, 27.5),
        (robot_servo.kv, 157.5),
        (robot_servo.dead_time, [3e-3, 4e-3]),
    ):
        np.testing.assert_allclose(actual, expected)
    # The controller knows none of it, unless it weighs its payload.
    assert controller_arm is u.arm
    weighed = Unknowns.from_uncertainty(
        Uncertainty(payload=[0.0, 1.0], payload_known=True), arm, servo
    )
    assert weighed.make_robot(np.ones(1))[1].chain.payload.mass == pytest.approx(1.5)
    arm = ac.load_arm("ur5e").with_tool(ac.Frame(position=[0.0, 0.0, 0.12]))
    u = Unknowns.from_uncertainty(Uncertainty(payload=[0.0, 2.0]), arm, SERVO)
    load = u.make_robot(np.array([2.0]))[0].chain.payload
    assert load.mass == 2.0 and load.center[2] == 0.12
    assert u.make_robot(np.zeros(1))[0].chain.payload is None


LIMITS = ac.Limits.only(joint_torque=[40.0, 40.0])
# Drives with a long cycle, of which a run takes a moment.
COARSE = {"step": 1e-3}


@pytest.fixture(scope="module")
def runs(planar):
    arm, servo, path, set_points = planar
    u = Unknowns.from_uncertainty(
        Uncertainty(gains=[[0.05], [0.0]], payload=[0.0, 0.4], payload_known=True), arm, servo
    )
    return BodyRuns(set_points=set_points, path=path, unknowns=u, limits=LIMITS, options=COARSE)


def test_a_spread_is_what_the_plant_does(planar, runs):
    arm, servo, path, set_points = planar
    errors = np.array([[0.4, 0.05, -0.05]])
    sampled = spread_on_bodies(runs, errors)
    load = ac.Payload(mass=0.9, center=arm.chain.payload.center)
    true_arm = arm.with_dynamics(payload=load)
    plant = ac.RigidBodyPlant(true_arm, servo.replace(kp=[26.25, 23.75]), LIMITS, **COARSE)
    execution = ac.simulate(set_points, plant, resolution=1e-3)
    # A spread is of samples.
    result = ac.evaluate(dataclasses.replace(execution, plant=None), path)
    assert sampled.max[0] == pytest.approx(
        max(result.contour_error.max, result.coverage_error.max), rel=1e-9
    )
    errors_at_tool = path.project(execution.tool).distance
    assert sampled.rms[0] == pytest.approx(np.sqrt(np.mean(errors_at_tool**2)), rel=1e-9)
    assert sampled.worst_deviations == {
        "payload": 0.4,
        "kp of joint 1": 0.05,
        "kp of joint 2": -0.05,
    }
    assert sampled.payload[0] == 0.4 and (sampled.kp[0] == [26.25, 23.75]).all()
    assert 0 < sampled.nominal_max < sampled.max[0]
    # The same execution over time.
    ((t, errors_at_tool, tool),) = trace_on_bodies(runs, errors)
    assert (
        errors_at_tool.max() == sampled.max[0]
        and (tool == execution.tool).all()
        and (t == execution.t).all()
    )


def test_other_processes_find_the_same(runs, monkeypatch):
    """What is sent to them survives that."""
    errors = runs.unknowns.draw(4, 5)
    local = spread_on_bodies(runs, errors, seed=5, processes=1)

    def send(work, items, **_):
        return [pickle.loads(pickle.dumps(work))(x) for x in items]

    monkeypatch.setattr("armcontour.simulation.robustness.rigid_body_runs.map_in_processes", send)
    np.testing.assert_array_equal(local.max, spread_on_bodies(runs, errors).max)
    assert local.seed == 5 and len(local) == 4


def test_a_robot_that_cannot_be_controlled_is_named(planar, runs):
    arm, servo, path, set_points = planar
    wild = Unknowns.from_uncertainty(runs.unknowns.box, arm, servo.replace(kv=9e3))
    wrong = BodyRuns(set_points=set_points, path=path, unknowns=wild, limits=LIMITS, options={})
    with pytest.raises(ac.ExecutionError, match="robot with no errors failed: .*unstable"):
        spread_on_bodies(wrong, wild.high[None])
    assert describe_errors(wild, wild.high) == "payload +0.4 kg; kp +0.05"
