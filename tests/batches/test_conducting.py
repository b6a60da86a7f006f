"""Chunks, retries, and jobs that take their process with them."""

from __future__ import annotations

from concurrent.futures import Executor, Future

import pytest

from armcontour._executors import InProcess
from armcontour._pool import ProcessPool
from armcontour._process import ProcessEnded
from armcontour.batches.conducting import TRIES, conduct
from armcontour.batches.working import (
    DONE,
    KILLED,
    OUT_OF_MEMORY,
    TIMED_OUT,
    Outcome,
    killed,
)
from armcontour.errors import ExecutionError


def work(items):
    """Work in this process."""
    return [Outcome(DONE, figures=(float(x),), seconds=1e-3) for x in items]


def gather(executor, given, do=work, **more):
    found = {}

    def take(k, outcome):
        assert k not in found
        found[k] = outcome

    conduct(executor, do, enumerate(given), workers=2, take=take, **more)
    return found


class Counting(InProcess):
    """Counts chunks, and loses those that hold some job."""

    def __init__(self, loses=(), error=None):
        self.loses, self.error, self.chunks = set(loses), error, []

    def submit(self, fn, /, items):
        self.chunks.append(list(items))
        if self.loses & set(items):
            future = Future()
            future.set_exception(self.error)
            return future
        return super().submit(fn, items)


def test_chunks_grow_to_half_a_second_of_work():
    executor = Counting()
    found = gather(executor, range(3000))
    assert [found[k].figures for k in range(3000)] == [(k,) for k in range(3000)]
    # Jobs of a millisecond: 500 at once, as soon as that is known; sent at once only then.
    sizes = [len(x) for x in executor.chunks]
    assert sizes[:4] == [1] * 4 and 300 < max(sizes) <= 500 and len(sizes) < 60


@pytest.mark.parametrize(
    "error, status",
    [(MemoryError(), OUT_OF_MEMORY), (None, KILLED), (5.0, TIMED_OUT)],
)
def test_a_job_that_costs_its_worker_costs_only_itself(error, status):
    if not isinstance(error, Exception):
        after, error = error, ProcessEnded("It has ended.")
        error.after = after
    executor = Counting([1234], error)
    found = gather(executor, range(2000), time=4.0)
    assert {k for k, x in found.items() if x.status != DONE} == {1234}
    assert found[1234].status == status and found[1234].tries == TRIES
    assert executor.chunks.count([1234]) == TRIES
    # Others are worked on again only as often as the chunk is halved.
    assert sum(map(len, executor.chunks)) < 2000 + 2 * 500 + TRIES


def test_what_is_not_the_fault_of_a_job_is_tried_again_alone():
    seen = []

    def once(items):
        seen.append(list(items))
        return [killed() if x == 7 and [7] not in seen else Outcome(DONE) for x in items]

    found = gather(InProcess(), range(20), once)
    assert {x.status for x in found.values()} == {DONE}
    assert found[7].tries == 2 and [7] in seen and sum(7 in x for x in seen) == 2


def test_workers_that_cannot_work_end_the_batch_with_a_sentence():
    def broken(items):
        raise ImportError("no module named armcontour")

    with pytest.raises(ExecutionError, match="no module named armcontour.*same version"):
        gather(InProcess(), range(20), broken)
    pool = ProcessPool(1)
    pool.shutdown()
    with pytest.raises(ExecutionError, match="takes no more jobs.*goes on"):
        gather(pool, range(20))


class Light(Executor):
    """A pool whose processes compute numbers; this one makes outcomes of them."""

    def __init__(self, pool):
        self.pool = pool

    def submit(self, fn, /, items):
        future = Future()

        def tell(inner):
            if inner.exception() is not None:
                future.set_exception(inner.exception())
            else:
                future.set_result(work(inner.result()))

        self.pool.submit(eval, f"[{', '.join(items)}]").add_done_callback(tell)
        return future


def test_a_process_that_ends_is_replaced():
    items = [repr(k) for k in range(40)]
    items[11] = "__import__('os')._exit(3)"
    items[30] = "__import__('os').kill(__import__('os').getpid(), 9)"
    with ProcessPool(2) as pool:
        found = gather(Light(pool), items)
    assert {k for k, x in found.items() if x.status == KILLED} == {11, 30}
    assert all(found[k].figures == (k,) for k in range(40) if k not in (11, 30))
