"""`find_stopped_place`: where to resume a job whose motion was stopped."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.geometry.segments import REPEATED_POINT
from armcontour.jobs.job import Job
from armcontour.jobs.run_plan import places_on_path
from armcontour.jobs.run_result import RunResult
from armcontour.program import contour_called

# Largest distances of the measured tool from its path at which it counts as on the path [m]. The
# second one applies if the tool was always farther than the first one.
ON_PATH = (0.1e-3, 2e-3)
# The measured tool may lag its plan by at most this time [s].
LONGEST_LAG = 0.5
# The tool is searched on its path during this time before the end of a motion [s].
SEARCHED_TIME = 5.0
# Time between two points of the path with which a measured tool is compared [s].
COMPARED_STEP = 2e-3
# Numbers of samples that are compared at once.
SAMPLES_AT_ONCE = 500
# One iteration compares this number of places along a contour.
PLACES_PER_ITERATION = 1001
# In the last iteration, places are 1e-9 of the contour apart.
ITERATIONS = 3
# Resolution of the arc length within a contour [m].
PLACE_RESOLUTION = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class StoppedPlace:
    """Where to resume a job whose motion was stopped.

    Args:
        resume_at: Value of `process.resume_at` [m]; None if no work is left, or the place is
            unknown.
        words: The place in words, as a clause.
        job: Name of the job that was played.
        run: Name of its run.
        only: Value of `process.only`: contours that were to be executed; empty for all.
        measured: Measured joint positions after the stop [rad], (dof,).
    """

    resume_at: float | None
    words: str
    job: str
    run: str
    only: tuple[str, ...]
    measured: FloatArray

    @property
    def option(self) -> str:
        """Option of the command line that resumes the job; empty if it cannot be resumed."""
        if self.resume_at is None:
            return ""
        text = f"{1e3 * self.resume_at:.6f}".rstrip("0").rstrip(".")
        return f"--resume-at '{text} mm'"

    def resumed(self, job: Job) -> Job:
        """Return the job whose rest begins at this place.

        If the job has no `process.only`, it gets that of the motion that was stopped.

        Args:
            job: The job that was played, as it was or after it was resumed before.

        Raises:
            InvalidInput: This is another job, no work is left, or the place is unknown.
        """
        if job.name != self.job:
            raise InvalidInput(
                f"The motion that was stopped belongs to the job {self.job!r}, but this is the job "
                f"{job.name!r}. Specify the job that was played."
            )
        if self.resume_at is None:
            raise InvalidInput(
                f"The job {self.job} cannot be resumed where the motion was stopped: {self.words}."
            )
        process = job.process
        rest = replace(process, resume_at=self.resume_at, only=process.only or self.only)
        return replace(job, process=rest)


class _Place(NamedTuple):
    """Value of `process.resume_at` [m], None if no work is left or it is unknown; and the place."""

    resume_at: float | None
    words: str


def find_stopped_place(
    job: Job, planned: RunResult, end: float, t: FloatArray, measured: FloatArray
) -> StoppedPlace:
    """Find where to resume a job after a stop, such that no part of its contours is left out.

    The place is not after the measured tool, and before it by at most the distance of the tool from
    its path and a micrometre.

    Args:
        job: The job, as it was played.
        planned: The plan that was played.
        end: Time at which the plan is where the stop ends [s].
        t: Times of the samples on the clock of the plan [s], (n,).
        measured: Measured joint positions [rad], (n, dof).
    """
    reached = _last_time_on_path(planned, end, t, measured)
    place = _Place(None, "the tool has left its path, so the place of the stop is unknown")
    if reached is not None:
        place = _place_at(job, planned, *reached)
    return StoppedPlace(
        resume_at=place.resume_at,
        words=place.words,
        job=job.name,
        run=planned.run.name,
        only=job.process.only,
        measured=measured[-1],
    )


def _last_time_on_path(
    planned: RunResult, end: float, t: FloatArray, measured: FloatArray
) -> tuple[float, float] | None:
    """Find the last plan time that the measured tool reached [s], and its distance there [m].

    None if the tool was not on its path before it stopped.
    """
    arm = planned.arm
    is_compared = t >= min(end, float(t[-1])) - SEARCHED_TIME
    tools = arm.tool_position(measured[is_compared])
    latest = np.clip(t[is_compared], 0.0, end)
    # Times by which the tool may lag its plan. Without lag, the last samples are compared with the
    # end of the stop, which a robot that follows its plan reaches exactly.
    lags = np.append(np.arange(0.0, LONGEST_LAG, COMPARED_STEP), LONGEST_LAG)
    nearest_times = list[FloatArray]()
    smallest_distances = list[FloatArray]()
    for first in range(0, len(tools), SAMPLES_AT_ONCE):
        part = slice(first, first + SAMPLES_AT_ONCE)
        times = np.maximum(latest[part, None] - lags, 0.0)
        points = arm.tool_position(planned.trajectory(times.ravel())).reshape(*times.shape, -1)
        distances = np.linalg.norm(points - tools[part, None], axis=2)
        nearest = distances.argmin(axis=1)
        rows = np.arange(len(nearest))
        nearest_times.append(times[rows, nearest])
        smallest_distances.append(distances[rows, nearest])
    reached = np.concatenate(nearest_times)
    distance = np.concatenate(smallest_distances)
    for tolerance in ON_PATH:
        on_path = np.flatnonzero(distance <= tolerance)
        if len(on_path):
            # Of several samples at the last time, the nearest one.
            i = on_path[np.lexsort((distance[on_path], -reached[on_path]))[0]]
            return float(reached[i]), float(distance[i])
    return None


def _place_at(job: Job, planned: RunResult, time: float, distance: float) -> _Place:
    """Find the place at a plan time [s], or before it by a distance within the contour [m]."""
    objective = planned.objective
    works = [contour.at_work for contour in objective.contours]
    # A part of a job counts from the start of the whole job.
    breaks = objective.work_ranges[:, 0]
    for number, span in enumerate(planned.trajectory.contour_spans):
        name = contour_called(objective.contours[number], number)
        if time <= span.t[0]:
            return _Place(float(breaks[number]), f"before {name}, which is resumed as a whole")
        if time >= span.t[1]:
            continue
        start, end = works[number]
        s = float(planned.trajectory.s(time)) - span.s[0]
        drawn = _drawn_place(job, planned, number, s) - distance
        if drawn <= start + REPEATED_POINT:
            return _Place(float(breaks[number]), f"at the start of {name}")
        if drawn < end - REPEATED_POINT:
            # Rounded down, so that the text of the option is not after the place.
            value = np.floor((breaks[number] + drawn - start) / PLACE_RESOLUTION) * PLACE_RESOLUTION
            return _Place(float(max(value, breaks[number])), f"on {name}")
    return _Place(None, "all contours are complete")


def _drawn_place(job: Job, planned: RunResult, number: int, s: float) -> float:
    """Find the arc length on the drawn contour at or before a place of the path [m].

    `s`: arc length on the contour with rounded or shaped corners [m].
    """
    low = 0.0
    high = planned.objective.contours[number].path.length
    for _ in range(ITERATIONS):
        drawn = np.linspace(low, high, PLACES_PER_ITERATION)
        on_path = places_on_path(job, planned.run, planned.objective, planned.path, number, drawn)
        i = int(np.searchsorted(on_path, s, side="right")) - 1
        low = float(drawn[max(i, 0)])
        high = float(drawn[min(max(i, 0) + 1, PLACES_PER_ITERATION - 1)])
        if high <= low:
            break
    return low
