"""The section on a certificate: what holds, for which model, and what it costs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from armcontour.core import result as core
from armcontour.report.figure import Figure, make_trace
from armcontour.report.section import Section, Table, side_by_side, table_of, tiles
from armcontour.report.sections.program import MOST_ROWS
from armcontour.report.style import (
    EXECUTED_COLOUR,
    LIMIT_COLOUR,
    PATH_COLOUR,
    PLANNED_COLOUR,
    RUN_COLOURS,
    finish,
    line,
    thin,
)

if TYPE_CHECKING:
    from armcontour.certification import Certificate


def certificate(found: Certificate) -> Section:
    """The certificate, what it costs, and its derating."""
    data = found.to_data()
    return Section(
        key="certificate",
        title="Certificate",
        text=f"{TEXT} {found.model}." + (OF_PROGRAMS if _several(found) else ""),
        tiles=((found.run.name, tiles(data)),),
        tables=(
            side_by_side({found.run.name: data}),
            *([_contours(found)] if _several(found) else []),
            side_by_side(found.comparison),
        ),
        figures=(
            *([_errors_figure(found)] if _several(found) else []),
            _parts(found),
            _derating(found),
            _error(found),
        ),
        notes=(*data.notes, *data.warnings),
    )


def _contours(found: Certificate) -> Table:
    """The contours in order; of many those with the least left."""
    contours, caption = found.contours, "Contours in order"
    if len(contours) > MOST_ROWS:
        caption = (
            f"The {MOST_ROWS} of {len(contours)} contours with the least left; all are in "
            "summary.json"
        )
        contours = tuple(sorted(contours, key=lambda x: x.budget.left)[:MOST_ROWS])
    return table_of(core.Table.of("contours", [x.to_data() for x in contours]), caption)


# Smallest range of the axis of derated limits [%].
LEAST_RANGE = 1.0
TEXT = (
    "The fastest plan found whose execution keeps the tolerance. It does not cover collisions, "
    "flexibility, or any model but this one:"
)
OF_PROGRAMS = (
    " Every contour is certified while the process is on, in the execution of the whole program; "
    "rapids only keep the limits of the joints."
)


def _several(found: Certificate) -> bool:
    """Whether the program has several contours."""
    return len(found.contours) > 1


def _errors_figure(found: Certificate) -> Any:
    """Figure of the largest error of every contour, and the allowed error."""
    contours = found.contours
    number = np.arange(1, len(contours) + 1)
    figure = Figure(
        make_trace(
            "bar",
            x=number,
            y=[x.budget.executed * 1e3 for x in contours],
            name="certified",
            marker={"color": EXECUTED_COLOUR},
            customdata=[x.name for x in contours],
            hovertemplate="%{customdata}: %{y:.5g} mm<extra></extra>",
        )
    )
    ends = [0.5, len(contours) + 0.5]
    allowed = found.budget.servo_allowed * 1e3
    figure.add_trace(line(ends, [allowed] * 2, "allowed", LIMIT_COLOUR, dash="dash", width=1.5))
    figure.update_xaxes(title="contour")
    if len(contours) <= MOST_ROWS:
        names = [x.name.removeprefix("contour ") for x in contours]
        figure.update_xaxes(tickvals=number, ticktext=names)
    figure.update_yaxes(type="log", title="largest contour error [mm]")
    return finish(figure, title="Errors of contours and allowed error", height=360)


# Figures of a budget that are drawn.
PARTS = ("rounding", "servo", "sampling", "box", "unexplained", "left")


def _parts(found: Certificate) -> Any:
    """Figure of the parts of the error, with a logarithmic axis, because they differ widely."""
    budget = found.budget.to_data()
    parts = {x.label: abs(x.value) for x in map(budget.__getitem__, PARTS)}
    shown = {name: value * 1e3 for name, value in parts.items() if name and value > 0}
    colours = [RUN_COLOURS[k % len(RUN_COLOURS)] for k in range(len(shown))]
    figure = Figure(
        make_trace(
            "bar",
            x=list(shown),
            y=list(shown.values()),
            marker={"color": colours},
            hovertemplate="%{x}: %{y:.5g} mm<extra></extra>",
        )
    )
    figure.update_yaxes(type="log", title="largest part [mm]")
    return finish(figure, title="Parts of the contour error", height=360)


def _derating(found: Certificate) -> Any:
    """Figure of the usable share of every joint's acceleration limit along all contours."""
    figure = Figure()
    starts = np.cumsum([0.0, *(x.path.length for x in found.contours)])
    deratings = [x.derating for x in found.contours]
    # A gap after every contour.
    places = [
        np.append(start + (x.cells[:-1] + x.cells[1:]) / 2, start + x.cells[-1])
        for start, x in zip(starts[:-1], deratings, strict=True)
    ]
    for j, name in enumerate(found.job.arm.joint_names):
        shares = [np.append(x.share[:, j], np.nan) for x in deratings]
        s, left = thin(np.concatenate(places), np.concatenate(shares))
        figure.add_trace(line(s, left * 100, name, RUN_COLOURS[j % len(RUN_COLOURS)], width=1.5))
    figure.update_xaxes(
        title="arc length of the contours [m]" if _several(found) else "arc length [m]"
    )
    figure.update_yaxes(title="usable acceleration limit [%]")
    least = 100 * min(float(x.share.min()) for x in deratings)
    if least > 100 - LEAST_RANGE:
        # Rounding errors must not fill the height of the figure.
        figure.update_yaxes(range=[100 - LEAST_RANGE, 100 + LEAST_RANGE / 10])
    return finish(figure, title="Derating of limits", height=360)


def _error(found: Certificate) -> Any:
    """Figure of the contour error over time."""
    error = found.evaluation.contour_error
    t, values = thin(error.t, error.values)
    figure = Figure(line(t, values * 1e3, "nominal robot", EXECUTED_COLOUR, width=1.2))
    allowed = found.budget.servo_allowed * 1e3
    ends = [0.0, float(t[-1])]
    if found.corners is not None:
        worst = np.full(2, found.budget.executed * 1e3)
        figure.add_trace(line(ends, worst, "worst robot of the box", PLANNED_COLOUR, width=1.5))
    figure.add_trace(line(ends, [allowed] * 2, "allowed", LIMIT_COLOUR, dash="dash", width=1))
    figure.update_xaxes(title="time [s]")
    figure.update_yaxes(title="contour error [mm]")
    figure.update_layout(plot_bgcolor="white", legend={"font": {"color": PATH_COLOUR}})
    return finish(figure, title="Contour error of the execution", height=360)
