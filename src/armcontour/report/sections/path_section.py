"""Section on the tool path: executed paths with their errors."""

from __future__ import annotations

from itertools import chain
from typing import NamedTuple

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.render import number
from armcontour.jobs import JobResult, RunResult
from armcontour.motion import Execution
from armcontour.program import contour_called
from armcontour.report.figure import render
from armcontour.report.plan_drawing import Drawing, SymbolEntry, slug
from armcontour.report.section import Section
from armcontour.report.sheet import Mark, Sheet, view_of
from armcontour.report.view import drawn_arc_lengths, simplify
from armcontour.verification import ErrorProfile, Evaluation

# Maximum number of points per executed path.
MAX_PATH_POINTS = 3000
# Fraction of the drawing's size that is visible in an enlarged drawing.
VISIBLE = 1 / 50_000
# Upper ends of the error classes as fractions of the allowed error, and their colours on light and
# dark pages. The last class exceeds the allowed error.
CLASSES = (0.25, 0.5, 0.75, 1.0)
COLOURS = (
    ("#8fa9c0", "#5b7086"),
    ("#6389b0", "#7f9ab5"),
    ("#36659a", "#a9c6e2"),
    ("#0b3c6f", "#e3f0fb"),
    ("#D55E00", "#f07b22"),
)
# Maximum number of enlarged corners.
MAX_CORNERS = 8
# Size of the shown part at an enlarged corner, as a multiple of the rounding.
AROUND = 5.0


def paths(job_result: JobResult) -> Section:
    """Make the section with objective and executed paths."""
    kind = "executed" if job_result.simulated else "planned"
    return Section(
        key="paths",
        title="Path of the tool",
        summary=f"{kind} path" + " with its errors" * job_result.simulated,
        text=f"The {kind} path of the tool over the drawing"
        + ", coloured by its distance from the drawing" * job_result.simulated
        + ".",
        mouse="Drag a rectangle to enlarge it; double-click to see all.",
        choices=tuple((x.name, (draw_tool(x, job_result.job.name),)) for x in tools_of(job_result)),
    )


class Tool(NamedTuple):
    """The executed tool path of a run or an experiment.

    Args:
        name: Name of the run or experiment.
        result: The run.
        execution: Its execution; None for a plan.
        evaluation: Its evaluation; None for a plan.
    """

    name: str
    result: RunResult
    execution: Execution
    evaluation: Evaluation | None


def tools_of(job_result: JobResult) -> list[Tool]:
    """List the executed tool paths of all runs and experiments."""
    tools = []
    for name, result in job_result.runs.items():
        tools.append(Tool(name, result, result.motion, result.evaluation))
        if (x := result.experiment) is not None:
            tools.append(Tool(f"{name}, experiment", result, x.execution, x.evaluation))
    return tools


def draw_tool(tool: Tool, job: str) -> Drawing:
    """Draw the objective path and an executed path, with its error and enlarged corners."""
    contours = tool.result.objective.contours
    prefix = f"{slug(job)}-{slug(tool.name)}"
    points = np.concatenate([*(x.path.vertices for x in contours), tool.execution.tool])
    error = VISIBLE * float(np.ptp(points, axis=0).max())
    outline = [x.path(drawn_arc_lengths(x.path, error)) for x in contours]
    outline = [x[rows] for x, rows in zip(outline, simplify(outline, error), strict=True)]
    classes = _classes(tool, error)
    points = np.concatenate([*outline, *chain.from_iterable(classes.values())])
    sheet = Sheet.of(points, view_of(points))
    lines = [sheet.line(outline, 'class="objective"', "drawing", fine=True)]
    keys = [SymbolEntry("┄", "drawing")]
    allowed, named = _scale(tool)
    ends = [0.0, *CLASSES]
    for k, curves in classes.items():
        light, dark = COLOURS[k]
        look = f'class="limit{{}}" style="--light:{light};--dark:{dark}"'
        words = f"{ends[k]:.0%} to {CLASSES[k]:.0%}" if k < len(CLASSES) else f"more than {1:.0%}"
        words = f"{words} of the {named} {number(allowed, 'm')}" if allowed else "planned"
        lines.append(sheet.line(curves, look.format(" path"), words, fine=True))
        keys.append(SymbolEntry(f"<i {look.format(' swatch')}></i>", words))
    corners = _corners(tool, prefix)
    label = f"Drawing and executed path of {tool.name}"
    drawn = {"sheet": sheet, "lines": lines, "marks": [("", x) for x in corners], "numbers": ()}
    svg = render("drawing.svg", id=prefix, label=label, insets=corners, **drawn)
    return Drawing(title=f"Path of the tool: {tool.name}", svg=svg, keys=tuple(keys))


