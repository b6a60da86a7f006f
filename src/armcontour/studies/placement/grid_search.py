"""Search for the best place of a grid by bounds and plans, and refinement between grid points.

The result does not depend on the number of workers, because each place is compared with the best of
the places before it in the order of their bounds. A place is a candidate position of the part or
the base: values of the axes of the search.
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
from armcontour.jobs.placement_options import DURATION, Axis
from armcontour.studies.placement.place_evaluation import (
    COMPARED,
    CutoffVerdicts,
    PlaceEvaluator,
    Verdict,
)
from armcontour.studies.placement.screen import PlaceBounds

# Number of places per task that computes bounds, which takes about 0.25 s.
CHUNK = 32
# Smallest number of places for which worker processes are started by default.
MIN_PLACES = 100

# Indices of places, and the cutoff of the score; the cutoff is None if the task is to compute
# bounds.
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
    """Verdicts on places; places that bounds exclude from being the best have no plan.

    `every`: if True, all places are planned. `processes`: number of processes, by default one for
    fewer than MIN_PLACES places, otherwise one per processor.
    """
    if processes is None and (len(places) < MIN_PLACES or is_child()):
        processes = 1
    workers = None if executor else 0 if processes == 1 else processes
    with open_executor(workers, executor=executor) as opened:
        with TaskQueue[Task, Answer](partial(_run_task, evaluator, tuple(places)), opened) as queue:
            return _GridSearch(evaluator, len(places), every, progress).run(queue)


def index_of_best(verdicts: Sequence[Verdict], objective: str) -> int | None:
    """Index of the first place with the smallest score; None if no place has a plan."""
    scores = np.array([x.score(objective) for x in verdicts])
    best = int(np.argmin(scores))
    return best if np.isfinite(scores[best]) else None


def _run_task(evaluator: PlaceEvaluator, places: Sequence[Coordinates], task: Task) -> Answer:
    """Compute the bounds of some places, or evaluate one place."""
    indices, cutoff = task
    if cutoff is None:
        return evaluator.bounds_of([places[k] for k in indices])
    return evaluator.evaluate(places[indices[0]], cutoff)


class _GridSearch:
    """State of one call of `search_grid`."""

    def __init__(
        self, evaluator: PlaceEvaluator, count: int, every: bool, progress: Progress
    ) -> None:
        self.verdicts = [Verdict() for _ in range(count)]
        self._evaluator, self._every, self._progress = evaluator, every, progress
        # _candidates: lower bound of the score, and index, of each place that may be planned.
        # _best: best score, including places that were planned ahead of their turn.
        # _refused: number of refused places by kind.
        self._candidates: list[tuple[float, int]] = []
        self._best, self._refused = np.inf, Counter[str]()

    def run(self, queue: TaskQueue[Task, Answer]) -> list[Verdict]:
        """Compute bounds of all places, then plan the places that may be the best."""
        if self._evaluator.screen is None:
            self._candidates = [(-np.inf, k) for k in range(len(self.verdicts))]
        else:
            self._find_bounds(queue)
        self._plan(queue)
        return self.verdicts

    def _find_bounds(self, queue: TaskQueue[Task, Answer]) -> None:
        """Compute and store the bounds of all places."""
        count, done = len(self.verdicts), 0
        parts = (tuple(range(k, min(k + CHUNK, count))) for k in range(0, count, CHUNK))
        for (indices, _), answer in queue.run_all((x, None) for x in parts):
            for k, bounds in zip(indices, cast(list[PlaceBounds], answer), strict=True):
                self._add_bounds(k, bounds)
            done += len(indices)
            self._report("bounds", done / count)

    def _add_bounds(self, k: int, bounds: PlaceBounds) -> None:
        """Store the bounds of place k; it becomes a candidate unless it is refused."""
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
        # early: results of places before their turn. best: best score of the places before `turn`.
        early: dict[int, CutoffVerdicts] = {}
        best, next_turn, turn = np.inf, 0, 0
        while self._can_beat(turn, best):
            while len(queue) < queue.ahead and self._can_beat(next_turn, self._best):
                queue.give(((turns[next_turn],), self._cutoff(self._best)))
                next_turn += 1
            if not len(queue):
                # `_best` includes a place that was planned ahead and that does not count in its
                # turn, because its bound exceeds the cutoff. So the place of this turn is evaluated
                # for the cutoff of its turn.
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
        """True if there is a candidate for this turn that may have a better score."""
        return turn < len(self._candidates) and (self._every or self._candidates[turn][0] <= score)

    def _cutoff(self, score: float) -> float:
        """Cutoff for a best score: places with a larger bound of the score are not planned."""
        return np.inf if self._every else score

    def _report(self, name: str, share: float) -> None:
        """Report the completed share, the best score so far, and the number of refusals by kind."""
        words = [name]
        if np.isfinite(self._best):
            words.append(f"best so far {format_score(self._best, self._evaluator.objective)}")
        words += [f"{n} refused by {kind}" for kind, n in self._refused.most_common()]
        self._progress(Step((", ".join(words),), share))


def format_score(score: float, objective: str) -> str:
    """Text with the figure of merit of a score, with its unit."""
    _, unit = COMPARED[objective]
    return number(score if objective == DURATION else -score, unit)


# Smallest step of the refinement, as a share of a grid step; the first step is half a grid step.
FINEST_STEP = 1 / 16
# Largest number of evaluated places of the refinement.
MAX_REFINEMENTS = 200
# A place is better if its score is smaller by more than this relative amount.
LEAST_GAIN = 1e-6


def refine(
    evaluator: PlaceEvaluator,
    axes: Sequence[Axis],
    place: Mapping[str, float],
    verdict: Verdict,
    progress: Progress,
) -> tuple[dict[str, float], Verdict]:
    """Best place by a pattern search from the best place of the grid, and its verdict.

    The search stays within the ranges of the axes.
    """
    current, best, score = dict(place), verdict, verdict.score(evaluator.objective)
    varied = [x for x in axes if x.step > 0]
    share, trials = 0.5, 0
    while varied and share >= FINEST_STEP:
        gained = False
        for axis in varied:
            for sign in (1, -1):
                neighbour = _neighbour(current, axis, sign * share)
                if neighbour == current or trials >= MAX_REFINEMENTS:
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
    """The place moved by some grid steps along an axis, clipped to its range."""
    low, high = float(axis.values[0]), float(axis.values[-1])
    if axis.whole_turn:
        low, high = -float("inf"), float("inf")
    return {**place, axis.name: min(max(place[axis.name] + steps * axis.step, low), high)}
