"""Positioners: kinematics by products of exponentials, torques by pinocchio, tracing, clearance."""

import dataclasses
from pathlib import Path as FilePath

import numpy as np
import pytest
from tests.dynamics_extra import needs_dynamics, pinocchio
from tests.files.tables import refusals, rows

import armcontour as ac
from armcontour.core.frames import Frame, exp
from armcontour.files.file_keys import read_keys
from armcontour.files.job_arm import arm_of
from armcontour.files.job_model import ArmModel
from armcontour.files.scene_file import LinkShapeModel, more_link_shapes
from armcontour.robot import JointPreference, Payload
from armcontour.robot.chain import link_poses
from armcontour.robot.scene import Box, Obstacle, Scene, Sphere
from armcontour.verification.clearance import check_clearance

WORK = Frame.rpy((0.8, 0.0, 0.6), (0.1, 0.2, 0.3))
AXES = [((1.0, 0.2, 0.1), (0.9, 0.1, 0.3)), ((0.1, 0.0, 1.0), (0.8, 0.1, 0.5))]


def axis(name, along, origin, **changes):
    usual = {"lower": -7.0, "upper": 7.0, "velocity": 1.5, "acceleration": 2.0, "mass": 30.0}
    return ac.PositionerAxis(name=name, axis=along, origin=origin, **(usual | changes))


def skew(part=None, **changes):
    """A positioner with two axes in general position."""
    axes = [
        axis(name, *line, center=(0.8, 0.2, 0.5), inertia=np.diag([0.5, 0.6, 0.7]), **changes)
        for name, line in zip(("tilt", "turn"), AXES, strict=True)
    ]
    return ac.Positioner(axes=tuple(axes), part=part)


def motion(along, origin, angle):
    """Transform of a rotation about a line."""
    found = np.eye(4)
    origin = np.array(origin)
    found[:3, :3] = exp(np.array(along) / np.linalg.norm(along) * angle)
    found[:3, 3] = origin - found[:3, :3] @ origin
    return found


RAIL = ac.Rail(axis=(0.0, 1.0, 0.0), upper=2.0, velocity=1.0, acceleration=2.0, mass=50.0)


@pytest.fixture(scope="module")
def on_floor():
    """A UR10e on a rail, with its work frame on the floor."""
    return ac.load_arm("ur10e").with_work(np.eye(4)).with_rail(RAIL)


def test_the_tool_moves_relative_to_the_part(on_floor):
    arm = on_floor.with_work(WORK).with_positioner(skew())
    for q in np.random.default_rng(0).normal(size=(20, arm.dof)):
        part = motion(*AXES[0], q[1]) @ motion(*AXES[1], q[0]) @ WORK.homogeneous
        expected = np.linalg.inv(part) @ on_floor.forward(q[2:])
        np.testing.assert_allclose(arm.forward(q), expected, atol=1e-12)
    assert arm.joint_names[:3] == ("turn", "tilt", "rail")


@needs_dynamics
def test_torques_equal_those_of_a_kinematic_tree_in_pinocchio(on_floor):
    pin = pinocchio()
    part = Payload(mass=7.0, center=(0.1, 0.2, 0.3), inertia=0.2 * np.eye(3))
    arm = on_floor.with_work(WORK).with_positioner(skew(part))
    model = pin.Model()
    before = np.zeros(3)
    carried = 0
    for along, origin in AXES:
        joint = pin.JointModelRevoluteUnaligned(np.array(along) / np.linalg.norm(along))
        place = pin.SE3(np.eye(3), np.array(origin) - before)
        carried = model.addJoint(carried, joint, place, f"{origin}")
        before = np.array(origin)
        center = np.array([0.8, 0.2, 0.5]) - before
        model.appendBodyToJoint(
            carried, pin.Inertia(30.0, center, np.diag([0.5, 0.6, 0.7])), pin.SE3.Identity()
        )
    body = pin.Inertia(part.mass, np.array(part.center), np.array(part.inertia))
    model.appendBodyToJoint(carried, body, pin.SE3(WORK.rotation, WORK.position - before))
    data = model.createData()
    for q, dq, ddq in np.random.default_rng(1).normal(size=(30, 3, arm.dof)):
        torque = arm.dynamics.torque(q, dq, ddq)
        turned = (x[[1, 0]] for x in (q, dq, ddq))
        np.testing.assert_allclose(torque[[1, 0]], pin.rnea(model, data, *turned), atol=1e-9)
        rest = on_floor.dynamics.torque(q[2:], dq[2:], ddq[2:])
        np.testing.assert_allclose(torque[2:], rest, atol=1e-9)


