"""Tables of joint motion in CSV: recognition of column titles, and reading of samples."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path as FilePath
from typing import NamedTuple

import numpy as np

from armcontour.core.checks import FloatArray, Frozen, IntArray
from armcontour.core.errors import InvalidInput
from armcontour.core.file_access import LARGE, read_text, refuse_ending
from armcontour.core.sampling import LARGEST, check_samples, check_time_range, describe_bursts
from armcontour.core.text import count_noun, show
from armcontour.files.csv_table import CsvTable, Digits, Title, last_digit, title_pattern
from armcontour.motion import LapLaw, Trajectory

# Titles of the named formats: quantity, role, rank, and pattern; # is the number of the joint. The
# lowest rank is used if several columns have one quantity.
FORMATS: dict[str, tuple[tuple[str, str, int, str], ...]] = {
    # armcontour's own files, and what `play` writes
    "armcontour": (
        ("t", "", 0, r"t|time"),
        ("q", "command", 0, r"u[ _]?#|command[ _]#|command (.+)"),
        ("q", "measured", 0, r"(?:q|joint)[ _]?#|measured[ _]#|(?:q|measured) (.+)"),
        ("dq", "measured", 0, r"dq[ _]?#|dq (.+)"),
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
    for rows in FORMATS.values()
    for kind, role, rank, pattern in rows
]
# SI units by kind of column.
SI = {"t": "s", "q": "rad", "dq": "rad/s", "ddq": "rad/s^2"}


class Key(NamedTuple):
    """Quantity in a column of joint motion."""

    kind: str  # "t", "q", "dq" or "ddq"
    role: str = ""  # "command" or "measured"; empty for times
    joint: str = ""  # Number or name of the joint in the file; empty for times

    def __str__(self) -> str:
        """Title of a column with this quantity, for messages."""
        return f"{self.kind}{self.joint}"

    @property
    def si(self) -> str:
        """SI unit of the quantity."""
        return SI[self.kind]


TIME = Key("t")


def read_joint_title(name: str, joint_names: Sequence[str] = ()) -> Title[Key] | None:
    """Recognize a title of the named formats, or the name of a joint; None for other titles.

    `name` is the title without a unit in brackets.
    """
    for kind, role, rank, pattern in _PATTERNS:
        match = pattern.fullmatch(name.strip())
        if match is None:
            continue
        if kind == "t":
            return Title(TIME, "s")
        joint = next(x for x in match.groups() if x is not None)
        joint = (joint.lstrip("0") or "0") if joint.isdigit() else joint
        return Title(Key(kind, role, joint), SI[kind], rank=rank)
    if name.strip() in joint_names:
        return Title(Key("q", "measured", name.strip()), SI["q"])
    return None


# Names of the kinds of joint columns, for messages.
QUANTITIES = {"q": "joint position", "dq": "joint velocity", "ddq": "joint acceleration"}
# Joint positions [rad] above this require a unit in the title, because they may be degrees. No arm
# of the library turns by more than two turns.
MAX_ANGLE = 4 * math.pi
# Times require a unit in the title if they increase by 1 s or more per sample and all joints are
# slower than this [rad/s], because the times may be milliseconds.
MIN_SPEED = 0.01
# With fewer samples than this, steps below 2 s are accepted without a unit.
FEW_SAMPLES = 10


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrajectoryFile(Frozen):
    """Joint motion of a file, in SI units."""

    source: str  # Name of the file, for messages
    t: FloatArray  # Times [s], (n,)
    q: FloatArray  # Joint positions [rad], (n, dof)
    dq: FloatArray | None = None  # Joint velocities [rad/s], (n, dof); None if not in the file
    # Joint accelerations [rad/s²], (n, dof); None if not in the file
    ddq: FloatArray | None = None
    command: FloatArray | None = None  # Set-points [rad], (n, dof); None if not in the file
    # Value of the last printed digit of "t", "q", "dq", "ddq", in SI units
    resolution: Mapping[str, float] = field(default_factory=dict)
    joints: tuple[str, ...] = ()  # Names of the joints as in the file
    left_out: tuple[str, ...] = ()  # Titles of columns that are not used
    notes: tuple[str, ...] = ()  # Notes on recognized and ignored content of the file

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


def read_csv_text(file: str | FilePath, kind: str) -> str:
    """Read the text of a CSV file; `kind` is for messages."""
    refuse_ending(file, kind)
    return read_text(file, kind, maximum=LARGE, latin=True)


def joints_of(table: CsvTable[Key], kind: str, role: str) -> list[str]:
    """Joints with a column of a kind and role: numbers in increasing order, or else names."""
    every = [x.joint for x in table.columns if (x.kind, x.role) == (kind, role)]
    numbers = sorted((x for x in every if x.isdigit()), key=lambda x: (len(x), x))
    return numbers or every


def read_samples(
    table: CsvTable[Key], keys: Sequence[Key], start: float = -math.inf, end: float = math.inf
) -> TableSamples:
    """Read the times and the columns `keys`; `start` and `end` [s] limit the checks only."""
    # Rows that repeat the previous row, and rows that have cells only in other columns, are
    # omitted. Rounded times are replaced by equidistant times if they agree with them.
    table.require_columns(TIME)
    values, digits = table.read([TIME, *keys])
    rows = _filled_rows(table, values, [TIME, *keys])
    values, notes = values[rows], list[str]()
    if len(rows) < len(table.lines):
        count = len(table.lines) - len(rows)
        verb = "was" if count == 1 else "were"
        notes.append(
            f"{count_noun(count, 'row')} of {table.source} without positions {verb} skipped."
        )
    t, values = values[:, 0], values[:, 1:]
    named = {x: [i for i, y in enumerate(keys) if y.kind == x] for x in QUANTITIES}

    def locate(name: str, i: int, j: int) -> str:
        row, key = int(rows[i]), keys[named[name][j]] if name in named else TIME
        return f"{table.place(row, key)}: {show(table.cell(row, key))}"

    check_time_range(t, locate, lambda new: table.rename(new, table.columns[TIME].title))
    _check_angle_unit(table, keys, values)
    _check_time_unit(table, t, values[:, [x.kind == "q" for x in keys]])
    last = last_digit(digits[:1]) * table.columns[TIME].factor
    t, kept_rows, time_notes = tidy_times(t, values, last, table.source)
    values, rows = values[kept_rows], rows[kept_rows]
    used = (t >= start) & (t <= end)
    rows = rows[used]
    check_samples(
        t[used], {x: values[used][:, columns] for x, columns in named.items() if columns}, locate
    )
    return TableSamples(t, values, last, digits[1:], (*notes, *time_notes))


def _filled_rows(table: CsvTable[Key], values: FloatArray, keys: Sequence[Key]) -> IntArray:
    """Indices of the rows with values in `keys`; omits rows with values in other columns only."""
    used = {table.columns[x].index for x in keys}
    spare = [
        i
        for i in np.flatnonzero(np.isnan(values[:, 1:]).all(axis=1)).tolist()
        if any(x for k, x in enumerate(table.cells(i)) if k not in used)
    ]
    every = np.arange(len(values))
    rows = every if len(spare) == len(every) else np.delete(every, spare)
    empty = np.argwhere(np.isnan(values[rows]))
    if len(empty):
        table.raise_cell_error(int(rows[empty[0, 0]]), keys[empty[0, 1]])
    return rows


def tidy_times(
    t: FloatArray, values: FloatArray, digit: float, source: str
) -> tuple[FloatArray, IntArray, tuple[str, ...]]:
    """Times corrected for rounding, the indices of the rows that are not repeated, and notes."""
    again = np.zeros(len(t), dtype=bool)
    again[1:] = (np.diff(t) == 0) & (np.diff(values, axis=0) == 0).all(axis=1)
    # If all rows are equal, all are used; `check_samples` rejects their times later.
    again &= not again[1:].all()
    rows, notes = np.flatnonzero(~again), []
    if again.any():
        count = int(again.sum())
        notes.append(
            f"{count_noun(count, 'row')} of {source} {'was' if count == 1 else 'were'} skipped, "
            f"because {'it repeats' if count == 1 else 'they repeat'} the previous row."
        )
        t = t[rows]
    steps = np.diff(t)
    if len(t) > 2 and (steps == 0).any() and (steps >= 0).all():
        step = _find_constant_step(t, digit)
        if step is not None:
            t = t[0] + step * np.arange(len(t))
            notes.append(
                f"The times of {source} are rounded to {digit:g} s. They are replaced by times "
                f"with a constant step of {step:g} s, which agree with the rounded times."
            )
    elif (steps > 0).all() and (bursts := describe_bursts(t, source)):
        notes.append(bursts)
    return t, rows, tuple(notes)


def _find_constant_step(t: FloatArray, digit: float) -> float | None:
    """Constant step [s] with the fewest digits that agrees with rounded times, or None."""
    index = np.arange(len(t))
    step = float(np.polyfit(index, t - t[0], 1)[0])
    for count in range(1, 10):
        short = float(f"{step:.{count}g}")
        if np.ptp(t - t[0] - short * index) <= 1.001 * digit:
            return short
    return None


def _check_angle_unit(table: CsvTable[Key], keys: Sequence[Key], values: FloatArray) -> None:
    """Reject joint positions without a unit that are probably degrees."""
    bare = [k for k, x in enumerate(keys) if x.kind == "q" and table.columns[x].unit is None]
    for k in bare:
        low, high = values[:, k].min(), values[:, k].max()
        if not MAX_ANGLE < max(-low, high) <= LARGEST["q"]:
            continue
        every = dict.fromkeys(title_pattern(table.columns[keys[i]].title) for i in bare)
        raise InvalidInput(
            f"{table.heading}: the column {show(table.columns[keys[k]].title)} has no unit. Its "
            f"values from {low:.4g} to {high:.4g} would be up to "
            f"{max(-low, high) / (2 * math.pi):.3g} turns in rad. Specify the unit, such as "
            f"--columns '{','.join(f'{x} [deg]={x}' for x in every)}' for degrees ([rad] for "
            "radians)."
        )


def _check_time_unit(table: CsvTable[Key], t: FloatArray, q: FloatArray) -> None:
    """Reject times without a unit that are probably not seconds, because joints are too slow."""
    steps, column = np.diff(t), table.columns[TIME]
    usable = steps > 0
    if column.unit is not None or not usable.any() or not q.shape[1]:
        return
    if np.median(steps[usable]) < (1 if len(t) >= FEW_SAMPLES else 2):
        return
    speed = float((np.abs(np.diff(q, axis=0)[usable]) / steps[usable][:, None]).max())
    if 0 < speed < MIN_SPEED:
        unit = next((x for x, y in (("ms", 1e-3), ("us", 1e-6)) if speed / y > MIN_SPEED), "ns")
        raise InvalidInput(
            f"{table.heading}: the column {show(column.title)} has no unit. In seconds, its step "
            f"is {np.median(steps[usable]):g} s, and the fastest joint has only {speed:.2g} rad/s. "
            f"Specify the unit, such as --columns 't [{unit}]={column.title}' "
            f"('t [s]={column.title}' for seconds)."
        )
