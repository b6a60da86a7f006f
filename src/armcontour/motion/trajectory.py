"""Trajectory: joint positions over time, made of one time law after another."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from itertools import accumulate
from typing import Any

import numpy as np
import numpy.typing as npt

from armcontour.core import checks
from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.describing import (
    count_kinds,
    count_noun,
    draw,
    format_table,
    short_repr,
    to_html,
)
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import Checked, checked
from armcontour.core.quantities import Interval
from armcontour.core.render import number
from armcontour.geometry import Path
from armcontour.motion._laws import Motion, joint_motions, path_motions
from armcontour.motion.laws import Law, LawAlongPath, PathLaw
from armcontour.robot import Arm, Limits

# Cycle by default [s].
DEFAULT_CYCLE = 4e-3
# Number of times that are computed together, to save memory.
AT_ONCE = 50_000
# Times of so many laws along joint paths are computed together.
MANY = 4
# Largest number of laws in the cached table (a few MB), and number of laws before and after the
# requested range that the table includes.
KEPT, MORE = 100, 3
# Arc lengths and times may be outside by this fraction of the whole, due to rounding errors.
SLACK = 1e-12
# A set-point may exceed a limit by this fraction of the limit, or by this much [rad, rad/s], due to
# rounding errors.
COMMAND_SLACK = 1e-9
# Along one path, the end of a law and the start of the next differ by less than this [m].
SAME_PLACE = 1e-9


class Method(StrEnum):
    """Names of the planning methods."""

    OPTIMAL = "optimal"
    PAPER = "paper"
    CONVENTIONAL = "conventional"
    SHAPED = "shaped"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LawPhase(Checked):
    """A part of a trajectory that was planned by one rule.

    Args:
        name: Name of the part of the path, such as "line 1" or "corner 2".
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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Span:
    """The part of a program's trajectory that belongs to one move.

    Args:
        move: Index of the move in the program; None for a rapid that leads to the
            next move, or a pause before it.
        kind: "contour", "rapid" or "dwell".
        name: Name of the contour; may be empty.
        t: Times of start and end [s].
        s: Arc lengths of start and end, over all contours of the program [m].
        work: For a contour, times from which and until which the process is at work [s].
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

    def shifted(self, by: float) -> TimedEvent:
        """The event later by a time [s]."""
        return replace(self, t=self.t + by, due=self.due + by) if by else self


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Samples(Checked):
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


def to_columns(samples: Any) -> dict[str, FloatArray]:
    """Times, positions, velocities and accelerations as columns `t`, `q1`, ..., `dq1`, ..."""
    columns = {"t": np.array(samples.t)}
    for name in ("q", "dq", "ddq"):
        columns |= {f"{name}{j + 1}": x.copy() for j, x in enumerate(getattr(samples, name).T)}
    return columns


@checks.explain_calls
@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Trajectory(Checked):
    """Joint positions over time, made of consecutive time laws; two-sided at breaks.

    Args:
        laws: The time laws in order.
        method: Name of the planning method; a `Method` if it is one of these.
        path: The tool path that the trajectory follows, if there is one.
        stretches: Parts of the trajectory by the rule that planned them, in order.
        spans: Parts of the trajectory by the moves of the program, in order; empty for a single
            path.
        events: Outputs that are switched during the motion, by time.
        limits: Limits with which it was planned, without the reserve; None if it was not planned
            with limits.
        reserve: Share of the limits of joint acceleration and torque that was left to the servo.
        arm: The arm that it was planned for; None if it is not known.

    Attributes:
        starts: Start times of the laws, and the end of the last [s], (laws + 1,).

    Raises:
        InvalidInput: There is no law, or the laws of the spans are not those of the trajectory.
    """

    laws: tuple[Law, ...]
    method: str
    path: Path | None = None
    stretches: tuple[LawPhase, ...] = ()
    spans: tuple[Span, ...] = ()
    events: tuple[TimedEvent, ...] = ()
    limits: Limits | None = None
    reserve: float = 0.0
    arm: Arm | None = None
    starts: FloatArray = field(init=False, repr=False)
    _parts: tuple[_Part, ...] = field(init=False, repr=False)
    _ends: FloatArray = field(init=False, repr=False)
    _joined: list[tuple[int, int, JoinedLaws]] = field(default_factory=list, init=False, repr=False)

    def _check_together(self) -> None:
        if not self.laws:
            raise InvalidInput("A trajectory needs at least one law of motion.")
        starts = [0.0, *accumulate(float(law.breaks[-1]) for law in self.laws)]
        object.__setattr__(self, "starts", checks.frozen_array(starts))
        parts = _parts(self.laws, self.spans)
        object.__setattr__(self, "_parts", parts)
        object.__setattr__(self, "_ends", checks.frozen_array([x.s for x in parts]))

    def __repr__(self) -> str:
        """Method, duration and number of joints, without arrays."""
        return f"Trajectory({str(self.method)!r}, {self._size})"

    @property
    def _size(self) -> str:
        """Duration and number of joints."""
        return f"{number(self.duration, 's')}, {count_noun(self.dof, 'joint')}"

    def __str__(self) -> str:
        """Method, duration, length, and what the motion consists of."""
        path, moves = self.path, Counter(x.kind for x in self.spans)
        return format_table(
            f"Trajectory: {self._size}",
            [
                ("method", str(self.method)),
                ("path", "" if path is None else number(path.length, "m")),
                ("moves", count_kinds(moves)),
                ("outputs", count_kinds({"event": len(self.events)})),
                ("stretches", ", ".join(x.name for x in self.stretches)),
            ],
        )

    _repr_html_ = to_html
    figure = draw

    def to_dict(self, cycle: float = DEFAULT_CYCLE) -> dict[str, FloatArray]:
        """Samples as columns that `pandas.DataFrame` takes, by name.

            pandas.DataFrame(trajectory.to_dict(cycle=8e-3)).plot(x="t", y="dq1")

        Args:
            cycle: Time between samples [s].

        Returns:
            `t` [s], and of each joint `q1`, `dq1` and `ddq1` [rad, rad/s, rad/s²], (n,) each.

        Raises:
            InvalidInput: As for `sample`.
        """
        return to_columns(self.sample(cycle))

    @checked
    def limited(self, limits: Limits, reserve: float = 0.0, arm: Arm | None = None) -> Trajectory:
        """The trajectory with the limits of its plan; rapids have the limits of the joints only.

        Args:
            limits: The limits, without the reserve.
            reserve: Share of the limits that was left to the servo.
            arm: Its arm; by default the one that it knows.
        """
        joints = limits.of_joints
        spans = tuple(
            x
            if x.trajectory is None
            else replace(
                x,
                trajectory=x.trajectory.limited(limits if x.kind == "contour" else joints, reserve),
            )
            for x in self.spans
        )
        own = self.arm if arm is None else arm
        return replace(self, spans=spans, limits=limits, reserve=reserve, arm=own)

    def require_arm(self) -> Arm:
        """The arm.

        Raises:
            InvalidInput: The trajectory does not know it.
        """
        if self.arm is None:
            raise InvalidInput("This trajectory does not know its arm: plan it with an arm.")
        return self.arm

    @checked
    def limits_for(self, limits: Limits | None) -> Limits:
        """The given limits, and where they give none, those of the plan, one value per joint.

        Args:
            limits: The given limits, or None.
        """
        given = (limits or Limits()).for_joints(self.dof)
        return given if self.limits is None else given.over(self.limits)

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
            t, s = (0.0, self.duration), (float(self._ends[0, 0]), float(self._ends[-1, 1]))
            return (Span(move=0, kind="contour", t=t, s=s, work=t, trajectory=self),)
        return tuple(x for x in self.spans if x.kind == "contour")

    def paths_at(self, t: FloatArray) -> list[tuple[Path, IntArray]]:
        """Paths of the contours, and which times belong to each; empty if one has no path.

        A path has all times, a contour of a program those while the process is at work on it.

        Args:
            t: Times [s], (n,).

        Raises:
            InvalidInput: The times are no numbers.
        """
        t = np.atleast_1d(checks.check_numbers("t", t, "s"))
        if not self.spans:
            return [] if self.path is None else [(self.path, np.arange(len(t)))]
        found: list[tuple[Path, IntArray]] = []
        for span in self.contour_spans:
            if span.trajectory is None or span.trajectory.path is None:
                return []
            start, end = span.work or span.t
            found.append((span.trajectory.path, np.flatnonzero((t >= start) & (t <= end))))
        return [x for x in found if len(x[1])]

    @property
    def breaks(self) -> FloatArray:
        """Times between which the motion is smooth, with start and end [s]."""
        inner = [
            np.append(start + law.breaks[:-1], end)
            for law, start, end in zip(self.laws, self.starts[:-1], self.starts[1:], strict=True)
        ]
        return np.unique(np.concatenate(inner))

    @property
    def smooth_breaks(self) -> FloatArray:
        """Times between which the motion and its joint paths are smooth [s]."""
        laws = zip(self.laws, self.starts[:-1], strict=True)
        passed = (t + x.passages for x, t in laws if isinstance(x, PathLaw))
        return np.unique(np.concatenate([self.breaks, *passed]))

    @property
    def switching_points(self) -> FloatArray:
        """Times of the paper's switching points P0, P1, ...: the ends of the stretches [s]."""
        return np.array([0.0, *(x.t[1] for x in self.stretches)])

    def __call__(self, t: npt.ArrayLike, order: int = 0, *, side: str = "right") -> FloatArray:
        """Joint positions or their derivatives, `t.shape + (dof,)` [rad, rad/s, rad/s², rad/s³].

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
        """Joint positions and their derivatives up to an order, `t.shape + (dof,)` each.

        Faster than a call for every order.

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
        """Values of the laws at times, `t.shape + (dof,)` for each order: one, or all up to one."""
        flat = t.ravel()
        found: tuple[FloatArray, ...] = ()
        for of, values in self._values(flat, side, orders):
            if len(of) == t.size:
                # They are in order; laws of users may give other arrays than ours do.
                found = tuple(np.require(x, np.float64, ("O", "W")) for x in values)
                break
            if not found:
                found = tuple(np.empty((t.size, x.shape[-1])) for x in values)
            for whole, part in zip(found, values, strict=True):
                whole[of] = part
        if not found:
            found = tuple(np.empty((0, self.dof)) for _ in orders)
        # Not views of other arrays where none are needed, so that `frozen_array` makes no copies.
        return found if t.ndim == 1 else tuple(x.reshape((*t.shape, x.shape[1])) for x in found)

    def _values(
        self, t: FloatArray, side: str, orders: tuple[int, ...]
    ) -> Iterator[tuple[IntArray, tuple[FloatArray, ...]]]:
        """Values of laws at times: of each law, or of many laws at a time.

        Yields:
            Indices of times in `t`, (m,), and the values there, (m, dof) for each order.
        """
        which = self._law_at(t, side)
        touched = np.unique(which) if len(self.laws) >= MANY else which[:0]
        many = [k for k in touched.tolist() if type(self.laws[k]) is PathLaw]
        alone = np.arange(len(t))
        if len(many) >= MANY:
            together = np.zeros(len(self.laws), dtype=bool)
            together[many] = True
            yield from self._values_together(
                np.flatnonzero(together[which]), which, t, side, orders
            )
            alone = np.flatnonzero(~together[which])
        for k, of, i, local in self.locate(t[alone], side):
            law = self.laws[k]
            if len(orders) == 1:
                yield alone[of], (law.on_interval(i, local, orders[0]),)
            else:
                yield alone[of], law.motion(i, local, orders[-1])

    def _values_together(
        self, of: IntArray, which: IntArray, t: FloatArray, side: str, orders: tuple[int, ...]
    ) -> Iterator[tuple[IntArray, tuple[FloatArray, ...]]]:
        """Values at the times of laws along joint paths, of AT_ONCE times together.

        Args:
            of: Indices of these times in `t`, (m,).
            which: The law of every time in `t`, (n,).
            t: As in `_values`.
            side: As in `_values`.
            orders: As in `_values`.
        """
        for begin in range(0, len(of), AT_ONCE):
            here = of[begin : begin + AT_ONCE]
            law, joined = self._join(which[here])
            yield here, joined.motion(law, t[here], side, orders)

    def _join(self, which: IntArray) -> tuple[IntArray, JoinedLaws]:
        """A table of the laws of some times, and the rows of these laws in it, (n,).

        The last table of few laws is kept: who looks for clearance asks for them again and again.

        Args:
            which: The law of every time, (n,).
        """
        first, last = int(which.min()), int(which.max()) + 1
        for begin, end, joined in self._joined[:]:
            if begin <= first and last <= end:
                return which - begin, joined
        if last - first <= KEPT:
            begin, end = first, last
            while begin > max(first - MORE, 0) and type(self.laws[begin - 1]) is PathLaw:
                begin -= 1
            while end < min(last + MORE, len(self.laws)) and type(self.laws[end]) is PathLaw:
                end += 1
            own = [x for x in self.laws[begin:end] if type(x) is PathLaw]
            if len(own) == end - begin:
                joined = JoinedLaws.of(own, np.array(self.starts[begin:end]))
                self._joined[:] = [(begin, end, joined)]
                return which - begin, joined
        laws, law = np.unique(which, return_inverse=True)
        return law, JoinedLaws.of([self.laws[k] for k in laws.tolist()], self.starts[laws])

    def with_rests(self, t: FloatArray, order: int = 0) -> FloatArray:
        """The motion at any times, at rest before and after it, (n, dof).

        Args:
            t: Times [s], (n,).
            order: 0, 1, 2 or 3.
        """
        t = checks.floats("t", t, "s")
        found = self(np.clip(t, 0.0, self.duration), order)
        if order:
            found[(t < 0) | (t > self.duration)] = 0.0
        return found

    def motion_with_rests(self, t: FloatArray, order: int = 2) -> tuple[FloatArray, ...]:
        """The motion at any times, at rest before and after it, up to an order, (n, dof) each.

        Faster than `with_rests` for every order.

        Args:
            t: Times [s], (n,).
            order: 0, 1, 2 or 3.
        """
        t = checks.floats("t", t, "s")
        found = self.motion(np.clip(t, 0.0, self.duration), order)
        rests = (t < 0) | (t > self.duration)
        for values in found[1:]:
            values[rests] = 0.0
        return found

    def s(self, t: npt.ArrayLike, order: int = 0, *, side: str = "right") -> FloatArray:
        """Arc length or its derivatives over time, with the shape of `t` [m, m/s, m/s², m/s³].

        For a program, s counts over all contours, as in its spans, and is constant in rapids and
        dwells. For a joint path without a tool path, s is the parameter of the joint path.

        Args:
            t: Times from 0 to `duration` [s], any shape.
            order: 0, 1, 2 or 3.
            side: At a jump, "right" for the value after it, "left" for the value before it.

        Raises:
            InvalidInput: A time is outside the trajectory, the order is not 0, 1, 2 or 3, or the
                laws are not along one path.
        """
        at = self._clip_times(t, order)
        self._refuse_no_arc_length()
        found = np.empty(at.size)
        for k, of, i, local in self.locate(at.ravel(), side):
            part = self._parts[k]
            found[of] = part.offset if order == 0 else 0.0
            if part.law is not None:
                found[of] += part.law.path_position(i, local, order)
        return found.reshape(at.shape)

    def time_at(self, s: npt.ArrayLike, *, side: str = "left") -> FloatArray:
        """Times at which the motion reaches or leaves arc lengths, with the shape of `s` [s].

        Args:
            s: Arc lengths [m], counted as by `Trajectory.s`, any shape.
            side: "left" for the time at which the motion reaches s; "right" for the time at which
                it leaves s, which is later if s is constant for a while.

        Raises:
            InvalidInput: An arc length is outside the path, or the laws are not along one path.
        """
        at = self._clip_arc_lengths(s)
        found = np.empty(at.size)
        for k, of, _, local in self._by_length(at.ravel(), side):
            found[of] = np.minimum(self.starts[k] + local, self.starts[k + 1])
        return found.reshape(at.shape)

    def speed_at(self, s: npt.ArrayLike, *, side: str = "right") -> FloatArray:
        """Path speeds at arc lengths, with the shape of `s` [m/s].

        Args:
            s: Arc lengths [m], counted as by `Trajectory.s`, any shape.
            side: At a jump, "right" for the value after it, "left" for the value before it.

        Raises:
            InvalidInput: An arc length is outside the path, or the laws are not along one path.
        """
        at = self._clip_arc_lengths(s)
        found = np.zeros(at.size)
        for k, of, i, local in self._by_length(at.ravel(), side):
            law = self._parts[k].law
            if law is not None:
                found[of] = law.path_position(i, local, 1)
        return found.reshape(at.shape)

    @checked
    def sample(self, cycle: Interval) -> Samples:
        """The trajectory sampled every `cycle` [s], and at its end.

        Args:
            cycle: Time between two samples [s]; the last interval may be shorter.
        """
        t = np.append(np.arange(0, self.duration - 1e-9 * cycle, cycle), self.duration)
        orders = self.motion(t)
        for values in orders:
            # No copies: a long motion has gigabytes of samples.
            values.setflags(write=False)
        return Samples(t=t, q=orders[0], dq=orders[1], ddq=orders[2])

    def locate(
        self, t: FloatArray, side: str = "right"
    ) -> Iterator[tuple[int, IntArray, IntArray, FloatArray]]:
        """Group times by law.

        Args:
            t: Times from 0 to `duration` [s], (n,).
            side: "right" or "left": the interval to which a break belongs.

        Yields:
            Index of the law, indices of its times in `t`, their intervals, and their times since
            the start of the law [s].
        """
        for k, of in _group_by_law(self._law_at(t, side)):
            start, own = self.starts[k], self.laws[k].breaks
            # A time less the start is rounded, to either side of the law's break. So times are
            # compared with the very sums that `breaks` has.
            i = np.searchsorted(start + own, t[of], side=checks.check_side(side)) - 1
            i = np.clip(i, 0, len(own) - 2)
            yield k, of, i, np.clip(t[of] - start, own[i], own[i + 1])

    def _law_at(self, t: FloatArray, side: str) -> IntArray:
        """Index of the law at each time [s], (n,)."""
        found = np.searchsorted(self.starts, t, side=checks.check_side(side)) - 1
        return np.clip(found, 0, len(self.laws) - 1)

    def _clip_times(self, t: npt.ArrayLike, order: int) -> FloatArray:
        """Times clipped to the trajectory, after refusing those outside and other orders.

        Raises:
            InvalidInput: A time is outside the trajectory, or the order is not 0, 1, 2 or 3.
        """
        at = checks.floats("t", t, "s")
        checks.derivative(order, 3)
        slack = SLACK * self.duration
        outside = ~((at >= -slack) & (at <= self.duration + slack))
        if outside.any():
            value = float(at[outside].flat[0])
            raise InvalidInput(
                f"Time {value:g} s lies outside the trajectory, which runs from 0 to "
                f"{self.duration:.9g} s.",
                t=value,
                allowed=self.duration,
            )
        return np.asarray(np.clip(at, 0, self.duration))

    def _clip_arc_lengths(self, s: npt.ArrayLike) -> FloatArray:
        """Arc lengths clipped to the motion, after refusing those outside.

        Raises:
            InvalidInput: An arc length is outside the motion, or the laws are not along one path.
        """
        self._refuse_no_arc_length()
        at = checks.check_numbers("s", s, "m")
        low, high = float(self._ends[0, 0]), float(self._ends[-1, 1])
        slack = SLACK * max(high - low, 1e-3)
        outside = ~((at >= low - slack) & (at <= high + slack))
        if outside.any():
            value = float(at[outside].flat[0])
            raise InvalidInput(
                f"Arc length {value:g} m lies outside the motion, which runs from {low:g} to "
                f"{high:.9g} m.",
                s=value,
                allowed=high,
            )
        return np.asarray(np.clip(at, low, high))

    def _by_length(
        self, s: FloatArray, side: str
    ) -> Iterator[tuple[int, IntArray, IntArray, FloatArray]]:
        """Group arc lengths by law, with the times at which the motion reaches or leaves them.

        Yields:
            Index of the law, indices of its arc lengths in `s`, their intervals, and the times
            since the start of the law [s].
        """
        ends = self._ends
        if checks.check_side(side) == "left":
            which = np.searchsorted(ends[:, 1], s, side="left")
        else:
            which = np.searchsorted(ends[:, 0], s, side="right") - 1
        for k, of in _group_by_law(np.clip(which, 0, len(ends) - 1)):
            part = self._parts[k]
            if part.law is None:
                still = 0.0 if side == "left" else self.laws[k].breaks[-1]
                yield k, of, np.zeros(len(of), dtype=np.intp), np.full(len(of), still)
            else:
                yield k, of, *part.law.reach(s[of] - part.offset, side)

    def _refuse_no_arc_length(self) -> None:
        """Refuse laws that do not follow each other along one path.

        Raises:
            InvalidInput: A law has no arc length, or does not start where the law before it ends.
        """
        unknown = np.isnan(self._ends[:, 0])
        if unknown.any():
            raise InvalidInput(
                f"Law {int(np.argmax(unknown)) + 1} of the trajectory does not run along a path, "
                "so the trajectory has no arc length: plan it along a path."
            )
        gaps = np.abs(self._ends[1:, 0] - self._ends[:-1, 1])
        if (gaps > SAME_PLACE).any():
            k = int(np.argmax(gaps > SAME_PLACE)) + 1
            raise InvalidInput(
                f"Law {k + 1} of the trajectory starts {gaps[k - 1]:.3g} m along the path away "
                f"from the end of law {k}, so the trajectory has no single arc length: use the "
                "motions along its paths one by one."
            )


