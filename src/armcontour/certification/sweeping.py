"""Entry point `sweep`: certified time against corner tolerance and against assigned velocity.

Over the tolerances, arcs and paths of the shape free may be compared.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial

from armcontour import _checks
from armcontour._describing import line_up, mm
from armcontour._executors import map_on
from armcontour._progress import Progress, Step, under
from armcontour.certification.certificate import Certificate
from armcontour.certification.certifying import certify, goal_of, run_of
from armcontour.errors import ArmContourError, InvalidInput
from armcontour.jobs.goal import Goal
from armcontour.jobs.job import ARC, FREE, SHAPES, Job, Run
from armcontour.jobs.programs import programs_of, trace_run
from armcontour.timing import plan

# Default values of a sweep, as multiples of the values of the job.
TOLERANCES = (0.1, 0.2, 0.5, 1.0, 2.0)
SPEEDS = (0.4, 0.6, 0.8, 1.0, 1.25)
# Iterations of a shape, unless the run says how many: each point is shaped several times.
COARSE = 10


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepPoint:
    """One choice of corner tolerance and assigned velocity.

    Args:
        tolerance: Tolerance of the corners, or of the whole contour if the goal has a tolerance
            [m]; None if no corner is rounded.
        speed: Assigned velocity [m/s]; None without one.
        optimum: Duration of the fastest plan, not certified [s]; None if there is no plan.
        duration: Duration of the certified plan [s]; None if the certificate was refused, or if
            none was asked for.
        contour_error: Largest contour error of its execution, over the box if there is one [m].
        refusal: Reason of the refusal; None for a certified point, and where there was none.
        shape: Shape of the corners, "arc" or "free"; None if no corner is rounded.
    """

    tolerance: float | None
    speed: float | None
    optimum: float | None
    duration: float | None
    contour_error: float | None
    refusal: str | None
    shape: str | None

    @property
    def cells(self) -> tuple[str, ...]:
        """Tolerance, speed, shape, optimum, certified duration and error as text, for tables."""
        certified = "" if self.duration is None else f"{self.duration:.4f} s"
        return (
            "" if self.tolerance is None else mm(self.tolerance),
            "" if self.speed is None else f"{mm(self.speed)}/s",
            self.shape or "",
            "" if self.optimum is None else f"{self.optimum:.4f} s",
            certified if self.refusal is None else "refused",
            "" if self.contour_error is None else mm(self.contour_error),
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sweep:
    """Points along two lines through the job's own choice.

    Args:
        job: The job.
        run: Its run.
        goal: The goal of every certified point; None if no point is certified.
        tolerances: Points with the run's assigned velocity, by shape and tolerance.
        speeds: Points with the run's tolerance, by assigned velocity.
    """

    job: Job
    run: Run
    goal: Goal | None
    tolerances: tuple[SweepPoint, ...]
    speeds: tuple[SweepPoint, ...]

    @property
    def shapes(self) -> dict[str, tuple[SweepPoint, ...]]:
        """The points by tolerance, of each shape of the corners that is compared."""
        shapes = dict.fromkeys(x.shape for x in self.tolerances if x.shape is not None)
        return {name: tuple(x for x in self.tolerances if x.shape == name) for name in shapes}

    @property
    def iterations(self) -> int | None:
        """Largest number of iterations of a point of the shape free; None without such points."""
        if not any(x.shape == FREE for x in (*self.tolerances, *self.speeds)):
            return None
        own = None if self.run.rounding is None else self.run.rounding.iterations
        return COARSE if own is None else own

    def __str__(self) -> str:
        """A row for every point."""
        header = ("tolerance", "speed", "corners", "optimum", "certified", "contour error")
        rows = [header, *(x.cells for x in (*self.tolerances, *self.speeds))]
        return line_up(f"Sweep of {self.job.title}, run {self.run.name}", rows, columns=">")

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
    shapes: Sequence[str] | None = None,
    certified: bool = True,
    goal: Goal | None = None,
    executor: Executor | None = None,
    progress: Progress | None = None,
) -> Sweep:
    """Certify a job for several corner tolerances and for several assigned velocities.

    Args:
        job: The job.
        run: Name of the run; by default the certificate's.
        tolerances: Tolerances of the corners, or of the whole contour if the goal has a tolerance
            [m]; by default 0.1 to 2 times the run's; none if no corner is rounded to a tolerance.
        speeds: Assigned velocities [m/s]; by default 0.4 to 1.25 times the run's.
        shapes: Shapes of the corners to compare over the tolerances, "arc" and "free"; by default
            that of the run, with arcs beside the shape free. The shape free takes at most 10
            iterations per point, unless the run gives their number.
        certified: Whether to certify the points; without it they are fastest plans only, which need
            no goal and a fraction of the time.
        goal: The goal of every point; by default the certificate of the job.
        executor: An executor that works on the points, such as a
            `concurrent.futures.ProcessPoolExecutor`; by default this process does.
        progress: Called with a step, a point and a few words, before every trial; with an executor,
            before its result is there.

    Raises:
        InvalidInput: There is nothing to sweep, no goal, or no such run. A plan that cannot be
            certified is a point with a refusal.
    """
    if goal is not None and not certified:
        raise InvalidInput(
            "A goal (--servo) is for certified points, but no point is to be certified: remove it."
        )
    if goal is None and certified:
        goal = goal_of(job)
    name = goal.run if run is None and goal is not None else run
    this = run_of(job, name)
    own = None if goal is None else goal.tolerance
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
    compared = _shapes(this, shapes) if tolerance_values else [None]
    tolerance_points = [
        (x, this.limits.speed, shape) for shape in compared for x in tolerance_values
    ]
    speed_points = [(own, x, call.shape) for x in speed_values]
    if executor is not None:
        call.share([*tolerance_points, *speed_points], executor)
    return Sweep(
        job=job,
        run=this,
        goal=goal,
        tolerances=tuple(call.at(*x) for x in tolerance_points),
        speeds=tuple(call.at(*x) for x in speed_points),
    )


def _shapes(this: Run, given: Sequence[str] | None) -> list[str | None]:
    """The shapes of the corners to compare over the tolerances."""
    if given is not None:
        return [_checks.choice("shapes", x, SHAPES) for x in dict.fromkeys(given)]
    if this.rounding is None:
        return [None]
    return [ARC, FREE] if this.rounding.free else [ARC]


def _values(
    name: str, given: Sequence[float] | None, own: float | None, multiples: Sequence[float]
) -> list[float]:
    """The given values in order, or by default multiples of the job's own value."""
    if given is not None:
        return sorted(_checks.positive(name, x) for x in given)
    return [] if own is None else [own * x for x in multiples]


