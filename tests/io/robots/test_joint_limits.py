"""MoveIt's joint_limits.yaml: what it overrides and lifts, and what is refused."""

from __future__ import annotations

from pathlib import Path as FilePath

import numpy as np
import pytest

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


def test_what_is_switched_off_is_lifted(tmp_path):
    limits = with_text(
        tmp_path,
        for_all(
            "has_velocity_limits: false, max_velocity: 1, has_position_limits: false, "
            "has_effort_limits: false, has_jerk_limits: true, max_jerk: 100"
        ),
    ).limits
    assert limits.joint_velocity is None and limits.joint_torque is None
    assert limits.joint_lower is None and limits.joint_upper is None
    np.testing.assert_array_equal(limits.joint_jerk, [100] * 4)


def test_jerk_may_be_given_for_some_joints_only(tmp_path):
    text = "joint_limits:\n  elbow: {max_acceleration: 2, has_jerk_limits: true, max_jerk: 7}\n"
    text += "".join(f"  {x}: {{max_acceleration: 2}}\n" for x in JOINTS if x != "elbow")
    jerk = with_text(tmp_path, text).limits.joint_jerk
    np.testing.assert_array_equal(jerk, [7.0 if x == "elbow" else np.inf for x in JOINTS])


def test_a_file_for_the_parameter_server(tmp_path):
    text = for_all("max_acceleration: 2").replace("\n", "\n      ")
    wrapped = "/**:\n  ros__parameters:\n    robot_description_planning:\n      " + text
    np.testing.assert_array_equal(with_text(tmp_path, wrapped).limits.joint_acceleration, [2] * 4)


def test_it_goes_before_an_arm_file_too(tmp_path):
    file = tmp_path / "limits.yaml"
    file.write_text("joint_limits:\n  wrist_3_joint:\n    max_acceleration: !degrees 60\n")
    arm = ac.load_arm("ur5e", joint_limits=file)
    np.testing.assert_allclose(arm.limits.joint_acceleration, [np.pi] * 5 + [np.pi / 3])
    np.testing.assert_array_equal(arm.limits.joint_torque, [150, 150, 150, 28, 28, 28])


def test_accelerations_of_a_file_hold_both_ways(tmp_path):
    arm_file = tmp_path / "arm.yaml"
    arm_file.write_text("""
name: mine
kind: planar_two_link
base: {value: 0.1, unit: m}
links: {value: [0.3, 0.2], unit: m}
limits:
  joint_acceleration: {value: [3, 4], unit: rad/s^2}
  joint_deceleration: {value: [1, 2], unit: rad/s^2}
""")
    file = tmp_path / "limits.yaml"
    file.write_text("joint_limits:\n  joint 1: {max_acceleration: 5, max_velocity: 1}\n"
                    "  joint 2: {max_velocity: 1}\n")  # fmt: skip
    limits = ac.load_arm(arm_file, joint_limits=file).limits
    np.testing.assert_array_equal(limits.joint_acceleration, [5, 4])
    np.testing.assert_array_equal(limits.joint_deceleration, [5, 2])
    lifted = "joint_limits:\n" + "".join(
        f"  joint {k}: {{has_acceleration_limits: false}}\n" for k in (1, 2)
    )
    file.write_text(lifted)
    limits = ac.load_arm(arm_file, joint_limits=file).limits
    assert limits.joint_acceleration is None and limits.joint_deceleration is None


def test_it_says_what_the_description_leaves_out(tmp_path):
    robot = tmp_path / "robot.urdf"
    robot.write_text(ROBOT.read_text().replace('<limit effort="80" velocity="2"/>', ""))
    file = tmp_path / "limits.yaml"
    file.write_text("joint_limits:\n  pan: {max_velocity: 1.0, max_effort: 10.0}\n")
    limits = ac.load_arm(robot, base="base_link", tip="tcp", joint_limits=file).limits
    np.testing.assert_array_equal(limits.joint_velocity, [1, 1.5, 2.5, 4])
    np.testing.assert_array_equal(limits.joint_torque, [10, 70, 40, 15])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("joint_limits: [", ("is not valid YAML",)),
        ("joint_limits: {pan: {max_velocity: !degrees fast}}", ("is not valid YAML", "'fast'")),
        ("joint_limits: {pan: {max_velocity: !turns 2}}", ("is not valid YAML", "!turns")),
        ("pan: {max_velocity: 1}", ("needs the key joint_limits",)),
        ("just words", ("needs the key joint_limits",)),
        ("joint_limits: 3", ("needs the key joint_limits",)),
        ("joint_limits: {pan_joint: {max_velocity: 1}}",
         ("none of the arm's joints", "names pan_joint", "pan, tilt, elbow, roll")),
        ("joint_limits: {pan: 3}", ("joint pan must be named limits", "3")),
        ("joint_limits: {pan: {max_speed: 3}}", ("joint pan", "unknown key 'max_speed'",
                                                 "max_velocity")),
        ("joint_limits: {pan: {max_velocity: '${radians(90)}'}}",
         ("joint pan: max_velocity must be a number", "radians(90)", "!degrees 90")),
        ("joint_limits: {pan: {max_velocity: true}}", ("must be a number, not True",)),
        ("joint_limits: {pan: {max_velocity: '1_0'}}", ("must be a number, not '1_0'",)),
        ("joint_limits: {pan: {max_velocity: .nan}}", ("must be a number, not nan",)),
        ("joint_limits: {pan: {has_velocity_limits: 1, max_velocity: 1}}",
         ("has_velocity_limits must be true or false", "not 1")),
        ("joint_limits: {pan: {has_deceleration_limits: true, max_acceleration: 1}}",
         ("no max_deceleration: add it",)),
        ("joint_limits: {pan: {has_velocity_limits: true}}", ("no max_velocity: add it",)),
        ("joint_limits: {pan: {max_velocity: -1}}",
         ("joint_velocity of joint pan must be above zero", "-1 rad/s")),
        ("joint_limits: {pan: {max_acceleration: 1}}",
         ("joint tilt has no joint_acceleration", "every joint or to none")),
        ("joint_limits: {pan: {max_deceleration: -1}}",
         ("joint pan has a max_deceleration but no max_acceleration",)),
        ("joint_limits: {tilt: {min_position: 2, max_position: 1}}",
         ("range of joint tilt is empty", "from 2 to 1 rad")),
    ],
)  # fmt: skip
def test_files_that_limit_nothing_are_refused(tmp_path, text, words, refuses):
    refuses(lambda: with_text(tmp_path, text), ac.InvalidInput, *words)


def test_a_missing_file_is_refused(tmp_path, refuses):
    refuses(lambda: load(tmp_path / "no.yaml"), ac.InvalidInput, "no file of joint limits")
