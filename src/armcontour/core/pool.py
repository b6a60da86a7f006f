"""One engine for work on many items: threads, other processes, a cluster, or this process."""

from __future__ import annotations

import subprocess
import time
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ThreadPoolExecutor,
)
from concurrent.futures import wait as wait_for
from contextlib import contextmanager, nullcontext, suppress
from functools import lru_cache, partial
from importlib import import_module
from importlib.util import find_spec
from itertools import islice
from threading import Lock
from typing import Any, Generic, TypeVar, cast

from armcontour.core.errors import ArmContourError, ExecutionError, InvalidInput
from armcontour.core.process import (
    Packed,
    ProcessEnded,
    call,
    can_start,
    end,
    is_other,
    pack,
    processors,
    start,
    unpack,
    working_for_another,
)

T = TypeVar("T")
R = TypeVar("R")
# Largest number of threads that share compiled work; their results are put together in one.
MOST_THREADS = 8
# Starting a process takes as long as some items, so that fewer of them are not given away.
FEWEST = 12
# Time that starting a process costs, about [s]: work is shared if twice as much is left for each.
START = 1.0
# Largest number of processes that plan moves; each takes about as much memory as this one.
MOST_PROCESSES = 8
# Least number of parts of the items that an executor gets, each with the work.
PARTS = 32
# How long a scheduler may take to answer [s].
PATIENCE = "20s"
# Longest time between two looks at what is done [s]: an interrupt is heard then everywhere.
PULSE = 1.0
# What executors raise for work whose process is gone; Dask's are named, as it may be missing.
LOST = (ProcessEnded, BrokenExecutor, CancelledError, MemoryError)
LOST_NAMES = ("KilledWorker", "FutureCancelledError", "CommClosedError", "FutureLostError")


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


