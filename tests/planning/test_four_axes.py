"""Arms whose tool turns about one direction: SCARA, gantries with no or one rotation."""

import numpy as np
import pytest
from tests.own_kinematics import distance_from_line, keeps_limits, shift, slide, turn

import armcontour as ac
from armcontour.core.errors import InvalidInput, Unreachable
from armcontour.files import read_job

DOWN = np.diag([1.0, -1.0, -1.0])
SCARA = """<robot name="scara"><link name="base"/><link name="l1"/><link name="l2"/>
<link name="quill"/><link name="spindle"/><link name="tool0"/>
<joint name="j1" type="revolute"><origin xyz="0 0 0.4"/><parent link="base"/><child link="l1"/>
<axis xyz="0 0 1"/><limit lower="-2.9" upper="2.9" velocity="7" acceleration="30" effort="0"/>
</joint>
<joint name="j2" type="revolute"><origin xyz="0.35 0 0"/><parent link="l1"/><child link="l2"/>
<axis xyz="0 0 1"/><limit lower="-2.6" upper="2.6" velocity="9" acceleration="40" effort="0"/>
</joint>
<joint name="z" type="prismatic"><origin xyz="0.3 0 -0.05"/><parent link="l2"/><child link="quill"/>
<axis xyz="0 0 -1"/><limit lower="0" upper="0.25" velocity="1.2" acceleration="8" effort="0"/>
</joint>
<joint name="r" type="revolute"><origin xyz="0 0 -0.05"/><parent link="quill"/>
<child link="spindle"/><axis xyz="0 0 -1"/>
<limit lower="-6.28" upper="6.28" velocity="20" acceleration="100" effort="0"/>
</joint>
<joint name="t" type="fixed"><origin xyz="0.03 0 -0.05" rpy="3.141592653589793 0 0"/>
<parent link="spindle"/><child link="tool0"/></joint></robot>"""
SCARA_VELOCITY = (7.0, 9.0, 1.2, 20.0)
SCARA_ACCELERATION = (30.0, 40.0, 8.0, 100.0)
GANTRY = """<robot name="gantry"><link name="floor"/><link name="bx"/><link name="by"/>
<link name="bz"/><link name="head"/><link name="tool0"/>
<joint name="gx" type="prismatic"><origin xyz="0 0 2"/><parent link="floor"/><child link="bx"/>
<axis xyz="1 0 0"/><limit lower="-4" upper="4" velocity="1.2" acceleration="1.5" effort="0"/>
</joint>
<joint name="gy" type="prismatic"><parent link="bx"/><child link="by"/><axis xyz="0 1 0"/>
<limit lower="-1.5" upper="1.5" velocity="0.9" acceleration="2" effort="0"/>
</joint>
<joint name="gz" type="prismatic"><origin xyz="0 0 -0.5"/><parent link="by"/><child link="bz"/>
<axis xyz="0 0 -1"/><limit lower="0" upper="1.2" velocity="0.4" acceleration="0.8" effort="0"/>
</joint>
{head}
<joint name="t" type="fixed"><origin xyz="0 0 -0.25" rpy="{tool} 0 0"/><parent link="head"/>
<child link="tool0"/></joint></robot>"""
HEAD = """<joint name="ga" type="revolute"><origin xyz="0 0 -0.1"/><parent link="bz"/>
<child link="head"/><axis xyz="{axis}"/>
<limit lower="-3.1" upper="3.1" velocity="2" acceleration="8" effort="0"/></joint>"""
FIXED = """<joint name="ga" type="fixed"><origin xyz="0 0 -0.1"/><parent link="bz"/>
<child link="head"/></joint>"""
GANTRY_VELOCITY = (1.2, 0.9, 0.4, 2.0)
GANTRY_ACCELERATION = (1.5, 2.0, 0.8, 8.0)
JOB = """
name: four axes
arm: {{file: arm.urdf}}
path: {{points: {points}, orientation: {orientation}}}
corners: {{tolerance: 2 mm}}
servo: {{kp: 25 1/s, kv: 150 1/s}}
{more}
runs: {{w: {{}}}}
"""


