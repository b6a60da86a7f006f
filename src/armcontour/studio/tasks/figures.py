"""Figures of a full run, or what the run refuses and where."""

from __future__ import annotations

from typing import Any

from armcontour.errors import ArmContourError, InvalidInput
from armcontour.studio.tasks.request import Request
from armcontour.studio.wire import Frame


def figures(x: Request) -> Frame:
    """Figures of a full run, or what the run refuses and where."""
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
    judge, near = result.judge, result.clearance
    e, least = judge.evaluation, None if near is None else near.least
    header: dict[str, Any] = {
        **{"run": result.run.name, "duration": e.duration, "settled": e.settled},
        **{"rms": e.contour_error.rms, "max": e.contour_error.max},
        "saturated": saturated_joints(judge.execution),
        "demand": e.demand_ratio,
        "clearance": None
        if near is None or least is None
        else {"low": near.low, "pair": [least.first, least.second], "t": least.t},
        "start": result.trajectory(0.0),
        "warnings": result.warnings,
        "notes": [*result.remarks, *x.job.arm.notes],
    }
    return Frame("figures", header)
