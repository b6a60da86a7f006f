"""What several sections show of a plan and is slow to compute: once per report."""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache

import numpy as np

from armcontour.jobs import RunResult
from armcontour.jobs.quantities import Torques, planned_torques, torques_at

# More runs than this are computed again.
MOST_RUNS = 16
# Breaks of a plan at which torques are looked at; of more, this many. The others differ little.
MOST_BREAKS = 20_000
SUFFIXES = {1: "st", 2: "nd", 3: "rd"}


@lru_cache(maxsize=MOST_RUNS)
def torques_of(result: RunResult) -> Torques | None:
    """Torques that a plan takes, of a long one at a share of its breaks; None without bodies."""
    arm, plan = result.execution.arm, result.trajectory
    every = torque_stride(result)
    if not arm.has_bodies or every == 1:
        return planned_torques(result)
    t = np.union1d(plan.breaks[::every], [plan.duration])
    left, right = torques_at(arm, plan, t[1:], side="left"), torques_at(arm, plan, t[:-1])
    values = np.stack([right, left], axis=1).reshape(-1, arm.dof)
    return Torques(t=np.repeat(t, 2)[1:-1], values=values)


def torque_notes(results: Iterable[RunResult]) -> list[str]:
    """Sentences on plans whose torques are not looked at at every break."""
    return [
        f"Run {x.run.name}: torques are computed at every {ordinal(torque_stride(x))} of the "
        f"plan's {len(x.trajectory.breaks)} breaks; summary.json has the largest of all breaks."
        for x in results
        if torque_stride(x) > 1
    ]


def torque_stride(result: RunResult) -> int:
    """Torques are looked at at every so many-th break of the plan."""
    return -(-len(result.trajectory.breaks) // MOST_BREAKS)


def ordinal(n: int) -> str:
    """A number as a place in a row: 1st, 2nd, 3rd, 4th."""
    last = 0 if 10 < n % 100 < 14 else n % 10
    return f"{n}{SUFFIXES.get(last, 'th')}"


def forget() -> None:
    """Let go of what was computed."""
    torques_of.cache_clear()
