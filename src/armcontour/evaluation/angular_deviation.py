"""Angles between the tool and the required tool orientation of a path."""

from __future__ import annotations

import numpy as np

from armcontour._checks import FloatArray
from armcontour.geometry import Orientation, Path, Projection
from armcontour.geometry.nearest import pack
from armcontour.geometry.orientation import turns_between

# So many of the largest angles are looked at first, and four times as many in each round after it.
FIRST = 100


def angle_off(orientation: Orientation, s: FloatArray, turned: FloatArray) -> FloatArray:
    """Angle between the tool and the required tool orientation [rad], (n,).

    The angle is that between the tool axes if the path prescribes only an axis.

    Args:
        orientation: The required tool orientation.
        s: Arc lengths of the tool on the path [m], (n,).
        turned: The tool's axes as columns, (n, 3, 3).
    """
    return turns_between(orientation(s), turned, axis_only=orientation.axis_only)


def least_off(
    path: Path, tool: FloatArray, nearest: Projection, turned: FloatArray, reach: float
) -> FloatArray:
    """Angle between the tool and the required tool orientation nearby on the path [rad], (n,).

    Where the path crosses itself, turns back or closes, the tool may follow another point of the
    path than the nearest one. So the smallest angle at the nearest points of all segments within
    `reach` counts, and at the ends of segments within it. Angles that cannot be the largest one are
    not reduced in this way.

    Args:
        path: The path, with a tool orientation.
        tool: Tool points [m], (n, 3).
        nearest: Nearest points of the path.
        turned: The tool's axes as columns, (n, 3, 3).
        reach: Largest distance of the tool from the point of the path that it follows [m].
    """
    from armcontour.evaluation._following import find_places

    assert path.orientation is not None
    angle = angle_off(path.orientation, nearest.s, turned)
    geometry, order = pack(path.segments), np.argsort(-angle)
    size, done, worst = FIRST, 0, -np.inf
    while done < len(order) and angle[order[done]] > worst:
        these = order[done : done + size]
        far = np.maximum(reach, nearest.distance[these])
        of, places = find_places(tool[these], geometry, far)
        fits = angle_off(path.orientation, np.minimum(places, path.length), turned[these[of]])
        np.minimum.at(angle, these[of], fits)
        worst = max(worst, float(angle[these].max()))
        done, size = done + size, size * 4
    return angle
