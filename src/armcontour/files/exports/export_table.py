"""Table of times, joint positions and events for all export formats, and its CSV file."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path as FilePath
from types import MappingProxyType
from typing import Annotated, Any

import numpy as np

from armcontour.core import checks
from armcontour.core.checks import FloatArray
from armcontour.core.errors import ArmMismatch, InvalidInput
from armcontour.core.fields import Checked, checked
from armcontour.core.pool import split_evenly
from armcontour.core.quantities import AtLeast, Axes, Interval, Quantity, joint_units
from armcontour.core.render import number
from armcontour.motion import (
    DEFAULT_CYCLE,
    LONGEST_CLOCK,
    JointPath,
    Samples,
    SetPoints,
    TimedEvent,
    TimedWait,
    Trajectory,
)
from armcontour.motion.set_point_rule import SetPointRule
from armcontour.robot import Arm

# An event that is earlier than a point by less than this fraction of the cycle is assigned to the
# point, because both times have rounding errors.
EVENT_TOLERANCE = 1e-9
# At a wait, set-points move by at most this distance in a cycle [rad or m].
AT_REST = 1e-6
# A rest at a wait lasts at least this number of cycles, so that events before and after it are at
# different points.
CYCLES_OF_WAIT = 2
# A time long before any plan, when the process is off [s].
LONG_BEFORE = -1e6
# Set-points equal the plan if they differ by at most this value [rad]; results have 12 decimals.
SAME_POSITION = 2e-12
# Maximum number of samples of a trajectory; more do not fit into memory together with the export.
MAX_SAMPLES = 20_000_000
# Decimals of results, and of set-points with command limits.
DECIMALS = 12
# Decimals of joint positions [rad] in exported texts. An error of 1e-7 rad moves a tool at 1 m by
# 0.1 um.
POSITION_DECIMALS = 7
# Decimals of joint positions [rad] if the cycle is at most FINE_CYCLE. With a cycle of FINE_CYCLE,
# 7 decimals would change accelerations, which are second differences of the positions, by up to
# 0.0125 rad/s^2, and with shorter cycles by more.
FINE_DECIMALS = 9
# Longest cycle whose joint positions are written with FINE_DECIMALS [s].
FINE_CYCLE = 0.004
# Each quantity has this number of decimals fewer than the joint positions.
FEWER_DECIMALS = {"dq": 1, "ddq": 2}
# Decimals of times [s] if all times are whole microseconds.
MICRO = 6
# Decimals of other times [s].
NANO = 9
# Number of values per formatting step; larger blocks need more memory and are not faster.
FORMAT_BLOCK = 1 << 16
# Largest number of samples whose torques are computed at once, which limits the memory.
SAMPLES_AT_ONCE = 50_000
# Name of the exported plan, without compensation.
REFERENCE = "reference"
# Units of the quantities of revolute joints.
UNITS = {"q": "rad", "dq": "rad/s", "ddq": "rad/s^2", "torque": "N m"}
# Attributes of events in JSON; `event_data` adds `point`.
EVENT_KEYS = ("name", "value", "t", "due", "s")
# Attributes of waits in JSON.
WAIT_KEYS = ("input", "within", "at", "t", "rest")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SetPointTable(Checked):
    """Joint positions over time, with events.

    Args:
        name: Name of the program, one line of text.
        origin: When and of what the table was made, one line of text for a comment; empty: none.
        servo: The servo that the set-points compensate, one line of text; empty: none.
        between: How far a controller that plans the motion between the points may leave the path,
            one line of text; empty: unknown, or the controller follows the times of the points.
        joint_names: Names of the joints.
        prismatic: Whether each joint is prismatic, with m instead of rad; by default none is.
        external: Indices of external axes; by default of the prismatic joints.
        cycle: Time between points [s]; the last interval may be shorter.
        t: Times of the points [s], (n,); the first one is 0.
        q: Joint positions [rad], (n, dof).
        dq, ddq: Joint velocities [rad/s] and accelerations [rad/s²]; None if they are not written.
        events: Events in the order of their times, which count from the first point too.
        start_time: Time of the first point in the plan [s], where the plan starts at 0.
        waits: Waits for inputs, in the order of their times, which count from the first point.
        analog: Values of analog outputs by their names, (n,) each.
        analog_off: Their values while the process is off, by name; 0 by default.
        rule: Limits of the joint positions as set-points; None for a plan.

    Raises:
        InvalidInput: An array has a wrong shape, the times do not increase, a name is not one line
            of text, or an event is before the first point.
    """

    name: str
    joint_names: Annotated[tuple[str, ...], Axes("joints")]
    cycle: Interval
    t: Annotated[FloatArray, Quantity(""), Axes("n")]
    q: Annotated[FloatArray, Quantity(""), Axes("n", "joints")]
    dq: Annotated[FloatArray, Quantity(""), Axes("n", "joints")] | None = None
    ddq: Annotated[FloatArray, Quantity(""), Axes("n", "joints")] | None = None
    events: tuple[TimedEvent, ...] = ()
    start_time: float = 0.0
    waits: tuple[TimedWait, ...] = ()
    analog: Mapping[str, FloatArray] = field(default_factory=dict)
    analog_off: Mapping[str, float] = field(default_factory=dict)
    rule: SetPointRule | None = None
    prismatic: tuple[bool, ...] = ()
    external: tuple[int, ...] = ()
    origin: str = ""
    servo: str = ""
    between: str = ""

    def _check_together(self) -> None:
        """Complete the defaults, and check that the fields fit together."""
        object.__setattr__(self, "prismatic", self.prismatic or (False,) * self.dof)
        sliding = tuple(np.flatnonzero(self.prismatic).tolist())
        object.__setattr__(self, "external", self.external or sliding)
        analog = {
            key: checks.freeze(checks.check_numbers(f"analog output {key} of {self.name!r}", x))
            for key, x in self.analog.items()
        }
        object.__setattr__(self, "analog", MappingProxyType(analog))
        off = {key: float(self.analog_off.get(key, 0.0)) for key in analog}
        object.__setattr__(self, "analog_off", MappingProxyType(off))
        self._check_shapes()
        self._check_names()
        events = tuple(sorted((_with_builtin_types(x) for x in self.events), key=lambda x: x.t))
        object.__setattr__(self, "events", events)
        if events and events[0].t < -EVENT_TOLERANCE * self.cycle:
            raise InvalidInput(
                f"The event {events[0].name} is {-events[0].t:g} s before the first set-point. "
                "Shorten its time advance, or start the program with a dwell.",
                t=events[0].t,
                allowed=0.0,
            )

    def _check_shapes(self) -> None:
        """Check that the shapes of arrays match, and that times start at zero and increase."""
        n = len(self.t)
        for key, values in self.analog.items():
            if values.shape != (n,):
                raise InvalidInput(
                    f"The analog output {key} of {self.name!r} has shape {values.shape}, but must "
                    f"have {(n,)}."
                )
        if n == 0 or self.t[0] != 0 or not (np.diff(self.t) > 0).all():
            raise InvalidInput(f"The times of {self.name!r} must start at zero and increase.")

    def _check_names(self) -> None:
        """Check that names are one line of text, and that joint names differ."""
        named = [("name", self.name), *(("joint name", x) for x in self.joint_names)]
        named += [("name of an analog output", x) for x in self.analog]
        named += [("name of an input", x.input) for x in self.waits]
        for kind, text in [*named, *(("name of an event", x.name) for x in self.events)]:
            if not isinstance(text, str) or not text.strip() or not text.isprintable():
                raise InvalidInput(f"A {kind} must be one line of text, but is {text!r}.")
            if kind != "name":
                # The name of the table is by default that of a file, which may be longer.
                checks.check_name(kind, text)
        for kind, text in (
            ("origin", self.origin),
            ("servo", self.servo),
            ("between", self.between),
        ):
            if not isinstance(text, str) or not text.isprintable():
                raise InvalidInput(f"The {kind} must be one line of text, but is {text!r}.")
        repeated = {x for x in self.joint_names if self.joint_names.count(x) > 1}
        if repeated:
            raise InvalidInput(f"Joint names must be unique, but {min(repeated)!r} is repeated.")

    @property
    def dof(self) -> int:
        """Number of joints."""
        return len(self.joint_names)

    @property
    def duration(self) -> float:
        """Time from the first point to the last [s]."""
        return float(self.t[-1])

    @property
    def point_of_events(self) -> list[int]:
        """Index of the last point at or before each event, as a list."""
        late = np.array([x.t for x in self.events]) + EVENT_TOLERANCE * self.cycle
        indices = np.searchsorted(self.t, late, side="right") - 1
        return [max(0, int(i)) for i in indices]

    @property
    def point_of_waits(self) -> list[int]:
        """Index of the point at which a program waits for each input, as a list.

        Raises:
            InvalidInput: A rest is shorter than two cycles, or the set-points do not rest there.
        """
        indices = list[int]()
        for wait in self.waits:
            if wait.rest < CYCLES_OF_WAIT * self.cycle * (1 - EVENT_TOLERANCE):
                raise InvalidInput(
                    f"The rest at the wait for {wait.input} is {number(wait.rest, 's')}, but "
                    f"points every {number(self.cycle, 's')} require at least "
                    f"{number(CYCLES_OF_WAIT * self.cycle, 's')}. Set rest in process.wait, or "
                    "shorten the cycle.",
                    needed=CYCLES_OF_WAIT * self.cycle,
                    allowed=wait.rest,
                )
            k = int(np.searchsorted(self.t, wait.t - EVENT_TOLERANCE * self.cycle))
            following = min(k + 1, len(self.t) - 1)
            moved = float(np.abs(self.q[following] - self.q[k]).max())
            if moved > AT_REST:
                raise InvalidInput(
                    f"At the wait for {wait.input}, the set-points do not rest: within one cycle, "
                    f"a joint moves by {moved:.3g} rad. The servo's time advance or transient is "
                    f"longer than the rest of {number(wait.rest, 's')}. Increase rest in "
                    "process.wait.",
                    needed=moved,
                    allowed=AT_REST,
                )
            indices.append(k)
        return indices

    @property
    def decimals(self) -> int:
        """Number of decimals of joint positions [rad] in texts."""
        if self.rule is not None:
            # With fewer decimals, rounded set-points can exceed their limits.
            return DECIMALS
        return POSITION_DECIMALS if self.cycle > FINE_CYCLE * (1 + 1e-9) else FINE_DECIMALS


@checked
def make_table(
    data: SetPoints | Trajectory,
    *,
    name: str,
    arm: Arm | None = None,
    joint_names: Sequence[str] | None = None,
    cycle: Interval | None = None,
    derivatives: Annotated[int, AtLeast(0, 2)] | None = None,
    analog: Mapping[str, Callable[[FloatArray], FloatArray]] | None = None,
    origin: str = "",
) -> SetPointTable:
    """Create the table of set-points or of a sampled trajectory; the first point has time 0.

    Velocities and accelerations of a trajectory are its derivatives; at a jump, the value after the
    jump. Set-points that equal their plan have the derivatives of the plan if accelerations are
    written. Other set-points have the derivatives of the clamped cubic spline through them. The
    spline is at rest at both ends. A controller follows this spline both with cubic interpolation
    (positions and velocities) and with quintic interpolation (also accelerations).

    Args:
        data: The set-points or the trajectory.
        name: Name of the program.
        arm: The arm, which gives the joint names; by default that of the plan.
        joint_names: Joint names instead of the arm's; "joint 1", "joint 2", ... without an arm.
        cycle: Sampling cycle of a trajectory [s], 4 ms by default; set-points have their own.
        derivatives: 2, 1 for positions and velocities only, or 0 for positions only; by default 2,
            but 0 for set-points that differ from their plan and have limits of the user or a
            controller, which are limits of their differences.
        analog: Analog outputs by their names: functions from times of the plan [s], (n,), to
            values, as `armcontour.jobs.analog_outputs` gives them.
        origin: When and of what the table is made, for a comment of the file; empty: none.
    """
    if isinstance(data, SetPoints):
        if derivatives is None and equals_plan(data.q, data.trajectory.with_rests(data.t)):
            derivatives = 2
        samples = _sample_set_points(data, cycle, derivatives)
        step = data.cycle
        start = data.start_time
        plan = data.trajectory
    else:
        step = _sampling_cycle(data, name, cycle)
        samples = data.sample(step)
        start = 0.0
        plan = data
    if arm is None and plan.arm is not None and plan.arm.dof == samples.q.shape[1]:
        arm = plan.arm
    return tabulate(
        samples,
        name=name,
        origin=origin,
        cycle=step,
        events=tuple(x.shifted(-start) for x in plan.events),
        waits=tuple(x.shifted(-start) for x in plan.waits),
        start_time=start,
        arm=arm,
        joint_names=joint_names,
        derivatives=derivatives,
        analog={key: values(samples.t + start) for key, values in (analog or {}).items()},
        analog_off=_values_off(analog or {}) if plan.waits else {},
        rule=data.rule if isinstance(data, SetPoints) else None,
        servo=data.servo_text if isinstance(data, SetPoints) else "",
    )


def _values_off(analog: Mapping[str, Callable[[FloatArray], FloatArray]]) -> dict[str, float]:
    """Return the value of each analog output while the process is off, by name."""
    return {key: float(values(np.array([LONG_BEFORE]))[0]) for key, values in analog.items()}


def tabulate(
    samples: Samples,
    *,
    arm: Arm | None = None,
    joint_names: Sequence[str] | None = None,
    derivatives: int | None = None,
    **about: Any,
) -> SetPointTable:
    """Create the table of samples; `about` are further fields of `SetPointTable`."""
    name = about["name"]
    dof = samples.q.shape[1]
    if derivatives is None:
        # The derivatives of a curve through set-points can exceed limits of their differences.
        rule = about.get("rule")
        derivatives = 0 if rule is not None and rule.has_own_limits else 2
    if arm is not None and arm.dof != dof:
        raise ArmMismatch(
            f"The arm {arm.name} has {arm.dof} joints, but the motion of {name!r} has {dof}."
        )
    if joint_names is None:
        joint_names = arm.joint_names if arm else [f"joint {i}" for i in range(1, dof + 1)]
    if arm is not None:
        about |= {"prismatic": arm.chain.prismatic, "external": arm.chain.external}
    return SetPointTable(
        joint_names=joint_names,  # type: ignore[arg-type]  # converted by the field
        t=samples.t,
        q=samples.q,
        dq=samples.dq if derivatives > 0 else None,
        ddq=samples.ddq if derivatives > 1 else None,
        **about,
    )


def _sampling_cycle(trajectory: Trajectory, name: str, cycle: float | None) -> float:
    """Return the sampling cycle of a trajectory [s], checked against its duration."""
    step = cycle or DEFAULT_CYCLE
    duration = trajectory.duration
    # Up to LONGEST_CLOCK, a cycle is always valid.
    if step > max(duration, LONGEST_CLOCK):
        raise InvalidInput(
            f"The cycle of {step:g} s is longer than the motion of {name!r}, which takes "
            f"{duration:.6g} s. Specify a shorter cycle.",
            needed=step,
            allowed=duration,
        )
    if trajectory.duration > MAX_SAMPLES * step:
        raise InvalidInput(
            f"{name!r} takes {trajectory.duration:.6g} s. With a cycle of {step:g} s, it would "
            f"have more than {MAX_SAMPLES} samples. Specify a longer cycle.",
            needed=trajectory.duration / step,
            allowed=float(MAX_SAMPLES),
        )
    return step


def _sample_set_points(
    set_points: SetPoints, cycle: float | None, derivatives: int | None
) -> Samples:
    """Return the set-points with their derivatives, as documented in `make_table`."""
    requested = cycle or set_points.cycle
    if not math.isclose(requested, set_points.cycle, rel_tol=1e-9):
        raise InvalidInput(
            f"The set-points have a cycle of {set_points.cycle:g} s and cannot be exported with a "
            f"cycle of {requested:g} s. Remove the cycle, or compute set-points with this cycle.",
            needed=requested,
            allowed=set_points.cycle,
        )
    plan = set_points.trajectory
    t = set_points.t
    if derivatives in (None, 2) and equals_plan(set_points.q, plan.with_rests(t)):
        dq, ddq = plan.with_rests(t, 1), plan.with_rests(t, 2)
        for values in (dq, ddq):
            values.setflags(write=False)
        return Samples(t=regular_times(len(t), set_points.cycle), q=set_points.q, dq=dq, ddq=ddq)
    return sample_spline(set_points.q, set_points.cycle)


def equals_plan(q: FloatArray, plan: FloatArray) -> bool:
    """Return whether set-points equal the plan at the same times, (n, dof) each, up to rounding."""
    return q.shape == plan.shape and bool((np.abs(q - plan) <= SAME_POSITION).all())


def regular_times(count: int, cycle: float) -> FloatArray:
    """Return the times at multiples of `cycle`, starting at 0 [s], (count,)."""
    return np.asarray(np.arange(count) * cycle, dtype=np.float64)


def sample_spline(q: FloatArray, cycle: float) -> Samples:
    """Samples of set-points with the derivatives of the clamped cubic spline through them."""
    t = regular_times(len(q), cycle)
    dq = np.zeros_like(q)
    ddq = np.zeros_like(q)
    # One joint at once, because a long motion has gigabytes of set-points.
    for j in range(q.shape[1] if len(q) > 1 else 0):
        spline = JointPath.spline(q[:, j : j + 1], t, ends="clamped")
        first, second, third = spline.coefficients[:, 1:4, 0].T
        width = np.diff(t)
        # Coefficients are of powers of the fraction of an interval.
        dq[1:-1, j] = first[1:] / width[1:]
        ddq[:-1, j] = 2 * second / width**2
        ddq[-1, j] = (2 * second[-1] + 6 * third[-1]) / width[-1] ** 2
    for values in (dq, ddq):
        # Samples copies writable arrays.
        values.setflags(write=False)
    return Samples(t=t, q=q, dq=dq, ddq=ddq)


def _with_builtin_types(event: TimedEvent) -> TimedEvent:
    """Copy of an event with built-in Python types, which all formats can write."""
    value = event.value.item() if isinstance(event.value, np.generic) else event.value
    if isinstance(value, float) and not math.isfinite(value):
        raise InvalidInput(
            f"The value of the event {event.name} must be a finite number, but is {value}."
        )
    return TimedEvent(
        name=str(event.name),
        value=value,
        t=checks.check_number(f"time of the event {event.name}", event.t, "s"),
        due=float(event.due),
        s=float(event.s),
        point=tuple(float(x) for x in event.point),
    )


def joint_columns(
    t: FloatArray,
    joint_names: Sequence[str],
    prismatic: Sequence[bool] | None = None,
    **quantities: FloatArray | None,
) -> tuple[list[str], list[FloatArray]]:
    """Titles (`t [s]`, `q 1 [rad]`, ...) and columns of times and quantities that are not None."""
    # Titles contain the names of the joints, without "joint " if the shortened names are unique.
    # The readers of joint files recognize these titles.
    called = [x.removeprefix("joint ") for x in joint_names]
    if len(set(called)) < len(called):
        called = list(joint_names)
    header = ["t [s]"]
    columns = [t]
    slides = prismatic or (False,) * len(called)
    for quantity, values in quantities.items():
        if values is not None:
            units = joint_units(UNITS[quantity], slides)
            header += [f"{quantity} {x} [{unit}]" for x, unit in zip(called, units, strict=True)]
            columns.append(values)
    return header, columns


def csv_pieces(
    header: Sequence[str],
    columns: Sequence[FloatArray],
    cells: Mapping[int, str] | None = None,
    decimals: Sequence[int] | None = None,
) -> Iterator[str]:
    """Yield columns as CSV text in blocks of rows; `cells` is an additional last column.

    Args:
        header: Titles of the columns.
        columns: Arrays, (n,) or (n, columns).
        cells: Texts of the last column by row.
        decimals: Decimals of each array; 12 by default.
    """
    yield _csv_line(header)
    places = decimals or [DECIMALS] * len(columns)
    row = ",".join(
        fixed_form(place, 1 if x.ndim == 1 else x.shape[1], ",")
        for x, place in zip(columns, places, strict=True)
    )
    lines = {k: row + _csv_line(["", x]).replace("%", "%%") for k, x in (cells or {}).items()}
    yield from format_rows(row + ("\n" if cells is None else ",\n"), *columns, lines=lines)


def fixed_form(decimals: int, count: int = 1, separator: str = ", ") -> str:
    """Return the format string (%) of `count` numbers with a fixed number of decimals."""
    return separator.join([f"%.{decimals}f"] * count)


def time_decimals(t: FloatArray) -> int:
    """Return the number of decimals of times [s]: 6 if all are whole microseconds, otherwise 9."""
    return MICRO if bool((np.abs(t - np.round(t, MICRO)) < 1e-10).all()) else NANO


def _csv_line(cells: Sequence[str]) -> str:
    """One line of CSV with its line end; cells with commas or quotes are quoted."""
    line = io.StringIO()
    csv.writer(line, lineterminator="\n").writerow(cells)
    return line.getvalue()


def format_rows(
    row: str, *columns: FloatArray, lines: Mapping[int, str] | None = None
) -> Iterator[str]:
    """Yield rows as text in blocks; `row` is the % format, and `lines` has exceptions by row."""
    at_once = max(1, FORMAT_BLOCK // max(1, row.count("%")))
    for i in range(0, len(columns[0]), at_once):
        values = np.column_stack([x[i : i + at_once] for x in columns])
        rows = range(i, i + len(values))
        form = "".join(lines.get(k, row) for k in rows) if lines else row * len(values)
        yield form % tuple(values.ravel().tolist())


def write_pieces(file: FilePath, pieces: Iterable[str]) -> None:
    """Write pieces of text to a file in their order."""
    with file.open("w", encoding="utf-8", newline="\n") as stream:
        stream.writelines(pieces)


def event_data(event: TimedEvent) -> dict[str, Any]:
    """Return the data of an event as a dictionary for JSON, in SI units."""
    return {x: getattr(event, x) for x in EVENT_KEYS} | {"point": list(event.point)}


def write_csv(table: SetPointTable, file: FilePath) -> None:
    """Write a table as CSV: t, quantities of the joints, analog outputs, and events."""
    # The titles of analog outputs are such as `analog power`. An event is in the row of the last
    # point at or before the event, with its exact time: `tool=on@0.104000; gas=2.5@0.104500`.
    quantities = {x: getattr(table, x) for x in ("q", "dq", "ddq")}
    header, columns = joint_columns(table.t, table.joint_names, table.prismatic, **quantities)
    fewer = [FEWER_DECIMALS.get(x, 0) for x, values in quantities.items() if values is not None]
    places = [time_decimals(table.t)]
    places += [table.decimals - n for n in fewer]
    for name, values in table.analog.items():
        header.append(f"analog {name}")
        columns.append(values)
        places.append(table.decimals)
    cells = None
    if table.events:
        cells = _event_cells(table)
        header.append("events")
    write_pieces(file, csv_pieces(header, columns, cells, places))


def _event_cells(table: SetPointTable) -> dict[int, str]:
    """Return the texts of the events in the `events` column, by the index of the row."""
    cells: dict[int, str] = {}
    for event, i in zip(table.events, table.point_of_events, strict=True):
        text = f"{event.text}@{event.t:.{time_decimals(np.array(event.t))}f}"
        cells[i] = f"{cells[i]}; {text}" if i in cells else text
    return cells


def write_set_points(file: FilePath, set_points: SetPoints, joint_names: Sequence[str]) -> None:
    """Write set-points as CSV: t, then q of each joint."""
    write_pieces(file, set_point_pieces(set_points, joint_names))


def set_point_pieces(set_points: SetPoints, joint_names: Sequence[str]) -> Iterator[str]:
    """Yield the CSV text of set-points in blocks of rows."""
    arm = set_points.trajectory.arm
    prismatic = None if arm is None else arm.chain.prismatic
    return csv_pieces(*joint_columns(set_points.t, joint_names, prismatic, q=set_points.q))


def write_planned(
    file: FilePath,
    samples: Samples,
    joint_names: Sequence[str] = (),
    prismatic: Sequence[bool] | None = None,
) -> None:
    """Write the realizable trajectory as CSV: t, then q, dq and ddq of every joint.

    Args:
        file: The file.
        samples: Samples of the trajectory; the last row is the end.
        joint_names: Names of the joints; numbers by default.
        prismatic: As in `SetPointTable`.
    """
    names = joint_names or [f"joint {j + 1}" for j in range(samples.q.shape[1])]
    rates = {"q": samples.q, "dq": samples.dq, "ddq": samples.ddq}
    write_pieces(file, csv_pieces(*joint_columns(samples.t, names, prismatic, **rates)))


def write_torque(file: FilePath, samples: Samples, arm: Arm) -> None:
    """Write torques of the realizable trajectory as CSV: t, then the torque of every drive.

    Args:
        file: The file.
        samples: Samples of the trajectory; the last row is the end.
        arm: The arm, with bodies.
    """
    count = len(samples.t)
    torque = np.empty_like(samples.q)
    for group in split_evenly(count, -(-count // SAMPLES_AT_ONCE)):
        torque[group] = arm.torque(samples.q[group], samples.dq[group], samples.ddq[group])
    titled = joint_columns(samples.t, arm.joint_names, arm.chain.prismatic, torque=torque)
    write_pieces(file, csv_pieces(*titled))
