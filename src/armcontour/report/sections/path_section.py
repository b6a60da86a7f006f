"""Section on the tool path: executed path and enlarged corners."""

from __future__ import annotations

from typing import Any

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.jobs import JobResult
from armcontour.motion import Execution
from armcontour.report.figure import Figure
from armcontour.report.outline import outline_points, simplify
from armcontour.report.section import Section
from armcontour.report.sections.bodies import curve, in_space
from armcontour.report.sections.corner_figures import Tool, corners, tools_of
from armcontour.report.style import PATH_COLOUR, finish

# Maximum number of points of an executed path, and number of evenly spaced points among them.
MAX_POINTS, EVEN = 6000, 800
# Height of the figures [px].
HEIGHT = 350


def paths(study: JobResult) -> Section:
    """Section with objective and executed paths, and enlarged corners."""
    figures = [draw_path(study), *corners(study)]
    text = "The executed path of the tool" if study.simulated else "The planned path of the tool"
    for figure in figures:
        figure.span = 6 // len(figures)
    return Section(
        key="paths",
        title="Path of the tool",
        summary="interactive figure" + (" and enlarged corners" if len(figures) > 1 else ""),
        text=f"{text}.",
        parts=tuple(figures),
    )


def draw_path(study: JobResult) -> Any:
    """Figure with the objective path and the executed paths."""
    first = next(iter(study.runs.values()))
    objective = outline_points(first.objective)
    figure = Figure(curve(objective, "objective path", PATH_COLOUR, width=6, opacity=0.5))
    for tool in tools_of(study):
        figure.add_trace(curve(executed_points(tool), tool.name, **tool.look))
    if objective.shape[1] == 3:
        everywhere = np.concatenate([np.stack([x.x, x.y, x.z], axis=1) for x in figure.data])
        in_space(figure, everywhere, title="Path of the tool", height=HEIGHT)
        return figure
    figure.update_xaxes(title="x [mm]")
    figure.update_yaxes(title="y [mm]", scaleanchor="x")
    return finish(figure, title="Path of the tool", height=HEIGHT)


def executed_points(tool: Tool) -> FloatArray:
    """Executed points along contours [m], (n, dimension), with the point of the largest error.

    NaN separates contours, because rapids are not drawn.
    """
    execution, points = tool.execution, tool.execution.tool
    peak = -1.0 if tool.evaluation is None else tool.evaluation.contour_error.t_max
    worst = int(np.searchsorted(execution.t, peak))
    spans = executed_contours(execution)
    parts = simplify([points[a:b] for a, b in spans], MAX_POINTS, even=EVEN)
    gap, drawn = np.full((1, points.shape[1]), np.nan), []
    for (a, b), chosen in zip(spans, parts, strict=True):
        rows = np.union1d(a + chosen, [worst]) if a <= worst < b else a + chosen
        drawn += [points[rows], gap]
    return np.concatenate(drawn[:-1])


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
