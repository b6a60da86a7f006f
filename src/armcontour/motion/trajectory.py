"""Trajectory: joint positions over time, made of one time law after another."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from enum import StrEnum
from itertools import accumulate
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from armcontour.core import checks, pictures
from armcontour.core.checks import FloatArray, Frozen, IntArray
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import Checked, checked, declared
from armcontour.core.lazy import load_method
from armcontour.core.quantities import Interval, SpeedFactor
from armcontour.core.render import number
from armcontour.core.text import count_noun, short_repr
from armcontour.geometry import Path
from armcontour.motion.joined_laws import JoinedLaws
from armcontour.motion.laws import Law, LawAlongPath, PathLaw
from armcontour.robot import Arm, Limits, load_named

# Default cycle [s].
DEFAULT_CYCLE = 4e-3
# Largest number of times that are computed together, which limits the memory.
TIMES_AT_ONCE = 50_000
# Largest number of laws that are evaluated together, which limits the memory of their copies.
LAWS_AT_ONCE = 500
# A set-point may exceed a limit by this fraction of the limit, or by this much [rad, rad/s], due to
# rounding errors.
COMMAND_SLACK = 1e-9
# A sample that is nearer to the end of the motion than this fraction of a cycle is left out.
SAME_SAMPLE = 1e-9
# Along one path, the end of a law and the start of the next differ by less than this [m].
SAME_ARC_LENGTH = 1e-9


class Method(StrEnum):
    """Names of the planning methods."""

    OPTIMAL = "optimal"
    PAPER = "paper"
    CONVENTIONAL = "conventional"
    SHAPED = "shaped"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LawPhase(Frozen):
    """A part of a trajectory that was planned by one rule.

    Args:
        name: Name of this part of the path, such as "line 1" or "corner 2".
        kind: The rule: "MAC", "AVC", "MDC", "corner" or "uniform".
        t: Times of start and end [s].
        s: Arc lengths of start and end [m].
        demand: Largest acceleration of each joint [rad/s²], (dof,).
        speed: Largest tool speed [m/s].
    """

    name: str
    kind: str
    t: tuple[float, float]
    s: tuple[float, float]
    demand: FloatArray
    speed: float

    def stretched(self, speed_factor: float) -> LawPhase:
        """Return the same part of a motion at the fraction `speed_factor` of its speed."""
        return replace(
            self,
            t=(self.t[0] / speed_factor, self.t[1] / speed_factor),
            demand=self.demand * speed_factor**2,
            speed=self.speed * speed_factor,
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Span:
    """The part of a program's trajectory that belongs to one move.

    Args:
        move: Index of the move in the program; None for a rapid to the next move, or a pause before
            it.
        kind: "contour", "rapid" or "dwell".
        name: Name of the contour; may be empty.
        t: Times of start and end [s].
        s: Arc lengths of start and end, over all contours of the program [m].
        work: For a contour, times at which the process is switched on and off [s]; otherwise None.
        trajectory: Trajectory of the move, from time 0; None if the tool is at rest.
    """

    move: int | None
    kind: str
    t: tuple[float, float]
    name: str = ""
    s: tuple[float, float] = (0.0, 0.0)
    work: tuple[float, float] | None = None
    trajectory: Trajectory | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class TimedEvent:
    """An output that is switched at a time of a trajectory.

    Args:
        name: Name of the output.
        value: New value of the output.
        t: Switching time, with the event's time advance [s].
        due: Time at which the tool is at the event's position [s].
        s: Arc length of the event, over all contours of the program [m].
        point: Position of the event [m], 2 or 3 coordinates.
    """

    name: str
    value: bool | float | str
    t: float
    due: float
    s: float
    point: tuple[float, ...]

    @property
    def text(self) -> str:
        """The event without its time, such as `tool=on`; a text value is quoted."""
        plain = all(x.isalnum() or x in "_-. " for x in self.name)
        name = self.name if plain else json.dumps(self.name)
        value = json.dumps(self.value)
        if isinstance(self.value, bool):
            value = "on" if self.value else "off"
        return f"{name}={value}"

    def shifted(self, by: float) -> TimedEvent:
        """Return the event delayed by a time [s]."""
        return replace(self, t=self.t + by, due=self.due + by) if by else self


@dataclass(frozen=True, slots=True, kw_only=True)
class TimedWait:
    """A wait for an input of the robot, at a rest of a trajectory that does not contain its time.

    Args:
        input: Name of the input.
        within: Longest time that the robot waits [s].
        at: "start" with the process off, or "switched_on" right after it is switched on.
        t: Time at which the rest begins [s].
        rest: Duration of the rest [s].
    """

    input: str
    within: float
    at: str
    t: float
    rest: float

    def shifted(self, by: float) -> TimedWait:
        """Return the wait delayed by a time [s]."""
        return replace(self, t=self.t + by) if by else self


class LawGroup(NamedTuple):
    """Times whose laws are evaluated together.

    Args:
        laws: Indices of the laws, increasing; one law, or several path laws.
        indices: Where the times are among all requested ones, (m,).
        number: Position of each time's law among `laws`, (m,).
    """

    laws: list[int]
    indices: IntArray
    number: IntArray


class TimesOfLaw(NamedTuple):
    """The requested arc lengths that belong to one law of a trajectory.

    Args:
        law: Index of the law.
        indices: Where they are among all requested ones, (m,).
        intervals: Their intervals of the law, (m,).
        t: Their times since the start of the law [s], (m,).
    """

    law: int
    indices: IntArray
    intervals: IntArray
    t: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Samples(Frozen):
    """A trajectory sampled at regular times.

    Args:
        t: Times [s], (n,).
        q, dq, ddq: Joint positions, velocities and accelerations, (n, dof).
    """

    t: FloatArray
    q: FloatArray
    dq: FloatArray
    ddq: FloatArray

    __repr__ = short_repr


@declared(eq=False, repr=False)
class Trajectory(Checked):
    """Joint positions over time, made of consecutive time laws; derivatives can jump at breaks.

    >>> q, dq = planned(0.1), planned(0.1, 1)
    >>> planned.sample(0.01).q.shape[1]
    2

    Args:
        laws: The time laws in order.
        method: Name of the planning method; a `Method` if it is one of these.
        path: The tool path that the trajectory follows; None without one.
        stretches: Parts of the trajectory by the rule that planned them, in order; empty for
            methods without such rules.
        spans: Parts of the trajectory by the moves of the program, in order; empty for a single
            path.
        events: Outputs that are switched during the motion, by time; empty by default.
        waits: Waits for inputs of the robot, by time; empty by default.
        limits: Limits with which the trajectory was planned, without the reserve; None if it was
            not planned with limits.
        reserve: Fraction of the joint acceleration and torque limits reserved for the servo.
        arm: The arm for which the trajectory was planned; None if unknown.
        speed_factor: Ratio of the speed to the planned speed, after `stretched`.

    Attributes:
        starts: Start times of the laws, and end time of the last law [s], (laws + 1,).

    Raises:
        InvalidInput: There is no law, or the laws of the spans are not those of the trajectory.
    """

    laws: tuple[Law, ...]
    method: str
    path: Path | None = None
    stretches: tuple[LawPhase, ...] = ()
    spans: tuple[Span, ...] = ()
    events: tuple[TimedEvent, ...] = ()
    waits: tuple[TimedWait, ...] = ()
    limits: Limits | None = None
    reserve: float = 0.0
    arm: Arm | None = None
    speed_factor: float = 1.0
    starts: FloatArray = field(init=False, repr=False)
    _law_ranges: tuple[_LawRange, ...] = field(init=False, repr=False)
    _ends: FloatArray = field(init=False, repr=False)

    def _check_together(self) -> None:
        if not self.laws:
            raise InvalidInput("A trajectory needs at least one law of motion.")
        starts = np.array([0.0, *accumulate([float(law.breaks[-1]) for law in self.laws])])
        parts = _law_ranges(self.laws, self.spans)
        ends = np.array([x.s for x in parts])
        starts.setflags(write=False)
        ends.setflags(write=False)
        for name, values in (("starts", starts), ("_law_ranges", parts), ("_ends", ends)):
            object.__setattr__(self, name, values)

    def __repr__(self) -> str:
        """Method, duration and number of joints, without arrays."""
        joints = count_noun(self.dof, "joint")
        return f"Trajectory({str(self.method)!r}, {number(self.duration, 's')}, {joints})"

    plot = pictures.plot
    _repr_html_ = pictures.draw_as_html

    @property
    def t(self) -> FloatArray:
        """Times of `q`, `dq` and `ddq`, one per cycle of 4 ms [s], (n,)."""
        return self.sample(DEFAULT_CYCLE).t

    @property
    def q(self) -> FloatArray:
        """Joint positions at the times `t` [rad], (n, dof); `sample` has other cycles."""
        return self.sample(DEFAULT_CYCLE).q

    @property
    def dq(self) -> FloatArray:
        """Joint velocities at the times `t` [rad/s], (n, dof)."""
        return self.sample(DEFAULT_CYCLE).dq

    @property
    def ddq(self) -> FloatArray:
        """Joint accelerations at the times `t` [rad/s²], (n, dof)."""
        return self.sample(DEFAULT_CYCLE).ddq

    def explain(self) -> Any:
        """Explain which limit determines the speed, as `armcontour.explain` does.

        Raises:
            InvalidInput: The trajectory has no arm, or was planned by another method.
        """
        return load_method("explain")(self)

    @checked
    def limited(self, limits: Limits, reserve: float = 0.0, arm: Arm | None = None) -> Trajectory:
        """Attach limits to the trajectory; its rapids get the limits of the joints only.

        Args:
            limits: The limits, without the reserve.
            reserve: Fraction of the limits reserved for the servo; 0 by default.
            arm: The arm; by default the arm of the trajectory.
        """
        spans = list(self.spans)
        for k, span in enumerate(spans):
            if span.trajectory is not None:
                move_limits = limits if span.kind == "contour" else limits.of_joints
                move = span.trajectory.limited(move_limits, reserve)
                spans[k] = replace(span, trajectory=move)
        plan_arm = self.arm if arm is None else arm
        # The laws and their ranges are the same.
        return checks.copy_unchecked(
            self, spans=tuple(spans), limits=limits, reserve=reserve, arm=plan_arm
        )

    @checked
    def limits_for(self, limits: Limits | None) -> Limits:
        """Complete the specified limits by the plan's limits, with one value per joint.

        Args:
            limits: The specified limits, or None.
        """
        specified = (limits or Limits()).for_joints(self.dof)
        return specified if self.limits is None else specified.over(self.limits)

    @checked
    def stretched(self, speed_factor: SpeedFactor) -> Trajectory:
        """Return the same motion at a fraction of its speed; dwells keep their durations.

        The joints move through the same positions, q(f t) with the speed factor f. Velocities are
        multiplied by f, accelerations by f², jerks by f³. Torques become g + f² (tau - g), where g
        is the torque of gravity and dry friction, if the arm has no viscous friction. The times at
        which events are due are those of the slower tool. Their lead times do not change, because
        they are delays of the process.

        >>> slow = planned.stretched(0.1)
        >>> round(slow.duration / planned.duration, 9)
        10.0

        Args:
            speed_factor: Ratio of the new speed to the planned speed.
        """
        if speed_factor == 1.0:
            return self
        spans = _stretch_spans(self.spans, speed_factor)
        if spans:
            laws = _laws_of_spans(self.laws, spans)
            # Between the ends of its spans, the slower motion is proportional to the planned one.
            ends = [x.t[1] for x in self.spans]
            slow_ends = [x.t[1] for x in spans]
        else:
            laws = [law.stretched(speed_factor) for law in self.laws]
            ends = [self.duration]
            slow_ends = [self.duration / speed_factor]
        events = list[TimedEvent]()
        for event in self.events:
            due = float(np.interp(event.due, [0.0, *ends], [0.0, *slow_ends]))
            lead_time = event.due - event.t
            events.append(replace(event, due=due, t=due - lead_time))
        slow_starts = np.interp([x.t for x in self.waits], [0.0, *ends], [0.0, *slow_ends])
        pairs = zip(self.waits, slow_starts.tolist(), strict=True)
        waits = tuple(replace(wait, t=t) for wait, t in pairs)
        return replace(
            self,
            laws=tuple(laws),
            stretches=tuple(x.stretched(speed_factor) for x in self.stretches),
            spans=spans,
            events=tuple(sorted(events, key=lambda x: x.t)),
            waits=waits,
            speed_factor=self.speed_factor * speed_factor,
        )

    @property
    def duration(self) -> float:
        """Time from start to end [s]."""
        return float(self.starts[-1])

    @property
    def dof(self) -> int:
        """Number of joints."""
        start = self.laws[0].on_interval(np.zeros(1, dtype=np.intp), np.zeros(1), 0)
        return int(start.shape[-1])

    @property
    def contour_spans(self) -> tuple[Span, ...]:
        """Spans of the contours in order; a trajectory without spans is one contour."""
        if not self.spans:
            t = (0.0, self.duration)
            s = (float(self._ends[0, 0]), float(self._ends[-1, 1]))
            return (Span(move=0, kind="contour", t=t, s=s, work=t, trajectory=self),)
        return tuple(x for x in self.spans if x.kind == "contour")

    def paths_at(self, t: FloatArray) -> list[tuple[Path, IntArray]]:
        """Return the contours' paths with the indices of their times; empty if one has no path.

        The trajectory of a single path has all times. A contour of a program has the times at which
        the process is on.

        Args:
            t: Times [s], (n,).

        Raises:
            InvalidInput: The times are not numbers.
        """
        t = np.atleast_1d(checks.check_numbers("t", t, "s"))
        if not self.spans:
            return [] if self.path is None else [(self.path, np.arange(len(t)))]
        paths: list[tuple[Path, IntArray]] = []
        for span in self.contour_spans:
            if span.trajectory is None or span.trajectory.path is None:
                return []
            start, end = span.work or span.t
            paths.append((span.trajectory.path, np.flatnonzero((t >= start) & (t <= end))))
        return [x for x in paths if len(x[1])]

    @property
    def breaks(self) -> FloatArray:
        """Times between which the motion is smooth, with start and end [s]."""
        counts = [len(law.breaks) - 1 for law in self.laws]
        times = np.empty(sum(counts) + 1)
        first = 0
        for law, start, count in zip(self.laws, self.starts[:-1], counts, strict=True):
            np.add(start, law.breaks[:-1], out=times[first : first + count])
            first += count
        times[-1] = self.duration
        # The times are in order, because rounded sums are; sorting millions of times takes seconds.
        return np.asarray(times[np.append(True, times[1:] > times[:-1])])

    @property
    def smooth_breaks(self) -> FloatArray:
        """Times between which the motion and its joint paths are smooth [s]."""
        laws = zip(self.laws, self.starts[:-1], strict=True)
        passed = [t + x.passages for x, t in laws if isinstance(x, PathLaw)]
        if not any(len(x) for x in passed):
            return self.breaks
        return np.unique(np.concatenate([self.breaks, *passed]))

    @property
    def switching_points(self) -> FloatArray:
        """Times of the paper's switching points P0, P1, ..., the ends of the stretches [s]."""
        return np.array([0.0, *(x.t[1] for x in self.stretches)])

    def __call__(self, t: npt.ArrayLike, order: int = 0, *, side: str = "right") -> FloatArray:
        """Return joint positions or derivatives up to the third, `t.shape + (dof,)`.

        Args:
            t: Times from 0 to `duration` [s], any shape.
            order: 0, 1, 2 or 3.
            side: At a jump, "right" for the value after it, "left" for the value before it.

        Raises:
            InvalidInput: A time is outside the trajectory, or the order is not 0, 1, 2 or 3.
        """
        return self._evaluate(self._clip_times(t, order), side, (order,))[0]

    def motion(
        self, t: npt.ArrayLike, order: int = 2, *, side: str = "right"
    ) -> tuple[FloatArray, ...]:
        """Return joint positions and their derivatives up to an order, `t.shape + (dof,)` each.

        This is faster than a call for every order.

        Args:
            t: Times from 0 to `duration` [s], any shape.
            order: 0, 1, 2 or 3.
            side: At a jump, "right" for the value after it, "left" for the value before it.

        Raises:
            InvalidInput: A time is outside the trajectory, or the order is not 0, 1, 2 or 3.
        """
        return self._evaluate(self._clip_times(t, order), side, tuple(range(order + 1)))

    def _evaluate(
        self, t: FloatArray, side: str, orders: tuple[int, ...]
    ) -> tuple[FloatArray, ...]:
        """Evaluate the laws at times, `t.shape + (dof,)` for each order."""
        outputs: tuple[FloatArray, ...] = ()
        for indices, values in self._values_by_law(t.ravel(), side, orders):
            if len(indices) == t.size:
                # One group has all times, in order. A user's law may return arrays of another type.
                outputs = tuple(np.require(x, np.float64, ("O", "W")) for x in values)
                break
            if not outputs:
                outputs = tuple(np.empty((t.size, x.shape[-1])) for x in values)
            for whole, part in zip(outputs, values, strict=True):
                whole[indices] = part
        if not outputs:
            outputs = tuple(np.empty((0, self.dof)) for _ in orders)
        # Where possible, the results own their data, so that `frozen_array` does not copy them.
        if t.ndim == 1:
            return outputs
        return tuple(x.reshape((*t.shape, x.shape[1])) for x in outputs)

    def _values_by_law(
        self, t: FloatArray, side: str, orders: tuple[int, ...]
    ) -> Iterator[tuple[IntArray, tuple[FloatArray, ...]]]:
        """Yield the indices of some times, (m,), and the values at them, (m, dof) per order."""
        for group in self._group(t, self._law_index(t, side)):
            times = t[group.indices]
            if len(group.laws) > 1:
                values = self._join(group).motion(group.number, times, side, orders)
                yield group.indices, values
                continue
            law = self.laws[group.laws[0]]
            i, law_t = self._within(group.laws[0], times, side)
            if len(orders) == 1:
                yield group.indices, (law.on_interval(i, law_t, orders[0]),)
            else:
                yield group.indices, law.motion(i, law_t, orders[-1])

    def with_rests(self, t: FloatArray, order: int = 0) -> FloatArray:
        """Return joint positions or a derivative, (n, dof), at rest before and after the motion.

        Args:
            t: Times [s], (n,).
            order: 0, 1, 2 or 3.
        """
        t = checks.floats("t", t, "s")
        values = self(np.clip(t, 0.0, self.duration), order)
        if order:
            values[(t < 0) | (t > self.duration)] = 0.0
        return values

    def motion_with_rests(self, t: FloatArray, order: int = 2) -> tuple[FloatArray, ...]:
        """Return joint positions and derivatives, (n, dof) each, at rest outside the motion.

        This is faster than `with_rests` for every order.

        Args:
            t: Times [s], (n,).
            order: 0, 1, 2 or 3.
        """
        t = checks.floats("t", t, "s")
        motion = self.motion(np.clip(t, 0.0, self.duration), order)
        rests = (t < 0) | (t > self.duration)
        for values in motion[1:]:
            values[rests] = 0.0
        return motion

    def s(self, t: npt.ArrayLike, order: int = 0, *, side: str = "right") -> FloatArray:
        """Return the arc length or its derivatives over time, shaped like `t` [m, m/s, m/s²].

        For a program, s counts over all contours, as in its spans, and is constant in rapids and
        dwells. For a joint path without a tool path, s is the parameter of the joint path.

        Args:
            t: Times from 0 to `duration` [s], any shape.
            order: 0, 1 or 2.
            side: At a jump, "right" for the value after it, "left" for the value before it.

        Raises:
            InvalidInput: A time is outside the trajectory, the order is not 0, 1 or 2, or the
                laws are not along one path.
        """
        times = self._clip_times(t, checks.derivative(order, 2))
        self._check_arc_length()
        t = times.ravel()
        lengths = np.zeros(times.size)
        for group in self._group(t, self._law_index(t, side)):
            ranges = [self._law_ranges[k] for k in group.laws]
            if order == 0:
                lengths[group.indices] = np.array([x.offset for x in ranges])[group.number]
            # In rapids and dwells, the arc length is constant.
            moving = np.array([x.law is not None for x in ranges])[group.number]
            if moving.any():
                chosen = LawGroup(group.laws, group.indices[moving], group.number[moving])
                lengths[chosen.indices] += self._arc_length(chosen, t, order, side)
        return lengths.reshape(times.shape)

    def time_at(self, s: npt.ArrayLike, *, side: str = "left") -> FloatArray:
        """Return the times at which the motion reaches or leaves arc lengths [s], shaped like `s`.

        >>> bool(planned.time_at(planned.path.length) == planned.duration)
        True

        Args:
            s: Arc lengths [m], counted as by `Trajectory.s`, any shape.
            side: "left" for the time at which the motion reaches s; "right" for the time at which
                it leaves s, which is later if s is constant for a while.

        Raises:
            InvalidInput: An arc length is outside the path, or the laws are not along one path.
        """
        arc_lengths = self._clip_arc_lengths(s)
        times = np.empty(arc_lengths.size)
        for k, indices, _, law_t in self._by_length(arc_lengths.ravel(), side):
            times[indices] = np.minimum(self.starts[k] + law_t, self.starts[k + 1])
        return times.reshape(arc_lengths.shape)

    def speed_at(self, s: npt.ArrayLike, *, side: str = "right") -> FloatArray:
        """Return path speeds at arc lengths [m/s], shaped like `s`.

        >>> planned.speed_at([0.0, 0.01]).round(4)
        array([0.    , 0.0636])

        Args:
            s: Arc lengths [m], counted as by `Trajectory.s`, any shape.
            side: At a jump, "right" for the value after it, "left" for the value before it.

        Raises:
            InvalidInput: An arc length is outside the path, or the laws are not along one path.
        """
        arc_lengths = self._clip_arc_lengths(s)
        speeds = np.zeros(arc_lengths.size)
        for k, indices, i, law_t in self._by_length(arc_lengths.ravel(), side):
            law = self._law_ranges[k].law
            if law is not None:
                speeds[indices] = law.path_position(i, law_t, 1)
        return speeds.reshape(arc_lengths.shape)

    @checked
    def sample(self, cycle: Interval) -> Samples:
        """Sample the trajectory every `cycle` [s], and at its end.

        >>> planned.sample(0.01).t[:3]
        array([0.  , 0.01, 0.02])

        Args:
            cycle: Time between two samples [s]; the last interval may be shorter.
        """
        end = self.duration - SAME_SAMPLE * cycle
        t = np.append(np.arange(0, end, cycle), self.duration)
        orders = self.motion(t)
        for values in orders:
            # The arrays become read-only without a copy, because a long motion has gigabytes of
            # samples.
            values.setflags(write=False)
        return Samples(t=t, q=orders[0], dq=orders[1], ddq=orders[2])

    def _arc_length(self, group: LawGroup, t: FloatArray, order: int, side: str) -> FloatArray:
        """Return the arc lengths of a group's laws, or a derivative, at its times, (m,).

        - `t`: all requested times [s], (n,).
        """
        times = t[group.indices]
        if len(group.laws) > 1:
            return np.asarray(self._join(group).path_motion(group.number, times, side)[1][order])
        k = group.laws[0]
        law = self._law_ranges[k].law
        assert law is not None
        return law.path_position(*self._within(k, times, side), order)

    def _law_index(self, t: FloatArray, side: str) -> IntArray:
        """Return the index of the law of each time [s], (n,); at a break, on one `side`."""
        index = np.searchsorted(self.starts, t, side=checks.check_side(side)) - 1
        return np.clip(index, 0, len(self.laws) - 1)

    def _group(self, t: FloatArray, law_index: IntArray) -> Iterator[LawGroup]:
        """Group times whose laws are evaluated together, in groups of limited size.

        - `t`, `law_index`: times and the indices of their laws, (n,) each.
        """
        if len(self.laws) == 1 and len(t) <= TIMES_AT_ONCE:
            yield LawGroup([0], np.arange(len(t)), law_index)
            return
        for indices in _batches(law_index):
            laws, number = np.unique(law_index[indices], return_inverse=True)
            joinable = np.array([type(self.laws[k]) is PathLaw for k in laws])
            if np.count_nonzero(joinable) < 2:
                joinable[:] = False
            if joinable.any():
                rows = joinable[number]
                number_among = (np.cumsum(joinable) - 1)[number[rows]]
                yield LawGroup(laws[joinable].tolist(), indices[rows], number_among)
            for k in np.flatnonzero(~joinable):
                rows = np.flatnonzero(number == k)
                yield LawGroup([int(laws[k])], indices[rows], np.zeros(len(rows), dtype=np.intp))

    def _join(self, group: LawGroup) -> JoinedLaws:
        """Join the path laws of a group."""
        laws = [x for x in (self.laws[k] for k in group.laws) if isinstance(x, PathLaw)]
        return JoinedLaws.join(laws, self.starts[group.laws])

    def _within(self, k: int, t: FloatArray, side: str) -> tuple[IntArray, FloatArray]:
        """Return the intervals of law k at times [s], (n,), and the times since its start."""
        start = self.starts[k]
        breaks = self.laws[k].breaks
        # `t - start` can be rounded to either side of the law's break. Therefore t is
        # compared with `start + breaks`, the sums that the property `breaks` also returns.
        i = np.searchsorted(start + breaks, t, side=checks.check_side(side)) - 1
        i = np.clip(i, 0, len(breaks) - 2)
        return i, np.clip(t - start, breaks[i], breaks[i + 1])

    def _clip_times(self, t: npt.ArrayLike, order: int) -> FloatArray:
        """Clip times to the trajectory [s]; raise InvalidInput for times outside."""
        # An invalid order also raises InvalidInput.
        checks.derivative(order, 3)
        return checks.clip_within("time", t, 0.0, self.duration, "s", "the trajectory")

    def _clip_arc_lengths(self, s: npt.ArrayLike) -> FloatArray:
        """Clip arc lengths to the motion [m]; raise InvalidInput for arc lengths outside."""
        self._check_arc_length()
        low = float(self._ends[0, 0])
        high = float(self._ends[-1, 1])
        return checks.clip_within("arc length", s, low, high, "m", "the motion")

    def _by_length(self, s: FloatArray, side: str) -> Iterator[TimesOfLaw]:
        """Group arc lengths by law, with their times in the law, like `locate`."""
        ends = self._ends
        if checks.check_side(side) == "left":
            law_index = np.searchsorted(ends[:, 1], s, side="left")
        else:
            law_index = np.searchsorted(ends[:, 0], s, side="right") - 1
        for k, indices in _group_by_law(np.clip(law_index, 0, len(ends) - 1)):
            part = self._law_ranges[k]
            if part.law is None:
                # The arc length is constant: it is reached at the start and left at the end.
                law_t = np.full(len(indices), 0.0 if side == "left" else self.laws[k].breaks[-1])
                yield TimesOfLaw(k, indices, np.zeros(len(indices), dtype=np.intp), law_t)
            else:
                i, law_t = part.law.reach(s[indices] - part.offset, side)
                yield TimesOfLaw(k, indices, i, law_t)

    def _check_arc_length(self) -> None:
        """Raise InvalidInput unless the laws follow each other along one path."""
        unknown = np.isnan(self._ends[:, 0])
        if unknown.any():
            raise InvalidInput(
                f"Law {int(np.argmax(unknown)) + 1} of the trajectory does not run along a path, "
                "so the trajectory has no arc length. Plan it along a path."
            )
        gaps = np.abs(self._ends[1:, 0] - self._ends[:-1, 1])
        if (gaps > SAME_ARC_LENGTH).any():
            k = int(np.argmax(gaps > SAME_ARC_LENGTH)) + 1
            raise InvalidInput(
                f"Law {k + 1} of the trajectory starts {gaps[k - 1]:.3g} m along the path away "
                f"from the end of law {k}, so the trajectory has no single arc length. Use the "
                "motions along its paths separately."
            )


