"""Rigid bodies of cells with rails, positioners and sliding tables, simulated by MuJoCo."""

import numpy as np
import pytest

import armcontour as ac
from armcontour.files import parse_job
from armcontour.robot import Payload

pytest.importorskip("mujoco")
from armcontour.simulation import mujoco_model  # noqa: E402

CELL = """
name: seam
arm:
  name: ur10e
  work: {position: [0.9, 0, 0.5]}
  positioner:
    part: {mass: 3 kg, center: [0, 0, 50 mm]}
    axes:
      - {name: tilt, axis: [0, 1, 0], origin: [0.9, 0, 0.3], lower: -2, upper: 2, velocity: 1,
         acceleration: 2, mass: 30, inertia: [1, 0, 0, 1, 0, 1]}
      - {name: turn, axis: [0, 0, 1], origin: [0.9, 0, 0.4], velocity: 1, acceleration: 2,
         mass: 20, inertia: [0.5, 0, 0, 0.5, 0, 1]}
path: {points: [[0, -0.1, 0.1], [0, 0.1, 0.1]], orientation: {axis: [0, 0, -1]}}
limits: {speed: 50 mm/s}
servo: {kp: 25 1/s, kv: 150 1/s}
experiment: {}
runs: {w: {compensation: {method: inverse}}}
"""


def cell_arm():
    """An arm on a rail, over a slide, a tilting axis and a turntable."""
    usual = {"lower": -1.0, "upper": 1.0, "velocity": 1.0, "acceleration": 2.0, "mass": 20.0}
    axes = (
        ac.PositionerAxis(
            name="slide", axis=(0.6, 0, 0.8), origin=(0.9, 0, 0), prismatic=True, **usual
        ),
        ac.PositionerAxis(
            name="tilt",
            axis=(0, 1, 0),
            origin=(0.9, 0, 0.3),
            center=(0.8, 0.1, 0.2),
            inertia=np.diag([1.0, 2.0, 2.5]),
            **usual,
        ),
        ac.PositionerAxis(name="turn", axis=(0, 0, 1), origin=(0.9, 0, 0.4), **usual),
    )
    rail = ac.Rail(axis=(0, 1, 0), lower=-1, upper=1, velocity=1, acceleration=2, mass=50.0)
    part = Payload(mass=5.0, center=(0.1, 0.02, 0.1))
    arm = ac.load_arm("ur10e").with_rail(rail)
    arm = arm.with_positioner(ac.Positioner(axes=axes, part=part))
    arm = arm.with_work((0.9, 0.0, 0.5))
    return arm.with_dynamics(armature=np.linspace(0.1, 1.0, arm.dof))


def test_joints_of_the_model_are_those_of_the_chain():
    arm = cell_arm()
    model = mujoco_model.build_model(arm.chain, 1e-3, friction=True)
    assert mujoco_model.order_of(model).tolist() == [2, 1, 0, 3, 4, 5, 6, 7, 8, 9]
    q = np.random.default_rng(0).uniform(-0.8, 0.8, (5, arm.dof))
    # The recursive Newton-Euler algorithm of the package shares nothing with MuJoCo.
    expected = arm.dynamics.mass_matrix(q)
    np.testing.assert_allclose(mujoco_model.mass_matrices(model, q), expected, atol=1e-9)
    data = mujoco_model.import_mujoco().MjData(model)
    for x in q:
        weight = mujoco_model.gravity_torques(model, data, x)
        np.testing.assert_allclose(weight, arm.dynamics.gravity(x), atol=1e-9)


def test_experiment_beside_a_positioner():
    job = parse_job(CELL)
    result = ac.run(job).runs["w"]
    planned = result.trajectory
    q = result.execution.q
    t = result.execution.t
    inside = (t >= 0) & (t <= planned.duration)
    away = np.abs(q[inside] - planned(t[inside])).max(axis=0)
    assert away.max() < 2e-3
    # The turntable or the tilting axis may stay, but the arm moves.
    assert np.ptp(q[inside], axis=0).max() > 0.05