def urdf_arm(folder, text):
    (folder / "arm.urdf").write_text(text)
    return ac.load_arm(folder / "arm.urdf")


def gantry(axis=None, tool="3.141592653589793"):
    head = FIXED if axis is None else HEAD.format(axis=axis)
    return GANTRY.format(head=head, tool=tool)


def read(folder, text, points, orientation, more=""):
    (folder / "arm.urdf").write_text(text)
    job = JOB.format(points=points, orientation=orientation, more=more)
    (folder / "job.yaml").write_text(job)
    return read_job(folder / "job.yaml")


def scara_poses(q):
    """Tool poses of the SCARA, (n, 4, 4)."""
    poses = turn((0, 0, 1), (0, 0, 0), q[:, 0]) @ shift((0.35, 0, 0.4))
    poses = poses @ turn((0, 0, 1), (0, 0, 0), q[:, 1]) @ shift((0.3, 0, -0.05))
    poses = poses @ slide((0, 0, -1), q[:, 2]) @ shift((0, 0, -0.05))
    poses = poses @ turn((0, 0, -1), (0, 0, 0), q[:, 3]) @ shift((0.03, 0, -0.05))
    poses[:, :3, :3] = poses[:, :3, :3] @ DOWN
    return poses


def gantry_poses(q, axis, tool=DOWN):
    """Tool poses of the gantry with a rotation about an axis, (n, 4, 4)."""
    poses = shift((0, 0, 1.5)) @ slide((1, 0, 0), q[:, 0]) @ slide((0, 1, 0), q[:, 1])
    poses = poses @ slide((0, 0, -1), q[:, 2]) @ shift((0, 0, -0.1))
    poses = poses @ turn(axis, (0, 0, 0), q[:, 3]) @ shift((0, 0, -0.25))
    poses[:, :3, :3] = poses[:, :3, :3] @ tool
    return poses


def sampled(trajectory):
    return trajectory(np.linspace(0.0, trajectory.duration, 2001))


def test_scara_follows_position_and_rotation_about_its_axis(tmp_path):
    arm = urdf_arm(tmp_path, SCARA)
    turned = np.array([[np.cos(1.0), np.sin(1.0), 0], [np.sin(1.0), -np.cos(1.0), 0], [0, 0, -1]])
    start = (0.4, -0.2, 0.2)
    end = (0.4, 0.2, 0.15)
    path = ac.Path.polyline([start, end]).oriented(np.stack([DOWN, turned]))
    trajectory = ac.plan(path, arm, arm.limits, ac.Optimal())
    poses = scara_poses(sampled(trajectory))
    assert distance_from_line(poses[:, :3, 3], start, end).max() < 1e-9
    share = (poses[:, 1, 3] + 0.2) / 0.4
    angle = np.unwrap(np.arctan2(poses[:, 1, 0], poses[:, 0, 0]))
    np.testing.assert_allclose(angle, share, atol=1e-8)
    assert keeps_limits(trajectory, SCARA_VELOCITY, SCARA_ACCELERATION)


def test_scara_job_with_a_free_rotation(tmp_path):
    points = "[[0.4, -0.2, 0.2], [0.45, 0, 0.2], [0.4, 0.2, 0.2]]"
    job = read(tmp_path, SCARA, points, "{axis: [0, 0, -1]}")
    result = ac.run(job).runs["w"]
    trajectory = result.trajectory
    poses = scara_poses(sampled(trajectory))
    near = [distance_from_line(poses[:, :3, 3], (0.4, y, 0.2), (0.45, 0, 0.2)) for y in (-0.2, 0.2)]
    assert np.minimum(*near).max() < 2e-3
    np.testing.assert_allclose(poses[:, :3, 2] @ [0, 0, -1.0], 1.0, atol=1e-12)
    assert keeps_limits(trajectory, SCARA_VELOCITY, SCARA_ACCELERATION)


