"""Serial arms: derivatives by differences, frames, shapes, and refusals."""

import numpy as np
import pinocchio as pin
import pytest
from tests.geometry.tables import each, refused

import armcontour as ac
from armcontour.arms import Chain, Payload, SerialArm
from armcontour.frames import Frame, exp, log

STEP = 1e-6


def crooked(dof=6, seed=0):
    """An arm with nothing at right angles."""
    rng = np.random.default_rng(seed)
    axes = rng.normal(size=(dof, 3))
    spread = 0.3 * rng.normal(size=(dof, 3, 3))
    chain = Chain(
        joints=tuple(f"j{k}" for k in range(dof)),
        rotations=exp(rng.normal(size=(dof, 3))),
        positions=rng.normal(size=(dof, 3)),
        axes=axes / np.linalg.norm(axes, axis=1, keepdims=True),
        masses=rng.uniform(1, 2, dof),
        centers=rng.normal(size=(dof, 3)),
        inertias=spread @ np.swapaxes(spread, 1, 2) + np.eye(3),
        armature=rng.uniform(0, 1, dof),
        viscous=rng.uniform(0, 1, dof),
        coulomb=rng.uniform(0, 1, dof),
        base=Frame.rpy([0.1, 0.2, 0.3], [1.0, 2.0, 3.0]),
        tip=Frame.rpy([0.3, 0.1, 0.2], [0.3, 0.1, 0.2]),
        tool=Frame.rpy([0.1, 0.1, 0.4], [0.2, 0.5, 0.7]),
        gravity=[1.0, 2.0, -9.0],
    )
    return SerialArm(name="crooked", chain=chain, limits=ac.Limits(joint_velocity=1.0))


@pytest.fixture(params=["crooked", "ur5e", "panda"])
def arm3(request):
    return crooked() if request.param == "crooked" else ac.load_arm(request.param)


@pytest.fixture
def states(arm3):
    return np.random.default_rng(1).normal(size=(3, 200, arm3.dof))


def difference(function, q, dq):
    return (function(q + STEP * dq) - function(q - STEP * dq)) / (2 * STEP)


def test_the_jacobian_agrees_with_differences(arm3, states):
    q, dq, _ = states
    twist = arm3.tool_twist(q, dq)
    np.testing.assert_allclose(twist[:, :3], difference(arm3.forward, q, dq), atol=1e-8)
    before, after = arm3.pose(q - STEP * dq)[1], arm3.pose(q + STEP * dq)[1]
    turn = log(after @ np.swapaxes(before, 1, 2)) / (2 * STEP)
    np.testing.assert_allclose(twist[:, 3:], turn, atol=1e-8)
    np.testing.assert_array_equal(arm3.tool_velocity(q, dq), twist[:, :3])
    np.testing.assert_array_equal(arm3.jacobian(q), arm3.twist_jacobian(q)[:, :3])


def test_the_jacobians_rate_and_the_drift_agree_with_differences(arm3, states):
    q, dq, ddq = states
    rate = difference(arm3.twist_jacobian, q, dq)
    np.testing.assert_allclose(arm3.jacobian_rate(q, dq), rate[:, :3], atol=1e-7)
    drift = np.einsum("nij,nj->ni", rate, dq)
    np.testing.assert_allclose(arm3.twist_drift(q, dq), drift, atol=1e-7)
    found = arm3.tool_twist_rate(q, dq, ddq)
    np.testing.assert_allclose(found, drift + arm3.tool_twist(q, ddq), atol=1e-7)
    np.testing.assert_array_equal(arm3.tool_acceleration(q, dq, ddq), found[:, :3])
    exact = np.einsum("nij,nj->ni", arm3.jacobian_rate(q, dq), dq)
    np.testing.assert_allclose(exact, arm3.twist_drift(q, dq)[:, :3], atol=1e-12)


def exact_jerk(arm, states):
    """The third derivative of the product of all transformations, by Cauchy's integral."""
    chain, (q, dq, ddq, dddq) = arm.chain, states

    def point(t):
        angles = q + t * (dq + t * (ddq / 2 + t * dddq / 6))
        place, turn = chain.base.position + 0j, chain.base.rotation + 0j
        for k, (x, y, z) in enumerate(chain.axes):
            place, turn = place + turn @ chain.positions[k], turn @ chain.rotations[k]
            cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
            s, c = np.sin(angles[k]), np.cos(angles[k])
            turn = turn @ (np.eye(3) + s * cross + (1 - c) * cross @ cross)
        for x in (chain.tip, chain.tool):
            place, turn = place + turn @ x.position, turn @ x.rotation
        return place

    # Joint positions are whole functions of time, so the sum over a circle has all digits.
    around = 0.5 * np.exp(2j * np.pi * np.arange(64) / 64)
    return 6 * np.mean([point(t) / t**3 for t in around], axis=0).real


