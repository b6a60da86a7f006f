"""Report of a batch: statuses of the jobs, and their results plotted over the parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.render import number, number_range, scale
from armcontour.report.figure import Figure, make_trace
from armcontour.report.section import Front, Section, Tile
from armcontour.report.style import EXECUTED_COLOUR, PATH_COLOUR, finish

# Maximum number of plots on a page, and of tiles with results.
MAX_FIGURES, MAX_TILES = 6, 4


@dataclass(frozen=True, slots=True)
class PlotValues:
    """Values of a parameter or of a result column for all drawn jobs."""

    name: str
    # SI unit
    unit: str
    # One value per drawn job in SI units; NaN if missing
    values: FloatArray
    # True for a logarithmic axis
    log: bool

    @property
    def title(self) -> str:
        """Name with the displayed unit."""
        unit, _ = scale(self.unit)
        return f"{self.name} [{unit}]" if unit else self.name

    @property
    def drawn(self) -> FloatArray:
        """Values in the displayed unit, (n,)."""
        return self.values / scale(self.unit)[1]


@dataclass(frozen=True, slots=True, kw_only=True)
class BatchView:
    """Data of a batch for its report."""

    name: str
    # Description in one line
    about: str
    # Number of jobs by status, and number of jobs with an error by name of the error
    counts: Mapping[str, int]
    errors: Mapping[str, int]
    # Varied numeric parameters
    axes: tuple[PlotValues, ...]
    figures: tuple[PlotValues, ...]
    # Status of each drawn job
    status: tuple[str, ...]
    # Status of jobs that have results
    done: str
    # Only every stride-th job is drawn.
    stride: int


def counted(view: BatchView) -> Front:
    """First screen: numbers of jobs by status, and the plot of the first result column."""
    total, done = sum(view.counts.values()), view.counts.get(view.done, 0)
    tiles = [Tile(label="jobs done", value=f"{done} of {total}")]
    for values in view.figures[:MAX_TILES]:
        known = values.values[np.isfinite(values.values)].tolist()
        if known:
            note = f"median {number(float(np.median(known)), values.unit)}"
            tiles.append(Tile(label=values.name, value=number_range(known, values.unit), note=note))
    sentences = [("Points", "Each point is a job; crosses are jobs without figures.")]
    if view.stride > 1:
        sentences.append(("Shown jobs", f"One of {view.stride} jobs is shown."))
    if view.errors:
        errors = ", ".join(f"{name} ({n})" for name, n in view.errors.items())
        sentences.append(("Errors", f"{errors}."))
    return Front(
        verdict=", ".join(f"{n} {name}" for name, n in view.counts.items()),
        tiles=tuple(tiles),
        parts=tuple(_figure(view, x) for x in view.figures[:1]) if view.axes else (),
        sentences=tuple(sentences),
    )


def batch(view: BatchView) -> Section | None:
    """Section with plots of the other result columns over the parameters; None without plots."""
    figures = [_figure(view, x) for x in view.figures[1:MAX_FIGURES]] if view.axes else []
    for figure in figures:
        figure.span = 3
    names = ", ".join(x.name for x in view.figures[1:MAX_FIGURES])
    return (
        Section(key="batch", title="Other figures", summary=names, parts=tuple(figures))
        if figures
        else None
    )


def _figure(view: BatchView, colours: PlotValues) -> Any:
    """Plot of a result column over the only parameter, or as colours over the first two."""
    status = np.array(view.status)
    done, failed = status == view.done, status != view.done
    first, second = view.axes[0], view.axes[1] if len(view.axes) > 1 else colours
    flat = second is not colours
    marker: dict[str, Any] = {"color": EXECUTED_COLOUR, "size": 5}
    if flat:
        values = colours.drawn[done]
        marker = {"color": values, "colorscale": "Viridis", "size": 7, "showscale": True}
        # The title is at the side, because a title above the colour bar would widen the bar.
        marker["colorbar"] = {"title": {"text": colours.title, "side": "right"}}
    figure = Figure()
    figure.add_trace(
        make_trace(
            "scattergl",
            x=first.drawn[done],
            y=second.drawn[done],
            customdata=colours.drawn[done],
            name=view.done,
            mode="markers",
            marker=marker,
            hovertemplate="%{x:.6g}, %{y:.6g}: %{customdata:.6g}<extra></extra>",
        )
    )
    if flat and failed.any():
        figure.add_trace(
            make_trace(
                "scattergl",
                x=first.drawn[failed],
                y=second.drawn[failed],
                text=status[failed],
                name="without figures",
                mode="markers",
                marker={"color": PATH_COLOUR, "size": 6, "symbol": "x"},
            )
        )
    figure.update_xaxes(**_axis(first))
    figure.update_yaxes(**_axis(second))
    return finish(figure, title=colours.name, height=380)


def _axis(values: PlotValues) -> dict[str, Any]:
    """Title and type of an axis for plotly.js."""
    return {"title": values.title, "type": "log" if values.log else "linear"}
