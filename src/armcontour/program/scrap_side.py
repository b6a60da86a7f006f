"""The scrap side of contours: inside of holes, outside of outer contours."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armcontour._checks import BoolArray, FloatArray
from armcontour.geometry import Path
from armcontour.program.moves import Contour

# Points that represent a closed contour, besides its vertices.
PLACES = 64


def waste_sides(contours: Sequence[Contour], up: FloatArray) -> list[str]:
    """The scrap side of every contour in its direction of travel, "left" or "right".

    Closed contours inside an odd number of other contours of their layer are holes. The scrap side
    of open contours is "left".

    Args:
        contours: The contours in their direction of travel.
        up: In space, the direction from which the contours are viewed, (3,).
    """
    closed = [i for i, x in enumerate(contours) if x.closed]
    outlines = {i: _outline(contours[i].path, up) for i in closed}
    sides = ["left"] * len(contours)
    starts = np.array([outlines[i][0] for i in closed]).reshape(len(closed), 2)
    depth = np.zeros(len(closed), dtype=int)
    for i in closed:
        same = np.array([contours[i].layer == contours[k].layer and i != k for k in closed])
        depth += same & _within(starts, outlines[i])
    for i, deep in zip(closed, depth.tolist(), strict=True):
        inside_is_left = _area(outlines[i]) > 0
        hole = deep % 2 == 1
        sides[i] = "left" if hole == inside_is_left else "right"
    return sides


def _outline(path: Path, up: FloatArray) -> FloatArray:
    """Points along a closed path, projected along `up`, (n, 2)."""
    points = path(np.union1d(path.breaks[:-1], np.linspace(0, path.length, PLACES)[:-1]))
    if path.dimension == 2:
        return points
    across = np.eye(3)[int(np.argmin(np.abs(up)))]
    first = np.cross(across, up)
    first /= np.linalg.norm(first)
    return np.asarray(points @ np.stack([first, np.cross(up, first)], axis=1))


def _area(outline: FloatArray) -> float:
    """Area of a closed outline [m²], positive if the outline is counter-clockwise."""
    x, y = (outline - outline[0]).T
    return float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y) / 2)


def _within(points: FloatArray, outline: FloatArray) -> BoolArray:
    """Mask of the points inside an outline, from which a ray crosses it an odd number of times."""
    a, b = outline, np.roll(outline, -1, axis=0)
    inside = np.zeros(len(points), dtype=bool)
    for (ax, ay), (bx, by) in zip(a.tolist(), b.tolist(), strict=True):
        if ay == by:
            continue
        between = (points[:, 1] >= min(ay, by)) & (points[:, 1] < max(ay, by))
        at = ax + (points[:, 1] - ay) * (bx - ax) / (by - ay)
        inside ^= between & (points[:, 0] < at)
    return inside
