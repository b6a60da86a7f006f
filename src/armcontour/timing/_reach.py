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


@compiled(inner=True, inline="always")
def write_rows(
    half: float,
    shift: float,
    lost: float,
    row: int,
    a: FloatArray,
    b: FloatArray,
    low: FloatArray,
    high: FloatArray,
    bound: int,
    margin: FloatArray,
    first: int,
    i: int,
    out: FloatArray,
) -> float:
    """Write the rows of one interval, and return the largest share that margins take, as `pack`.

    Args:
        half: 1 over twice the width of the interval.
        shift: Slope of u over s times width².
        lost: The share so far.
        row: Index of the interval in a, b and the margin.
        a: As in `pack`, as the next three.
        b: See above.
        low: See above.
        high: See above.
        bound: Index of the interval in the bounds.
        margin: As in `pack`, as `first`.
        first: See above.
        i: Index of the interval in `out`.
        out: As in `pack`.
    """
    every, by_end = out.shape[2] // 2, low.shape[0] - 1
    turn = abs(shift) * half
    for end in range(2):
        at, begin = end * by_end, end * every + first
        # x counts at the start of the interval, or y at its end.
        start, last = (1.0, 0.0) if end == 0 else (0.0, 1.0)
        aside = shift * (start - last)
        for k in range(a.shape[2]):
            inertia, other, room = a[end, row, k] * half, b[end, row, k], margin[row, k]
            least, most = low[at, bound, k], high[at, bound, k]
            out[i, 0, begin + k] = start * other - inertia
            out[i, 1, begin + k] = last * other + inertia
            out[i, 2, begin + k] = least + room + inertia * aside
            out[i, 3, begin + k] = most - room + inertia * aside
            allowed = min(most, -least)
            if room > lost * allowed:
                lost = room / allowed
            if abs(a[end, row, k]) * turn > allowed - room:
                lost = max(lost, 1.0)
    return lost


@compiled()
def pack(
    width: FloatArray,
    shifts: FloatArray,
    a: FloatArray,
    b: FloatArray,
    low: FloatArray,
    high: FloatArray,
    margin: FloatArray,
    first: int,
    out: FloatArray,
    lost: FloatArray,
) -> None:
    """Write rows as bounds of `p x + q y`, from which both passes of `reach` take them.

    Args:
        width: Interval lengths, (n,).
        shifts: Slope of u over s times width², (n,).
        a: Coefficients of u at interval starts and ends, (2, n, rows).
        b: Coefficients of x there, (2, n, rows).
        low: Lower bounds there, (2, n, rows), or with 1 in place of 2, of n or of both where they
            do not differ.
        high: Upper bounds there, as `low`.
        margin: Margin subtracted from both bounds, (n, rows).
        first: Number of rows before these.
        out: Output: p, q, lower and upper bound of each row, all starts before all ends,
            (n, 4, 2 all rows).
        lost: Output: the largest share of any bound that margins take on each interval, if it is
            larger than what is there, (n,). The share is 1 where the change of u over half an
            interval alone would break a bound at rest, so that no state is certainly allowed.
    """
    by_interval = min(low.shape[1] - 1, 1)
    for i in range(a.shape[1]):
        half = 0.5 / width[i]
        lost[i] = write_rows(
            half, shifts[i], lost[i], i, a, b, low, high, i * by_interval, margin, first, i, out
        )


@compiled(inner=True)
def _of_x(
    y: float,
    rows: FloatArray,
    i: int,
    half: float,
    c0: float,
    c1: float,
    r: float,
    shift: float,
) -> tuple[float, float, float, float, int, int]:
    """Interval of x for a given y: upper end, its slope in y, lower end, its slope, both rows."""
    upper = np.inf
    upper_slope = 0.0
    lower = -np.inf
    lower_slope = 0.0
    above = below = -1
    for k in range(rows.shape[2]):
        p, known = rows[i, 0, k], rows[i, 1, k] * y
        down, up = rows[i, 2, k] - known, rows[i, 3, k] - known
        # A division only where the row is narrower than all before it.
        if p > 0.0:
            if up < upper * p:
                upper, upper_slope, above = up / p, -rows[i, 1, k] / p, k
            if down > lower * p:
                lower, lower_slope, below = down / p, -rows[i, 1, k] / p, k
        elif p < 0.0:
            if down > upper * p:
                upper, upper_slope, above = down / p, -rows[i, 1, k] / p, k
            if up < lower * p:
                lower, lower_slope, below = up / p, -rows[i, 1, k] / p, k
        else:
            slack = EDGE * abs(known)
            if up < -slack or down > slack:
                return -np.inf, -1.0, 0.0, 0.0, -1, -1
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
    return upper, upper_slope, lower, lower_slope, above, below


