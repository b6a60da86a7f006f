"""Serial arms in space by differences and closed forms; chains, payloads and limits."""

import dataclasses
from functools import partial

import numpy as np
import pytest
from tests.geometry.tables import each, refused

import armcontour as ac
from armcontour.core.frames import Frame, exp, log
from armcontour.robot import Chain, Payload, SerialArm
from armcontour.robot.limits import UNITS, or_unlimited
from armcontour.robot.planar import LinkTube

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


def test_the_jacobian_its_rate_and_the_drift_agree_with_differences(arm3, states):
    q, dq, _ = states
    twist = arm3.tool_twist(q, dq)
    np.testing.assert_allclose(twist[:, :3], difference(arm3.tool_position, q, dq), atol=1e-8)
    before = arm3.pose(q - STEP * dq)[1]
    after = arm3.pose(q + STEP * dq)[1]
    turn = log(after @ np.swapaxes(before, 1, 2)) / (2 * STEP)
    np.testing.assert_allclose(twist[:, 3:], turn, atol=1e-8)
    np.testing.assert_array_equal(arm3.tool_velocity(q, dq), twist[:, :3])
    np.testing.assert_array_equal(arm3.tool_jacobian(q), arm3.jacobian(q)[:, :3])
    q, dq, ddq = states
    rate = difference(arm3.jacobian, q, dq)
    np.testing.assert_allclose(arm3.tool_jacobian_rate(q, dq), rate[:, :3], atol=1e-7)
    drift = np.einsum("nij,nj->ni", rate, dq)
    bias = arm3.tool_twist_rate(q, dq, np.zeros_like(q))
    np.testing.assert_allclose(bias, drift, atol=1e-7)
    twist_rate = arm3.tool_twist_rate(q, dq, ddq)
    np.testing.assert_allclose(twist_rate, drift + arm3.tool_twist(q, ddq), atol=1e-7)
    np.testing.assert_array_equal(arm3.tool_acceleration(q, dq, ddq), twist_rate[:, :3])
    exact = np.einsum("nij,nj->ni", arm3.tool_jacobian_rate(q, dq), dq)
    np.testing.assert_allclose(exact, bias[:, :3], atol=1e-12)


def test_work_frame_and_tool_change_only_the_ends_of_the_chain(arm3, states):
    q, dq, ddq = states
    work = Frame.rpy([1, 2, 3], [0.3, 0.2, 0.1])
    tool = Frame.rpy([0.1, 0, 0.2], [0, 0.5, 0])
    moved = arm3.with_work(work)
    bare = arm3.with_work(Frame())
    points, rotations = bare.pose(q)
    rotation, turned = moved.pose(q)
    np.testing.assert_allclose(work.position + rotation @ work.rotation.T, points, atol=1e-12)
    np.testing.assert_allclose(work.rotation @ turned, rotations, atol=1e-12)
    equipped = bare.with_tool(tool)
    flange = bare.with_tool(Frame())
    position, axes = flange.pose(q)
    np.testing.assert_allclose(
        equipped.tool_position(q), position + axes @ tool.position, atol=1e-12
    )
    np.testing.assert_allclose(equipped.pose(q)[1], axes @ tool.rotation, atol=1e-12)
    # Torques do not depend on either.
    expected = arm3.torque(q, dq, ddq)
    np.testing.assert_allclose(moved.torque(q, dq, ddq), expected, rtol=1e-12)
    np.testing.assert_allclose(equipped.torque(q, dq, ddq), expected, rtol=1e-12)


