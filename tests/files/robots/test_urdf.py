"""Arms from robot descriptions: chain, bodies on the chain, and refusals."""

import re
from pathlib import Path as FilePath

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation
from tests.dynamics_extra import pinocchio
from tests.files.tables import refusals, rows

import armcontour as ac
from armcontour.core.file_access import ENDINGS
from armcontour.core.frames import Frame

DATA = FilePath(__file__).parent / "data"
ROBOT = DATA / "robot.urdf"
TEXT = ROBOT.read_text()
TURNING = ("pan", "tilt", "elbow", "roll")


WHOLE = {"base": "base_link", "tip": "tcp"}


def load(tmp_path, *changes, file="robot.urdf", **options):
    """Load the robot with parts of its text replaced."""
    text = TEXT
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    (tmp_path / file).write_text(text)
    return ac.load_arm(tmp_path / file, **WHOLE | options)


def original_arm(*, tool=None, work=None, **options):
    """Load the arm from the unchanged file."""
    return ac.load_arm(ROBOT, **WHOLE | options, tool=tool, work=work)


def compute_with_mujoco(q, dq, ddq, held):
    """Torques and positions of the tip from MuJoCo's own reader of the file."""
    mujoco = pytest.importorskip("mujoco")
    # MuJoCo must keep the frames; the mesh files do not exist.
    compiler = '<mujoco><compiler fusestatic="false"/></mujoco>'
    text = TEXT.replace('<robot name="lifter">', f'<robot name="lifter">{compiler}')
    text = text.replace("<visual>", "<!--").replace("</visual>", "-->")
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    dofs = [model.joint(name).dofadr[0] for name in TURNING]
    model.dof_damping[:] = model.dof_frictionloss[:] = 0
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT
    torques_and_poses = []
    for state in zip(q, dq, ddq, strict=True):
        data.qpos[:] = data.qvel[:] = data.qacc[:] = 0
        for name, value in held.items():
            data.qpos[model.joint(name).qposadr[0]] = value
        data.qpos[dofs], data.qvel[dofs], data.qacc[dofs] = state
        mujoco.mj_inverse(model, data)
        base = data.body("base_link")
        tip = data.body("tcp")
        turn = base.xmat.reshape(3, 3).T
        torques_and_poses.append((data.qfrc_inverse[dofs].copy(), turn @ (tip.xpos - base.xpos)))
    return tuple(np.array(x) for x in zip(*torques_and_poses, strict=True))


def test_the_arm_with_its_gripper_has_the_dynamics_of_mujoco():
    arm = original_arm()
    assert (arm.name, arm.joint_names) == ("lifter", TURNING)
    q, dq, ddq = np.random.default_rng(0).normal(size=(3, 200, 4))
    torque, place = compute_with_mujoco(q, dq, ddq, {"left": 0.0, "right": 0.01, "hinge": 0.0})
    np.testing.assert_allclose(arm.tool_position(q), place, atol=1e-9)
    largest = np.abs(torque).max(axis=1, keepdims=True)
    assert (np.abs(arm.dynamics.torque(q, dq, ddq) - torque) <= 1e-8 * largest).all()


def compare_with_pinocchio(arm, text, held):
    """Compare frames, bodies and torques of an arm with those of pinocchio's own reader."""
    pin = pinocchio()
    whole = pin.buildModelFromXML(text)
    q = pin.neutral(whole)
    fixed = [x for x in list(whole.names)[1:] if x not in arm.joint_names]
    for name in fixed:
        joint = whole.joints[whole.getJointId(name)]
        angle = held.get(name, 0.0)
        # The state of a continuous joint is cosine and sine of its angle.
        q[joint.idx_q : joint.idx_q + joint.nq] = (
            angle if joint.nq == 1 else (np.cos(angle), np.sin(angle))
        )
    model = pin.buildReducedModel(whole, [whole.getJointId(x) for x in fixed], q)
    chain = arm.chain
    assert tuple(model.names)[1:] == chain.joints

    def same(actual, expected):
        expected = np.array(expected)
        np.testing.assert_allclose(actual, expected, atol=1e-14 * (1 + np.abs(expected).max()))

    bodies = list(model.inertias)[1:]
    places = list(model.jointPlacements)[1:]
    same(chain.masses, [x.mass for x in bodies])
    same(chain.centers, [x.lever for x in bodies])
    same(chain.inertias, [x.inertia for x in bodies])
    same(chain.rotations, [x.rotation for x in places])
    same(chain.positions, [x.translation for x in places])
    tip = model.frames[model.getFrameId("tcp")].placement
    same(chain.tip.position, tip.translation)
    same(chain.tip.rotation, tip.rotation)
    data = model.createData()
    states = np.random.default_rng(5).normal(size=(20, 3, len(chain)))
    for q, dq, ddq in states:
        ends = [joint.nq for joint in list(model.joints)[1:]]
        values = [[x] if n == 1 else [np.cos(x), np.sin(x)] for x, n in zip(q, ends, strict=True)]
        torque = pin.rnea(model, data, np.concatenate(values), dq, ddq)
        same(arm.dynamics.torque(q, dq, ddq) / 100, torque / 100)


