"""How far limits are used: against motions of one joint, whose quantities are known."""

import numpy as np

import armcontour as ac
from armcontour.timing.limit_use import STILL, States, allowed, quantity, ratio

REACH = 0.250 + 0.215  # m, the PMK-3s stretched out
DQ, DDQ = np.array([2.0, -1.5, 0.0]), np.array([0.3, -4.0, 5.0])  # rad/s, rad/s²
DDDQ = np.array([7.0, 0.0, -3.0])  # rad/s³


def about_joint(arm, joint):
    """Only one joint moves; of the arm in the plane the elbow is straight."""
    rates = np.zeros((3, 3, arm.dof))
    rates[:, :, joint] = DQ, DDQ, DDDQ
    return States(arm, np.zeros((3, arm.dof)), *rates)


def test_a_tool_on_a_circle(arm):
    for name, expected in (
        ("speed", REACH * np.abs(DQ)),
        # At rest there is no direction for a part of the acceleration to be at right angles to.
        ("centripetal_acceleration", REACH * DQ**2),
        ("tool_acceleration", REACH * np.hypot(DDQ, DQ**2)),
        ("tool_jerk", REACH * np.hypot(DDDQ - DQ**3, 3 * DQ * DDQ)),
    ):
        found = quantity(name, about_joint(arm, 0))
        np.testing.assert_allclose(found, expected, rtol=1e-12, err_msg=name)
    states = about_joint(ac.load_arm("ur5e"), 5)
    for name, expected in (("angular_speed", DQ), ("angular_acceleration", DDQ)):
        np.testing.assert_allclose(quantity(name, states), np.abs(expected), rtol=1e-12)


def test_refusals(arm, refuses):
    states = about_joint(arm, 1)
    found = ratio("joint_jerk", ac.Limits(joint_jerk=[np.inf, 10.0]), states)
    np.testing.assert_allclose(found, [[0, 0.7], [0, 0], [0, 0.3]], rtol=1e-12)
    without = States(arm, states.q, states.dq, states.ddq)
    for name in ("joint_jerk", "tool_jerk"):
        refuses(lambda x=name: quantity(x, without), ac.InvalidInput, "states with dddq")
    for name in ("sped", "path_jerk", "joint_lower", "joint_deceleration"):
        refuses(lambda x=name: quantity(x, states), ac.InvalidInput, repr(name))
    refuses(lambda: quantity("angular_speed", states), ac.InvalidInput, "a point without")


def test_each_direction_is_compared_to_its_own_acceleration_if_it_is_limited(arm):
    limits = ac.Limits(joint_acceleration=5.0, joint_deceleration=2.0).for_joints(2)
    states = about_joint(arm, 1)
    found = ratio("joint_acceleration", limits, states)
    np.testing.assert_allclose(found, [[0, 0.06], [0, 2.0], [0, 1.0]], rtol=1e-12)
    np.testing.assert_array_equal(allowed("joint_acceleration", limits, states)[1], [5.0, -2.0])
    states = about_joint(arm, 0)
    for name in ("joint_velocity", "joint_acceleration", "speed"):
        assert not ratio(name, ac.Limits(), states).any()


def test_dry_friction_at_rest_is_the_one_that_helps(arm):
    rough = arm.with_dynamics(coulomb=[3.0, 0.5])
    still, slow = np.zeros((1, 2)), np.full((1, 2), 1.01 * STILL)
    q, ddq = np.zeros((1, 2)), np.array([[10.0, -10.0]])
    without = np.abs(arm.torque(q, still, ddq))
    helped = np.maximum(without - [3.0, 0.5], 0.0)
    for dq in (still, STILL * np.ones((1, 2)), -STILL * np.ones((1, 2))):
        found = quantity("joint_torque", States(rough, q, dq, ddq))
        np.testing.assert_allclose(found, helped, atol=1e-6)
    found = quantity("joint_torque", States(rough, q, slow, ddq))
    np.testing.assert_allclose(found, np.abs(rough.torque(q, slow, ddq)), rtol=1e-12)
