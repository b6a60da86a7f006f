"""Timing of a program: its moves one by one, and all of them as one trajectory."""

from __future__ import annotations

from contextlib import closing
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput, NotRealizable
from armcontour.core.progress import Progress, Step
from armcontour.geometry.segments import REPEATED_POINT
from armcontour.motion import (
    JointPath,
    Law,
    Method,
    PathLaw,
    Span,
    TimedEvent,
    Trajectory,
    dwell_law,
)
from armcontour.planning.constraints import RapidSpeed
from armcontour.planning.optimal import plan_optimal
from armcontour.planning.options import Conventional, Optimal, Paper, PlanOptions, Shaped
from armcontour.planning.program_tracing import TracedMove, Tracing, ends_of
from armcontour.program import Contour, Dwell, Event
from armcontour.robot import Arm, Limits

# Grid intervals of a rapid: limits change little along a straight line of the joints or the tool.
RAPID_INTERVALS = 200
# Events nearer in time than this are at once [s].
SAME_TIME = 1e-9


@dataclass(frozen=True, slots=True)
class Timing:
    """How the moves of a program are timed.

    Args:
        arm: The arm.
        limits: The limits that plans keep, less the reserve for the servo.
        options: The method and its options.
    """

    arm: Arm
    limits: Limits
    options: PlanOptions


def time_program(traced: Tracing, timing: Timing, progress: Progress | None = None) -> Trajectory:
    """Time all moves of a program, with the arm at rest between any two of them.

    Contours keep the limits of the tool and of the joints; rapids keep those of the joints only.
    Moves are planned independently of each other, in other processes where that saves time.

    Args:
        traced: The program with its joint paths.
        timing: How contours and rapids are timed.
        progress: Called after every contour with the step "timing" and the share that is done.

    Raises:
        ArmContourError: A move cannot be planned; the message starts with the name of the contour.
    """
    number, count = 0, len(traced.program.contours)
    rapid_speed = traced.program.rapid_speed
    joined = JoinedMoves(traced, timing.arm)
    moves = [(x.joint_path, traced.is_contour(x)) for x in traced.steps if x.joint_path is not None]
    time_move = partial(_time_move, timing, rapid_speed)
    if len(moves) > 1:
        from armcontour.core.pool import map_in_order

        timed = map_in_order(time_move, moves)
    else:
        timed = (time_move(x) for x in moves)
    with closing(timed) as plans:
        for step in traced.steps:
            found = None
            if step.joint_path is not None:
                with step.named():
                    found = _along(next(plans), step.joint_path)
            joined.add(step, found)
            if traced.is_contour(step) and progress is not None:
                number += 1
                progress(Step(("timing",), number / count))
    return joined.trajectory()


def _time_move(
    timing: Timing, rapid_speed: float | None, move: tuple[JointPath, bool]
) -> Trajectory:
    """Plan the motion along a joint path, which is that of a contour or of a rapid."""
    joint_path, is_contour = move
    if is_contour:
        return time_contour(joint_path, timing)
    return time_rapid(joint_path, timing.arm, timing.limits, rapid_speed)


def time_contour(joint_path: JointPath, timing: Timing) -> Trajectory:
    """Plan the motion along a contour."""
    how, options = (joint_path, timing.arm, timing.limits), timing.options
    if isinstance(options, Conventional):
        from armcontour.planning.conventional import plan_conventional

        return plan_conventional(*how)
    if isinstance(options, Paper):
        from armcontour.planning.paper import plan_paper

        return plan_paper(*how, options)
    if isinstance(options, Optimal):
        return plan_optimal(*how, options)
    assert isinstance(options, Shaped)
    return replace(plan_optimal(*how, Optimal(intervals=options.intervals)), method=Method.SHAPED)


def time_rapid(
    joint_path: JointPath, arm: Arm, limits: Limits, speed: float | None = None
) -> Trajectory:
    """Plan the fastest rapid, which keeps the limits of the joints and ignores those of the tool.

    A tool path keeps the speeds of its segments.

    Args:
        joint_path: The joint path of the rapid.
        arm: The arm.
        limits: Limits of the arm, one value per joint.
        speed: Largest tool speed along a joint path without a tool path [m/s].
    """
    more: tuple[RapidSpeed, ...] = ()
    if speed is not None and joint_path.tool_path is None:
        more = (RapidSpeed(speed, arm),)
    options = Optimal(intervals=RAPID_INTERVALS, constraints=more)
    return plan_optimal(joint_path, arm, limits.of_joints, options)


def _along(found: Trajectory, joint_path: JointPath) -> Trajectory:
    """The plan of a move along its own joint path, of which another process has a copy."""
    if found.path is joint_path.tool_path:
        return found
    (law,) = found.laws
    if isinstance(law, PathLaw) and np.array_equal(law.joint_path.breaks, joint_path.breaks):
        law = replace(law, joint_path=joint_path)
    return replace(found, laws=(law,), path=joint_path.tool_path)