def test_frames_and_bodies_and_torques_equal_those_of_pinocchio(tmp_path):
    arm = load(tmp_path, base=None)
    assert arm.chain.prismatic == (True, False, False, False, False)
    compare_with_pinocchio(arm, TEXT, {"left": 0.0, "right": 0.01})


@pytest.mark.parametrize("seed", range(4))
def test_random_urdf_files_are_read_like_pinocchio_does(tmp_path, seed):
    rng = np.random.default_rng(seed)

    def words(low, high, count=3):
        return " ".join(map(repr, rng.uniform(low, high, count).tolist()))

    links = ['<link name="l0"/>']
    joints = []
    for k in range(1, 16):
        if k % 5 == 0:
            kind = "fixed"
        elif k % 4 == 3:
            kind = "prismatic"
        else:
            kind = "revolute"
        name = "tcp" if k == 15 else f"l{k}"
        # These moments satisfy the triangle inequality.
        xx, yy = rng.uniform(0.02, 0.03, 2)
        links.append(
            f'<link name="{name}"><inertial><origin xyz="{words(-0.3, 0.3)}" rpy="{words(-3, 3)}"/>'
            f'<mass value="{rng.uniform(0.1, 5)}"/><inertia ixx="{xx}" ixy="0.001" ixz="-0.002" '
            f'iyy="{yy}" iyz="0.0015" izz="0.025"/></inertial></link>'
        )
        # Some links are side branches of the chain.
        parent = f"l{k - 2 if (k - 1) % 3 == 0 and k > 1 else k - 1}"
        joints.append(
            f'<joint name="j{k}" type="{kind}"><origin xyz="{words(-1, 1)}" rpy="{words(-4, 4)}"/>'
            f'<parent link="{parent}"/><child link="{name}"/><axis xyz="{words(-1, 1)}"/>'
            '<limit lower="-2" upper="2" effort="9" velocity="1"/></joint>'
        )
    text = f'<robot name="random">{"".join(links + joints)}</robot>'
    (tmp_path / "random.urdf").write_text(text)
    arm = ac.load_arm(tmp_path / "random.urdf", tip="tcp")
    assert len(arm.chain) > 5
    compare_with_pinocchio(arm, text, {})


def test_the_arm_has_the_values_of_its_description():
    arm = original_arm()
    limits = arm.limits
    np.testing.assert_array_equal(limits.joint_velocity, [2, 1.5, 2.5, 4])
    np.testing.assert_array_equal(limits.joint_torque, [80, 70, 40, 15])
    np.testing.assert_array_equal(limits.joint_lower, [-np.inf, -2, -2.5, -3])
    np.testing.assert_array_equal(limits.joint_upper, [np.inf, 1.5, 2.5, 3])
    # Default: the maximum velocity is reached in one second.
    np.testing.assert_array_equal(limits.joint_acceleration, limits.joint_velocity)
    assert [x for x in arm.notes if "no acceleration limits" in x] and arm.limits_hint == ""
    np.testing.assert_array_equal(arm.chain.viscous, [0.5, 0, 0.1, 0])
    np.testing.assert_array_equal(arm.chain.coulomb, [1.5, 0, 0, 0])
    np.testing.assert_allclose(arm.chain.axes[1], [0, np.sqrt(0.5), np.sqrt(0.5)])
    np.testing.assert_array_equal(arm.chain.axes[3], [1, 0, 0])  # by default
    # The last mass includes wrist, hand and fingers.
    np.testing.assert_allclose(arm.chain.masses, [4, 3, 2.4, 1.6])
    assert arm.source.endswith("robot.urdf")


