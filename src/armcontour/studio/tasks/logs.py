"""Tasks on logs of the robot: plan against measured, servos of the joints, next set-points.

The option `logs` names the logs of successive runs, each of the set-points that the logs before it
teach; `columns` names columns as `read_log` takes them.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

import numpy as np

from armcontour.core.errors import InvalidInput
from armcontour.core.progress import Step
from armcontour.core.render import cells, frame, verdict
from armcontour.core.result import TABLE, Data
from armcontour.studio.tasks.request import Request
from armcontour.studio.wire import Frame

if TYPE_CHECKING:
    from armcontour.jobs.run_learning import LearningStudy


def measured(x: Request) -> Frame:
    """The plan against the last log: contour errors, and the measured motion of the tool."""
    from armcontour.jobs.run_learning import judge_last
    from armcontour.studio.executed import tool_lines

    logs = read_logs(x)
    study = judge_last(x.whole_job, x.run, logs, x.progress)
    arrays = tool_lines(study.pieces, x.view)
    arrays["t"] = arrays["t"] + np.float32(study.early)
    facts = {"run": study.plan.run.name, "times": study.worst_times}
    return Frame("result", {**facts, **_shown(study.result, logs[-1:])}, arrays)


def identify(x: Request) -> Frame:
    """The servo of each joint from the logs, and the edit that puts it into the job."""
    from armcontour.control.identification import ServoFit, identify
    from armcontour.files.robot_file import servo_values

    logs = read_logs(x, commanded=True)
    found = identify(logs, ServoFit(kinematics=x.job.arm), progress=x.progress)
    data, edits = found.to_data(), []
    if any(y.written for y in found.joints):
        edits = [{"do": "set", "key": "servo", "value": servo_values(found)}]
    facts = {"sentence": verdict(data), "kept": found.judgement.trusted, "label": "Use this servo"}
    return Frame("result", {**facts, "edits": edits, **_shown(data, logs)})


def learn(x: Request) -> Frame:
    """The set-points of the next run, as `armcontour learn` writes them."""
    from armcontour.files.exports.table import set_point_pieces

    study = learned(x)
    content = "".join(set_point_pieces(study.lesson, study.job.arm.joint_names)).encode()
    name = f"{study.job.name}-{study.plan.run.name}-set_points.csv"
    return Frame.of_file(
        name, content, {"label": "Download next set-points", **_shown(study.result)}
    )


def learned(x: Request) -> LearningStudy:
    """Set-points learned from the logs of successive runs."""
    from armcontour.jobs.run_learning import learn_logs

    return learn_logs(x.whole_job, x.run, read_logs(x), x.progress)


def read_logs(x: Request, *, commanded: bool = False) -> list[Any]:
    """The logs of a task, with joints in the order of the arm.

    Args:
        x: The task.
        commanded: Whether set-points are needed.

    Raises:
        InvalidInput: There is none, or one that cannot be read.
    """
    from armcontour.files.log_file import read_run_log

    if not x.logs:
        raise InvalidInput("This needs a log of the robot: drop one on the page, and tick it.")
    x.progress(Step(("reading the log",)))
    columns, names = str(x.option("columns", "")) or None, x.job.arm.joint_names
    try:
        return [read_run_log(y, names, columns=columns, commanded=commanded) for y in x.logs]
    except InvalidInput as error:
        # Logs are told by their names, not by the folder in which they are kept.
        raise InvalidInput(str(error).replace(f"{FilePath(x.logs[0]).parent}/", "")) from None


def _shown(data: Data, logs: Sequence[Any] = ()) -> dict[str, Any]:
    """What the terminal prints of a result: figures, tables and notes, also those of logs."""
    from armcontour.studio.tabs import without_options

    tables = [{"title": y.name, "cells": cells(y)} for y in data.tables if y.level <= TABLE]
    notes = [without_options(y) for z in (data, *logs) for y in z.notes]
    return {"rows": frame(data), "tables": tables, "notes": notes}
