"""Tables of joint motion in CSV: recognition of column titles, and reading of samples."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path as FilePath
from typing import NamedTuple

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import Checked
from armcontour.core.file_access import LARGE, read_text
from armcontour.core.sampling import LARGEST, check_samples, check_time_range, describe_bursts
from armcontour.core.text import count_noun, show
from armcontour.files.csv_table import CsvTable, Digits, Title, last_digit
from armcontour.motion import LapLaw, Trajectory

# Words in titles by their meaning, in the singular. They are from PlotJuggler, ROS, controllers
# and their clients (UR's RTDE, KUKA's RSI, ABB's EGM, libfranka), in English and German.
WORDS_BY_MEANING = {
    "t": "t time timestamp stamp clock ipoc zeit zeitstempel",
    "fraction": "nanosec nsec nanosecond usec microsec microsecond",
    "command": "command commanded cmd u setpoint target reference ref desired des planned plan set "
    "nominal nom demand demanded goal soll sollwert lagesollwert sollposition as",
    "measured": "measured meas msr actual act feedback fb fbk encoder present ist istwert "
    "lageistwert istposition observed ai",
    "q": "q position pos angle joint axis axes j a theta achse gelenk winkel position lage",
    "dq": "dq qd qdot dot velocity vel velo speed omega geschwindigkeit drehzahl",
    "ddq": "ddq qdd qddot ddot acceleration acc accel beschleunigung",
    # Words of other quantities; a column with such a word is ignored.
    "other": "x y z rx ry rz qx qy qz qw current cur torque effort tau moment momentum force "
    "wrench jerk voltage temperature temp power energy pwm tcp pose tool cartesian orientation "
    "orient quaternion euler bit digital analog register mode status error err deviation ratio "
    "scaling scale fraction factor override output input counter count seq id line program load "
    "mass payload gain kp ki kd stiffness damping correction korr external accelerometer kraft "
    "strom drehmoment spannung temperatur fehler abweichung safety rist rsol rkorr",
    # Words of messages and files, which are not names of joints.
    "topic": "state controller trajectory header field robot arm data msg message value from start "
    "elapsed ros system host sample since nc plc to",
}
_MEANING = {word: what for what, words in WORDS_BY_MEANING.items() for word in words.split()}
# Units of angle at the end of a title, such as q1_deg.
ANGLES = "rad mrad urad µrad deg degree degrees radian radians turn turns rev rpm"
# Units of time at the end of a title, with their symbols.
TIMES = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), "s"),
    **dict.fromkeys(("ms", "msec", "msecs", "millis", "milliseconds"), "ms"),
    **{"us": "us", "µs": "us", "ns": "ns"},
}
_SUFFIX = re.compile(
    r"(?P<name>.+?)(?:[ _/.]+|(?<=\d)|(?<=[a-z])(?=[A-Z]))"
    rf"(?P<unit>(?i:{'|'.join((*ANGLES.split(), *TIMES))})(?:(?:/|_per_)\w+(?:\^2|²)?)?|°)"
)
_RUN = re.compile(r"[^\W\d_]+|\d+")
# Matches the words in a word such as AxisSet, in which capitals begin the next word.
_CAPITALS = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[^\W\d_A-Z]+")
_PARTS = re.compile(r"[/.:|]+")
# Titles of tool angles, which are ignored. With other words, as in wrist_roll, they are joints.
TOOL_ANGLES = ("roll", "pitch", "yaw", "a", "b", "c")
# Titles of tool positions have an axis, and optionally some of TOOL_WORDS and a unit of LENGTHS.
AXES = ("x", "y", "z")
TOOL_WORDS = ("tool", "tcp", "actual", "measured", "position", "pos")
LENGTHS = ("m", "mm", "um", "cm")
# Maximum number of digits of the number of a joint.
MAX_DIGITS = 9
# SI units by kind of column.
SI = {"t": "s", "fraction": "s", "q": "rad", "dq": "rad/s", "ddq": "rad/s^2"}


class Key(NamedTuple):
    """Quantity in a column of joint motion or tool positions."""

    # "t", "fraction" (fraction of the second in a separate column), "q", "dq" or "ddq"; "x", "y" or
    # "z" for the tool
    kind: str
    role: str = ""  # "command" or "measured"; empty for times and tool positions
    joint: str = ""  # Number or name of the joint in the file; empty for times and tool positions

    def __str__(self) -> str:
        """Title of a column with this quantity, for messages."""
        return f"{self.kind}{self.joint}"

    @property
    def si(self) -> str:
        """SI unit of the quantity."""
        return SI.get(self.kind, "m")


TIME = Key("t")
FRACTION = Key("fraction")


class _Word(NamedTuple):
    """A word of a title."""

    text: str
    meaning: str | None  # Key of WORDS_BY_MEANING; None for names and numbers
    link: str  # Text that joins the word to the previous word in a name, "_" or empty


def read_joint_title(
    name: str, has_unit: bool, joint_names: Sequence[str] = ()
) -> Title[Key] | None:
    """Recognize a title of times or joint motion; None for other titles.

    `name` is the title without a unit in brackets; `has_unit` is True if it has one.
    """
    name, joint = _split_joint(name.strip(), joint_names)
    unit = None
    match = None if has_unit else _SUFFIX.fullmatch(name)
    if not has_unit and name.lower() in TIMES and len(name) > 1:
        name, unit = "t", TIMES[name.lower()]
    elif match and match["unit"].lower() in TIMES:
        # For a column that is not a time, the suffix is part of a name, such as joint_1_s.
        title = None if joint else read_joint_title(match["name"], True)
        if title is not None and title.key == TIME:
            return title._replace(unit=TIMES[match["unit"].lower()])
    elif match:
        name, unit = match["name"], match["unit"].replace("_per_", "/").lower()
    parts = [words for part in _PARTS.split(name) if (words := list(_split_words(part)))]
    words = [word for part in parts for word in part]
    meanings = [x.meaning for x in words]
    # Parts before the last two are the name of a topic, such as /tool_controller, and are ignored.
    if any(x.meaning == "other" for part in parts[-2:] for x in part):
        return None
    if not joint and ("t" in meanings or "fraction" in meanings):
        return _time_title(words, unit)
    kind = next((x for x in ("ddq", "dq", "q") if x in meanings), "")
    roles = [x for x in meanings if x in ("command", "measured")]
    named = joint
    if not joint:
        joint = _find_joint(parts) if kind or roles else ""
    if not joint and kind == "q":
        return Title(Key("q", roles[-1] if roles else "measured", "1"), "rad", unit, 2)
    of_tool = not (kind or named) and joint.lower() in TOOL_ANGLES
    if not joint or of_tool or (joint.isdigit() and len(joint) > MAX_DIGITS):
        return None
    # Positions of motors (theta) and titles with two command words, which are copies of commands,
    # have lower priority.
    rank = (roles.count("command") > 1) + any(x.text.lower() == "theta" for x in words)
    key = Key(kind or "q", roles[-1] if roles else "measured", joint)
    return Title(key, key.si, unit, rank)


def read_tool_title(name: str, has_unit: bool) -> Title[Key] | None:
    """Recognize a title of times or tool positions, as `read_joint_title`; None for others."""
    words = [x.lower() for x in _RUN.findall(name)]
    unit = words.pop() if not has_unit and len(words) > 1 and words[-1] in LENGTHS else None
    axis = [x for x in words if x not in TOOL_WORDS]
    if len(axis) == 1 and axis[0] in AXES:
        return Title(Key(axis[0]), "m", unit)
    title = read_joint_title(name, has_unit)
    return title if title is not None and title.key in (TIME, FRACTION) else None


def _split_joint(name: str, joint_names: Sequence[str]) -> tuple[str, str]:
    """Split a title into its other words and the name of an arm joint; "" if it has none."""
    if not joint_names or _are_numbers(tuple(joint_names)):
        return name, ""
    for joint in sorted(joint_names, key=len, reverse=True):
        if match := re.search(rf"(?<![^\W_]){re.escape(joint)}(?![^\W_])", name):
            before, after = name[: match.start()], name[match.end() :]
            neighbours = f"{_PARTS.split(before)[-1]} {_PARTS.split(after)[0]}"
            names = [x.text for x in _split_words(neighbours) if x.meaning is None]
            if set(map(str.lower, names)) <= {*ANGLES.split(), *TIMES}:
                return f"{before} {after}".strip(), joint
    return name, ""


@cache
def _are_numbers(joint_names: tuple[str, ...]) -> bool:
    """True if names of joints are recognized as joint numbers 1, 2, ..., as in joint_1, joint_2."""
    titles = [read_joint_title(x, True) for x in joint_names]
    numbers = [x.key.joint if x else "" for x in titles]
    return numbers == [str(k) for k in range(1, len(numbers) + 1)]


def _time_title(words: Sequence[_Word], unit: str | None) -> Title[Key] | None:
    """Title of a column of times or of fractions of a second; None for other columns."""
    if not {x.meaning for x in words} <= {"t", "fraction", "topic", "q", "measured"}:
        return None
    for word in words:
        if word.meaning == "fraction":
            unit = "ns" if word.text.lower().startswith("n") else "us"
            return Title(FRACTION, "s", unit, len(words))
    return Title(TIME, "s", unit, len(words) - 1)


def _find_joint(parts: Sequence[Sequence[_Word]]) -> str:
    """Number or name of the joint in the last part of a title that has one; "" if none has."""
    for part in reversed(parts):
        names = [x for x in part if x.meaning is None]
        if names and all(x.text.isdigit() for x in names):
            return names[-1].text.lstrip("0") or "0"
        if names:
            named = [x for x in part if x.meaning is None or x.text.lower() in ("joint", "axis")]
            return named[0].text + "".join(x.link + x.text for x in named[1:])
    return ""


def _split_words(part: str) -> Iterator[_Word]:
    """Yield the words of one part of a title, with their meanings."""
    before, end = None, 0
    runs = list(_RUN.finditer(part))
    for match, later in zip(runs, [*runs[1:], None], strict=False):
        run, following = match[0], later[0] if later else ""
        link, end = "_" if match.start() > end else "", match.end()
        texts = [run] if run.isdigit() or _meaning(run) else _CAPITALS.findall(run)
        for text in texts:
            meaning = _meaning(text)
            if text.lower() in ("a", "j") and not following.isdigit():
                meaning = None
            if text == "d" and before in ("q", "dq", "ddq") and following.isdigit():
                meaning = "command"
            if text.lower() == "current" and _meaning(following) == "q":
                meaning = "measured"
            yield _Word(text, meaning, link)
            before, link = meaning, ""


@cache
def _meaning(word: str) -> str | None:
    """Meaning of a word (singular or plural), a key of WORDS_BY_MEANING; None if unknown."""
    low = word.lower()
    singular = f"{low[:-3]}y" if low.endswith("ies") else low.removesuffix("s")
    return _MEANING.get(low) or _MEANING.get(singular)


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
class TrajectoryFile(Checked):
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


def read_csv_text(file: str | FilePath, kind: str, topic: str | None = None) -> str:
    """Read the text of a CSV file; `kind` is for messages, and `topic` must be None."""
    if topic is not None:
        name = FilePath(file).name
        raise InvalidInput(f"{name} is a CSV file, which has no topics. Remove --topic.")
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
    times = [x for x in (TIME, FRACTION) if x in table.columns]
    if not times:
        table.require_columns(TIME)
    values, digits = table.read([*times, *keys])
    rows = _filled_rows(table, values, [*times, *keys], len(times))
    values, notes = values[rows], list[str]()
    if len(rows) < len(table.lines):
        count = len(table.lines) - len(rows)
        verb = "was" if count == 1 else "were"
        notes.append(
            f"{count_noun(count, 'row')} of {table.source} without positions {verb} skipped."
        )
    clock, t, part = times[0], values[:, 0], values[:, len(times) - 1]
    if len(times) == 2 and ((part >= 0) & (part < 1)).all():
        # A float has too few digits for nanoseconds since 1970, so the first second is subtracted.
        clock, t = FRACTION, t - t[0] + part
    values, digit = values[:, len(times) :], digits[times.index(clock)]
    named = {x: [i for i, y in enumerate(keys) if y.kind == x] for x in QUANTITIES}

    def locate(name: str, i: int, j: int) -> str:
        row, key = int(rows[i]), keys[named[name][j]] if name in named else times[0]
        return f"{table.place(row, key)}: {show(table.cell(row, key))}"

    check_time_range(t, locate, lambda new: table.rename(new, table.columns[clock].title))
    _check_angle_unit(table, keys, values)
    _check_time_unit(table, clock, t, values[:, [x.kind == "q" for x in keys]])
    last = last_digit([digit]) * table.columns[clock].factor
    t, kept_rows, time_notes = tidy_times(t, values, last, table.source)
    values, rows = values[kept_rows], rows[kept_rows]
    used = (t >= start) & (t <= end)
    rows = rows[used]
    check_samples(
        t[used], {x: values[used][:, columns] for x, columns in named.items() if columns}, locate
    )
    if any("joint_states" in table.columns[x].title and x.joint.isdigit() for x in keys):
        time_notes += (
            "Joints of /joint_states are assigned in the order of their numbers. Compare them with "
            "the names in the messages. If the order differs, rename columns (--columns).",
        )
    return TableSamples(t, values, last, digits[len(times) :], (*notes, *time_notes))


def _filled_rows(
    table: CsvTable[Key], values: FloatArray, keys: Sequence[Key], first: int
) -> IntArray:
    """Indices of the rows with values in `keys`; omits rows with values in other columns only."""
    used = {table.columns[x].index for x in keys}
    spare = [
        i
        for i in np.flatnonzero(np.isnan(values[:, first:]).all(axis=1)).tolist()
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


def _check_time_unit(table: CsvTable[Key], clock: Key, t: FloatArray, q: FloatArray) -> None:
    """Reject times without a unit that are probably not seconds, because joints are too slow."""
    steps, column = np.diff(t), table.columns[clock]
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


def title_pattern(title: str) -> str:
    """Pattern of a title for the option --columns, with # instead of its last number."""
    return re.sub(r"\d+(?=\D*$)", "#", title)