def test_the_chain_can_begin_and_end_at_chosen_links():
    flange = original_arm(tip="flange")
    whole = original_arm()
    q, dq, ddq = np.random.default_rng(1).normal(size=(3, 20, 4))
    # The torques do not depend on the position of the tip.
    np.testing.assert_allclose(flange.torque(q, dq, ddq), whole.torque(q, dq, ddq), atol=1e-12)
    assert np.abs(flange.tool_position(q) - whole.tool_position(q)).max() > 0.05
    assert original_arm(base="upper").joint_names == ("elbow", "roll")
    held = original_arm(tip="upper")
    assert held.joint_names == ("pan", "tilt")
    q[:, 2:] = 0.0
    expected = whole.dynamics.torque(q, 0 * q, 0 * q)[:, :2]
    torque = held.dynamics.torque(q[:, :2], 0 * q[:, :2], 0 * q[:, :2])
    np.testing.assert_allclose(torque, expected, atol=1e-9)


def test_a_description_without_inertial_elements_has_kinematics_only(tmp_path):
    text = re.sub("<inertial>.*?</inertial>", "", TEXT, flags=re.DOTALL)
    arm = load(tmp_path, (TEXT, text))
    whole = original_arm()
    assert arm.chain.masses is None
    np.testing.assert_array_equal(arm.tool_position(np.ones(4)), whole.tool_position(np.ones(4)))
    refusals(lambda x: x.dynamics, [(arm, "masses of the arm lifter")])
    # Without masses, effort limits are ignored instead of refused.
    assert arm.limits.joint_torque is None and whole.limits.joint_torque is not None
    assert any("effort limits are ignored" in note for note in arm.notes)
    # Tool and work frames are supported.
    tool = Frame.rpy([0, 0.1, 0.2], [0.1, 0, 0])
    points, rotations = whole.pose(np.ones(4))
    moved = original_arm(tool=tool, work=Frame()).tool_position(np.ones(4))
    np.testing.assert_allclose(moved, points + rotations @ tool.position)


QUATERNIONS = """
0.5 0.5 -0.5 => must be 4 numbers ... '0.5 0.5 -0.5'
0 0 0 0 => length 1 within 0.001, but has 0
0 0 1 1 => length 1 within 0.001, but has 1.41421
0 0 nan 1 => must be 4 numbers ... nan
"""


def test_origins_may_have_quaternions(tmp_path):
    first = '<robot name="lifter">'
    last = 'rpy="1.2 0 0.3"'
    place = Frame.rpy((0, 0, 0), (1.2, 0, 0.3))
    version = (first, '<robot name="lifter" version="1.2">')
    # Four printed digits of a quaternion are enough.
    for number, error in (("{:.17g}", 1e-15), ("{:.4f}", 1e-4)):
        words = " ".join(number.format(x) for x in Rotation.from_matrix(place.rotation).as_quat())
        arm = load(tmp_path, version, (last, f'quat_xyzw="{words}"'))
        q = np.random.default_rng(2).normal(size=(20, 4))
        np.testing.assert_allclose(
            arm.tool_position(q), original_arm().tool_position(q), rtol=0, atol=error
        )
    table = [(f'quat_xyzw="{x}"', f"quat_xyzw ... {words}") for x, words in rows(QUATERNIONS)]
    table.append((f'{last} quat_xyzw="0 0 0 1"', "rpy and quat_xyzw. Remove one"))
    refusals(lambda x: load(tmp_path, version, (last, x)), table, "oint tilt")
    # ROS ignores a quaternion in a file of URDF 1.0.
    for old in (first, '<robot name="lifter" version="1.0">'):
        change = ((first, old), (last, 'quat_xyzw="0 0 0 1"'))
        refusals(lambda x: load(tmp_path, *x), [(change, "'tilt' ... version=\"1.1\"")])


