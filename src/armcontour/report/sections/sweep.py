"""The section on a sweep: time of the motion against tolerance and speed."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

from armcontour.report.figure import Figure, make_trace
from armcontour.report.section import Section, Table
from armcontour.report.style import (
    EXECUTED_COLOUR,
    PATH_COLOUR,
    PLANNED_COLOUR,
    RUN_COLOURS,
    finish,
)

if TYPE_CHECKING:
    from armcontour.certification import Sweep, SweepPoint

# What the shapes of corners are called.
SHAPES = {"arc": "arcs", "free": "shaped"}


def sweep(found: Sweep) -> Section:
    """Time against corner tolerance and against assigned velocity, with certified points."""
    total = found.goal is not None and found.goal.tolerance is not None
    figures, tables = [], []
    if found.tolerances:
        name = "tolerance of the whole contour" if total else "corner tolerance"
        of = found.tolerances
        lines = {SHAPES[shape]: points for shape, points in found.shapes.items()}
        if len(lines) < 2:
            lines = {"": of}
        at = f"{name} [mm]"
        figures.append(_figure(lines, at, lambda x: 1e3 * (x.tolerance or 0.0), log=True))
        tables.append(_table(of, f"Time against {name}"))
    if found.speeds:
        lines = {"": found.speeds}
        figures.append(_figure(lines, "assigned velocity [m/s]", lambda x: x.speed or 0.0))
        tables.append(_table(found.speeds, "Time against assigned velocity"))
    return Section(
        key="sweep",
        title="Trade-off",
        text=(
            "Time of the motion for other tolerances and velocities. A filled point is certified; "
            "the line is the fastest plan within the same limits, not certified; a cross was "
            "refused. Arcs are as large as the tolerance allows, so that a larger tolerance can "
            "take longer."
            + (
                ""
                if found.iterations is None
                else f" Shapes are found in at most {found.iterations} iterations per point."
            )
        ),
        figures=tuple(figures),
        tables=tuple(tables),
        notes=tuple(
            f"{_value(x)}: {x.refusal}"
            for x in (*found.tolerances, *found.speeds)
            if x.refusal is not None
        ),
    )


def _figure(
    lines: Mapping[str, tuple[SweepPoint, ...]],
    title: str,
    at: Callable[[SweepPoint], float],
    *,
    log: bool = False,
) -> Any:
    """Figure of optimal and certified times over one parameter, of one or several lines of points.

    Args:
        lines: The points by the names of the lines; a single line needs no name.
        title: Title of the parameter, with its unit.
        at: The parameter of a point.
        log: Whether the parameter has a logarithmic axis.
    """
    figure = Figure()
    for i, (name, points) in enumerate(lines.items()):
        one = len(lines) == 1
        colour = EXECUTED_COLOUR if one else RUN_COLOURS[i % len(RUN_COLOURS)]
        faint, cross = (PATH_COLOUR, PLANNED_COLOUR) if one else (colour, colour)
        for trace in _traces(points, at, (faint, colour, cross)):
            trace.name = f"{name}, {trace.name}" if name else trace.name
            figure.add_trace(trace)
    figure.update_xaxes(title=title, type="log" if log else "linear")
    figure.update_yaxes(title="time of the motion [s]")
    return finish(figure, title=f"Time against {title.split(' [')[0]}", height=420)


def _traces(
    points: tuple[SweepPoint, ...], at: Callable[[SweepPoint], float], colours: tuple[str, str, str]
) -> Iterator[Any]:
    """The optimum, certified and refused points, in three colours; without what is empty."""
    known = [x for x in points if x.optimum is not None]
    yield make_trace(
        "scatter",
        x=[at(x) for x in known],
        y=[x.optimum for x in known],
        name="optimum, not certified",
        mode="lines",
        line={"color": colours[0], "dash": "dash", "width": 1.5},
    )
    certified = [x for x in points if x.duration is not None]
    if certified:
        yield make_trace(
            "scatter",
            x=[at(x) for x in certified],
            y=[x.duration for x in certified],
            customdata=[1e3 * (x.contour_error or 0.0) for x in certified],
            name="certified",
            mode="lines+markers",
            marker={"color": colours[1], "size": 10},
            line={"color": colours[1], "width": 1},
            hovertemplate="%{y:.4f} s<br>contour error %{customdata:.5f} mm<extra></extra>",
        )
    refused = [x for x in known if x.refusal is not None]
    if refused:
        yield make_trace(
            "scatter",
            x=[at(x) for x in refused],
            y=[x.optimum for x in refused],
            name="refused",
            mode="markers",
            marker={"color": colours[2], "size": 11, "symbol": "x"},
        )


def _table(points: tuple[SweepPoint, ...], caption: str) -> Table:
    """Table of the points of a sweep."""
    rows = tuple(
        (
            _value(x),
            "" if x.optimum is None else f"{x.optimum:.4f} s",
            _certified(x),
            "" if x.contour_error is None else f"{x.contour_error * 1e3:.5f} mm",
        )
        for x in points
    )
    return Table(
        header=("tolerance, velocity", "optimum", "certified", "contour error"),
        rows=rows,
        caption=caption,
    )


def _certified(x: SweepPoint) -> str:
    """Certified time of a point as text; empty where no certificate was asked for."""
    if x.refusal is not None:
        return "refused"
    return "" if x.duration is None else f"{x.duration:.4f} s"


def _value(x: SweepPoint) -> str:
    """Tolerance and speed of a point as text."""
    parts = [] if x.tolerance is None else [f"{x.tolerance * 1e3:.4g} mm"]
    parts += [] if x.speed is None else [f"{x.speed:.4g} m/s"]
    parts += [SHAPES["free"]] if x.shape == "free" else []
    return ", ".join(parts)
