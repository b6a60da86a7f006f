"""Interpolation, differences and noise of sampled motions; numbering of parts."""

from __future__ import annotations

import numpy as np

from armcontour.core.checks import FloatArray, IntArray

# Normally distributed values: standard deviation divided by the median magnitude.
DEVIATION_PER_MEDIAN = 1.4826


def interpolate(times: FloatArray, t: FloatArray, values: FloatArray) -> FloatArray:
    """Interpolate samples linearly at `times`, constant outside their range, (m, columns)."""
    if len(times):
        # Only the needed samples are copied, so that short parts of long motions are fast.
        first, last = np.searchsorted(t, (times.min(), times.max()))
        neighbours = slice(max(first - 1, 0), last + 1)
        t = t[neighbours]
        values = values[neighbours]
    return np.stack([np.interp(times, t, x) for x in values.T], axis=1)


def differences(values: FloatArray, order: int) -> FloatArray:
    """Return differences of an order, (n + order - 2, ...); a motion rests before and after.

    >>> differences(np.array([0.0, 1.0, 1.0]), 2)
    array([ 1., -1.,  0.])
    """
    around = [(order - 1, order - 1), *[(0, 0)] * (values.ndim - 1)]
    return np.diff(np.pad(values, around, mode="edge"), order, axis=0)


def integrate(values: FloatArray, t: FloatArray) -> float:
    """Integrate values over time by the trapezoidal rule; `numpy.trapezoid` needs numpy 2."""
    return float((np.diff(t) * (values[1:] + values[:-1]) / 2.0).sum())


def subdivide(values: FloatArray, count: int) -> FloatArray:
    """Insert `count` - 1 evenly spaced values between neighbours of increasing values.

    >>> subdivide(np.array([0.0, 1.0, 3.0]), 2)
    array([0. , 0.5, 1. , 2. , 3. ])
    """
    inner = values[:-1, None] + np.arange(count) / count * np.diff(values)[:, None]
    return np.append(inner.ravel(), values[-1])


def spread_indices(count: int, most: int) -> IntArray:
    """Return at most `most` evenly spaced indices below `count`, including both ends."""
    return np.unique(np.linspace(0, count - 1, most).astype(np.intp))


def number_parts(count: IntArray) -> tuple[IntArray, IntArray]:
    """Number the parts of items: item i is divided into `count[i]` parts.

    >>> number_parts(np.array([2, 3]))
    (array([0, 0, 1, 1, 1]), array([0, 1, 0, 1, 2]))

    Returns:
        For each part, the index of its item, and its own index within the item.
    """
    whole = np.repeat(np.arange(len(count)), count)
    return whole, np.arange(len(whole)) - np.repeat(np.cumsum(count) - count, count)


def white_noise(values: FloatArray, order: int = 3) -> FloatArray:
    """Return the standard deviation of white noise in regular samples of smooth motion, (...).

    Smooth motion contributes little to differences of a high order, so they are mostly noise. For
    noise with standard deviation σ, the difference of order n has the standard deviation σ |b|,
    where b are the binomial coefficients. The deviation follows from the median magnitude, which
    ignores outliers and short disturbances, such as friction at a reversal. If most differences
    are 0, as with a coarse encoder, it follows from their root mean square.
    """
    if len(values) <= order:
        return np.zeros(values.shape[1:])
    differences = np.abs(np.diff(values, order, axis=0))
    deviation = DEVIATION_PER_MEDIAN * np.median(differences, axis=0)
    deviation = np.where(deviation > 0, deviation, np.sqrt(np.mean(differences**2, axis=0)))
    return np.asarray(deviation / np.linalg.norm(np.diff(np.pad([1.0], order), order)))
