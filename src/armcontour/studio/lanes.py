"""Where work is done: previews in one thread, of which the latest wins; all else in a process."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from threading import Condition, Thread
from typing import TypeAlias

from armcontour.errors import ArmContourError
from armcontour.studio.wire import Frame

Stale: TypeAlias = Callable[[], bool]
Work: TypeAlias = Callable[[Stale], Iterator[Frame]]


class FastLane:
    """One thread for previews: of works that wait, only the latest is done.

    Frames are delivered in the order of the works, so that an older answer never comes after a
    newer one.

    Args:
        deliver: Called in the thread with every frame.
    """

    def __init__(self, deliver: Callable[[Frame], None]) -> None:
        self._deliver = deliver
        self._news = Condition()
        self._waiting: Work | None = None
        self._newest, self._open = 0, True
        self._thread = Thread(target=self._run, name="studio previews", daemon=True)
        self._thread.start()

    def submit(self, work: Work) -> None:
        """Do some work next, in place of what waits.

        Args:
            work: Yields frames; it is told whether newer work waits.
        """
        with self._news:
            self._waiting, self._newest = work, self._newest + 1
            self._news.notify()

    def close(self) -> None:
        """End after the present step; what waits is not done."""
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
                for frame in work(lambda number=number: self._newest > number):  # type: ignore[misc]
                    self._deliver(frame)
            except ArmContourError as error:
                self._deliver(Frame("notice", {"sentence": str(error)}))
            except Exception as error:
                # The lane goes on: the next edit may do without what failed here.
                told = f"The preview failed: {type(error).__name__}: {error}"
                self._deliver(Frame("notice", {"sentence": told}))


class SlowLane:
    """stub"""

    def __init__(self, deliver):
        self._deliver = deliver

    def submit(self, id, task, request):
        self._deliver(Frame("failed", {"id": id, "sentence": "not yet"}))

    def cancel(self, id): ...
    def close(self): ...
