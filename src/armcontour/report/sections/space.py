"""The tool's path in space, its error magnified on request, and the arm that moves along it."""

from __future__ import annotations

from itertools import cycle
from typing import Any

import numpy as np

from armcontour._checks import FloatArray
from armcontour.geometry import Path
from armcontour.motion import Execution
from armcontour.program import Program
from armcontour.report.section import Section
from armcontour.report.sections.corners import DASHES, corners, rounded_paths
from armcontour.report.sections.paths import drawn
from armcontour.report.style import (
    EXPERIMENT_DASH,
    PATH_COLOUR,
    RUN_COLOURS,
    finish,
    run_colours,
    run_widths,
)
from armcontour.study import RunResult, Study

# How many times larger errors can be shown.
MAGNIFICATIONS = (1, 10, 100, 1000)
# Points of an executed path: it is stored once per magnification.
MOST_PLACES = 600
# Places at which the tool's axes are drawn, and their length in sizes of the path.
STICKS = 32
STICK_LENGTH = 0.09
# Instants of the arm's motion.
FRAMES = 50
# More arms than this at once hide each other; the rest wait in the legend.
MOST_ARMS = 2
# The shortest side of a scene, in longest ones.
FLATTEST = 0.4
# Longest side of a scene in units of plotly's: it just fits, seen from anywhere.
SCENE = 1.45
SHOWN = {"size": 13, "color": "#222222"}
# Where each view is seen from, and what is up in it.
VIEWS = {
    "oblique": ((1.1, -1.5, 0.9), (0, 0, 1)),
    "top": ((0, 0, 2), (0, 1, 0)),
    "front": ((0, -2, 0), (0, 0, 1)),
    "side": ((2, 0, 0), (0, 0, 1)),
}


def space(study: Study) -> Section | None:
    """The path and what was made of it in space; None for a path in the plane."""
    if study.job.path.dimension != 3:
        return None
    return Section(
        key="paths",
        title="Path of the tool",
        text=(
            "The objective path, the rounded path, and what the tool did in each run. Errors can "
            "be magnified: then a point is drawn at its nearest place of the path, plus so many "
            "times its distance from there. Sticks are the tool in the first run: its axis, and "
            "shorter its x axis where that is given."
        ),
        figures=(_path(study), *corners(study), _arm(study)),
    )


def _path(study: Study) -> Any:
    import plotly.graph_objects as go

    figure = go.Figure()
    objective = drawn(study.job.path) * 1e3
    figure.add_trace(_line(objective, "objective path", PATH_COLOUR, width=9, opacity=0.45))
    for (name, path), dash in zip(rounded_paths(study).items(), cycle(DASHES), strict=False):
        figure.add_trace(_line(drawn(path) * 1e3, name, "#000000", width=3, dash=dash))
    for points, name, colour in _sticks(study):
        figure.add_trace(_line(points, name, colour, width=3))
    static = len(figure.data)
    colours, widths = run_colours(study.runs), run_widths(study.runs)
    moved: list[tuple[FloatArray, FloatArray]] = []
    for name, result in study.runs.items():
        done = [(name, result.execution, "solid")]
        if result.experiment is not None:
            done.append((f"{name}, experiment", result.experiment.execution, EXPERIMENT_DASH))
        for label, execution, dash in done:
            moved.append(_error(execution, result.path))
            points = (moved[-1][0] + moved[-1][1]) * 1e3
            width = widths[name] + 2
            figure.add_trace(_line(points, label, colours[name], width=width, dash=dash))
    which = list(range(static, len(figure.data)))
    _in_space(figure, title="Path in space", height=680)
    fixed = np.concatenate([_points(x) for x in figure.data[:static]])
    buttons = []
    for k in MAGNIFICATIONS:
        curves = [(nearest + k * error) * 1e3 for nearest, error in moved]
        box = _box(np.concatenate([fixed, *curves]))
        buttons.append(
            {"label": f"{k}×", "method": "update", "args": [_coordinates(curves), box, which]}
        )
    figure.update_layout(buttons[0]["args"][1])
    figure.update_layout(
        updatemenus=[_buttons(buttons, 0.12), _views(0.62)],
        annotations=[_label("error magnified", 0.0), _label("view", 0.57)],
    )
    return figure


