"""Report of an identification as an HTML page: joints, motion and residuals."""

from __future__ import annotations

from typing import Any

import numpy as np

from armcontour.control.identification import Identification
from armcontour.core.result import TABLE, Data
from armcontour.core.text import capitalise
from armcontour.report.figure import make_subplots, render_page
from armcontour.report.section import Chapter, Front, Section, Tile, text_table, tiles
from armcontour.report.style import (
    EXECUTED_COLOUR,
    LIMIT_COLOUR,
    PLANNED_COLOUR,
    finish,
    line,
    thin,
)

# Gap between successive logs in the figures [s], and height of the plots of a joint [px].
APART, HEIGHT = 1.0, 90


def render_identification(identification: Identification) -> str:
    """Render the report of an identification as one self-contained HTML page."""
    data = identification.to_data()
    chapter = Chapter(front=_front(identification, data), sections=_sections(identification, data))
    return render_page(
        title=data.title,
        about="",
        chapters=[chapter],
        source="Everything on this page was computed from the logs.",
    )


def _front(result: Identification, data: Data) -> Front:
    """First screen: the verdict, a table of all joints, and the weakest point."""
    trusted = data["judgement.trusted"]
    words = [trusted.label if trusted.value else f"not {trusted.label}", trusted.note]
    table = next(x for x in data.tables if x.level <= TABLE)
    determined = [x.determined for x in result.joints]
    known = f"{sum(determined)} of {len(determined)}"
    return Front(
        verdict=capitalise(": ".join(filter(None, words))) + ".",
        good=bool(trusted.value),
        doubtful=not trusted.value or result.judgement.programs < 2,
        tiles=(
            *(x for x in tiles(data) if x.label != trusted.label),
            Tile(label="joints with all parameters determined", value=known),
        ),
        tables=(text_table(table, "All joints"),),
        sentences=tuple(("Weakest point", x) for x in [*data.warnings, *data.notes][:1]),
    )


def _sections(identification: Identification, data: Data) -> list[Section]:
    """Sections with the parameters and notes of the joints, and with the motion and residuals."""
    tables = [x for x in data.tables if x.level <= TABLE][1:]
    of_joints = (
        f"{x.title}: {y}"
        for x in (joint.to_data() for joint in identification.joints)
        for y in x.notes
        if y not in data.notes
    )
    sections = [
        Section(
            key="parameters",
            title="Parameters",
            summary="values with their 95 % intervals, and which are determined",
            parts=tuple(text_table(x, capitalise(x.name)) for x in tables),
            notes=(*data.notes, *of_joints),
        )
    ]
    if any(x.rests for x in identification.joints):
        sections.append(
            Section(
                key="motion",
                title="Motion and residuals",
                summary="measured and predicted positions of all joints, and residuals",
                parts=(_figure(identification),),
            )
        )
    return sections


def _figure(identification: Identification) -> Any:
    """Figure with measured and predicted position, and residual, of each joint with a model."""
    joints = [(j, x) for j, x in enumerate(identification.joints) if x.rests]
    source = "predicted from the other parts, where not fitted"
    drawn = make_subplots(
        rows=len(joints),
        cols=2,
        column_titles=["position [rad]", "residual [mrad]"],
        vertical_spacing=0.15 / len(joints),
    )
    for row, (j, joint) in enumerate(joints, start=1):
        gap, start, parts = np.full((1, 3), np.nan), 0.0, []
        for log, residual in zip(identification.logs, joint.rests, strict=True):
            y = log.measured[:, j]
            parts += [np.stack([log.t - log.t[0] + start, y, residual], axis=1), gap]
            start += log.t[-1] - log.t[0] + APART
        times, measured, residuals = np.concatenate(parts).T
        for column, curve, name, colour in (
            (1, measured, "measured", EXECUTED_COLOUR),
            (1, measured - residuals, source, PLANNED_COLOUR),
            (2, residuals * 1e3, "residual", LIMIT_COLOUR),
        ):
            t, y = thin(times, curve)
            look = {"legendgroup": name, "showlegend": row == 1, "width": 1.2}
            drawn.add_trace(line(t, y, name, colour, **look), row, column)
        drawn.update_yaxes(row, 1, title={"text": joint.name, "font": {"size": 11}})
    for column in (1, 2):
        drawn.update_xaxes(len(joints), column, title="time [s]")
    drawn.update_yaxes(nticks=4)
    return finish(drawn, title="All joints", height=HEIGHT * len(joints) + 150)
