"""ROS: the YAML by PyYAML, bags by rosbags' reader."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path as FilePath
from typing import Any, Literal

import numpy as np
import pytest
import yaml
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

from armcontour.errors import InvalidInput
from armcontour.io.exports import Table, write_table
from armcontour.io.exports.text import event_data

ARRAYS = {"positions": "q", "velocities": "dq", "accelerations": "ddq"}


def written(table: Table, file: FilePath) -> tuple[dict[str, Any], str]:
    write_table(table, file, format="ros-yaml")
    text = file.read_text(encoding="utf-8")
    documents = list(yaml.safe_load_all(text))
    assert len(documents) == 1  # `ros2 topic pub --yaml-file` sends every document
    return documents[0], text


@pytest.mark.parametrize("dof", [2, 6])
def test_yaml_is_a_joint_trajectory(
    table: Callable[..., Table], tmp_path: FilePath, dof: int
) -> None:
    given = table(dof)
    found, _ = written(given, tmp_path / "a.yaml")
    assert list(found) == ["header", "joint_names", "points"]
    assert found["header"] == {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}
    assert found["joint_names"] == list(given.joint_names)
    for key, name in ARRAYS.items():
        values = [x[key] for x in found["points"]]
        np.testing.assert_allclose(values, getattr(given, name), rtol=0, atol=0.5000001e-12)
    starts = [x["time_from_start"] for x in found["points"]]
    assert [x["sec"] * 10**9 + x["nanosec"] for x in starts] == [4_000_000 * i for i in range(9)]
    assert all(x["effort"] == [] for x in found["points"])


def test_yaml_has_events_as_comments(table: Callable[..., Table], tmp_path: FilePath) -> None:
    given = table()
    _, text = written(given, tmp_path / "a.yaml")
    lines = [x.removeprefix("# event: ") for x in text.splitlines() if x.startswith("# event: ")]
    assert [json.loads(x) for x in lines] == [event_data(x) for x in given.events]


def test_yaml_is_the_message_that_ros_knows(
    table: Callable[..., Table], tmp_path: FilePath
) -> None:
    found, _ = written(table(), tmp_path / "a.yaml")
    types = get_typestore(Stores.ROS2_HUMBLE).types
    point = types["trajectory_msgs/msg/JointTrajectoryPoint"]
    fields = {x.name for x in dataclasses.fields(point)} - {"__msgtype__"}
    assert all(set(x) == fields for x in found["points"])


@pytest.mark.parametrize(("orders", "kept"), [(0, ["positions"]), (1, ["positions", "velocities"])])
def test_yaml_without_derivatives_has_empty_lists(
    table: Callable[..., Table], tmp_path: FilePath, orders: int, kept: list[str]
) -> None:
    given = table()
    given = dataclasses.replace(given, dq=given.dq if orders else None, ddq=None)
    found, _ = written(given, tmp_path / "a.yaml")
    assert [x for x in ARRAYS if found["points"][0][x]] == kept


def test_hours_are_told_to_the_nanosecond(table: Callable[..., Table], tmp_path: FilePath) -> None:
    given = dataclasses.replace(table(count=3), t=np.array([0, 1.0000000004, 12345.678901234]))
    found, _ = written(given, tmp_path / "a.yaml")
    starts = [tuple(x["time_from_start"].values()) for x in found["points"]]
    assert starts == [(0, 0), (1, 0), (12345, 678901234)]


@pytest.mark.parametrize("form", ["ros-yaml", "mcap"])
@pytest.mark.parametrize(
    ("times", "words"),
    [([0, 1e-10, 1], "less than a nanosecond"), ([0, 1, 3e9], "at most 2147483647 s")],
)
def test_refuses_times_that_ros_cannot_hold(
    table: Callable[..., Table],
    tmp_path: FilePath,
    refuses: Callable[..., None],
    form: str,
    times: list[float],
    words: str,
) -> None:
    given = dataclasses.replace(table(count=3, events=()), t=np.array(times))
    refuses(lambda: write_table(given, tmp_path / "a", format=form), InvalidInput, words)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("order", ["C", "F"])
def test_a_bag_comes_back_from_its_folder(
    table: Callable[..., Table], tmp_path: FilePath, order: Literal["C", "F"]
) -> None:
    given = table(6)
    # Those of an earlier result lie column by column.
    arrays = {name: np.asarray(getattr(given, name), order=order) for name in ARRAYS.values()}
    given = dataclasses.replace(given, **arrays)
    assert given.q.flags.c_contiguous == (order == "C")
    bag = tmp_path / "motion.mcap"
    write_table(given, bag, format="mcap")
    assert sorted(x.name for x in bag.iterdir()) == ["metadata.yaml", "motion.mcap"]
    assert [x.name for x in tmp_path.iterdir()] == ["motion.mcap"]
    with AnyReader([bag]) as reader:
        read = [
            (x.topic, at, reader.deserialize(raw, x.msgtype)) for x, at, raw in reader.messages()
        ]
    topic, at, message = read[0]
    assert (topic, at) == ("/joint_trajectory_controller/joint_trajectory", 0)
    assert message.joint_names == list(given.joint_names)
    for key, name in ARRAYS.items():
        values = np.array([getattr(x, key) for x in message.points])
        np.testing.assert_array_equal(values, getattr(given, name))
    starts = [x.time_from_start for x in message.points]
    assert [x.sec * 10**9 + x.nanosec for x in starts] == [4_000_000 * i for i in range(9)]
    events = read[1:]
    assert {x[0] for x in events} == {"/armcontour/events"}
    assert [json.loads(x[2].data) for x in events] == [event_data(x) for x in given.events]
    assert [x[1] for x in events] == [round(x.t * 1e9) for x in given.events]


def test_a_bag_without_events_has_one_message(
    table: Callable[..., Table], tmp_path: FilePath
) -> None:
    write_table(table(2, events=()), tmp_path / "bag", format="mcap")
    with Reader(tmp_path / "bag") as reader:
        assert reader.message_count == 1 and len(reader.topics) == 1
        assert reader.start_time == 0
