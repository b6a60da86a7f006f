"""The section on a placement: maps of what every place is worth, and of what refuses it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.render import scale
from armcontour.core.result import VERDICT, Row
from armcontour.report.figure import Figure, make_trace
from armcontour.report.section import Front, Section, Table, side_by_side, tiles
from armcontour.report.style import EXECUTED_COLOUR, PLANNED_COLOUR, finish

if TYPE_CHECKING:
    from armcontour.studies.placement import Axis, Placement

# Height of a map [px].
HEIGHT = 460
# Grey tones of refused places, by the kinds of refusals.
GREYS = {
    "reach": "#4d4d4d",
    "joint range": "#737373",
    "singularity": "#8f8f8f",
    "clearance": "#a8a8a8",
    "limits": "#c2c2c2",
    "other": "#d9d9d9",
}
# A scale that readers of all kinds of colour vision read in the same order.
SCALE = "Viridis"
OBJECTIVES = {
    "duration": "shortest duration",
    "manipulability": "largest manipulability",
    "clearance": "largest clearance",
    "torque": "largest torque margin",
}


def placed(found: Placement) -> Front:
    """The first screen: the map of the sought figure, and the best place.

    Args:
        found: The placement.
    """
    rows, maps = found.to_data().shown(VERDICT), _maps(found)
    sentences = [("What the map shows", _text(found))]
    sentences += [("Weakest point", x) for x in found.notes[:1]]
    return Front(
        verdict=f"Best place of the {found.moved}: {found.refined}",
        tiles=tiles(rows),
        parts=maps[0][1] if maps else (),
        sentences=tuple(sentences),
    )


def placement(found: Placement) -> Section:
    """The other maps, the figures of the best place, and how places were refused.

    Args:
        found: The placement.
    """
    rows = tuple((kind, str(n)) for kind, n in found.refusals.items())
    refused = Table(header=("refused by", "places"), rows=rows)
    return Section(
        key="placement",
        title="Other maps and figures",
        summary="figures of the best place and of the job's own place; refused places",
        parts=(side_by_side(found.comparison), *([refused] if found.refusals else [])),
        choices=tuple(_maps(found)[1:]),
        notes=found.notes[1:],
    )


def _maps(found: Placement) -> list[tuple[str, tuple[Any, ...]]]:
    """A map of each figure that places have, by their labels."""
    return [
        (x.label, (_figure(found, x, values),))
        for x in found.own.to_data().rows
        if x.label and x.unit and np.isfinite(values := _values(found, x)).any()
    ]


def _text(found: Placement) -> str:
    """What the maps show."""
    best = OBJECTIVES[found.objective]
    parts = [
        f"Every point is a place of the {found.moved}; sought is the {best}. Refused places are "
        "grey, with a tone per reason; the cross is the best place."
    ]
    if found.planned < len(found.verdicts) - sum(found.refusals.values()):
        parts.append(
            "Most places were not planned, as a lower bound on the duration already rules them "
            "out: for them the map has that bound."
        )
    if len(_varied(found)) > 2:
        parts.append("Each point shows the best over the other axes.")
    if found.uncertainty:
        parts.append("All figures are those of the worst of a place and of the corners around it.")
    return " ".join(parts)


def _varied(found: Placement) -> list[Axis]:
    """The axes along which there is more than one place, at least one."""
    return [x for x in found.axes if len(x.values) > 1] or [found.axes[0]]


def _values(found: Placement, x: Row) -> FloatArray:
    """Values of a map, not a number where a place is refused or nothing is known."""
    values = found.values(x.name)
    if x.name == "duration":
        bounds = found.values("bound")
        values = np.where(np.isnan(values) & (bounds > 0), bounds, values)
    refused = np.array([bool(v.refusal) for v in found.verdicts]).reshape(found.shape)
    values[refused | np.isinf(values)] = np.nan
    return values / scale(x.unit)[1]


def _figure(found: Placement, x: Row, values: FloatArray) -> Any:
    """A heat map over the first two axes that vary, or a line over the only one."""
    axes = _varied(found)[:2]
    kept = [k for k, a in enumerate(found.axes) if any(a is b for b in axes)]
    others = tuple(k for k in range(len(found.axes)) if k not in kept)
    # Short times are good, and other figures where they are large.
    small = x.unit == "s"
    worst = np.inf if small else -np.inf
    filled = np.where(np.isnan(values), worst, values)
    best = filled.min(axis=others) if small else filled.max(axis=others)
    best = np.where(np.isinf(best), np.nan, best)
    numbers = {kind: k for k, kind in enumerate(GREYS)}
    kinds = np.array([numbers.get(v.refusal, -1) for v in found.verdicts])
    # A place that is refused in all other values of the axes: by the last kind in the list.
    refused = kinds.reshape(found.shape)
    refused = np.where((refused >= 0).all(axis=others), refused.max(axis=others), -1)
    return (_map if len(axes) == 2 else _line)(found, x, axes, best, refused)


def _map(
    found: Placement, x: Row, axes: list[Axis], values: FloatArray, refused: FloatArray
) -> Any:
    """A heat map; refused places in tones of grey, with a legend."""
    at = [a.values / scale(a.unit)[1] for a in axes]
    drawn = Figure()
    for k, kind in enumerate(GREYS):
        if (refused == k).any():
            grey = GREYS[kind]
            drawn.add_trace(
                make_trace(
                    "heatmap",
                    x=at[0],
                    y=at[1],
                    z=np.where(refused == k, 1.0, np.nan).T,
                    colorscale=[[0, grey], [1, grey]],
                    showscale=False,
                    hovertemplate=f"%{{x:.4g}}, %{{y:.4g}}<br>refused by {kind}<extra></extra>",
                )
            )
            drawn.add_trace(_key(kind, grey))
    drawn.add_trace(
        make_trace(
            "heatmap",
            x=at[0],
            y=at[1],
            z=values.T,
            colorscale=SCALE,
            reversescale=x.unit == "s",
            colorbar={"title": {"text": _title(x.label, x.unit), "side": "right"}},
            hovertemplate="%{x:.4g}, %{y:.4g}<br>%{z:.5g}<extra></extra>",
        )
    )
    best = [found.refined.values[a.name] / scale(a.unit)[1] for a in axes]
    drawn.add_trace(
        make_trace(
            "scatter",
            x=best[:1],
            y=best[1:],
            mode="markers",
            name="best place",
            marker={"symbol": "x", "size": 12, "color": PLANNED_COLOUR},
        )
    )
    drawn.update_xaxes(title=_title(axes[0].name, axes[0].unit))
    drawn.update_yaxes(title=_title(axes[1].name, axes[1].unit))
    if all(a.unit == "m" for a in axes):
        drawn.update_xaxes(constrain="domain")
        drawn.update_yaxes(constrain="domain", scaleanchor="x", scaleratio=1)
    return finish(drawn, title=f"Places by {x.label}", height=HEIGHT)


def _key(kind: str, colour: str) -> Any:
    """An entry of the legend for a kind of refusals."""
    marker = {"symbol": "square", "size": 12, "color": colour}
    return make_trace(
        "scatter", x=[None], y=[None], mode="markers", name=f"refused by {kind}", marker=marker
    )


def _line(
    found: Placement, x: Row, axes: list[Axis], values: FloatArray, refused: FloatArray
) -> Any:
    """Values along the only axis that varies; refused places as squares below."""
    at, drawn = axes[0].values / scale(axes[0].unit)[1], Figure()
    drawn.add_trace(
        make_trace(
            "scatter",
            x=at,
            y=values,
            mode="lines+markers",
            name=_title(x.label, x.unit),
            line={"color": EXECUTED_COLOUR, "width": 1.5},
        )
    )
    floor = float(np.nanmin(values))
    for k, kind in enumerate(GREYS):
        which = refused == k
        if which.any():
            entry = _key(kind, GREYS[kind])
            entry.x, entry.y = at[which], np.full(which.sum(), floor)
            drawn.add_trace(entry)
    drawn.update_xaxes(title=_title(axes[0].name, axes[0].unit))
    drawn.update_yaxes(title=_title(x.label, x.unit))
    return finish(drawn, title=f"Places by {x.label}", height=HEIGHT)


def _title(label: str, unit: str) -> str:
    """The title of an axis."""
    return f"{label} [{scale(unit)[0]}]"
