"""Reader of bags of ROS 2 (.mcap, .db3): joint states, and states of trajectory controllers."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

import numpy as np

from armcontour.core.errors import FileError, InvalidInput
from armcontour.core.file_access import MAX_RECORDED, read_bytes
from armcontour.core.text import count_noun, list_some, show
from armcontour.files.csv_table import MAX_NAMED, CsvTable, read_table
from armcontour.files.joint_table import JointColumn, read_joint_title
from armcontour.motion.log import match_joints

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

JOINT_STATE = "sensor_msgs/msg/JointState"
CONTROLLER_STATE = "control_msgs/msg/JointTrajectoryControllerState"
# Files of a bag. A bag of `ros2 bag record` is a folder that contains them.
BAG_ENDINGS = (".mcap", ".db3")
METADATA = "metadata.yaml"
MISSING_LIBRARY = (
    "{task} requires rosbags, which is not installed. Install it with: pip install "
    "'armcontour[ros]'."
)
# Fields of a controller's state by release, the newest first: with a speed factor since an update
# of Jazzy, without it since Iron, with old and new names in Humble, with old names before. Bags of
# Humble in SQLite do not contain the definitions of their messages.
NEW_POINTS = ("reference", "feedback", "error", "output")
OLD_POINTS = ("desired", "actual", "error")
LAYOUTS = (
    (NEW_POINTS, "float64 speed_scaling_factor\n"),
    (NEW_POINTS, ""),
    ((*NEW_POINTS, "desired", "actual"), ""),
    (OLD_POINTS, ""),
)
# The layout of releases before Galactic, without joints of several degrees of freedom.
FIRST_LAYOUT = "std_msgs/Header header\nstring[] joint_names\n" + "".join(
    f"trajectory_msgs/JointTrajectoryPoint {x}\n" for x in OLD_POINTS
)
# Titles of columns by role: those that `read_log` and `read_trajectory` recognize.
TITLES = {"command": "command", "measured": "measured", "velocity": "dq"}
JOINT_TITLE = "q elbow_joint [deg]"
NANOSECONDS = 10**9
# Messages arrive at most this number of messages late.
MAX_DISORDER = 10
RECORD = "ros2 bag record /joint_states /CONTROLLER/controller_state"


@dataclass(slots=True)
class _Series:
    """Messages of one topic with the same joints: one row per message."""

    topic: str
    kind: str  # Type of the messages
    joints: tuple[str, ...]  # Names in the order of the first message
    stamps: list[int] = field(default_factory=list)  # Times in the headers [ns]
    received: list[int] = field(default_factory=list)  # Times of arrival [ns]
    # Values by the names of TITLES: a row per message, empty where the message has no such values
    values: dict[str, list[list[float]]] = field(default_factory=lambda: {x: [] for x in TITLES})

    @property
    def has_commands(self) -> bool:
        """Whether the messages are states of a controller."""
        return self.kind == CONTROLLER_STATE

    @property
    def label(self) -> str:
        """Topic and joints, for messages."""
        return f"{self.topic} ({list_some(list(self.joints), MAX_NAMED)})"

    def fits(self, joint_names: Sequence[str]) -> bool:
        """Return whether the messages have all joints of an arm, as `match_joints` finds them."""
        try:
            return not joint_names or match_joints(self.joints, joint_names, "") is not None
        except InvalidInput:
            # Several joints match. The error is raised when the joints are arranged.
            return True

    def add(self, message: Any, received: int, file: str) -> None:
        """Add a message, with its joints in the order of the first one."""
        names, arrays = _content(message, self.kind)
        order = [names.index(x) for x in self.joints]
        for role, numbers in arrays.items():
            if len(numbers) not in (0, len(names)):
                raise InvalidInput(
                    f"{file}: message {len(self.stamps) + 1} of {self.topic} names "
                    f"{count_noun(len(names), 'joint')}, but has {len(numbers)} values of "
                    f"{role}. Record the joints again, or choose another topic (--topic)."
                )
            row = [float(numbers[k]) for k in order] if len(numbers) else []
            self.values[role].append(row)
        stamp = message.header.stamp
        self.stamps.append(int(stamp.sec) * NANOSECONDS + int(stamp.nanosec))
        self.received.append(received)


def is_bag(file: FilePath, topic: str | None = None) -> bool:
    """Return whether a path is a bag: a file of one, or a folder with such files.

    Raises:
        InvalidInput: It is not a bag, but a topic is specified.
    """
    if file.suffix.lower() in BAG_ENDINGS or (file.is_dir() and bool(_storage_files(file))):
        return True
    if topic is not None:
        raise InvalidInput(
            f"{file.name} is not a bag of ROS 2 ({', '.join(BAG_ENDINGS)}), so it has no topics. "
            "Remove --topic."
        )
    return False


def read_bag(
    file: FilePath,
    joint_names: Sequence[str],
    *,
    topic: str | None = None,
    columns: str | None = None,
    commanded: bool = False,
) -> tuple[CsvTable[JointColumn], tuple[str, ...]]:
    """Read the joint motion in a bag as a table; returns the table and notes.

    The state of a controller is preferred to joint states, because it also has the commands. Times
    are the stamps of the messages, and count from the first message.

    Args:
        file: A file of a bag (.mcap, .db3), or the folder of a bag.
        joint_names: Names of the arm's joints; empty for those of the file.
        topic: The topic; None for the only one that has these joints.
        columns: New names of columns or joints, as in `rename`; None for those of the file.
        commanded: Whether a bag without commands is refused.

    Raises:
        InvalidInput: rosbags is not installed, the bag cannot be read, no topic or several topics
            fit, or a message has another number of values than of names.
    """
    if topic is not None:
        topic = f"/{topic.lstrip('/')}"
    chosen, notes = _choose(_read_series(file, topic), file, joint_names, topic)
    if commanded and not chosen.has_commands:
        raise InvalidInput(
            f"{file.name} has measured positions ({chosen.topic}), but no commands. Record the "
            f"state of the controller too, such as with `{RECORD}`."
        )
    text, text_notes = _to_text(chosen, file.name)
    table = read_table(
        text,
        file.name,
        partial(read_joint_title, joint_names=joint_names),
        example=JOINT_TITLE,
        columns=columns,
        option="--columns",
    )
    # Rows are counted as messages. Line 1 has the titles.
    table = replace(
        table,
        heading=f"{file.name}, topic {chosen.topic}",
        row_noun=f"topic {chosen.topic}, message",
        numbers=[x - 1 for x in table.numbers],
    )
    return table, (*notes, *text_notes)


def register_controller_state(store: Typestore, layout: int = 0) -> None:
    """Add the type of a controller's state to a store of types.

    Args:
        store: The store.
        layout: Index of the layout in LAYOUTS; the number of LAYOUTS for FIRST_LAYOUT.
    """
    from rosbags.typesys import get_types_from_msg

    definition = FIRST_LAYOUT
    if layout < len(LAYOUTS):
        points, end = LAYOUTS[layout]
        single = "".join(f"trajectory_msgs/JointTrajectoryPoint {x}\n" for x in points)
        several = "".join(
            f"trajectory_msgs/MultiDOFJointTrajectoryPoint multi_dof_{x}\n" for x in points
        )
        definition = (
            f"std_msgs/Header header\nstring[] joint_names\n{single}"
            f"string[] multi_dof_joint_names\n{several}{end}"
        )
    store.register(get_types_from_msg(definition, CONTROLLER_STATE))


def _storage_files(folder: FilePath) -> list[FilePath]:
    """Return the files with messages in the folder of a bag, in order; also compressed files."""
    names = [x for x in folder.iterdir() if x.name.removesuffix(".zstd").endswith(BAG_ENDINGS)]
    return sorted(x for x in names if x.is_file())


def _read_series(file: FilePath, topic: str | None) -> list[_Series]:
    """Read all messages of joints in a bag, or those of a topic; a series per topic and joints."""
    try:
        from rosbags.rosbag2 import Reader
    except ImportError:
        raise InvalidInput(MISSING_LIBRARY.format(task="Reading bags of ROS 2")) from None
    storage = _storage_files(file) if file.is_dir() else [file]
    for x in storage:
        # The content is read for its fingerprint, and to refuse files that may not be read.
        read_bytes(x, "bag", maximum=MAX_RECORDED)
    is_whole = file.is_dir() and (file / METADATA).is_file()
    series: dict[tuple[str, frozenset[str]], _Series] = {}
    kinds: dict[str, str] = {}
    try:
        with ExitStack() as stack:
            for x in [file] if is_whole else storage:
                reader = stack.enter_context(Reader(x))
                kinds |= {y.topic: y.msgtype for y in reader.connections if y.msgcount}
                _add_messages(reader, topic, file.name, series)
    except InvalidInput:
        raise
    except Exception as error:
        # For a damaged bag, rosbags can raise exceptions of any class.
        raise FileError(
            f"{file.name} cannot be read as a bag of ROS 2: {str(error).rstrip('.')}. A recording "
            "must be ended with Ctrl-C. Of a compressed bag, specify the folder."
        ) from None
    if not series:
        raise InvalidInput(_nothing_sentence(file.name, kinds, topic))
    return list(series.values())


def _add_messages(
    reader: Any, topic: str | None, file: str, series: dict[tuple[str, frozenset[str]], _Series]
) -> None:
    """Add the messages of an open bag to the series of their topics and joints."""
    chosen = [
        x
        for x in reader.connections
        if x.msgtype in (JOINT_STATE, CONTROLLER_STATE) and topic in (None, x.topic)
    ]
    decoders: dict[str, Any] = {}
    for connection, received, data in reader.messages(connections=chosen) if chosen else ():
        kind = connection.msgtype
        if kind not in decoders:
            decoders[kind] = _find_decoder(connection, data)
        message = decoders[kind](data, kind)
        names, _ = _content(message, kind)
        if names:
            key = (connection.topic, frozenset(names))
            one = series.setdefault(key, _Series(connection.topic, kind, tuple(names)))
            one.add(message, received, file)


def _find_decoder(connection: Any, data: bytes) -> Any:
    """Return the function that decodes messages of a topic, of which `data` is the first."""
    from rosbags.interfaces import MessageDefinitionFormat
    from rosbags.serde import SerdeError
    from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

    if connection.msgdef.format == MessageDefinitionFormat.MSG:
        store = get_typestore(Stores.EMPTY)
        store.register(get_types_from_msg(connection.msgdef.data, connection.msgtype))
        return store.deserialize_cdr
    if connection.msgdef.format == MessageDefinitionFormat.IDL:
        store = get_typestore(Stores.EMPTY)
        store.register(get_types_from_idl(connection.msgdef.data))
        return store.deserialize_cdr
    # All releases have the same joint states.
    count = len(LAYOUTS) + 1 if connection.msgtype == CONTROLLER_STATE else 1
    for layout in range(count):
        store = get_typestore(Stores.ROS2_HUMBLE)
        if connection.msgtype == CONTROLLER_STATE:
            register_controller_state(store, layout)
        try:
            store.deserialize_cdr(data, connection.msgtype)
        except SerdeError:
            if layout == count - 1:
                raise
        else:
            return store.deserialize_cdr
    raise AssertionError("the last layout returns or raises")


def _content(message: Any, kind: str) -> tuple[list[str], dict[str, Sequence[float]]]:
    """Return the joint names of a message, and its values by the names of TITLES."""
    if kind == JOINT_STATE:
        arrays = {"command": (), "measured": message.position, "velocity": message.velocity}
        return list(message.name), arrays
    command = _filled_point(message, ("reference", "desired"))
    measured = _filled_point(message, ("feedback", "actual"))
    arrays = {
        "command": command.positions,
        "measured": measured.positions,
        "velocity": measured.velocities,
    }
    return list(message.joint_names), arrays


def _filled_point(message: Any, names: Sequence[str]) -> Any:
    """Return the first of some points of a message that has positions; else the last."""
    points = [getattr(message, x) for x in names if hasattr(message, x)]
    return next((x for x in points if len(x.positions)), points[-1])


def _choose(
    series: Sequence[_Series], file: FilePath, joint_names: Sequence[str], topic: str | None
) -> tuple[_Series, list[str]]:
    """Choose the messages to read, and write notes on them.

    Raises:
        InvalidInput: No messages or several ones fit.
    """
    filled = [x for x in series if any(x.values["measured"]) or any(x.values["command"])]
    if not filled:
        raise InvalidInput(
            f"The messages of {list_some([x.label for x in series], MAX_NAMED)} in {file.name} "
            "have no positions. Record a topic with joint positions."
        )
    fitting = [x for x in filled if x.fits(joint_names)]
    # With --columns, joints can have other names than those of the arm.
    fitting = fitting or filled
    fitting = [x for x in fitting if x.has_commands] or fitting
    if len(fitting) > 1:
        found = "; ".join(x.label for x in fitting[:MAX_NAMED])
        remedy = f"Choose one with --topic, such as --topic {fitting[0].topic}"
        if len({x.topic for x in fitting}) == 1:
            remedy = "Record one publisher, or specify an arm whose joints only one of them has"
        raise InvalidInput(
            f"{file.name} has several recordings of joints that can be meant: {found}. {remedy}."
        )
    chosen = fitting[0]
    notes = []
    if topic is None and len(series) > 1:
        notes.append(f"Of {file.name}, the topic {chosen.topic} is read.")
    others = [x for x in series if x.topic == chosen.topic and x is not chosen]
    if others:
        count = sum(len(x.stamps) for x in others)
        names = list_some([y for x in others for y in x.joints], MAX_NAMED)
        notes.append(
            f"Messages of {chosen.topic} with other joints were skipped: {count} ({names})."
        )
    return chosen, notes


def _to_text(series: _Series, file: str) -> tuple[str, list[str]]:
    """Return messages as CSV text with a row per message, and notes on their times and values."""
    notes = []
    times = np.array(series.stamps, dtype=np.int64)
    if not times.any():
        times = np.array(series.received, dtype=np.int64)
        notes.append(
            f"The messages of {series.topic} in {file} have no stamps, so the times at which they "
            "were recorded are used. Speeds computed from these times are less exact."
        )
    order = np.argsort(times, kind="stable")
    late = int(np.count_nonzero(np.diff(times) < 0))
    if np.abs(order - np.arange(len(order))).max() > MAX_DISORDER:
        # The stamps jump back, because a clock was set. `read_samples` checks their times.
        order = np.arange(len(order))
    elif late:
        notes.append(
            f"Messages of {series.topic} in {file} that arrived in another order than that of "
            f"their stamps were sorted: {late}."
        )
    roles = []
    for role, rows in series.values.items():
        missing = sum(not x for x in rows)
        if missing == 0:
            roles.append(role)
        elif missing < len(rows):
            notes.append(
                f"The {role} values of {series.topic} in {file} are not used, because "
                f"{count_noun(missing, 'message')} of {len(rows)} have none."
            )
    first = int(times[order[0]])
    notes.append(
        f"Times of {file} count from the first message of {series.topic}, at "
        f"{first // NANOSECONDS}.{first % NANOSECONDS:09d} s."
    )
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["t [s]", *(f"{TITLES[x]} {y}" for x in roles for y in series.joints)])
    for i in order.tolist():
        since = int(times[i]) - first
        sign = "-" * (since < 0)
        since = abs(since)
        cells = [repr(x) for role in roles for x in series.values[role][i]]
        writer.writerow([f"{sign}{since // NANOSECONDS}.{since % NANOSECONDS:09d}", *cells])
    return text.getvalue(), notes


def _nothing_sentence(file: str, kinds: dict[str, str], topic: str | None) -> str:
    """Return the error for a bag without messages of joints, which names its topics."""
    listed = list_some([f"{x} ({y})" for x, y in kinds.items()], MAX_NAMED) or "no messages"
    wanted = "no messages of the types JointState and JointTrajectoryControllerState with joints"
    if topic is not None:
        wanted = f"{wanted} on the topic {show(topic)}"
    return f"{file} has {wanted}. It has {listed}. Record the joints, such as with `{RECORD}`."
