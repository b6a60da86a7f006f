"""Workers: one thread for previews, of which the latest wins, and one process for tasks."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Mapping
from concurrent.futures import CancelledError, Future
from contextlib import suppress
from functools import partial
from threading import Condition, Thread
from typing import Any, Protocol, TypeAlias

from armcontour.core.child_process import ProcessEnded
from armcontour.core.errors import ArmContourError
from armcontour.core.pool import ProcessPool
from armcontour.studio.page_frame import PageFrame
from armcontour.studio.tasks.dispatch import WARM, TaskInput, work

# Niceness of the task process, so that previews have priority.
NICE = 10


class StaleCheck(Protocol):
    """Tests if newer work waits, or arrives within a time [s]."""

    def __call__(self, within: float = 0.0) -> bool:
        """True if newer work waits."""


Work: TypeAlias = Callable[[StaleCheck], None]


class PreviewWorker:
    """A thread for previews that does only the latest of the waiting works."""

    def __init__(self, deliver: Callable[[PageFrame], None]) -> None:
        self._deliver = deliver
        self._news = Condition()
        self._waiting: Work | None = None
        self._newest, self._is_open = 0, True
        Thread(target=self._run, name="studio previews", daemon=True).start()

    def submit(self, work: Work) -> None:
        """Replace the waiting work."""
        with self._news:
            self._waiting, self._newest = work, self._newest + 1
            self._news.notify()

    def close(self) -> None:
        """End after the present work."""
        with self._news:
            self._waiting, self._is_open = None, False
            self._newest += 1
            self._news.notify()

    def _run(self) -> None:
        while True:
            with self._news:
                self._news.wait_for(lambda: self._waiting is not None or not self._is_open)
                work, number = self._waiting, self._newest
                self._waiting = None
            if work is None:
                return
            try:
                work(partial(self._is_stale, number))
            except ArmContourError as error:
                self._deliver(PageFrame("notice", {"sentence": str(error)}))
            except Exception as error:
                # The worker continues, because the next edit may succeed.
                sentence = f"The preview failed: {type(error).__name__}: {error}"
                self._deliver(PageFrame("notice", {"sentence": sentence}))

    def _is_stale(self, number: int, within: float = 0.0) -> bool:
        with self._news:
            return self._news.wait_for(lambda: self._newest > number, max(0.0, within))


class TaskWorker:
    """A process for tasks, in order; it starts with the first task and after a cancellation."""

    def __init__(self, deliver: Callable[[PageFrame], None]) -> None:
        self._deliver = deliver
        self._news = Condition()
        self._waiting: deque[TaskInput] = deque()
        self._running: TaskInput | None = None
        self._future: Future[bytes] | None = None
        self._pool: ProcessPool | None = None
        self._is_open = True
        # Frames to deliver, in order; the delivering thread holds no lock.
        self._frames: deque[PageFrame] = deque()
        self._is_delivering = False
        self._thread = Thread(target=self._run, name="studio tasks", daemon=True)
        self._thread.start()

    def submit(self, id: str, task: str, request: Mapping[str, Any]) -> None:
        """Add a task, one of `TASKS`, to the queue."""
        with self._news:
            self._waiting.append(TaskInput(id, task, request))
            self._news.notify()

    def cancel(self, id: str) -> None:
        """Cancel a running or waiting task."""
        with self._news:
            waiting = [x for x in self._waiting if x.id == id]
            running = self._running is not None and self._running.id == id
            if not waiting and not running:
                return
            self._waiting = deque(x for x in self._waiting if x.id != id)
            if running:
                self._running = None
                assert self._pool is not None and self._future is not None
                if not self._future.cancel():
                    self._pool.kill()
            self._frames.append(PageFrame("cancelled", {"id": id}))
        self._deliver_all()

    def close(self) -> None:
        """End the process, including a running task."""
        with self._news:
            self._waiting.clear()
            self._running, self._is_open = None, False
            self._news.notify()
        # Without the lock, because the thread of the process may wait for it.
        if self._pool is not None:
            self._pool.end()
        self._thread.join()

    def _run(self) -> None:
        """Run the tasks of the queue."""
        while (future := self._next()) is not None:
            assert self._pool is not None
            try:
                self._finish(PageFrame.unpack(future.result()))
            except (ProcessEnded, RuntimeError, CancelledError) as error:
                self._finish(PageFrame("failed", {"sentence": str(error)}))
                # A new process loads the modules for the next task.
                with suppress(RuntimeError):
                    _warm_up(self._pool)

    def _next(self) -> Future[bytes] | None:
        """Wait for the next task and start it; None at the end."""
        with self._news:
            self._news.wait_for(lambda: self._waiting or not self._is_open)
            if not self._is_open:
                return None
            if self._pool is None:
                self._pool = ProcessPool(1)
                _warm_up(self._pool)
            self._running = task_input = self._waiting.popleft()
            self._future = self._pool.submit_reporting(
                self._deliver_progress, partial(work, task_input)
            )
            return self._future

    def _deliver_progress(self, data: bytes) -> None:
        """Deliver progress, unless the task was cancelled."""
        with self._news:
            if self._running is not None:
                self._frames.append(PageFrame.unpack(data))
        self._deliver_all()

    def _finish(self, frame: PageFrame) -> None:
        """Deliver the final frame of the running task, unless it was cancelled."""
        with self._news:
            task_input, self._running = self._running, None
            if task_input is not None:
                self._frames.append(frame.stamped(id=task_input.id))
        self._deliver_all()

    def _deliver_all(self) -> None:
        """Deliver queued frames; one thread at once, without holding the lock."""
        while True:
            with self._news:
                if self._is_delivering or not self._frames:
                    return
                self._is_delivering, frame = True, self._frames.popleft()
            try:
                self._deliver(frame)
            finally:
                with self._news:
                    self._is_delivering = False


def _warm_up(pool: ProcessPool) -> None:
    """Load the modules of tasks in the process, with low priority."""
    if hasattr(os, "nice"):
        pool.submit(os.nice, NICE)
    pool.submit(work, WARM)