@dataclass(frozen=True, slots=True)
class _Part:
    """Arc lengths of one law in its trajectory.

    Args:
        law: The law; None if s is constant.
        s: Arc lengths at the start and end of the law [m]; NaN if it has none.
        offset: Difference between the trajectory's and the law's arc lengths [m].
    """

    law: LawAlongPath | None
    s: tuple[float, float]
    offset: float


def _parts(laws: tuple[Law, ...], spans: tuple[Span, ...]) -> tuple[_Part, ...]:
    """Arc lengths of every law of a trajectory.

    Raises:
        InvalidInput: The laws of the spans are not those of the trajectory.
    """
    if not spans:
        return tuple(_along(law, 0.0) for law in laws)
    found: list[_Part] = []
    for span in spans:
        count = 1 if span.trajectory is None else len(span.trajectory.laws)
        own = laws[len(found) : len(found) + count]
        if len(own) < count or (span.trajectory is not None and own != span.trajectory.laws):
            raise InvalidInput("The spans of a trajectory must have its laws, in the same order.")
        counts = span.kind == "contour"
        still = _Part(None, span.s, span.s[0])
        found += [_along(law, span.s[0]) if counts else still for law in own]
    if len(found) < len(laws):
        raise InvalidInput("The spans of a trajectory must have all of its laws.")
    return tuple(found)