def saddle():
    """Seam of a branch on a pipe, with the tool axis in the bisector of the walls."""
    t = np.linspace(0, 2 * np.pi, 61)
    small = 0.05
    large = 0.1
    points = np.column_stack([small * np.cos(t), small * np.sin(t), np.zeros(61)])
    points[:, 2] = np.sqrt(large**2 - points[:, 1] ** 2)
    points[-1] = points[0]
    branch = np.column_stack([np.cos(t), np.sin(t), 0 * t])
    pipe = np.column_stack([0 * t, points[:, 1], points[:, 2]]) / large
    return ac.Path.spline(points).pointing(-(branch + pipe))


TILT = np.radians(10)


def cell(tilt=TILT, holds=(None, None)):
    """A UR10e with a table that tilts and turns."""
    axes = (
        axis("tilt", (0.0, 1.0, 0.0), (0.9, 0.0, 0.3), lower=-2.0, upper=2.0),
        axis("turn", (0.0, 0.0, 1.0), (0.9, 0.0, 0.4)),
    )
    arm = ac.load_arm("ur10e").with_work(Frame((0.9, 0.0, 0.4)))
    arm = arm.with_positioner(ac.Positioner(axes=axes, tilt=tilt))
    named = zip(("tilt", "turn"), holds, strict=True)
    return arm.with_preferences({name: JointPreference(hold=x) for name, x in named})


def angles_to_gravity(arm, q):
    """Angles between tool axis and gravity [rad], from the products of the axes' motions."""
    axes = arm.chain.positioner.axes
    count = len(arm.chain.positioner.axes)
    found = []
    for row, rotation in zip(q, arm.forward(q)[:, :3, :3], strict=True):
        part = np.eye(4)
        for x, angle in zip(axes, row[:count][::-1], strict=True):
            part = part @ motion(x.axis, x.origin, angle)
        part = part[:3, :3] @ arm.chain.base.rotation.T
        found.append(np.arccos(np.clip(-(part @ rotation[:, 2])[2], -1, 1)))
    return np.array(found)


def test_a_weld_stays_within_its_angle_to_gravity():
    path = saddle()
    arm = cell()
    speed = 6e-3
    planned = ac.plan(path, arm, limits=ac.Limits(speed=speed))
    t = np.linspace(0, planned.duration, 3000)
    q, dq, ddq = (planned(t, k) for k in range(3))
    assert angles_to_gravity(arm, q).max() < np.radians(10)
    assert np.ptp(q[:, 0]) > 5.0
    limits = planned.limits
    for values, most in ((dq, limits.joint_velocity), (ddq, limits.joint_acceleration)):
        assert (np.abs(values) / most).max() < 1 + 1e-9
    points = arm.forward(q)[:, :3, 3]
    assert path.project(points).distance.max() < 1e-9
    assert np.linalg.norm(arm.tool_twist(q, dq)[:, :3], axis=1).max() < speed * (1 + 1e-9)


def test_a_table_that_cannot_reach_the_angle_to_gravity_is_refused():
    arm = cell(holds=(0.3, 0.2))
    with pytest.raises(ac.Unreachable) as error:
        ac.trace(saddle(), arm)
    assert error.value.limit == "hold"
    assert error.value.joint in (0, 1)


