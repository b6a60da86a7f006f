"""Tasks that show a run: picture of its plan, exact figures and execution; and advice."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from armcontour.core.errors import ArmContourError, InvalidInput
from armcontour.core.progress import Step
from armcontour.report.message_frame import MessageFrame
from armcontour.robot.scene import BASE, HalfSpace
from armcontour.studio.tasks.request import Request

if TYPE_CHECKING:
    from armcontour.jobs import RunResult
    from armcontour.verification.clearance import PairClearance


def picture(request: Request) -> MessageFrame:
    """Draw the plan of a run, or return a refusal with its position.

    If the figures are not known yet, the plan has no check of collisions.
    """
    from armcontour.studio.plan_frames import picture_frame

    try:
        preview = request.preview
    except ArmContourError as error:
        return _refusal(request, error, tier=1)
    request.progress(Step(("drawing",)))
    return picture_frame(preview, request.view)


def executed(request: Request) -> MessageFrame:
    """Draw the execution of a run whose figures are known; without one if it takes too long."""
    from armcontour.studio.execution_frame import execution_frame

    preview = request.preview
    if not request.previewer.may_execute(preview):
        return MessageFrame("omitted")
    return execution_frame(request.previewer.execute(preview), request.view)


def _refusal(request: Request, error: ArmContourError, *, tier: int) -> MessageFrame:
    """Make the frame of an error; `tier` as for `refusal_header`."""
    from armcontour.studio.plan_frames import refusal_header

    view = arm = None
    # If the data are not a valid job, there is no picture in which to mark a position.
    with suppress(InvalidInput):
        view = request.view
        arm = request.job.arm
    header = refusal_header(error, view, tier=tier, run=request.run or "", arm=arm)
    return MessageFrame("refusal", header)


def figures(request: Request) -> MessageFrame:
    """Compute the exact figures of a run, or return a refusal with its position."""
    from armcontour.core.render import frame
    from armcontour.core.result import VERDICT, Row
    from armcontour.jobs.rows import with_worst_execution
    from armcontour.report.arm_frame import nearest_pair
    from armcontour.studio.plan_frames import Tier, time_header

    try:
        result = request.result
    except ArmContourError as error:
        return _refusal(request, error, tier=3)
    request.progress(Step(("figures",)))
    data = with_worst_execution(result, result.to_data())
    obstacle = _nearest_to_obstacles(request, result)
    if obstacle is not None:
        row = Row("obstacle", obstacle.low, "m", "to the obstacles", obstacle.bodies, VERDICT)
        data = replace(data, rows=(*data.rows, row))
    header = {
        "run": result.run.name,
        "tier": Tier.EXACT,
        "rows": frame(data),
        "obstacle_t": obstacle and obstacle.t,
        **time_header(result.explanation),
        "nearest": nearest_pair(result),
        "warnings": data.warnings,
        "notes": [*data.notes, *request.job.arm.notes],
    }
    return MessageFrame("figures", header)


def _nearest_to_obstacles(request: Request, result: RunResult) -> PairClearance | None:
    """Return the nearest pair with an obstacle on the base; pairs of links can be nearer.

    Its lower bound is accurate, while those of pairs with larger distances can be much too small.
    """
    scene = request.job.scene
    bodies = () if scene is None else scene.obstacles
    names = {x.name for x in bodies if x.fixed_to == BASE and not isinstance(x.shape, HalfSpace)}
    pairs = () if result.clearance is None else result.clearance.pairs
    with_obstacle = (x for x in pairs if names & {x.first, x.second})
    return min(with_obstacle, key=lambda x: x.high, default=None)


def changes(request: Request) -> MessageFrame:
    """Propose changes of the run that save time, or that repair it."""
    from armcontour.core.render import number
    from armcontour.jobs.advice import advise

    advice = advise(request.job, request.result, request.progress)
    proposals = [
        {
            "label": f"{x.label}: {x.effect}",
            "short": f"{x.edits[0][0].rpartition('.')[2].capitalize()}: "
            + number(-x.saved, "s").replace("-", "−"),
            "condition": x.condition,
            "edits": [_set(*y) for y in x.edits],
        }
        for x in advice.improvements
    ]
    return MessageFrame("result", {"sentence": advice.note, "changes": proposals})


def _set(key: str, value: Any) -> dict[str, Any]:
    return {"do": "set", "key": key, "value": value}