def _error(tool: Tool) -> ErrorProfile | None:
    """Return the distance from the drawing, or from the path without one; None for a plan."""
    e = tool.evaluation
    return None if e is None else e.objective_error or e.contour_error


def _scale(tool: Tool) -> tuple[float, str]:
    """Return the error that counts as 100 % [m], allowed or largest, and its name; 0 without."""
    if (e := _error(tool)) is None:
        return 0.0, ""
    allowed = tool.result.allowed_distance
    return (allowed, "allowed") if allowed else (e.max, "largest")


def _classes(tool: Tool, error: float) -> dict[int, list[FloatArray]]:
    """Sort the executed curves along contours [m] by the class of their largest error."""
    execution = tool.execution
    points = tool.execution.tool
    shares = np.zeros(len(points))
    if (e := _error(tool)) is not None:
        known = np.isfinite(e.values)
        shares = np.interp(execution.t, e.t[known], e.values[known]) / (_scale(tool)[0] or 1.0)
    spans = executed_contours(execution)
    parts = simplify([points[a:b] for a, b in spans], error, MAX_PATH_POINTS)
    classes: dict[int, list[FloatArray]] = {k: [] for k in range(len(COLOURS))}
    for (a, _), chosen in zip(spans, parts, strict=True):
        rows = a + chosen
        # A chord belongs to the class of its largest error.
        largest = np.maximum.reduceat(shares, rows)[:-1]
        kinds = np.digitize(np.maximum(largest, shares[rows[1:]]), CLASSES, right=True)
        edges = np.flatnonzero(np.diff(kinds, prepend=-1, append=-1))
        for start, end in zip(edges, edges[1:], strict=False):
            classes[int(kinds[start])].append(points[rows[start : end + 1]])
    return {k: x for k, x in classes.items() if x}


def _corners(tool: Tool, prefix: str) -> list[Mark]:
    """Mark the corners with the largest deviations."""
    found = () if tool.evaluation is None else tool.evaluation.corners
    contours = tool.result.path.contours
    marks = []
    for k, x in enumerate(sorted(found, key=lambda x: -x.rounding)[:MAX_CORNERS]):
        place = ""
        if x.contour is not None:
            place = f" of {contour_called(contours[x.contour - 1], x.contour - 1)}"
        words = f"corner {x.vertex}{place}: {number(x.rounding, 'm')} from the tool"
        window = AROUND * x.rounding
        marks.append(Mark(np.asarray(x.point), words, None, f"{prefix}-corner-{k}", window))
    return marks


def executed_contours(execution: Execution) -> list[tuple[int, int]]:
    """Return each contour's index of the first executed sample, and after the last one.

    Samples before and after the motion belong to the first and last contour.
    """
    trajectory = execution.set_points.trajectory
    last = len(execution.t)
    indices = []
    for span in trajectory.contour_spans:
        start, end = np.searchsorted(execution.t, span.t).tolist()
        # Each contour has at least two samples.
        start = 0 if span.t[0] <= 0 else min(start, last - 2)
        end = last if span.t[1] >= trajectory.duration else max(end + 1, start + 2)
        indices.append((start, end))
    return indices
