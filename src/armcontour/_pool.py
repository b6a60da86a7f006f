"""Other processes that do one piece of work after the other, and one that can be ended."""

from __future__ import annotations

import subprocess
import time
from collections.abc import Callable
from concurrent.futures import Executor, Future
from functools import partial
from queue import SimpleQueue
from threading import Lock, Thread
from typing import Any, Generic, TypeVar

from armcontour._process import (
    ProcessEnded,
    can_start,
    end,
    processors,
    receive,
    send,
    start,
)

T = TypeVar("T")
R = TypeVar("R")
# So many processes of a pool may end one after the other before they are ready for work.
STARTS = 5


class ProcessPool(Executor):
    """Other processes that do one piece of work after the other.

    A process that ends costs what it was working on: that raises `ProcessEnded`, and another
    process takes its place. Work with a method `prepare`, which is called in each process before
    its first piece, is not lost if the process ends in that: another one is started, up to STARTS
    times. Other errors of the work come as a RuntimeError with their text. Where no process can be
    started, threads of this one work.

    Args:
        processes: Number of processes; by default that of processors.
    """

    def __init__(self, processes: int | None = None) -> None:
        self.processes = processes or processors()
        self._given = SimpleQueue[tuple[Future[Any], partial[Any]] | None]()
        self._lock, self._open, self._ended = Lock(), True, False
        self._children = set[subprocess.Popen[bytes]]()
        # A program may end without these threads, and then their processes end too.
        self._threads = [
            Thread(target=self._feed, name="pool", daemon=True) for _ in range(self.processes)
        ]
        for x in self._threads:
            x.start()

    def submit(self, fn: Callable[..., R], /, *args: Any, **kwargs: Any) -> Future[R]:
        """Have a process call a function; function, arguments and result can be pickled."""
        future: Future[R] = Future()
        with self._lock:
            if not self._open:
                raise RuntimeError("The pool is shut down, and takes no more work.")
            self._given.put((future, partial(fn, *args, **kwargs)))
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes after the work that is given, or after what they are at."""
        with self._lock:
            if self._open:
                self._open = False
                while cancel_futures and not self._given.empty():
                    left = self._given.get()
                    assert left is not None
                    left[0].cancel()
                for _ in self._threads:
                    self._given.put(None)
        if wait:
            for x in self._threads:
                x.join()

    def end(self) -> None:
        """End the processes at once, whatever they are at; work that is not done is lost."""
        self.shutdown(wait=False, cancel_futures=True)
        with self._lock:
            self._ended = True
            for child in self._children:
                child.kill()
        if can_start():
            for x in self._threads:
                x.join()

    def _feed(self) -> None:
        """Give work to one process, and to another if it ends."""
        child: subprocess.Popen[bytes] | None = None
        while (given := self._given.get()) is not None:
            future, work = given
            if not future.set_running_or_notify_cancel():
                continue
            begin = time.monotonic()
            try:
                if not can_start():
                    future.set_result(work())
                    continue
                if child is None:
                    child = self._prepared(work.func)
                    begin = time.monotonic()
                assert child.stdin is not None and child.stdout is not None
                send(child.stdin, work)
                future.set_result(receive(child.stdout))
            except BaseException as error:
                if isinstance(error, ProcessEnded) and child is not None:
                    error.after = time.monotonic() - begin
                    self._end(child)
                    child = None
                future.set_exception(error)
        if child is not None:
            self._end(child)

    def _prepared(self, work: Callable[..., Any]) -> subprocess.Popen[bytes]:
        """A process that is ready for some work.

        Raises:
            ProcessEnded: So many processes have ended before they were ready, or the pool is ended.
        """
        for left in reversed(range(STARTS)):
            with self._lock:
                if self._ended:
                    raise ProcessEnded("The pool is ended.")
                child = start()
                self._children.add(child)
            assert child.stdin is not None and child.stdout is not None
            try:
                send(child.stdin, _call)
                send(child.stdin, getattr(work, "prepare", _nothing))
                receive(child.stdout)
            except BaseException as error:
                self._end(child)
                if not isinstance(error, ProcessEnded) or not left:
                    raise
            else:
                break
        return child

    def _end(self, child: subprocess.Popen[bytes]) -> None:
        """End a process."""
        with self._lock:
            self._children.discard(child)
        child.kill()
        end(child)


class Worker(Generic[T, R]):
    """Another process that does one piece of work at a time, tells of it, and can be ended.

    Args:
        work: The work; it can be pickled, as items and results can.
    """

    def __init__(self, work: Callable[[T], R]) -> None:
        self._child = start()
        self._work = work
        self._begun = False

    def do(self, item: T, heard: Callable[[Any], None]) -> R:
        """Do the work on an item.

        Args:
            item: The item.
            heard: Called with what the work tells by `tell` meanwhile.

        Raises:
            ProcessEnded: The process has ended, or was ended.
            RuntimeError: An error of the work, as text.
        """
        stdin, stdout = self._child.stdin, self._child.stdout
        assert stdin is not None and stdout is not None
        if not self._begun:
            send(stdin, self._work)
            self._begun = True
        send(stdin, item)
        found: R = receive(stdout, heard)
        return found

    def end(self) -> None:
        """End the process, whatever it is doing; another thread may wait for its answer."""
        self._child.kill()

    def close(self) -> None:
        """End the process, and close its pipes."""
        self.end()
        end(self._child)


def _nothing() -> None:
    """What work without a method `prepare` does before its first piece."""


def _call(work: Callable[[], Any]) -> Any:
    """Do a piece of work of a pool."""
    return work()
