"""Colours of figures, and selection of what they show."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.render import PALETTE
from armcontour.report.view import select_points

RUN_COLOURS = PALETTE["runs"]
# Colour of the first run, which no limit in the same legend has.
FIRST_RUN = "#1c2430"
# Number of colours in RUN_COLOURS that frequent limits have too; other runs get them last.
OF_LIMITS = 3
# Line style of an experiment, which has the colour of its run.
EXPERIMENT_DASH = (2.0, 3.0)
# Line style of a limit or an assigned velocity.
LIMIT_DASH = (6.0, 4.0)
# Ratio of the largest value to the smallest one on a logarithmic axis; smaller values are drawn at
# the edge, because noise would take most of the height.
DECADES = 1e3
# Maximum number of points in a curve; more points are not visible.
MAX_POINTS = 2400
# Maximum number of sentences per kind.
MAX_SENTENCES = 6


def run_colours(names: Iterable[str]) -> dict[str, str]:
    """Choose each run's colour, by name; after the last one they repeat."""
    colours = [FIRST_RUN, *RUN_COLOURS[OF_LIMITS:], *RUN_COLOURS[:OF_LIMITS]]
    return {name: colours[i % len(colours)] for i, name in enumerate(names)}


def run_widths(names: Iterable[str]) -> dict[str, float]:
    """Choose each run's line width [px], by name; later runs are thinner, to cover no line."""
    listed = list(names)
    return {name: min(1.5 + 1.3 * (len(listed) - 1 - i), 7.0) for i, name in enumerate(listed)}


def thin(x: FloatArray, y: FloatArray, count: int = MAX_POINTS) -> tuple[FloatArray, FloatArray]:
    """Reduce a curve through n points to about `count` points.

    The result contains the extremes in equal intervals, and all gaps (NaN) with the points next to
    them.
    """
    if len(x) <= count:
        return x, y
    gaps = np.isnan(y)
    near_gaps = np.convolve(gaps, np.ones(3), "same") > 0
    known = np.where(gaps, np.nanmean(y), y)
    chosen = select_points(np.where(near_gaps, np.inf, 0.0), [known], count)
    return x[chosen], y[chosen]


def few(sentences: Iterable[str], noun: str = "of these") -> tuple[str, ...]:
    """Return the first MAX_SENTENCES sentences, and a sentence that counts the others."""
    listed = tuple(sentences)
    if len(listed) <= MAX_SENTENCES:
        return listed
    return (*listed[:MAX_SENTENCES], f"And {len(listed) - MAX_SENTENCES} more {noun}.")
