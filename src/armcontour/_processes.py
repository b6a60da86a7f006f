"""The same work on many items in other Python processes, for work that holds Python's lock.

The processes are started as programs of their own, so that scripts need no guard against being
imported, and end when this process ends, however it does: their input ends then.
"""

from __future__ import annotations

import copyreg
import os
import pickle
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor, as_completed
from functools import cached_property, partial
from queue import SimpleQueue
from threading import Condition, Lock, Thread
from types import MappingProxyType
from typing import IO, Any, Generic, Protocol, TypeAlias, TypeVar, cast

from armcontour.errors import ExecutionError

T = TypeVar("T")
R = TypeVar("R")
Done = TypeVar("Done", contravariant=True)
Packed: TypeAlias = tuple[bytes, list[bytes]]

# Starting a process takes as long as some items, so that fewer of them are not given away.
FEWEST = 12
SERVE = "from armcontour._processes import serve; serve()"
# Parts of the items that an executor gets, each with the work: more would send it too often.
CHUNKS = 32
# Work ahead begins when this process has worked so long on its own [s of processor time], if twice
# as much is left for each of the others: a start takes about as long.
ALONE = 1.0
# Largest number of others that work ahead; each takes about as much memory as this process.
MOST_AHEAD = 7
# So many processes of a pool may end one after the other before they are ready for work.
STARTS = 5
# Largest number of threads that share compiled work; their results are put together in one.
MOST_THREADS = 8
# Every process computes in one thread, but for `map_in_threads`.
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


def locked(mapping: Mapping[Any, Any]) -> MappingProxyType[Any, Any]:
    """A mapping that does not change."""
    return MappingProxyType(dict(mapping))


# Values have such mappings, which pickle does not know by itself.
copyreg.pickle(MappingProxyType, lambda x: (locked, (dict(x),)))


class ProcessEnded(ExecutionError):
    """Another process ended before its work did.

    Attributes:
        after: How long it had worked [s]; None if unknown.
    """

    after: float | None = None


def map_in_processes(
    work: Callable[[T], R],
    items: Sequence[T],
    *,
    processes: int | None = None,
    executor: Executor | None = None,
    done: Callable[[int], None] | None = None,
) -> list[R]:
    """Do some work on all items; results are in the order of the items.

    Args:
        work: The work; it can be pickled, as items and results can.
        items: The items.
        processes: Number of processes; by default that of processors. 1 works in this process, and
            so does one of the other processes itself.
        executor: An executor that does the work in place of processes of its own.
        done: Called with the number of items that are done, from time to time.

    Raises:
        ExecutionError: A process ended before its work did.
        Exception: As the work raises, or a RuntimeError with its text from another process.
    """
    tell = done or (lambda number: None)
    if executor is not None:
        return _map_on(executor, work, items, tell)
    count = min(processes or os.cpu_count() or 1, len(items))
    found: list[Any] = [None] * len(items)
    if count < 2 or len(items) < FEWEST or is_other() or not can_start():
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


