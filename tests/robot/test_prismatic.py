"""Chains with prismatic joints: own 4 by 4 matrices, pinocchio, and a gantry in closed form."""

import dataclasses

import numpy as np
import pytest
from tests.dynamics_extra import needs_dynamics, pinocchio, pinocchio_model

import armcontour as ac
from armcontour.core.frames import Frame, exp
from armcontour.files import read_job
from armcontour.motion import LapLaw, Trajectory
from armcontour.robot import Chain, JointPreference, Payload, SerialArm
from armcontour.robot.scene import ArmShapes, LinkShape, Obstacle, Scene, Sphere
from armcontour.verification.clearance import check_clearance

ORDER = 4


def mixed(seed, dof=6, reach=0.4):
    """An arm with random joints of both kinds, the first or second of which is prismatic."""
    rng = np.random.default_rng(seed)
    axes = rng.normal(size=(dof, 3))
    spread = 0.2 * rng.normal(size=(dof, 3, 3))
    prismatic = rng.uniform(size=dof) < 0.4
    prismatic[seed % 2] = True
    chain = Chain(
        joints=tuple(f"j{k}" for k in range(dof)),
        rotations=exp(rng.normal(size=(dof, 3))),
        positions=reach * rng.normal(size=(dof, 3)),
        axes=axes / np.linalg.norm(axes, axis=1, keepdims=True),
        masses=rng.uniform(1, 2, dof),
        centers=0.1 * rng.normal(size=(dof, 3)),
        inertias=spread @ np.swapaxes(spread, 1, 2) + np.eye(3),
        armature=rng.uniform(0, 1, dof),
        base=Frame.rpy([0.1, 0.2, 0.3], [1.0, 2.0, 3.0]),
        tip=Frame.rpy([0.1, 0.1, 0.2], [0.3, 0.1, 0.2]),
        tool=Frame.rpy([0.1, 0.1, 0.2], [0.2, 0.5, 0.7]),
        gravity=[1.0, 2.0, -9.0],
        payload=Payload(mass=0.5, center=(0.1, 0.0, 0.05)),
        prismatic=tuple(prismatic.tolist()),
    )
    limits = ac.Limits(
        joint_velocity=rng.uniform(0.5, 2.0, dof), joint_acceleration=rng.uniform(1.0, 9.0, dof)
    )
    return SerialArm(name=f"mixed {seed}", chain=chain, limits=limits)


def products(a, b):
    """Product of two series of 4 by 4 matrices in time."""
    return np.array([sum(a[i] @ b[k - i] for i in range(k + 1)) for k in range(len(a))])


def joint_series(axis, slides, q):
    """Taylor coefficients of the transform of a joint from those of its position."""
    motion = np.zeros((len(q), 4, 4))
    if slides:
        motion[:, :3, 3] = np.outer(q, axis)
        motion[0] += np.eye(4)
        return motion
    # z = exp(i q) has the derivative i q' z.
    z = np.zeros(len(q), complex)
    z[0] = np.exp(1j * q[0])
    for k in range(1, len(q)):
        z[k] = 1j * sum((m + 1) * q[m + 1] * z[k - 1 - m] for m in range(k)) / k
    cross = np.cross(axis, np.eye(3)).T
    parallel = np.outer(axis, axis)
    for k in range(len(q)):
        motion[k, :3, :3] = z[k].real * (np.eye(3) - parallel) + z[k].imag * cross
    motion[0, :3, :3] += parallel
    motion[0, 3, 3] = 1.0
    return motion


def constant(rotation, position):
    series = np.zeros((ORDER, 4, 4))
    series[0] = np.eye(4)
    series[0, :3, :3] = rotation
    series[0, :3, 3] = position
    return series


