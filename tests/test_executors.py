"""Who works: results in order, errors of the work, and what an executor loses."""

import os
import sys
from concurrent.futures import CancelledError, Executor, Future, ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from operator import truediv

import pytest

import armcontour as ac
from armcontour._executors import (
    Crew,
    InProcess,
    Watch,
    map_on,
    open_engine,
    refuse_unclear,
    workers_of,
)
from armcontour._pool import ProcessPool
from armcontour.batches.conducting import conduct
from armcontour.errors import ExecutionError, InvalidInput

# Functions that other processes can import.
halve = partial(truediv, 1.0)
PID = "__import__('os').getpid()"


def test_an_executor_does_work_on_many_items():
    with ProcessPool(1) as pool:
        told = []
        items = list(range(1, 101))
        assert map_on(pool, halve, items, done=told.append) == [1 / x for x in items]
        assert told[0] == 0 and told == sorted(told) and told[-1] < 100
        assert len(set(map_on(pool, eval, [PID] * 20)) - {os.getpid()}) == 1
        assert map_on(pool, halve, []) == []


def test_errors_of_this_package_keep_their_kind():
    with ProcessPool(1) as pool, pytest.raises(InvalidInput, match=r"no arm|There is no"):
        map_on(pool, ac.load_arm, ["no-such-arm"])


@pytest.mark.parametrize("own", [True, False])
def test_a_lost_worker_is_one_sentence(own):
    pool = ProcessPool(1) if own else ProcessPoolExecutor(1, mp_context=get_context("spawn"))
    with pool, pytest.raises(ExecutionError, match=r"has ended before it gave an answer.*memory"):
        map_on(pool, eval, ["__import__('os')._exit(3)"])


class Failing(Executor):
    """An executor whose futures fail."""

    def __init__(self, error):
        self.error = error

    def submit(self, fn, /, *args, **kwargs):
        future = Future()
        future.set_exception(self.error)
        return future


class KilledWorker(Exception):
    """As Dask calls what it raises for a task whose workers have died."""


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (KilledWorker("gone"), r"has ended before it gave an answer \(KilledWorker\)"),
        (CancelledError(), r"has ended before it gave an answer \(CancelledError\)"),
        (MemoryError(), r"has ended before it gave an answer \(MemoryError\)"),
        (ImportError("no armcontour"), r"cannot do the work \(ImportError: no armcontour\): they"),
    ],
)
def test_what_an_executor_raises_is_one_sentence(error, words):
    with pytest.raises(ExecutionError, match=words):
        map_on(Failing(error), halve, [1])


def test_an_executor_that_is_closed_is_said():
    pool = ProcessPool(1)
    pool.shutdown()
    with pytest.raises(ExecutionError, match="takes no work .*shut down.*: give one that is open"):
        map_on(pool, halve, [1])


def test_a_client_that_is_closed_is_said():
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None
        ) as cluster,
        distributed.Client(cluster, set_as_default=False) as client,
    ):
        executor = client.get_executor(pure=False)
        assert workers_of(executor) == 1 and map_on(executor, halve, [2]) == [0.5]
    with pytest.raises(ExecutionError, match="The executor takes no work"):
        map_on(executor, halve, [1])


class Deserted(Executor):
    """As the executor of a Dask cluster: the number of its workers at each look, and no answer."""

    def __init__(self, *counts):
        self.counts, self._client = list(counts), self

    def ncores(self):
        count = self.counts.pop(0) if len(self.counts) > 1 else self.counts[0]
        return {"tcp://10.0.0.2:1": count} if count else {}

    def submit(self, fn, /, *args, **kwargs):
        return Future()


@pytest.mark.parametrize("work", ["items", "jobs"])
def test_a_cluster_that_has_lost_all_workers_is_not_waited_for(monkeypatch, work):
    monkeypatch.setattr("armcontour._executors.PULSE", 0.01)
    monkeypatch.setattr("armcontour._executors.DESERTED", 0.05)
    executor = Deserted(2, 1, 0)
    with pytest.raises(ExecutionError, match=r"All workers of the cluster .* in 0.05 s: start"):
        if work == "items":
            map_on(executor, halve, [1])
        else:
            conduct(executor, abs, enumerate([1]), workers=1, take=lambda k, outcome: None)


def test_a_worker_that_comes_back_is_waited_for(monkeypatch):
    monkeypatch.setattr("armcontour._executors.PULSE", 0.001)
    monkeypatch.setattr("armcontour._executors.DESERTED", 0.05)
    clock = iter(range(1000))
    monkeypatch.setattr("armcontour._executors.monotonic", lambda: 0.02 * next(clock))
    # Two looks of the clock without a worker, one with it, and so on: never for as long as that.
    watch, futures = Watch(Deserted(*[0, 0, 1] * 20)), [Future()]
    assert not any(watch.wait(futures) for _ in range(50))


def test_this_process_works_when_an_item_is_given():
    with Crew(halve, None) as crew:
        crew.give(2)
        assert len(crew) == 1 and crew.ahead == 1
        assert crew.take() == [(2, 0.5)] and crew.take() == []
        # An error is that of the work, as nobody else had a part in it.
        with pytest.raises(ZeroDivisionError):
            crew.give(0)


def test_what_nobody_works_on_is_taken_back():
    with ProcessPool(1) as pool:
        with Crew(eval, pool) as crew:
            for text in ["__import__('time').sleep(0.2)", *["1"] * 20]:
                crew.give(text)
        futures = [pool.submit(eval, "2")]
        assert futures[0].result() == 2 and len(crew) == 21


def test_executors_tell_their_workers():
    assert workers_of(ProcessPool(3)) == 3
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        assert workers_of(pool) == 2
    assert workers_of(InProcess()) >= 1
    with open_engine(workers=2) as engine:
        assert (engine.workers, engine.mortal, engine.name) == (2, True, "2 processes")
    with pytest.raises(RuntimeError, match="shut down"):
        engine.executor.submit(abs, 1)


def test_options_that_make_no_sense_are_refused(monkeypatch):
    with pytest.raises(InvalidInput, match="A cluster has its own workers"):
        refuse_unclear(2, "tcp://127.0.0.1:1", None)
    with pytest.raises(InvalidInput, match="workers must be 0 or more, but is -1"):
        refuse_unclear(-1, None, None)
    monkeypatch.setitem(sys.modules, "distributed", None)
    monkeypatch.setattr("armcontour._executors.find_spec", lambda name: None)
    with pytest.raises(InvalidInput, match=r"pip install 'armcontour\[cluster\]'"):
        refuse_unclear(None, "tcp://127.0.0.1:1", None)


def test_a_cluster_that_is_not_there_is_one_sentence(monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr("armcontour._executors.PATIENCE", "1s")
    with (
        pytest.raises(ExecutionError, match=r"No Dask scheduler answers at tcp://127.0.0.1:1 \("),
        open_engine(cluster="tcp://127.0.0.1:1"),
    ):
        pass
