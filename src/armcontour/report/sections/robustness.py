"""The section on robustness: distribution of the contour error for uncertain robots."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from armcontour._checks import FloatArray
from armcontour.report.figure import Figure, make_trace
from armcontour.report.section import Section, Table, Tile
from armcontour.report.style import (
    EXECUTED_COLOUR,
    EXPERIMENT_COLOUR,
    LIMIT_COLOUR,
    MOST_POINTS,
    PATH_COLOUR,
    PLANNED_COLOUR,
    finish,
    line,
)

if TYPE_CHECKING:
    from armcontour.robustness.monte_carlo import Spread


def robustness(
    drawn: Spread, corners: Spread | None = None, *, budget: float | None = None, run: str = ""
) -> Section:
    """Distribution of the largest contour error, and its most important parameter.

    Args:
        drawn: Executions drawn from a box, by `spread`.
        corners: Executions in the corners of the box, by `worst_corner`.
        budget: Largest allowed contour error [m].
        run: Name of the run of the taught data.
    """
    figures = [_distribution(drawn, corners, budget)]
    if drawn.names:
        figures.append(_dependence(drawn, corners, budget))
    return Section(
        key="robustness",
        title="Robustness",
        text=(
            f"Largest contour error of {len(drawn)} executions of the same taught data, by robots "
            "that differ from the model within the errors given for it."
        ),
        tiles=((run, _tiles(drawn, corners, budget)),),
        figures=tuple(figures),
        tables=(_table(drawn, corners),) if drawn.names else (),
    )


def _tiles(drawn: Spread, corners: Spread | None, budget: float | None) -> tuple[Tile, ...]:
    """Tiles of the distribution."""
    found = [
        Tile(label="without errors of the model", value=_mm(drawn.nominal_max)),
        Tile(label="95 % stay within", value=_mm(drawn.quantile(0.95))),
        Tile(label="largest of the drawn", value=_mm(float(drawn.max.max()))),
    ]
    if corners is not None:
        found.append(Tile(label="worst corner", value=_mm(float(corners.max.max()))))
    if budget is not None:
        share = f"{drawn.within(budget):.1%}"
        found.append(Tile(label="within the budget", value=share, note=f"of {_mm(budget)}"))
    return tuple(found)


def _distribution(drawn: Spread, corners: Spread | None, budget: float | None) -> Any:
    """Figure of the share of executions that stay within an error, over that error."""
    errors = np.sort(drawn.max) * 1e3
    share = 100 * np.arange(1, len(errors) + 1) / len(errors)
    kept = _thin(len(errors))
    curve = line(errors[kept], share[kept], "executions", EXECUTED_COLOUR)
    curve.line.shape = "hv"
    figure = Figure(curve)
    _upright(figure, drawn.nominal_max, "without errors of the model", PATH_COLOUR, "dot")
    if corners is not None:
        _upright(figure, float(corners.max.max()), "worst corner", PLANNED_COLOUR, "dash")
    if budget is not None:
        _upright(figure, budget, f"budget {_mm(budget)}", LIMIT_COLOUR, "solid")
    figure.update_xaxes(title="largest contour error [mm]", rangemode="tozero")
    figure.update_yaxes(title="executions that stay within it [%]", range=[0, 101])
    return finish(figure, title="Contour error of robots drawn from the box")


def _dependence(drawn: Spread, corners: Spread | None, budget: float | None) -> Any:
    """Figure of the error over the parameter that explains most of its variance."""
    shares = drawn.influence()
    name = max(shares, key=lambda x: shares[x])
    unit, scale = _unit(name)
    figure = Figure()
    listed = [(drawn, "executions", EXECUTED_COLOUR, "circle", 4)]
    if corners is not None:
        listed.append((corners, "corners", PLANNED_COLOUR, "diamond", 8))
    for found, label, colour, symbol, size in listed:
        kept = _thin(len(found))
        figure.add_trace(
            make_trace(
                "scatter",
                x=_of(found, name)[kept] * scale,
                y=found.max[kept] * 1e3,
                name=label,
                mode="markers",
                marker={"color": colour, "symbol": symbol, "size": size, "opacity": 0.6},
            )
        )
    at = np.array([-1.0, 1.0]) * np.abs(_of(drawn, name)).max() * scale
    level = np.full(2, drawn.nominal_max * 1e3)
    figure.add_trace(line(at, level, "without errors of the model", EXPERIMENT_COLOUR, dash="dot"))
    if budget is not None:
        figure.add_trace(line(at, np.full(2, budget * 1e3), f"budget {_mm(budget)}", LIMIT_COLOUR))
    figure.update_xaxes(title=f"error of {name} [{unit}]")
    figure.update_yaxes(title="largest contour error [mm]", rangemode="tozero")
    explained = f"{shares[name]:.0%} of the variance" if len(shares) > 1 else "alone"
    return finish(figure, title=f"What matters most: {name} ({explained})")


def _table(drawn: Spread, corners: Spread | None) -> Table:
    """Table of the parameters, their share of the variance, and their worst values."""
    shares, rows = drawn.influence(), []
    for name in sorted(shares, key=lambda x: -shares[x]):
        unit, scale = _unit(name)
        cells = [name, f"{shares[name]:.0%}"]
        for found in (drawn, corners):
            if found is not None:
                cells.append(f"{found.worst_deviations[name] * scale:+.3g} {unit}")
        rows.append(tuple(cells))
    header = ["error of", "explains of the variance", "in the worst execution"]
    if corners is not None:
        header.append("in the worst corner")
    return Table(header=tuple(header), rows=tuple(rows))


def _upright(figure: Any, error: float, name: str, colour: str, dash: str) -> None:
    """Draw a vertical line at an error."""
    figure.add_trace(line([error * 1e3] * 2, [0, 100], name, colour, dash=dash))


def _thin(count: int) -> Any:
    """Indices of evenly spaced executions, with the first and the last, up to `MOST_POINTS`."""
    return np.unique(np.linspace(0, count - 1, min(count, MOST_POINTS)).astype(np.intp))


def _of(found: Spread, name: str) -> FloatArray:
    """Deviations of one parameter, (n,)."""
    return np.asarray(found.deviations[:, found.names.index(name)])


def _unit(name: str) -> tuple[str, float]:
    """Unit of the deviation of a parameter, and its factor from SI."""
    if name.startswith("dead time"):
        return "ms", 1e3
    return ("kg", 1.0) if name == "payload" else ("%", 1e2)


def _mm(length: float) -> str:
    """A length in mm as text."""
    return f"{length * 1e3:.3g} mm"
