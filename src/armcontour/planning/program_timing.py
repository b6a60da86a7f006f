"""Timing of the moves of a program, also with a given duration, and their joint trajectory."""

from __future__ import annotations

from collections.abc import Hashable
from contextlib import closing
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput, NotRealizable
from armcontour.core.memory import content_key, is_remembering, recall, remember
from armcontour.core.progress import Progress, contour_step
from armcontour.motion import (
    JointPath,
    Law,
    LawAlongPath,
    PathLaw,
    Span,
    TimedEvent,
    TimedWait,
    Trajectory,
    arm_of,
    dwell_law,
)
from armcontour.planning.constraints import RapidSpeed
from armcontour.planning.law_checks import check_limits
from armcontour.planning.optimal_timing import Optimal, plan_optimal
from armcontour.planning.program_tracing import TracedMove, Tracing, ends_of
from armcontour.planning.timing_options import LONGEST_MOTION, PlanOptions
from armcontour.program import Contour, Dwell, Event, Wait
from armcontour.program.moves import contour_called
from armcontour.robot import Arm, Limits
from armcontour.robot.limits import LIMITS, reduce_limits

# Number of grid intervals of a rapid. Few suffice, because limits change little along a straight
# line of the joints or the tool.
RAPID_INTERVALS = 200
# Events closer in time than this are simultaneous [s].
SAME_TIME = 1e-9
# Durations that differ by less than this fraction are equal.
SAME_DURATION = 1e-9


@dataclass(frozen=True, slots=True)
class Timing:
    """Arm, limits and method by which the moves of a program are timed."""

    arm: Arm
    limits: Limits
    options: PlanOptions


def time_program(traced: Tracing, timing: Timing, progress: Progress | None = None) -> Trajectory:
    """Time all moves of a program, with the arm at rest between two moves.

    Contours satisfy the limits of the tool and of the joints; rapids satisfy the limits of the
    joints only. Moves are planned independently, in other processes if that saves time.

    - `traced`: the program with its joint paths.
    - `progress`: called after every contour with the step "timing" and the fraction done.
    """
    number = 0
    count = len(traced.program.contours)
    rapid_speed = traced.program.rapid_speed
    joined = JoinedMoves(traced, timing.arm)
    moves = [(x.joint_path, traced.is_contour(x)) for x in traced.steps if x.joint_path is not None]
    time_move = partial(_time_move, timing, rapid_speed)
    key: tuple[Hashable, ...] = ()
    if is_remembering():
        key = timing.arm, content_key((timing.limits, timing.options, rapid_speed))
    new = [x for x in moves if recall(("timing", *key, *x)) is None]
    if len(new) > 1:
        from armcontour.core.pool import map_in_order

        timed = map_in_order(time_move, new)
    else:
        timed = (time_move(x) for x in new)
    with closing(timed) as plans:
        for step in traced.steps:
            trajectory = None
            if step.joint_path is not None:
                key_of_move = "timing", *key, step.joint_path, traced.is_contour(step)
                trajectory = recall(key_of_move)
                if trajectory is None:
                    with step.named():
                        trajectory = _restore_joint_path(next(plans), step.joint_path)
                    remember(key_of_move, trajectory)
            joined.add(step, trajectory)
            if traced.is_contour(step) and progress is not None:
                number += 1
                progress(contour_step("timing", number, count))
    return joined.trajectory()


def _time_move(
    timing: Timing, rapid_speed: float | None, move: tuple[JointPath, bool]
) -> Trajectory:
    """Time one move of a program.

    - `rapid_speed`: largest tool speed of rapids [m/s]; None without a limit.
    - `move`: the joint path, and whether it belongs to a contour.
    """
    joint_path, is_contour = move
    if is_contour:
        return timing.options.time(joint_path, timing.arm, timing.limits)
    return time_rapid(joint_path, timing.arm, timing.limits, rapid_speed)


