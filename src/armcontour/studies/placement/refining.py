"""A better place between those of a grid: a pattern search around the best one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from armcontour.core.progress import Progress, Step
from armcontour.jobs.axes import Axis
from armcontour.studies.placement.judging import Judge, Verdict
from armcontour.studies.placement.searching import shown

# The first steps are half of the grid's, the last ones this share of them.
FINEST = 1 / 16
# Largest number of places that are looked at.
MOST_TRIALS = 200
# A place is better if its score is less by this share of it.
LEAST_GAIN = 1e-6


def refine(
    judge: Judge,
    axes: Sequence[Axis],
    place: Mapping[str, float],
    verdict: Verdict,
    progress: Progress,
) -> tuple[dict[str, float], Verdict]:
    """Go from a place to better ones beside it, in smaller and smaller steps.

    Every better place was planned in full. Places stay within the ranges of the axes.

    Args:
        judge: Judges places.
        axes: The axes.
        place: The best place of the grid.
        verdict: The verdict on it.
        progress: Called before every trial.

    Returns:
        The place and its verdict; those given if none beside it is better.
    """
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
