"""Section on a drawing before any arm: its contours by layer, their order, and their sizes."""

from __future__ import annotations

from html import escape
from typing import Any

import numpy as np

from armcontour.program import Program
from armcontour.program.survey import ContourFacts, extent_of, survey
from armcontour.report.figure import Figure
from armcontour.report.outline import outlines
from armcontour.report.section import Section, Table, Tile
from armcontour.report.sections.program_picture import (
    MOST_MARKERS,
    arrows_in_plane,
    arrows_in_space,
    coordinates_of,
    draw_in_plane,
    draw_in_space,
    lay_out,
    number_contours,
    split_layers,
)
from armcontour.report.style import PATH_COLOUR

# Largest number of rows in the table.
MOST_ROWS = 200
HEADER = (
    "contour",
    "layer",
    "length [mm]",
    "size [mm]",
    "direction",
    "inside of",
    "corners",
    "lines",
    "arcs",
)


def drawing(program: Program) -> Section:
    """The section on a drawing: tiles, the picture, and a table of contours."""
    facts = survey(program)
    size = extent_of(facts)
    notes = list(program.notes)
    if len(facts) > MOST_ROWS:
        notes.append(f"The table has the first {MOST_ROWS} of {len(facts)} contours.")
    layers = {x.layer for x in facts}
    tiles = (
        Tile(
            label="contours",
            value=str(len(facts)),
            note=f"{sum(x.closed for x in facts)} closed, {len(layers)} "
            f"layer{'s' if len(layers) > 1 else ''}",
        ),
        Tile(label="length", value=f"{program.length:.4g} m"),
        Tile(label="size", value=f"{format_size(size)} mm", note=f"from {format_corner(size)} mm"),
    )
    table = Table(header=HEADER, rows=tuple(row_of(x) for x in facts[:MOST_ROWS]))
    return Section(
        key="drawing",
        title="Drawing",
        text="Contours as they are read, in their order and direction, before any arm; ccw is "
        "counter-clockwise, cw is clockwise.",
        tiles=(("", tiles),),
        figures=(_picture(program, facts),),
        tables=(table,),
        notes=tuple(notes),
    )


def row_of(x: ContourFacts) -> tuple[str, ...]:
    """Cells of a contour, in the order of `HEADER`."""
    turn = "ccw" if x.area > 0 else "cw"
    return (
        f"{x.number}: {x.name}" if x.name else str(x.number),
        x.layer,
        f"{x.length * 1e3:.2f}",
        format_size(x.extent),
        f"closed, {turn}" if x.closed else "open",
        "" if x.inside is None else str(x.inside),
        str(x.corners),
        str(x.lines),
        str(x.arcs),
    )


def format_size(extent: Any) -> str:
    """The sides of a box in mm, such as "120.00 x 80.00"; a side of zero in z is left out."""
    sides = (extent[1] - extent[0]) * 1e3
    shown = sides[:2] if len(sides) == 3 and sides[2] < 5e-3 else sides
    return " x ".join(f"{x:.2f}" for x in shown)


def format_corner(extent: Any) -> str:
    """The lower corner of a box in mm."""
    return ", ".join(f"{x:z.2f}" for x in extent[0] * 1e3)


def _picture(program: Program, facts: tuple[ContourFacts, ...]) -> Any:
    """The contours by layer, with arrows and numbers at their starts and lines between them."""
    figure, flat = Figure(), program.dimension == 2
    draw = draw_in_plane if flat else draw_in_space
    contours = program.contours
    if len(contours) > 1:
        ways = [
            np.stack([a.path(a.path.length), b.path(0.0)])
            for a, b in zip(contours[:-1], contours[1:], strict=True)
        ]
        look: dict[str, Any] = {"width": 1, "dash": "dot"} if flat else {"width": 1}
        figure.add_trace(draw(outlines(ways), "order", PATH_COLOUR, **look))
    for name, colour, points in split_layers(program):
        figure.add_trace(draw(points, name, colour, width=2.2 if flat else 5))
    everywhere = np.concatenate([coordinates_of(x, program.dimension) for x in figure.data])
    every = -(-len(contours) // MOST_MARKERS)
    starts = [
        (x.path(0.0), x.path(0.0, 1), "<br>".join(map(escape, row_of(of)[:5])))
        for x, of in list(zip(contours, facts, strict=True))[::every]
    ]
    for trace in (arrows_in_plane if flat else arrows_in_space)(starts, everywhere):
        figure.add_trace(trace)
    for trace in number_contours(program):
        figure.add_trace(trace)
    lay_out(figure, everywhere, flat=flat, title="The drawing {}, as read")
    return figure
