"""Arms from robot descriptions: the chain in them, what hangs on it, and what is refused."""

from __future__ import annotations

import sys
from importlib import resources
from pathlib import Path as FilePath

import numpy as np
import pytest

import armcontour as ac
from armcontour.frames import Frame

DATA = FilePath(__file__).parent / "data"
ROBOT = DATA / "robot.urdf"
TEXT = ROBOT.read_text()
TURNING = ("pan", "tilt", "elbow", "roll")


def load(tmp_path, *changes, file="robot.urdf", **options):
    """The robot with parts of its text replaced."""
    text = TEXT
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    (tmp_path / file).write_text(text)
    return ac.load_arm(tmp_path / file, **({"base": "base_link", "tip": "tcp"} | options))


def seen_by_mujoco(q, dq, ddq, held):
    """Torques and the place of the tip, by MuJoCo's own reading of the file."""
    mujoco = pytest.importorskip("mujoco")
    # Frames are to be kept, and there is no mesh.
    compiler = '<mujoco><compiler fusestatic="false"/></mujoco>'
    text = TEXT.replace('<robot name="lifter">', f'<robot name="lifter">{compiler}')
    text = text.replace("<visual>", "<!--").replace("</visual>", "-->")
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    at = [model.joint(name).dofadr[0] for name in TURNING]
    model.dof_damping[:] = model.dof_frictionloss[:] = 0
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT
    found = []
    for state in zip(q, dq, ddq, strict=True):
        data.qpos[:] = data.qvel[:] = data.qacc[:] = 0
        for name, value in held.items():
            data.qpos[model.joint(name).qposadr[0]] = value
        data.qpos[at], data.qvel[at], data.qacc[at] = state
        mujoco.mj_inverse(model, data)
        base, tip = data.body("base_link"), data.body("tcp")
        turn = base.xmat.reshape(3, 3).T
        found.append((data.qfrc_inverse[at].copy(), turn @ (tip.xpos - base.xpos)))
    return tuple(np.array(x) for x in zip(*found, strict=True))


@pytest.mark.parametrize("locked", [{}, {"left": 0.03, "hinge": 0.6}, {"right": 0.04}])
def test_the_arm_with_its_gripper_as_mujoco_sees_it(locked):
    arm = ac.load_arm(ROBOT, base="base_link", tip="tcp", locked=locked)
    assert (arm.name, arm.joint_names) == ("lifter", TURNING)
    q, dq, ddq = np.random.default_rng(0).normal(size=(3, 200, 4))
    left = locked.get("left", 0.0)
    held = {"left": left, "right": 0.5 * left + 0.01, "hinge": 0.0} | locked
    torque, place = seen_by_mujoco(q, dq, ddq, held)
    np.testing.assert_allclose(arm.forward(q), place, atol=1e-9)
    largest = np.abs(torque).max(axis=1, keepdims=True)
    assert (np.abs(arm.dynamics.torque(q, dq, ddq) - torque) <= 1e-8 * largest).all()


def test_what_the_description_says_is_what_the_arm_has():
    arm = ac.load_arm(ROBOT, base="base_link", tip="tcp")
    limits = arm.limits
    np.testing.assert_array_equal(limits.joint_velocity, [2, 1.5, 2.5, 4])
    np.testing.assert_array_equal(limits.joint_torque, [80, 70, 40, 15])
    np.testing.assert_array_equal(limits.joint_lower, [-np.inf, -2, -2.5, -3])
    np.testing.assert_array_equal(limits.joint_upper, [np.inf, 1.5, 2.5, 3])
    assert limits.joint_acceleration is None and "has_acceleration_limits" in arm.limits_hint
    np.testing.assert_array_equal(arm.chain.viscous, [0.5, 0, 0.1, 0])
    np.testing.assert_array_equal(arm.chain.coulomb, [1.5, 0, 0, 0])
    np.testing.assert_allclose(arm.chain.axes[1], [0, np.sqrt(0.5), np.sqrt(0.5)])
    np.testing.assert_array_equal(arm.chain.axes[3], [1, 0, 0])  # by default
    # All that hangs on the last link: wrist, hand and fingers.
    np.testing.assert_allclose(arm.chain.masses, [4, 3, 2.4, 1.6])
    assert arm.source.endswith("robot.urdf")