def test_scara_follows_the_tangent_of_an_arc(tmp_path):
    arm = urdf_arm(tmp_path, SCARA)
    arc = ac.Path.arc((0.5, 0.0, 0.2), (0.3, 0.0, 0.2), via=(0.4, 0.1, 0.2))
    path = arc.following_tangent((0, 0, 1), tool=DOWN)
    trajectory = ac.plan(path, arm, arm.limits, ac.Optimal())
    poses = scara_poses(sampled(trajectory))
    from_centre = poses[:, :3, 3] - [0.4, 0.0, 0.2]
    np.testing.assert_allclose(np.linalg.norm(from_centre, axis=1), 0.1, atol=1e-9)
    np.testing.assert_allclose(from_centre[:, 2], 0.0, atol=1e-9)
    # The x axis of the tool is the tangent.
    np.testing.assert_allclose((poses[:, :3, 0] * from_centre).sum(axis=1), 0.0, atol=1e-9)


def test_scara_resumes_in_its_configuration(tmp_path):
    arm = urdf_arm(tmp_path, SCARA)
    path = ac.Path.polyline([(0.4, -0.2, 0.2), (0.4, 0.2, 0.2)])
    for oriented in (path.pointing((0, 0, -1)), path.oriented(DOWN)):
        whole = ac.trace(oriented, arm)
        rest = ac.planning.tracing.trace_rest(
            ac.geometry.path.cut_path(oriented, 0.1, 0.4), arm, whole, 0.1, 0.0
        )
        s = np.linspace(0.0, 0.3, 31)
        np.testing.assert_allclose(rest(s), whole(s + 0.1), atol=1e-6)


def test_scara_on_a_rail_and_over_a_turntable(tmp_path):
    rail = ac.Rail(axis=(0, 1, 0), lower=-1.0, upper=1.0, velocity=0.5, acceleration=2.0)
    table = ac.PositionerAxis(
        name="table", axis=(0, 0, 1), origin=(0.45, 0, 0), velocity=2.0, acceleration=5.0
    )
    plain = urdf_arm(tmp_path, SCARA)
    on_rail = plain.with_rail(rail)
    long = ac.Path.polyline([(0.4, -1.2, 0.2), (0.4, 1.2, 0.2)]).oriented(DOWN)
    trajectory = ac.plan(long, on_rail, on_rail.limits, ac.Optimal())
    q = sampled(trajectory)
    poses = slide((0, 1, 0), q[:, 0]) @ scara_poses(q[:, 1:])
    assert distance_from_line(poses[:, :3, 3], (0.4, -1.2, 0.2), (0.4, 1.2, 0.2)).max() < 1e-9
    np.testing.assert_allclose(poses[:, :3, :3], np.tile(DOWN, (len(q), 1, 1)), atol=1e-8)
    over = plain.with_positioner(ac.Positioner(axes=(table,)))
    angles = np.linspace(0, 4 * np.pi, 90)
    spiral = np.stack(
        [0.45 + 0.1 * np.cos(angles), 0.1 * np.sin(angles), 0.2 - 0.002 * angles], axis=1
    )
    path = ac.Path.polyline(spiral).pointing((0, 0, -1))
    trajectory = ac.plan(path, over, over.limits.replace(speed=0.1), ac.Optimal())
    q = sampled(trajectory)
    poses = turn((0, 0, -1), (0.45, 0, 0), q[:, 0]) @ scara_poses(q[:, 1:])
    gaps = [
        distance_from_line(poses[:, :3, 3], a, b)
        for a, b in zip(spiral[:-1], spiral[1:], strict=True)
    ]
    assert np.min(gaps, axis=0).max() < 1e-9