def arm_of(motion: Any, arm: Arm | Any | None = None) -> Arm:
    """Return `arm` if it is given, otherwise the arm of `motion`, or raise InvalidInput."""
    chosen: Arm | None = getattr(motion, "arm", None) if arm is None else load_named(arm)
    if chosen is None:
        raise InvalidInput(
            f"This {type(motion).__name__} has no arm. Plan it with an arm, or specify "
            "the argument arm."
        )
    return chosen


@dataclass(frozen=True, slots=True)
class _LawRange:
    """A law's range of arc lengths in its trajectory."""

    law: LawAlongPath | None  # The law; None if its s is constant or unknown
    s: tuple[float, float]  # Arc lengths at the start and end of the law [m]; NaN if it has none
    offset: float  # Difference between the trajectory's and the law's arc lengths [m]


def _law_ranges(laws: tuple[Law, ...], spans: tuple[Span, ...]) -> tuple[_LawRange, ...]:
    """Return every law's range of arc lengths; InvalidInput unless the spans have all laws."""
    if not spans:
        return tuple(_law_range(law, 0.0) for law in laws)
    parts: list[_LawRange] = []
    for span in spans:
        count = 1 if span.trajectory is None else len(span.trajectory.laws)
        span_laws = laws[len(parts) : len(parts) + count]
        if len(span_laws) < count or (
            span.trajectory is not None and span_laws != span.trajectory.laws
        ):
            raise InvalidInput(
                "The spans of a trajectory must have the laws of the trajectory in the same order."
            )
        if span.kind == "contour":
            parts += [_law_range(law, span.s[0]) for law in span_laws]
        else:
            # The arc length is constant in rapids and dwells.
            parts += [_LawRange(None, span.s, span.s[0])] * len(span_laws)
    if len(parts) < len(laws):
        raise InvalidInput("The spans of a trajectory must have all laws of the trajectory.")
    return tuple(parts)


