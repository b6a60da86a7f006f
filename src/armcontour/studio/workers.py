"""Workers: a thread that computes only the newest preview, and a process that runs tasks."""

from __future__ import annotations

import gc
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from threading import Condition, Lock, Thread, Timer
from typing import Any, Protocol, TypeAlias

from armcontour.core.errors import ArmContourError
from armcontour.core.pool import ENVIRONMENT, ProcessEnded, starting_processes
from armcontour.report.message_frame import MessageFrame
from armcontour.studio.tasks.dispatch import TaskInput, serve


class StaleCheck(Protocol):
    """Function that tests if newer work is submitted."""

    def __call__(self, within: float = 0.0) -> bool:
        """Return whether newer work waits or is submitted within a time [s]."""


Work: TypeAlias = Callable[[StaleCheck], None]
# Time within which a task must stop when it is asked to [s]; its process is killed then, and what
# it remembers is lost.
MAX_STOPPING = 20.0


class PreviewWorker:
    """A thread for previews that executes only the newest submitted function.

    Args:
        deliver: Function that sends the frame of an error.
    """

    def __init__(self, deliver: Callable[[MessageFrame], None]) -> None:
        self._deliver = deliver
        self._news = Condition()
        self._waiting: Work | None = None
        self._newest = 0
        self._is_open = True
        Thread(target=self._run, name="studio previews", daemon=True).start()

    def submit(self, work: Work) -> None:
        """Execute a function next; the function replaces a waiting function."""
        with self._news:
            self._waiting = work
            self._newest = self._newest + 1
            self._news.notify()

    def close(self) -> None:
        """End the thread after the running function."""
        with self._news:
            self._waiting = None
            self._is_open = False
            self._newest += 1
            self._news.notify()

    def _run(self) -> None:
        """Execute the newest function that waits, until the worker is closed."""
        while True:
            with self._news:
                self._news.wait_for(lambda: self._waiting is not None or not self._is_open)
                work = self._waiting
                number = self._newest
                self._waiting = None
            if work is None:
                return
            try:
                work(partial(self._is_stale, number))
            except ArmContourError as error:
                self._deliver(MessageFrame("notice", {"sentence": str(error)}))
            except Exception as error:
                # The worker continues, because the preview of the next edit may succeed.
                sentence = f"Internal error of the preview ({type(error).__name__}): {error}"
                self._deliver(MessageFrame("notice", {"sentence": sentence}))

    def _is_stale(self, number: int, within: float = 0.0) -> bool:
        """Return whether a newer function than this number waits, or arrives within a time [s]."""
        with self._news:
            return self._news.wait_for(lambda: self._newest > number, max(0.0, within))


class TaskProcess:
    """A process that runs tasks."""

    def __init__(self) -> None:
        from multiprocessing import Pipe

        from loky.backend.process import LokyProcess

        self._tasks, other_end = Pipe()
        # A pipe can be written by one thread at a time only.
        self._writing = Lock()
        with starting_processes() as (lifeline, self._writer):
            arguments = other_end, lifeline, gc.get_threshold()
            self._process = LokyProcess(target=serve, args=arguments, daemon=True, env=ENVIRONMENT)
            self._process.start()
        self.is_killed = False
        other_end.close()

    def run(self, task_input: TaskInput, listener: Callable[[MessageFrame], None]) -> MessageFrame:
        """Run a task and return its final frame; `listener` receives its progress."""
        try:
            with self._writing:
                self._tasks.send(task_input)
            while (frame := MessageFrame.unpack(self._tasks.recv_bytes())).kind == "progress":
                listener(frame)
        except (EOFError, OSError):
            self._process.join()
            raise ProcessEnded.from_reason(f"exit code {self._process.exitcode}") from None
        return frame

    def stop(self, id: str) -> None:
        """Ask a running task to stop at its next report of progress; the process continues."""
        with self._writing, suppress(OSError):
            self._tasks.send(id)

    def kill(self) -> None:
        """End the process, including a running task."""
        self.is_killed = True
        self._process.terminate()
        self._process.join()


class TaskWorker:
    """A process that runs tasks in order; started by the first task and after a cancellation.

    Args:
        deliver: Function that sends the frames of tasks.
    """

    def __init__(self, deliver: Callable[[MessageFrame], None]) -> None:
        self._deliver = deliver
        self._news = Condition()
        self._waiting: deque[TaskInput] = deque()
        self._running: str | None = None
        self._process: TaskProcess | None = None
        self._is_cancelled = False
        # Cancels a task that does not stop in time.
        self._stopping = Timer(0.0, lambda: None)
        self._is_open = True
        self._thread = Thread(target=self._run, name="studio tasks", daemon=True)
        self._thread.start()

    def submit(self, id: str, task: str, request: Mapping[str, Any]) -> None:
        """Add a task, one of `TASKS`, to the queue."""
        with self._news:
            self._waiting.append(TaskInput(id, task, request))
            self._news.notify()

    def stop(self, id: str) -> None:
        """Stop a task when it reports progress next, so that its process keeps its results."""
        with self._news:
            if self._running == id and self._process is not None:
                self._process.stop(id)
                self._stopping.cancel()
                self._stopping = Timer(MAX_STOPPING, self.cancel, (id,))
                self._stopping.daemon = True
                self._stopping.start()
        self._forget(id)

    def cancel(self, id: str) -> None:
        """Cancel a task that is running or waiting."""
        with self._news:
            if self._running == id and self._process is not None:
                self._is_cancelled = True
                self._process.kill()
        self._forget(id)

    def _forget(self, id: str) -> None:
        """Remove a task that is waiting."""
        with self._news:
            is_waiting = any(x.id == id for x in self._waiting)
            self._waiting = deque(x for x in self._waiting if x.id != id)
        if is_waiting:
            self._deliver(MessageFrame("cancelled", {"id": id}))

    def close(self) -> None:
        """End the process, including a running task."""
        with self._news:
            self._is_open = False
            if self._process is not None:
                self._process.kill()
            self._news.notify()
        self._thread.join()

    def _run(self) -> None:
        """Run the tasks of the queue."""
        while True:
            with self._news:
                self._news.wait_for(lambda: self._waiting or not self._is_open)
                if not self._is_open:
                    return
                self._process = self._process or TaskProcess()
                task_input = self._waiting.popleft()
                self._is_cancelled = False
                self._running = task_input.id
            try:
                frame = self._process.run(task_input, self._deliver)
            except ProcessEnded as error:
                frame = MessageFrame("failed", {"sentence": str(error)})
                self._process.kill()
            with self._news:
                self._running = None
                self._stopping.cancel()
                if self._is_cancelled:
                    frame = MessageFrame("cancelled", {})
                if not self._is_open:
                    return
                if self._process.is_killed:
                    self._process = TaskProcess()
            self._deliver(frame.stamped(id=task_input.id))
