"""Points of programs whose controllers plan the motion between them: interval and distances."""

from __future__ import annotations

import math
from dataclasses import dataclass

from armcontour.core.checks import Frozen
from armcontour.jobs.job import Job, Run
from armcontour.motion import Trajectory
from armcontour.verification.between_points import BetweenPoints, measure_between_points

# Longest and shortest interval of points that is chosen [s]. Controllers interpolate every 4 ms or
# more, so that points much closer than that do not help.
LONGEST_INTERVAL = 0.05
SHORTEST_INTERVAL = 1e-3
# Chosen intervals are multiples of this [s].
INTERVAL_STEP = 0.5e-3
# The next interval of the search aims at this share of the allowed distance, and the distance may
# reach the accepted share, because the largest distance is measured with an error of 1/32.
AIMED_SHARE = 0.9
ACCEPTED_SHARE = 0.97
# Relative rounding error up to which an interval counts as a multiple of the step.
STEP_ROUNDING = 1e-9
# Smallest number of intervals within the rest at a wait.
INTERVALS_OF_WAIT = 2


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ProgramPoints(Frozen):
    """Points of programs whose controllers plan the motion between them.

    Args:
        formats: Formats of the programs, such as kuka.
        only: True if the run sends only such programs, and no set-points.
        automatic: True if the interval of the points follows from the allowed contour error.
        between: How far the controllers may leave the path between the points.
    """

    formats: tuple[str, ...]
    only: bool
    automatic: bool
    between: BetweenPoints


def program_points(
    job: Job, run: Run, plan: Trajectory, allowed: float | None
) -> ProgramPoints | None:
    """Choose and measure the points of a job's programs; None if no such program is sent.

    Args:
        job: The job.
        run: The run.
        plan: The run's plan.
        allowed: Largest allowed contour error [m]; None if the run allows none.
    """
    formats = job.export.programs
    if not formats or job.played_on is not None:
        return None
    automatic = job.export.cycle is None and allowed is not None
    if job.export.cycle is not None:
        between = measure_between_points(plan, job.export.cycle)
    elif allowed is None:
        between = measure_between_points(plan, run.cycle)
    else:
        between = choose_points(plan, allowed, _longest_interval(job, run, plan))
    return ProgramPoints(
        formats=formats, only=job.only_programs, automatic=automatic, between=between
    )


def choose_points(
    plan: Trajectory, allowed: float, longest: float = LONGEST_INTERVAL
) -> BetweenPoints:
    """Find the longest interval of points with which a controller stays near the path.

    The distances fall about with the square of the interval. If even the shortest interval does not
    suffice, it is returned.

    Args:
        plan: The plan, with its arm.
        allowed: Largest distance in both directions [m].
        longest: Longest interval [s].
    """
    interval = _round_down(min(longest, plan.duration))
    between = measure_between_points(plan, interval)
    while between.largest > ACCEPTED_SHARE * allowed and interval > SHORTEST_INTERVAL:
        share = math.sqrt(AIMED_SHARE * allowed / between.largest)
        interval = _round_down(interval * min(share, AIMED_SHARE))
        between = measure_between_points(plan, interval)
    return between


def _longest_interval(job: Job, run: Run, plan: Trajectory) -> float:
    """Return the longest interval of points with which waits and analog outputs fit [s]."""
    rests = [x.rest / INTERVALS_OF_WAIT for x in plan.waits]
    # The levels of analog outputs change at points only.
    levels = [run.cycle] if job.process.analog_names else []
    return min([LONGEST_INTERVAL, *rests, *levels])


def _round_down(interval: float) -> float:
    """Round an interval down to a multiple of the step, but at least to the shortest one [s]."""
    steps = math.floor(interval / INTERVAL_STEP * (1 + STEP_ROUNDING))
    return max(steps * INTERVAL_STEP, SHORTEST_INTERVAL)
