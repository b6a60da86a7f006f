"""Compiled search for peaks of ratios between successive times."""

from __future__ import annotations

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.kernel_cache import compiled


@compiled()
def find_peaks(
    values: FloatArray, zero: FloatArray, room: FloatArray, threshold: float
) -> tuple[IntArray, FloatArray]:
    """Find where the parabola through three successive ratios exceeds a threshold at its top.

    The ratios are `(value - zero) / room`. A parabola without a top between its outer times has its
    highest value at an end, which is a ratio. Returns the indices of the middle ratios as rows
    (time, interval, column), (m, 3), and the heights of the tops, (m,).

    - `values`: values at all times, (times, intervals, columns).
    - `zero`, `room`: origin and range of the values of each column, (columns,) each.
    """
    times, intervals, columns = values.shape
    places = np.empty((16, 3), np.int64)
    heights = np.empty(16)
    count = 0
    for i in range(1, times - 1):
        for k in range(intervals):
            for column in range(columns):
                before = values[i - 1, k, column]
                middle = values[i, k, column]
                after = values[i + 1, k, column]
                curvature = before - 2 * middle + after
                tilt = (after - before) / 2
                # The ratio decreases with the value if the room is negative.
                bend = curvature if room[column] > 0.0 else -curvature
                if not (bend < 0.0 and abs(tilt) < -bend):
                    continue
                top = middle - tilt**2 / (2 * curvature)
                height = (top - zero[column]) / room[column]
                if not height > threshold:
                    continue
                if count == len(heights):
                    # The arrays are full, so their sizes are doubled.
                    places = np.concatenate((places, places))
                    heights = np.concatenate((heights, heights))
                places[count, 0] = i
                places[count, 1] = k
                places[count, 2] = column
                heights[count] = height
                count += 1
    return places[:count], heights[:count]
