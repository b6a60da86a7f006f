"""Figures of a full run, or what the run refuses and where; and what to change of it."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from armcontour.core.errors import ArmContourError, InvalidInput
from armcontour.studio.tasks.request import Request
from armcontour.studio.wire import Frame

if TYPE_CHECKING:
    from armcontour.jobs.improvements import Advice

# Jobs of more segments are not planned again while somebody works on them.
MOST_SEGMENTS = 200
LONG = "The program is long: the command run plans its changes with --changes."
# The steps of what to change for the last figures, by what they are of.
_advising: dict[tuple[str, str | None], Generator[float, None, Advice]] = {}


def figures(x: Request) -> Frame:
    """Figures of a full run, or what the run refuses and where."""
    from armcontour.core.render import frame
    from armcontour.jobs.advice import advising, is_small
    from armcontour.jobs.results import judging_rows
    from armcontour.studio.picture import time_header
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
        **time_header(result.explanation),
        "start": result.trajectory(0.0),
        "warnings": data.warnings,
        "notes": [*data.notes, *x.job.arm.notes],
    }
    _advising.clear()
    if is_small(x.job, MOST_SEGMENTS):
        _advising[x.text, x.run] = advising(x.job, result)
    return Frame("figures", header)


def changes(x: Request) -> Frame:
    """The next step of what to change; the last one has the changes."""
    from armcontour.jobs.advice import advising, is_small

    if not is_small(x.job, MOST_SEGMENTS):
        return Frame("changes", {"run": x.run, "share": 1.0, "changes": [], "note": LONG})
    steps = _advising.get((x.text, x.run)) or advising(x.job, x.result)
    _advising[x.text, x.run] = steps
    try:
        return Frame("changes", {"run": x.run, "share": next(steps)})
    except StopIteration as end:
        advice: Advice = end.value
    found = [
        {
            **{"label": y.label, "effect": y.effect, "edits": [_set(*z) for z in y.edits]},
            "condition": y.condition and f"if {y.condition}",
        }
        for y in advice.improvements
    ]
    return Frame("changes", {"run": x.run, "share": 1.0, "changes": found, "note": advice.note})


def _set(key: str, value: Any) -> dict[str, Any]:
    """The edit that sets a key."""
    return {"do": "set", "key": key, "value": value}
