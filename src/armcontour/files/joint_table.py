"""Tables of joint motion in CSV: recognition of column titles, and reading of samples."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path as FilePath
from typing import NamedTuple

import numpy as np

from armcontour.core.checks import FloatArray, Frozen, IntArray
from armcontour.core.file_access import MAX_RECORDED, read_text, refuse_ending
from armcontour.core.text import show
from armcontour.files.csv_table import CsvTable, Digits, Title, last_digit, title_pattern
from armcontour.motion import LapLaw, Trajectory
from armcontour.motion.log_checks import (
    check_angle_unit,
    check_samples,
    check_time_range,
    check_time_unit,
    describe_bursts,
)
from armcontour.motion.log_times import follow_clock
from armcontour.motion.time_finding import TimeFinding

# Titles of columns by the name of the format: quantity, role, rank, and pattern, in which # is the
# number of the joint. If several columns have the same quantity, role and joint, the one with the
# lowest rank is used. Times with a rank above 0 are in ns.
TITLES_OF_FORMATS: dict[str, tuple[tuple[str, str, int, str], ...]] = {
    # armcontour's own files, and what `play` writes
    "armcontour": (
        ("t", "", 0, r"t|time"),
        ("plan", "", 0, r"plan[ _]time"),
        ("dq", "command", 0, r"command velocity[ _]?#|command velocity (.+)"),
        ("dq", "measured", 0, r"(?:measured )?velocity[ _]?#|(?:measured )?velocity (.+)"),
        ("dq", "measured", 0, r"dq[ _]?#|dq (.+)"),
        ("q", "command", 0, r"u[ _]?#|command[ _]#|command (.+)"),
        ("q", "measured", 0, r"(?:q|joint)[ _]?#|measured[ _]#|(?:q|measured) (.+)"),
        ("ddq", "measured", 0, r"ddq[ _]?#|ddq (.+)"),
    ),
    "RTDE of UR": (
        ("t", "", 0, r"timestamp"),
        ("q", "command", 0, r"target_q_#"),
        ("q", "measured", 0, r"actual_q_#"),
        ("dq", "command", 0, r"target_qd_#"),
        ("dq", "measured", 0, r"actual_qd_#"),
        ("ddq", "command", 0, r"target_qdd_#"),
    ),
    # Controller state, whose older releases have desired and actual; and JointState
    "ROS 2 in PlotJuggler": (
        ("t", "", 0, r"__time"),
        ("q", "command", 0, r".*/reference/positions\[#\]"),
        ("q", "command", 1, r".*/desired/positions\[#\]"),
        ("q", "measured", 0, r".*/feedback/positions\[#\]"),
        ("q", "measured", 1, r".*/actual/positions\[#\]"),
        ("q", "measured", 2, r".*/joint_states/(.+)/position"),
        ("dq", "measured", 2, r".*/joint_states/(.+)/velocity"),
    ),
    # `rostopic echo -p` of JointState and a controller's state; times are integers
    "rostopic echo -p": (
        ("t", "", 1, r"field\.header\.stamp"),
        ("t", "", 2, r"%time"),
        ("q", "command", 0, r"field\.desired\.positions#"),
        ("q", "measured", 0, r"field\.(?:position|actual\.positions)#"),
        ("dq", "measured", 0, r"field\.(?:velocity|actual\.velocities)#"),
    ),
    # `ros2 topic echo --csv` of JointState, with the titles of `joint_state_titles`
    "ros2 topic echo --csv": (
        ("q", "measured", 0, r"position\[#\]"),
        ("dq", "measured", 0, r"velocity\[#\]"),
    ),
    "RSI of KUKA": (
        ("t", "", 0, r"IPOC"),
        ("q", "command", 0, r"ASPos[._]A#|AxisSet#"),
        ("q", "measured", 0, r"AIPos[._]A#|AxisAct#"),
    ),
    "EGM of ABB": (
        ("q", "command", 0, r"planned\.(?:joints\.)?joints\[#\]"),
        ("q", "measured", 0, r"feedBack\.(?:joints\.)?joints\[#\]"),
    ),
    "libfranka": (
        ("q", "command", 0, r"(?:state\.)?q_d\[#\]"),
        ("q", "measured", 0, r"(?:state\.)?q\[#\]"),
        ("dq", "command", 0, r"(?:state\.)?dq_d\[#\]"),
        ("dq", "measured", 0, r"(?:state\.)?dq\[#\]"),
        ("ddq", "command", 0, r"(?:state\.)?ddq_d\[#\]"),
    ),
}
_PATTERNS = [
    (kind, role, rank, re.compile(pattern.replace("#", r"(\d{1,9})"), re.IGNORECASE))
    for kind, role, rank, pattern in chain.from_iterable(TITLES_OF_FORMATS.values())
]
# SI units by kind of column.
SI = {"t": "s", "plan": "s", "q": "rad", "dq": "rad/s", "ddq": "rad/s^2"}
# Names of joint columns by their kinds, for messages.
QUANTITIES = {"q": "joint position", "dq": "joint velocity", "ddq": "joint acceleration"}


class JointColumn(NamedTuple):
    """What a column contains: quantity, role and joint."""

    kind: str  # "t", "plan" (time of the plan), "q", "dq" or "ddq"
    role: str = ""  # "command" or "measured"; empty for times
    joint: str = ""  # Number or name of the joint in the file; empty for times

    def __str__(self) -> str:
        """Return the title of a column with this quantity, for messages."""
        return f"{self.kind}{self.joint}"

    @property
    def si(self) -> str:
        """SI unit of the quantity."""
        return SI[self.kind]


TIME = JointColumn("t")
# Time of the plan, in logs of `play`
PLAN_TIME = JointColumn("plan")


def read_joint_title(name: str, joint_names: Sequence[str] = ()) -> Title[JointColumn] | None:
    """Recognize a title of the named formats, or the name of a joint; None for other titles.

    `name` is the title without a unit in brackets.
    """
    for kind, role, rank, pattern in _PATTERNS:
        match = pattern.fullmatch(name.strip())
        if match is None:
            continue
        if kind == "t":
            return Title(TIME, "s", unit="ns" if rank else None, rank=rank)
        if kind == "plan":
            return Title(PLAN_TIME, "s")
        joint = next(x for x in match.groups() if x is not None)
        joint = (joint.lstrip("0") or "0") if joint.isdigit() else joint
        return Title(JointColumn(kind, role, joint), SI[kind], rank=rank)
    if name.strip() in joint_names:
        return Title(JointColumn("q", "measured", name.strip()), SI["q"])
    return None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrajectoryFile(Frozen):
    """Joint motion of a file, in SI units."""

    source: str  # Name of the file, for messages
    t: FloatArray  # Times [s], (n,)
    q: FloatArray  # Joint positions [rad], (n, dof)
    dq: FloatArray | None = None  # Joint velocities [rad/s], (n, dof); None if not in the file
    # Joint accelerations [rad/s²], (n, dof); None if not in the file
    ddq: FloatArray | None = None
    # Value of the last printed digit of "t", "q", "dq", "ddq", in SI units
    resolution: Mapping[str, float] = field(default_factory=dict)
    joints: tuple[str, ...] = ()  # Names of the joints as in the file
    # Whether the unit of each joint's column is that of a prismatic joint; None without a unit
    prismatic: tuple[bool | None, ...] = ()
    left_out: tuple[str, ...] = ()  # Titles of columns that are not used
    notes: tuple[str, ...] = ()  # Notes on recognized and ignored content of the file
    lines: IntArray | None = None  # Line of each sample in the file, (n,); None in YAML
    # True for the points of a JointTrajectory, which have any distance; false for samples
    is_plan: bool = False
    # True for measured positions: of a bag, beside commands, or with such a title
    is_log: bool = False
    # What was wrong with the times of measured positions, and was repaired
    findings: tuple[TimeFinding, ...] = ()

    @property
    def straight(self) -> Trajectory:
        """Trajectory with linear interpolation between the samples; it starts at time 0."""
        rates = np.diff(self.q, axis=0) / np.diff(self.t)[:, None]
        law = LapLaw(breaks=self.t - self.t[0], q=self.q, dq=rates, ddq=np.zeros_like(rates))
        return Trajectory(laws=(law,), method="samples")


@dataclass(frozen=True, slots=True, eq=False)
class TableSamples:
    """Samples of selected columns, in SI units."""

    t: FloatArray  # Times [s], (n,)
    values: FloatArray  # Values in SI units, (n, columns)
    digit: float  # Value of the last printed digit of the times [s]
    digits: Sequence[Digits]  # Printed digits of each column of `values`
    notes: tuple[str, ...]  # Notes on changed times and skipped rows
    lines: IntArray  # Line of each sample in the file, (n,)
    findings: tuple[TimeFinding, ...]  # Times that jumped back and were continued


def read_csv_text(file: str | FilePath, kind: str) -> str:
    """Read the text of a CSV file; `kind` is for messages."""
    refuse_ending(file, kind)
    return read_text(file, kind, maximum=MAX_RECORDED, latin=True)


def joints_of(table: CsvTable[JointColumn], kind: str, role: str) -> list[str]:
    """Return the joints with a column of a kind and role: increasing numbers, or names."""
    joints = [x.joint for x in table.columns if (x.kind, x.role) == (kind, role)]
    numbers = sorted((x for x in joints if x.isdigit()), key=lambda x: (len(x), x))
    return numbers or joints


def read_samples(
    table: CsvTable[JointColumn],
    keys: Sequence[JointColumn],
    start: float = -math.inf,
    end: float = math.inf,
) -> TableSamples:
    """Read times and columns of a table.

    Args:
        table: The table.
        keys: Columns to read.
        start: First time that is used [s]. Of earlier samples, only the numbers are checked.
        end: Last time that is used [s]. Of later samples, only the numbers are checked.

    Raises:
        InvalidInput: The table has no column of times, a cell is not a number, or a time or a
            sample is not valid.
    """
    # Rows that repeat the previous row, and rows that have cells only in other columns, are
    # omitted.
    table.require_columns(TIME)
    values, digits = table.read([TIME, *keys])
    rows = _filled_rows(table, values, [TIME, *keys])
    values = values[rows]
    notes = list[str]()
    if len(rows) < len(table.lines):
        count = len(table.lines) - len(rows)
        notes.append(f"Rows of {table.source} without positions were skipped: {count}.")
    t = values[:, 0]
    values = values[:, 1:]
    columns_of = {x: [i for i, y in enumerate(keys) if y.kind == x] for x in QUANTITIES}

    def locate(name: str, i: int, j: int) -> str:
        row = int(rows[i])
        key = keys[columns_of[name][j]] if name in columns_of else TIME
        return f"{table.place(row, key)}: {show(table.cell(row, key))}"

    check_time_range(t, locate, lambda new: table.rename(new, table.columns[TIME].title))
    _check_units(table, keys, t, values)
    last = last_digit(digits[:1]) * table.columns[TIME].factor
    new, time_notes = find_new_rows(t, values, table.source)
    t = t[new]
    values = values[new]
    rows = rows[new]
    lines = np.array(table.numbers)[rows]
    t, findings = _continue_times(table, keys, t, values)
    used = (t >= start) & (t <= end)
    rows = rows[used]
    check_samples(
        t[used],
        {x: values[used][:, columns] for x, columns in columns_of.items() if columns},
        locate,
    )
    return TableSamples(t, values, last, digits[1:], (*notes, *time_notes), lines, findings)


def _continue_times(
    table: CsvTable[JointColumn], keys: Sequence[JointColumn], t: FloatArray, values: FloatArray
) -> tuple[FloatArray, tuple[TimeFinding, ...]]:
    """Continue times that jump back, by the columns with measured positions and velocities.

    `values`: values of `keys`, (n, columns).
    """
    positions = [i for i, x in enumerate(keys) if (x.kind, x.role) == ("q", "measured")]
    if not positions:
        return t, ()
    rates = [JointColumn("dq", "measured", keys[i].joint) for i in positions]
    dq = None
    if all(x in keys for x in rates):
        dq = values[:, [keys.index(x) for x in rates]]
    t, finding = follow_clock(t, values[:, positions], dq, table.source)
    return t, (finding,) if finding else ()


def _filled_rows(
    table: CsvTable[JointColumn], values: FloatArray, keys: Sequence[JointColumn]
) -> IntArray:
    """Return the indices of the rows with values in the columns `keys`.

    Rows with cells only in other columns are omitted. `values`: times and values of `keys`,
    (n, 1 + columns).
    """
    used_columns = {table.columns[x].index for x in keys}
    omitted_rows = []
    for i in np.flatnonzero(np.isnan(values[:, 1:]).all(axis=1)).tolist():
        other_cells = [x for k, x in enumerate(table.cells(i)) if k not in used_columns]
        if any(other_cells):
            omitted_rows.append(i)
    all_rows = np.arange(len(values))
    # If no row would remain, all are used, so that the check below refuses the first empty cell.
    rows = all_rows if len(omitted_rows) == len(values) else np.delete(all_rows, omitted_rows)
    empty = np.argwhere(np.isnan(values[rows]))
    if len(empty):
        table.raise_cell_error(int(rows[empty[0, 0]]), keys[empty[0, 1]])
    return rows


def find_new_rows(
    t: FloatArray, values: FloatArray, source: str
) -> tuple[IntArray, tuple[str, ...]]:
    """Return the indices of rows that do not repeat the previous row, and notes on the times.

    - `t`: times [s], (n,).
    - `values`: values of the rows, (n, columns).
    - `source`: name of the file, for the notes.
    """
    is_repeated = np.zeros(len(t), dtype=bool)
    is_repeated[1:] = (np.diff(t) == 0) & (np.diff(values, axis=0) == 0).all(axis=1)
    # If all rows are equal, all are used; `check_samples` rejects their times later.
    is_repeated &= not is_repeated[1:].all()
    rows = np.flatnonzero(~is_repeated)
    notes = []
    if is_repeated.any():
        notes.append(
            f"Rows of {source} that repeat the previous row were skipped: {int(is_repeated.sum())}."
        )
    if (np.diff(t[rows]) > 0).all() and (bursts := describe_bursts(t[rows], source)):
        notes.append(bursts)
    return rows, tuple(notes)


def _check_units(
    table: CsvTable[JointColumn], keys: Sequence[JointColumn], t: FloatArray, values: FloatArray
) -> None:
    """Check the columns of times and positions whose titles have no unit."""
    positions = [k for k, x in enumerate(keys) if x.kind == "q"]
    without_unit = {k: x.title for k in positions if (x := table.columns[keys[k]]).unit is None}
    fix = ",".join(
        f"{x} [deg]={x}" for x in dict.fromkeys(map(title_pattern, without_unit.values()))
    )
    for k, title in without_unit.items():
        check_angle_unit(f"{table.heading}: the column {show(title)}", values[:, k], fix)
    column = table.columns[TIME]
    if column.unit is None:
        location = f"{table.heading}: the column {show(column.title)}"
        check_time_unit(location, column.title, t, values[:, positions])
