"""Reader for the set-points of a run, with the lesson that is next to them, if any."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path as FilePath

import numpy as np

from armcontour.control.learning import LearningResult
from armcontour.core.errors import InvalidInput
from armcontour.files.joint_table import TrajectoryFile
from armcontour.files.lesson_file import LESSON, read_lesson
from armcontour.files.result_folder import verify_file
from armcontour.files.trajectory_file import read_trajectory
from armcontour.jobs import Job, RunResult
from armcontour.motion import SetPoints

# Largest deviation of set-points [rad] and times [s] that are computed again. Versions of libraries
# round differently.
TOLERANCE = 1e-9


def read_set_points(location: FilePath, job: Job, plan: RunResult) -> SetPoints:
    """Set-points of a file or result folder; a `LearningResult` if the folder has a lesson."""
    # The returned set-points are those of the job, or of the lesson in the same folder, because the
    # file has rounded numbers. The file must equal them within its printed digits. If a result
    # folder has the plan of the job but other set-points, for example because the servo of the job
    # has changed since, the set-points of the file are returned.
    name = plan.run.name
    file = verify_file(location, f"{name}/set_points.csv") if location.is_dir() else location
    history = file.parent / LESSON
    same_plan = location.is_dir() and _has_same_plan(location, job, plan)
    if not history.exists():
        if same_plan and (recorded := _recorded_set_points(file, job, plan)) is not None:
            return recorded
        again = f"the run {name} of the job {job.name} has"
        remedy = "Specify the job that produced this file, with the same options"
        _check_same_set_points(file, job, plan.set_points, again, remedy)
        return plan.set_points
    lesson = read_lesson(history, plan.trajectory)
    if not same_plan:
        _check_same_job(history, lesson, job, plan)
    _check_same_set_points(
        file,
        job,
        lesson,
        f"{history.name} in its folder has",
        "Specify both files as learn wrote them",
    )
    return replace(lesson, command_limits=plan.set_points.command_limits)


def _has_same_plan(folder: FilePath, job: Job, plan: RunResult) -> bool:
    """Return whether the planned motion in a result folder equals the plan of a run."""
    file = verify_file(folder, f"{plan.run.name}/planned.csv")
    planned, duration = read_trajectory(file, job.arm.joint_names), plan.trajectory.duration
    if abs(planned.t[-1] - duration) > plan.set_points.cycle or planned.q.shape[1] != job.arm.dof:
        return False
    deviation = np.abs(planned.q - plan.trajectory.with_rests(planned.t)).max()
    return bool(deviation <= planned.resolution["q"] + TOLERANCE)


def _recorded_set_points(file: FilePath, job: Job, plan: RunResult) -> SetPoints | None:
    """Set-points of a file, with the plan of a job; None if they equal the set-points of the job.

    Also None if the cycle of the file differs from that of the job.
    """
    recorded, current = read_trajectory(file, job.arm.joint_names), plan.set_points
    steps = np.abs(np.diff(recorded.t) - current.cycle)
    same = recorded.q.shape == current.q.shape and abs(
        recorded.t[0] - current.t[0]
    ) <= _time_tolerance(recorded)
    if steps.max() > 2 * _time_tolerance(recorded):
        return None
    if same and np.abs(recorded.q - current.q).max() <= recorded.resolution["q"] + TOLERANCE:
        return None
    return replace(
        current,
        q=recorded.q,
        start_time=min(float(recorded.t[0]), 0.0),
        truncated=None,
        limit_cost=None,
    )


def _check_same_set_points(
    file: FilePath, job: Job, set_points: SetPoints, has: str, remedy: str
) -> None:
    """Check that a file has the given set-points; `has` and `remedy` are parts of the message."""
    stored = read_trajectory(file, job.arm.joint_names)
    same = stored.q.shape == set_points.q.shape
    if same:
        deviation = np.abs(stored.q - set_points.q).max()
        # Times are compared relative to the first set-point, because exports start at zero, but
        # set-points that lead the plan start at a negative time.
        late = np.abs((stored.t - stored.t[0]) - (set_points.t - set_points.t[0])).max()
        same = deviation <= stored.resolution["q"] + TOLERANCE and late <= _time_tolerance(stored)
    if not same:
        raise InvalidInput(
            f"{file} has other set-points than {has}. {remedy}, or start again with run."
        )


def _time_tolerance(stored: TrajectoryFile) -> float:
    """Largest difference due to rounding between a time in a file and the exact time [s]."""
    return stored.resolution["t"] + TOLERANCE


def _check_same_job(history: FilePath, lesson: LearningResult, job: Job, plan: RunResult) -> None:
    """Check that a lesson started with the set-points of the job."""
    first, current = lesson.runs[0].q, plan.set_points.q
    same = first.shape == current.shape and lesson.cycle == plan.set_points.cycle
    if not same or np.abs(first - current).max() > TOLERANCE:
        raise InvalidInput(
            f"The learning of {history} started with other set-points than the run "
            f"{plan.run.name} of the job {job.name} has. Specify the original job with the same "
            "options, or start again with the set-points of run."
        )