def test_axes_of_a_positioner_that_are_held_do_not_move():
    joint_path = ac.trace(saddle(), cell(tilt=None, holds=(0.8, None)))
    q = joint_path(np.linspace(0, joint_path.length, 200))
    assert (q[:, 1] == 0.8).all()
    assert np.ptp(q[:, 0]) > 0.5


@needs_dynamics
@pytest.mark.parametrize("seed", range(12))
def test_motions_reported_as_clear_have_no_sample_in_contact(seed):
    # The part and the obstacles are balls, whose distances are those of their centres.
    rng = np.random.default_rng(seed)
    arm = cell(tilt=None)
    part = Obstacle("part", Sphere(0.05), place=Frame(rng.uniform(-0.2, 0.2, 3)), fixed_to="part")
    places = np.array([0.9, 0.0, 0.4]) + rng.normal(size=(3, 3)) * 0.25
    balls = [Obstacle(f"ball {k}", Sphere(0.04), place=Frame(x)) for k, x in enumerate(places)]
    scene = Scene((part, *balls), floor="none")
    ends = rng.uniform(-1.0, 1.0, (4, arm.dof)) + np.array([0, 0, 0, -1.5, 1.5, 0, 0, 0])
    planned = ac.plan(ac.JointPath.spline(ends), arm)
    found = check_clearance(planned, arm, scene)
    pairs = {frozenset((x.first, x.second)): x for x in found.pairs}
    t = np.linspace(0, planned.duration, 400)
    centre = np.array([*part.place.position, 1.0])
    axes = arm.chain.positioner.axes
    for k, place in enumerate(places):
        distances = []
        for q in planned(t):
            moved = motion(axes[0].axis, axes[0].origin, q[1])
            moved = moved @ motion(axes[1].axis, axes[1].origin, q[0])
            moved = moved @ arm.chain.base.inverse.homogeneous @ centre
            distances.append(np.linalg.norm(moved[:3] - place) - 0.09)
        pair = pairs[frozenset(("part", f"ball {k}"))]
        assert pair.low <= min(distances) + 1e-9


@needs_dynamics
def test_a_table_below_the_part_moves_with_it():
    arm = cell(tilt=None)
    table = Obstacle("table", Box((0.4, 0.4, 0.02)), place=Frame((0, 0, -0.02)), fixed_to="part")
    post = Obstacle("post", Sphere(0.02), place=Frame((1.2, 0.0, 0.4)))
    still = np.tile([0.0, 0.0, 0.0, -1.5, 1.5, 0.0, 0.0, 0.0], (3, 1))
    still[:, 2] = 0.0, 0.1, 0.2
    tilted = still.copy()
    tilted[:, 1] = 0.0, 0.5, 1.0
    pairs = []
    for q in (still, tilted):
        planned = ac.plan(ac.JointPath.spline(q), arm)
        found = check_clearance(planned, arm, Scene((table, post), floor="none")).pairs
        pairs += [x for x in found if {x.first, x.second} == {"table", "post"}]
    assert pairs[0].high == pytest.approx(0.08, abs=2e-3)
    assert pairs[1].high < pairs[0].high


def test_invalid_positioners_are_refused(on_floor):
    with pytest.raises(ac.InvalidInput, match="range"):
        axis("turn", (0, 0, 1), (0, 0, 0), lower=1.0, upper=1.0)
    with pytest.raises(ac.InvalidInput, match="same name"):
        dataclasses.replace(skew(), axes=(skew().axes[0],) * 2)
    with pytest.raises(ac.InvalidInput, match="already"):
        on_floor.with_positioner(skew()).with_positioner(skew())
    with pytest.raises(ac.InvalidInput, match="rail first"):
        ac.load_arm("ur10e").with_positioner(skew()).with_rail(RAIL)


