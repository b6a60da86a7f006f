"""Section on the tool path: executed path, enlarged corners, and animated arm."""

from __future__ import annotations

from typing import Any

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.jobs import JobResult, RunResult
from armcontour.motion import Execution
from armcontour.report.figure import Figure, Node, make_trace
from armcontour.report.outline import outline_points, simplify
from armcontour.report.section import Section
from armcontour.report.sections.bodies import (
    curve,
    draw_surroundings,
    in_space,
    line_in_space,
    seen_from_base,
)
from armcontour.report.sections.corner_figures import Tool, corners, tools_of
from armcontour.report.sections.motion import marked_run
from armcontour.report.style import PATH_COLOUR, RUN_COLOURS, finish, run_colours

# Maximum number of points of an executed path, and number of evenly spaced points among them.
MAX_POINTS, EVEN = 6000, 800
# Number of drawn tool axes, and their length as a share of the size of the path.
STICKS = 32
STICK_LENGTH = 0.09
# Height of the figures [px], and number of frames of the animation.
HEIGHT, FRAMES = 350, 50
# Maximum number of arms that are visible at first; the user can show others in the legend.
MAX_ARMS = 2
# Font of the time in the animation.
SHOWN = {"size": 13, "color": "#222222"}


def paths(study: JobResult) -> Section:
    """Section with objective and executed paths, enlarged corners and, in space, the moving arm."""
    figures = [draw_path(study), *corners(study)]
    text = "The executed path of the tool" if study.simulated else "The planned path of the tool"
    if study.job.program.dimension == 3:
        figures.append(_arm(study))
        text += (
            ". Sticks show the tool in the first run: its axis and, if the x axis is specified, a "
            "shorter stick along it. The arm is drawn in the base frame"
        )
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
    for points, name, colour in _sticks(study):
        figure.add_trace(curve(points, name, colour, width=3))
    for tool in tools_of(study):
        figure.add_trace(curve(executed_points(tool), tool.name, **tool.look))
    if objective.shape[1] == 3:
        everywhere = np.concatenate([np.stack([x.x, x.y, x.z], axis=1) for x in figure.data])
        in_space(figure, everywhere, title="Path of the tool", height=HEIGHT)
        return figure
    if (marked := marked_run(study)) is not None:
        figure.add_trace(_switching_points(marked, run_colours(study.runs)[marked.run.name]))
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


def _switching_points(result: RunResult, colour: str) -> Any:
    """Trace with the switching points P0, P1, ... on the tool path."""
    t = result.trajectory.switching_points
    q = result.trajectory(np.minimum(t, result.trajectory.duration))
    x, y = result.arm.tool_position(q).T * 1e3
    return make_trace(
        "scatter",
        x=x,
        y=y,
        name=f"{result.run.name}: switching points",
        mode="markers+text",
        text=[f"P{k}" for k in range(len(t))],
        textposition="top right",
        marker={"color": colour, "size": 8, "symbol": "diamond", "line": {"width": 1}},
    )


def _sticks(study: JobResult) -> list[tuple[FloatArray, str, str]]:
    """Points [m], name and colour of lines that show the tool axes along the first run."""
    result = next(iter(study.runs.values()))
    arm = result.arm
    if result.path.dimension == 2 or not hasattr(arm, "pose"):
        return []
    points, axes = arm.pose(_along(result))
    outline = outline_points(result.path)
    length = STICK_LENGTH * float((np.nanmax(outline, axis=0) - np.nanmin(outline, axis=0)).max())
    # The tool axis points from the arm to the work. The sticks are drawn from the tool point
    # against this direction.
    sticks = [(_separate(points, points - length * axes[:, :, 2]), "tool axis", RUN_COLOURS[5])]
    path = result.path.contours[0].path
    if path.orientation is not None and not path.orientation.axis_only:
        ends = points + length / 2 * axes[:, :, 0]
        sticks.append((_separate(points, ends), "tool x axis", RUN_COLOURS[4]))
    return sticks


