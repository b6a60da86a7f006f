"""Executors of work: results in order, errors, lost work; tests/slow has processes and Dask."""

import sys
from concurrent.futures import CancelledError, Executor, Future
from functools import partial
from operator import truediv

import pytest

import armcontour as ac
from armcontour._executors import Crew, InProcess, Watch, map_on, refuse_unclear, workers_of
from armcontour._pool import ProcessPool
from armcontour.errors import ExecutionError, InvalidInput

halve = partial(truediv, 1.0)


class Elsewhere(InProcess):
    """Works here, but is taken for another executor, to which work is sent in parts."""


def test_an_executor_does_work_on_many_items():
    told, items = [], list(range(1, 101))
    found = map_on(Elsewhere(), halve, items, done=told.append)
    assert found == [1 / x for x in items]
    assert told[0] == 0 and told == sorted(told) and told[-1] < 100
    assert map_on(Elsewhere(), halve, []) == []
    # Errors of this package keep their class.
    with pytest.raises(InvalidInput):
        map_on(Elsewhere(), ac.load_arm, ["no-such-arm"])


class Failing(Executor):
    """An executor whose futures fail."""

    def __init__(self, error):
        self.error = error

    def submit(self, fn, /, *args, **kwargs):
        future = Future()
        future.set_exception(self.error)
        return future


@pytest.mark.parametrize("error", [CancelledError(), MemoryError(), ImportError("no armcontour")])
def test_an_error_of_an_executor_is_one_of_this_package(error):
    with pytest.raises(ExecutionError, match=type(error).__name__):
        map_on(Failing(error), halve, [1])


class Deserted(Executor):
    """As the executor of a Dask cluster: the number of its workers at each look, and no answer."""

    def __init__(self, *counts):
        self.counts, self._client = list(counts), self

    def ncores(self):
        count = self.counts.pop(0) if len(self.counts) > 1 else self.counts[0]
        return {"tcp://10.0.0.2:1": count} if count else {}

    def submit(self, fn, /, *args, **kwargs):
        return Future()


@pytest.fixture
def clock(monkeypatch):
    """The clock of watches: 0.02 s at each look, and a cluster is deserted after 0.05 s."""
    looks = iter(range(1000))
    monkeypatch.setattr("armcontour._executors.monotonic", lambda: 0.02 * next(looks))
    monkeypatch.setattr("armcontour._executors.PULSE", 0.001)
    monkeypatch.setattr("armcontour._executors.DESERTED", 0.05)


def test_a_cluster_is_waited_for_until_all_its_workers_have_ended(clock):
    with pytest.raises(ExecutionError, match=r"All workers of the cluster .* in 0.05 s: start"):
        map_on(Deserted(2, 1, 0), halve, [1])
    # Two looks of the clock without a worker, one with it, and so on: never for as long as that.
    watch, futures = Watch(Deserted(*[0, 0, 1] * 20)), [Future()]
    assert not any(watch.wait(futures) for _ in range(50))


def test_this_process_works_when_an_item_is_given():
    with Crew(halve, None) as crew:
        crew.give(2)
        assert len(crew) == 1 and crew.ahead == 1
        assert crew.take() == [(2, 0.5)] and crew.take() == []
        # An error is that of the work, as no other worker had a part in it.
        with pytest.raises(ZeroDivisionError):
            crew.give(0)


def test_options_that_do_not_go_together_are_refused(monkeypatch):
    assert workers_of(ProcessPool(3)) == 3 and workers_of(InProcess()) >= 1
    monkeypatch.setitem(sys.modules, "distributed", None)
    monkeypatch.setattr("armcontour._executors.find_spec", lambda name: None)
    for arguments, words in (
        ((2, "tcp://127.0.0.1:1", None), "A cluster has its own workers"),
        ((-1, None, None), "workers must be 0 or more, but is -1"),
        ((None, "tcp://127.0.0.1:1", None), r"pip install 'armcontour\[cluster\]'"),
    ):
        with pytest.raises(InvalidInput, match=words):
            refuse_unclear(*arguments)