def test_the_chain_may_end_early_and_begin_late():
    flange = ac.load_arm(ROBOT, base="base_link", tip="flange")
    whole = ac.load_arm(ROBOT, base="base_link", tip="tcp")
    q, dq, ddq = np.random.default_rng(1).normal(size=(3, 20, 4))
    # Where the tip is makes no difference to the drives.
    np.testing.assert_allclose(flange.torque(q, dq, ddq), whole.torque(q, dq, ddq), atol=1e-12)
    assert np.abs(flange.forward(q) - whole.forward(q)).max() > 0.05
    short = ac.load_arm(ROBOT, base="upper", tip="tcp")
    assert short.joint_names == ("elbow", "roll")
    held = ac.load_arm(ROBOT, base="base_link", tip="upper", locked={"elbow": 0.5, "roll": 0.3})
    assert held.joint_names == ("pan", "tilt")
    q = np.column_stack([q[:, :2], np.full(20, 0.5), np.full(20, 0.3)])
    still = np.zeros_like(q)
    expected = whole.dynamics.torque(q, still, still)[:, :2]
    found = held.dynamics.torque(q[:, :2], still[:, :2], still[:, :2])
    np.testing.assert_allclose(found, expected, atol=1e-9)


def test_a_joint_that_slides_may_be_locked():
    low = ac.load_arm(ROBOT, tip="tcp", locked={"lift": 0.1})
    high = ac.load_arm(ROBOT, tip="tcp", locked={"lift": 0.4})
    q = np.random.default_rng(2).normal(size=(10, 4))
    np.testing.assert_allclose(high.forward(q) - low.forward(q), np.tile([0, 0, 0.3], (10, 1)))


def test_the_tip_is_found_where_there_is_one_end(tmp_path):
    cut = TEXT.index('<joint name="hinge"'), TEXT.index('<joint name="roll"')
    text = TEXT[: cut[0]] + TEXT[cut[1] :]
    cut = text.index('<joint name="left"'), text.index('<joint name="hand_tcp"')
    text = text[: cut[0]] + text[cut[1] :]
    for link in ("cover", "left_finger", "right_finger"):
        start = text.index(f'<link name="{link}">')
        text = text[:start] + text[text.index("</link>", start) + 7 :]
    (tmp_path / "one.urdf").write_text(text)
    arm = ac.load_arm(tmp_path / "one.urdf", base="base_link")
    named = ac.load_arm(tmp_path / "one.urdf", base="base_link", tip="tcp")
    np.testing.assert_array_equal(arm.forward(np.ones(4)), named.forward(np.ones(4)))


def test_without_any_inertial_only_kinematics_are_known(tmp_path, refuses):
    text = TEXT
    while "<inertial>" in text:
        text = text[: text.index("<inertial>")] + text[text.index("</inertial>") + 11 :]
    (tmp_path / "bare.urdf").write_text(text)
    arm = ac.load_arm(tmp_path / "bare.urdf", base="base_link", tip="tcp")
    assert arm.chain.masses is None
    whole = ac.load_arm(ROBOT, base="base_link", tip="tcp")
    np.testing.assert_array_equal(arm.forward(np.ones(4)), whole.forward(np.ones(4)))
    refuses(lambda: arm.dynamics, ac.InvalidInput, "masses of the arm lifter")
    # Efforts mean nothing then, and must not keep the arm from being planned for.
    assert arm.limits.joint_torque is None and whole.limits.joint_torque is not None
    assert any("limits of effort are left out" in note for note in arm.notes)


def test_tool_and_work_frames_go_with_it():
    tool = Frame.rpy([0, 0.1, 0.2], [0.1, 0, 0])
    arm = ac.load_arm(ROBOT, base="base_link", tip="tcp", tool=tool, work=Frame())
    bare = ac.load_arm(ROBOT, base="base_link", tip="tcp")
    points, rotations = bare.pose(np.ones(4))
    np.testing.assert_allclose(arm.forward(np.ones(4)), points + rotations @ tool.position)


