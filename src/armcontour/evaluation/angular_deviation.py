"""Angles between the tool and the required tool orientation of a path."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from armcontour._checks import FloatArray
from armcontour.frames import log
from armcontour.geometry import Orientation, Path, Projection, angle_between

# Samples of the path in the search for other points of it near the tool.
PLACES = 5000


def angle_off(orientation: Orientation, s: FloatArray, turned: FloatArray) -> FloatArray:
    """Angle between the tool and the required tool orientation [rad], (n,).

    The angle is that between the tool axes if the path prescribes only an axis.

    Args:
        orientation: The required tool orientation.
        s: Arc lengths of the tool on the path [m], (n,).
        turned: The tool's axes as columns, (n, 3, 3).
    """
    wanted = orientation(s)
    if orientation.axis_only:
        return angle_between(turned[:, :, 2], wanted[:, :, 2])
    return np.asarray(np.linalg.norm(log(wanted @ np.swapaxes(turned, 1, 2)), axis=1))


def least_off(
    path: Path,
    tool: FloatArray,
    nearest: Projection,
    turned: FloatArray,
    allowed: float,
    reach: float,
) -> FloatArray:
    """Angle between the tool and the required tool orientation nearby on the path [rad], (n,).

    Where the path crosses itself or closes, the tool may follow another point of the path than the
    nearest one. So the smallest angle to all points within `reach` counts. Angles that cannot be
    the largest one are not reduced in this way.

    Args:
        path: The path, with a tool orientation.
        tool: Tool points [m], (n, 3).
        nearest: Nearest points of the path.
        turned: The tool's axes as columns, (n, 3, 3).
        allowed: Angles up to this one are returned as they are [rad].
        reach: Largest distance of the tool from the point of the path that it follows [m].
    """
    assert path.orientation is not None
    angle = angle_off(path.orientation, nearest.s, turned)
    if not (angle > allowed).any():
        return angle
    s = np.linspace(0.0, path.length, PLACES)
    tree, gap = cKDTree(path(s)), float(s[1])
    worst = allowed
    for i in np.argsort(-angle).tolist():
        if angle[i] <= worst:
            break
        near = s[tree.query_ball_point(tool[i], max(reach, nearest.distance[i]) + gap)]
        others = near[np.abs(near - nearest.s[i]) > 2 * gap]
        if len(others):
            fits = angle_off(path.orientation, others, np.tile(turned[i], (len(others), 1, 1)))
            # Between two samples the angle may be smaller by the rotation along the gap.
            fits -= gap * np.linalg.norm(path.orientation.rates(others)[0], axis=1)
            angle[i] = min(angle[i], max(0.0, float(fits.min())))
        worst = max(worst, float(angle[i]))
    return angle
