"""ROS 2 formats: a JointTrajectory as YAML, or a bag (MCAP) with a JointTrajectory and events."""

from __future__ import annotations

import json
from dataclasses import dataclass
from itertools import chain
from pathlib import Path as FilePath
from tempfile import TemporaryDirectory
from textwrap import indent
from typing import Annotated, Any

import numpy as np

from armcontour.core import checks
from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import Checked
from armcontour.core.quantities import Axes, Duration, Quantity
from armcontour.files.exports.table import (
    FEWER_DECIMALS,
    SetPointTable,
    event_data,
    fixed_form,
    format_rows,
    write_pieces,
)
from armcontour.motion import Execution

TOPIC = "/joint_trajectory_controller/joint_trajectory"
EVENTS_TOPIC = "/armcontour/events"
SECOND = 1_000_000_000
# Largest duration in ROS [s]; its seconds are a 32-bit integer.
MAX_DURATION = 2**31 - 1
# Fields of `SetPointTable` by the names of the fields of a JointTrajectoryPoint.
FIELDS = {"positions": "q", "velocities": "dq", "accelerations": "ddq", "effort": "torque"}
# Smallest tolerance [rad]; encoder errors and a delay of one controller cycle are smaller.
MIN_TOLERANCE = 1e-3
# Minimum time after the last point within which the joints must reach the goal [s].
SETTLING = 0.5
TOLERANCE = "- name: %s\n  position: %.6f\n  velocity: 0.0\n  acceleration: 0.0\n"


@checks.explain_calls
@dataclass(frozen=True, slots=True, kw_only=True)
class GoalTolerances(Checked):
    """Tolerances of a goal of the action FollowJointTrajectory.

    Args:
        path: Largest deviation of each joint from the trajectory during the motion [rad], (dof,).
        goal: Largest deviation of each joint from the last point at the end [rad], (dof,).
        time: Time after the last point within which the joints must reach the goal [s].
    """

    path: Annotated[FloatArray, Quantity("", sign="positive"), Axes("joints")]
    goal: Annotated[FloatArray, Quantity("", sign="positive"), Axes("joints")]
    time: Duration = SETTLING


def predict_tolerances(execution: Execution, factor: float = 2.0) -> GoalTolerances:
    """Tolerances of a goal, computed from the predicted joint errors of its set-points.

    Args:
        execution: The predicted motion.
        factor: Ratio of the tolerances to the largest predicted errors. A real arm can exceed the
            predicted errors. No tolerance is below 1 mrad.

    Raises:
        InvalidInput: `factor` is less than 1.
    """
    factor = checks.check_number("factor", factor, "")
    if factor < 1:
        raise InvalidInput(f"factor must be at least 1, but is {factor:g}.", allowed=1.0)
    commands, t = execution.set_points, execution.t
    measured = execution.q if execution.motor_q is None else execution.motor_q
    command = np.column_stack([np.interp(t, commands.t, q) for q in commands.q.T])
    errors = np.abs(command - measured)
    late = float(t[-1] - commands.t[-1])
    return GoalTolerances(
        path=np.maximum(factor * errors.max(axis=0), MIN_TOLERANCE),
        goal=np.maximum(factor * errors[-1], MIN_TOLERANCE),
        time=max(2 * late, SETTLING),
    )


