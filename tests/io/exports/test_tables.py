"""CSV, npz and ROS, read back by pandas, numpy, PyYAML and rosbags."""

import dataclasses
import io
import json
import re

import numpy as np
import pandas as pd
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore
from tests.io.tables import refusals

from armcontour.io import read_trajectory
from armcontour.io.exports import csv_text, text, write_table
from armcontour.io.exports.text import event_data

EVENT = re.compile(r'(?P<name>\w+)=(?P<value>on|off|[-\d.e]+|"(?:[^"\\]|\\.)*")@(?P<t>[\d.]+)')
QUANTITIES = (("q", "rad"), ("dq", "rad/s"), ("ddq", "rad/s^2"))


def assert_columns(found, table, atol):
    np.testing.assert_allclose(found["t [s]"], table.t, rtol=0, atol=atol)
    for quantity, unit in QUANTITIES:
        for i, name in enumerate(table.joint_names):
            values = found[f"{quantity} {name} [{unit}]"]
            expected = getattr(table, quantity)[:, i]
            np.testing.assert_allclose(values, expected, rtol=0, atol=atol, err_msg=name)


def events_in(cell):
    words = {"on": True, "off": False}
    return [
        (x["name"], words[x["value"]] if x["value"] in words else json.loads(x["value"]), x["t"])
        for x in EVENT.finditer(cell)
    ]


@pytest.mark.parametrize("dof", [2, 7])
def test_csv_comes_back_in_pandas(table, tmp_path, dof):
    given = table(dof)
    write_table(given, tmp_path / "a.csv", format="csv")
    found = pd.read_csv(tmp_path / "a.csv")
    assert len(found.columns) == 1 + 3 * dof + 1
    assert_columns(found, given, 0.5000001e-12)
    cells = found["events"].fillna("")
    expected = [(x.name, x.value, f"{x.t:.12f}") for x in given.events]
    assert [x for cell in cells for x in events_in(cell)] == expected
    assert [i for i, cell in enumerate(cells) for _ in events_in(cell)] == given.point_of_events


def test_csv_without_events_is_what_check_reads(table, tmp_path):
    given = table(6, events=())
    write_table(given, tmp_path / "a.csv", format="csv")
    found = read_trajectory(tmp_path / "a.csv", given.joint_names)
    for name in ("t", "q", "dq", "ddq"):
        np.testing.assert_allclose(getattr(found, name), getattr(given, name), 0, 0.5000001e-12)
    # Names that are numbers and words stay apart.
    given = dataclasses.replace(table(2), joint_names=("joint 1", "1"))
    write_table(given, tmp_path / "a.csv", format="csv")
    assert_columns(pd.read_csv(tmp_path / "a.csv"), given, 1e-11)


def test_npz_comes_back_to_the_last_bit_and_without_pickles(table, tmp_path):
    given = dataclasses.replace(table(6), tool=np.ones((9, 3)), ddq=None)
    write_table(given, tmp_path / "a.npz", format="npz")
    with np.load(tmp_path / "a.npz", allow_pickle=False) as found:
        for name in ("t", "q", "dq", "tool"):
            np.testing.assert_array_equal(found[name], getattr(given, name))
        assert "ddq" not in found
        assert found["joint_names"].tolist() == list(given.joint_names)
        assert found["event_name"].tolist() == [x.name for x in given.events]
        assert found["event_t"].tolist() == [x.t for x in given.events]
        assert found["event_due"].tolist() == [x.due for x in given.events]
        values = [json.loads(x) for x in found["event_value"].tolist()]
        assert values == [x.value for x in given.events]
        assert [type(x) for x in values] == [type(x.value) for x in given.events]
        assert float(found["period"]) == given.period and str(found["name"]) == "part 7"


def by_numpy(header, rows):
    file = io.StringIO()
    file.write(",".join(header) + "\n")
    np.savetxt(file, rows, fmt="%.12f", delimiter=",")
    return file.getvalue()


@given(
    arrays(
        np.float64,
        st.tuples(st.integers(0, 12), st.integers(1, 5)),
        elements=st.floats(-1e18, 1e18, allow_subnormal=True),
    )
)
def test_is_the_same_text_as_numpys(rows):
    header = ["t [s]", *(f"joint {i} [rad]" for i in range(rows.shape[1]))]
    assert csv_text(header, [rows]) == by_numpy(header, rows)


