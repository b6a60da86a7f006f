"""Timing of a program: contours, rapids, dwells and events as one trajectory."""

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
from armcontour.timing.planned_moves import planned_in_processes
from armcontour.timing.program_tracing import TracedMove, Tracing, ends_of

# Events nearer in time than this are at once [s].
SAME_TIME = 1e-9


def time_program(
    traced: Tracing, timing: MoveTiming, progress: Progress | None = None
) -> Trajectory:
    """Time all moves of a program, with the arm at rest between any two of them.

    Contours keep the limits of the tool and of the joints; rapids keep those of the joints only.

    Args:
        traced: The program with its joint paths.
        timing: How contours and rapids are timed.
        progress: Called after every contour with the step "timing" and the share that is done.

    Raises:
        ArmContourError: A move cannot be planned; the message starts with the name of the contour.
    """
    number, count = 0, len(traced.program.contours)
    with planned_in_processes(traced, timing) as planned:
        chain = _Chain(traced, planned)
        for step in traced.steps:
            move = None if step.move is None else traced.program.moves[step.move]
            if isinstance(move, Contour):
                chain.add_contour(step, move)
                number += 1
                if progress is not None:
                    progress(Step(("timing",), number / count))
            elif isinstance(move, Event | Dwell):
                chain.add_still(step, move)
            else:
                chain.add_rapid(step)
        return chain.trajectory()


@dataclass(slots=True)
class _Chain:
    """Moves timed so far; each starts where the one before ended."""

    traced: Tracing
    timing: MoveTiming
    t: float = 0.0
    length: float = 0.0
    done: JointPath | None = None
    last: Trajectory | None = None
    laws: list[Law] = field(default_factory=list)
    spans: list[Span] = field(default_factory=list)
    events: list[TimedEvent] = field(default_factory=list)

    def add_contour(self, step: TracedMove, move: Contour) -> None:
        """Plan and append a contour with its events."""
        assert step.joint_path is not None
        with step.named():
            self._pause()
            trajectory = self.timing.contour(step.joint_path, self.laws)
        start, end = self.t, self.t + trajectory.duration
        work = (start, end)
        if move.work is not None and move.work != (0.0, move.path.length):
            on, off = (start + trajectory.time_at(move.work)).tolist()
            work = (on, off)
        s = (self.length, self.length + move.path.length)
        self._append(
            step.joint_path,
            Span(
                move=step.move,
                kind="contour",
                name=move.name,
                t=(start, end),
                s=s,
                work=work,
                trajectory=trajectory,
            ),
        )
        self.last, self.length = trajectory, s[1]
        for x in move.events:
            self._add_event(x, move, trajectory, start, s[0], step.called)

    def add_rapid(self, step: TracedMove) -> None:
        """Plan and append a rapid, along its path or along a straight line in joint space."""
        assert step.joint_path is not None
        with step.named():
            trajectory = self.timing.rapid(step.joint_path, self.laws)
        t, s = (self.t, self.t + trajectory.duration), (self.length, self.length)
        span = Span(move=step.move, kind="rapid", t=t, s=s, trajectory=trajectory)
        self._append(step.joint_path, span)

    def add_still(self, step: TracedMove, move: Event | Dwell) -> None:
        """Append a dwell, or an event between moves."""
        if isinstance(move, Dwell):
            self._stand(step.move, move.duration)
        else:
            self._add_event_at_rest(move)

    def trajectory(self) -> Trajectory:
        """The trajectory of all moves so far.

        Raises:
            InvalidInput: An event would come before the motion starts, or out of order.
        """
        early = next((x for x in self.events if x.t < 0), None)
        if early is not None:
            raise InvalidInput(
                f"The event {early.name} is to come {-early.t:.6g} s before the motion begins: "
                "start with a longer lead-in or a dwell, or give the event less advance.",
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
            # The times and arc lengths of stretches count from the start of their own path.
            stretches=() if single_path is None else self.last.stretches,
            spans=tuple(self.spans),
            events=tuple(sorted(self.events, key=lambda x: x.t)),
        )

    def _refuse_disorder(self) -> None:
        """Refuse advances that change the order in which one output is switched."""
        last: dict[str, TimedEvent] = {}
        for x in self.events:
            before = last.get(x.name)
            if before is not None and x.t < before.t - SAME_TIME and x.value != before.value:
                raise InvalidInput(
                    f"The event {x.name} to {x.value} at {x.s:.6g} m would come at {x.t:.6g} s, "
                    f"with its advance, before the one to {before.value} at {before.s:.6g} m, "
                    f"which comes at {before.t:.6g} s: give it less advance, or more distance or "
                    "time between them.",
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
        """Joint positions after the moves so far [rad], (dof,)."""
        if self.done is None:
            return ends_of(self.traced.joint_paths[0])[0]
        return ends_of(self.done)[1]

    def _stand(self, move: int | None, duration: float) -> None:
        """Append a standstill [s]; `move` is the index of its dwell, None for a pause."""
        t, s = (self.t, self.t + duration), self.length
        self.laws.append(stand_still(self._q, duration))
        self.spans.append(Span(move=move, kind="dwell", t=t, s=(s, s)))
        self.t = t[1]

    def _pause(self) -> None:
        """Append the standstill that the next contour needs before its start."""
        duration = self.timing.pause(self.laws) if self.laws else 0.0
        if duration > 0:
            self._stand(None, duration)

    def _add_event_at_rest(self, x: Event) -> None:
        """Append an event at the present joint positions."""
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

    def _add_event(
        self,
        x: Event,
        move: Contour,
        trajectory: Trajectory,
        start: float,
        offset: float,
        called: str,
    ) -> None:
        """Append an event of a contour.

        Args:
            x: The event.
            move: The contour.
            trajectory: The motion along the contour.
            start: Start time of the contour [s].
            offset: Length of the contours before it [m].
            called: Name of the contour in error messages.

        Raises:
            InvalidInput: The event would be switched off the contour.
        """
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
        due, t = (start + trajectory.time_at(places)).tolist()
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