def test_methods_of_an_arm_accept_arrays_of_any_shape():
    arm = crooked(dof=4)
    q = np.random.default_rng(3).normal(size=(2, 5, 4))
    for method, count, shape in (
        (arm.tool_position, 1, (3,)),
        (lambda x: arm.pose(x)[1], 1, (3, 3)),
        (arm.links, 1, (7, 3)),
        (arm.tool_jacobian, 1, (3, 4)),
        (arm.jacobian, 1, (6, 4)),
        (arm.tool_jacobian_rate, 2, (3, 4)),
        (arm.tool_twist, 2, (6,)),
        (arm.tool_twist_rate, 3, (6,)),
        (arm.torque, 3, (4,)),
        (arm.dynamics.mass_matrix, 1, (4, 4)),
        (lambda *x: arm.dynamics.path_terms(*x)[1], 3, (4,)),
    ):
        assert method(*[q[0, 0].tolist()] * count).shape == shape
        assert method(*[q[:0]] * count).shape == (0, 5, *shape)
        values = method(*[q] * count)
        assert values.shape == (2, 5, *shape)
        np.testing.assert_allclose(values[1, 2], method(*[q[1, 2]] * count), atol=1e-12)


GOOD = {
    "joints": ("a", "b"),
    "rotations": np.tile(np.eye(3), (2, 1, 1)),
    "positions": np.zeros((2, 3)),
    "axes": [[0, 0, 1], [0, 1, 0]],
    "masses": [1.0, 2.0],
    "centers": np.zeros((2, 3)),
    "inertias": np.tile(np.eye(3), (2, 1, 1)),
}
PLANE = {"name": "a", "base": 0.1, "links": (0.2, 0.3), "limits": ac.Limits()}
TUBE = {"outer_diameter": 0.08, "wall": 0.01, "density": 2700}
ODD_LIMITS = (
    ({"joint_acceleration": 0.0}, "rad/s²", {"limit": "joint_acceleration"}),
    ({"joint_acceleration": [0.7, -0.1]}, "-0.1 rad", {"limit": "joint_acceleration"}),
    ({"joint_velocity": [[1.0, 1.0, 1.0]]}, "per joint", "(1, 3)", {"limit": "joint_velocity"}),
    ({"joint_velocity": [[0.5, 1.0]]}, "a lower bound below zero", {"limit": "joint_velocity"}),
    ({"joint_torque": [[-1.0, 1.0]]}, "one per joint", "(1, 2)", {"limit": "joint_torque"}),
    ({"joint_velocity": [1.0, np.nan]}, "joint_velocity", "finite", {"index": 1}),
    ({"speed": 0.0}, "speed", "0 m/s"),
    ({"speed": [0.1, 0.2]}, "speed", "one number"),
    ({"speed": -np.inf}, "speed", "finite"),
    ({"centripetal_acceleration": -1.0}, "centripetal_acceleration", "-1 m/s²"),
    ({"joint_lower": "wide"}, "joint_lower", "in rad"),
    ({"joint_lower": [np.nan, 1.0]}, "joint_lower", "finite"),
    ({"joint_lower": [[1.0]]}, "joint_lower", "one per joint"),
)
ODD_CHAINS = (
    ({"joints": ()}, "joints = 0"),
    ({"centers": None}, "requires centres of mass"),
    ({"positions": [0, 0, 0]}, "positions of a chain", "(joints, 3)"),
    ({"rotations": np.tile(2 * np.eye(3), (2, 1, 1))}, "rotations of a chain", "not a rotation"),
    ({"rotations": np.tile(-np.eye(3), (2, 1, 1))}, "rotations of a chain", "right-handed"),
    ({"gravity": [0, 0, np.inf]}, "gravity", "finite"),
    ({"axes": [[0, 0, 2], [0, 1, 0]]}, "unit vectors"),
    ({"armature": [-1, 0]}, "armature"),
    ({"masses": [1, -1]}, "link after b", "-1 kg"),
    ({"inertias": [np.eye(3), np.diag([1, 1, 3])]}, "link after b", "No body", "1, 1, 3"),
    ({"inertias": [np.triu(np.ones((3, 3))), np.eye(3)]}, "link after a", "symmetric"),
)
ODD_PAYLOADS = (
    ({"mass": -1.0}, "mass of a payload"),
    ({"center": [0, 0]}, "center of a payload", "(3,)"),
    ({"inertia": np.diag([1.0, 1.0, 3.0])}, "inertia of the payload", "No body"),
)
ODD_PLANES = (
    ({"base": np.nan}, "base", "finite"),
    ({"base": (1, 2)}, "base", "one number"),
    ({"links": (0.0, 0.3)}, "links must be above zero"),
    ({"links": (0.2, -0.3)}, "links", "-0.3 m"),
    ({"links": ("long", 0.3)}, "links", "quantity in m"),
    ({"limits": ac.Limits(joint_velocity=[1.0, 2.0, 3.0])}, "has 3 values", "2 joints"),
)
ODD_TUBES = (
    ({"outer_diameter": 0}, "outer_diameter"),
    ({"wall": 0.05}, "wall of a tube", "0.08 m", "0.05 m"),
    ({"density": np.nan}, "density"),
)


