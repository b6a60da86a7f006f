"""Messages of joints in the files of a bag of ROS 2, read by rosbags; in a limited process."""

from __future__ import annotations

import os
import shutil
import sqlite3
import struct
import sys
from array import array
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, field
from pathlib import Path as FilePath
from typing import Any, TypeAlias

from armcontour.core.file_access import MAX_RECORDED, MEGABYTE
from armcontour.core.text import count_noun, show, to_line

JOINT_STATE = "sensor_msgs/msg/JointState"
CONTROLLER_STATE = "control_msgs/msg/JointTrajectoryControllerState"
# Ending of a compressed file.
ZSTD = ".zstd"
# Compression of a bag, in its metadata.
BY_FILE = "file"
BY_MESSAGE = "message"
# Largest number of joints in a message, of sets of joints, and of topics.
MOST_JOINTS = 1000
MOST_SERIES = 100
MOST_TOPICS = 10_000
# Largest number of messages with joints.
MOST_MESSAGES = 10_000_000
# Number of bytes that are unpacked at once.
BLOCK = MEGABYTE
# Values of a message.
ROLES = ("command", "measured", "velocity")
NANOSECONDS = 10**9
# Number of bytes that name the encoding, size of a 64-bit number, and fewest bytes that are no
# padding at the end of a message [bytes].
ENCODING_SIZE = 4
NUMBER_SIZE = 8
PADDING = 4
# Numbers of a transform, of a velocity and of an acceleration in a MultiDOFJointTrajectoryPoint.
SEVERAL_NUMBERS = (7, 6, 6)
# Positions and velocities of a point.
_Point: TypeAlias = "tuple[array[float], array[float]]"


@dataclass(frozen=True, slots=True)
class Layout:
    """Fields of a message after its header and the names of the joints.

    Args:
        points: Points of a controller's state; none for the values of a joint state.
        has_several: Whether joints with several degrees of freedom follow.
        has_factor: Whether a speed factor follows.
    """

    points: tuple[str, ...] = ()
    has_several: bool = False
    has_factor: bool = False

    @property
    def definition(self) -> str:
        """The definition of a controller's state, as ROS 2 writes it."""
        lines = ["std_msgs/Header header", "string[] joint_names"]
        lines += [f"trajectory_msgs/JointTrajectoryPoint {x}" for x in self.points]
        if self.has_several:
            several = "trajectory_msgs/MultiDOFJointTrajectoryPoint multi_dof_"
            lines.append("string[] multi_dof_joint_names")
            lines += [f"{several}{x}" for x in self.points]
        if self.has_factor:
            lines.append("float64 speed_scaling_factor")
        return "\n".join([*lines, ""])


NEW_POINTS = ("reference", "feedback", "error", "output")
OLD_POINTS = ("desired", "actual", "error")
# All releases have the same joint states.
JOINT_STATE_LAYOUT = Layout()
# A controller's state by release, the newest first: with a speed factor since an update of Jazzy,
# without it since Iron, with old and new names in Humble, with old names before, and before
# Galactic without joints with several degrees of freedom.
LAYOUTS = (
    Layout(NEW_POINTS, has_several=True, has_factor=True),
    Layout(NEW_POINTS, has_several=True),
    Layout((*NEW_POINTS, "desired", "actual"), has_several=True),
    Layout(OLD_POINTS, has_several=True),
    Layout(OLD_POINTS),
)