def _along(law: Law, offset: float) -> _Part:
    """Arc lengths of a law, with an offset [m]."""
    if not isinstance(law, LawAlongPath):
        return _Part(None, (np.nan, np.nan), np.nan)
    return _Part(law, (offset + float(law.s[0]), offset + float(law.s[-1])), offset)


def _group_by_law(which: IntArray) -> Iterator[tuple[int, IntArray]]:
    """Group indices by law, in groups of limited size to save memory.

    Args:
        which: Index of the law of each time or arc length, (n,).

    Yields:
        Index of a law, and indices into `which`.
    """
    if (np.diff(which) < 0).any():
        order = np.argsort(which, kind="stable")
        which = which[order]
    else:
        order = np.arange(len(which))
    edges = np.flatnonzero(np.diff(which)) + 1
    if len(which) > AT_ONCE:
        edges = np.union1d(edges, np.arange(AT_ONCE, len(which), AT_ONCE))
    bounds = [0, *edges.tolist(), len(which)]
    for begin, end in zip(bounds[:-1], bounds[1:], strict=True) if len(which) else ():
        yield int(which[begin]), order[begin:end]


@dataclass(frozen=True, slots=True)
class JoinedLaws:
    """Several laws as one table, with a row for every break, also for the last one of a law.

    Args:
        starts: Start times of the laws [s], (laws,).
        rows: Rows of the laws' first breaks, and the number of all rows, (laws + 1,).
        breaks: Breaks, counted from the start of each law [s], (n,).
        times: Breaks, counted from the start of the trajectory and rounded as those of the
            trajectory are [s], (n,).
        s: Arc lengths there [m], (n,).
        rates: The columns of `Rates` for the interval after each break, (n,) each.
        path_rows: Rows of the first breaks of the laws' joint paths, (laws + 1,).
        path_breaks: Breaks of the joint paths [m], (m,).
        coefficients: Their coefficients after each break, (m, 6, dof).
    """

    starts: FloatArray
    rows: IntArray
    breaks: FloatArray
    times: FloatArray
    s: FloatArray
    rates: tuple[FloatArray, ...]
    path_rows: IntArray
    path_breaks: FloatArray
    coefficients: FloatArray

    @classmethod
    def of(cls, laws: Sequence[PathLaw], starts: FloatArray) -> JoinedLaws:
        """The table of some laws with their start times [s]."""
        paths = [x.joint_path for x in laws]
        return cls(
            starts=starts,
            rows=_first_rows([x.breaks for x in laws]),
            breaks=_join([x.breaks for x in laws]),
            times=_join([at + x.breaks for at, x in zip(starts, laws, strict=True)]),
            s=_join([x.s for x in laws]),
            rates=tuple(_join_padded([x.rates[k] for x in laws]) for k in range(4)),
            path_rows=_first_rows([x.breaks for x in paths]),
            path_breaks=_join([x.breaks for x in paths]),
            coefficients=_join_padded([x.coefficients for x in paths]),
        )

    def motion(
        self, law: IntArray, t: FloatArray, side: str, orders: tuple[int, ...]
    ) -> tuple[FloatArray, ...]:
        """Joint positions or derivatives over time, (n, dof) for each order.

        Args:
            law: The law of each time, (n,).
            t: Times [s], (n,).
            side: "right" or "left": the interval to which a break belongs.
            orders: The orders, from 0 to 3.
        """
        row = np.searchsorted(self.times, t, side=checks.check_side(side)) - 1
        row = np.clip(row, self.rows[law], self.rows[law + 1] - 2)
        local = np.clip(t - self.starts[law], self.breaks[row], self.breaks[row + 1])
        for x in (row, local):
            x.setflags(write=False)
        along = path_motions(row, local, self.breaks, self.s, *self.rates)
        dof = self.coefficients.shape[2]
        found = Motion(*(np.empty((len(t) if k in orders else 0, dof)) for k in range(4)))
        tables = self.path_rows, self.path_breaks, self.coefficients
        joint_motions(along, _locked(self.s[row + 1]), law, *tables, found)
        return tuple(found[k] for k in orders)


def _locked(values: FloatArray) -> FloatArray:
    """An array made read-only: all that a kernel is compiled for."""
    values.setflags(write=False)
    return values


def _join(parts: list[FloatArray]) -> FloatArray:
    """Arrays one after the other."""
    return _locked(np.concatenate(parts))


def _join_padded(parts: list[FloatArray]) -> FloatArray:
    """Arrays one after the other, with a row of zeros after each."""
    zero = np.zeros((1, *parts[0].shape[1:]))
    return _join([x for part in parts for x in (part, zero)])


def _first_rows(parts: list[FloatArray]) -> IntArray:
    """The row at which each of several arrays begins, and the number of all rows."""
    return np.cumsum([0, *(len(x) for x in parts)], dtype=np.intp)
