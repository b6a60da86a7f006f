"""Public functions for poses, Jacobians and inverse kinematics, against pinocchio."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.dynamics_extra import pinocchio, pinocchio_model

import armcontour as ac

NAMES = ac.arm_names()


def inside(arm, seed=0, count=4):
    """Random joint positions in the middle of the joint ranges, (count, dof)."""
    lower, upper = (np.clip(x, -2.5, 2.5) for x in arm.limits.joint_range(arm.dof))
    shares = np.random.default_rng(seed).uniform(0.2, 0.8, (count, arm.dof))
    return lower + shares * (upper - lower)


@pytest.mark.parametrize("name", NAMES)
def test_poses_and_jacobians_equal_those_of_pinocchio(name):
    pin = pinocchio()
    arm = ac.load_arm(name)
    model = pinocchio_model(arm.chain)
    model.armature = np.array(arm.chain.armature)
    data = model.createData()
    tool = model.getFrameId("tool")
    for q in inside(arm):
        pin.framesForwardKinematics(model, data, q)
        pose = arm.forward(q)
        np.testing.assert_allclose(pose, data.oMf[tool].homogeneous, atol=1e-12)
        np.testing.assert_array_equal(ac.Frame(data.oMf[tool]).position, data.oMf[tool].translation)
        np.testing.assert_array_equal(pose[: arm.dimension, 3], arm.tool_position(q))
        jacobian = pin.computeFrameJacobian(model, data, q, tool, pin.LOCAL_WORLD_ALIGNED)
        np.testing.assert_allclose(arm.jacobian(q), jacobian, atol=1e-12)
    assert arm.forward(inside(arm)).shape == (4, 4, 4)
    if arm.has_bodies:
        q, dq, ddq = inside(arm, 1, 3)
        torque = pin.rnea(model, data, q, dq, ddq) + arm.chain.viscous * dq
        np.testing.assert_allclose(
            torque + arm.chain.coulomb * np.sign(dq), arm.torque(q, dq, ddq), atol=1e-9
        )


@pytest.mark.parametrize("name", NAMES)
def test_the_inverse_returns_nearby_joint_positions(name):
    arm = ac.load_arm(name)
    lower, upper = arm.limits.joint_range(arm.dof)
    for q in inside(arm, 2):
        pose = arm.forward(q)
        near = arm.inverse(pose, near=q)
        np.testing.assert_allclose(near, q, atol=1e-7)
        every = arm.inverse(pose, near=q, all=True)
        np.testing.assert_allclose(every[0], q, atol=1e-7)
        assert (every >= lower).all() and (every <= upper).all() and len(every) > 1
        if arm.dimension == 3:
            np.testing.assert_allclose(
                arm.forward(every), np.tile(pose, (len(every), 1, 1)), atol=1e-7
            )
        points = arm.tool_position(every)
        np.testing.assert_allclose(
            points, np.tile(pose[: arm.dimension, 3], (len(every), 1)), atol=1e-7
        )
    # A row of poses: each solution starts from the one before it.
    row = inside(arm, 3, 1) + np.linspace(0, 0.3, 7)[:, None]
    positions = arm.inverse(arm.forward(row), near=row[0])
    assert positions.shape == row.shape and np.abs(np.diff(positions, axis=0)).max() < 0.5
    if arm.dof in (2, 6):
        np.testing.assert_allclose(positions, row, atol=1e-7)


def test_all_forms_of_a_pose_give_the_same_joint_positions(refuses):
    arm = ac.load_arm("ur5e")
    q = inside(arm, 4, 1)[0]
    pose = arm.forward(q)
    turned = Rotation.from_matrix(pose[:3, :3])
    point = pose[:3, 3]
    forms = [pose, pose.tolist(), SimpleNamespace(homogeneous=pose), ac.Frame(pose)]
    forms += [ac.Frame(point, turned), ac.Frame(point, turned.as_quat())]
    for form in forms:
        np.testing.assert_allclose(arm.inverse(form, q), q, atol=1e-9)
        tool = ac.load_arm("ur5e", tool=form).chain.tool
        np.testing.assert_allclose(tool.homogeneous, pose, atol=1e-12)
        np.testing.assert_allclose(arm.with_work(form).forward(q), np.eye(4), atol=1e-12)
    # A position alone leaves the rotation free; as a tool it is not turned.
    np.testing.assert_allclose(arm.tool_position(arm.inverse(point, near=q)), point, atol=1e-7)
    np.testing.assert_array_equal(
        ac.load_arm("ur5e", tool=(0, 0, 0.1)).chain.tool.rotation, np.eye(3)
    )
    scaled = 2 * np.eye(4)
    sheared = np.eye(4)
    sheared[0, 1] = 0.5
    for wrong in (scaled, sheared, [1.0, 2.0], "pose", None, np.full(3, np.nan)):
        refuses(lambda x=wrong: arm.inverse(x), ac.InvalidInput)
        refuses(lambda x=wrong: arm.with_tool(x), ac.InvalidInput)
    refuses(lambda: ac.Frame(pose, np.eye(3) @ pose[:3, :3]), ac.InvalidInput)
    refuses(lambda: arm.inverse(np.stack([pose, pose]), all=True), ac.InvalidInput)
    refuses(lambda: arm.inverse(pose, near=[0.0]), ac.InvalidInput)


def test_poses_out_of_reach_or_range_are_refused(refuses):
    arm = ac.load_arm("ur5e")
    planar = ac.load_arm("pmk3s")
    q = inside(arm, 5, 1)[0]
    near, far = arm.forward(q), arm.forward(q)
    far[:3, 3] += 2.0
    error = refuses(lambda: arm.inverse([near, far]), ac.Unreachable, index=1, limit="reach")
    assert error is None or error.needed > 1.0
    refuses(lambda: planar.inverse((2.0, 0.0)), ac.Unreachable, index=0, limit="reach")
    refuses(lambda: planar.inverse((0.35, 0.1, 0.2)), ac.InvalidInput)
    narrow = dict(joint_lower=q - 1e-3, joint_upper=q + 1e-3)
    held = arm.with_limits(arm.limits.replace(**narrow))
    np.testing.assert_allclose(held.inverse(near, all=True), q[None], atol=1e-9)
    turned = held.forward(q + 0.5)
    refuses(lambda: held.inverse(turned), ac.Unreachable, index=0, limit="range")


def test_the_nearest_of_two_turns_is_returned():
    arm = ac.load_arm("ur5e")
    q = inside(arm, 6, 1)[0]
    q[5] = 4.0
    np.testing.assert_allclose(arm.inverse(arm.forward(q), near=q), q, atol=1e-9)
    assert abs(arm.inverse(arm.forward(q))[5]) < np.pi
