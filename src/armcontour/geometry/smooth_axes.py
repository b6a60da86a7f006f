"""Directions of the tool axis that turn smoothly, within an angle of measured ones."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from armcontour.core import checks
from armcontour.core._banded import solve_banded
from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.frames import angle_between

# Weights of smoothness, for waypoints one apart: the tool turns evenly with the largest of them.
# They are bisected on a logarithmic scale in so many steps.
WEAKEST, STRONGEST, BISECTIONS = 1e-6, 1e14, 40
# Ends nearer than this, and axes that differ by less, belong together [m or 1].
SAME = 1e-9


def smooth_axes(points: npt.ArrayLike, axes: npt.ArrayLike, tolerance: float) -> FloatArray:
    """Directions that turn as smoothly as they can within an angle of the given ones.

    A smoothing spline: it minimizes the squares of what the directions change by and, with a
    weight, of their second derivatives along the points; the weight is the largest one with which
    every direction is within the tolerance. A closed path stays closed.

    Args:
        points: Points of a path, which differ from their neighbours [m], (n, dimension).
        axes: Directions at the points, (n, 3).
        tolerance: Largest angle between a direction and the given one [rad].

    Returns:
        Unit vectors, (n, 3).

    Raises:
        InvalidInput: The tolerance is negative, neighbours are the same point, or a direction has
            no length.
    """
    at, given = checks.check_numbers("points", points), checks.check_numbers("axes", axes)
    checks.not_negative("tolerance of axes", tolerance, "rad")
    steps, size = np.linalg.norm(np.diff(at, axis=0), axis=1), np.linalg.norm(given, axis=1)
    if not (steps > 0).all() or not (size > 0).all():
        raise InvalidInput("Smooth axes need points that differ, and directions with a length.")
    unit: FloatArray = np.asarray(given / size[:, None])
    if len(at) < 3 or tolerance == 0:
        return unit
    ends = np.linalg.norm(at[-1] - at[0]), np.linalg.norm(unit[-1] - unit[0])
    closed = max(ends) <= SAME
    # Three rounds, of which the middle one knows of no ends.
    s = np.append(0.0, np.cumsum(np.tile(steps, 3) if closed else steps)) / steps.mean()
    rounds = np.concatenate([np.tile(unit[:-1], (3, 1)), unit[:1]]) if closed else unit
    first = len(steps) if closed else 0

    def smooth(weight: float) -> FloatArray:
        found = _solve(s, rounds, weight)[first : first + len(unit)]
        if closed:
            found[-1] = found[0]
        return np.asarray(found / np.linalg.norm(found, axis=1, keepdims=True))

    best, low, high = unit, np.log(WEAKEST), np.log(STRONGEST)
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        found = smooth(float(np.exp(middle)))
        if np.isfinite(found).all() and angle_between(found, unit).max() <= tolerance:
            best, low = found, middle
        else:
            high = middle
    return best


def _solve(s: FloatArray, values: FloatArray, weight: float) -> FloatArray:
    """Values that are near the given ones and bend little, (n, columns).

    Args:
        s: Places, increasing, (n,).
        values: The given values, (n, columns).
        weight: Weight of the squares of second derivatives.
    """
    h = np.diff(s)
    width = (h[:-1] + h[1:]) / 2
    rows = np.stack([1 / h[:-1], -1 / h[:-1] - 1 / h[1:], 1 / h[1:]], axis=1) / width[:, None]
    bands = np.zeros((len(s), 3))
    bands[:, 0] = 1.0
    for i in range(3):
        for j in range(i, 3):
            add = weight * width * rows[:, i] * rows[:, j]
            bands[i : len(s) - 2 + i, j - i] += add
    right = np.array(values)
    solve_banded(bands, right)
    return right
