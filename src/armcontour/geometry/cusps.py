"""Cusps of a curve: parameter values at which its derivative vanishes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from armcontour._checks import BoolArray, FloatArray, IntArray
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


Curves = Callable[[IntArray, FloatArray, int], FloatArray]


def split_at_cusps(
    curves: Curves, breaks: FloatArray, rows: IntArray
) -> tuple[FloatArray, IntArray, BoolArray]:
    """Add the parameter values between breaks at which the derivative of a curve vanishes.

    Args:
        curves: `curves(row, t, order)` gives points (order 0) or derivatives (order 1) of the
            curves `row` at `t`, (n, dimension).
        breaks: Parameter values, increasing along each curve, (n,).
        rows: Curve of each break, ascending, (n,).

    Returns:
        The breaks with the added ones, their curves, and a mask of the added ones.
    """
    row, low, high, most = _bracket_minima(curves, breaks, rows)
    if len(low) == 0:
        return breaks, rows, np.zeros(len(breaks), dtype=bool)
    at, speed = _minimize_speed(curves, row, low, high)
    found = speed <= STILL * most
    together = np.concatenate([breaks, at[found]])
    curve = np.concatenate([rows, row[found]])
    order = np.lexsort([together, curve])
    added = order >= len(breaks)
    together, curve = together[order], curve[order]
    # A value found at a break is that break.
    kept = np.concatenate([[True], (np.diff(together) > 0) | (np.diff(curve) > 0)])
    return together[kept], curve[kept], added[kept]


def _bracket_minima(
    curves: Curves, breaks: FloatArray, rows: IntArray
) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
    """Curves, lower and upper ends of brackets of speed minima, and the largest speed of each."""
    one = np.flatnonzero(rows[:-1] == rows[1:])
    row, begin, end = rows[one], breaks[one], breaks[one + 1]
    places = begin[:, None] + (end - begin)[:, None] * PLACES
    places = np.minimum(places, np.nextafter(end, -np.inf)[:, None])
    every = np.repeat(row, len(PLACES))
    speed = length(curves(every, places.ravel(), 1)).reshape(places.shape)
    inner = speed[:, 1:-1]
    most = inner.max(axis=1)
    least = (inner <= speed[:, :-2]) & (inner <= speed[:, 2:]) & (inner < SLOW * most[:, None])
    i, k = np.nonzero(least)
    return row[i], places[i, k], places[i, k + 2], most[i]


def _minimize_speed(
    curves: Curves, row: IntArray, low: FloatArray, high: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Parameter of the least speed in each bracket, and that speed, by golden-section search."""
    low, high = low.copy(), high.copy()
    for _ in range(STEPS):
        span = GOLDEN * (high - low)
        left, right = high - span, low + span
        falls = length(curves(row, left, 1)) > length(curves(row, right, 1))
        low, high = np.where(falls, left, low), np.where(falls, high, right)
    middle = (low + high) / 2
    return middle, length(curves(row, middle, 1))
