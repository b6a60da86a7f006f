"""The compiled part of the optimal planner: what can be reached, backwards and then forwards.

The stage of interval i has x at its start and y at its end (both ds²). Its mean path acceleration
is `(y - x) / (2 width)`, and with the slope given beforehand that at its start is
`(y - x - shift) / (2 width)` and that at its end `(y - x + shift) / (2 width)`. Every row is then
linear in x and y, and every disc convex, so for a given y the allowed x form an interval, and its
upper end is a concave function of y.
"""

from __future__ import annotations

import math

import numpy as np

from armcontour._checks import FloatArray
from armcontour._kernels import compiled

# Largest number of cuts in the search for the best y of a stage, which takes a few.
MOST_CUTS = 80
# A start or end speed above the allowed one by at most this share counts as allowed: margins for
# the tolerance of the traced path and for rounding lower the limits a little.
PLAY = 1e-7
# Two interval ends that differ by at most this ratio differ by rounding only.
EDGE = 1e-13
# Relative rounding error of a row.
ROUNDING = 1e-15
# A row binds on an interval from this share of its bound on, if no ceiling is this near to binding.
BINDING = 0.98
BELOW_CEILING = 1 - 1e-6
# A skew is used only if the binding quantity changes by at most this share over the interval.
LARGEST_CHANGE = 0.1
# A coefficient of u below this share of that at the other end of its interval is rounding.
VANISHED = 1e-9