def test_invalid_limits_chains_payloads_and_arms_are_refused():
    assert ac.PlanarTwoLink(**PLANE).link2 == 0.3
    for kind, good, rows in (
        (ac.Limits, {}, ODD_LIMITS),
        (Chain, GOOD, ODD_CHAINS),
        (Payload, {"mass": 1.0}, ODD_PAYLOADS),
        (ac.PlanarTwoLink, PLANE, ODD_PLANES),
        (LinkTube, TUBE, ODD_TUBES),
    ):
        refused(*((partial(kind, **good | x), *more) for x, *more in rows))
    two = ac.Limits(joint_acceleration=[1.0, 1.0])
    jerk = ac.Limits(joint_jerk=[np.inf, 5.0])
    refused(
        (lambda: two.replace(sped=0.2), "Unknown limit 'sped'", "centripetal_acceleration"),
        (lambda: two.replace(speed=-1), "speed"),
        (lambda: two.for_joints(3), "joint_acceleration has 2 values", "3 joints"),
        (lambda: jerk.for_joints(3), "joint_jerk has 2 values", "3 joints"),
    )


def test_limits_are_replaced_added_removed_and_broadcast_to_joints():
    assert {*UNITS, "removed", "prismatic"} == {x.name for x in dataclasses.fields(ac.Limits)}
    values = np.array([1.0, 2.0])
    limits = ac.Limits(joint_acceleration=values, speed=0.1)
    values[0] = 9.0
    other = limits.replace(speed=0.2, centripetal_acceleration=0.5)
    assert (other.speed, other.centripetal_acceleration) == (0.2, 0.5)
    np.testing.assert_array_equal(other.joint_acceleration, [1.0, 2.0])
    assert limits.speed == 0.1 and limits.centripetal_acceleration is None
    for none, removed in ((None, set()), (np.inf, {"speed"})):
        assert other.replace(speed=none).speed is None
        assert other.replace(speed=none).removed == removed
    with pytest.raises(ValueError, match="read-only"):
        limits.joint_acceleration[0] = 9.0
    spread = ac.Limits(joint_acceleration=0.7, joint_velocity=[1.0, 2.0]).for_joints(2)
    np.testing.assert_array_equal(spread.joint_acceleration, [0.7, 0.7])
    np.testing.assert_array_equal(spread.joint_velocity, [1.0, 2.0])
    assert ac.Limits().for_joints(3).joint_acceleration is None
    # One pair is for all joints.
    pair = ac.Limits(joint_velocity=[[-1.0, 2.0]])
    for joint_limits in (pair, pair.for_joints(3)):
        np.testing.assert_array_equal(joint_limits.velocity_bounds(3), [[-1.0] * 3, [2.0] * 3])
    np.testing.assert_array_equal(or_unlimited(None, 2), [np.inf, np.inf])
    np.testing.assert_array_equal(or_unlimited([1.0, 2.0], 2), [1.0, 2.0])