def test_shapes_of_a_job_are_in_the_frame_of_the_base_with_the_axes_at_zero():
    shapes = [
        {"link": link, "name": f"on {link}", "type": "sphere", "radius": 0.01, "at": [0.5, 0, 0.2]}
        for link in ("base", "tilt", "turn")
    ]
    lines = [dict(zip(("axis", "origin"), map(list, x), strict=True)) for x in AXES]
    usual = {"lower": -1, "upper": 1, "velocity": 1, "acceleration": 1}
    axes = [{"name": n, **x, **usual} for n, x in zip(("tilt", "turn"), lines, strict=True)]
    model = read_keys(ArmModel, {"name": "ur10e", "positioner": {"axes": axes}, "shapes": shapes})
    arm = arm_of(model, FilePath())
    poses = link_poses(arm.chain, np.zeros((1, arm.dof)))[0]
    added = [x for x in arm.shapes.shapes if x.name.startswith("on ")]
    assert [x.link for x in added] == [2, 1, 0]
    for x in added:
        point = poses[x.link, :, :3] @ x.place.position + poses[x.link, :, 3]
        np.testing.assert_allclose(point, [0.5, 0.0, 0.2], atol=1e-12)


ROBOT = FilePath(__file__).parents[1] / "files" / "robots" / "data" / "robot.urdf"
# A post that is fixed to the floor, and a frame and a table that turn.
POST = Frame.rpy((0.9, 0.1, 0.3), (0.1, 0.2, 0.3))
FRAME = Frame.rpy((0.0, 0.05, 0.2), (0.3, 0.0, 0.1))
TABLE = Frame.rpy((0.02, 0.0, 0.05), (0.0, 0.1, 0.4))
POSITIONER = """
<link name="post"/><link name="frame">{frame}{ball}</link><link name="turned">{turned}</link>
<link name="table">{ball}</link>
<joint name="stand" type="fixed"><origin xyz="0.9 0.1 0.3" rpy="0.1 0.2 0.3"/>
  <parent link="world"/><child link="post"/></joint>
<joint name="swing" type="revolute"><parent link="post"/><child link="frame"/><axis xyz="0 2 0"/>
  <limit lower="-2" upper="1.5" effort="300" velocity="1.2"/></joint>
<joint name="turn" type="revolute"><origin xyz="0 0.05 0.2" rpy="0.3 0 0.1"/>
  <parent link="frame"/><child link="turned"/><axis xyz="0 0 1"/>
  <limit lower="-7" upper="7" effort="200" velocity="1.5"/><dynamics damping="0.4"/></joint>
<joint name="plate" type="fixed"><origin xyz="0.02 0 0.05" rpy="0 0.1 0.4"/>
  <parent link="turned"/><child link="table"/></joint></robot>"""
BODY = """<inertial><origin xyz="0.01 0.02 0.03" rpy="0.2 0 0.1"/><mass value="{}"/>
<inertia ixx="0.5" ixy="0.01" ixz="0" iyy="0.6" iyz="0" izz="0.7"/></inertial>"""
BALL = "<collision><geometry><sphere radius='0.05'/></geometry></collision>"


def described_cell(folder, *changes, **options):
    """The lifter as an arm on a rail, with a positioner, from one file."""
    text = ROBOT.read_text().replace("</robot>", POSITIONER)
    changes = (
        ('name="lift"', 'name="rail"'), ('rpy="0 0 0.7"', ""), ("{ball}", BALL),
        ("{frame}", BODY.format(30)), ("{turned}", BODY.format(20)),
        ('<link name="world"/>', f'<link name="world">{BALL}</link>'),
        ('<link name="column">', f'<link name="column">{BALL}'),
        ('<link name="upper">', f'<link name="upper">{BALL}'), *changes,
    )  # fmt: skip
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    (folder / "cell.urdf").write_text(text)
    keys = {"file": "cell.urdf", "tip": "tcp", "part": "table"} | options
    return arm_of(read_keys(ArmModel, keys), folder)