def _along(result: RunResult) -> FloatArray:
    """Joint positions along contours [rad], (n, dof); of many contours, only every k-th is used."""
    spans = result.trajectory.contour_spans
    every = -(-len(spans) // STICKS)
    each = max(2, STICKS * every // len(spans))
    times = [np.linspace(*x.t, each) for x in spans[::every]]
    return result.trajectory(np.minimum(np.concatenate(times), result.trajectory.duration))


def _separate(start: FloatArray, end: FloatArray) -> FloatArray:
    """Points of the lines from start to end points, with NaN after each line, (3 n, 3)."""
    return np.stack([start, end, np.full_like(start, np.nan)], axis=1).reshape(-1, 3)


def _arm(study: JobResult) -> Any:
    """Figure with an animation of the arm along the executed motions."""
    colours = run_colours(study.runs)
    last = max(float(x.motion.t[-1]) for x in study.runs.values())
    ends = [x.evaluation.end_time for x in study.runs.values() if x.evaluation is not None]
    last = min([last, *([max(ends)] if ends else [])])
    times = np.linspace(0, last, FRAMES)
    arms = {name: _arm_points(x.motion, times) for name, x in study.runs.items()}
    first = next(iter(study.runs.values()))
    path = seen_from_base(study.job.arm, outline_points(first.objective))
    figure = Figure(*[line_in_space(path, "objective path", PATH_COLOUR, width=7)])
    for i, (name, links) in enumerate(arms.items()):
        trace = line_in_space(links[0], name, colours[name], width=9)
        trace.update(mode="lines+markers", marker={"size": 4, "color": "#222222"})
        if i >= MAX_ARMS:
            trace.update(visible="legendonly")
        figure.add_trace(trace)
    traces = list(range(1, len(figure.data)))
    everywhere = np.concatenate([path, *(x.reshape(-1, 3) for x in arms.values())])
    drawn = [everywhere]
    for trace, points in draw_surroundings(study.job, everywhere):
        figure.add_trace(trace)
        drawn.append(points)
    figure.frames = [
        Node(
            {
                "name": str(k),
                "traces": traces,
                "data": [
                    {"type": "scatter3d", **dict(zip("xyz", links[k].T, strict=True))}
                    for links in arms.values()
                ],
            }
        )
        for k in range(FRAMES)
    ]
    title = "The arm along its motion"
    in_space(figure, np.concatenate(drawn), title=title, height=HEIGHT, top=50)
    figure.update_layout(**_playing(times))
    return figure


def _playing(times: FloatArray) -> dict[str, Any]:
    """Layout of an animation: buttons, and a slider over the times of its frames [s]."""
    steps = [
        {"label": f"{t:.2f}", "method": "animate", "args": [[str(k)], _at_once()]}
        for k, t in enumerate(times)
    ]
    each = 1e3 * float(times[-1]) / FRAMES
    play: list[dict[str, Any]] = [
        {"label": "play", "method": "animate", "args": [None, _at_once(each)]},
        {"label": "stop", "method": "animate", "args": [[None], _at_once()]},
    ]
    slider = {
        "steps": steps,
        "currentvalue": {"prefix": "time ", "suffix": " s", "font": SHOWN},
        "pad": {"t": 10, "b": 10},
        "len": 1.0,
        "ticklen": 0,
        "font": {"color": "rgba(0,0,0,0)"},  # transparent, because the labels would overlap
    }
    # The buttons are above the scene. Their padding is in pixels, so that they fit narrow screens.
    menu = {
        "type": "buttons",
        "direction": "right",
        "buttons": play,
        "showactive": False,
        "x": 0,
        "xanchor": "left",
        "y": 1,
        "yanchor": "bottom",
        "pad": {"t": 0, "b": 6},
        "bgcolor": "#FFFFFF",
        "font": {"size": 12},
    }
    return {"updatemenus": [menu], "sliders": [slider], "margin": {"b": 20}}


def _arm_points(execution: Execution, times: FloatArray) -> FloatArray:
    """Points of the arm's links at times, in the base frame [mm], (n, points, 3)."""
    q = np.column_stack([np.interp(times, execution.t, x) for x in execution.q.T])
    return np.round(seen_from_base(execution.arm, execution.arm.links(q)), 2).astype(np.float32)


def _at_once(duration: float = 0.0) -> dict[str, Any]:
    """Options of an animation without transitions; `duration`: time per frame [ms]."""
    return {
        "mode": "immediate",
        "fromcurrent": True,
        "frame": {"duration": duration, "redraw": True},
        "transition": {"duration": 0},
    }