def test_only_finite_jerk_limits_limit_the_jerk():
    for endless in (np.inf, [np.inf, np.inf]):
        limits = ac.Limits(joint_jerk=endless)
        assert not limits.limits_jerk and limits.removed == {"joint_jerk"}
        assert limits.for_joints(2).joint_jerk is None
    some = ac.Limits(joint_jerk=[np.inf, 5.0])
    assert some.limits_jerk and some.of_joints.limits_jerk and not some.of_tool.limits_jerk
    np.testing.assert_array_equal(some.for_joints(2).joint_jerk, [np.inf, 5.0])


def test_chains_have_defaults_and_equal_their_denavit_hartenberg_frames():
    chain = Chain(**GOOD)
    assert len(chain) == 2
    for name in ("armature", "viscous", "coulomb"):
        np.testing.assert_array_equal(getattr(chain, name), [0, 0])
    np.testing.assert_array_equal(chain.gravity, [0, 0, -9.81])
    with pytest.raises(ValueError, match="read-only"):
        chain.masses[0] = 3
    np.testing.assert_array_equal(chain.replace(masses=[3, 4]).masses, [3, 4])
    assert chain.replace(masses=None, centers=None, inertias=None).masses is None
    # As the page on arms makes it, against the product of the four elementary transforms.
    rng = np.random.default_rng(3)
    dh = rng.uniform(-1, 1, (6, 4))
    frames = []
    before = ac.Frame()
    for a, alpha, d, offset in dh:
        frames.append(before @ ac.Frame.rpy((0, 0, d), (0, 0, offset)))
        before = ac.Frame.rpy((a, 0, 0), (alpha, 0, 0))
    places = {"positions": [x.position for x in frames], "rotations": [x.rotation for x in frames]}
    chain = Chain(joints=tuple("abcdef"), **places, axes=[(0, 0, 1)] * 6, tip=before)
    arm = ac.SerialArm(name="six", chain=chain, limits=ac.Limits())
    for q in rng.uniform(-3, 3, (20, 6)):
        whole = np.eye(4)
        for (a, alpha, d, offset), angle in zip(dh, q, strict=True):
            (c, s), (k, m) = ((np.cos(x), np.sin(x)) for x in (angle + offset, alpha))
            first = [c, -s * k, s * m, a * c]
            second = [s, c * k, -c * m, a * s]
            whole = whole @ [first, second, [0, m, k, d], [0, 0, 0, 1]]
        point, rotation = arm.pose(q)
        np.testing.assert_allclose(point, whole[:3, 3], rtol=0, atol=1e-14)
        np.testing.assert_allclose(rotation, whole[:3, :3], rtol=0, atol=1e-14)


@each("n", [0, 1, 31, 33])
def test_compiled_kinematics_agree_for_any_number_of_states(arm3, n):
    q, dq, ddq, dddq = states = np.random.default_rng(n).normal(size=(4, n, arm3.dof))
    twist = arm3.tool_twist(q, dq)
    bend = arm3.tool_twist_rate(q, dq, ddq)
    # The Jacobian and its rate are computed by other code.
    expected = np.einsum("nij,nj->ni", arm3.jacobian(q), dq)
    np.testing.assert_allclose(twist, expected, rtol=0, atol=1e-13 * arm3.dof)
    rate = arm3.tool_jacobian_rate(q, dq)
    expected = arm3.tool_velocity(q, ddq) + np.einsum("nij,nj->ni", rate, dq)
    np.testing.assert_allclose(bend[:, :3], expected, rtol=0, atol=1e-12 * arm3.dof)
    velocity, acceleration = arm3.tool_motion(q, dq, ddq)
    np.testing.assert_array_equal(velocity, twist[:, :3])
    np.testing.assert_array_equal(acceleration, bend[:, :3])
    states.flags.writeable = False
    points = arm3.tool_position(states[0])
    for k in range(n):
        one = states[:, k]
        np.testing.assert_allclose(arm3.tool_position(one[0]), points[k], atol=1e-14)
