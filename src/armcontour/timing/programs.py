"""Planning a program: every contour by itself, free rapids between them, one trajectory of all."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field
from functools import partial

import numpy as np
import numpy.typing as npt

from armcontour._checks import FloatArray
from armcontour.arms import Arm, Limits, PlanarTwoLink
from armcontour.arms.limits import TOOL_LIMITS
from armcontour.errors import ArmContourError, InvalidInput, Unreachable, locate_errors
from armcontour.frames import exp, log, shortest
from armcontour.geometry import Path
from armcontour.geometry.cutting import reverse_path
from armcontour.geometry.orientation import Orientation
from armcontour.geometry.segments import REPEATED_POINT
from armcontour.motion import (
    JointPath,
    Law,
    Method,
    Span,
    TimedEvent,
    Trajectory,
    stand_still,
)
from armcontour.program import Contour, Dwell, Event, Program, Rapid, contour_called
from armcontour.timing.fastest_configuration import trace_fastest
from armcontour.timing.optimal import plan_optimal
from armcontour.tracing import trace

# Joint positions nearer than this are the same [rad]: what exact inverse kinematics leaves.
SAME_POSITION = 1e-9
# Events nearer in time than this are at once [s].
SAME_TIME = 1e-9
# A rapid's grid: its limits change little along a straight line of the joints or of the tool.
RAPID_INTERVALS = 200

# Plans a joint path that follows some laws.
Plan = Callable[[JointPath, Sequence[Law]], Trajectory]
# How long the joints are to stand still after some laws, before the contour that follows [s].
Pause = Callable[[Sequence[Law]], float]
Progress = Callable[[int, int], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Ways:
    """How the moves of a program are traced and timed.

    Args:
        arm: The arm.
        limits: Of this arm, one value per joint.
        branch: As in `plan`.
        start: As in `plan`.
        contour: Plans a contour along its joint path, after the moves before it.
        rapid: Plans a rapid along its joint path, after the moves before it.
        pause: Says how long to stand still between a rapid and its contour; None is not at all.
        joint_paths: Of the moves by their indices, as far as they are traced. Tracing does not
            depend on timing, so whoever plans a program again hands the same dictionary over.
    """

    arm: Arm
    limits: Limits
    branch: str | None
    start: npt.ArrayLike | None
    contour: Plan
    rapid: Plan
    pause: Pause | None = None
    joint_paths: dict[int, JointPath] = field(default_factory=dict)


def plan_program(program: Program, ways: Ways, progress: Progress | None = None) -> Trajectory:
    """One trajectory of all moves of a program, at rest between any two of them.

    Limits of the tool hold along contours; rapids have those of the joints. A rapid without a path,
    and whatever gap is left between two moves, is a straight line of the joints. The first contour
    starts in the configuration that is fastest along it; every other one in that which is nearest
    to where the joints are then, or in the fastest if that does not complete it.

    Args:
        program: The program, with its corners rounded and the tool's orientation given.
        ways: How its moves are planned.
        progress: Called with the number of contours done, and of all.

    Raises:
        ArmContourError: As tracing and planning raise it, with the contour's name.
    """
    chain = _Chain(program, ways)
    number, count = 0, len(program.contours)
    for i, move in enumerate(program.moves):
        if isinstance(move, Contour):
            chain.contour(i, move, number)
            number += 1
            if progress is not None:
                progress(number, count)
        elif isinstance(move, Rapid):
            chain.rapid(i, move)
        else:
            chain.still(i, move)
    return chain.trajectory()


@dataclass(slots=True)
class _Chain:
    """Moves planned so far, each beginning where the one before ended."""

    program: Program
    ways: Ways
    q: FloatArray | None = None
    t: float = 0.0
    laws: list[Law] = field(default_factory=list)
    spans: list[Span] = field(default_factory=list)
    events: list[TimedEvent] = field(default_factory=list)
    waiting: list[tuple[int, Event | Dwell]] = field(default_factory=list)
    method: str = Method.OPTIMAL
    length: float = 0.0

    def contour(self, i: int, move: Contour, number: int) -> None:
        called = contour_called(move, number)
        alone = len(self.program.moves) == 1 and not move.name
        with nullcontext() if alone else locate_errors(called):
            joint_path = self._known(i, lambda: self._traced(move.path))
            self._bridge(joint_path(0.0))
            self._pause()
            planned = self.ways.contour(joint_path, self.laws)
        self.method = planned.method
        begun, offset = self.t, self.length
        ends = (0.0, move.path.length) if move.work is None else move.work
        work = begun + planned.time_at(ends)
        self._append(
            planned,
            Span(
                move=i,
                kind="contour",
                name=move.name,
                t=(begun, begun + planned.duration),
                s=(offset, offset + move.path.length),
                work=(float(work[0]), float(work[1])),
                trajectory=planned,
            ),
        )
        self.length += move.path.length
        for x in move.events:
            self._timed(x, move, planned, begun, offset, called)

    def rapid(self, i: int, move: Rapid) -> None:
        """A rapid along a path; one without bridges the gap to the next contour, which does it."""
        if move.path is None:
            return
        path = self._held(i, move.path)
        with locate_errors(self._rapid_called(i)):
            first = self.q is None and self.ways.start is None
            trace_move = partial(self._led, i) if first else self._traced
            joint_path = self._known(i, lambda: trace_move(path))
            self._bridge(joint_path(0.0))
            planned = self.ways.rapid(joint_path, self.laws)
        self._append_rapid(i, planned)

    def still(self, i: int, move: Event | Dwell) -> None:
        """What comes where the joints stand; before the first contour it waits to know where."""
        if self.q is None:
            self.waiting.append((i, move))
        elif isinstance(move, Dwell):
            self._stand(i, move)
        else:
            self._switch(move)

    def trajectory(self) -> Trajectory:
        """All that was planned."""
        early = next((x for x in self.events if x.t < 0), None)
        if early is not None:
            raise InvalidInput(
                f"The event {early.name} is to come {-early.t:.6g} s before the motion begins: "
                "begin with a longer lead-in or a dwell, or give it less lead.",
                t=early.t,
                allowed=0.0,
            )
        self._refuse_disorder()
        return Trajectory(
            laws=tuple(self.laws),
            method=self.method,
            spans=tuple(self.spans),
            events=tuple(sorted(self.events, key=lambda x: x.t)),
        )

    def _refuse_disorder(self) -> None:
        """Refuse leads that bring what is switched into another order than it is meant in."""
        last: dict[str, TimedEvent] = {}
        for x in self.events:
            before = last.get(x.name)
            if before is not None and x.t < before.t - SAME_TIME and x.value != before.value:
                raise InvalidInput(
                    f"The event {x.name} to {x.value} at {x.s:.6g} m would come at {x.t:.6g} s, "
                    f"with its lead, and so before the one to {before.value} at {before.s:.6g} m, "
                    f"which comes at {before.t:.6g} s: give it less lead, or more way or time "
                    "between them.",
                    s=x.s,
                    t=x.t,
                    allowed=before.t,
                )
            last[x.name] = x

    def _known(self, i: int, trace_move: Callable[[], JointPath]) -> JointPath:
        """The joint path of move i, which is traced if it is not known yet."""
        known = self.ways.joint_paths
        if i not in known:
            known[i] = trace_move()
        return known[i]

    def _traced(self, path: Path) -> JointPath:
        """A path from the configuration that the joints are in, if that completes it."""
        if self.q is None or isinstance(self.ways.arm, PlanarTwoLink):
            start = self.ways.start if self.q is None else None
            return trace_fastest(
                path, self.ways.arm, self.ways.limits, branch=self.ways.branch, start=start
            )
        try:
            return trace(path, self.ways.arm, limits=self.ways.limits, start=self.q)
        except Unreachable:
            return trace_fastest(path, self.ways.arm, self.ways.limits)

    def _led(self, i: int, path: Path) -> JointPath:
        """A rapid before the first contour, in the configuration that is fastest along that."""
        ways = self.ways
        contour = next(x for x in self.program.moves[i:] if isinstance(x, Contour))
        if isinstance(ways.arm, PlanarTwoLink):
            return self._traced(path)
        try:
            fastest = trace_fastest(contour.path, ways.arm, ways.limits)
            back = trace(reverse_path(path), ways.arm, limits=ways.limits, start=fastest(0.0))
            return trace(path, ways.arm, limits=ways.limits, start=back(back.length))
        except ArmContourError:
            # In another configuration, if there is one; what is wrong with the contour, it says.
            return self._traced(path)

    def _bridge(self, q: FloatArray) -> None:
        """A straight line of the joints to where the next move begins."""
        if self.q is None:
            self.q = q
            for i, x in self.waiting:
                self.still(i, x)
            return
        if np.abs(q - self.q).max() <= SAME_POSITION:
            return
        line = JointPath.spline([self.q, q])
        self._append_rapid(None, self.ways.rapid(line, self.laws))

    def _append_rapid(self, i: int | None, planned: Trajectory) -> None:
        ends, s = (self.t, self.t + planned.duration), self.length
        self._append(planned, Span(move=i, kind="rapid", t=ends, s=(s, s), trajectory=planned))

    def _append(self, planned: Trajectory, span: Span) -> None:
        self.laws += planned.laws
        self.spans.append(span)
        self.t = span.t[1]
        self.q = planned(planned.duration, side="left")

    def _stand(self, i: int | None, move: Dwell) -> None:
        assert self.q is not None
        ends, s = (self.t, self.t + move.duration), self.length
        self.laws.append(stand_still(self.q, move.duration))
        self.spans.append(Span(move=i, kind="dwell", t=ends, s=(s, s)))
        self.t = ends[1]

    def _pause(self) -> None:
        """Stand still until the contour that follows may start."""
        if self.ways.pause is None or not self.laws:
            return
        duration = self.ways.pause(self.laws)
        if duration > 0:
            self._stand(None, Dwell(duration=duration))

    def _switch(self, x: Event) -> None:
        """What is switched where the joints stand now."""
        assert self.q is not None
        self.events.append(
            TimedEvent(
                name=x.name,
                value=x.value,
                t=self.t - x.lead_time,
                due=self.t,
                s=self.length,
                point=tuple(self.ways.arm.forward(self.q).tolist()),
            )
        )

    def _timed(
        self, x: Event, move: Contour, planned: Trajectory, begun: float, offset: float, called: str
    ) -> None:
        early = x.s - x.lead_distance
        if not -REPEATED_POINT <= early <= move.path.length + REPEATED_POINT:
            leads = x.lead_distance > 0
            raise InvalidInput(
                f"{called}: the event {x.name} at {x.s:g} m {'leads' if leads else 'lags'} by "
                f"{abs(x.lead_distance):g} m, which is off the contour of {move.path.length:g} m: "
                f"give it a lead-{'in' if leads else 'out'} that long.",
                s=x.s,
                needed=abs(x.lead_distance),
                allowed=x.s if leads else move.path.length - x.s,
            )
        places = np.clip([x.s, early], 0.0, move.path.length)
        due, t = (begun + planned.time_at(places)).tolist()
        self.events.append(
            TimedEvent(
                name=x.name,
                value=x.value,
                t=t - x.lead_time,
                due=due,
                s=offset + x.s,
                point=tuple(move.path(min(x.s, move.path.length)).tolist()),
            )
        )

    def _rapid_called(self, i: int) -> str:
        """A rapid by the contour that it leads to, or away from."""
        contours = [(k, x) for k, x in enumerate(self.program.moves) if isinstance(x, Contour)]
        number = sum(k < i for k, _ in contours)
        if number < len(contours):
            return f"rapid to {contour_called(contours[number][1], number)}"
        return f"rapid away from {contour_called(contours[-1][1], number - 1)}"

    def _held(self, i: int, path: Path) -> Path:
        """A rapid's path with the tool turning from the last contour's way to the next one's."""
        if path.orientation is not None or path.dimension == 2:
            return path
        moves = self.program.moves
        before = next(
            (moves[k] for k in range(i - 1, -1, -1) if isinstance(moves[k], Contour)), None
        )
        after = next(
            (moves[k] for k in range(i + 1, len(moves)) if isinstance(moves[k], Contour)), None
        )
        ends = [(x.path, x.path.length) for x in (before,) if isinstance(x, Contour)]
        ends += [(x.path, 0.0) for x in (after,) if isinstance(x, Contour)]
        held = [x.orientation(s) for x, s in ends if x.orientation is not None]
        if not held:
            return path
        free = all(x.orientation.axis_only for x, _ in ends if x.orientation is not None)
        first, last = held[0], held[-1]
        # Of two ways of half a turn either will do, and an axis that is free to turn asks for none.
        turn = shortest(first[:, 2], last[:, 2]) if free else log((last @ first.T)[None])[0]
        rates = np.tile(turn / path.length, (len(path), 1))
        starts = exp(path.breaks[:-1, None] * rates) @ first
        return dataclasses.replace(
            path,
            orientation=Orientation.even(path.lengths, starts, rates, axis_only=free),
        )


def plan_rapid(joint_path: JointPath, arm: Arm, limits: Limits) -> Trajectory:
    """A free motion: the limits of the joints hold, and none of the tool."""
    free = limits.replace(**dict.fromkeys(TOOL_LIMITS, None))
    return plan_optimal(joint_path, arm, free, intervals=RAPID_INTERVALS)