def _stretch_spans(spans: tuple[Span, ...], speed_factor: float) -> tuple[Span, ...]:
    """Return the spans at a fraction of their speed; dwells keep their durations."""
    slow_spans = list[Span]()
    t = 0.0
    for span in spans:
        if span.trajectory is None:
            end = t + span.t[1] - span.t[0]
            slow_spans.append(replace(span, t=(t, end)))
        else:
            trajectory = span.trajectory.stretched(speed_factor)
            end = t + trajectory.duration
            work = None
            if span.work is not None:
                begin_work, end_work = ((x - span.t[0]) / speed_factor for x in span.work)
                work = (t + begin_work, t + end_work)
            slow_spans.append(replace(span, t=(t, end), work=work, trajectory=trajectory))
        t = end
    return tuple(slow_spans)


def _laws_of_spans(laws: tuple[Law, ...], spans: tuple[Span, ...]) -> list[Law]:
    """Return the spans' laws in order; the laws of dwells are taken from `laws`."""
    span_laws = list[Law]()
    for span in spans:
        if span.trajectory is None:
            span_laws.append(laws[len(span_laws)])
        else:
            span_laws += span.trajectory.laws
    return span_laws


def _law_range(law: Law, offset: float) -> _LawRange:
    """Return a law's range of arc lengths plus an offset [m]; NaN if it has none."""
    if not isinstance(law, LawAlongPath):
        return _LawRange(None, (np.nan, np.nan), np.nan)
    return _LawRange(law, (offset + float(law.s[0]), offset + float(law.s[-1])), offset)


