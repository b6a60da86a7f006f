"""The same work on many items in other Python processes, for work that holds Python's lock."""

from __future__ import annotations

import subprocess
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from functools import partial
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
# Work ahead is given to another process if twice as much of it is left for each of them as a start
# takes, about [s]. That is judged as soon as this process has worked a quarter of it on its own.
ALONE = 1.0
# Largest number of others that work ahead; each takes about as much memory as this process.
MOST_AHEAD = 7
# Another process that works ahead gets more items at once as long as they take less than this [s]:
# between two of its turns this process may hold Python's lock for some milliseconds.
BRIEF = 0.02


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


class WorkAhead(Generic[T, R]):
    """Some work on items that come one after the other; others work ahead if that saves time.

    This process works too, on what is asked for, and does again what another one fails at. So an
    error is raised here, in the place of its item. It is a context, with which the others end.

    Args:
        work: The work; if it, an item or a result cannot be pickled, this process does all.
    """

    def __init__(self, work: Callable[[T], R]) -> None:
        self.work, self.items = work, list[T]()
        # Index of the next item that nobody works on, the items that others work on, and results
        # that nobody has asked for: in lists, which are empty where somebody failed.
        self.next, self.away, self.found = 0, set[int](), dict[int, list[R]]()
        self.ended, self.news = False, Condition()
        self.children: list[subprocess.Popen[bytes]] = []
        self.threads: list[Thread] = []
        self.begin = time.thread_time()

    def __enter__(self) -> WorkAhead[T, R]:
        return self

    def __exit__(self, *_: object) -> None:
        """End the other processes."""
        with self.news:
            self.ended = True
            self.news.notify_all()
        # Threads that wait for an answer get none, and end.
        for child in self.children:
            child.kill()
        for x in self.threads:
            x.join()
        for child in self.children:
            end(child)

    def add(self, item: T, share: float) -> None:
        """Add an item, on which others may work at once.

        Args:
            item: The item.
            share: Share of all items added so far, this one included, 0 to 1. Used to estimate the
                work left.
        """
        with self.news:
            self.items.append(item)
            self.news.notify_all()
        self._start_if_worth(share)

    def results(self) -> Iterator[R]:
        """The results of all items, in order."""
        self.begin = time.thread_time()
        for k in range(len(self.items)):
            if k:
                self._start_if_worth(k / len(self.items))
            yield self._result(k)

    def _start_if_worth(self, share: float) -> None:
        """Start others if that saves time, after a share of the work since the beginning."""
        if self.children:
            return
        others = _worth(time.thread_time() - self.begin, share)
        self.children = [start() for _ in range(others)]
        self.threads = [
            Thread(target=self._feed, args=(x,), name="work ahead", daemon=True)
            for x in self.children
        ]
        for x in self.threads:
            x.start()

    def _result(self, k: int) -> R:
        """The result of an item; until it is there, this process works on others."""
        while True:
            with self.news:
                while k in self.away and not (others := self._take(1)):
                    self.news.wait()
                done = self.found.pop(k, None)
                if k not in self.away:
                    others, self.next = range(0), max(self.next, k + 1)
            if done:
                return done[0]
            if not others:
                return self.work(self.items[k])
            try:
                found = [self.work(self.items[others[0]])]
            except Exception:
                found = []
            self._add(others, found)

    def _take(self, most: int) -> range:
        """Indices of items for somebody to work on, at most so many; none if there are none."""
        first = self.next
        if not self.ended:
            self.next = min(first + most, len(self.items))
        return range(first, self.next)

    def _add(self, taken: range, found: list[R]) -> None:
        """Keep the results of items; after a failure nobody works ahead any more."""
        with self.news:
            self.found |= {k: found[i : i + 1] for i, k in enumerate(taken)}
            self.away -= {*taken}
            self.ended |= not found
            self.news.notify_all()

    def _feed(self, child: subprocess.Popen[bytes]) -> None:
        """Have another process work on items, until there are no more or it fails."""
        assert child.stdin is not None and child.stdout is not None
        most, sent = 1, False
        while True:
            with self.news:
                while not (taken := self._take(most)) and not self.ended:
                    self.news.wait()
                if not taken:
                    return
                self.away |= {*taken}
            found, begin = [], time.perf_counter()
            try:
                if not sent:
                    send(child.stdin, partial(_do_each, self.work))
                    sent = True
                send(child.stdin, [self.items[k] for k in taken])
                found = receive(child.stdout)
            except Exception:  # Also what pickle raises, which is anything.
                pass
            self._add(taken, found)
            if time.perf_counter() - begin < BRIEF:
                most *= 2


def _do_each(work: Callable[[T], R], items: Sequence[T]) -> list[R]:
    """Do some work on each of several items."""
    return [work(x) for x in items]


def _worth(spent: float, share: float) -> int:
    """Number of other processes that are worth their start, after a share of some work [s]."""
    if spent < ALONE / 4 or is_other() or not can_start():
        return 0
    return min(processors() - 1, MOST_AHEAD, int(spent * (1 / share - 1) / (2 * ALONE)))
