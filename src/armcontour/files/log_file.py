"""Readers of logs with commanded and measured joint positions, and of measured tool positions."""

from __future__ import annotations

import io
import math
import re
from collections.abc import Iterable, Sequence
from functools import partial
from itertools import product
from pathlib import Path as FilePath
from typing import TYPE_CHECKING

import numpy as np

from armcontour.core.errors import InvalidInput
from armcontour.core.fields import checked
from armcontour.core.quantities import joint_units
from armcontour.core.text import list_some, show
from armcontour.files.csv_table import MAX_NAMED, CsvTable, read_table
from armcontour.files.joint_table import (
    PLAN_TIME,
    TITLES_OF_FORMATS,
    JointColumn,
    joints_of,
    read_csv_text,
    read_joint_title,
    read_samples,
)
from armcontour.files.ros_bag import is_bag, read_bag
from armcontour.files.ros_table import joint_state_titles, name_joints
from armcontour.motion.log import INTERPOLATIONS, Log, arrange_joints, cut_log

if TYPE_CHECKING:
    from armcontour.control.learning import Recording

EXAMPLE = "t,u1,q1,u2,q2 or t [s],command 1 [deg],measured 1 [deg]"
_INTERPOLATION = re.compile(r"#\s*interpolation\s*[:=]\s*(?P<what>.*\S)\s*", re.IGNORECASE)
ROLES = ("command", "measured")


@checked
def read_log(
    file: str | FilePath,
    *,
    start: float = -math.inf,
    end: float = math.inf,
    columns: str | None = None,
    topic: str | None = None,
) -> Log:
    """Read a log from a CSV file, or from a bag of ROS 2.

    The first line of CSV names the columns: `t`, and for each joint a command, `u1`, `command 1` or
    `command shoulder`, and a measured position, `q1`, `measured 1` or `measured shoulder`. The
    column names of UR's RTDE client, ROS 2 in PlotJuggler, KUKA's RSI, ABB's EGM and libfranka are
    also read; `columns` names others. Units are SI unless specified in brackets (`t [ms]`,
    `command 1 [deg]`, `command rail [mm]`). Other columns, and joints with only a command or only a
    measured position, are ignored. Measured velocities (`dq1`, `velocity 1`, `measured velocity 1
    [rad/s]`) show wrong times, see `identify`. Separators are commas, semicolons, tabs or blanks.
    Lines that start with # are comments; the comment `# interpolation: step` specifies the
    interpolation between set-points. The column `plan time` of logs of `play` is the time of the
    plan.

    A bag (.mcap, .db3, or its folder) needs the extra `ros` and the state of a joint trajectory
    controller. Times are the stamps of its messages, from the first one.

    >>> log = ac.read_log("log.csv")
    >>> log.measured.shape == (len(log.t), 1)
    True

    Args:
        file: The file.
        start: First time to use [s].
        end: Last time to use [s].
        columns: Names of all columns of a CSV file, separated by commas, for a file without titles;
            `-` ignores a column. Or new names of some columns: `q1 [deg]=axis_1`, `q# [deg]=axis_#`
            for every number, `-=tool_*` for any text.
        topic: Topic of a bag, if several have joints.

    Raises:
        InvalidInput: The file has another form, or `Log` rejects its samples; the message names
            file and line.
    """
    location = FilePath(file)
    return _read_log(location, (), (start, end), columns, topic, commanded=True)[0]


def log_text(log: Log) -> str:
    """Return the CSV text of a log with all digits and its notes, which `read_log` can read."""
    text = io.StringIO()
    comments = [] if log.interpolation is None else [f"interpolation: {log.interpolation}"]
    columns = [log.t, log.command, log.measured]
    head = log_head([*comments, *log.notes], log.prismatic)
    if log.velocity is not None:
        columns.append(log.velocity)
        units = joint_units("rad/s", log.prismatic)
        head += "".join(f",measured velocity {j} [{x}]" for j, x in enumerate(units, start=1))
    if log.plan_time is not None:
        columns.append(log.plan_time)
        head = f"{head},plan time [s]"
    np.savetxt(text, np.column_stack(columns), delimiter=",", fmt="%.17g", header=head, comments="")
    return text.getvalue()


def log_head(comments: Iterable[str], prismatic: Sequence[bool]) -> str:
    """Write the comments and titles of a log: times [s], commands and measured positions.

    Args:
        comments: The comments, without #.
        prismatic: For each joint, whether it slides.
    """
    units = joint_units("rad", prismatic)
    titles = ["t [s]"]
    for role in ROLES:
        titles += [f"{role} {j} [{unit}]" for j, unit in enumerate(units, start=1)]
    return "".join(f"# {x}\n" for x in comments) + ",".join(titles)


def read_run_log(
    file: str | FilePath,
    joint_names: Sequence[str],
    *,
    window: tuple[float, float] = (-math.inf, math.inf),
    columns: str | None = None,
    topic: str | None = None,
    commanded: bool = False,
) -> Log | Recording:
    """Read the log of a robot run for learning; without commands, it is a `Recording`.

    The file has the form of `read_log`, or has measured positions only. Joints with the names of
    the arm, also with another prefix or suffix, are sorted in the order of the arm. The order of
    other joints does not change.

    Args:
        file: The file.
        joint_names: Names of the arm's joints.
        window: First and last time to use [s].
        columns: As in `read_log`.
        topic: As in `read_log`.
        commanded: Whether a log without commands is refused.

    Raises:
        InvalidInput: As in `read_log`, or the log has other joints.
    """
    from armcontour.control.learning import Recording

    log, has_commands = _read_log(
        FilePath(file), joint_names, window, columns, topic, commanded=commanded
    )
    log = arrange_joints(log, joint_names)
    if has_commands:
        return log
    return Recording(
        t=log.t,
        q=log.measured,
        velocity=log.velocity,
        source=log.source,
        notes=log.notes,
        findings=log.findings,
    )


