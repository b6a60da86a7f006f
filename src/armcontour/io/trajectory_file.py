"""Read time-stamped joint trajectories of any planner or log: CSV, and files of ROS."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path as FilePath

import numpy as np

from armcontour import _checks
from armcontour._checks import FloatArray
from armcontour._describing import several
from armcontour._files import LARGE, read_text
from armcontour._text import show
from armcontour.core.fields import Checked, checked
from armcontour.errors import InvalidInput
from armcontour.io.joint_table import (
    JointColumns,
    describe_match,
    match_joints,
    read_joint_columns,
    read_joint_samples,
    refuse_large,
    refuse_times,
    title_pattern,
)
from armcontour.io.joint_titles import Key
from armcontour.io.number_table import last_digit
from armcontour.io.ros_files import NANOSECOND, is_ros_file, read_ros_motion
from armcontour.motion import LapLaw, Trajectory

# Quantities of the columns, for messages.
QUANTITIES = {"q": "joint position", "dq": "joint velocity", "ddq": "joint acceleration"}
# Columns of our own that are left out without a word.
IGNORED = ("events",)
# Names that are said in one message; of more the first ones.
MOST_NAMED = 8


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrajectoryFile(Checked):
    """The trajectory of a file, in SI units.

    Args:
        source: Name of the file.
        t: Times [s], (n,).
        q: Joint positions [rad], (n, dof).
        dq, ddq: Joint velocities [rad/s] and accelerations [rad/s²], (n, dof); None without them.
        resolution: Value of the last printed digit of "t", "q", "dq", "ddq" [SI].
        joints: Names of the joints, as the file has them.
        left_out: Titles of columns that are not used.
        notes: What was recognised in the file, or left out of it.
    """

    source: str
    t: FloatArray
    q: FloatArray
    dq: FloatArray | None
    ddq: FloatArray | None
    resolution: Mapping[str, float]
    joints: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def straight(self) -> Trajectory:
        """The motion of joints that move evenly from sample to sample, from time 0 on."""
        rates = np.diff(self.q, axis=0) / np.diff(self.t)[:, None]
        law = LapLaw(breaks=self.t - self.t[0], q=self.q, dq=rates, ddq=np.zeros_like(rates))
        return Trajectory(laws=(law,), method="samples")


@checked
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
    The names of logs are known, too (see `read_log`): of measured positions and commands, the
    measured ones are read. Other columns are left out. Separators are commas, semicolons, tabs or
    blanks. Lines that start with # are comments.

    A bag, of storage mcap or sqlite3, is a folder or one file. Of its messages, a JointTrajectory
    is read; else what a controller's state or JointStates have measured.

    Args:
        file: The file: `.yaml`, `.mcap`, `.db3` or a folder for ROS, else CSV.
        joint_names: Other names of joint 1, 2, ...: alone for positions, or after `q`, `dq`, `ddq`.
            Joints are also found by these names with a prefix.
        columns: As in `read_log`.
        topic: Topic of a bag; by default the only one of its type.

    Raises:
        InvalidInput: A file of another form; names file and line.
    """
    place = FilePath(file)
    if is_ros_file(place):
        return _from_ros(place, joint_names, columns, topic)
    if topic is not None:
        raise InvalidInput(f"{place.name} is CSV, which has no topics: leave --topic out.")
    text = read_text(file, "trajectory file", most=LARGE, latin=True)
    return parse_trajectory(text, joint_names, source=place.name, columns=columns)


