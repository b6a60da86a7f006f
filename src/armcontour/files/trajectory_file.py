"""Readers of joint trajectories (CSV and ROS files), and of the runs in result folders."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from armcontour.core import checks
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import checked
from armcontour.core.file_access import read_text
from armcontour.core.text import list_some, show
from armcontour.files.csv_table import CsvTable, last_digit, read_table, title_pattern
from armcontour.files.exports.table import (
    EVENT_KEYS,
    SetPointTable,
    check_export_cycle,
    equals_plan,
    regular_times,
    sample_spline,
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
)
from armcontour.files.result_folder import SUMMARY, verify_file
from armcontour.files.ros_files import is_ros_file, read_ros_motion
from armcontour.motion import Samples, TimedEvent
from armcontour.motion.log import match_joints, raise_other_joints
from armcontour.robot import Limits

# Beginnings of the titles of export columns that are ignored without a note.
IGNORED = ("events", "torque ")
EXAMPLE = "t [s],q1 [deg],q2 [deg], or t,u1,q1,u2,q2 for commands and measured positions"


@checked
def read_trajectory(
    file: str | FilePath,
    joint_names: Sequence[str] = (),
    *,
    columns: str | None = None,
) -> TrajectoryFile:
    """Read a trajectory from a CSV file, or a JointTrajectory in YAML.

    The first line of CSV names the columns: `t`, `q1` or `joint 1`, `dq1`, `ddq1`, ..., each with a
    unit in brackets (`t [ms]`, `joint 1 [deg]`) if the unit is not SI. The column names of logs are
    also recognized (see `read_log`). If a file has commands and
    measured positions, the measured positions are read. Other columns are ignored. Separators are
    commas, semicolons, tabs or blanks. Lines that start with # are comments.

    >>> samples = ac.read_trajectory("motion.csv")
    >>> samples.q.shape == (len(samples.t), 2)
    True

    Args:
        file: The file: `.yaml` for ROS; any other file is read as CSV.
        joint_names: Names of joint 1, 2, ... in titles: only the name for positions, or the name
            after `q`, `dq`, `ddq`. Names with an additional prefix are also recognized.
        columns: As in `read_log`.

    Raises:
        InvalidInput: The file has another form; the message names file and line.
    """
    location = FilePath(file)
    if is_ros_file(location):
        return read_ros_motion(location, joint_names, columns)
    text = read_csv_text(file, "trajectory file")
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
    keys, notes = _select_columns(table, joint_names)
    samples = read_samples(table, keys)
    arrays, resolution = {}, {"t": samples.digit}
    for kind in QUANTITIES:
        indices = [i for i, key in enumerate(keys) if key.kind == kind]
        if indices:
            arrays[kind] = samples.values[:, indices]
            factor = max(table.columns[keys[i]].factor for i in indices)
            resolution[kind] = factor * last_digit([samples.digits[i] for i in indices])
    used = [table.columns[x] for x in keys if x.kind == "q"]
    spare = [
        x.title for key, x in table.columns.items() if key.kind in QUANTITIES and key not in keys
    ]
    return TrajectoryFile(
        source=source,
        t=samples.t,
        **arrays,
        resolution=resolution,
        joints=tuple(x.title for x in used),
        prismatic=tuple(None if x.unit is None else x.linear for x in used),
        left_out=(*(x for x in table.unknown if not x.lower().startswith(IGNORED)), *spare),
        notes=(*notes, *samples.notes),
    )


def _select_columns(
    table: CsvTable[Key], joint_names: Sequence[str]
) -> tuple[list[Key], list[str]]:
    """Keys of the columns to read, and notes on the assignment of joints and ignored columns."""
    notes = list[str]()
    roles = [x for x in ("measured", "command") if joints_of(table, "q", x)]
    role = roles[0] if roles else "measured"
    every = [x.joint for x in table.columns if (x.kind, x.role) == ("q", role)]
    order = match_joints(every, joint_names, table.heading) if joint_names else None
    if order is not None:
        joints = [every[i] for i in order]
    else:
        joints = joints_of(table, "q", role)
        if joints and not joints[0].isdigit():
            if joint_names:
                titles = [table.columns[Key("q", role, x)].title for x in joints]
                raise_other_joints(table.heading, joints, joint_names, titles)
        else:
            joints = _joint_numbers(table, role)
    if len(roles) > 1:
        notes.append(
            f"{table.source} has commands and measured positions. The measured positions are read. "
            "To read the commands instead, skip the measured positions (--columns "
            f"'-={title_pattern(table.columns[Key('q', role, joints[0])].title)}')."
        )
    keys = [Key("q", role, x) for x in joints]
    for kind in ("dq", "ddq"):
        needed = [Key(kind, role, x) for x in joints]
        columns = [x for x in needed if x in table.columns]
        present = [x for x in columns if not table.is_empty(x)]
        if len(present) == len(needed):
            keys += present
        elif columns:
            lacking = next(x.joint for x in needed if x not in present)
            notes.append(
                f"Columns such as {show(table.columns[columns[0]].title)} are ignored, because "
                f"joint {lacking} of {table.source} has no {QUANTITIES[kind]}."
            )
    return keys, notes


def _joint_numbers(table: CsvTable[Key], role: str) -> list[str]:
    """Numbers of the joints as texts, starting at 1, or at 0 if there is a joint 0."""
    numbers = {int(x.joint) for x in table.columns if x.role == role and x.joint.isdigit()}
    first = 0 if 0 in numbers else 1
    joints = []
    # `require_columns` raises an error at the first missing number, so that a huge number is
    # no problem.
    for k in range(first, max(numbers, default=first) + 1):
        table.require_columns(Key("q", role, str(k)))
        joints.append(str(k))
    return joints


# Times are equal if they differ by at most this [cycles]; times are printed with 12 digits.
SAME_TIME = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class StoredRun:
    """A run in a result folder of the commands `run`, `demo`, `certify` or `learn`."""

    folder: FilePath  # Result folder
    name: str  # Name of the run
    title: str  # Name of the job
    joint_names: tuple[str, ...]
    cycle: float  # Time between set-points, and between rows of the plan [s]
    events: tuple[TimedEvent, ...]  # Events, with times since the start of the plan
    analog: tuple[str, ...] = ()  # Names of analog outputs; the folder does not have their values
    plain: bool = False  # Whether the set-points are those of the plan, without compensation
    limited: bool = False  # Whether the set-points have command limits
    outputs: Mapping[str, int | str] = field(default_factory=dict)  # Outputs of events by name

    def set_points(self, derivatives: int | None = None) -> SetPointTable:
        """Table of the set-points; `derivatives` as in `tabulate`."""
        stored = self._read("set_points.csv")
        start = float(stored.t[0])
        return tabulate(
            self._set_points(stored, derivatives),
            name=f"{self.title} set-points",
            cycle=self.cycle,
            events=tuple(x.shifted(-start) for x in self.events),
            start_time=start,
            joint_names=self.joint_names,
            prismatic=tuple(x is True for x in stored.prismatic),
            derivatives=derivatives,
            command_limits=Limits() if self.limited else None,
        )

    def reference(
        self, cycle: float | None = None, derivatives: int | None = None
    ) -> SetPointTable:
        """Table of the plan, sampled with the period `cycle` [s]; by default that of the run."""
        step = self.cycle if cycle is None else cycle
        every = round(step / self.cycle)
        if every < 1 or abs(step - every * self.cycle) > 1e-9 * step:
            example = max(1, int(step / self.cycle)) * self.cycle
            raise InvalidInput(
                f"The cycle must be a multiple of {self.cycle * 1e3:g} ms, the cycle of the plan "
                f"in {self.folder}, such as {example * 1e3:g} ms, but is {step * 1e3:g} ms.",
                needed=step,
                allowed=example,
            )
        planned = self._read("planned.csv")
        if planned.dq is None or planned.ddq is None:
            raise InvalidInput(
                f"{planned.source} of {self.folder} must have velocities and accelerations. Run "
                "the job again."
            )
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
            prismatic=tuple(x is True for x in planned.prismatic),
            derivatives=derivatives,
        )

    def _set_points(self, set_points: TrajectoryFile, derivatives: int | None) -> Samples:
        """Samples of set-points with the same derivatives as in `make_table`."""
        if not self.plain or derivatives not in (None, 2):
            return sample_spline(set_points.q, self.cycle)
        plan = self._read("planned.csv")
        if plan.dq is None or plan.ddq is None or not equals_plan(set_points.q, plan.q):
            return sample_spline(set_points.q, self.cycle)
        dq, ddq = plan.dq.copy(), plan.ddq.copy()
        if abs(plan.t[-1] - set_points.t[-1]) > SAME_TIME * self.cycle:
            # The plan ends between the last two set-points, so that the last one is at rest.
            dq[-1], ddq[-1] = 0.0, 0.0
        return Samples(t=regular_times(len(dq), self.cycle), q=set_points.q, dq=dq, ddq=ddq)

    def _read(self, name: str) -> TrajectoryFile:
        """Read a file of the run; it must not have changed since armcontour wrote it."""
        return read_trajectory(verify_file(self.folder, f"{self.name}/{name}"), self.joint_names)


def read_run(folder: str | FilePath, name: str | None = None) -> StoredRun:
    """Read a run of a result folder; `name` is optional if the folder has only one run."""
    location = FilePath(folder)
    file = verify_file(location, SUMMARY)
    try:
        data = json.loads(read_text(file, "summary"))
        run = _choose_run(location, data["runs"], name)
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
            limited="command_use" in about,
            outputs=dict(about.get("outputs", {})),
        )
    except InvalidInput:
        raise
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InvalidInput(
            f"{file} is not the summary of a run or a certificate ({type(error).__name__})."
        ) from None


def _choose_run(folder: FilePath, runs: Mapping[str, Any], name: str | None) -> str:
    """Name of the requested run, or of the only run."""
    names = list_some([repr(x) for x in runs], 6)
    if name is None and len(runs) == 1:
        return next(iter(runs))
    if name is None:
        raise InvalidInput(f"{folder} has the runs {names}. Choose one with --run.")
    if name not in runs:
        raise InvalidInput(f"{folder} has no run {name!r}. Its runs are {names}.")
    return name