UNKNOWN = """
<axis xyz="0 1 1"/> => <axis xyz="0 1 1" rpy="1 0 0"/> => <axis> of ... 'tilt' ... rpy
effort="40" velocity="2.5" => effort="40" max_velocity="2.5" => <limit> of ... max_v
name="elbow" type="revolute" => name="elbow" type="revolute" offset="1" => <joint> of ... offset,
<origin xyz="0.4 0 0.02" => <origin quat="0 0 0 1" xyz="0.4 0 0.02" => <origin> of ... quat,
<origin xyz="0.15 0 0.03"/> => <origin xyz="0.15 0 0.03" yaw="1"/> => link 'upper' ... yaw
"""


def test_unknown_attributes_are_refused(tmp_path):
    table = [((old, new), words) for old, new, words in rows(UNKNOWN)]
    refusals(lambda x: load(tmp_path, x), table, "robot.urdf", "URDF 1.0 does not have")
    kind = 'name="elbow" type="revolute"'
    assert load(tmp_path, (kind, f'{kind} dont_collapse="true"')).dof == 4


def test_acceleration_and_jerk_limits_of_a_description_are_read(tmp_path):
    elbow = 'effort="40" velocity="2.5"'
    more = 'acceleration="8" deceleration="6" jerk="50"'
    arm = load(tmp_path, (elbow, f"{elbow} {more}"))
    # Accelerations of the other joints are assumed from their velocities.
    np.testing.assert_array_equal(arm.limits.joint_acceleration, [2, 1.5, 6, 4])
    np.testing.assert_array_equal(arm.limits.joint_jerk, [np.inf, np.inf, 50, np.inf])
    assert any("no acceleration limits of pan, tilt, roll" in x for x in arm.notes)
    assert any("no jerk of pan, tilt, roll" in x for x in arm.notes)
    only = load(tmp_path, (elbow, f'{elbow} deceleration="6"'))
    assert only.limits.joint_acceleration[2] == 6
    text = re.sub('velocity="', 'acceleration="8" jerk="50" velocity="', TEXT)
    arm = load(tmp_path, (TEXT, text))
    np.testing.assert_array_equal(arm.limits.joint_acceleration, [8] * 4)
    np.testing.assert_array_equal(arm.limits.joint_jerk, [50] * 4)
    assert not any("acceleration" in x or "jerk" in x for x in arm.notes)


BAD = """
link name="cover" => link => a link without a name
joint name="elbow" => joint name="tilt" => two joints ... tilt
<child link="wrist"/> => <child link="lower"/> => has two parent joints ... elbow and roll
<parent link="world"/> => <parent link="tcp"/> => loop
<link name="world"/> => <link name="world"/><link name="lost"/> => without a parent joint ... lost
name="elbow" type="revolute" => name="elbow" type="ball" => elbow ... 'ball'
name="elbow" type="revolute" => name="elbow" type="planar" => elbow ... planar ... prismatic
<limit lower="-2.5" => <mimic joint="absent"/><limit lower="-2.5" => elbow ... mimics absent
effort="40" velocity="2.5" => effort="40" velocity="fast" => velocity ... joint elbow ... 'fast'
lower="-2.5" upper="2.5" => => lower end of the range of joint elbow
lower="-2.5" upper="2.5" => lower="2.5" upper="-2.5" => range of joint elbow ... from 2.5 to -2.5
lower="-1" upper="1" effort="1" => lower="1" upper="-1" effort="1" => joint hinge ... 1 to -1 rad
<mass value="2"/> => <mass/> => link lower of ... value of the mass
<axis xyz="0 1 1"/> => <axis xyz="0 0 0"/> => Joint tilt of ... zero axis
<dynamics damping="0.1"/> => <dynamics damping="-0.1"/> => elbow ... damping of joint elbow
<mimic joint="left" => <mimic joint="right" => right ... must mimic an existing joint
"""
NO_ROBOTS = """
solid gripper => is not valid XML ... line 1
<mujoco/> => is not a robot description ... <mujoco>
<robot name="r"/> => without links
<robot xmlns:xacro="http://ros.org/wiki/xacro"><xacro:arm/></robot> => xacro
"""


def test_descriptions_without_an_arm_are_refused(tmp_path):
    table = [((old, new), words) for old, new, words in rows(BAD)]
    table += [((TEXT, text), words) for text, words in rows(NO_ROBOTS)]
    refusals(lambda x: load(tmp_path, x), table, "robot.urdf")
    absent = [(tmp_path / "no.urdf", "no robot ... no.urdf")]
    refusals(ac.load_arm, absent)


