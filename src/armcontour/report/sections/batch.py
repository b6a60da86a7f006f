"""The section on a batch: how many jobs came to what, and their figures over the parameters."""

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

# Largest number of figures on a page, and of figures in large print.
MAX_FIGURES, MAX_TILES = 6, 4


@dataclass(frozen=True, slots=True)
class Axis:
    """Values of a parameter or of a figure of jobs.

    Args:
        name: Its name.
        unit: Its SI unit.
        values: One value for each job that is shown, in SI units; NaN where there is none.
        log: Whether its axis is logarithmic.
    """

    name: str
    unit: str
    values: FloatArray
    log: bool

    @property
    def title(self) -> str:
        """Its name with the unit in which it is drawn."""
        unit, _ = scale(self.unit)
        return f"{self.name} [{unit}]" if unit else self.name

    @property
    def drawn(self) -> FloatArray:
        """The values in the unit in which they are drawn."""
        return self.values / scale(self.unit)[1]


@dataclass(frozen=True, slots=True, kw_only=True)
class BatchView:
    """What a page shows of a batch.

    Args:
        name: Name of the batch.
        about: What it is, in a line.
        counts: Number of jobs by their status.
        errors: Number of jobs by the name of their error.
        axes: Parameters that are numbers, with more than one value.
        figures: Figures of the jobs.
        status: Status of each job that is shown.
        done: The status of jobs with figures.
        stride: Of so many jobs, one is shown.
    """

    name: str
    about: str
    counts: Mapping[str, int]
    errors: Mapping[str, int]
    axes: tuple[Axis, ...]
    figures: tuple[Axis, ...]
    status: tuple[str, ...]
    done: str
    stride: int


def counted(view: BatchView) -> Front:
    """The first screen: how many jobs came to what, and their first figure."""
    total, done = sum(view.counts.values()), view.counts.get(view.done, 0)
    tiles = [Tile(label="jobs done", value=f"{done} of {total}")]
    for x in view.figures[:MAX_TILES]:
        there = x.values[np.isfinite(x.values)].tolist()
        if there:
            note = f"median {number(float(np.median(there)), x.unit)}"
            tiles.append(Tile(label=x.name, value=number_range(there, x.unit), note=note))
    sentences = [("What a point is", "Each point is a job; crosses are jobs without figures.")]
    if view.stride > 1:
        sentences.append(("How many", f"One of {view.stride} jobs is shown."))
    if view.errors:
        errors = ", ".join(f"{name} ({n})" for name, n in view.errors.items())
        sentences.append(("Why others are not done", f"{errors}."))
    return Front(
        verdict=", ".join(f"{n} {name}" for name, n in view.counts.items()),
        tiles=tuple(tiles),
        parts=tuple(_figure(view, x) for x in view.figures[:1]) if view.axes else (),
        sentences=tuple(sentences),
    )


def batch(view: BatchView) -> Section | None:
    """The other figures over the parameters; None if there are none."""
    figures = [_figure(view, x) for x in view.figures[1:MAX_FIGURES]] if view.axes else []
    for x in figures:
        x.span = 3
    names = ", ".join(x.name for x in view.figures[1:MAX_FIGURES])
    return (
        Section(key="batch", title="Other figures", summary=names, parts=tuple(figures))
        if figures
        else None
    )


def _figure(view: BatchView, of: Axis) -> Any:
    """A figure over one parameter, or in colours over two; others are drawn over each other."""
    status = np.array(view.status)
    done, vain = status == view.done, status != view.done
    first, second = view.axes[0], view.axes[1] if len(view.axes) > 1 else of
    flat = second is not of
    marker: dict[str, Any] = {"color": EXECUTED_COLOUR, "size": 5}
    if flat:
        values = of.drawn[done]
        marker = {"color": values, "colorscale": "Viridis", "size": 7, "showscale": True}
        # A title above would make the bar as wide as itself.
        marker["colorbar"] = {"title": {"text": of.title, "side": "right"}}
    figure = Figure()
    figure.add_trace(
        make_trace(
            "scattergl",
            x=first.drawn[done],
            y=second.drawn[done],
            customdata=of.drawn[done],
            name=view.done,
            mode="markers",
            marker=marker,
            hovertemplate="%{x:.6g}, %{y:.6g}: %{customdata:.6g}<extra></extra>",
        )
    )
    if flat and vain.any():
        figure.add_trace(
            make_trace(
                "scattergl",
                x=first.drawn[vain],
                y=second.drawn[vain],
                text=status[vain],
                name="without figures",
                mode="markers",
                marker={"color": PATH_COLOUR, "size": 6, "symbol": "x"},
            )
        )
    figure.update_xaxes(**_axis(first))
    figure.update_yaxes(**_axis(second))
    return finish(figure, title=of.name, height=380)


def _axis(of: Axis) -> dict[str, Any]:
    """Title and scale of an axis."""
    return {"title": of.title, "type": "log" if of.log else "linear"}
