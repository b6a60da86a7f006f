"""Arrows that show the direction of the tool along paths, in drawings."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.geometry import Path
from armcontour.report.sheet import Sheet

# Length of an arrow, and of both strokes of its head [px].
LENGTH = 26.0
HEAD = 6.0
# Angle between the arrow and the strokes of its head [rad].
HEAD_ANGLE = 0.45
# Arrows are at least this far apart [px], and a drawing has at most this number of them.
APART = 30.0
MOST = 250
# Shorter projections of arrows are not drawn, because they point towards the reader [px].
SHORTEST = 4.0
# Words for the legend.
WORDS = "tool axis: from the tool to the path"


def axis_arrows(paths: Iterable[Path], sheet: Sheet) -> str:
    """Return arrows that point from the tool to paths, as the SVG attribute `d`; empty if none.

    Args:
        paths: The paths; those without tool orientation have no arrows.
        sheet: Projection of the drawing.
    """
    oriented = [x for x in paths if x.orientation is not None]
    total = sum(x.length for x in oriented) * sheet.size
    spacing = max(APART, total / MOST) / sheet.size
    parts = []
    for path in oriented:
        assert path.orientation is not None
        count = max(int(path.length / spacing), 1)
        s = (np.arange(count) + 0.5) * path.length / count
        axes = path.orientation(s)[:, :, 2] @ sheet.axes.T
        # In SVG, y points down.
        steps = LENGTH * axes * [1.0, -1.0]
        tips = sheet.place(path(s))
        shown = np.linalg.norm(steps, axis=1) >= SHORTEST
        parts += [_arrow(tip, step) for tip, step in zip(tips[shown], steps[shown], strict=True)]
    return "".join(parts)


def _arrow(tip: FloatArray, step: FloatArray) -> str:
    """Return an arrow that ends at a point [px], as the SVG attribute `d`."""
    back = -step / np.linalg.norm(step) * HEAD
    sides = []
    for angle in (HEAD_ANGLE, -HEAD_ANGLE):
        c, s = np.cos(angle), np.sin(angle)
        sides.append(tip + np.array([c * back[0] - s * back[1], s * back[0] + c * back[1]]))
    points = [tip - step, tip, sides[0], tip, sides[1]]
    return "M" + " ".join(f"{x:.1f}" for point in points for x in point.tolist())
