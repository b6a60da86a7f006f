"""Who does the work of a command: this process, a pool of processes, or a cluster."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from concurrent.futures import Executor


@contextmanager
def open_executor(workers: int | None, cluster: str | None) -> Iterator[Executor]:
    """Open what the options `--workers` and `--cluster` name, and close it at the end.

    Args:
        workers: Number of processes on this machine; None is one a processor, 0 this process.
        cluster: Address of a Dask scheduler.

    Raises:
        InvalidInput: Both are given, or a library is missing.
        ExecutionError: Nobody answers at the address, or the cluster has no workers.
    """
    from armcontour._executors import open_engine, refuse_unclear

    refuse_unclear(workers, cluster, None)
    with open_engine(workers=workers, cluster=cluster) as engine:
        yield engine.executor
