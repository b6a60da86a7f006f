"""Torques of plans for several sections of the report, computed once per report."""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache

import numpy as np

from armcontour.jobs import RunResult
from armcontour.jobs.quantities import Torques, planned_torques, torques_at

# Number of runs whose torques are stored.
MOST_RUNS = 16
# Largest number of breaks of a plan at which torques are computed for the figures.
MOST_BREAKS = 20_000
SUFFIXES = {1: "st", 2: "nd", 3: "rd"}


@lru_cache(maxsize=MOST_RUNS)
def torques_of(result: RunResult) -> Torques | None:
    """Torques of a plan over time, for a long plan at some of its breaks; None without bodies."""
    arm, plan = result.execution.arm, result.trajectory
    every = torque_stride(result)
    if not arm.has_bodies or every == 1:
        return planned_torques(result)
    t = np.union1d(plan.breaks[::every], [plan.duration])
    left, right = torques_at(arm, plan, t[1:], side="left"), torques_at(arm, plan, t[:-1])
    values = np.stack([right, left], axis=1).reshape(-1, arm.dof)
    return Torques(t=np.repeat(t, 2)[1:-1], values=values)


def describe_torque_sampling(results: Iterable[RunResult]) -> list[str]:
    """Sentences on plans whose torques are not drawn at every break."""
    return [
        f"Run {x.run.name}: torques are computed at every {ordinal(torque_stride(x))} of the "
        f"plan's {len(x.trajectory.breaks)} breaks; summary.json has the largest of all breaks."
        for x in results
        if torque_stride(x) > 1
    ]


def torque_stride(result: RunResult) -> int:
    """The number k if torques are drawn at every k-th break of a plan."""
    return -(-len(result.trajectory.breaks) // MOST_BREAKS)


def ordinal(n: int) -> str:
    """A number as an ordinal: 1st, 2nd, 3rd, 4th."""
    last = 0 if 10 < n % 100 < 14 else n % 10
    return f"{n}{SUFFIXES.get(last, 'th')}"


def forget() -> None:
    """Delete the stored torques."""
    torques_of.cache_clear()
