"""The same work on many items in other Python processes, for work that holds Python's lock."""

from __future__ import annotations

import subprocess
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from threading import Condition, Lock, Thread
from typing import Any, Generic, Protocol, TypeVar

from armcontour._process import (
    can_start,
    end,
    is_other,
    processors,
    receive,
    send,
    start,
)

T = TypeVar("T")
R = TypeVar("R")
Done = TypeVar("Done", contravariant=True)

# Starting a process takes as long as some items, so that fewer of them are not given away.
FEWEST = 12
# Work ahead begins when this process has worked so long on its own [s of processor time], if twice
# as much is left for each of the others: a start takes about as long.
ALONE = 1.0
# Largest number of others that work ahead; each takes about as much memory as this process.
MOST_AHEAD = 7


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
        processes: Number of processes; by default that of processors. 1 works in this process, and
            so does one of the other processes itself.
        done: Called with the number of items that are done, from time to time.

    Raises:
        ExecutionError: A process ended before its work did.
        Exception: As the work raises, or a RuntimeError with its text from another process.
    """
    tell = done or (lambda number: None)
    count = min(processes or processors(), len(items))
    found: list[Any] = [None] * len(items)
    if count < 2 or len(items) < FEWEST or is_other() or not can_start():
        for k, item in enumerate(items):
            tell(k)
            found[k] = work(item)
        return found
    children = [start() for _ in range(count)]
    left, lock = iter(enumerate(items)), Lock()
    finished: list[int] = []

    def feed(child: subprocess.Popen[bytes]) -> None:
        assert child.stdin is not None and child.stdout is not None
        send(child.stdin, work)
        for k, item in _each(left, lock):
            send(child.stdin, item)
            found[k] = receive(child.stdout)
            with lock:
                finished.append(k)
                tell(len(finished))

    _feed_all(children, feed)
    return found


class Order(Protocol[T, Done]):
    """Items in an order that depends on what is done already; several threads use it."""

    def take(self) -> T | None:
        """The next item, maybe after a while; None if none is left."""

    def finish(self, item: T, result: Done) -> None:
        """Take an item that is done, and its result."""

    def give_up(self) -> None:
        """Have no items any more."""


def share_work(work: Callable[[T], R], order: Order[T, R], *, processes: int) -> None:
    """Do some work on items in other processes, in an order that depends on what is done already.

    Where no process can be started, this one does the work.

    Args:
        work: The work; it can be pickled, as items and results can.
        order: The items.
        processes: Number of processes.

    Raises:
        ExecutionError: A process ended before its work did.
        RuntimeError: An error of the work, as text.
    """
    if not can_start():
        while (item := order.take()) is not None:
            order.finish(item, work(item))
        return
    children = [start() for _ in range(processes)]

    def feed(child: subprocess.Popen[bytes]) -> None:
        assert child.stdin is not None and child.stdout is not None
        try:
            send(child.stdin, work)
            while (item := order.take()) is not None:
                send(child.stdin, item)
                order.finish(item, receive(child.stdout))
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
            end(child)


def _each(left: Iterator[T], lock: Lock) -> Iterator[T]:
    """The items that are left when they are asked for, by several threads."""
    while True:
        with lock:
            try:
                item = next(left)
            except StopIteration:
                return
        yield item


def map_ahead(work: Callable[[T], R], items: Sequence[T]) -> Generator[R]:
    """Do some work on items and yield the results in order; others work ahead if that saves time.

    This process works too, and does again what another one fails at. So an error is raised here,
    that of the first item that has one.

    Args:
        work: The work; if it, an item or a result cannot be pickled, this process does all.
        items: The items.
    """
    team: _Team[T, R] | None = None
    begin = time.thread_time()
    try:
        for k in range(len(items)):
            if team is None and k:
                others = _worth(time.thread_time() - begin, k, len(items) - k)
                team = _Team(work, items, k, others) if others > 0 else None
            yield work(items[k]) if team is None else team.result(k)
    finally:
        if team is not None:
            team.end()


def _worth(spent: float, done: int, left: int) -> int:
    """Number of other processes that are worth their start, after some work [s] on some items."""
    if spent < ALONE or is_other() or not can_start():
        return 0
    return min(processors() - 1, MOST_AHEAD, int(spent / done * left / (2 * ALONE)))


class _Team(Generic[T, R]):
    """This process and others, which work on the items of `map_ahead` from some item on.

    Args:
        work: The work.
        items: The items.
        first: Index of the first item that is not done yet.
        others: Number of other processes.
    """

    def __init__(self, work: Callable[[T], R], items: Sequence[T], first: int, others: int) -> None:
        self.work, self.items = work, items
        # Index of the next item that nobody works on, the items that others work on, and results
        # that nobody has asked for: in lists, which are empty where somebody failed.
        self.next, self.away, self.found = first, set[int](), dict[int, list[R]]()
        self.news = Condition()
        self.children = [start() for _ in range(others)]
        self.threads = [
            Thread(target=self._feed, args=(x,), name="work ahead", daemon=True)
            for x in self.children
        ]
        for x in self.threads:
            x.start()

    def result(self, k: int) -> R:
        """The result of an item; until it is there, this process works on others."""
        while True:
            with self.news:
                while k in self.away and self.next >= len(self.items):
                    self.news.wait()
                done = self.found.pop(k, None)
                if k in self.away:
                    other = self._take()
                else:
                    other, self.next = None, max(self.next, k + 1)
            if done:
                return done[0]
            if other is None:
                return self.work(self.items[k])
            try:
                found = [self.work(self.items[other])]
            except Exception:
                found = []
            self._add(other, found)

    def end(self) -> None:
        """End the other processes."""
        with self.news:
            self.next = len(self.items)
        # Threads that wait for an answer get none, and end.
        for child in self.children:
            child.kill()
        for x in self.threads:
            x.join()
        for child in self.children:
            end(child)

    def _take(self) -> int | None:
        """Index of an item for somebody to work on; None if there is none."""
        if self.next >= len(self.items):
            return None
        self.next += 1
        return self.next - 1

    def _add(self, k: int, found: list[R]) -> None:
        """Keep the result of an item; after a failure nobody works ahead any more."""
        with self.news:
            self.found[k] = found
            self.away.discard(k)
            if not found:
                self.next = len(self.items)
            self.news.notify_all()

    def _feed(self, child: subprocess.Popen[bytes]) -> None:
        """Have another process work on items, until none is left or it fails."""
        assert child.stdin is not None and child.stdout is not None
        found: list[R] = [...]  # type: ignore[list-item]
        sent = False
        while found:
            with self.news:
                k = self._take()
                if k is None:
                    return
                self.away.add(k)
            found = []
            try:
                if not sent:
                    send(child.stdin, self.work)
                    sent = True
                send(child.stdin, self.items[k])
                found = [receive(child.stdout)]
            except Exception:  # Also what pickle raises, which is anything.
                pass
            self._add(k, found)