def test_gantry_with_one_rotation_about_the_tool(tmp_path):
    start = (-1.0, -0.5, 0.6)
    end = (1.0, 0.5, 0.7)
    path = ac.Path.polyline([start, end])
    arm = urdf_arm(tmp_path, gantry("0 0 1"))
    expected = None
    for oriented in (path, path.pointing((0, 0, -1)), path.oriented(DOWN)):
        trajectory = ac.plan(oriented, arm, arm.limits, ac.Optimal())
        q = sampled(trajectory)
        poses = gantry_poses(q, (0, 0, 1))
        assert distance_from_line(poses[:, :3, 3], start, end).max() < 1e-9
        # No motion needs the rotation, so it is held.
        np.testing.assert_allclose(q[:, 3], q[0, 3], atol=1e-9)
        assert keeps_limits(trajectory, GANTRY_VELOCITY, GANTRY_ACCELERATION)
        expected = trajectory.duration if expected is None else expected
        assert trajectory.duration == pytest.approx(expected, rel=1e-6)


def test_gantry_with_a_tilting_head_follows_axes_in_its_plane(tmp_path):
    # The head turns about y, so the tool axis is in the x-z plane.
    arm = urdf_arm(tmp_path, gantry("0 1 0"))
    axes = [(np.sin(x), 0.0, -np.cos(x)) for x in (0.0, 0.6)]
    path = ac.Path.polyline([(-0.5, -0.5, 0.6), (0.5, 0.5, 0.6)]).pointing(np.array(axes))
    trajectory = ac.plan(path, arm, arm.limits, ac.Optimal())
    q = sampled(trajectory)
    poses = gantry_poses(q, (0, 1, 0))
    assert distance_from_line(poses[:, :3, 3], (-0.5, -0.5, 0.6), (0.5, 0.5, 0.6)).max() < 1e-9
    angle = 0.6 * (poses[:, 0, 3] + 0.5)
    required = np.stack([np.sin(angle), 0 * angle, -np.cos(angle)], axis=1)
    np.testing.assert_allclose(poses[:, :3, 2], required, atol=1e-8)
    with pytest.raises(Unreachable) as error:
        ac.plan(path.pointing((0, 0.3, -1)), arm, arm.limits, ac.Optimal())
    assert error.value.limit == "orientation"
    assert error.value.needed == pytest.approx(np.arctan(0.3), rel=1e-9)


def test_rounded_angles_of_descriptions_and_paths_are_met(tmp_path):
    # A tool frame of 3.1416 rad, and orientations with six decimals that turn about z.
    arm = urdf_arm(tmp_path, gantry("0 0 1", tool="3.1416"))
    path = ac.Path.spline([(-1.0, 0, 0.6), (0.0, 0, 0.6), (1.0, 0.0, 0.6)])
    angles = (0.0, 0.4, 0.8)
    turned = [
        np.round([[np.cos(x), np.sin(x), 0], [np.sin(x), -np.cos(x), 0], [0, 0, -1]], 6)
        for x in angles
    ]
    oriented = path.oriented(np.array(turned))
    trajectory = ac.plan(oriented, arm, arm.limits, ac.Optimal())
    q = sampled(trajectory)
    rest = 3.1416
    tool = np.array([[1, 0, 0], [0, np.cos(rest), -np.sin(rest)], [0, np.sin(rest), np.cos(rest)]])
    poses = gantry_poses(q, (0, 0, 1), tool)
    assert distance_from_line(poses[:, :3, 3], (-1, 0, 0.6), (1, 0, 0.6)).max() < 1e-9
    angle = np.arctan2(poses[:, 1, 0], poses[:, 0, 0])
    at_points = np.interp([-1.0, 0.0, 1.0], poses[:, 0, 3], angle)
    np.testing.assert_allclose(at_points, angles, atol=1e-5)
    assert (np.diff(angle) > -1e-9).all()


