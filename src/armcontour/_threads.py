"""Compiled work in threads of this process: it lets other threads go on."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from queue import Empty, SimpleQueue
from threading import Thread
from typing import Self, TypeVar

from armcontour._process import is_other, processors

T = TypeVar("T")
R = TypeVar("R")
# Largest number of threads that share compiled work; their results are put together in one.
MOST_THREADS = 8


def map_in_threads(work: Callable[[T], R], items: Sequence[T]) -> list[R]:
    """Do compiled work on all items, in threads: it lets other threads of this process go on.

    Calls should take a millisecond or more: between them a thread waits for the others.

    Args:
        work: The work, nearly all of it in few calls of compiled functions.
        items: The items, in whose order the results are.
    """
    count = 1 if is_other() else min(processors(), MOST_THREADS, len(items))
    if count < 2:
        return [work(x) for x in items]
    with ThreadPoolExecutor(count) as pool:
        return list(pool.map(work, items))


def do_both(work: Callable[[], R], own: Callable[[], T]) -> tuple[R, T]:
    """Do mostly compiled work in another thread, and other work in this one meanwhile.

    Both have ended when this returns or raises; where both fail, the error is that of this thread.

    Args:
        work: The work, nearly all of it in few calls of compiled functions, or of the system.
        own: What this thread does.

    Returns:
        Their results.
    """
    with ThreadPoolExecutor(1) as pool:
        done = pool.submit(work)
        found = own()
    return done.result(), found


def split_evenly(count: int, parts: int) -> list[slice]:
    """Slices of so many parts, about equally long, that make up a sequence.

    Args:
        count: Length of the sequence.
        parts: Largest number of parts.
    """
    few = max(1, min(parts, count))
    return [slice(count * k // few, count * (k + 1) // few) for k in range(few)]


class Beside:
    """Compiled work that goes on in one more thread, piece after piece, if a processor is free.

    To be used with `with`, whose end drops what has not begun. Nothing waits for the thread when a
    program is interrupted.
    """

    def __init__(self) -> None:
        self._queue: SimpleQueue[Callable[[], None] | None] = SimpleQueue()
        self._thread: Thread | None = None

    def start(self, work: Callable[[], R]) -> Callable[[], R]:
        """Start work after what was started before; with one processor, do it before returning.

        Args:
            work: The work, nearly all of it in few calls of compiled functions.

        Returns:
            A function that waits for the work, and returns its result or raises its error.
        """
        done: Future[R] = Future()
        task = partial(_do, work, done)
        if is_other() or processors() < 2:
            task()
            return done.result
        self._queue.put(task)
        if self._thread is None:
            self._thread = Thread(target=_do_all, args=(self._queue,), name="beside", daemon=True)
            self._thread.start()
        return done.result

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        with suppress(Empty):
            while True:
                self._queue.get_nowait()
        self._queue.put(None)


def _do_all(tasks: SimpleQueue[Callable[[], None] | None]) -> None:
    """Do tasks as they come, until there is None."""
    while (task := tasks.get()) is not None:
        task()


def _do(work: Callable[[], R], done: Future[R]) -> None:
    """Do work, and hand on its result or its error."""
    try:
        done.set_result(work())
    except BaseException as error:
        done.set_exception(error)
