"""`sweep`: certified duration over corner tolerances and over assigned speeds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from armcontour.core import checks
from armcontour.core.errors import ArmContourError, InvalidInput
from armcontour.core.fields import checked
from armcontour.core.progress import Progress, subprogress
from armcontour.jobs.goal import CertificateGoal
from armcontour.jobs.job import Job
from armcontour.studies.certification.certifying import certify, goal_of, run_of


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepPoint:
    """Certified duration at one tolerance or assigned speed.

    Args:
        tolerance: Tolerance of the corners, or of the whole contour if the goal has a tolerance
            [m]; None if it is that of the job.
        speed: Assigned speed [m/s]; None if it is that of the job.
        duration: Duration of the certified plan [s]; None if the certificate was refused.
        refusal: Reason of the refusal; None for a certified point.
    """

    tolerance: float | None
    speed: float | None
    duration: float | None
    refusal: str | None


@checked
def sweep(
    job: Job,
    run: str | None = None,
    *,
    tolerances: Sequence[float] = (),
    speeds: Sequence[float] = (),
    goal: CertificateGoal | None = None,
    progress: Progress | None = None,
) -> tuple[SweepPoint, ...]:
    """Certify a job for several corner tolerances, then for several assigned speeds.

    The command `armcontour batch` varies any keys of a job, several at once, and draws charts.

    >>> points = ac.sweep(ac.read_job("job.yaml"), tolerances=[1e-3, 2e-3])
    >>> points[0].duration > points[1].duration
    True

    Args:
        job: The job.
        run: Name of the run; by default that of the goal.
        tolerances: Tolerances of the corners, or of the whole contour if the goal has a tolerance
            [m]; the speed is that of the job.
        speeds: Assigned speeds [m/s]; the tolerance is that of the job.
        goal: The goal of every point; by default the certificate of the job.
        progress: Called with a step, which has the value as its name, before every trial.

    Raises:
        InvalidInput: No values, no goal, no such run, or a tolerance for a run without rounded
            corners. A plan that cannot be certified is a point with a refusal.
    """
    tolerances = checks.check_sequence("tolerances", tolerances, object, "numbers")
    speeds = checks.check_sequence("speeds", speeds, object, "numbers")
    goal = goal_of(job) if goal is None else goal
    this = run_of(job, goal.run if run is None else run)
    values: list[tuple[float | None, float | None]] = [
        (checks.positive("tolerance", x, "m"), None) for x in tolerances
    ]
    values += [(None, checks.positive("speed", x, "m/s")) for x in speeds]
    if not values:
        raise InvalidInput("sweep needs values of tolerances or speeds, such as speeds=[0.1, 0.2].")
    if len(tolerances) and this.rounding is None:
        raise InvalidInput(
            f"Run {this.name} rounds no corners, so sweep has no tolerance to vary: give the run "
            "corners, or sweep speeds."
        )
    points = []
    for tolerance, speed in values:
        duration, refusal = None, None
        name = f"{speed:.3g} m/s" if tolerance is None else f"{tolerance * 1e3:.3g} mm"
        try:
            changed, aim = this, goal
            if speed is not None:
                changed = replace(this, limits=this.limits.replace(speed=speed))
            if tolerance is not None and this.rounding is not None:
                changed = replace(this, rounding=replace(this.rounding, tolerance=tolerance))
                aim = goal if goal.tolerance is None else replace(goal, tolerance=tolerance)
            one = replace(job, runs=(changed,), certificate=aim)
            duration = certify(one, this.name, progress=subprogress(progress, name)).duration
        except ArmContourError as error:
            refusal = str(error)
        points.append(
            SweepPoint(tolerance=tolerance, speed=speed, duration=duration, refusal=refusal)
        )
    return tuple(points)