def tool_series(chain, *states):
    """Taylor coefficients of the tool's transform, from q, dq, ddq and dddq."""
    pose = constant(chain.base.rotation, chain.base.position)
    factorials = np.array([1.0, 1.0, 2.0, 6.0])
    for k in range(len(chain)):
        pose = products(pose, constant(chain.rotations[k], chain.positions[k]))
        q = np.array([x[k] for x in states]) / factorials
        pose = products(pose, joint_series(chain.axes[k], chain.prismatic[k], q))
    for end in (chain.tip, chain.tool):
        pose = products(pose, constant(end.rotation, end.position))
    return pose


def vector(matrix):
    return np.array([matrix[2, 1], matrix[0, 2], matrix[1, 0]])


@pytest.mark.parametrize("seed", range(12))
def test_mixed_chains_move_like_products_of_matrices(seed):
    arm = mixed(seed, dof=3 + seed % 5)
    states = np.random.default_rng(seed).normal(size=(4, 40, arm.dof))
    q, dq, ddq, _ = states
    poses = arm.forward(q)
    twists = arm.tool_twist(q, dq)
    rates = arm.tool_twist_rate(q, dq, ddq)
    motion = arm._motion(*states)
    for i in range(len(q)):
        series = tool_series(arm.chain, *states[:, i])
        np.testing.assert_allclose(poses[i], series[0], atol=1e-12)
        rotation = series[:, :3, :3]
        back = np.swapaxes(rotation, 1, 2)
        first = rotation[1] @ back[0]
        second = 2 * rotation[2] @ back[0] + rotation[1] @ back[1]
        third = 6 * rotation[3] @ back[0] + 4 * rotation[2] @ back[1] + 2 * rotation[1] @ back[2]
        expected = [[*series[1, :3, 3], *vector(first)]]
        expected += [[*2 * series[2, :3, 3], *vector(second)]]
        expected += [[*6 * series[3, :3, 3], *vector(third)]]
        np.testing.assert_allclose(twists[i], expected[0], atol=1e-11)
        np.testing.assert_allclose(rates[i], expected[1], atol=1e-11)
        np.testing.assert_allclose(motion[i], np.ravel(expected), atol=1e-10)
    np.testing.assert_allclose(twists, np.einsum("nij,nj->ni", arm.jacobian(q), dq), atol=1e-12)
    drift = np.einsum("nij,nj->ni", arm.tool_jacobian_rate(q, dq), dq)
    bias = arm.tool_acceleration(q, dq, np.zeros_like(q))
    np.testing.assert_allclose(drift, bias, atol=1e-12)


@pytest.mark.parametrize("seed", range(8))
def test_torques_and_forces_equal_those_of_pinocchio(seed):
    pin = pinocchio()
    arm = mixed(seed, dof=2 + seed)
    chain = arm.chain
    dynamics = arm.dynamics
    model = pinocchio_model(chain)
    data = model.createData()
    states = np.random.default_rng(seed).normal(size=(3, 60, arm.dof))
    armature = np.diag(chain.armature)
    position, rate, mass = dynamics.derivatives(*states)
    for i, (q, dq, ddq) in enumerate(np.swapaxes(states, 0, 1)):
        torque = pin.rnea(model, data, q, dq, ddq) + armature @ ddq
        np.testing.assert_allclose(dynamics.torque(q, dq, ddq), torque, atol=1e-9)
        pin.crba(model, data, q)
        expected = np.triu(data.M) + np.triu(data.M, 1).T + armature
        np.testing.assert_allclose(dynamics.mass_matrix(q), expected, atol=1e-9)
        np.testing.assert_allclose(mass[i], expected, atol=1e-9)
        gravity = pin.computeGeneralizedGravity(model, data, q)
        np.testing.assert_allclose(dynamics.gravity(q), gravity, atol=1e-9)
        pin.computeRNEADerivatives(model, data, q, dq, ddq)
        np.testing.assert_allclose(position[i], data.dtau_dq, atol=1e-8)
        np.testing.assert_allclose(rate[i], data.dtau_dv, atol=1e-8)


LENGTH = 0.2


