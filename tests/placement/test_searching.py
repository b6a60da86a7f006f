"""The search finds the same whoever works, and in whatever order the answers come."""

import random
from concurrent.futures import Executor, Future
from dataclasses import dataclass
from functools import partial
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import armcontour as ac
from armcontour import _pool
from armcontour._pool import InProcess
from armcontour.errors import ExecutionError, InvalidInput
from armcontour.io import placement_csv
from armcontour.placement.judging import Trail, Verdict
from armcontour.placement.screening import Screened
from armcontour.placement.searching import best_of, search


class Untidy(Executor):
    """Works on what it was given when somebody waits for it, in any order."""

    _max_workers = 4

    def __init__(self, seed):
        self.random, self.waiting, self.count = random.Random(seed), [], 0

    def submit(self, fn, /, *args, **kwargs):
        future = Future()
        self.count += 1
        self.waiting.append((future, fn, args))
        return future

    def wait(self, futures, **more):
        """Do one piece of work or several, in place of waiting for them."""
        for _ in range(self.random.randint(1, len(self.waiting))):
            future, fn, args = self.waiting.pop(self.random.randrange(len(self.waiting)))
            if future.set_running_or_notify_cancel():
                future.set_result(fn(*args))


def untidily(seed, call, **given):
    """The result of a call with an executor that answers in any order, and its pieces of work."""
    executor = Untidy(seed)
    with patch.object(_pool, "wait_for", executor.wait):
        return call(executor=executor, **given), executor.count


FEW = {"x": (-0.1, 0.1, 3)}


@dataclass(frozen=True)
class Known:
    """Judges places of which bounds and durations are known; some bounds may not hold."""

    bounds: tuple[float, ...]
    durations: tuple[float, ...]
    screen: Any = True
    objective: str = "cycle"

    def look_all(self, places):
        return [
            Screened(refusal="reach")
            if np.isinf(self.durations[int(x["x"])])
            else Screened(duration=self.bounds[int(x["x"])])
            for x in places
        ]

    def least_score(self, seen):
        return seen.duration

    def weigh(self, place, cutoff):
        k = int(place["x"])
        bound = Verdict(bound=self.bounds[k])
        steps = [(self.bounds[k], bound), (self.bounds[k] + 0.5, Verdict(bound=bound.bound + 0.5))]
        for i, x in enumerate(steps):
            if x[0] > cutoff:
                return Trail(tuple(steps[: i + 1]))
        return Trail((*steps, (np.inf, Verdict(duration=self.durations[k]))))


places = st.lists(
    st.tuples(st.integers(1, 9), st.sampled_from([-2, 0, 0.5, 1, 3, np.inf])),
    min_size=1,
    max_size=40,
)


@given(places, st.booleans(), st.integers(0, 99))
def test_the_order_of_answers_changes_nothing(given, every, seed):
    judge = Known(tuple(float(b) for b, _ in given), tuple(float(b + more) for b, more in given))
    grid = [{"x": float(k)} for k in range(len(given))]
    tell = []
    alone = search(judge, grid, every=every, processes=1, progress=lambda x: tell.append(x.done))
    shuffled = partial(search, judge, grid, every=every, progress=lambda x: None)
    found, _ = untidily(seed, shuffled)
    # As text, as what is unknown is not a number.
    assert str(found) == str(alone)
    if all(more >= 0.5 for _, more in given):
        # With bounds that hold the best is that of all.
        best = best_of(alone, "cycle")
        finite = [x for x in judge.durations if np.isfinite(x)]
        assert (best is None) == (not finite)
        assert best is None or judge.durations[best] == min(finite)
    assert tell[-1] == 1.0


@pytest.mark.parametrize(
    "more",
    [
        {"over": {"x": (-0.35, 0.45, 5), "y": (-0.25, 0.25, 3)}},
        {"uncertainty": {"x": 2e-3}, "over": FEW},
        {"objective": "manipulability", "over": FEW},
        {"every": True, "over": FEW},
    ],
)
def test_the_table_is_the_same_byte_for_byte(square, more):
    alone = ac.place(square, processes=1, refined=False, **more)
    found, count = untidily(3, partial(ac.place, square, refined=False, **more))
    assert placement_csv(found) == placement_csv(alone) and count > 1
    assert found.best.values == alone.best.values and str(found) == str(alone)


class Losing(InProcess):
    """Loses its worker after some work."""

    def __init__(self, after):
        self.left = after

    def submit(self, fn, /, *args, **kwargs):
        self.left -= 1
        if self.left >= 0:
            return super().submit(fn, *args, **kwargs)
        future = Future()
        future.cancel()
        return future


def test_a_lost_worker_is_an_error(square, refuses):
    lost = "A worker of the executor has ended before"
    for after in (0, 2):
        with pytest.raises(ExecutionError, match=lost):
            ac.place(square, over=FEW, executor=Losing(after))
    with pytest.raises(InvalidInput, match="An executor has its own workers"):
        ac.place(square, over=FEW, executor=InProcess(), processes=2)
