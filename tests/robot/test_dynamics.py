"""Torques: their parts along a path, the masses, friction, gravity, and refusals."""

import sys

import numpy as np
import pytest
from tests.dynamics_extra import pinocchio, pinocchio_model
from tests.geometry.tables import each, refused

import armcontour as ac
from armcontour.core.frames import Frame, exp
from armcontour.robot import Chain, Dynamics, Payload, PlanarTwoLink, SerialArm
from armcontour.robot.planar import LinkTube


def chain(**changes):
    data = {
        "joints": ("a", "b", "c"),
        "rotations": exp([[0.1, 0.2, 0.3], [1.0, 0.0, 0.5], [0.0, -1.0, 0.4]]),
        "positions": [[0, 0, 0.3], [0.1, 0.4, 0], [0.3, 0, 0.1]],
        "axes": [[0, 0, 1], [0, 0.6, 0.8], [1, 0, 0]],
        "masses": [4.0, 3.0, 2.0],
        "centers": [[0, 0.1, 0.1], [0.2, 0, 0], [0, 0, 0.1]],
        "inertias": [0.1 * np.eye(3), np.diag([0.1, 0.2, 0.15]), 0.01 * np.eye(3)],
        "armature": [0.5, 0.4, 0.3],
        "viscous": [0.1, 0.2, 0.0],
        "coulomb": [1.0, 0.0, 0.5],
        "tip": Frame.rpy([0, 0, 0.2], [0.4, 0, 0]),
    }
    return Chain(**(data | changes))


@pytest.fixture
def states():
    return np.random.default_rng(0).normal(size=(3, 100, 3))


def test_friction_adds_to_the_torque_of_drives(states):
    q, dq, ddq = states
    arm = SerialArm(name="three", chain=chain(), limits=ac.Limits())
    dq[0] = 0
    expected = [0.1, 0.2, 0.0] * dq + [1.0, 0.0, 0.5] * np.sign(dq)
    drive_torque = arm.torque(q, dq, ddq) - arm.dynamics.torque(q, dq, ddq)
    np.testing.assert_allclose(drive_torque, expected, atol=1e-12)
    assert (drive_torque[0] == 0).all()


def test_two_planar_links_have_the_torques_of_the_textbook():
    tubes = tuple(LinkTube(outer_diameter=0.08, wall=0.005, density=2700) for _ in range(2))
    links = {"base": 0.1, "links": (0.3, 0.2), "limits": ac.Limits()}
    arm = PlanarTwoLink(name="plane", **links, tubes=tubes, payload=Payload(mass=2.0))
    outer, inner = 0.04, 0.035
    lengths = np.array([0.3, 0.2])
    m1, m2 = m = 2700 * np.pi * (outer**2 - inner**2) * lengths
    i1, i2 = m * (3 * (outer**2 + inner**2) + lengths**2) / 12
    q, dq, ddq = np.random.default_rng(2).normal(size=(3, 40, 2))
    cos = np.cos(q[:, 1])
    sin = np.sin(q[:, 1])
    one = i1 + m1 * 0.15**2 + (m2 + 2) * 0.3**2
    two = i2 + m2 * 0.1**2 + 2 * 0.2**2
    both = 0.3 * (m2 * 0.1 + 2 * 0.2)
    first = (one + two + 2 * both * cos) * ddq[:, 0] + (two + both * cos) * ddq[:, 1]
    first -= both * sin * (2 * dq[:, 0] * dq[:, 1] + dq[:, 1] ** 2)
    second = (two + both * cos) * ddq[:, 0] + two * ddq[:, 1] + both * sin * dq[:, 0] ** 2
    expected = np.stack([first, second], axis=1)
    np.testing.assert_allclose(arm.torque(q, dq, ddq), expected, atol=1e-12)


def test_arms_without_masses_have_no_torques(monkeypatch, states):
    arm = PlanarTwoLink(name="bare", base=0.1, links=(0.3, 0.2), limits=ac.Limits())
    dynamics = Dynamics(chain())
    p = np.zeros((4, 2))
    q = np.zeros((4, 3))
    monkeypatch.setitem(sys.modules, "pinocchio", None)
    assert np.isfinite(dynamics.torque(*states)).all()
    refused(
        (lambda: arm.torque([0, 0], [0, 0], [0, 0]), "masses of the arm bare"),
        (lambda: Dynamics(arm.chain), "require the masses"),
        (lambda: dynamics.torque(p, p, p), "3 joints", "3 columns", "(4, 2)"),
        (lambda: dynamics.mass_matrix(p), "3 columns"),
        (lambda: dynamics.derivatives(q, q, p), "3 columns", "(4, 2)"),
    )