def split_evenly(count: int, parts: int) -> list[slice]:
    """Slices of so many parts, about equally long, that make up a sequence.

    Args:
        count: Length of the sequence.
        parts: Largest number of parts.
    """
    few = max(1, min(parts, count))
    return [slice(count * k // few, count * (k + 1) // few) for k in range(few)]


class InProcess(Executor):
    """Does all work in this process, when it is given."""

    def submit(self, fn: Callable[..., R], /, *args: Any, **kwargs: Any) -> Future[R]:
        """Call a function."""
        future: Future[R] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


class ProcessPool(ThreadPoolExecutor):
    """Other processes; a thread of this process gives each of them one piece of work at a time.

    Scripts that use it need no guard against being imported. A process that ends costs what it was
    working on: that raises `ProcessEnded`, and another process takes its place. Other errors of
    the work come as a RuntimeError with their text. Where no process can be started, threads of
    this one work.

    Args:
        processes: Number of processes; by default that of processors.
    """

    def __init__(self, processes: int | None = None) -> None:
        self.processes = processes or processors()
        super().__init__(self.processes, "pool")
        # Number of calls of `kill`; the processes, and those of them that wait for work.
        self._lock, self._kills = Lock(), 0
        self._children = set[subprocess.Popen[bytes]]()
        self._idle = list[subprocess.Popen[bytes]]()

    def submit(self, fn: Callable[..., R], /, *args: Any, **kwargs: Any) -> Future[R]:
        """Have a process call a function; function, arguments and result can be pickled."""
        return self.submit_heard(lambda told: None, partial(fn, *args, **kwargs))

    def submit_heard(self, heard: Callable[[Any], None], work: partial[R]) -> Future[R]:
        """Have a process do some work, and hear what it reports by `tell` before its result."""
        return super().submit(self._have_done, self._kills, heard, work)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes after the work that is given, or after what they are at."""
        super().shutdown(wait, cancel_futures=cancel_futures)
        if wait:
            self.kill()

    def kill(self) -> None:
        """End the work that is given so far, whatever the processes are at; others replace them."""
        with self._lock:
            self._kills += 1
            for child in self._children:
                child.kill()
            while self._idle:
                self._end(self._idle.pop())

    def end(self) -> None:
        """End the processes at once; work that is not done is lost."""
        super().shutdown(wait=False, cancel_futures=True)
        self.kill()
        if can_start():
            self.shutdown()

    def _have_done(self, kills: int, heard: Callable[[Any], None], work: partial[R]) -> R:
        """Have a process do some work that was given after so many calls of `kill`."""
        if not can_start():
            return work()
        with self._lock:
            if self._kills > kills:
                raise ProcessEnded("The work was ended before a process began it.")
            child = self._idle.pop() if self._idle else start()
            self._children.add(child)
        try:
            return cast(R, call(child, work, heard))
        finally:
            with self._lock:
                if self._kills == kills and child.poll() is None:
                    self._idle.append(child)
                else:
                    self._end(child)

    def _end(self, child: subprocess.Popen[bytes]) -> None:
        """End a process, with the lock."""
        self._children.discard(child)
        end(child)


@contextmanager
def open_executor(
    workers: int | None = None, cluster: str | None = None, executor: Executor | None = None
) -> Iterator[Executor]:
    """Open an executor, and close it at the end; that of the caller stays open.

    Args:
        workers: Number of processes on this machine; by default one a processor. 0 works in this
            process.
        cluster: Address of a Dask scheduler, such as `tcp://10.0.0.1:8786`.
        executor: An executor of the caller.

    Raises:
        InvalidInput: Options that do not go together, or Dask is not installed.
        ExecutionError: Nobody answers at the address, or the cluster has no workers.
    """
    if workers is not None and workers < 0:
        raise InvalidInput(f"workers must be 0 or more, but is {workers}.")
    if sum(x is not None for x in (workers, cluster, executor)) > 1:
        raise InvalidInput(
            "A cluster or an executor has its own workers: give one of workers, cluster and "
            "executor."
        )
    if executor is not None:
        yield executor
    elif cluster is not None:
        with _dask(cluster) as opened:
            yield opened
    elif workers == 0:
        yield InProcess()
    else:
        pool = ProcessPool(workers)
        try:
            yield pool
        finally:
            # Nobody waits for what is under way now: all is done, nobody needs it, or an error ends
            # the work.
            pool.end()


@contextmanager
def _dask(address: str) -> Iterator[Executor]:
    """The executor of a Dask cluster."""
    if find_spec("distributed") is None:
        raise InvalidInput(
            "A cluster needs the library distributed: pip install 'armcontour[cluster]'."
        )
    distributed: Any = import_module("distributed")
    try:
        client = distributed.Client(address, timeout=PATIENCE, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        raise ExecutionError(
            f"No Dask scheduler answers at {address} ({error}): start one with `dask scheduler`, "
            "and workers with `dask worker ADDRESS --nthreads 1`."
        ) from None
    try:
        if not client.ncores():
            raise ExecutionError(
                f"The Dask cluster at {address} has no workers: start some with `dask worker "
                f"{address} --nthreads 1`."
            )
        # Work has no side effects, but Dask would take equal calls for one.
        yield client.get_executor(pure=False)
    finally:
        client.close()


def workers_of(executor: Executor) -> int:
    """Number of workers of an executor; that of processors where it does not tell."""
    if isinstance(executor, InProcess):
        return 1
    if isinstance(executor, ProcessPool):
        return executor.processes
    cores = getattr(getattr(executor, "_client", None), "ncores", dict)
    # A client of Dask that is closed says so when it is given work.
    with suppress(Exception):
        if count := sum(cores().values()):
            return int(count)
    return getattr(executor, "_max_workers", None) or processors()


class TaskQueue(Generic[T, R]):
    """An executor that works on items, which come back as they are done.

    As a context it takes back at its end what nobody works on yet.

    Args:
        work: The work; it can be pickled, as items and results can.
        executor: The executor; `InProcess` works when an item is given.
        lost: The result of an item whose worker ended; by default that is an error.
    """

    def __init__(
        self, work: Callable[[T], R], executor: Executor, lost: Callable[[], R] | None = None
    ) -> None:
        self.workers = workers_of(executor)
        # A subclass may do otherwise.
        self._alone = type(executor) is InProcess
        self._work, self._executor, self._lost = work, executor, lost
        self._call = None if self._alone else partial(_on, pack(work))
        self._done: list[tuple[T, R]] = []
        self._away: dict[Future[Packed], T] = {}

    def __enter__(self) -> TaskQueue[T, R]:
        return self

    def __exit__(self, *error: object) -> None:
        for x in self._away:
            x.cancel()

    def __len__(self) -> int:
        """Number of items that are given and not taken."""
        return len(self._done) + len(self._away)

    @property
    def ahead(self) -> int:
        """So many items are enough that no worker waits for one."""
        return 1 if self._alone else self.workers + self.workers // 4 + 1

    def give(self, item: T) -> None:
        """Have an item worked on.

        Raises:
            ExecutionError: The executor takes no work.
        """
        if self._call is None:
            self._done.append((item, self._work(item)))
            return
        try:
            self._away[self._executor.submit(self._call, pack(item))] = item
        except Exception as error:
            raise ExecutionError(
                f"The executor takes no work ({type(error).__name__}: {error}): give one that is "
                "open, and whose workers have not ended."
            ) from None

    def take(self) -> list[tuple[T, R]]:
        """The items that are done, after a while, and their results; none if none is away.

        Raises:
            ExecutionError: A worker has ended, or cannot do the work.
            ArmContourError: As the work raises.
        """
        while self._away and not self._done:
            wait_for(self._away, timeout=PULSE, return_when=FIRST_COMPLETED)
            # That does not wait for what its executor has cancelled.
            for x in [x for x in self._away if x.done()]:
                self._done.append((self._away.pop(x), self._result(x)))
        found, self._done = self._done, []
        return found

    def work_off(self, items: Iterable[T]) -> Iterator[tuple[T, R]]:
        """Give items such that no worker waits; yield each with its result as it is done.

        Raises:
            ExecutionError: As `give` and `take` raise it.
            ArmContourError: As the work raises.
        """
        waiting = iter(items)
        while True:
            for item in islice(waiting, self.ahead - len(self)):
                self.give(item)
            if not len(self):
                return
            yield from self.take()

    def _result(self, future: Future[Packed]) -> R:
        """What came of an item."""
        try:
            found = unpack(future.result())
        except (Exception, CancelledError) as error:
            name = type(error).__name__
            if isinstance(error, ProcessEnded) or name == "KilledWorker":
                if self._lost is not None:
                    return self._lost()
                if isinstance(error, ProcessEnded):
                    raise
            if isinstance(error, LOST) or name in LOST_NAMES:
                raise ExecutionError(
                    f"A worker of the executor has ended before it gave an answer ({name}), as "
                    "when memory runs out: take fewer workers, or give each more memory."
                ) from None
            if isinstance(self._executor, ProcessPool):
                raise
            raise ExecutionError(
                f"The workers of the executor cannot do the work ({name}: {error}): they need the "
                "same version of armcontour as this process."
            ) from None
        if isinstance(found, ArmContourError):
            raise found
        return cast(R, found)


def _on(work: Packed, item: Packed) -> Packed:
    """Do packed work on an item; arrays are read-only as in this package's own processes.

    An error of this package is a result, which keeps its kind on every way.
    """
    try:
        with working_for_another():
            return pack(_unpacked(work)(unpack(item)))
    except ArmContourError as error:
        return pack(error)


@lru_cache(maxsize=2)
def _unpacked(work: Packed) -> Callable[[Any], Any]:
    """The work, which is made once in each process."""
    return cast(Callable[[Any], Any], unpack(work))


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
        executor: An executor that does the work in place of these processes.
        done: Called with the number of items that are done, from time to time.

    Raises:
        ExecutionError: The executor takes no work, or a worker has ended or cannot do it.
        Exception: As the work raises, or a RuntimeError with its text from another process.
    """
    tell = done or (lambda number: None)
    count = min(processes or processors(), len(items))
    here = count < 2 or len(items) < FEWEST or is_other() or not can_start()
    if executor is None and here:
        executor = InProcess()
    with nullcontext(executor) if executor else open_executor(count) as opened:
        work_on_chunk = partial(_several, work)
        with TaskQueue[tuple[int, Sequence[T]], list[R]](work_on_chunk, opened) as crew:
            slices = split_evenly(len(items), max(PARTS, 4 * crew.workers))
            found: dict[int, list[R]] = {}
            number = 0
            for (k, part), results in crew.work_off(enumerate(items[x] for x in slices)):
                tell(number)
                found[k] = results
                number += len(part)
    return [x for k in sorted(found) for x in found[k]]


def _several(work: Callable[[T], R], numbered: tuple[int, Sequence[T]]) -> list[R]:
    """Do some work on several items."""
    return [work(x) for x in numbered[1]]


def map_in_order(work: Callable[[T], R], items: Sequence[T]) -> Generator[R, None, None]:
    """The results of all items, each when it is asked for; other processes work if it saves time.

    What another process fails at is done again here, so that an error is raised in the place of its
    item.

    Args:
        work: The work; if it, an item or a result cannot be pickled, this process does all.
        items: The items.
    """
    begin, count = time.thread_time(), 0
    for k, item in enumerate(items):
        count = _worth(time.thread_time() - begin, k / len(items)) if k else 0
        if count > 1:
            break
        yield work(item)
    if count < 2:
        return
    left = items[k:]
    parts = [left[x] for x in split_evenly(len(left), 8 * count)]
    with open_executor(count) as pool:
        futures = [pool.submit(_several, work, (0, x)) for x in parts]
        for part, future in zip(parts, futures, strict=True):
            try:
                found = future.result()
            except Exception:  # Also what pickle raises, which is anything.
                yield from map(work, part)
            else:
                yield from found


def _worth(spent: float, share: float) -> int:
    """Number of processes that are worth their start, after a share of some work [s]."""
    if spent < START / 4 or is_other() or not can_start():
        return 0
    return min(processors(), MOST_PROCESSES, int(spent * (1 / share - 1) / (2 * START)))
