"""Read time-stamped joint trajectories of any planner or log: CSV, and files of ROS."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path as FilePath

from armcontour.core import checks
from armcontour.core.describing import count_noun
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import checked
from armcontour.core.text import list_some, show
from armcontour.files.csv_table import MOST_NAMED, CsvTable, last_digit, read_table
from armcontour.files.joint_table import (
    QUANTITIES,
    TrajectoryFile,
    joints_of,
    read_csv_text,
    read_samples,
    title_pattern,
)
from armcontour.files.joint_titles import Key, read_joint_title
from armcontour.files.ros_files import is_ros_file, read_ros_motion
from armcontour.motion.log_checks import describe_match, match_joints

# Columns of our own that are left out without a word.
IGNORED = ("events",)
EXAMPLE = "t [s],q1 [deg],q2 [deg], or t,u1,q1,u2,q2 for commands and measured positions"


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
        return read_ros_motion(place, joint_names, topic, columns)
    text = read_csv_text(file, "trajectory file", topic)
    return parse_trajectory(text, joint_names, source=place.name, columns=columns)


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
    joint_names = checks.check_names("joint_names", joint_names)
    title_of = partial(read_joint_title, joint_names=joint_names)
    table = read_table(text, source, title_of, example=EXAMPLE, columns=columns, option="--columns")
    keys, notes = _keys(table, joint_names)
    samples = read_samples(table, keys)
    arrays, resolution = {}, {"t": samples.digit}
    for kind in QUANTITIES:
        of = [i for i, key in enumerate(keys) if key.kind == kind]
        if of:
            arrays[kind] = samples.values[:, of]
            factor = max(table.columns[keys[i]].factor for i in of)
            resolution[kind] = factor * last_digit([samples.digits[i] for i in of])
    spare = [
        x.title for key, x in table.columns.items() if key.kind in QUANTITIES and key not in keys
    ]
    return TrajectoryFile(
        source=source,
        t=samples.t,
        **arrays,
        resolution=resolution,
        joints=tuple(table.columns[key].title for key in keys if key.kind == "q"),
        left_out=(*(x for x in table.unknown if x.lower() not in IGNORED), *spare),
        notes=(*notes, *samples.notes),
    )


def _keys(table: CsvTable[Key], joint_names: Sequence[str]) -> tuple[list[Key], list[str]]:
    """The columns to read, and notes on how their joints were found.

    Raises:
        InvalidInput: A column is missing.
    """
    notes = list[str]()
    roles = [x for x in ("measured", "command") if joints_of(table, "q", x)]
    role = roles[0] if roles else "measured"
    every = [x.joint for x in table.columns if (x.kind, x.role) == ("q", role)]
    order = match_joints(every, joint_names, table.heading) if joint_names else None
    if order is not None:
        joints = [every[i] for i in order]
        notes += describe_match(every, joint_names, order)
    else:
        joints = joints_of(table, "q", role)
        if joints and not joints[0].isdigit():
            if joint_names:
                title = table.columns[Key("q", role, joints[0])].title
                _refuse_other_joints(table.heading, joints, joint_names, title)
        else:
            joints = _numbers(table, role)
    if len(roles) > 1:
        notes.append(
            f"{table.source} has commands and measured positions: the measured ones are read. To "
            "read the commands, leave the others out with --columns, such as "
            f"'-={title_pattern(table.columns[Key('q', role, joints[0])].title)}'."
        )
    keys = [Key("q", role, x) for x in joints]
    for kind in ("dq", "ddq"):
        own = [Key(kind, role, x) for x in joints]
        some = [x for x in own if x in table.columns]
        if len(some) == len(own):
            keys += some
        elif some:
            lacking = next(x.joint for x in own if x not in table.columns)
            notes.append(
                f"Joint {lacking} of {table.source} has no {QUANTITIES[kind]}: columns such as "
                f"{show(table.columns[some[0]].title)} are left out."
            )
    return keys, notes


def _numbers(table: CsvTable[Key], role: str) -> list[str]:
    """The numbers of the joints, from 1 on, or from 0 on if there is a joint 0.

    Raises:
        InvalidInput: A number is missing.
    """
    given = {int(x.joint) for x in table.columns if x.role == role and x.joint.isdigit()}
    first = 0 if 0 in given else 1
    joints = []
    # The largest number may be of any size, so the search ends at the first gap.
    for k in range(first, max(given, default=first) + 1):
        table.need(Key("q", role, str(k)))
        joints.append(str(k))
    return joints


def _refuse_other_joints(
    where: str, joints: Sequence[str], joint_names: Sequence[str], title: str
) -> None:
    """Refuse positions of joints with names that the arm does not have.

    Raises:
        InvalidInput: Always.
    """
    have, arm = (list_some([show(x) for x in y], MOST_NAMED) for y in (joints, joint_names))
    fix = "give the arm of the file with --arm"
    if len(joints) >= len(joint_names):
        fix = (
            "name its columns as the arm's joints with --columns, such as "
            f"'{joint_names[0]}={title}' or 'q#=NAME_#', or give its arm with --arm"
        )
    raise InvalidInput(
        f"{where}: the file has positions of {count_noun(len(joints), 'joint')} ({have}), but the "
        f"arm has {len(joint_names)} ({arm}): {fix}.",
        needed=len(joints),
        allowed=len(joint_names),
    )