# Tolerance [m], assigned velocity [m/s] and shape of a point.
Choice = tuple[float | None, float | None, str | None]


def _point(job: Job, this: Run, goal: Goal | None, choice: Choice) -> SweepPoint:
    """A point, in another process."""
    return _Point(job, this, goal, under(None)).at(*choice)


class _Point:
    """Certifies one choice; a choice that both lines share is certified once."""

    def __init__(self, job: Job, this: Run, goal: Goal | None, progress: Progress) -> None:
        self.job, self.this, self.goal, self.progress = job, this, goal, progress
        self.shape = None if this.rounding is None else this.rounding.shape
        self.known: dict[Choice, SweepPoint] = {}

    def share(self, choices: Sequence[Choice], executor: Executor) -> None:
        """Have an executor work on several points."""
        work = partial(_point, self.job, self.this, self.goal)
        several = list(dict.fromkeys(choices))

        def tell(done: int) -> None:
            count = len(several)
            self.progress(Step((f"{min(done + 1, count)} of {count} points",), done / count))

        self.known.update(zip(several, map_on(executor, work, several, done=tell), strict=True))

    def at(self, tolerance: float | None, speed: float | None, shape: str | None) -> SweepPoint:
        """The point of a corner tolerance [m], an assigned velocity [m/s] and a shape."""
        key = (tolerance, speed, shape)
        if key not in self.known:
            self.known[key] = self._point(*key)
        return self.known[key]

    def _point(self, tolerance: float | None, speed: float | None, shape: str | None) -> SweepPoint:
        """Certify one point; a refusal is a point too."""
        shown = ["" if tolerance is None else f"{tolerance * 1e3:.3g} mm"]
        shown += ["" if speed is None else f"{speed:.3g} m/s"]
        shown += ["shaped" if shape == FREE else ""]
        name = ", ".join(x for x in shown if x)
        found: Certificate | None = None
        job: Job | None = None
        optimum, refusal = None, None
        try:
            job = self._job(tolerance, speed, shape)
            if self.goal is None:
                self.progress(Step((name,)))
                optimum = self._optimum(job)
            else:
                found = certify(job, self.this.name, progress=under(self.progress, name))
                optimum = found.uncertified.duration
        except ArmContourError as error:
            refusal = str(error)
            if self.goal is not None and job is not None:
                with suppress(ArmContourError):
                    optimum = self._optimum(job)
        return SweepPoint(
            tolerance=tolerance,
            speed=speed,
            optimum=optimum,
            duration=None if found is None else found.duration,
            contour_error=None if found is None else found.budget.executed,
            refusal=refusal,
            shape=shape,
        )

    def _job(self, tolerance: float | None, speed: float | None, shape: str | None) -> Job:
        """The job with the values of a point, and with its run only.

        Raises:
            InvalidInput: Values that do not go together.
        """
        goal, this = self.goal, self.this
        if speed is not None:
            this = replace(this, limits=this.limits.replace(speed=speed))
        if goal is not None and goal.tolerance is not None:
            goal = replace(goal, tolerance=tolerance)
        rounding = this.rounding
        if rounding is not None:
            own = rounding.tolerance if tolerance is None else tolerance
            if shape == FREE:
                count = COARSE if rounding.iterations is None else rounding.iterations
                rounding = replace(
                    rounding.without_continuity, shape=FREE, tolerance=own, iterations=count
                )
            else:
                rounding = replace(rounding.with_arcs, tolerance=own)
            this = replace(this, rounding=rounding)
        return replace(self.job, runs=(this,), certificate=goal)

    def _optimum(self, job: Job) -> float:
        """Duration of the uncertified plan of a job's only run [s].

        Raises:
            ArmContourError: There is no plan.
        """
        (this,) = job.runs
        traced = trace_run(job, this, programs_of(job, this)[1])
        found = plan(traced, job.arm, this.limits)
        return found.duration
