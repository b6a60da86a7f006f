"""Readers of joint trajectories (CSV and ROS files), and of the runs in result folders."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from armcontour.core import checks, yaml_loader
from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import checked
from armcontour.core.file_access import read_text
from armcontour.core.text import list_some, plain_number, show
from armcontour.files.csv_table import (
    CsvTable,
    Digits,
    last_digit,
    read_table,
    rename,
    title_pattern,
)
from armcontour.files.drawings.path_reader import YAML
from armcontour.files.exports.export_table import (
    EVENT_KEYS,
    REFERENCE,
    WAIT_KEYS,
    SetPointTable,
    equals_plan,
    regular_times,
    sample_spline,
    tabulate,
)
from armcontour.files.joint_table import (
    QUANTITIES,
    JointColumn,
    TrajectoryFile,
    find_new_rows,
    joints_of,
    read_csv_text,
    read_joint_title,
    read_samples,
)
from armcontour.files.result_folder import SUMMARY, verify_file
from armcontour.files.ros_bag import is_bag, read_bag
from armcontour.files.ros_table import joint_state_titles, name_joints
from armcontour.motion import Samples, TimedEvent, TimedWait
from armcontour.motion.log import match_joints, raise_other_joints
from armcontour.motion.set_point_rule import SetPointRule

# Fields of messages and goals that contain the JointTrajectory, directly or nested.
INNER_FIELDS = ("request", "goal", "trajectory", "joint_trajectory")
# Fields of a time in ROS 2 and ROS 1.
STAMPS = (("sec", "nanosec"), ("secs", "nsecs"))
ARRAYS = {"q": "positions", "dq": "velocities", "ddq": "accelerations"}
# Resolution of times in ROS [s].
NANOSECOND = 1e-9
# Export columns that are ignored without a note, by the beginnings of their titles.
IGNORED = ("events", "torque ")
# Title of a column that a program has measured, not planned.
MEASURED = re.compile("measured|actual|feedback", re.IGNORECASE)
EXAMPLE = "t [s],q1 [deg],q2 [deg], or t,u1,q1,u2,q2 for commands and measured positions"
# Times are equal if they differ by at most this [cycles]; times are printed with 12 digits.
SAME_TIME = 1e-6


def read_ros_motion(
    file: FilePath, joint_names: Sequence[str], names: str | None = None
) -> TrajectoryFile:
    """Read a JointTrajectory in the form of `ros2 topic echo`.

    Args:
        file: The file (YAML).
        joint_names: Names of the arm's joints; empty for the joints of the file.
        names: New names of joints, as in `rename`; None for those of the file.

    Raises:
        InvalidInput: The file has not exactly one JointTrajectory, or its joints or points are
            wrong.
    """
    if names is not None and "=" not in names:
        raise InvalidInput(
            f"{file.name} is a file of ROS, which has no columns. --columns can only rename its "
            "joints, such as 'elbow_joint=left_elbow_joint'."
        )
    # The output of `ros2 topic echo` ends with a document separator.
    text = read_text(file, "trajectory file").rstrip().removesuffix("---")
    data = _trajectory_in(yaml_loader.load(text, file.name))
    if not isinstance(data, dict) or not {"joint_names", "points"} <= set(data):
        raise InvalidInput(
            f"{file.name} has not exactly one JointTrajectory. It must be a JointTrajectory, or a "
            "message or goal that contains one, with the keys joint_names and points, and with "
            "positions and time_from_start in each point."
        )
    if not isinstance(data["points"], list) or not isinstance(data["joint_names"], list):
        raise InvalidInput(f"{file.name}: joint_names and points must be lists.")
    if not data["points"]:
        raise InvalidInput(f"{file.name} has a trajectory without points.")
    points = [_Point(file.name, i, x) for i, x in enumerate(data["points"], start=1)]
    called = [str(x) for x in data["joint_names"]]
    called = called if names is None else list(rename(called, names, file.name))
    return _join_points(file.name, called, points, joint_names)


def _trajectory_in(data: Any) -> Any:
    """JointTrajectory in a message or goal; `data` itself if it has no field of INNER_FIELDS."""
    if isinstance(data, list):
        return _trajectory_in(data[0]) if len(data) == 1 else data
    for name in INNER_FIELDS:
        if isinstance(data, dict) and data.get(name) is not None:
            return _trajectory_in(data[name])
    return data


class _Point:
    """Point of a trajectory: numbers by the names of ARRAYS, and the time from the start [ns]."""

    def __init__(self, source: str, number: int, data: Any) -> None:
        location = f"{source}, point {number}"
        if not isinstance(data, dict):
            raise InvalidInput(
                f"{location}: a point must have positions and time_from_start, but is {show(data)}."
            )
        self.numbers: dict[str, list[Any]] = {}
        for name in ARRAYS.values():
            values = data.get(name) or ()
            numbers = (
                [plain_number(x) for x in values] if isinstance(values, list | tuple) else [None]
            )
            if None in numbers:
                raise InvalidInput(
                    f"{location}: {name} must be a list of numbers, but is {show(values)}."
                )
            self.numbers[name] = numbers
        start = data.get("time_from_start")
        self.nanoseconds = _nanoseconds(start)
        if abs(self.nanoseconds) >= INVALID_TIME:
            raise InvalidInput(
                f"{location}: time_from_start must be a number of seconds, or sec and nanosec "
                f"(secs and nsecs in ROS 1), and at most 292 years, but is {show(start)}."
            )


# This number of nanoseconds is too large for a time, which has 64 bits with a sign.
INVALID_TIME = 2**63


def _nanoseconds(start: Any) -> int:
    """Convert a time in YAML, in seconds or in fields of ROS 1 or 2, to ns.

    An invalid time results in INVALID_TIME.
    """
    fields = [start]
    if isinstance(start, dict):
        pair = next((x for x in STAMPS if set(start) == set(x)), None)
        fields = [] if pair is None else [start[x] for x in pair]
    numbers = [plain_number(x) for x in fields]
    if not numbers or None in numbers or isinstance(start, str):
        return INVALID_TIME
    if isinstance(start, dict):
        return int(fields[0]) * 10**9 + int(fields[1])
    return round(float(start) * 1e9)


def _join_points(
    source: str, names: Sequence[str], points: Sequence[_Point], joint_names: Sequence[str]
) -> TrajectoryFile:
    """Join points to a motion, with the resolution of the printed numbers."""
    requested = tuple(joint_names) or tuple(names)
    order = match_joints(names, requested, source)
    if not order:
        raise_other_joints(source, names, requested, names)
    arrays = {}
    for kind, name in ARRAYS.items():
        rows = [x.numbers[name] for x in points]
        if kind != "q" and not all(rows):
            continue
        for number, row in enumerate(rows, start=1):
            if len(row) <= max(order):
                raise InvalidInput(
                    f"{source}, sample {number}: the message has {len(row)} {name}, but needs at "
                    f"least {max(order) + 1}, one per joint name.",
                    index=number - 1,
                )
        arrays[kind] = np.array([[row[j] for j in order] for row in rows], dtype=float)
    times = np.array([x.nanoseconds for x in points]) * NANOSECOND
    values = np.concatenate(list(arrays.values()), axis=1)
    new_rows, notes = find_new_rows(times, values, source)
    arrays_of_rows: dict[str, Any] = {key: x[new_rows] for key, x in arrays.items()}
    return TrajectoryFile(
        source=source,
        joints=requested,
        t=times[new_rows],
        **arrays_of_rows,
        resolution={"t": NANOSECOND, **{key: _last_digit(x) for key, x in arrays.items()}},
        is_plan=True,
        notes=notes,
    )


def _last_digit(values: FloatArray) -> float:
    """Return the value of the last digit of numbers that are printed in their shortest form."""
    digits = Digits()
    digits.add([repr(x) for x in values.ravel().tolist()])
    return last_digit([digits])


@checked
def read_trajectory(
    file: str | FilePath,
    joint_names: Sequence[str] = (),
    *,
    columns: str | None = None,
    topic: str | None = None,
) -> TrajectoryFile:
    """Read a trajectory from a CSV file, a bag of ROS 2, or a JointTrajectory in YAML.

    The first line of CSV names the columns: `t`, `q1` or `joint 1`, `dq1`, `ddq1`, ..., each with a
    unit in brackets (`t [ms]`, `joint 1 [deg]`) if the unit is not SI. The column names of logs are
    also recognized (see `read_log`). If a file has commands and
    measured positions, the measured positions are read. Other columns are ignored. Separators are
    commas, semicolons, tabs or blanks. Lines that start with # are comments.

    A bag (.mcap, .db3, or its folder) needs the extra `ros`, and joint states or the state of a
    joint trajectory controller. Times are the stamps of its messages, from the first one.

    >>> samples = ac.read_trajectory("motion.csv")
    >>> samples.q.shape == (len(samples.t), 2)
    True

    Args:
        file: The file: `.yaml` for ROS, a bag; any other file is read as CSV.
        joint_names: Names of joint 1, 2, ... in titles: only the name for positions, or the name
            after `q`, `dq`, `ddq`. Names with an additional prefix are also recognized.
        columns: As in `read_log`.
        topic: As in `read_log`.

    Raises:
        InvalidInput: The file has another form; the message names file and line.
    """
    location = FilePath(file)
    if is_bag(location, topic):
        joint_names = checks.check_names("joint_names", joint_names)
        table, notes = read_bag(location, joint_names, topic=topic, columns=columns)
        motion = _read_motion(table, joint_names)
        is_log = any(x.role == "measured" for x in table.columns)
        # The rows of a bag are not lines.
        return replace(motion, notes=(*notes, *motion.notes), lines=None, is_log=is_log)
    if location.suffix.lower() in YAML:
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
    """Read a trajectory from CSV text.

    Args:
        text: The text, in the form that `read_trajectory` describes.
        joint_names: As in `read_trajectory`.
        source: Name of the text, for messages.
        columns: As in `read_trajectory`.

    Raises:
        InvalidInput: As in `read_trajectory`.
    """
    joint_names = checks.check_names("joint_names", joint_names)
    title_of = partial(read_joint_title, joint_names=joint_names)
    table = read_table(
        text,
        source,
        title_of,
        example=EXAMPLE,
        columns=columns,
        option="--columns",
        untitled=joint_state_titles,
        names=joint_names,
    )
    table, naming = name_joints(table, joint_names)
    motion = _read_motion(table, joint_names)
    return replace(motion, notes=(*naming, *motion.notes))


def _read_motion(table: CsvTable[JointColumn], joint_names: Sequence[str]) -> TrajectoryFile:
    """Read the motion in a table."""
    keys, notes = _select_columns(table, joint_names)
    samples = read_samples(table, keys)
    arrays: dict[str, Any] = {}
    resolution = {"t": samples.digit}
    for kind in QUANTITIES:
        indices = [i for i, key in enumerate(keys) if key.kind == kind]
        if indices:
            arrays[kind] = samples.values[:, indices]
            factor = max(table.columns[keys[i]].factor for i in indices)
            resolution[kind] = factor * last_digit([samples.digits[i] for i in indices])
    positions = [x for x in keys if x.kind == "q"]
    position_columns = [table.columns[x] for x in positions]
    # The titles of numbered joints, the names of the others.
    joints = [table.columns[x].title if x.joint.isdigit() else x.joint for x in positions]
    unused = [
        x.title for key, x in table.columns.items() if key.kind in QUANTITIES and key not in keys
    ]
    return TrajectoryFile(
        source=table.source,
        t=samples.t,
        **arrays,
        resolution=resolution,
        joints=tuple(joints),
        prismatic=tuple(None if x.unit is None else x.linear for x in position_columns),
        left_out=(*(x for x in table.unknown if not x.lower().startswith(IGNORED)), *unused),
        notes=(*notes, *samples.notes),
        lines=samples.lines,
        findings=samples.findings,
        is_log=_is_log(table, positions),
    )


def _is_log(table: CsvTable[JointColumn], positions: Sequence[JointColumn]) -> bool:
    """Return whether positions were measured: they are beside commands, or their titles say so."""
    has_commands = any(x.role == "command" for x in table.columns)
    return positions[0].role == "measured" and (
        has_commands or MEASURED.search(table.columns[positions[0]].title) is not None
    )


def _select_columns(
    table: CsvTable[JointColumn], joint_names: Sequence[str]
) -> tuple[list[JointColumn], list[str]]:
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
                titles = [table.file_title(JointColumn("q", role, x)) for x in joints]
                raise_other_joints(table.heading, joints, joint_names, titles)
        else:
            joints = _joint_numbers(table, role)
    if len(roles) > 1:
        notes.append(
            f"{table.source} has commands and measured positions. The measured positions are read. "
            "To read the commands instead, skip the measured positions (--columns "
            f"'-={title_pattern(table.file_title(JointColumn('q', role, joints[0])))}')."
        )
    keys = [JointColumn("q", role, x) for x in joints]
    for kind in ("dq", "ddq"):
        needed = [JointColumn(kind, role, x) for x in joints]
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


def _joint_numbers(table: CsvTable[JointColumn], role: str) -> list[str]:
    """Return the numbers of the joints as texts, starting at 1, or at 0 if there is a joint 0."""
    numbers = {int(x.joint) for x in table.columns if x.role == role and x.joint.isdigit()}
    first = 0 if 0 in numbers else 1
    joints = []
    # `require_columns` raises an error at the first missing number, so that a huge number is
    # no problem.
    for k in range(first, max(numbers, default=first) + 1):
        table.require_columns(JointColumn("q", role, str(k)))
        joints.append(str(k))
    return joints


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
    rule: SetPointRule | None = None  # Limits of the set-points; None if they are unknown
    outputs: Mapping[str, Any] = field(default_factory=dict)  # As `outputs` of `Exports`
    inputs: Mapping[str, Any] = field(default_factory=dict)  # As `inputs` of `Exports`
    servoj: Mapping[str, float] = field(default_factory=dict)  # As `servoj` of `Exports`
    waits: tuple[TimedWait, ...] = ()  # Waits for inputs, with times since the start of the plan
    external: tuple[int, ...] = ()  # Indices of external axes
    servo: str = ""  # The servo that the set-points compensate, in one line

    def set_points(self, derivatives: int | None = None) -> SetPointTable:
        """Return the table of the set-points; `derivatives` as in `tabulate`."""
        stored = self._read("set_points.csv")
        if derivatives is None and self.plain:
            derivatives = 2
        samples = self._with_derivatives(stored, derivatives)
        return self._table("set_points", stored, samples, derivatives)

    def plan(self, derivatives: int | None = None) -> SetPointTable:
        """Return the table of the plan, for controllers that plan the motion between points."""
        stored = self._read("planned.csv")
        if stored.dq is None or stored.ddq is None:
            samples = sample_spline(stored.q, self.cycle)
        else:
            samples = Samples(t=stored.t, q=stored.q, dq=stored.dq, ddq=stored.ddq)
        return self._table(REFERENCE, stored, samples, derivatives)

    def _table(
        self, label: str, stored: TrajectoryFile, samples: Samples, derivatives: int | None
    ) -> SetPointTable:
        """Return the table of samples that are those of a file, with the events of the run."""
        start = float(stored.t[0])
        return tabulate(
            samples,
            name=f"{self.title} {self.name} {label}",
            cycle=self.cycle,
            events=tuple(x.shifted(-start) for x in self.events),
            waits=tuple(x.shifted(-start) for x in self.waits),
            start_time=start,
            joint_names=self.joint_names,
            prismatic=tuple(x is True for x in stored.prismatic),
            external=self.external,
            derivatives=derivatives,
            rule=None if label == REFERENCE else self.rule,
            servo="" if label == REFERENCE else self.servo,
        )

    def _with_derivatives(self, stored: TrajectoryFile, derivatives: int | None) -> Samples:
        """Set-points with the derivatives of the plan if both are equal, otherwise of a spline."""
        if not self.plain or derivatives not in (None, 2):
            return sample_spline(stored.q, self.cycle)
        plan = self._read("planned.csv")
        if plan.dq is None or plan.ddq is None or not equals_plan(stored.q, plan.q):
            return sample_spline(stored.q, self.cycle)
        dq, ddq = plan.dq.copy(), plan.ddq.copy()
        if abs(plan.t[-1] - stored.t[-1]) > SAME_TIME * self.cycle:
            # The plan ends between the last two set-points, so that the last one is at rest.
            dq[-1] = 0.0
            ddq[-1] = 0.0
        return Samples(t=regular_times(len(dq), self.cycle), q=stored.q, dq=dq, ddq=ddq)

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
            rule=SetPointRule.from_data(rule) if (rule := about.get("set_point_rule")) else None,
            outputs=dict(about.get("outputs", {})),
            inputs=dict(about.get("inputs", {})),
            servoj=dict(about.get("servoj", {})),
            waits=tuple(TimedWait(**{x: w[x] for x in WAIT_KEYS}) for w in about.get("waits", ())),
            external=tuple(data["arm"].get("external", ())),
            servo=about.get("servo") or "",
        )
    except InvalidInput:
        raise
    except (KeyError, TypeError, ValueError, AttributeError, RecursionError) as error:
        raise InvalidInput(
            f"{file} is not the summary of a run or a certificate ({type(error).__name__})."
        ) from None


def _choose_run(folder: FilePath, runs: Mapping[str, Any], name: str | None) -> str:
    """Return the name of the requested run, or of the only run."""
    names = list_some([repr(x) for x in runs], 6)
    if name is None and len(runs) == 1:
        return next(iter(runs))
    if name is None:
        raise InvalidInput(f"{folder} has the runs {names}. Choose one with --run.")
    if name not in runs:
        raise InvalidInput(f"{folder} has no run {name!r}. Its runs are {names}.")
    return name