def time_rapid(
    joint_path: JointPath, arm: Arm, limits: Limits, speed: float | None = None
) -> Trajectory:
    """Plan the fastest rapid within the limits of the joints; limits of the tool are ignored.

    If the joint path has a tool path, the speeds of its segments also apply.

    - `joint_path`: the joint path of the rapid.
    - `limits`: limits of the arm, one value per joint.
    - `speed`: largest tool speed along a joint path without a tool path [m/s].
    """
    constraints: tuple[RapidSpeed, ...] = ()
    if speed is not None and joint_path.tool_path is None:
        constraints = (RapidSpeed(speed, arm),)
    options = Optimal(intervals=RAPID_INTERVALS, constraints=constraints)
    return plan_optimal(joint_path, arm, limits.of_joints, options)


def _restore_joint_path(trajectory: Trajectory, joint_path: JointPath) -> Trajectory:
    """Replace the copy of the joint path in a plan of another process by the original."""
    if trajectory.path is joint_path.tool_path:
        return trajectory
    (law,) = trajectory.laws
    if isinstance(law, PathLaw):
        law = replace(law, joint_path=joint_path)
    return replace(trajectory, laws=(law,), path=joint_path.tool_path)


@dataclass(slots=True)
class JoinedMoves:
    """Timed moves of a program, which are joined to one trajectory in order."""

    traced: Tracing
    arm: Arm
    t: float = 0.0  # End time of the moves added so far [s]
    length: float = 0.0  # Length of the contours added so far [m]
    last_joint_path: JointPath | None = None
    last_contour: Trajectory | None = None
    laws: list[Law] = field(default_factory=list)
    spans: list[Span] = field(default_factory=list)
    events: list[TimedEvent] = field(default_factory=list)
    waits: list[TimedWait] = field(default_factory=list)
    # Number of events before each wait.
    events_before: list[int] = field(default_factory=list)

    def add(self, step: TracedMove, trajectory: Trajectory | None) -> None:
        """Append the next step of the program.

        `trajectory` is the motion along its joint path, or None for dwells and events.
        """
        move = None if step.move is None else self.traced.program.moves[step.move]
        if isinstance(move, Dwell):
            if move.wait is not None:
                self._add_wait(move.wait)
            self.add_dwell(move.duration, step.move)
            return
        if isinstance(move, Event):
            point = tuple(self.arm.tool_position(self._q).tolist())
            self._add_event(move, self.t, self.length, point)
            return
        assert trajectory is not None and step.joint_path is not None
        t = (self.t, self.t + trajectory.duration)
        s = self.length
        fields: dict[str, Any] = {"kind": "rapid"}
        if isinstance(move, Contour):
            work = t
            if move.work is not None and move.work != (0.0, move.path.length):
                work_start, work_end = (t[0] + trajectory.time_at(move.work)).tolist()
                work = (work_start, work_end)
            fields = {"kind": "contour", "name": move.name, "work": work}
            for event in move.events:
                s_event = min(event.s, move.path.length)
                due = t[0] + float(trajectory.time_at(s_event))
                point = tuple(move.path(s_event).tolist())
                self._add_event(event, due, s + event.s, point)
            self.last_contour = trajectory
            self.length = s + move.path.length
        self.laws += trajectory.laws
        self.spans.append(
            Span(move=step.move, t=t, s=(s, self.length), trajectory=trajectory, **fields)
        )
        self.t = t[1]
        self.last_joint_path = step.joint_path

    def add_dwell(self, duration: float, move: int | None = None) -> None:
        """Append a dwell.

        - `duration`: duration [s].
        - `move`: index of the dwell; None for a pause that is not in the program.
        """
        t = (self.t, self.t + duration)
        s = self.length
        self.laws.append(dwell_law(self._q, duration))
        self.spans.append(Span(move=move, kind="dwell", t=t, s=(s, s)))
        self.t = t[1]

    def trajectory(self) -> Trajectory:
        """Join the moves added so far to one trajectory."""
        too_early = next((x for x in self.events if x.t < 0), None)
        if too_early is not None:
            contours = self.traced.program.contours
            first = "" if len(contours) == 1 else f" for {contour_called(contours[0], 0)}"
            raise InvalidInput(
                f"The event {too_early.name} would be switched {-too_early.t:.6g} s before the "
                f"motion begins{first}. Begin with an approach, or rest before the first contour "
                "(process.approach or process.dwell in a job), or reduce the advance of the event "
                "(on_lead, lead_time).",
                t=too_early.t,
                allowed=0.0,
            )
        self._refuse_disorder()
        self._refuse_events_in_waits()
        assert self.last_contour is not None
        single_path = self.traced.program.single_path
        return Trajectory(
            laws=tuple(self.laws),
            method=self.last_contour.method,
            path=single_path,
            # Times and arc lengths of stretches are relative to the start of their path.
            stretches=() if single_path is None else self.last_contour.stretches,
            spans=tuple(self.spans),
            events=tuple(sorted(self.events, key=lambda x: x.t)),
            waits=tuple(self.waits),
        )

    def _refuse_disorder(self) -> None:
        """Raise InvalidInput if lead times change the switching order of an output."""
        last_events: dict[str, TimedEvent] = {}
        for event in self.events:
            before = last_events.get(event.name)
            is_earlier = before is not None and event.t < before.t - SAME_TIME
            if before is not None and is_earlier and event.value != before.value:
                raise InvalidInput(
                    f"Because of its advance, the event at {event.s:.6g} m would switch "
                    f"{event.name} to {event.value} at {event.t:.6g} s, before the previous event "
                    f"at {before.s:.6g} m switches it to {before.value} at {before.t:.6g} s. "
                    "Reduce the advance, or increase the distance or time between the events.",
                    s=event.s,
                    t=event.t,
                    allowed=before.t,
                )
            last_events[event.name] = event

    def _refuse_events_in_waits(self) -> None:
        """Raise InvalidInput if an event of one side of a wait is due on its other side.

        While the robot waits, its program does not switch outputs.
        """
        for wait, count in zip(self.waits, self.events_before, strict=True):
            late = [x for x in self.events[:count] if x.t > wait.t + SAME_TIME]
            early = [x for x in self.events[count:] if x.t < wait.t + wait.rest - SAME_TIME]
            for event in (*late, *early):
                remedy = "Reduce its advance" if event in early else "Reduce its delay"
                raise InvalidInput(
                    f"{event.name} would be switched at {event.t:.6g} s, while the robot waits for "
                    f"{wait.input} at {wait.t:.6g} s. {remedy}, or remove the wait.",
                    t=event.t,
                    allowed=wait.t,
                )

    def _add_wait(self, wait: Wait) -> None:
        """Append a wait at the end of the moves added so far."""
        self.waits.append(
            TimedWait(input=wait.input, within=wait.within, at=wait.at, t=self.t, rest=wait.rest)
        )
        self.events_before.append(len(self.events))

    @property
    def _q(self) -> FloatArray:
        """Joint positions after the moves added so far [rad], (dof,)."""
        if self.last_joint_path is None:
            return ends_of(self.traced.joint_paths[0])[0]
        return ends_of(self.last_joint_path)[1]

    def _add_event(self, event: Event, due: float, s: float, point: tuple[float, ...]) -> None:
        """Append an event, which switches its output by the lead time before it is due.

        - `due`: time at which the tool is at the event's point [s].
        - `s`: arc length of this point in the program [m].
        - `point`: its coordinates [m].
        """
        t = due - event.lead_time
        self.events.append(
            TimedEvent(name=event.name, value=event.value, t=t, due=due, s=s, point=point)
        )


