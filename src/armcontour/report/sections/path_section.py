"""Section on the tool path: executed path and enlarged corners.

A corner in space is drawn in the plane of its two lines.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import cycle
from typing import Any, NamedTuple

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.render import number
from armcontour.geometry import Path, RoundedPath, ShapedPath
from armcontour.geometry.segments import TANGENT_TOLERANCE
from armcontour.jobs import JobResult
from armcontour.motion import Execution
from armcontour.report.figure import Figure, make_subplots, make_trace
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
MAX_PATH_POINTS, EVEN, PATH_HEIGHT = 6000, 800, 350
# Half width of the picture of a corner, as a factor of the corner error.
ZOOM = 4.0
# Maximum number of enlarged corners.
MAX_CORNERS = 4
# Number of pictures in a row, height of a figure with one row, and height of each further row [px].
COLUMNS = 2
HEIGHT, MORE_HEIGHT = 350, 250
# Number of drawn points per executed sample, and approximate maximum number of drawn points per
# execution and corner.
FINER = 6
MAX_POINTS = 800
# Number of evenly spaced points of a drawn path.
PLACES = 200
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
IN_PLANE = np.eye(2)
Replaced = RoundedPath | ShapedPath
# Dashes of different rounded paths.
DASHES = ("dash", "dot", "dashdot", "longdash")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Corner:
    """A corner that is drawn enlarged."""

    # Index of the vertex of the objective path, from 0
    vertex: int
    # Position of the vertex [m], (dimension,)
    point: FloatArray
    # Half width of the picture [m]
    half: float
    title: str


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
        in_space(figure, everywhere, title="Path of the tool", height=PATH_HEIGHT)
        return figure
    figure.update_xaxes(title="x [mm]")
    figure.update_yaxes(title="y [mm]", scaleanchor="x")
    return finish(figure, title="Path of the tool", height=PATH_HEIGHT)


def executed_points(tool: Tool) -> FloatArray:
    """Executed points along contours [m], (n, dimension), with the point of the largest error.

    NaN separates contours, because rapids are not drawn.
    """
    execution, points = tool.execution, tool.execution.tool
    peak = -1.0 if tool.evaluation is None else tool.evaluation.contour_error.t_max
    worst = int(np.searchsorted(execution.t, peak))
    spans = executed_contours(execution)
    parts = simplify([points[a:b] for a, b in spans], MAX_PATH_POINTS, even=EVEN)
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


def corners(study: JobResult) -> list[Any]:
    """List with the figure of enlarged corners; empty if no run has rounded or shaped corners."""
    paths = _replaced_paths(study)
    if not paths:
        return []
    first = next(iter(paths.values()))
    all_corners = find_corners(first)
    if not all_corners:
        return []
    shown, tools = all_corners[:MAX_CORNERS], tools_of(study)
    rows = -(-len(shown) // COLUMNS)
    figure = make_subplots(
        rows=rows,
        cols=min(len(shown), COLUMNS),
        subplot_titles=[x.title for x in shown],
        vertical_spacing=0.16,
    )
    for k, corner in enumerate(shown):
        _corner(figure, tools, paths, corner, k)
    title = _title(study, len(shown), len(all_corners))
    finish(figure, title=title, height=HEIGHT + (rows - 1) * MORE_HEIGHT)
    figure.update_layout(margin={"t": 70})
    return [figure]


def find_corners(path: Replaced) -> list[Corner]:
    """The corners of a rounded or shaped path in path order."""
    if isinstance(path, ShapedPath):
        # `turns` begins with the second vertex.
        turns = np.append(0.0, path.objective.turns)
        turned = np.flatnonzero((turns > TANGENT_TOLERANCE) & (turns < np.pi - TANGENT_TOLERANCE))
        return [
            Corner(
                vertex=k,
                point=path.objective.vertices[k],
                half=ZOOM * path.tolerance,
                title=f"corner {i + 1}<br>turn {number(turns[k], 'rad')}",
            )
            for i, k in enumerate(turned.tolist())
            if path.tolerance > 0
        ]
    c = path.corners
    return [
        Corner(
            vertex=int(c.vertex[k]),
            point=c.point[k],
            half=ZOOM * float(c.error[k]),
            title=f"corner {k + 1}<br>r = {number(c.radius[k], 'm')}<br>"
            f"error {number(c.error[k], 'm')}",
        )
        for k in np.flatnonzero(c.radius > 0)
    ]


def _title(study: JobResult, shown: int, count: int) -> str:
    """Title of the figure: contour, and the number of shown corners if some are omitted."""
    has_contours = len(study.job.program.contours) > 1
    title = "Corners enlarged" + (f", contour {_shown(study) + 1}" if has_contours else "")
    return title + (f": the first {shown} of {count}" if count > shown else "")


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


def _replaced_paths(study: JobResult) -> dict[str, Replaced]:
    """Rounded or shaped paths of the drawn contour by name; equal paths are listed once."""
    index, paths = _shown(study), dict[str, Replaced]()
    for name, result in study.runs.items():
        path = result.path.contours[index].path
        if isinstance(path, Replaced) and not any(alike(path, x) for x in paths.values()):
            paths[name] = path
    suffix = " of {}" if len(paths) > 1 else ""
    return {f"{_kind(x)} path" + suffix.format(name): x for name, x in paths.items()}


def _kind(path: Path) -> str:
    """Name of the kind of a path."""
    return "shaped" if isinstance(path, ShapedPath) else "rounded"


def _shown(study: JobResult) -> int:
    """Index of the drawn contour: the first contour with rounded or shaped corners, or 0."""
    program = next(iter(study.runs.values())).path
    for i, contour in enumerate(program.contours):
        if isinstance(contour.path, Replaced) and find_corners(contour.path):
            return i
    return 0


def alike(first: Path, second: Path) -> bool:
    """True if two paths have the same vertices."""
    return np.array_equal(first.breaks, second.breaks) and np.array_equal(
        first.vertices, second.vertices
    )


def _corner(
    figure: Any, tools: Sequence[Tool], paths: Mapping[str, Replaced], corner: Corner, k: int
) -> None:
    """Draw all paths and executions near a corner in picture k of the figure, from 0."""
    row, column = divmod(k, COLUMNS)
    path, place = next(iter(paths.values())), {"row": row + 1, "col": column + 1}
    point, half = corner.point, corner.half
    view = _view(path.objective, corner.vertex)
    # In space, coordinates are relative to the corner.
    origin = np.zeros_like(point) if path.dimension == 2 else point

    def project(points: FloatArray) -> FloatArray:
        return (points - origin) @ view.T * 1e3

    def draw(points: FloatArray, name: str, colour: str, **look: Any) -> None:
        drawn = project(points)
        curve = line(
            drawn[:, 0], drawn[:, 1], name, colour, showlegend=k == 0, legendgroup=name, **look
        )
        figure.add_trace(curve, **place)

    s = float(path.objective.breaks[corner.vertex])
    around = s - 3 * half, s + 3 * half
    draw(_between(path.objective, *around), "objective path", PATH_COLOUR, width=6, opacity=0.5)
    for (name, other), dash in zip(paths.items(), cycle(DASHES), strict=False):
        stretch = _between(other, *other.place(np.clip(around, 0, path.objective.length)))
        draw(stretch, name, "#000000", dash=dash, width=1.5)
    for tool in tools:
        draw(_near(tool.execution, point, 3 * half), tool.name, **tool.look)
    middle = project(point)
    names = ("x [mm]", "y [mm]") if path.dimension == 2 else ("along [mm]", "across [mm]")
    ends = [middle - half * 1e3, middle + half * 1e3]
    figure.update_xaxes(title=names[0], range=[float(x[0]) for x in ends], **place)
    figure.update_yaxes(
        title=names[1] if column == 0 else None,
        range=[float(x[1]) for x in ends],
        scaleanchor=f"x{k + 1}" if k else "x",
        **place,
    )


def _view(path: Path, vertex: int) -> FloatArray:
    """Axes of the picture of a corner, (2, dimension).

    In space, they are the tangent before the corner and the normal in the plane of the corner.
    """
    if path.dimension == 2:
        return IN_PLANE
    before, after = path(path.breaks[vertex], 1, side="left"), path.tangents[vertex]
    across = after - (after @ before) * before
    return np.stack([before, across / np.linalg.norm(across)])


def _between(path: Path, start: float, end: float) -> FloatArray:
    """Points of a path between two arc lengths, including its vertices [m], (n, dimension)."""
    low, high = max(start, 0.0), min(end, path.length)
    vertices = path.breaks[(path.breaks > low) & (path.breaks < high)]
    return path(np.union1d(np.linspace(low, high, PLACES), vertices))


def _near(done: Execution, corner: FloatArray, distance: float) -> FloatArray:
    """Executed tool positions near a corner, interpolated [m], (n, dimension), with NaN as gaps."""
    from scipy.interpolate import CubicHermiteSpline

    near = np.flatnonzero(np.all(np.abs(done.tool - corner) < distance, axis=1)[:-1])
    gap = np.full((1, len(corner)), np.nan)
    parts = [gap]
    for visit in np.split(near, np.flatnonzero(np.diff(near) > 1) + 1):
        if len(visit):
            places = len(visit) * min(FINER, MAX_POINTS / len(near))
            samples = slice(visit[0], visit[-1] + 2)
            t = np.linspace(done.t[samples][0], done.t[samples][-1], int(places) + 2)
            q = CubicHermiteSpline(done.t[samples], done.q[samples], done.dq[samples])(t)
            parts += [done.arm.tool_position(q), gap]
    return np.concatenate(parts)


def curve(points: FloatArray, name: str, colour: str, **look: Any) -> Any:
    """Trace of a curve through points [m], (n, 2) or (n, 3)."""
    if points.shape[1] == 2:
        x, y = points.T * 1e3
        return line(x, y, name, colour, **look)
    look["width"] = look.get("width", 2) + 2
    return line_in_space(points * 1e3, name, colour, **look)


def line_in_space(points: FloatArray, name: str, colour: str, **look: Any) -> Any:
    """Trace of a curve in space through points [mm], (n, 3), rounded to 0.1 µm."""
    line = {"color": colour, "width": look.pop("width", 4), "dash": look.pop("dash", "solid")}
    x, y, z = np.round(points, 4).astype(np.float32).T
    hover = "x %{x:.3f} mm<br>y %{y:.3f} mm<br>z %{z:.3f} mm"
    return make_trace(
        "scatter3d", x=x, y=y, z=z, name=name, mode="lines", line=line, hovertemplate=hover, **look
    )


def in_space(
    figure: Any, points: FloatArray, *, title: str, height: int, top: int = 12, span: int = 6
) -> None:
    """Set the layout of a figure in space for points [mm], (n, 3), with axes of equal scale."""
    finish(figure, title=title, height=height, span=span)
    low, high = np.nanmin(points, axis=0), np.nanmax(points, axis=0)
    size = high - low
    longest = float(size.max())
    # A flat scene gets a margin, because the tick labels of its short axis would overlap.
    edge = np.maximum(FLATTEST * longest - size, 0.0) / 2 + 0.03 * longest
    size = size + 2 * edge
    ratio = size / float(size.max()) * SCENE_SIZE
    axis = {
        "nticks": 6,
        "backgroundcolor": "#FAFAFA",
        "gridcolor": "#DDDDDD",
        "zerolinecolor": "#DDDDDD",
    }
    figure.update_layout(
        scene={
            "aspectmode": "manual",
            "aspectratio": dict(zip("xyz", ratio.tolist(), strict=True)),
            "camera": CAMERA,
            **{
                f"{x}axis": {"title": {"text": f"{x} [mm]"}, "range": [a, b], **axis}
                for x, a, b in zip(
                    "xyz", (low - edge).tolist(), (high + edge).tolist(), strict=True
                )
            },
        },
        legend={
            "orientation": "v",
            "x": 0,
            "xref": "paper",
            "xanchor": "left",
            "yref": "paper",
            "y": 1,
            "yanchor": "top",
            "bgcolor": "rgba(255,255,255,0.8)",
        },
        margin={"l": 10, "r": 10, "t": top, "b": 10},
    )
