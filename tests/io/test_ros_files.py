"""Trajectories and logs of ROS: those of our exports, and bags written by rosbags' own writer."""

from __future__ import annotations

from pathlib import Path as FilePath
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

import armcontour as ac
from armcontour.errors import InvalidInput
from armcontour.io import read_trajectory
from armcontour.io.exports import write_table
from armcontour.io.exports.table import Table
from armcontour.io.log_file import read_log

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


@pytest.fixture(scope="module")
def table() -> Table:
    t = np.arange(6) * 0.004
    q = np.column_stack([np.sin(t), np.cos(t)])
    return Table(
        name="arm", joint_names=("shoulder", "elbow"), period=4e-3, t=t, q=q, dq=2 * q, ddq=3 * q
    )


def _bag(
    folder: FilePath,
    topics: dict[str, tuple[str, list[Any]]],
    definitions: dict[str, str] | None = None,
    plugin: StoragePlugin = StoragePlugin.MCAP,
    packed: CompressionMode = CompressionMode.NONE,
) -> FilePath:
    store = get_typestore(Stores.ROS2_HUMBLE)
    for name, text in (definitions or {}).items():
        store.register(get_types_from_msg(text, name))
    writer = Writer(folder, version=9, storage_plugin=plugin)
    writer.set_compression(packed, CompressionFormat.ZSTD)
    with writer:
        for topic, (kind, messages) in topics.items():
            connection = writer.add_connection(topic, kind, typestore=store)
            for i, make in enumerate(messages):
                raw = store.serialize_cdr(make(SimpleNamespace(**_types(store))), kind)
                writer.write(connection, 10**18 + i * 4_000_000, raw)
    return folder


def _types(store: Any) -> dict[str, Any]:
    return {name.rpartition("/")[2]: x for name, x in store.types.items()}


def _header(x: Any, i: int) -> Any:
    stamp = x.Time(sec=1_700_000_000, nanosec=i * 4_000_000)
    return x.Header(stamp=stamp, frame_id="")


def _point(x: Any, q: Any) -> Any:
    none = np.zeros(0)
    return x.JointTrajectoryPoint(
        positions=np.array(q, dtype=float),
        velocities=none,
        accelerations=none,
        effort=none,
        time_from_start=x.Duration(sec=0, nanosec=0),
    )


def _states(count: int = 80) -> tuple[str, list[Any]]:
    def make(i: int) -> Any:
        return lambda x: x.JointState(
            header=_header(x, i), name=NAMES, position=Q[i], velocity=2 * Q[i], effort=np.zeros(0)
        )

    return "sensor_msgs/msg/JointState", [make(i) for i in range(count)]


def _controller(command: str, measured: str, *others: str) -> tuple[str, list[Any]]:
    def make(i: int) -> Any:
        def message(x: Any) -> Any:
            fields = {command: _point(x, Q[i] + 0.1), measured: _point(x, Q[i])}
            fields |= {name: _point(x, []) for name in others}
            return x.JointTrajectoryControllerState(
                header=_header(x, i), joint_names=NAMES, **fields
            )

        return message

    return CONTROLLER, [make(i) for i in range(len(T))]


@pytest.mark.parametrize("form", ["ros-yaml", "mcap"])
def test_exports_come_back(table: Table, tmp_path: FilePath, form: str) -> None:
    file = tmp_path / f"a.{form.removeprefix('ros-')}"
    write_table(table, file, format=form)
    found = read_trajectory(file)
    assert found.joints == ("shoulder", "elbow")
    np.testing.assert_allclose(found.t, table.t, rtol=0, atol=1e-12)
    for name in ("q", "dq", "ddq"):
        np.testing.assert_allclose(getattr(found, name), getattr(table, name), atol=1e-12)
    # By name, in the order of the arm; other joints of the file are not looked at.
    turned = read_trajectory(file, ["elbow", "shoulder"])
    np.testing.assert_array_equal(turned.q, found.q[:, ::-1])
    assert read_trajectory(file, ["elbow"]).q.shape == (6, 1)
    with pytest.raises(InvalidInput, match="the joints 'shoulder', 'elbow', but 'wrist'"):
        read_trajectory(file, ["wrist"])