@compiled(inline="always")
def _of_x(
    y: float,
    half: float,
    a: FloatArray,
    b: FloatArray,
    low: FloatArray,
    high: FloatArray,
    margin: FloatArray,
    i: int,
    c0: float,
    c1: float,
    r: float,
    shift: float,
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
            known = q * y - (inertia * shift if end == 0 else -inertia * shift)
            if p == 0.0:
                slack = EDGE * abs(known)
                if known > high[end, i, k] - margin[i, k] + slack:
                    return -np.inf, -1.0, 0.0, 0.0
                if known < low[end, i, k] + margin[i, k] - slack:
                    return -np.inf, -1.0, 0.0, 0.0
                continue
            inverse = 1.0 / p
            first = (low[end, i, k] + margin[i, k] - known) * inverse
            second = (high[end, i, k] - margin[i, k] - known) * inverse
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
        # `_largest_y` makes sure that both roots exist, except for rounding.
        reach = math.sqrt(max(radius * radius - (c1 / half * y) * (c1 / half * y), 0.0))
        steep = (c1 / half) * (c1 / half) * y / max(reach, 1e-300)
        if y + shift + reach < upper:
            upper = y + shift + reach
            upper_slope = 1.0 - steep
        if y + shift - reach > lower:
            lower = y + shift - reach
            lower_slope = 1.0 + steep
        k2 = (c0 / half) * (c0 / half)
        moved = y - shift
        reach = math.sqrt(max(radius * radius * (1.0 + k2) - k2 * moved * moved, 0.0))
        steep = k2 * moved / max(reach, 1e-300)
        if (moved + reach) / (1.0 + k2) < upper:
            upper = (moved + reach) / (1.0 + k2)
            upper_slope = (1.0 - steep) / (1.0 + k2)
        if (moved - reach) / (1.0 + k2) > lower:
            lower = (moved - reach) / (1.0 + k2)
            lower_slope = (1.0 + steep) / (1.0 + k2)
    return upper, upper_slope, lower, lower_slope


@compiled()
def _largest_y(
    half: float,
    a: FloatArray,
    b: FloatArray,
    low: FloatArray,
    high: FloatArray,
    margin: FloatArray,
    i: int,
    c0: float,
    c1: float,
    r: float,
    shift: float,
) -> float:
    """Largest y for which the disc, and rows that do not depend on x, allow any x."""
    y = np.inf
    if r < np.inf:
        if c1 > 0.0:
            y = min(y, r / c1)
        if c0 > 0.0:
            y = min(y, shift + r / half * math.hypot(1.0, half / c0))
    for end in range(2):
        for k in range(a.shape[2]):
            inertia = a[end, i, k] * half
            p = b[end, i, k] - inertia if end == 0 else -inertia
            q = inertia if end == 0 else inertia + b[end, i, k]
            if p == 0.0 and q != 0.0:
                known = inertia * shift if end == 0 else -inertia * shift
                if q > 0.0:
                    y = min(y, (high[end, i, k] - margin[i, k] + known) / q)
                else:
                    y = min(y, (low[end, i, k] + margin[i, k] + known) / q)
    return max(y, 0.0)


@compiled(inline="always")
def _of_y(
    x: float,
    half: float,
    a: FloatArray,
    b: FloatArray,
    low: FloatArray,
    high: FloatArray,
    margin: FloatArray,
    i: int,
    c0: float,
    c1: float,
    r: float,
    shift: float,
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
            known = p * x - (inertia * shift if end == 0 else -inertia * shift)
            inverse = 1.0 / q
            # Where q is tiny and x at the row's edge, rounding must not decide on y.
            least = low[end, i, k] + margin[i, k]
            most = high[end, i, k] - margin[i, k]
            first = (least - ROUNDING * (abs(least) + abs(known)) - known) * inverse
            second = (most + ROUNDING * (abs(most) + abs(known)) - known) * inverse
            if q < 0.0:
                first, second = second, first
            upper = min(upper, second)
            lower = max(lower, first)
    if r < np.inf:
        radius = r / half
        reach = math.sqrt(max(radius * radius - (c0 / half * x) * (c0 / half * x), 0.0))
        upper = min(upper, x + shift + reach)
        lower = max(lower, x + shift - reach)
        k2 = (c1 / half) * (c1 / half)
        moved = x - shift
        reach = math.sqrt(max(radius * radius * (1.0 + k2) - k2 * moved * moved, 0.0))
        upper = min(upper, (moved + reach) / (1.0 + k2))
        lower = max(lower, (moved - reach) / (1.0 + k2))
    return upper, lower


@compiled()
def reach(
    width: FloatArray,
    a: FloatArray,
    b: FloatArray,
    low: FloatArray,
    high: FloatArray,
    margin: FloatArray,
    ceiling: FloatArray,
    c: FloatArray,
    radius: FloatArray,
    shifts: FloatArray,
    start: float,
    end: float,
) -> tuple[FloatArray, FloatArray, int]:
    """The largest x at every grid point that leads from `start` to `end`.

    Args:
        width: Interval lengths, (n,).
        a: Coefficients of u at interval starts and ends, (2, n, rows).
        b: Coefficients of x there, (2, n, rows).
        low: Lower bounds there, (2, n, rows).
        high: Upper bounds there, (2, n, rows).
        margin: Margin subtracted from both bounds, (n, rows).
        ceiling: Largest x at the grid points, (n + 1,).
        c: Coefficients of the discs, (2, n).
        radius: Radii of the discs, infinite for no disc, (n,).
        shifts: Slope of u over s times width², (n,).
        start: x at the first point; infinite for the largest that leads to the end.
        end: x at the last point.

    Returns:
        x (n + 1,); the largest x from which the end can be reached, (n + 1,); and the index of the
        first interval in which no motion is allowed, or -1.
    """
    n = len(width)
    most = np.empty(n + 1)
    x = np.empty(n + 1)
    most[n] = end
    for i in range(n - 1, -1, -1):
        half = 0.5 / width[i]
        cap = ceiling[i]
        y = most[i + 1]
        c0, c1, r, shift = c[0, i], c[1, i], radius[i], shifts[i]
        if r < np.inf:
            y = min(y, _largest_y(half, a, b, low, high, margin, i, c0, c1, r, shift))
        up, slope, down, down_slope = _of_x(y, half, a, b, low, high, margin, i, c0, c1, r, shift)
        if up == -np.inf:
            y = min(y, _largest_y(half, a, b, low, high, margin, i, c0, c1, r, shift))
            up, slope, down, down_slope = _of_x(
                y, half, a, b, low, high, margin, i, c0, c1, r, shift
            )
        # Too fast an end of the interval may leave no x at all. The room for x is concave in y, so
        # Newton's steps come down to its edge without passing over it.
        for _ in range(MOST_CUTS):
            if up >= down - EDGE * abs(down) and up >= 0.0:
                break
            closing = slope - down_slope if up >= 0.0 else slope
            gap = up - down if up >= 0.0 else up
            if up == -np.inf or closing >= 0.0:
                y *= 0.5
            else:
                # On a steep edge rounding can cancel the step, but y must decrease.
                y = min(max(y - gap / closing, 0.0), y * (1 - EDGE))
            up, slope, down, down_slope = _of_x(
                y, half, a, b, low, high, margin, i, c0, c1, r, shift
            )
        else:
            return x, most, i
        # The largest x is at this y, or, if x rises as y falls, at the top of a concave function.
        if up < cap and slope < 0.0:
            y_left = 0.0
            x_left, slope_left, down_left, _ = _of_x(
                y_left, half, a, b, low, high, margin, i, c0, c1, r, shift
            )
            if not (x_left >= down_left and x_left >= 0.0):
                return x, most, i
            y_right, x_right, slope_right = y, up, slope
            best = max(x_left, up)
            for _ in range(MOST_CUTS):
                if slope_left <= 0.0 or slope_left <= slope_right or best >= cap:
                    break
                y = (x_right - x_left + slope_left * y_left - slope_right * y_right) / (
                    slope_left - slope_right
                )
                if y <= y_left or y >= y_right:
                    break
                if x_left + slope_left * (y - y_left) <= best * (1 + EDGE):
                    break
                up, slope, down, down_slope = _of_x(
                    y, half, a, b, low, high, margin, i, c0, c1, r, shift
                )
                best = max(best, up)
                if slope > 0.0:
                    y_left, x_left, slope_left = y, up, slope
                else:
                    y_right, x_right, slope_right = y, up, slope
            up = best
        most[i] = min(up, cap)
    if start == np.inf:
        start = most[0]
    if start > most[0] * (1 + PLAY):
        return x, most, 0
    x[0] = min(start, most[0])
    for i in range(n):
        half = 0.5 / width[i]
        up, down = _of_y(
            x[i], half, a, b, low, high, margin, i, c[0, i], c[1, i], radius[i], shifts[i]
        )
        y = min(up, most[i + 1])
        # Both ends of the interval of y are rounded; next to the edge of a disc under a root.
        slack = 1e-12 * (abs(down) + most[i + 1] + x[i])
        if radius[i] < np.inf:
            slack += 1e-7 * radius[i] / half
        if y < down - slack:
            return x, most, i
        x[i + 1] = max(y, 0.0)
    return x, most, -1


@compiled()
def skews(
    width: FloatArray,
    a: FloatArray,
    b: FloatArray,
    low: FloatArray,
    high: FloatArray,
    ceiling: FloatArray,
    c: FloatArray,
    radius: FloatArray,
    x: FloatArray,
) -> FloatArray:
    """Slopes of dds over s with which the binding constraint binds on whole intervals, (n,).

    Args:
        width: Interval lengths, (n,).
        a: Coefficients of u at interval starts and ends, (2, n, rows).
        b: Coefficients of x there, (2, n, rows).
        low: Lower bounds there, (2, n, rows).
        high: Upper bounds there, (2, n, rows).
        ceiling: Largest x at the grid points, (n + 1,).
        c: Coefficients of the discs, (2, n).
        radius: Radii of the discs, infinite for no disc, (n,).
        x: A plan, (n + 1,).
    """
    n = len(width)
    skew = np.zeros(n)
    for i in range(n):
        first, last = x[i], x[i + 1]
        if first == 0.0 or last == 0.0:
            continue
        if first > ceiling[i] * BELOW_CEILING or last > ceiling[i + 1] * BELOW_CEILING:
            continue
        u = (last - first) / (2.0 * width[i])
        most = BINDING
        for k in range(a.shape[2]):
            inertia = min(abs(a[0, i, k]), abs(a[1, i, k]))
            if a[0, i, k] * a[1, i, k] <= 0.0 or inertia < VANISHED * abs(a[0, i, k] + a[1, i, k]):
                continue
            v0 = a[0, i, k] * u + b[0, i, k] * first
            v1 = a[1, i, k] * u + b[1, i, k] * last
            bound0 = high[0, i, k] if v0 > 0.0 else low[0, i, k]
            bound1 = high[1, i, k] if v0 > 0.0 else low[1, i, k]
            used = max(v0 / bound0, v1 / bound1)
            # On a tie the first one, so that rounding does not choose.
            if used > most * (1 + 1e-9):
                u0 = (bound0 - b[0, i, k] * first) / a[0, i, k]
                u1 = (bound1 - b[1, i, k] * last) / a[1, i, k]
                change = abs(a[0, i, k] * (u1 - u0))
                if change < LARGEST_CHANGE * abs(bound0):
                    most = used
                    skew[i] = (u1 - u0) / width[i]
        if radius[i] < np.inf:
            used = max(math.hypot(c[0, i] * first, u), math.hypot(c[1, i] * last, u)) / radius[i]
            left0 = radius[i] ** 2 - (c[0, i] * first) ** 2
            left1 = radius[i] ** 2 - (c[1, i] * last) ** 2
            if used > most and left0 > 0.0 and left1 > 0.0:
                change = math.copysign(1.0, u) * (math.sqrt(left1) - math.sqrt(left0))
                if abs(change) < LARGEST_CHANGE * radius[i]:
                    skew[i] = change / width[i]
    return skew