def _batches(law_index: IntArray) -> Iterator[IntArray]:
    """Divide times into batches with limited numbers of times and laws; yields their indices.

    A single batch has the times in their order.

    - `law_index`: index of the law of each time, (n,).
    """
    count = len(law_index)
    if count == 0:
        return
    span = int(law_index.max() - law_index.min()) + 1
    if count <= TIMES_AT_ONCE and span <= LAWS_AT_ONCE:
        yield np.arange(count)
        return
    order = np.arange(count)
    if (np.diff(law_index) < 0).any():
        order = np.argsort(law_index, kind="stable")
    by_law = (law_index[order] - law_index.min()) // LAWS_AT_ONCE
    edges = np.union1d(
        np.flatnonzero(np.diff(by_law)) + 1, np.arange(TIMES_AT_ONCE, count, TIMES_AT_ONCE)
    )
    yield from np.split(order, edges.astype(np.intp))


def _group_by_law(law_index: IntArray) -> Iterator[tuple[int, IntArray]]:
    """Group indices by law, in groups of limited size to save memory; yields (law, indices)."""
    if (np.diff(law_index) < 0).any():
        order = np.argsort(law_index, kind="stable")
        law_index = law_index[order]
    else:
        order = np.arange(len(law_index))
    edges = np.flatnonzero(np.diff(law_index)) + 1
    if len(law_index) > TIMES_AT_ONCE:
        edges = np.union1d(edges, np.arange(TIMES_AT_ONCE, len(law_index), TIMES_AT_ONCE))
    bounds = [0, *edges.tolist(), len(law_index)]
    for begin, end in zip(bounds[:-1], bounds[1:], strict=True) if len(law_index) else ():
        yield int(law_index[begin]), order[begin:end]