def test_the_tools_jerk_has_all_digits(arm3):
    states = np.random.default_rng(3).normal(size=(4, arm3.dof))
    found = arm3.tool_jerk(*states)
    exact = exact_jerk(arm3, states)
    np.testing.assert_allclose(found, exact, rtol=1e-12, atol=1e-12)
    # What an arm of a user's own has by itself.
    own = ac.Arm.tool_jerk(arm3, *states)
    size = np.abs(states[1]).sum() ** 3
    np.testing.assert_allclose(own, exact, atol=1e-12 * size)


def test_the_jerk_of_many_states_is_that_of_each(arm3):
    states = np.random.default_rng(4).normal(size=(4, 2, 3, arm3.dof))
    found = arm3.tool_jerk(*states)
    assert found.shape == (2, 3, 3)
    np.testing.assert_array_equal(found[1, 2], arm3.tool_jerk(*states[:, 1, 2]))
    # At rest there is no way to go along.
    q, rest, _, dddq = states
    found = ac.Arm.tool_jerk(arm3, q, rest * 0, rest * 0, dddq)
    np.testing.assert_allclose(found, arm3.tool_velocity(q, dddq), atol=1e-12)


@each("n", [0, 1, 31, 33])
def test_blocks_of_states_end_anywhere(arm3, n):
    q, dq, ddq, dddq = states = np.random.default_rng(n).normal(size=(4, n, arm3.dof))
    twist, bend = arm3.tool_twist(q, dq), arm3.tool_twist_rate(q, dq, ddq)
    # The Jacobian and its rate are computed by other code.
    expected = np.einsum("nij,nj->ni", arm3.twist_jacobian(q), dq)
    np.testing.assert_allclose(twist, expected, rtol=0, atol=1e-13 * arm3.dof)
    rate = arm3.jacobian_rate(q, dq)
    expected = arm3.tool_velocity(q, ddq) + np.einsum("nij,nj->ni", rate, dq)
    np.testing.assert_allclose(bend[:, :3], expected, rtol=0, atol=1e-12 * arm3.dof)
    velocity, acceleration = arm3.tool_motion(q, dq, ddq)
    np.testing.assert_array_equal(velocity, twist[:, :3])
    np.testing.assert_array_equal(acceleration, bend[:, :3])
    states.flags.writeable = False
    points, jerk = arm3.forward(states[0]), arm3.tool_jerk(*states)
    for k in range(n):
        one = states[:, k]
        np.testing.assert_allclose(arm3.forward(one[0]), points[k], atol=1e-14)
        np.testing.assert_allclose(arm3.tool_jerk(*one), jerk[k], atol=1e-12)


def test_pinocchio_sees_the_same_arm():
    arm = crooked()
    chain, model, joint = arm.chain, pin.Model(), 0
    for k, name in enumerate(chain.joints):
        turning = pin.JointModelRevoluteUnaligned(np.array(chain.axes[k]))
        place = pin.SE3(np.array(chain.rotations[k]), np.array(chain.positions[k]))
        joint = model.addJoint(joint, turning, place, name)
    end = chain.tip @ chain.tool
    place = pin.SE3(end.rotation, end.position)
    frame = model.addFrame(pin.Frame("tool", joint, 0, place, pin.FrameType.OP_FRAME))
    data, base = model.createData(), chain.base
    turn = np.kron(np.eye(2), base.rotation)
    for q in np.random.default_rng(2).normal(size=(50, arm.dof)):
        seen = pin.computeFrameJacobian(model, data, q, frame, pin.LOCAL_WORLD_ALIGNED)
        pin.framesForwardKinematics(model, data, q)
        place = data.oMf[frame]
        point, rotation = arm.pose(q)
        expected = base.position + base.rotation @ place.translation
        np.testing.assert_allclose(point, expected, atol=1e-12)
        np.testing.assert_allclose(rotation, base.rotation @ place.rotation, atol=1e-12)
        np.testing.assert_allclose(arm.twist_jacobian(q), turn @ seen, atol=1e-12)


