"""Places: which point of the objective each point of another path belongs to."""

from __future__ import annotations

import numpy as np

from armcontour._checks import FloatArray
from armcontour._sampling import number_parts
from armcontour.geometry import Path, Proof, Tube

# Places are found at the ends of segments, and so often along arcs [rad].
TURN = 0.05
# A point may lie this share of the tolerance beside its place, along the objective.
BESIDE = 0.05


def match(tube: Tube, path: Path, places: FloatArray, reach: FloatArray | float) -> FloatArray:
    """Places at which points of a path are nearest to the objective, in order, (m, 2).

    The point of the path that is nearest to a corner passes it: points before it belong to the
    stretch before the corner, points after it to the stretch after the corner.

    Args:
        tube: The tube around the objective.
        path: The path.
        places: Arc lengths on the objective and on the path that nearly belong together [m],
            increasing, (n, 2).
        reach: How far the nearest point may be from the given place along the objective [m], one
            number or one per given place, (n,).
    """
    reaches = np.broadcast_to(np.asarray(reach, dtype=np.float64), len(places))
    _, passed = tube.nearest_to_corners(path, places, reaches)
    passed = np.maximum.accumulate(passed)
    count = np.maximum(np.ceil(path.curvatures * path.lengths / TURN).astype(np.intp), 1)
    segment, number = number_parts(count)
    even = path.breaks[segment] + path.lengths[segment] * number / count[segment]
    # The points that pass a corner are on both sides of it.
    s = np.concatenate([even, [path.length], passed, passed])
    corner = np.arange(len(passed))
    stretch = np.searchsorted(passed, s[: len(even) + 1])
    stretch = np.concatenate([stretch, corner, corner + 1])
    order = np.lexsort((stretch, s))
    s, stretch = s[order], stretch[order]
    guess, around = (np.interp(s, places[:, 1], x) for x in (places[:, 0], reaches))
    corners = np.concatenate([[0.0], tube.objective.breaks[tube.vertex], [tube.breaks[-1]]])
    low = np.clip(guess - around, corners[stretch], corners[stretch + 1])
    high = np.clip(guess + around, corners[stretch], corners[stretch + 1])
    at = np.maximum.accumulate(tube.nearest(path(s), low, high))
    at[0], at[-1] = 0.0, tube.objective.length
    return np.stack([at, s], axis=1)


def prove(tube: Tube, path: Path, places: FloatArray) -> Proof:
    """Proof that every point of a path is within the tolerance of its place.

    Args:
        tube: The tube around the objective.
        path: The path.
        places: Its places, as from `match`, (m, 2).
    """
    last = len(tube) - 1
    piece = np.clip(np.searchsorted(tube.breaks, places[:, 0], side="right") - 1, 0, last)
    return tube.prove(path, places, BESIDE * tube.tolerance[piece])
