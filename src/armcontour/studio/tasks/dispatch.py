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
from armcontour.studio.tasks.figures import changes, compare, figures
from armcontour.studio.tasks.files import certify, export, identify, learn, report
from armcontour.studio.tasks.measurement import measure
from armcontour.studio.tasks.request import Request

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

Listener: TypeAlias = Callable[[bytes], None]
# Minimum interval of progress frames [s].
PROGRESS_INTERVAL = 0.1
# Niceness of the task process, so that previews have priority.
NICE = 10
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
    "figures": figures,
    "changes": changes,
    "compare": compare,
    "certify": certify,
    "export": export,
    "report": report,
    "identify": identify,
    "learn": learn,
    "measure": measure,
}


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
    if hasattr(os, "nice"):
        os.nice(NICE)
    # The modules that tasks need are loaded now, so that the first task starts sooner.
    figures(Request(text=WARMUP_JOB))
    while True:
        tasks.send_bytes(work(tasks.recv(), tasks.send_bytes))


def work(task_input: TaskInput, listener: Listener) -> bytes:
    """Run a task; returns the encoded final frame, and sends progress to the listener."""
    id, task, request = task_input
    try:
        frame = do(task, request, _progress_frames(id, task, listener))
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

    The task `figures` returns an error of the job as a frame `refusal`; other tasks raise it.
    """
    if task not in TASKS:
        raise InvalidInput(f"The task must be one of {', '.join(TASKS)}, but is {task!r}.")
    task_request = Request(**request, progress=progress)
    named = [FilePath(x) for x in task_request.named]
    allowed = [FilePath(x) for x in task_request.allowed]
    with reading_below(allowed, named) if allowed else nullcontext():
        return TASKS[task](task_request)
