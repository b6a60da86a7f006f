"""Entry point `sweep`: certified time against corner tolerance and against assigned velocity."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from armcontour import _checks
from armcontour._progress import Progress, under
from armcontour.certification.certifying import certify, goal_of, run_of
from armcontour.errors import ArmContourError, InvalidInput
from armcontour.jobs.goal import Goal
from armcontour.jobs.job import Job, Rounding, Run
from armcontour.jobs.programs import programs_of
from armcontour.timing import plan

# Default values of a sweep, as multiples of the values of the job.
TOLERANCES = (0.1, 0.2, 0.5, 1.0, 2.0)
SPEEDS = (0.4, 0.6, 0.8, 1.0, 1.25)


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepPoint:
    """One choice of corner tolerance and assigned velocity.

    Args:
        tolerance: Tolerance of the corners, or of the whole contour if the goal has a tolerance
            [m]; None if no corner is rounded.
        speed: Assigned velocity [m/s]; None without one.
        optimum: Duration of the fastest plan, not certified [s]; None if there is no plan.
        duration: Duration of the certified plan [s]; None if the certificate was refused.
        contour_error: Largest contour error of its execution, over the box if there is one [m].
        refusal: Reason of the refusal; None for a certified point.
    """

    tolerance: float | None
    speed: float | None
    optimum: float | None
    duration: float | None
    contour_error: float | None
    refusal: str | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sweep:
    """Points along two lines through the job's own choice.

    Args:
        job: The job.
        run: Its run.
        goal: The goal of every certified point.
        tolerances: Points with the run's assigned velocity, by tolerance.
        speeds: Points with the run's tolerance, by assigned velocity.
    """

    job: Job
    run: Run
    goal: Goal
    tolerances: tuple[SweepPoint, ...]
    speeds: tuple[SweepPoint, ...]

    def __repr__(self) -> str:
        """Job, run and how many points are certified."""
        points = (*self.tolerances, *self.speeds)
        certified = sum(x.duration is not None for x in points)
        return (
            f"Sweep({self.job.name!r}, run {self.run.name!r}, {certified} of {len(points)} points "
            "certified)"
        )


def sweep(
    job: Job,
    run: str | None = None,
    *,
    tolerances: Sequence[float] | None = None,
    speeds: Sequence[float] | None = None,
    progress: Progress | None = None,
    **overrides: Any,
) -> Sweep:
    """Certify a job for several corner tolerances and for several assigned velocities.

    Args:
        job: The job; its certificate is the goal of every point.
        run: Name of the run; by default the certificate's.
        tolerances: Tolerances of the corners, or of the whole contour if the goal has a tolerance
            [m]; by default 0.1 to 2 times the run's; none if no corner is rounded to a tolerance.
        speeds: Assigned velocities [m/s]; by default 0.4 to 1.25 times the run's.
        progress: Called with a step, a point and a few words, before every trial.
        overrides: Fields of `Goal` that replace those of the job.

    Raises:
        InvalidInput: There is nothing to sweep, no goal, or no such run. A plan that cannot be
            certified is a point with a refusal.
    """
    goal = goal_of(job, overrides)
    this = run_of(job, goal.run if run is None else run)
    own = goal.tolerance
    if own is None and this.rounding is not None:
        own = this.rounding.tolerance
    tolerance_values = _values("tolerance", tolerances, own, TOLERANCES)
    speed_values = _values("speed", speeds, this.limits.speed, SPEEDS)
    if tolerance_values and this.rounding is None:
        raise InvalidInput(
            f"The run {this.name} rounds no corners, so it has no tolerance to vary."
        )
    if not tolerance_values and not speed_values:
        raise InvalidInput(
            f"The run {this.name} has neither a corner tolerance nor an assigned velocity: give "
            "tolerances or speeds to compare."
        )
    call = _Point(job, this, goal, under(progress))
    return Sweep(
        job=job,
        run=this,
        goal=goal,
        tolerances=tuple(call.at(x, this.limits.speed) for x in tolerance_values),
        speeds=tuple(call.at(own, x) for x in speed_values),
    )


def _values(
    name: str, given: Sequence[float] | None, own: float | None, multiples: Sequence[float]
) -> list[float]:
    """The given values in order, or by default multiples of the job's own value."""
    if given is not None:
        return sorted(_checks.positive(name, x) for x in given)
    return [] if own is None else [own * x for x in multiples]


class _Point:
    """Certifies one choice; a choice that both lines share is certified once."""

    def __init__(self, job: Job, this: Run, goal: Goal, progress: Progress) -> None:
        self.job, self.this, self.goal, self.progress = job, this, goal, progress
        self.known: dict[tuple[float | None, float | None], SweepPoint] = {}

    def at(self, tolerance: float | None, speed: float | None) -> SweepPoint:
        """The point of a corner tolerance [m] and an assigned velocity [m/s]."""
        key = (tolerance, speed)
        if key not in self.known:
            self.known[key] = self._certify(tolerance, speed)
        return self.known[key]

    def _certify(self, tolerance: float | None, speed: float | None) -> SweepPoint:
        """Certify one point; a refusal is a point too."""
        goal, this = self.goal, self.this
        if speed is not None:
            this = replace(this, limits=this.limits.replace(speed=speed))
        if goal.tolerance is not None:
            goal = replace(goal, tolerance=tolerance)
        elif this.rounding is not None and tolerance is not None:
            rounding: Rounding = replace(this.rounding, tolerance=tolerance)
            this = replace(this, rounding=rounding)
        shown = ["" if tolerance is None else f"{tolerance * 1e3:.3g} mm"]
        shown += ["" if speed is None else f"{speed:.3g} m/s"]
        name = ", ".join(x for x in shown if x)
        job = replace(self.job, runs=(this,), certificate=goal)
        try:
            found = certify(job, this.name, progress=under(self.progress, name))
        except ArmContourError as error:
            return SweepPoint(
                tolerance=tolerance,
                speed=speed,
                optimum=self._optimum(job, this),
                duration=None,
                contour_error=None,
                refusal=str(error),
            )
        return SweepPoint(
            tolerance=tolerance,
            speed=speed,
            optimum=found.uncertified.duration,
            duration=found.duration,
            contour_error=found.budget.executed,
            refusal=None,
        )

    def _optimum(self, job: Job, this: Run) -> float | None:
        """Duration of the uncertified plan [s]; None if there is no plan."""
        try:
            program = programs_of(job, this)[1]
            found = plan(
                program,
                job.arm,
                this.limits,
                branch=job.branch,
                start=job.start,
                ignore_jerk=this.ignore_jerk,
            )
            return found.duration
        except ArmContourError:
            return None
