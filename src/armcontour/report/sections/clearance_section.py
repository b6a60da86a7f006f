"""Section on clearance: smallest distances over time, and the arm at the smallest distance."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from armcontour.core.frames import Frame
from armcontour.core.render import number
from armcontour.core.text import list_some
from armcontour.jobs import Job, JobResult, RunResult
from armcontour.report.figure import Figure
from armcontour.report.outline import outline_points
from armcontour.report.section import Section, text_table
from armcontour.report.sections.bodies import (
    LINK_COLOUR,
    TOOL_COLOUR,
    draw_body,
    draw_surroundings,
    in_space,
    line_in_space,
    points_of,
    seen_from_base,
)
from armcontour.report.style import LIMIT_COLOUR, PATH_COLOUR, RUN_COLOURS, finish, line
from armcontour.robot.chain import link_poses
from armcontour.robot.scene import Scene
from armcontour.verification.clearance import Clearance, PairClearance

# Displayed names of the kinds of pairs.
KINDS = {
    "environment": "links and cell",
    "own": "links among each other",
    "tool": "tool and others",
}
# Number of points of the curves, and maximum number of rows of the table.
TIMES, MAX_ROWS = 200, 7
# Height of the figures [px].
HEIGHT = 320


def clearance(study: JobResult) -> Section | None:
    """Section with the clearance of each run that was checked; None if no run was checked."""
    runs = {name: x for name, x in study.runs.items() if x.clearance is not None}
    if not runs:
        return None
    first = next(iter(runs.values()))
    result = first.clearance
    assert result is not None
    reasons = Counter(x.reason for x in result.left_out)
    skipped = list_some([f"{reason} ({n})" for reason, n in reasons.items()], 6)
    return Section(
        key="clearance",
        title="Clearance",
        summary="least distances of the arm from itself, from its tool and from its cell",
        text="The clearance is proven for all times, also between samples. The figure shows "
        "distances at single times; dashed lines are margins.",
        choices=tuple((name, tuple(_parts(study.job, x))) for name, x in runs.items()),
        notes=(f"Pairs that are not checked: {skipped}.",) if reasons else (),
    )


def _parts(job: Job, result: RunResult) -> Iterator[Any]:
    """Yield figures and tables of a run: distances over time, posture, and nearest pairs."""
    assert result.clearance is not None
    nearest = _nearest(job, result.clearance)
    yield _over_time(job, result)
    if job.program.dimension == 3 and nearest is not None:
        yield _posture(job, result, nearest)
    for clearance, source in (
        (result.clearance, "planned"),
        (result.executed_clearance, "executed"),
    ):
        if clearance is not None:
            pairs = next(x for x in clearance.to_data().tables if x.name == "pairs")
            yield text_table(replace(pairs, rows=pairs.rows[:MAX_ROWS]), f"Nearest pairs, {source}")


def _nearest(job: Job, clearance: Clearance) -> PairClearance | None:
    """The nearest pair with an obstacle, else the nearest of all pairs; None without pairs."""
    names = {x.name for x in (job.scene or Scene()).obstacles}
    pairs = [x for x in clearance.pairs if {x.first, x.second} & names]
    return min(pairs or clearance.pairs, key=lambda x: x.high, default=None)


def _over_time(job: Job, result: RunResult) -> Any:
    """Figure with the smallest distance of each kind of pair over time, planned and executed."""
    figure = Figure()
    cell = job.cell
    t = np.linspace(0.0, result.trajectory.duration, TIMES)
    planned = cell.smallest_distances(result.trajectory(t))
    executed = result.motion
    rows = np.unique(np.linspace(0, len(executed.t) - 1, TIMES).astype(int))
    driven = cell.smallest_distances(executed.q[rows])
    margins = {x.kind: x.margin for x in cell.pairs}
    for (kind, least), colour in zip(planned.items(), RUN_COLOURS, strict=False):
        figure.add_trace(line(t, least * 1e3, f"{KINDS[kind]}, planned", colour))
        if result.execution is not None:
            least, label = driven[kind] * 1e3, f"{KINDS[kind]}, executed"
            figure.add_trace(line(executed.t[rows], least, label, colour, dash="dot"))
        figure.add_hline(y=margins[kind] * 1e3, line={"color": colour, "width": 1, "dash": "dash"})
    figure.update_xaxes(title="t [s]")
    figure.update_yaxes(title="least distance [mm]", rangemode="tozero")
    return finish(figure, title="Least distances", height=HEIGHT, span=3)


def _posture(job: Job, result: RunResult, nearest: PairClearance) -> Any:
    """Figure of arm, tool and cell at the time of the smallest distance."""
    figure = Figure()
    chain, shapes = job.arm.chain, job.arm.shapes
    assert chain is not None
    q = result.trajectory(np.array([min(nearest.t, result.trajectory.duration)]))
    poses = link_poses(replace(chain, base=Frame()), q)[0]
    path = seen_from_base(job.arm, outline_points(result.path))
    figure.add_trace(line_in_space(path, "path", PATH_COLOUR, width=6))
    drawn = [path]
    # The base is skipped, because `draw_surroundings` draws it.
    for shape in () if shapes is None else shapes.shapes:
        if shape.link == 0 and not shape.tool:
            continue
        place = (
            Frame(position=poses[shape.link][:, 3], rotation=poses[shape.link][:, :3]) @ shape.place
        )
        points = points_of(shape.shape, place)
        figure.add_trace(
            draw_body(points, shape.name, TOOL_COLOUR if shape.tool else LINK_COLOUR, 0.6)
        )
        drawn.append(points)
    for trace, points in draw_surroundings(job, np.concatenate(drawn)):
        figure.add_trace(trace)
        drawn.append(points)
    least, t = nearest.high, nearest.t
    name = f"{nearest.second}, {nearest.first}: {number(least, 'm')} at {number(t, 's')}"
    between = seen_from_base(job.arm, nearest.points)
    figure.add_trace(line_in_space(between, name, LIMIT_COLOUR, width=8))
    title = "Posture of the least distance"
    in_space(figure, np.concatenate(drawn), title=title, height=HEIGHT, span=3)
    return figure
