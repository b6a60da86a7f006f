"""Logs of what joints were told and what they did, from CSV files."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path as FilePath

import numpy as np

from armcontour._files import LARGE, read_text
from armcontour.errors import InvalidInput
from armcontour.identification import INTERPOLATIONS, Log, cut
from armcontour.io.number_table import read_columns, split_csv
from armcontour.io.units import parse

COMMAND = ("command", "commanded", "cmd", "u", "setpoint", "target", "reference", "ref", "desired")
MEASURED = ("measured", "meas", "actual", "feedback", "encoder", "q")
TIME = ("t", "time", "timestamp")
# Words that are neither a name nor a role.
PLAIN = ("joint", "axis", "j", "position", "pos", "q")
# Of these a log has columns too, which are not needed.
RATES = (
    "dq",
    "ddq",
    "velocity",
    "vel",
    "speed",
    "acceleration",
    "acc",
    "torque",
    "effort",
    "current",
)
UNITS = ("rad", "deg", "mrad", "degree", "degrees", "radian", "radians")
TIMES = ("s", "ms", "us", "sec", "seconds")
_BRACKETS = re.compile(r"(?P<name>.*?)\s*[\[(](?P<unit>[^\])]*)[\])]")
_WORDS = re.compile(r"[^\W\d_]+|\d+")
_SAID = re.compile(r"#\s*interpolation\s*[:=]\s*(?P<what>\w+)\s*", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class _Column:
    role: str
    joint: str
    factor: float


def read_log(
    file: str | FilePath,
    *,
    start: float = -math.inf,
    end: float = math.inf,
    unwrap: bool = False,
) -> Log:
    """The log in a CSV file.

    The first line names the columns: `t`, and for every joint a command such as `u1`, `command 1`,
    `q1_cmd`, `shoulder command`, and a measured position such as `q1`, `measured 1`, `shoulder
    measured`. Units are SI unless in brackets or a suffix: `t [ms]`, `command 1 [deg]`, `q1_deg`.
    Columns of anything else are left out. Commas, semicolons or tabs separate; lines that start
    with # are comments, of which `# interpolation: step` says what happens between set-points.

    Args:
        file: The file.
        start: First time to use [s].
        end: Last time to use [s].
        unwrap: Undo jumps of whole turns.

    Raises:
        InvalidInput: A file of another form; names it and the line. As `Log`.
    """
    text = read_text(file, "log", most=LARGE)
    return parse_log(text, source=FilePath(file).name, start=start, end=end, unwrap=unwrap)


def parse_log(
    text: str,
    *,
    source: str = "log",
    start: float = -math.inf,
    end: float = math.inf,
    unwrap: bool = False,
) -> Log:
    """The log in CSV text; see `read_log`.

    Raises:
        InvalidInput: As in `read_log`.
    """
    table = split_csv(text, source)
    where = f"{source}, line {table.header}"
    columns = [_column(name, where) for name in table.names]
    joints = _paired(columns, table.names, where)
    keys = [("t", ""), *(("command", x) for x in joints), *(("measured", x) for x in joints)]
    found = {(x.role, x.joint): i for i, x in enumerate(columns) if x is not None}
    used = [found[key] for key in keys]
    factors = [x.factor for x in (columns[i] for i in used) if x is not None]
    values = read_columns(table, used)[0] * np.array(factors)
    dof = len(joints)
    return cut(
        values[:, 0],
        values[:, 1 : dof + 1],
        values[:, dof + 1 :],
        start,
        end,
        [f"joint {x}" if x.isdigit() else x for x in joints],
        interpolation=_said(text.splitlines()),
        source=source,
        unwrap=unwrap,
    )


def _said(lines: Sequence[str]) -> str | None:
    """The interpolation that a comment names."""
    for line in lines:
        match = _SAID.fullmatch(line.strip())
        if match and match["what"].lower() in INTERPOLATIONS:
            return str(match["what"].lower())
    return None


def _column(name: str, where: str) -> _Column | None:
    """What a column holds; None if it is nothing that is needed.

    Raises:
        InvalidInput: An unknown unit of a column that is.
    """
    bracketed = _BRACKETS.fullmatch(name)
    bare, unit = (bracketed["name"], bracketed["unit"]) if bracketed else (name, None)
    words = _WORDS.findall(bare)
    low = [x.lower() for x in words]
    if unit is None and len(low) > 1 and low[-1] in (*UNITS, *TIMES):
        unit, words, low = low[-1], words[:-1], low[:-1]
    if any(x in RATES for x in low):
        return None
    if low and low[0] in TIME and len(low) == 1:
        return _Column("t", "", _factor(unit, "s", name, where))
    for role, known in (("command", COMMAND), ("measured", MEASURED)):
        at = next((i for i, x in enumerate(low) if x in known), None)
        if at is not None:
            rest = [x for i, x in enumerate(words) if i != at]
            named = [x for x in rest if x.lower() not in PLAIN]
            joint = named[0].lstrip("0") or "0" if len(named) == 1 and named[0].isdigit() else ""
            return _Column(role, joint or "_".join(rest), _factor(unit, "rad", name, where))
    if len(low) == 2 and low[0] in PLAIN and low[1].isdigit():
        return _Column("measured", low[1].lstrip("0") or "0", _factor(unit, "rad", name, where))
    return None


def _factor(unit: str | None, si: str, name: str, where: str) -> float:
    if unit is None:
        return 1.0
    plain = unit.strip().replace("°", "deg")
    try:
        factor = parse(f"1 {plain}", si)
    except ValueError:
        factor = 0.0
    # To a library of units an angle is a bare number.
    if factor <= 0 or (si == "rad" and not re.search("rad|deg|turn|rev", plain)):
        raise InvalidInput(f"{where}: the unit {unit!r} of the column {name!r} is not one of {si}.")
    return factor


def _paired(columns: Sequence[_Column | None], names: Sequence[str], where: str) -> list[str]:
    """The joints, each with a command and a measured position.

    Raises:
        InvalidInput: A column is missing, or there twice.
    """
    found: dict[tuple[str, str], str] = {}
    for column, name in zip(columns, names, strict=True):
        if column is None:
            continue
        key = (column.role, column.joint)
        if key in found:
            raise InvalidInput(f"{where}: the columns {found[key]!r} and {name!r} hold the same.")
        found[key] = name
    if ("t", "") not in found:
        raise InvalidInput(f"{where}: the column t is missing: the times of the samples.")
    joints = list(dict.fromkeys(joint for role, joint in found if role != "t"))
    if not joints:
        raise InvalidInput(
            f"{where}: there is no command and no measured position: name the columns such as "
            "t,u1,q1,u2,q2 or t [s],command 1 [deg],measured 1 [deg]."
        )
    for joint in joints:
        for role, other in (("command", "measured"), ("measured", "command")):
            if (role, joint) not in found:
                raise InvalidInput(
                    f"{where}: the column {found[(other, joint)]!r} has no {role} column beside "
                    f"it: name one such as {'u' if role == 'command' else 'q'}"
                    f"{joint if joint.isdigit() else '_' + joint}."
                )
    numbers = all(x.isdigit() for x in joints)
    return sorted(joints, key=int) if numbers else joints
