"""Axes under the part: turntables without a range, slides, and mixtures of both."""

import numpy as np
import pytest
from tests.own_kinematics import distance_from_line, inverse, keeps_limits, shift, slide, turn

import armcontour as ac
from armcontour.core.errors import InvalidInput
from armcontour.files import read_job
from armcontour.planning.tracing import trace_rest
from armcontour.program import Contour, Program, Rapid
from armcontour.robot import Payload
from armcontour.robot.scene import ArmShapes, LinkShape, Obstacle, Scene, Sphere
from armcontour.verification.clearance import check_clearance

LIMIT = '<limit lower="{}" upper="{}" velocity="{}" acceleration="{}" effort="0"/>'
# A mill: the tool slides along z, and the table along x and y.
MILL = f"""<robot name="mill"><link name="floor"/><link name="head"/><link name="tool0"/>
<link name="saddle"/><link name="table"/>
<joint name="z" type="prismatic"><origin xyz="0 0 1"/><parent link="floor"/><child link="head"/>
<axis xyz="0 0 1"/>{LIMIT.format(-0.6, 0.0, 0.5, 2)}</joint>
<joint name="t" type="fixed"><origin xyz="0 0 -0.2" rpy="3.141592653589793 0 0"/>
<parent link="head"/><child link="tool0"/></joint>
<joint name="y" type="prismatic"><origin xyz="0 0 0.3"/><parent link="floor"/>
<child link="saddle"/><axis xyz="0 1 0"/>{LIMIT.format(-0.3, 0.3, 0.4, 1.5)}</joint>
<joint name="x" type="prismatic"><origin xyz="0 0 0.1"/><parent link="saddle"/>
<child link="table"/><axis xyz="1 0 0"/>{LIMIT.format(-0.5, 0.5, 0.8, 3)}</joint></robot>"""
# A tool that slides along x and z, over a turntable without a range.
TOOL = f"""<link name="floor"/><link name="bx"/><link name="bz"/><link name="tool0"/>
<joint name="x" type="prismatic"><origin xyz="0 0 1"/><parent link="floor"/><child link="bx"/>
<axis xyz="1 0 0"/>{LIMIT.format(0, 1, 1, 2)}</joint>
<joint name="z" type="prismatic"><parent link="bx"/><child link="bz"/><axis xyz="0 0 1"/>
{LIMIT.format(-0.8, 0, 1, 2)}</joint>
<joint name="t" type="fixed"><origin rpy="3.141592653589793 0 0"/><parent link="bz"/>
<child link="tool0"/></joint>"""
TURNTABLE = f"""<robot name="lathe">{TOOL}<link name="table"/>
<joint name="c" type="continuous"><origin xyz="0.2 0 0.2"/><parent link="floor"/>
<child link="table"/><axis xyz="0 0 1"/><limit velocity="3" acceleration="6" effort="0"/></joint>
</robot>"""
DOWN = np.diag([1.0, -1.0, -1.0])
JOB = """
name: cell
arm: {arm}
path: {{points: {points}, orientation: {{axis: [0, 0, -1]}}}}
limits: {{speed: 100 mm/s}}
corners: {{tolerance: 0.5 mm}}
servo: {{kp: 25 1/s, kv: 150 1/s}}
export: {{formats: [csv], cycle: 20 ms}}
runs: {{w: {{}}}}
"""


def read(folder, arm, points, text=""):
    if text:
        (folder / "cell.urdf").write_text(text)
    (folder / "job.yaml").write_text(JOB.format(arm=arm, points=points))
    return read_job(folder / "job.yaml")


def sampled(trajectory, count=4001):
    return trajectory(np.linspace(0.0, trajectory.duration, count))


def helix(turns, radius=0.1, rise=0.01, per_turn=40):
    angle = np.linspace(0.0, 2 * np.pi * turns, turns * per_turn + 1)
    return np.stack(
        [radius * np.cos(angle), radius * np.sin(angle), 0.1 + rise * angle / (2 * np.pi)], axis=1
    )


def distances_from(points, corners):
    pairs = zip(corners[:-1], corners[1:], strict=True)
    return np.min([distance_from_line(points, a, b) for a, b in pairs], axis=0)