@needs_dynamics
def test_a_description_of_the_cell_is_the_arm_with_rail_and_positioner(tmp_path):
    described = described_cell(tmp_path, tilt="10 deg")
    turned = POST @ FRAME
    body = Frame.rpy((0.01, 0.02, 0.03), (0.2, 0.0, 0.1))
    tensor = np.array([[0.5, 0.01, 0], [0.01, 0.6, 0], [0, 0, 0.7]])
    axes = []
    for name, frame, along, *values in (
        ("swing", POST, (0, 1, 0), -2, 1.5, 1.2, 300, 30),
        ("turn", turned, (0, 0, 1), -7, 7, 1.5, 200, 20),
    ):
        lower, upper, speed, torque, mass = values
        place = frame @ body
        axes.append(
            ac.PositionerAxis(
                name=name, axis=frame.rotation @ along, origin=frame.position, lower=lower,
                upper=upper, velocity=speed, acceleration=speed, torque=torque, mass=mass,
                center=place.position, inertia=place.rotation @ tensor @ place.rotation.T,
            )
        )  # fmt: skip
    rail = ac.Rail(
        axis=(0, 0, 1), origin=(0.1, 0.2, 0.7), upper=0.5, velocity=0.2, acceleration=0.2,
        force=900, mass=30,
    )  # fmt: skip
    lifter = ac.load_arm(ROBOT, base="base_link", tip="tcp", work=turned @ TABLE)
    arm = lifter.with_rail(rail).with_positioner(ac.Positioner(axes=axes, tilt=TILT))
    arm = arm.with_dynamics(viscous=[0.4, *[0] * 2, *lifter.chain.viscous])
    assert described.joint_names == arm.joint_names
    assert described.chain.positioner.tilt == pytest.approx(TILT)
    at_zero = (
        ("swing", "frame", POST), ("turn", "table", turned @ TABLE), ("base", "world", Frame()),
        ("rail", "column", Frame((0, 0, 0.4))), ("tilt", "upper", Frame()),
    )  # fmt: skip
    balls = [
        {"link": x, "name": name, "type": "sphere", "radius": 0.05, "at": frame.position.tolist()}
        for x, name, frame in at_zero
    ]
    balls = more_link_shapes([read_keys(LinkShapeModel, x) for x in balls], tmp_path, arm)
    found = sorted(described.shapes.shapes, key=lambda x: x.name)
    expected = sorted(balls, key=lambda x: x.name)
    assert [(x.name, x.link) for x in found] == [(x.name, x.link) for x in expected]
    for q, dq, ddq in np.random.default_rng(2).normal(size=(20, 3, arm.dof)):
        np.testing.assert_allclose(described.forward(q), arm.forward(q), atol=1e-12)
        torques = [x.torque(q, dq, ddq) for x in (described, arm)]
        np.testing.assert_allclose(*torques, rtol=1e-12, atol=1e-9)
        centers = []
        for shapes, chain in ((found, described.chain), (expected, arm.chain)):
            poses = link_poses(chain, q[None])[0]
            centers.append([poses[x.link] @ [*x.place.position, 1] for x in shapes])
        np.testing.assert_allclose(*centers, atol=1e-12)
    for name in ("lower", "upper", "velocity", "acceleration", "torque"):
        values = [getattr(x.limits, f"joint_{name}") for x in (described, arm)]
        np.testing.assert_array_equal(*values)


NO_CELLS = """
table => tabel => part must be a link of ... 'tabel'
table => upper => part upper ... on the branch of the arm ... tilt
table => post => No joint moves between base and part
<axis xyz="0 2 0"/> => <axis xyz="0 2 0"/><mimic joint="turn"/> => swing ... mimics
"""


def test_descriptions_without_a_branch_for_the_part_are_refused(tmp_path):
    table = [(x, words) for *x, words in rows(NO_CELLS)]

    def load(change):
        if change[0] == "table":
            return described_cell(tmp_path, part=change[1])
        return described_cell(tmp_path, change)

    refusals(load, table)
    with pytest.raises(ac.InvalidInput, match="requires part"):
        ac.load_arm(ROBOT, base="base_link", tip="tcp", tilt=0.1)
