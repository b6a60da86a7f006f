"""Colours, fonts and layout of figures."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.render import LINES, PALETTE
from armcontour.report.figure import make_trace

RUN_COLOURS = PALETTE["runs"]
PATH_COLOUR, LIMIT_COLOUR = LINES["objective"], LINES["allowed"]
PLANNED_COLOUR, EXECUTED_COLOUR = LINES["planned"], LINES["executed"]
EXPERIMENT_COLOUR = LINES["experiment"]
# Line style of an experiment, which has the colour of its run.
EXPERIMENT_DASH = "dot"
# Ratio of the largest to the smallest value above which a logarithmic axis is labelled only at
# powers of ten.
DECADES = 1e3
# Width of a figure that is as wide as the page, in sixths.
WHOLE = 6
# Maximum number of points in a curve; more points are not visible.
MAX_POINTS = 2400
# Maximum number of sentences of one kind.
MAX_SENTENCES = 6


def run_colours(names: Iterable[str]) -> dict[str, str]:
    """Colour of each run by name; colours repeat after the last one of RUN_COLOURS."""
    return {name: RUN_COLOURS[i % len(RUN_COLOURS)] for i, name in enumerate(names)}


def run_widths(names: Iterable[str]) -> dict[str, float]:
    """Line width of each run by name [px]; later runs are thinner, so that no line is covered."""
    listed = list(names)
    return {name: min(1.5 + 1.3 * (len(listed) - 1 - i), 7.0) for i, name in enumerate(listed)}


def thin(t: FloatArray, *curves: FloatArray, count: int = MAX_POINTS) -> list[FloatArray]:
    """Reduce times and curves, (n,) each, to about `count` points.

    The result contains the extremes of every curve in equal intervals, and all gaps (NaN) with the
    points next to them.
    """
    n = len(t)
    bins = count // (2 * max(1, len(curves)))
    if n <= count:
        return [t, *curves]
    size = int(np.ceil(n / bins))
    chosen = {0, n - 1}
    for curve in curves:
        gaps = np.isnan(curve)
        indices = np.flatnonzero(gaps)
        beside = np.concatenate([indices - 1, indices, indices + 1])
        chosen |= set(beside[(beside >= 0) & (beside < n)].tolist())
        for sign in (1, -1):
            # Gaps must not be chosen as extremes.
            peaks = np.where(gaps, -np.inf, sign * curve)
            padded = np.append(peaks, np.full(-n % size, -np.inf)).reshape(-1, size)
            first = np.arange(len(padded)) * size
            chosen |= set(np.minimum(first + padded.argmax(axis=1), n - 1).tolist())
    order = np.array(sorted(chosen))
    return [t[order], *(x[order] for x in curves)]


def few(sentences: Iterable[str], noun: str = "of these") -> tuple[str, ...]:
    """The first MAX_SENTENCES sentences, and a sentence with the number of the others."""
    listed = tuple(sentences)
    if len(listed) <= MAX_SENTENCES:
        return listed
    return (*listed[:MAX_SENTENCES], f"And {len(listed) - MAX_SENTENCES} more {noun}.")


def finish(figure: Any, *, title: str, height: int = 320, span: int = WHOLE) -> Any:
    """Apply the common layout; `height`: height [px]; `span`: width in sixths of the page."""
    if span < WHOLE:
        figure.span = span
    figure.update_layout(
        title=title,
        height=height,
        font={"family": "system-ui, sans-serif", "size": 13, "color": "#222222"},
        margin={"l": 70, "r": 20, "t": 30, "b": 60},
        legend={
            **{"orientation": "h", "xref": "container", "x": 0},
            **{"yref": "container", "yanchor": "bottom", "y": 0},
        },
        hovermode="closest",
    )
    axes = {"showline": True, "linecolor": "#444444", "ticks": "outside", "zeroline": False}
    # Labels have powers of ten, because a label such as 100µ on an axis in mm is misread as µm.
    figure.update_xaxes(**axes, exponentformat="power")
    figure.update_yaxes(**axes, exponentformat="power")
    for letter in "xy":
        axis = figure.layout[f"{letter}axis"]
        if axis.type == "log":
            shown = [np.asarray(x[letter], dtype=np.float64).ravel() for x in figure.data]
            axis.merge(_log_ticks(np.concatenate(shown)))
    return figure


def _log_ticks(values: FloatArray) -> dict[str, Any]:
    """Tick options of a logarithmic axis: at 1, 2 and 5, or for a wide range at powers of ten."""
    positive = values[np.isfinite(values) & (values > 0)]
    wide = len(positive) > 0 and positive.max() > DECADES * positive.min()
    return {"dtick": 1} if wide else {"tickformat": "~g", "dtick": "D2"}


def line(x: Any, y: Any, name: str, colour: str, **options: Any) -> Any:
    """Trace of a curve in single precision, which halves the size of the page."""
    dash = options.pop("dash", "solid")
    width = options.pop("width", 2)
    return make_trace(
        "scatter",
        x=np.asarray(x, dtype=np.float32),
        y=np.asarray(y, dtype=np.float32),
        name=name,
        mode="lines",
        line={"color": colour, "dash": dash, "width": width},
        **options,
    )
