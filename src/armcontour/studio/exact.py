"""What takes long, in other processes: exact figures of what is shown, and tasks of the person.

There is one process for figures and one for tasks, so that a long task holds no figures up.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from threading import RLock, Thread
from typing import Any, TypeAlias

from armcontour.errors import InvalidInput
from armcontour.studio.lanes import SlowLane
from armcontour.studio.tasks import working
from armcontour.studio.wire import Frame

MakeLane: TypeAlias = Callable[[Callable[[Frame], None]], SlowLane]
# Figures that took longer are not waited for when they are out of date [s].
PATIENCE = 2.0
# What a person can ask for.
TASKS = tuple(x for x in working.TASKS if x != "figures")
# Frames after which a task is over.
LAST = ("figures", "result", "refusal", "failed", "cancelled")
# Names of figures; no task of a page has such a name.
OWN = "#"


@dataclass(frozen=True, slots=True)
class Asked:
    """Figures that are asked for.

    Args:
        rev: Revision of the document.
        answers: As of `Shown`.
        request: What is computed.
    """

    rev: int
    answers: Mapping[int, int]
    request: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Known:
    """Figures that are known: what was computed, and what came of it."""

    request: Mapping[str, Any]
    header: Mapping[str, Any]


class Exact:
    """Asks for figures one after the other, of which only the newest is wanted, and for tasks.

    Args:
        deliver: Called with each frame, and with what it answers if it has figures.
        lane: Makes a lane.
    """

    def __init__(self, deliver: Callable[[Frame, Asked | None], None], lane: MakeLane) -> None:
        self._deliver, self._make = deliver, lane
        self._lock = RLock()
        self._figures = lane(self._hear)
        self._tasks: SlowLane | None = None
        self._running: set[str] = set()
        self._count, self._since = 0, 0.0
        # What is computed, and what is to be computed next.
        self._asked: Asked | None = None
        self._wanted: Asked | None = None
        self.latest: Known | None = None

    def ask(self, asked: Asked) -> None:
        """Compute figures, in place of others that wait; what is known is told at once."""
        with self._lock:
            if self.latest is not None and self.latest.request == asked.request:
                self._wanted = None
                self._deliver(Frame("figures", self.latest.header), asked)
                return
            self._wanted = asked
            if self._asked is None:
                self._next()
            elif time.monotonic() - self._since > PATIENCE:
                self._figures.cancel(f"{OWN}{self._count}")

    def do(self, id: str, task: str, request: Mapping[str, Any]) -> None:
        """Begin a task.

        Args:
            id: Its name, by which it can be cancelled.
            task: What is done, of `TASKS`.
            request: What it is done with.

        Raises:
            InvalidInput: No such task, or a name that is taken.
        """
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
        """End a task; nothing happens if it is over."""
        with self._lock:
            if id in self._running and self._tasks is not None:
                self._tasks.cancel(id)

    def forget(self) -> None:
        """Forget figures, as files of the job may have changed."""
        with self._lock:
            self.latest = None

    def close(self) -> None:
        """End both processes, at the same time."""
        lanes = [x for x in (self._figures, self._tasks) if x is not None]
        closing = [Thread(target=x.close, daemon=True) for x in lanes]
        for x in closing:
            x.start()
        for x in closing:
            x.join()

    def _next(self) -> None:
        """Compute the figures that are wanted."""
        self._asked, self._wanted = self._wanted, None
        if self._asked is not None:
            self._count += 1
            self._since = time.monotonic()
            self._figures.submit(f"{OWN}{self._count}", "figures", dict(self._asked.request))

    def _hear(self, frame: Frame) -> None:
        """Take a frame of a process."""
        with self._lock:
            id = str(frame.header.get("id", ""))
            if not id.startswith(OWN):
                if frame.kind in LAST:
                    self._running.discard(id)
                self._deliver(frame, None)
                return
            asked = self._asked
            if asked is None or id != f"{OWN}{self._count}" or frame.kind not in LAST:
                return
            if frame.kind == "figures":
                self.latest = Known(asked.request, frame.header)
            if frame.kind != "cancelled":
                self._deliver(frame, asked)
            self._next()
