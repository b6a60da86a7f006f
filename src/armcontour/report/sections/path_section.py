"""Section on the tool path: executed paths with their errors."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.render import number
from armcontour.jobs import JobResult, RunResult
from armcontour.jobs.rows import allowed_error
from armcontour.motion import Execution
from armcontour.report.outline import fine_places, simplify
from armcontour.report.plan_drawing import Drawing, Key, Mark, Sheet, line, slug, view_of
from armcontour.report.section import Section
from armcontour.verification import Evaluation

# Maximum number of points of an executed path, and of evenly spaced points among them.
MAX_PATH_POINTS, EVEN = 3000, 800
# Fraction of the drawing's size that is visible in an enlarged drawing.
VISIBLE = 1 / 50_000
# Upper ends of the classes of errors as shares of the allowed error, and the colours of the
# classes on light and dark pages. The last class exceeds the allowed error.
CLASSES = (0.25, 0.5, 0.75, 1.0)
COLOURS = (
    ("#8fa9c0", "#5b7086"),
    ("#6389b0", "#7f9ab5"),
    ("#36659a", "#a9c6e2"),
    ("#0b3c6f", "#e3f0fb"),
    ("#D55E00", "#f07b22"),
)
# Maximum number of listed corners, and size of the shown part of a corner as a multiple of its
# rounding.
MAX_CORNERS, AROUND = 8, 5.0


def paths(study: JobResult) -> Section:
    """Section with objective and executed paths."""
    kind = "executed" if study.simulated else "planned"
    return Section(
        key="paths",
        title="Path of the tool",
        summary=f"{kind} path" + " with its errors" * study.simulated,
        text=f"The {kind} path of the tool over the objective path. Drag a rectangle to enlarge "
        "it; double-click to see all.",
        choices=tuple((x.name, (draw_tool(x, study.job.name),)) for x in tools_of(study)),
    )


class Tool(NamedTuple):
    """The executed tool path of a run or an experiment."""

    name: str
    result: RunResult
    execution: Execution
    evaluation: Evaluation | None


def tools_of(study: JobResult) -> list[Tool]:
    """Executed tool paths of all runs and experiments."""
    tools = []
    for name, result in study.runs.items():
        tools.append(Tool(name, result, result.motion, result.evaluation))
        if (x := result.experiment) is not None:
            tools.append(Tool(f"{name}, experiment", result, x.execution, x.evaluation))
    return tools


def draw_tool(tool: Tool, job: str) -> Drawing:
    """Drawing of the objective path and an executed path, coloured by its error."""
    outline = [x.path(fine_places(x.path)) for x in tool.result.objective.contours]
    classes = _classes(tool)
    points = np.concatenate([*outline, *(x for y in classes.values() for x in y)])
    sheet = Sheet.of(points, view_of(points))
    parts = [line(sheet, outline, 'class="objective"', "objective path")]
    keys = [Key("┄", "objective path")]
    allowed, named = _scale(tool)
    ends = [0.0, *CLASSES]
    for k, curves in classes.items():
        light, dark = COLOURS[k]
        look = f'class="limit{{}}" style="--light:{light};--dark:{dark}"'
        words = f"{ends[k]:.0%} to {CLASSES[k]:.0%}" if k < len(CLASSES) else f"more than {1:.0%}"
        words = f"error {words} of the {named} {number(allowed, 'm')}" if allowed else "planned"
        parts.append(line(sheet, curves, look.format(" path"), words, fine=True))
        keys.append(Key(f"<i {look.format(' swatch')}></i>", words))
    corners = _corners(tool, f"{slug(job)}-{slug(tool.name)}")
    parts += [*(sheet.ring(x) for x in corners), *sheet.scale()]
    keys += [Key("∠", x.words, x.place) for x in corners]
    return Drawing(
        title=f"Path of the tool: {tool.name}",
        svg=sheet.svg(f"Objective and executed path of {tool.name}", parts),
        keys=tuple(keys),
    )


def _scale(tool: Tool) -> tuple[float, str]:
    """Error of 100 % [m] and its name: the allowed error, or else the largest one; 0 without."""
    if tool.evaluation is None:
        return 0.0, ""
    allowed = allowed_error(tool.result)
    return (allowed, "allowed") if allowed else (tool.evaluation.contour_error.max, "largest")


def _classes(tool: Tool) -> dict[int, list[FloatArray]]:
    """Executed curves along contours [m], by class of their largest error, in order."""
    execution, points = tool.execution, tool.execution.tool
    shares = np.zeros(len(points))
    if tool.evaluation is not None:
        e = tool.evaluation.contour_error
        known = np.isfinite(e.values)
        shares = np.interp(execution.t, e.t[known], e.values[known]) / (_scale(tool)[0] or 1.0)
    spans = executed_contours(execution)
    size = float(np.ptp(points, axis=0).max())
    parts = simplify(
        [points[a:b] for a, b in spans], MAX_PATH_POINTS, even=EVEN, visible=VISIBLE * size
    )
    classes: dict[int, list[FloatArray]] = {k: [] for k in range(len(COLOURS))}
    for (a, _), chosen in zip(spans, parts, strict=True):
        rows = a + chosen
        # The class of a chord is that of its largest error.
        largest = np.maximum.reduceat(shares, rows)[:-1]
        kinds = np.digitize(np.maximum(largest, shares[rows[1:]]), CLASSES, right=True)
        edges = np.flatnonzero(np.diff(kinds, prepend=-1, append=-1))
        for start, end in zip(edges, edges[1:], strict=False):
            classes[int(kinds[start])].append(points[rows[start : end + 1]])
    return {k: x for k, x in classes.items() if x}


def _corners(tool: Tool, prefix: str) -> list[Mark]:
    """Marks of the corners with the largest deviations."""
    found = () if tool.evaluation is None else tool.evaluation.corners
    worst = sorted(found, key=lambda x: -x.rounding)[:MAX_CORNERS]
    return [
        Mark(
            np.asarray(x.point),
            f"corner {x.vertex}"
            + ("" if x.contour is None else f" of contour {x.contour}")
            + f": {number(x.rounding, 'm')} from the tool",
            place=f"{prefix}-corner-{k}",
            window=AROUND * x.rounding,
        )
        for k, x in enumerate(worst)
    ]


def executed_contours(execution: Execution) -> list[tuple[int, int]]:
    """For each contour, index of the first executed sample, and index after the last one.

    Samples before and after the motion belong to the first and last contour.
    """
    trajectory, last = execution.set_points.trajectory, len(execution.t)
    indices = []
    for span in trajectory.contour_spans:
        start, end = np.searchsorted(execution.t, span.t).tolist()
        # Each contour has at least two samples.
        start = 0 if span.t[0] <= 0 else min(start, last - 2)
        end = last if span.t[1] >= trajectory.duration else max(end + 1, start + 2)
        indices.append((start, end))
    return indices