LIMITS = """joint_limits:
  elbow: {has_effort_limits: true, max_effort: 33, has_velocity_limits: true, max_velocity: 1.25}
"""


ELBOW = '<limit lower="-2.5" upper="2.5" effort="40" velocity="2.5"/>'


def test_soft_limits_narrow_the_range(tmp_path):
    for soft, lower, upper in (
        ('soft_lower_limit="-1" soft_upper_limit="0.5"', -1, 0.5),
        ('soft_lower_limit="-9" soft_upper_limit="0.5"', -2.5, 0.5),
        # Controllers of the speed alone.
        ("", -2.5, 2.5),
        ('soft_lower_limit="0" soft_upper_limit="0"', -2.5, 2.5),
    ):
        arm = load(tmp_path, (ELBOW, f'{ELBOW}<safety_controller {soft} k_velocity="9"/>'))
        assert (arm.limits.joint_lower[2], arm.limits.joint_upper[2]) == (lower, upper), soft
    endless = '<limit effort="80" velocity="2"/>'
    soft = 'safety_controller soft_lower_limit="-1" soft_upper_limit="1" k_velocity="9"'
    arm = load(tmp_path, (endless, f"{endless}<{soft}/>"))
    assert arm.limits.joint_lower[0] == -np.inf
    file = tmp_path / "limits.yaml"
    for switch, lower in (
        ("has_soft_limits: true, ", -1),
        ("", -1),
        ("has_soft_limits: false, ", -2),
    ):
        limits = f"{{{switch}soft_lower_limit: -1, soft_upper_limit: 1, min_position: -2}}"
        file.write_text(f"joint_limits: {{elbow: {limits}}}")
        arm = original_arm(joint_limits=file)
        assert arm.limits.joint_lower[2] == lower
        assert arm.limits.joint_upper[2] == (1 if lower == -1 else 2.5)


def test_ranges_that_look_like_degrees_are_refused(tmp_path):
    def changed(low, high):
        return (ELBOW, ELBOW.replace("-2.5", f"{low}", 1).replace('upper="2.5"', f'upper="{high}"'))

    words = "range of joint elbow from {} to {} rad ... degrees ... joint_limits.yaml"
    ends = ((-170, 170), (-120, 0), (0, 350), (-540, 540))
    refusals(lambda x: load(tmp_path, changed(*x)), [(x, words.format(*x)) for x in ends])
    # Descriptions without ranges have numbers such as these; a usual wrist turns 2.5 times.
    for ends in ((-1000, 1000), (-1e9, 1e9), (-15.71, 15.71)):
        assert load(tmp_path, changed(*ends)).limits.joint_upper[2] == ends[1]
    file = tmp_path / "limits.yaml"
    file.write_text("joint_limits: {elbow: {min_position: -170, max_position: 170}}")
    arm = load(tmp_path, changed(-170, 170), joint_limits=file)
    assert arm.limits.joint_upper[2] == 170


def test_limits_of_zero_or_less_are_ignored(tmp_path):
    elbow = 'effort="40" velocity="2.5"'
    for effort, velocity, lacking in (
        ("0", "2.5", "effort"),
        ("40", "0", "velocity"),
        ("40", "-1", "velocity"),
        ("0", "0", "velocity of elbow and no effort"),
    ):
        change = (elbow, f'effort="{effort}" velocity="{velocity}"')
        arm = load(tmp_path, change)
        (note,) = (x for x in arm.notes if "values of at most 0 are ignored" in x)
        assert note.startswith(f"robot.urdf: it has no {lacking} of elbow")
        # The limits of the other joints remain.
        torque = np.inf if "no effort" in note else 40
        speed = np.inf if "no velocity" in note else 2.5
        np.testing.assert_array_equal(arm.limits.joint_torque, [80, 70, torque, 15])
        np.testing.assert_array_equal(arm.limits.joint_velocity, [2, 1.5, speed, 4])
        # Without the speed of a joint no accelerations are assumed.
        assert (arm.limits.joint_acceleration is None) == ("no velocity" in note)
    # With the values from elsewhere nothing is lacking.
    (tmp_path / "joint_limits.yaml").write_text(LIMITS)
    arm = load(tmp_path, change, joint_limits=tmp_path / "joint_limits.yaml")
    np.testing.assert_array_equal(arm.limits.joint_torque, [80, 70, 33, 15])
    np.testing.assert_array_equal(arm.limits.joint_velocity, [2, 1.5, 1.25, 4])
    assert not any("ignored" in x for x in arm.notes)
    change = ('effort="80" velocity="2"', 'effort="0" velocity="2"')
    arm = load(tmp_path, change, joint_limits=tmp_path / "joint_limits.yaml")
    np.testing.assert_array_equal(arm.limits.joint_torque, [np.inf, 70, 33, 15])
    assert any("no effort of pan (" in x for x in arm.notes)


