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
from armcontour.core.process import is_other
from armcontour.core.progress import Progress, Step
from armcontour.core.render import number
from armcontour.jobs.place_search import DURATION
from armcontour.studies.placement.judging import COMPARED, Judge, Trail, Verdict
from armcontour.studies.placement.screening import Screened

# Places that are looked at together without a plan: about a quarter of a second of work.
CHUNK = 32
# With fewer places than this other processes are not worth their start.
FEWEST_PLACES = 100

# Work on places: their indices and, for a plan, the score that it has to beat.
Task: TypeAlias = tuple[tuple[int, ...], float | None]
Answer: TypeAlias = list[Screened] | Trail
Place: TypeAlias = Mapping[str, float]


def search_grid(
    judge: Judge,
    places: Sequence[Place],
    *,
    every: bool = False,
    processes: int | None = None,
    executor: Executor | None = None,
    progress: Progress,
) -> list[Verdict]:
    """Find the best of some places; the others have bounds that prove it.

    Args:
        judge: Judges places.
        places: The places.
        every: Whether every place is planned.
        processes: Number of processes; by default that of processors for many places, else 1.
        executor: An executor that does the work in place of these processes.
        progress: Called with the share that is done.

    Returns:
        What is known of every place; the same whoever works.

    Raises:
        ExecutionError: The executor takes no work, or has lost a worker.
    """
    if processes is None and (len(places) < FEWEST_PLACES or is_other()):
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


def _work(judge: Judge, places: Sequence[Place], task: Task) -> Answer:
    """Look at some places, or plan one."""
    which, cutoff = task
    if cutoff is None:
        return judge.look_all([places[k] for k in which])
    return judge.weigh(places[which[0]], cutoff)


class _Search:
    """One call of `search_grid`.

    Args:
        judge: Says what bounds are worth.
        count: Number of places.
        every: Whether every place is planned.
        progress: Called with the share that is done.
    """

    def __init__(self, judge: Judge, count: int, every: bool, progress: Progress) -> None:
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
        for (which, _), answer in crew.work_off((x, None) for x in parts):
            for k, seen in zip(which, cast(list[Screened], answer), strict=True):
                self._looked(k, seen)
            done += len(which)
            self._tell("bounds", done / count)

    def _looked(self, k: int, seen: Screened) -> None:
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
        trails: dict[int, Trail] = {}
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
                trail = trails[which[0]] = cast(Trail, answer)
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
