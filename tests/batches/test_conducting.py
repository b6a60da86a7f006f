"""Chunks and retries of jobs; tests/slow/batches ends processes."""

from concurrent.futures import Future

import pytest

from armcontour._executors import InProcess
from armcontour._process import ProcessEnded
from armcontour.batches.conducting import TRIES, conduct
from armcontour.batches.working import DONE, KILLED, OUT_OF_MEMORY, TIMED_OUT, Outcome
from armcontour.errors import ExecutionError


def work(items):
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


def test_a_job_that_costs_its_worker_costs_only_itself():
    ended, late = ProcessEnded("It has ended."), ProcessEnded("It has ended.")
    ended.after, late.after = None, 5.0
    for error, status in ((MemoryError(), OUT_OF_MEMORY), (ended, KILLED), (late, TIMED_OUT)):
        executor = Counting([1234], error)
        found = gather(executor, range(2000), time=4.0)
        assert {k for k, x in found.items() if x.status != DONE} == {1234}
        assert found[1234].status == status and found[1234].tries == TRIES
        assert executor.chunks.count([1234]) == TRIES
        assert all(found[k].figures == (k,) for k in range(2000) if k != 1234)
        # Others are worked on again only as often as the chunk is halved.
        assert sum(map(len, executor.chunks)) < 2000 + 2 * 500 + TRIES


def test_workers_that_cannot_work_end_the_batch():
    class Closed(InProcess):
        def submit(self, fn, /, *args):
            raise RuntimeError("shut down")

    def broken(items):
        raise ImportError("no module named armcontour")

    for executor, do in ((InProcess(), broken), (Closed(), work)):
        with pytest.raises(ExecutionError):
            gather(executor, range(20), do)
