"""Runs of a job file."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from contextlib import contextmanager

from armcontour.control.compensation import CompensationOptions
from armcontour.core.errors import InvalidInput, error_context, key_context
from armcontour.core.text import Keys, key_text
from armcontour.files.job_model import JobModel, RunModel
from armcontour.jobs import Exports, Rounding, Run
from armcontour.jobs.job import FIRST_TOLERANCE, default_compensation, required_servo
from armcontour.motion import DEFAULT_CYCLE
from armcontour.planning import Optimal, PlanOptions
from armcontour.robot import Arm, Limits, resolve_limits


def run_of(name: str, run: RunModel, job: JobModel, arm: Arm) -> Run:
    """Make a run of a job; keys that the run does not specify have the values of the job.

    Args:
        name: Name of the run.
        run: Keys of the run.
        job: Keys of the job.
        arm: Arm of the job.

    Raises:
        InvalidInput: A value is wrong. The error has the key path of this value, in the run or in
            the job.
    """
    corners = run.corners or job.corners
    rounding = corners if isinstance(corners, Rounding) else None
    limits = _limits(name, run, job, arm)
    if rounding is not None and limits.centripetal_acceleration is None:
        # With `corners.speed`, this acceleration determines the corner radius. It also limits the
        # speed in the corners.
        limits = limits.replace(centripetal_acceleration=rounding.acceleration)
    compensation = _compensation(name, run, job, arm)
    if rounding is not None:
        _check_rounding(rounding, limits, name, run)
    cycle = run.cycle or job.cycle or DEFAULT_CYCLE
    with _locate_key(name, run, job):
        return Run(
            name=name,
            timing=_timing(run, cycle),
            compensation=compensation,
            limits=limits,
            rounding=rounding,
            cycle=cycle,
            speed_factor=run.speed_factor or job.speed_factor,
            end_time=run.end_time,
            experiment=job.experiment,
            accuracy=job.accuracy,
            default_compensation=run.compensation is None,
        )


@contextmanager
def _locate_key(name: str, run: RunModel, job: JobModel) -> Iterator[None]:
    """Context that adds the run to an error, and to its key unless the job specifies the value."""
    try:
        with error_context(f"runs.{name}"):
            yield
    except InvalidInput as error:
        key = str(error.key[0]) if error.key else ""
        inherited = getattr(run, key, None) is None and getattr(job, key, None) is not None
        if not inherited:
            error.key = ("runs", name, *error.key)
        raise


def _limits(name: str, run: RunModel, job: JobModel, arm: Arm) -> Limits:
    """Return the arm's limits, replaced by those of the job, then by those of the run."""
    with key_context("limits"):
        limits = resolve_limits("A job", arm, Limits(**job.limits))
    with key_context("runs", name, "limits"):
        return resolve_limits("A run", arm, Limits(**run.limits), limits)


def _compensation(name: str, run: RunModel, job: JobModel, arm: Arm) -> CompensationOptions:
    """Return the compensation of a run, with the command limits of the job and the run."""
    servo = required_servo(job.servo, job.export or Exports())
    options = run.compensation or default_compensation(servo, arm, job.experiment)
    values = {**job.command_limits, **run.command_limits}
    if not values:
        return options
    from armcontour.motion.nearest_commands import check_command_limits

    keys: Keys = ("runs", name, "command_limits") if run.command_limits else ("command_limits",)
    with key_context(*keys):
        command_limits = check_command_limits(Limits(**values), arm.dof)
    return dataclasses.replace(options, command_limits=command_limits)


def _timing(run: RunModel, cycle: float) -> PlanOptions:
    """Return the timing options of a run, with the values of its keys `duration` and `cycle`."""
    if isinstance(run.timing, Optimal):
        return dataclasses.replace(run.timing, duration=run.duration)
    if run.duration is not None:
        raise InvalidInput(
            f"duration requires the timing method optimal, not {run.timing.method}. Remove "
            "duration, or write timing: {method: optimal}.",
            remedies=({("duration",): None}, {("timing", "method"): Optimal.method}),
        )
    return run.timing.at_cycle(cycle)


def _check_rounding(rounding: Rounding, limits: Limits, name: str, run: RunModel) -> None:
    """Check the key `corners` of a run, or of the job if the run does not specify it."""
    inherited = run.corners is None
    keys: Keys = ("corners",) if inherited else ("runs", name, "corners")
    with error_context(f"Run {name}" if inherited else "", *keys):
        rounding.check(run.timing, key_text(keys))
    if rounding.tolerance is not None:
        return
    if rounding.speed is None or limits.centripetal_acceleration is None:
        raise InvalidInput(
            f"{key_text(keys)} requires either tolerance, the largest corner error, or both speed "
            "and acceleration.",
            key=keys,
            remedies=({("tolerance",): FIRST_TOLERANCE},),
        )
