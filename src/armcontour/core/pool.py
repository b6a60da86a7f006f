"""Work on many items in threads, in processes of `loky`, by any executor, or in this process.

Scripts that use processes need no `if __name__ == "__main__"`. A process ends when its parent
process ends for any reason.
"""

from __future__ import annotations

import gc
import os
import pickle
import re
import signal
import sys
import threading
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent import futures
from concurrent.futures import BrokenExecutor, Executor, Future
from contextlib import contextmanager, suppress
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar, cast

from armcontour.core.errors import ExecutionError, InvalidInput

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

T = TypeVar("T")
R = TypeVar("R")
Packed: TypeAlias = tuple[bytes, tuple[bytes, ...]]
# Largest number of threads for compiled work; combining their results is serial.
MAX_THREADS = 8
# Fewest items for other processes, because starting a process takes as long as several items.
FEWEST_ITEMS = 12
# Approximate time to start a process [s]. Work is shared if each process saves twice this time.
PROCESS_START_TIME = 1.0
# Approximate time to send an item to a process, and to receive its result [s].
TRANSFER_TIME = 1e-3
# Largest number of processes that plan moves; each needs about as much memory as this one.
MAX_PROCESSES = 8
# Smallest number of chunks for an executor; each chunk carries the pickled work.
FEWEST_CHUNKS = 32
# Longest wait for results [s]; between waits an interrupt is handled on all systems.
LONGEST_WAIT = 1.0
# Environment of processes: libraries use one thread, because only `map_in_threads` uses several;
# and no module is imported from the current folder, because its files could replace modules.
ENVIRONMENT = dict.fromkeys(
    (
        *("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"),
        "PYTHONSAFEPATH",
    ),
    "1",
)
# Per thread: `busy` is True while the thread works for another process or an executor.
_threads = threading.local()
_changing_environment = threading.Lock()


class ProcessEnded(ExecutionError):
    """A process ended before its work was done."""

    @classmethod
    def from_reason(cls, reason: str) -> ProcessEnded:
        """Make the error for a reason, such as a signal or an exit code."""
        return cls(
            f"A process ended before its work was done ({reason}), for example because memory ran "
            "out. Use fewer processes, or free some memory."
        )


def processors() -> int:
    """Count the processors available to this process."""
    if sys.platform == "linux":
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def can_start() -> bool:
    """Return whether processes can be started; a frozen application has no Python interpreter."""
    return bool(sys.executable) and not getattr(sys, "frozen", False)


def is_child() -> bool:
    """Return whether this thread works for another process or an executor."""
    return getattr(_threads, "busy", False)


def map_in_threads(work: Callable[[T], R], items: Sequence[T]) -> list[R]:
    """Apply a compiled function to all items in threads; kernels release the interpreter's lock."""
    # A call should take 1 ms or more, because the Python code between calls is serial.
    count = 1 if is_child() else min(processors(), MAX_THREADS, len(items))
    if count < 2:
        return [work(x) for x in items]
    with futures.ThreadPoolExecutor(count) as pool:
        return list(pool.map(work, items))


