"""Work on many items in other processes."""

import os
import subprocess
import sys
import time
from functools import partial
from operator import truediv
from threading import Barrier, Condition, Event, Timer, current_thread

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import armcontour as ac
from armcontour._pool import STARTS, ProcessPool, Worker
from armcontour._process import ProcessEnded, pack, unpack
from armcontour._processes import WorkAhead, map_in_processes, share_work
from armcontour._threads import Beside, do_both, map_in_threads, split_evenly

# Functions that other processes can import.
halve = partial(truediv, 1.0)


@pytest.mark.parametrize("processes", [1, 2])
def test_results_come_in_order(processes):
    told = []
    items = list(range(1, 31))
    found = map_in_processes(halve, items, processes=processes, done=told.append)
    assert found == [1 / x for x in items]
    assert len(told) == 30 and max(told) in (29, 30)


def test_an_error_ends_the_work_with_its_text():
    with pytest.raises(RuntimeError, match="ZeroDivisionError"):
        map_in_processes(halve, [1.0] * 20 + [0.0], processes=2)
    with pytest.raises(ZeroDivisionError):
        map_in_processes(halve, [0.0])


def test_a_process_that_ends_is_said():
    with pytest.raises(ac.ExecutionError, match="has ended"):
        map_in_processes(sys.exit, [3] * 20, processes=2)


def test_threads_give_results_in_order_and_their_errors(monkeypatch):
    monkeypatch.setattr("armcontour._processes.processors", lambda: 3)
    assert map_in_threads(halve, list(range(1, 31))) == [1 / x for x in range(1, 31)]
    assert map_in_threads(halve, []) == []
    with pytest.raises(ZeroDivisionError):
        map_in_threads(halve, [1.0, 0.0, 2.0])


@pytest.mark.parametrize("count", [1, 2])
def test_work_beside_comes_in_order_with_its_errors(monkeypatch, count):
    monkeypatch.setattr("armcontour._threads.processors", lambda: count)
    where = []
    with Beside() as beside:
        first = beside.start(lambda: where.append(current_thread()) or 1)
        fails = beside.start(partial(halve, 0.0))
        last = beside.start(lambda: where.append(current_thread()) or 2)
        assert (last(), first()) == (2, 1)
        with pytest.raises(ZeroDivisionError):
            fails()
    assert where[0] is where[1]
    assert (where[0] is current_thread()) == (count == 1)
    if count == 2:
        where[0].join(10)
        assert not where[0].is_alive()


def test_work_beside_that_has_not_begun_is_dropped(monkeypatch):
    monkeypatch.setattr("armcontour._threads.processors", lambda: 2)
    begun, go, done = Event(), Event(), []
    with Beside() as beside:
        beside.start(lambda: (begun.set(), done.append(current_thread()), go.wait()))
        beside.start(lambda: done.append("dropped"))
        assert begun.wait(10)
    go.set()
    done[0].join(10)
    assert not done[0].is_alive() and len(done) == 1


def test_both_have_ended_whatever_fails():
    # Each waits for the other.
    both = Barrier(2)
    found = do_both(lambda: (both.wait(10), "other")[1], lambda: (both.wait(10), "own")[1])
    assert found == ("other", "own")
    done = []
    with pytest.raises(ZeroDivisionError):
        do_both(lambda: (time.sleep(0.05), done.append(1)), partial(halve, 0.0))
    assert done == [1]
    with pytest.raises(ZeroDivisionError):
        do_both(partial(halve, 0.0), lambda: None)


@given(st.integers(0, 100), st.integers(1, 20))
def test_even_parts_make_up_the_whole(count, parts):
    found = [list(range(count))[x] for x in split_evenly(count, parts)]
    assert sum(found, []) == list(range(count))
    assert max(map(len, found)) - min(map(len, found)) <= 1


@pytest.fixture
def eager(monkeypatch):
    """Two other processes work ahead from the second item on."""
    monkeypatch.setattr("armcontour._processes.ALONE", 1e-9)
    monkeypatch.setattr("armcontour._processes.processors", lambda: 3)


# What `eval` of these items gives tells which process it was.
SLOW = "(__import__('time').sleep(0.02), {}, __import__('os').getpid())[1:]"


def work_ahead(work, items):
    """The results of all items, all of which are there at the beginning."""
    with WorkAhead(work) as ahead:
        for k, item in enumerate(items):
            ahead.add(item, (k + 1) / len(items))
        yield from ahead.results()


def test_work_ahead_comes_in_order_from_all_processes(eager):
    found = list(work_ahead(eval, [SLOW.format(k) for k in range(60)]))
    assert [k for k, _ in found] == list(range(60))
    assert len({pid for _, pid in found}) == 3


