"""Timing a program: every contour by itself, free rapids between them, one trajectory of all."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from armcontour._checks import FloatArray
from armcontour._progress import Progress, Step
from armcontour.errors import InvalidInput
from armcontour.geometry.segments import REPEATED_POINT
from armcontour.motion import JointPath, Law, Span, TimedEvent, Trajectory, stand_still
from armcontour.program import Contour, Dwell, Event
from armcontour.timing.methods import MoveTiming
from armcontour.timing.program_tracing import TracedMove, Tracing, ends_of

# Events nearer in time than this are at once [s].
SAME_TIME = 1e-9


def time_program(
    traced: Tracing, timing: MoveTiming, progress: Progress | None = None
) -> Trajectory:
    """One trajectory of all moves of a program, at rest between any two of them.

    Limits of the tool hold along contours; rapids have those of the joints.

    Args:
        traced: The program with what the joints follow.
        timing: How contours and rapids are timed.
        progress: Called after every contour with the step "timing" and the share that is done.

    Raises:
        ArmContourError: As planning raises it, with the contour's name.
    """
    chain = _Chain(traced, timing)
    number, count = 0, len(traced.program.contours)
    for step in traced.steps:
        move = None if step.move is None else traced.program.moves[step.move]
        if isinstance(move, Contour):
            chain.contour(step, move)
            number += 1
            if progress is not None:
                progress(Step(("timing",), number / count))
        elif isinstance(move, Event | Dwell):
            chain.still(step, move)
        else:
            chain.rapid(step)
    return chain.trajectory()


@dataclass(slots=True)
class _Chain:
    """Moves timed so far, each beginning where the one before ended."""

    traced: Tracing
    timing: MoveTiming
    t: float = 0.0
    length: float = 0.0
    done: JointPath | None = None
    last: Trajectory | None = None
    laws: list[Law] = field(default_factory=list)
    spans: list[Span] = field(default_factory=list)
    events: list[TimedEvent] = field(default_factory=list)

    def contour(self, step: TracedMove, move: Contour) -> None:
        """A contour, with what is switched along it."""
        assert step.joint_path is not None
        with step.named():
            self._pause()
            planned = self.timing.contour(step.joint_path, self.laws)
        begun, end = self.t, self.t + planned.duration
        work = (begun, end)
        if move.work is not None:
            on, off = (begun + planned.time_at(move.work)).tolist()
            work = (on, off)
        s = (self.length, self.length + move.path.length)
        self._append(
            step.joint_path,
            Span(
                move=step.move,
                kind="contour",
                name=move.name,
                t=(begun, end),
                s=s,
                work=work,
                trajectory=planned,
            ),
        )
        self.last, self.length = planned, s[1]
        for x in move.events:
            self._timed(x, move, planned, begun, s[0], step.called)

    def rapid(self, step: TracedMove) -> None:
        """A rapid, along its path or along a straight line of the joints."""
        assert step.joint_path is not None
        with step.named():
            planned = self.timing.rapid(step.joint_path, self.laws)
        t, s = (self.t, self.t + planned.duration), (self.length, self.length)
        span = Span(move=step.move, kind="rapid", t=t, s=s, trajectory=planned)
        self._append(step.joint_path, span)

    def still(self, step: TracedMove, move: Event | Dwell) -> None:
        """What comes where the joints stand."""
        if isinstance(move, Dwell):
            self._stand(step.move, move.duration)
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
        assert self.last is not None
        single_path = self.traced.program.single_path
        return Trajectory(
            laws=tuple(self.laws),
            method=self.last.method,
            path=single_path,
            # Stretches have times and places of their own path.
            stretches=() if single_path is None else self.last.stretches,
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

    def _append(self, joint_path: JointPath, span: Span) -> None:
        assert span.trajectory is not None
        self.laws += span.trajectory.laws
        self.spans.append(span)
        self.t, self.done = span.t[1], joint_path

    @property
    def _q(self) -> FloatArray:
        """Where the joints stand now [rad], (dof,)."""
        if self.done is None:
            return ends_of(self.traced.joint_paths[0])[0]
        return ends_of(self.done)[1]

    def _stand(self, move: int | None, duration: float) -> None:
        """Stand still for a dwell of the program, or for a pause that is none of its moves."""
        t, s = (self.t, self.t + duration), self.length
        self.laws.append(stand_still(self._q, duration))
        self.spans.append(Span(move=move, kind="dwell", t=t, s=(s, s)))
        self.t = t[1]

    def _pause(self) -> None:
        """Stand still until the contour that follows may start."""
        duration = self.timing.pause(self.laws) if self.laws else 0.0
        if duration > 0:
            self._stand(None, duration)

    def _switch(self, x: Event) -> None:
        """What is switched where the joints stand now."""
        self.events.append(
            TimedEvent(
                name=x.name,
                value=x.value,
                t=self.t - x.lead_time,
                due=self.t,
                s=self.length,
                point=tuple(self.timing.arm.forward(self._q).tolist()),
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