def _map_on(
    executor: Executor,
    work: Callable[[T], R],
    items: Sequence[T],
    tell: Callable[[int], None],
) -> list[R]:
    """Have an executor do some work on all items, some at a time."""
    step = max(1, len(items) // CHUNKS)
    unpacked = _Several(pack(work))
    away = [
        executor.submit(unpacked, pack(items[k : k + step])) for k in range(0, len(items), step)
    ]
    found: list[R] = []
    for x in away:
        tell(len(found))
        found += x.result()
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


def map_in_threads(work: Callable[[T], R], items: Sequence[T]) -> list[R]:
    """Do compiled work on all items, in threads: it lets other threads of this process go on.

    Calls should take a millisecond or more: between them a thread waits for the others.

    Args:
        work: The work, nearly all of it in few calls of compiled functions.
        items: The items, in whose order the results are.
    """
    count = 1 if _Serving.here else min(processors(), MOST_THREADS, len(items))
    if count < 2:
        return [work(x) for x in items]
    with ThreadPoolExecutor(count) as pool:
        return list(pool.map(work, items))


def split_evenly(count: int, parts: int) -> list[slice]:
    """Slices of so many parts, about equally long, that make up a sequence.

    Args:
        count: Length of the sequence.
        parts: Largest number of parts.
    """
    few = max(1, min(parts, count))
    return [slice(count * k // few, count * (k + 1) // few) for k in range(few)]


def _worth(spent: float, done: int, left: int) -> int:
    """Number of other processes that are worth their start, after some work [s] on some items."""
    if spent < ALONE or is_other() or not can_start():
        return 0
    return min(processors() - 1, MOST_AHEAD, int(spent / done * left / (2 * ALONE)))


def processors() -> int:
    """Number of processors that this process may use."""
    if sys.platform == "linux":
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class _Serving:
    """Whether this process is one of the others, which start no further ones."""

    here = False
    # Where answers go.
    answers: IO[bytes] | None = None


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
        self._lock, self._open = Lock(), True
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
                    child = _prepared(work.func)
                    begin = time.monotonic()
                assert child.stdin is not None and child.stdout is not None
                _send(child.stdin, work)
                future.set_result(_receive(child.stdout))
            except BaseException as error:
                if isinstance(error, ProcessEnded) and child is not None:
                    error.after = time.monotonic() - begin
                    child.kill()
                    _end(child)
                    child = None
                future.set_exception(error)
        if child is not None:
            child.kill()
            _end(child)


class Worker(Generic[T, R]):
    """Another process that does one piece of work at a time, tells of it, and can be ended.

    Args:
        work: The work; it can be pickled, as items and results can.
    """

    def __init__(self, work: Callable[[T], R]) -> None:
        self._child = _start()
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
            _send(stdin, self._work)
            self._begun = True
        _send(stdin, item)
        found: R = _receive(stdout, heard)
        return found

    def end(self) -> None:
        """End the process, whatever it is doing; another thread may wait for its answer."""
        self._child.kill()

    def close(self) -> None:
        """End the process, and close its pipes."""
        self.end()
        _end(self._child)


def tell(value: Any) -> None:
    """Tell the process that this one works for something before the answer.

    Args:
        value: What is told; it can be pickled. It is not for work that nobody listens to.
    """
    if _Serving.answers is not None:
        _write(_Serving.answers, pickle.dumps((None, value)))


def _prepared(work: Callable[..., Any]) -> subprocess.Popen[bytes]:
    """A process of a pool that is ready for some work.

    Raises:
        ProcessEnded: So many processes have ended before they were ready.
    """
    for left in reversed(range(STARTS)):
        child = _start()
        assert child.stdin is not None and child.stdout is not None
        try:
            _send(child.stdin, _call)
            _send(child.stdin, getattr(work, "prepare", _nothing))
            _receive(child.stdout)
        except BaseException as error:
            child.kill()
            _end(child)
            if not isinstance(error, ProcessEnded) or not left:
                raise
        else:
            break
    return child


def _nothing() -> None:
    """What work without a method `prepare` does before its first piece."""


def _call(work: Callable[[], Any]) -> Any:
    """Do a piece of work of a pool."""
    return work()


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
        self.children = [_start() for _ in range(others)]
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
            _end(child)

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
                    _send(child.stdin, self.work)
                    sent = True
                _send(child.stdin, self.items[k])
                found = [_receive(child.stdout)]
            except Exception:  # Also what pickle raises, which is anything.
                pass
            self._add(k, found)


class _Several:
    """Work on several items together, for executors; arrays are read-only as in own processes.

    Args:
        packed: The work.
    """

    def __init__(self, packed: Packed) -> None:
        self.packed = packed

    @cached_property
    def work(self) -> Callable[[Any], Any]:
        """The work itself."""
        return cast(Callable[[Any], Any], unpack(self.packed))

    def __call__(self, items: Packed) -> list[Any]:
        """Do the work on each of the items."""
        return [self.work(x) for x in unpack(items)]


def pack(value: Any) -> Packed:
    """A value as bytes. Arrays are read-only when they are unpacked, as checked values have them.

    Compiled functions are compiled for such arrays.
    """
    buffers: list[pickle.PickleBuffer] = []
    data = pickle.dumps(value, protocol=5, buffer_callback=buffers.append)
    return data, [bytes(x.raw()) for x in buffers]


def unpack(packed: Packed) -> Any:
    """The value that was packed."""
    data, buffers = packed
    return pickle.loads(data, buffers=buffers)


def serve() -> None:
    """The other process: do the work on the items that come in, until none comes."""
    _Serving.here = True
    # The terminal interrupts all processes; the first one decides what that means.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    answers = _Serving.answers = os.fdopen(os.dup(1), "wb")
    # What libraries print is no answer.
    os.dup2(2, 1)
    try:
        packed, work = pickle.load(sys.stdin.buffer), None
        while True:
            item = pickle.load(sys.stdin.buffer)
            try:
                if work is None:
                    work = unpack(packed)
                answer = pickle.dumps((True, work(unpack(item))))
            except Exception as error:
                answer = pickle.dumps((False, f"{type(error).__name__}: {error}"))
            _write(answers, answer)
    except (EOFError, OSError):
        return


def can_start() -> bool:
    """Whether other processes can be started: a frozen application is no Python to start."""
    return bool(sys.executable) and not getattr(sys, "frozen", False)


def is_other() -> bool:
    """Whether this process only works for another one."""
    return _Serving.here


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
    """Write a value to a pipe, with arrays that are read-only at its other end.

    Raises:
        ProcessEnded: The other process has ended.
    """
    _write(pipe, pickle.dumps(pack(value)))


def _write(pipe: IO[bytes], data: bytes) -> None:
    """Write bytes to a pipe.

    Raises:
        ProcessEnded: The other process has ended.
    """
    try:
        pipe.write(data)
        pipe.flush()
    except OSError as error:
        raise ProcessEnded(f"Another process of this work has ended: {error}.") from None


def _receive(pipe: IO[bytes], heard: Callable[[Any], None] | None = None) -> Any:
    """Read an answer from a pipe.

    Args:
        pipe: The pipe.
        heard: Called with what is told before the answer.

    Raises:
        ProcessEnded: The other process has ended.
    """
    while True:
        try:
            worked, value = pickle.load(pipe)
        except (EOFError, OSError, pickle.UnpicklingError):
            raise ProcessEnded(
                "Another process of this work has ended before it gave an answer, as when memory "
                "runs out: take fewer processes, or free some memory."
            ) from None
        if worked is not None:
            break
        if heard is not None:
            heard(value)
    if not worked:
        raise RuntimeError(f"Another process of this work failed: {value}")
    return value
