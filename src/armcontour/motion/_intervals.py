"""Compiled times of intervals of a law: the path acceleration is linear in s on each."""

from __future__ import annotations

import math

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.kernels import compiled

# Below this size of slope times squared time a series is exact.
SMALL = 1e-4


@compiled(inner=True)
def interval_time(width: float, begin: float, end: float, slope: float) -> float:
    """Duration of one interval, see `interval_times`."""
    simple = 2 * width / (begin + end)
    z = slope * simple * simple / 4
    if abs(z) < SMALL:
        return simple * (1 + z * (1 / 3 + z * (1 / 5 + z * (1 / 7 + z / 9))))
    size = math.sqrt(abs(z))
    return simple * (math.atanh(size) if z > 0 else math.atan(size)) / size


@compiled()
def interval_times(
    width: FloatArray, begin: FloatArray, end: FloatArray, slope: FloatArray
) -> FloatArray:
    """Durations of intervals with a path acceleration linear in s [s], (n,).

    `(2 / k) atanh(k width / (begin + end))` with `k² = slope`.

    Args:
        width: Lengths of the intervals [m], (n,).
        begin: Path speeds at the starts [m/s], (n,).
        end: Path speeds at the ends [m/s], (n,).
        slope: Slopes of dds over s [1/s²], (n,).
    """
    times = np.empty(len(width))
    for i in range(len(width)):
        times[i] = interval_time(width[i], begin[i], end[i], slope[i])
    return times


@compiled()
def write_law(
    s: FloatArray,
    x: FloatArray,
    slope: FloatArray,
    breaks: FloatArray,
    ds: FloatArray,
    dds: FloatArray,
) -> int:
    """Write the law of squares of path speeds; return the first interval at rest, or -1.

    Args:
        s: Arc lengths at the breaks [m], (n + 1,).
        x: ds² at the breaks [m²/s²], (n + 1,).
        slope: Slopes of dds over s [1/s²], (n,).
        breaks: Takes the breaks [s], (n + 1,).
        ds: Takes the path speeds at the starts of the intervals [m/s], (n,).
        dds: Takes the path accelerations there [m/s²], (n,).
    """
    stuck, begin, breaks[0] = -1, math.sqrt(x[0]), 0.0
    for i in range(len(slope)):
        width, end = s[i + 1] - s[i], math.sqrt(x[i + 1])
        if begin + end == 0.0 and stuck < 0:
            stuck = i
        ds[i], dds[i] = begin, (x[i + 1] - x[i]) / (2 * width) - slope[i] * width / 2
        breaks[i + 1] = breaks[i] + interval_time(width, begin, end, slope[i])
        begin = end
    return stuck
