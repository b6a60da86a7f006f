"""Monotone piecewise cubic interpolation (PCHIP; Fritsch and Butland, 1984).

`scipy.interpolate.PchipInterpolator` has the same values, but its import takes 0.3 s, which is a
tenth of a short run.
"""

from __future__ import annotations

import numpy as np

from armcontour.core.checks import FloatArray


def interpolate_monotone(x: FloatArray, values: FloatArray, at: FloatArray) -> FloatArray:
    """Interpolate values, (n, ...), at increasing places `x`, (n,), at other places, (k,).

    Between two places the interpolant does not leave the range of their values.

    >>> interpolate_monotone(np.array([0.0, 1.0, 2.0]), np.array([0.0, 0.0, 1.0]), np.array([1.5]))
    array([0.3125])
    """
    i = np.clip(np.searchsorted(x, at, side="right") - 1, 0, len(x) - 2)
    slopes = monotone_slopes(x, values)
    width = _as_column(np.diff(x), values)
    chord = np.diff(values, axis=0) / width
    # Coefficients of the distance u from the start of the interval, its square and its cube
    excess = (slopes[:-1] + slopes[1:] - 2 * chord) / width
    second = (chord - slopes[:-1]) / width - excess
    third = excess / width
    u = _as_column(at - x[i], values)
    square = u * u
    return np.asarray(values[i] + slopes[i] * u + second[i] * square + third[i] * (square * u))


def monotone_slopes(x: FloatArray, values: FloatArray) -> FloatArray:
    """Return the slopes of the interpolant at the places `x`, (n, ...).

    Where the chords on both sides have the same sign, the slope is their harmonic mean, weighted by
    the widths of the intervals; elsewhere it is 0.

    - `x`, `values`: as in `interpolate_monotone`.
    """
    width = _as_column(np.diff(x), values)
    chord = np.diff(values, axis=0) / width
    if len(x) == 2:
        return np.concatenate([chord, chord])
    before = chord[:-1]
    after = chord[1:]
    weight_before = 2 * width[1:] + width[:-1]
    weight_after = width[1:] + 2 * width[:-1]
    slopes = np.zeros_like(values)
    # Division by a tiny chord overflows, and the slope is 0 there.
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        inverse = (weight_before / before + weight_after / after) / (weight_before + weight_after)
        monotone = np.sign(before) * np.sign(after) > 0
        slopes[1:-1] = np.where(monotone, 1.0 / inverse, 0.0)
    slopes[0] = _end_slope(width[0], width[1], chord[0], chord[1])
    slopes[-1] = _end_slope(width[-1], width[-2], chord[-1], chord[-2])
    return slopes


def _end_slope(
    width: FloatArray, next_width: FloatArray, chord: FloatArray, next_chord: FloatArray
) -> FloatArray:
    """Return the slope of the parabola through three points at the first one, (...), if monotone.

    A slope of the wrong sign becomes 0. If the chords turn, it is at most three times the first.

    - `width`, `chord`: those of the interval at the end.
    - `next_width`, `next_chord`: those of the interval next to it.
    """
    slope = ((2 * width + next_width) * chord - width * next_chord) / (width + next_width)
    turns = np.sign(chord) != np.sign(next_chord)
    slope = np.where(turns & (np.abs(slope) > 3.0 * np.abs(chord)), 3.0 * chord, slope)
    return np.where(np.sign(slope) == np.sign(chord), slope, 0.0)


def _as_column(x: FloatArray, values: FloatArray) -> FloatArray:
    """Return an array, (n,), with as many dimensions as `values`, (n, 1, ...)."""
    return x.reshape(-1, *[1] * (values.ndim - 1))
