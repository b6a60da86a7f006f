"""Section on the tool path: objective and executed paths."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.jobs import JobResult
from armcontour.motion import Execution
from armcontour.report.figure import Figure, make_trace
from armcontour.report.outline import outline_points, simplify
from armcontour.report.section import Section
from armcontour.report.style import (
    EXPERIMENT_DASH,
    PATH_COLOUR,
    finish,
    line,
    run_colours,
    run_widths,
)
from armcontour.verification import Evaluation

# Maximum number of points of an executed path, number of evenly spaced points among them, and
# height of its figure [px].
MAX_PATH_POINTS, EVEN, PATH_HEIGHT = 6000, 800, 420
# Deviation of a drawn executed path that is visible in an enlarged figure [m].
VISIBLE = 1e-6
TITLE = "Path of the tool"
# Look of an axis in space.
SPACE_AXIS = {
    **{"nticks": 6, "backgroundcolor": "#FAFAFA"},
    **dict.fromkeys(("gridcolor", "zerolinecolor"), "#DDDDDD"),
}
# Minimum ratio of the shortest to the longest side of a scene.
FLATTEST = 0.4
# Length of the longest side of a scene in units of plotly, with which the scene fits in every view.
SCENE_SIZE = 1.45
# Camera with parallel projection, so that equal lengths appear equal.
CAMERA = {
    "eye": {"x": 1.1, "y": -1.5, "z": 0.9},
    "up": {"x": 0, "y": 0, "z": 1},
    "center": {"x": 0, "y": 0, "z": 0},
    "projection": {"type": "orthographic"},
}


def paths(study: JobResult) -> Section:
    """Section with objective and executed paths."""
    kind = "executed" if study.simulated else "planned"
    return Section(
        key="paths",
        title=TITLE,
        summary="interactive figure",
        text=f"The {kind} path of the tool. Drag a rectangle, or turn the wheel, to enlarge it.",
        parts=(draw_path(study),),
    )


def draw_path(study: JobResult) -> Any:
    """Figure with the objective path and the executed paths."""
    first = next(iter(study.runs.values()))
    objective = outline_points(first.objective)
    figure = Figure(curve(objective, "objective path", PATH_COLOUR, width=6, opacity=0.5))
    for tool in tools_of(study):
        figure.add_trace(curve(executed_points(tool), tool.name, **tool.look))
    if objective.shape[1] == 3:
        return lay_out_in_space(figure)
    figure.update_xaxes(title="x [mm]")
    figure.update_yaxes(title="y [mm]", scaleanchor="x")
    return finish(figure, title=TITLE, height=PATH_HEIGHT)


def executed_points(tool: Tool) -> FloatArray:
    """Executed points along contours [m], (n, dimension), with the point of the largest error.

    NaN separates contours, because rapids are not drawn.
    """
    execution, points = tool.execution, tool.execution.tool
    peak = -1.0 if tool.evaluation is None else tool.evaluation.contour_error.t_max
    worst = int(np.searchsorted(execution.t, peak))
    spans = executed_contours(execution)
    parts = simplify([points[a:b] for a, b in spans], MAX_PATH_POINTS, even=EVEN, visible=VISIBLE)
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


class Tool(NamedTuple):
    """The executed tool path of a run or an experiment, and its line in figures."""

    # Name in the legend
    name: str
    execution: Execution
    evaluation: Evaluation | None
    # Colour and other options of the line
    look: dict[str, Any]


def tools_of(study: JobResult) -> list[Tool]:
    """Executed tool paths of all runs and experiments."""
    colours, widths = run_colours(study.runs), run_widths(study.runs)
    tools = []
    for name, result in study.runs.items():
        look: dict[str, Any] = {"colour": colours[name], "width": widths[name]}
        tools.append(Tool(name, result.motion, result.evaluation, look))
        if (experiment := result.experiment) is not None:
            look = {"colour": colours[name], "dash": EXPERIMENT_DASH, "width": 1.5}
            label = f"{name}, experiment"
            tools.append(Tool(label, experiment.execution, experiment.evaluation, look))
    return tools


def curve(points: FloatArray, name: str, colour: str, **look: Any) -> Any:
    """Trace of a curve through points [m], (n, 2) or (n, 3); in space rounded to 0.1 µm."""
    if points.shape[1] == 2:
        x, y = points.T * 1e3
        return line(x, y, name, colour, **look)
    drawn = {
        "color": colour,
        "width": look.pop("width", 2) + 2,
        "dash": look.pop("dash", "solid"),
    }
    x, y, z = np.round(points * 1e3, 4).astype(np.float32).T
    hover = "x %{x:.3f} mm<br>y %{y:.3f} mm<br>z %{z:.3f} mm"
    shown = {"mode": "lines", "line": drawn, "hovertemplate": hover, **look}
    return make_trace("scatter3d", x=x, y=y, z=z, name=name, **shown)


def lay_out_in_space(figure: Any) -> Any:
    """Set the layout of a figure in space, with axes of equal scale."""
    points = np.concatenate([np.stack([x.x, x.y, x.z], axis=1) for x in figure.data])
    low, high = np.nanmin(points, axis=0), np.nanmax(points, axis=0)
    longest = float((high - low).max())
    # A flat scene gets a margin, because the tick labels of its short axis would overlap.
    edge = np.maximum(FLATTEST * longest - (high - low), 0.0) / 2 + 0.03 * longest
    low, high = low - edge, high + edge
    ratio = (high - low) / float((high - low).max()) * SCENE_SIZE
    finish(figure, title=TITLE, height=PATH_HEIGHT)
    figure.update_layout(
        scene={
            "aspectmode": "manual",
            "aspectratio": dict(zip("xyz", ratio.tolist(), strict=True)),
            "camera": CAMERA,
            **{
                f"{x}axis": {"title": {"text": f"{x} [mm]"}, "range": [a, b], **SPACE_AXIS}
                for x, a, b in zip("xyz", low.tolist(), high.tolist(), strict=True)
            },
        },
        legend={"orientation": "v", "xref": "paper", "yref": "paper", "y": 1, "yanchor": "top"},
        margin={"l": 10, "r": 10, "t": 12, "b": 10},
    )
    return figure
