"""Report of a placement: heat map of the durations, and a table of all places."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

import numpy as np

from armcontour.core.render import number
from armcontour.core.result import VERDICT
from armcontour.report.plan_drawing import Drawing
from armcontour.report.section import Front, Section, TextTable, tiles

if TYPE_CHECKING:
    from armcontour.studies.placement import Place, Placement

# Colours of viridis from the best to the worst duration, whose order is visible without hues; and
# colour of refused places.
SCALE, REFUSED = ("#fde725", "#5ec962", "#21918c", "#3b528b", "#440154"), "#9a9a9a"
# Width of the map, largest side of a cell, margins for labels at the left and at the top [px].
WIDTH, MAX_CELL, LEFT, TOP = 800, 60, 110, 10
# Largest number of places in the table; the CSV file has all.
MAX_ROWS = 500


def placed(result: Placement) -> Front:
    """First screen: the best place and the map."""
    best, data = result.best, result.to_data()
    found = "No place is feasible" if best is None else f"Best place of the {result.moved}: {best}"
    examples = {x.refusal: x.why_not for x in reversed(result.places) if x.refusal}
    refused = [(f"Refused by {x} ({n})", examples[x]) for x, n in result.refusals.items()]
    return Front(
        verdict=found,
        good=None if best else False,
        tiles=tiles(x for x in data.shown(VERDICT) if not isinstance(x.value, str)),
        drawing=draw_map(result),
        sentences=(*refused, *(("Weakest point", x) for x in data.notes)),
    )


def placement(result: Placement) -> Section:
    """Section with a table of the places."""
    rows = []
    for x in result.places[:MAX_ROWS]:
        values = [_value(name, y) for name, y in x.values.items()]
        rows.append((*values, number(x.duration, "s"), number(x.clearance, "m"), x.why_not))
    header = (*result.axes, "motion", "clearance", "why not")
    return Section(
        key="places",
        title="All places",
        summary="duration, clearance, and why a place is refused",
        parts=(TextTable(header=header, rows=tuple(rows)),),
        notes=("placement.csv has the other places.",) if len(result.places) > MAX_ROWS else (),
    )


def draw_map(result: Placement) -> Drawing:
    """Draw the best duration for each value of the first two axes that vary."""
    names = sorted(result.axes, key=lambda x: len(result.axes[x]) == 1)[:2]
    columns, *more = (result.axes[x].tolist() for x in names)
    rows = more[0] if more else [0.0]
    cells: dict[tuple[float, ...], Place] = {}
    for place in result.places:
        key = tuple(place.values[x] for x in names)
        if key not in cells or _duration(place) < _duration(cells[key]):
            cells[key] = place
    durations = [x.duration for x in result.places if x.duration is not None]
    low, high = (min(durations), max(durations)) if durations else (0.0, 0.0)
    size, best, parts = min(MAX_CELL, (WIDTH - LEFT) / len(columns)), result.best, []
    for i, a in enumerate(columns):
        for j, b in enumerate(reversed(rows)):
            place = cells[(a, b)[: len(names)]]
            x, y = LEFT + i * size, TOP + j * size
            colour, words = REFUSED, place.why_not
            if place.duration is not None:
                share = (place.duration - low) / (high - low) if high > low else 0.0
                colour = SCALE[round(share * (len(SCALE) - 1))]
                words = number(place.duration, "s")
            edge = "var(--ink)" if place is best else "var(--card)"
            parts.append(
                f'<rect x="{x:.1f}" y="{y:.1f}" width="{size - 3:.1f}" height="{size - 3:.1f}" '
                f'fill="{colour}" stroke="{edge}" stroke-width="3">'
                f"<title>{escape(f'{place}: {words}')}</title></rect>"
            )
            if place.refusal:
                parts.append(_text(x + size / 2 - 2, y + size / 2 + 3, place.refusal[0].upper()))
    bottom = TOP + size * len(rows)
    for k in sorted({0, len(columns) - 1}):
        words = f"{names[0]} {_value(names[0], columns[k])}"
        parts.append(_text(LEFT + (k + 0.5) * size, bottom + 16, words))
    for k in sorted({0, len(rows) - 1}) if more else ():
        words = f"{names[1]} {_value(names[1], rows[k])}"
        parts.append(_text(LEFT / 2, bottom - (k + 0.5) * size, words))
    marks = [(x[0].upper(), f"refused by {x} ({n})") for x, n in result.refusals.items()]
    if best is not None:
        marks.insert(0, ("■", f"yellow {number(low, 's')} to dark {number(high, 's')}"))
        marks.insert(1, ("□", "frame: best place"))
    return Drawing(
        svg=(
            f'<svg class="drawing" role="img" viewBox="0 0 {WIDTH} {bottom + 24:.0f}" '
            f'aria-label="Durations over {" and ".join(names)}">{"".join(parts)}</svg>'
        ),
        legend=(),
        marks=tuple(marks),
    )


def _duration(place: Place) -> float:
    """Duration for a comparison; infinite for a refused place."""
    return np.inf if place.duration is None else place.duration


def _value(axis: str, value: float) -> str:
    return number(value, "rad" if axis == "yaw" else "m")


def _text(x: float, y: float, words: str) -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" class="number axis">{words}</text>'