def test_joints_without_a_limit_element_are_unlimited(tmp_path):
    arm = load(tmp_path, ('<limit effort="80" velocity="2"/>', ""))
    np.testing.assert_array_equal(arm.limits.joint_velocity, [np.inf, 1.5, 2.5, 4])
    assert arm.limits.joint_torque[0] == arm.limits.joint_upper[0] == np.inf
    limit = '<limit lower="-2.5" upper="2.5" effort="40" velocity="2.5"/>'
    arm = load(tmp_path, (limit, ""))
    assert arm.limits.joint_upper[2] == np.inf and arm.limits.joint_upper[1] == 1.5
    assert any("no range of elbow" in note for note in arm.notes)


NO_BODIES = """
<mass value="2"/> => <mass value="0"/> => link lower, which a joint moves, has the mass 0 kg
<mass value="2"/> => <mass value="-2"/> => link lower has the mass -2 kg
"0.02" iyz="0" izz="0.02" => "0.02" iyz="0" izz="0.2" => the inertia of the link lower
<mimic joint="left" => <mimic joint="roll" => joint right moves a mass along with joint roll
"""


def test_links_without_mass_remove_only_the_dynamics(tmp_path):
    upper = re.search('<link name="upper">.*?(<inertial>.*?</inertial>)', TEXT, re.DOTALL)[1]
    table = [*rows(NO_BODIES), (upper, "", "the link upper has no mass")]
    whole = original_arm()
    for old, new, words in table:
        arm = load(tmp_path, (old, new))
        assert not arm.has_bodies and arm.limits.joint_torque is None
        assert any(words in note and "effort limits are ignored" in note for note in arm.notes)
        q = np.random.default_rng(3).normal(size=(20, 4))
        np.testing.assert_array_equal(arm.tool_position(q), whole.tool_position(q))
        refusals(lambda x: x.dynamics, [(arm, "masses of the arm lifter")])


IMPLAUSIBLE = """
<mass value="2"/> => <mass value="2e6"/> => the link lower has the mass 2e+06 kg
"0.02" iyz="0" izz="0.02" => "2e4" iyz="0" izz="2e4" => lower has a moment of inertia of 2e+04 kg m²
"""


def test_implausible_masses_and_inertias_are_noted_and_kept(tmp_path):
    assert not any("no link of an arm has" in x for x in original_arm().notes)
    for old, new, words in rows(IMPLAUSIBLE):
        arm = load(tmp_path, (old, new))
        assert arm.has_bodies
        assert any(words in x and "no link of an arm has" in x for x in arm.notes), arm.notes


def test_faults_of_several_links_are_named_with_their_figures(tmp_path):
    mass = re.search('<link name="upper">.*?(<mass value="[^"]*"/>)', TEXT, re.DOTALL)[1]
    text = TEXT.replace('<mass value="2"/>', '<mass value="-2"/>').replace(
        mass, '<mass value="-3"/>', 1
    )
    (tmp_path / "robot.urdf").write_text(text)
    (note,) = [x for x in ac.load_arm(tmp_path / "robot.urdf", **WHOLE).notes if "effort" in x]
    assert "lower has the mass -2 kg" in note and "-3 kg" in note