def _from_ros(
    file: FilePath, joint_names: Sequence[str], columns: str | None, topic: str | None
) -> TrajectoryFile:
    """The trajectory in a file of ROS."""
    found = read_ros_motion(file, joint_names, topic, columns)
    return TrajectoryFile(
        source=file.name,
        t=found.t,
        q=found.arrays["q"],
        dq=found.arrays.get("dq"),
        ddq=found.arrays.get("ddq"),
        resolution={"t": NANOSECOND, **found.digit},
        joints=found.names,
        notes=found.notes,
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
    found = read_joint_columns(text, source, columns, joint_names)
    keys, notes = _keys(found, joint_names)
    samples = read_joint_samples(found, keys)
    refuse_times(samples, found)
    refuse_large(found, samples, keys, QUANTITIES)
    arrays, resolution = {}, {"t": samples.digit}
    for kind in QUANTITIES:
        of = [i for i, key in enumerate(keys) if key.kind == kind]
        if of:
            arrays[kind] = samples.values[:, of]
            factor = max(found.known[keys[i]].factor for i in of)
            resolution[kind] = factor * last_digit([samples.digits[i] for i in of])
    spare = [
        x.title for key, x in found.known.items() if key.kind in QUANTITIES and key not in keys
    ]
    return TrajectoryFile(
        source=source,
        t=samples.t,
        q=arrays["q"],
        dq=arrays.get("dq"),
        ddq=arrays.get("ddq"),
        resolution=resolution,
        joints=tuple(found.known[key].title for key in keys if key.kind == "q"),
        left_out=(*(x for x in found.unknown if x.lower() not in IGNORED), *spare),
        notes=(*notes, *samples.notes),
    )


def _keys(found: JointColumns, joint_names: Sequence[str]) -> tuple[list[Key], list[str]]:
    """The columns to read, and notes on how their joints were found.

    Raises:
        InvalidInput: A column is missing.
    """
    where, notes = found.table.heading, []
    roles = [x for x in ("measured", "command") if found.joints("q", x)]
    role = roles[0] if roles else "measured"
    every = [x.joint for x in found.known if (x.kind, x.role) == ("q", role)]
    order = match_joints(every, joint_names, where) if joint_names else None
    if order is not None:
        joints = [every[i] for i in order]
        notes += describe_match(every, joint_names, order)
    else:
        joints = found.joints("q", role)
        numbers = bool(joints) and joints[0].isdigit()
        if joint_names and joints and not numbers:
            title = found.known[Key("q", role, joints[0])].title
            _refuse_other_joints(where, joints, joint_names, title)
        if numbers or not joints:
            joints = _numbers(found, role)
    if len(roles) > 1:
        notes.append(
            f"{found.table.source} has commands and measured positions: the measured ones are "
            "read. To read the commands, leave the others out with --columns, such as "
            f"'-={title_pattern(found.known[Key('q', role, joints[0])].title)}'."
        )
    keys = [Key("q", role, x) for x in joints]
    for kind in ("dq", "ddq"):
        own = [Key(kind, role, x) for x in joints]
        some = [x for x in own if x in found.known]
        if len(some) == len(own):
            keys += some
        elif some:
            lacking = next(x.joint for x in own if x not in found.known)
            title = found.known[some[0]].title
            notes.append(
                f"Joint {lacking} of {found.table.source} has no {QUANTITIES[kind]}: columns such "
                f"as {show(title)} are left out."
            )
    return keys, notes


def _numbers(found: JointColumns, role: str) -> list[str]:
    """The numbers of the joints, from 1 on, or from 0 on if there is a joint 0.

    Raises:
        InvalidInput: A number is missing.
    """
    given = {x.joint for x in found.known if x.role == role and x.joint.isdigit()}
    first = 0 if "0" in given else 1
    last = max((int(x) for x in given), default=first)
    # The largest number may be of any size, so the search ends at the first gap.
    missing = next(
        (k for k in range(first, last + 1) if Key("q", role, str(k)) not in found.known), None
    )
    if missing is not None:
        _refuse_missing(f"q{missing}", found)
    return [str(k) for k in range(first, last + 1)]


def _refuse_missing(name: str, found: JointColumns) -> None:
    """Refuse a table without a column.

    Raises:
        InvalidInput: Always.
    """
    left_out = found.unknown
    known = (
        ": the columns are t, q1 or joint 1, dq1, ddq1, ...; name them with --columns, such as "
        "'q#=NAME_#'. The columns "
    )
    more = f"{known}{_some(left_out)} are not known" if left_out else ""
    raise InvalidInput(f"{found.table.heading}: the column {name} is missing{more}.")


def _refuse_other_joints(
    where: str, joints: Sequence[str], joint_names: Sequence[str], title: str
) -> None:
    """Refuse positions of joints with names that the arm does not have.

    Raises:
        InvalidInput: Always.
    """
    have = f"the file has positions of {several(len(joints), 'joint')} ({_some(joints)})"
    arm = f"the arm has {len(joint_names)} ({_some(joint_names)})"
    fix = "give the arm of the file with --arm"
    if len(joints) >= len(joint_names):
        fix = (
            "name its columns as the arm's joints with --columns, such as "
            f"'{joint_names[0]}={title}' or 'q#=NAME_#', or give its arm with --arm"
        )
    raise InvalidInput(
        f"{where}: {have}, but {arm}: {fix}.", needed=len(joints), allowed=len(joint_names)
    )


def _some(names: Sequence[str]) -> str:
    """Names as text, of many the first ones only."""
    more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
    return ", ".join(map(show, names[:MOST_NAMED])) + more