def mill_poses(q):
    """Tool poses of the mill in the frame of the table, (n, 4, 4); joints x, y, z."""
    table = slide((0, 1, 0), q[:, 1]) @ shift((0, 0, 0.4)) @ slide((1, 0, 0), q[:, 0])
    tool = slide((0, 0, 1), q[:, 2]) @ shift((0, 0, 0.8))
    poses = inverse(table) @ tool
    poses[:, :3, :3] = poses[:, :3, :3] @ DOWN
    return poses


def turntable_poses(q):
    """Tool poses in the frame of the turntable, (n, 4, 4); joints c, x, z."""
    table = shift((0.2, 0, 0.2)) @ turn((0, 0, 1), (0, 0, 0), q[:, 0])
    tool = slide((1, 0, 0), q[:, 1]) @ slide((0, 0, 1), q[:, 2])
    return inverse(table) @ shift((0, 0, 1)) @ tool


def test_mill_moves_the_table_under_the_tool(tmp_path):
    corners = np.array([[-0.3, -0.2, 0.1], [0.3, -0.2, 0.1], [0.3, 0.2, 0.2]])
    job = read(tmp_path, "{file: cell.urdf, part: table}", corners.tolist(), MILL)
    arm = job.arm
    assert arm.joint_names == ("x", "y", "z")
    # First the slides of the arm, then those of the part from the floor.
    assert arm.chain.external == (2, 1, 0)
    q = np.array([[0.1, -0.2, -0.3], [-0.4, 0.1, -0.1]])
    np.testing.assert_allclose(arm.forward(q), mill_poses(q), atol=1e-12)
    in_python = ac.plan(
        ac.Path.polyline(corners).pointing((0, 0, -1)), arm, arm.limits.replace(speed=0.1)
    )
    in_job = ac.run(job).runs["w"].trajectory
    for trajectory, tolerance in ((in_python, 1e-9), (in_job, 5e-4 + 1e-9)):
        tool = mill_poses(sampled(trajectory))[:, :3, 3]
        assert distances_from(tool, corners).max() < tolerance
        speed = np.linalg.norm(np.diff(tool, axis=0), axis=1) / (trajectory.duration / 4000)
        assert speed.max() < 0.1 * (1 + 1e-6)
        assert keeps_limits(trajectory, (0.8, 0.4, 0.5), (3, 1.5, 2))


def test_slides_need_a_range():
    with pytest.raises(InvalidInput):
        ac.PositionerAxis(
            name="x", axis=(1, 0, 0), origin=(0, 0, 0), velocity=1, acceleration=2, prismatic=True
        )


def test_forces_of_slides_under_the_part():
    up = np.array([0.0, 0.6, 0.8])
    slope = ac.PositionerAxis(
        name="lift",
        axis=up,
        origin=(1, 0, 0),
        velocity=1,
        acceleration=2,
        lower=-1,
        upper=1,
        mass=30.0,
        prismatic=True,
    )
    table = ac.PositionerAxis(
        name="turn", axis=(0, 0, 1), origin=(1, 0, 0.2), velocity=1, acceleration=2, mass=20.0
    )
    part = Payload(mass=5.0, center=(0.1, 0.0, 0.0))
    arm = ac.load_arm("ur10e").with_positioner(ac.Positioner(axes=(slope, table), part=part))
    arm = arm.with_work((1.0, 0.0, 0.2))
    q = np.zeros(8)
    q[:2] = 0.7, 0.3
    ddq = np.zeros(8)
    ddq[1] = 1.5
    still = np.zeros(8)
    # All 55 kg move along the slope against gravity.
    force = arm.torque(q, still, ddq)[1]
    assert force == pytest.approx(55.0 * (1.5 + 9.81 * 0.8), rel=1e-12)
    # A turn of the table moves the part only, at a lever of 0.1 m.
    ddq[:2] = 2.0, 0.0
    assert arm.torque(q, still, ddq)[0] == pytest.approx(5.0 * 0.1**2 * 2.0, rel=1e-12)