def test_properties_of_xacro_without_use_are_ignored(tmp_path):
    head = re.search("<robot[^>]*>", TEXT)[0]
    name = head[:-1] + ' xmlns:xacro="http://ros.org/wiki/xacro">'
    definition = '<xacro:property name="width" value=".2"/>'
    arm = load(tmp_path, (head, name + definition))
    q = np.random.default_rng(4).normal(size=(20, 4))
    np.testing.assert_array_equal(arm.tool_position(q), original_arm().tool_position(q))
    used = name + definition + '<link name="${width}"/>'
    refusals(lambda x: load(tmp_path, x), [((head, used), "xacro elements that are not expanded")])


def test_a_description_without_a_moving_joint_is_no_arm(tmp_path):
    file = tmp_path / "plate.urdf"
    file.write_text('<robot name="plate"><link name="plate"/></robot>')
    refusals(ac.load_arm, [(file, "does not describe an arm ... below the link plate")])


def test_joints_outside_the_arm_stay_at_0_or_the_nearest_end_of_their_range(tmp_path):
    ranges = 'lower="-1" upper="1" effort="1"'
    for range_text, end in (('lower="0.5" upper="1"', 0.5), ('lower="-1" upper="-0.25"', -0.25)):
        arm = load(tmp_path, (ranges, range_text + ' effort="1"'))
        assert any(f"hinge at {end:g} rad" in note for note in arm.notes)


CHOICES = """
{tip: gripper} => tip must be a link of ... 'gripper' ... left_finger ... tcp
{tip: base_link, base: upper} => tip base_link is not below the base upper
{tip: base_link, base: base_link} => No joint moves
"""


def test_options_that_contradict_the_description_are_refused(tmp_path):
    refusals(lambda x: load(tmp_path, **yaml.safe_load(x)), CHOICES)


def test_xml_that_cannot_be_read_is_refused(tmp_path):
    entities = "".join(
        f"<!ENTITY a{i} '{f'&a{i - 1};' * 10}'>" if i else "<!ENTITY a0 'aaaaaaaaaa'>"
        for i in range(12)
    )
    head = '<?xml version="1.0" encoding="{}"?><robot name="r"/>'
    names = ("utf-7", "zlib_codec", "nowhere", "utf-16")
    table = [(head.format(x), "is not valid XML") for x in names]
    grown = f'<!DOCTYPE robot [{entities}]><robot name="r">&a11;</robot>'
    table.append((grown, "is not valid XML ... amplification"))

    def read(text):
        (tmp_path / "robot.urdf").write_text(text)
        return ac.load_arm(tmp_path / "robot.urdf")

    refusals(read, table, "robot.urdf")
    # Other encodings are read.
    file = tmp_path / "robot.urdf"
    plain = TEXT[TEXT.index("<robot") :].replace("lifter", "Höhe")
    for encoding in ("latin-1", "utf-16"):
        text = f'<?xml version="1.0" encoding="{encoding}"?>' + plain
        file.write_bytes(text.encode(encoding))
        assert ac.load_arm(file, base="base_link", tip="tcp").name == "Höhe"


def links(count):
    """Chain of `count` links."""
    body = "".join(
        f'<link name="l{i}"/><joint name="j{i}" type="revolute"><parent link="l{i - 1}"/>'
        f'<child link="l{i}"/><limit lower="-1" upper="1" velocity="1" effort="1"/></joint>'
        for i in range(1, count)
    )
    return f'<robot name="r"><link name="l0"/>{body}</robot>'


def test_long_and_deep_descriptions_are_read(tmp_path):
    file = tmp_path / "robot.urdf"
    file.write_text(links(1000))
    assert ac.load_arm(file, tip="l999").dof == 999

    # Unknown elements are ignored.
    deep = "<extra>" * 90 + "</extra>" * 90
    mass = '<mass value="2"/>'
    assert mass in TEXT
    light = load(tmp_path, (mass, mass + deep))
    np.testing.assert_array_equal(light.chain.masses, original_arm().chain.masses)


NAMES = [
    ("link", "world", "w\x9b2Jd", r"name of a link of ... 'w\x9b2Jd'"),
    ("joint", "elbow", "&#10;elbow", r"name of a joint of ... '\nelbow'"),
    ("robot", "lifter", "\u202elifter", r"name of the robot of ... '\u202elifter'"),
]
# N is replaced by a text that is no number.
NUMBERS = """
velocity="2.5" => velocity="N" => must be one finite number
<mass value="2"/> => <mass value="N"/> => value of the mass must be a number
<origin xyz="0.4 0 0.02"/> => <origin xyz="N 0 0"/> => xyz must be 3 numbers
"""
TOO_LARGE = """
xyz="0.4 0 0.02" => xyz="1e300 0 0.02" => elbow ... at most 1e+09 ... 1e300
<mass value="2"/> => <mass value="1e200"/> => of the mass ... at most 1e+09
offset="0.01" => offset="1e300" => position ... right ... at most 1e+09
"""


