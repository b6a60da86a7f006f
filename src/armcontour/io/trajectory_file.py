"""Time-stamped joint trajectories from CSV files: ours, another planner's, a log."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path as FilePath

from armcontour import _checks
from armcontour._checks import FloatArray
from armcontour._files import LARGE, read_text
from armcontour._sampling import (
    LARGEST,
    LATEST,
    describe_short_step,
    find_far_time,
    find_large,
    find_short_step,
)
from armcontour.errors import InvalidInput
from armcontour.io.number_table import NUMBER, CsvTable, last_digit, read_columns, split_csv
from armcontour.io.units import parse

# What a column of each kind has, for messages.
CALLED = {"q": "joint position", "dq": "joint velocity", "ddq": "joint acceleration"}
SI = {"t": "s", "q": "rad", "dq": "rad/s", "ddq": "rad/s^2"}
# Columns that are passed over.
BESIDE = ("events",)
KINDS = {"t": "t", "time": "t", "q": "q", "joint": "q", "dq": "dq", "ddq": "ddq"}
_NAME = re.compile(
    r"(?P<kind>time|t|joint|ddq|dq|q)[ _]?(?P<joint>\d+)?"
    r"(?:\s*[\[(](?P<unit>[^\])]*)[\])]|_(?P<suffix>[A-Za-zµ°]\S*))?",
    re.IGNORECASE,
)
_BRACKETS = re.compile(r"(?P<name>.*?)\s*[\[(](?P<unit>[^\])]*)[\])]")
# A quantity of a joint that is called by its name.
_CALLED = re.compile(r"(?P<kind>ddq|dq|q)[ _](?P<name>.+)", re.IGNORECASE)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrajectoryFile:
    """A trajectory as it stands in a file, in SI units.

    Args:
        source: Name of the file.
        t: Times [s], (n,).
        q: Joint positions [rad], (n, dof).
        dq, ddq: Velocities and accelerations, if the file has them.
        resolution: Last printed digit of "t", "q", "dq", "ddq" [SI].
    """

    source: str
    t: FloatArray
    q: FloatArray
    dq: FloatArray | None
    ddq: FloatArray | None
    resolution: Mapping[str, float]

    def __post_init__(self) -> None:
        for name in ("t", "q", "dq", "ddq"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, _checks.lock_floats(getattr(self, name)))


@dataclass(frozen=True, slots=True)
class _Column:
    kind: str
    joint: int
    factor: float


def read_trajectory(file: str | FilePath, joint_names: Sequence[str] = ()) -> TrajectoryFile:
    """The trajectory in a CSV file.

    The first line names the columns: `t`, `q1` or `joint 1`, `dq1`, `ddq1`, ..., each with a unit
    in brackets (`t [ms]`, `joint 1 [deg]`) or as a suffix (`q1_deg`) if it is not SI. Commas,
    semicolons or tabs separate; lines that start with # are comments.

    Args:
        file: The file.
        joint_names: Other names of joint 1, 2, ..., alone for positions or after `q`, `dq`, `ddq`.

    Raises:
        InvalidInput: Anything else; names the file and the line.
    """
    text = read_text(file, "trajectory file", most=LARGE)
    return parse_trajectory(text, joint_names, source=FilePath(file).name)


def parse_trajectory(
    text: str, joint_names: Sequence[str] = (), *, source: str = "trajectory"
) -> TrajectoryFile:
    """The trajectory in CSV text; see `read_trajectory`.

    Raises:
        InvalidInput: As in `read_trajectory`.
    """
    table = split_csv(text, source)
    # What is switched during the motion says nothing about joints.
    kept = [i for i, name in enumerate(table.names) if name.lower() not in BESIDE]
    names = [table.names[i] for i in kept]
    columns = _columns(names, joint_names, f"{source}, line {table.header}")
    values, digits = read_columns(table, kept)
    arrays, resolution = {}, {}
    for kind in SI:
        of = sorted(
            (i for i, x in enumerate(columns) if x.kind == kind), key=lambda i: columns[i].joint
        )
        if of:
            factors = [columns[i].factor for i in of]
            arrays[kind] = values[:, of] * factors
            resolution[kind] = max(factors) * last_digit([digits[i] for i in of])
            if kind == "t":
                _refuse_times(table, kept[of[0]], arrays["t"][:, 0])
            else:
                _refuse_large(table, [kept[i] for i in of], kind, arrays[kind])
    return TrajectoryFile(
        source=source,
        t=arrays["t"][:, 0],
        q=arrays["q"],
        dq=arrays.get("dq"),
        ddq=arrays.get("ddq"),
        resolution=resolution,
    )


def _refuse_times(table: CsvTable, column: int, t: FloatArray) -> None:
    row = find_far_time(t)
    if row is not None:
        raise InvalidInput(
            f"{table.place(row)}: {table.cell(row, column)} is {t[row]:.3g} s, but times must stay "
            f"within {LATEST:g} s: give the column its unit, such as t [ms].",
            index=row,
        )
    row = find_short_step(t)
    if row is not None:
        before, after = (table.cells(i)[column] for i in (row - 1, row))
        said = describe_short_step(before, after, float(t[row] - t[row - 1]))
        raise InvalidInput(
            f"{table.place(row)}: {said} (column {table.names[column]!r}).", index=row
        )


def _refuse_large(table: CsvTable, columns: Sequence[int], kind: str, values: FloatArray) -> None:
    found = find_large(kind, values)
    if found is not None:
        row, k = found
        raise InvalidInput(
            f"{table.place(row)}: {table.cell(row, columns[k])} is {values[row, k]:.3g} "
            f"{SI[kind]}, but no {CALLED[kind]} is above {LARGEST[kind]:g} {SI[kind]}: mend the "
            "number, or give the column its unit, such as q1 [deg].",
            index=row,
            joint=k + 1,
        )


def _columns(names: Sequence[str], joint_names: Sequence[str], where: str) -> list[_Column]:
    """What each column holds.

    Raises:
        InvalidInput: A name or unit that is not known, a column twice, or one that is missing.
    """
    if all(NUMBER.fullmatch(x) for x in names):
        raise InvalidInput(
            f"{where}: the first line must name the columns, such as t,q1,q2 or "
            "t [s],joint 1 [rad],joint 2 [rad]."
        )
    columns = [_column(name, joint_names, where) for name in names]
    found = [(x.kind, x.joint) for x in columns]
    twice = next((i for i, x in enumerate(found) if x in found[:i]), None)
    if twice is not None:
        first = names[found.index(found[twice])]
        raise InvalidInput(f"{where}: the columns {first!r} and {names[twice]!r} hold the same.")
    dof = max((joint for _, joint in found), default=0)
    for kind in ("t", "q", "dq", "ddq"):
        joints = range(1) if kind == "t" else range(1, dof + 1)
        optional = kind in ("dq", "ddq") and not any(x == kind for x, _ in found)
        missing = [x for x in joints if (kind, x) not in found]
        if not joints or (missing and not optional):
            number = str(missing[0]) if joints and kind != "t" else "1" if kind != "t" else ""
            raise InvalidInput(f"{where}: the column {kind}{number} is missing.")
    return columns


def _column(name: str, joint_names: Sequence[str], where: str) -> _Column:
    bracketed = _BRACKETS.fullmatch(name)
    bare = bracketed["name"] if bracketed else name
    match = _NAME.fullmatch(name)
    called = _CALLED.fullmatch(bare)
    if bare in joint_names:
        kind, joint, unit = "q", joint_names.index(bare) + 1, bracketed and bracketed["unit"]
    elif called and called["name"] in joint_names:
        kind, joint = called["kind"].lower(), joint_names.index(called["name"]) + 1
        unit = bracketed and bracketed["unit"]
    elif match and (match["joint"] is None) == (KINDS[match["kind"].lower()] == "t"):
        kind, joint = KINDS[match["kind"].lower()], int(match["joint"] or 0)
        unit = match["unit"] if match["unit"] is not None else match["suffix"]
    else:
        raise InvalidInput(
            f"{where}: unknown column {name!r}: the columns are t, q1 or joint 1, dq1, ddq1, ..., "
            "with a unit in brackets where it is not SI."
        )
    if (kind == "t") != (joint == 0):
        raise InvalidInput(f"{where}: the column {name!r} has the joint 0: joints count from 1.")
    if unit is None:
        return _Column(kind, joint, 1.0)
    plain = unit.strip().replace("²", "^2").replace("°", "deg")
    try:
        factor = parse(f"1 {plain}", SI[kind])
    except ValueError:
        factor = 0.0
    # To pint an angle is a bare number, so that "1/s" would pass for "rad/s".
    if factor <= 0 or (kind != "t" and not re.search("rad|deg|turn|rev|rpm", plain)):
        raise InvalidInput(
            f"{where}: the unit {unit!r} of the column {name!r} is not one of {SI[kind]}."
        )
    return _Column(kind, joint, factor)
