"""Report of a placement search: maps of the values of all candidates, and rejections."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.render import scale
from armcontour.core.result import VERDICT, Row
from armcontour.report.figure import Figure, make_trace
from armcontour.report.section import Front, Section, TextTable, side_by_side, tiles
from armcontour.report.style import EXECUTED_COLOUR, PLANNED_COLOUR, finish

if TYPE_CHECKING:
    from armcontour.studies.placement import Axis, Placement

# Height of a map [px].
HEIGHT = 460
# Grey tones of rejected candidates, by the reason of the rejection.
GREYS = {
    "reach": "#4d4d4d",
    "joint range": "#737373",
    "singularity": "#8f8f8f",
    "clearance": "#a8a8a8",
    "limits": "#c2c2c2",
    "other": "#d9d9d9",
}
# Colour scale whose order is visible regardless of colour vision.
SCALE = "Viridis"
OBJECTIVES = {
    "duration": "shortest duration",
    "manipulability": "largest manipulability",
    "clearance": "largest clearance",
    "torque": "largest torque margin",
}


def placed(result: Placement) -> Front:
    """First screen: the best placement and the first map."""
    rows, maps = result.to_data().shown(VERDICT), _maps(result)
    sentences = [("The map", _text(result))]
    sentences += [("Weakest point", x) for x in result.notes[:1]]
    return Front(
        verdict=f"Best place of the {result.moved}: {result.refined}",
        tiles=tiles(rows),
        parts=maps[0][1] if maps else (),
        sentences=tuple(sentences),
    )


def placement(result: Placement) -> Section:
    """Section with the other maps, the values of the best placement, and the rejections."""
    rows = tuple((kind, str(n)) for kind, n in result.refusals.items())
    refused = TextTable(header=("refused by", "places"), rows=rows)
    return Section(
        key="placement",
        title="Other maps and figures",
        summary="figures of the best place and of the job's own place; refused places",
        parts=(side_by_side(result.comparison), *([refused] if result.refusals else [])),
        choices=tuple(_maps(result)[1:]),
        notes=result.notes[1:],
    )


def _maps(result: Placement) -> list[tuple[str, tuple[Any, ...]]]:
    """Label and map of each quantity that has known values."""
    return [
        (x.label, (_figure(result, x, values),))
        for x in result.own.to_data().rows
        if x.label and x.unit and np.isfinite(values := _values(result, x)).any()
    ]


def _text(result: Placement) -> str:
    """Text that describes the maps."""
    best = OBJECTIVES[result.objective]
    parts = [
        f"Every point is a placement of the {result.moved}. The search maximizes or minimizes for "
        f"the {best}. Rejected placements are grey, with a tone per reason. The cross marks the "
        "best placement."
    ]
    if result.planned < len(result.verdicts) - sum(result.refusals.values()):
        parts.append(
            "Placements whose lower bound of the duration exceeds the best duration were not "
            "planned; for them, the map shows the lower bound."
        )
    if len(_varied(result)) > 2:
        parts.append("Each point shows the best value over the other axes.")
    if result.uncertainty:
        parts.append(
            "All figures are the worst values of a placement and of the corners of its uncertainty."
        )
    return " ".join(parts)


def _varied(result: Placement) -> list[Axis]:
    """Axes with more than one value; if there is none, the first axis."""
    return [x for x in result.axes if len(x.values) > 1] or [result.axes[0]]


def _values(result: Placement, row: Row) -> FloatArray:
    """Values of a quantity in the displayed unit; NaN for rejected candidates and unknown values.

    Unknown durations are replaced by their lower bounds.
    """
    values = result.values(row.name)
    if row.name == "duration":
        bounds = result.values("bound")
        values = np.where(np.isnan(values) & (bounds > 0), bounds, values)
    refused = np.array([bool(v.refusal) for v in result.verdicts]).reshape(result.shape)
    values[refused | np.isinf(values)] = np.nan
    return values / scale(row.unit)[1]


def _figure(result: Placement, row: Row, values: FloatArray) -> Any:
    """Figure with a heat map over the first two axes that vary, or a line over the only one."""
    axes = _varied(result)[:2]
    varied = [k for k, a in enumerate(result.axes) if any(a is b for b in axes)]
    others = tuple(k for k in range(len(result.axes)) if k not in varied)
    # The best duration is the smallest; the best value of other quantities is the largest.
    small = row.unit == "s"
    worst = np.inf if small else -np.inf
    filled = np.where(np.isnan(values), worst, values)
    best = filled.min(axis=others) if small else filled.max(axis=others)
    best = np.where(np.isinf(best), np.nan, best)
    numbers = {kind: k for k, kind in enumerate(GREYS)}
    kinds = np.array([numbers.get(v.refusal, -1) for v in result.verdicts])
    # A point is grey if its candidates are rejected for all values of the other axes. Of several
    # reasons, the last one of GREYS is shown.
    refused = kinds.reshape(result.shape)
    refused = np.where((refused >= 0).all(axis=others), refused.max(axis=others), -1)
    return (_map if len(axes) == 2 else _line)(result, row, axes, best, refused)


def _map(
    result: Placement, row: Row, axes: list[Axis], values: FloatArray, refused: FloatArray
) -> Any:
    """Figure with a heat map; rejected candidates are grey and have entries in the legend."""
    coordinates = [a.values / scale(a.unit)[1] for a in axes]
    drawn = Figure()
    for k, kind in enumerate(GREYS):
        if (refused == k).any():
            grey = GREYS[kind]
            drawn.add_trace(
                make_trace(
                    "heatmap",
                    x=coordinates[0],
                    y=coordinates[1],
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
            x=coordinates[0],
            y=coordinates[1],
            z=values.T,
            colorscale=SCALE,
            reversescale=row.unit == "s",
            colorbar={"title": {"text": _title(row.label, row.unit), "side": "right"}},
            hovertemplate="%{x:.4g}, %{y:.4g}<br>%{z:.5g}<extra></extra>",
        )
    )
    best = [result.refined.values[a.name] / scale(a.unit)[1] for a in axes]
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
    return finish(drawn, title=f"Places by {row.label}", height=HEIGHT)


def _key(kind: str, colour: str) -> Any:
    """Trace that is only an entry of the legend for a reason of rejection."""
    marker = {"symbol": "square", "size": 12, "color": colour}
    return make_trace(
        "scatter", x=[None], y=[None], mode="markers", name=f"refused by {kind}", marker=marker
    )


def _line(
    result: Placement, row: Row, axes: list[Axis], values: FloatArray, refused: FloatArray
) -> Any:
    """Figure with values over the only axis that varies; rejected candidates are grey squares."""
    coordinates, drawn = axes[0].values / scale(axes[0].unit)[1], Figure()
    drawn.add_trace(
        make_trace(
            "scatter",
            x=coordinates,
            y=values,
            mode="lines+markers",
            name=_title(row.label, row.unit),
            line={"color": EXECUTED_COLOUR, "width": 1.5},
        )
    )
    floor = float(np.nanmin(values))
    for k, kind in enumerate(GREYS):
        mask = refused == k
        if mask.any():
            entry = _key(kind, GREYS[kind])
            entry.x, entry.y = coordinates[mask], np.full(mask.sum(), floor)
            drawn.add_trace(entry)
    drawn.update_xaxes(title=_title(axes[0].name, axes[0].unit))
    drawn.update_yaxes(title=_title(row.label, row.unit))
    return finish(drawn, title=f"Places by {row.label}", height=HEIGHT)


def _title(label: str, unit: str) -> str:
    """Title of an axis: label and displayed unit."""
    return f"{label} [{scale(unit)[0]}]"