def _roomy(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Lower and upper ends of a box around points, no side much shorter than the longest."""
    low, high = np.nanmin(points, axis=0), np.nanmax(points, axis=0)
    size = high - low
    more = np.maximum(FLATTEST * float(size.max()) - size, 0.0) / 2
    return low - more, high + more


def _error(execution: Execution, path: Path | Program) -> tuple[FloatArray, FloatArray]:
    """Nearest places of the path, and the way from there to the tool, (n, 3) each [m].

    Between the contours of a program there is no path: the tool is drawn where it was.
    """
    tool = execution.tool
    nearest, distance = tool.copy(), np.zeros(len(tool))
    for part, of in _followed(execution, path):
        found = part.project(tool[of])
        nearest[of], distance[of] = part(found.s), found.distance
    every = max(1, len(tool) // MOST_PLACES)
    kept = np.union1d(np.arange(0, len(tool), every), [int(np.argmax(distance))])
    return nearest[kept], tool[kept] - nearest[kept]


def _followed(execution: Execution, path: Path | Program) -> list[tuple[Path, slice]]:
    """The paths that were followed, and which of the results belong to each."""
    if isinstance(path, Path):
        return [(path, slice(None))]
    spans = [x for x in execution.taught.trajectory.spans if x.kind == "contour"]
    ends = [np.searchsorted(execution.t, x.t) for x in spans]
    return [(x.path, slice(int(a), int(b))) for x, (a, b) in zip(path.contours, ends, strict=True)]


def _coordinates(curves: list[FloatArray]) -> dict[str, list[Any]]:
    """Coordinates of curves as buttons take them; tenths of a micron will do."""
    return {name: [np.round(x[:, i], 4).tolist() for x in curves] for i, name in enumerate("xyz")}


def _points(trace: Any) -> FloatArray:
    return np.stack([trace.x, trace.y, trace.z], axis=1)


def _sticks(study: Study) -> list[tuple[FloatArray, str, str]]:
    """The tool's axes at places along the path of the first run [mm]."""
    result = next(iter(study.runs.values()))
    arm = result.execution.arm
    if not hasattr(arm, "pose"):
        return []
    points, axes = arm.pose(_along(result))
    outline = drawn(result.path)
    length = STICK_LENGTH * float((np.nanmax(outline, axis=0) - np.nanmin(outline, axis=0)).max())
    # The tool is behind its point: its axis goes from the arm to the work.
    found = [(_separate(points, points - length * axes[:, :, 2]), "tool axis", RUN_COLOURS[5])]
    path = result.path if isinstance(result.path, Path) else result.path.contours[0].path
    if path.orientation is not None and not path.orientation.axis_only:
        ends = points + length / 2 * axes[:, :, 0]
        found.append((_separate(points, ends), "tool x axis", RUN_COLOURS[4]))
    return [(x * 1e3, name, colour) for x, name, colour in found]


def _along(result: RunResult) -> FloatArray:
    """Joint positions at places along the path, or at times along every contour, (n, dof)."""
    if result.joint_path is not None and isinstance(result.path, Path):
        return result.joint_path(np.linspace(0, result.path.length, STICKS))
    spans = [x for x in result.trajectory.spans if x.kind == "contour"]
    each = max(2, STICKS // len(spans))
    return result.trajectory(np.concatenate([np.linspace(*x.t, each) for x in spans]))


def _separate(begin: FloatArray, end: FloatArray) -> FloatArray:
    """Lines from points to others, with gaps between them."""
    return np.stack([begin, end, np.full_like(begin, np.nan)], axis=1).reshape(-1, 3)


def _arm(study: Study) -> Any:
    import plotly.graph_objects as go

    colours = run_colours(study.runs)
    last = max(float(x.execution.t[-1]) for x in study.runs.values())
    last = min(last, max(x.evaluation.until for x in study.runs.values()))
    times = np.linspace(0, last, FRAMES)
    arms = {name: _links(x.execution, times) for name, x in study.runs.items()}
    path = drawn(study.job.path) * 1e3
    figure = go.Figure(data=[_line(path, "objective path", PATH_COLOUR, width=7)])
    for i, (name, links) in enumerate(arms.items()):
        trace = _line(links[0], name, colours[name], width=9)
        trace.update(mode="lines+markers", marker={"size": 4, "color": "#222222"})
        if i >= MOST_ARMS:
            trace.update(visible="legendonly")
        figure.add_trace(trace)
    which = list(range(1, len(figure.data)))
    figure.frames = [
        go.Frame(
            name=str(k),
            traces=which,
            data=[
                {"type": "scatter3d", **dict(zip("xyz", links[k].T, strict=True))}
                for links in arms.values()
            ],
        )
        for k in range(FRAMES)
    ]
    _in_space(figure, title="The arm along its motion, as executed", height=700)
    everywhere = np.concatenate([path, *(x.reshape(-1, 3) for x in arms.values())])
    figure.update_layout(_box(everywhere))
    steps = [
        {"label": f"{t:.2f}", "method": "animate", "args": [[str(k)], _at_once()]}
        for k, t in enumerate(times)
    ]
    play: list[dict[str, Any]] = [
        {"label": "play", "method": "animate", "args": [None, _at_once(1e3 * last / FRAMES)]},
        {"label": "stop", "method": "animate", "args": [[None], _at_once()]},
    ]
    figure.update_layout(
        updatemenus=[{**_buttons(play, 0.0), "showactive": False}, _views(0.62)],
        annotations=[_label("view", 0.57)],
        sliders=[
            {
                "steps": steps,
                "currentvalue": {"prefix": "time ", "suffix": " s", "font": SHOWN},
                "pad": {"t": 10, "b": 10},
                "len": 1.0,
                "ticklen": 0,
                "font": {"color": "rgba(0,0,0,0)"},  # fifty labels would hide each other
            }
        ],
        margin={"l": 10, "r": 10, "t": 110, "b": 20},
    )
    return figure


def _links(execution: Execution, times: FloatArray) -> FloatArray:
    """Points of the arm at some times [mm], (n, points, 3)."""
    q = np.column_stack([np.interp(times, execution.t, x) for x in execution.q.T])
    return np.round(execution.arm.links(q) * 1e3, 2).astype(np.float32)


def _line(points: FloatArray, name: str, colour: str, **look: Any) -> Any:
    import plotly.graph_objects as go

    line = {"color": colour, "width": look.pop("width", 4), "dash": look.pop("dash", "solid")}
    x, y, z = np.round(points, 4).astype(np.float32).T
    hover = "x %{x:.3f} mm<br>y %{y:.3f} mm<br>z %{z:.3f} mm"
    return go.Scatter3d(
        x=x, y=y, z=z, name=name, mode="lines", line=line, hovertemplate=hover, **look
    )


def _in_space(figure: Any, *, title: str, height: int) -> None:
    """Layout of a figure in space: equal axes, a legend that hides nothing below."""
    finish(figure, title=title, height=height)
    axis = {
        "nticks": 6,
        "backgroundcolor": "#FAFAFA",
        "gridcolor": "#DDDDDD",
        "zerolinecolor": "#DDDDDD",
    }
    figure.update_layout(
        scene={
            "aspectmode": "manual",
            "camera": _camera("oblique"),
            **{f"{x}axis": {"title": {"text": f"{x} [mm]"}, **axis} for x in "xyz"},
        },
        legend={
            "orientation": "v",
            "x": 0,
            "xanchor": "left",
            "yref": "paper",
            "y": 1,
            "yanchor": "top",
            "bgcolor": "rgba(255,255,255,0.8)",
        },
        margin={"l": 10, "r": 10, "t": 110, "b": 10},
    )


def _box(points: FloatArray) -> dict[str, Any]:
    """Layout of a scene that holds some points, equal in all directions, whatever is seen."""
    low, high = _roomy(points)
    edge = 0.03 * float((high - low).max())
    size = high - low + 2 * edge
    ratio = size / float(size.max()) * SCENE
    found: dict[str, Any] = {
        f"scene.{x}axis.range": [float(low[i] - edge), float(high[i] + edge)]
        for i, x in enumerate("xyz")
    }
    return {**found, "scene.aspectratio": dict(zip("xyz", ratio.tolist(), strict=True))}


def _camera(view: str) -> dict[str, Any]:
    (x, y, z), (a, b, c) = VIEWS[view]
    return {
        "eye": {"x": x, "y": y, "z": z},
        "up": {"x": a, "y": b, "z": c},
        "center": {"x": 0, "y": 0, "z": 0},
        # Parallel lines stay parallel: what is equal looks equal.
        "projection": {"type": "orthographic"},
    }


def _views(x: float) -> dict[str, Any]:
    found = []
    for name, (eye, _) in VIEWS.items():
        # Seen from its end, an axis has all its labels in one place.
        args: dict[str, Any] = {
            f"scene.{axis}axis.visible": np.count_nonzero(eye) > 1 or not eye[i]
            for i, axis in enumerate("xyz")
        }
        args["scene.camera"] = _camera(name)
        found.append({"label": name, "method": "relayout", "args": [args]})
    return _buttons(found, x)


def _buttons(buttons: list[dict[str, Any]], x: float) -> dict[str, Any]:
    return {
        "type": "buttons",
        "direction": "right",
        "buttons": buttons,
        "x": x,
        "xanchor": "left",
        "y": 1.01,
        "yanchor": "bottom",
        "pad": {"t": 0, "b": 4},
        "bgcolor": "#FFFFFF",
        "font": {"size": 12},
    }


def _label(text: str, x: float) -> dict[str, Any]:
    """A label before a row of buttons."""
    return {
        "text": text,
        "x": x,
        "xref": "paper",
        "xanchor": "left",
        "y": 1.01,
        "yref": "paper",
        "yanchor": "bottom",
        "yshift": 12,
        "showarrow": False,
        "font": {"size": 12},
    }


def _at_once(duration: float = 0.0) -> dict[str, Any]:
    """Options of an animation without transitions; a scene must be drawn anew."""
    return {
        "mode": "immediate",
        "fromcurrent": True,
        "frame": {"duration": duration, "redraw": True},
        "transition": {"duration": 0},
    }
