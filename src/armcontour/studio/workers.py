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

from armcontour.core.errors import ArmContourError
from armcontour.core.pool import ProcessPool
from armcontour.core.process import ProcessEnded
from armcontour.studio.page_frame import Frame
from armcontour.studio.tasks.dispatch import WARM, TaskInput, work

# Niceness of the other process, so that previews come first.
NICE = 10


class Stale(Protocol):
    """Tests if newer work waits, or arrives within a time [s]."""

    def __call__(self, within: float = 0.0) -> bool:
        """True if newer work waits."""


Work: TypeAlias = Callable[[Stale], None]


class FastLane:
    """A thread for previews that does only the latest of the waiting works."""

    def __init__(self, deliver: Callable[[Frame], None]) -> None:
        self._deliver = deliver
        self._news = Condition()
        self._waiting: Work | None = None
        self._newest, self._open = 0, True
        Thread(target=self._run, name="studio previews", daemon=True).start()

    def submit(self, work: Work) -> None:
        """Replace the waiting work."""
        with self._news:
            self._waiting, self._newest = work, self._newest + 1
            self._news.notify()

    def close(self) -> None:
        """End after the present work."""
        with self._news:
            self._waiting, self._open = None, False
            self._newest += 1
            self._news.notify()

    def _run(self) -> None:
        while True:
            with self._news:
                self._news.wait_for(lambda: self._waiting is not None or not self._open)
                work, number = self._waiting, self._newest
                self._waiting = None
            if work is None:
                return
            try:
                work(partial(self._is_stale, number))
            except ArmContourError as error:
                self._deliver(Frame("notice", {"sentence": str(error)}))
            except Exception as error:
                # The lane goes on: the next edit may do without what failed here.
                told = f"The preview failed: {type(error).__name__}: {error}"
                self._deliver(Frame("notice", {"sentence": told}))

    def _is_stale(self, number: int, within: float = 0.0) -> bool:
        with self._news:
            return self._news.wait_for(lambda: self._newest > number, max(0.0, within))


class SlowLane:
    """A process for tasks, in order; it starts with the first task and after a cancellation."""

    def __init__(self, deliver: Callable[[Frame], None]) -> None:
        self._deliver = deliver
        self._news = Condition()
        self._waiting: deque[TaskInput] = deque()
        self._running: TaskInput | None = None
        self._doing: Future[bytes] | None = None
        self._pool: ProcessPool | None = None
        self._open = True
        # Frames on their way, in order; who delivers them holds no lock.
        self._said: deque[Frame] = deque()
        self._saying = False
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
                assert self._pool is not None and self._doing is not None
                if not self._doing.cancel():
                    self._pool.kill()
            self._said.append(Frame("cancelled", {"id": id}))
        self._deliver_all()

    def close(self) -> None:
        """End the process, including a running task."""
        with self._news:
            self._waiting.clear()
            self._running, self._open = None, False
            self._news.notify()
        # Without the lock, for which the thread of the process may wait.
        if self._pool is not None:
            self._pool.end()
        self._thread.join()

    def _run(self) -> None:
        """Run the tasks of the queue."""
        while (doing := self._next()) is not None:
            assert self._pool is not None
            try:
                self._end(Frame.unpack(doing.result()))
            except (ProcessEnded, RuntimeError, CancelledError) as error:
                self._end(Frame("failed", {"sentence": str(error)}))
                # Another process gets ready for the next task.
                with suppress(RuntimeError):
                    _get_ready(self._pool)

    def _next(self) -> Future[bytes] | None:
        """Wait for the next task and start it; None at the end."""
        with self._news:
            self._news.wait_for(lambda: self._waiting or not self._open)
            if not self._open:
                return None
            if self._pool is None:
                self._pool = ProcessPool(1)
                _get_ready(self._pool)
            self._running = given = self._waiting.popleft()
            self._doing = self._pool.submit_reporting(self._hear, partial(work, given))
            return self._doing

    def _hear(self, data: bytes) -> None:
        """Deliver progress, unless the task was cancelled."""
        with self._news:
            if self._running is not None:
                self._said.append(Frame.unpack(data))
        self._deliver_all()

    def _end(self, frame: Frame) -> None:
        """Deliver the final frame of the running task, unless it was cancelled."""
        with self._news:
            given, self._running = self._running, None
            if given is not None:
                self._said.append(frame.stamped(id=given.id))
        self._deliver_all()

    def _deliver_all(self) -> None:
        """Deliver queued frames; one thread at once, without holding the lock."""
        while True:
            with self._news:
                if self._saying or not self._said:
                    return
                self._saying, frame = True, self._said.popleft()
            try:
                self._deliver(frame)
            finally:
                with self._news:
                    self._saying = False


def _get_ready(pool: ProcessPool) -> None:
    """Load the modules of tasks in the process, with low priority."""
    if hasattr(os, "nice"):
        pool.submit(os.nice, NICE)
    pool.submit(work, WARM)
