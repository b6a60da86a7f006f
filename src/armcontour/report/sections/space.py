"""The section on the path in space, and an animation of the arm."""

from __future__ import annotations

from itertools import cycle
from typing import Any

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour.evaluation import Evaluation
from armcontour.jobs import RunResult, Study
from armcontour.motion import Execution
from armcontour.program import Program
from armcontour.report.figure import Figure, Node
from armcontour.report.outline import outline_points, simplify
from armcontour.report.section import Section
from armcontour.report.sections.bodies import (
    draw_surroundings,
    in_space,
    line_in_space,
    seen_from_base,
)
from armcontour.report.sections.corners import DASHES, corners, replaced_paths, replaced_programs
from armcontour.report.sections.paths import done, executed_contours, objective_of
from armcontour.report.style import (
    EXPERIMENT_DASH,
    PATH_COLOUR,
    RUN_COLOURS,
    run_colours,
    run_widths,
)

# Largest number of points of an executed path.
MOST_PLACES = 600
# The same for a program, which may fill an area.
MOST_OF_PROGRAM = 6000
# Number of drawn tool axes, and their length as a share of the size of the path.
STICKS = 32
STICK_LENGTH = 0.09
# Number of frames of the animation.
FRAMES = 50
# Largest number of visible arms; the others can be shown in the legend.
MOST_ARMS = 2
SHOWN = {"size": 13, "color": "#222222"}


def space(study: Study) -> Section | None:
    """The objective path, executed paths and the moving arm in space; None in the plane."""
    if study.job.program.dimension != 3:
        return None
    return Section(
        key="paths",
        title="Path of the tool",
        text=(
            f"The objective path, {replaced_paths(study)}, and the {done(study)} path of the tool "
            "in each run. "
            "Sticks are the tool in the first run: its axis, and "
            "shorter its x axis where that is given. The arm below moves in the "
            "coordinates of its base, among what is known of its cell."
        ),
        figures=(draw_in_space(study), *corners(study), _arm(study)),
    )


def draw_in_space(study: Study) -> Any:
    """Figure of the paths in space."""
    figure = Figure()
    objective = outline_points(objective_of(study)) * 1e3
    figure.add_trace(line_in_space(objective, "objective path", PATH_COLOUR, width=9, opacity=0.45))
    noun = "contours" if len(study.job.program.contours) > 1 else "path"
    replaced = replaced_programs(study, noun)
    for (name, program), dash in zip(replaced.items(), cycle(DASHES), strict=False):
        figure.add_trace(
            line_in_space(outline_points(program) * 1e3, name, "#000000", width=3, dash=dash)
        )
    for points, name, colour in _sticks(study):
        figure.add_trace(line_in_space(points, name, colour, width=3))
    colours, widths = run_colours(study.runs), run_widths(study.runs)
    for name, result in study.runs.items():
        moved: list[tuple[str, Execution, Evaluation | None, str]] = []
        moved.append((name, result.motion, result.evaluation, "solid"))
        if (x := result.experiment) is not None:
            moved.append((f"{name}, experiment", x.execution, x.evaluation, EXPERIMENT_DASH))
        for label, execution, evaluation, dash in moved:
            points = _executed_tool(execution, evaluation, result.path) * 1e3
            width = widths[name] + 2
            figure.add_trace(line_in_space(points, label, colours[name], width=width, dash=dash))
    everywhere = np.concatenate([np.stack([x.x, x.y, x.z], axis=1) for x in figure.data])
    in_space(figure, everywhere, title="Path in space", height=680)
    return figure


