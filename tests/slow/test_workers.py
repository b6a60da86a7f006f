"""Processes and clusters: order, errors, and processes that end, that are slow or killed."""

import os
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context, resource_tracker
from operator import truediv
from threading import Timer

import pytest

from armcontour.core import pool
from armcontour.core.child_process import ProcessEnded
from armcontour.core.errors import ExecutionError
from armcontour.core.pool import (
    ProcessPool,
    TaskQueue,
    count_workers,
    map_in_order,
    map_in_processes,
    open_executor,
)

halve = partial(truediv, 1.0)
PID = "__import__('os').getpid()"
SLEEP = "__import__('time').sleep({})"
# A process that multiprocessing starts once, and keeps until Python ends.
resource_tracker.ensure_running()


def test_moves_are_shared_by_all_processes(monkeypatch):
    monkeypatch.setattr(pool, "START", 1e-9)
    monkeypatch.setattr(pool, "processors", lambda: 2)
    items = [f"({SLEEP.format(0.02)}, {k}, {PID})[1:]" for k in range(200)]
    pairs = list(map_in_order(eval, items))
    assert [k for k, _ in pairs] == list(range(200))
    assert len({pid for _, pid in pairs}) == 3
    with pytest.raises(ExecutionError, match="ended before"):
        map_in_processes(sys.exit, [3] * 20, processes=2)


def test_a_pool_that_is_ended_waits_for_nothing():
    pool = ProcessPool(2)
    assert pool.submit(eval, "1").result() == 1
    away = [pool.submit(eval, SLEEP.format(600)) for _ in range(3)]
    begin = time.monotonic()
    pool.end()
    assert time.monotonic() - begin < 60 and all(x.done() for x in away)
    with pytest.raises(RuntimeError, match="shutdown"):
        pool.submit(abs, 1)
    # Work that has not begun can be given up.
    pool = ProcessPool(1)
    slow = [pool.submit(eval, SLEEP.format(0.3)) for _ in range(9)]
    pool.shutdown(cancel_futures=True)
    assert sum(x.cancelled() for x in slow) >= 7


def test_a_pool_that_is_killed_goes_on():
    with ProcessPool(1) as pool:
        slow = pool.submit(eval, SLEEP.format(600))
        Timer(0.3, pool.kill).start()
        with pytest.raises(ProcessEnded):
            slow.result()
        assert pool.submit(abs, -1).result() == 1


@pytest.mark.parametrize("own_pool", [True, False])
def test_executors_of_processes(own_pool):
    pool = ProcessPool(1) if own_pool else ProcessPoolExecutor(1, mp_context=get_context("spawn"))
    assert count_workers(pool) == 1
    with pool:
        assert len(set(map_in_processes(eval, [PID] * 20, executor=pool)) - {os.getpid()}) == 1
        with TaskQueue(eval, pool) as crew:
            for text in [SLEEP.format(0.2), *["1"] * 20]:
                crew.give(text)
        assert pool.submit(eval, "2").result() == 2 and len(crew) == 21
        with pytest.raises(ExecutionError, match=r"ended before it returned a result.*memory"):
            map_in_processes(eval, ["__import__('os')._exit(3)"], executor=pool)
    with pytest.raises(ExecutionError, match="accepts no work .*: it must be open"):
        map_in_processes(halve, [1], executor=pool)
    with open_executor(2) as opened:
        assert count_workers(opened) == 2
    with pytest.raises(RuntimeError, match="shutdown"):
        opened.submit(abs, 1)
