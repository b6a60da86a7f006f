"""Trajectories and logs of ROS: those of our exports, and bags written by rosbags' own writer."""

from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from tests.files.tables import refusals

from armcontour.core.errors import InvalidInput
from armcontour.files import read_trajectory, ros_files
from armcontour.files.exports import RosYamlFormat
from armcontour.files.exports.table import SetPointTable
from armcontour.files.log_file import read_log

POINT = "trajectory_msgs/JointTrajectoryPoint"
CONTROLLER = "control_msgs/msg/JointTrajectoryControllerState"
# The fields that older and newer releases have in common with others left out.
OLD = f"std_msgs/Header header\nstring[] joint_names\n{POINT} desired\n{POINT} actual\n"
NEW = f"std_msgs/Header header\nstring[] joint_names\n{POINT} reference\n{POINT} feedback\n"
BOTH = f"{NEW}{POINT} desired\n{POINT} actual\n"
AT_ONCE = "time_from_start: {sec: 0, nanosec: 0}}"
NAMES = ["elbow", "gripper", "shoulder"]
T = np.arange(80) * 4e-3
Q = np.column_stack([np.sin(T), 0 * T, np.cos(T)])


def _bag(folder, topics, definitions=None, plugin=StoragePlugin.MCAP, packed=CompressionMode.NONE):
    store = get_typestore(Stores.ROS2_HUMBLE)
    for name, text in (definitions or {}).items():
        store.register(get_types_from_msg(text, name))
    types = SimpleNamespace(**{name.rpartition("/")[2]: x for name, x in store.types.items()})
    writer = Writer(folder, version=9, storage_plugin=plugin)
    writer.set_compression(packed, CompressionFormat.ZSTD)
    with writer:
        for topic, (kind, messages) in topics.items():
            connection = writer.add_connection(topic, kind, typestore=store)
            for i, make in enumerate(messages):
                raw = store.serialize_cdr(make(types), kind)
                writer.write(connection, 10**18 + i * 4_000_000, raw)
    return folder


def _header(x, i):
    stamp = x.Time(sec=1_700_000_000, nanosec=i * 4_000_000)
    return x.Header(stamp=stamp, frame_id="")


def _point(x, q):
    none = dict.fromkeys(("velocities", "accelerations", "effort"), np.zeros(0))
    start = x.Duration(sec=0, nanosec=0)
    return x.JointTrajectoryPoint(positions=np.array(q, float), time_from_start=start, **none)


def _states(count=80):
    def make(i, x):
        fields = {"position": Q[i], "velocity": 2 * Q[i], "effort": np.zeros(0)}
        return x.JointState(header=_header(x, i), name=NAMES, **fields)

    return "sensor_msgs/msg/JointState", [partial(make, i) for i in range(count)]


def _controller(command, measured, *others):
    def make(i, x):
        fields = {command: _point(x, Q[i] + 0.1), measured: _point(x, Q[i])}
        fields |= {name: _point(x, []) for name in others}
        fields |= {"header": _header(x, i), "joint_names": NAMES}
        return x.JointTrajectoryControllerState(**fields)

    return CONTROLLER, [partial(make, i) for i in range(len(T))]


def test_exports_come_back(tmp_path, mac, arm):
    t = np.arange(6) * 0.004
    q = np.column_stack([np.sin(t), np.cos(t)])
    names, file = ("shoulder", "elbow"), tmp_path / "a.yaml"
    table = SetPointTable(name="arm", joint_names=names, cycle=4e-3, t=t, q=q, dq=2 * q, ddq=3 * q)
    RosYamlFormat().write(table, file)
    trajectory = read_trajectory(file)
    assert trajectory.joints == names
    np.testing.assert_allclose(trajectory.t, table.t, rtol=0, atol=1e-12)
    for fewer, name in enumerate(("q", "dq", "ddq")):
        atol = 0.51 * 10.0 ** (fewer - 7)
        np.testing.assert_allclose(getattr(trajectory, name), getattr(table, name), 0, atol)
    # By name, in the order of the arm; other joints of the file are not looked at.
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


def test_goals_and_messages_of_moveit_and_what_echo_prints(read):
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


def test_a_bag_of_moveit(tmp_path):
    kind = "moveit_msgs/msg/RobotTrajectory"

    def make(x):
        points = [_point(x, [1, 2, 3])]
        inner = x.JointTrajectory(header=_header(x, 0), joint_names=NAMES, points=points)
        return x.RobotTrajectory(joint_trajectory=inner)

    definition = {kind: "trajectory_msgs/JointTrajectory joint_trajectory\n"}
    bag = _bag(tmp_path / "bag", {"/plan": (kind, [make])}, definition)
    assert read_trajectory(bag, ["shoulder", "elbow"]).q.tolist() == [[3.0, 1.0]]


GOAL = "control_msgs/action/FollowJointTrajectory"
# Definitions of bags name types of folders of their own in full.
UUID = "unique_identifier_msgs/msg/UUID"
GOALS = {
    UUID: "uint8[16] uuid\n",
    f"{GOAL}_Goal": "trajectory_msgs/msg/JointTrajectory trajectory\n",
    f"{GOAL}_SendGoal_Request": f"{UUID} goal_id\n{GOAL}_Goal goal\n",
    f"{GOAL}_SendGoal_Event": f"{GOAL}_SendGoal_Request[<=1] request\n",
    "control_msgs/msg/FollowJointTrajectoryActionGoal": f"{GOAL}_Goal goal\n",
}


