"""A trajectory: joint positions over time as one continuous law."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from armcontour import _checks
from armcontour._checks import FloatArray
from armcontour.errors import InvalidInput
from armcontour.geometry import Path
from armcontour.motion.laws import Law

# Times that are looked at together.
AT_ONCE = 50_000


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
        object.__setattr__(self, "demand", _checks.locked(self.demand))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Span:
    """The share that a move of a program has of its trajectory.

    Args:
        move: Its index among the program's moves; None for a rapid that leads to the next one.
        kind: "contour", "rapid" or "dwell".
        name: Of its contour; may be empty.
        t: Start and end [s].
        s: Start and end along the contours of the program, one behind the other [m].
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
        s: That place along the contours of the program, one behind the other [m].
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
            object.__setattr__(self, name, _checks.locked(getattr(self, name)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Trajectory:
    """Laws of motion one after the other, callable at any time, two-sided at breaks.

    Args:
        laws: The pieces.
        method: Name of the planner that made it.
        path: The tool path it follows, if there is one.
        stretches: What was made by which rule, in order.
        spans: The moves of the program it does, in order; none for a single path.
        events: What is switched on the way, by their times.
    """

    laws: tuple[Law, ...]
    method: str
    path: Path | None = None
    stretches: tuple[Stretch, ...] = ()
    spans: tuple[Span, ...] = ()
    events: tuple[TimedEvent, ...] = ()
    starts: FloatArray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if not self.laws:
            raise InvalidInput("A trajectory needs at least one law of motion.")
        ends = np.cumsum([law.breaks[-1] for law in self.laws])
        object.__setattr__(self, "starts", _checks.locked(np.concatenate([[0.0], ends])))

    def __repr__(self) -> str:
        """What it is, and not all of its numbers."""
        return f"Trajectory({self.method!r}, {self.duration:.6g} s, {self.dof} joints)"

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
        at = np.asarray(t, dtype=np.float64)
        if order not in (0, 1, 2):
            raise InvalidInput(f"A trajectory has the orders 0, 1 and 2, not {order}.")
        slack = 1e-12 * self.duration
        outside = ~((at >= -slack) & (at <= self.duration + slack))
        if outside.any():
            value = float(at[outside].flat[0])
            raise InvalidInput(
                f"Time {value:g} s lies outside the trajectory, which runs from 0 to "
                f"{self.duration:.9g} s.",
                t=value,
                allowed=self.duration,
            )
        flat = np.clip(at.ravel(), 0, self.duration)
        which = self._law(flat, side)
        # Times of one law stand together once they are sorted by it; few at once keep memory low.
        order_of = np.argsort(which, kind="stable")
        edges = np.flatnonzero(np.diff(which[order_of])) + 1
        edges = np.union1d(edges, np.arange(AT_ONCE, len(flat), AT_ONCE))
        result: FloatArray | None = None
        for of in np.split(order_of, edges) if len(flat) else ():
            k = int(which[of[0]])
            law = self.laws[k]
            local = np.clip(flat[of] - self.starts[k], 0, law.breaks[-1])
            where = np.searchsorted(law.breaks, local, side=_checks.side(side))
            values = law.on_interval(np.clip(where - 1, 0, len(law.breaks) - 2), local, order)
            if result is None:
                result = np.empty((len(flat), values.shape[-1]))
            result[of] = values
        if result is None:
            result = np.empty((0, self.dof))
        return result.reshape((*at.shape, result.shape[1]))

    def sample(self, period: float) -> Samples:
        """The trajectory every `period` [s], and at its end.

        Args:
            period: Time between two samples [s]; the last interval may be shorter.
        """
        step = _checks.positive("sampling period", period, "s")
        t = np.append(np.arange(0, self.duration - 1e-9 * step, step), self.duration)
        return Samples(t=t, q=self(t), dq=self(t, 1), ddq=self(t, 2))

    def _law(self, t: FloatArray, side: str) -> npt.NDArray[np.intp]:
        found = np.searchsorted(self.starts, t, side=_checks.side(side)) - 1
        return np.clip(found, 0, len(self.laws) - 1)