def _executed_tool(
    execution: Execution, evaluation: Evaluation | None, program: Program
) -> FloatArray:
    """Executed points of the tool, with its largest error, (n, 3) [m].

    After each of several contours there is a gap (NaN): rapids have no path.
    """
    peak = -1.0 if evaluation is None else evaluation.contour_error.t_max
    worst = int(np.searchsorted(execution.t, peak))
    found = []
    followed = executed_contours(execution, program)
    gaps = [np.full((1, 3), np.nan)] if len(followed) > 1 else []
    for _, begin, end in followed:
        kept = np.arange(begin, end, max(1, len(execution.t) // MOST_PLACES))
        kept = np.union1d(kept, _shape(execution, begin, end, len(followed)))
        if begin <= worst < end:
            kept = np.union1d(kept, [worst])
        found += [execution.arm.tool_position(execution.q[kept]), *gaps]
    return np.concatenate(found)


def _shape(execution: Execution, begin: int, end: int, contours: int) -> IntArray:
    """Indices of the executed samples that show the shape of a contour."""
    tool = execution.arm.tool_position(execution.q[begin:end])
    each = max(4, MOST_OF_PROGRAM // contours)
    even = min(max(1, each // 4), MOST_PLACES)
    return begin + simplify([tool], each, even=even)[0]


def _sticks(study: Study) -> list[tuple[FloatArray, str, str]]:
    """Tool axes at points along the path of the first run [mm]."""
    result = next(iter(study.runs.values()))
    arm = result.arm
    if not hasattr(arm, "pose"):
        return []
    points, axes = arm.pose(_along(result))
    outline = outline_points(result.path)
    length = STICK_LENGTH * float((np.nanmax(outline, axis=0) - np.nanmin(outline, axis=0)).max())
    # The tool axis points from the arm to the work, so that the tool is on its negative side.
    found = [(_separate(points, points - length * axes[:, :, 2]), "tool axis", RUN_COLOURS[5])]
    path = result.path.contours[0].path
    if path.orientation is not None and not path.orientation.axis_only:
        ends = points + length / 2 * axes[:, :, 0]
        found.append((_separate(points, ends), "tool x axis", RUN_COLOURS[4]))
    return [(x * 1e3, name, colour) for x, name, colour in found]


def _along(result: RunResult) -> FloatArray:
    """Joint positions at points along every contour, or along some of many contours, (n, dof)."""
    spans, contours = result.trajectory.contour_spans, result.path.contours
    every = -(-len(spans) // STICKS)
    each = max(2, STICKS * every // len(spans))
    found = []
    for x, contour in zip(spans[::every], contours[::every], strict=True):
        assert x.trajectory is not None
        places = np.linspace(0, contour.path.length, each)
        found.append(x.trajectory(x.trajectory.time_at(places)))
    return np.concatenate(found)


def _separate(start: FloatArray, end: FloatArray) -> FloatArray:
    """Lines from start points to end points, with gaps (NaN) between."""
    return np.stack([start, end, np.full_like(start, np.nan)], axis=1).reshape(-1, 3)


def _arm(study: Study) -> Any:
    """Animation of the arm along the executed motions."""
    colours = run_colours(study.runs)
    last = max(float(x.motion.t[-1]) for x in study.runs.values())
    ends = [x.evaluation.until for x in study.runs.values() if x.evaluation is not None]
    last = min([last, *([max(ends)] if ends else [])])
    times = np.linspace(0, last, FRAMES)
    arms = {name: _arm_points(x.motion, times) for name, x in study.runs.items()}
    path = seen_from_base(study.job.arm, outline_points(objective_of(study)))
    figure = Figure(*[line_in_space(path, "objective path", PATH_COLOUR, width=7)])
    for i, (name, links) in enumerate(arms.items()):
        trace = line_in_space(links[0], name, colours[name], width=9)
        trace.update(mode="lines+markers", marker={"size": 4, "color": "#222222"})
        if i >= MOST_ARMS:
            trace.update(visible="legendonly")
        figure.add_trace(trace)
    which = list(range(1, len(figure.data)))
    everywhere = np.concatenate([path, *(x.reshape(-1, 3) for x in arms.values())])
    drawn = [everywhere]
    for trace, points in draw_surroundings(study.job, everywhere):
        figure.add_trace(trace)
        drawn.append(points)
    figure.frames = [
        Node(
            {
                "name": str(k),
                "traces": which,
                "data": [
                    {"type": "scatter3d", **dict(zip("xyz", links[k].T, strict=True))}
                    for links in arms.values()
                ],
            }
        )
        for k in range(FRAMES)
    ]
    title = "The arm along its motion, as its base has it"
    in_space(figure, np.concatenate(drawn), title=title, height=700, top=50)
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
        "font": {"color": "rgba(0,0,0,0)"},  # fifty labels would hide each other
    }
    # Above the scene; places are in pixels, so that buttons fit narrow screens.
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
    return {
        "updatemenus": [menu],
        "sliders": [slider],
        "margin": {"b": 20},
    }


def _arm_points(execution: Execution, times: FloatArray) -> FloatArray:
    """Points of the arm's links at some times [mm], (n, points, 3)."""
    q = np.column_stack([np.interp(times, execution.t, x) for x in execution.q.T])
    return np.round(seen_from_base(execution.arm, execution.arm.links(q)), 2).astype(np.float32)


def _at_once(duration: float = 0.0) -> dict[str, Any]:
    """Options of an animation without transitions; a scene needs a redraw."""
    return {
        "mode": "immediate",
        "fromcurrent": True,
        "frame": {"duration": duration, "redraw": True},
        "transition": {"duration": 0},
    }
