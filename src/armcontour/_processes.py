"""The same work on many items in other Python processes, for work that holds Python's lock.

The processes are started as programs of their own, so that scripts need no guard against being
imported, and end when this process ends, however it does: their input ends then.
"""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from threading import Lock
from typing import IO, Any, Protocol, TypeVar

from armcontour.errors import ExecutionError

T = TypeVar("T")
R = TypeVar("R")

# Starting a process takes as long as some items, so that fewer of them are not given away.
FEWEST = 12
SERVE = "from armcontour._processes import serve; serve()"
# Every process computes in one thread.
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


def map_in_processes(
    work: Callable[[T], R],
    items: Sequence[T],
    *,
    processes: int | None = None,
    done: Callable[[int], None] | None = None,
) -> list[R]:
    """Do some work on all items; results are in the order of the items.

    Args:
        work: The work; it can be pickled, as items and results can.
        items: The items.
        processes: Number of processes; by default that of processors. 1 works in this process.
        done: Called with the number of items that are done, from time to time.

    Raises:
        ExecutionError: A process ended before its work did.
        Exception: As the work raises, or a RuntimeError with its text from another process.
    """
    count = min(processes or os.cpu_count() or 1, len(items))
    tell = done or (lambda number: None)
    found: list[Any] = [None] * len(items)
    if count < 2 or len(items) < FEWEST or not sys.executable:
        for k, item in enumerate(items):
            tell(k)
            found[k] = work(item)
        return found
    children = [_start() for _ in range(count)]
    left, lock = iter(enumerate(items)), Lock()
    finished: list[int] = []

    def feed(child: subprocess.Popen[bytes]) -> None:
        assert child.stdin is not None and child.stdout is not None
        _send(child.stdin, work)
        for k, item in _each(left, lock):
            _send(child.stdin, item)
            found[k] = _receive(child.stdout)
            with lock:
                finished.append(k)
                tell(len(finished))

    _feed_all(children, feed)
    return found


class Order(Protocol[T, R]):
    """Items in an order that depends on what is done already; several threads use it."""

    def take(self) -> T | None:
        """The next item, maybe after a while; None if none is left."""

    def finish(self, item: T, result: R) -> None:
        """Take an item that is done, and its result."""

    def give_up(self) -> None:
        """Have no items any more."""


def share_work(work: Callable[[T], R], order: Order[T, R], *, processes: int) -> None:
    """Do some work on items in other processes, in an order that depends on what is done already.

    Args:
        work: The work; it can be pickled, as items and results can.
        order: The items.
        processes: Number of processes.

    Raises:
        ExecutionError: A process ended before its work did.
        RuntimeError: An error of the work, as text.
    """
    children = [_start() for _ in range(processes)]

    def feed(child: subprocess.Popen[bytes]) -> None:
        assert child.stdin is not None and child.stdout is not None
        try:
            _send(child.stdin, work)
            while (item := order.take()) is not None:
                _send(child.stdin, item)
                order.finish(item, _receive(child.stdout))
        except BaseException:
            # Others may wait for what this process should have done.
            order.give_up()
            raise

    _feed_all(children, feed)


def _feed_all(
    children: Sequence[subprocess.Popen[bytes]], feed: Callable[[subprocess.Popen[bytes]], None]
) -> None:
    """Feed each process in a thread of its own; then, or after an error, end them all."""
    try:
        with ThreadPoolExecutor(len(children)) as pool:
            try:
                for future in as_completed([pool.submit(feed, x) for x in children]):
                    future.result()
            finally:
                # Threads that wait for an answer get none, and end.
                for child in children:
                    child.kill()
    finally:
        for child in children:
            _end(child)


def serve() -> None:
    """The other process: do the work on the items that come in, until none comes."""
    # The terminal interrupts all processes; the first one decides what that means.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    answers = os.fdopen(os.dup(1), "wb")
    # What libraries print is no answer.
    os.dup2(2, 1)
    try:
        work = pickle.load(sys.stdin.buffer)
        while True:
            item = pickle.load(sys.stdin.buffer)
            try:
                answer = True, work(item)
            except Exception as error:
                answer = False, f"{type(error).__name__}: {error}"
            _send(answers, answer)
    except (EOFError, OSError):
        return


def _start() -> subprocess.Popen[bytes]:
    """Start a process that serves."""
    own = {"PYTHONPATH": os.pathsep.join(x for x in sys.path if x)} | dict.fromkeys(THREADS, "1")
    return subprocess.Popen(
        [sys.executable, "-c", SERVE],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env=os.environ | own,
        creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
    )


def _end(child: subprocess.Popen[bytes]) -> None:
    """Wait for the end of a killed process, and close its pipes."""
    child.wait()
    for pipe in (child.stdin, child.stdout):
        assert pipe is not None
        try:
            pipe.close()
        except OSError:  # what was not written has no reader any more
            pass


def _each(left: Iterator[T], lock: Lock) -> Iterator[T]:
    """The items that are left when they are asked for, by several threads."""
    while True:
        with lock:
            try:
                item = next(left)
            except StopIteration:
                return
        yield item


def _send(pipe: IO[bytes], value: Any) -> None:
    """Write a value to a pipe.

    Raises:
        ExecutionError: The other process has ended.
    """
    data = pickle.dumps(value)
    try:
        pipe.write(data)
        pipe.flush()
    except OSError as error:
        raise ExecutionError(f"Another process of this work has ended: {error}.") from None


def _receive(pipe: IO[bytes]) -> Any:
    """Read an answer from a pipe.

    Raises:
        ExecutionError: The other process has ended.
    """
    try:
        worked, value = pickle.load(pipe)
    except (EOFError, OSError, pickle.UnpicklingError):
        raise ExecutionError(
            "Another process of this work has ended before it gave an answer, as when memory "
            "runs out: take fewer processes, or free some memory."
        ) from None
    if not worked:
        raise RuntimeError(f"Another process of this work failed: {value}")
    return value
