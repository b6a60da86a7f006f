"""Work on many items in threads, processes and executors."""

import os
import sys
from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor
from functools import partial
from operator import truediv

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import armcontour as ac
from armcontour.core import pool
from armcontour.core.errors import InvalidInput
from armcontour.core.pool import (
    ProcessEnded,
    ProcessPool,
    map_in_order,
    map_in_processes,
    map_in_threads,
    open_executor,
    pack,
    run_all,
    split_evenly,
    starting_processes,
    unpack,
)

# Functions that other processes can import.
halve = partial(truediv, 1.0)
PID = "__import__('os').getpid()"


class Elsewhere(Executor):
    """Works here, but is taken for another executor, to which work is sent in parts."""

    def submit(self, fn, /, *args, **kwargs):
        future = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


@pytest.mark.parametrize("workers", [{"processes": 1}, {"processes": 2}, {"executor": Elsewhere()}])
def test_results_of_workers_are_in_the_order_of_their_items(workers):
    progress_log = []
    items = list(range(1, 101))
    results = map_in_processes(halve, items, **workers, done=progress_log.append)
    assert results == [1 / x for x in items]
    assert progress_log[0] == 0 and progress_log == sorted(progress_log) and progress_log[-1] < 100
    assert map_in_processes(halve, [], **workers) == []
    with pytest.raises(ZeroDivisionError):
        map_in_processes(halve, [1.0] * 20 + [0.0], **workers)
    with pytest.raises(InvalidInput):
        map_in_processes(ac.load_arm, ["no-such-arm"], **workers)


def test_threads_give_results_in_order_and_their_errors(monkeypatch):
    monkeypatch.setattr(pool, "processors", lambda: 3)
    assert map_in_threads(halve, list(range(1, 31))) == [1 / x for x in range(1, 31)]
    assert map_in_threads(halve, []) == []
    with pytest.raises(ZeroDivisionError):
        map_in_threads(halve, [1.0, 0.0, 2.0])


@given(st.integers(0, 100), st.integers(1, 20))
def test_parts_of_equal_size_cover_all_items(count, parts):
    parts_of_range = [list(range(count))[x] for x in split_evenly(count, parts)]
    assert sum(parts_of_range, []) == list(range(count))
    assert max(map(len, parts_of_range)) - min(map(len, parts_of_range)) <= 1


def test_packed_arrays_are_read_only():
    values = np.arange(3.0)
    unpacked = unpack(pack({"values": values}))["values"]
    assert np.array_equal(unpacked, values) and not unpacked.flags.writeable


@pytest.fixture
def eager(monkeypatch):
    """Processes are worth their start after the first item."""
    monkeypatch.setattr(pool, "PROCESS_START_TIME", 1e-9)
    monkeypatch.setattr(pool, "TRANSFER_TIME", 0.0)
    monkeypatch.setattr(pool, "processors", lambda: 2)


def test_an_error_is_returned_at_the_position_of_its_item(eager):
    pids = list(map_in_order(eval, [PID] * 40))
    assert pids[0] == os.getpid() and len(set(pids)) > 1
    results = map_in_order(halve, [1.0] * 20 + [0.0] + [1.0] * 10 + ["x"])
    assert [next(results) for _ in range(20)] == [1.0] * 20
    with pytest.raises(ZeroDivisionError):
        next(results)
    assert list(map_in_order(lambda x: x + 1, list(range(9)))) == list(range(1, 10))


def test_a_frozen_application_uses_no_other_processes(eager, monkeypatch):
    # `sys.executable` is the application there, which is no Python to start.
    monkeypatch.setattr(sys, "frozen", True, raising=False)
    own_ids = [os.getpid()] * 20
    assert list(map_in_order(eval, [PID] * 20)) == own_ids
    assert map_in_processes(eval, [PID] * 20, processes=2) == own_ids
    with open_executor(2) as executor:
        assert executor is None


def test_a_pool_is_an_executor_of_other_processes():
    with ProcessPool(1) as pool:
        assert list(pool.map(abs, [-1, 2, -3])) == [1, 2, 3]
        assert pool.submit(eval, PID).result() != os.getpid()
        # It computes in one thread.
        one = "__import__('os').environ['OMP_NUM_THREADS']"
        assert pool.submit(eval, one).result() == "1"
        # It can do nothing on the terminal.
        assert pool.submit(eval, "__import__('os').isatty(1) or print('x')").result() is None
        with pytest.raises(ZeroDivisionError):
            pool.submit(eval, "1 / 0").result()
        # New processes replace those of a pool in which a process has ended.
        with pytest.raises(BrokenExecutor, match=r"SIGABRT\(-6\)"):
            pool.submit(os.abort).result()
        assert pool.submit(abs, -4).result() == 4


class Failing(Executor):
    """An executor whose futures fail."""

    def __init__(self, error):
        self.error = error

    def submit(self, fn, /, *args, **kwargs):
        future = Future()
        future.set_exception(self.error)
        return future


def taken(items):
    return partial(next, iter(items), None)


def test_the_error_of_an_executor_is_raised():
    with pytest.raises(ImportError, match="no armcontour"):
        map_in_processes(halve, [1], executor=Failing(ImportError("no armcontour")))
    with pytest.raises(ProcessEnded, match=r"\(BrokenExecutor\).*memory"):
        map_in_processes(halve, [1], executor=Failing(BrokenExecutor()))


def test_the_result_of_a_lost_item_can_be_its_error():
    lost = run_all(halve, taken([2]), Failing(BrokenExecutor()), lambda error: error)
    [(item, error)] = lost
    assert item == 2 and error.startswith("A process ended before its work was done")


def test_without_workers_an_item_is_computed_when_its_result_is_taken():
    results = run_all(halve, taken([2, 0]), None)
    assert next(results) == (2, 0.5)
    with pytest.raises(ZeroDivisionError):
        next(results)


def test_options_that_exclude_each_other_are_refused():
    for arguments, words in (
        ((2, Elsewhere()), "An executor has its own workers"),
        ((-1, None), "workers must be 0 or more, but is -1"),
    ):
        with pytest.raises(InvalidInput, match=words), open_executor(*arguments):
            pass


def test_threads_that_start_processes_at_once_leave_the_environment_as_it_was(monkeypatch):
    monkeypatch.delenv("PYTHONSAFEPATH", raising=False)

    def start(_):
        with starting_processes() as ends:
            [end.close() for end in ends]

    with ThreadPoolExecutor(8) as executor:
        list(executor.map(start, range(200)))
    assert "PYTHONSAFEPATH" not in os.environ
