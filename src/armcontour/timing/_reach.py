"""The compiled part of the optimal planner: what can be reached, backwards and then forwards.

The stage of interval i has x at its start and y at its end (both ds²), `u = (y - x) / (2 width)`.
Every row is then linear in x and y, and every disc convex, so for a given y the allowed x form an
interval, and its upper end is a concave function of y.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from armcontour._checks import FloatArray

# The search for the best y of a stage takes a few cuts; this many would mean it is broken.
MOST_CUTS = 80


@njit(cache=True, error_model="numpy", inline="always")
def _of_x(
    y: float,
    half: float,
    a: FloatArray,
    b: FloatArray,
    low: FloatArray,
    high: FloatArray,
    i: int,
    c0: float,
    c1: float,
    r: float,
) -> tuple[float, float, float, float]:
    """Interval of x for a given y: upper end, its slope in y, lower end, its slope."""
    upper = np.inf
    upper_slope = 0.0
    lower = -np.inf
    lower_slope = 0.0
    for end in range(2):
        for k in range(a.shape[2]):
            inertia = a[end, i, k] * half
            p = b[end, i, k] - inertia if end == 0 else -inertia
            q = inertia if end == 0 else inertia + b[end, i, k]
            if p == 0.0:
                if q * y > high[end, i, k] or q * y < low[end, i, k]:
                    return -np.inf, -1.0, 0.0, 0.0
                continue
            inverse = 1.0 / p
            first = (low[end, i, k] - q * y) * inverse
            second = (high[end, i, k] - q * y) * inverse
            if p < 0.0:
                first, second = second, first
            if second < upper:
                upper = second
                upper_slope = -q * inverse
            if first > lower:
                lower = first
                lower_slope = -q * inverse
    if r < np.inf:
        radius = r / half
        left = radius * radius - (c1 / half * y) * (c1 / half * y)
        if left < 0.0:
            return -np.inf, -1.0, 0.0, 0.0
        reach = math.sqrt(left)
        steep = (c1 / half) * (c1 / half) * y / max(reach, 1e-300)
        if y + reach < upper:
            upper = y + reach
            upper_slope = 1.0 - steep
        if y - reach > lower:
            lower = y - reach
            lower_slope = 1.0 + steep
        k2 = (c0 / half) * (c0 / half)
        left = radius * radius * (1.0 + k2) - k2 * y * y
        if left < 0.0:
            return -np.inf, -1.0, 0.0, 0.0
        reach = math.sqrt(left)
        steep = k2 * y / max(reach, 1e-300)
        if (y + reach) / (1.0 + k2) < upper:
            upper = (y + reach) / (1.0 + k2)
            upper_slope = (1.0 - steep) / (1.0 + k2)
        if (y - reach) / (1.0 + k2) > lower:
            lower = (y - reach) / (1.0 + k2)
            lower_slope = (1.0 + steep) / (1.0 + k2)
    return upper, upper_slope, lower, lower_slope


@njit(cache=True, error_model="numpy", inline="always")
def _of_y(
    x: float,
    half: float,
    a: FloatArray,
    b: FloatArray,
    low: FloatArray,
    high: FloatArray,
    i: int,
    c0: float,
    c1: float,
    r: float,
) -> tuple[float, float]:
    """Interval of y for a given x."""
    upper = np.inf
    lower = -np.inf
    for end in range(2):
        for k in range(a.shape[2]):
            inertia = a[end, i, k] * half
            p = b[end, i, k] - inertia if end == 0 else -inertia
            q = inertia if end == 0 else inertia + b[end, i, k]
            if q == 0.0:
                continue
            inverse = 1.0 / q
            first = (low[end, i, k] - p * x) * inverse
            second = (high[end, i, k] - p * x) * inverse
            if q < 0.0:
                first, second = second, first
            upper = min(upper, second)
            lower = max(lower, first)
    if r < np.inf:
        radius = r / half
        reach = math.sqrt(max(radius * radius - (c0 / half * x) * (c0 / half * x), 0.0))
        upper = min(upper, x + reach)
        lower = max(lower, x - reach)
        k2 = (c1 / half) * (c1 / half)
        reach = math.sqrt(max(radius * radius * (1.0 + k2) - k2 * x * x, 0.0))
        upper = min(upper, (x + reach) / (1.0 + k2))
        lower = max(lower, (x - reach) / (1.0 + k2))
    return upper, lower


@njit(cache=True, error_model="numpy")
def reach(
    width: FloatArray,
    a: FloatArray,
    b: FloatArray,
    low: FloatArray,
    high: FloatArray,
    ceiling: FloatArray,
    c: FloatArray,
    radius: FloatArray,
    start: float,
    end: float,
) -> tuple[FloatArray, FloatArray, int]:
    """The largest x at every grid point that leads from `start` to `end`.

    Args:
        width: Interval lengths, (n,).
        a: Coefficients of u at interval starts and ends, (2, n, rows).
        b: Coefficients of x, likewise.
        low: Lower bounds, likewise.
        high: Upper bounds, likewise.
        ceiling: Largest x at the grid points, (n + 1,).
        c: Coefficients of the discs, (2, n).
        radius: Their radii, infinite for none, (n,).
        start: x at the first point.
        end: x at the last point.

    Returns:
        x (n + 1,); the largest x from which the end can be reached, (n + 1,); and the number of the
        first interval without a way on, or -1.
    """
    n = len(width)
    most = np.empty(n + 1)
    x = np.empty(n + 1)
    most[n] = end
    for i in range(n - 1, -1, -1):
        half = 0.5 / width[i]
        cap = ceiling[i]
        y = most[i + 1]
        c0, c1, r = c[0, i], c[1, i], radius[i]
        up, slope, down, down_slope = _of_x(y, half, a, b, low, high, i, c0, c1, r)
        feasible = up >= down and up >= 0.0
        if feasible and (up >= cap or slope >= 0.0):
            most[i] = min(up, cap)
            continue
        if not feasible and up > -np.inf and slope - down_slope >= 0.0 and slope >= 0.0:
            return x, most, i
        # A lower y allows a larger x: find the top of a concave function by cutting.
        y_left = 0.0
        x_left, slope_left, down_left, _ = _of_x(y_left, half, a, b, low, high, i, c0, c1, r)
        if not (x_left >= down_left and x_left >= 0.0):
            return x, most, i
        y_right, x_right, slope_right = y, up, slope
        best = max(x_left, up if feasible else 0.0)
        right_known = feasible
        for _ in range(MOST_CUTS):
            if slope_left <= 0.0 or best >= cap:
                break
            if right_known and slope_left > slope_right:
                y = (x_right - x_left + slope_left * y_left - slope_right * y_right) / (
                    slope_left - slope_right
                )
                if x_left + slope_left * (y - y_left) <= best * (1 + 1e-13):
                    break
                y = min(max(y, y_left), y_right)
            else:
                y = 0.5 * (y_left + y_right)
            if y <= y_left or y >= y_right:
                break
            up, slope, down, down_slope = _of_x(y, half, a, b, low, high, i, c0, c1, r)
            if not (up >= down and up >= 0.0):
                y_right, right_known = y, False
                continue
            best = max(best, up)
            if slope > 0.0:
                y_left, x_left, slope_left = y, up, slope
            else:
                y_right, x_right, slope_right, right_known = y, up, slope, True
        most[i] = min(best, cap)
    x[0] = start
    if start > most[0] * (1 + 1e-12):
        return x, most, 0
    for i in range(n):
        half = 0.5 / width[i]
        up, down = _of_y(x[i], half, a, b, low, high, i, c[0, i], c[1, i], radius[i])
        y = min(up, most[i + 1])
        # Both ends of the interval of y are rounded.
        if y < down - 1e-9 * (abs(down) + most[i + 1]):
            return x, most, i
        x[i + 1] = max(y, 0.0)
    return x, most, -1