def gantry():
    """Three prismatic joints and a spherical wrist; its tool is LENGTH from the centre of it."""
    axes = np.eye(3)[[0, 1, 2, 2, 1, 2]]
    chain = Chain(
        joints=("x", "y", "z", "swing", "tilt", "roll"),
        rotations=np.tile(np.eye(3), (6, 1, 1)),
        positions=[[0, 0, 1.0], *np.zeros((5, 3))],
        axes=axes,
        tool=Frame([0, 0, LENGTH]),
        prismatic=(True, True, True, False, False, False),
    )
    limits = ac.Limits(
        joint_lower=[-1.0, -2.0, -0.5, -4.0, -2.8, -4.0],
        joint_upper=[3.0, 2.0, 0.8, 4.0, 2.8, 4.0],
        joint_velocity=[1.0, 1.0, 0.5, 3.0, 3.0, 3.0],
        joint_acceleration=[2.0, 2.0, 1.0, 20.0, 20.0, 20.0],
    )
    return SerialArm(name="gantry", chain=chain, limits=limits)


def gantry_positions(points, rotations, tilt):
    """Joint positions by hand: Z-Y-Z angles of the wrist; `tilt`: sign of the second one."""
    second = tilt * np.arccos(rotations[:, 2, 2])
    sine = np.sin(second)
    swing = np.arctan2(rotations[:, 1, 2] / sine, rotations[:, 0, 2] / sine)
    roll = np.arctan2(rotations[:, 2, 1] / sine, -rotations[:, 2, 0] / sine)
    centre = points - LENGTH * rotations[:, :, 2] - [0, 0, 1.0]
    return np.column_stack([centre, swing, second, roll])


POINTS = np.array([(0.5, -0.5, 0.6), (1.4, -0.2, 0.7), (1.6, 0.8, 0.5), (0.4, 1.2, 0.8)])
TURNS = exp([[0.3, 2.4, 0.1], [0.5, 2.2, 0.3], [0.2, 2.3, 0.6], [0.0, 2.5, 0.2]])


def gantry_paths():
    """Return a rounded, a spline and a straight path with tool orientations, for the gantry."""
    rounded = ac.round_corners(
        ac.Path.polyline(POINTS).oriented(TURNS), tolerance=0.05, angular_tolerance=0.2
    )
    curve = ac.Path.spline(POINTS, tolerance=1e-4).oriented(TURNS[0])
    return {
        "rounded": rounded,
        "spline": curve,
        "line": ac.Path.polyline(POINTS[:2]).oriented(TURNS[1]),
    }


@pytest.mark.parametrize("kind", ["rounded", "spline", "line"])
def test_the_joint_positions_of_a_gantry_equal_a_hand_calculation(kind):
    arm = gantry()
    path = gantry_paths()[kind]
    traced = ac.trace(path, arm)
    s = np.random.default_rng(0).uniform(0, path.length, 500)
    q = traced(s)
    expected = gantry_positions(path(s), path.orientation(s), np.sign(q[0, 4]))
    turns = 2 * np.pi * np.round((q - expected) / (2 * np.pi))[:, 3:]
    assert (turns == turns[0]).all()
    expected[:, 3:] += turns
    np.testing.assert_allclose(q, expected, atol=1e-9)
    found = arm.inverse(Frame(path(0.0), path.orientation(0.0)), all=True)
    assert len(found) >= 2
    for one in found:
        np.testing.assert_allclose(arm.forward(one)[:3, 3], path(0.0), atol=1e-8)


