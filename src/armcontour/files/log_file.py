"""Read logs of commanded and measured positions: CSV, and bags of ROS; positions of the tool."""

from __future__ import annotations

import io
import math
import re
from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path as FilePath
from typing import TYPE_CHECKING

import numpy as np

from armcontour.core import checks
from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import checked
from armcontour.core.text import list_some, show
from armcontour.files.csv_table import MAX_NAMED, CsvTable, read_table
from armcontour.files.joint_table import (
    AXES,
    Key,
    TrajectoryFile,
    joints_of,
    read_csv_text,
    read_joint_title,
    read_samples,
    read_tool_title,
)
from armcontour.files.ros_files import is_ros_file, read_ros_log
from armcontour.motion.log import INTERPOLATIONS, Log, cut_log
from armcontour.motion.log_checks import arrange_joints

if TYPE_CHECKING:
    from armcontour.control.learning import Recording

EXAMPLE = "t,u1,q1,u2,q2 or t [s],command 1 [deg],measured 1 [deg]"
_INTERPOLATION = re.compile(r"#\s*interpolation\s*[:=]\s*(?P<what>\w+)", re.IGNORECASE)
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
    `q1_deg`, or in a second line. Other columns, and those without a partner, are omitted.
    Separators are commas, semicolons, tabs or blanks. Lines that start with # are comments; the
    comment `# interpolation: step` gives the interpolation between set-points.

    Of a bag, of storage mcap or sqlite3, the state of a joint trajectory controller is read: its
    reference (or desired) and feedback (or actual) positions. Its times begin at zero.

    >>> log = ac.read_log("log.csv")
    >>> log.measured.shape == (len(log.t), 1)
    True

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
    location = checks.read_file_path("read_log", file)
    return _read(location, (), (start, end), unwrap, columns, topic, commanded=True)[0]


def log_text(log: Log) -> str:
    """A log as the text of a CSV file that `read_log` takes, with all digits."""
    text = io.StringIO()
    titles = [f"{kind} {j + 1} [rad]" for kind in BOTH for j in range(log.dof)]
    comment = "" if log.interpolation is None else f"# interpolation: {log.interpolation}\n"
    np.savetxt(
        text,
        np.column_stack([log.t, log.command, log.measured]),
        delimiter=",",
        fmt="%.17g",
        header=f"{comment}{','.join(['t [s]', *titles])}",
        comments="",
    )
    return text.getvalue()


def read_run_log(
    file: str | FilePath,
    joint_names: Sequence[str],
    *,
    window: tuple[float, float] = (-math.inf, math.inf),
    unwrap: bool = False,
    columns: str | None = None,
    topic: str | None = None,
    commanded: bool = False,
) -> Log | Recording:
    """Read the log of one run of a robot, from which the next run is learned."""
    # It is a log as `read_log` takes it, or CSV with measured positions alone. Joints with the
    # names of the arm, also with a prefix, get the order of the arm; others keep their order.
    from armcontour.control.learning import Recording

    log, has_commands = _read(
        FilePath(file), joint_names, window, unwrap, columns, topic, commanded=commanded
    )
    log = arrange_joints(log, joint_names)
    if has_commands:
        return log
    return Recording(t=log.t, q=log.measured, source=log.source, notes=log.notes)


def _read(
    file: FilePath,
    joint_names: Sequence[str],
    window: tuple[float, float],
    unwrap: bool,
    columns: str | None,
    topic: str | None,
    *,
    commanded: bool,
) -> tuple[Log, bool]:
    """The log in a file, and whether it has commands; else they are the measured positions."""
    # Logs without commands are refused if `commanded`.
    if is_ros_file(file):
        motion, interpolation = read_ros_log(file, topic, columns), None
    else:
        table = read_table(
            read_csv_text(file, "log", topic),
            file.name,
            partial(read_joint_title, joint_names=joint_names),
            example=EXAMPLE,
            columns=columns,
            option="--columns",
        )
        motion = _joint_motion(table, *window, positions=not commanded)
        interpolation = _find_interpolation(table.comments)
    log = cut_log(
        motion.t,
        motion.q if motion.command is None else motion.command,
        motion.q,
        window,
        joint_names=tuple(f"joint {x}" if x.isdigit() else x for x in motion.joints),
        interpolation=interpolation,
        source=motion.source,
        unwrap=unwrap,
        notes=motion.notes,
    )
    return log, motion.command is not None


def _joint_motion(
    table: CsvTable[Key], start: float, end: float, *, positions: bool
) -> TrajectoryFile:
    """Commands and measured positions; with `positions` also measured positions alone."""
    joints = {role: joints_of(table, "q", role) for role in BOTH}
    if positions and joints["measured"] and not joints["command"]:
        roles, (names, notes) = ["measured"], (joints["measured"], list[str]())
    else:
        roles, (names, notes) = list(BOTH), _pair(table, joints)
    samples = read_samples(table, [Key("q", x, y) for x in roles for y in names], start, end)
    *command, q = np.hsplit(samples.values, len(roles))
    return TrajectoryFile(
        source=table.source,
        t=samples.t,
        q=q,
        command=command[0] if command else None,
        joints=tuple(names),
        notes=(*notes, *samples.notes),
    )


def _find_interpolation(comments: Iterable[str]) -> str | None:
    """The interpolation that a comment gives; None without such a comment."""
    names = (match["what"].lower() for x in comments if (match := _INTERPOLATION.fullmatch(x)))
    return next((x for x in names if x in INTERPOLATIONS), None)


def _pair(table: CsvTable[Key], joints: dict[str, list[str]]) -> tuple[list[str], list[str]]:
    """Names of the joints with a command and a measured position, and notes on the others."""
    pairs = [x for x in joints["measured"] if x in joints["command"]]
    if not any(joints.values()):
        raise InvalidInput(
            f"{table.heading}: there is no command and no measured position: name the columns such "
            f"as {EXAMPLE}, also with --columns 'u#=COMMAND_#,q#=MEASURED_#'."
        )
    single = [key for key in table.columns if key.kind == "q" and key.joint not in pairs]
    if not pairs:
        key = single[0]
        other, letter = ("measured", "q") if key.role == "command" else ("command", "u")
        raise InvalidInput(
            f"{table.heading}: the column {show(table.columns[key].title)} has no {other} column "
            f"for the same joint: name one such as {letter}{'' if key.joint.isdigit() else '_'}"
            f"{key.joint}, also with --columns '{letter}#=NAME_#'."
        )
    notes = []
    for role, other in (BOTH, BOTH[::-1]):
        titles = [show(table.columns[x].title) for x in single if x.role == role]
        if titles:
            notes.append(
                f"{list_some(titles, MAX_NAMED)} of {table.source} "
                f"{'has' if len(titles) == 1 else 'have'} no {other} column: skipped."
            )
    return pairs, notes


def read_tool_positions(file: str | FilePath, dimension: int) -> tuple[FloatArray, FloatArray]:
    """Times [s], (n,), and tool points [m], (n, dimension), that a tracker measured, from a CSV."""
    # Columns are `t`, `x`, `y` and, in space, `z`, also as `tool x` or `tcp_x`; units are SI unless
    # the title has one. Positions are those of the tool point in the frame of the job's path.
    axes = AXES[:dimension]
    example = f"t,{','.join(axes)} or t [ms],{','.join(f'{x} [mm]' for x in axes)}"
    text = read_csv_text(file, "file of tool positions")
    table = read_table(text, FilePath(file).name, read_tool_title, example=example)
    keys = [Key(x) for x in axes]
    table.need(*keys)
    samples = read_samples(table, keys)
    return samples.t, samples.values
