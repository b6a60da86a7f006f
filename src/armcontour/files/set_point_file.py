"""Set-points of a run and the learning results stored with them."""

from __future__ import annotations

import dataclasses
import io
import json
import zipfile
from dataclasses import replace
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from armcontour._version import __version__
from armcontour.control.learning import LearningResult, LearningRun
from armcontour.core.errors import InvalidInput
from armcontour.core.file_access import LARGE, read_bytes
from armcontour.files.joint_table import TrajectoryFile
from armcontour.files.result_folder import verify_file
from armcontour.files.trajectory_file import read_trajectory
from armcontour.jobs import Job, RunResult
from armcontour.motion import SetPoints, Trajectory
from armcontour.robot.servo import ServoModel

# Changes with the content of these files.
VERSION = 3
# Recomputed fields: plan and command limits from the job, the response model from the plan.
LEFT_OUT = ("trajectory", "runs", "lifted", "servo", "misfits", "command_limits", "limit_cost")
RUN = "run {}: {}"
# Entry with everything that is no array.
ABOUT = "about.json"


def write_lesson(file: FilePath, lesson: LearningResult) -> None:
    """Write a lesson with all its runs to a file, without the plan."""
    arrays, plain = _split(lesson, LEFT_OUT)
    runs = []
    for number, run in enumerate(lesson.runs, start=1):
        run_arrays, plain_run = _split(run)
        arrays |= {RUN.format(number, name): values for name, values in run_arrays.items()}
        runs.append(plain_run)
    about = {
        "version": VERSION,
        "armcontour": __version__,
        "lesson": plain,
        "servo": {
            x.name: value.tolist() if isinstance(value, np.ndarray) else value
            for x in dataclasses.fields(lesson.servo)
            for value in [getattr(lesson.servo, x.name)]
        },
        "misfits": lesson.misfits,
        "runs": runs,
    }
    # Equal lessons are equal files: neither numpy nor ZipInfo writes the present time.
    with file.open("wb") as stream:
        np.savez_compressed(stream, **arrays)
    with zipfile.ZipFile(file, "a") as target:
        target.writestr(zipfile.ZipInfo(ABOUT), json.dumps(about, indent=1), zipfile.ZIP_DEFLATED)


def read_lesson(file: FilePath, plan: Trajectory) -> LearningResult:
    """Read a lesson that `write_lesson` wrote."""
    content = read_bytes(file, "file of learning")
    try:
        with np.load(io.BytesIO(content), allow_pickle=False) as source:
            if sum(x.file_size for x in source.zip.infolist()) > LARGE:
                raise ValueError("its content is too large")
            about = json.loads(source[ABOUT])
            if about["version"] != VERSION:
                raise InvalidInput(
                    f"it is of version {about['version']} of such files, by armcontour "
                    f"{about['armcontour']}, and armcontour {__version__} reads version {VERSION}: "
                    "learn with that one, or begin again with the set-points of the job."
                )
            arrays: dict[str, Any] = {x: source[x] for x in source.files if x != ABOUT}
        runs = []
        for number, plain in enumerate(about["runs"], start=1):
            start = RUN.format(number, "")
            run_arrays = {
                x.removeprefix(start): y for x, y in arrays.items() if x.startswith(start)
            }
            runs.append(LearningRun(**plain, **run_arrays))
        before, after = about["misfits"]
        return LearningResult(
            trajectory=plan,
            runs=tuple(runs),
            servo=ServoModel(**about["servo"]),
            misfits=(before, after),
            **about["lesson"],
            **{x: y for x, y in arrays.items() if ": " not in x},
        )
    except InvalidInput as error:
        raise error.with_location(str(file)) from None
    except Exception as error:
        # A damaged zip file can raise almost anything.
        raise InvalidInput(
            f"{file} is no file of learning, or is damaged ({type(error).__name__}): begin again "
            "with the set-points of the job."
        ) from None


def _split(
    value: LearningResult | LearningRun, left_out: tuple[str, ...] = ()
) -> tuple[dict[str, Any], dict[str, Any]]:
    """The fields of a dataclass that are arrays, and those that are numbers or text."""
    named = {
        x.name: getattr(value, x.name) for x in dataclasses.fields(value) if x.name not in left_out
    }
    arrays = {name: x for name, x in named.items() if isinstance(x, np.ndarray)}
    return arrays, {name: x for name, x in named.items() if name not in arrays}


# The file of the learning history, next to the set-points of the next run.
LESSON = "lesson.npz"
# Recomputed set-points agree within this [rad]: versions of libraries round differently.
SAME = 1e-9


