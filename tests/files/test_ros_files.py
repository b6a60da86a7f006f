"""Trajectories of ROS: our exports, messages, goals, and messages without a trajectory."""

import numpy as np
import pytest
from tests.files.tables import refusals

from armcontour.core.errors import InvalidInput
from armcontour.files import read_trajectory
from armcontour.files.exports import RosYamlFormat
from armcontour.files.exports.export_table import SetPointTable
from armcontour.files.log_file import read_log

AT_ONCE = "time_from_start: {sec: 0, nanosec: 0}}"


def test_exported_files_are_read_again(tmp_path, mac, arm):
    t = np.arange(6) * 0.004
    q = np.column_stack([np.sin(t), np.cos(t)])
    names = ("shoulder", "elbow")
    file = tmp_path / "a.yaml"
    table = SetPointTable(name="arm", joint_names=names, cycle=4e-3, t=t, q=q, dq=2 * q, ddq=3 * q)
    RosYamlFormat().write(table, file)
    trajectory = read_trajectory(file)
    assert trajectory.joints == names
    np.testing.assert_allclose(trajectory.t, table.t, rtol=0, atol=1e-12)
    for fewer, name in enumerate(("q", "dq", "ddq")):
        atol = 0.51 * 10.0 ** (fewer - 7)
        np.testing.assert_allclose(getattr(trajectory, name), getattr(table, name), 0, atol)
    # Joints are selected by name, in the order of the arm; other joints are ignored.
    turned = read_trajectory(file, ["elbow", "shoulder"])
    np.testing.assert_array_equal(turned.q, trajectory.q[:, ::-1])
    assert read_trajectory(file, ["elbow"]).q.shape == (6, 1)
    wrist = [(["wrist"], "2 joints ('shoulder', 'elbow'), but the arm has 1 ('wrist')")]
    refusals(lambda x: read_trajectory(file, x), wrist)
    # A whole plan with its digits.
    x = mac.sample(4e-3)
    plan = SetPointTable(name="paper", joint_names=arm.joint_names, cycle=4e-3, t=x.t, q=x.q)
    place = file.with_stem("paper")
    RosYamlFormat().write(plan, place)
    again = read_trajectory(place, arm.joint_names)
    np.testing.assert_allclose(again.q, x.q, 0, 0.51e-9)
    assert again.resolution["q"] == pytest.approx(1e-9)


INNER = "{joint_names: [a], points: [{positions: [1.5], " + AT_ONCE + "]}"


@pytest.fixture
def read(tmp_path):
    def from_text(text):
        (tmp_path / "a.yaml").write_text(text)
        return read_trajectory(tmp_path / "a.yaml")

    return from_text


ECHO = """
header:
  stamp: {sec: 0, nanosec: 0}
  frame_id: ''
joint_names:
- a
points:
- positions:
  - 0.125
  velocities: []
  accelerations: []
  effort: []
  time_from_start:
    sec: 1
    nanosec: 5
- {positions: [2.125], velocities: [], time_from_start: {sec: 2, nanosec: 500000000}}
---
"""


def test_goals_messages_of_moveit_and_echoed_messages_are_read(read):
    for text in (
        "trajectory: I",
        "goal_id: {uuid: [1, 2]}\ngoal: {trajectory: I}",
        "joint_trajectory: I\nmulti_dof_joint_trajectory: {joint_names: []}",
        "model_id: arm\ntrajectory:\n- joint_trajectory: I\ntrajectory_start: {}",
    ):
        trajectory = read(text.replace("I", INNER))
        assert trajectory.joints == ("a",) and trajectory.q.tolist() == [[1.5]]
    trajectory = read(ECHO)
    np.testing.assert_allclose(trajectory.t, [1 + 5e-9, 2.5], rtol=0, atol=1e-12)
    np.testing.assert_array_equal(trajectory.q, [[0.125], [2.125]])
    assert trajectory.dq is None
    assert trajectory.resolution["q"] == pytest.approx(1e-3)
    assert trajectory.resolution["t"] == pytest.approx(1e-9)


def test_joints_may_have_a_prefix_or_new_names(tmp_path):
    points = f"points: [{{positions: [1, 2, 3], {AT_ONCE}]"
    (tmp_path / "a.yaml").write_text(f"joint_names: [left_b, left_a, right_a]\n{points}")
    refusals(lambda x: read_trajectory(x, ["a", "b"]), [(tmp_path / "a.yaml", "-=*right_*")])
    chosen = read_trajectory(tmp_path / "a.yaml", ["a", "b"], columns="-=right_*")
    assert chosen.q.tolist() == [[2.0, 1.0]]
    chosen = read_trajectory(tmp_path / "a.yaml", ["x", "b"], columns="x=right_a")
    assert chosen.q.tolist() == [[3.0, 1.0]]


def test_joints_that_the_arm_does_not_have_are_refused(read, tmp_path):
    text = f"joint_names: [a, c]\npoints: [{{positions: [1, 2], {AT_ONCE}]"
    (tmp_path / "a.yaml").write_text(text)
    (tmp_path / "a.csv").write_text("t,q a [rad],q c [rad]\n0,1,2\n1,1,2\n")
    files = {"a.yaml": "c", "a.csv": "q c [rad]"}
    for name, spare in files.items():
        # A joint is not renamed to itself, and one that is missing cannot be renamed.
        table = [(["a", "b", "c"], "2 joints ... has 3 ... Add the other joints")]
        table.append((["a", "b"], f"--columns 'b={spare}'"))
        refusals(lambda x, y=name: read_trajectory(tmp_path / y, x), table, name)


OTHERS = f"""
trajectory: [{INNER}, {INNER}] => not exactly one JointTrajectory
a: 1 => not exactly one JointTrajectory ... joint_names and points
joint_names: [a] | points: [] => without points
joint_names: [a] | points: [{{positions: [1]}}] => point 1: ... time_from_start
joint_names: [a] | points: [{{positions: [1], {AT_ONCE.replace("0}}", ".inf}}")}] => point 1:
joint_names: [a] | points: [{{positions: [x], {AT_ONCE}] => point 1: positions ... ['x']
"""


def test_yaml_of_other_messages_is_refused(read):
    refusals(lambda x: read(x.replace(" | ", "\n")), OTHERS, "a.yaml")


def test_bags_of_ros_1_are_refused_with_their_remedy(tmp_path):
    (tmp_path / "a.bag").write_bytes(b"#ROSBAG V2.0\n")
    for read in (read_trajectory, read_log):
        with pytest.raises(InvalidInput, match="rosbags-convert"):
            read(tmp_path / "a.bag")
