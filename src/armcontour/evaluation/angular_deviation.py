"""How far a tool is turned from how it is to be held."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from armcontour._checks import FloatArray
from armcontour.frames import log
from armcontour.geometry import Orientation, Path, Projection, angle_between

# Where a path comes back to itself is looked for at so many places.
PLACES = 5000


def angle_off(orientation: Orientation, s: FloatArray, turned: FloatArray) -> FloatArray:
    """Angle between tools and how they are to be held [rad], (n,); of axes, where these count.

    Args:
        orientation: How the tool is to be held.
        s: Arc lengths at which it is [m], (n,).
        turned: The tool's axes there as columns, (n, 3, 3).
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
    """As `angle_off` at the nearest places of a path that says how the tool is held.

    Where the path crosses or closes, the place that the tool is at may not be the nearest: the one
    within reach that fits best counts. Of the angles that are not allowed only the largest is
    looked at twice.

    Args:
        path: The path.
        tool: Places of the tool [m], (n, 3).
        nearest: The path's nearest places.
        turned: The tool's axes as columns, (n, 3, 3).
        allowed: Angles that need no second look [rad].
        reach: The tool may be this far from where it is to be [m].
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
            # Between two of these places the path may fit better by what it turns there.
            fits -= gap * np.linalg.norm(path.orientation.rates(others)[0], axis=1)
            angle[i] = min(angle[i], max(0.0, float(fits.min())))
        worst = max(worst, float(angle[i]))
    return angle
