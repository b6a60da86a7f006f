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
from armcontour.studio.execution_picture import execution_frame
from armcontour.studio.page_frame import PageFrame
from armcontour.studio.picture import detail_frame, drawing_frame, picture_frame, refusal_header
from armcontour.studio.preview import CONFIGURATION, CoarsePlanner, Preview, PreviewExecution, Tier
from armcontour.studio.tasks import dispatch
from armcontour.studio.view import Detail, View
from armcontour.studio.workers import PreviewWorker, StaleCheck, TaskWorker

TaskWorkerFactory: TypeAlias = Callable[[Callable[[PageFrame], None]], TaskWorker]
# An execution waits for rest if its plan took longer [s],
FAST_PLAN = 0.03
# or if its motion is longer [s], because an execution cannot be cancelled.
MAX_EXECUTED = 60.0
# Executions of a drag are at least this far apart, so that plans come first [s].
PLANS_ONLY = 0.06
# If the last two plans took longer, only the outline is shown until rest [s].
SLOW_PLAN = 0.5
# A plan that takes longer is cancelled by a newer state [s].
MAX_OBSOLETE_PLAN = 0.5
# Exact figures that take longer are cancelled by a newer state [s].
MAX_OBSOLETE_FIGURES = 2.0
# Time of the first progress frame, and minimum interval of the next ones [s].
PROGRESS_DELAY, PROGRESS_INTERVAL = 0.7, 0.1
# Number of steps of a run that belong to its plan.
PLAN_STEPS = 3
# Tasks that a page can start.
TASKS = tuple(x for x in dispatch.TASKS if x not in ("figures", "changes"))
# Frames that end a task.
FINAL_KINDS = ("figures", "changes", "result", "refusal", "failed", "cancelled")
# Prefix of the identities of exact figures, and identity of the progress of a state.
STATE_ID = "#"
# Values of `state` in progress frames.
WORKING, STOPPED, DONE = "working", "stopped", "done"
# Starts that differ by more are in different configurations [rad].
SAME_CONFIGURATION = 0.01


class Superseded(Exception):
    """A newer state of the document waits."""


@dataclass(slots=True, eq=False)
class ShownResults:
    """Results of one document, and the parts of them that pages have."""

    planned: Preview | None = None
    executed: PreviewExecution | None = None
    sent_parts: tuple[Arm, Scene | None] | None = None
    # Computing times of the last two plans of each tier [s].
    plan_times: dict[Tier, tuple[float, float]] = field(default_factory=dict)
    # Plan or program on the pages, its view, and the number of its picture.
    drawn: tuple[Preview | Program, View, int] | None = None
    # Revision whose preview follows the configuration of its full run.
    followed: int = 0
    has_exact: bool = False


@dataclass(slots=True, eq=False, kw_only=True)
class DocumentState:
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
    # Results of its document.
    results: ShownResults = field(default_factory=ShownResults, init=False)
    start_time: float = field(default_factory=time.monotonic, init=False)
    # Stopped by the user; plan shown or refused.
    stopped: bool = field(default=False, init=False)
    answered: bool = field(default=False, init=False)
    # Time of the last progress frame [s]; None without one.
    reported: float | None = field(default=None, init=False)


# State, request to the process, and task: "figures" or "changes".
FiguresRequest: TypeAlias = tuple[DocumentState, Mapping[str, Any], str]