def test_exported_columns_have_the_units_of_their_joint_type(tmp_path):
    arm = gantry()
    path = gantry_paths()["line"]
    plan = ac.plan(path, arm)
    for name in ("plan.csv", "plan.yaml"):
        ac.export(plan, tmp_path / name, arm=arm, cycle=0.01)
    titles = (tmp_path / "plan.csv").read_text().splitlines()[0].split(",")
    kinds = [("q", "rad", "m"), ("dq", "rad/s", "m/s"), ("ddq", "rad/s^2", "m/s^2")]
    expected = ["t [s]"]
    for quantity, angle, length in kinds:
        for joint, slides in zip(arm.joint_names, arm.chain.prismatic, strict=True):
            unit = length if slides else angle
            expected.append(f"{quantity} {joint} [{unit}]")
    assert titles == expected
    for name in ("plan.csv", "plan.yaml"):
        samples = ac.read_trajectory(tmp_path / name, arm.joint_names)
        t = np.minimum(samples.t, plan.duration)
        np.testing.assert_allclose(samples.q, plan(t), atol=1e-7)
        assert not ac.check(samples, arm, path=path, deviation=1e-6).violations
    # A file in mm has the same motion.
    text = (tmp_path / "plan.csv").read_text().replace(" x [m", " x [mm")
    rows = [x.split(",") for x in text.splitlines()[1:]]
    columns = [k for k, x in enumerate(titles) if " x [" in x]
    for row in rows:
        for k in columns:
            row[k] = f"{1e3 * float(row[k]):.9f}"
    lines = [text.splitlines()[0], *map(",".join, rows)]
    (tmp_path / "mm.csv").write_text("\n".join(lines))
    samples = ac.read_trajectory(tmp_path / "mm.csv", arm.joint_names)
    np.testing.assert_allclose(samples.q, plan(np.minimum(samples.t, plan.duration)), atol=1e-7)
    assert samples.prismatic == arm.chain.prismatic


def planned_nearby(seed):
    """A plan of a random mixed chain along a corner near a random posture; None out of reach."""
    rng = np.random.default_rng(seed)
    arm = mixed(seed, dof=6 + seed % 2, reach=0.3)
    q = rng.uniform(-0.8, 0.8, arm.dof)
    start = arm.forward(q)
    corners = start[:3, 3] + np.cumsum([np.zeros(3), *rng.normal(size=(2, 3)) * 0.03], axis=0)
    path = ac.round_corners(
        ac.Path.polyline(corners).oriented(start[:3, :3]), tolerance=3e-3, continuity="curvature"
    )
    limits = arm.limits.replace(
        speed=0.2,
        tool_acceleration=2.0,
        joint_jerk=rng.uniform(20.0, 200.0, arm.dof) if seed % 5 == 0 else np.inf,
    )
    try:
        return arm, path, limits, ac.plan(path, arm, limits, ac.Optimal(seed=q))
    except ac.Unreachable:
        return None


@pytest.mark.parametrize("part", range(4))
def test_limits_are_satisfied_between_samples_by_independent_kinematics(part):
    planned = 0
    seed = 40 * part
    while planned < 25:
        assert seed < 40 * (part + 1)
        found = planned_nearby(seed)
        seed = seed + 1
        if found is None:
            continue
        planned += 1
        arm, path, limits, plan = found
        t = np.random.default_rng(seed).uniform(0, plan.duration, 60)
        states = [plan(t, k) for k in range(4 if limits.limits_jerk else 3)]
        names = ("joint_velocity", "joint_acceleration", "joint_jerk")
        for name, values in zip(names, states[1:], strict=False):
            ratio = np.abs(values) / getattr(limits, name)
            assert ratio.max() <= 1 + 1e-9, (seed, name, ratio.max())
        states = [*states, np.zeros_like(states[0])][:4]
        series = np.array([tool_series(arm.chain, *x) for x in np.swapaxes(states, 0, 1)])
        points = series[:, :, :3, 3]
        assert np.linalg.norm(points[:, 1], axis=1).max() <= 0.2 * (1 + 1e-9)
        assert np.linalg.norm(2 * points[:, 2], axis=1).max() <= 2.0 * (1 + 1e-9)
        assert path.project(points[:, 0]).distance.max() < 1e-9
        # Positions between the times follow from the velocities, by Simpson's rule.
        h = 1e-4
        t = t[(t > h) & (t < plan.duration - h)]
        moved = plan(t + h) - plan(t - h)
        rates = plan(t - h, 1) + 4 * plan(t, 1) + plan(t + h, 1)
        np.testing.assert_allclose(moved, rates * h / 3, atol=1e-7)