NO_MASS = '<mass value="2"/>'


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ((TEXT, "solid gripper"), ("is not XML", "line 1")),
        ((TEXT, "<mujoco/>"), ("is not a robot description", "<mujoco>")),
        ((TEXT, '<robot name="r"/>'), ("without links",)),
        ((TEXT, '<robot xmlns:xacro="http://ros.org/wiki/xacro"><xacro:arm/></robot>'), ("xacro",)),
        (('<link name="cover">', '<link name="upper">'), ("two links", "upper")),
        (('<link name="cover">', "<link>"), ("a link without a name",)),
        (('joint name="elbow"', 'joint name="tilt"'), ("two joints", "tilt")),
        (('<child link="wrist"/>', '<child link="lower"/>'), ("on two joints", "elbow and roll")),
        (('<parent link="world"/>', '<parent link="tcp"/>'), ("loop",)),
        (('<link name="world"/>', '<link name="world"/><link name="lost"/>'), ("in parts", "lost")),
        (('<parent link="lower"/>', '<parent link="lover"/>'), ("no parent", "'lover'")),
        (('name="elbow" type="revolute"', 'name="elbow" type="ball"'), ("elbow", "'ball'")),
        (('name="elbow" type="revolute"', 'name="elbow" type="prismatic"'),
         ("elbow", "is prismatic", "locked=")),
        (('name="elbow" type="revolute"', 'name="elbow" type="floating"'), ("is floating",)),
        (('<limit lower="-2.5"', '<mimic joint="tilt"/><limit lower="-2.5"'),
         ("elbow", "mimics another", "locked=")),
        (('effort="40" velocity="2.5"', 'effort="40" velocity="fast"'),
         ("velocity", "joint elbow", "'fast'")),
        (('lower="-2.5" upper="2.5"', ""), ("range of joint elbow is empty",)),
        ((NO_MASS, "<mass/>"), ("link lower of", "value of its mass")),
        (('<axis xyz="0 1 1"/>', '<axis xyz="0 0 0"/>'), ("Joint tilt of", "axis of length 0")),
        (('<axis xyz="0 1 1"/>', '<axis xyz="0 1"/>'), ("Joint tilt of", "three numbers", "'0 1'")),
        (('<origin xyz="0.4 0 0.02"/>', '<origin xyz="0.4 0 a"/>'), ("elbow", "three numbers")),
        (('<dynamics damping="0.1"/>', '<dynamics damping="-0.1"/>'), ("elbow", "damping -0.1")),
        (('<mimic joint="left"', '<mimic joint="right"'), ("right", "mimics no joint")),
        (('<mimic joint="left"', '<mimic joint="lost"'), ("right", "mimics no joint")),
    ],
)  # fmt: skip
def test_descriptions_of_no_arm_are_refused(tmp_path, change, words, refuses):
    refuses(lambda: load(tmp_path, change), ac.InvalidInput, "robot.urdf", *words)


LIMITS = """joint_limits:
  elbow: {has_effort_limits: true, max_effort: 33, has_velocity_limits: true, max_velocity: 1.25}
"""


def test_zero_and_less_count_as_not_given(tmp_path):
    elbow = 'effort="40" velocity="2.5"'
    for given, lacking in (
        ('effort="0" velocity="2.5"', "effort"),
        ('velocity="2.5"', "effort"),
        ('effort="40" velocity="0"', "velocity"),
        ('effort="40" velocity="-1"', "velocity"),
        ('effort="0" velocity="0"', "velocity of elbow and no effort"),
    ):
        arm = load(tmp_path, (elbow, given))
        (note,) = (x for x in arm.notes if "count as not given" in x)
        assert note.startswith(f"robot.urdf: it gives no {lacking} of elbow")
        for key in ("effort", "velocity"):
            limit = {"effort": "joint_torque", "velocity": "joint_velocity"}[key]
            assert (getattr(arm.limits, limit) is None) == (f"no {key}" in note)
            assert (f"has_{key}_limits and max_{key}" in note) == (f"no {key}" in note)
        # Planning needs one of the two, and then says so.
        assert ("max_effort do as well" in arm.limits_hint) == (arm.limits.joint_torque is None)
    # With the values from elsewhere nothing is lacking.
    (tmp_path / "joint_limits.yaml").write_text(LIMITS)
    arm = load(tmp_path, (elbow, given), joint_limits=tmp_path / "joint_limits.yaml")
    np.testing.assert_array_equal(arm.limits.joint_torque, [80, 70, 33, 15])
    np.testing.assert_array_equal(arm.limits.joint_velocity, [2, 1.5, 1.25, 4])
    assert not any("not given" in x for x in arm.notes)


