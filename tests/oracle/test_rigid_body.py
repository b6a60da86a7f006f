"""Compare the rigid-body plant with pinocchio's equations of motion, integrated by SciPy."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from tests.dynamics_extra import pinocchio, pinocchio_model
from tests.simulation.test_rigid_body_plant import make_set_points

import armcontour as ac
from armcontour.core.frames import Frame, from_rpy
from armcontour.robot.bodies import Payload
from armcontour.robot.chain import Chain
from armcontour.robot.serial import SerialArm

pytest.importorskip("mujoco")
pin = pinocchio()

KP = np.array([20.0, 30.0, 40.0])  # 1/s
KV = np.array([120.0, 150.0, 90.0])  # 1/s


def skew_arm():
    """Three joints with skew axes, a payload, drives, and oblique gravity."""
    rng = np.random.default_rng(3)
    turned = from_rpy(rng.normal(size=(3, 3)))
    chain = Chain(
        joints=("a", "b", "c"),
        rotations=from_rpy(rng.normal(size=(3, 3))),
        positions=rng.normal(size=(3, 3)) * 0.3,
        axes=(axes := rng.normal(size=(3, 3))) / np.linalg.norm(axes, axis=1, keepdims=True),
        masses=[4.0, 3.0, 2.0],
        centers=rng.normal(size=(3, 3)) * 0.2,
        inertias=turned @ np.diag([0.03, 0.05, 0.06]) @ np.swapaxes(turned, 1, 2),
        armature=[0.2, 0.1, 0.05],
        viscous=[2.0, 1.0, 0.5],
        tip=Frame.rpy([0.1, 0.2, -0.1], [0.5, 0.6, 0.7]),
        gravity=np.array([3.0, -4.0, -8.0]),
        payload=Payload(mass=1.5, center=[0.1, 0.0, 0.05], inertia=np.diag([0.01, 0.02, 0.025])),
    )
    return SerialArm(name="skew", chain=chain, limits=ac.Limits())


def by_pinocchio(chain, inertia, q, step, cycle, limit):
    """States at the steps, integrated by DOP853 with constant torques during each step."""
    model = pinocchio_model(chain)
    data = model.createData()
    n = len(chain)

    def rate(t, x):
        q = x[:n]
        moving = x[n:]
        mass = np.triu(pin.crba(model, data, q))
        mass = mass + np.triu(mass, 1).T + np.diag(chain.armature)
        net_torque = torque - chain.viscous * moving - pin.nonLinearEffects(model, data, q, moving)
        return np.concatenate([moving, np.linalg.solve(mass, net_torque)])

    x = np.concatenate([q[0], np.zeros(n)])
    states = []
    steps = round(cycle / step)
    for k in range(len(q) - 1):
        for i in range(steps):
            states.append(x)
            target = q[k] + (q[k + 1] - q[k]) * i / steps
            torque = inertia * KV * (KP * (target - x[:n]) - x[n:])
            torque = torque + pin.computeGeneralizedGravity(model, data, x[:n])
            torque = np.clip(torque, -limit, limit)
            x = solve_ivp(rate, (0, step), x, method="DOP853", rtol=1e-12, atol=1e-14).y[:, -1]
    return np.array(states)


def error(step, limit):
    arm = skew_arm()
    cycle = 0.008
    t = np.arange(0, 0.4, cycle)[:, None]
    q = np.array([0.3, -0.4, 0.6]) + np.array([0.8, -1.1, 1.3]) * (1 - np.cos(5 * t))
    servo = ac.ServoModel(kp=KP, kv=KV)
    limits = ac.Limits.only(joint_torque=limit)
    plant = ac.RigidBodyPlant(arm, servo, limits, step=step)
    execution = ac.simulate(make_set_points(q, cycle), plant, resolution=step)
    expected = by_pinocchio(arm.chain, plant.nominal_inertia, q, step, cycle, limit)
    n = len(expected)
    assert np.abs(execution.dq).max() > 3 and (execution.saturated_time > 0.01).any()
    return np.abs(execution.q[:n] - expected[:, :3]).max()


def test_rigid_bodies_move_as_in_pinocchio():
    errors = [error(step, np.array([90.0, 60.0, 40.0])) for step in (8e-3, 4e-3, 2e-3)]
    # The remaining error is of fourth order in the step: 1e-14 rad at the standard step.
    assert errors[2] < 1e-10
    np.testing.assert_allclose(np.divide(errors[:-1], errors[1:]), 16, rtol=0.1)
