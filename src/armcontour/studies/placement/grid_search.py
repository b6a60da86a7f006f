"""Search for the best place of a grid by bounds and plans, and refinement between grid points.

The result does not depend on the workers: in the order of their bounds, places are compared with
the best place before them.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import Counter
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from functools import partial
from typing import TypeAlias, cast

import numpy as np

from armcontour.core.child_process import is_child
from armcontour.core.pool import TaskQueue, open_executor
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

# Number of places per task without plans, about 0.25 s.
CHUNK = 32
# Smallest number of places for which other processes are started.
MIN_PLACES = 100

# Indices of places and, for a plan, the cutoff of its score.
Task: TypeAlias = tuple[tuple[int, ...], float | None]
Answer: TypeAlias = list[PlaceBounds] | CutoffVerdicts
Coordinates: TypeAlias = Mapping[str, float]


def search_grid(
    evaluator: PlaceEvaluator,
    places: Sequence[Coordinates],
    *,
    every: bool = False,
    processes: int | None = None,
    executor: Executor | None = None,
    progress: Progress,
) -> list[Verdict]:
    """Find the best of some places; bounds of the others prove it.

    With `every`, all places are planned. `processes` is by default that of the machine for many
    places, otherwise 1.
    """
    if processes is None and (len(places) < MIN_PLACES or is_child()):
        processes = 1
    workers = None if executor else 0 if processes == 1 else processes
    with open_executor(workers, executor=executor) as opened:
        with TaskQueue[Task, Answer](partial(_work, evaluator, tuple(places)), opened) as queue:
            return _Search(evaluator, len(places), every, progress).run(queue)


def best_of(verdicts: Sequence[Verdict], objective: str) -> int | None:
    """Index of the first place with the smallest score; None if no place has a plan."""
    scores = np.array([x.score(objective) for x in verdicts])
    best = int(np.argmin(scores))
    return best if np.isfinite(scores[best]) else None


def _work(evaluator: PlaceEvaluator, places: Sequence[Coordinates], task: Task) -> Answer:
    """Find bounds of some places, or evaluate one."""
    indices, cutoff = task
    if cutoff is None:
        return evaluator.bounds_of([places[k] for k in indices])
    return evaluator.evaluate(places[indices[0]], cutoff)


class _Search:
    """One call of `search_grid`."""

    def __init__(
        self, evaluator: PlaceEvaluator, count: int, every: bool, progress: Progress
    ) -> None:
        self.verdicts = [Verdict() for _ in range(count)]
        self._evaluator, self._every, self._progress = evaluator, every, progress
        # Lower bounds of scores, and indices, of places that may be planned; and the best score,
        # including places planned ahead of their turn.
        self._candidates: list[tuple[float, int]] = []
        self._best, self._refused = np.inf, Counter[str]()

    def run(self, queue: TaskQueue[Task, Answer]) -> list[Verdict]:
        """Find bounds of all places, then plan those that may be the best."""
        if self._evaluator.screen is None:
            self._candidates = [(-np.inf, k) for k in range(len(self.verdicts))]
        else:
            self._find_bounds(queue)
        self._plan(queue)
        return self.verdicts

    def _find_bounds(self, queue: TaskQueue[Task, Answer]) -> None:
        """Find bounds of all places."""
        count, done = len(self.verdicts), 0
        parts = (tuple(range(k, min(k + CHUNK, count))) for k in range(0, count, CHUNK))
        for (indices, _), answer in queue.run_all((x, None) for x in parts):
            for k, bounds in zip(indices, cast(list[PlaceBounds], answer), strict=True):
                self._add_bounds(k, bounds)
            done += len(indices)
            self._report("bounds", done / count)

    def _add_bounds(self, k: int, bounds: PlaceBounds) -> None:
        """Store the bounds of a place."""
        least = self._evaluator.least_score(bounds)
        bound = least if self._evaluator.objective == DURATION else 0.0
        self.verdicts[k] = Verdict(bound=bound, singular=bounds.singular, refusal=bounds.refusal)
        if bounds.refusal:
            self._refused[bounds.refusal] += 1
        else:
            self._candidates.append((least, k))

    def _plan(self, queue: TaskQueue[Task, Answer]) -> None:
        """Plan places in the order of their bounds until no other place can be better."""
        self._candidates.sort()
        bounds, turns = [x for x, _ in self._candidates], [k for _, k in self._candidates]
        # Results before their turn; and the best score of the places before `turn`.
        early: dict[int, CutoffVerdicts] = {}
        best, next_turn, turn = np.inf, 0, 0
        while self._can_beat(turn, best):
            while len(queue) < queue.ahead and self._can_beat(next_turn, self._best):
                queue.give(((turns[next_turn],), self._cutoff(self._best)))
                next_turn += 1
            if not len(queue):
                # The bound of a place that was planned ahead exceeds its plan, so other places are
                # candidates again.
                queue.give(((turns[turn],), self._cutoff(best)))
                next_turn = max(next_turn, turn + 1)
            for (indices, _), answer in queue.take():
                result = early[indices[0]] = cast(CutoffVerdicts, answer)
                self._best = min(self._best, result.last.score(self._evaluator.objective))
            while turn < next_turn and turns[turn] in early and self._can_beat(turn, best):
                verdict = early.pop(turns[turn]).for_cutoff(self._cutoff(best))
                if verdict is None:
                    break
                best = min(best, verdict.score(self._evaluator.objective))
                self.verdicts[turns[turn]] = verdict
                if verdict.refusal:
                    self._refused[verdict.refusal] += 1
                turn += 1
            needed = len(turns) if self._every else bisect_right(bounds, best)
            self._report("plans", turn / max(needed, turn, 1))
        self._best = best

    def _can_beat(self, turn: int, score: float) -> bool:
        """True if the candidate of a turn exists and may have a better score."""
        return turn < len(self._candidates) and (self._every or self._candidates[turn][0] <= score)

    def _cutoff(self, score: float) -> float:
        """Score above which a place is not planned."""
        return np.inf if self._every else score

    def _report(self, name: str, share: float) -> None:
        """Report the completed share, the best score so far, and refusals by kind."""
        words = [name]
        if np.isfinite(self._best):
            words.append(f"best so far {format_score(self._best, self._evaluator.objective)}")
        words += [f"{n} refused by {kind}" for kind, n in self._refused.most_common()]
        self._progress(Step((", ".join(words),), share))


def format_score(score: float, objective: str) -> str:
    """The figure of a score, with its unit."""
    _, unit = COMPARED[objective]
    return number(score if objective == DURATION else -score, unit)


# Last steps of the refinement as a share of those of the grid; the first are half of them.
FINEST = 1 / 16
# Largest number of evaluated places of the refinement.
MAX_TRIALS = 200
# Relative improvement of the score from which a place is better.
LEAST_GAIN = 1e-6


def refine(
    evaluator: PlaceEvaluator,
    axes: Sequence[Axis],
    place: Mapping[str, float],
    verdict: Verdict,
    progress: Progress,
) -> tuple[dict[str, float], Verdict]:
    """Pattern search from the best place of the grid within the ranges of the axes.

    Every better place is planned completely.
    """
    current, best, score = dict(place), verdict, verdict.score(evaluator.objective)
    varied = [x for x in axes if x.step > 0]
    share, trials = 0.5, 0
    while varied and share >= FINEST:
        gained = False
        for axis in varied:
            for sign in (1, -1):
                neighbour = _neighbour(current, axis, sign * share)
                if neighbour == current or trials >= MAX_TRIALS:
                    continue
                trials += 1
                progress(Step((f"refining, {format_score(score, evaluator.objective)}",)))
                cutoff = score - LEAST_GAIN * abs(score)
                trial = evaluator.evaluate(neighbour, cutoff).last
                if trial.score(evaluator.objective) < cutoff:
                    current, best, score = neighbour, trial, trial.score(evaluator.objective)
                    gained = True
                    break
        if not gained:
            share /= 2
    return current, best


def _neighbour(place: Mapping[str, float], axis: Axis, steps: float) -> dict[str, float]:
    """Place some grid steps away along an axis, within its range."""
    low, high = float(axis.values[0]), float(axis.values[-1])
    if axis.whole_turn:
        low, high = -float("inf"), float("inf")
    return {**place, axis.name: min(max(place[axis.name] + steps * axis.step, low), high)}
