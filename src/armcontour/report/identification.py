"""The report of an identification as one HTML page: motion and residuals."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from armcontour.core.render import verdict
from armcontour.core.result import TABLE, Data
from armcontour.identification import Identification, RobotIdentification
from armcontour.report.figure import Figure, render_page
from armcontour.report.section import Table, table_of
from armcontour.report.style import (
    EXECUTED_COLOUR,
    LIMIT_COLOUR,
    PLANNED_COLOUR,
    finish,
    line,
    thin,
)

# Time between logs in the figures [s].
APART = 1.0


def render_identification(found: Identification) -> str:
    """Render the report of an identification as one HTML page without other files."""
    return _render(found, _figures)


def render_robot(found: RobotIdentification) -> str:
    """Render the report of the identification of a robot as one HTML page."""
    return _render(found, _robot_figures)


def _render(found: Any, figures: Callable[[Any, int], list[Any]]) -> str:
    """Render verdict, tables and notes of a result, then those of every joint with figures."""
    data, joints = found.to_data(), [x.to_data() for x in found.joints]
    return render_page(
        "identification.html",
        data=data,
        verdict=verdict(data),
        tables=_tables(data),
        joints=[(x, _tables(x), figures(found, j)) for j, x in enumerate(joints)],
    )


def _tables(data: Data) -> list[Table]:
    """The tables of a result."""
    return [table_of(x, x.name) for x in data.tables if x.level <= TABLE]


def _robot_figures(found: RobotIdentification, j: int) -> list[Any]:
    """The figures of one joint: lag and residuals of every log."""
    figures, name = [], found.joints[j].name
    for x in found.fitted:
        figure = Figure()
        command = np.interp(x.t, x.log.t, x.log.command[:, j])
        for values, what, colour in (
            (command - x.measured[:, j], "command less measured", EXECUTED_COLOUR),
            (command - x.simulated[:, j], "command less simulated", PLANNED_COLOUR),
            (x.residuals[:, j], "measured less simulated", LIMIT_COLOUR),
        ):
            t, y = thin(x.t, values * 1e3)
            figure.add_trace(line(t, y, what, colour, width=1))
        figure.update_xaxes(title="t [s]")
        figure.update_yaxes(title="[mrad]")
        figures.append(finish(figure, title=f"{name}, {x.log.source}: lag", height=320))
    return figures


def _figures(found: Identification, j: int) -> list[Any]:
    """Figures of a joint: measured and predicted position, and residual, where not fitted."""
    joint = found.joints[j]
    if not joint.rests:
        return []
    gap, start, parts = np.full((1, 3), np.nan), 0.0, []
    for log, rest in zip(found.logs, joint.rests, strict=True):
        y = log.measured[:, j]
        parts += [np.stack([log.t - log.t[0] + start, y, rest], axis=1), gap]
        start += log.t[-1] - log.t[0] + APART
    times, measured, rests = np.concatenate(parts).T
    motion, residual = Figure(), Figure()
    for figure, curve, name, colour in (
        (motion, measured, "measured", EXECUTED_COLOUR),
        (motion, measured - rests, "predicted from the other parts", PLANNED_COLOUR),
        (residual, rests * 1e3, "residual", LIMIT_COLOUR),
    ):
        t, y = thin(times, curve)
        figure.add_trace(line(t, y, name, colour, width=1.5))
    for figure, unit in ((motion, "position [rad]"), (residual, "residual [mrad]")):
        figure.update_xaxes(title="t [s]")
        figure.update_yaxes(title=unit)
    return [
        finish(motion, title=f"{joint.name}: measured and predicted where not fitted"),
        finish(residual, title=f"{joint.name}: residuals where not fitted", height=320),
    ]
