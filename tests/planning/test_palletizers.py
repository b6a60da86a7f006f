"""Palletizers: arms with joints that follow other joints, as their linkages do."""

import numpy as np
import pytest
from tests.dynamics_extra import needs_dynamics
from tests.own_kinematics import (
    cross_matrix,
    distance_from_line,
    inverse,
    keeps_limits,
    shift,
    slide,
    turn,
)

import armcontour as ac
from armcontour.core.errors import InvalidInput, Unreachable
from armcontour.files import read_job
from armcontour.planning.tracing import trace_rest
from armcontour.report.arm_frame import arm_frame
from armcontour.robot.scene import ArmShapes, LinkShape, Obstacle, Scene, Sphere
from armcontour.verification.clearance import check_clearance

LIMIT = '<limit lower="{}" upper="{}" velocity="{}" acceleration="{}" effort="0"/>'
JOINT = '<joint name="{}" type="revolute"><origin xyz="{}"/><parent link="{}"/><child link="{}"/>'
MIMIC = LIMIT.format(-3, 3, 9, 9) + '<mimic joint="{}" multiplier="{}"/></joint>'
LINKS = "".join(f'<link name="{x}"/>' for x in ("base", "column", "upper", "knee", "forearm"))
LINKS += '<link name="wrist"/><link name="level"/><link name="hand"/><link name="tool0"/>'
TOOL = (
    '<joint name="t" type="fixed"><origin xyz="0.05 0 -0.2" rpy="3.141592653589793 0 0"/>'
    '<parent link="hand"/><child link="tool0"/></joint></robot>'
)
COLUMN = (
    JOINT.format("j1", "0 0 0.8", "base", "column") + f'<axis xyz="0 0 1"/>'
    f"{LIMIT.format(-3, 3, 2, 6)}</joint>"
    + JOINT.format("j2", "0.2 0 0", "column", "upper")
    + f'<axis xyz="0 1 0"/>{LIMIT.format(-0.7, 1.4, 2, 6)}</joint>'
)
HAND = (
    JOINT.format("j4", "0.15 0 -0.1", "{}", "hand")
    + f'<axis xyz="0 0 -1"/>{LIMIT.format(-6, 6, 4, 20)}</joint>'
)
# The knee and the wrist are held level: the forearm has an angle to the floor.
LEVEL_KNEE = (
    '<robot name="palletizer">' + LINKS.replace('<link name="level"/>', "") + COLUMN
    + JOINT.format("m2", "0 0 1.1", "upper", "knee")
    + f'<axis xyz="0 1 0"/>{MIMIC.format("j2", -1)}'
    + JOINT.format("j3", "0 0 0.1", "knee", "forearm")
    + f'<axis xyz="0 1 0"/>{LIMIT.format(-0.3, 1.9, 2, 6)}</joint>'
    + JOINT.format("m3", "1.2 0 0", "forearm", "wrist")
    + f'<axis xyz="0 -1 0"/>{MIMIC.format("j3", 1)}'
    + HAND.format("wrist") + TOOL
)  # fmt: skip
# Only the wrist is held level: the forearm has an angle to the upper arm.
LEVEL_WRIST = (
    '<robot name="palletizer">' + LINKS.replace('<link name="knee"/>', "") + COLUMN
    + JOINT.format("j3", "0 0 1.1", "upper", "forearm")
    + f'<axis xyz="0 1 0"/>{LIMIT.format(-1.5, 1.5, 2, 6)}</joint>'
    + JOINT.format("m2", "1.2 0 0", "forearm", "level")
    + f'<axis xyz="0 1 0"/>{MIMIC.format("j2", -1)}'
    + JOINT.format("m3", "0 0 0", "level", "wrist")
    + f'<axis xyz="0 1 0"/>{MIMIC.format("j3", -1)}'
    + HAND.format("wrist") + TOOL
)  # fmt: skip
VELOCITY = (2, 2, 2, 4)
ACCELERATION = (6, 6, 6, 20)
DOWN = np.diag([1.0, -1.0, -1.0])
ORIGIN = (0, 0, 0)
Y = (0, 1, 0)
JOB = """
name: palletizer
arm: {{file: arm.urdf}}
path: {{points: [[1.3, -0.6, 0.9], [1.3, 0.6, 0.9]], orientation: {orientation}}}
servo: {{kp: 25 1/s, kv: 150 1/s}}
{more}
runs: {{w: {{}}}}
"""


def level_knee_poses(q):
    poses = turn((0, 0, 1), ORIGIN, q[:, 0]) @ shift((0.2, 0, 0.8)) @ turn(Y, ORIGIN, q[:, 1])
    poses = poses @ shift((0, 0, 1.1)) @ turn(Y, ORIGIN, -q[:, 1]) @ shift((0, 0, 0.1))
    poses = poses @ turn(Y, ORIGIN, q[:, 2]) @ shift((1.2, 0, 0)) @ turn(Y, ORIGIN, -q[:, 2])
    return with_hand(poses, q)


