"""Scheduler of document states: outline, moving preview, preview, exact figures; and of tasks."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from threading import Event, RLock, Thread
from typing import Any, TypeAlias

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import ArmContourError, InvalidInput
from armcontour.core.progress import Step
from armcontour.jobs import Job
from armcontour.jobs.study import STEPS
from armcontour.program import Program
from armcontour.robot import Arm
from armcontour.robot.scene import Scene
from armcontour.studio.arm_picture import arm_frame
from armcontour.studio.execution_picture import executed_frame
from armcontour.studio.page_frame import Frame
from armcontour.studio.picture import detail_frame, drawing_frame, picture_frame, refusal_header
from armcontour.studio.preview import CONFIGURATION, CoarsePlanner, Executed, Preview, Tier
from armcontour.studio.tasks import dispatch
from armcontour.studio.view import Detail, View
from armcontour.studio.workers import FastLane, SlowLane, Stale

MakeLane: TypeAlias = Callable[[Callable[[Frame], None]], SlowLane]
# A plan that took longer is executed only when nothing changes any more [s].
QUICK = 0.03
# A longer motion, too [s]: an execution cannot be given up for a newer one.
SHORT = 60.0
# While edits come faster than they are executed, their plans come first for so long [s].
WITHOUT = 0.06
# Where two plans took longer, an outline comes first, and plans when nothing changes [s].
SLOW = 0.5
# A plan that takes longer is given up for a newer state [s].
LATE = 0.5
# Exact figures that took longer are not waited for when they are out of date [s].
PATIENCE = 2.0
# Progress is reported after so long at the earliest, and then at such intervals at least [s].
SOON, OFTEN = 0.7, 0.1
# So many of the steps of a run, the first ones, are those of a plan.
OF_PLAN = 3
# What a person can ask for.
TASKS = tuple(x for x in dispatch.TASKS if x not in ("figures", "changes"))
# Frames after which a task is over.
LAST = ("figures", "changes", "result", "refusal", "failed", "cancelled")
# Names of exact figures begin so; no task of a page has such a name. Progress of a state has it.
OWN = "#"
# How the work on a state goes on.
WORKING, STOPPED, DONE = "working", "stopped", "done"
# Motions whose starts differ by more are in different configurations [rad].
SAME = 0.01


class Superseded(Exception):
    """A newer state of the document waits."""


@dataclass(slots=True, eq=False)
class Seen:
    """Results of one document, and the parts of them that pages have."""

    planned: Preview | None = None
    executed: Executed | None = None
    parts: tuple[Arm, Scene | None] | None = None
    # How long the last two plans of each tier took [s].
    took: dict[Tier, tuple[float, float]] = field(default_factory=dict)
    drawn: tuple[Preview | Program, View, int] | None = None
    followed: int = 0
    has_exact: bool = False


@dataclass(slots=True, eq=False, kw_only=True)
class State:
    """A state of the document to be shown."""

    data: Mapping[str, Any]
    run: str
    view: View
    document: str
    rev: int
    answers: Mapping[int, int]
    request: Callable[[], Mapping[str, Any]]
    # Waypoints in the plane [m], (n, 2).
    waypoints: FloatArray | None = None
    moving: bool = False
    # What is seen of its document.
    seen: Seen = field(default_factory=Seen, init=False)
    begin: float = field(default_factory=time.monotonic, init=False)
    # Whether a person has stopped it, and whether its plan is shown or refused.
    stopped: bool = field(default=False, init=False)
    answered: bool = field(default=False, init=False)
    # When its progress was told last [s]; None if pages have none.
    told: float | None = field(default=None, init=False)


# A state whose figures or changes are computed, what another process needs for that, and which.
Asked: TypeAlias = tuple[State, Mapping[str, Any], str]


class Planner:
    """Takes the newest state through its tiers, and starts tasks."""

    def __init__(
        self,
        previewer: CoarsePlanner,
        deliver: Callable[[Frame, State | None], bool],
        fast: Callable[[Callable[[Frame], None]], FastLane],
        slow: MakeLane,
        rest: float,
    ) -> None:
        self.previewer, self._rest = previewer, rest
        self._pictures = 0
        self._deliver, self._make = deliver, slow
        self._lock = RLock()
        self._seen = Seen()
        self._newest: State | None = None
        # When a plan was executed last [s].
        self._executed_at = 0.0
        self._done = Event()
        self._lane = fast(self._fail)
        # What is seen is drawn finer while a plan is made.
        self._details = fast(self._fail)
        self._looks: dict[object, tuple[Detail, Callable[[Frame], None]]] = {}
        self._figures = slow(self._hear)
        # The states whose figures are computed now and next, what was asked, and what is known.
        self._asked: Asked | None = None
        self._wanted: Asked | None = None
        self._known: tuple[Mapping[str, Any], Frame] | None = None
        # What to change, which follows the known figures step by step.
        self._changes: Frame | None = None
        self._count, self._since = 0, 0.0
        self._tasks: SlowLane | None = None
        self._running: set[str] = set()

    @property
    def planned(self) -> Preview | None:
        """Newest plan of this document."""
        return self._seen.planned

    def wait(self) -> None:
        """Wait until a picture or a refusal was sent."""
        self._done.wait()

    def show(self, state: State) -> None:
        """Show a state instead of older ones."""
        with self._lock:
            old, self._newest, state.seen = self._newest, state, self._seen
            if old is not None:
                self._end_progress(old)
            if self._asked is not None and self._since + PATIENCE < time.monotonic():
                # It would take the processor from what is shown now.
                self._figures.cancel(f"{OWN}{self._count}")
            self._lane.submit(partial(self._work, state))

    def stop(self) -> None:
        """Stop the work on the newest state; its results stay on the pages."""
        with self._lock:
            state = self._newest
            if state is not None:
                state.stopped, self._wanted = True, None
                if self._asked is not None:
                    self._figures.cancel(f"{OWN}{self._count}")
                self._tell_progress(state, (), None, STOPPED)

    def resume(self) -> None:
        """Continue a stopped state."""
        with self._lock:
            state = self._newest
            if state is not None and state.stopped:
                state.stopped = False
                self._tell_progress(state, (), None, WORKING)
                self._lane.submit(partial(self._work, state))

    def look(self, detail: Detail, deliver: Callable[[Frame], None], page: object) -> None:
        """Draw the visible part of the newest picture for a page."""
        self._looks[page] = detail, deliver
        self._details.submit(self._draw_details)

    def _draw_details(self, stale: Stale) -> None:
        """Draw all requested details."""
        while self._looks and (drawn := self._seen.drawn) is not None:
            _, (detail, deliver) = self._looks.popitem()
            (made, view, number), executed = drawn, self._seen.executed
            if not isinstance(made, Preview):
                executed = None
            tier = None if executed is None else executed.planned.tier
            frame = detail_frame(made, executed, view, detail)
            deliver(frame.stamped(number=number, tier=tier))

    def pose(self, t: float, of: str) -> FloatArray:
        """Joint positions at a time [s], clipped to the motion; `of`: "planned" or "executed"."""
        planned, executed = self._seen.planned, self._seen.executed
        if of == "executed" and executed is not None:
            execution = executed.execution
            return np.array([np.interp(t, execution.t, q) for q in execution.q.T])
        if of != "planned" or planned is None:
            raise InvalidInput(f"There is no motion {of!r} yet.")
        return planned.trajectory(float(np.clip(t, 0.0, planned.trajectory.duration)))

    def do(self, id: str, task: str, request: Mapping[str, Any]) -> None:
        """Start a task; `id` identifies it for `cancel`."""
        with self._lock:
            if task not in TASKS:
                raise InvalidInput(f"There is no task {task!r}: there are {', '.join(TASKS)}.")
            if id.startswith(OWN) or id in self._running:
                raise InvalidInput(f"The task {id} is running already.")
            if self._tasks is None:
                self._tasks = self._make(self._hear)
            self._running.add(id)
            self._tasks.submit(id, task, dict(request))

    def cancel(self, id: str) -> None:
        """Cancel a task, or stop the work on the newest state."""
        with self._lock:
            if id == OWN:
                self.stop()
            elif id in self._running and self._tasks is not None:
                self._tasks.cancel(id)

    def forget(self) -> None:
        """Discard all results, because another document is opened."""
        with self._lock:
            if self._newest is not None:
                self._end_progress(self._newest)
            # What is at work for the other document goes on with what was seen of that.
            self._newest, self._seen = None, Seen()

    def forget_figures(self) -> None:
        """Discard exact figures, because files of the job may have changed."""
        with self._lock:
            self._known = None

    def close(self) -> None:
        """End all work and both processes."""
        lanes = [x for x in (self._figures, self._tasks) if x is not None]
        closing = [Thread(target=x.close, daemon=True) for x in lanes]
        for x in closing:
            x.start()
        for x in closing:
            x.join()
        self._done.set()
        self._lane.close()
        self._details.close()

    # In the thread of previews.

    def _fail(self, frame: Frame) -> None:
        """Report that the preview of the newest state has failed."""
        self._deliver(frame, self._newest)

    def _work(self, state: State, stale: Stale) -> None:
        """Take a state through its tiers until it is superseded."""

        def is_over(within: float = 0.0) -> bool:
            return stale(within) or state.stopped

        with contextlib.suppress(Superseded):
            self._tiers(state, is_over)
        self._done.set()

    def _tiers(self, state: State, stale: Stale) -> None:
        """Show an outline or a moving plan; then, at rest, the preview and the exact results."""
        try:
            if self._is_slow(state):
                self._draw_outline(state)
                self._wait(state, stale)
                # The other process does not wait for the preview.
                self._ask(state)
                self._tell_progress(state, ("planning",), None, WORKING)
            elif state.moving:
                self._show(state, Tier.MOVING, stale)
                self._wait(state, stale)
            planned = self._show(state, Tier.PREVIEW, stale)
        except ArmContourError as error:
            planned = None
            self._refuse(state, error)
        self._wait(state, stale)
        self._ask(state)
        if planned is not None and self.previewer.may_be_exact(planned):
            try:
                self._show(state, Tier.EXACT, stale)
            except ArmContourError as error:
                self._refuse(state, error)

    def _show(self, state: State, tier: Tier, stale: Stale) -> Preview:
        """Show plan and execution of a tier."""
        # Time of the processor: on a busy machine plans that are given up would be worse than late.
        seen, begin = state.seen, time.thread_time()

        def go_on(step: Step) -> None:
            is_late = tier == Tier.EXACT or time.thread_time() > begin + LATE
            if state.stopped or (is_late and stale()):
                raise Superseded
            self._tell_progress(state, step.names, step.done)

        planned = self.previewer.plan(state.data, state.run, tier=tier, progress=go_on)
        took = time.thread_time() - begin
        seen.took[tier] = seen.took.get(tier, (0.0, 0.0))[1], took
        if took < SLOW:
            seen.took.pop(Tier.MOVING, None)
        state.answered = True
        seen.planned = planned
        self._draw(picture_frame(planned, state.view), planned, state)
        # The first plan is wanted before shapes of links, which may take long.
        self._show_arm(state, planned.job)
        if not self.previewer.may_execute(planned):
            # The exact run has its errors; nothing else could be shown meanwhile.
            return planned
        if tier != Tier.EXACT and (took > QUICK or planned.trajectory.duration > SHORT):
            self._wait(state, stale)
        if stale() and (tier == Tier.EXACT or time.monotonic() < self._executed_at + WITHOUT):
            raise Superseded
        try:
            seen.executed = executed = self.previewer.execute(planned)
        except ArmContourError as error:
            self._refuse(state, error, planned)
        else:
            self._executed_at = time.monotonic()
            self._deliver(executed_frame(executed, state.view), state)
        return planned

    def _wait(self, state: State, stale: Stale) -> None:
        """Wait until the document rests."""
        self._done.set()
        if stale(state.begin + self._rest - time.monotonic()):
            raise Superseded

    def _is_slow(self, state: State) -> bool:
        """True if planning takes so long that the outline comes first."""
        tier = Tier.MOVING if state.moving else Tier.PREVIEW
        return min(state.seen.took.get(tier, (0.0, 0.0))) > SLOW or self.previewer.is_long(
            state.data
        )

    def _draw_outline(self, state: State) -> None:
        """Show the path of a state without a plan."""
        program = self.previewer.drawn(state.data)
        self._draw(drawing_frame(program, state.view, run=state.run), program, state)

    def _draw(self, frame: Frame, made: Preview | Program, state: State) -> None:
        """Send a picture."""
        self._pictures += 1
        if self._deliver(frame.stamped(number=self._pictures), state):
            state.seen.drawn = made, state.view, self._pictures

    def _show_arm(self, state: State, job: Job) -> None:
        """Send arm and cell if the pages have others."""
        parts = state.seen.parts
        if parts is None or parts[0] is not job.arm or parts[1] != job.scene:
            if self._deliver(arm_frame(job), state):
                state.seen.parts = job.arm, job.scene

    def _refuse(self, state: State, error: ArmContourError, planned: Preview | None = None) -> None:
        """Report an error of planning or execution with its position."""
        seen, state.answered = state.seen, True
        if planned is None and seen.planned is None:
            # What is out of reach can be moved only if it is seen where it is.
            with contextlib.suppress(ArmContourError):
                program = self.previewer.drawn(state.data)
                if seen.drawn is None or seen.drawn[0] is not program:
                    self._draw_outline(state)
        header = refusal_header(
            error,
            state.view,
            tier=1 if planned is None else 2,
            run=state.run,
            planned=planned,
            waypoints=state.waypoints,
        )
        self._deliver(Frame("refusal", header), state)

    # Exact figures and tasks.

    def _ask(self, state: State) -> None:
        """Request the exact figures of a state; known ones are sent at once."""
        with contextlib.suppress(ArmContourError):
            request = state.request()
            with self._lock:
                asked = state, request, "figures"
                if self._known is not None and self._known[0] == request:
                    self._wanted, asked = None, (state, request, "changes")
                    self._tell_figures(state, self._known[1])
                    if self._changes is not None:
                        self._deliver(Frame("changes", self._changes.header), state)
                    if self._is_told(self._changes):
                        return
                if self._asked is None:
                    self._begin(*asked)
                elif self._asked[1:] == asked[1:]:
                    self._asked = asked
                elif self._asked[0] is not state:
                    self._wanted = asked

    @staticmethod
    def _is_told(changes: Frame | None) -> bool:
        """True if the advice is complete."""
        return changes is not None and changes.header["share"] >= 1

    def _begin(self, state: State, request: Mapping[str, Any], task: str) -> None:
        """Submit figures, or the next step of the advice, to the process."""
        self._asked, self._wanted = (state, request, task), None
        self._count += 1
        self._since = time.monotonic()
        self._figures.submit(f"{OWN}{self._count}", task, dict(request))

    def _hear(self, frame: Frame) -> None:
        """Process a frame of a task process."""
        with self._lock:
            id = str(frame.header.get("id", ""))
            if not id.startswith(OWN):
                if frame.kind in LAST:
                    self._running.discard(id)
                self._deliver(frame, None)
                return
            if self._asked is None or id != f"{OWN}{self._count}":
                return
            state, request, task = self._asked
            if frame.kind not in LAST:
                if state.answered and task == "figures":
                    self._tell_progress(state, frame.header["steps"], frame.header["share"])
                return
            self._asked = None
            if frame.kind == "figures":
                self._known, self._changes = (request, frame), None
                self._tell_figures(state, frame)
            elif frame.kind == "changes":
                self._changes = frame
                self._deliver(Frame("changes", frame.header), state)
            elif task == "changes":
                # Pages do without what to change.
                pass
            elif frame.kind == "refusal":
                self._deliver(frame, state)
                self._end_progress(state)
            elif frame.kind == "failed":
                # Such as a process that was killed: another one may do it.
                state.stopped = True
                self._tell_progress(state, (str(frame.header["sentence"]),), None, STOPPED)
            if self._wanted is not None:
                self._begin(*self._wanted)
            elif frame.kind in ("figures", "changes") and not self._is_told(self._changes):
                # Steps are short, so that the next figures need not wait for what to change.
                self._begin(state, request, "changes")

    def _tell_figures(self, state: State, frame: Frame) -> None:
        """Send exact figures; the preview then follows the configuration of the full run."""
        taken = self._deliver(Frame("figures", frame.header), state)
        self._end_progress(state)
        seen, start = state.seen, frame.header.get("start")
        had_exact, seen.has_exact = seen.has_exact, seen.has_exact or taken
        if not taken or start is None or state is not self._newest or seen.followed == state.rev:
            return
        if seen.planned is None or np.abs(seen.planned.start - np.asarray(start)).max() <= SAME:
            return
        seen.followed = state.rev
        self._lane.submit(partial(self._follow, state, np.asarray(start), had_exact))

    def _follow(self, state: State, start: FloatArray, had_exact: bool, stale: Stale) -> None:
        """Show a state in the configuration of the full run, with a notice if that is a change."""
        planned = state.seen.planned
        assert planned is not None
        if CONFIGURATION in planned.differs and had_exact:
            joint = int(np.argmax(np.abs(planned.start - start)))
            before, after = np.degrees((planned.start[joint], start[joint]))
            sentence = (
                "The arm is in another configuration now, in which the motion is faster: joint "
                f"{joint + 1} starts at {after:z.1f} deg, and started at {before:z.1f} deg before. "
                "`seed` in the job file fixes one."
            )
            self._deliver(Frame("notice", {"sentence": sentence}), state)
        self.previewer.keep_start(planned.job, start)
        self._work(state, stale)

    def _tell_progress(
        self, state: State, steps: Sequence[str], share: float | None, how: str = ""
    ) -> None:
        """Send progress at intervals; a change of the state of the work (`how`) is sent at once."""
        with self._lock:
            now = time.monotonic()
            due = state.begin + SOON if state.told is None else state.told + OFTEN
            if state is self._newest and (how or (now >= due and not state.stopped)):
                state.told = now
                tier = Tier.EXACT if state.answered else Tier.PREVIEW
                if steps and steps[-1] in STEPS:
                    number = STEPS.index(steps[-1]) + 1
                    count = len(STEPS) if state.answered else OF_PLAN
                    steps = (*steps[:-1], f"{steps[-1]} (step {number} of {count})")
                told = {"id": OWN, "task": OWN, "tier": tier, "state": how or WORKING}
                self._deliver(Frame("progress", {**told, "steps": steps, "share": share}), state)

    def _end_progress(self, state: State) -> None:
        """Remove the progress from the pages."""
        if state.told is not None:
            state.told = None
            self._deliver(Frame("progress", {"id": OWN, "task": OWN, "state": DONE}), None)