def slow_down(
    fastest: Trajectory, duration: float, traced: Tracing | JointPath, timing: Timing
) -> Trajectory:
    """Slow the fastest motion down to a given duration.

    All contours are slowed down by one factor. Rapids and dwells keep their durations.

    At each point of the path, a limit allows a convex set of pairs (u, x) of path acceleration and
    squared path speed. The set contains (0, 0), because a plan is refused where gravity or dry
    friction alone exceed a limit. Therefore the set contains (u, x) / factor² for every factor
    >= 1, and a slowed motion satisfies the limits that the fastest one satisfies. Viscous friction
    is the exception, because it is proportional to the root of x: where it assists braking, the
    slower motion can need more torque. The slower motion is then checked.

    - `duration`: duration from start to end [s].
    - `traced`: the tracing or joint path of the motion.
    - `timing`: arm, limits and options with which the fastest motion was planned; the options are
      `Optimal`.
    """
    if isinstance(traced, JointPath):
        factor = _slowing_factor(duration, fastest.duration, 0.0)
        return _slow_down(fastest, factor, timing)
    contours = sum(x.t[1] - x.t[0] for x in fastest.contour_spans)
    factor = _slowing_factor(duration, contours, fastest.duration - contours)
    move_trajectories = (x.trajectory for x in fastest.spans if x.trajectory is not None)
    joined = JoinedMoves(traced, timing.arm)
    for step in traced.steps:
        trajectory = None if step.joint_path is None else next(move_trajectories)
        if trajectory is not None and traced.is_contour(step):
            with step.named():
                trajectory = _slow_down(trajectory, factor, timing)
        joined.add(step, trajectory)
    return joined.trajectory()


