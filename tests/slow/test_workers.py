"""Processes and clusters: order, errors, and processes that end, that are slow or killed."""

import os
import subprocess
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from operator import truediv
from threading import Timer

import pytest

from armcontour._executors import Crew, map_on, open_engine, workers_of
from armcontour._pool import ProcessPool, Worker
from armcontour._process import ProcessEnded
from armcontour._processes import WorkAhead, map_in_processes
from armcontour.errors import ExecutionError

halve = partial(truediv, 1.0)
PID = "__import__('os').getpid()"
SLEEP = "__import__('time').sleep({})"


@pytest.fixture
def eager(monkeypatch):
    """Two other processes work ahead from the second item on."""
    monkeypatch.setattr("armcontour._processes.ALONE", 1e-9)
    monkeypatch.setattr("armcontour._processes.processors", lambda: 3)


def work_ahead(work, items):
    """The results of all items, all of which are there at the beginning."""
    with WorkAhead(work) as ahead:
        for k, item in enumerate(items):
            ahead.add(item, (k + 1) / len(items))
        yield from ahead.results()


def test_work_ahead_comes_in_order_from_all_processes(eager):
    items = [f"({SLEEP.format(0.02)}, {k}, {PID})[1:]" for k in range(60)]
    found = list(work_ahead(eval, items))
    assert [k for k, _ in found] == list(range(60))
    assert len({pid for _, pid in found}) == 3
    # The first error comes in its place.
    found = work_ahead(halve, [1.0] * 20 + [0.0] + [1.0] * 10 + ["x"])
    assert [next(found) for _ in range(20)] == [1.0] * 20
    with pytest.raises(ZeroDivisionError):
        next(found)
    with pytest.raises(ExecutionError, match="has ended"):
        map_in_processes(sys.exit, [3] * 20, processes=2)


def test_a_pool_that_is_ended_waits_for_nothing():
    pool = ProcessPool(2)
    assert pool.submit(eval, "1").result() == 1
    away = [pool.submit(eval, SLEEP.format(600)) for _ in range(3)]
    begin = time.monotonic()
    pool.end()
    assert time.monotonic() - begin < 60 and all(x.done() for x in away)
    with pytest.raises(RuntimeError, match="shut down"):
        pool.submit(abs, 1)
    # Work that has not begun can be given up.
    pool = ProcessPool(1)
    slow = [pool.submit(eval, SLEEP.format(0.3)) for _ in range(9)]
    pool.shutdown(cancel_futures=True)
    assert sum(x.cancelled() for x in slow) >= 7


def test_a_process_of_a_pool_that_ends_costs_its_work_only():
    with ProcessPool(1) as pool:
        found = [pool.submit(eval, x) for x in ("1", "__import__('os')._exit(3)", "2")]
        with pytest.raises(ProcessEnded) as caught:
            found[1].result()
        assert (found[0].result(), found[2].result()) == (1, 2)
        assert 0 <= caught.value.after < 60


def test_a_worker_reports_and_continues_after_errors_until_it_is_ended():
    worker, told = Worker(eval), []
    tell = "__import__('armcontour._process', fromlist=['tell']).tell"
    assert worker.do(f"[{tell}(x) for x in 'ab'] and 3", told.append) == 3
    assert told == ["a", "b"]
    with pytest.raises(RuntimeError, match="ZeroDivisionError"):
        worker.do("1 / 0", told.append)
    assert worker.do("4", told.append) == 4
    Timer(0.3, worker.end).start()
    with pytest.raises(ProcessEnded):
        worker.do(SLEEP.format(60), print)
    worker.close()


@pytest.mark.parametrize("own", [True, False])
def test_executors_of_processes(own):
    pool = ProcessPool(1) if own else ProcessPoolExecutor(1, mp_context=get_context("spawn"))
    assert workers_of(pool) == 1
    with pool:
        assert len(set(map_on(pool, eval, [PID] * 20)) - {os.getpid()}) == 1
        with Crew(eval, pool) as crew:
            for text in [SLEEP.format(0.2), *["1"] * 20]:
                crew.give(text)
        assert pool.submit(eval, "2").result() == 2 and len(crew) == 21
        with pytest.raises(ExecutionError, match=r"has ended before it gave an answer.*memory"):
            map_on(pool, eval, ["__import__('os')._exit(3)"])
    with pytest.raises(ExecutionError, match="takes no work .*: give one that is open"):
        map_on(pool, halve, [1])
    with open_engine(workers=2) as engine:
        assert (engine.workers, engine.mortal, engine.name) == (2, True, "2 processes")
    with pytest.raises(RuntimeError, match="shut down"):
        engine.executor.submit(abs, 1)


def test_commands_end_without_garbage_collection():
    """It takes as long as all else at the end, where compiled functions are loaded."""
    told = "import atexit, gc, sys; atexit.register(lambda: print(gc.get_freeze_count() > 0))"
    command = "sys.argv = ['armcontour', 'arms']; from armcontour.cli import main; main()"
    call = [sys.executable, "-c", f"{told}; {command}"]
    done = subprocess.run(call, capture_output=True, text=True, check=True)
    assert "ur5e" in done.stdout and done.stdout.endswith("\nTrue\n")
