"""The search over a grid: bounds of all places first, then plans of those that may be the best.

The result does not depend on the number of workers: each place is compared with the best place
before it, in the order of the bounds.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import Counter
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from functools import partial
from typing import TypeAlias, cast

import numpy as np

from armcontour.core.pool import TaskQueue, open_executor
from armcontour.core.process import is_child
from armcontour.core.progress import Progress, Step
from armcontour.core.render import number
from armcontour.jobs.place_search import DURATION, Axis
from armcontour.studies.placement.place_evaluation import (
    COMPARED,
    CutoffVerdicts,
    PlaceEvaluator,
    Verdict,
)
from armcontour.studies.placement.screen import PlaceBounds

# Places that are looked at together without a plan: about a quarter of a second of work.
CHUNK = 32
# With fewer places than this other processes are not worth their start.
FEWEST_PLACES = 100

# Work on places: their indices and, for a plan, the score that it has to beat.
Task: TypeAlias = tuple[tuple[int, ...], float | None]
Answer: TypeAlias = list[PlaceBounds] | CutoffVerdicts
Place: TypeAlias = Mapping[str, float]


def search_grid(
    judge: PlaceEvaluator,
    places: Sequence[Place],
    *,
    every: bool = False,
    processes: int | None = None,
    executor: Executor | None = None,
    progress: Progress,
) -> list[Verdict]:
    """Find the best of some places; the others have bounds that prove it."""
    if processes is None and (len(places) < FEWEST_PLACES or is_child()):
        processes = 1
    workers = None if executor else 0 if processes == 1 else processes
    with open_executor(workers, executor=executor) as opened:
        with TaskQueue[Task, Answer](partial(_work, judge, tuple(places)), opened) as crew:
            return _Search(judge, len(places), every, progress).run(crew)


def best_of(verdicts: Sequence[Verdict], objective: str) -> int | None:
    """Index of the first place of the least score; None if no place has one."""
    scores = np.array([x.score(objective) for x in verdicts])
    best = int(np.argmin(scores))
    return best if np.isfinite(scores[best]) else None


def _work(judge: PlaceEvaluator, places: Sequence[Place], task: Task) -> Answer:
    """Look at some places, or plan one."""
    which, cutoff = task
    if cutoff is None:
        return judge.look_all([places[k] for k in which])
    return judge.weigh(places[which[0]], cutoff)


class _Search:
    """One call of `search_grid`."""

    def __init__(self, judge: PlaceEvaluator, count: int, every: bool, progress: Progress) -> None:
        self.verdicts = [Verdict() for _ in range(count)]
        self._judge, self._every, self._progress = judge, every, progress
        # Least scores and indices of places that may be planned; the best score, also of places
        # that are planned ahead of their turn.
        self._left: list[tuple[float, int]] = []
        self._best, self._refused = np.inf, Counter[str]()

    def run(self, crew: TaskQueue[Task, Answer]) -> list[Verdict]:
        """Look at all places, then plan those that may be the best."""
        if self._judge.screen is None:
            self._left = [(-np.inf, k) for k in range(len(self.verdicts))]
        else:
            self._look(crew)
        self._plan(crew)
        return self.verdicts

    def _look(self, crew: TaskQueue[Task, Answer]) -> None:
        """Find bounds of all places, some of them at a time."""
        count, done = len(self.verdicts), 0
        parts = (tuple(range(k, min(k + CHUNK, count))) for k in range(0, count, CHUNK))
        for (which, _), answer in crew.run_all((x, None) for x in parts):
            for k, seen in zip(which, cast(list[PlaceBounds], answer), strict=True):
                self._looked(k, seen)
            done += len(which)
            self._tell("bounds", done / count)

    def _looked(self, k: int, seen: PlaceBounds) -> None:
        """Keep the bounds of a place."""
        least = self._judge.least_score(seen)
        bound = least if self._judge.objective == DURATION else 0.0
        self.verdicts[k] = Verdict(bound=bound, singular=seen.singular, refusal=seen.refusal)
        if seen.refusal:
            self._refused[seen.refusal] += 1
        else:
            self._left.append((least, k))

    def _plan(self, crew: TaskQueue[Task, Answer]) -> None:
        """Plan places in the order of their bounds, until no other can be better."""
        self._left.sort()
        bounds, turns = [x for x, _ in self._left], [k for _, k in self._left]
        # Trails that wait for their turn; the best score of the places whose turn was.
        trails: dict[int, CutoffVerdicts] = {}
        best, given, turn = np.inf, 0, 0
        while self._can_beat(turn, best):
            while len(crew) < crew.ahead and self._can_beat(given, self._best):
                crew.give(((turns[given],), self._cutoff(self._best)))
                given += 1
            if not len(crew):
                # A bound on a place that was planned ahead was above its plan: others come anew.
                crew.give(((turns[turn],), self._cutoff(best)))
                given = max(given, turn + 1)
            for (which, _), answer in crew.take():
                trail = trails[which[0]] = cast(CutoffVerdicts, answer)
                self._best = min(self._best, trail.last.score(self._judge.objective))
            while turn < given and turns[turn] in trails and self._can_beat(turn, best):
                found = trails.pop(turns[turn]).at(self._cutoff(best))
                if found is None:
                    break
                best = min(best, found.score(self._judge.objective))
                self._judged(turns[turn], found)
                turn += 1
            needed = len(turns) if self._every else bisect_right(bounds, best)
            self._tell("plans", turn / max(needed, turn, 1))
        self._best = best

    def _can_beat(self, turn: int, score: float) -> bool:
        """Whether there is a place at a turn, and it may have a better score."""
        return turn < len(self._left) and (self._every or self._left[turn][0] <= score)

    def _cutoff(self, score: float) -> float:
        """The score that a place has to beat."""
        return np.inf if self._every else score

    def _judged(self, k: int, found: Verdict) -> None:
        """Keep the verdict on a place."""
        self.verdicts[k] = found
        if found.refusal:
            self._refused[found.refusal] += 1

    def _tell(self, name: str, share: float) -> None:
        """Tell the share that is done, the best so far, and refusals by kind."""
        words = [name]
        if np.isfinite(self._best):
            words.append(f"best so far {shown(self._best, self._judge.objective)}")
        words += [f"{n} refused by {kind}" for kind, n in self._refused.most_common()]
        self._progress(Step((", ".join(words),), share))


def shown(score: float, objective: str) -> str:
    """A score as the value that people know."""
    _, unit = COMPARED[objective]
    return number(score if objective == DURATION else -score, unit)


# The first steps are half of the grid's, the last ones this share of them.
FINEST = 1 / 16
# Largest number of places that are looked at.
MOST_TRIALS = 200
# A place is better if its score is less by this share of it.
LEAST_GAIN = 1e-6


def refine(
    judge: PlaceEvaluator,
    axes: Sequence[Axis],
    place: Mapping[str, float],
    verdict: Verdict,
    progress: Progress,
) -> tuple[dict[str, float], Verdict]:
    """Go from a place to better ones beside it, in smaller and smaller steps."""
    here, best, score = dict(place), verdict, verdict.score(judge.objective)
    varied = [x for x in axes if x.step > 0]
    share, trials = 0.5, 0
    while varied and share >= FINEST:
        gained = False
        for axis in varied:
            for way in (1, -1):
                there = _beside(here, axis, way * share)
                if there == here or trials >= MOST_TRIALS:
                    continue
                trials += 1
                progress(Step((f"refining, {shown(score, judge.objective)}",)))
                cutoff = score - LEAST_GAIN * abs(score)
                found = judge.judge(there, cutoff)
                if found.score(judge.objective) < cutoff:
                    here, best, score = there, found, found.score(judge.objective)
                    gained = True
                    break
        if not gained:
            share /= 2
    return here, best


def _beside(place: Mapping[str, float], axis: Axis, steps: float) -> dict[str, float]:
    """A place some steps of the grid away along an axis, within its range."""
    low, high = float(axis.values[0]), float(axis.values[-1])
    if axis.whole_turn:
        low, high = -float("inf"), float("inf")
    return {**place, axis.name: min(max(place[axis.name] + steps * axis.step, low), high)}