def level_wrist_poses(q):
    poses = turn((0, 0, 1), ORIGIN, q[:, 0]) @ shift((0.2, 0, 0.8)) @ turn(Y, ORIGIN, q[:, 1])
    poses = poses @ shift((0, 0, 1.1)) @ turn(Y, ORIGIN, q[:, 2]) @ shift((1.2, 0, 0))
    return with_hand(poses @ turn(Y, ORIGIN, -q[:, 1] - q[:, 2]), q)


def with_hand(poses, q):
    poses = poses @ shift((0.15, 0, -0.1)) @ turn((0, 0, -1), ORIGIN, q[:, 3])
    poses = poses @ shift((0.05, 0, -0.2))
    poses[:, :3, :3] = poses[:, :3, :3] @ DOWN
    return poses


KINDS = {"knee": (LEVEL_KNEE, level_knee_poses), "wrist": (LEVEL_WRIST, level_wrist_poses)}


@pytest.fixture(params=list(KINDS))
def palletizer(request, tmp_path):
    text, poses = KINDS[request.param]
    (tmp_path / "arm.urdf").write_text(text)
    return ac.load_arm(tmp_path / "arm.urdf"), poses


def postures(count=8):
    return np.random.default_rng(0).uniform(-0.6, 0.6, (count, 4))


def test_kinematics_of_linkages(palletizer):
    arm, poses = palletizer
    assert arm.joint_names == ("j1", "j2", "j3", "j4")
    q = postures()
    np.testing.assert_allclose(arm.forward(q), poses(q), atol=1e-12)
    step = 1e-6
    jacobian = arm.jacobian(q)
    for k in range(4):
        change = np.zeros(4)
        change[k] = step
        ends = [poses(q + x) for x in (change, -change)]
        moved = (ends[0] - ends[1]) / (2 * step)
        np.testing.assert_allclose(jacobian[:, :3, k], moved[:, :3, 3], atol=1e-8)
        spin = moved[:, :3, :3] @ np.swapaxes(poses(q)[:, :3, :3], 1, 2)
        turned = np.array([cross_matrix(x) for x in jacobian[:, 3:, k]])
        np.testing.assert_allclose(turned, spin, atol=1e-8)
    dq = postures()[::-1]
    rate = (arm.tool_jacobian(q + step * dq) - arm.tool_jacobian(q - step * dq)) / (2 * step)
    np.testing.assert_allclose(arm.tool_jacobian_rate(q, dq), rate, atol=1e-8)
    change = [arm.tool_velocity(x, dq) for x in (q + step * dq, q - step * dq)]
    acceleration = (change[0] - change[1]) / (2 * step)
    np.testing.assert_allclose(arm.tool_acceleration(q, dq, 0 * dq), acceleration, atol=1e-8)


def test_palletizers_follow_position_and_rotation(palletizer):
    arm, poses = palletizer
    start = (1.3, -0.6, 0.9)
    end = (1.1, 0.6, 0.6)
    turned = turn((0, 0, 1), ORIGIN, 1.2)[0, :3, :3] @ DOWN
    path = ac.Path.polyline([start, end])
    length = np.linalg.norm(np.subtract(end, start))
    for oriented, turns in (
        (path, None),
        (path.pointing((0, 0, -1)), None),
        (path.oriented(DOWN), 0.0),
        (path.oriented(np.stack([DOWN, turned])), 1.2),
    ):
        trajectory = ac.plan(oriented, arm, arm.limits, ac.Optimal())
        q = trajectory(np.linspace(0, trajectory.duration, 2001))
        tool = poses(q)
        assert distance_from_line(tool[:, :3, 3], start, end).max() < 1e-9
        np.testing.assert_allclose(tool[:, :3, 2], np.tile([0, 0, -1.0], (2001, 1)), atol=1e-9)
        if turns is not None:
            share = np.linalg.norm(tool[:, :3, 3] - start, axis=1) / length
            angle = np.arctan2(tool[:, 1, 0], tool[:, 0, 0])
            np.testing.assert_allclose(angle, turns * share, atol=1e-8)
        assert keeps_limits(trajectory, VELOCITY, ACCELERATION)
    with pytest.raises(Unreachable) as error:
        ac.plan(path.pointing((0.2, 0, -1)), arm, arm.limits, ac.Optimal())
    assert error.value.needed == pytest.approx(np.arctan(0.2), rel=1e-9)


@pytest.mark.parametrize("orientation", ["{axis: [0, 0, -1]}", "{quaternion: [1, 0, 0, 0]}"])
def test_palletizer_jobs(tmp_path, orientation):
    (tmp_path / "arm.urdf").write_text(LEVEL_KNEE)
    (tmp_path / "job.yaml").write_text(JOB.format(orientation=orientation, more=""))
    job = read_job(tmp_path / "job.yaml")
    result = ac.run(job).runs["w"]
    trajectory = result.trajectory
    q = trajectory(np.linspace(0, trajectory.duration, 2001))
    tool = level_knee_poses(q)
    assert distance_from_line(tool[:, :3, 3], (1.3, -0.6, 0.9), (1.3, 0.6, 0.9)).max() < 1e-9
    assert keeps_limits(trajectory, VELOCITY, ACCELERATION)
    whole = ac.trace(job.path, job.arm)
    rest = trace_rest(ac.geometry.path.cut_path(job.path, 0.5, 1.2), job.arm, whole, 0.5, 0.0)
    np.testing.assert_allclose(rest(0.0), whole(0.5), atol=1e-9)


