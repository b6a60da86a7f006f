"""Tasks that compute the exact figures of a run, and advice."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from armcontour.core.errors import ArmContourError, InvalidInput
from armcontour.studio.page_frame import PageFrame
from armcontour.studio.tasks.request import Request

if TYPE_CHECKING:
    from armcontour.jobs.run_result import Advice


# Maximum number of segments of a job for which the Studio computes advice. Advice requires many
# plans of the job.
MAX_SEGMENTS = 200
LONG_NOTE = (
    "The Studio computes no proposals for this program, because it is long. Use the command "
    "armcontour run with --changes."
)
# Generator that computes the advice for the last figures, by text and run.
_advising: dict[tuple[str, str | None], Generator[float, None, Advice]] = {}


def figures(request: Request) -> PageFrame:
    """Frame with the exact figures of a run, or a refusal with the position of the error."""
    from armcontour.core.render import frame
    from armcontour.jobs.advice import advice_steps, is_small
    from armcontour.jobs.rows import judging_rows
    from armcontour.studio.picture import refusal_header, time_header
    from armcontour.studio.preview import Tier

    try:
        result = request.result
    except ArmContourError as error:
        try:
            refusal = refusal_header(error, request.view, tier=3, run=request.run or "")
        except InvalidInput:
            # The data are not a valid job, so there is no picture in which to mark a position.
            refusal = {"tier": 3, "run": request.run, "sentence": str(error), "at": {}}
        return PageFrame("refusal", refusal)
    data = result.to_data()
    header = {
        "run": result.run.name,
        "tier": Tier.EXACT,
        "rows": frame(replace(data, rows=judging_rows(result, data.rows))),
        **time_header(result.explanation),
        "start": result.trajectory(0.0),
        "warnings": data.warnings,
        "notes": [*data.notes, *request.job.arm.notes],
    }
    _advising.clear()
    if is_small(request.job, MAX_SEGMENTS):
        _advising[request.text, request.run] = advice_steps(request.job, result)
    return PageFrame("figures", header)


def changes(request: Request) -> PageFrame:
    """Compute the next step of the advice; the frame of the last step has the proposed changes."""
    from armcontour.jobs.advice import advice_steps, is_small

    if not is_small(request.job, MAX_SEGMENTS):
        return PageFrame(
            "changes", {"run": request.run, "share": 1.0, "changes": [], "note": LONG_NOTE}
        )
    steps = _advising.get((request.text, request.run)) or advice_steps(request.job, request.result)
    _advising[request.text, request.run] = steps
    try:
        return PageFrame("changes", {"run": request.run, "share": next(steps)})
    except StopIteration as end:
        advice: Advice = end.value
    proposals = [
        {
            **{"label": y.label, "effect": y.effect, "edits": [_set(*z) for z in y.edits]},
            "condition": y.condition and f"if {y.condition}",
        }
        for y in advice.improvements
    ]
    return PageFrame(
        "changes", {"run": request.run, "share": 1.0, "changes": proposals, "note": advice.note}
    )


def _set(key: str, value: Any) -> dict[str, Any]:
    return {"do": "set", "key": key, "value": value}
