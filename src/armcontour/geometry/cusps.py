"""Cusps of a curve: parameter values at which its derivative vanishes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from armcontour._checks import BoolArray, FloatArray
from armcontour.geometry.biarcs import length

# Fractions of an interval at which the norm of the derivative ("speed") is sampled.
PLACES = np.linspace(0, 1, 33)
# The derivative vanishes if the least speed is at most this fraction of the largest. A larger least
# speed is a tight turn, in a loop whose relative size is the square of that fraction.
STILL = 1e-6
# Minima are refined if the sampled speed is below this fraction of the largest.
SLOW = 0.5
# Steps of the golden-section search; more would not give more digits of a minimum.
STEPS = 45
GOLDEN = (np.sqrt(5) - 1) / 2


def split_at_cusps(
    curve: Callable[[FloatArray, int], FloatArray], breaks: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Add the parameter values between breaks at which the derivative of a curve vanishes.

    Args:
        curve: `curve(t, order)` gives points (order 0) or derivatives (order 1), (n, dimension).
        breaks: Increasing parameter values, (n,).

    Returns:
        The breaks with the added ones, and a mask of the added ones.
    """
    low, high, most = _bracket_minima(curve, breaks)
    if len(low) == 0:
        return breaks, np.zeros(len(breaks), dtype=bool)
    at, speed = _minimize_speed(curve, low, high)
    found = at[speed <= STILL * most]
    together = np.concatenate([breaks, found])
    added = np.arange(len(together)) >= len(breaks)
    order = np.argsort(together, kind="stable")
    together, added = together[order], added[order]
    # A value found at a break is that break.
    kept = np.concatenate([[True], np.diff(together) > 0])
    return together[kept], added[kept]


def _bracket_minima(
    curve: Callable[[FloatArray, int], FloatArray], breaks: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Lower and upper ends of brackets of speed minima, and the largest speed of each interval."""
    span = np.diff(breaks)
    places = breaks[:-1, None] + span[:, None] * PLACES
    places = np.minimum(places, np.nextafter(breaks[1:], -np.inf)[:, None])
    speed = length(curve(places.ravel(), 1)).reshape(places.shape)
    most = speed[:, 1:-1].max(axis=1)
    inner = speed[:, 1:-1]
    least = (inner <= speed[:, :-2]) & (inner <= speed[:, 2:]) & (inner < SLOW * most[:, None])
    i, k = np.nonzero(least)
    return places[i, k], places[i, k + 2], most[i]


def _minimize_speed(
    curve: Callable[[FloatArray, int], FloatArray], low: FloatArray, high: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Parameter of the least speed in each bracket, and that speed, by golden-section search."""
    low, high = low.copy(), high.copy()
    for _ in range(STEPS):
        span = GOLDEN * (high - low)
        left, right = high - span, low + span
        falls = length(curve(left, 1)) > length(curve(right, 1))
        low, high = np.where(falls, left, low), np.where(falls, high, right)
    middle = (low + high) / 2
    return middle, length(curve(middle, 1))
