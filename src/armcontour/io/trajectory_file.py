"""Read time-stamped joint trajectories of any planner or log: CSV, and files of ROS."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path as FilePath

import numpy as np

from armcontour import _checks
from armcontour._checks import FloatArray
from armcontour._describing import several
from armcontour._files import LARGE, read_text
from armcontour._sampling import (
    LARGEST,
    LATEST,
    describe_short_step,
    find_far_time,
    find_large,
    find_short_step,
)
from armcontour._text import show
from armcontour.errors import InvalidInput
from armcontour.io.columns import Column, read_titles
from armcontour.io.number_table import CsvTable, last_digit, read_columns, split_csv
from armcontour.io.ros_files import NANOSECOND, is_ros_file, read_ros_motion
from armcontour.motion import LapLaw, Trajectory

# Quantities of the columns, for messages.
QUANTITIES = {"q": "joint position", "dq": "joint velocity", "ddq": "joint acceleration"}
SI = {"t": "s", "q": "rad", "dq": "rad/s", "ddq": "rad/s^2"}
# Columns of our own that are left out without a word.
IGNORED = ("events",)
EXAMPLE = "t,q1,q2 or t [s],q 1 [rad],q 2 [rad]; without such a line, name them with --columns"
KINDS = {"t": "t", "time": "t", "q": "q", "joint": "q", "dq": "dq", "ddq": "ddq"}
_NAME = re.compile(
    r"(?P<kind>time|t|joint|ddq|dq|q)[ _]?(?P<joint>\d{1,9})?"
    r"(?:_(?P<unit>[A-Za-zµ°]\S*))?",
    re.IGNORECASE,
)
# Names that are said in one message; of more the first ones.
MOST_NAMED = 8
_UNIT = re.compile(r"\s*\[[^\]]*\]$")
# A quantity of a joint with a name in place of its number.
_BY_NAME = re.compile(r"(?P<kind>ddq|dq|q)[ _](?P<name>.+)", re.IGNORECASE)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrajectoryFile:
    """The trajectory of a file, in SI units.

    Args:
        source: Name of the file.
        t: Times [s], (n,).
        q: Joint positions [rad], (n, dof).
        dq, ddq: Joint velocities [rad/s] and accelerations [rad/s²], (n, dof); None without them.
        resolution: Value of the last printed digit of "t", "q", "dq", "ddq" [SI].
        joints: Names of the joints, as the file has them.
        left_out: Titles of columns that are not known.
    """

    source: str
    t: FloatArray
    q: FloatArray
    dq: FloatArray | None
    ddq: FloatArray | None
    resolution: Mapping[str, float]
    joints: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in ("t", "q", "dq", "ddq"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, _checks.lock_floats(getattr(self, name)))

    @property
    def straight(self) -> Trajectory:
        """The motion of joints that move evenly from sample to sample, from time 0 on."""
        rates = np.diff(self.q, axis=0) / np.diff(self.t)[:, None]
        law = LapLaw(breaks=self.t - self.t[0], q=self.q, dq=rates, ddq=np.zeros_like(rates))
        return Trajectory(laws=(law,), method="samples")


# A quantity, and the number of its joint; 0 for the time.
_Key = tuple[str, int]


@_checks.checked
def read_trajectory(
    file: str | FilePath,
    joint_names: Sequence[str] = (),
    *,
    columns: str | None = None,
    topic: str | None = None,
) -> TrajectoryFile:
    """Read a trajectory from a CSV file, a JointTrajectory in YAML, or a bag of ROS 2.

    The first line of CSV names the columns: `t`, `q1` or `joint 1`, `dq1`, `ddq1`, ..., each with a
    unit in brackets (`t [ms]`, `joint 1 [deg]`) or as a suffix (`q1_deg`) if the unit is not SI.
    Other columns are left out. Separators are commas, semicolons or tabs. Lines that start with #
    are comments.

    A bag, of storage mcap or sqlite3, is a folder or one file. Of its messages, a JointTrajectory
    is read; else what a controller's state or JointStates have measured.

    Args:
        file: The file: `.yaml`, `.mcap`, `.db3` or a folder for ROS, else CSV.
        joint_names: Other names of joint 1, 2, ...: alone for positions, or after `q`, `dq`, `ddq`.
            Joints of ROS are found by these names.
        columns: Names of the columns of CSV without a first line for them, separated by commas;
            `-` for a column that is not needed.
        topic: Topic of a bag; by default the only one of its type.

    Raises:
        InvalidInput: A file of another form; names file and line.
    """
    place = FilePath(file)
    if is_ros_file(place):
        if columns is not None:
            raise InvalidInput(f"{place.name} is a file of ROS, which has no columns to name.")
        return _from_ros(place, joint_names, topic)
    if topic is not None:
        raise InvalidInput(f"{place.name} is CSV, which has no topics: leave --topic out.")
    text = read_text(file, "trajectory file", most=LARGE, latin=True)
    return parse_trajectory(text, joint_names, source=place.name, columns=columns)


def _from_ros(file: FilePath, joint_names: Sequence[str], topic: str | None) -> TrajectoryFile:
    """The trajectory in a file of ROS."""
    found = read_ros_motion(file, joint_names, topic)
    return TrajectoryFile(
        source=file.name,
        t=found.t,
        q=found.arrays["q"],
        dq=found.arrays.get("dq"),
        ddq=found.arrays.get("ddq"),
        resolution={"t": NANOSECOND, **found.digit},
        joints=found.names,
    )


def parse_trajectory(
    text: str,
    joint_names: Sequence[str] = (),
    *,
    source: str = "trajectory",
    columns: str | None = None,
) -> TrajectoryFile:
    """Read a trajectory from CSV text; see `read_trajectory`.

    Raises:
        InvalidInput: As in `read_trajectory`.
    """
    joint_names = _checks.check_names("joint_names", joint_names)
    table = split_csv(text, source, columns)
    known, left_out = _columns(table, joint_names)
    used = [known[key] for key in sorted(known)]
    values, digits = read_columns(table, [x.index for x in used])
    arrays, resolution = {}, {}
    for kind in SI:
        of = [i for i, x in enumerate(used) if x.key[0] == kind]
        if of:
            factors = [used[i].factor for i in of]
            arrays[kind] = values[:, of] * factors
            resolution[kind] = max(factors) * last_digit([digits[i] for i in of])
            if kind == "t":
                _refuse_times(table, used[of[0]].index, arrays["t"][:, 0])
            else:
                _refuse_large(table, [used[i].index for i in of], kind, arrays[kind])
    return TrajectoryFile(
        source=source,
        t=arrays["t"][:, 0],
        q=arrays["q"],
        dq=arrays.get("dq"),
        ddq=arrays.get("ddq"),
        resolution=resolution,
        joints=tuple(x.title for x in used if x.key[0] == "q"),
        left_out=left_out,
    )


def _refuse_times(table: CsvTable, column: int, t: FloatArray) -> None:
    """Refuse times that are too large, do not increase, or increase by too little."""
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
        problem = describe_short_step(before, after, float(t[row] - t[row - 1]))
        raise InvalidInput(
            f"{table.place(row)}: {problem} (column {table.names[column]!r}).", index=row
        )


def _refuse_large(table: CsvTable, columns: Sequence[int], kind: str, values: FloatArray) -> None:
    """Refuse joint values that no joint can have, such as degrees read as radians."""
    found = find_large(kind, values)
    if found is not None:
        row, k = found
        raise InvalidInput(
            f"{table.place(row)}: {table.cell(row, columns[k])} is {values[row, k]:.3g} "
            f"{SI[kind]}, but no {QUANTITIES[kind]} is above {LARGEST[kind]:g} {SI[kind]}: correct "
            "the number, or give the column its unit, such as q1 [deg].",
            index=row,
            joint=k,
        )


def _columns(
    table: CsvTable, joint_names: Sequence[str]
) -> tuple[dict[_Key, Column[_Key]], tuple[str, ...]]:
    """The columns by their quantity and joint, and the titles of unknown ones.

    Raises:
        InvalidInput: An unknown unit, two columns for one quantity, or a missing column.
    """
    where = table.heading
    unknown: list[str] = []
    columns = read_titles(
        table.names,
        where=where,
        example=EXAMPLE,
        key_of=lambda name, _: _key(name, joint_names),
        si_of=lambda key: SI[key[0]],
        unknown=unknown.append,
    )
    left_out = tuple(x for x in unknown if x.lower() not in IGNORED)
    for (kind, joint), column in columns.items():
        if kind != "t" and joint == 0:
            raise InvalidInput(
                f"{where}: the column {show(column.title)} has the joint 0: joints count from 1."
            )
    _refuse_missing(where, columns, left_out, joint_names)
    return columns, left_out


def _refuse_missing(
    where: str, columns: Collection[_Key], left_out: Sequence[str], joint_names: Sequence[str]
) -> None:
    """Refuse a missing column of t or q, or of a quantity that other joints have."""
    dof = max((joint for _, joint in columns), default=0)
    for kind in SI:
        joints = range(1) if kind == "t" else range(1, max(1, dof) + 1)
        # The largest number may be of any size, so the search ends at the first gap.
        missing = next((x for x in joints if (kind, x) not in columns), None)
        given = kind in ("t", "q") or any(x == kind for x, _ in columns)
        if missing is not None and given:
            if kind == "q":
                _refuse_other_joints(where, left_out, joint_names)
            known = ": the columns are t, q1 or joint 1, dq1, ddq1, .... The columns "
            more = f"{known}{_some(left_out)} are not known" if left_out else ""
            raise InvalidInput(f"{where}: the column {kind}{missing or ''} is missing{more}.")


def _refuse_other_joints(where: str, left_out: Sequence[str], joint_names: Sequence[str]) -> None:
    """Refuse positions of joints with names that the arm does not have.

    Raises:
        InvalidInput: There are such positions.
    """
    found = (_BY_NAME.fullmatch(_UNIT.sub("", x)) for x in left_out)
    others = [x["name"] for x in found if x and x["kind"].lower() == "q"]
    if not others or not joint_names:
        return
    have = f"the file has positions of {several(len(others), 'joint')} ({_some(others)})"
    arm = f"the arm has {len(joint_names)} ({_some(joint_names)})"
    mend = "give the arm of the file with --arm"
    if len(others) == len(joint_names):
        mend = "name its columns as the arm's joints with --columns, or give its arm with --arm"
    raise InvalidInput(
        f"{where}: {have}, but {arm}: {mend}.",
        needed=len(others),
        allowed=len(joint_names),
    )


def _some(names: Sequence[str]) -> str:
    """Names as text, of many the first ones only."""
    more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
    return ", ".join(map(show, names[:MOST_NAMED])) + more


def _key(name: str, joint_names: Sequence[str]) -> tuple[_Key, str | None] | None:
    """Quantity and joint of a column by its name, and the unit in the name; None if unknown."""
    by_name = _BY_NAME.fullmatch(name)
    if name in joint_names:
        return ("q", joint_names.index(name) + 1), None
    if by_name and by_name["name"] in joint_names:
        return (by_name["kind"].lower(), joint_names.index(by_name["name"]) + 1), None
    match = _NAME.fullmatch(name)
    kind = KINDS[match["kind"].lower()] if match else ""
    if match is None or (match["joint"] is None) != (kind == "t"):
        return None
    return (kind, int(match["joint"] or 0)), match["unit"]