def test_report_draws_the_linkage(tmp_path):
    # The page multiplies the frames of this message; here they are multiplied by own matrices.
    (tmp_path / "arm.urdf").write_text(LEVEL_KNEE)
    job_text = JOB.format(orientation="{axis: [0, 0, -1]}", more="")
    (tmp_path / "job.yaml").write_text(job_text)
    head = arm_frame(read_job(tmp_path / "job.yaml")).header
    q = postures(1)
    found = [np.eye(4)]
    for joint in head["joints"]:
        angle = joint["factor"] * q[:, joint["column"]]
        moved = np.array(joint["origin"]) @ turn(joint["axis"], ORIGIN, angle)[0]
        found.append(found[joint["parent"]] @ moved)
    tool = np.array(head["base"]) @ found[-1] @ np.array(head["tool"])
    np.testing.assert_allclose(tool, level_knee_poses(q)[0], atol=1e-12)


def test_palletizer_on_a_rail_over_a_turntable(tmp_path):
    (tmp_path / "arm.urdf").write_text(LEVEL_KNEE)
    rail = ac.Rail(axis=(0, 1, 0), lower=-1, upper=1, velocity=1, acceleration=2)
    table = ac.PositionerAxis(
        name="table", axis=(0, 0, 1), origin=(1.2, 0, 0), velocity=2, acceleration=4
    )
    arm = ac.load_arm(tmp_path / "arm.urdf").with_rail(rail)
    arm = arm.with_positioner(ac.Positioner(axes=(table,)))
    q = np.random.default_rng(1).uniform(-0.6, 0.6, (5, 6))
    table_pose = turn((0, 0, 1), (1.2, 0, 0), q[:, 0])
    expected = inverse(table_pose) @ slide((0, 1, 0), q[:, 1]) @ level_knee_poses(q[:, 2:])
    np.testing.assert_allclose(arm.forward(q), expected, atol=1e-12)
    np.testing.assert_allclose(arm.from_floor.forward(q[:, 1:]), table_pose @ expected, atol=1e-12)


def test_held_joints_of_a_palletizer(palletizer):
    arm, poses = palletizer
    q = postures()
    for held in range(4):
        chain = arm.chain.replace(held={held: 0.3})
        moving = [k for k in range(4) if k != held]
        fixed = arm._with(chain).without_held()
        at = q.copy()
        at[:, held] = 0.3
        np.testing.assert_allclose(fixed.forward(q[:, moving]), poses(at), atol=1e-12)


@needs_dynamics
def test_clearance_of_a_palletizer(palletizer):
    arm, poses = palletizer
    ball = LinkShape(name="hand", link=4, shape=Sphere(radius=0.05), place=ac.Frame((0, 0, -0.1)))
    arm = arm.with_shapes(ArmShapes(shapes=(ball,)))
    post = Obstacle(name="post", shape=Sphere(radius=0.03), place=ac.Frame((1.28, 0.1, 0.9)))
    path = ac.Path.polyline([(1.3, -0.6, 0.9), (1.3, 0.6, 0.9)]).oriented(DOWN)
    trajectory = ac.plan(path, arm, arm.limits, ac.Optimal())
    (pair,) = check_clearance(trajectory, arm, Scene((post,), floor="none")).pairs
    q = trajectory(np.linspace(0, trajectory.duration, 20001))
    # The ball is 0.05 m beside and 0.1 m above the tool point.
    middle = (poses(q) @ [-0.05, 0.0, -0.1, 1.0])[:, :3]
    own = np.linalg.norm(middle - [1.28, 0.1, 0.9], axis=1).min() - 0.08
    assert pair.low <= own + 1e-9
    assert pair.high == pytest.approx(own, abs=1e-3)


def test_mimicking_joints_that_are_no_linkage_are_refused(tmp_path):
    faulty = LEVEL_KNEE.replace('<mimic joint="j2"', '<mimic joint="elsewhere"')
    (tmp_path / "arm.urdf").write_text(faulty)
    with pytest.raises(InvalidInput):
        ac.load_arm(tmp_path / "arm.urdf")
    # Bodies of linkages are not modelled, so torques are not computed.
    body = '<inertial><mass value="2"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>'
    heavy = LEVEL_KNEE
    for link in ("column", "upper", "forearm", "hand"):
        heavy = heavy.replace(
            f'<link name="{link}"/>', f'<link name="{link}">{body}</inertial></link>'
        )
    (tmp_path / "arm.urdf").write_text(heavy)
    arm = ac.load_arm(tmp_path / "arm.urdf")
    assert not arm.has_bodies and any("j2" in x for x in arm.notes)