def place_of(chain, q, link, point):
    """A point of a link in the frame of the base, (3,)."""
    pose = np.eye(4)
    for k in range(link):
        pose = pose @ constant(chain.rotations[k], chain.positions[k])[0]
        pose = pose @ joint_series(chain.axes[k], chain.prismatic[k], np.append(q[k], 0.0))[0]
    return pose[:3] @ np.append(point, 1.0)


@needs_dynamics
@pytest.mark.parametrize("seed", range(30))
def test_clearance_is_bounded_between_samples(seed):
    rng = np.random.default_rng(seed)
    arm = mixed(seed, dof=5)
    link = 2 + seed % 4
    point = 0.2 * rng.normal(size=3)
    body = LinkShape(name="body", link=link, shape=Sphere(radius=0.05), place=Frame(position=point))
    first, last = rng.uniform(-1, 1, size=(2, arm.dof))
    law = LapLaw(
        breaks=np.array([0.0, 1.0]),
        q=np.array([first, last]),
        dq=(last - first)[None],
        ddq=np.zeros((1, arm.dof)),
    )
    motion = Trajectory(laws=(law,), method="test")
    centre = place_of(arm.chain, motion(rng.uniform()), link, point) + 0.15 * rng.normal(size=3)
    wall = Obstacle(
        name="wall", shape=Sphere(radius=0.02), place=Frame(position=centre), fixed_to="base"
    )
    arm = arm.with_shapes(ArmShapes(shapes=(body,)))
    (pair,) = check_clearance(motion, arm, Scene(obstacles=(wall,)), resolution=1e-4).pairs
    places = [place_of(arm.chain, x, link, point) for x in motion(np.linspace(0, 1, 2001))]
    sampled = np.linalg.norm(np.array(places) - centre, axis=1).min() - 0.07
    assert pair.low <= sampled + 1e-9 and pair.high <= pair.low + 1.1e-4
    assert pair.high > sampled - 3e-3


SEAM = ac.Path.polyline([(0.0, -0.7, 0.1), (3.0, -0.7, 0.1)]).pointing([0, 0, -1])


def ur10e():
    return ac.load_arm("ur10e").with_tool([0, 0, 0.15])


def test_a_rail_is_the_first_joint():
    bare = ur10e().with_work(Frame.rpy([0.1, 0.2, 0.3], [0.1, 0.4, 2.0]))
    axis = np.array([0.6, 0.0, 0.8])
    origin = np.array([0.2, -0.1, 0.3])
    rail = ac.Rail(
        axis=2 * axis, lower=-1.0, upper=2.0, velocity=0.7, acceleration=1.5, force=900.0,
        origin=origin, mass=120.0,
    )  # fmt: skip
    arm = bare.with_rail(rail)
    q = np.random.default_rng(0).uniform(-1, 1, (50, 7))
    moved = bare.chain.base.rotation @ (origin + q[:, :1] * axis)[..., None]
    poses = arm.forward(q)
    expected = bare.forward(q[:, 1:])
    np.testing.assert_allclose(poses[:, :3, :3], expected[:, :3, :3], atol=1e-12)
    np.testing.assert_allclose(poses[:, :3, 3], expected[:, :3, 3] + moved[..., 0], atol=1e-12)
    limits = {"lower": -1.0, "upper": 2.0, "velocity": 0.7, "acceleration": 1.5, "torque": 900.0}
    for name, first in limits.items():
        values = getattr(arm.limits, f"joint_{name}")
        np.testing.assert_array_equal(values[0], first)
        np.testing.assert_array_equal(values[1:], getattr(bare.limits, f"joint_{name}"))
    assert "0.7 m/s, " in str(arm.limits) and "900 N, " in str(arm.limits)
    slow = ac.Limits(joint_velocity=0.5).over(arm.limits)
    assert "0.5 m/s, 0.5 rad/s, " in str(slow) and "0.7 m/s" not in str(slow)
    # The force moves the carriage and all links, and holds them against gravity along the axis.
    still = np.zeros(7)
    force = arm.dynamics.torque(q[0], still, np.eye(7)[0])[0]
    mass = 120.0 + np.sum(bare.chain.masses)
    assert force == pytest.approx(mass * (1.0 + 0.8 * 9.81), rel=1e-9)
    torque = arm.dynamics.torque(q[0], still, still)[1:]
    np.testing.assert_allclose(
        torque, bare.dynamics.torque(q[0, 1:], still[1:], still[1:]), atol=1e-9
    )
    # The shapes of the base move with the rail.
    links = {x.name: x.link for x in bare.shapes.shapes}
    assert {x.name: x.link for x in arm.shapes.shapes} == {x: k + 1 for x, k in links.items()}
    for words in ({"axis": [0, 0, 0]}, {"lower": 2.0}):
        with pytest.raises(ac.InvalidInput):
            dataclasses.replace(rail, **words)