def test_what_echo_prints(tmp_path: FilePath) -> None:
    (tmp_path / "a.yaml").write_text(
        "header:\n  stamp:\n    sec: 0\n    nanosec: 0\n  frame_id: ''\n"
        "joint_names:\n- a\npoints:\n"
        "- positions:\n  - 0.125\n  velocities: []\n  accelerations: []\n  effort: []\n"
        "  time_from_start:\n    sec: 1\n    nanosec: 5\n"
        "- positions:\n  - 2.125\n  velocities: []\n  accelerations: []\n  effort: []\n"
        "  time_from_start:\n    sec: 2\n    nanosec: 500000000\n---\n"
    )
    found = read_trajectory(tmp_path / "a.yaml")
    np.testing.assert_allclose(found.t, [1 + 5e-9, 2.5], rtol=0, atol=1e-12)
    np.testing.assert_array_equal(found.q, [[0.125], [2.125]])
    assert found.dq is None
    assert found.resolution["q"] == pytest.approx(1e-3)
    assert found.resolution["t"] == pytest.approx(1e-9)


INNER = "{joint_names: [a], points: [{positions: [1.5], " + AT_ONCE + "]}"


@pytest.mark.parametrize(
    "text",
    [
        "trajectory: " + INNER,
        "goal_id: {uuid: [1, 2]}\ngoal: {trajectory: " + INNER + "}",
        "joint_trajectory: " + INNER + "\nmulti_dof_joint_trajectory: {joint_names: []}",
        "model_id: arm\ntrajectory:\n- joint_trajectory: " + INNER + "\ntrajectory_start: {}",
    ],
)
def test_goals_and_messages_of_moveit(tmp_path: FilePath, text: str) -> None:
    (tmp_path / "a.yaml").write_text(text)
    found = read_trajectory(tmp_path / "a.yaml")
    assert found.joints == ("a",) and found.q.tolist() == [[1.5]]


def test_a_bag_of_moveit(tmp_path: FilePath) -> None:
    kind = "moveit_msgs/msg/RobotTrajectory"

    def make(x: Any) -> Any:
        inner = x.JointTrajectory(
            header=_header(x, 0), joint_names=NAMES, points=[_point(x, [1, 2, 3])]
        )
        return x.RobotTrajectory(joint_trajectory=inner)

    definition = {kind: "trajectory_msgs/JointTrajectory joint_trajectory\n"}
    bag = _bag(tmp_path / "bag", {"/plan": (kind, [make])}, definition)
    assert read_trajectory(bag, ["shoulder", "elbow"]).q.tolist() == [[3.0, 1.0]]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (f"trajectory: [{INNER}, {INNER}]", "holds 2 trajectories, but one"),
        ("trajectory: []", "no JointTrajectory"),
        ("a: 1\n", "no JointTrajectory.*joint_names and points"),
        ("joint_names: [a]\npoints: []\n", "without points"),
        ("joint_names: [a]\npoints: 3\n", "must be lists"),
        ("joint_names: [a]\npoints: [{positions: [1]}]\n", "point 1: .*time_from_start"),
        (
            f"joint_names: [a, b]\npoints:\n- {{positions: [1], {AT_ONCE}",
            "sample 1: 1 positions, but at least 2 joints",
        ),
        (
            "joint_names: [a]\npoints:\n"
            "- {positions: [1], time_from_start: {sec: 0, nanosec: .inf}}",
            "point 1: ",
        ),
        (
            "joint_names: [a]\npoints:\n- {positions: [1], time_from_start: "
            f"{{sec: 1, nanosec: {'9' * 30}}}}}",
            "point 1: ",
        ),
        (
            f"joint_names: [a]\npoints:\n- {{positions: [x], {AT_ONCE}",
            "point 1: .*could not convert",
        ),
    ],
)
def test_yaml_of_something_else(tmp_path: FilePath, text: str, words: str) -> None:
    (tmp_path / "a.yaml").write_text(text)
    with pytest.raises(InvalidInput, match=f"a.yaml.*{words}"):
        read_trajectory(tmp_path / "a.yaml")


