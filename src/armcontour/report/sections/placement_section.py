"""Report of a placement: heat map of the durations, and reasons of refusals."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from armcontour.core.render import number, scale
from armcontour.report.figure import Figure, make_trace
from armcontour.report.section import Front, tiles
from armcontour.report.style import finish

if TYPE_CHECKING:
    from armcontour.studies.placement import Place, Placement

# Colour of refused places, and size of the marker of a place [px].
REFUSED, SIZE = "#9a9a9a", 26


def placed(result: Placement) -> Front:
    """First screen: the best place and the map."""
    best, data = result.best, result.to_data()
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


def draw_map(result: Placement) -> Any:
    """Map of the shortest durations over the first two axes that vary.

    Refused places have the number of the refusal.
    """
    names = list(result.axes)
    axes = sorted(names, key=lambda x: len(result.axes[x]) == 1)[:2]
    best: dict[tuple[float, ...], Place] = {}
    for place in result.places:
        key = tuple(place.values[x] for x in axes)
        if key not in best or (place.duration or np.inf) < (best[key].duration or np.inf):
            best[key] = place
    numbers = {x: str(k) for k, x in enumerate(result.refusals, start=1)}
    units = [scale("rad" if x == "yaw" else "m") for x in axes]
    figure = Figure()
    for name, refused in (("motion [s]", False), ("refused", True)):
        shown = {key: x for key, x in best.items() if (x.duration is None) == refused}
        points = np.array([*shown, *[[np.nan] * len(axes)]]) / [size for _, size in units]
        times = [x.duration for x in shown.values()]
        colour = {"color": times, "colorscale": "Viridis", "reversescale": True, "showscale": True}
        look = {"color": REFUSED} if refused else {**colour, "colorbar": {"title": {"text": name}}}
        figure.add_trace(
            make_trace(
                "scatter",
                x=points[:-1, 0],
                y=points[:-1, 1] if axes[1:] else np.zeros(len(shown)),
                name=name,
                mode="markers+text",
                text=[numbers.get(x.refusal, "") for x in shown.values()],
                hovertext=[f"{x}: {x.why_not or number(x.duration, 's')}" for x in shown.values()],
                hoverinfo="text",
                marker={"symbol": "square", "size": SIZE, **look},
                showlegend=False,
            )
        )
    titles = [f"{name} [{unit}]" for name, (unit, _) in zip(axes, units, strict=True)]
    figure.update_xaxes(title=titles[0])
    figure.update_yaxes(title=titles[1] if titles[1:] else "")
    return finish(figure, title="Shortest motion at each place")
