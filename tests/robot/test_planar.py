"""Planar arms compared with the paper's equations, and arms that users make."""

import copy
import pickle
from dataclasses import FrozenInstanceError
from functools import partial

import numpy as np
import pytest
from tests.geometry.tables import each, refused

import armcontour as ac
from armcontour.robot import SerialArm

# Base offset and lengths of both links [m], paper Sec. IV-A.
L0 = 0.135
L1 = 0.250
L2 = 0.215
# Edges of the reach: distances from the first joint [m].
NEAR = L1 - L2
FAR = L1 + L2
BRANCHES = {"positive": 1, "negative": -1}


def ring(distance, angle):
    return np.stack([L0 + distance * np.cos(angle), distance * np.sin(angle)], axis=1)


def random_points(n=400, margin=1e-3, seed=0):
    rng = np.random.default_rng(seed)
    distance = rng.uniform(NEAR + margin, FAR - margin, n)
    return ring(distance, rng.uniform(-np.pi, np.pi, n))


def random_joints(n=200, seed=1):
    """Joint positions away from the singular ones."""
    rng = np.random.default_rng(seed)
    q2 = rng.choice([-1, 1], n) * rng.uniform(0.2, np.pi - 0.2, n)
    return np.stack([rng.uniform(-3, 3, n), q2], axis=1)


def test_forward_kinematics_equal_equations_1_and_2(arm):
    q = random_joints(20)
    t1 = q[:, 0]
    t12 = q.sum(axis=1)
    x = L0 + L1 * np.sin(t1) + L2 * np.sin(t12)
    y = L1 * np.cos(t1) + L2 * np.cos(t12)
    np.testing.assert_allclose(arm.tool_position(q), np.stack([x, y], axis=1), atol=1e-15)
    # Angles are measured from y, clockwise.
    np.testing.assert_allclose(arm.tool_position([0, 0]), (L0, L1 + L2), atol=1e-15)
    np.testing.assert_allclose(arm.tool_position([np.pi / 2, 0]), (L0 + L1 + L2, 0), atol=1e-15)


@each("configuration", BRANCHES)
def test_forward_and_inverse_kinematics_are_inverse_to_each_other(arm, configuration):
    points = random_points()
    sign = BRANCHES[configuration]
    q = arm.joint_position(points, configuration)
    np.testing.assert_allclose(arm.tool_position(q), points, atol=2e-15)
    assert (np.sign(q[:, 1]) == sign).all()
    # Near the edges of the reach.
    for edge in (NEAR + 2e-9, NEAR + 1e-6, FAR - 1e-6, FAR - 2e-9):
        points = ring(edge, np.linspace(-3, 3, 50))
        np.testing.assert_allclose(
            arm.tool_position(arm.joint_position(points, configuration)), points, atol=1e-14
        )
    q = random_joints()
    q = q[np.sign(q[:, 1]) == sign]
    turns = (arm.joint_position(arm.tool_position(q), configuration) - q) / (2 * np.pi)
    np.testing.assert_allclose(turns, np.round(turns), atol=1e-13)
    np.testing.assert_array_equal(np.round(turns[:, 1]), 0)


def test_the_jacobian_its_rate_and_tool_motion_agree_with_differences(arm):
    q = random_joints()
    step = 1e-6
    for j, dq in enumerate(step * np.eye(2)):
        difference = (arm.tool_position(q + dq) - arm.tool_position(q - dq)) / (2 * step)
        np.testing.assert_allclose(arm.tool_jacobian(q)[..., j], difference, atol=1e-9)
    dq = np.random.default_rng(2).normal(size=q.shape)
    difference = (arm.tool_jacobian(q + step * dq) - arm.tool_jacobian(q - step * dq)) / (2 * step)
    np.testing.assert_allclose(arm.tool_jacobian_rate(q, dq), difference, atol=1e-8)

    def q(t):
        return np.stack([np.sin(t), 1 + 0.5 * np.cos(2 * t)], axis=-1)

    t = np.linspace(0, 3, 40)
    h = 1e-4
    dq = np.stack([np.cos(t), -np.sin(2 * t)], axis=-1)
    ddq = np.stack([-np.sin(t), -2 * np.cos(2 * t)], axis=-1)
    before, now, after = (arm.tool_position(q(t + k * h)) for k in (-1, 0, 1))
    velocity = (after - before) / (2 * h)
    acceleration = (after - 2 * now + before) / h**2
    v = arm.tool_velocity(q(t), dq)
    a = arm.tool_acceleration(q(t), dq, ddq)
    np.testing.assert_allclose(v, velocity, atol=1e-8)
    np.testing.assert_allclose(a, acceleration, atol=1e-6)
    np.testing.assert_allclose(arm.joint_velocity(q(t), v), dq, atol=1e-12)
    np.testing.assert_allclose(arm.joint_acceleration(q(t), dq, a), ddq, atol=1e-11)


