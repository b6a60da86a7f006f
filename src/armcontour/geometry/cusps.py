"""Where a smooth parametrization stands still: the curve may turn back there, or have a cusp."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from armcontour._checks import BoolArray, FloatArray
from armcontour.geometry.biarcs import length

# Places in an interval at which the speed of the parametrization is looked at.
PLACES = np.linspace(0, 1, 33)
# A least speed up to this part of the largest is a standstill; above it the curve makes a tight
# turn, in a loop whose size is the square of that part.
STILL = 1e-6
# A least speed is looked for where the samples fall below this part of the largest.
SLOW = 0.5
# Steps of the golden section: the last digits of a minimum are not to be had.
STEPS = 45
GOLDEN = (np.sqrt(5) - 1) / 2


def split_at_cusps(
    curve: Callable[[FloatArray, int], FloatArray], breaks: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Breaks with those places added at which the derivative vanishes between them.

    Returns:
        The breaks, and which of them were added.
    """
    low, high, most = _slow_places(curve, breaks)
    if len(low) == 0:
        return breaks, np.zeros(len(breaks), dtype=bool)
    at, speed = _least(curve, low, high)
    found = at[speed <= STILL * most]
    together = np.concatenate([breaks, found])
    added = np.arange(len(together)) >= len(breaks)
    order = np.argsort(together, kind="stable")
    together, added = together[order], added[order]
    # One that is next to a break is that break.
    kept = np.concatenate([[True], np.diff(together) > 0])
    return together[kept], added[kept]


def _slow_places(
    curve: Callable[[FloatArray, int], FloatArray], breaks: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Brackets of the least speeds, and the largest speed of their intervals."""
    span = np.diff(breaks)
    places = breaks[:-1, None] + span[:, None] * PLACES
    places = np.minimum(places, np.nextafter(breaks[1:], -np.inf)[:, None])
    speed = length(curve(places.ravel(), 1)).reshape(places.shape)
    most = speed[:, 1:-1].max(axis=1)
    inner = speed[:, 1:-1]
    least = (inner <= speed[:, :-2]) & (inner <= speed[:, 2:]) & (inner < SLOW * most[:, None])
    i, k = np.nonzero(least)
    return places[i, k], places[i, k + 2], most[i]


def _least(
    curve: Callable[[FloatArray, int], FloatArray], low: FloatArray, high: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Where the speed is least between two places, and that speed, by the golden section."""
    low, high = low.copy(), high.copy()
    for _ in range(STEPS):
        span = GOLDEN * (high - low)
        left, right = high - span, low + span
        falls = length(curve(left, 1)) > length(curve(right, 1))
        low, high = np.where(falls, left, low), np.where(falls, high, right)
    middle = (low + high) / 2
    return middle, length(curve(middle, 1))
