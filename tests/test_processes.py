"""Work on many items in threads and other processes; tests/slow ends and delays processes."""

import os
import sys
from functools import partial
from operator import truediv

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from armcontour._pool import ProcessPool
from armcontour._process import pack, unpack
from armcontour._processes import WorkAhead, map_in_processes
from armcontour._threads import map_in_threads, split_evenly

# Functions that other processes can import.
halve = partial(truediv, 1.0)
PID = "__import__('os').getpid()"


@pytest.mark.parametrize("processes", [1, 2])
def test_results_come_in_order(processes):
    told = []
    items = list(range(1, 31))
    found = map_in_processes(halve, items, processes=processes, done=told.append)
    assert found == [1 / x for x in items]
    assert len(told) == 30 and max(told) in (29, 30)
    with pytest.raises(ZeroDivisionError if processes == 1 else RuntimeError):
        map_in_processes(halve, [1.0] * 20 + [0.0], processes=processes)


def test_threads_give_results_in_order_and_their_errors(monkeypatch):
    monkeypatch.setattr("armcontour._processes.processors", lambda: 3)
    assert map_in_threads(halve, list(range(1, 31))) == [1 / x for x in range(1, 31)]
    assert map_in_threads(halve, []) == []
    with pytest.raises(ZeroDivisionError):
        map_in_threads(halve, [1.0, 0.0, 2.0])


@given(st.integers(0, 100), st.integers(1, 20))
def test_even_parts_make_up_the_whole(count, parts):
    found = [list(range(count))[x] for x in split_evenly(count, parts)]
    assert sum(found, []) == list(range(count))
    assert max(map(len, found)) - min(map(len, found)) <= 1


def work_ahead(work, items):
    """The results of all items, all of which are there at the beginning."""
    with WorkAhead(work) as ahead:
        for k, item in enumerate(items):
            ahead.add(item, (k + 1) / len(items))
        yield from ahead.results()


def test_packed_arrays_are_read_only():
    values = np.arange(3.0)
    found = unpack(pack({"values": values}))["values"]
    assert np.array_equal(found, values) and not found.flags.writeable


def test_a_frozen_application_does_all_itself(monkeypatch):
    # `sys.executable` is the application there, which is no Python to start.
    monkeypatch.setattr(sys, "frozen", True, raising=False)
    monkeypatch.setattr("armcontour._processes.ALONE", 1e-9)
    monkeypatch.setattr("armcontour._processes.processors", lambda: 3)
    here = [os.getpid()] * 20
    assert list(work_ahead(eval, [PID] * 20)) == here
    assert map_in_processes(eval, [PID] * 20, processes=2) == here
    with ProcessPool(2) as pool:
        assert pool.submit(eval, PID).result() == os.getpid()


def test_a_pool_is_an_executor_of_other_processes():
    with ProcessPool(1) as pool:
        assert list(pool.map(abs, [-1, 2, -3])) == [1, 2, 3]
        assert pool.submit(eval, PID).result() != os.getpid()
        # It computes in one thread, and starts no further processes.
        one = "__import__('os').environ['OMP_NUM_THREADS']"
        assert pool.submit(eval, one).result() == "1"
        with pytest.raises(RuntimeError, match="ZeroDivisionError"):
            pool.submit(eval, "1 / 0").result()
    with pytest.raises(RuntimeError, match="shut down"):
        pool.submit(abs, 1)
