"""The tolerance of a shaped path, in figures: a tube around its objective path."""

from __future__ import annotations

from typing import Any

import numpy as np

from armcontour._checks import FloatArray
from armcontour.geometry import ShapedPath
from armcontour.report.figure import make_trace
from armcontour.report.outline import fine_places
from armcontour.timing.shaping.wishes import tube_of

TUBE_COLOUR = "rgba(86, 180, 233, 0.25)"
# Points of the round joint between two pieces of a tube.
ROUND = 24
# Turns below this need no round joint: the gap between two pieces is not visible [rad].
NO_GAP = 0.03


def tube_pieces(
    path: ShapedPath, start: float = 0.0, end: float | None = None
) -> tuple[FloatArray, FloatArray]:
    """Arc lengths along the objective path, and the tolerance between each two of them [m].

    Args:
        path: The shaped path.
        start: Arc length of the objective path at which the tube starts [m].
        end: Arc length at which it ends [m]; by default the end of the objective path.

    Returns:
        Arc lengths, (n,), and tolerances, (n - 1,).
    """
    objective, tube = path.objective, tube_of(path.objective, path)
    low, high = max(start, 0.0), objective.length if end is None else min(end, objective.length)
    # Where zones of vertices start and end the tolerance jumps.
    inside = tube.breaks[(tube.breaks > low) & (tube.breaks < high)]
    s = np.union1d(fine_places(objective, low, high), inside)
    piece = np.searchsorted(tube.breaks, (s[1:] + s[:-1]) / 2) - 1
    return s, tube.tolerance[np.clip(piece, 0, len(tube) - 1)]


def tube_outline(points: FloatArray, radius: FloatArray) -> FloatArray:
    """Outlines of the pieces of a tube around a polyline in the plane, with gaps (NaN) between.

    All run counter-clockwise, so that what is filled is their union.

    Args:
        points: The polyline, (n, 2).
        radius: Half width of the tube around each of its lines, (n - 1,).
    """
    along = np.diff(points, axis=0)
    length = np.linalg.norm(along, axis=1)
    kept = length > 0
    start, along, radius = points[:-1][kept], along[kept], radius[kept]
    across = np.stack([-along[:, 1], along[:, 0]], axis=1) / length[kept, None] * radius[:, None]
    gap = np.full((len(start), 1, 2), np.nan)
    sides = [start - across, start + along - across, start + along + across, start + across]
    quads = np.concatenate([np.stack([*sides, sides[0]], axis=1), gap], axis=1)
    heading = np.unwrap(np.arctan2(along[:, 1], along[:, 0]))
    bent = np.flatnonzero(np.abs(np.diff(heading)) > NO_GAP) + 1
    angle = np.linspace(0, 2 * np.pi, ROUND + 1)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    wide = np.maximum(radius[bent], radius[bent - 1])[:, None, None]
    discs = np.concatenate([start[bent][:, None] + wide * circle, gap[bent]], axis=1)
    return np.concatenate([quads.reshape(-1, 2), discs.reshape(-1, 2)])


def draw_tube(outline: FloatArray, **look: Any) -> Any:
    """The filled curve of a tube [mm]."""
    x, y = outline.astype(np.float32).T
    return make_trace(
        "scatter",
        x=x,
        y=y,
        name="tolerance",
        legendgroup="tolerance",
        mode="lines",
        line={"width": 0},
        fill="toself",
        fillcolor=TUBE_COLOUR,
        hoverinfo="skip",
        **look,
    )
