"""The report of an identification as one HTML page: joints, motion and residuals."""

from __future__ import annotations

from typing import Any

import numpy as np

from armcontour.control.identification import BodyIdentification, Identification
from armcontour.core.render import figure
from armcontour.core.result import TABLE, VERDICT, Data
from armcontour.core.text import capitalise
from armcontour.report.figure import make_subplots, render_page
from armcontour.report.section import Chapter, Front, Section, Table, Tile, table_of, tiles
from armcontour.report.style import (
    EXECUTED_COLOUR,
    LIMIT_COLOUR,
    PLANNED_COLOUR,
    finish,
    line,
    thin,
)

# Time between logs in the figures [s], and height of the plots of a joint [px].
APART, HEIGHT = 1.0, 90


def render_identification(found: Identification | BodyIdentification) -> str:
    """Render the report of an identification as one HTML page without other files.

    The first screen has the verdict and a table of all joints.

    Args:
        found: The identification.
    """
    data = found.to_data()
    chapter = Chapter(front=_front(found, data), sections=_sections(found, data))
    return render_page(
        title=data.title,
        about="",
        chapters=[chapter],
        source="Everything on this page was computed from the logs.",
    )


def _front(found: Identification | BodyIdentification, data: Data) -> Front:
    """The verdict, and all joints with what to record next."""
    first, *rows = data.shown(VERDICT)
    notes = [*data.warnings, *data.notes]
    shown = table_of(next(x for x in data.tables if x.level <= TABLE), "All joints")
    known = [bool(x.estimates) and all(y.determined for y in x.estimates) for x in found.joints]
    if len(shown.rows) == len(known):
        more = [("yes" if x else "no", _next(y)) for x, y in zip(known, found.joints, strict=True)]
        shown = Table(
            header=(*shown.header, "determined", "record next"),
            rows=tuple((*x, *y) for x, y in zip(shown.rows, more, strict=True)),
            caption=shown.caption,
        )
    joints = Tile(
        label="joints with all parameters determined",
        value=f"{sum(known)} of {len(known)}",
    )
    words = [first.label if first.value else f"not {first.label}", first.note]
    said = [f"{x.label} {figure(x)}" + f" ({x.note})" * bool(x.note) for x in rows]
    return Front(
        verdict=capitalise("; ".join([": ".join(filter(None, words)), *said])) + ".",
        good=bool(first.value),
        tiles=(*tiles(rows[:2]), joints),
        tables=(shown,),
        sentences=tuple(("Weakest point", x) for x in notes[:1]),
    )


def _next(joint: Any) -> str:
    """What is not determined of a joint, or what its note asks for."""
    note = getattr(joint, "note", "")
    if ": record" in note:
        return str(note.rsplit(": ", 1)[1])
    unknown = [x.label for x in joint.estimates if not x.determined]
    words = "more motion at other velocities and accelerations, to determine"
    return f"{words} {', '.join(unknown)}" if unknown else "-"


def _sections(found: Identification | BodyIdentification, data: Data) -> list[Section]:
    """Figures of all joints, their parameters and notes."""
    tables = [x for x in data.tables if x.level <= TABLE][1:]
    of_joints = (
        f"{x.title}: {y}"
        for x in (joint.to_data() for joint in found.joints)
        for y in x.notes
        if y not in data.notes
    )
    sections = [
        Section(
            key="parameters",
            title="Parameters",
            summary="values with their 95 % intervals, and which are determined",
            parts=tuple(table_of(x, capitalise(x.name)) for x in tables),
            notes=(*data.notes, *of_joints),
        )
    ]
    if any(x.rests for x in found.joints):
        sections.append(
            Section(
                key="motion",
                title="Motion and residuals",
                summary="measured and predicted positions of all joints, and what remains",
                parts=(_figure(found),),
            )
        )
    return sections


def _figure(found: Identification | BodyIdentification) -> Any:
    """Measured and predicted position, and residual, of all joints with a model."""
    joints = [(j, x) for j, x in enumerate(found.joints) if x.rests]
    how = "simulated"
    if isinstance(found, Identification):
        how = "predicted from the other parts, where not fitted"
    drawn = make_subplots(
        rows=len(joints),
        cols=2,
        shared_xaxes=True,
        column_titles=["position [rad]", "residual [mrad]"],
        vertical_spacing=0.15 / len(joints),
    )
    for row, (j, joint) in enumerate(joints, start=1):
        gap, start, parts = np.full((1, 3), np.nan), 0.0, []
        for log, rest in zip(found.logs, joint.rests, strict=True):
            y = log.measured[:, j]
            parts += [np.stack([log.t - log.t[0] + start, y, rest], axis=1), gap]
            start += log.t[-1] - log.t[0] + APART
        times, measured, rests = np.concatenate(parts).T
        for column, curve, name, colour in (
            (1, measured, "measured", EXECUTED_COLOUR),
            (1, measured - rests, how, PLANNED_COLOUR),
            (2, rests * 1e3, "residual", LIMIT_COLOUR),
        ):
            t, y = thin(times, curve)
            look = {"legendgroup": name, "showlegend": row == 1, "width": 1.2}
            drawn.add_trace(line(t, y, name, colour, **look), row, column)
        drawn.update_yaxes(row, 1, title={"text": joint.name, "font": {"size": 11}})
    for column in (1, 2):
        drawn.update_xaxes(len(joints), column, title="time [s]")
    drawn.update_yaxes(nticks=4)
    return finish(drawn, title="All joints", height=HEIGHT * len(joints) + 150)
