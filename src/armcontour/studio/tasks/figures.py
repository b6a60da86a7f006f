"""Tasks that show a run: picture of its plan, exact figures and execution; and advice."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from armcontour.core.errors import ArmContourError, InvalidInput
from armcontour.core.progress import Step, subprogress
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
    try:
        result = request.result
    except ArmContourError as error:
        return _refusal(request, error, tier=3)
    request.progress(Step(("figures",)))
    return MessageFrame("figures", exact_figures(request, result))


def exact_figures(request: Request, result: RunResult) -> dict[str, Any]:
    """Make the header of a frame `figures`: the values of a full run."""
    from armcontour.core.render import frame
    from armcontour.core.result import VERDICT, Row
    from armcontour.jobs.rows import with_worst_execution
    from armcontour.report.arm_frame import nearest_pair
    from armcontour.studio.plan_frames import Tier, time_header

    data = with_worst_execution(result, result.to_data())
    obstacle = _nearest_to_obstacles(request, result)
    own = _nearest_links(request, result)
    pairs = [("obstacle", "to the obstacles", obstacle), ("own_links", "between own links", own)]
    if obstacle is not None:
        # Without obstacles, the clearance is between the arm's own bodies.
        near = [
            Row(x, pair.low, "m", label, pair.bodies, VERDICT) for x, label, pair in pairs if pair
        ]
        data = replace(data, rows=(*data.rows, *near))
    return {
        "run": result.run.name,
        "tier": Tier.EXACT,
        "rows": frame(data),
        "off_t": _worst_time(result),
        "obstacle_t": obstacle and obstacle.t,
        "own_links_t": own and own.t,
        "margins": _margins(result, obstacle, own),
        **time_header(result.explanation),
        "nearest": nearest_pair(result),
        "warnings": data.warnings,
        "notes": [*data.notes, *request.job.arm.notes],
    }


def compare(request: Request) -> MessageFrame:
    """Compute the exact figures of several runs, named in the option `runs`, or why they fail."""
    names = request.option("runs", [])
    if not isinstance(names, list) or not set(map(str, names)) <= set(request.data["runs"]):
        raise InvalidInput("The option runs of the task compare must be a list of names of runs.")
    rows = []
    for name in map(str, names):
        one = replace(request, run=name, progress=subprogress(request.progress, f"run {name}"))
        try:
            rows.append(exact_figures(one, one.result))
        except ArmContourError as error:
            rows.append({"run": name, "sentence": str(error)})
    return MessageFrame("result", {"runs": rows})


def _worst_time(result: RunResult) -> float | None:
    """Return the time of the largest distance from the drawing [s]; None without an execution."""
    if result.judged is None or not result.judged.drawing_errors:
        return None
    return max(result.judged.drawing_errors, key=lambda x: x.max).t_max


def _margins(
    result: RunResult, obstacle: PairClearance | None, own: PairClearance | None
) -> dict[str, str]:
    """Return the least allowed distance of each clearance of the figures; empty text without."""
    from armcontour.core.render import number

    least = None if result.clearance is None else result.clearance.least
    pairs = {"obstacle": obstacle, "own_links": own, "clearance.low": least}
    return {
        name: number(pair.margin, "m") if pair.margin > 0 else ""
        for name, pair in pairs.items()
        if pair is not None
    }


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


def _nearest_links(request: Request, result: RunResult) -> PairClearance | None:
    """Return the nearest pair of the arm's own bodies: links, tool and external axes."""
    names = set() if request.job.scene is None else {x.name for x in request.job.scene.obstacles}
    pairs = () if result.clearance is None else result.clearance.pairs
    own = (x for x in pairs if not names & {x.first, x.second})
    return min(own, key=lambda x: x.high, default=None)


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
