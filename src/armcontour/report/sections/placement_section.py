"""Report of a placement: heat map of the durations, and reasons of refusals."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

import numpy as np

from armcontour.core.render import number
from armcontour.report.plan_drawing import Drawing
from armcontour.report.section import Front, tiles

if TYPE_CHECKING:
    from armcontour.studies.placement import Place, Placement

# Colours of viridis from the best to the worst duration, whose order is visible without hues; and
# colour of refused places.
SCALE, REFUSED = ("#fde725", "#5ec962", "#21918c", "#3b528b", "#440154"), "#9a9a9a"
# Width of the map, largest side of a cell, and margin [px].
WIDTH, MAX_CELL, MARGIN = 800, 60, 4


def placed(result: Placement) -> Front:
    """First screen: the best place and the map."""
    best, data = result.best, result.to_data()
    found = "No place is feasible" if best is None else f"Best place of the {result.moved}: {best}"
    examples = {x.refusal: x.why_not for x in reversed(result.places) if x.refusal}
    refused = [(f"Refused by {x} ({n})", examples[x]) for x, n in result.refusals.items()]
    return Front(
        verdict=found,
        good=None if best else False,
        tiles=tiles(data),
        drawing=draw_map(result),
        sentences=(*refused, *(("Weakest point", x) for x in data.notes)),
    )


def draw_map(result: Placement) -> Drawing:
    """Draw the best duration for each value of the first two axes that vary."""
    names = sorted(result.axes, key=lambda x: len(result.axes[x]) == 1)[:2]
    columns, *more = (result.axes[x].tolist() for x in names)
    rows = more[0] if more else [0.0]
    cells: dict[tuple[float, ...], Place] = {}
    for place in result.places:
        key = tuple(place.values[x] for x in names)
        if key not in cells or (place.duration or np.inf) < (cells[key].duration or np.inf):
            cells[key] = place
    numbers = {x: str(k + 1) for k, x in enumerate(result.refusals)}
    durations = [x.duration for x in result.places if x.duration is not None]
    low, high = (min(durations), max(durations)) if durations else (0.0, 0.0)
    size, best, parts = min(MAX_CELL, (WIDTH - 2 * MARGIN) / len(columns)), result.best, []
    for i, a in enumerate(columns):
        for j, b in enumerate(reversed(rows)):
            place = cells[(a, b)[: len(names)]]
            x, y = MARGIN + i * size, MARGIN + j * size
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
                at = f'x="{x + size / 2 - 2:.1f}" y="{y + size / 2 + 3:.1f}"'
                parts.append(f'<text {at} class="number axis">{numbers[place.refusal]}</text>')
    height = size * len(rows) + 2 * MARGIN
    marks = [(numbers[x], f"refused by {x} ({n})") for x, n in result.refusals.items()]
    marks += [("■", f"yellow {number(low, 's')} to dark {number(high, 's')}")] * bool(durations)
    for arrow, name in zip("→↑", names, strict=False):
        ends = (number(x, "rad" if name == "yaw" else "m") for x in result.axes[name][[0, -1]])
        marks.append((arrow, f"{name} from {' to '.join(ends)}"))
    return Drawing(
        svg=(
            f'<svg class="drawing" role="img" viewBox="0 0 {WIDTH} {height:.0f}" '
            f'aria-label="Durations over {" and ".join(names)}">{"".join(parts)}</svg>'
        ),
        legend=(),
        marks=tuple(marks),
    )
