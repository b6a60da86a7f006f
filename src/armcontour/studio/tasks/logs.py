"""Tasks that read logs of the robot: identification and learning.

Options: `logs`, the names of the logs of successive runs, and `columns` as in `read_log`.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

from armcontour.core.errors import InvalidInput
from armcontour.core.progress import Step
from armcontour.core.render import cells, frame, verdict
from armcontour.core.result import TABLE, Data
from armcontour.studio.page_frame import PageFrame
from armcontour.studio.tasks.request import Request

if TYPE_CHECKING:
    from armcontour.jobs.run_learning import LearningStudy


def identify(request: Request) -> PageFrame:
    """Identify the servo of each joint; the frame has the edit that writes servos into the job."""
    from armcontour.control.identification import ServoFit, identify
    from armcontour.files.robot_file import servo_values

    logs = read_logs(request, commanded=True)
    identification = identify(logs, ServoFit(kinematics=request.job.arm), progress=request.progress)
    data, edits = identification.to_data(), []
    if any(y.written for y in identification.joints):
        edits = [{"do": "set", "key": "servo", "value": servo_values(identification)}]
    facts = {
        "sentence": verdict(data),
        "kept": identification.trusted,
        "label": "Use this servo",
    }
    return PageFrame("result", {**facts, "edits": edits, **_shown(data, logs)})


def learn(request: Request) -> PageFrame:
    """Learn the set-points of the next run; creates the same file as `armcontour learn`."""
    from armcontour.files.exports.table import set_point_pieces

    study = learn_from_logs(request)
    content = "".join(set_point_pieces(study.lesson, study.job.arm.joint_names)).encode()
    name = f"{study.job.name}-{study.plan.run.name}-set_points.csv"
    return PageFrame.of_file(
        name, content, {"label": "Download next set-points", **_shown(study.result)}
    )


def learn_from_logs(request: Request) -> LearningStudy:
    """Learn from the logs of successive runs; returns the learning study."""
    from armcontour.jobs.run_learning import LearningStudy, learn_logs, plan_run

    job, progress = request.whole_job, request.progress
    plan = plan_run(job, request.run, progress)
    lesson = learn_logs(job, plan, read_logs(request), progress=progress)
    return LearningStudy(job=job, plan=plan, lesson=lesson)


def read_logs(request: Request, *, commanded: bool = False) -> list[Any]:
    """Read the logs of a task, with joints in the order of the arm.

    `commanded`: the logs must contain set-points.
    """
    from armcontour.files.log_file import read_run_log

    if not request.logs:
        raise InvalidInput(
            "This task requires a log of the robot. Drop a log on the page and select it."
        )
    request.progress(Step(("reading the log",)))
    columns, names = str(request.option("columns", "")) or None, request.job.arm.joint_names
    try:
        return [read_run_log(y, names, columns=columns, commanded=commanded) for y in request.logs]
    except InvalidInput as error:
        # The message names the log without the folder of uploads.
        raise InvalidInput(str(error).replace(f"{FilePath(request.logs[0]).parent}/", "")) from None


def _shown(data: Data, logs: Sequence[Any] = ()) -> dict[str, Any]:
    """Values, tables and notes of a result, the same as the terminal prints."""
    from armcontour.studio.page_frame import without_options

    tables = [{"title": y.name, "cells": cells(y)} for y in data.tables if y.level <= TABLE]
    notes = [without_options(y) for z in (data, *logs) for y in z.notes]
    return {"rows": frame(data), "tables": tables, "notes": notes}
