"""Scheduler: sends pictures and figures (values of a full run) of a document, and starts tasks."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from threading import Event, RLock
from typing import Any, TypeAlias

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import ArmContourError, InvalidInput, Unreachable
from armcontour.core.kernel_cache import may_wait
from armcontour.core.progress import Step, TimeLeft
from armcontour.jobs import Job
from armcontour.program import Program
from armcontour.report.arm_frame import arm_frame, path_points
from armcontour.report.message_frame import MessageFrame
from armcontour.report.view import View
from armcontour.robot import Arm
from armcontour.robot.scene import Scene
from armcontour.studio.certified_plans import CertifiedPlan
from armcontour.studio.execution_frame import execution_frame
from armcontour.studio.pages import Answers
from armcontour.studio.plan_frames import (
    Preview,
    Tier,
    drawing_frame,
    picture_frame,
    refusal_header,
)
from armcontour.studio.preview import CoarsePlanner
from armcontour.studio.tasks import dispatch
from armcontour.studio.workers import PreviewWorker, StaleCheck, TaskWorker

TaskWorkerFactory: TypeAlias = Callable[[Callable[[MessageFrame], None]], TaskWorker]
# Time without changes before exact figures are computed [s].
REST = 0.15
# If the plan took longer than this [s], it is simulated only after the rest time without edits.
FAST_PLAN = 0.03
# If the planned motion is longer than this [s], it is simulated only after the rest time without
# edits, because a simulation cannot be cancelled.
MAX_EXECUTED = 60.0
# Minimum interval of simulations while newer states wait [s], so that their plans come first.
MIN_SIMULATION_INTERVAL = 0.06
# If the last two plans took longer than this [s], the outline is shown first, and the plan only
# after the rest time without edits.
SLOW_PLAN = 0.5
# If the simulation of a preview took longer than this [s], the next ones are omitted, because the
# exact figures, which are then computed at once, take little longer.
SLOW_SIMULATION = 0.5
# Computing time after which a newer state cancels a plan [s].
MAX_OBSOLETE_PLAN = 0.5
# Delay of the first progress frame [s].
PROGRESS_DELAY = 0.7
# Minimum interval of further progress frames [s].
PROGRESS_INTERVAL = 0.1
# Tasks that a page can start.
TASKS = tuple(x for x in dispatch.TASKS if x not in dispatch.SHOWING)
# Tasks of a state in their order: figures first if there is a preview, and otherwise the plan, of
# which the picture does not change when its figures are known.
AFTER_PREVIEW = ("figures", "picture", "executed")
WITHOUT_PREVIEW = ("picture", "figures", "executed")
# Prefix of task identifiers for exact figures, and identifier in a state's progress frames.
STATE_ID = "#"
# Values of `state` in progress frames.
WORKING = "working"
DONE = "done"


class Superseded(Exception):
    """Raised to end the work on a state because a newer state of the document waits."""


@dataclass(slots=True, eq=False)
class ShownResults:
    """Newest results of a document that the pages show.

    Args:
        planned: Newest preview; None without one.
        start: Joint positions at the start of the newest plan [rad], (dof,); None without one.
        sent_parts: Arm, scene and `path_points` that the pages show.
        plan_times: Computing times of the last two plans [s].
        simulation_time: Computing time of the last simulation of a preview [s].
        drawn: Path that the pages show without a plan.
    """

    planned: Preview | None = None
    start: FloatArray | None = None
    sent_parts: tuple[Arm, Scene | None, list[list[float]] | None] | None = None
    plan_times: tuple[float, float] = (0.0, 0.0)
    simulation_time: float = 0.0
    drawn: Program | None = None


@dataclass(slots=True, eq=False, kw_only=True)
class DocumentState:
    """Document state that the pages show next.

    Args:
        data: Data of the job.
        run: Name of the shown run.
        view: View of the picture.
        document: Identity of the document.
        rev: Revision of the document.
        answers: Messages that the frames of this state answer.
        request: Function that creates the request for exact figures.
        waypoints: Waypoints in the plane of the picture [m], (n, 2).
        certified: Certified plan that the pages show instead of that of the run; None for the run.
    """

    data: Mapping[str, Any]
    run: str
    view: View
    document: str
    rev: int
    answers: Answers
    request: Callable[[], Mapping[str, Any]]
    waypoints: FloatArray | None = None
    certified: CertifiedPlan | None = None
    # Results of the document.
    results: ShownResults = field(default_factory=ShownResults, init=False)
    # Picture without a plan, and its program.
    outline: tuple[MessageFrame, Program] | None = field(default=None, init=False)
    start_time: float = field(default_factory=time.monotonic, init=False)
    # True if a plan or a refusal was computed.
    answered: bool = field(default=False, init=False)
    # Time of the last progress frame [s]; None if the pages show no progress.
    reported: float | None = field(default=None, init=False)
    # Estimate of the time until the plan or the exact figures are computed.
    time_left: TimeLeft = field(default_factory=lambda: TimeLeft(time.monotonic), init=False)

    def is_same(self, other: DocumentState) -> bool:
        """Return whether another state shows the same plan, for example to a further page."""
        is_of_run = self.certified is None and other.certified is None
        return is_of_run and self.data is other.data and self.run == other.run


@dataclass(slots=True, eq=False)
class Showing:
    """The tasks of the task process for a state, and the frames that they have made.

    Args:
        state: State that is shown.
        request: Fields of the request of all tasks.
        tasks: Tasks that are not completed, in their order.
        frames: Frames of the completed tasks, in their order.
        is_stopped: Whether the running task was asked to stop.
    """

    state: DocumentState
    request: Mapping[str, Any]
    tasks: list[str]
    frames: list[MessageFrame] = field(default_factory=list)
    is_stopped: bool = False

    @property
    def has_figures(self) -> bool:
        """Whether the exact figures are computed."""
        return "figures" not in self.tasks


@dataclass(frozen=True, slots=True)
class SchedulerOptions:
    """Factories of the workers, and the time without changes before exact figures [s].

    Args:
        preview_worker: Factory of the preview worker.
        task_worker: Factory of the worker for exact figures and tasks.
        rest_time: Time without changes before exact figures are computed [s].
    """

    preview_worker: Callable[[Callable[[MessageFrame], None]], PreviewWorker] = PreviewWorker
    task_worker: TaskWorkerFactory = TaskWorker
    rest_time: float = REST


class Scheduler:
    """Shows the newest document state with increasing accuracy (tiers), and starts tasks.

    Args:
        previewer: Planner of previews.
        deliver: Function that sends a frame of a state to the pages; False if it is obsolete.
        options: Workers and waiting times.
    """

    def __init__(
        self,
        previewer: CoarsePlanner,
        deliver: Callable[[MessageFrame, DocumentState | None], bool],
        options: SchedulerOptions,
    ) -> None:
        self.previewer = previewer
        self._rest = options.rest_time
        self._deliver = deliver
        self._make_task_worker = options.task_worker
        self._lock = RLock()
        self._results = ShownResults()
        self._newest: DocumentState | None = None
        # Time of the last simulation [s].
        self._executed_at = 0.0
        self._done = Event()
        self._preview_worker = options.preview_worker(self._fail)
        self._figures_worker = options.task_worker(self._receive)
        # Running and queued tasks for states.
        self._current: Showing | None = None
        self._queued: Showing | None = None
        # Last tasks of which one was completed, with their frames.
        self._known: Showing | None = None
        # Number of tasks of the figures worker.
        self._count = 0
        self._task_worker: TaskWorker | None = None
        self._running: set[str] = set()

    @property
    def planned(self) -> Preview | None:
        """Newest preview of the document; None if there is none yet."""
        return self._results.planned

    @property
    def start(self) -> FloatArray | None:
        """Joint positions at the start of the newest plan [rad], (dof,); None if there is none."""
        return self._results.start

    def wait(self) -> None:
        """Wait until the first picture or refusal was sent."""
        self._done.wait()

    def show(self, state: DocumentState) -> None:
        """Show a state; the work on older states is ended."""
        with self._lock:
            old = self._newest
            self._newest = state
            state.results = self._results
            if old is not None:
                self._end_progress(old)
            current = self._current
            if current is not None and current.state is old and not current.state.is_same(state):
                # Obsolete work is stopped, because it slows the preview down.
                current.is_stopped = True
                self._figures_worker.stop(self._figures_id)
            show = self._show_state if state.certified is None else self._show_certified
            self._preview_worker.submit(partial(show, state))

    def check_task(self, id: str, task: str) -> None:
        """Raise InvalidInput for an unknown task, or an identifier of another task that runs."""
        with self._lock:
            if task not in TASKS:
                raise InvalidInput(f"The task must be one of {', '.join(TASKS)}, but is {task!r}.")
            if id.startswith(STATE_ID) or id in self._running:
                raise InvalidInput(f"The task identifier {id} is already in use.")

    def start_task(self, id: str, task: str, request: Mapping[str, Any]) -> None:
        """Start a task in the task process; `id` identifies the task for `cancel`."""
        with self._lock:
            if self._task_worker is None:
                self._task_worker = self._make_task_worker(self._receive)
            self._running.add(id)
            self._task_worker.submit(id, task, dict(request))

    def cancel(self, id: str) -> None:
        """Cancel a task."""
        with self._lock:
            if id in self._running and self._task_worker is not None:
                self._task_worker.cancel(id)

    def forget(self) -> None:
        """Discard all results, because another document is opened."""
        with self._lock:
            if self._newest is not None:
                self._end_progress(self._newest)
            self._newest = None
            # Work that is still running refers to the results of the previous document.
            self._results = ShownResults()

    def show_again(self) -> None:
        """Send everything with the next state, because a page has nothing yet."""
        with self._lock:
            # `planned = None`: an error frame also contains the outline, which a new page lacks.
            self._results.sent_parts = self._results.drawn = self._results.start = None

    def close(self) -> None:
        """End the task processes and the worker threads."""
        for worker in (self._figures_worker, self._task_worker):
            if worker is not None:
                worker.close()
        self._done.set()
        self._preview_worker.close()

    # The methods below run in the thread of the preview worker.

    def _fail(self, frame: MessageFrame) -> None:
        """Send the error of a worker thread as the answer to the newest state."""
        self._deliver(frame, self._newest)

    def _show_state(self, state: DocumentState, stale: StaleCheck) -> None:
        """Compute and send the tiers of a state until a newer state supersedes it."""
        with contextlib.suppress(Superseded):
            self._compute(state, stale)
        self._done.set()

    def _show_certified(self, state: DocumentState, stale: StaleCheck) -> None:
        """Send the plan of a certificate, its figures and its execution."""
        assert state.certified is not None
        plan = state.certified.load()
        planned = self.previewer.shown(
            self.previewer.job(state.data, plan.run.name), plan, Tier.CERTIFIED
        )
        self.previewer.follow(state.data, planned.start)
        state.answered = True
        frame = picture_frame(planned, state.view)
        self._deliver(frame.stamped(certificate=state.certified.id), state)
        self._show_arm(state, planned.job)
        self._deliver(MessageFrame("figures", state.certified.figures), state)
        if not stale():
            self._show_execution(state, planned)

    def _compute(self, state: DocumentState, stale: StaleCheck) -> None:
        """Show an outline if the plan is slow, then a preview, and request exact figures."""
        # An error of reach is explained only after the last edit, because that takes long.
        for explain in (False, True):
            try:
                is_long = self.previewer.is_long(state.data)
                if may_wait():
                    # The plan waits until its functions are compiled, the path and the arm do not.
                    self._send_outline(state)
                    self._show_arm(state, self.previewer.job(state.data, state.run))
                if is_long or min(state.results.plan_times) > SLOW_PLAN:
                    self._send_outline(state)
                    self._wait(state, stale)
                    self._send_progress(state, Step(("planning",)), at_once=True)
                if is_long and self.previewer.is_full(state.data, state.run):
                    # The page answers while another process plans.
                    self._show_arm(state, self.previewer.job(state.data, state.run))
                    self._request_figures(state, WITHOUT_PREVIEW)
                    return
                self._plan(state, stale, explain)
                break
            except ArmContourError as error:
                self._refuse(state, error)
                self._wait(state, stale)
                if not isinstance(error, Unreachable):
                    break
        self._wait(state, stale)
        self._request_figures(state, AFTER_PREVIEW)

    def _plan(self, state: DocumentState, stale: StaleCheck, explain: bool) -> None:
        """Compute and show the preview of a state; `explain`: as for `CoarsePlanner.plan`."""
        results = state.results
        # Computing time is CPU time, so that plans are not cancelled because the machine is busy.
        started_at = time.thread_time()

        def report(step: Step) -> None:
            if time.thread_time() > started_at + MAX_OBSOLETE_PLAN and stale():
                raise Superseded
            self._send_progress(state, step)

        planned = self.previewer.plan(state.data, state.run, report, explain=explain)
        plan_time = time.thread_time() - started_at
        results.plan_times = results.plan_times[1], plan_time
        self._show_plan(state, planned)
        if plan_time > FAST_PLAN or planned.trajectory.duration > MAX_EXECUTED:
            self._wait(state, stale)
        if results.simulation_time > SLOW_SIMULATION:
            return
        if stale() and time.monotonic() < self._executed_at + MIN_SIMULATION_INTERVAL:
            raise Superseded
        started_at = time.thread_time()
        self._show_execution(state, planned)
        results.simulation_time = time.thread_time() - started_at

    def _follow(self, state: DocumentState, start: FloatArray, stale: StaleCheck) -> None:
        """Plan the next previews in the configuration of a plan of the task process."""
        if state.results is self._results:
            self.previewer.follow(state.data, start)

    def _show_plan(self, state: DocumentState, planned: Preview) -> None:
        """Send the picture of a plan, and the arm."""
        state.answered = True
        state.results.planned = planned
        state.results.start = planned.start
        self._deliver(picture_frame(planned, state.view), state)
        # The arm follows the plan, because computing the triangles of its links can take long.
        self._show_arm(state, planned.job)

    def _show_execution(self, state: DocumentState, planned: Preview) -> None:
        """Simulate a plan and send its execution, unless the motion is long."""
        if not self.previewer.may_execute(planned):
            return
        try:
            executed = self.previewer.execute(planned)
        except ArmContourError as error:
            self._refuse(state, error, planned)
        else:
            self._executed_at = time.monotonic()
            self._deliver(execution_frame(executed, state.view), state)

    def _wait(self, state: DocumentState, stale: StaleCheck) -> None:
        """Wait until the state is unchanged for the rest time; raises Superseded if it changes."""
        self._done.set()
        if stale(state.start_time + self._rest - time.monotonic()):
            raise Superseded

    def _send_outline(self, state: DocumentState) -> None:
        """Send the picture of the path without a plan."""
        frame, program = self._outline(state)
        if self._deliver(frame, state):
            state.results.drawn = program

    def _outline(self, state: DocumentState) -> tuple[MessageFrame, Program]:
        """Make the picture of a state's path without a plan, and return the path."""
        if state.outline is None:
            program = self.previewer.path_program(state.data)
            state.outline = drawing_frame(program, state.view, run=state.run), program
        return state.outline

    def _show_arm(self, state: DocumentState, job: Job) -> None:
        """Send arm and scene if they differ from those that the pages show."""
        parts = state.results.sent_parts
        corners = path_points(job)
        points = None if corners is None else corners.tolist()
        shown = job.arm, job.scene, points
        if parts is None or parts[0] is not job.arm or parts[1:] != shown[1:]:
            if self._deliver(arm_frame(job), state):
                state.results.sent_parts = shown

    def _refuse(
        self, state: DocumentState, error: ArmContourError, planned: Preview | None = None
    ) -> None:
        """Send an error with its position on the path.

        `planned`: the plan whose execution has failed; None for an error of planning.
        """
        results = state.results
        state.answered = True
        header = refusal_header(
            error,
            state.view,
            tier=1 if planned is None else 2,
            run=state.run,
            planned=planned,
            waypoints=state.waypoints,
        )
        frame = MessageFrame("refusal", header)
        if planned is None:
            # The path is shown without a plan, so that the user can move it into reach.
            with contextlib.suppress(ArmContourError):
                outline, program = self._outline(state)
                frame = MessageFrame(
                    "refusal", {**header, "outline": outline.header}, outline.arrays
                )
                if results.start is None and results.drawn is not program:
                    self._send_outline(state)
            if results.sent_parts is None:
                # Pages show the new cell, although its job has no plan.
                with contextlib.suppress(ArmContourError):
                    self._show_arm(state, self.previewer.job(state.data, state.run))
        self._deliver(frame, state)

    # Exact figures and tasks

    @property
    def _figures_id(self) -> str:
        """Task identifier of the last request for exact figures."""
        return f"{STATE_ID}{self._count}"

    def _request_figures(self, state: DocumentState, tasks: Sequence[str]) -> None:
        """Request the exact figures and pictures of a state; if they are known, send them."""
        with contextlib.suppress(ArmContourError):
            showing = Showing(state, state.request(), list(tasks))
            with self._lock:
                current = self._current
                is_running = current is not None and not current.is_stopped
                if current is not None and is_running and current.request == showing.request:
                    self._queued = None
                    self._continue(current, state)
                    return
                if self._known is not None and self._known.request == showing.request:
                    showing.tasks = [*self._known.tasks]
                    showing.frames = [*self._known.frames]
                    self._continue(showing, state)
                self._queued = None
                if not showing.tasks:
                    return
                if current is None:
                    self._submit(showing)
                else:
                    # The running task is that of an older state, which was stopped.
                    self._queued = showing

    def _submit(self, showing: Showing) -> None:
        """Submit the next task for a state to the task process."""
        self._current = showing
        self._queued = None
        self._count += 1
        self._figures_worker.submit(self._figures_id, showing.tasks[0], dict(showing.request))

    def _continue(self, known: Showing, state: DocumentState) -> None:
        """Answer a state by known frames; the tasks that are left are for this state."""
        known.state = state
        for frame in known.frames:
            self._show_frame(state, frame)
        if known.has_figures:
            self._end_progress(state)

    def _receive(self, frame: MessageFrame) -> None:
        """Process a frame that a task process has sent."""
        with self._lock:
            task_id = str(frame.header.get("id", ""))
            if not task_id.startswith(STATE_ID):
                self._receive_task_frame(task_id, frame)
            elif self._current is not None and task_id == self._figures_id:
                if frame.kind == "progress":
                    self._receive_progress(self._current, frame)
                else:
                    self._receive_state_frame(self._current, frame)

    def _receive_task_frame(self, task_id: str, frame: MessageFrame) -> None:
        """Send the frame of a task that a page has started to the pages."""
        if frame.kind != "progress":
            self._running.discard(task_id)
        self._deliver(frame, None)

    def _receive_progress(self, showing: Showing, frame: MessageFrame) -> None:
        """Send the progress of a task for a state until the exact figures are computed."""
        header = frame.header
        if not showing.has_figures:
            step = Step(tuple(header["steps"]), header["share"], header["part"])
            self._send_progress(showing.state, step)

    def _receive_state_frame(self, showing: Showing, frame: MessageFrame) -> None:
        """Process the last frame of a task for a state, and submit the next task."""
        state = showing.state
        self._current = None
        is_shown = frame.kind in (*dispatch.SHOWING, "omitted")
        if is_shown:
            self._known = showing
            del showing.tasks[0]
            showing.frames.append(frame)
            self._show_frame(state, frame)
            if frame.kind == "figures":
                self._end_progress(state)
        else:
            self._end_showing(state, frame)
        if self._queued is not None:
            self._submit(self._queued)
        elif is_shown and showing.tasks and state is self._newest:
            self._submit(showing)

    def _show_frame(self, state: DocumentState, frame: MessageFrame) -> None:
        """Send a picture, figures or an execution that the task process has computed."""
        # While the pages show a certified plan, those of the run are not sent.
        is_certified = self._newest is not None and self._newest.certified is not None
        if frame.kind == "omitted" or is_certified:
            return
        is_current = self._deliver(frame, state)
        if is_current and frame.kind == "picture" and state is self._newest:
            state.answered = True
            state.results.start = start = np.array(frame.arrays["q"][0])
            self._preview_worker.submit(partial(self._follow, state, start))

    def _end_showing(self, state: DocumentState, frame: MessageFrame) -> None:
        """Send why a task for a state has no result; nothing if it was stopped."""
        if self._newest is not None and self._newest.certified is not None:
            self._end_progress(state)
        elif frame.kind == "refusal":
            state.answered = True
            if frame.header["tier"] == 1 and state.outline is not None:
                outline, _ = state.outline
                header = {**frame.header, "outline": outline.header}
                frame = MessageFrame("refusal", header, outline.arrays)
            self._deliver(frame, state)
            self._end_progress(state)
        elif frame.kind == "failed":
            # The process has failed, for example because it was killed.
            self._deliver(MessageFrame("notice", {"sentence": frame.header["sentence"]}), state)
            self._end_progress(state)

    def _send_progress(self, state: DocumentState, step: Step, *, at_once: bool = False) -> None:
        """Send progress after a delay, then at intervals."""
        with self._lock:
            now = time.monotonic()
            left = state.time_left.after(step)
            due = state.start_time + PROGRESS_DELAY
            if state.reported is not None:
                due = state.reported + PROGRESS_INTERVAL
            if state is self._newest and (at_once or now >= due):
                state.reported = now
                tier = Tier.EXACT if state.answered else Tier.PREVIEW
                header = {
                    **{"id": STATE_ID, "task": STATE_ID, "tier": tier, "state": WORKING},
                    **{"steps": step.names, "share": step.done, "part": step.part, "left": left},
                }
                self._deliver(MessageFrame("progress", header), state)

    def _end_progress(self, state: DocumentState) -> None:
        """Remove the progress from the pages."""
        if state.reported is not None:
            state.reported = None
            self._deliver(
                MessageFrame("progress", {"id": STATE_ID, "task": STATE_ID, "state": DONE}), None
            )