def test_work_ahead_raises_the_first_error_in_its_place(eager):
    found = work_ahead(halve, [1.0] * 20 + [0.0] + [1.0] * 10 + ["x"])
    assert [next(found) for _ in range(20)] == [1.0] * 20
    with pytest.raises(ZeroDivisionError):
        next(found)


def test_what_others_cannot_do_is_done_here(eager):
    assert list(work_ahead(lambda x: x + 1, range(30))) == list(range(1, 31))
    ends = f"__import__('os').getpid() == {os.getpid()} or __import__('os')._exit(1)"
    assert list(work_ahead(eval, [ends] * 30)) == [True] * 30


def test_little_work_stays_here():
    found = work_ahead(eval, ["__import__('os').getpid()"] * 100)
    assert set(found) == {os.getpid()}


def test_packed_arrays_are_read_only():
    values = np.arange(3.0)
    found = unpack(pack({"values": values}))["values"]
    assert np.array_equal(found, values) and not found.flags.writeable


class Unpackable:
    """What can be packed, but not unpacked."""

    def __reduce__(self):
        return int, ("x",)


class Halves:
    """Numbers, of which each comes after its half."""

    def __init__(self, numbers):
        self.left, self.away, self.found = list(numbers), set(), {}
        self.news = Condition()

    def take(self):
        with self.news:
            while self.left:
                undone = {*self.left, *self.away}
                for x in self.left:
                    if x / 2 not in undone:
                        self.left.remove(x)
                        self.away.add(x)
                        return x
                self.news.wait()

    def finish(self, item, result):
        with self.news:
            self.away.remove(item)
            self.found[item] = result
            self.news.notify_all()

    def give_up(self):
        with self.news:
            self.left.clear()
            self.news.notify_all()


def test_items_come_in_an_order_that_depends_on_what_is_done():
    order = Halves([8, 4, 3, 2, 1])
    share_work(halve, order, processes=2)
    assert order.found == {x: 1 / x for x in (1, 2, 3, 4, 8)}
    assert list(order.found).index(1) < list(order.found).index(2) < list(order.found).index(4)


def test_nobody_waits_for_a_process_that_has_ended():
    # The number 2 waits for 1, which ends its process.
    order = Halves([2, 1])
    with pytest.raises(ac.ExecutionError, match="has ended"):
        share_work(sys.exit, order, processes=2)
    assert order.found == {}


def test_a_frozen_application_does_all_itself(monkeypatch, eager):
    # `sys.executable` is the application there, which is no Python to start.
    monkeypatch.setattr(sys, "frozen", True, raising=False)
    here = [os.getpid()] * 20
    tell = ["__import__('os').getpid()"] * 20
    assert list(work_ahead(eval, tell)) == here
    assert map_in_processes(eval, tell, processes=2) == here
    order = Halves([8, 4, 3, 2, 1])
    share_work(halve, order, processes=2)
    assert order.found == {x: 1 / x for x in (1, 2, 3, 4, 8)}


PID = "__import__('os').getpid()"


def test_a_pool_is_an_executor_of_other_processes():
    with ProcessPool(2) as pool:
        assert list(pool.map(abs, [-1, 2, -3])) == [1, 2, 3]
        pids = {pool.submit(eval, PID).result() for _ in range(10)}
        assert os.getpid() not in pids and len(pids) <= 2
        # Each of them computes in one thread, and starts no further ones.
        one = "__import__('os').environ['OMP_NUM_THREADS']"
        assert pool.submit(eval, one).result() == "1"
        assert len(set(pool.submit(map_in_processes, eval, [PID] * 20).result())) == 1
        with pytest.raises(RuntimeError, match="ZeroDivisionError"):
            pool.submit(eval, "1 / 0").result()
        # What cannot be sent back, and what the other process cannot unpack.
        with pytest.raises(RuntimeError, match="pickle"):
            pool.submit(eval, "lambda: 1").result()
        with pytest.raises(RuntimeError, match="ValueError"):
            pool.submit(abs, Unpackable()).result()
    with pytest.raises(RuntimeError, match="shut down"):
        pool.submit(abs, 1)


def test_other_processes_import_nothing_from_the_current_folder(tmp_path, monkeypatch):
    for name in ("pickle", "copyreg", "numpy"):
        (tmp_path / f"{name}.py").write_text("raise SystemExit")
    monkeypatch.chdir(tmp_path)
    for folder in ("", ".", str(tmp_path)):
        monkeypatch.syspath_prepend(folder)
    with ProcessPool(1) as pool:
        code = "(__import__('sys').path, __import__('numpy').__file__)"
        path, numpy = pool.submit(eval, code).result()
    assert not {"", ".", str(tmp_path)} & set(path) and numpy == np.__file__


