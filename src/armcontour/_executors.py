"""Who works: this process, a pool of processes, a cluster; what is sent there, and what is lost."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Collection, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Executor, Future
from concurrent.futures import wait as wait_for
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import lru_cache, partial
from importlib import import_module
from importlib.util import find_spec
from time import monotonic
from typing import Any, Generic, TypeVar, cast

from armcontour._pool import ProcessPool
from armcontour._process import (
    Packed,
    ProcessEnded,
    pack,
    processors,
    unpack,
    working_for_another,
)
from armcontour.errors import ArmContourError, ExecutionError, InvalidInput

T = TypeVar("T")
R = TypeVar("R")
# How long a scheduler may take to answer [s].
PATIENCE = "20s"
# Longest time between two looks at what is done [s].
PULSE = 1.0
# How long a cluster may be without any worker [s]: one that ended may be started again meanwhile.
DESERTED = 60.0
# Parts of the items that an executor gets, each with the work: more would send it too often.
CHUNKS = 32
# What executors raise for work whose process is gone; Dask's are named, as it may be missing.
LOST = (ProcessEnded, BrokenExecutor, CancelledError)
LOST_NAMES = ("KilledWorker", "FutureCancelledError", "CommClosedError", "FutureLostError")


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


@dataclass(frozen=True)
class Engine:
    """An executor and what is known of it.

    Args:
        executor: The executor.
        workers: Number of its workers.
        mortal: Whether work that does not end may end its process.
        remote: Whether its workers may be on other machines.
        name: What it is called in progress.
    """

    executor: Executor
    workers: int
    mortal: bool
    remote: bool
    name: str


def refuse_unclear(workers: int | None, cluster: str | None, executor: Executor | None) -> None:
    """Refuse options of `open_engine` that make no sense, and a cluster without Dask.

    Raises:
        InvalidInput: Such options, or Dask is not installed.
    """
    if workers is not None and workers < 0:
        raise InvalidInput(f"workers must be 0 or more, but is {workers}.")
    if cluster is not None and (workers is not None or executor is not None):
        raise InvalidInput("A cluster has its own workers: leave workers and executor out.")
    if cluster is not None and find_spec("distributed") is None:
        raise InvalidInput(
            "A cluster needs the library distributed: pip install 'armcontour[cluster]'."
        )


@contextmanager
def open_engine(
    *,
    workers: int | None = None,
    cluster: str | None = None,
    executor: Executor | None = None,
) -> Iterator[Engine]:
    """Open an executor, and close it at the end.

    Args:
        workers: Number of processes on this machine; by default one a processor. 0 works in this
            process. For an executor of the caller, the number of its workers.
        cluster: Address of a Dask scheduler, such as `tcp://10.0.0.1:8786`.
        executor: An executor of the caller, which stays open.

    Raises:
        ExecutionError: Nobody answers at the address, or the cluster has no workers.
    """
    if executor is not None:
        count = workers or workers_of(executor)
        yield Engine(executor, count, False, False, type(executor).__name__)
    elif cluster is not None:
        with _dask(cluster) as engine:
            yield engine
    elif workers == 0:
        yield Engine(InProcess(), 1, False, False, "this process")
    else:
        pool = ProcessPool(workers)
        try:
            yield Engine(pool, pool.processes, True, False, _processes(pool.processes))
        finally:
            # Nobody waits for what is under way now: all is done, nobody needs it, or an error ends
            # the work.
            pool.end()


def workers_of(executor: Executor) -> int:
    """Number of workers of an executor; that of processors where it does not tell."""
    if isinstance(executor, ProcessPool):
        return executor.processes
    return getattr(executor, "_max_workers", None) or _present(executor) or processors()


def _present(executor: Executor | None) -> int | None:
    """Number of workers that a cluster has now; None for others, and where it does not tell."""
    cores = getattr(getattr(executor, "_client", None), "ncores", None)
    if cores is not None:
        # A client of Dask that is closed says so when it is given work.
        with suppress(Exception):
            return int(sum(cores().values()))
    return None


def _processes(count: int) -> str:
    """A number of processes in words."""
    return f"{count} process{'es' if count > 1 else ''}"


@contextmanager
def _dask(address: str) -> Iterator[Engine]:
    """The executor of a Dask cluster."""
    distributed: Any = import_module("distributed")
    try:
        client = distributed.Client(address, timeout=PATIENCE, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        raise ExecutionError(
            f"No Dask scheduler answers at {address} ({error}): start one with `dask scheduler`, "
            "and workers with `dask worker ADDRESS --nthreads 1`."
        ) from None
    try:
        count = sum(client.ncores().values())
        if not count:
            raise ExecutionError(
                f"The Dask cluster at {address} has no workers: start some with `dask worker "
                f"{address} --nthreads 1`."
            )
        # Work has no side effects, but Dask would take equal calls for one.
        yield Engine(
            client.get_executor(pure=False), count, True, True, f"{count} workers at {address}"
        )
    finally:
        client.close()


def is_lost(error: BaseException) -> bool:
    """Whether an executor raises this for work whose process is gone."""
    return isinstance(error, LOST) or type(error).__name__ in LOST_NAMES


def is_out_of_memory(error: BaseException) -> bool:
    """Whether an executor raises this for work whose memory ran out."""
    text = "Another process of this work failed: MemoryError"
    return isinstance(error, MemoryError) or str(error).startswith(text)


def not_able(error: BaseException) -> ExecutionError:
    """The error of workers that cannot do some work at all."""
    return ExecutionError(
        f"The workers of the executor cannot do the work ({type(error).__name__}: {error}): they "
        "need the same version of armcontour as this process."
    )


class Watch:
    """Waits for futures of an executor, but not for a cluster that has lost all of its workers.

    Such a cluster keeps the work for workers that may never come.

    Args:
        executor: The executor; None where nothing is waited for.
    """

    def __init__(self, executor: Executor | None) -> None:
        self._executor = executor
        self._deserted: float | None = None

    def wait(self, futures: Collection[Future[R]]) -> list[Future[R]]:
        """The futures that are done, after a while; none if that takes long.

        Raises:
            ExecutionError: The cluster has been without a worker for too long.
        """
        wait_for(futures, timeout=PULSE, return_when=FIRST_COMPLETED)
        # That does not wait for what its executor has cancelled.
        done = [x for x in futures if x.done()]
        if not done:
            self._refuse_deserted()
        return done

    def _refuse_deserted(self) -> None:
        """Refuse to wait on for a cluster without workers."""
        if _present(self._executor) != 0:
            self._deserted = None
            return
        now = monotonic()
        self._deserted = now if self._deserted is None else self._deserted
        if now - self._deserted >= DESERTED:
            raise ExecutionError(
                f"All workers of the cluster have ended, and none has come back in {DESERTED:g} s: "
                "start some with `dask worker ADDRESS --nthreads 1`, and start this work again."
            )


class Crew(Generic[T, R]):
    """An executor that works on items, which come back as they are done; else this process.

    As a context it takes back at its end what nobody works on yet.

    Args:
        work: The work; it can be pickled, as items and results can.
        executor: The executor; None and `InProcess` work when an item is given.
        workers: Number of its workers; by default what it tells.
    """

    def __init__(
        self, work: Callable[[T], R], executor: Executor | None, workers: int | None = None
    ) -> None:
        # A subclass may do otherwise.
        alone = executor is None or type(executor) is InProcess
        self._work, self._executor = work, None if alone else executor
        self.workers = 1 if executor is None or alone else workers or workers_of(executor)
        self._call = None if alone else partial(_on, _frozen(pack(work)))
        self._done: list[tuple[T, R]] = []
        self._away: dict[Future[Packed], T] = {}
        self._watch = Watch(self._executor)

    def __enter__(self) -> Crew[T, R]:
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
        return 1 if self._executor is None else self.workers + self.workers // 4 + 1

    def give(self, item: T) -> None:
        """Have an item worked on.

        Raises:
            ExecutionError: The executor takes no work.
        """
        if self._executor is None or self._call is None:
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
            ExecutionError: A worker has ended, or cannot do the work, or no worker is left.
            ArmContourError: As the work raises.
        """
        while self._away and not self._done:
            self._done += [(self._away.pop(x), _result(x)) for x in self._watch.wait(self._away)]
        found, self._done = self._done, []
        return found