def test_numbers_on_and_beside_ties_are_rounded_as_numpy_does():
    """Odd multiples of 2^-13 are ties of twelve decimals; their neighbours differ by one bit."""
    rng = np.random.default_rng(3)
    size = 10.0 ** rng.uniform(-4, 3.9, 500)
    ties = (2 * np.floor(size * 2.0**12) + 1) * 2.0**-13
    units = np.floor(size * 1e12) * 1e-12 + 0.5e-12
    edges = np.array([9007.199254740992, 9.9999999999995, 99.9999999999995, 999.9999999999995])
    more = np.array([2.0**-13, -(2.0**-13), 0.5e-12, -0.0, -1e-300, 1e300, np.pi])
    near = np.concatenate([ties, -units, edges, 10.0 ** np.arange(-13, 4), more])
    rows = np.column_stack([near, np.nextafter(near, -np.inf), np.nextafter(near, np.inf)])
    assert csv_text(["a", "b", "c"], [rows]) == by_numpy(["a", "b", "c"], rows)
    for row in rows:
        assert csv_text(["a", "b", "c"], [row[None]]) == by_numpy(["a", "b", "c"], row[None])


def test_nothing_is_lost_between_pieces(monkeypatch):
    monkeypatch.setattr(text, "CHUNK", 30)
    for count in (9, 10, 11, 30):
        rows = np.random.default_rng(0).normal(size=(count, 3))
        found = csv_text(["a", "b", "c"], [rows[:, 0], rows[:, 1:]])
        assert found == by_numpy(["a", "b", "c"], rows)
    # A comma in a name does not make a column.
    found = csv_text(["t [s]", 'wrist, "left" [rad]'], [np.zeros(1), np.zeros(1)])
    assert found.splitlines()[0] == 't [s],"wrist, ""left"" [rad]"'


ARRAYS = {"positions": "q", "velocities": "dq", "accelerations": "ddq"}


def ros_yaml(table, file):
    write_table(table, file, format="ros-yaml")
    text = file.read_text(encoding="utf-8")
    documents = list(yaml.safe_load_all(text))
    assert len(documents) == 1  # `ros2 topic pub --yaml-file` sends every document
    return documents[0], text


def test_yaml_is_a_joint_trajectory(table, tmp_path):
    types = get_typestore(Stores.ROS2_HUMBLE).types
    point = types["trajectory_msgs/msg/JointTrajectoryPoint"]
    fields = {x.name for x in dataclasses.fields(point)} - {"__msgtype__"}
    for dof in (2, 6):
        given = table(dof)
        found, text = ros_yaml(given, tmp_path / "a.yaml")
        assert list(found) == ["header", "joint_names", "points"]
        assert found["header"] == {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}
        assert found["joint_names"] == list(given.joint_names)
        for key, name in ARRAYS.items():
            values = [x[key] for x in found["points"]]
            np.testing.assert_allclose(values, getattr(given, name), rtol=0, atol=0.5000001e-12)
        starts = [x["time_from_start"] for x in found["points"]]
        assert [x["sec"] * 10**9 + x["nanosec"] for x in starts] == [4000_000 * i for i in range(9)]
        assert all(x["effort"] == [] and set(x) == fields for x in found["points"])
        mark = "# event: "
        lines = [x.removeprefix(mark) for x in text.splitlines() if x.startswith(mark)]
        assert [json.loads(x) for x in lines] == [event_data(x) for x in given.events]


def test_yaml_without_derivatives_has_empty_lists(table, tmp_path):
    given = table()
    for dq, kept in ((None, ["positions"]), (given.dq, ["positions", "velocities"])):
        found, _ = ros_yaml(dataclasses.replace(given, dq=dq, ddq=None), tmp_path / "a.yaml")
        assert [x for x in ARRAYS if found["points"][0][x]] == kept
    # Hours are told to the nanosecond.
    given = dataclasses.replace(table(count=3), t=np.array([0, 1.0000000004, 12345.678901234]))
    found, _ = ros_yaml(given, tmp_path / "a.yaml")
    starts = [tuple(x["time_from_start"].values()) for x in found["points"]]
    assert starts == [(0, 0), (1, 0), (12345, 678901234)]


def test_refuses_times_that_ros_cannot_hold(table, tmp_path):
    words = {1e-10: "less than a nanosecond", 3e9: "at most 2147483647 s"}
    for form in ("ros-yaml", "mcap"):

        def write(t, form=form):
            given = dataclasses.replace(table(count=3, events=()), t=np.sort([0, 1, t]))
            write_table(given, tmp_path / "a", format=form)

        refusals(write, words.items())
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("order", ["C", "F"])
def test_a_bag_comes_back_from_its_folder(table, tmp_path, order):
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
        read = [(x.topic, at, reader.deserialize(y, x.msgtype)) for x, at, y in reader.messages()]
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
    # Without events, a bag has one message.
    write_table(table(2, events=()), tmp_path / "bag", format="mcap")
    with Reader(tmp_path / "bag") as reader:
        assert reader.message_count == 1 and len(reader.topics) == 1
        assert reader.start_time == 0
