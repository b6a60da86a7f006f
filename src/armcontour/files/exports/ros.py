"""ROS 2 formats: a JointTrajectory as YAML, or in a bag (MCAP) together with the events."""

from __future__ import annotations

import json
from itertools import chain
from pathlib import Path as FilePath
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from armcontour.core.checks import IntArray
from armcontour.core.errors import InvalidInput
from armcontour.files.exports.table import (
    FIXED,
    SetPointTable,
    event_data,
    format_rows,
    write_pieces,
)

TOPIC = "/joint_trajectory_controller/joint_trajectory"
EVENTS_TOPIC = "/armcontour/events"
SECOND = 1_000_000_000
# A duration in ROS has a 32-bit number of seconds.
LONGEST = 2**31 - 1


def write_ros_yaml(table: SetPointTable, file: FilePath) -> None:
    """Write the table as the YAML of a trajectory_msgs/msg/JointTrajectory."""
    # The text is valid for `ros2 topic pub` and has the form of `ros2 topic echo`. The message has
    # no field for events, so each event is a comment at the top in JSON, `# event: {...}`.
    fields = {"positions": table.q, "velocities": table.dq, "accelerations": table.ddq}
    present = {name: x for name, x in fields.items() if x is not None}
    lines = [
        f"  {name}: [{', '.join([FIXED] * table.dof) if name in present else ''}]\n"
        for name in fields
    ]
    point = (
        f"- {''.join(lines).lstrip()}"
        "  effort: []\n  time_from_start:\n    sec: %d\n    nanosec: %d\n"
    )
    ns = _nanoseconds(table)
    values = np.column_stack([*present.values(), ns // SECOND, ns % SECOND])
    events = "".join(f"# event: {json.dumps(event_data(x))}\n" for x in table.events)
    names = "".join(f"- {json.dumps(x, ensure_ascii=False)}\n" for x in table.joint_names)
    head = (
        f"# {table.name}\n{events}"
        "header:\n  stamp:\n    sec: 0\n    nanosec: 0\n  frame_id: ''\n"
        f"joint_names:\n{names}points:\n"
    )
    write_pieces(file, chain([head], format_rows(point, values)))


def write_mcap(table: SetPointTable, file: FilePath) -> None:
    """Write a bag with storage MCAP: a folder with the trajectory message and the events."""
    # The trajectory message is at time 0 of the bag. Each event is a std_msgs/msg/String of JSON on
    # the topic /armcontour/events at its own time, so playing the bag publishes the events in step
    # with the motion.
    try:
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise InvalidInput(
            "MCAP needs the library rosbags: pip install 'armcontour[ros]'."
        ) from None
    store = get_typestore(Stores.ROS2_HUMBLE)
    with TemporaryDirectory(prefix=".armcontour-", dir=file.parent) as temporary:
        # rosbags names the file inside after the folder and adds an extension.
        bag = FilePath(temporary) / (file.stem if file.suffix == ".mcap" else file.name)
        with Writer(bag, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
            _fill(writer, table, store)
        bag.rename(file)


def _fill(writer: Any, table: SetPointTable, store: Any) -> None:
    """Write the messages into an open bag."""
    kind = "trajectory_msgs/msg/JointTrajectory"
    topic = writer.add_connection(TOPIC, kind, typestore=store)
    writer.write(topic, 0, store.serialize_cdr(_message(table, store.types), kind))
    if not table.events:
        return
    kind = "std_msgs/msg/String"
    topic = writer.add_connection(EVENTS_TOPIC, kind, typestore=store)
    for event in table.events:
        message = store.types[kind](data=json.dumps(event_data(event)))
        time = max(0, round(event.t * SECOND))
        writer.write(topic, time, store.serialize_cdr(message, kind))


def _message(table: SetPointTable, types: Any) -> Any:
    """The table as a JointTrajectory message of rosbags."""
    make = {
        name.rpartition("/")[2]: types[name]
        for name in (
            "trajectory_msgs/msg/JointTrajectory",
            "trajectory_msgs/msg/JointTrajectoryPoint",
            "std_msgs/msg/Header",
            "builtin_interfaces/msg/Time",
            "builtin_interfaces/msg/Duration",
        )
    }
    none = np.zeros(0)
    empty = [none] * len(table.t)
    # Rows of arrays that lie column by column, as those read from a file do, are not written.
    q, dq, ddq = (
        empty if x is None else np.ascontiguousarray(x) for x in (table.q, table.dq, table.ddq)
    )
    points = [
        make["JointTrajectoryPoint"](
            positions=position,
            velocities=velocity,
            accelerations=acceleration,
            effort=none,
            time_from_start=make["Duration"](sec=ns // SECOND, nanosec=ns % SECOND),
        )
        for position, velocity, acceleration, ns in zip(
            q, dq, ddq, _nanoseconds(table).tolist(), strict=True
        )
    ]
    stamp = make["Time"](sec=0, nanosec=0)
    return make["JointTrajectory"](
        header=make["Header"](stamp=stamp, frame_id=""),
        joint_names=list(table.joint_names),
        points=points,
    )


def _nanoseconds(table: SetPointTable) -> IntArray:
    """Times of the points in whole nanoseconds, (n,)."""
    if table.duration > LONGEST:
        raise InvalidInput(
            f"{table.name} takes {table.duration:g} s, but a duration in ROS is at most "
            f"{LONGEST} s.",
            needed=table.duration,
            allowed=float(LONGEST),
        )
    rounded = np.rint(table.t * 1e9).astype(np.intp)
    if not (np.diff(rounded) > 0).all():
        raise InvalidInput(f"Points of {table.name!r} are less than a nanosecond apart.")
    return rounded