def map_on(
    executor: Executor,
    work: Callable[[T], R],
    items: Sequence[T],
    *,
    done: Callable[[int], None] | None = None,
) -> list[R]:
    """Have an executor do some work on all items; results are in their order.

    Args:
        executor: The executor.
        work: The work; it can be pickled, as items and results can.
        items: The items.
        done: Called with the number of items that are done, from time to time.

    Raises:
        ExecutionError: The executor takes no work, or a worker has ended or cannot do it.
        ArmContourError: As the work raises.
    """
    step = max(1, len(items) // CHUNKS)
    left = deque(range(0, len(items), step))
    found: dict[int, list[R]] = {}
    number = 0
    with Crew[tuple[int, Sequence[T]], list[R]](partial(_several, work), executor) as crew:
        while left or len(crew):
            while left and (crew.ahead > 1 or not len(crew)):
                k = left.popleft()
                crew.give((k, items[k : k + step]))
            if done is not None:
                done(number)
            for (k, _), results in crew.take():
                found[k] = results
                number += len(results)
    return [x for k in sorted(found) for x in found[k]]


def _several(work: Callable[[T], R], numbered: tuple[int, Sequence[T]]) -> list[R]:
    """Do some work on several items."""
    return [work(x) for x in numbered[1]]


def _frozen(packed: Packed) -> tuple[bytes, tuple[bytes, ...]]:
    """Packed work as a key of a cache."""
    return packed[0], tuple(packed[1])


def _on(work: tuple[bytes, tuple[bytes, ...]], item: Packed) -> Packed:
    """Do packed work on an item; arrays are read-only as in this package's own processes.

    An error of this package is a result, which keeps its kind on every way.
    """
    try:
        with working_for_another():
            return pack(_unpacked(work)(unpack(item)))
    except ArmContourError as error:
        return pack(error)


@lru_cache(maxsize=2)
def _unpacked(work: tuple[bytes, tuple[bytes, ...]]) -> Callable[[Any], Any]:
    """The work, which is made once in each process."""
    return cast(Callable[[Any], Any], unpack((work[0], list(work[1]))))


def _result(future: Future[Packed]) -> Any:
    """What came of an item.

    Raises:
        ExecutionError: Its worker has ended, or cannot do the work.
        ArmContourError: As the work raises.
    """
    try:
        found = unpack(future.result())
    except ProcessEnded:
        raise
    except (Exception, CancelledError) as error:
        if not is_lost(error) and not is_out_of_memory(error):
            raise not_able(error) from None
        raise ExecutionError(
            f"A worker of the executor has ended before it gave an answer ({type(error).__name__}),"
            " as when memory runs out: take fewer workers, or give each more memory."
        ) from None
    if isinstance(found, ArmContourError):
        raise found
    return found
