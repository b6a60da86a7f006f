"""The set-points of a run as it was given to a robot: compared with its job, with its history."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path as FilePath

import numpy as np

from armcontour.control.learning import LearningResult
from armcontour.core.errors import InvalidInput
from armcontour.files.joint_table import TrajectoryFile
from armcontour.files.lesson_file import read_lesson
from armcontour.files.results import verify_file
from armcontour.files.trajectory_file import read_trajectory
from armcontour.jobs import Job, RunResult
from armcontour.motion import SetPoints

# The file of what was learned so far, beside the set-points of the next run.
LESSON = "lesson.npz"
# Set-points that a job makes again are the same within this [rad]: other versions of the libraries
# round differently.
SAME = 1e-9


def read_taught(place: FilePath, job: Job, plan: RunResult) -> SetPoints:
    """The set-points in a file of set-points, with what was learned before.

    The set-points are those that the job makes, or those of the lesson in the same folder, exact to
    the last bit. The file is compared with them, within its printed digits. Set-points of a result
    folder with the plan of the job are valid also if the servo of the job has changed since.

    Args:
        place: The file `set_points.csv` of a run, or a result folder that has it.
        job: The job.
        plan: Plan and set-points of the job's run.

    Raises:
        InvalidInput: No such file, or one with other set-points.
    """
    name = plan.run.name
    file = verify_file(place, f"{name}/set_points.csv") if place.is_dir() else place
    history = file.parent / LESSON
    same_plan = place.is_dir() and _has_same_plan(place, job, plan)
    if not history.exists():
        if same_plan and (found := _recorded(file, job, plan)) is not None:
            return found
        again = f"the job {job.name} makes for its run {name}"
        mend = "give the job that made this file, with the same options"
        _refuse_other(file, job, plan.set_points, again, mend)
        return plan.set_points
    lesson = read_lesson(history, plan.trajectory)
    if not same_plan:
        _refuse_other_job(history, lesson, job, plan)
    _refuse_other(
        file, job, lesson, f"{history.name} beside it has", "give both as learn wrote them"
    )
    return replace(lesson, command_limits=plan.set_points.command_limits)


def _has_same_plan(folder: FilePath, job: Job, plan: RunResult) -> bool:
    """Whether a result folder has the planned motion of a run."""
    file = verify_file(folder, f"{plan.run.name}/planned.csv")
    found, duration = read_trajectory(file, job.arm.joint_names), plan.trajectory.duration
    if abs(found.t[-1] - duration) > plan.set_points.cycle or found.q.shape[1] != job.arm.dof:
        return False
    off = np.abs(found.q - plan.trajectory.with_rests(found.t)).max()
    return bool(off <= found.resolution["q"] + SAME)


def _recorded(file: FilePath, job: Job, plan: RunResult) -> SetPoints | None:
    """Set-points of the file for the plan of a job; None if the job makes the same ones."""
    found, now = read_trajectory(file, job.arm.joint_names), plan.set_points
    steps = np.abs(np.diff(found.t) - now.cycle)
    same = found.q.shape == now.q.shape and abs(found.t[0] - now.t[0]) <= _near(found)
    if steps.max() > 2 * _near(found):
        return None
    if same and np.abs(found.q - now.q).max() <= found.resolution["q"] + SAME:
        return None
    return replace(
        now, q=found.q, start_time=min(float(found.t[0]), 0.0), truncated=None, limit_cost=None
    )


def _refuse_other(file: FilePath, job: Job, set_points: SetPoints, has: str, mend: str) -> None:
    """Refuse a file that has not the given set-points.

    Raises:
        InvalidInput: It has others.
    """
    found = read_trajectory(file, job.arm.joint_names)
    problem = ""
    if found.q.shape != set_points.q.shape:
        rows, dof = found.q.shape
        count, joints = set_points.q.shape
        problem = (
            f"{rows} set-points of {dof} joints, not the {count} of {joints} joints that {has}"
        )
    else:
        off = np.abs(found.q - set_points.q)
        k, j = np.unravel_index(int(np.argmax(off)), off.shape)
        if off[k, j] > found.resolution["q"] + SAME:
            problem = (
                f"other set-points than {has}: {job.arm.joint_names[j]} differs by "
                f"{off[k, j]:.3g} rad at t = {found.t[k]:.4g} s"
            )
        # Exports begin at zero, set-points that lead their plan before it.
        elif np.abs((found.t - found.t[0]) - (set_points.t - set_points.t[0])).max() > _near(found):
            problem = f"set-points at other times than {has}"
    if problem:
        raise InvalidInput(f"{file} has {problem}: {mend}, or begin again with run.")


def _near(found: TrajectoryFile) -> float:
    """Times of a file that differ by less are the same [s]."""
    return found.resolution["t"] + SAME


def _refuse_other_job(history: FilePath, lesson: LearningResult, job: Job, plan: RunResult) -> None:
    """Refuse a lesson that began with other set-points than the job makes.

    Raises:
        InvalidInput: It did, or has another interval.
    """
    first, now = lesson.runs[0].q, plan.set_points.q
    same = first.shape == now.shape and lesson.cycle == plan.set_points.cycle
    if not same or np.abs(first - now).max() > SAME:
        raise InvalidInput(
            f"{history} was learned with other set-points at its beginning than the job "
            f"{job.name} makes for its run {plan.run.name}: give the job as it was, with the same "
            "options, or begin again with the set-points of run."
        )