def test_unprintable_names_and_invalid_numbers_are_refused(tmp_path):
    table = [((f'{x} name="{a}"', f'{x} name="{b}"'), words) for x, a, b, words in NAMES]
    for number in ("1_0", "inf", "0x10"):
        table += [((old, new.replace("N", number)), words) for old, new, words in rows(NUMBERS)]
    refusals(lambda x: load(tmp_path, x), table)
    large = [((old, new), words) for old, new, words in rows(TOO_LARGE)]
    refusals(lambda x: load(tmp_path, x), large)


# Joints as name, kind, parent link, child link.
SIX = [(f"a{k}", "revolute", f"l{k - 1}", f"l{k}") for k in range(1, 7)]
FRAMES = [("b", "fixed", "l0", "base"), ("f", "fixed", "l6", "flange")]
TOOL = ("t", "fixed", "flange", "tool0")
SENSOR = ("s", "fixed", "flange", "ft_frame")
FINGERS = [(x, "prismatic", "l6", x) for x in ("left", "right")]


def load_joints(tmp_path, joints, **options):
    links = {"l0": None} | dict.fromkeys(x[3] for x in joints)
    text = "".join(f'<link name="{x}"/>' for x in links)
    for name, kind, parent, child in joints:
        text += (
            f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
            '<origin xyz="0 0 0.1"/><limit lower="-1" upper="1" velocity="1" effort="1"/></joint>'
        )
    (tmp_path / "r.urdf").write_text(f'<robot name="r">{text}</robot>')
    return ac.load_arm(tmp_path / "r.urdf", **options)


def test_the_default_tip_is_tool0_or_else_flange(tmp_path):
    for joints, tip in (
        ([*SIX, *FRAMES, TOOL, SENSOR], "tool0"),
        ([*SIX, *FRAMES, SENSOR], "flange"),
        ([*SIX, *FRAMES, *FINGERS], "flange"),
    ):
        arm = load_joints(tmp_path, joints)
        assert arm.joint_names == ("a1", "a2", "a3", "a4", "a5", "a6")
        named = load_joints(tmp_path, joints, tip=tip)
        assert (named.tool_position([0.1] * 6) == arm.tool_position([0.1] * 6)).all()
    words = "no link tool0 or flange ... (in a job, arm.tip; ... --arm JOB) ... "
    table = [(SIX, words + "l6"), ([*SIX, *FINGERS], words)]
    refusals(lambda x: load_joints(tmp_path, x), table)


def test_files_of_other_formats_are_refused_with_their_remedy(tmp_path):
    table = [(str(tmp_path / f"robot{x}"), words) for x, words in ENDINGS.items()]
    table += [("a.XACRO", "pip install xacrodoc ... -o robot.urdf"), ("b.xml", "Use a URDF")]
    refusals(ac.load_arm, table, "files are not supported. ")
    # Logs and trajectories are also read from bags.
    others = [(file, words) for file, words in table if not file.endswith((".mcap", ".db3"))]
    for read in (ac.read_log, ac.read_trajectory):
        refusals(read, others, "files are not supported. ")


def test_a_range_of_a_continuous_joint_is_noted(tmp_path):
    range_of = '<limit lower="-1" upper="1" velocity="2" effort="5"/>'
    text = ROBOT.read_text(encoding="utf-8")
    assert not any("continuous" in x for x in original_arm().notes)
    joint = re.search(r'<joint name="\w+" type="continuous">', text)
    assert joint is not None
    changed = text.replace(joint[0], joint[0] + range_of, 1)
    (tmp_path / "range.urdf").write_text(changed, encoding="utf-8")
    arm = ac.load_arm(tmp_path / "range.urdf", **WHOLE)
    (note,) = (x for x in arm.notes if "continuous" in x)
    assert joint[0].split('"')[1] in note
