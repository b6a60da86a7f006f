"""Times of rapids and dwells in figures over time, in which limits of contours do not hold."""

from __future__ import annotations

from typing import Any

import numpy as np

from armcontour.jobs import Study
from armcontour.report.style import RAPID_SHADE, run_colours, shade

# Largest number of shaded rapids of a run.
MOST_SHADES = 300
# Height of the strip of a run below a figure, as a share of its height, and how opaque it is.
STRIP, OPACITY = 0.025, 0.55


def shade_rapids(figure: Any, study: Study) -> str:
    """Shade when no contour is followed; returns words on what is shaded.

    Runs that agree share bands over the whole height; others have a strip each at the bottom, in
    their colours.

    Args:
        figure: A figure over time with one plot.
        study: The study.
    """
    times = {
        name: [x.t for x in result.trajectory.spans if x.kind != "contour"]
        for name, result in study.runs.items()
    }
    first, *others = times.values()
    if max(map(len, times.values())) > MOST_SHADES:
        return ""
    if all(np.shape(x) == np.shape(first) and np.allclose(x, first) for x in others):
        shade(figure, first, 1, RAPID_SHADE)
        return ", in grey,"
    colours = run_colours(study.runs)
    for k, (name, spans) in enumerate(times.items()):
        ends = (k * STRIP, (k + 1) * STRIP)
        shade(figure, spans, 1, colours[name], ends=ends, opacity=OPACITY)
    return ", in strips of the runs' colours at the bottom,"