@pytest.mark.parametrize("axis", [None, "0 0 1"])
def test_refusal_of_another_tool_axis_names_angle_and_remedy(tmp_path, axis):
    arm = urdf_arm(tmp_path, gantry(axis))
    path = ac.Path.polyline([(-1, 0, 0.6), (1, 0, 0.6)])
    with pytest.raises(Unreachable) as error:
        ac.plan(path.pointing((0.3, 0, -1)), arm, arm.limits, ac.Optimal())
    assert error.value.limit == "orientation"
    assert error.value.needed == pytest.approx(np.arctan(0.3), rel=1e-9)
    # The remedy that the message names is planned.
    assert "(0, 0, -1)" in str(error.value)
    assert ac.plan(path.pointing((0, 0, -1)), arm, arm.limits, ac.Optimal()).duration > 0


def test_gantry_without_rotation_follows_its_own_orientation_only(tmp_path):
    arm = urdf_arm(tmp_path, gantry())
    path = ac.Path.polyline([(-1, 0, 0.6), (1, 0, 0.6)])
    durations = [
        ac.plan(x, arm, arm.limits, ac.Optimal()).duration
        for x in (path, path.pointing((0, 0, -1)), path.oriented(DOWN))
    ]
    assert np.ptp(durations) == 0.0
    turned = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]])
    with pytest.raises(Unreachable) as error:
        ac.plan(path.oriented(turned), arm, arm.limits, ac.Optimal())
    assert error.value.needed == pytest.approx(np.pi / 2, rel=1e-9)
    free = path.oriented(turned, axis_only=True)
    assert ac.plan(free, arm, arm.limits, ac.Optimal()).duration == durations[0]


def test_tilting_head_requires_an_orientation(tmp_path):
    arm = urdf_arm(tmp_path, gantry("0 1 0"))
    with pytest.raises(InvalidInput):
        ac.plan(ac.Path.polyline([(-1, 0, 0.6), (1, 0, 0.6)]), arm, arm.limits, ac.Optimal())


def test_inverse_kinematics_of_a_scara(tmp_path):
    arm = urdf_arm(tmp_path, SCARA)
    q = np.array([0.3, -0.8, 0.1, 0.5])
    solutions = arm.inverse(scara_poses(q[None])[0], all=True)
    assert len(solutions) == 2
    np.testing.assert_allclose(scara_poses(solutions), scara_poses(q[None])[[0, 0]], atol=1e-9)
    tilted = scara_poses(q[None])[0] @ turn((1, 0, 0), (0, 0, 0), 0.1)[0]
    with pytest.raises(Unreachable):
        arm.inverse(tilted)


def test_job_with_a_gantry_exports_and_checks_clearance(tmp_path):
    text = gantry("0 0 1").replace(
        '<link name="head"/>',
        '<link name="head"><collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision>'
        "</link>",
    )
    points = "[[-1, -0.5, 0.6], [1, -0.5, 0.6]]"
    obstacle = "{name: post, type: box, size: [0.1, 0.1, 0.3], at: [0, -0.5, 0.9]}"
    job = read(tmp_path, text, points, "{axis: [0, 0, -1]}", f"scene: {{obstacles: [{obstacle}]}}")
    with pytest.raises(ac.Collision):
        ac.run(job)
    free = read(tmp_path, text, points, "{axis: [0, 0, -1]}", "scene: {floor: none}")
    result = ac.run(free).runs["w"]
    assert keeps_limits(result.trajectory, GANTRY_VELOCITY, GANTRY_ACCELERATION)


def test_scene_without_floor_needs_no_shapes(tmp_path):
    points = "[[-1, -0.5, 0.6], [1, -0.5, 0.6]]"
    more = "scene: {floor: none}"
    job = read(tmp_path, gantry("0 0 1"), points, "{axis: [0, 0, -1]}", more)
    assert ac.run(job).runs["w"].clearance is None
    floor = read(tmp_path, gantry("0 0 1"), points, "{axis: [0, 0, -1]}", "scene: {floor: 0 mm}")
    with pytest.raises(InvalidInput):
        ac.run(floor)