def _goal(x, kind, uuid):
    """A goal of an action in a message of a kind; without a uuid, a response."""
    points = [_point(x, [1, 2, 3])]
    inner = x.JointTrajectory(header=_header(x, 0), joint_names=NAMES, points=points)
    goal = x.FollowJointTrajectory_Goal(trajectory=inner)
    name = kind.rpartition("/")[2]
    if name.endswith("ActionGoal"):
        return x.FollowJointTrajectoryActionGoal(goal=goal)
    if name.endswith("_Goal"):
        return goal
    number = x.UUID(uuid=np.full(16, uuid or 0, dtype=np.uint8))
    request = x.FollowJointTrajectory_SendGoal_Request(goal_id=number, goal=goal)
    if name.endswith("_Request"):
        return request
    return x.FollowJointTrajectory_SendGoal_Event(request=[request] if uuid else [])


def test_bags_of_goals_of_actions(tmp_path, monkeypatch):
    # The writer shortens names of messages only.
    monkeypatch.setattr("rosbags.typesys.store.denormalize_msgtype", lambda name: name)
    for i, kind in enumerate(x for x in GOALS if x != UUID):
        # Services record requests twice, and responses without a request.
        uuids = [1, 1, None, None] if kind.endswith("_Event") else [1]
        make = [partial(_goal, kind=kind, uuid=u) for u in uuids]
        bag = _bag(tmp_path / f"bag{i}", {"/goal": (kind, make)}, GOALS)
        assert read_trajectory(bag, ["shoulder", "elbow"]).q.tolist() == [[3.0, 1.0]], kind
    make = [partial(_goal, kind=f"{GOAL}_SendGoal_Event", uuid=u) for u in (1, 2)]
    bag = _bag(tmp_path / "two", {"/goal": (f"{GOAL}_SendGoal_Event", make)}, GOALS)
    refusals(read_trajectory, [(bag, "more than one FollowJointTrajectory_SendGoal_Event")])


TIMES = """
{sec: 1, nanosec: 500000000}
{secs: 1, nsecs: 500000000}
{nsecs: 500000000, secs: 1}
1.5
1.5e+0
"""


def test_times_of_yaml_in_all_forms(read):
    for time in TIMES.split("\n")[1:-1]:
        text = f"joint_names: [a]\npoints: [{{positions: [1], time_from_start: {time}}}]"
        np.testing.assert_allclose(read(text).t, [1.5], rtol=0, atol=1e-12, err_msg=time)
    start = "joint_names: [a]\npoints: [{positions: [1], time_from_start: %s}]"
    bad = ("soon", "'1.5'", "{sec: 1}", "{secs: 1, nanosec: 0}", "1e12", "[1, 2]", "true")
    refusals(read, [(start % x, "point 1: time_from_start must be a number of") for x in bad])


def test_a_repeated_point_of_yaml_is_skipped(read):
    point = "{positions: [%g], time_from_start: %g}"
    points = [point % x for x in ((1, 0), (2, 0.5), (3, 1), (3, 1))]
    file = read(f"joint_names: [a]\npoints: [{', '.join(points)}]")
    np.testing.assert_allclose(np.column_stack([file.t, file.q]), [(0, 1), (0.5, 2), (1, 3)])
    assert len(file.notes) == 1 and "repeats" in file.notes[0]
    assert file.resolution["q"] == 0.1


def test_names_with_a_prefix_and_new_names(tmp_path):
    points = f"points: [{{positions: [1, 2, 3], {AT_ONCE}]"
    (tmp_path / "a.yaml").write_text(f"joint_names: [left_b, left_a, right_a]\n{points}")
    refusals(lambda x: read_trajectory(x, ["a", "b"]), [(tmp_path / "a.yaml", "-=*right_*")])
    chosen = read_trajectory(tmp_path / "a.yaml", ["a", "b"], columns="-=right_*")
    assert chosen.q.tolist() == [[2.0, 1.0]]
    assert "left_a = a" in chosen.notes[0]
    chosen = read_trajectory(tmp_path / "a.yaml", ["x", "b"], columns="x=right_a")
    assert chosen.q.tolist() == [[3.0, 1.0]]
    bag = _bag(tmp_path / "bag", {"/joint_states": _states()})
    trajectory = read_trajectory(bag, ["arm/shoulder", "arm/elbow"])
    np.testing.assert_array_equal(trajectory.q, Q[:, [2, 0]])
    assert len(trajectory.notes) == 1
    log = _bag(tmp_path / "log", {"/c": _controller("reference", "feedback")}, {CONTROLLER: NEW})
    assert read_log(log, columns="*_joint=*").joint_names == tuple(f"{x}_joint" for x in NAMES)


