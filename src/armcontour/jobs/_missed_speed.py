"""The compiled bound of the acceleration that the ends of a motion show."""

from __future__ import annotations

from armcontour._checks import FloatArray
from armcontour._kernels import compiled


@compiled()
def bound_mean_acceleration(
    breaks: FloatArray,
    s: FloatArray,
    ds: FloatArray,
    dds: FloatArray,
    slope: FloatArray,
    jerk: FloatArray,
    length: float,
    first: float,
) -> float:
    """A bound of ds² / 2 over the distance from the nearer end, beyond a first distance [m/s²].

    On every interval dds lies between its values at the ends. So from an end of an interval on,
    ds² / 2 grows by the larger of them times the distance at most: over the distance from the end
    of the path it stays below its value there and that larger one.

    Args:
        breaks: Times of the ends of the intervals [s], (n + 1,).
        s: Arc lengths there [m], (n + 1,).
        ds: Path speeds at the starts [m/s], (n,).
        dds: Path accelerations at the starts [m/s²], (n,).
        slope: Slopes of dds over s [1/s²], (n,).
        jerk: Slopes of dds over time [m/s³], (n,).
        length: Length of the path [m].
        first: The first distance [m].
    """
    found, n = 0.0, len(ds)
    for i in range(n):
        width, time = s[i + 1] - s[i], breaks[i + 1] - breaks[i]
        low = high = dds[i]
        end = dds[i] + slope[i] * width + jerk[i] * time
        low, high = min(low, end), max(high, end)
        before = ds[i] ** 2
        if i + 1 < n:
            after = ds[i + 1] ** 2
        else:
            # On an interval with a jerk dds is linear in time, and its mean over s is not known.
            after = before + 2 * width * (high if jerk[i] != 0.0 else (dds[i] + end) / 2)
        after = max(after, 0.0)
        most = min(before + 2 * max(high, 0.0) * width, after + 2 * max(-low, 0.0) * width)
        for side in range(2):
            near, far = (s[i], s[i + 1]) if side == 0 else (length - s[i + 1], length - s[i])
            if far <= first or near > length / 2:
                continue
            x, u = (before, high) if side == 0 else (after, -low)
            beyond = max(near, first)
            # Near the end of the path x may be a rounding error.
            growth = x / (2 * beyond) + max(u, 0.0)
            if near > 0.0:
                growth = min(growth, max(x / (2 * near), u))
            found = max(found, min(growth, most / (2 * beyond)))
    return found
