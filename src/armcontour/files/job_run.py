"""Runs of a job file."""

from __future__ import annotations

import dataclasses

from armcontour.core.errors import InvalidInput, error_context, key_context
from armcontour.core.text import Keys, key_text
from armcontour.files.job_model import JobModel, RunModel
from armcontour.jobs import Rounding, Run
from armcontour.jobs.job import FIRST_TOLERANCE, default_compensation
from armcontour.motion import DEFAULT_CYCLE
from armcontour.planning import Optimal, PlanOptions
from armcontour.robot import Arm, Limits, resolve_limits


def run_of(name: str, model: RunModel, job: JobModel, arm: Arm) -> Run:
    """Make a run of a job; keys that the run does not specify have the values of the job."""
    chosen = model.corners or job.corners
    corners = chosen if isinstance(chosen, Rounding) else None
    with key_context("limits"):
        limits = resolve_limits("A job", arm, Limits(**job.limits))
    with key_context("runs", name, "limits"):
        limits = resolve_limits("A run", arm, Limits(**model.limits), limits)
    if corners is not None and limits.centripetal_acceleration is None:
        # With `corners.speed`, this acceleration determines the corner radius. It also limits the
        # speed in the corners.
        limits = limits.replace(centripetal_acceleration=corners.acceleration)
    commands = {**job.command_limits, **model.command_limits}
    command_limits = None
    keys: Keys = ("runs", name) if model.command_limits else ()
    with key_context(*keys, "command_limits"):
        if commands:
            from armcontour.motion.nearest_commands import check_command_limits

            command_limits = check_command_limits(Limits(**commands), arm.dof)
    if corners is not None:
        keys = ("corners",) if model.corners is None else ("runs", name, "corners")
        with error_context(f"Run {name}" if model.corners is None else "", *keys):
            corners.check(model.timing, key_text(keys))
        if corners.tolerance is None:
            _check_corner_speed(keys, corners, limits)
    cycle = model.cycle or job.cycle or DEFAULT_CYCLE
    compensation = model.compensation or default_compensation(job.servo, arm, job.experiment)
    compensation = dataclasses.replace(compensation, command_limits=command_limits)
    try:
        with error_context(f"runs.{name}"):
            return Run(
                name=name,
                timing=_timing(model, cycle),
                compensation=compensation,
                limits=limits,
                rounding=corners,
                cycle=cycle,
                speed_factor=model.speed_factor or job.speed_factor,
                end_time=model.end_time,
                experiment=job.experiment,
                accuracy=job.accuracy,
                default_compensation=model.compensation is None,
            )
    except InvalidInput as error:
        key = str(error.key[0]) if error.key else ""
        inherited = getattr(job, key, None) is not None and getattr(model, key, None) is None
        error.key = error.key if inherited else ("runs", name, *error.key)
        raise


def _timing(model: RunModel, cycle: float) -> PlanOptions:
    """Timing options of a run, with the values of its keys `duration` and `cycle`."""
    if isinstance(model.timing, Optimal):
        return dataclasses.replace(model.timing, duration=model.duration)
    if model.duration is not None:
        raise InvalidInput(
            f"duration requires the timing method optimal, not {model.timing.method}. Remove "
            "duration, or write timing: {method: optimal}.",
            remedies=({("duration",): None}, {("timing", "method"): Optimal.method}),
        )
    return model.timing.at_cycle(cycle)


def _check_corner_speed(keys: Keys, corners: Rounding, limits: Limits) -> None:
    """Check that rounding of corners without a tolerance has a speed and an acceleration."""
    if corners.speed is None or limits.centripetal_acceleration is None:
        raise InvalidInput(
            f"{key_text(keys)} requires either tolerance, the largest corner error, or both speed "
            "and acceleration.",
            key=keys,
            remedies=({("tolerance",): FIRST_TOLERANCE},),
        )