def read_set_points(location: FilePath, job: Job, plan: RunResult) -> SetPoints:
    """The set-points in a file of set-points, with the learning history."""
    # The set-points are those that the job makes, or those of the lesson in the same folder, exact
    # to the last bit. The file is compared with them, within its printed digits. Set-points of a
    # result folder with the plan of the job are valid also if the servo of the job has changed
    # since.
    name = plan.run.name
    file = verify_file(location, f"{name}/set_points.csv") if location.is_dir() else location
    history = file.parent / LESSON
    same_plan = location.is_dir() and _has_same_plan(location, job, plan)
    if not history.exists():
        if same_plan and (recorded := _recorded(file, job, plan)) is not None:
            return recorded
        again = f"the job {job.name} makes for its run {name}"
        mend = "give the job that made this file, with the same options"
        _check_same_set_points(file, job, plan.set_points, again, mend)
        return plan.set_points
    lesson = read_lesson(history, plan.trajectory)
    if not same_plan:
        _check_same_job(history, lesson, job, plan)
    _check_same_set_points(
        file, job, lesson, f"{history.name} next to it has", "give both as learn wrote them"
    )
    return replace(lesson, command_limits=plan.set_points.command_limits)


def _has_same_plan(folder: FilePath, job: Job, plan: RunResult) -> bool:
    """True if a result folder has the planned motion of a run."""
    file = verify_file(folder, f"{plan.run.name}/planned.csv")
    planned, duration = read_trajectory(file, job.arm.joint_names), plan.trajectory.duration
    if abs(planned.t[-1] - duration) > plan.set_points.cycle or planned.q.shape[1] != job.arm.dof:
        return False
    deviation = np.abs(planned.q - plan.trajectory.with_rests(planned.t)).max()
    return bool(deviation <= planned.resolution["q"] + SAME)


def _recorded(file: FilePath, job: Job, plan: RunResult) -> SetPoints | None:
    """Set-points of the file for the plan of a job; None if the job makes the same ones."""
    recorded, current = read_trajectory(file, job.arm.joint_names), plan.set_points
    steps = np.abs(np.diff(recorded.t) - current.cycle)
    same = recorded.q.shape == current.q.shape and abs(recorded.t[0] - current.t[0]) <= _near(
        recorded
    )
    if steps.max() > 2 * _near(recorded):
        return None
    if same and np.abs(recorded.q - current.q).max() <= recorded.resolution["q"] + SAME:
        return None
    return replace(
        current,
        q=recorded.q,
        start_time=min(float(recorded.t[0]), 0.0),
        truncated=None,
        limit_cost=None,
    )


def _check_same_set_points(
    file: FilePath, job: Job, set_points: SetPoints, has: str, mend: str
) -> None:
    """Check that a file has the given set-points."""
    stored = read_trajectory(file, job.arm.joint_names)
    problem = ""
    if stored.q.shape != set_points.q.shape:
        rows, dof = stored.q.shape
        count, joints = set_points.q.shape
        problem = (
            f"{rows} set-points of {dof} joints, not the {count} of {joints} joints that {has}"
        )
    else:
        deviation = np.abs(stored.q - set_points.q)
        k, j = np.unravel_index(int(np.argmax(deviation)), deviation.shape)
        if deviation[k, j] > stored.resolution["q"] + SAME:
            problem = (
                f"other set-points than {has}: {job.arm.joint_names[j]} differs by "
                f"{deviation[k, j]:.3g} rad at t = {stored.t[k]:.4g} s"
            )
        # Exports begin at zero, set-points that lead their plan before it.
        elif np.abs((stored.t - stored.t[0]) - (set_points.t - set_points.t[0])).max() > _near(
            stored
        ):
            problem = f"set-points at other times than {has}"
    if problem:
        raise InvalidInput(f"{file} has {problem}: {mend}, or begin again with run.")


def _near(stored: TrajectoryFile) -> float:
    """Tolerance for equal times of a file [s]."""
    return stored.resolution["t"] + SAME


def _check_same_job(history: FilePath, lesson: LearningResult, job: Job, plan: RunResult) -> None:
    """Check that a learning history began with the set-points of the job."""
    first, current = lesson.runs[0].q, plan.set_points.q
    same = first.shape == current.shape and lesson.cycle == plan.set_points.cycle
    if not same or np.abs(first - current).max() > SAME:
        raise InvalidInput(
            f"{history} was learned with other set-points at its beginning than the job "
            f"{job.name} makes for its run {plan.run.name}: give the job as it was, with the same "
            "options, or begin again with the set-points of run."
        )
