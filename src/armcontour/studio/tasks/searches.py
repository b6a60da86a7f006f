"""Tasks that plan a job many times: sweep of a key, placement of the part."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from armcontour.core.errors import ArmContourError, InvalidInput
from armcontour.core.progress import Step
from armcontour.jobs import PlaceSearch
from armcontour.jobs.placement_options import LENGTHS
from armcontour.robot.scene import BASE
from armcontour.studio.page_frame import PageFrame
from armcontour.studio.tasks.request import Request

if TYPE_CHECKING:
    from armcontour.studio.view import View


# Default number of points of a sweep.
SWEEP_POINTS = 15


def sweep(request: Request) -> PageFrame:
    """Compute duration and contour error in previews over values of a job key.

    Options: `key`, and either `values` or `min`, `max`, `count` and `log`.
    """
    from armcontour.files.job_text_edits import change_data
    from armcontour.studio.edits.keys import set_value
    from armcontour.studio.handles import EditState, handles_of

    key, values = str(request.option("key", "")), _values(request)
    state = EditState(
        data=request.data,
        run=request.job.runs[0].name,
        handles=handles_of(request.job, request.data),
    )
    duration, rms, maximum = (np.full(len(values), np.nan) for _ in range(3))
    refusals: list[str | None] = []
    for k, value in enumerate(values.tolist()):
        request.progress(Step((f"{k + 1} of {len(values)}",), k / len(values)))
        try:
            changes = set_value({"key": key, "value": value}, state)
            planned = request.previewer.plan(change_data(request.data, changes), request.run)
            duration[k] = planned.trajectory.duration
            errors = request.previewer.execute(planned).errors
            rms[k], maximum[k] = errors.rms, errors.max
            refusals.append(None)
        except ArmContourError as error:
            refusals.append(str(error))
    return PageFrame(
        "result",
        {"run": state.run, "key": key, "refusals": refusals},
        {"values": values, "duration": duration, "rms": rms, "max": maximum},
    )


def _values(request: Request) -> Any:
    values = request.options.get("values")
    if values is not None:
        return np.array(values, dtype=np.float64)
    low, high = request.options.get("min"), request.options.get("max")
    if low is None or high is None:
        raise InvalidInput("A sweep requires the option `values`, or `min` and `max`.")
    space = np.geomspace if request.option("log", False) else np.linspace
    return space(float(low), float(high), int(request.option("count", SWEEP_POINTS)))


def place(request: Request) -> PageFrame:
    """Compute a map of part placements; options: `processes`, `as_job`, fields of `PlaceSearch`."""
    from armcontour.core.render import frame, verdict
    from armcontour.studies.placement import place

    options = dict(request.options)
    processes, as_job = options.pop("processes", 1), options.pop("as_job", True)
    base = (request.job.placement if as_job else None) or PlaceSearch()
    search = replace(base, **options)
    search = replace(search, over={**base.over, **search.over})
    _refuse_unseen(search)
    result = place(
        request.job, search, run=request.run, processes=processes, progress=request.progress
    )
    verdicts, objective = result.verdicts, result.objective
    placements = [result.place(k) for k in range(len(verdicts))]
    kinds = list(result.refusals)
    best = result.refined
    sentence = verdict(result.to_data())
    anchor = result.moves.anchor
    # Absolute positions are converted to shifts from the current position of the part.
    part = dict(zip(LENGTHS, anchor.tolist(), strict=True))
    zero = {name: part[name] for name in result.moves.absolute}
    header = {
        **{"run": result.run.name, "sentence": sentence, "objective": objective},
        "axes": [{"name": y.name, "values": y.values} for y in result.axes],
        "anchor": request.view.uv(anchor),
        "refusals": kinds,
        "best": {
            **{"values": best.values, "by": _shift(request.view, best.values, zero)},
            "turn": best.values.get("yaw", 0.0),
            "rows": frame(best.verdict.to_data()),
        },
        "own": frame(result.own.to_data()),
        "notes": result.notes,
    }
    refused = [kinds.index(y.refusal) if y.refusal else 255 for y in verdicts]
    scores = np.array([y.score(objective) for y in verdicts])
    # Shifts have 64 bits, because the page writes them into the job.
    arrays: dict[str, Any] = {
        "by": np.array([_shift(request.view, y, zero) for y in placements]),
        "turn": np.array([y.get("yaw", 0.0) for y in placements]),
        "duration": result.values("duration").ravel().astype(np.float32),
        "score": scores.astype(np.float32),
        "refusal": np.array(refused, dtype=np.uint8),
    }
    return PageFrame("result", header, arrays)


def _refuse_unseen(search: PlaceSearch) -> None:
    """Raise InvalidInput for placements that the picture cannot show."""
    axes = [name for name in ("z", "tilt") if name in search.over]
    if axes or search.what == BASE:
        moved = f"the part in {' and '.join(axes)}" if axes else "the base"
        raise InvalidInput(
            f"The map shows placements of the part in the plane of the drawing, so it cannot move "
            f"{moved}. Use `armcontour place`, or deselect *as in the job* and specify ranges of "
            "x, y and turn."
        )


def _shift(view: View, values: Mapping[str, float], zero: Mapping[str, float]) -> Any:
    """Shift of a placement in the plane of the picture [m], (2,)."""
    shift = np.array([values.get(name, 0.0) - zero.get(name, 0.0) for name in LENGTHS])
    return np.array([shift @ view.plane.x, shift @ view.plane.y])