def test_the_work_frame_and_the_tool_only_say_where_from_and_where_to(arm3, states):
    q, dq, ddq = states
    work, tool = Frame.rpy([1, 2, 3], [0.3, 0.2, 0.1]), Frame.rpy([0.1, 0, 0.2], [0, 0.5, 0])
    moved = arm3.with_work(work)
    bare = arm3.with_work(Frame())
    points, rotations = bare.pose(q)
    seen, turned = moved.pose(q)
    np.testing.assert_allclose(work.position + seen @ work.rotation.T, points, atol=1e-12)
    np.testing.assert_allclose(work.rotation @ turned, rotations, atol=1e-12)
    equipped = bare.with_tool(tool)
    flange = bare.with_tool(Frame())
    at, axes = flange.pose(q)
    np.testing.assert_allclose(equipped.forward(q), at + axes @ tool.position, atol=1e-12)
    np.testing.assert_allclose(equipped.pose(q)[1], axes @ tool.rotation, atol=1e-12)
    # Nor do torques know of either.
    expected = arm3.torque(q, dq, ddq)
    np.testing.assert_allclose(moved.torque(q, dq, ddq), expected, rtol=1e-12)
    np.testing.assert_allclose(equipped.torque(q, dq, ddq), expected, rtol=1e-12)


def test_a_new_tool_keeps_the_payload_unless_it_brings_one():
    load = Payload(mass=1.0)
    arm = crooked().with_tool(Frame(), load)
    assert arm.chain.payload is load
    assert arm.with_tool(Frame.rpy([0, 0, 1], [0, 0, 0])).chain.payload is load
    assert arm.with_tool(Frame(), Payload(mass=2.0)).chain.payload.mass == 2.0


def test_links_lead_from_the_base_to_the_tool(arm3, states):
    q = states[0]
    points = arm3.links(q)
    assert points.shape == (200, arm3.dof + 3, 3)
    np.testing.assert_allclose(points[:, 0], np.tile(arm3.chain.base.position, (200, 1)))
    np.testing.assert_allclose(points[:, -2], arm3.with_tool(Frame()).forward(q), atol=1e-12)
    np.testing.assert_array_equal(points[:, -1], arm3.forward(q))
    lengths = np.linalg.norm(np.diff(points, axis=1), axis=2)
    np.testing.assert_allclose(lengths, np.tile(lengths[0], (200, 1)), atol=1e-12)
    np.testing.assert_allclose(
        lengths[0, :-2], np.linalg.norm(arm3.chain.positions, axis=1), atol=1e-12
    )


def test_one_state_and_any_shape_of_states():
    arm = crooked(dof=4)
    q = np.random.default_rng(3).normal(size=(2, 5, 4))
    for method, count, shape in (
        (arm.forward, 1, (3,)),
        (lambda x: arm.pose(x)[1], 1, (3, 3)),
        (arm.links, 1, (7, 3)),
        (arm.jacobian, 1, (3, 4)),
        (arm.twist_jacobian, 1, (6, 4)),
        (arm.jacobian_rate, 2, (3, 4)),
        (arm.twist_drift, 2, (6,)),
        (arm.tool_twist, 2, (6,)),
        (arm.tool_twist_rate, 3, (6,)),
        (arm.torque, 3, (4,)),
        (arm.dynamics.mass_matrix, 1, (4, 4)),
        (lambda *x: arm.dynamics.path_terms(*x)[1], 3, (4,)),
    ):
        assert method(*[q[0, 0].tolist()] * count).shape == shape
        assert method(*[q[:0]] * count).shape == (0, 5, *shape)
        found = method(*[q] * count)
        assert found.shape == (2, 5, *shape)
        np.testing.assert_allclose(found[1, 2], method(*[q[1, 2]] * count), atol=1e-12)


def test_what_an_arm_is_made_of_stays_as_it_is_and_states_have_to_fit():
    arm, states = crooked(), np.zeros((5, 7))
    assert (arm.dof, arm.dimension, arm.branches) == (6, 3, ())
    for array in arm.arrays:
        assert array.flags.c_contiguous
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0
    np.testing.assert_array_equal(arm.limits.joint_velocity, np.ones(6))
    q = np.zeros((2, 6))
    q.setflags(write=False)
    arm.forward(q)[0, 0] = 1.0  # results are the caller's own
    refused(
        (lambda: arm.forward(states), "crooked has 6 joints", "(5, 7)"),
        (lambda: arm.jacobian_rate(states[:, :6], states), "(5, 6), (5, 7)"),
        (lambda: arm.forward(1.0), "6 columns"),
        (lambda: arm.tool_twist(states[:, :6], states[:3, :6]), "fit together", "(3, 6)"),
    )