@compiled(inner=True)
def _largest_y(
    rows: FloatArray, i: int, half: float, c0: float, c1: float, r: float, shift: float
) -> float:
    """Largest y for which the disc, and rows that do not depend on x, allow any x."""
    y = np.inf
    if r < np.inf:
        if c1 > 0.0:
            y = min(y, r / c1)
        if c0 > 0.0:
            y = min(y, shift + r / half * math.hypot(1.0, half / c0))
    for k in range(rows.shape[2]):
        p, q = rows[i, 0, k], rows[i, 1, k]
        if p == 0.0 and q != 0.0:
            y = min(y, rows[i, 3, k] / q if q > 0.0 else rows[i, 2, k] / q)
    return max(y, 0.0)


@compiled(inner=True)
def _of_y(
    x: float,
    rows: FloatArray,
    i: int,
    half: float,
    c0: float,
    c1: float,
    r: float,
    shift: float,
) -> tuple[float, float, int]:
    """Interval of y for a given x, and the row that bounds it from above."""
    upper = np.inf
    lower = -np.inf
    above = -1
    for k in range(rows.shape[2]):
        q, known = rows[i, 1, k], rows[i, 0, k] * x
        # Where q is tiny and x at the row's edge, rounding must not decide on y.
        least, most = rows[i, 2, k], rows[i, 3, k]
        down = least - ROUNDING * (abs(least) + abs(known)) - known
        up = most + ROUNDING * (abs(most) + abs(known)) - known
        if q > 0.0:
            if up < upper * q:
                upper, above = up / q, k
            if down > lower * q:
                lower = down / q
        elif q < 0.0:
            if down > upper * q:
                upper, above = down / q, k
            if up < lower * q:
                lower = up / q
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
    return upper, lower, above


@compiled(inner=True)
def _breaks(x: float, y: float, rows: FloatArray, i: int, k: int, play: float) -> bool:
    """Whether x and y break row k of an interval by more than a share of its terms."""
    one, other = rows[i, 0, k] * x, rows[i, 1, k] * y
    slack = play * (abs(one) + abs(other))
    return bool((one + other > rows[i, 3, k] + slack) | (one + other < rows[i, 2, k] - slack))


