"""Read motion over time from tables: the joints of an arm, or the point of its tool."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path as FilePath

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import Checked
from armcontour.core.file_access import LARGE, read_text
from armcontour.core.sampling import LARGEST, check_distance, check_samples, describe_bursts
from armcontour.core.text import count_noun, show
from armcontour.files.csv_table import CsvTable, Digits, last_digit
from armcontour.files.joint_titles import FRACTION, TIME, Key
from armcontour.motion import LapLaw, Trajectory

# Quantities of the columns, for messages.
QUANTITIES = {"q": "joint position", "dq": "joint velocity", "ddq": "joint acceleration"}
# Joint positions without a unit [rad] above this are asked about: they may be degrees. No arm of
# the library turns by more than two turns.
WIDEST = 4 * math.pi
# Joints slower than this [rad/s] in steps of a second or more are asked about: in ms the same
# numbers are usual speeds.
SLOWEST = 0.01
# Fewer samples may well be a second apart.
FEW = 10


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrajectoryFile(Checked):
    """The joint motion of a file, in SI units.

    Args:
        source: Name of the file.
        t: Times [s], (n,).
        q: Joint positions [rad], (n, dof).
        dq, ddq: Joint velocities [rad/s] and accelerations [rad/s²], (n, dof); None without them.
        command: Set-points [rad], (n, dof); None without them.
        resolution: Value of the last printed digit of "t", "q", "dq", "ddq" [SI].
        joints: Names of the joints, as the file has them.
        left_out: Titles of columns that are not used.
        notes: What was recognised in the file, or left out of it.
    """

    source: str
    t: FloatArray
    q: FloatArray
    dq: FloatArray | None = None
    ddq: FloatArray | None = None
    command: FloatArray | None = None
    resolution: Mapping[str, float] = field(default_factory=dict)
    joints: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def straight(self) -> Trajectory:
        """The motion of joints that move evenly from sample to sample, from time 0 on."""
        rates = np.diff(self.q, axis=0) / np.diff(self.t)[:, None]
        law = LapLaw(breaks=self.t - self.t[0], q=self.q, dq=rates, ddq=np.zeros_like(rates))
        return Trajectory(laws=(law,), method="samples")


@dataclass(frozen=True, slots=True, eq=False)
class TableSamples:
    """TableSamples of some columns, in SI units.

    Args:
        t: Times [s], (n,).
        values: Values, (n, columns).
        digit: Value of the last printed digit of the times [s].
        digits: Printed digits per column.
        notes: What was recognised or left out.
    """

    t: FloatArray
    values: FloatArray
    digit: float
    digits: Sequence[Digits]
    notes: tuple[str, ...]


def read_csv_text(file: str | FilePath, what: str, topic: str | None = None) -> str:
    """The text of a file of some kind, which has no topics.

    Raises:
        InvalidInput: There is no such file, or a topic is given.
    """
    if topic is not None:
        name = FilePath(file).name
        raise InvalidInput(f"{name} is CSV, which has no topics: leave --topic out.")
    return read_text(file, what, maximum=LARGE, latin=True)


def joints_of(table: CsvTable[Key], kind: str, role: str) -> list[str]:
    """Joints with columns of a kind and role: in the order of their numbers, or of the file.

    Joints with names are left out where others have numbers.
    """
    every = [x.joint for x in table.columns if (x.kind, x.role) == (kind, role)]
    numbers = sorted((x for x in every if x.isdigit()), key=lambda x: (len(x), x))
    return numbers or every


def read_samples(
    table: CsvTable[Key], keys: Sequence[Key], start: float = -math.inf, end: float = math.inf
) -> TableSamples:
    """Read the times and some columns.

    Rows that repeat the one before are left out, and those with cells of other columns only.
    Rounded times that agree with even steps are replaced by these.

    Args:
        table: The table.
        keys: The columns, at least one.
        start: First time that is needed [s].
        end: Last time that is needed [s].

    Raises:
        InvalidInput: There is no time, a cell is no number, a column without a unit looks as if
            it had another one than SI, or needed times do not increase or values are too large.
    """
    times = [x for x in (TIME, FRACTION) if x in table.columns]
    if not times:
        table.need(TIME)
    values, digits = table.read([*times, *keys])
    rows = _filled_rows(table, values, [*times, *keys], len(times))
    values, notes = values[rows], list[str]()
    if len(rows) < len(table.lines):
        left_out = count_noun(len(table.lines) - len(rows), "row")
        notes.append(f"{left_out} of {table.source} without positions: left out.")
    clock, t, part = times[0], values[:, 0], values[:, len(times) - 1]
    if len(times) == 2 and ((part >= 0) & (part < 1)).all():
        # Nanoseconds since 1970 have more digits than a float: times begin in second 0.
        clock, t = FRACTION, t - t[0] + part
    values, digit = values[:, len(times) :], digits[times.index(clock)]
    named = {x: [i for i, y in enumerate(keys) if y.kind == x] for x in QUANTITIES}

    def place(name: str, i: int, j: int) -> str:
        row, key = int(rows[i]), keys[named[name][j]] if name in named else times[0]
        return f"{table.place(row, key)}: {show(table.cell(row, key))}"

    check_distance(t, place, lambda new: table.rename(new, table.columns[clock].title))
    _ask_for_angles(table, keys, values)
    _ask_for_times(table, clock, t, values[:, [x.kind == "q" for x in keys]])
    last = last_digit([digit]) * table.columns[clock].factor
    t, some, more = tidy_times(t, values, last, table.source)
    values, rows = values[some], rows[some]
    used = (t >= start) & (t <= end)
    rows = rows[used]
    check_samples(t[used], {x: values[used][:, of] for x, of in named.items() if of}, place)
    if any("joint_states" in table.columns[x].title and x.joint.isdigit() for x in keys):
        more += (
            "Joints of /joint_states are taken in the order of their numbers. Compare with the "
            "names in its messages, and rename columns with --columns where the order differs.",
        )
    return TableSamples(t, values, last, digits[len(times) :], (*notes, *more))


def _filled_rows(
    table: CsvTable[Key], values: FloatArray, keys: Sequence[Key], first: int
) -> IntArray:
    """Rows without those that have cells of other columns only, as rows of other topics.

    Raises:
        InvalidInput: Another cell is empty, or all rows are left out.
    """
    known = {table.columns[x].index for x in keys}
    spare = [
        i
        for i in np.flatnonzero(np.isnan(values[:, first:]).all(axis=1)).tolist()
        if any(x for k, x in enumerate(table.cells(i)) if k not in known)
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
    """Times without repeated rows and without rounding, the rows that they belong to, and notes.

    Args:
        t: Times [s], (n,).
        values: Values at these times, (n, columns).
        digit: Value of the last digit of the times [s].
        source: Name of the file.
    """
    again = np.zeros(len(t), dtype=bool)
    again[1:] = (np.diff(t) == 0) & (np.diff(values, axis=0) == 0).all(axis=1)
    # A clock that stands still is refused later.
    again &= not again[1:].all()
    rows, notes = np.flatnonzero(~again), []
    if again.any():
        count = int(again.sum())
        notes.append(
            f"{count_noun(count, 'row')} of {source} {'repeats' if count == 1 else 'repeat'} the "
            "one before: left out."
        )
        t = t[rows]
    steps = np.diff(t)
    if len(t) > 2 and (steps == 0).any() and (steps >= 0).all():
        step = _even_step(t, digit)
        if step is not None:
            t = t[0] + step * np.arange(len(t))
            notes.append(
                f"The times of {source} are rounded to {digit:g} s: they are replaced by even "
                f"steps of {step:g} s, with which they agree."
            )
    elif (steps > 0).all() and (bursts := describe_bursts(t, source)):
        notes.append(bursts)
    return t, rows, tuple(notes)


def _even_step(t: FloatArray, digit: float) -> float | None:
    """The step with the fewest digits whose rounded multiples are the times; None without."""
    index = np.arange(len(t))
    step = float(np.polyfit(index, t - t[0], 1)[0])
    for count in range(1, 10):
        short = float(f"{step:.{count}g}")
        if np.ptp(t - t[0] - short * index) <= 1.001 * digit:
            return short
    return None


def _ask_for_angles(table: CsvTable[Key], keys: Sequence[Key], values: FloatArray) -> None:
    """Ask for the unit of positions without one that are many turns."""
    bare = [k for k, x in enumerate(keys) if x.kind == "q" and table.columns[x].unit is None]
    for k in bare:
        low, high = values[:, k].min(), values[:, k].max()
        if not WIDEST < max(-low, high) <= LARGEST["q"]:
            continue
        every = dict.fromkeys(title_pattern(table.columns[keys[i]].title) for i in bare)
        raise InvalidInput(
            f"{table.heading}: the column {show(table.columns[keys[k]].title)} has no unit, and "
            f"its values from {low:.4g} to {high:.4g} would be up to "
            f"{max(-low, high) / (2 * math.pi):.3g} turns: name the unit, such as --columns "
            f"'{','.join(f'{x} [deg]={x}' for x in every)}' for degrees ([rad] for radians)."
        )


def _ask_for_times(table: CsvTable[Key], clock: Key, t: FloatArray, q: FloatArray) -> None:
    """Ask for the unit of times without one at which joints would hardly move."""
    steps, column = np.diff(t), table.columns[clock]
    usable = steps > 0
    if column.unit is not None or not usable.any() or not q.shape[1]:
        return
    if np.median(steps[usable]) < (1 if len(t) >= FEW else 2):
        return
    speed = float((np.abs(np.diff(q, axis=0)[usable]) / steps[usable][:, None]).max())
    if 0 < speed < SLOWEST:
        unit = next((x for x, y in (("ms", 1e-3), ("us", 1e-6)) if speed / y > SLOWEST), "ns")
        raise InvalidInput(
            f"{table.heading}: the column {show(column.title)} has no unit, and in s its steps are "
            f"{np.median(steps[usable]):g} s and no joint is faster than {speed:.2g} rad/s: name "
            f"its unit, such as --columns 't [{unit}]={column.title}' ('t [s]={column.title}' for "
            "seconds)."
        )


def title_pattern(title: str) -> str:
    """Titles such as this one, as the option --columns takes them: a number is #."""
    return re.sub(r"\d+(?=\D*$)", "#", title)
