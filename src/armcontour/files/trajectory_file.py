"""Readers of joint trajectories (CSV, files of ROS) and of the runs in result folders."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from armcontour.core import checks
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import checked
from armcontour.core.file_access import read_text
from armcontour.core.text import count_noun, list_some, show
from armcontour.files.csv_table import MAX_NAMED, CsvTable, last_digit, read_table
from armcontour.files.exports.table import (
    EVENT_KEYS,
    SetPointTable,
    check_export_cycle,
    differentiate,
    equals_plan,
    regular_times,
    tabulate,
)
from armcontour.files.joint_table import (
    QUANTITIES,
    Key,
    TrajectoryFile,
    joints_of,
    read_csv_text,
    read_joint_title,
    read_samples,
    title_pattern,
)
from armcontour.files.result_folder import SUMMARY, verify_file
from armcontour.files.ros_files import is_ros_file, read_ros_motion
from armcontour.motion import Samples, TimedEvent
from armcontour.motion.log_checks import describe_match, match_joints

# Columns of exports that are ignored without a note.
IGNORED = ("events", "torque ")
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
    measured ones are read. Other columns are omitted. Separators are commas, semicolons, tabs or
    blanks. Lines that start with # are comments.

    A bag, of storage mcap or sqlite3, is a folder or one file. Of its messages, a JointTrajectory
    is read; else what a controller's state or JointStates have measured.

    >>> samples = ac.read_trajectory("motion.csv")
    >>> samples.q.shape == (len(samples.t), 2)
    True

    Args:
        file: The file: `.yaml`, `.mcap`, `.db3` or a folder for ROS, else CSV.
        joint_names: Other names of joint 1, 2, ...: alone for positions, or after `q`, `dq`, `ddq`.
            Joints are also found by these names with a prefix.
        columns: As in `read_log`.
        topic: Topic of a bag; by default the only one of its type.

    Raises:
        InvalidInput: A file of another form; names file and line.
    """
    location = FilePath(file)
    if is_ros_file(location):
        return read_ros_motion(location, joint_names, topic, columns)
    text = read_csv_text(file, "trajectory file", topic)
    return parse_trajectory(text, joint_names, source=location.name, columns=columns)


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
        indices = [i for i, key in enumerate(keys) if key.kind == kind]
        if indices:
            arrays[kind] = samples.values[:, indices]
            factor = max(table.columns[keys[i]].factor for i in indices)
            resolution[kind] = factor * last_digit([samples.digits[i] for i in indices])
    spare = [
        x.title for key, x in table.columns.items() if key.kind in QUANTITIES and key not in keys
    ]
    return TrajectoryFile(
        source=source,
        t=samples.t,
        **arrays,
        resolution=resolution,
        joints=tuple(table.columns[key].title for key in keys if key.kind == "q"),
        left_out=(*(x for x in table.unknown if not x.lower().startswith(IGNORED)), *spare),
        notes=(*notes, *samples.notes),
    )


def _keys(table: CsvTable[Key], joint_names: Sequence[str]) -> tuple[list[Key], list[str]]:
    """The columns to read, and notes on how their joints were found."""
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
                _raise_other_joints(table.heading, joints, joint_names, title)
        else:
            joints = _numbers(table, role)
    if len(roles) > 1:
        notes.append(
            f"{table.source} has commands and measured positions: the measured ones are read. To "
            "read the commands, skip the others with --columns, such as "
            f"'-={title_pattern(table.columns[Key('q', role, joints[0])].title)}'."
        )
    keys = [Key("q", role, x) for x in joints]
    for kind in ("dq", "ddq"):
        needed = [Key(kind, role, x) for x in joints]
        present = [x for x in needed if x in table.columns]
        if len(present) == len(needed):
            keys += present
        elif present:
            lacking = next(x.joint for x in needed if x not in table.columns)
            notes.append(
                f"Joint {lacking} of {table.source} has no {QUANTITIES[kind]}: columns such as "
                f"{show(table.columns[present[0]].title)} are left out."
            )
    return keys, notes


def _numbers(table: CsvTable[Key], role: str) -> list[str]:
    """The numbers of the joints, from 1 on, or from 0 on if there is a joint 0."""
    numbers = {int(x.joint) for x in table.columns if x.role == role and x.joint.isdigit()}
    first = 0 if 0 in numbers else 1
    joints = []
    # The largest number may be of any size, so the search ends at the first gap.
    for k in range(first, max(numbers, default=first) + 1):
        table.need(Key("q", role, str(k)))
        joints.append(str(k))
    return joints


def _raise_other_joints(
    heading: str, joints: Sequence[str], joint_names: Sequence[str], title: str
) -> None:
    """Raise the error for joints with names that the arm does not have."""
    have, arm = (list_some([show(x) for x in y], MAX_NAMED) for y in (joints, joint_names))
    fix = "give the arm of the file with --arm"
    if len(joints) >= len(joint_names):
        fix = (
            "name its columns as the arm's joints with --columns, such as "
            f"'{joint_names[0]}={title}' or 'q#=NAME_#', or give its arm with --arm"
        )
    raise InvalidInput(
        f"{heading}: the file has positions of {count_noun(len(joints), 'joint')} ({have}), but "
        f"the arm has {len(joint_names)} ({arm}): {fix}.",
        needed=len(joints),
        allowed=len(joint_names),
    )