def write_ros_yaml(
    table: SetPointTable,
    file: FilePath,
    *,
    decimals: int | None = None,
    tolerances: GoalTolerances | None = None,
) -> None:
    """Write a JointTrajectory message as YAML; with tolerances, a FollowJointTrajectory goal."""
    # `ros2 topic pub` accepts the text, which has the form of `ros2 topic echo`. The message has no
    # field for events and contours; each is a comment in JSON at the top, `# event: {...}`.
    most = table.decimals_of(decimals)
    fields = {
        name: (getattr(table, x), fixed_form(most - FEWER_DECIMALS.get(x, 0), table.dof))
        for name, x in FIELDS.items()
    }
    present = {name: x for name, (x, _) in fields.items() if x is not None}
    lines = [f"  {name}: [{x if name in present else ''}]\n" for name, (_, x) in fields.items()]
    point = f"- {''.join(lines).lstrip()}  time_from_start:\n    sec: %d\n    nanosec: %d\n"
    ns = _nanoseconds(table)
    values = np.column_stack([*present.values(), ns // SECOND, ns % SECOND])
    events = "".join(f"# event: {json.dumps(event_data(x))}\n" for x in table.events)
    contours = "".join(
        f"# contour: {json.dumps({'name': name, 't': round(t, 9)}, ensure_ascii=False)}\n"
        for t, name in table.named_contours
    )
    names = [json.dumps(x, ensure_ascii=False) for x in table.joint_names]
    listed = "".join(f"- {x}\n" for x in names)
    head = (
        "header:\n  stamp:\n    sec: 0\n    nanosec: 0\n  frame_id: ''\n"
        f"joint_names:\n{listed}points:\n"
    )
    about, end = f"# {table.title}\n{contours}{events}", list[str]()
    if tolerances is not None:
        about += "trajectory:\n"
        head, point = indent(head, "  "), indent(point, "  ")
        if len(tolerances.path) != table.dof:
            raise InvalidInput(
                f"The tolerances have values for {len(tolerances.path)} joints, but {table.name!r} "
                f"has {table.dof} joints."
            )
        for key, values_of in (("path", tolerances.path), ("goal", tolerances.goal)):
            rows = zip(names, values_of, strict=True)
            end += [f"{key}_tolerance:\n", *(TOLERANCE % row for row in rows)]
        ns_late = round(tolerances.time * SECOND)
        end.append(
            f"goal_time_tolerance:\n  sec: {ns_late // SECOND}\n  nanosec: {ns_late % SECOND}\n"
        )
    write_pieces(file, chain([about, head], format_rows(point, values), end))


def write_mcap(table: SetPointTable, file: FilePath) -> None:
    """Write a bag with MCAP storage: a folder with the trajectory message and the events."""
    # The trajectory message is at time 0 of the bag. Each event is a std_msgs/msg/String with JSON
    # on the topic /armcontour/events at the time of the event, so that playing the bag publishes
    # the events in sync with the motion.
    try:
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise InvalidInput(
            "The format MCAP requires the library rosbags. Install it with pip install "
            "'armcontour[ros]'."
        ) from None
    store = get_typestore(Stores.ROS2_HUMBLE)
    with TemporaryDirectory(prefix=".armcontour-", dir=file.parent) as temporary:
        # rosbags names the file in the folder after the folder, with an additional extension.
        bag = FilePath(temporary) / (file.stem if file.suffix == ".mcap" else file.name)
        with Writer(bag, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
            _write_messages(writer, table, store)
        bag.rename(file)


def _write_messages(writer: Any, table: SetPointTable, store: Any) -> None:
    """Write the messages of a table into an open bag."""
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
    """JointTrajectory message of a table, as a type of rosbags."""
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
    # rosbags cannot serialize rows of Fortran-ordered arrays, such as arrays read from a file.
    q, dq, ddq, torque = (
        empty if x is None else np.ascontiguousarray(x)
        for x in (getattr(table, key) for key in FIELDS.values())
    )
    points = [
        make["JointTrajectoryPoint"](
            positions=position,
            velocities=velocity,
            accelerations=acceleration,
            effort=effort,
            time_from_start=make["Duration"](sec=ns // SECOND, nanosec=ns % SECOND),
        )
        for position, velocity, acceleration, effort, ns in zip(
            q, dq, ddq, torque, _nanoseconds(table).tolist(), strict=True
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
    if table.duration > MAX_DURATION:
        raise InvalidInput(
            f"The motion of {table.name!r} takes {table.duration:g} s, but a duration in ROS is at "
            f"most {MAX_DURATION} s.",
            needed=table.duration,
            allowed=float(MAX_DURATION),
        )
    rounded = np.rint(table.t * 1e9).astype(np.intp)
    if not (np.diff(rounded) > 0).all():
        raise InvalidInput(
            f"The points of {table.name!r} must be at least 1 ns apart, but are nearer."
        )
    return rounded
