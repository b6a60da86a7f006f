"""Work on many items in threads, in other processes, or in this process."""

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
from itertools import islice
from threading import Lock
from typing import Any, Generic, TypeVar, cast

from armcontour.core.child_process import (
    Packed,
    ProcessEnded,
    call,
    can_start,
    child_context,
    end,
    is_child,
    pack,
    processors,
    start,
    unpack,
)
from armcontour.core.errors import ArmContourError, ExecutionError, InvalidInput

T = TypeVar("T")
R = TypeVar("R")
# Largest number of threads for compiled work; combining their results is serial.
MAX_THREADS = 8
# Fewest items for other processes, because starting a process takes as long as several items.
FEWEST = 12
# Approximate time to start a process [s]. Work is shared if each process saves twice this time.
START = 1.0
# Largest number of processes that plan moves; each needs about as much memory as this one.
MAX_PROCESSES = 8
# Smallest number of chunks for an executor; each chunk carries the pickled work.
PARTS = 32
# Longest wait for results [s]; between waits an interrupt is handled on all systems.
PULSE = 1.0
# Errors that mean that a working process ended; errors of Dask by name, because Dask is optional.
LOST = (ProcessEnded, BrokenExecutor, CancelledError, MemoryError)
LOST_NAMES = ("KilledWorker", "FutureCancelledError", "CommClosedError", "FutureLostError")


def map_in_threads(work: Callable[[T], R], items: Sequence[T]) -> list[R]:
    """Apply a compiled function to all items in threads; kernels release the interpreter's lock."""
    # A call should take 1 ms or more, because the Python code between calls is serial.
    count = 1 if is_child() else min(processors(), MAX_THREADS, len(items))
    if count < 2:
        return [work(x) for x in items]
    with ThreadPoolExecutor(count) as pool:
        return list(pool.map(work, items))


