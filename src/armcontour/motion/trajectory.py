"""A trajectory: joint positions over time as one continuous law."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np
import numpy.typing as npt

from armcontour import _checks
from armcontour._checks import FloatArray, IntArray
from armcontour.errors import InvalidInput
from armcontour.geometry import Path
from armcontour.motion.laws import Law, LawAlongPath

# Times that are looked at together.
AT_ONCE = 50_000
# Arc lengths and times may lie outside by this share of the whole: rounding.
SLACK = 1e-12
# Where one law ends and the next one begins differ by less than this along one path [m].
SAME_PLACE = 1e-9


class Method(StrEnum):
    """The planning methods, by the names that people read."""

    OPTIMAL = "optimal"
    MAC = "mac"
    CONVENTIONAL = "conventional"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stretch:
    """A part of a trajectory that was made by one rule.

    Args:
        name: Where it is, such as "line 1" or "corner 2".
        kind: The rule: "MAC", "AVC", "MDC", "corner" or "uniform".
        t: Start and end [s].
        s: Start and end along the path [m].
        demand: Largest acceleration of each joint [rad/s²], (dof,).
        speed: Largest tool speed [m/s].
    """

    name: str
    kind: str
    t: tuple[float, float]
    s: tuple[float, float]
    demand: FloatArray
    speed: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "demand", _checks.lock_floats(self.demand))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Span:
    """The share that a move of a program has of its trajectory.

    Args:
        move: Its index among the program's moves; None for a rapid that leads to the next one, or
            a pause before it.
        kind: "contour", "rapid" or "dwell".
        name: Of its contour; may be empty.
        t: Start and end [s].
        s: Start and end along the contours of the program, one after the other [m].
        work: Of a contour: from when to when the process is at work [s].
        trajectory: Its own, from 0; None where the tool stands still.
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
    """Something that is switched at a time of a trajectory.

    Args:
        name: What is switched.
        value: What to.
        t: When, its lead taken off [s].
        due: When the tool is at its place [s].
        s: That place along the contours of the program, one after the other [m].
        point: The same in space or in the plane [m].
    """

    name: str
    value: bool | float | str
    t: float
    due: float
    s: float
    point: tuple[float, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Samples:
    """A trajectory at regular times: t (n,), q, dq, ddq (n, dof)."""

    t: FloatArray
    q: FloatArray
    dq: FloatArray
    ddq: FloatArray

    def __post_init__(self) -> None:
        for name in ("t", "q", "dq", "ddq"):
            object.__setattr__(self, name, _checks.lock_floats(getattr(self, name)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Trajectory:
    """Laws of motion one after the other, callable at any time, two-sided at breaks.

    Args:
        laws: The pieces.
        method: Name of the planner that made it; a `Method` if it is one of these planners.
        path: The tool path it follows, if there is one.
        stretches: What was made by which rule, in order.
        spans: The moves of the program it does, in order; none for a single path.
        events: What is switched on the way, by their times.

    Raises:
        InvalidInput: No law, or spans whose own laws are not those of the trajectory.
    """

    laws: tuple[Law, ...]
    method: str
    path: Path | None = None
    stretches: tuple[Stretch, ...] = ()
    spans: tuple[Span, ...] = ()
    events: tuple[TimedEvent, ...] = ()
    starts: FloatArray = field(init=False, repr=False)
    _parts: tuple[_Part, ...] = field(init=False, repr=False)
    _ends: FloatArray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if not self.laws:
            raise InvalidInput("A trajectory needs at least one law of motion.")
        ends = np.cumsum([law.breaks[-1] for law in self.laws])
        object.__setattr__(self, "starts", _checks.lock_floats(np.concatenate([[0.0], ends])))
        parts = _parts(self.laws, self.spans)
        object.__setattr__(self, "_parts", parts)
        object.__setattr__(self, "_ends", _checks.lock_floats([x.s for x in parts]))

    def __repr__(self) -> str:
        """What it is, and not all of its numbers."""
        return f"Trajectory({str(self.method)!r}, {self.duration:.6g} s, {self.dof} joints)"

    @property
    def duration(self) -> float:
        """Time from start to end [s]."""
        return float(self.starts[-1])

    @property
    def dof(self) -> int:
        """Number of joints."""
        return int(self(0.0).shape[-1])

    @property
    def contour_spans(self) -> tuple[Span, ...]:
        """Those of its spans that are contours of a program, in order."""
        return tuple(x for x in self.spans if x.kind == "contour")

    @property
    def breaks(self) -> FloatArray:
        """All times between which the motion is smooth, 0 and the end included [s]."""
        inner = [
            np.append(start + law.breaks[:-1], end)
            for law, start, end in zip(self.laws, self.starts[:-1], self.starts[1:], strict=True)
        ]
        return np.unique(np.concatenate(inner))

    @property
    def switching_points(self) -> FloatArray:
        """Times of the paper's switching points P0, P1, ...: the stretches' ends [s]."""
        return np.array([0.0, *(x.t[1] for x in self.stretches)])

    def __call__(self, t: npt.ArrayLike, order: int = 0, *, side: str = "right") -> FloatArray:
        """Joint positions, velocities or accelerations, `t.shape + (dof,)` [rad, rad/s, rad/s²].

        Args:
            t: Times from 0 to `duration` [s], any shape.
            order: 0, 1 or 2.
            side: "right" or "left": whose value to take where it jumps.

        Raises:
            InvalidInput: A time outside the trajectory, or another order.
        """
        at = self._check_times(t, order)
        result: FloatArray | None = None
        for k, of, i, local in self.locate(at.ravel(), side):
            values = self.laws[k].on_interval(i, local, order)
            if result is None:
                result = np.empty((at.size, values.shape[-1]))
            result[of] = values
        if result is None:
            result = np.empty((0, self.dof))
        return result.reshape((*at.shape, result.shape[1]))

    def s(self, t: npt.ArrayLike, order: int = 0, *, side: str = "right") -> FloatArray:
        """Arc length, path speed or path acceleration, of the shape of `t` [m, m/s, m/s²].

        Of a program s counts along its contours, one after the other, as in its spans; s stands
        still in rapids and dwells. Where a joint path traces no tool path, s is its own parameter.

        Args:
            t: Times from 0 to `duration` [s], any shape.
            order: 0, 1 or 2.
            side: "right" or "left": whose value to take where it jumps.

        Raises:
            InvalidInput: A time outside the trajectory, another order, or laws that do not run
                along one path.
        """
        at = self._check_times(t, order)
        self._refuse_no_arc_length()
        found = np.empty(at.size)
        for k, of, i, local in self.locate(at.ravel(), side):
            part = self._parts[k]
            found[of] = part.offset if order == 0 else 0.0
            if part.law is not None:
                found[of] += part.law.path_position(i, local, order)
        return found.reshape(at.shape)

    def time_at(self, s: npt.ArrayLike, *, side: str = "left") -> FloatArray:
        """When the motion gets to arc lengths, of the shape of `s` [s].

        Args:
            s: Arc lengths [m], counted as by `Trajectory.s`, any shape.
            side: "left" for when the motion gets there; "right" for when the motion goes on, which
                is later where s stands still.

        Raises:
            InvalidInput: An arc length outside the path, or laws that do not run along one path.
        """
        at = self._check_lengths(s)
        found = np.empty(at.size)
        for k, of, _, local in self._by_length(at.ravel(), side):
            found[of] = np.minimum(self.starts[k] + local, self.starts[k + 1])
        return found.reshape(at.shape)

    def speed_at(self, s: npt.ArrayLike, *, side: str = "right") -> FloatArray:
        """Path speed at arc lengths, of the shape of `s` [m/s].

        Args:
            s: Arc lengths [m], counted as by `Trajectory.s`, any shape.
            side: "right" or "left": whose value to take where it jumps.

        Raises:
            InvalidInput: An arc length outside the path, or laws that do not run along one path.
        """
        at = self._check_lengths(s)
        found = np.zeros(at.size)
        for k, of, i, local in self._by_length(at.ravel(), side):
            law = self._parts[k].law
            if law is not None:
                found[of] = law.path_position(i, local, 1)
        return found.reshape(at.shape)

    def sample(self, period: float) -> Samples:
        """The trajectory every `period` [s], and at its end.

        Args:
            period: Time between two samples [s]; the last interval may be shorter.
        """
        step = _checks.positive("sampling period", period, "s")
        t = np.append(np.arange(0, self.duration - 1e-9 * step, step), self.duration)
        return Samples(t=t, q=self(t), dq=self(t, 1), ddq=self(t, 2))

    def locate(
        self, t: FloatArray, side: str = "right"
    ) -> Iterator[tuple[int, IntArray, IntArray, FloatArray]]:
        """Times law by law: its index, which times, their intervals, and the law's own times.

        Args:
            t: Times from 0 to `duration` [s], (n,).
            side: "right" or "left": which interval a break counts to.
        """
        found = np.searchsorted(self.starts, t, side=_checks.side(side)) - 1
        for k, of in _group_by_law(np.clip(found, 0, len(self.laws) - 1)):
            start, own = self.starts[k], self.laws[k].breaks
            # A time less the start is rounded, to either side of the law's break. So times are
            # compared with the very sums that `breaks` has.
            i = np.searchsorted(start + own, t[of], side=_checks.side(side)) - 1
            i = np.clip(i, 0, len(own) - 2)
            yield k, of, i, np.clip(t[of] - start, own[i], own[i + 1])

    def _check_times(self, t: npt.ArrayLike, order: int) -> FloatArray:
        at = np.asarray(t)
        if at.dtype != np.float64:
            at = _checks.numbers("t", t, "s")
        if order not in (0, 1, 2):
            raise InvalidInput(f"A trajectory has the orders 0, 1 and 2, not {order}.")
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

    def _check_lengths(self, s: npt.ArrayLike) -> FloatArray:
        self._refuse_no_arc_length()
        at = _checks.numbers("s", s, "m")
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
        """Arc lengths law by law, as `locate`: when the motion gets there, or goes on."""
        ends = self._ends
        if _checks.side(side) == "left":
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
        """Refuse laws that do not follow each other along one path."""
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
                f"Law {k + 1} of the trajectory begins {gaps[k - 1]:.3g} m along the path away "
                f"from where law {k} ends, so the trajectory has no one arc length: look at the "
                "motions along its paths one by one."
            )


@dataclass(frozen=True, slots=True)
class _Part:
    """What a law does along the path of its trajectory.

    Args:
        law: The law; None if s stands still over it.
        s: Arc lengths at its start and end [m]; NaN if it knows none.
        offset: What is added to its own arc lengths, if there are any [m].
    """

    law: LawAlongPath | None
    s: tuple[float, float]
    offset: float


def _parts(laws: tuple[Law, ...], spans: tuple[Span, ...]) -> tuple[_Part, ...]:
    """One part for every law of a trajectory.

    Raises:
        InvalidInput: Spans whose own laws are not those of the trajectory.
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
    if not isinstance(law, LawAlongPath):
        return _Part(None, (np.nan, np.nan), np.nan)
    return _Part(law, (offset + float(law.s[0]), offset + float(law.s[-1])), offset)


def _group_by_law(which: IntArray) -> Iterator[tuple[int, IntArray]]:
    """The laws that are meant, and where each is; few places at once keep memory low."""
    order = np.argsort(which, kind="stable")
    edges = np.flatnonzero(np.diff(which[order])) + 1
    edges = np.union1d(edges, np.arange(AT_ONCE, len(which), AT_ONCE))
    for of in np.split(order, edges) if len(which) else ():
        yield int(which[of[0]]), of
