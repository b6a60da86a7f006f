"""Readers of joint trajectories and logs of ROS, from YAML and from messages in a bag."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from io import BytesIO
from itertools import islice
from pathlib import Path as FilePath
from types import SimpleNamespace
from typing import Any

import numpy as np

from armcontour.core import yaml_loader
from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.file_access import LARGE, MEGABYTE, SMALL, read_text
from armcontour.core.text import plain_number, show
from armcontour.files.csv_table import Digits, last_digit, rename
from armcontour.files.joint_table import TrajectoryFile, tidy_times
from armcontour.motion.log_checks import describe_match, match_joints, raise_other_joints

TRAJECTORY = "trajectory_msgs/msg/JointTrajectory"
# Message types of action goals, as ROS 1 and 2 record them.
GOAL_TYPES = tuple(
    f"{package}/{'action' if '_' in end else 'msg'}/{name}{end}"
    for package, name in (
        ("control_msgs", "FollowJointTrajectory"),
        ("moveit_msgs", "ExecuteTrajectory"),
    )
    for end in ("ActionGoal", "Goal", "_Goal", "_SendGoal_Request", "_SendGoal_Event")
)
# Message types that contain a JointTrajectory.
CONTAINER_TYPES = (
    "moveit_msgs/msg/RobotTrajectory",
    "moveit_msgs/msg/DisplayTrajectory",
    *GOAL_TYPES,
)
# Fields of these messages that contain the JointTrajectory, directly or nested.
INNER_FIELDS = ("request", "goal", "trajectory", "joint_trajectory")
EVENT = "_SendGoal_Event"
STATE = "sensor_msgs/msg/JointState"
CONTROLLER = "control_msgs/msg/JointTrajectoryControllerState"
# Names of the fields of command and measurement in the state of a controller, in newer and older
# releases of ROS 2.
COMMANDS = ("reference", "desired")
MEASUREMENTS = ("feedback", "actual")
# Names of the fields of a time in ROS 2 and ROS 1.
STAMPS = (("sec", "nanosec"), ("secs", "nsecs"))
YAMLS = (".yaml", ".yml")
BAGS = (".mcap", ".db3")
ARRAYS = {"q": "positions", "dq": "velocities", "ddq": "accelerations"}
# Lock for the replacement of the decompression functions of rosbags, which are global.
_rosbags = threading.Lock()
# Resolution of times in ROS [s].
NANOSECOND = 1e-9


def is_ros_file(file: str | FilePath) -> bool:
    """True if a path is a folder, or a file with an extension of ROS (YAML or bag)."""
    location = FilePath(file)
    return location.is_dir() or location.suffix.lower() in (*YAMLS, *BAGS)


def read_ros_motion(
    file: FilePath, joint_names: Sequence[str], topic: str | None, names: str | None = None
) -> TrajectoryFile:
    """Read the motion of joints from YAML or a bag; `names` renames joints of the file."""
    called = _joint_renamer(file.name, names)
    if file.suffix.lower() in YAMLS and not file.is_dir():
        if topic is not None:
            raise InvalidInput(f"{file.name} is a YAML file, which has no topics. Remove --topic.")
        return _read_yaml(file, joint_names, called)
    kind, messages = _read_bag(file, (TRAJECTORY, *CONTAINER_TYPES, CONTROLLER, STATE), topic)
    if kind in (TRAJECTORY, *CONTAINER_TYPES):
        if len(messages) > 1:
            raise InvalidInput(
                f"{file.name} has more than one {kind.rpartition('/')[2]} message. Record one "
                "message per bag."
            )
        message = _trajectory_in(file.name, messages[0][1])
        return _join_points(file.name, called(message.joint_names), message.points, joint_names)
    every = [called(_names_of(kind, x[1])) for x in messages]
    requested = tuple(joint_names) or every[0]
    orders = [match_joints(x, requested, file.name) for x in every]
    if not any(orders):
        raise_other_joints(file.name, every[0], requested, every[0])
    some = [i for i, x in enumerate(orders) if x]
    return _make_motion(
        file.name,
        _times([_stamp(messages[i]) for i in some]),
        _stack(
            file.name,
            [
                _JointState(x) if kind == STATE else _point(x, MEASUREMENTS)
                for x in (messages[i][1] for i in some)
            ],
            [orders[i] or [] for i in some],
        ),
        requested,
        describe_match(every[some[0]], requested, orders[some[0]] or []),
        {},
    )


def _joint_renamer(source: str, names: str | None) -> Callable[[Sequence[str]], tuple[str, ...]]:
    """Function that renames joints by the value of the option --columns."""
    if names is not None and "=" not in names:
        raise InvalidInput(
            f"{source} is a file of ROS, which has no columns. --columns can only rename its "
            "joints, such as 'elbow_joint=left_elbow_joint'."
        )
    return lambda x: tuple(x) if names is None else rename(tuple(x), names, source)


def _make_motion(
    source: str,
    times: FloatArray,
    arrays: dict[str, FloatArray],
    names: Sequence[str],
    notes: Sequence[str],
    digits: dict[str, float],
) -> TrajectoryFile:
    """Motion of points with times [s], without repeated points; `digits`: of printed numbers."""
    values = np.concatenate(list(arrays.values()), axis=1)
    t, rows, time_notes = tidy_times(times, values, NANOSECOND, source)
    tidied: dict[str, Any] = {key: x[rows] for key, x in arrays.items()}
    return TrajectoryFile(
        source=source,
        joints=tuple(names),
        t=t,
        **tidied,
        resolution={"t": NANOSECOND, **digits},
        notes=(*notes, *time_notes),
    )


def read_ros_log(file: FilePath, topic: str | None, names: str | None = None) -> TrajectoryFile:
    """Read commands and measured positions from the controller states in a bag."""
    if file.suffix.lower() in YAMLS and not file.is_dir():
        raise InvalidInput(
            f"{file.name} is YAML, but a log needs commands and measured positions. Record the "
            "topic controller_state of the joint trajectory controller in a bag, or write CSV."
        )
    called = _joint_renamer(file.name, names)
    _, messages = _read_bag(file, (CONTROLLER,), topic)
    joints = called(messages[0][1].joint_names)
    orders = [_joint_indices(file.name, called(x[1].joint_names), joints) for x in messages]
    arrays = {}
    for role, fields in (("command", COMMANDS), ("q", MEASUREMENTS)):
        parts = [_point(x[1], fields) for x in messages]
        arrays[role] = _stack(file.name, parts, orders, ("q",))["q"]
    return _make_motion(file.name, _times([_stamp(x) for x in messages]), arrays, joints, (), {})


def _read_yaml(
    file: FilePath,
    joint_names: Sequence[str],
    called: Callable[[Sequence[str]], tuple[str, ...]],
) -> TrajectoryFile:
    """Read a YAML file in the form of `ros2 topic echo` that contains a JointTrajectory."""
    # The output of `ros2 topic echo` ends with a document separator.
    text = read_text(file, "trajectory file").rstrip().removesuffix("---")
    data = _trajectory_in(file.name, yaml_loader.load(text, file.name))
    if not isinstance(data, dict) or not {"joint_names", "points"} <= set(data):
        raise InvalidInput(
            f"{file.name} has no JointTrajectory. It must be a JointTrajectory, or a message or "
            "goal that contains one, with the keys joint_names and points, and with positions and "
            "time_from_start in each point."
        )
    if not isinstance(data["points"], list) or not isinstance(data["joint_names"], list):
        raise InvalidInput(f"{file.name}: joint_names and points must be lists.")
    points = [_Point(file.name, i, x) for i, x in enumerate(data["points"], start=1)]
    names = called([str(x) for x in data["joint_names"]])
    return _join_points(file.name, names, points, joint_names, printed=True)


def _trajectory_in(source: str, data: Any) -> Any:
    """JointTrajectory in a message or goal; `data` itself if it has no field of INNER_FIELDS."""
    if isinstance(data, list):
        if len(data) > 1:
            raise InvalidInput(
                f"{source} has {len(data)} trajectories, but a file must have only one. Write them "
                "to separate files."
            )
        return _trajectory_in(source, data[0]) if data else data
    for name in INNER_FIELDS:
        inner = data.get(name) if isinstance(data, dict) else getattr(data, name, None)
        if inner is not None:
            return _trajectory_in(source, inner)
    return data


class _Point:
    """Point of a trajectory in YAML, with the attributes of a JointTrajectoryPoint message."""

    def __init__(self, source: str, number: int, data: Any) -> None:
        location = f"{source}, point {number}"
        if not isinstance(data, dict):
            raise InvalidInput(
                f"{location}: a point must have positions and time_from_start, but is {show(data)}."
            )
        for name in ARRAYS.values():
            values = data.get(name) or ()
            numbers = (
                [plain_number(x) for x in values] if isinstance(values, list | tuple) else [None]
            )
            if None in numbers:
                raise InvalidInput(
                    f"{location}: {name} must be a list of numbers, but is {show(values)}."
                )
            setattr(self, name, numbers)
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
    source: str,
    names: Sequence[str],
    points: Sequence[Any],
    joint_names: Sequence[str],
    *,
    printed: bool = False,
) -> TrajectoryFile:
    """Motion of the points of one trajectory; if `printed`, with the resolution of the numbers."""
    if not points:
        raise InvalidInput(f"{source} has a trajectory without points.")
    requested = tuple(joint_names) or tuple(names)
    order = _joint_indices(source, names, requested)
    notes = tuple(describe_match(names, requested, order))
    arrays = _stack(source, points, [order] * len(points))
    times = np.array([_duration(x) for x in points]) * NANOSECOND
    digits = {x: _last_digit(values) for x, values in arrays.items()} if printed else {}
    return _make_motion(source, times, arrays, requested, notes, digits)


def _last_digit(values: FloatArray) -> float:
    """Value of the last printed digit of numbers, if each is printed in its shortest form."""
    digits = Digits()
    digits.add([repr(x) for x in values.ravel().tolist()])
    return last_digit([digits])


def _stack(
    source: str,
    points: Sequence[Any],
    orders: Sequence[list[int]],
    kinds: Sequence[str] = tuple(ARRAYS),
) -> dict[str, FloatArray]:
    """Arrays, (n, dof), by kind; omits velocities or accelerations if any point lacks them.

    `orders` has for each point the indices of the requested joints.
    """
    arrays = {}
    for kind in kinds:
        rows = [getattr(x, ARRAYS[kind], ()) for x in points]
        if kind != "q" and not all(len(x) for x in rows):
            continue
        for number, (row, order) in enumerate(zip(rows, orders, strict=True), start=1):
            if len(row) <= max(order):
                raise InvalidInput(
                    f"{source}, sample {number}: the message has {len(row)} {ARRAYS[kind]}, but "
                    f"needs at least {max(order) + 1}, one per joint name.",
                    index=number - 1,
                )
        arrays[kind] = np.array(
            [[row[j] for j in order] for row, order in zip(rows, orders, strict=True)], dtype=float
        )
    return arrays


def _joint_indices(source: str, names: Sequence[str], requested: Sequence[str]) -> list[int]:
    """Index in `names` of each requested joint; InvalidInput if one is missing."""
    order = match_joints(list(names), requested, source)
    if not order:
        raise_other_joints(source, names, requested, names)
    return order


def _read_bag(
    file: FilePath, kinds: Sequence[str], topic: str | None
) -> tuple[str, list[tuple[int, Any]]]:
    """Read one topic of a bag; returns the message type, and (time [ns], message) pairs."""
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise InvalidInput(
            "Reading a bag of ROS requires the library rosbags. Install it with pip install "
            "'armcontour[ros]'."
        ) from None
    _check_size(file)
    unpacker, read = _Unpacker(file.name), _Unpacker(file.name)
    try:
        # Bags recorded before 2023 have no message definitions, so a default is necessary.
        store = get_typestore(Stores.ROS2_HUMBLE)
        with unpacker.installed(), AnyReader([file], default_typestore=store) as reader:
            # AnyReader unpacks a bag without an index completely when it opens the bag. The limit
            # of unpacked bytes is reset before reading.
            unpacker.remaining = LARGE
            of_topic = {x.topic: x for x in reader.connections}
            used = _choose_topic(
                file.name, {k: x.msgtype for k, x in of_topic.items()}, kinds, topic
            )
            kind = of_topic[used].msgtype
            messages: list[tuple[int, Any]] = [
                (at, reader.deserialize(read.count(raw), connection.msgtype))
                for connection, at, raw in islice(
                    reader.messages([x for x in reader.connections if x.topic == used]),
                    # More than one trajectory is an error, so at most two messages are read.
                    2
                    if kind in (TRAJECTORY, *CONTAINER_TYPES) and not kind.endswith(EVENT)
                    else None,
                )
            ]
            if kind.endswith(EVENT):
                # A goal has four events: request sent and received, response sent and received.
                # The responses have no request.
                goals = {
                    bytes(x.request[0].goal_id.uuid): (at, x) for at, x in messages if x.request
                }
                messages = list(goals.values())
    except InvalidInput:
        raise
    except Exception as error:  # for damaged bags, rosbags does not catch errors of its libraries
        problem = str(error).strip().rstrip(".") or type(error).__name__
        raise InvalidInput(
            f"{file.name} cannot be read as a bag of ROS 2: {show(problem)}."
        ) from None
    if not messages:
        raise InvalidInput(f"{file.name}: the topic {show(used)} has no messages.")
    return kind, messages


class _Unpacker:
    """Decompression of bags with a bound on the size, which rosbags does not have."""

    def __init__(self, source: str) -> None:
        self._source = source
        self.remaining = LARGE

    def count(self, data: bytes) -> bytes:
        """Count unpacked data and return it; InvalidInput if a bound is exceeded."""
        self.remaining -= len(data)
        if self.remaining < 0 or len(data) > SMALL:
            raise InvalidInput(
                f"The unpacked size of {self._source} is more than {LARGE / MEGABYTE:.0f} MB, or "
                f"that of a chunk or message is more than {SMALL / MEGABYTE:.0f} MB. Record only "
                "the required topic."
            )
        return data

    @contextmanager
    def installed(self) -> Iterator[None]:
        """Context in which rosbags uses this decompression; a lock allows one bag at a time."""
        import lz4.frame  # type: ignore[import-untyped, unused-ignore]
        import rosbags.rosbag2

        package: Any = rosbags.rosbag2
        reader, mcap = package.reader, package.storage_mcap

        def unpack(library: Any, data: bytes) -> bytes:
            with library.open(BytesIO(data), "rb") as unpacked:
                return self.count(unpacked.read(min(self.remaining, SMALL) + 1))

        @contextmanager
        def open_counted(file: Any, mode: str) -> Iterator[Any]:
            with zstd.open(file, mode) as unpacked:
                yield SimpleNamespace(read=lambda size: self.count(unpacked.read(size)))

        with _rosbags:
            zstd, unpack_lz4 = mcap.zstd, mcap.lz4_decompress
            bounded = SimpleNamespace(decompress=partial(unpack, zstd), open=open_counted)
            try:
                reader.zstd = mcap.zstd = bounded
                mcap.lz4_decompress = partial(unpack, lz4.frame)
                yield
            finally:
                reader.zstd = mcap.zstd = zstd
                mcap.lz4_decompress = unpack_lz4


def _check_size(file: FilePath) -> None:
    """Check that a bag exists and is not too large."""
    if not file.exists():
        raise InvalidInput(f"The trajectory file or log {file} does not exist.")
    parts = [x for x in file.iterdir() if x.is_file()] if file.is_dir() else [file]
    size = sum(x.stat().st_size for x in parts)
    if size > LARGE:
        raise InvalidInput(
            f"{file.name} has {size / MEGABYTE:.0f} MB, but at most {LARGE / MEGABYTE:.0f} MB are "
            "allowed. Record only the required topic."
        )


def _choose_topic(
    source: str, types: dict[str, str], kinds: Sequence[str], topic: str | None
) -> str:
    """Topic to read: `topic` if specified, or the only topic of the first type in the bag."""
    shown = ", ".join(f"{show(k)} ({x.rpartition('/')[2]})" for k, x in types.items()) or "none"
    names = " or ".join(x.rpartition("/")[2] for x in kinds)
    if topic is not None:
        if types.get(topic) not in kinds:
            raise InvalidInput(
                f"{source} has no topic {show(topic)} of the type {names}. Its topics are {shown}."
            )
        return topic
    for kind in kinds:
        topics = [x for x, y in types.items() if y == kind]
        if len(topics) > 1:
            raise InvalidInput(
                f"{source} has several topics of the type {kind.rpartition('/')[2]}. Choose one "
                f"with --topic ({', '.join(topics)})."
            )
        if topics:
            return topics[0]
    raise InvalidInput(f"{source} has no topic of the type {names}. Its topics are {shown}.")


def _names_of(kind: str, message: Any) -> Sequence[str]:
    """Names of the joints in a message."""
    return list(message.name if kind == STATE else message.joint_names)


class _JointState:
    """JointState message with the attributes of a point, without accelerations."""

    def __init__(self, message: Any) -> None:
        self.positions = message.position
        self.velocities = message.velocity


def _point(message: Any, fields: Sequence[str]) -> Any:
    """Point of a controller state: the first of `fields` with positions, else the first field."""
    points: Iterator[Any] = (getattr(message, x) for x in fields if hasattr(message, x))
    candidates = list(points)
    return next((x for x in candidates if len(x.positions)), candidates[0])


def _duration(point: Any) -> int:
    """Time of a point from the start of its trajectory [ns]."""
    if isinstance(point, _Point):
        return point.nanoseconds
    start = point.time_from_start
    return int(start.sec) * 10**9 + int(start.nanosec)


def _stamp(timed_message: tuple[int, Any]) -> int:
    """Time of a message by its header [ns], or by the bag if the header has none."""
    bag_time, message = timed_message
    stamp = message.header.stamp
    return (int(stamp.sec) * 10**9 + int(stamp.nanosec)) or bag_time


def _times(nanoseconds: Sequence[int]) -> FloatArray:
    """Times since the first time [s], (n,)."""
    first = nanoseconds[0]
    return np.array([x - first for x in nanoseconds]) * NANOSECOND