def test_turntable_of_a_urdf_turns_endlessly(tmp_path):
    corners = helix(6)
    arm_keys = "{file: cell.urdf, part: table}"
    job = read(tmp_path, arm_keys, corners.tolist(), TURNTABLE)
    trajectory = ac.run(job).runs["w"].trajectory
    q = sampled(trajectory)
    tool = turntable_poses(q)[:, :3, 3]
    assert distances_from(tool, corners).max() < 5e-4 + 1e-9
    # The table turns six times in one direction, from a start within half a turn of 0.
    assert abs(q[0, 0]) <= np.pi
    assert abs(q[-1, 0] - q[0, 0]) > 2 * np.pi * 5.9
    steps = np.diff(q[:, 0]) * np.sign(q[-1, 0] - q[0, 0])
    assert (steps > -1e-4).all()
    assert keeps_limits(trajectory, (3, 1, 1), (6, 2, 2))
    whole = ac.trace(ac.Path.polyline(corners).pointing((0, 0, -1)), job.arm)
    s = whole.length * 0.7
    rest = ac.geometry.path.cut_path(whole.tool_path, s, whole.length)
    resumed = trace_rest(rest, job.arm, whole, s, 0.0)
    np.testing.assert_allclose(resumed(0.0), whole(s), atol=1e-9)


def test_turntable_is_not_wound_back_between_contours(tmp_path):
    (tmp_path / "cell.urdf").write_text(TURNTABLE)
    arm = ac.load_arm(tmp_path / "cell.urdf", part="table")
    first = ac.Path.polyline(helix(4)).pointing((0, 0, -1))
    second = ac.Path.polyline(helix(3, radius=0.15) + [0, 0, 0.05]).pointing((0, 0, -1))
    program = Program(moves=(Contour(path=first), Rapid(), Contour(path=second)))
    trajectory = ac.plan(program, arm, arm.limits.replace(speed=0.3), ac.Optimal())
    turned = np.diff(sampled(trajectory)[:, 0])
    # At most half a turn back to the start of the second contour.
    back = -np.minimum(turned * np.sign(turned.sum()), 0.0).sum()
    assert back < np.pi + 1e-6
    assert abs(turned.sum()) > 2 * np.pi * 6


def test_axes_of_job_keys_without_a_range(tmp_path):
    axis = "{name: c, axis: [0, 0, 1], origin: [0.2, 0, 0.2], velocity: 3, acceleration: 6}"
    arm = f"{{file: cell.urdf, work: {{position: [0.2, 0, 0.2]}}, positioner: {{axes: [{axis}]}}}}"
    corners = helix(3)
    job = read(tmp_path, arm, corners.tolist(), f'<robot name="xz">{TOOL}</robot>')
    trajectory = ac.run(job).runs["w"].trajectory
    q = sampled(trajectory)
    assert distances_from(turntable_poses(q)[:, :3, 3], corners).max() < 5e-4 + 1e-9
    assert abs(q[-1, 0] - q[0, 0]) > 2 * np.pi * 2.9
    assert keeps_limits(trajectory, (3, 1, 1), (6, 2, 2))


def test_export_of_cells_with_slides_under_the_part(tmp_path):
    corners = np.array([[-0.3, -0.2, 0.1], [0.3, -0.2, 0.1]])
    job = read(tmp_path, "{file: cell.urdf, part: table}", corners.tolist(), MILL)
    trajectory = ac.run(job).runs["w"].trajectory
    ac.export(trajectory, tmp_path / "plan.csv", arm=job.arm, cycle=0.02)
    header, *rows = (tmp_path / "plan.csv").read_text().splitlines()
    columns = header.split(",")
    q = np.array([[float(x) for x in row.split(",")[:4]] for row in rows])
    assert columns[1:4] == ["q x [m]", "q y [m]", "q z [m]"]
    tool = mill_poses(q[:, 1:])[:, :3, 3]
    assert distances_from(tool, corners).max() < 1e-9


