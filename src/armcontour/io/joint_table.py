"""Read joint motion from CSV, for trajectories and logs: columns, joints, and times."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from armcontour._checks import BoolArray, FloatArray, IntArray
from armcontour._describing import several
from armcontour._sampling import (
    LARGEST,
    LATEST,
    describe_bursts,
    describe_short_step,
    find_far_time,
    find_large,
    find_short_step,
)
from armcontour._text import show
from armcontour.errors import InvalidInput
from armcontour.io.columns import Column, read_titles
from armcontour.io.joint_titles import FRACTION, TIME, Key, read_joint_title
from armcontour.io.number_table import CsvTable, Digits, last_digit, read_columns, split_csv

EXAMPLE = (
    "t [s],q1 [deg],q2 [deg], or t,u1,q1,u2,q2 for commands and measured positions; without such a "
    "line, name them with --columns"
)
# Joint positions without a unit [rad] above this are asked about: they may be degrees. No arm of
# the library turns by more than two turns.
WIDEST = 4 * math.pi
# Joints slower than this [rad/s] in steps of a second or more are asked about: in ms the same
# numbers are usual speeds.
SLOWEST = 0.01
# Fewer samples may well be a second apart.
FEW = 10


@dataclass(frozen=True, slots=True, eq=False)
class JointColumns:
    """The columns of joint motion in a table.

    Args:
        table: The table.
        known: The columns by what they hold.
        unknown: Titles of the other columns.
    """

    table: CsvTable
    known: Mapping[Key, Column[Key]]
    unknown: tuple[str, ...]

    def joints(self, kind: str, role: str) -> list[str]:
        """Joints with columns of a kind and role: in the order of their numbers, or of the file.

        Joints with names are left out where others have numbers.
        """
        every = [x.joint for x in self.known if (x.kind, x.role) == (kind, role)]
        numbers = sorted((x for x in every if x.isdigit()), key=lambda x: (len(x), x))
        return numbers or every


@dataclass(frozen=True, slots=True, eq=False)
class JointSamples:
    """Samples of some columns, in SI units.

    Args:
        t: Times [s], (n,).
        values: Values, (n, columns).
        rows: Rows of the table, (n,).
        digit: Value of the last printed digit of the times [s].
        digits: Printed digits per column.
        notes: What was recognised or left out.
    """

    t: FloatArray
    values: FloatArray
    rows: IntArray
    digit: float
    digits: Sequence[Digits]
    notes: tuple[str, ...]


def read_joint_columns(
    text: str, source: str, columns: str | None, joint_names: Sequence[str] = ()
) -> JointColumns:
    """Read the titles of a table.

    Args:
        text: The CSV text.
        source: Name of the file, for messages.
        columns: Names of columns, as `split_csv` takes them.
        joint_names: Names of the arm's joints, if it is known.

    Raises:
        InvalidInput: There is no such table, or two columns have the same title.
    """
    table = split_csv(text, source, columns)
    unknown: list[str] = []
    known = read_titles(
        table.names,
        where=table.heading,
        example=EXAMPLE,
        key_of=lambda name, has_unit: read_joint_title(name, has_unit, joint_names),
        si_of=lambda key: key.si,
        unknown=unknown.append,
        option="--columns",
    )
    return JointColumns(table, known, tuple(unknown))


def read_joint_samples(columns: JointColumns, keys: Sequence[Key]) -> JointSamples:
    """Read the times and some columns.

    Rows that repeat the one before are left out. Rounded times that agree with even steps are
    replaced by these.

    Raises:
        InvalidInput: There is no time, a cell is no number, or a column without a unit looks as if
            it had another one than SI.
    """
    table, known = columns.table, columns.known
    if TIME not in known and FRACTION not in known:
        raise InvalidInput(
            f"{table.heading}: the column t is missing, the times of the samples: give it, or name "
            "it, such as --columns 't [ms]=NAME'."
        )
    times = [known[x] for x in (TIME, FRACTION) if x in known]
    used = [*times, *(known[key] for key in keys)]
    indices = [x.index for x in used]
    filled = np.arange(len(table.lines))
    try:
        numbers, digits = read_columns(table, indices)
    except InvalidInput:
        filled = _filled_rows(table, indices[len(times) :])
        if len(filled) in (0, len(table.lines)):
            raise
        table = replace(
            table,
            lines=[table.lines[i] for i in filled],
            numbers=[table.numbers[i] for i in filled],
        )
        numbers, digits = read_columns(table, indices)
    clock, t = times[0], numbers[:, 0] * times[0].factor
    if len(times) == 2:
        part = numbers[:, 1] * times[1].factor
        if ((part >= 0) & (part < 1)).all():
            # Nanoseconds since 1970 have more digits than a float: times begin in second 0.
            clock, t = times[1], t - t[0] + part
    values = numbers[:, len(times) :] * [x.factor for x in used[len(times) :]]
    _refuse_far(table, clock.index, t)
    _ask_for_angles(columns, keys, values)
    if clock.unit is None:
        _ask_for_times(table, clock, t, values[:, [x.kind == "q" for x in keys]])
    digit = last_digit([digits[times.index(clock)]]) * clock.factor
    t, rows, notes = tidy_times(t, values, digit, table.source)
    if len(filled) < len(columns.table.lines):
        count = len(columns.table.lines) - len(filled)
        notes = (f"{several(count, 'row')} of {table.source} without positions: left out.", *notes)
    if any("joint_states" in known[x].title and x.joint.isdigit() for x in keys):
        notes += (
            "Joints of /joint_states are taken in the order of their numbers. Compare with the "
            "names in its messages, and rename columns with --columns where the order differs.",
        )
    return JointSamples(t, values[rows], filled[rows], digit, digits[len(times) :], notes)


def _filled_rows(table: CsvTable, columns: Sequence[int]) -> IntArray:
    """Rows with a cell in some columns, or without any but the time, as other topics have none."""
    found = []
    for i in range(len(table.lines)):
        cells = table.cells(i)
        others = [x for k, x in enumerate(cells[1:], start=1) if k not in columns]
        if any(cells[k] for k in columns if k < len(cells)) or not any(others):
            found.append(i)
    return np.array(found, dtype=np.intp)


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
            f"{several(count, 'row')} of {source} {'repeats' if count == 1 else 'repeat'} the one "
            "before: left out."
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


def match_joints(names: Sequence[str], wanted: Sequence[str], source: str) -> list[int] | None:
    """Indices of the wanted joints by equal names, or by names with a prefix; None without.

    Raises:
        InvalidInput: Several names end with that of a joint.
    """
    if set(wanted) <= set(names):
        return [names.index(x) for x in wanted]
    found = []
    for joint in wanted:
        alike = [i for i, x in enumerate(names) if x == joint]
        alike = alike or [i for i, x in enumerate(names) if _is_prefixed(x, joint)]
        if len(alike) > 1:
            other = names[alike[1]].removesuffix(joint)
            raise InvalidInput(
                f"{source}: {' and '.join(show(names[i]) for i in alike[:2])} both may be the "
                f"joint {joint}: leave the other out with --columns '-=*{other}*'."
            )
        found += alike
    return found if len(set(found)) == len(wanted) and wanted else None


def describe_match(names: Sequence[str], wanted: Sequence[str], order: Sequence[int]) -> list[str]:
    """A note on joints that were matched by names with a prefix; none for equal names."""
    if not wanted or names[order[0]] == wanted[0]:
        return []
    return [
        f"Joints are matched by the ends of their names, such as {names[order[0]]} = {wanted[0]}."
    ]


def _is_prefixed(long: str, short: str) -> bool:
    """Whether one of two names is the other one with a prefix."""
    if len(long) < len(short):
        long, short = short, long
    return not short.isdigit() and re.fullmatch(rf".*[_\W]{re.escape(short)}", long) is not None


def _refuse_far(table: CsvTable, column: int, t: FloatArray) -> None:
    """Refuse times that are too large to be seconds."""
    row = find_far_time(t)
    if row is not None:
        name = table.names[column]
        unit = next((x for x, y in (("ms", 1e-3), ("us", 1e-6)) if abs(t[row]) * y < LATEST), "ns")
        raise InvalidInput(
            f"{table.place(row)}: {table.cell(row, column)} is {t[row]:.3g} s, but times must stay "
            f"within {LATEST:g} s: give the column its unit, such as --columns "
            f"'t [{unit}]={name}'.",
            index=row,
        )


def refuse_times(samples: JointSamples, columns: JointColumns) -> None:
    """Refuse times that do not increase, or increase by too little.

    Raises:
        InvalidInput: As said; names the line.
    """
    i = find_short_step(samples.t)
    if i is None:
        return
    table = columns.table
    index = columns.known[TIME if TIME in columns.known else FRACTION].index
    before, after = (table.cells(int(samples.rows[k]))[index] for k in (i - 1, i))
    step = float(samples.t[i] - samples.t[i - 1])
    raise InvalidInput(
        f"{table.place(int(samples.rows[i]))}: {describe_short_step(before, after, step)} (column "
        f"{table.names[index]!r}).",
        index=int(samples.rows[i]),
    )


def refuse_large(
    columns: JointColumns, samples: JointSamples, keys: Sequence[Key], quantities: Mapping[str, str]
) -> None:
    """Refuse joint values that no joint can have.

    Raises:
        InvalidInput: As said; names the line.
    """
    for kind in quantities:
        of = [i for i, x in enumerate(keys) if x.kind == kind]
        large = find_large(kind, samples.values[:, of]) if of else None
        if large is not None:
            i, k = large
            row, key, table = int(samples.rows[i]), keys[of[k]], columns.table
            raise InvalidInput(
                f"{table.place(row)}: {table.cell(row, columns.known[key].index)} is "
                f"{samples.values[i, of[k]]:.3g} {key.si}, but no {quantities[kind]} is above "
                f"{LARGEST[kind]:g} {key.si}: correct the number, or give the column its unit, "
                "such as q1 [deg].",
                index=row,
                joint=k,
            )


def _ask_for_angles(columns: JointColumns, keys: Sequence[Key], values: FloatArray) -> None:
    """Ask for the unit of positions without one that are many turns.

    Raises:
        InvalidInput: There are such positions.
    """
    bare = [k for k, x in enumerate(keys) if x.kind == "q" and columns.known[x].unit is None]
    for k in bare:
        low, high = values[:, k].min(), values[:, k].max()
        if not WIDEST < max(-low, high) <= LARGEST["q"]:
            continue
        every = dict.fromkeys(title_pattern(columns.known[keys[i]].title) for i in bare)
        raise InvalidInput(
            f"{columns.table.heading}: the column {show(columns.known[keys[k]].title)} has no "
            f"unit, and its values from {low:.4g} to {high:.4g} would be up to "
            f"{max(-low, high) / (2 * math.pi):.3g} turns: name the unit, such as --columns "
            f"'{','.join(f'{x} [deg]={x}' for x in every)}' for degrees ([rad] for radians)."
        )


def _ask_for_times(table: CsvTable, column: Column[Key], t: FloatArray, q: FloatArray) -> None:
    """Ask for the unit of times without one at which joints would hardly move.

    Raises:
        InvalidInput: There are such times.
    """
    steps = np.diff(t)
    usable: BoolArray = steps > 0
    if not usable.any() or not q.shape[1] or np.median(steps[usable]) < (1 if len(t) >= FEW else 2):
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
