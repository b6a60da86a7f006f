"""The report of an identification as one HTML page: motion and residuals."""

from __future__ import annotations

from typing import Any

import numpy as np

from armcontour.core.render import verdict
from armcontour.core.result import TABLE, Data
from armcontour.identification import BodyIdentification, Identification
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


def render_identification(found: Identification | BodyIdentification) -> str:
    """Render the report of an identification as one HTML page without other files.

    It has verdict, tables and notes of the result, then those of every joint with figures.

    Args:
        found: The identification.
    """
    data, joints = found.to_data(), [x.to_data() for x in found.joints]
    return render_page(
        "identification.html",
        data=data,
        verdict=verdict(data),
        tables=_tables(data),
        joints=[(x, _tables(x), _figures(found, j)) for j, x in enumerate(joints)],
    )


def _tables(data: Data) -> list[Table]:
    """The tables of a result."""
    return [table_of(x, x.name) for x in data.tables if x.level <= TABLE]


def _figures(found: Identification | BodyIdentification, j: int) -> list[Any]:
    """Figures of a joint: measured and predicted position, and residual."""
    joint = found.joints[j]
    if not joint.rests:
        return []
    gap, start, parts = np.full((1, 3), np.nan), 0.0, []
    for log, rest in zip(found.logs, joint.rests, strict=True):
        y = log.measured[:, j]
        parts += [np.stack([log.t - log.t[0] + start, y, rest], axis=1), gap]
        start += log.t[-1] - log.t[0] + APART
    times, measured, rests = np.concatenate(parts).T
    how, where = "simulated", ""
    if isinstance(found, Identification):
        how, where = "predicted from the other parts", " where not fitted"
    motion, residual = Figure(), Figure()
    for figure, curve, name, colour in (
        (motion, measured, "measured", EXECUTED_COLOUR),
        (motion, measured - rests, how, PLANNED_COLOUR),
        (residual, rests * 1e3, "residual", LIMIT_COLOUR),
    ):
        t, y = thin(times, curve)
        figure.add_trace(line(t, y, name, colour, width=1.5))
    for figure, unit in ((motion, "position [rad]"), (residual, "residual [mrad]")):
        figure.update_xaxes(title="t [s]")
        figure.update_yaxes(title=unit)
    return [
        finish(motion, title=f"{joint.name}: measured and predicted{where}"),
        finish(residual, title=f"{joint.name}: residuals{where}", height=320),
    ]