def _read_log(
    file: FilePath,
    joint_names: Sequence[str],
    window: tuple[float, float],
    columns: str | None,
    topic: str | None,
    *,
    commanded: bool,
) -> tuple[Log, bool]:
    """Log of a file, and True if it has commands; else measured positions are used as commands.

    A file without commands is rejected if `commanded`.
    """
    if is_bag(file, topic):
        table, naming = read_bag(
            file, joint_names, topic=topic, columns=columns, commanded=commanded
        )
    else:
        table = read_table(
            read_csv_text(file, "log"),
            file.name,
            partial(read_joint_title, joint_names=joint_names),
            example=EXAMPLE,
            columns=columns,
            option="--columns",
            untitled=joint_state_titles,
            names=joint_names,
        )
        table, naming = name_joints(table, joint_names)
    joints = {role: joints_of(table, "q", role) for role in ROLES}
    roles: tuple[str, ...] = ROLES
    if not commanded and joints["measured"] and not joints["command"]:
        roles = ROLES[1:]
        names = joints["measured"]
        notes = list[str]()
    else:
        names, notes = _pair_joints(table, joints)
    keys = [JointColumn("q", role, name) for role, name in product(roles, names)]
    velocities = [JointColumn("dq", "measured", name) for name in names]
    if not all(x in table.columns for x in velocities):
        velocities = []
    has_plan_time = PLAN_TIME in table.columns
    samples = read_samples(table, [*keys, *velocities, *[PLAN_TIME] * has_plan_time], *window)
    columns_of_roles = np.hsplit(samples.values[:, : len(keys)], len(roles))
    log = cut_log(
        samples.t,
        columns_of_roles[0],
        columns_of_roles[-1],
        window,
        joint_names=tuple(f"joint {x}" if x.isdigit() else x for x in names),
        prismatic=tuple(_is_prismatic(table, x, roles) for x in names),
        interpolation=_find_interpolation(table),
        source=table.source,
        notes=(*naming, *notes, *samples.notes),
        velocity=samples.values[:, len(keys) : len(keys) + len(names)] if velocities else None,
        findings=samples.findings,
        plan_time=samples.values[:, -1] if has_plan_time else None,
    )
    return log, len(roles) > 1


def _is_prismatic(table: CsvTable[JointColumn], joint: str, roles: Sequence[str]) -> bool:
    """Return whether the columns of a joint have a unit of length; all must agree."""
    columns = [table.columns[JointColumn("q", x, joint)] for x in roles]
    slides = any(x.linear for x in columns)
    angle = next((x for x in columns if x.unit is not None and not x.linear), None)
    if slides and angle is not None:
        raise InvalidInput(
            f"{table.heading}: the column {show(angle.title)} has the unit {show(angle.unit)}, "
            "but another column of this joint has a unit of length. Correct one of them."
        )
    return slides


def _find_interpolation(table: CsvTable[JointColumn]) -> str | None:
    """Return the interpolation that a comment specifies; None if no comment specifies it."""
    found = None
    for comment in table.comments:
        match = _INTERPOLATION.fullmatch(comment)
        if match is None:
            continue
        name = match["what"].lower()
        if name not in INTERPOLATIONS or found not in (None, name):
            raise InvalidInput(
                f"{table.source}: the comment {show(comment)} must specify one interpolation, "
                f"{' or '.join(INTERPOLATIONS)}: linear if the controller moves evenly between "
                "set-points, step if it holds each. Correct or remove the comment."
            )
        found = name
    return found


def _pair_joints(
    table: CsvTable[JointColumn], joints: dict[str, list[str]]
) -> tuple[list[str], list[str]]:
    """Return the joints with a command and a measured position, and notes on the others."""
    pairs = [x for x in joints["measured"] if x in joints["command"]]
    if not any(joints.values()):
        raise InvalidInput(
            f"{table.heading}: no column is a command or a measured position. Name the columns, "
            f"such as {EXAMPLE} (or rename them with {table.suggest('u1', 'q1')}). The known "
            f"formats are {', '.join(TITLES_OF_FORMATS)}."
        )
    single = [key for key in table.columns if key.kind == "q" and key.joint not in pairs]
    if not pairs:
        key = single[0]
        other, name = ("measured", "q") if key.role == "command" else ("command", "u")
        renaming = table.suggest(name + key.joint)
        if not key.joint.isdigit():
            name = f"{other} "
            renaming = f"{table.option} '{name}{key.joint}=NAME'"
        raise InvalidInput(
            f"{table.heading}: there is no {other} column for the same joint as the column "
            f"{show(table.columns[key].title)}. Name a column {name}{key.joint} (or rename it with "
            f"{renaming})."
        )
    notes = []
    for role, other in (ROLES, ROLES[::-1]):
        titles = [show(table.columns[x].title) for x in single if x.role == role]
        if titles:
            notes.append(
                f"{list_some(titles, MAX_NAMED)} of {table.source} "
                f"{'was' if len(titles) == 1 else 'were'} skipped, because there is no {other} "
                "column for the same joint."
            )
    return pairs, notes
