"""Reader for the set-points of a run, with the lesson that is next to them, if any."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path as FilePath

import numpy as np

from armcontour.control.learning import LearningResult
from armcontour.core.errors import InvalidInput
from armcontour.files.lesson_file import LESSON, read_lesson
from armcontour.files.result_folder import verify_file
from armcontour.files.trajectory_file import read_trajectory
from armcontour.jobs import Job, RunResult
from armcontour.motion import SetPoints

# Largest deviation of set-points [rad] and times [s] that are computed again. Versions of libraries
# round differently.
TOLERANCE = 1e-9


def read_set_points(location: FilePath, job: Job, plan: RunResult) -> SetPoints:
    """Read executed set-points of a job; a `LearningResult` if the folder has a lesson.

    Args:
        location: File of set-points, or folder of a result.
        job: The job.
        plan: Plan of the run.

    Raises:
        InvalidInput: The file cannot be read, or its set-points are neither those of the job nor
            those of the lesson.
    """
    # The returned set-points are those of the job, or of the lesson in the same folder, because the
    # file has rounded numbers. The file must equal them within its printed digits. If a result
    # folder has the plan of the job but other set-points, for example because the servo of the job
    # has changed since, the set-points of the file are returned.
    name = plan.run.name
    current = plan.set_points
    file = verify_file(location, f"{name}/set_points.csv") if location.is_dir() else location
    history = file.parent / LESSON
    same_plan = location.is_dir() and _has_same_plan(location, job, plan)
    lesson = read_lesson(history, plan.trajectory) if history.exists() else None
    if lesson is not None and not same_plan:
        _check_same_job(history, lesson, job, plan)
    expected = current if lesson is None else lesson
    stored = read_trajectory(file, job.arm.joint_names)
    rounding = stored.resolution["t"] + TOLERANCE
    same = stored.q.shape == expected.q.shape and bool(
        np.abs(stored.q - expected.q).max() <= stored.resolution["q"] + TOLERANCE
    )
    if lesson is None and same_plan:
        regular = np.abs(np.diff(stored.t) - current.cycle).max() <= 2 * rounding
        if regular and not (same and abs(stored.t[0] - current.t[0]) <= rounding):
            start = min(float(stored.t[0]), 0.0)
            return replace(current, q=stored.q, start_time=start, truncated=None, limit_cost=None)
    # Times are compared relative to the first set-point, because exports start at zero, but
    # set-points that lead the plan start at a negative time.
    if same:
        late = (stored.t - stored.t[0]) - (expected.t - expected.t[0])
        same = bool(np.abs(late).max() <= rounding)
    if not same:
        has = f"the run {name} of the job {job.name} has"
        remedy = "Specify the job that produced this file, with the same options"
        if lesson is not None:
            has = f"{history.name} in its folder has"
            remedy = "Specify both files as learn wrote them"
        raise InvalidInput(
            f"{file} has other set-points than {has}. {remedy}, or start again with run."
        )
    return current if lesson is None else replace(lesson, rule=current.rule)


def _has_same_plan(folder: FilePath, job: Job, plan: RunResult) -> bool:
    """Return whether the planned motion in a result folder equals the plan of a run."""
    file = verify_file(folder, f"{plan.run.name}/planned.csv")
    planned = read_trajectory(file, job.arm.joint_names)
    duration = plan.trajectory.duration
    if abs(planned.t[-1] - duration) > plan.set_points.cycle or planned.q.shape[1] != job.arm.dof:
        return False
    deviation = np.abs(planned.q - plan.trajectory.with_rests(planned.t)).max()
    return bool(deviation <= planned.resolution["q"] + TOLERANCE)


def _check_same_job(history: FilePath, lesson: LearningResult, job: Job, plan: RunResult) -> None:
    """Check that a lesson started with the set-points of the job."""
    first = lesson.runs[0].q
    current = plan.set_points.q
    same = first.shape == current.shape and lesson.cycle == plan.set_points.cycle
    if not same or np.abs(first - current).max() > TOLERANCE:
        raise InvalidInput(
            f"The learning of {history} started with other set-points than the run "
            f"{plan.run.name} of the job {job.name} has. Specify the original job with the same "
            "options, or start again with the set-points of run."
        )
