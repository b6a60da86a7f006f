"""Reader of bags of ROS 2 (.mcap, .db3): joint states, and states of trajectory controllers."""

from __future__ import annotations

import importlib.util
import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path as FilePath
from typing import cast

import numpy as np

from armcontour.core import yaml_loader
from armcontour.core.checks import LONGEST_NAME
from armcontour.core.errors import FileError, InvalidInput
from armcontour.core.file_access import MAX_RECORDED, MEGABYTE, read_bytes, read_text
from armcontour.core.text import count_noun, list_some, show, to_line
from armcontour.files.bag_messages import (
    BY_FILE,
    BY_MESSAGE,
    NANOSECONDS,
    ZSTD,
    BagAnswer,
    BagQuestion,
    JointMessages,
)
from armcontour.files.csv_table import MAX_NAMED, CsvTable, make_table
from armcontour.files.joint_table import JointColumn, read_joint_title
from armcontour.files.reader_process import GIGABYTE, ReaderFailed, ReaderLimits, read_in_process
from armcontour.motion.log import match_joints

# Files of a bag. A bag of `ros2 bag record` is a folder that contains them.
BAG_ENDINGS = (".mcap", ".db3")
METADATA = "metadata.yaml"
# Largest number of files of a bag.
MOST_FILES = 1000
MISSING_LIBRARY = (
    "{task} requires rosbags, which is not installed. Install it with: pip install "
    "'armcontour[ros]'."
)
# Processor time for a small bag [s], and more per megabyte [s].
PROCESSOR_TIME = 12
TIME_PER_MEGABYTE = 2
# Memory for a small bag [bytes], more per byte of the bag, and the largest memory [bytes].
MEMORY = 3 * GIGABYTE // 2
MEMORY_PER_BYTE = 6
LARGEST_MEMORY = 8 * GIGABYTE
# The time may be this number of times the processor time.
WAITING = 10
# Titles of columns by role: those that `read_log` and `read_trajectory` recognize.
TITLES = {"command": "command", "measured": "measured", "velocity": "dq"}
JOINT_TITLE = "q elbow_joint [deg]"
# Messages arrive at most this number of messages late.
MAX_DISORDER = 10
RECORD = "ros2 bag record /joint_states /CONTROLLER/controller_state"


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
    chosen, notes = _choose(_ask_reader(file, topic).series, file, joint_names, topic)
    if commanded and not chosen.has_commands:
        raise InvalidInput(
            f"{file.name} has measured positions ({chosen.topic}), but no commands. Record the "
            f"state of the controller too, such as with `{RECORD}`."
        )
    titles, rows, row_notes = _to_rows(chosen, file.name)
    table = make_table(
        titles,
        rows,
        file.name,
        partial(read_joint_title, joint_names=joint_names),
        example=JOINT_TITLE,
        columns=columns,
        option="--columns",
        names=chosen.joints,
    )
    table = replace(
        table,
        heading=f"{file.name}, topic {chosen.topic}",
        row_noun=f"topic {chosen.topic}, message",
    )
    return table, (*notes, *row_notes)


def _storage_files(folder: FilePath) -> list[FilePath]:
    """Return the files with messages in the folder of a bag, in order; also compressed files."""
    names = [x for x in folder.iterdir() if x.name.removesuffix(ZSTD).endswith(BAG_ENDINGS)]
    return sorted(x for x in names if not x.is_dir())


def _ask_reader(file: FilePath, topic: str | None) -> BagAnswer:
    """Read all messages of joints in a bag, or those of a topic, in a limited process."""
    if importlib.util.find_spec("rosbags") is None:
        raise InvalidInput(MISSING_LIBRARY.format(task="Reading bags of ROS 2"))
    files = [file]
    compression = ""
    if file.is_dir():
        files = _storage_files(file)
        if os.path.lexists(file / METADATA):
            files, compression = _read_metadata(file)
        _refuse_links(file, files)
    # The content is read for its fingerprint, and to refuse files that may not be read.
    size = sum(len(read_bytes(x, "bag", maximum=MAX_RECORDED)) for x in files)
    question = BagQuestion(
        source=file.name,
        files=tuple(str(x.absolute()) for x in files),
        compression=compression,
        topic=topic,
    )
    time = PROCESSOR_TIME + TIME_PER_MEGABYTE * size // MEGABYTE
    limits = ReaderLimits(
        library="rosbags",
        processor_time=time,
        duration=WAITING * time,
        memory=min(MEMORY + MEMORY_PER_BYTE * size, LARGEST_MEMORY),
    )
    try:
        answer = read_in_process("armcontour.files.bag_messages", question, limits)
    except ReaderFailed as error:
        raise FileError(f"The bag {file.name} {error}. Record it again, or split it.") from None
    if isinstance(answer, str):
        raise FileError(answer)
    if not answer.series:
        raise InvalidInput(_nothing_sentence(file.name, answer.kinds, topic))
    for series in answer.series:
        _check_names(series, file.name)
    return cast(BagAnswer, answer)


