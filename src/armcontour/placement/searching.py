"""The search over a grid: bounds of all places first, then plans of those that may be the best."""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Mapping, Sequence
from functools import partial
from threading import Condition
from typing import TypeAlias

import numpy as np

from armcontour._process import processors
from armcontour._processes import share_work
from armcontour._progress import Progress, Step
from armcontour.jobs.place_search import CYCLE
from armcontour.placement.judging import Judge, Verdict
from armcontour.placement.screening import Screened

# Places that are looked at together without a plan: about a quarter of a second of work.
CHUNK = 32
# With fewer places than this other processes are not worth their start.
FEWEST_PLACES = 100

# Work on places: their indices and, for a plan, the score that it has to beat.
Task: TypeAlias = tuple[tuple[int, ...], float | None]
Answer: TypeAlias = list[Screened] | Verdict
Place: TypeAlias = Mapping[str, float]


def search(
    judge: Judge,
    places: Sequence[Place],
    *,
    every: bool = False,
    processes: int | None = None,
    progress: Progress,
) -> list[Verdict]:
    """Find the best of some places; the others have bounds that prove it.

    Args:
        judge: Judges places.
        places: The places.
        every: Whether every place is planned.
        processes: Number of processes; by default that of processors for many places, else 1.
        progress: Called with the share that is done.

    Returns:
        What is known of every place.
    """
    order = _BestFirst(judge, places, every, progress)
    if processes is None:
        processes = processors() if len(places) >= FEWEST_PLACES else 1
    _share(judge, places, order, processes)
    return order.verdicts


def best_of(verdicts: Sequence[Verdict], objective: str) -> int | None:
    """Index of the first place of the least score; None if no place has one."""
    scores = np.array([x.score(objective) for x in verdicts])
    best = int(np.argmin(scores))
    return best if np.isfinite(scores[best]) else None


def _share(judge: Judge, places: Sequence[Place], order: _BestFirst, processes: int) -> None:
    """Work in the order, in this process or in others; all sharing is here."""
    if processes > 1:
        work = partial(_work, judge, list(places))
        share_work(work, order, processes=processes)
        return
    while (task := order.take()) is not None:
        order.finish(task, _work(judge, places, task))


def _work(judge: Judge, places: Sequence[Place], task: Task) -> Answer:
    """Look at some places, or plan one."""
    which, cutoff = task
    if cutoff is None:
        return judge.look_all([places[k] for k in which])
    return judge.judge(places[which[0]], cutoff)


class _BestFirst:
    """Places in the order of their bounds, as `share_work` takes them.

    Args:
        judge: Says what bounds are worth.
        places: The places.
        every: Whether every place is planned.
        progress: Called with the share that is done.
    """

    def __init__(
        self, judge: Judge, places: Sequence[Place], every: bool, progress: Progress
    ) -> None:
        self.verdicts = [Verdict() for _ in places]
        self._judge, self._every, self._progress = judge, every, progress
        every_index = range(len(places))
        looks = judge.screen is not None
        self._chunks = [
            tuple(every_index[k : k + CHUNK]) for k in range(0, len(places) if looks else 0, CHUNK)
        ]
        self._away, self._done = 0, 0
        # Least scores and indices of places that may be planned.
        self._left = [] if looks else [(-np.inf, k) for k in every_index]
        self._candidates = len(self._left)
        self._best, self._refused = np.inf, Counter[str]()
        self._news = Condition()

    def take(self) -> Task | None:
        """The next places to look at, or the next one to plan; None if none can be better."""
        with self._news:
            if self._chunks:
                self._away += 1
                return self._chunks.pop(0), None
            # Plans begin when all bounds are known.
            while self._away and not self._planning:
                self._news.wait()
            if not self._left:
                return None
            _, k = heapq.heappop(self._left)
            self._away += 1
            return (k,), np.inf if self._every else self._best

    @property
    def _planning(self) -> bool:
        return self._done >= len(self.verdicts) or self._judge.screen is None

    def finish(self, task: Task, answer: Answer) -> None:
        """Take what was found."""
        which, cutoff = task
        with self._news:
            self._away -= 1
            if isinstance(answer, Verdict):
                self._judged(which[0], answer)
            else:
                for k, seen in zip(which, answer, strict=True):
                    self._looked(k, seen)
                self._done += len(which)
                if self._planning:
                    heapq.heapify(self._left)
                    self._candidates = len(self._left)
            self._tell(looking=cutoff is None)
            self._news.notify_all()

    def give_up(self) -> None:
        """Have no places any more."""
        with self._news:
            self._chunks.clear()
            self._left.clear()
            self._done = len(self.verdicts)
            self._news.notify_all()

    def _looked(self, k: int, seen: Screened) -> None:
        """Keep the bounds of a place."""
        least = self._judge.least_score(seen)
        bound = least if self._judge.objective == CYCLE else 0.0
        self.verdicts[k] = Verdict(bound=bound, singular=seen.singular, refusal=seen.refusal)
        if seen.refusal:
            self._refused[seen.refusal] += 1
        else:
            self._left.append((least, k))

    def _judged(self, k: int, found: Verdict) -> None:
        """Keep the verdict on a place."""
        self.verdicts[k] = found
        if found.refusal:
            self._refused[found.refusal] += 1
        score = found.score(self._judge.objective)
        if score < self._best:
            self._best = score
            if not self._every:
                self._left = [x for x in self._left if x[0] <= score]
                heapq.heapify(self._left)

    def _tell(self, *, looking: bool) -> None:
        """Tell the share that is done, the best so far, and refusals by kind."""
        if looking:
            name, share = "bounds", self._done / len(self.verdicts)
        else:
            name, share = "plans", 1 - len(self._left) / max(self._candidates, 1)
        words = [name]
        if np.isfinite(self._best):
            words.append(f"best so far {shown(self._best, self._judge.objective)}")
        words += [f"{n} refused by {kind}" for kind, n in self._refused.most_common()]
        self._progress(Step((", ".join(words),), share))


def shown(score: float, objective: str) -> str:
    """A score as the value that people know."""
    unit, factor, sign = {
        "cycle": (" s", 1.0, 1),
        "manipulability": (" m/rad", 1.0, -1),
        "clearance": (" mm", 1e3, -1),
        "torque": (" %", 1e2, -1),
    }[objective]
    return f"{sign * score * factor:.5g}{unit}"