def test_clearance_of_an_obstacle_on_a_sliding_part(tmp_path):
    (tmp_path / "cell.urdf").write_text(MILL)
    arm = ac.load_arm(tmp_path / "cell.urdf", part="table")
    ball = LinkShape(name="head", link=3, shape=Sphere(radius=0.05), place=ac.Frame((0, 0, 0)))
    arm = arm.with_shapes(ArmShapes(shapes=(ball,)))
    clamp = Obstacle(
        name="clamp", shape=Sphere(radius=0.03), place=ac.Frame((0.2, 0.0, 0.25)), fixed_to="part"
    )
    path = ac.Path.polyline([(-0.3, 0.0, 0.2), (0.3, 0.05, 0.2)]).pointing((0, 0, -1))
    trajectory = ac.plan(path, arm, arm.limits.replace(speed=0.2), ac.Optimal())
    clearance = check_clearance(trajectory, arm, Scene((clamp,), floor="none"))
    q = sampled(trajectory, 20001)
    head = mill_poses(q)[:, :3, 3] + [0, 0, 0.2]
    own = np.linalg.norm(head - [0.2, 0.0, 0.25], axis=1).min() - 0.08
    assert clearance.pairs[0].low <= own + 1e-9
    assert clearance.pairs[0].high == pytest.approx(own, abs=1e-3)


SIX = (
    ("joint_1", "0 0 0", "0 0 1"),
    ("joint_2", "0.1 0 0.615", "0 1 0"),
    ("joint_3", "0 0 0.705", "0 1 0"),
    ("joint_4", "0.258 0 0.135", "1 0 0"),
    ("joint_5", "0.497 0 0", "0 1 0"),
    ("joint_6", "0.085 0 0", "1 0 0"),
)


def column_urdf():
    """A six-joint robot on a rotating column, 1 m beside its axis."""
    links = "".join(f'<link name="{x}"/>' for x in ("floor", "column", "base", "tool0"))
    joint = '<joint name="{}" type="{}"><origin xyz="{}"/><parent link="{}"/><child link="{}"/>'
    text = links + joint.format("column_joint", "revolute", "0 0 0.5", "floor", "column")
    text += f'<axis xyz="0 0 1"/>{LIMIT.format(-3, 3, 1, 2)}</joint>'
    text += joint.format("foot", "fixed", "1 0 0", "column", "base") + "</joint>"
    parent = "base"
    for name, origin, axis in SIX:
        text += f'<link name="{name}_link"/>'
        text += joint.format(name, "revolute", origin, parent, f"{name}_link")
        text += f'<axis xyz="{axis}"/>{LIMIT.format(-3, 3, 2.5, 6)}</joint>'
        parent = f"{name}_link"
    tip = '<joint name="tip" type="fixed"><origin xyz="0.2 0 0" rpy="0 1.5707963267948966 0"/>'
    return (
        f'<robot name="c">{text}{tip}<parent link="{parent}"/><child link="tool0"/></joint></robot>'
    )


def column_poses(q):
    """Tool poses of the robot on the column, (n, 4, 4)."""
    poses = shift((0, 0, 0.5)) @ turn((0, 0, 1), (0, 0, 0), q[:, 0]) @ shift((1, 0, 0))
    for k, (_, origin, axis) in enumerate(SIX, start=1):
        numbers = [[float(x) for x in words.split()] for words in (origin, axis)]
        poses = poses @ shift(numbers[0]) @ turn(numbers[1], (0, 0, 0), q[:, k])
    poses = poses @ shift((0.2, 0, 0))
    return poses @ turn((0, 1, 0), (0, 0, 0), np.pi / 2)[0]


def test_rotating_column_is_an_external_axis(tmp_path):
    corners = np.array([[1.8, -0.8, 1.0], [1.8, 0.8, 1.0]])
    job = read(tmp_path, "{file: cell.urdf}", corners.tolist(), column_urdf())
    assert job.arm.chain.external == (0,)
    trajectory = ac.run(job).runs["w"].trajectory
    poses = column_poses(sampled(trajectory))
    assert distances_from(poses[:, :3, 3], corners).max() < 1e-9
    np.testing.assert_allclose(poses[:, :3, 2], np.tile([0, 0, -1.0], (4001, 1)), atol=1e-8)
    assert keeps_limits(trajectory, (1, *[2.5] * 6), (2, *[6] * 6))
    ac.export(trajectory, tmp_path / "plan.src", "kuka", arm=job.arm, cycle=0.1)
    text = (tmp_path / "plan.src").read_text()
    assert "E1" in text and "A6" in text and "E2" not in text
    # A robot of seven joints in a row has no column.
    assert ac.load_arm("fr3").chain.external == ()
