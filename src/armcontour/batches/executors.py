"""Where jobs are worked on: in this process, in a pool of processes, or on a cluster."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from typing import Any, TypeVar

from armcontour._pool import ProcessPool
from armcontour._process import processors
from armcontour.errors import ExecutionError, InvalidInput

R = TypeVar("R")
# How long a scheduler may take to answer [s].
PATIENCE = "20s"


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
        mortal: Whether a job that does not end may end its process.
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
    """Open the executor of a batch, and close it at the end.

    Args:
        workers: Number of processes on this machine; by default one a processor. 0 works in this
            process. For an executor of the caller, the number of its workers.
        cluster: Address of a Dask scheduler, such as `tcp://10.0.0.1:8786`.
        executor: An executor of the caller, which stays open.

    Raises:
        ExecutionError: Nobody answers at the address, or the cluster has no workers.
    """
    if executor is not None:
        count = workers or getattr(executor, "_max_workers", None) or processors()
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
        except BaseException:
            # After an error nobody waits for jobs that are under way.
            pool.shutdown(wait=False, cancel_futures=True)
            raise
        pool.shutdown()


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
