"""What a full run gives: its figures, or what it refuses and where, and the picture of its plan."""

from __future__ import annotations

from typing import Any

import numpy as np

from armcontour.errors import ArmContourError, InvalidInput
from armcontour.studio.tasks.request import Request
from armcontour.studio.wire import Frame

# Motions whose starts differ by more are in different configurations [rad].
SAME = 0.01
OTHER_CONFIGURATION = "The full run starts in another configuration of the arm than the preview."


def figures(x: Request) -> Frame:
    """The figures of a full run, or what it refuses and where.

    Options: `start`, joint positions at the start of the preview, to say where they differ.
    """
    from armcontour.studio.demand import saturated_joints
    from armcontour.studio.refusals import refusal_header

    try:
        result = x.result
    except ArmContourError as error:
        try:
            told = refusal_header(error, x.view, tier=3, run=x.run or "")
        except InvalidInput:
            # The data make no job, so that there is no plane to draw in.
            told = {"tier": 3, "run": x.run, "sentence": str(error), "at": {}}
        return Frame("refusal", told)
    e, near, start = result.evaluation, result.clearance, result.trajectory(0.0)
    least = None if near is None else near.least
    off = e.objective_error
    header: dict[str, Any] = {
        **{"run": result.run.name, "duration": e.duration, "settled": e.settled},
        **{"rms": e.contour_error.rms, "max": e.contour_error.max, "t_max": e.contour_error.t_max},
        "objective_max": None if off is None else off.max,
        "missed": e.missed.max,
        "saturated": saturated_joints(result.execution),
        "demand": e.demand_ratio,
        "limit_use": e.limit_ratios,
        "clearance": None
        if least is None
        else {"least": least.high, "pair": [least.first, least.second], "t": least.t},
        "start": start,
        "warnings": result.warnings,
        "notes": [
            *result.remarks,
            *x.job.arm.notes,
        ],
    }
    preview = x.options.get("start")
    if preview is not None and np.abs(start - preview).max() > SAME:
        header["notes"].append(OTHER_CONFIGURATION)
    return Frame("figures", header)


def plan(x: Request) -> Frame:
    """The picture of the plan as a full run has it, in whatever time that takes."""
    from armcontour.studio.picture import picture_frame

    planned = x.previewer.plan(x.data, x.run, exact=True, progress=x.progress)
    return picture_frame(planned, x.view)
