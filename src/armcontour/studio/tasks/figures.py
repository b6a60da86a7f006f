"""Figures of a full run, or what the run refuses and where."""

from __future__ import annotations

from dataclasses import replace

from armcontour.errors import ArmContourError, InvalidInput
from armcontour.studio.tasks.request import Request
from armcontour.studio.wire import Frame


def figures(x: Request) -> Frame:
    """Figures of a full run, or what the run refuses and where."""
    from armcontour.core.render import frame
    from armcontour.jobs.results import judging_rows
    from armcontour.studio.preview import Tier
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
    data = result.to_data()
    header = {
        "run": result.run.name,
        "tier": Tier.EXACT,
        "rows": frame(replace(data, rows=judging_rows(result, data.rows))),
        "start": result.trajectory(0.0),
        "warnings": data.warnings,
        "notes": [*data.notes, *x.job.arm.notes],
    }
    return Frame("figures", header)