class Unreadable(Exception):
    """The bag cannot be read; the text is a sentence."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BagQuestion:
    """What is read.

    Args:
        source: Name of the bag, for messages.
        files: Absolute paths of the files with messages.
        compression: `BY_FILE`, `BY_MESSAGE`, or empty.
        topic: The topic; None for all topics.
    """

    source: str
    files: tuple[str, ...]
    compression: str
    topic: str | None


@dataclass(slots=True)
class JointMessages:
    """Messages of one topic with the same joints.

    Args:
        topic: The topic.
        kind: Type of the messages.
        joints: Names of the joints, in the order of the first message.
        stamps: Time in the header of each message [ns].
        received: Time of arrival of each message [ns].
        values: Values by the names of `ROLES`, as 64-bit numbers: a row of all joints for each
            message that has such values.
        filled: Whether each message has such values, by the names of `ROLES`.
    """

    topic: str
    kind: str
    joints: tuple[str, ...]
    stamps: array[int] = field(default_factory=lambda: array("q"))
    received: array[int] = field(default_factory=lambda: array("q"))
    values: dict[str, bytearray] = field(default_factory=lambda: {x: bytearray() for x in ROLES})
    filled: dict[str, bytearray] = field(default_factory=lambda: {x: bytearray() for x in ROLES})

    @property
    def has_commands(self) -> bool:
        """Whether the messages are states of a controller."""
        return self.kind == CONTROLLER_STATE

    def add(self, content: _Content, received: int, source: str) -> None:
        """Add a message, with its joints in the order of the first one."""
        order = None
        if content.names != self.joints:
            index = {name: k for k, name in enumerate(content.names)}
            order = [index[x] for x in self.joints]
        for role, numbers in content.values.items():
            self.filled[role].append(len(numbers) > 0)
            if not numbers:
                continue
            if len(numbers) != len(self.joints):
                raise Unreadable(
                    f"{source}: message {len(self.stamps) + 1} of {to_line(self.topic)} names "
                    f"{count_noun(len(self.joints), 'joint')}, but has {len(numbers)} values of "
                    f"{role}. Record the joints again, or choose another topic (--topic)."
                )
            row = numbers if order is None else array("d", [numbers[k] for k in order])
            self.values[role] += row.tobytes()
        self.stamps.append(content.stamp)
        self.received.append(received)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BagAnswer:
    """Messages of joints in a bag, and the types of all messages by their topics."""

    series: tuple[JointMessages, ...]
    kinds: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class _Content:
    """Content of a message: names, time [ns], and values by the names of `ROLES`."""

    names: tuple[str, ...]
    stamp: int
    values: Mapping[str, array[float]]


def answer(question: BagQuestion, folder: FilePath) -> BagAnswer | str:
    """Read the messages of a bag; returns a sentence if they cannot be read.

    Args:
        question: What is read.
        folder: Empty folder for unpacked files.
    """
    reading = _Reading(question, folder)
    try:
        for number, file in enumerate(question.files):
            reading.add_file(FilePath(file), number)
    except MemoryError:
        raise
    except Unreadable as error:
        return str(error)
    except Exception as error:
        # For a damaged bag, rosbags can raise exceptions of any class.
        if type(error).__name__ == "NoMemError":
            raise MemoryError from None
        reason = to_line(str(error).partition("\n")[0].rstrip("."))
        return (
            f"{question.source} cannot be read as a bag of ROS 2: {reason}. A recording must be "
            "ended with Ctrl-C. Of a compressed bag, specify the folder."
        )
    return BagAnswer(series=tuple(reading.series.values()), kinds=reading.kinds)


class _Reading:
    """The messages of the files of a bag that are already read."""

    def __init__(self, question: BagQuestion, folder: FilePath) -> None:
        self.question = question
        self.source = question.source
        self.folder = folder
        self.kinds: dict[str, str] = {}
        self.series: dict[tuple[str, frozenset[str]], JointMessages] = {}
        self.unpacked = 0
        self.messages = 0

    def add_file(self, file: FilePath, number: int) -> None:
        """Add the messages of a file, which is the `number`th one of the bag."""
        from rosbags.rosbag2 import Reader

        name = file.name.removesuffix(ZSTD)
        place = self.folder / f"{number}{FilePath(name).suffix}"
        if self.question.compression == BY_FILE or file.name.endswith(ZSTD):
            self._unpack_file(file, place)
        else:
            # SQLite treats some characters of a path as those of a URI.
            _link(file, place)
        os.chdir(self.folder)
        if place.suffix == ".db3":
            _check_tables(place.name, self.source)
        with Reader(FilePath(place.name)) as reader:
            if len(reader.connections) > MOST_TOPICS:
                raise Unreadable(
                    f"{self.source} has {len(reader.connections)} topics, but at most "
                    f"{MOST_TOPICS} are read."
                )
            self.kinds |= {x.topic: x.msgtype for x in reader.connections if x.msgcount}
            self._add_messages(reader)

    def _unpack_file(self, file: FilePath, place: FilePath) -> None:
        """Unpack a compressed file."""
        with _zstd().open(file, "rb") as packed, place.open("wb") as whole:
            while block := packed.read(BLOCK):
                self._count_bytes(len(block))
                whole.write(block)
        # The messages in the file are not counted again.
        self.unpacked = 0

    def _count_bytes(self, count: int) -> None:
        """Count unpacked bytes, and refuse too many."""
        self.unpacked += count
        if self.unpacked > MAX_RECORDED:
            raise Unreadable(
                f"{self.source} has more than {MAX_RECORDED / MEGABYTE:.0f} MB when it is "
                "unpacked, which is the most that is read. Split the recording."
            )

    def _add_messages(self, reader: Any) -> None:
        """Add the messages of an open file to the series of their topics and joints."""
        topic = self.question.topic
        chosen = [
            x
            for x in reader.connections
            if x.msgtype in (JOINT_STATE, CONTROLLER_STATE) and topic in (None, x.topic)
        ]
        if not chosen:
            return
        layouts: dict[str, Layout] = {}
        before = self.messages
        for connection, received, data in reader.messages(connections=chosen):
            kind = connection.msgtype
            if self.question.compression == BY_MESSAGE:
                data = self._unpack_message(data)
            self._count_bytes(len(data))
            self.messages += 1
            if self.messages > MOST_MESSAGES:
                raise Unreadable(
                    f"{self.source} has more than {MOST_MESSAGES} messages with joints, which is "
                    "the most that is read. Split the recording."
                )
            if kind not in layouts:
                layouts[kind] = self._find_layout(connection.topic, kind, data)
            content = _decode(data, layouts[kind])
            self._add(connection.topic, kind, content, received)
        count = self.messages - before
        declared = sum(x.msgcount for x in chosen)
        if count != declared:
            raise Unreadable(
                f"{self.source} is damaged, because it has {count_noun(count, 'message')} with "
                f"joints, but counts {declared}. Record the joints again."
            )

    def _find_layout(self, topic: str, kind: str, data: bytes) -> Layout:
        """Return the layout of messages of a type, of which `data` is the first."""
        for layout in (JOINT_STATE_LAYOUT,) if kind == JOINT_STATE else LAYOUTS:
            with suppress(ValueError, struct.error):
                _decode(data, layout)
                return layout
        raise Unreadable(
            f"{self.source}: the messages of {to_line(topic)} do not have the fields of {kind} in "
            "any release of ROS 2 from Foxy to Jazzy. Choose another topic (--topic). Of a "
            "compressed bag, specify the folder."
        )

    def _unpack_message(self, data: bytes) -> bytes:
        """Unpack a compressed message."""
        unpacker = _zstd().ZstdDecompressor()
        whole: bytes = unpacker.decompress(data, MAX_RECORDED + 1)
        if not unpacker.eof and len(whole) <= MAX_RECORDED:
            raise Unreadable(f"{self.source} has an incomplete message. Record the joints again.")
        return whole

    def _add(self, topic: str, kind: str, content: _Content, received: int) -> None:
        """Add a message to the series of its topic and joints."""
        names = content.names
        if not names:
            return
        key = (topic, frozenset(names))
        if key not in self.series:
            self._check_joints(topic, names)
            self.series[key] = JointMessages(topic, kind, names)
        self.series[key].add(content, received, self.source)

    def _check_joints(self, topic: str, names: Sequence[str]) -> None:
        """Refuse too many joints, and too many sets of joints."""
        place = f"{self.source}: a message of {to_line(topic)}"
        if len(names) > MOST_JOINTS:
            raise Unreadable(
                f"{place} has {len(names)} joints, but at most {MOST_JOINTS} are read. Choose "
                "another topic (--topic)."
            )
        if len(self.series) >= MOST_SERIES:
            raise Unreadable(
                f"{self.source} has messages with more than {MOST_SERIES} different sets of "
                "joints. Choose a topic (--topic) whose joints do not change."
            )


def _zstd() -> Any:
    """Return the module that unpacks zstd, which rosbags requires."""
    if sys.version_info >= (3, 14):
        from compression import zstd
    else:
        from backports import zstd
    return zstd


def _link(file: FilePath, place: FilePath) -> None:
    """Make a file available at a place."""
    try:
        place.symlink_to(file)
    except OSError:
        # Windows allows links only to some users.
        shutil.copyfile(file, place)


def _check_tables(name: str, source: str) -> None:
    """Refuse a SQLite file that computes its rows when they are read; ROS 2 writes only tables."""
    with closing(sqlite3.connect(f"file:{name}?mode=ro&immutable=1", uri=True)) as base:
        for kind, table, page in _rows(base, "SELECT type, name, rootpage FROM sqlite_master"):
            computed = kind == "view" or (kind == "table" and not page)
            if kind == "table" and not computed:
                columns = _rows(base, "SELECT hidden FROM pragma_table_xinfo(?)", table)
                computed = any(hidden for (hidden,) in columns)
            if computed:
                raise Unreadable(
                    f"{source} is not a recording, because its table {show(table)} is computed. "
                    "Record the joints with `ros2 bag record`."
                )


def _rows(base: sqlite3.Connection, query: str, *values: str) -> Iterator[tuple[Any, ...]]:
    """Return the rows of a query."""
    return iter(base.execute(query, values).fetchall())


def _decode(data: bytes, layout: Layout) -> _Content:
    """Return the content of a message.

    The definition in the file is not used, because it could describe anything.

    Raises:
        ValueError: The message has another layout.
    """
    message = _Message(data)
    seconds = message.number("i")
    stamp = seconds * NANOSECONDS + message.number("I")
    message.text()
    names = message.texts()
    if not layout.points:
        values = {"command": array("d"), "measured": message.numbers()}
        values["velocity"] = message.numbers()
        message.numbers()
        message.check_end()
        return _Content(names, stamp, values)
    points = {x: message.point() for x in layout.points}
    if layout.has_several:
        message.texts()
        for _ in layout.points:
            message.skip_several_point()
    if layout.has_factor:
        message.number("d")
    message.check_end()
    command, _ = _filled_point(points, ("reference", "desired"))
    measured, velocity = _filled_point(points, ("feedback", "actual"))
    return _Content(names, stamp, dict(zip(ROLES, (command, measured, velocity), strict=True)))


def _filled_point(points: Mapping[str, _Point], names: Sequence[str]) -> _Point:
    """Return the first of some points of a message that has positions; else the last."""
    present = [points[x] for x in names if x in points]
    return next((x for x in present if x[0]), present[-1])


class _Message:
    """A message in CDR, which is read from its beginning.

    Numbers start at multiples of their size, counted from the end of the four bytes that name the
    encoding (Object Management Group, Common Object Request Broker Architecture, chapter 9.3).
    """

    def __init__(self, data: bytes) -> None:
        if len(data) < ENCODING_SIZE or data[0] != 0 or data[1] > 1:
            raise ValueError("a message has an unknown encoding")
        self.is_little = data[1] == 1
        self.order = "<" if self.is_little else ">"
        self.data = data[ENCODING_SIZE:]
        self.place = 0

    def number(self, form: str) -> Any:
        """Read a number, whose form is that of `struct`."""
        size = struct.calcsize(form)
        self.place += -self.place % size
        (value,) = struct.unpack_from(self.order + form, self.data, self.place)
        self.place += size
        return value

    def _take(self, size: int) -> bytes:
        """Read a number of bytes."""
        start = self.place
        self.place += size
        if self.place > len(self.data):
            raise ValueError("a message is too short")
        return self.data[start : self.place]

    def text(self) -> str:
        """Read a text, which ends with a zero byte."""
        return self._take(self.number("I"))[:-1].decode()

    def texts(self) -> tuple[str, ...]:
        """Read a sequence of texts."""
        return tuple([self.text() for _ in range(self.number("I"))])

    def numbers(self) -> array[float]:
        """Read a sequence of 64-bit numbers."""
        values = array("d")
        count = self.number("I")
        if count:
            self.place += -self.place % values.itemsize
            values.frombytes(self._take(count * values.itemsize))
        if self.is_little != (sys.byteorder == "little"):
            values.byteswap()
        return values

    def point(self) -> _Point:
        """Read the positions and velocities of a JointTrajectoryPoint."""
        positions = self.numbers()
        velocities = self.numbers()
        self.numbers()
        self.numbers()
        self._skip_duration()
        return positions, velocities

    def skip_several_point(self) -> None:
        """Skip a MultiDOFJointTrajectoryPoint: transforms, velocities and accelerations."""
        for count in SEVERAL_NUMBERS:
            for _ in range(self.number("I")):
                self.place += -self.place % NUMBER_SIZE
                self._take(count * NUMBER_SIZE)
        self._skip_duration()

    def _skip_duration(self) -> None:
        """Skip a Duration."""
        self.number("i")
        self.number("I")

    def check_end(self) -> None:
        """Refuse a message that has more fields; its end may be padded."""
        if not 0 <= len(self.data) - self.place < PADDING:
            raise ValueError("a message has more fields")