def split_evenly(count: int, parts: int) -> list[slice]:
    """Slices of approximately equal length that cover a sequence."""
    number = max(1, min(parts, count))
    return [slice(count * k // number, count * (k + 1) // number) for k in range(number)]


class InProcess(Executor):
    """Executor that runs work in this process, at submission."""

    def submit(self, fn: Callable[..., R], /, *args: Any, **kwargs: Any) -> Future[R]:
        """Call a function at once."""
        future: Future[R] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


class ProcessPool(ThreadPoolExecutor):
    """Executor of child processes; one thread of this process serves each of them."""

    # Scripts that use the pool need no `if __name__ == "__main__"`. If a process ends during a
    # call, the call raises `ProcessEnded`, and a new process replaces it. Other errors of the work
    # are raised as RuntimeError with their text. If processes cannot be started, the work runs in
    # threads of this process.

    def __init__(self, processes: int | None = None) -> None:
        self.processes = processes or processors()
        super().__init__(self.processes, "pool")
        # Number of calls of `kill`; all processes; processes without work.
        self._lock, self._kills = Lock(), 0
        self._children = set[subprocess.Popen[bytes]]()
        self._idle = list[subprocess.Popen[bytes]]()

    def submit(self, fn: Callable[..., R], /, *args: Any, **kwargs: Any) -> Future[R]:
        """Call a function in a process; function, arguments and result must be picklable."""
        return self.submit_reporting(lambda reported: None, partial(fn, *args, **kwargs))

    def submit_reporting(self, heard: Callable[[Any], None], work: partial[R]) -> Future[R]:
        """Call work in a process; `heard` receives its reports before the result."""
        return super().submit(self._run_in_process, self._kills, heard, work)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes after the submitted work, or after the current work."""
        super().shutdown(wait, cancel_futures=cancel_futures)
        if wait:
            self.kill()

    def kill(self) -> None:
        """Cancel all submitted work by killing the processes; later work starts new processes."""
        with self._lock:
            self._kills += 1
            for child in self._children:
                child.kill()
            while self._idle:
                self._end(self._idle.pop())

    def end(self) -> None:
        """Kill the processes and shut down; unfinished work is lost."""
        super().shutdown(wait=False, cancel_futures=True)
        self.kill()
        if can_start():
            self.shutdown()

    def _run_in_process(self, kills: int, heard: Callable[[Any], None], work: partial[R]) -> R:
        """Run work in an idle or new process; `kills`: number of calls of `kill` at submission."""
        if not can_start():
            return work()
        with self._lock:
            if self._kills > kills:
                raise ProcessEnded("The work was cancelled before a process started it.")
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
        """End a process; the caller holds the lock."""
        self._children.discard(child)
        end(child)


@contextmanager
def open_executor(
    workers: int | None = None, executor: Executor | None = None
) -> Iterator[Executor]:
    """Context with `executor` if given, else with `workers` processes."""
    # With 0 workers, the work runs in this process.
    if workers is not None and workers < 0:
        raise InvalidInput(f"workers must be 0 or more, but is {workers}.")
    if workers is not None and executor is not None:
        raise InvalidInput("An executor has its own workers. Remove workers.")
    if executor is not None:
        yield executor
    elif workers == 0:
        yield InProcess()
    else:
        pool = ProcessPool(workers)
        try:
            yield pool
        finally:
            # Remaining work is not needed, because its results were used or an error ended the
            # context.
            pool.end()


def count_workers(executor: Executor) -> int:
    """Number of workers of an executor; number of processors if it is unknown."""
    if isinstance(executor, InProcess):
        return 1
    if isinstance(executor, ProcessPool):
        return executor.processes
    cores = getattr(getattr(executor, "_client", None), "ncores", dict)
    # A closed Dask client raises its error at submission.
    with suppress(Exception):
        if count := sum(cores().values()):
            return int(count)
    return getattr(executor, "_max_workers", None) or processors()


class TaskQueue(Generic[T, R]):
    """Queue of items for an executor; results are returned in order of completion."""

    # At its end, the context cancels the items that no worker has started.

    def __init__(
        self, work: Callable[[T], R], executor: Executor, lost: Callable[[], R] | None = None
    ) -> None:
        self.workers = count_workers(executor)
        # Subclasses of InProcess may defer the work, so they are not local.
        self._is_local = type(executor) is InProcess
        self._work, self._executor, self._lost = work, executor, lost
        self._call = None if self._is_local else partial(_apply_packed, pack(work))
        self._done: list[tuple[T, R]] = []
        self._pending: dict[Future[Packed], T] = {}

    def __enter__(self) -> TaskQueue[T, R]:
        return self

    def __exit__(self, *error: object) -> None:
        for future in self._pending:
            future.cancel()

    def __len__(self) -> int:
        """Number of submitted items whose results were not returned yet."""
        return len(self._done) + len(self._pending)

    @property
    def ahead(self) -> int:
        """Number of submitted items that keeps all workers busy."""
        return 1 if self._is_local else self.workers + self.workers // 4 + 1

    def give(self, item: T) -> None:
        """Submit an item."""
        if self._call is None:
            self._done.append((item, self._work(item)))
            return
        try:
            self._pending[self._executor.submit(self._call, pack(item))] = item
        except Exception as error:
            raise ExecutionError(
                f"The executor accepts no work ({type(error).__name__}: {error}): it must be open, "
                "and its workers must be running."
            ) from None

    def take(self) -> list[tuple[T, R]]:
        """Wait for finished items; return them with their results; empty if none are submitted."""
        while self._pending and not self._done:
            wait_for(self._pending, timeout=PULSE, return_when=FIRST_COMPLETED)
            # `wait_for` ignores futures that the executor cancelled; `done` includes them.
            for future in [x for x in self._pending if x.done()]:
                self._done.append((self._pending.pop(future), self._result(future)))
        results, self._done = self._done, []
        return results

    def run_all(self, items: Iterable[T]) -> Iterator[tuple[T, R]]:
        """Submit all items, at most `ahead` at once; yield each with its result when it is done."""
        waiting = iter(items)
        while True:
            for item in islice(waiting, self.ahead - len(self)):
                self.give(item)
            if not len(self):
                return
            yield from self.take()

    def _result(self, future: Future[Packed]) -> R:
        """Result of an item; of `_lost`, if specified, for a lost worker; raises other errors."""
        try:
            result = unpack(future.result())
        except (Exception, CancelledError) as error:
            name = type(error).__name__
            if isinstance(error, ProcessEnded) or name == "KilledWorker":
                if self._lost is not None:
                    return self._lost()
                if isinstance(error, ProcessEnded):
                    raise
            if isinstance(error, LOST) or name in LOST_NAMES:
                raise ExecutionError(
                    f"A worker of the executor ended before it returned a result ({name}), for "
                    "example because memory ran out. Use fewer workers, or more memory for each."
                ) from None
            if isinstance(self._executor, ProcessPool):
                raise
            raise ExecutionError(
                f"The workers of the executor cannot do the work ({name}: {error}). They must have "
                "the same version of armcontour as this process."
            ) from None
        if isinstance(result, ArmContourError):
            raise result
        return cast(R, result)


def _apply_packed(work: Packed, item: Packed) -> Packed:
    """Apply packed work to a packed item; errors of this package are returned with their class."""
    try:
        with child_context():
            return pack(_unpack_work(work)(unpack(item)))
    except ArmContourError as error:
        return pack(error)


@lru_cache(maxsize=2)
def _unpack_work(work: Packed) -> Callable[[Any], Any]:
    """Unpacked work, cached in each process."""
    return cast(Callable[[Any], Any], unpack(work))


def map_in_processes(
    work: Callable[[T], R],
    items: Sequence[T],
    *,
    processes: int | None = None,
    executor: Executor | None = None,
    done: Callable[[int], None] | None = None,
) -> list[R]:
    """Apply work to all items in other processes; results are in the order of the items."""
    # An error of the work in another process is raised as a RuntimeError with its text.
    tell = done or (lambda number: None)
    count = min(processes or processors(), len(items))
    in_process = count < 2 or len(items) < FEWEST or is_child() or not can_start()
    if executor is None and in_process:
        executor = InProcess()
    with nullcontext(executor) if executor else open_executor(count) as opened:
        work_on_chunk = partial(_apply_to_chunk, work)
        with TaskQueue[tuple[int, Sequence[T]], list[R]](work_on_chunk, opened) as queue:
            slices = split_evenly(len(items), max(PARTS, 4 * queue.workers))
            results_by_chunk: dict[int, list[R]] = {}
            number = 0
            for (k, part), results in queue.run_all(enumerate(items[x] for x in slices)):
                tell(number)
                results_by_chunk[k] = results
                number += len(part)
    return [x for k in sorted(results_by_chunk) for x in results_by_chunk[k]]


def _apply_to_chunk(work: Callable[[T], R], numbered: tuple[int, Sequence[T]]) -> list[R]:
    """Apply work to the items of a numbered chunk."""
    return [work(x) for x in numbered[1]]


def map_in_order(work: Callable[[T], R], items: Sequence[T]) -> Generator[R, None, None]:
    """Yield the results of all items in order; in other processes if this saves time."""
    # If another process fails, this process repeats the item, so that its error is raised in order.
    begin, count = time.thread_time(), 0
    for k, item in enumerate(items):
        count = _count_processes(time.thread_time() - begin, k / len(items)) if k else 0
        if count > 1:
            break
        yield work(item)
    if count < 2:
        return
    remaining = items[k:]
    parts = [remaining[x] for x in split_evenly(len(remaining), 8 * count)]
    with open_executor(count) as pool:
        futures = [pool.submit(_apply_to_chunk, work, (0, x)) for x in parts]
        for part, future in zip(parts, futures, strict=True):
            try:
                results = future.result()
            except Exception:  # Pickle can raise any exception.
                yield from map(work, part)
            else:
                yield from results


def _count_processes(spent: float, fraction: float) -> int:
    """Number of processes that save more time than their start costs; 0 for none."""
    if spent < START / 4 or is_child() or not can_start():
        return 0
    return min(processors(), MAX_PROCESSES, int(spent * (1 / fraction - 1) / (2 * START)))
