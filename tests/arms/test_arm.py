"""What holds of every arm: once made, it does not change, and other arms are made from it."""

import copy
import pickle
from dataclasses import FrozenInstanceError

import numpy as np
import pytest
from tests.geometry.tables import refused

import armcontour as ac


@pytest.fixture(params=["pmk3s", "ur5e"])
def made(request):
    return ac.load_arm(request.param)


def test_nothing_of_an_arm_can_be_set(made):
    said = f"of a {type(made).__name__} .*: with_limits, .*\\.$"
    for name in ("limits", "name", "chain", "limits_hint", "joint_names", "new"):
        before = getattr(made, name, None)
        with pytest.raises(FrozenInstanceError, match=f"^The {name} {said}"):
            setattr(made, name, None)
        with pytest.raises(FrozenInstanceError, match=f"^The {name} {said}"):
            delattr(made, name)
        assert getattr(made, name, None) is before


def test_another_arm_is_made_with_other_limits_and_another_name(made):
    limits, name = made.limits, made.name
    slow = made.with_limits(limits.replace(joint_velocity=0.5))
    other = slow.with_name("slow")
    assert type(other) is type(made) and other.name == "slow"
    np.testing.assert_array_equal(other.limits.joint_velocity, np.full(made.dof, 0.5))
    assert made.limits is limits and made.name == slow.name == name
    q = np.full(made.dof, 0.3)
    np.testing.assert_array_equal(other.forward(q), made.forward(q))
    for again in (other, copy.copy(other), copy.deepcopy(other), pickle.loads(pickle.dumps(other))):
        with pytest.raises(FrozenInstanceError):
            again.limits = limits
    # What is computed once and kept is no change, and other limits keep it.
    assert other.dynamics is other.dynamics
    assert made.with_limits(made.limits) is made
    dynamics = made.dynamics
    assert made.with_limits(made.limits.replace(joint_velocity=0.4)).dynamics is dynamics


class Slide(ac.Arm):
    """An arm of a user's own: one joint that turns a stick."""

    dimension = 2
    branches = ()

    def __init__(self, length, offsets):
        self.name, self.joint_names, self.source = "slide", ("a",), ""
        self.limits = ac.Limits(joint_acceleration=1.0).for_joints(1)
        self.length = length
        self.offsets = offsets

    def forward(self, q):
        angle = np.asarray(q)[..., 0]
        return self.length * np.stack([np.cos(angle), np.sin(angle)], axis=-1)

    def links(self, q):
        raise NotImplementedError

    jacobian = jacobian_rate = links


class Longer(Slide):
    """One whose constructor goes on after that of its base."""

    def __init__(self, length):
        super().__init__(length, np.arange(3.0))
        self.length = 2 * length


def test_a_users_own_arm_is_made_as_usual_and_stays_as_it_is():
    own = np.arange(2.0)
    stick, longer = Slide(1.0, own), Longer(1.0)
    assert longer.length == 2.0
    for arm in (stick, longer):
        with pytest.raises(FrozenInstanceError, match="The length of a"):
            arm.length = 3.0
        with pytest.raises(ValueError, match="read-only"):
            arm.offsets[0] = 5.0
    # The array that was given stays the user's.
    own[0] = 7.0
    assert stick.offsets[0] == 0.0
    assert longer.with_name("b").length == 2.0


def test_another_load_and_other_drives_change_the_torques_and_nothing_else(made):
    q = np.full((1, made.dof), 0.3)
    # Torques of the arm are computed before: the other arm must not have them.
    before = made.torque(q, 0 * q, q)
    load = ac.Payload(mass=2.0)
    other = made.with_dynamics(payload=load, armature=0.1, viscous=[1.0] * made.dof)
    assert other.chain.payload is load and type(other) is type(made)
    np.testing.assert_array_equal(other.forward(q), made.forward(q))
    np.testing.assert_array_equal(other.chain.coulomb, made.chain.coulomb)
    # Drives add their inertia and friction to their own joint alone.
    loaded = other.with_dynamics(armature=0.0, viscous=0.0)
    added = other.torque(q, q, q) - loaded.torque(q, q, q)
    np.testing.assert_allclose(added, 0.1 * q + q, rtol=1e-9)
    assert np.abs(loaded.torque(q, 0 * q, q) - before).max() > 1e-3
    np.testing.assert_array_equal(made.torque(q, 0 * q, q), before)
    assert made.with_dynamics() is made
    said = f"coulomb has 9 values, but the arm has {made.dof} joints"
    refused(
        (lambda: made.with_dynamics(coulomb=[1.0] * 9), said),
        (lambda: made.with_dynamics(viscous=-1.0), "viscous of a chain"),
    )
