"""Reader of joint trajectories of ROS as YAML: messages, action goals, and those of MoveIt."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from armcontour.core import yaml_loader
from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.file_access import read_text
from armcontour.core.text import plain_number, show
from armcontour.files.csv_table import Digits, last_digit, rename
from armcontour.files.joint_table import TrajectoryFile, drop_repeated_rows
from armcontour.motion.log import match_joints, raise_other_joints

# Fields of messages and goals that contain the JointTrajectory, directly or nested.
INNER_FIELDS = ("request", "goal", "trajectory", "joint_trajectory")
# Names of the fields of a time in ROS 2 and ROS 1.
STAMPS = (("sec", "nanosec"), ("secs", "nsecs"))
YAMLS = (".yaml", ".yml")
ARRAYS = {"q": "positions", "dq": "velocities", "ddq": "accelerations"}
# Resolution of times in ROS [s].
NANOSECOND = 1e-9


def is_ros_file(file: str | FilePath) -> bool:
    """Return whether a file is YAML, which contains a trajectory of ROS."""
    return FilePath(file).suffix.lower() in YAMLS


def read_ros_motion(
    file: FilePath, joint_names: Sequence[str], names: str | None = None
) -> TrajectoryFile:
    """Read a JointTrajectory in the form of `ros2 topic echo`; `names` renames its joints."""
    if names is not None and "=" not in names:
        raise InvalidInput(
            f"{file.name} is a file of ROS, which has no columns. --columns can only rename its "
            "joints, such as 'elbow_joint=left_elbow_joint'."
        )
    # The output of `ros2 topic echo` ends with a document separator.
    text = read_text(file, "trajectory file").rstrip().removesuffix("---")
    data = _trajectory_in(yaml_loader.load(text, file.name))
    if not isinstance(data, dict) or not {"joint_names", "points"} <= set(data):
        raise InvalidInput(
            f"{file.name} has not exactly one JointTrajectory. It must be a JointTrajectory, or a "
            "message or goal that contains one, with the keys joint_names and points, and with "
            "positions and time_from_start in each point."
        )
    if not isinstance(data["points"], list) or not isinstance(data["joint_names"], list):
        raise InvalidInput(f"{file.name}: joint_names and points must be lists.")
    if not data["points"]:
        raise InvalidInput(f"{file.name} has a trajectory without points.")
    points = [_Point(file.name, i, x) for i, x in enumerate(data["points"], start=1)]
    called = [str(x) for x in data["joint_names"]]
    called = called if names is None else list(rename(called, names, file.name))
    return _join_points(file.name, called, points, joint_names)


def _trajectory_in(data: Any) -> Any:
    """JointTrajectory in a message or goal; `data` itself if it has no field of INNER_FIELDS."""
    if isinstance(data, list):
        return _trajectory_in(data[0]) if len(data) == 1 else data
    for name in INNER_FIELDS:
        if isinstance(data, dict) and data.get(name) is not None:
            return _trajectory_in(data[name])
    return data


class _Point:
    """Point of a trajectory: numbers by the names of ARRAYS, and the time from the start [ns]."""

    def __init__(self, source: str, number: int, data: Any) -> None:
        location = f"{source}, point {number}"
        if not isinstance(data, dict):
            raise InvalidInput(
                f"{location}: a point must have positions and time_from_start, but is {show(data)}."
            )
        self.numbers: dict[str, list[Any]] = {}
        for name in ARRAYS.values():
            values = data.get(name) or ()
            numbers = (
                [plain_number(x) for x in values] if isinstance(values, list | tuple) else [None]
            )
            if None in numbers:
                raise InvalidInput(
                    f"{location}: {name} must be a list of numbers, but is {show(values)}."
                )
            self.numbers[name] = numbers
        start = data.get("time_from_start")
        self.nanoseconds = _nanoseconds(start)
        if abs(self.nanoseconds) >= 2**63:
            raise InvalidInput(
                f"{location}: time_from_start must be a number of seconds, or sec and nanosec "
                f"(secs and nsecs in ROS 1), and at most 292 years, but is {show(start)}."
            )


def _nanoseconds(start: Any) -> int:
    """Time in YAML [ns], from seconds or from fields of ROS 1 or 2; 2**63 if it is invalid."""
    fields = [start]
    if isinstance(start, dict):
        pair = next((x for x in STAMPS if set(start) == set(x)), None)
        fields = [] if pair is None else [start[x] for x in pair]
    numbers = [plain_number(x) for x in fields]
    if not numbers or None in numbers or isinstance(start, str):
        return 2**63
    if isinstance(start, dict):
        return int(fields[0]) * 10**9 + int(fields[1])
    return round(float(start) * 1e9)


def _join_points(
    source: str, names: Sequence[str], points: Sequence[_Point], joint_names: Sequence[str]
) -> TrajectoryFile:
    """Motion of the points of a trajectory, with the resolution of the printed numbers."""
    requested = tuple(joint_names) or tuple(names)
    order = match_joints(names, requested, source)
    if not order:
        raise_other_joints(source, names, requested, names)
    arrays = {}
    for kind, field in ARRAYS.items():
        rows = [x.numbers[field] for x in points]
        if kind != "q" and not all(rows):
            continue
        for number, row in enumerate(rows, start=1):
            if len(row) <= max(order):
                raise InvalidInput(
                    f"{source}, sample {number}: the message has {len(row)} {field}, but needs at "
                    f"least {max(order) + 1}, one per joint name.",
                    index=number - 1,
                )
        arrays[kind] = np.array([[row[j] for j in order] for row in rows], dtype=float)
    times = np.array([x.nanoseconds for x in points]) * NANOSECOND
    values = np.concatenate(list(arrays.values()), axis=1)
    kept, notes = drop_repeated_rows(times, values, source)
    tidied: dict[str, Any] = {key: x[kept] for key, x in arrays.items()}
    return TrajectoryFile(
        source=source,
        joints=requested,
        t=times[kept],
        **tidied,
        resolution={"t": NANOSECOND, **{key: _last_digit(x) for key, x in arrays.items()}},
        notes=notes,
    )


def _last_digit(values: FloatArray) -> float:
    """Value of the last printed digit of numbers, if each is printed in its shortest form."""
    digits = Digits()
    digits.add([repr(x) for x in values.ravel().tolist()])
    return last_digit([digits])