def split_evenly(count: int, parts: int) -> list[slice]:
    """Divide a sequence into slices of approximately equal length."""
    number = max(1, min(parts, count))
    return [slice(count * k // number, count * (k + 1) // number) for k in range(number)]


class ProcessPool(Executor):
    """Process executor; new processes replace all of them after one has ended."""

    def __init__(self, processes: int | None = None) -> None:
        self._max_workers = processes or processors()
        self._pool: Any = None

    def submit(self, fn: Callable[..., R], /, *args: Any, **kwargs: Any) -> Future[R]:
        """Call a function in a process; function, arguments and result must be picklable."""
        with suppress(BrokenExecutor):
            if self._pool is not None:
                return cast(Future[R], self._pool.submit(fn, *args, **kwargs))
        from loky import ProcessPoolExecutor

        with starting_processes() as (lifeline, self._writer):
            self._pool = ProcessPoolExecutor(
                self._max_workers,
                initializer=begin_process,
                initargs=(lifeline, gc.get_threshold()),
                env=ENVIRONMENT,
            )
            return cast(Future[R], self._pool.submit(fn, *args, **kwargs))

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Kill the processes; unfinished work is lost."""
        if self._pool is not None:
            self._pool.shutdown(wait, kill_workers=True)


@contextmanager
def starting_processes() -> Iterator[tuple[Connection, Connection]]:
    """Set the environment in which processes are started; yield both ends of a pipe.

    Processes with the first end (`begin_process`) end when this process closes the second.
    """
    from multiprocessing import Pipe, resource_tracker

    from loky.backend import resource_tracker as loky_tracker

    # Also the processes that clean up after others must not import from the current folder. The
    # environment is that of all threads, so one thread changes it at a time.
    with _changing_environment:
        before = os.environ.get("PYTHONSAFEPATH")
        os.environ["PYTHONSAFEPATH"] = "1"
        resource_tracker.ensure_running()
        loky_tracker.ensure_running()
        del os.environ["PYTHONSAFEPATH"]
        if before is not None:
            os.environ["PYTHONSAFEPATH"] = before
    if not hasattr(signal, "pthread_sigmask"):
        yield Pipe(duplex=False)
        return
    # The terminal interrupts all processes, but only this one handles interrupts.
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield Pipe(duplex=False)
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)


def begin_process(lifeline: Connection, threshold: tuple[int, int, int]) -> None:
    """Prepare a process: it is quiet, leaves interrupts to its parent and ends with its parent."""
    _threads.busy = True
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    gc.set_threshold(*threshold)
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 1)
    os.dup2(null, 2)

    def follow() -> None:
        with suppress(EOFError, OSError):
            lifeline.recv_bytes()
        os._exit(1)

    threading.Thread(target=follow, daemon=True).start()


@contextmanager
def open_executor(
    workers: int | None = None, executor: Executor | None = None
) -> Iterator[Executor | None]:
    """Yield `executor`, or one with `workers` processes; None if this process does the work."""
    if workers is not None and workers < 0:
        raise InvalidInput(f"workers must be 0 or more, but is {workers}.")
    if executor is not None and workers is not None:
        raise InvalidInput("An executor has its own workers. Remove workers.")
    if executor is not None or workers == 0 or not can_start():
        yield executor
        return
    with ProcessPool(workers) as pool:
        yield pool


def run_all(
    work: Callable[[T], R],
    take: Callable[[], T | None],
    executor: Executor | None,
    lost: Callable[[str], R] | None = None,
) -> Iterator[tuple[T, R]]:
    """Yield each item and its result as soon as the item is done.

    Args:
        work: Function that is applied to each item.
        take: Called for the next item; returns None if none is ready.
        executor: The executor, or None for this process.
        lost: Result of an item whose process ended, from the message of the error. Without it,
            the error is raised.
    """
    if executor is None:
        while (item := take()) is not None:
            yield item, work(item)
        return
    call = partial(_apply_packed, pack(work))
    # Items that keep all workers busy; an executor with unknown workers gets all items.
    workers = getattr(executor, "_max_workers", sys.maxsize)
    pending: dict[Future[Packed], T] = {}
    # Items that were in work when a process ended. Each is repeated without other items, so that
    # the item whose process ends is known.
    again: list[T] = []
    repeated: T | None = None
    try:
        while True:
            while not again and len(pending) <= 1.25 * workers and (item := take()) is not None:
                pending[executor.submit(call, pack(item))] = item
            if again and not pending:
                repeated = again.pop()
                pending[executor.submit(call, pack(repeated))] = repeated
            if not pending:
                return
            futures.wait(pending, LONGEST_WAIT, futures.FIRST_COMPLETED)
            # `wait` ignores futures that the executor cancelled; `done` includes them.
            for future in [x for x in pending if x.done()]:
                item = pending.pop(future)
                try:
                    result = unpack(future.result())
                except BrokenExecutor as error:
                    if item is not repeated:
                        again.append(item)
                        continue
                    # loky names the signals or exit codes at the end of a long text.
                    found = re.search(r"exit codes of the workers are \{(.*)\}", str(error))
                    ended = ProcessEnded.from_reason(found[1] if found else type(error).__name__)
                    if lost is None:
                        raise ended from None
                    result = lost(str(ended))
                yield item, result
    finally:
        for future in pending:
            future.cancel()


def pack(value: Any) -> Packed:
    """Pickle a value; its arrays are read-only after `unpack`, like checked arrays."""
    import cloudpickle

    # Arrays are read-only because the kernels are compiled for read-only arrays.
    buffers: list[pickle.PickleBuffer] = []
    data = cloudpickle.dumps(value, protocol=5, buffer_callback=buffers.append)
    return data, tuple(bytes(x.raw()) for x in buffers)


def unpack(packed: Packed) -> Any:
    """Unpickle a packed value."""
    data, buffers = packed
    return pickle.loads(data, buffers=buffers)


def _apply_packed(work: Packed, item: Packed) -> Packed:
    """Apply packed work to a packed item."""
    before = is_child()
    _threads.busy = True
    try:
        return pack(_unpack_work(work)(unpack(item)))
    finally:
        _threads.busy = before


@lru_cache(maxsize=2)
def _unpack_work(work: Packed) -> Callable[[Any], Any]:
    """Unpack work; each process caches the result."""
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
    count = min(processes or processors(), len(items))
    in_process = count < 2 or len(items) < FEWEST_ITEMS or is_child()
    workers: int | None = count
    if executor is not None:
        workers = None
    elif in_process:
        workers = 0
    slices = split_evenly(len(items), max(FEWEST_CHUNKS, 4 * count))
    results_by_chunk: dict[int, list[R]] = {}
    number = 0
    with open_executor(workers, executor) as opened:
        chunks = iter([(x.start, items[x]) for x in slices])
        take = partial(next, chunks, None)
        for (start, _), results in run_all(lambda x: [work(y) for y in x[1]], take, opened):
            if done is not None:
                done(number)
            results_by_chunk[start] = results
            number += len(results)
    in_order = []
    for start in sorted(results_by_chunk):
        in_order += results_by_chunk[start]
    return in_order


def map_in_order(work: Callable[[T], R], items: Sequence[T]) -> Generator[R, None, None]:
    """Yield the results of all items in order; in other processes if this saves time."""
    # If another process fails, this process repeats the item, so that its error is raised in order.
    begin = time.thread_time()
    count = 0
    for k, item in enumerate(items):
        count = _count_processes(time.thread_time() - begin, k, len(items)) if k else 0
        if count > 1:
            break
        yield work(item)
    if count < 2:
        return
    remaining = items[k:]
    parts = [remaining[x] for x in split_evenly(len(remaining), 8 * count)]
    call = partial(_apply_packed, pack(lambda part: [work(x) for x in part]))
    with ProcessPool(count) as pool:
        submitted = [pool.submit(call, pack(x)) for x in parts]
        for part, future in zip(parts, submitted, strict=True):
            try:
                results = unpack(future.result())
            except Exception:  # Pickle can raise any exception.
                yield from map(work, part)
            else:
                yield from results


def _count_processes(spent: float, done: int, count: int) -> int:
    """Return how many processes save more time than they and their items cost; 0 for none.

    - `spent`: time that the first `done` of `count` items took [s].
    """
    if spent < PROCESS_START_TIME / 4 or is_child() or not can_start():
        return 0
    saved = (count - done) * (spent / done - TRANSFER_TIME)
    return max(0, min(processors(), MAX_PROCESSES, int(saved / (2 * PROCESS_START_TIME))))
