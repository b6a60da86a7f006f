"""Processes and executors: order, errors, and processes that end."""

import os
import signal
import subprocess
import sys
import time
from concurrent.futures import BrokenExecutor, ProcessPoolExecutor
from contextlib import suppress
from functools import partial
from multiprocessing import get_context
from operator import truediv
from pathlib import Path

import pytest
from tests.slow.studio.test_workers import is_running

from armcontour.core import pool
from armcontour.core.pool import (
    ProcessEnded,
    ProcessPool,
    map_in_order,
    map_in_processes,
    run_all,
)

halve = partial(truediv, 1.0)
PID = "__import__('os').getpid()"
SLEEP = "__import__('time').sleep({})"


def test_items_are_distributed_to_all_processes(monkeypatch):
    monkeypatch.setattr(pool, "PROCESS_START_TIME", 1e-9)
    monkeypatch.setattr(pool, "TRANSFER_TIME", 0.0)
    monkeypatch.setattr(pool, "processors", lambda: 2)
    items = [f"({SLEEP.format(0.02)}, {k}, {PID})[1:]" for k in range(200)]
    pairs = list(map_in_order(eval, items))
    assert [k for k, _ in pairs] == list(range(200))
    assert len({pid for _, pid in pairs}) == 3
    with pytest.raises(ProcessEnded, match=r"EXIT\(3\)"):
        map_in_processes(eval, ["__import__('os')._exit(3)"] * 20, processes=2)


def test_ending_a_pool_does_not_wait():
    with ProcessPool(2) as pool:
        assert pool.submit(eval, "1").result() == 1
        slow = [pool.submit(eval, SLEEP.format(600)) for _ in range(3)]
        begin = time.monotonic()
    assert time.monotonic() - begin < 60 and all(x.done() for x in slow)
    with pytest.raises(RuntimeError, match="shutdown"):
        pool.submit(abs, 1)


def test_only_the_item_whose_process_ends_is_lost():
    items = ["1", "__import__('os')._exit(3)", *["(__import__('time').sleep(0.1), 2)[1]"] * 9]
    with ProcessPool(2) as pool:
        results = run_all(eval, partial(next, iter(items), None), pool, lambda error: error)
        found = dict(results)
    assert found.pop(items[1]).startswith("A process ended before its work was done (EXIT(3))")
    assert found == {"1": 1, items[2]: 2}


def test_other_executors_of_processes_are_supported():
    pool = ProcessPoolExecutor(1, mp_context=get_context("spawn"))
    with pool:
        assert len(set(map_in_processes(eval, [PID] * 20, executor=pool)) - {os.getpid()}) == 1
        with pytest.raises(BrokenExecutor, match="terminated abruptly"):
            map_in_processes(eval, ["__import__('os')._exit(3)"], executor=pool)
    with pytest.raises(RuntimeError, match="terminated|shutdown"):
        map_in_processes(halve, [1], executor=pool)


# A program that has two busy processes; it prints their ids.
BUSY = """
import os, sys, time
from concurrent.futures import wait
from armcontour.core.pool import ProcessPool
with ProcessPool(2) as pool:
    pool.submit(abs, 1).result()
    print(*pool._pool._processes, flush=True)
    wait([pool.submit(time.sleep, 600) for _ in range(2)])
"""


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
def test_processes_end_with_the_program_that_started_them(number, tmp_path):
    (tmp_path / "busy.py").write_text(BUSY)
    program = subprocess.Popen(
        [sys.executable, "busy.py"],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    with program:
        pids = {int(x) for x in program.stdout.readline().split()}
        assert len(pids) == 2 and all(map(is_running, pids))
        # Ctrl-C reaches all processes of the terminal.
        (os.killpg if number == signal.SIGINT else os.kill)(program.pid, number)
        program.wait(20)
        end = time.monotonic() + 20
        # Also wait for the helper processes that release resources.
        while any(map(is_running, pids)) or processes_of(program.pid):
            assert time.monotonic() < end
            time.sleep(0.05)


def processes_of(session):
    """Ids of the running processes that a program has started."""
    return {
        int(x.name)
        for x in Path("/proc").iterdir()
        if x.name.isdigit() and is_running(x.name) and session_of(x.name) == session
    }


def session_of(pid):
    with suppress(OSError):
        return os.getsid(int(pid))
