"""What a robot is to be given, as one table: times, joints, events."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from armcontour import _checks
from armcontour._checks import FloatArray, IntArray
from armcontour.arms import Arm
from armcontour.errors import InvalidInput
from armcontour.motion import Samples, TaughtData, TimedEvent, Trajectory

# An event belongs to a point if it is due before it by less than this part of an interval: times
# are sums and multiples, with rounding in the last digits.
ON_THE_POINT = 1e-9
# More samples of a trajectory than this do not fit in memory beside what is made of them.
MOST_SAMPLES = 20_000_000


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Table:
    """Points of the joints over time, with what is switched on the way.

    Args:
        name: What it is called; one line of text.
        joint_names: One per joint.
        period: Time between points; the last one may come earlier [s].
        t: Times from the first point on, which is at 0 [s], (n,).
        q: Joint positions [rad], (n, dof).
        dq, ddq: Their velocities [rad/s] and accelerations [rad/s²]; None: not to be written.
        events: By their times, which count from the first point too.
        tool: Tool points [m], (n, 2) or (n, 3).
        start_time: Time of the first point on the clock of the plan, which begins at 0 [s].

    Raises:
        InvalidInput: Arrays of another shape, times that do not increase, names that are not one
            line of text, or an event before the first point.
    """

    name: str
    joint_names: tuple[str, ...]
    period: float
    t: FloatArray
    q: FloatArray
    dq: FloatArray | None = None
    ddq: FloatArray | None = None
    events: tuple[TimedEvent, ...] = ()
    tool: FloatArray | None = None
    start_time: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "joint_names", tuple(str(x) for x in self.joint_names))
        for name in ("t", "q", "dq", "ddq", "tool"):
            if getattr(self, name) is not None:
                values = _checks.numbers(f"{name} of {self.name!r}", getattr(self, name))
                object.__setattr__(self, name, _checks.lock_floats(values))
        _checks.positive("period", self.period, "s")
        self._check_shapes()
        self._check_names()
        events = tuple(sorted((_clean(x) for x in self.events), key=lambda x: x.t))
        object.__setattr__(self, "events", events)
        if events and events[0].t < -ON_THE_POINT * self.period:
            raise InvalidInput(
                f"The event {events[0].name} is to come {-events[0].t:g} s before the first "
                "set-point: shorten its lead, or let the program begin with a dwell.",
                t=events[0].t,
                allowed=0.0,
            )

    def _check_shapes(self) -> None:
        if self.t.ndim != 1:
            raise InvalidInput(f"t of {self.name!r} must be a list of times.")
        n, dof = len(self.t), len(self.joint_names)
        if self.q.ndim == 2 and self.q.shape[1] != dof:
            raise InvalidInput(
                f"{self.name} has {self.q.shape[1]} joints, but {dof} joint names are given."
            )
        shapes = {"q": (n, dof), "dq": (n, dof), "ddq": (n, dof)}
        for name, shape in shapes.items():
            values = getattr(self, name)
            if values is not None and values.shape != shape:
                raise InvalidInput(
                    f"{name} of {self.name!r} has shape {values.shape}, but must have {shape}."
                )
        if self.tool is not None and self.tool.shape not in ((n, 2), (n, 3)):
            raise InvalidInput(
                f"tool of {self.name!r} has shape {self.tool.shape}, but must have {(n, 3)}."
            )
        if n == 0 or self.t[0] != 0 or not (np.diff(self.t) > 0).all():
            raise InvalidInput(f"The times of {self.name!r} must start at zero and increase.")

    def _check_names(self) -> None:
        given = [("name", self.name), *(("joint name", x) for x in self.joint_names)]
        for what, text in [*given, *(("name of an event", x.name) for x in self.events)]:
            if not text.strip() or not text.isprintable():
                raise InvalidInput(f"A {what} must be one line of text, but is {text!r}.")
            if what != "name":
                # The name is that of a file by default, which may be longer.
                _checks.check_name(what, text)
        twice = {x for x in self.joint_names if self.joint_names.count(x) > 1}
        if twice:
            raise InvalidInput(f"Joint names must differ, but {min(twice)!r} is there twice.")

    @property
    def dof(self) -> int:
        """Number of joints."""
        return len(self.joint_names)

    @property
    def duration(self) -> float:
        """Time from the first point to the last [s]."""
        return float(self.t[-1])

    @property
    def nanoseconds(self) -> IntArray:
        """Times in whole nanoseconds, (n,).

        Raises:
            InvalidInput: Points nearer to each other than that.
        """
        rounded = np.rint(self.t * 1e9).astype(np.intp)
        if not (np.diff(rounded) > 0).all():
            raise InvalidInput(f"Points of {self.name!r} are less than a nanosecond apart.")
        return rounded

    @property
    def point_of_events(self) -> list[int]:
        """Index of the last point at or before each event."""
        times = np.array([x.t for x in self.events]) + ON_THE_POINT * self.period
        found = np.searchsorted(self.t, times, side="right") - 1
        return [int(i) for i in found]


def make_table(
    data: TaughtData | Trajectory,
    *,
    name: str,
    arm: Arm | None = None,
    joint_names: Sequence[str] | None = None,
    period: float | None = None,
    derivatives: int = 2,
) -> Table:
    """Taught data or a trajectory as a table whose time counts from the first point.

    A trajectory is sampled, and its velocities and accelerations are its own; where they jump,
    those after the jump. Those of set-points are of the clamped cubic spline through them: at rest
    at both ends, and the same curve whether a controller joins points by cubics from positions and
    velocities, or by quintics from accelerations too.

    Args:
        data: What is to be written.
        name: What it is called.
        arm: Gives joint names and tool points.
        joint_names: Other names than the arm's; "joint 1", "joint 2", ... without an arm.
        period: Time between samples of a trajectory [s]; taught data has its own.
        derivatives: 2, 1 for positions and velocities only, or 0 for positions only.

    Raises:
        InvalidInput: No period for a trajectory, another one than taught data has, a wrong number
            of joints or names; as `Table`.
    """
    _checks.whole("derivatives", derivatives, 0, 2)
    if not isinstance(data, TaughtData | Trajectory):
        raise InvalidInput(
            f"Only taught data and trajectories can be exported, not a {type(data).__name__}."
        )
    if isinstance(data, TaughtData):
        samples, step = _set_points(data, period), data.period
        start, events = data.start_time, data.trajectory.events
    else:
        if period is None:
            raise InvalidInput("A trajectory is exported every so often: give a period [s].")
        step = _checks.positive("period", period, "s")
        if data.duration > MOST_SAMPLES * step:
            raise InvalidInput(
                f"{name!r} takes {data.duration:.6g} s, which every {step:g} s are more than the "
                f"{MOST_SAMPLES} samples that are written: give a longer period.",
                needed=data.duration / step,
                allowed=float(MOST_SAMPLES),
            )
        samples, start, events = data.sample(step), 0.0, data.events
    dof = samples.q.shape[1]
    if arm is not None and arm.dof != dof:
        raise InvalidInput(f"The arm {arm.name} has {arm.dof} joints, but {name!r} has {dof}.")
    numbered = tuple(f"joint {i}" for i in range(1, dof + 1))
    if isinstance(joint_names, str) or not isinstance(joint_names, Iterable | None):
        raise InvalidInput(f"joint_names must be a list of {dof} names, not {joint_names!r}.")
    names = joint_names if joint_names is not None else arm.joint_names if arm else numbered
    return Table(
        name=name,
        joint_names=tuple(names),
        period=step,
        t=samples.t,
        q=samples.q,
        dq=samples.dq if derivatives > 0 else None,
        ddq=samples.ddq if derivatives > 1 else None,
        events=tuple(_shift_event(x, -start) for x in events),
        tool=None if arm is None else arm.forward(samples.q),
        start_time=start,
    )


def _set_points(taught: TaughtData, period: float | None) -> Samples:
    """Set-points with the derivatives of the spline through them."""
    wanted = taught.period if period is None else _checks.positive("period", period, "s")
    if not math.isclose(wanted, taught.period, rel_tol=1e-9):
        raise InvalidInput(
            f"Taught data has its own interval of {taught.period:g} s and cannot be exported every "
            f"{wanted:g} s: leave the period out, or compensate for that interval.",
            needed=wanted,
            allowed=taught.period,
        )
    q = taught.q
    t = np.asarray(np.arange(len(q)) * taught.period, dtype=np.float64)
    if len(q) == 1:
        return Samples(t=t, q=q, dq=np.zeros_like(q), ddq=np.zeros_like(q))
    from scipy.interpolate import CubicSpline

    spline = CubicSpline(t, q, bc_type="clamped")
    dq = spline(t, 1)
    # At rest to the last bit: controllers refuse a motion that does not end so.
    dq[[0, -1]] = 0.0
    return Samples(t=t, q=q, dq=dq, ddq=spline(t, 2))


def _shift_event(event: TimedEvent, by: float) -> TimedEvent:
    return dataclasses.replace(event, t=event.t + by, due=event.due + by) if by else event


def _clean(event: TimedEvent) -> TimedEvent:
    """The event with Python's own types, which is what every format can write."""
    value = event.value.item() if isinstance(event.value, np.generic) else event.value
    if isinstance(value, float) and not math.isfinite(value):
        raise InvalidInput(f"The event {event.name} is to switch to {value}, which is no number.")
    return TimedEvent(
        name=str(event.name),
        value=value,
        t=_checks.number(f"time of the event {event.name}", event.t, "s"),
        due=float(event.due),
        s=float(event.s),
        point=tuple(float(x) for x in event.point),
    )