def test_joints_that_the_arm_does_not_have(read, tmp_path):
    text = f"joint_names: [a, c]\npoints: [{{positions: [1, 2], {AT_ONCE}]"
    (tmp_path / "a.yaml").write_text(text)
    (tmp_path / "a.csv").write_text("t,q_a [rad],q_c [rad]\n0,1,2\n1,1,2\n")
    files = {"a.yaml": "c", "a.csv": "q_c [rad]"}
    for name, spare in files.items():
        # A joint is not renamed to itself, and one that is missing cannot be renamed.
        table = [(["a", "b", "c"], "2 joints ... has 3 ... Add the other joints")]
        table.append((["a", "b"], f"--columns 'b={spare}'"))
        refusals(lambda x, y=name: read_trajectory(tmp_path / y, x), table, name)


OTHERS = f"""
trajectory: [{INNER}, {INNER}] => has 2 trajectories, but a file
a: 1 => no JointTrajectory ... joint_names and points
joint_names: [a] | points: [] => without points
joint_names: [a] | points: [{{positions: [1]}}] => point 1: ... time_from_start
joint_names: [a] | points: [{{positions: [1], {AT_ONCE.replace("0}}", ".inf}}")}] => point 1:
joint_names: [a] | points: [{{positions: [x], {AT_ONCE}] => point 1: positions ... ['x']
"""


def test_yaml_of_something_else(read):
    refusals(lambda x: read(x.replace(" | ", "\n")), OTHERS, "a.yaml")


@pytest.mark.parametrize("plugin", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_joint_states(tmp_path, plugin):
    bag = _bag(tmp_path / "bag", {"/joint_states": _states()}, plugin=plugin)
    for place in (bag, next(x for x in bag.iterdir() if x.suffix in (".mcap", ".db3"))):
        trajectory = read_trajectory(place, ["shoulder", "elbow"])
        np.testing.assert_allclose(trajectory.t, T, rtol=0, atol=1e-12)
        np.testing.assert_array_equal(trajectory.q, Q[:, [2, 0]])
        np.testing.assert_array_equal(trajectory.dq, 2 * Q[:, [2, 0]])
        assert trajectory.ddq is None


def test_the_state_of_a_controller_is_a_log(tmp_path):
    for i, (text, fields) in enumerate((
        (OLD, ("desired", "actual")),
        (NEW, ("reference", "feedback")),
        (BOTH, ("reference", "feedback", "desired", "actual")),
        (BOTH, ("desired", "actual", "reference", "feedback")),
    )):  # fmt: skip
        topics = {"/controller/state": _controller(*fields), "/joint_states": _states()}
        bag = _bag(tmp_path / f"bag{i}", topics, {CONTROLLER: text})
        log = read_log(bag, start=0.02)
        assert log.joint_names == tuple(NAMES)
        np.testing.assert_allclose(log.t, T[5:], rtol=0, atol=1e-12)
        np.testing.assert_array_equal(log.command, Q[5:] + 0.1)
        np.testing.assert_array_equal(log.measured, Q[5:])
        np.testing.assert_array_equal(read_trajectory(bag, ["elbow"]).q, Q[:, :1])


@pytest.mark.parametrize("packed", CompressionMode)
@pytest.mark.parametrize("plugin", StoragePlugin)
def test_bags_that_unpack_to_too_much(tmp_path, monkeypatch, plugin, packed):
    if (plugin, packed) == (StoragePlugin.SQLITE3, CompressionMode.STORAGE):
        pytest.skip("sqlite3 has no compression of its own")
    monkeypatch.setattr(ros_files, "SMALL", 100_000)
    kind, (*others, last) = _states(4)
    for size in (1, 200_000):

        def large(x, size=size):
            message = last(x)
            message.header.frame_id = "a" * size
            return message

        topics = {"/states": (kind, [*others, large])}
        bag = _bag(tmp_path / f"bag{size}", topics, None, plugin, packed)
        if size > 1:
            with pytest.raises(InvalidInput):
                read_trajectory(bag)
        else:
            np.testing.assert_array_equal(read_trajectory(bag, NAMES).q, Q[:4])


def test_several_topics_and_what_is_no_bag(tmp_path):
    bag = _bag(tmp_path / "bag", {"/left": _states(3), "/right": _states(4)})
    assert len(read_trajectory(bag, topic="/right").t) == 4
    refusals(lambda x: read_trajectory(bag, topic=x), [("/up", "no topic '/up' ... '/left'")])
    (tmp_path / "a.mcap").write_bytes(b"no bag")
    (tmp_path / "folder").mkdir()
    (tmp_path / "a.yaml").write_text("a: 1\n")
    no_bags = [
        ("bag", "several topics of the type JointState ... --topic ... /left, /right"),
        ("a.mcap", "a.mcap cannot be read as a bag of ROS 2"),
        ("folder", "folder cannot be read as a bag of ROS 2"),
    ]
    refusals(lambda x: read_trajectory(tmp_path / x), no_bags)
    no_logs = [
        ("bag", "no topic of the type JointTrajectoryControllerState"),
        ("b.db3", "does not exist"),
        ("a.yaml", "a log needs commands and measured positions"),
    ]
    refusals(lambda x: read_log(tmp_path / x), no_logs)
