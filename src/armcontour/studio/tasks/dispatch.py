"""Entry point of the task process: table of tasks, progress, warm-up."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping
from contextlib import nullcontext
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

from armcontour.core.errors import ArmContourError, InvalidInput
from armcontour.core.file_access import reading_below
from armcontour.core.pool import begin_process
from armcontour.core.progress import Progress, Step, TimeLeft
from armcontour.report.message_frame import MessageFrame
from armcontour.studio.tasks.figures import changes, compare, executed, figures, picture
from armcontour.studio.tasks.files import certify, export, identify, learn, report
from armcontour.studio.tasks.measurement import measure
from armcontour.studio.tasks.request import Request

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

Listener: TypeAlias = Callable[[bytes], None]
# Minimum interval of progress frames [s].
PROGRESS_INTERVAL = 0.1
# Niceness of the process of tasks that a page starts, so that what is shown has priority.
NICE = 10
# Tasks of one state of a document, which use the same results.
SHOWING = ("picture", "figures", "executed")
# Small job that is computed to load the modules that tasks need.
WARMUP_JOB = """
name: small
arm: pmk3s
path: {points: [[0.35, 0.1], [0.4, 0.15], [0.35, 0.2]]}
corners: {tolerance: 1 mm}
servo: {kp: 25, kv: 150}
runs: {one: {}}
"""
TASKS: dict[str, Callable[[Request], MessageFrame]] = {
    "picture": picture,
    "figures": figures,
    "executed": executed,
    "changes": changes,
    "compare": compare,
    "certify": certify,
    "export": export,
    "report": report,
    "identify": identify,
    "learn": learn,
    "measure": measure,
}


# Last request of a task in SHOWING, with its results; at most one.
_shown: list[Request] = []


class Stopped(Exception):
    """Raised to end a task because its result is no longer needed; what is remembered stays."""


class TaskInput(NamedTuple):
    """A task for the task process; `id` identifies the task for `cancel`.

    Args:
        id: Identifier for `cancel`.
        task: Name of the task.
        request: Fields of a `Request`.
    """

    id: str
    task: str
    request: Mapping[str, Any]


def serve(tasks: Connection, lifeline: Connection, threshold: tuple[int, int, int]) -> None:
    """Run the main loop of the task process: execute tasks and send their frames."""
    begin_process(lifeline, threshold)
    is_nice = False
    # The modules that tasks need are loaded now, so that the first task starts sooner.
    figures(Request(text=WARMUP_JOB))

    def stops(id: str) -> bool:
        """Return whether the task with this identifier must end."""
        return tasks.poll() and tasks.recv() == id

    while True:
        received = tasks.recv()
        # A request to stop can arrive after its task has ended.
        if isinstance(received, str):
            continue
        if received.task not in SHOWING and not is_nice and hasattr(os, "nice"):
            os.nice(NICE)
            is_nice = True
        tasks.send_bytes(work(received, tasks.send_bytes, stops))


def work(
    task_input: TaskInput, listener: Listener, stops: Callable[[str], bool] = lambda id: False
) -> bytes:
    """Run a task; returns the encoded final frame, and sends progress to the listener.

    `stops`: returns whether the task must end; called whenever the task reports progress.
    """
    id, task, request = task_input
    send = _progress_frames(id, task, listener)

    def report(step: Step) -> None:
        if stops(id):
            raise Stopped
        send(step)

    try:
        frame = do(task, request, report)
    except Stopped:
        frame = MessageFrame("cancelled")
    except ArmContourError as error:
        frame = MessageFrame("failed", {"sentence": str(error)})
    except Exception as error:
        sentence = f"Internal error of the task {task} ({type(error).__name__}): {error}"
        frame = MessageFrame("failed", {"sentence": sentence})
    return frame.stamped(id=id, task=task).pack()


def _progress_frames(id: str, task: str, listener: Listener) -> Progress:
    """Make the callback that sends progress frames, with the estimated remaining time."""
    reported_at = time.monotonic()
    time_left = TimeLeft(time.monotonic)

    def report(step: Step) -> None:
        """Send a step, unless the last one was sent less than PROGRESS_INTERVAL ago."""
        nonlocal reported_at
        now = time.monotonic()
        left = time_left.after(step)
        if now < reported_at + PROGRESS_INTERVAL:
            return
        reported_at = now
        header = {
            **{"id": id, "task": task, "steps": step.names, "share": step.done},
            **{"part": step.part, "eta": left},
        }
        listener(MessageFrame("progress", header).pack())

    return report


def do(task: str, request: Mapping[str, Any], progress: Progress) -> MessageFrame:
    """Run a task and return its frame.

    The tasks `picture` and `figures` return an error of the job as a frame `refusal`; other tasks
    raise it.
    """
    if task not in TASKS:
        raise InvalidInput(f"The task must be one of {', '.join(TASKS)}, but is {task!r}.")
    task_request = Request(**request, progress=progress)
    if task in SHOWING:
        task_request = _with_results(task_request)
    named = [FilePath(x) for x in task_request.named]
    allowed = [FilePath(x) for x in task_request.allowed]
    with reading_below(allowed, named) if allowed else nullcontext():
        frame = TASKS[task](task_request)
    if task == SHOWING[-1]:
        _shown.clear()
    return frame


def _with_results(request: Request) -> Request:
    """Return the last request with its results if this one is the same, and keep it."""
    if request in _shown:
        (same,) = _shown
        same.progress = request.progress
        return same
    # The results of the previous request are released before new ones are computed.
    _shown.clear()
    _shown.append(request)
    return request
