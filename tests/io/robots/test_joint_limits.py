"""MoveIt's joint_limits.yaml: what it overrides and lifts, and what is refused."""

from pathlib import Path as FilePath

import numpy as np
from tests.io.tables import refusals, values

import armcontour as ac

DATA = FilePath(__file__).parent / "data"
ROBOT = DATA / "robot.urdf"
JOINTS = ("pan", "tilt", "elbow", "roll")


def load(file):
    return ac.load_arm(ROBOT, base="base_link", tip="tcp", joint_limits=file)


def with_text(tmp_path, text):
    file = tmp_path / "joint_limits.yaml"
    file.write_text(text)
    return load(file)


def for_all(lines):
    return "joint_limits:\n" + "".join(f"  {joint}: {{{lines}}}\n" for joint in JOINTS)


def test_a_file_of_the_field():
    arm = load(DATA / "joint_limits.yaml")
    limits = arm.limits
    assert arm.limits_hint == ""
    np.testing.assert_allclose(limits.joint_velocity, [np.pi / 2, 1.5, 2.5, 4])
    # The smaller of acceleration and deceleration holds both ways.
    np.testing.assert_array_equal(limits.joint_acceleration, [3, 2, 10, 20])
    assert limits.joint_deceleration is None and limits.joint_jerk is None
    np.testing.assert_array_equal(limits.joint_torque, [80, 70, 35, 15])
    np.testing.assert_allclose(limits.joint_lower, [-np.inf, -np.pi / 3, -2.5, -np.inf])
    np.testing.assert_allclose(limits.joint_upper, [np.inf, 1.0, 2.5, np.inf])


def test_limits_of_all_or_some_joints(tmp_path):
    off = "has_velocity_limits: false, max_velocity: 1, has_position_limits: false, "
    off += "has_effort_limits: false, has_jerk_limits: true, max_jerk: 100"
    limits = with_text(tmp_path, for_all(off)).limits
    assert limits.joint_velocity is None and limits.joint_torque is None
    assert limits.joint_lower is None and limits.joint_upper is None
    np.testing.assert_array_equal(limits.joint_jerk, [100] * 4)
    # Jerk may be given for some joints only.
    text = for_all("max_acceleration: 2")
    some = text.replace("elbow: {", "elbow: {has_jerk_limits: true, max_jerk: 7, ")
    jerk = with_text(tmp_path, some).limits.joint_jerk
    np.testing.assert_array_equal(jerk, [7.0 if x == "elbow" else np.inf for x in JOINTS])
    # A file for the parameter server.
    inner = text.replace("\n", "\n      ")
    wrapped = "/**:\n  ros__parameters:\n    robot_description_planning:\n      " + inner
    np.testing.assert_array_equal(with_text(tmp_path, wrapped).limits.joint_acceleration, [2] * 4)


def test_it_goes_before_an_arm_file_too(tmp_path):
    file, arm_file = tmp_path / "limits.yaml", tmp_path / "arm.yaml"
    file.write_text("joint_limits: {wrist_3_joint: {max_acceleration: !degrees 60}}")
    limits = ac.load_arm("ur5e", joint_limits=file).limits
    np.testing.assert_allclose(limits.joint_acceleration, [np.pi] * 5 + [np.pi / 3])
    np.testing.assert_array_equal(limits.joint_torque, [150, 150, 150, 28, 28, 28])
    # Accelerations of a file hold both ways.
    arm_file.write_text("""
name: mine
kind: planar_two_link
base: {value: 0.1, unit: m}
links: {value: [0.3, 0.2], unit: m}
limits:
  joint_acceleration: {value: [3, 4], unit: rad/s^2}
  joint_deceleration: {value: [1, 2], unit: rad/s^2}
""")
    table = """
{joint 1: {max_acceleration: 5}, joint 2: {max_velocity: 1}} => {joint_acceleration: [5, 4]}
{joint 1: {max_acceleration: 5}, joint 2: {max_velocity: 1}} => {joint_deceleration: [5, 2]}
{joint 1: &x {has_acceleration_limits: false}, joint 2: *x} => {joint_acceleration: null}
{joint 1: &x {has_acceleration_limits: false}, joint 2: *x} => {joint_deceleration: null}
"""

    def read(text):
        text = text.replace("max_acceleration: 5", "max_acceleration: 5, max_velocity: 1")
        file.write_text(f"joint_limits: {text}")
        return ac.load_arm(arm_file, joint_limits=file).limits

    values(read, table)


def test_it_says_what_the_description_leaves_out(tmp_path):
    robot, file = tmp_path / "robot.urdf", tmp_path / "limits.yaml"
    robot.write_text(ROBOT.read_text().replace('<limit effort="80" velocity="2"/>', ""))
    file.write_text("joint_limits: {pan: {max_velocity: 1.0, max_effort: 10.0}}")
    limits = ac.load_arm(robot, base="base_link", tip="tcp", joint_limits=file).limits
    np.testing.assert_array_equal(limits.joint_velocity, [1, 1.5, 2.5, 4])
    np.testing.assert_array_equal(limits.joint_torque, [10, 70, 40, 15])


BAD = r"""
joint_limits: [ => is not valid YAML
joint_limits: {pan: {max_velocity: !degrees fast}} => is not valid YAML ... 'fast'
joint_limits: {pan: {max_velocity: !turns 2}} => is not valid YAML ... !turns
pan: {max_velocity: 1} => needs the key joint_limits
just words => needs the key joint_limits
joint_limits: 3 => needs the key joint_limits
joint_limits: {pan_joint: {max_velocity: 1}} => names pan_joint ... pan, tilt, elbow, roll
joint_limits: {pan: 3} => joint pan must be named limits ... 3
joint_limits: {pan: {max_speed: 3}} => joint pan ... unknown key 'max_speed' ... max_velocity
joint_limits: {pan: {max_velocity: '${radians(90)}'}} => pan: max_velocity ... radians(90) ... !deg
joint_limits: {pan: {max_velocity: true}} => must be a number, not True
joint_limits: {pan: {max_velocity: '1_0'}} => must be a number, not '1_0'
joint_limits: {pan: {max_velocity: .nan}} => must be a number, not nan
joint_limits: {pan: {has_velocity_limits: 1, max_velocity: 1}} => has_velocity_limits must ... not 1
joint_limits: {pan: {has_deceleration_limits: true, max_acceleration: 1}} => no max_deceleration
joint_limits: {pan: {has_velocity_limits: true}} => no max_velocity: add it
joint_limits: {pan: {max_velocity: -1}} => joint_velocity of joint pan ... above zero ... -1 rad/s
joint_limits: {pan: {max_acceleration: 1}} => joint tilt has no joint_acceleration
joint_limits: {pan: {max_deceleration: -1}} => joint pan has a max_deceleration but no max_accel
joint_limits: {tilt: {min_position: 2, max_position: 1}} => joint tilt is empty ... from 2 to 1 rad
"""


def test_files_that_limit_nothing_are_refused(tmp_path):
    refusals(lambda x: with_text(tmp_path, x), BAD)
    refusals(load, [(tmp_path / "no.yaml", "no file of joint limits")])