def test_joint_limits_of_some_joints_are_not_enough(tmp_path, refuses):
    (tmp_path / "joint_limits.yaml").write_text(LIMITS)
    change = ('effort="80" velocity="2"', 'effort="0" velocity="2"')
    refuses(
        lambda: load(tmp_path, change, joint_limits=tmp_path / "joint_limits.yaml"),
        ac.InvalidInput, "joint pan has no joint_torque", "joint_limits",
    )  # fmt: skip


def test_joints_without_a_limit_element(tmp_path):
    arm = load(tmp_path, ('<limit effort="80" velocity="2"/>', ""))
    assert arm.limits.joint_velocity is None and arm.limits.joint_torque is None
    assert arm.limits.joint_upper[0] == np.inf
    limit = '<limit lower="-2.5" upper="2.5" effort="40" velocity="2.5"/>'
    arm = load(tmp_path, (limit, ""))
    assert arm.limits.joint_upper[2] == np.inf and arm.limits.joint_upper[1] == 1.5
    assert any("no range of elbow" in note for note in arm.notes)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ((NO_MASS, '<mass value="0"/>'), "link lower, which a joint moves, has the mass 0 kg"),
        ((NO_MASS, '<mass value="-2"/>'), "link lower has the mass -2 kg"),
        (('iyy="0.02" iyz="0" izz="0.02"', 'iyy="0.02" iyz="0" izz="0.2"'),
         "no body can have the inertia of the link lower"),
        (('<mimic joint="left"', '<mimic joint="roll"'),
         "joint right moves a mass along with joint roll"),
        (("upper", None), "the link upper has no mass"),
    ],
)  # fmt: skip
def test_links_that_are_no_bodies_leave_out_dynamics_only(tmp_path, change, words, refuses):
    if change[1] is None:
        start = TEXT.index("<inertial>", TEXT.index('<link name="upper">'))
        change = (TEXT[start : TEXT.index("</inertial>", start) + 11], "")
    arm, whole = load(tmp_path, change), ac.load_arm(ROBOT, base="base_link", tip="tcp")
    assert not arm.has_bodies and arm.limits.joint_torque is None
    assert any(words in note and "limits of effort are left out" in note for note in arm.notes)
    q = np.random.default_rng(3).normal(size=(20, 4))
    np.testing.assert_array_equal(arm.forward(q), whole.forward(q))
    refuses(lambda: arm.dynamics, ac.InvalidInput, "masses of the arm lifter")


def test_what_weighs_nothing_may_move_along_with_the_arm(tmp_path):
    start = TEXT.index("<inertial>", TEXT.index('<link name="right_finger">'))
    inertial = TEXT[start : TEXT.index("</inertial>", start) + 11]
    mimic = ('<mimic joint="left"', '<mimic joint="roll"')
    arm, bare = load(tmp_path, (inertial, ""), mimic), load(tmp_path, (inertial, ""))
    q, dq, ddq = np.random.default_rng(4).normal(size=(3, 20, 4))
    np.testing.assert_array_equal(arm.torque(q, dq, ddq), bare.torque(q, dq, ddq))
    assert arm.has_bodies and not any("right" in note for note in arm.notes)
    # Locked, it is a body like any other.
    held = load(tmp_path, mimic, locked={"right": 0.01})
    assert held.has_bodies


def test_joints_beside_the_arm_stand_at_the_nearest_end_of_their_range(tmp_path):
    ranges = 'lower="-1" upper="1" effort="1"'
    for given, end in (('lower="0.5" upper="1"', 0.5), ('lower="-1" upper="-0.25"', -0.25)):
        arm = load(tmp_path, (ranges, given + ' effort="1"'))
        same = load(tmp_path, (ranges, given + ' effort="1"'), locked={"hinge": end})
        assert any(f"hinge at {end:g} rad" in note for note in arm.notes)
        assert not any("hinge" in note for note in same.notes)
        q, dq, ddq = np.random.default_rng(5).normal(size=(3, 20, 4))
        np.testing.assert_array_equal(arm.torque(q, dq, ddq), same.torque(q, dq, ddq))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"tip": "gripper"}, ("no link 'gripper' to be the tip", "left_finger", "tcp")),
        ({"base": "floor"}, ("no link 'floor' to be the base", "base_link")),
        ({"tip": None}, ("4 links that could be the tip", "cover", "tcp", "(in a job, arm: {tip:")),
        ({"tip": "base_link", "base": "upper"}, ("base upper does not carry the tip base_link",)),
        ({"tip": "base_link", "base": "base_link"}, ("No joint turns",)),
        ({"tip": "tcp", "base": "wrist"}, ("No joint turns",)),
        ({"base": None}, ("lift", "is prismatic", "locked={'lift': ...}")),
        ({"locked": {"thumb": 0}}, ("no joint 'thumb' to be locked", "hinge")),
        ({"locked": {"hinge": 2}}, ("hinge", "locked at 2", "-1 to 1")),
        ({"locked": {"hinge": "open"}}, ("position of hinge", "numbers")),
        ({"locked": {"hand_tcp": 1}}, ("hand_tcp", "is fixed and cannot be locked")),
    ],
)
def test_choices_that_a_description_does_not_have(tmp_path, options, words, refuses):
    refuses(lambda: load(tmp_path, **options), ac.InvalidInput, *words)