@dataclass(slots=True)
class JoinedMoves:
    """Timed moves of a program that become one trajectory; each starts where the last one ended.

    Args:
        traced: The program with its joint paths.
        arm: The arm.
    """

    traced: Tracing
    arm: Arm
    t: float = 0.0
    length: float = 0.0
    done: JointPath | None = None
    last: Trajectory | None = None
    laws: list[Law] = field(default_factory=list)
    spans: list[Span] = field(default_factory=list)
    events: list[TimedEvent] = field(default_factory=list)

    def add(self, step: TracedMove, trajectory: Trajectory | None) -> None:
        """Append the next step of the program.

        Args:
            step: The step.
            trajectory: The motion along its joint path; None for dwells and events.

        Raises:
            InvalidInput: An event of a contour would be switched off the contour.
        """
        move = None if step.move is None else self.traced.program.moves[step.move]
        if isinstance(move, Dwell):
            self.stand(move.duration, step.move)
            return
        if isinstance(move, Event):
            point = tuple(self.arm.tool_position(self._q).tolist())
            self._add_event(move, self.t - move.lead_time, self.t, self.length, point)
            return
        assert trajectory is not None and step.joint_path is not None
        t, s = (self.t, self.t + trajectory.duration), self.length
        own: dict[str, Any] = {"kind": "rapid"}
        if isinstance(move, Contour):
            work = t
            if move.work is not None and move.work != (0.0, move.path.length):
                on, off = (t[0] + trajectory.time_at(move.work)).tolist()
                work = (on, off)
            own = {"kind": "contour", "name": move.name, "work": work}
            for x in move.events:
                early = _early_place(x, move.path.length, step.called)
                places = np.clip([x.s, early], 0.0, move.path.length)
                due, at = (t[0] + trajectory.time_at(places)).tolist()
                point = tuple(move.path(places[0]).tolist())
                self._add_event(x, at - x.lead_time, due, s + x.s, point)
            self.last, self.length = trajectory, s + move.path.length
        self.laws += trajectory.laws
        self.spans.append(
            Span(move=step.move, t=t, s=(s, self.length), trajectory=trajectory, **own)
        )
        self.t, self.done = t[1], step.joint_path

    def stand(self, duration: float, move: int | None = None) -> None:
        """Append a standstill.

        Args:
            duration: Its time [s].
            move: Index of its dwell; None for a pause that the program does not have.
        """
        t, s = (self.t, self.t + duration), self.length
        self.laws.append(dwell_law(self._q, duration))
        self.spans.append(Span(move=move, kind="dwell", t=t, s=(s, s)))
        self.t = t[1]

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

    @property
    def _q(self) -> FloatArray:
        """Joint positions after the moves so far [rad], (dof,)."""
        if self.done is None:
            return ends_of(self.traced.joint_paths[0])[0]
        return ends_of(self.done)[1]

    def _add_event(
        self, x: Event, t: float, due: float, s: float, point: tuple[float, ...]
    ) -> None:
        """Append an event that is due at a time [s], and switched at the time `t` [s]."""
        self.events.append(TimedEvent(name=x.name, value=x.value, t=t, due=due, s=s, point=point))


def _early_place(x: Event, length: float, called: str) -> float:
    """Arc length at which an event of a contour is switched [m], by its lead along the contour.

    Raises:
        InvalidInput: The event would be switched off the contour.
    """
    early = x.s - x.lead_distance
    if not -REPEATED_POINT <= early <= length + REPEATED_POINT:
        leads = x.lead_distance > 0
        raise InvalidInput(
            f"{called}: the event {x.name} at {x.s:g} m {'leads' if leads else 'lags'} by "
            f"{abs(x.lead_distance):g} m, which is off the contour of {length:g} m: "
            f"give it a lead-{'in' if leads else 'out'} that long.",
            s=x.s,
            needed=abs(x.lead_distance),
            allowed=x.s if leads else length - x.s,
        )
    return early


def check_jerk_support(method: Method, limits: Limits) -> None:
    """Refuse limits of jerk for the methods that keep none.

    Args:
        method: The method.
        limits: The limits.

    Raises:
        NotRealizable: There are limits of jerk, and the method keeps none.
    """
    given = limits.jerk_limits
    if not given or method == Method.OPTIMAL:
        return
    names = " and ".join(given)
    lift = (
        f"lift {names} with limits.replace({', '.join(f'{x}=math.inf' for x in given)}) (in a "
        f"job, limits: {{{', '.join(f'{x}: inf' for x in given)}}})"
    )
    if method == Method.SHAPED:
        raise NotRealizable(
            f"Along a shaped path accelerations jump, at places where {names} would stop the tool: "
            'round corners with continuity="curvature" and plan by the method optimal (in a job, '
            f"corners: {{shape: arc}}, which has it where jerk is limited), or {lift}.",
            limit=given[0],
        )
    raise NotRealizable(
        f"The method {method} keeps no limits of jerk, but there is {names}: plan by the method "
        f"optimal (in a job, timing: {{method: optimal}}), or {lift}.",
        limit=given[0],
    )
