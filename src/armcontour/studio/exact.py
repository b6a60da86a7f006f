"""What takes long, in other processes: exact figures of what is shown, and tasks of the person.

There is one process for figures and one for tasks, so that a long task holds no figures up.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from threading import RLock, Thread
from typing import Any, TypeAlias

from armcontour.errors import InvalidInput
from armcontour.studio.lanes import SlowLane
from armcontour.studio.wire import Frame

MakeLane: TypeAlias = Callable[[Callable[[Frame], None]], SlowLane]
# Figures that took longer are not waited for when they are out of date [s].
PATIENCE = 2.0
# What a person can ask for.
TASKS = ("check", "clearance", "certify", "sweep", "place", "export", "report")
# Frames after which a task is over.
LAST = ("figures", "changes", "result", "refusal", "failed", "cancelled")
# Names of figures; no task of a page has such a name.
OWN = "#"


@dataclass(frozen=True, slots=True)
class Asked:
    """Figures that are asked for, or what to change, which follows them step by step.

    Args:
        rev: Revision of the document.
        answers: As of `Shown`.
        request: What is computed.
        task: "figures" or "changes".
    """

    rev: int
    answers: Mapping[int, int]
    request: Mapping[str, Any]
    task: str = "figures"


@dataclass(frozen=True, slots=True)
class Known:
    """Figures that are known: what was computed, and the frames that came of it."""

    request: Mapping[str, Any]
    frames: tuple[Frame, ...]


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
                *_, last = frames = self.latest.frames
                for frame in frames:
                    self._deliver(frame, asked)
                follows = replace(asked, task="changes")
                # What to change goes on where it is, or is found from its start.
                if self._asked is not None and self._asked.request == asked.request:
                    self._asked, self._wanted = follows, None
                else:
                    self._wanted = follows if last.header.get("share", 0.0) < 1 else None
                if self._asked is None:
                    self._next()
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
            request = dict(self._asked.request)
            self._figures.submit(f"{OWN}{self._count}", self._asked.task, request)

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
                self.latest = Known(asked.request, (frame,))
            elif frame.kind == "changes" and self.latest is not None:
                self.latest = Known(asked.request, (self.latest.frames[0], frame))
            if frame.kind in ("figures", "changes"):
                self._deliver(frame, asked)
                if self._wanted is None and frame.header.get("share", 0.0) < 1:
                    # Steps are short, so that the next figures need not wait for what to change.
                    self._wanted = replace(asked, task="changes")
            elif frame.kind != "cancelled" and asked.task == "figures":
                self._deliver(frame, asked)
            self._next()
