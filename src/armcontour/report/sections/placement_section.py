"""Report of a placement: heat map of the durations, and reasons of refusals."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.render import PALETTE, digits_and_unit, number, scale
from armcontour.core.text import list_some
from armcontour.report.figure import render
from armcontour.report.moving_arm import draw_arm
from armcontour.report.plan_drawing import Drawing, SymbolEntry, draw_plan
from armcontour.report.section import Front, tiles
from armcontour.report.sheet import WIDTH

if TYPE_CHECKING:
    from armcontour.jobs import RunResult
    from armcontour.studies.placement import Place, Placement

# Colour of refused places.
REFUSED = "#9a9a9a"
# Colour map cividis (red, green, blue) from the longest to the shortest motion.
COLOURS = np.array(PALETTE["cividis"])
# Brightness of the colour map above which texts are black, from 0 to 1.
BRIGHT = 0.5
# Name of the axis of rotations, whose range can be a whole turn.
YAW = "yaw"
# Difference up to which a range of angles counts as a whole turn [rad].
SAME_ANGLE = 1e-6
# Width of the labels left of the map [px].
LEFT = 72.0
# Maximum size of a place [px].
LARGEST = 84.0
# Minimum distance of texts in a row [px].
LEAST_TEXT = 40.0
# Minimum distance of texts in a column [px].
LEAST_ROW = 18.0
AT_EDGE = "A larger grid may contain a better place: the best one is the outermost along"


def placed(result: Placement, plan: RunResult | None = None) -> Front:
    """Make the first screen: the best place, the map, and the plan at the best place, if known."""
    best = result.best
    data = result.to_data()
    examples = {x.refusal: x.why_not for x in reversed(result.places) if x.refusal}
    refused = [
        (f"{k}: refused by {x} ({n})", examples[x])
        for k, (x, n) in enumerate(result.refusals.items(), start=1)
    ]
    if best is None:
        verdict = "No place is feasible."
    else:
        verdict = f"Best place of the {result.moved}: {best}."
        if edges := edges_of(result):
            verdict = f"{verdict[:-1]}, at the edge of the grid ({list_some(edges, len(edges))})."
            refused.insert(0, ("Edge of the grid", f"{AT_EDGE} {list_some(edges, len(edges))}."))
    weak = [("Weakest point", x) for x in data.notes]
    drawn = None if plan is None else draw_plan(plan, result.placed())
    return Front(
        verdict=verdict,
        good=None if best else False,
        tiles=tiles(data),
        drawing=draw_map(result),
        arm=None if plan is None else draw_arm(plan, result.placed()),
        parts=() if drawn is None else (drawn,),
        sentences=(*refused, *weak),
    )


def edges_of(result: Placement) -> list[str]:
    """Return the axes on which the best place is the first or last of several values."""
    best = result.best
    edges = []
    for name, values in result.axes.items():
        if best is None or len(values) < 2 or (name == YAW and _is_whole_turn(values)):
            continue
        if best.values[name] in (values.min(), values.max()):
            edges.append(name)
    return edges


def _is_whole_turn(values: FloatArray) -> bool:
    """Return whether angles are evenly spaced on a whole turn, so that they have no edge [rad]."""
    steps = np.diff(np.sort(values), append=values.min() + 2 * np.pi)
    return bool(np.ptp(steps) < SAME_ANGLE)


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
    framed: tuple[int, int] | None = None
    for key, place in best.items():
        if place.duration is None:
            colour = REFUSED
            text = str(numbers[place.refusal])
            ink = "#000"
        else:
            share = (high - place.duration) / (high - low) if high > low else 1.0
            colour = _heat(share)
            text = digits_and_unit(place.duration, "s")[0] * (size > LEAST_TEXT)
            ink = "#000" if share > BRIGHT else "#fff"
        words = f"{place}: {place.why_not or number(place.duration, 's')}"
        row = rows.index(key[1]) if axes[1:] else 0
        column = columns.index(key[0])
        if place is result.best:
            framed = (column, row)
        cells.append((column, row, colour, ink, text, words))
    labelled = []
    for name, values, least in zip(axes, (columns, rows), (LEAST_TEXT, LEAST_ROW), strict=False):
        unit, factor = scale("rad" if name == "yaw" else "m")
        # As many values are written as have room.
        shown = range(0, len(values), int(np.ceil(least / size)))
        ticks = [((i + 0.5) * size, f"{values[i] / factor:.4g}") for i in shown]
        labelled.append((f"{name} [{unit}]", ticks))
    keys = list[SymbolEntry]()
    if times:
        words = f"best place, framed: {number(low, 's')}"
        keys.append(SymbolEntry(_swatch(_heat(1.0)), words))
    if high > low:
        keys.append(SymbolEntry(_swatch(_heat(0.0)), f"longest motion {number(high, 's')}"))
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
            framed=framed,
            axes=labelled,
            label=label,
        ),
        keys=tuple(keys),
    )


def _values_of_axis(places: Iterable[tuple[float, ...]], axis: int) -> list[float]:
    """Return the different values of places on an axis, sorted; 0 if places lack the axis."""
    return sorted({x[axis] if axis < len(x) else 0.0 for x in places})


def _heat(share: float) -> str:
    """Return the map's colour between the longest (0) and the shortest motion (1)."""
    at = share * (len(COLOURS) - 1)
    parts = [round(float(np.interp(at, range(len(COLOURS)), x))) for x in COLOURS.T]
    return f"rgb({','.join(map(str, parts))})"


def _swatch(colour: str) -> str:
    return f'<i class="swatch" style="--colour:{colour}"></i>'
