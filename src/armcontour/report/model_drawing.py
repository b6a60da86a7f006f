"""Drawing of a CAD model: its edges, the contours that were selected, and the tool along them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.text import count_noun
from armcontour.program import Program, contour_called
from armcontour.report.figure import render
from armcontour.report.plan_drawing import Drawing, SymbolEntry
from armcontour.report.sheet import OBLIQUE, Line, Mark, Sheet
from armcontour.report.tool_axes import WORDS, axis_arrows
from armcontour.report.view import drawn_curve

# Largest number of edges whose numbers are drawn.
MOST_NUMBERED = 80


def draw_model(
    title: str,
    edges: Sequence[FloatArray],
    numbers: Sequence[int],
    program: Program | None,
) -> Drawing:
    """Draw a model obliquely.

    Args:
        title: Title of the drawing.
        edges: Points along the edges of the model [m], (n, 3) each.
        numbers: Numbers of the edges.
        program: Selected contours; None draws the numbers of edges instead.
    """
    contours = () if program is None else program.contours
    curves = [drawn_curve(x.path) for x in contours]
    sheet = Sheet.of(np.concatenate([*edges, *curves]), OBLIQUE)
    lines = [sheet.line(edges, 'class="model"')]
    keys = []
    if curves:
        lines.append(sheet.line(curves, 'class="contour"'))
        keys.append(SymbolEntry("━", count_noun(len(curves), "contour")))
    arrows = axis_arrows((x.path for x in contours), sheet)
    if arrows:
        lines.append(Line('class="tool-axis"', arrows, WORDS))
        keys.append(SymbolEntry("→", WORDS))
    marks = []
    for k, x in enumerate(contours):
        called = contour_called(x, k)
        marks.append(("start", Mark(x.path(0.0), called, x.path(0.0, 1))))
    if marks:
        keys.append(SymbolEntry("▶", "start of a contour"))
    written: list[tuple[int, FloatArray]] = []
    if not contours and len(edges) <= MOST_NUMBERED:
        middles = [points[len(points) // 2] for points in edges]
        written = [(n, sheet.place(x)) for n, x in zip(numbers, middles, strict=True)]
    label = f"{title}: {count_noun(len(edges), 'edge')}"
    svg = render(
        "drawing.svg",
        id="model",
        label=label,
        insets=(),
        sheet=sheet,
        lines=lines,
        marks=marks,
        numbers=written,
    )
    return Drawing(title=title, svg=svg, keys=tuple(keys))