def _slowing_factor(duration: float, contours: float, others: float) -> float:
    """Return the slow-down factor of the contours with which the motion takes `duration` [s].

    - `contours`, `others`: shortest durations of all contours and of all other moves [s].
    """
    shortest = contours + others
    if duration < shortest * (1 - SAME_DURATION):
        raise NotRealizable(
            f"The motion cannot take {duration:.9g} s, because the fastest motion takes "
            f"{shortest:.9g} s. Specify a longer duration, or raise the active limits.",
            limit="duration",
            needed=shortest,
            allowed=duration,
        )
    return max((duration - others) / contours, 1.0)


def at_speed(trajectory: Trajectory, speed_factor: float) -> Trajectory:
    """Stretch a plan to a fraction of its speed, and check its torques and duration.

    The slower motion satisfies every limit that the plan satisfies, except torques if viscous
    friction assists braking (see `slow_down`).

    - `trajectory`: a plan with arm and limits.
    - `speed_factor`: ratio of the new speed to the planned speed.
    """
    if speed_factor == 1.0:
        return trajectory
    slow = trajectory.stretched(speed_factor)
    check_longest(slow.duration, "Raise the speed factor")
    limits = reduce_limits(trajectory.limits_for(None), trajectory.reserve)
    location = f"At {100 * speed_factor:.6g} % of the speed"
    _check_friction(slow.laws, arm_of(trajectory), limits, location, "another speed factor")
    return slow


def check_longest(duration: float, remedy: str) -> None:
    """Raise NotRealizable for a motion that takes too long; `remedy`: a sentence without period."""
    if not duration <= LONGEST_MOTION:
        raise NotRealizable(
            f"The motion would take {duration:.3g} s, but it may last at most "
            f"{LONGEST_MOTION:g} s. {remedy}.",
            needed=duration,
            allowed=LONGEST_MOTION,
        )


def _slow_down(fastest: Trajectory, factor: float, timing: Timing) -> Trajectory:
    """Return the motion along one path in `factor` times its shortest time, and check it."""
    if factor == 1.0:
        return fastest
    laws = tuple(law.stretched(1 / factor) for law in fastest.laws)
    location = f"Slowed down to {factor * fastest.duration:.6g} s"
    _check_friction(laws, timing.arm, timing.limits, location, "another duration")
    return replace(fastest, laws=laws)


def _check_friction(
    laws: tuple[Law, ...], arm: Arm, limits: Limits, location: str, other: str
) -> None:
    """Check the torques of a slower motion, because viscous friction assists its braking less.

    - `location`: first words of the error message.
    - `other`: what the message advises to specify, such as "another duration".
    """
    if limits.joint_torque is None or not np.any(arm.dynamics.chain.viscous):
        return
    check_limits(
        [x for x in laws if isinstance(x, LawAlongPath)],
        arm,
        limits,
        ignored=[x for x in LIMITS if x != "joint_torque"],
        location=location,
        t=0.0,
        remedy="Viscous friction assists braking less in a slower motion. Specify "
        f"{other}, or raise joint_torque",
    )