def test_a_heavier_rail_moves_less_along_a_long_seam():
    travels = []
    for weight in (1.0, 20.0):
        rail = ac.Rail(
            axis=(1, 0, 0), lower=-1.0, upper=4.0, velocity=1.0, acceleration=0.5, mass=200.0
        )
        arm = ur10e().with_rail(rail).with_preferences({"rail": JointPreference(weight=weight)})
        plan = ac.plan(SEAM, arm, arm.limits.replace(speed=0.02))
        t = np.random.default_rng(0).uniform(1.0, plan.duration - 1.0, 500)
        speed = np.linalg.norm(arm.tool_velocity(plan(t), plan(t, 1)), axis=1)
        np.testing.assert_allclose(speed, 0.02, rtol=1e-6)
        assert np.abs(plan(t, 2)[:, 0]).max() <= 0.5
        rates = plan(np.sort(t), 1)[:, 0]
        assert (rates > 0).all()
        jacobian = arm.jacobian(plan(np.linspace(0, plan.duration, 500)))[..., 1:]
        assert np.linalg.svd(jacobian, compute_uv=False).min() > 0.04
        travels.append(float(plan(plan.duration)[0] - plan(0.0)[0]))
    # By hand, the rail moves straight while the arm reaches as far as it can at both ends.
    near, far = 0.0, 2.0
    down = np.diag([1.0, -1.0, -1.0])
    bare = ur10e()
    for _ in range(30):
        middle = (near + far) / 2
        try:
            bare.inverse(Frame([middle, -0.7, 0.1], down))
            near = middle
        except ac.Unreachable:
            far = middle
    least = SEAM.length - 2 * near
    assert least - 1e-6 <= travels[1] <= 1.1 * least
    assert travels[1] < 0.8 * travels[0]


def test_the_keys_of_a_job_add_a_rail(tmp_path):
    rail = "{axis: [0, 1, 0], upper: 3 m, velocity: 500 mm/s, acceleration: 1 m/s^2, mass: 90 kg}"
    text = f"""
name: rail
arm: {{name: ur10e, rail: {rail}}}
path:
  start: [-700 mm, 0, 300 mm]
  segments: [{{to: [-700 mm, 2500 mm, 300 mm]}}]
  orientation: {{axis: [0, 0, -1]}}
limits: {{speed: 50 mm/s}}
servo: {{kp: 25, kv: 150}}
runs: {{fast: {{timing: {{method: optimal}}, compensation: {{method: none}}}}}}
"""
    file = tmp_path / "job.yaml"
    file.write_text(text)
    arm = read_job(file).arm
    assert arm.joint_names[0] == "rail" and arm.chain.prismatic == (True, *[False] * 6)
    assert arm.limits.joint_velocity[0] == 0.5 and arm.chain.masses[0] == 90
    file.write_text(text.replace("ur10e", "pmk3s"))
    with pytest.raises(ac.InvalidInput, match="rail"):
        read_job(file)
