"""Read logs of commanded and measured joint positions: CSV, and bags of ROS."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path as FilePath
from typing import TYPE_CHECKING

from armcontour import _checks
from armcontour._checks import FloatArray
from armcontour._files import LARGE, read_text
from armcontour._text import show
from armcontour.errors import InvalidInput
from armcontour.io.columns import Column, read_titles
from armcontour.io.number_table import CsvTable, read_columns, split_csv
from armcontour.io.ros_files import is_ros_file, read_ros_log
from armcontour.motion.log import INTERPOLATIONS, Log, cut

if TYPE_CHECKING:
    from armcontour.learning import Recording

COMMAND = ("command", "commanded", "cmd", "u", "setpoint", "target", "reference", "ref", "desired")
MEASURED = ("measured", "meas", "actual", "feedback", "encoder")
# A position without another word is the measured one.
POSITION = ("q",)
TIME = ("t", "time", "timestamp")
# Words in titles that are neither the name of a joint nor its role.
PLAIN = ("joint", "axis", "j", "position", "pos", "q")
# Quantities in other columns of a log, which are not needed.
OTHERS = (
    "dq",
    "ddq",
    "qd",
    "qdd",
    "velocity",
    "vel",
    "speed",
    "acceleration",
    "acc",
    "torque",
    "effort",
    "current",
    "moment",
    "force",
    "tau",
    "tcp",
    "pose",
    "voltage",
    "temperature",
)
UNITS = ("rad", "deg", "mrad", "degree", "degrees", "radian", "radians")
TIMES = ("s", "ms", "us", "sec", "seconds")
TIMES_OF = ("t", "")
EXAMPLE = "t,u1,q1,u2,q2 or t [s],command 1 [deg],measured 1 [deg]"
TITLES = f"{EXAMPLE}; without such a line, name them with --columns"
_WORDS = re.compile(r"[^\W\d_]+|\d+")
_INTERPOLATION = re.compile(r"#\s*interpolation\s*[:=]\s*(?P<what>\w+)\s*", re.IGNORECASE)
# "t", "command" or "measured", and the name of the joint; empty for the time.
_Key = tuple[str, str]


@_checks.checked
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
    `q1_actual`, `shoulder measured`. Units are SI unless in brackets or a suffix: `t [ms]`,
    `command 1 [deg]`, `q1_deg`. Other columns are left out. Separators are commas, semicolons or
    tabs. Lines that start with # are comments; the comment `# interpolation: step` gives the
    interpolation between set-points.

    Of a bag, of storage mcap or sqlite3, the state of a joint trajectory controller is read: its
    reference (or desired) and feedback (or actual) positions. Its times begin at zero.

    Args:
        file: The file: `.mcap`, `.db3` or a folder for ROS, else CSV.
        start: First time to use [s].
        end: Last time to use [s].
        unwrap: Whether to undo jumps of whole turns.
        columns: Names of the columns of CSV without a first line for them, separated by commas;
            `-` for a column that is not needed.
        topic: Topic of a bag; by default the only one of its type.

    Raises:
        InvalidInput: A file of another form, or samples that `Log` refuses; names file and line.
    """
    place = _checks.read_place("read_log", file)
    if is_ros_file(place):
        if columns is not None:
            raise InvalidInput(f"{place.name} is a file of ROS, which has no columns to name.")
        found = read_ros_log(place, topic)
        return cut(
            found.t, found.arrays["command"], found.arrays["q"], start, end, found.names,
            source=place.name, unwrap=unwrap,
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
    table = split_csv(text, source, columns)
    known = _read_roles(table)
    joints = _pair(known, table.heading)
    keys = [TIMES_OF, *(("command", x) for x in joints), *(("measured", x) for x in joints)]
    values = _read_values(table, known, keys)
    dof = len(joints)
    return cut(
        values[:, 0],
        values[:, 1 : dof + 1],
        values[:, dof + 1 :],
        start,
        end,
        [f"joint {x}" if x.isdigit() else x for x in joints],
        interpolation=_find_interpolation(text.splitlines()),
        source=source,
        unwrap=unwrap,
    )


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
    of the arm are put in the order of the arm; others stay in theirs.

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
        table = split_csv(text, place.name, columns)
        known = _read_roles(table)
        if TIMES_OF in known and known.keys() - {TIMES_OF} and not _has_commands(known):
            return _read_positions(table, known, joint_names, start, end, unwrap)
    found = read_log(file, start=start, end=end, unwrap=unwrap, columns=columns, topic=topic)
    found.refuse_gaps()
    order = _arm_order(found.joint_names, joint_names)
    return Log(
        t=found.t,
        command=found.command[:, order],
        measured=found.measured[:, order],
        joint_names=tuple(found.joint_names[i] for i in order),
        interpolation=found.interpolation,
        source=found.source,
    )


def _read_positions(
    table: CsvTable,
    known: Mapping[_Key, Column[_Key]],
    joint_names: Sequence[str],
    start: float,
    end: float,
    unwrap: bool,
) -> Recording:
    """Measured positions of a log without commands."""
    from armcontour.learning import Recording

    joints = _sorted([joint for role, joint in known if role == "measured"])
    values = _read_values(table, known, [TIMES_OF, *(("measured", x) for x in joints)])
    q = values[:, 1:]
    # A log refuses wrapped angles and numbers that no joint has.
    found = cut(
        values[:, 0], q, q, start, end, joints, source=table.source, unwrap=unwrap
    )  # fmt: skip
    found.refuse_gaps()
    order = _arm_order(joints, joint_names)
    return Recording(t=found.t, q=found.measured[:, order], source=table.source)


def _arm_order(own: Sequence[str], joint_names: Sequence[str]) -> list[int]:
    """Where the joints of an arm are among those of a log; all in their order if names differ."""
    if set(joint_names) <= set(own):
        return [own.index(x) for x in joint_names]
    return list(range(len(own)))


def _has_commands(known: Mapping[_Key, Column[_Key]]) -> bool:
    """Whether a log has a command of any joint."""
    return any(role == "command" for role, _ in known)


def _read_roles(table: CsvTable) -> dict[_Key, Column[_Key]]:
    """The columns that are needed, by role and joint."""
    return read_titles(
        table.names,
        where=table.heading,
        example=TITLES,
        key_of=_column_role,
        si_of=lambda key: "s" if key == TIMES_OF else "rad",
        unknown=lambda title: None,
    )


def _read_values(
    table: CsvTable, known: Mapping[_Key, Column[_Key]], keys: Sequence[_Key]
) -> FloatArray:
    """Columns in SI units, (samples, keys)."""
    used = [known[key] for key in keys]
    return read_columns(table, [x.index for x in used])[0] * [x.factor for x in used]


def _find_interpolation(lines: Sequence[str]) -> str | None:
    """The interpolation that a comment gives; None without such a comment."""
    for line in lines:
        match = _INTERPOLATION.fullmatch(line.strip())
        if match and match["what"].lower() in INTERPOLATIONS:
            return str(match["what"].lower())
    return None


def _column_role(name: str, has_unit: bool) -> tuple[_Key, str | None] | None:
    """Role and joint of a column by its name, and the unit in the name; None if not needed."""
    words = _WORDS.findall(name)
    unit = None
    if not has_unit and len(words) > 1 and words[-1].lower() in (*UNITS, *TIMES):
        unit = words.pop().lower()
    low = [x.lower() for x in words]
    if not set(OTHERS).isdisjoint(low):
        return None
    if len(low) == 1 and low[0] in TIME:
        return TIMES_OF, unit
    for role, known in (("command", COMMAND), ("measured", MEASURED), ("measured", POSITION)):
        at = [i for i, x in enumerate(low) if x in known]
        if at:
            del words[at[0]]
            return (role, _joint_of(words)), unit
    if len(low) == 2 and low[0] in PLAIN and low[1].isdigit():
        return ("measured", _joint_of(words)), unit
    return None


def _joint_of(words: Sequence[str]) -> str:
    """The number of a joint in the words of a title without its role, or else its name."""
    named = [x for x in words if x.lower() not in PLAIN]
    if len(named) == 1 and named[0].isdigit():
        return named[0].lstrip("0") or "0"
    return "_".join(words)


def _pair(columns: Mapping[_Key, Column[_Key]], where: str) -> list[str]:
    """Names of the joints, each of which must have a command and a measured position.

    Raises:
        InvalidInput: A column is missing.
    """
    if TIMES_OF not in columns:
        raise InvalidInput(f"{where}: the column t is missing: the times of the samples.")
    joints = list(dict.fromkeys(joint for role, joint in columns if role != "t"))
    if not joints:
        raise InvalidInput(
            f"{where}: there is no command and no measured position: name the columns such as "
            f"{EXAMPLE}."
        )
    for joint in joints:
        for role, other in (("command", "measured"), ("measured", "command")):
            if (role, joint) not in columns:
                raise InvalidInput(
                    f"{where}: the column {show(columns[other, joint].title)} has no {role} column "
                    f"for the same joint: name one such as {'u' if role == 'command' else 'q'}"
                    f"{joint if joint.isdigit() else '_' + joint}."
                )
    return _sorted(joints)


def _sorted(joints: list[str]) -> list[str]:
    """Joints in the order of their numbers; in their own order if they have names."""
    return sorted(joints, key=lambda x: (len(x), x)) if all(x.isdigit() for x in joints) else joints
