"""Report of a placement: heat map of the durations, and reasons of refusals."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from armcontour.core.render import digits_and_unit, number, scale
from armcontour.report.figure import render
from armcontour.report.plan_drawing import Drawing, SymbolEntry
from armcontour.report.section import Front, tiles
from armcontour.report.sheet import WIDTH

if TYPE_CHECKING:
    from armcontour.studies.placement import Place, Placement

# Colour of refused places.
REFUSED = "#9a9a9a"
# Ends of the colour map cividis (red, green, blue): colours of the shortest and longest motion.
DARK = np.array([0, 34, 78])
BRIGHT = np.array([254, 232, 56])
# Width of the labels left of the map [px].
LEFT = 72.0
# Maximum size of a place [px].
LARGEST = 84.0
# Minimum distance of texts in a row [px].
LEAST_TEXT = 40.0
# Minimum distance of texts in a column [px].
LEAST_ROW = 18.0


def placed(result: Placement) -> Front:
    """Make the first screen: the best place and the map."""
    best = result.best
    data = result.to_data()
    examples = {x.refusal: x.why_not for x in reversed(result.places) if x.refusal}
    refused = [
        (f"{k}: refused by {x} ({n})", examples[x])
        for k, (x, n) in enumerate(result.refusals.items(), start=1)
    ]
    return Front(
        verdict="No place is feasible" if best is None else f"Best {result.moved} place: {best}",
        good=None if best else False,
        tiles=tiles(data),
        parts=(draw_map(result),),
        sentences=(*refused, *(("Weakest point", x) for x in data.notes)),
    )


def draw_map(result: Placement) -> Drawing:
    """Draw a map of the shortest durations over the first two axes that vary.

    Refused places have the number of the refusal.
    """
    axes = sorted(result.axes, key=lambda x: len(result.axes[x]) == 1)[:2]
    best: dict[tuple[float, ...], Place] = {}
    for place in result.places:
        key = tuple(place.values[x] for x in axes)
        if key not in best or (place.duration or np.inf) < (best[key].duration or np.inf):
            best[key] = place
    times = [x.duration for x in best.values() if x.duration is not None]
    low, high = min(times, default=0.0), max(times, default=0.0)
    numbers = {x: k for k, x in enumerate(result.refusals, start=1)}
    columns = _values_of_axis(best, 0)
    rows = _values_of_axis(best, 1)
    size = min(LARGEST, (WIDTH - LEFT) / len(columns))
    cells = []
    for key, place in best.items():
        if place.duration is None:
            colour = REFUSED
            text = str(numbers[place.refusal])
            ink = "#000"
        else:
            share = (place.duration - low) / ((high - low) or 1.0)
            colour = _heat(share)
            text = digits_and_unit(place.duration, "s")[0] * (size > LEAST_TEXT)
            ink = "#000" if share > 0.5 else "#fff"
        words = f"{place}: {place.why_not or number(place.duration, 's')}"
        row = rows.index(key[1]) if axes[1:] else 0
        cells.append((columns.index(key[0]), row, colour, ink, text, words))
    labelled = []
    for name, values, least in zip(axes, (columns, rows), (LEAST_TEXT, LEAST_ROW), strict=False):
        unit, factor = scale("rad" if name == "yaw" else "m")
        # As many values are written as have room.
        shown = range(0, len(values), int(np.ceil(least / size)))
        ticks = [((i + 0.5) * size, f"{values[i] / factor:.4g}") for i in shown]
        labelled.append((f"{name} [{unit}]", ticks))
    keys = list[SymbolEntry]()
    if times:
        keys.append(SymbolEntry(_swatch(_heat(0.0)), f"shortest motion {number(low, 's')}"))
    if high > low:
        keys.append(SymbolEntry(_swatch(_heat(1.0)), f"longest {number(high, 's')}"))
    if numbers:
        keys.append(SymbolEntry(_swatch(REFUSED), "refused, with the number of the reason"))
    label = f"Shortest motion at {len(best)} places, {len(best) - len(times)} refused"
    return Drawing(
        title="Shortest motion at each place [s]",
        svg=render(
            "map.svg",
            left=LEFT,
            size=size,
            counts=(len(columns), len(rows)),
            cells=cells,
            axes=labelled,
            label=label,
        ),
        keys=tuple(keys),
    )


def _values_of_axis(places: Iterable[tuple[float, ...]], axis: int) -> list[float]:
    """Return the different values of places on an axis, sorted; 0 if places lack the axis."""
    return sorted({x[axis] if axis < len(x) else 0.0 for x in places})


def _heat(share: float) -> str:
    """Return the map's colour between the shortest (0) and the longest motion (1)."""
    parts = (DARK + share * (BRIGHT - DARK)).round().astype(int).tolist()
    return f"rgb({','.join(map(str, parts))})"


def _swatch(colour: str) -> str:
    return f'<i class="swatch" style="--colour:{colour}"></i>'
