"""Tool axes along the edges of a CAD model, for the page: arrows, and knobs that turn them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.geometry import Path
from armcontour.report.view import to_float32

# Length of an arrow as a fraction of the contours' size, and its smallest and largest value [m].
RELATIVE_LENGTH = 0.12
LENGTHS = (0.008, 0.04)
# Length of the strokes of an arrow's head as a fraction of the arrow, and their slope.
HEAD = 0.25
HEAD_SLOPE = 0.4
# Largest number of arrows, and smallest one of a contour.
MOST_ARROWS = 240
LEAST_ARROWS = 3
# Distance between arrows as a fraction of their length.
SPACING = 0.8


def tool_axes(paths: Sequence[Path]) -> tuple[list[dict[str, Any] | None], Any]:
    """Return a knob per path, and the strokes of arrows from the tool to the paths.

    A knob has the point `tip` in the middle of the path, the point `tail` of the arrow there, and
    `turn`, the derivative of `tail` with respect to the work angle [m/rad]. It is None for a path
    without tool orientation. All points are in the frame of the paths [m].

    Args:
        paths: The paths, in space.

    Returns:
        The knobs, and the ends of the strokes, (n, 2, 3).
    """
    oriented = [x for x in paths if x.orientation is not None]
    if not oriented:
        return [None] * len(paths), to_float32(np.empty((0, 2, 3)))
    points = np.concatenate([x.vertices for x in oriented])
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    length = float(np.clip(RELATIVE_LENGTH * size, *LENGTHS))
    total = sum(x.length for x in oriented)
    spacing = max(SPACING * length, total / MOST_ARROWS)
    strokes = []
    for path in oriented:
        count = max(LEAST_ARROWS, int(path.length / spacing))
        s = (np.arange(count) + 0.5) * path.length / count
        strokes.append(_arrows(path, s, length))
    knobs = [None if x.orientation is None else _knob(x, length) for x in paths]
    return knobs, to_float32(np.concatenate(strokes))


def _axes_at(path: Path, s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return points, tool axes and unit tangents at arc lengths, (n, 3) each."""
    assert path.orientation is not None
    tangents = path(s, 1)
    tangents = tangents / np.linalg.norm(tangents, axis=1, keepdims=True)
    return path(s), path.orientation(s)[:, :, 2], tangents


def _arrows(path: Path, s: FloatArray, length: float) -> FloatArray:
    """Return the strokes of arrows at arc lengths, (3 n, 2, 3)."""
    tips, axes, tangents = _axes_at(path, s)
    tails = tips - length * axes
    one, other = (
        tips - HEAD * length * (axes + side * HEAD_SLOPE * tangents) for side in (-1.0, 1.0)
    )
    return np.concatenate([np.stack([x, tips], axis=1) for x in (tails, one, other)])


def _knob(path: Path, length: float) -> dict[str, Any]:
    """Return the knob at the middle of a path, see `tool_axes`.

    With the tool axis z and the direction of travel t, the derivative of z with respect to the work
    angle is z × t, for any travel angle.
    """
    tips, axes, tangents = _axes_at(path, np.array([path.length / 2]))
    turn = -length * np.cross(axes[0], tangents[0])
    return {"tip": tips[0], "tail": tips[0] - length * axes[0], "turn": turn}
