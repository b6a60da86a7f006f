"""Figures of enlarged corners: in the plane, or in space in the plane of a corner's two lines."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import cycle
from typing import Any

import numpy as np

from armcontour._checks import FloatArray
from armcontour.geometry import Path, RoundedPath
from armcontour.jobs import Study
from armcontour.motion import Execution
from armcontour.program import Program
from armcontour.report.style import (
    EXPERIMENT_DASH,
    PATH_COLOUR,
    finish,
    line,
    run_colours,
    run_widths,
)

# Half width of an enlarged corner, in corner errors.
ZOOM = 4.0
# Largest number of enlarged corners.
MOST_CORNERS = 4
# Number of drawn points per executed sample.
FINER = 6
MOST_POINTS = 800
# Number of points of a drawn path.
PLACES = 200
IN_PLANE = np.eye(2)
# Dashes of different rounded paths.
DASHES = ("dash", "dot", "dashdot", "longdash")


def corners(study: Study) -> list[Any]:
    """A row of enlarged corners; empty if no run has rounded corners."""
    from plotly.subplots import make_subplots

    paths = _rounded_paths(study)
    if not paths:
        return []
    found = next(iter(paths.values())).corners
    rounded = np.flatnonzero(found.radius > 0)
    shown = rounded[:MOST_CORNERS]
    if not len(shown):
        return []
    # Long titles of neighbouring figures would overlap.
    apart = "<br>" if len(shown) > 2 else " "
    figure = make_subplots(
        rows=1,
        cols=len(shown),
        subplot_titles=[
            f"corner {k + 1}<br>r = {found.radius[k] * 1e3:.2f} mm,{apart}"
            f"error {found.error[k] * 1e3:.2f} mm"
            for k in shown
        ],
    )
    tools = _tools(study)
    for column, k in enumerate(shown, start=1):
        _corner(figure, tools, paths, int(k), column)
    finish(figure, title=_title(study, list(paths), len(shown), len(rounded)), height=540)
    figure.update_layout(margin={"t": 100})
    if len(shown) > 2:
        # Room for a third line of the titles.
        figure.update_layout(margin={"t": 130}, title={"y": 0.98, "yanchor": "top"})
        figure.update_xaxes(nticks=6, tickangle=0)
        figure.update_yaxes(nticks=6)
    return [figure]


def _title(study: Study, names: list[str], shown: int, rounded: int) -> str:
    """Title of the figure: which corners it shows, and of which run their numbers are."""
    title = "Corners enlarged"
    if len(study.job.program.contours) > 1:
        title += f", contour {_shown(study) + 1}"
    if rounded > shown:
        title += f": the first {shown} of {rounded}"
    if len(names) > 1:
        title += f"; radius and error are those of the {names[0]}"
    return title


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Tool:
    """The executed tool path of a run or an experiment, and its line in figures.

    Args:
        name: Name in the legend.
        done: The execution.
        points: Tool positions [m], (n, dimension).
        colour, look: Colour and other options of the line.
    """

    name: str
    done: Execution
    points: FloatArray
    colour: str
    look: dict[str, Any]


def _tools(study: Study) -> list[Tool]:
    """Executed tool paths of all runs and experiments."""
    colours, widths = run_colours(study.runs), run_widths(study.runs)
    found = []
    for name, result in study.runs.items():
        own: dict[str, Any] = {"width": widths[name]}
        done = [(name, result.execution, own)]
        if (x := result.experiment) is not None:
            look = {"dash": EXPERIMENT_DASH, "width": 1.5}
            done.append((f"{name}, experiment", x.execution, look))
        found += [
            Tool(name=called, done=y, points=y.tool, colour=colours[name], look=look)
            for called, y, look in done
        ]
    return found


def rounded_programs(study: Study) -> dict[str, Program]:
    """The different rounded programs, each by the name of the first run that has it."""
    found: dict[str, Program] = {}
    which = _shown(study)
    for name, result in study.runs.items():
        path = result.path.contours[which].path
        known = (x.contours[which].path for x in found.values())
        if isinstance(path, RoundedPath) and not any(_alike(path, x) for x in known):
            found[name] = result.path
    return found


def _rounded_paths(study: Study) -> dict[str, RoundedPath]:
    """The different rounded paths of the contour in the figure, by their names in the legend."""
    programs, which = rounded_programs(study), _shown(study)
    found: dict[str, RoundedPath] = {}
    for name, program in programs.items():
        path = program.contours[which].path
        assert isinstance(path, RoundedPath)
        found[f"rounded path of {name}" if len(programs) > 1 else "rounded path"] = path
    return found


def _shown(study: Study) -> int:
    """Index of the contour in the figure: the first with rounded corners."""
    program = next(iter(study.runs.values())).path
    for i, x in enumerate(program.contours):
        if isinstance(x.path, RoundedPath) and (x.path.corners.radius > 0).any():
            return i
    return 0


def _alike(first: Path, second: Path) -> bool:
    """Whether two paths have the same vertices."""
    return np.array_equal(first.breaks, second.breaks) and np.array_equal(
        first.vertices, second.vertices
    )


def _corner(
    figure: Any, tools: list[Tool], paths: dict[str, RoundedPath], k: int, column: int
) -> None:
    """Draw corner k of all paths and executions in one column of the figure."""
    path = next(iter(paths.values()))
    found, place = path.corners, {"row": 1, "col": column}
    corner, half = found.point[k], ZOOM * float(found.error[k])
    view = _view(path.objective, int(found.vertex[k]))
    # In the plane the coordinates are those of the path, in space they are relative to the corner.
    origin = np.zeros_like(corner) if path.dimension == 2 else corner

    def draw(points: FloatArray, name: str, colour: str, **look: Any) -> None:
        at = (points - origin) @ view.T * 1e3
        curve = line(
            at[:, 0], at[:, 1], name, colour, showlegend=column == 1, legendgroup=name, **look
        )
        figure.add_trace(curve, **place)

    at = float(path.objective.breaks[found.vertex[k]])
    lines = _between(path.objective, at, at, 3 * half)
    draw(lines, "objective path", PATH_COLOUR, width=6, opacity=0.5)
    for (name, other), dash in zip(paths.items(), cycle(DASHES), strict=False):
        for i in np.flatnonzero(other.corners.vertex == found.vertex[k]):
            start, end = float(other.corners.start[i]), float(other.corners.end[i])
            arc = _between(other, start, end, 3 * half)
            draw(arc, name, "#000000", dash=dash, width=1.5)
    for x in tools:
        draw(_near(x.done, x.points, corner, 3 * half), x.name, x.colour, **x.look)
    middle = (corner - origin) @ view.T * 1e3
    names = ("x [mm]", "y [mm]") if path.dimension == 2 else ("along [mm]", "across [mm]")
    ends = [middle - half * 1e3, middle + half * 1e3]
    figure.update_xaxes(title=names[0], range=[float(x[0]) for x in ends], **place)
    figure.update_yaxes(
        title=names[1] if column == 1 else None,
        range=[float(x[1]) for x in ends],
        scaleanchor="x" if column == 1 else f"x{column}",
        **place,
    )


def _view(path: Path, vertex: int) -> FloatArray:
    """Directions of the two axes of an enlarged corner, (2, dimension).

    In space these are the tangent before the corner, and the normal towards the tangent after it.
    """
    if path.dimension == 2:
        return IN_PLANE
    before, after = path(path.breaks[vertex], 1, side="left"), path.tangents[vertex]
    across = after - (after @ before) * before
    return np.stack([before, across / np.linalg.norm(across)])


def _between(path: Path, start: float, end: float, margin: float) -> FloatArray:
    """Points of a path from a margin before `start` to a margin after `end`, with its vertices."""
    low, high = max(start - margin, 0.0), min(end + margin, path.length)
    vertices = path.breaks[(path.breaks > low) & (path.breaks < high)]
    return path(np.union1d(np.linspace(low, high, PLACES), vertices))


def _near(done: Execution, tool: FloatArray, corner: FloatArray, distance: float) -> FloatArray:
    """Tool positions near a corner, interpolated between executed samples; gaps (NaN) elsewhere."""
    from scipy.interpolate import CubicHermiteSpline

    near = np.flatnonzero(np.all(np.abs(tool - corner) < distance, axis=1)[:-1])
    gap = np.full((1, len(corner)), np.nan)
    found = [gap]
    for visit in np.split(near, np.flatnonzero(np.diff(near) > 1) + 1):
        if len(visit):
            places = len(visit) * min(FINER, MOST_POINTS / len(near))
            of = slice(visit[0], visit[-1] + 2)
            t = np.linspace(done.t[of][0], done.t[of][-1], int(places) + 2)
            curve = CubicHermiteSpline(done.t[of], done.q[of], done.dq[of])
            found += [done.arm.forward(curve(t)), gap]
    return np.concatenate(found)
