"""The built-in arms against what their makers publish of them, by other formulas."""

from __future__ import annotations

from importlib import resources

import numpy as np
import pytest
import yaml

import armcontour as ac

# a [m], d [m], alpha [rad]: support article 45257 of Universal Robots, classic convention.
UR = {
    "ur5e": ([0, -0.425, -0.3922, 0, 0, 0], [0.1625, 0, 0, 0.1333, 0.0997, 0.0996]),
    "ur10e": ([0, -0.6127, -0.57155, 0, 0, 0], [0.1807, 0, 0, 0.17415, 0.11985, 0.11655]),
}
UR_TWIST = [np.pi / 2, 0, 0, np.pi / 2, -np.pi / 2, 0]
# FCI documentation of Franka Emika, control parameters; Craig's convention, and the flange.
PANDA = [
    (0, 0.333, 0), (0, 0, -np.pi / 2), (0, 0.316, np.pi / 2), (0.0825, 0, np.pi / 2),
    (-0.0825, 0.384, -np.pi / 2), (0, 0, np.pi / 2), (0.088, 0, np.pi / 2), (0, 0.107, 0),
]  # fmt: skip


def turn_z(angle, d):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, d], [0, 0, 0, 1]])


def turn_x(angle, a):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1, 0, 0, a], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1]])


def random_joints(dof):
    return np.random.default_rng(0).uniform(-np.pi, np.pi, (100, dof))


@pytest.mark.parametrize("name", UR)
def test_universal_robots_by_their_dh_parameters(name):
    arm = ac.load_arm(name)
    for q in random_joints(6):
        place = np.eye(4)
        for angle, a, d, alpha in zip(q, *UR[name], UR_TWIST, strict=True):
            place = place @ turn_z(angle, d) @ turn_x(alpha, a)
        point, rotation = arm.pose(q)
        np.testing.assert_allclose(point, place[:3, 3], atol=1e-12)
        np.testing.assert_allclose(rotation, place[:3, :3], atol=1e-12)


@pytest.mark.parametrize("name", ["panda", "fr3"])
def test_franka_arms_by_their_dh_parameters(name):
    arm = ac.load_arm(name)
    for q in random_joints(7):
        place = np.eye(4)
        for angle, (a, d, alpha) in zip([*q, 0], PANDA, strict=True):
            place = place @ turn_x(alpha, a) @ turn_z(angle, d)
        point, rotation = arm.pose(q)
        np.testing.assert_allclose(point, place[:3, 3], atol=1e-12)
        np.testing.assert_allclose(rotation, place[:3, :3], atol=1e-12)


def test_the_ur5e_stretched_out():
    # All joints at zero: the arm lies along -x, as the controller shows it.
    np.testing.assert_allclose(
        ac.load_arm("ur5e").forward(np.zeros(6)), [-0.8172, -0.2329, 0.0628], atol=1e-12
    )


@pytest.mark.parametrize("name", ac.arm_names())
def test_every_arm_can_be_planned_with(name):
    arm = ac.load_arm(name)
    assert arm.source and arm.chain.assumed
    assert arm.limits.joint_acceleration is not None and arm.limits_hint == ""
    assert arm.limits.joint_jerk is None  # for whoever asks for it
    if name != "pmk3s":  # the paper gives no others
        assert arm.limits.joint_torque is not None and arm.limits.joint_velocity is not None
        lower, upper = arm.limits.joint_range(arm.dof)
        # Torques to hold still are well within the drives' own, all over the range.
        q = lower + np.random.default_rng(1).random((2000, arm.dof)) * (upper - lower)
        hold = np.abs(arm.torque(q, 0 * q, 0 * q))
        assert (hold < 0.95 * arm.limits.joint_torque).all()
        assert (hold.max(axis=0)[1:3] > 0.1 * arm.limits.joint_torque[1:3]).any()


@pytest.mark.parametrize("name", ac.arm_names())
def test_every_number_has_a_unit_and_a_source(name):
    found = resources.files("armcontour.io.robots") / "library" / f"{name}.yaml"
    numbers = 0

    def look(data):
        nonlocal numbers
        if isinstance(data, dict) and "value" in data:
            assert data["unit"] and data["source"], data
            numbers += 1
        elif isinstance(data, dict):
            for inner in data.values():
                look(inner)
        else:
            assert not isinstance(data, int | float)

    look(yaml.safe_load(found.read_text("utf-8")))
    assert numbers >= 6