@compiled(inner=True)
def _keeps(x: float, y: float, rows: FloatArray, i: int, first: int, second: int) -> bool:
    """Whether x and y keep all rows of an interval.

    Args:
        x: ds² at the start.
        y: ds² at the end.
        rows: The rows, as in `reach`.
        i: The interval.
        first: A row on whose edge x and y are, and the same limit at the other end of the interval
            perhaps too: these two may be broken by rounding; -1 for none.
        second: Another such row, or -1.
    """
    count, broken = rows.shape[2], 0
    for k in range(count):
        value = rows[i, 0, k] * x + rows[i, 1, k] * y
        broken += (value > rows[i, 3, k]) | (value < rows[i, 2, k])
    if broken:
        for k in (first, second):
            if k >= 0:
                for row in (k, (k + count // 2) % count):
                    broken -= _breaks(x, y, rows, i, row, 0.0)
                    broken += _breaks(x, y, rows, i, row, EDGE)
            if k == second or second == (k + count // 2) % count:
                break
    return broken == 0


@compiled(inner=True)
def _end_of_x(y: float, rows: FloatArray, i: int, k: int, side: float) -> tuple[float, float]:
    """The upper end (side 1) or lower end (-1) of x that one row leaves at y, and its slope."""
    p, q = rows[i, 0, k], rows[i, 1, k]
    if p == 0.0:
        return side * np.inf, 0.0
    return (rows[i, 3 if p * side > 0.0 else 2, k] - q * y) / p, -q / p


@compiled(inner=True)
def _guess_x(
    y: float, cap: float, rows: FloatArray, i: int, above: int, below: int
) -> tuple[float, bool]:
    """The largest x of an interval if the same rows bound it as in the one before.

    Args:
        y: Largest x at the end of the interval.
        cap: Ceiling of x.
        rows: The rows, as in `reach`.
        i: The interval.
        above: The row that bounds x from above; -1 if the ceiling does.
        below: The row that bounds x from below, where both bound y; -1 if y is not bounded.

    Returns:
        x, and whether all rows agree.
    """
    if above < 0:
        return cap, cap < np.inf and _keeps(cap, y, rows, i, -1, -1)
    # With a skew the same limit binds at both ends: which one is first is a matter of rounding.
    every = rows.shape[2] // 2
    x, slope = _end_of_x(y, rows, i, above, 1.0)
    other, steep = _end_of_x(y, rows, i, (above + every) % (2 * every), 1.0)
    if other < x:
        x, slope, above = other, steep, (above + every) % (2 * every)
    if below >= 0:
        least, rise = _end_of_x(y, rows, i, below, -1.0)
        other, steep = _end_of_x(y, rows, i, (below + every) % (2 * every), -1.0)
        if other > least:
            least, rise, below = other, steep, (below + every) % (2 * every)
        if x >= least or slope >= rise:
            return 0.0, False
        # Where both rows meet, y is this much smaller.
        less = (x - least) / (slope - rise)
        x, y = x - slope * less, y - less
    agrees = slope >= 0.0 and x >= 0.0 and y >= 0.0 and _keeps(x, y, rows, i, above, below)
    return min(x, cap), agrees


@compiled(inner=True)
def _end_of_y(x: float, rows: FloatArray, i: int, k: int) -> float:
    """The upper end of y that one row leaves at x, as in `_of_y`."""
    p, q = rows[i, 0, k], rows[i, 1, k]
    if q == 0.0:
        return np.inf
    bound, known, side = rows[i, 3 if q > 0.0 else 2, k], p * x, math.copysign(1.0, q)
    up: float = (bound + side * ROUNDING * (abs(bound) + abs(known)) - known) / q
    return up


@compiled()
def reach(
    width: FloatArray,
    rows: FloatArray,
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
        rows: What `pack` writes, (n, 4, rows).
        ceiling: Largest x at the grid points, (n + 1,).
        c: Coefficients of the discs, (2, n), or (2, 0) without discs.
        radius: Radii of the discs, infinite for no disc, (n,), or (0,) without discs.
        shifts: Slope of u over s times width², (n,).
        start: x at the first point; infinite for the largest that leads to the end.
        end: x at the last point.

    Returns:
        x (n + 1,); the largest x from which the end can be reached, (n + 1,); and the index of the
        first interval in which no motion is allowed, or -1.
    """
    n, discs = len(width), len(radius) > 0
    c0, c1, r = 0.0, 0.0, np.inf
    guesses, above, below = False, -1, -1
    most = np.empty(n + 1)
    x = np.empty(n + 1)
    most[n] = end
    for i in range(n - 1, -1, -1):
        half = 0.5 / width[i]
        cap = ceiling[i]
        y = most[i + 1]
        shift = shifts[i]
        if discs:
            c0, c1, r = c[0, i], c[1, i], radius[i]
        elif guesses:
            most[i], agrees = _guess_x(y, cap, rows, i, above, below)
            if agrees:
                continue
        if r < np.inf:
            y = min(y, _largest_y(rows, i, half, c0, c1, r, shift))
        up, slope, down, down_slope, above, below = _of_x(y, rows, i, half, c0, c1, r, shift)
        if up == -np.inf:
            y = min(y, _largest_y(rows, i, half, c0, c1, r, shift))
            up, slope, down, down_slope, above, below = _of_x(y, rows, i, half, c0, c1, r, shift)
        # Too fast an end of the interval may leave no x at all. The room for x is concave in y, so
        # Newton's steps come down to its edge without passing over it.
        cut = guesses = False
        for _ in range(MOST_CUTS):
            if up >= down - EDGE * abs(down) and up >= 0.0:
                break
            cut = True
            closing = slope - down_slope if up >= 0.0 else slope
            gap = up - down if up >= 0.0 else up
            if up == -np.inf or closing >= 0.0:
                y *= 0.5
            else:
                # On a steep edge rounding can cancel the step, but y must decrease.
                y = min(max(y - gap / closing, 0.0), y * (1 - EDGE))
            up, slope, down, down_slope, above, below = _of_x(y, rows, i, half, c0, c1, r, shift)
        else:
            return x, most, i
        if not cut:
            below = -1
        if up >= cap and not cut:
            above = -1
        guesses = slope >= 0.0 and (above >= 0 or not cut)
        # The largest x is at this y, or, if x rises as y falls, at the top of a concave function.
        if up < cap and slope < 0.0:
            y_left = 0.0
            x_left, slope_left, down_left, _, _, _ = _of_x(y_left, rows, i, half, c0, c1, r, shift)
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
                up, slope, down, down_slope, above, below = _of_x(
                    y, rows, i, half, c0, c1, r, shift
                )
                best = max(best, up)
                if slope > 0.0:
                    y_left, x_left, slope_left = y, up, slope
                else:
                    y_right, x_right, slope_right = y, up, slope
            up, guesses = best, False
        most[i] = min(up, cap)
    if start == np.inf:
        start = most[0]
    if start > most[0] * (1 + PLAY):
        return x, most, 0
    x[0] = min(start, most[0])
    above, every = -1, rows.shape[2] // 2
    for i in range(n):
        half = 0.5 / width[i]
        if discs:
            c0, c1, r = c[0, i], c[1, i], radius[i]
        else:
            y, k = most[i + 1], -1
            if above >= 0:
                k = (above + every) % (2 * every)
                y = min(y, _end_of_y(x[i], rows, i, above), _end_of_y(x[i], rows, i, k))
            if y >= 0.0 and _keeps(x[i], y, rows, i, k, -1):
                x[i + 1] = y
                continue
        up, down, above = _of_y(x[i], rows, i, half, c0, c1, r, shifts[i])
        y = min(up, most[i + 1])
        # Both ends of the interval of y are rounded; next to the edge of a disc under a root.
        slack = 1e-12 * (abs(down) + most[i + 1] + x[i])
        if r < np.inf:
            slack += 1e-7 * r / half
        if y < down - slack:
            return x, most, i
        x[i + 1] = max(y, 0.0)
    return x, most, -1


@compiled()
def skew_along_rows(
    width: FloatArray,
    a: FloatArray,
    b: FloatArray,
    low: FloatArray,
    high: FloatArray,
    x: FloatArray,
    most: FloatArray,
    skew: FloatArray,
) -> None:
    """Slopes of dds over s with which the binding row binds on whole intervals.

    Args:
        width: Interval lengths, (n,).
        a: Coefficients of u at interval starts and ends, (2, n, rows).
        b: Coefficients of x there, (2, n, rows).
        low: Lower bounds there, as in `pack`.
        high: Upper bounds there, as in `pack`.
        x: A plan, (n + 1,).
        most: The largest use of any row on each interval so far, at first that from which on a row
            binds; infinite where no row is looked for, (n,). Changed in place.
        skew: The slope for that row, (n,). Changed in place.
    """
    n = len(width)
    by_end, by_interval = low.shape[0] - 1, min(low.shape[1] - 1, 1)
    for i in range(n):
        if most[i] == np.inf:
            continue
        first, last = x[i], x[i + 1]
        u = (last - first) / (2.0 * width[i])
        for k in range(a.shape[2]):
            a0, a1, b0, b1 = a[0, i, k], a[1, i, k], b[0, i, k], b[1, i, k]
            inertia = min(abs(a0), abs(a1))
            if a0 * a1 <= 0.0 or inertia < VANISHED * abs(a0 + a1):
                continue
            v0 = a0 * u + b0 * first
            v1 = a1 * u + b1 * last
            at = i * by_interval
            bound0 = high[0, at, k] if v0 > 0.0 else low[0, at, k]
            bound1 = high[by_end, at, k] if v0 > 0.0 else low[by_end, at, k]
            used = max(v0 / bound0, v1 / bound1)
            # On a tie the first one, so that rounding does not choose.
            if used > most[i] * (1 + 1e-9):
                u0 = (bound0 - b0 * first) / a0
                u1 = (bound1 - b1 * last) / a1
                change = abs(a0 * (u1 - u0))
                if change < LARGEST_CHANGE * abs(bound0):
                    most[i] = used
                    skew[i] = (u1 - u0) / width[i]


@compiled()
def skew_along_discs(
    width: FloatArray,
    c: FloatArray,
    radius: FloatArray,
    x: FloatArray,
    most: FloatArray,
    skew: FloatArray,
) -> None:
    """The same for discs: c, (2, n), and radius, (n,); other arguments as in `skew_along_rows`."""
    for i in range(len(width)):
        if most[i] == np.inf or radius[i] == np.inf:
            continue
        first, last = x[i], x[i + 1]
        u = (last - first) / (2.0 * width[i])
        used = max(math.hypot(c[0, i] * first, u), math.hypot(c[1, i] * last, u)) / radius[i]
        left0 = radius[i] ** 2 - (c[0, i] * first) ** 2
        left1 = radius[i] ** 2 - (c[1, i] * last) ** 2
        if used > most[i] and left0 > 0.0 and left1 > 0.0:
            change = math.copysign(1.0, u) * (math.sqrt(left1) - math.sqrt(left0))
            if abs(change) < LARGEST_CHANGE * radius[i]:
                skew[i] = change / width[i]