# Times that differ by less are equal, in cycles: they are printed with 12 digits.
SAME_TIME = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class StoredRun:
    """A run of a result folder, of `run`, `demo`, `certify` or `learn`."""

    folder: FilePath
    name: str
    title: str
    joint_names: tuple[str, ...]
    cycle: float  # Cycle, which is also the time between rows of the plan [s]
    events: tuple[TimedEvent, ...]  # Events with their times from the start of the plan
    analog: tuple[str, ...] = ()  # Names of analog outputs, whose values a result does not have
    plain: bool = False  # Whether set-points are those of the plan, without compensation

    def set_points(self, **options: Any) -> SetPointTable:
        """The table of the set-points."""
        stored = self._read("set_points.csv")
        start = float(stored.t[0])
        return tabulate(
            self._set_points(stored, options.get("derivatives", 2)),
            name=f"{self.title} set-points",
            cycle=self.cycle,
            events=tuple(x.shifted(-start) for x in self.events),
            start_time=start,
            joint_names=self.joint_names,
            **options,
        )

    def reference(self, cycle: float | None = None, **options: Any) -> SetPointTable:
        """The table of the plan, every `cycle`."""
        step = self.cycle if cycle is None else cycle
        every = round(step / self.cycle)
        if every < 1 or abs(step - every * self.cycle) > 1e-9 * step:
            example = max(1, int(step / self.cycle)) * self.cycle
            raise InvalidInput(
                f"The result in {self.folder} has the plan every {self.cycle * 1e3:g} ms, so the "
                f"cycle must be a multiple of that, such as {example * 1e3:g} ms, and not "
                f"{step * 1e3:g} ms.",
                needed=step,
                allowed=example,
            )
        planned = self._read("planned.csv")
        if planned.dq is None or planned.ddq is None:
            raise InvalidInput(f"{planned.source} has no velocities and accelerations.")
        check_export_cycle(step, float(planned.t[-1]), f"{self.title} reference")
        rows = np.unique(np.append(np.arange(0, len(planned.t), every), len(planned.t) - 1))
        return tabulate(
            Samples(
                t=planned.t[rows], q=planned.q[rows], dq=planned.dq[rows], ddq=planned.ddq[rows]
            ),
            name=f"{self.title} reference",
            cycle=step,
            events=self.events,
            joint_names=self.joint_names,
            **options,
        )

    def _set_points(self, set_points: TrajectoryFile, derivatives: int) -> Samples:
        """Set-points with their derivatives, as `make_table` gives them."""
        if not self.plain or derivatives < 2:
            return differentiate(set_points.q, self.cycle)
        plan = self._read("planned.csv")
        if plan.dq is None or plan.ddq is None or not equals_plan(set_points.q, plan.q):
            return differentiate(set_points.q, self.cycle)
        dq, ddq = plan.dq.copy(), plan.ddq.copy()
        if abs(plan.t[-1] - set_points.t[-1]) > SAME_TIME * self.cycle:
            # The plan ends between the last two set-points, and rests at the last one.
            dq[-1], ddq[-1] = 0.0, 0.0
        return Samples(t=regular_times(len(dq), self.cycle), q=set_points.q, dq=dq, ddq=ddq)

    def _read(self, name: str) -> TrajectoryFile:
        """Read a file of the run that did not change since it was written."""
        return read_trajectory(verify_file(self.folder, f"{self.name}/{name}"), self.joint_names)


def read_run(folder: str | FilePath, name: str | None = None) -> StoredRun:
    """Read a run of a result folder."""
    location = FilePath(folder)
    file = verify_file(location, SUMMARY)
    try:
        data = json.loads(read_text(file, "summary"))
        run = _choose(location, data["runs"], name)
        about = data["runs"][run]
        return StoredRun(
            folder=location,
            name=run,
            title=data["job"],
            joint_names=tuple(data["arm"]["joints"]),
            cycle=about["cycle"],
            events=tuple(
                TimedEvent(**{x: e[x] for x in EVENT_KEYS}, point=tuple(e["point"]))
                for e in about.get("events", ())
            ),
            analog=tuple(about.get("analog", ())),
            plain=about.get("compensation") == "none",
        )
    except InvalidInput:
        raise
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InvalidInput(
            f"{file} is not the summary of a run or a certificate: {type(error).__name__}."
        ) from None


def _choose(folder: FilePath, runs: Mapping[str, Any], name: str | None) -> str:
    """The name of the requested run, or of the only one."""
    names = list_some([repr(x) for x in runs], 6)
    if name is None and len(runs) == 1:
        return next(iter(runs))
    if name is None:
        raise InvalidInput(f"{folder} has the runs {names}: choose one with --run.")
    if name not in runs:
        raise InvalidInput(f"{folder} has no run {name!r}: its runs are {names}.")
    return name