@pytest.mark.parametrize("plugin", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
@pytest.mark.parametrize("whole", [True, False])
def test_joint_states(tmp_path: FilePath, plugin: StoragePlugin, whole: bool) -> None:
    bag = _bag(tmp_path / "bag", {"/joint_states": _states()}, plugin=plugin)
    file = next(x for x in bag.iterdir() if x.suffix in (".mcap", ".db3"))
    found = read_trajectory(bag if whole else file, ["shoulder", "elbow"])
    np.testing.assert_allclose(found.t, T, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(found.q, Q[:, [2, 0]])
    np.testing.assert_array_equal(found.dq, 2 * Q[:, [2, 0]])
    assert found.ddq is None


@pytest.mark.parametrize(
    ("text", "fields"),
    [
        (OLD, ("desired", "actual")),
        (NEW, ("reference", "feedback")),
        (BOTH, ("reference", "feedback", "desired", "actual")),
        (BOTH, ("desired", "actual", "reference", "feedback")),
    ],
)
def test_the_state_of_a_controller_is_a_log(
    tmp_path: FilePath, text: str, fields: tuple[str, ...]
) -> None:
    topics = {"/controller/state": _controller(*fields), "/joint_states": _states()}
    bag = _bag(tmp_path / "bag", topics, {CONTROLLER: text})
    log = read_log(bag, start=0.02)
    assert log.joint_names == tuple(NAMES)
    np.testing.assert_allclose(log.t, T[5:], rtol=0, atol=1e-12)
    np.testing.assert_array_equal(log.command, Q[5:] + 0.1)
    np.testing.assert_array_equal(log.measured, Q[5:])
    np.testing.assert_array_equal(read_trajectory(bag, ["elbow"]).q, Q[:, :1])


@pytest.mark.parametrize("size", [1, 70_000_000])
@pytest.mark.parametrize("packed", CompressionMode)
@pytest.mark.parametrize("plugin", StoragePlugin)
def test_bags_that_unpack_to_too_much(
    tmp_path: FilePath, plugin: StoragePlugin, packed: CompressionMode, size: int
) -> None:
    if (plugin, packed) == (StoragePlugin.SQLITE3, CompressionMode.STORAGE):
        pytest.skip("sqlite3 has no compression of its own")
    kind, (*others, last) = _states(4)

    def large(x: Any) -> Any:
        message = last(x)
        message.header.frame_id = "a" * size
        return message

    bag = _bag(tmp_path / "bag", {"/states": (kind, [*others, large])}, None, plugin, packed)
    if size > 1:
        with pytest.raises(InvalidInput):
            read_trajectory(bag)
    else:
        np.testing.assert_array_equal(read_trajectory(bag, NAMES).q, Q[:4])


def test_several_topics(tmp_path: FilePath) -> None:
    bag = _bag(tmp_path / "bag", {"/left": _states(3), "/right": _states(4)})
    with pytest.raises(InvalidInput, match="several topics of JointState.*--topic.*/left, /right"):
        read_trajectory(bag)
    assert len(read_trajectory(bag, topic="/right").t) == 4
    with pytest.raises(InvalidInput, match="no topic '/up'.*'/left'"):
        read_trajectory(bag, topic="/up")
    with pytest.raises(InvalidInput, match="no topic of JointTrajectoryControllerState"):
        read_log(bag)


def test_what_is_no_bag(tmp_path: FilePath) -> None:
    (tmp_path / "a.mcap").write_bytes(b"no bag")
    (tmp_path / "folder").mkdir()
    for name in ("a.mcap", "folder"):
        with pytest.raises(InvalidInput, match=f"{name} cannot be read as a bag of ROS 2"):
            read_trajectory(tmp_path / name)
    with pytest.raises(InvalidInput, match="There is no"):
        read_log(tmp_path / "b.db3")
    (tmp_path / "a.yaml").write_text("a: 1\n")
    with pytest.raises(InvalidInput, match="a log needs commands and measured positions"):
        read_log(tmp_path / "a.yaml")


def test_an_export_keeps_its_limits(tmp_path: FilePath, mac: ac.Trajectory, arm: ac.Arm) -> None:
    samples = mac.sample(4e-3)
    table = Table(name="mac", joint_names=arm.joint_names, period=4e-3, t=samples.t, q=samples.q)
    write_table(table, tmp_path / "a.yaml", format="ros-yaml")
    found = read_trajectory(tmp_path / "a.yaml", arm.joint_names)
    np.testing.assert_allclose(found.q, samples.q, atol=1e-12)
    assert found.resolution["q"] == pytest.approx(1e-12)