def test_files_that_are_not_there_are_refused(tmp_path, refuses):
    for name in ("no.urdf", "no.xacro"):
        refuses(lambda x=name: ac.load_arm(tmp_path / x), ac.InvalidInput, "no robot", name)


XACRO = TEXT.replace(
    '<robot name="lifter">',
    '<robot name="lifter" xmlns:xacro="http://www.ros.org/wiki/xacro">'
    '<xacro:property name="reach" value="${0.2 * 2}"/>',
).replace('<origin xyz="0.4 0 0.02"/>', '<origin xyz="${reach} 0 0.02"/>')


def test_xacro_is_expanded(tmp_path):
    pytest.importorskip("xacro")
    (tmp_path / "robot.urdf.xacro").write_text(XACRO)
    file = tmp_path / "robot.urdf.xacro"
    arm = ac.load_arm(file, base="base_link", tip="tcp", trust_xacro=True)
    whole = ac.load_arm(ROBOT, base="base_link", tip="tcp")
    np.testing.assert_allclose(arm.forward(np.ones(4)), whole.forward(np.ones(4)), atol=1e-15)
    assert arm.source.endswith(".xacro")


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ("${lost}", "robot.xacro cannot be expanded by xacro: name 'lost' is not defined"),
        ("$(arg size)", "robot.xacro is not expanded: it needs a value of its argument 'size'"),
        ("${1 +}", "robot.xacro cannot be expanded by xacro: invalid syntax"),
    ],
)
def test_xacro_that_cannot_be_expanded_is_refused(tmp_path, wrong, words, refuses):
    pytest.importorskip("xacro")
    (tmp_path / "robot.xacro").write_text(XACRO.replace("${reach}", wrong))
    refuses(
        lambda: ac.load_arm(
            tmp_path / "robot.xacro", base="base_link", tip="tcp", trust_xacro=True
        ),
        ac.InvalidInput,
        words,
    )


def test_a_file_of_macros_is_no_robot(tmp_path, refuses):
    pytest.importorskip("xacro")
    macro = '<xacro:macro name="arm" params=""><link name="base"/></xacro:macro>'
    head = '<robot xmlns:xacro="http://www.ros.org/wiki/xacro">'
    (tmp_path / "arm_macro.xacro").write_text(f"{head}{macro}</robot>")
    file = tmp_path / "arm_macro.xacro"
    refuses(
        lambda: ac.load_arm(file, trust_xacro=True),
        ac.InvalidInput, "arm_macro.xacro makes no links", "it only defines macros",
    )  # fmt: skip


def test_xacro_missing_is_said(tmp_path, monkeypatch, refuses):
    (tmp_path / "robot.xacro").write_text(XACRO)
    monkeypatch.setitem(sys.modules, "xacro", None)
    refuses(
        lambda: ac.load_arm(tmp_path / "robot.xacro", trust_xacro=True),
        ac.InvalidInput,
        "pip install 'armcontour[ros]'",
    )


def test_endings_are_read_in_capitals_too(tmp_path, refuses):
    (tmp_path / "ROBOT.URDF").write_text(TEXT)
    assert ac.load_arm(tmp_path / "ROBOT.URDF", base="base_link", tip="tcp").dof == 4
    library = resources.files("armcontour.io.robots") / "library"
    (tmp_path / "ARM.YAML").write_bytes((library / "ur5e.yaml").read_bytes())
    assert ac.load_arm(tmp_path / "ARM.YAML").dof == 6
    (tmp_path / "ROBOT.XACRO").write_text(TEXT)
    refuses(lambda: ac.load_arm(tmp_path / "ROBOT.XACRO"), ac.InvalidInput, "--trust-xacro")