def test_a_pool_that_is_ended_waits_for_nothing():
    pool = ProcessPool(2)
    assert pool.submit(eval, "1").result() == 1
    away = [pool.submit(eval, "__import__('time').sleep(600)") for _ in range(3)]
    begin = time.monotonic()
    pool.end()
    assert time.monotonic() - begin < 60 and all(x.done() for x in away)
    with pytest.raises(RuntimeError, match="shut down"):
        pool.submit(abs, 1)


def test_a_process_of_a_pool_that_ends_costs_its_work_only():
    with ProcessPool(1) as pool:
        found = [pool.submit(eval, x) for x in ("1", "__import__('os')._exit(3)", "2")]
        with pytest.raises(ProcessEnded) as caught:
            found[1].result()
        assert (found[0].result(), found[2].result()) == (1, 2)
        assert 0 <= caught.value.after < 60


def preparing(tmp_path, ends):
    """Work whose first so many processes end before they are ready."""
    file = str(tmp_path / "starts")
    begin = f"open({file!r}, 'a').write('x')"
    # A partial with an attribute stays as it is in another partial.
    work = partial(eval)
    work.prepare = partial(
        eval,
        f"{begin} and __import__('os').path.getsize({file!r}) <= {ends} "
        "and __import__('os')._exit(9)",
    )
    return work


def test_a_process_that_ends_before_it_is_ready_costs_no_work(tmp_path):
    with ProcessPool(1) as pool:
        assert pool.submit(preparing(tmp_path, 2), "6 * 7").result() == 42
    assert (tmp_path / "starts").stat().st_size == 3


def test_processes_are_not_started_for_ever(tmp_path):
    with ProcessPool(1) as pool, pytest.raises(ProcessEnded):
        pool.submit(preparing(tmp_path, 99), "6 * 7").result()
    assert (tmp_path / "starts").stat().st_size == STARTS


def test_a_pool_works_here_where_no_process_can_start(monkeypatch):
    monkeypatch.setattr(sys, "frozen", True, raising=False)
    with ProcessPool(2) as pool:
        assert pool.submit(eval, PID).result() == os.getpid()


def test_work_that_has_not_begun_can_be_given_up():
    pool = ProcessPool(1)
    slow = [pool.submit(eval, "__import__('time').sleep(0.3)") for _ in range(9)]
    pool.shutdown(cancel_futures=True)
    assert sum(x.cancelled() for x in slow) >= 7


class TestWorker:
    def test_it_tells_before_it_answers_and_goes_on_after_errors(self):
        worker, told = Worker(eval), []
        tell = "__import__('armcontour._process', fromlist=['tell']).tell"
        assert worker.do(f"[{tell}(x) for x in 'ab'] and 3", told.append) == 3
        assert told == ["a", "b"]
        with pytest.raises(RuntimeError, match="ZeroDivisionError"):
            worker.do("1 / 0", told.append)
        assert worker.do("4", told.append) == 4
        worker.close()

    def test_another_thread_can_end_it(self):
        worker = Worker(eval)
        timer = Timer(0.3, worker.end)
        timer.start()
        with pytest.raises(ProcessEnded):
            worker.do("__import__('time').sleep(60)", print)
        worker.close()


END = "from armcontour._process import end_at_once; end_at_once()"
RING = """
import sys
class Ring:
    def __del__(self, say=sys.stdout.write):
        say("looked for garbage")
ring = Ring()
ring.own = ring
del ring
"""


def test_a_process_can_end_without_a_last_look_for_garbage() -> None:
    """That look takes as long as all else at the end, where compiled functions are loaded."""
    for first, said in (("", "looked for garbage"), (END, "")):
        call = [sys.executable, "-c", f"{first}{RING}"]
        done = subprocess.run(call, capture_output=True, text=True, check=True)
        assert done.stdout == said and done.stderr == ""


def test_commands_end_so() -> None:
    told = "import atexit, gc, sys; atexit.register(lambda: print(gc.get_freeze_count() > 0))"
    command = "sys.argv = ['armcontour', 'arms']; from armcontour.cli import main; main()"
    call = [sys.executable, "-c", f"{told}; {command}"]
    done = subprocess.run(call, capture_output=True, text=True, check=True)
    assert "ur5e" in done.stdout and done.stdout.endswith("\nTrue\n")
