"""Interpolation, differences and noise of sampled motions; numbering of parts."""

from __future__ import annotations

import numpy as np

from armcontour.core.checks import FloatArray, IntArray

# Ratio of the standard deviation of normally distributed values to the median of their magnitudes.
DEVIATION_PER_MEDIAN = 1.4826


def interpolate(times: FloatArray, t: FloatArray, values: FloatArray) -> FloatArray:
    """Columns of samples, linearly interpolated at `times`, constant outside, (m, columns)."""
    if len(times):
        # Only the needed samples are copied, so that short parts of long motions are fast.
        first, last = np.searchsorted(t, (times.min(), times.max()))
        neighbours = slice(max(first - 1, 0), last + 1)
        t = t[neighbours]
        values = values[neighbours]
    return np.stack([np.interp(times, t, x) for x in values.T], axis=1)


def differences(values: FloatArray, order: int) -> FloatArray:
    """Differences of an order; before the first and after the last value, values are constant."""
    around = [(order - 1, order - 1), *[(0, 0)] * (values.ndim - 1)]
    return np.diff(np.pad(values, around, mode="edge"), order, axis=0)


def integrate(values: FloatArray, t: FloatArray) -> float:
    """Integral of values over time by the trapezoidal rule; `numpy.trapezoid` needs numpy 2."""
    return float((np.diff(t) * (values[1:] + values[:-1]) / 2.0).sum())


def subdivide(values: FloatArray, count: int) -> FloatArray:
    """Increasing values with `count` - 1 evenly spaced values inserted between neighbours."""
    inner = values[:-1, None] + np.arange(count) / count * np.diff(values)[:, None]
    return np.append(inner.ravel(), values[-1])


def spread_indices(count: int, most: int) -> IntArray:
    """At most `most` evenly distributed indices below `count`, with both ends; all if possible."""
    return np.unique(np.linspace(0, count - 1, most).astype(np.intp))


def number_parts(count: IntArray) -> tuple[IntArray, IntArray]:
    """Index of each part's item, and of each part in its item, for `count` parts per item."""
    whole = np.repeat(np.arange(len(count)), count)
    return whole, np.arange(len(whole)) - np.repeat(np.cumsum(count) - count, count)


def white_noise(values: FloatArray, order: int = 3) -> FloatArray:
    """Standard deviation of the white noise in regular samples of smooth motion, (...)."""
    # The deviation is computed from differences of a high order, to which smooth motion contributes
    # little. The median ignores outliers and short disturbances, such as friction at a reversal. If
    # most differences are 0, as with a coarse encoder, their root mean square is used.
    if len(values) <= order:
        return np.zeros(values.shape[1:])
    differences = np.abs(np.diff(values, order, axis=0))
    deviation = DEVIATION_PER_MEDIAN * np.median(differences, axis=0)
    deviation = np.where(deviation > 0, deviation, np.sqrt(np.mean(differences**2, axis=0)))
    return np.asarray(deviation / np.linalg.norm(np.diff(np.pad([1.0], order), order)))
