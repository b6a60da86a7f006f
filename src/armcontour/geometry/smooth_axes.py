"""Directions of the tool axis that turn smoothly, within an angle of specified directions."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from armcontour.core import checks
from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.frames import angle_between
from armcontour.core.quintics import solve_banded

# Smallest and largest weight of smoothness, for a mean distance of 1 between points, and number of
# bisections on a logarithmic scale. With the largest weight the tool turns evenly.
WEAKEST, STRONGEST, BISECTIONS = 1e-6, 1e14, 40
# End points closer than this [m], and axes that differ by less than this [1], count as equal.
SAME = 1e-9


def smooth_axes(points: npt.ArrayLike, axes: npt.ArrayLike, tolerance: float) -> FloatArray:
    """Unit vectors that turn smoothly within an angle of the specified directions, (n, 3)."""
    # A smoothing spline minimizes the squared changes of the directions plus, with a weight, their
    # squared second derivatives along the points. The weight is the largest with which every
    # direction is within the tolerance. A closed path stays closed.
    # `points`: points of a path, which differ from their neighbours [m], (n, dimension); `axes`:
    # specified directions at the points, (n, 3); `tolerance`: largest angle between a resulting and
    # the specified direction [rad].
    positions, directions = (
        checks.check_numbers("points", points),
        checks.check_numbers("axes", axes),
    )
    checks.not_negative("tolerance of axes", tolerance, "rad")
    steps, size = (
        np.linalg.norm(np.diff(positions, axis=0), axis=1),
        np.linalg.norm(directions, axis=1),
    )
    if not (steps > 0).all() or not (size > 0).all():
        raise InvalidInput(
            "Smooth axes need neighbouring points that differ, and directions that are not zero."
        )
    unit: FloatArray = np.asarray(directions / size[:, None])
    if len(positions) < 3 or tolerance == 0:
        return unit
    ends = np.linalg.norm(positions[-1] - positions[0]), np.linalg.norm(unit[-1] - unit[0])
    closed = max(ends) <= SAME
    # A closed path is repeated three times, because the ends then have no influence on the middle
    # round.
    s = np.append(0.0, np.cumsum(np.tile(steps, 3) if closed else steps)) / steps.mean()
    rounds = np.concatenate([np.tile(unit[:-1], (3, 1)), unit[:1]]) if closed else unit
    first = len(steps) if closed else 0

    def smooth(weight: float) -> FloatArray:
        smoothed = _solve(s, rounds, weight)[first : first + len(unit)]
        if closed:
            smoothed[-1] = smoothed[0]
        return np.asarray(smoothed / np.linalg.norm(smoothed, axis=1, keepdims=True))

    best, low, high = unit, np.log(WEAKEST), np.log(STRONGEST)
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        candidate = smooth(float(np.exp(middle)))
        if np.isfinite(candidate).all() and angle_between(candidate, unit).max() <= tolerance:
            best, low = candidate, middle
        else:
            high = middle
    return best


def _solve(s: FloatArray, values: FloatArray, weight: float) -> FloatArray:
    """Smoothing spline of values at increasing parameters `s`, (n, columns)."""
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
