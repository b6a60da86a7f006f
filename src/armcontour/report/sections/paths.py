"""Sections on the tool path in the plane, its enlarged corners, and the path in joint space."""

from __future__ import annotations

from typing import Any

import numpy as np

from armcontour._checks import FloatArray
from armcontour.geometry import Path
from armcontour.jobs import RunResult, Study
from armcontour.motion import Execution
from armcontour.program import Program
from armcontour.report.figure import Figure, make_trace
from armcontour.report.outline import outline_points, outlines, simplify
from armcontour.report.section import Section, marked_run
from armcontour.report.sections.corners import corners, replaced_paths
from armcontour.report.style import PATH_COLOUR, finish, line, run_colours, run_widths

# Number of samples of a planned joint path, before it is simplified.
DRAWN_TIMES = 800
MOST_TIMES = 100_000
# Ratio of height to width from which a path leaves room for corners in the same row.
TALL = 0.8
# Relative widths of such a path and of its enlarged corners.
COLUMNS = (2, 3)


def paths(study: Study) -> Section | None:
    """Cartesian path and its corners in the plane; None in space."""
    if study.job.program.dimension != 2:
        return None
    enlarged = corners(study)
    objective = outline_points(objective_of(study))
    beside = bool(enlarged) and _tall(objective)
    return Section(
        key="paths",
        title="Path of the tool",
        text=(
            f"The objective path, {replaced_paths(study)}, and the {done(study)} path of the tool "
            "in each run"
            + (" along the contours" if len(study.job.program.contours) > 1 else "")
            + ". The enlarged corners show the gap between corner point and path: the corner error."
        ),
        figures=(draw_in_plane(study), *enlarged),
        columns=COLUMNS if beside else (),
    )


def joint_space(study: Study) -> Section | None:
    """Planned and executed joint positions of a planar arm; None in space."""
    if study.job.program.dimension != 2:
        return None
    figure = Figure()
    colours, widths = run_colours(study.runs), run_widths(study.runs)
    for name, result in study.runs.items():
        q, planned = _of_joints(result)
        if result.execution is not None:
            figure.add_trace(
                line(q[:, 0], q[:, 1], f"{name}: executed", colours[name], width=widths[name])
            )
        figure.add_trace(
            line(planned[:, 0], planned[:, 1], f"{name}: planned", colours[name], dash="dot")
        )
    marked = marked_run(study)
    what = "planned and executed" if study.simulated else "planned"
    text = f"Joint positions, {what}."
    if marked is not None:
        _switching_points(figure, marked, marked.trajectory, colours[marked.run.name])
        text = f"Joint positions, {what}, with the switching points P0, P1, ..."
    names = study.job.arm.joint_names
    figure.update_xaxes(title=f"{names[0]} [rad]")
    figure.update_yaxes(title=f"{names[1]} [rad]")
    return Section(
        key="joint-space",
        title="Joint space",
        text=text,
        figures=(finish(figure, title="First two joints", height=560),),
    )


def _of_joints(result: RunResult) -> tuple[FloatArray, FloatArray]:
    """Executed and planned joint positions for the figure, simplified, (n, dof) each."""
    q, plan = result.motion.q, result.trajectory
    times = np.linspace(0, plan.duration, min(MOST_TIMES, max(DRAWN_TIMES, len(q))))
    planned = plan(times)
    of_q, of_plan = simplify([q, planned])
    return q[of_q], planned[of_plan]


def objective_of(study: Study) -> Program:
    """The program of the first run with leads and with sharp corners."""
    return next(iter(study.runs.values())).objective


def executed_contours(execution: Execution, program: Program) -> list[tuple[Path, int, int]]:
    """The path of every contour, and the indices of its first and after its last executed sample.

    Samples before and after the motion belong to the first and the last contour.
    """
    trajectory, last = execution.taught.trajectory, len(execution.t)
    found = []
    for x, span in zip(program.contours, trajectory.contour_spans, strict=True):
        start, end = np.searchsorted(execution.t, span.t).tolist()
        # At least two samples, also of a very short contour.
        start = 0 if span.t[0] <= 0 else min(start, last - 2)
        end = last if span.t[1] >= trajectory.duration else max(end + 1, start + 2)
        found.append((x.path, start, end))
    return found


def _executed_tool(result: RunResult) -> FloatArray:
    """Executed tool positions along all contours, with gaps (NaN) after each contour."""
    tool = result.motion.tool
    return outlines([tool[a:b] for _, a, b in executed_contours(result.motion, result.path)])


def _tall(points: FloatArray) -> bool:
    """Whether a path is high enough to leave room in its row."""
    width, height = np.nanmax(points, axis=0) - np.nanmin(points, axis=0)
    return bool(height > TALL * width)


def done(study: Study) -> str:
    """The word for the motion that is drawn."""
    return "executed" if study.simulated else "planned"


def draw_in_plane(study: Study) -> Any:
    """Figure of the objective path and the executed paths in the plane."""
    figure, objective = Figure(), outline_points(objective_of(study)) * 1e3
    figure.add_trace(
        line(objective[:, 0], objective[:, 1], "objective path", PATH_COLOUR, width=6, opacity=0.5)
    )
    colours, widths = run_colours(study.runs), run_widths(study.runs)
    for name, result in study.runs.items():
        tool = _executed_tool(result) * 1e3
        figure.add_trace(line(tool[:, 0], tool[:, 1], name, colours[name], width=widths[name]))
    marked = marked_run(study)
    if marked is not None:
        _switching_points(figure, marked, None, colours[marked.run.name])
    figure.update_xaxes(title="x [mm]")
    figure.update_yaxes(title="y [mm]", scaleanchor="x")
    return finish(figure, title="Cartesian path", height=640)


def _switching_points(figure: Any, result: RunResult, trajectory: Any, colour: str) -> None:
    """Mark the switching points P0, P1, ... on the tool path, or in joint space."""
    t = result.trajectory.switching_points
    q = result.trajectory(np.minimum(t, result.trajectory.duration))
    places = q if trajectory is not None else result.arm.tool_position(q) * 1e3
    figure.add_trace(
        make_trace(
            "scatter",
            x=places[:, 0],
            y=places[:, 1],
            name=f"{result.run.name}: switching points",
            mode="markers+text",
            text=[f"P{k}" for k in range(len(t))],
            textposition="top right",
            marker={"color": colour, "size": 8, "symbol": "diamond", "line": {"width": 1}},
        )
    )
