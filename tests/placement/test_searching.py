"""The search finds the same whoever works, and in whatever order the answers come."""

from __future__ import annotations

import random
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from dataclasses import dataclass
from threading import Timer
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import armcontour as ac
from armcontour._executors import InProcess
from armcontour.errors import ExecutionError, InvalidInput
from armcontour.io import placement_csv
from armcontour.jobs import Job
from armcontour.placement.judging import Trail, Verdict
from armcontour.placement.screening import Screened
from armcontour.placement.searching import best_of, search


class Untidy(Executor):
    """Works on what it was given in a while, in any order."""

    _max_workers = 4

    def __init__(self, seed: int) -> None:
        self.random, self.waiting = random.Random(seed), []
        self.count = 0

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        self.count += 1
        self.waiting.append((future, fn, args))
        Timer(1e-3, self._work).start()
        return future

    def _work(self) -> None:
        if self.waiting:
            future, fn, args = self.waiting.pop(self.random.randrange(len(self.waiting)))
            if future.set_running_or_notify_cancel():
                future.set_result(fn(*args))


@dataclass(frozen=True)
class Known:
    """Judges places of which bounds and durations are known; some bounds may not hold."""

    bounds: tuple[float, ...]
    durations: tuple[float, ...]
    screen: Any = True
    objective: str = "cycle"

    def look_all(self, places: Sequence[Mapping[str, float]]) -> list[Screened]:
        return [
            Screened(refusal="reach")
            if np.isinf(self.durations[int(x["x"])])
            else Screened(duration=self.bounds[int(x["x"])])
            for x in places
        ]

    def least_score(self, seen: Screened) -> float:
        return seen.duration

    def weigh(self, place: Mapping[str, float], cutoff: float) -> Trail:
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


@settings(deadline=None, max_examples=40)
@given(places, st.booleans(), st.integers(0, 99))
def test_the_order_of_answers_changes_nothing(given, every, seed):
    judge = Known(tuple(float(b) for b, _ in given), tuple(float(b + more) for b, more in given))
    grid = [{"x": float(k)} for k in range(len(given))]
    tell: list[float] = []
    alone = search(judge, grid, every=every, processes=1, progress=lambda x: tell.append(x.done))
    found = search(judge, grid, every=every, executor=Untidy(seed), progress=lambda x: None)
    # As text, as what is unknown is not a number.
    assert str(found) == str(alone)
    if all(more >= 0.5 for _, more in given):
        # With bounds that hold the best is that of all.
        best = best_of(alone, "cycle")
        finite = [x for x in judge.durations if np.isfinite(x)]
        assert (best is None) == (not finite) and (
            best is None or judge.durations[best] == min(finite)
        )
    assert tell[-1] == 1.0


OVER = {"x": (-0.35, 0.45, 9), "y": (-0.25, 0.25, 5)}


@pytest.mark.parametrize(
    "more",
    [
        {},
        {"uncertainty": {"x": 2e-3}, "over": {"x": (-0.1, 0.1, 3)}},
        {"objective": "manipulability"},
        {"every": True, "over": {"x": (-0.1, 0.1, 3)}},
    ],
)
def test_the_table_is_the_same_byte_for_byte(square: Job, more: dict[str, Any]) -> None:
    asked = {"over": OVER, "refined": False, **more}
    alone = ac.place(square, processes=1, **asked)
    untidy = Untidy(3)
    found = ac.place(square, executor=untidy, **asked)
    assert placement_csv(found) == placement_csv(alone) and untidy.count > 1
    assert found.best.values == alone.best.values and str(found) == str(alone)


def test_threads_and_processes_find_the_same(square: Job) -> None:
    alone = ac.place(square, over=OVER, processes=1)
    with ThreadPoolExecutor(3) as threads:
        found = ac.place(square, over=OVER, executor=threads)
    pool = ac.place(square, over=OVER, processes=2)
    assert placement_csv(found) == placement_csv(pool) == placement_csv(alone)
    assert found.refined.values == pool.refined.values == alone.refined.values


class Losing(InProcess):
    """Loses its worker after some work."""

    def __init__(self, after: int) -> None:
        self.left = after

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        self.left -= 1
        if self.left >= 0:
            return super().submit(fn, *args, **kwargs)
        future: Future[Any] = Future()
        future.cancel()
        return future


@pytest.mark.parametrize("after", [0, 3])
def test_a_lost_worker_is_one_sentence(square: Job, after: int) -> None:
    with pytest.raises(ExecutionError, match="A worker of the executor has ended before"):
        ac.place(square, over=OVER, executor=Losing(after))


def test_an_executor_goes_with_no_number_of_processes(square: Job) -> None:
    with pytest.raises(InvalidInput, match="An executor has its own workers: leave processes out"):
        ac.place(square, over=OVER, executor=InProcess(), processes=2)