def random_chain(seed, dof):
    rng = np.random.default_rng(seed)
    axes = rng.normal(size=(dof, 3))
    # Axes along z, the other way round, and any.
    axes[rng.random(dof) < 0.3] = [0, 0, 1]
    axes[rng.random(dof) < 0.2] = [0, 0, -1]
    turns = exp(rng.normal(size=(dof + 1, 3)))
    moments = np.array([np.diag(x) for x in rng.uniform(0.1, 0.15, (dof + 1, 3))])
    inertias = turns @ moments @ np.swapaxes(turns, 1, 2)
    inertias = (inertias + np.swapaxes(inertias, 1, 2)) / 2
    return Chain(
        joints=tuple(f"joint {k}" for k in range(dof)),
        rotations=exp(rng.normal(size=(dof, 3))),
        positions=rng.normal(size=(dof, 3)),
        axes=axes / np.linalg.norm(axes, axis=1)[:, None],
        masses=rng.uniform(0, 5, dof),
        centers=rng.normal(size=(dof, 3)),
        inertias=inertias[:dof],
        armature=rng.uniform(0, 1, dof),
        tip=Frame(position=rng.normal(size=3), rotation=exp(rng.normal(size=3))),
        gravity=rng.normal(size=3) * 9.81,
        payload=Payload(mass=2.0, center=rng.normal(size=3), inertia=inertias[dof])
        if seed % 2
        else None,
    )


def by_pinocchio(bodies):
    """Torques with and without gravity, and mass matrices, of single states, without armature."""
    pin = pinocchio()
    model = pinocchio_model(bodies)
    still = model.copy()
    still.gravity.linear = np.zeros(3)
    data = model.createData()
    upper = np.triu_indices(len(bodies))

    def mass(q):
        matrix = np.array(pin.crba(model, data, q))
        matrix.T[upper] = matrix[upper]
        return matrix

    return (
        lambda *state: np.array([pin.rnea(model, data, *x) for x in zip(*state, strict=True)]),
        lambda *state: np.array([pin.rnea(still, data, *x) for x in zip(*state, strict=True)]),
        lambda q: np.array([mass(x) for x in q]),
    )


# Whole blocks of states, a part of one, one state alone.
@each(("dof", "n"), [(1, 64), (2, 33), (6, 95), (7, 1), (9, 20)])
@each("seed", [0, 1])
def test_torques_and_their_parts_equal_those_of_pinocchio(seed, dof, n):
    bodies = random_chain(10 * dof + seed, dof)
    rng = np.random.default_rng(seed)
    q, dq, ddq = rng.uniform(-7, 7, (3, n, dof))
    still = np.zeros_like(q)
    armature = bodies.armature
    dynamics = Dynamics(bodies)
    torque, weightless, mass = by_pinocchio(bodies)

    def same(actual, expected):
        np.testing.assert_allclose(actual, expected, rtol=0, atol=1e-12 * np.abs(expected).max())

    a, b, c = dynamics.path_terms(q, dq, ddq)
    same(a, weightless(q, still, dq) + armature * dq)
    same(b, weightless(q, dq, ddq) + armature * ddq)
    same(c, torque(q, still, still))
    same(dynamics.gravity(q), torque(q, still, still))
    same(dynamics.torque(q, dq, ddq), torque(q, dq, ddq) + armature * ddq)
    same(dynamics.mass_matrix(q), mass(q) + np.diag(armature))


@each("turns", [3, -1000, 100_000, 10**9])
def test_whole_turns_of_a_joint_do_not_change_torques(turns, states):
    q, dq, ddq = states
    dynamics = Dynamics(chain())
    # The position itself is rounded, by half of its last digit.
    rounding = np.spacing(7.0 * abs(turns)) + 1e-15
    torque = dynamics.torque(q + 2 * np.pi * turns, dq, ddq)
    expected = dynamics.torque(q, dq, ddq)
    np.testing.assert_allclose(torque, expected, rtol=0, atol=2e3 * rounding)
