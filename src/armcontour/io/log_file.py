"""Read logs of commanded and measured joint positions: CSV, and bags of ROS."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

import numpy as np

from armcontour import _checks
from armcontour._describing import several
from armcontour._files import LARGE, read_text
from armcontour._text import list_some, show
from armcontour.core.fields import checked
from armcontour.errors import InvalidInput
from armcontour.io.joint_table import (
    JointColumns,
    describe_match,
    match_joints,
    read_joint_columns,
    read_joint_samples,
)
from armcontour.io.joint_titles import Key
from armcontour.io.ros_files import is_ros_file, read_ros_log
from armcontour.motion.log import INTERPOLATIONS, Log, cut

if TYPE_CHECKING:
    from armcontour.learning import Recording

EXAMPLE = "t,u1,q1,u2,q2 or t [s],command 1 [deg],measured 1 [deg]"
# Titles that one message lists.
MOST_NAMED = 8
_INTERPOLATION = re.compile(r"#\s*interpolation\s*[:=]\s*(?P<what>\w+)\s*", re.IGNORECASE)
BOTH = ("command", "measured")


@checked
def read_log(
    file: str | FilePath,
    *,
    start: float = -math.inf,
    end: float = math.inf,
    unwrap: bool = False,
    columns: str | None = None,
    topic: str | None = None,
) -> Log:
    """Read a log from a CSV file, or from a bag of ROS 2.

    The first line of CSV names the columns: `t`, and for every joint a command such as `u1`,
    `command 1`, `q1_cmd`, `shoulder command`, and a measured position such as `q1`, `measured 1`,
    `q1_actual`, `shoulder measured`; or as PlotJuggler, UR's RTDE client, KUKA's RSI, ABB's EGM and
    libfranka name them. Units are SI unless in brackets or a suffix: `t [ms]`, `command 1 [deg]`,
    `q1_deg`, or in a second line. Other columns, and those without a partner, are left out.
    Separators are commas, semicolons, tabs or blanks. Lines that start with # are comments; the
    comment `# interpolation: step` gives the interpolation between set-points.

    Of a bag, of storage mcap or sqlite3, the state of a joint trajectory controller is read: its
    reference (or desired) and feedback (or actual) positions. Its times begin at zero.

    Args:
        file: The file: `.mcap`, `.db3` or a folder for ROS, else CSV.
        start: First time to use [s].
        end: Last time to use [s].
        unwrap: Whether to undo jumps of whole turns.
        columns: Names of the columns of CSV without a first line for them, separated by commas;
            `-` for a column that is not needed. Or new names of some columns (of a bag, of joints):
            `q1 [deg]=axis_1`, `q# [deg]=axis_#` for every number, `-=tool_*` for any text.
        topic: Topic of a bag; by default the only one of its type.

    Raises:
        InvalidInput: A file of another form, or samples that `Log` refuses; names file and line.
    """
    place = _checks.read_place("read_log", file)
    if is_ros_file(place):
        found = read_ros_log(place, topic, columns)
        return cut(
            found.t, found.arrays["command"], found.arrays["q"], start, end, found.names,
            source=place.name, unwrap=unwrap, notes=found.notes,
        )  # fmt: skip
    if topic is not None:
        raise InvalidInput(f"{place.name} is CSV, which has no topics: leave --topic out.")
    text = read_text(file, "log", most=LARGE, latin=True)
    return parse_log(
        text, source=place.name, start=start, end=end, unwrap=unwrap, columns=columns
    )  # fmt: skip


def parse_log(
    text: str,
    *,
    source: str = "log",
    start: float = -math.inf,
    end: float = math.inf,
    unwrap: bool = False,
    columns: str | None = None,
) -> Log:
    """Read a log from CSV text; see `read_log`.

    Raises:
        InvalidInput: As in `read_log`.
    """
    found = read_joint_columns(text, source, columns)
    return _log(found, text, start=start, end=end, unwrap=unwrap)[0]


def _log(found: JointColumns, text: str, **window: Any) -> tuple[Log, list[str]]:
    """The log of joints with a command and a measured position, and their names in the table."""
    joints, notes = _pair(found)
    samples = read_joint_samples(found, [Key("q", role, x) for role in BOTH for x in joints])
    command, measured = np.hsplit(samples.values, 2)
    log = cut(
        samples.t,
        command,
        measured,
        joint_names=[f"joint {x}" if x.isdigit() else x for x in joints],
        interpolation=_find_interpolation(text.splitlines()),
        source=found.table.source,
        notes=(*notes, *samples.notes),
        **window,
    )
    return log, joints


def read_run_log(
    file: str | FilePath,
    joint_names: Sequence[str],
    *,
    start: float = -math.inf,
    end: float = math.inf,
    unwrap: bool = False,
    columns: str | None = None,
    topic: str | None = None,
) -> Log | Recording:
    """Read the log of one run of a robot, from which the next is learned.

    It is a log as `read_log` takes it, or CSV with measured positions alone. Joints with the names
    of the arm, also with a prefix, are put in the order of the arm; others stay in theirs.

    Args:
        file: As in `read_log`.
        joint_names: Names of the arm's joints.
        start: First time to use [s].
        end: Last time to use [s].
        unwrap: Whether to undo jumps of whole turns.
        columns: As in `read_log`.
        topic: As in `read_log`.

    Raises:
        InvalidInput: As in `read_log`.
    """
    place = FilePath(file)
    if not is_ros_file(place) and topic is None:
        text = read_text(file, "log", most=LARGE, latin=True)
        found = read_joint_columns(text, place.name, columns, joint_names)
        if found.joints("q", "measured") and not found.joints("q", "command"):
            return _read_positions(found, joint_names, start, end, unwrap)
        log, joints = _log(found, text, start=start, end=end, unwrap=unwrap)
    else:
        log = read_log(file, start=start, end=end, unwrap=unwrap, columns=columns, topic=topic)
        joints = list(log.joint_names)
    order, matched = _arm_order(joints, joint_names, log.source, log.notes)
    return Log(
        t=log.t,
        command=log.command[:, order],
        measured=log.measured[:, order],
        joint_names=tuple(log.joint_names[i] for i in order),
        interpolation=log.interpolation,
        source=log.source,
        notes=(*log.notes, *matched),
    )


def _read_positions(
    found: JointColumns, joint_names: Sequence[str], start: float, end: float, unwrap: bool
) -> Recording:
    """Measured positions of a log without commands."""
    from armcontour.learning import Recording

    source, joints = found.table.source, found.joints("q", "measured")
    samples = read_joint_samples(found, [Key("q", "measured", x) for x in joints])
    q = samples.values
    # A log refuses wrapped angles and numbers that no joint has.
    log = cut(samples.t, q, q, start, end, joints, source=source, unwrap=unwrap)
    order, matched = _arm_order(joints, joint_names, source)
    notes = (*samples.notes, *matched)
    return Recording(t=log.t, q=log.measured[:, order], source=source, notes=notes)


def _arm_order(
    own: Sequence[str], joint_names: Sequence[str], source: str, notes: Sequence[str] = ()
) -> tuple[list[int], list[str]]:
    """Where the joints of an arm are among those of a log, all in their order if names differ.

    Raises:
        InvalidInput: Names differ, and there are more or fewer joints.
    """
    order = match_joints(own, joint_names, source)
    if order is not None:
        return order, describe_match(own, joint_names, order)
    if len(own) != len(joint_names):
        raise InvalidInput(
            f"{source} has {several(len(own), 'joint')} ({list_some(own, MOST_NAMED)}), but the "
            f"arm has {len(joint_names)} ({list_some(joint_names, MOST_NAMED)}). "
            f"{' '.join(notes) or 'Name its columns with --columns.'}"
        )
    return list(range(len(own))), []


def _find_interpolation(lines: Sequence[str]) -> str | None:
    """The interpolation that a comment gives; None without such a comment."""
    for line in lines:
        match = _INTERPOLATION.fullmatch(line.strip())
        if match and match["what"].lower() in INTERPOLATIONS:
            return str(match["what"].lower())
    return None


def _pair(found: JointColumns) -> tuple[list[str], list[str]]:
    """Names of the joints with a command and a measured position, and notes on the others.

    Raises:
        InvalidInput: No joint has both.
    """
    where = found.table.heading
    joints = {role: found.joints("q", role) for role in BOTH}
    pairs = [x for x in joints["measured"] if x in joints["command"]]
    if not any(joints.values()):
        raise InvalidInput(
            f"{where}: there is no command and no measured position: name the columns such as "
            f"{EXAMPLE}, also with --columns 'u#=COMMAND_#,q#=MEASURED_#'."
        )
    single = [key for key in found.known if key.kind == "q" and key.joint not in pairs]
    if not pairs:
        key = single[0]
        other, letter = ("measured", "q") if key.role == "command" else ("command", "u")
        raise InvalidInput(
            f"{where}: the column {show(found.known[key].title)} has no {other} column for the "
            f"same joint: name one such as {letter}{'' if key.joint.isdigit() else '_'}{key.joint},"
            f" also with --columns '{letter}#=NAME_#'."
        )
    notes = []
    for role, other in (("command", "measured"), ("measured", "command")):
        titles = [show(found.known[x].title) for x in single if x.role == role]
        if titles:
            notes.append(
                f"{list_some(titles, MOST_NAMED)} of {found.table.source} "
                f"{'has' if len(titles) == 1 else 'have'} no {other} column: left out."
            )
    return pairs, notes