class Scheduler:
    """Takes the newest state through its tiers, and starts tasks."""

    def __init__(
        self,
        previewer: CoarsePlanner,
        deliver: Callable[[PageFrame, DocumentState | None], bool],
        preview_worker: Callable[[Callable[[PageFrame], None]], PreviewWorker],
        task_worker: TaskWorkerFactory,
        rest_time: float,
    ) -> None:
        self.previewer, self._rest = previewer, rest_time
        self._pictures = 0
        self._deliver, self._make_task_worker = deliver, task_worker
        self._lock = RLock()
        self._results = ShownResults()
        self._newest: DocumentState | None = None
        # Time of the last execution [s].
        self._executed_at = 0.0
        self._done = Event()
        self._preview_worker = preview_worker(self._fail)
        # Details are drawn while a plan is computed.
        self._detail_worker = preview_worker(self._fail)
        self._detail_requests: dict[object, tuple[Detail, Callable[[PageFrame], None]]] = {}
        self._figures_worker = task_worker(self._receive)
        # Running and queued requests of figures, and the last request with its figures.
        self._current: FiguresRequest | None = None
        self._queued: FiguresRequest | None = None
        self._known: tuple[Mapping[str, Any], PageFrame] | None = None
        # Last step of the advice for the known figures.
        self._changes: PageFrame | None = None
        self._count, self._since = 0, 0.0
        self._task_worker: TaskWorker | None = None
        self._running: set[str] = set()

    @property
    def planned(self) -> Preview | None:
        """Newest plan of this document."""
        return self._results.planned

    def wait(self) -> None:
        """Wait until a picture or a refusal was sent."""
        self._done.wait()

    def show(self, state: DocumentState) -> None:
        """Show a state instead of older ones."""
        with self._lock:
            old, self._newest, state.results = self._newest, state, self._results
            if old is not None:
                self._end_progress(old)
            if self._current is not None and self._since + MAX_OBSOLETE_FIGURES < time.monotonic():
                # Obsolete figures would slow the preview down.
                self._figures_worker.cancel(f"{STATE_ID}{self._count}")
            self._preview_worker.submit(partial(self._show_state, state))

    def stop(self) -> None:
        """Stop the work on the newest state; its results stay on the pages."""
        with self._lock:
            state = self._newest
            if state is not None:
                state.stopped, self._queued = True, None
                if self._current is not None:
                    self._figures_worker.cancel(f"{STATE_ID}{self._count}")
                self._send_progress(state, (), None, STOPPED)

    def resume(self) -> None:
        """Continue a stopped state."""
        with self._lock:
            state = self._newest
            if state is not None and state.stopped:
                state.stopped = False
                self._send_progress(state, (), None, WORKING)
                self._preview_worker.submit(partial(self._show_state, state))

    def draw_detail(
        self, detail: Detail, deliver: Callable[[PageFrame], None], page: object
    ) -> None:
        """Draw the visible part of the newest picture for a page."""
        self._detail_requests[page] = detail, deliver
        self._detail_worker.submit(self._draw_details)

    def _draw_details(self, stale: StaleCheck) -> None:
        """Draw all requested details."""
        while self._detail_requests and (drawn := self._results.drawn) is not None:
            _, (detail, deliver) = self._detail_requests.popitem()
            (made, view, number), executed = drawn, self._results.executed
            if not isinstance(made, Preview):
                executed = None
            tier = None if executed is None else executed.planned.tier
            frame = detail_frame(made, executed, view, detail)
            deliver(frame.stamped(number=number, tier=tier))

    def pose(self, t: float, motion: str) -> FloatArray:
        """Joint positions at a time [s] of the motion "planned" or "executed"."""
        planned, executed = self._results.planned, self._results.executed
        if motion == "executed" and executed is not None:
            execution = executed.execution
            return np.array([np.interp(t, execution.t, q) for q in execution.q.T])
        if motion != "planned" or planned is None:
            raise InvalidInput(f"There is no motion {motion!r} yet.")
        return planned.trajectory(float(np.clip(t, 0.0, planned.trajectory.duration)))

    def start_task(self, id: str, task: str, request: Mapping[str, Any]) -> None:
        """Start a task; `id` identifies it for `cancel`."""
        with self._lock:
            if task not in TASKS:
                raise InvalidInput(f"There is no task {task!r}: there are {', '.join(TASKS)}.")
            if id.startswith(STATE_ID) or id in self._running:
                raise InvalidInput(f"The task {id} is running already.")
            if self._task_worker is None:
                self._task_worker = self._make_task_worker(self._receive)
            self._running.add(id)
            self._task_worker.submit(id, task, dict(request))

    def cancel(self, id: str) -> None:
        """Cancel a task, or stop the work on the newest state."""
        with self._lock:
            if id == STATE_ID:
                self.stop()
            elif id in self._running and self._task_worker is not None:
                self._task_worker.cancel(id)

    def forget(self) -> None:
        """Discard all results, because another document is opened."""
        with self._lock:
            if self._newest is not None:
                self._end_progress(self._newest)
            # Running work on the previous document keeps its results.
            self._newest, self._results = None, ShownResults()

    def forget_figures(self) -> None:
        """Discard exact figures, because files of the job may have changed."""
        with self._lock:
            self._known = None

    def close(self) -> None:
        """End all work and both processes."""
        workers = [x for x in (self._figures_worker, self._task_worker) if x is not None]
        closing = [Thread(target=x.close, daemon=True) for x in workers]
        for thread in closing:
            thread.start()
        for thread in closing:
            thread.join()
        self._done.set()
        self._preview_worker.close()
        self._detail_worker.close()

    # The methods below run in the thread of the preview worker.

    def _fail(self, frame: PageFrame) -> None:
        """Report that the preview of the newest state has failed."""
        self._deliver(frame, self._newest)

    def _show_state(self, state: DocumentState, stale: StaleCheck) -> None:
        """Take a state through its tiers until it is superseded."""

        def is_over(within: float = 0.0) -> bool:
            return stale(within) or state.stopped

        with contextlib.suppress(Superseded):
            self._run_tiers(state, is_over)
        self._done.set()

    def _run_tiers(self, state: DocumentState, stale: StaleCheck) -> None:
        """Show an outline or a moving plan; then, at rest, the preview and the exact results."""
        try:
            if self._is_slow(state):
                self._draw_outline(state)
                self._wait(state, stale)
                # The figures do not wait for the preview.
                self._request_figures(state)
                self._send_progress(state, ("planning",), None, WORKING)
            elif state.moving:
                self._show_tier(state, Tier.MOVING, stale)
                self._wait(state, stale)
            planned = self._show_tier(state, Tier.PREVIEW, stale)
        except ArmContourError as error:
            planned = None
            self._refuse(state, error)
        self._wait(state, stale)
        self._request_figures(state)
        if planned is not None and self.previewer.may_be_exact(planned):
            try:
                self._show_tier(state, Tier.EXACT, stale)
            except ArmContourError as error:
                self._refuse(state, error)

    def _show_tier(self, state: DocumentState, tier: Tier, stale: StaleCheck) -> Preview:
        """Show plan and execution of a tier."""
        # CPU time, so that plans are not cancelled because the machine is busy.
        results, begin = state.results, time.thread_time()

        def go_on(step: Step) -> None:
            is_late = tier == Tier.EXACT or time.thread_time() > begin + MAX_OBSOLETE_PLAN
            if state.stopped or (is_late and stale()):
                raise Superseded
            self._send_progress(state, step.names, step.done)

        planned = self.previewer.plan(state.data, state.run, tier=tier, progress=go_on)
        took = time.thread_time() - begin
        results.plan_times[tier] = results.plan_times.get(tier, (0.0, 0.0))[1], took
        if took < SLOW_PLAN:
            results.plan_times.pop(Tier.MOVING, None)
        state.answered = True
        results.planned = planned
        self._send_picture(picture_frame(planned, state.view), planned, state)
        # The plan is shown before the shapes of links, whose triangles may take long.
        self._show_arm(state, planned.job)
        if not self.previewer.may_execute(planned):
            # Only the full run simulates so long a motion.
            return planned
        if tier != Tier.EXACT and (took > FAST_PLAN or planned.trajectory.duration > MAX_EXECUTED):
            self._wait(state, stale)
        if stale() and (tier == Tier.EXACT or time.monotonic() < self._executed_at + PLANS_ONLY):
            raise Superseded
        try:
            results.executed = executed = self.previewer.execute(planned)
        except ArmContourError as error:
            self._refuse(state, error, planned)
        else:
            self._executed_at = time.monotonic()
            self._deliver(execution_frame(executed, state.view), state)
        return planned

    def _wait(self, state: DocumentState, stale: StaleCheck) -> None:
        """Wait until the document rests."""
        self._done.set()
        if stale(state.start_time + self._rest - time.monotonic()):
            raise Superseded

    def _is_slow(self, state: DocumentState) -> bool:
        """True if planning takes so long that the outline comes first."""
        tier = Tier.MOVING if state.moving else Tier.PREVIEW
        return min(
            state.results.plan_times.get(tier, (0.0, 0.0))
        ) > SLOW_PLAN or self.previewer.is_long(state.data)

    def _draw_outline(self, state: DocumentState) -> None:
        """Show the path of a state without a plan."""
        program = self.previewer.path_program(state.data)
        self._send_picture(drawing_frame(program, state.view, run=state.run), program, state)

    def _send_picture(
        self, frame: PageFrame, made: Preview | Program, state: DocumentState
    ) -> None:
        """Send a picture."""
        self._pictures += 1
        if self._deliver(frame.stamped(number=self._pictures), state):
            state.results.drawn = made, state.view, self._pictures

    def _show_arm(self, state: DocumentState, job: Job) -> None:
        """Send arm and cell if the pages have others."""
        parts = state.results.sent_parts
        if parts is None or parts[0] is not job.arm or parts[1] != job.scene:
            if self._deliver(arm_frame(job), state):
                state.results.sent_parts = job.arm, job.scene

    def _refuse(
        self, state: DocumentState, error: ArmContourError, planned: Preview | None = None
    ) -> None:
        """Report an error of planning or execution with its position."""
        results, state.answered = state.results, True
        if planned is None and results.planned is None:
            # The user can move an unreachable path only if it is shown.
            with contextlib.suppress(ArmContourError):
                program = self.previewer.path_program(state.data)
                if results.drawn is None or results.drawn[0] is not program:
                    self._draw_outline(state)
        header = refusal_header(
            error,
            state.view,
            tier=1 if planned is None else 2,
            run=state.run,
            planned=planned,
            waypoints=state.waypoints,
        )
        self._deliver(PageFrame("refusal", header), state)

    # Exact figures and tasks.

    def _request_figures(self, state: DocumentState) -> None:
        """Request the exact figures of a state; known ones are sent at once."""
        with contextlib.suppress(ArmContourError):
            request = state.request()
            with self._lock:
                new = state, request, "figures"
                if self._known is not None and self._known[0] == request:
                    self._queued, new = None, (state, request, "changes")
                    self._send_figures(state, self._known[1])
                    if self._changes is not None:
                        self._deliver(PageFrame("changes", self._changes.header), state)
                    if self._is_complete(self._changes):
                        return
                if self._current is None:
                    self._submit_figures(*new)
                elif self._current[1:] == new[1:]:
                    self._current = new
                elif self._current[0] is not state:
                    self._queued = new

    @staticmethod
    def _is_complete(changes: PageFrame | None) -> bool:
        """True if the advice is complete."""
        return changes is not None and changes.header["share"] >= 1

    def _submit_figures(self, state: DocumentState, request: Mapping[str, Any], task: str) -> None:
        """Submit figures, or the next step of the advice, to the process."""
        self._current, self._queued = (state, request, task), None
        self._count += 1
        self._since = time.monotonic()
        self._figures_worker.submit(f"{STATE_ID}{self._count}", task, dict(request))

    def _receive(self, frame: PageFrame) -> None:
        """Process a frame of a task process."""
        with self._lock:
            id = str(frame.header.get("id", ""))
            if not id.startswith(STATE_ID):
                if frame.kind in FINAL_KINDS:
                    self._running.discard(id)
                self._deliver(frame, None)
                return
            if self._current is None or id != f"{STATE_ID}{self._count}":
                return
            state, request, task = self._current
            if frame.kind not in FINAL_KINDS:
                if state.answered and task == "figures":
                    self._send_progress(state, frame.header["steps"], frame.header["share"])
                return
            self._current = None
            if frame.kind == "figures":
                self._known, self._changes = (request, frame), None
                self._send_figures(state, frame)
            elif frame.kind == "changes":
                self._changes = frame
                self._deliver(PageFrame("changes", frame.header), state)
            elif task == "changes":
                # Advice is optional.
                pass
            elif frame.kind == "refusal":
                self._deliver(frame, state)
                self._end_progress(state)
            elif frame.kind == "failed":
                # For example after the process was killed. The user can resume.
                state.stopped = True
                self._send_progress(state, (str(frame.header["sentence"]),), None, STOPPED)
            if self._queued is not None:
                self._submit_figures(*self._queued)
            elif frame.kind in ("figures", "changes") and not self._is_complete(self._changes):
                # Steps are short, so the next figures do not wait for the advice.
                self._submit_figures(state, request, "changes")

    def _send_figures(self, state: DocumentState, frame: PageFrame) -> None:
        """Send exact figures; the preview then follows the configuration of the full run."""
        taken = self._deliver(PageFrame("figures", frame.header), state)
        self._end_progress(state)
        results, start = state.results, frame.header.get("start")
        had_exact, results.has_exact = results.has_exact, results.has_exact or taken
        if not taken or start is None or state is not self._newest or results.followed == state.rev:
            return
        if (
            results.planned is None
            or np.abs(results.planned.start - np.asarray(start)).max() <= SAME_CONFIGURATION
        ):
            return
        results.followed = state.rev
        self._preview_worker.submit(partial(self._follow, state, np.asarray(start), had_exact))

    def _follow(
        self, state: DocumentState, start: FloatArray, had_exact: bool, stale: StaleCheck
    ) -> None:
        """Show a state in the configuration of the full run, with a notice if that is a change."""
        planned = state.results.planned
        assert planned is not None
        if CONFIGURATION in planned.differs and had_exact:
            joint = int(np.argmax(np.abs(planned.start - start)))
            before, after = np.degrees((planned.start[joint], start[joint]))
            sentence = (
                "The arm is in another configuration now, in which the motion is faster: joint "
                f"{joint + 1} starts at {after:z.1f} deg, and started at {before:z.1f} deg before. "
                "`seed` in the job file fixes one."
            )
            self._deliver(PageFrame("notice", {"sentence": sentence}), state)
        self.previewer.keep_start(planned.job, start)
        self._show_state(state, stale)

    def _send_progress(
        self, state: DocumentState, steps: Sequence[str], share: float | None, how: str = ""
    ) -> None:
        """Send progress at intervals; a change of the state of the work (`how`) is sent at once."""
        with self._lock:
            now = time.monotonic()
            due = state.start_time + PROGRESS_DELAY
            if state.reported is not None:
                due = state.reported + PROGRESS_INTERVAL
            if state is self._newest and (how or (now >= due and not state.stopped)):
                state.reported = now
                tier = Tier.EXACT if state.answered else Tier.PREVIEW
                if steps and steps[-1] in STEPS:
                    number = STEPS.index(steps[-1]) + 1
                    count = len(STEPS) if state.answered else PLAN_STEPS
                    steps = (*steps[:-1], f"{steps[-1]} (step {number} of {count})")
                header = {"id": STATE_ID, "task": STATE_ID, "tier": tier, "state": how or WORKING}
                self._deliver(
                    PageFrame("progress", {**header, "steps": steps, "share": share}), state
                )

    def _end_progress(self, state: DocumentState) -> None:
        """Remove the progress from the pages."""
        if state.reported is not None:
            state.reported = None
            self._deliver(
                PageFrame("progress", {"id": STATE_ID, "task": STATE_ID, "state": DONE}), None
            )
