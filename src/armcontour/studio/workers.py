"""Workers: a thread that computes only the newest preview, and a process that runs tasks."""

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
    """Function that tests if newer work is submitted."""

    def __call__(self, within: float = 0.0) -> bool:
        """True if newer work waits or is submitted within a time [s]."""


Work: TypeAlias = Callable[[StaleCheck], None]


class PreviewWorker:
    """A thread for previews that executes only the newest submitted function."""

    def __init__(self, deliver: Callable[[PageFrame], None]) -> None:
        self._deliver = deliver
        self._news = Condition()
        self._waiting: Work | None = None
        self._newest, self._is_open = 0, True
        Thread(target=self._run, name="studio previews", daemon=True).start()

    def submit(self, work: Work) -> None:
        """Execute a function next; the function replaces a waiting function."""
        with self._news:
            self._waiting, self._newest = work, self._newest + 1
            self._news.notify()

    def close(self) -> None:
        """End the thread after the running function."""
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
                # The worker continues, because the preview of the next edit may succeed.
                sentence = f"Internal error of the preview ({type(error).__name__}): {error}"
                self._deliver(PageFrame("notice", {"sentence": sentence}))

    def _is_stale(self, number: int, within: float = 0.0) -> bool:
        with self._news:
            return self._news.wait_for(lambda: self._newest > number, max(0.0, within))


class TaskWorker:
    """A process that runs tasks in order; started by the first task and after a cancellation."""

    def __init__(self, deliver: Callable[[PageFrame], None]) -> None:
        self._deliver = deliver
        self._news = Condition()
        self._waiting: deque[TaskInput] = deque()
        self._running: TaskInput | None = None
        self._future: Future[bytes] | None = None
        self._pool: ProcessPool | None = None
        self._is_open = True
        # Frames that wait for delivery, oldest first.
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
        """Cancel a task that is running or waiting."""
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
        # The lock is released first, because the thread of the tasks may wait for it.
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
                # The new process loads its modules now, so that the next task starts sooner.
                with suppress(RuntimeError):
                    _warm_up(self._pool)

    def _next(self) -> Future[bytes] | None:
        """Wait for the next task and start it; returns its future, or None after `close`."""
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
        """Deliver queued frames without holding the lock; only one thread delivers at any time."""
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
    """Reduce the priority of the process and load the modules that tasks need."""
    if hasattr(os, "nice"):
        pool.submit(os.nice, NICE)
    pool.submit(work, WARM)
