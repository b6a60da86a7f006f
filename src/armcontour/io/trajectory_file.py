"""Time-stamped joint trajectories from CSV files: ours, another planner's, a log."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path as FilePath

import numpy as np

from armcontour import _checks
from armcontour._checks import FloatArray
from armcontour.errors import InvalidInput
from armcontour.io.units import parse

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
_NUMBER = re.compile(
    r"[+-]?(?=\.?\d)(?P<whole>\d*)(?:\.(?P<part>\d*))?(?:[eE](?P<power>[+-]?\d+))?"
)


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
                object.__setattr__(self, name, _checks.locked(getattr(self, name)))


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
        joint_names: Other names of joint 1, 2, ..., alone for positions or behind `q`, `dq`, `ddq`.

    Raises:
        InvalidInput: Anything else; names the file and the line.
    """
    place = FilePath(file)
    try:
        text = place.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        raise InvalidInput(f"Cannot read the trajectory file {place}: {reason}.") from None
    return parse_trajectory(text, joint_names, source=place.name)


def parse_trajectory(
    text: str, joint_names: Sequence[str] = (), *, source: str = "trajectory"
) -> TrajectoryFile:
    """The trajectory in CSV text; see `read_trajectory`.

    Raises:
        InvalidInput: As in `read_trajectory`.
    """
    lines = [
        (number, line)
        for number, line in enumerate(text.splitlines(), start=1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if not lines:
        raise InvalidInput(f"{source} is empty: it must have a line of column names and samples.")
    header = lines[0][1]
    separator = next((x for x in ";\t" if x in header), ",")
    names, *rows = (
        [x.strip() for x in row] for row in csv.reader((x for _, x in lines), delimiter=separator)
    )
    # What is switched on the way says nothing about joints.
    kept = [i for i, name in enumerate(names) if name.lower() not in BESIDE]
    if len(kept) < len(names):
        rows = [[row[i] for i in kept] if len(row) == len(names) else row for row in rows]
        names = [names[i] for i in kept]
    columns = _columns(names, joint_names, f"{source}, line {lines[0][0]}")
    numbers = [number for number, _ in lines[1:]]
    values = _values(rows, names, numbers, source)
    time = next(i for i, x in enumerate(columns) if x.kind == "t")
    late = np.flatnonzero(np.diff(values[:, time]) <= 0)
    if len(late):
        row = int(late[0]) + 1
        raise InvalidInput(
            f"{source}, line {numbers[row]}: times must increase, but {rows[row][time]} does not "
            f"come after {rows[row - 1][time]}.",
            index=row,
        )
    arrays, resolution = {}, {}
    for kind in SI:
        of = sorted((i for i, x in enumerate(columns) if x.kind == kind), key=_joint_of(columns))
        if of:
            factors = [columns[i].factor for i in of]
            printed = _resolution([row[i] for row in rows for i in of])
            arrays[kind] = values[:, of] * factors
            resolution[kind] = max(factors) * printed
    return TrajectoryFile(
        source=source,
        t=arrays["t"][:, 0],
        q=arrays["q"],
        dq=arrays.get("dq"),
        ddq=arrays.get("ddq"),
        resolution=resolution,
    )


def _joint_of(columns: Sequence[_Column]) -> Callable[[int], int]:
    return lambda i: columns[i].joint


def _columns(names: Sequence[str], joint_names: Sequence[str], where: str) -> list[_Column]:
    """What each column holds.

    Raises:
        InvalidInput: A name or unit that is not known, a column twice, or one that is missing.
    """
    if all(_NUMBER.fullmatch(x) for x in names):
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


def _values(
    rows: Sequence[Sequence[str]], names: Sequence[str], numbers: Sequence[int], source: str
) -> FloatArray:
    """The samples as numbers, (n, columns).

    Raises:
        InvalidInput: A line with too few or too many values, or one that is not a finite number.
    """
    if not rows:
        raise InvalidInput(f"{source} has column names, but no samples.")
    values = np.empty((len(rows), len(names)))
    for i, (row, number) in enumerate(zip(rows, numbers, strict=True)):
        if len(row) != len(names):
            raise InvalidInput(
                f"{source}, line {number}: {len(row)} values, but {len(names)} columns.", index=i
            )
        for k, text in enumerate(row):
            try:
                value = float(text)
            except ValueError:
                value = math.nan
            if not math.isfinite(value):
                raise InvalidInput(
                    f"{source}, line {number}: {text!r} in the column {names[k]!r} is not a finite "
                    "number.",
                    index=i,
                )
            values[i, k] = value
    return values


def _resolution(texts: Sequence[str]) -> float:
    """The last digit of numbers that were all printed in one format, where it counts most.

    That a format cuts zeros off at the end does not matter: the number of digits is the largest
    that is seen, behind the point and in all.
    """
    places, digits, highest = -99, 0, -math.inf
    for text in texts:
        match = _NUMBER.fullmatch(text)
        if match is None:
            continue
        part, power = match["part"] or "", int(match["power"] or 0)
        number = (match["whole"] + part).lstrip("0")
        places = max(places, len(part) - power)
        if number.strip("0"):
            digits = max(digits, len(number))
            # Power of ten of the first digit.
            highest = max(highest, len(number) - 1 - len(part) + power)
    return float(max(10.0**-places, 10.0 ** (highest - digits + 1)) if digits else 10.0**-places)
