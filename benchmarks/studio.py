"""Compute what the Studio does when the mouse moves, from the job's data to bytes for the page.

Every call moves the waypoint, so no result for the path can be reused. The bars leave the page the
rest of the time from the event to the picture. In executions of the paper's job, the experiment
with rigid bodies takes two thirds of the time.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from importlib.resources import files
from itertools import count
from typing import Any

from tools.studio_page import SQUARE

from armcontour.core.yaml_loader import load
from benchmarks import reference
from benchmarks.measured import Bar, Line, Pair, timed

# A waypoint moves by this much from one call to the next [m].
STEP = 1e-5
# After so many calls the changes begin again from the first one.
STEPS = 1000

Data = Mapping[str, Any]


def lines() -> list[Line]:
    """Return the lines for pictures of plans, executions and an arm in space, and a slider."""
    peer = reference.NAME
    drag = "drag a waypoint, to bytes for the page"
    paper = files("armcontour.jobs.library").joinpath("paper.yaml").read_text
    moved = partial(_prepare, change=_move)
    return [
        Line(
            "studio/plan",
            f"{drag}: the paper's job, its plan",
            peer,
            lambda: moved(paper(), executed=False),
            Bar(seconds=20e-3),
        ),
        Line(
            "studio/executed",
            f"{drag}: the paper's job, executed too",
            peer,
            lambda: moved(paper()),
            Bar(seconds=60e-3),
        ),
        Line(
            "studio/square",
            f"{drag}: square on a UR5e with limits of torque, executed too",
            peer,
            lambda: moved(SQUARE),
            Bar(seconds=100e-3),
        ),
        Line(
            "studio/gains",
            "slide a gain, to bytes for the page: the paper's job, executed too",
            peer,
            lambda: _prepare(paper(), change=_slide),
            Bar(seconds=60e-3),
        ),
    ]


def _prepare(text: str, *, change: Callable[[Data, int], Data], executed: bool = True) -> Pair:
    from armcontour.report.view import View
    from armcontour.studio.execution_frame import execution_frame
    from armcontour.studio.handles import handles_of
    from armcontour.studio.plan_frames import picture_frame
    from armcontour.studio.preview import CoarsePlanner

    data = load(text, "job")
    previewer = CoarsePlanner()
    numbers = count()
    handles = handles_of(previewer.job(data, "optimal"), data)
    view = View(handles.plane, handles.centre)

    def preview() -> list[bytes]:
        planned = previewer.plan(change(data, next(numbers) % STEPS), "optimal")
        frames = [picture_frame(planned, view).pack()]
        if executed:
            frames.append(execution_frame(previewer.execute(planned), view).pack())
        return frames

    def notes() -> list[str]:
        return [f"{', '.join(f'{len(x) / 1e3:.0f} kB' for x in preview())} for the page"]

    return Pair(timed(preview), timed(reference.work), notes)


def _move(data: Data, number: int) -> Data:
    """Return the job with a waypoint elsewhere."""
    points = [list(x) for x in data["path"]["points"]]
    points[1][0] += STEP * number
    return {**data, "path": {**data["path"], "points": points}}


def _slide(data: Data, number: int) -> Data:
    """Return the job with another gain."""
    return {**data, "servo": {"kp": 20.0 + 5e-3 * number, "kv": 150.0}}