OUT_OF_REACH = [
    ((0.700, 0.0), ("(0.7, 0) m", "0.1 m out of reach", "more than 0.465 m"), 0.565, FAR),
    ((0.145, 0.0), ("(0.145, 0) m", "0.025 m out of reach", "less than 0.035 m"), 0.01, NEAR),
    ((L0 + FAR, 0.0), ("on the edge of the reach", "singular"), FAR, FAR),
    ((L0, NEAR), ("on the edge of the reach", "singular"), NEAR, NEAR),
    ((L0, FAR - 1e-10), ("on the edge of the reach", "singular"), FAR, FAR),
    ((L0, 0.0), ("out of reach",), 0.0, NEAR),
]


@each("point, words, needed, allowed", OUT_OF_REACH)
def test_points_out_of_reach_are_refused_with_their_data(arm, point, words, needed, allowed):
    points = [(0.35, 0.1), (0.41, 0.15), point, (9.0, 9.0)]
    data = {"point": point, "index": 2, "needed": needed, "allowed": allowed}
    for configuration in BRANCHES:
        data["limit"] = "reach"
        solve = partial(arm.joint_position, points, configuration)
        refused((solve, "PMK-3s", *words, data), kind=ac.Unreachable)


def test_invalid_points_singular_arms_and_unknown_branches_are_refused(arm):
    refused(
        (lambda: arm.joint_position([(np.nan, 0.1)]), {"index": 0}),
        (lambda: arm.joint_velocity([[0.0, 0.0]], [[1.0, 0.0]]), "PMK-3s", "singular"),
        kind=ac.Unreachable,
    )
    refused((lambda: arm.joint_position([0.35, 0.1], "left"), "positive, negative", "'left'"))


def test_the_planar_arm_equals_its_model_in_space(arm):
    space = SerialArm(name="space", chain=arm.chain, limits=arm.limits)
    q, dq, ddq = np.random.default_rng(4).normal(size=(3, 50, 2))
    np.testing.assert_allclose(space.tool_position(q)[:, :2], arm.tool_position(q), atol=1e-15)
    assert (space.tool_position(q)[:, 2] == 0).all()
    np.testing.assert_allclose(space.tool_jacobian(q)[:, :2], arm.tool_jacobian(q), atol=1e-15)
    a, b = (x.tool_acceleration(q, dq, ddq)[:, :2] for x in (space, arm))
    np.testing.assert_allclose(a, b, atol=1e-13)


@pytest.fixture(params=["pmk3s", "ur5e"])
def made(request):
    return ac.load_arm(request.param)


def test_an_arm_with_other_limits_is_a_new_immutable_arm(made):
    limits = made.limits
    other = made.with_limits(limits.replace(joint_velocity=0.5))
    assert type(other) is type(made) and other.name == made.name
    np.testing.assert_array_equal(other.limits.joint_velocity, np.full(made.dof, 0.5))
    assert made.limits is limits
    q = np.full(made.dof, 0.3)
    np.testing.assert_array_equal(other.tool_position(q), made.tool_position(q))
    for again in (other, copy.copy(other), copy.deepcopy(other), pickle.loads(pickle.dumps(other))):
        with pytest.raises(FrozenInstanceError):
            again.limits = limits
    # What is computed once and kept is no change, and other limits keep it.
    assert other.dynamics is other.dynamics
    assert made.with_limits(made.limits) is made
    dynamics = made.dynamics
    assert made.with_limits(made.limits.replace(joint_velocity=0.4)).dynamics is dynamics


def test_payload_and_drives_change_only_the_torques(made):
    q = np.full((1, made.dof), 0.3)
    # Torques of the arm are computed before: the other arm must not have them.
    before = made.torque(q, 0 * q, q)
    load = ac.Payload(mass=2.0)
    other = made.with_dynamics(payload=load, armature=0.1, viscous=[1.0] * made.dof)
    assert other.chain.payload is load and type(other) is type(made)
    np.testing.assert_array_equal(other.tool_position(q), made.tool_position(q))
    np.testing.assert_array_equal(other.chain.coulomb, made.chain.coulomb)
    # Drives add their inertia and friction to their own joint alone.
    loaded = other.with_dynamics(armature=0.0, viscous=0.0)
    added = other.torque(q, q, q) - loaded.torque(q, q, q)
    np.testing.assert_allclose(added, 0.1 * q + q, rtol=1e-9)
    assert np.abs(loaded.torque(q, 0 * q, q) - before).max() > 1e-3
    np.testing.assert_array_equal(made.torque(q, 0 * q, q), before)
    assert made.with_dynamics() is made
    message = f"coulomb has 9 values, but the arm has {made.dof} joints"
    refused(
        (lambda: made.with_dynamics(coulomb=[1.0] * 9), message),
        (lambda: made.with_dynamics(viscous=-1.0), "viscous of a chain"),
    )