def _check_names(series: JointMessages, source: str) -> None:
    """Refuse names of joints that are no names of an arm."""
    for name in series.joints:
        if not (0 < len(name) <= LONGEST_NAME and name.isprintable()):
            raise FileError(
                f"{source}: a joint of {to_line(series.topic)} has the name {show(name)}, but a "
                f"name must have 1 to {LONGEST_NAME} printable characters. Rename the joint, and "
                "record it again."
            )


def _read_metadata(folder: FilePath) -> tuple[list[FilePath], str]:
    """Return the files that the metadata of a bag name, and the compression."""
    place = folder / METADATA
    _refuse_links(folder, [place])
    data = yaml_loader.load(read_text(place, "bag"), f"{folder.name}/{METADATA}")
    about = data.get("rosbag2_bagfile_information") if isinstance(data, dict) else None
    names = about.get("relative_file_paths") if isinstance(about, dict) else None
    are_names = isinstance(names, list) and all(isinstance(x, str) for x in names)
    if not about or not names or not are_names or len(names) > MOST_FILES:
        raise FileError(
            f"{folder.name}/{METADATA} must name 1 to {MOST_FILES} files (relative_file_paths). "
            "Remove it, so that all files of the folder are read."
        )
    mode = str(about.get("compression_mode", "")).lower()
    method = about.get("compression_format") or "none"
    if mode in (BY_FILE, BY_MESSAGE) and method != "zstd":
        raise FileError(
            f"{folder.name} is compressed by {show(method)}, but only zstd is read. Convert it "
            "with `ros2 bag convert`."
        )
    return [folder / FilePath(x).name for x in names], mode


def _refuse_links(folder: FilePath, files: Sequence[FilePath]) -> None:
    """Refuse files of a bag that are not in its folder."""
    for x in files:
        if x.is_symlink() or x.parent != folder:
            raise FileError(
                f"{show(x.name)} in the bag {folder.name} is a link, but a bag must contain its "
                "files. Copy the file into the folder."
            )


def _choose(
    series: Sequence[JointMessages], file: FilePath, joint_names: Sequence[str], topic: str | None
) -> tuple[JointMessages, list[str]]:
    """Choose the messages to read, and write notes on them.

    Raises:
        InvalidInput: No messages or several ones fit.
    """
    filled = [x for x in series if any(x.filled["measured"]) or any(x.filled["command"])]
    if not filled:
        raise InvalidInput(
            f"The messages of {list_some([_label(x) for x in series], MAX_NAMED)} in {file.name} "
            "have no positions. Record a topic with joint positions."
        )
    fitting = [x for x in filled if _fits(x, joint_names)]
    # With --columns, joints can have other names than those of the arm.
    fitting = fitting or filled
    fitting = [x for x in fitting if x.has_commands] or fitting
    if len(fitting) > 1:
        found = "; ".join(_label(x) for x in fitting[:MAX_NAMED])
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


def _label(series: JointMessages) -> str:
    """Return topic and joints, for messages."""
    return f"{series.topic} ({list_some(list(series.joints), MAX_NAMED)})"


def _fits(series: JointMessages, joint_names: Sequence[str]) -> bool:
    """Return whether messages have all joints of an arm, as `match_joints` finds them."""
    try:
        return not joint_names or match_joints(series.joints, joint_names, "") is not None
    except InvalidInput:
        # Several joints match. The error is raised when the joints are arranged.
        return True


def _to_rows(series: JointMessages, file: str) -> tuple[list[str], list[str], list[str]]:
    """Return titles, rows of CSV text, one per message, and notes on their times and values."""
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
    for role, filled in series.filled.items():
        missing = filled.count(False)
        if missing == 0:
            roles.append(role)
        elif missing < len(filled):
            notes.append(
                f"The {role} values of {series.topic} in {file} are not used, because "
                f"{count_noun(missing, 'message')} of {len(filled)} have none."
            )
    first = int(times[order[0]])
    notes.append(
        f"Times of {file} count from the first message of {series.topic}, at "
        f"{first // NANOSECONDS}.{first % NANOSECONDS:09d} s."
    )
    titles = ["t [s]", *(f"{TITLES[x]} {y}" for x in roles for y in series.joints)]
    since = (times[order] - first).tolist()
    shape = (len(times), len(series.joints))
    arrays = [np.frombuffer(series.values[x]).reshape(shape)[order] for x in roles]
    values = np.hstack([np.empty((len(times), 0)), *arrays]).tolist()
    rows = []
    for t, numbers in zip(since, values, strict=True):
        # A clock that was set anew may be before the first message.
        sign = "-" * (t < 0)
        seconds = f"{sign}{abs(t) // NANOSECONDS}.{abs(t) % NANOSECONDS:09d}"
        rows.append(",".join([seconds, *map(repr, numbers)]))
    return titles, rows, notes


def _nothing_sentence(file: str, kinds: Mapping[str, str], topic: str | None) -> str:
    """Return the error for a bag without messages of joints, which names its topics."""
    listed = list_some([f"{x} ({y})" for x, y in kinds.items()], MAX_NAMED) or "no messages"
    wanted = "no messages of the types JointState and JointTrajectoryControllerState with joints"
    if topic is not None:
        wanted = f"{wanted} on the topic {show(topic)}"
    return f"{file} has {wanted}. It has {listed}. Record the joints, such as with `{RECORD}`."
