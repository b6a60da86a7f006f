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

from armcontour._checks import BoolArray, FloatArray
from armcontour._kernels import FUSED, compiled
from armcontour.timing._block import (
    A0,
    A1,
    B0,
    B1,
    ENDS,
    HALF,
    HIGH0,
    HIGH1,
    INTERVAL,
    LOST,
    LOW0,
    LOW1,
    MARGIN,
    OWN,
    SHIFT,
    B,
    filled,
    take_rows,
    take_terms,
)

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
# Intervals of a block that are tried at once where the same rows have bound FEW before.
CHUNK = 16
FEW = 2
# Memory for a chunk: x and y of the intervals that are tried, zeros between two tries; and lines of
# rows that bound x or y from above, and of rows that bound x from below.
UPPER, LOWER, LANES = 2 * CHUNK, 6 * CHUNK, 10 * CHUNK
# A coefficient of u below this share of that at the other end of its interval is rounding.
VANISHED = 1e-9


@compiled(inner=True)
def write_rows(
    of: FloatArray,
    ends: FloatArray,
    row: int,
    own: FloatArray,
    j: int,
    out: FloatArray,
    b: int,
    start: int,
    end: int,
) -> None:
    """Write one limit on a block as bounds of `p x + q y` at starts and ends of the intervals.

    Args:
        of: HALF and SHIFT of the intervals.
        ends: Coefficients of some limits.
        row: Which of them this one has.
        own: Bounds and margins of some limits.
        j: Which of them this one has.
        out: Output: p, q, lower and upper bound, as in `pack`.
        b: The block.
        start: The row of the limit at the starts.
        end: The row of the limit at the ends.
    """
    for m in range(B):
        # x counts at the start of the interval.
        inertia, shift = ends[row, A0 + m] * of[HALF + m], of[SHIFT + m]
        low, high, room = own[j, LOW0 + m], own[j, HIGH0 + m], own[j, MARGIN + m]
        out[b, start, m], out[b, start, B + m] = ends[row, B0 + m] - inertia, inertia
        out[b, start, 2 * B + m] = low + room + inertia * shift
        out[b, start, 3 * B + m] = high - room + inertia * shift
    for m in range(B):
        # And y at its end.
        inertia, shift = ends[row, A1 + m] * of[HALF + m], of[SHIFT + m]
        low, high, room = own[j, LOW1 + m], own[j, HIGH1 + m], own[j, MARGIN + m]
        out[b, end, m], out[b, end, B + m] = -inertia, ends[row, B1 + m] + inertia
        out[b, end, 2 * B + m] = low + room - inertia * shift
        out[b, end, 3 * B + m] = high - room - inertia * shift


@compiled(inner=True)
def raise_lost(of: FloatArray, ends: FloatArray, own: FloatArray, j: int) -> None:
    """Raise LOST to what the margin of one limit takes of its bounds, see `pack`.

    Args:
        of: Rows of the intervals.
        ends: Coefficients of the limits.
        own: Their bounds and margins.
        j: The limit.
    """
    for m in range(B):
        room, lost = own[j, MARGIN + m], of[LOST + m]
        start = min(own[j, HIGH0 + m], -own[j, LOW0 + m])
        end = min(own[j, HIGH1 + m], -own[j, LOW1 + m])
        allowed = min(start, end)
        lost = room / allowed if room > lost * allowed else lost
        turn = abs(of[SHIFT + m]) * of[HALF + m]
        broken = abs(ends[j, A0 + m]) * turn > start - room
        broken |= abs(ends[j, A1 + m]) * turn > end - room
        of[LOST + m] = max(lost, 1.0) if broken else lost


@compiled(inner=True)
def take_bounds(low: FloatArray, high: FloatArray, begin: int, own: FloatArray) -> None:
    """Write the bounds of limits on a block into LOW0, LOW1, HIGH0, HIGH1.

    Args:
        low: Lower bounds, as in `pack`.
        high: Upper bounds, as in `pack`.
        begin: First interval of the block.
        own: Output, (rows, 7 B).
    """
    by_end, first = low.shape[0] - 1, begin if low.shape[1] > 1 else 0
    take_rows(low[0], first, own, LOW0)
    take_rows(low[by_end], first, own, LOW1)
    take_rows(high[0], first, own, HIGH0)
    take_rows(high[by_end], first, own, HIGH1)


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
        out: Output: p, q, lower and upper bound of each row, block by block, all starts before all
            ends, (blocks, 2 all rows, 4 B).
        lost: Output: the largest share of any bound that margins take on each interval, if it is
            larger than what is there, (n,). The share is 1 where the change of u over half an
            interval alone would break a bound at rest, so that no state is certainly allowed.
    """
    n, every, count = len(width), out.shape[1] // 2, a.shape[2]
    by_interval = low.shape[1] > 1
    of, ends, own = np.empty(INTERVAL), np.empty((count, ENDS)), np.empty((count, OWN))
    for begin in range(0, n, B):
        for m in range(B):
            i = min(begin + m, n - 1)
            of[HALF + m], of[SHIFT + m], of[LOST + m] = 0.5 / width[i], shifts[i], lost[i]
        if by_interval or begin == 0:
            # What does not differ from interval to interval fills all blocks.
            take_bounds(low, high, begin, own)
        take_terms(a, b, begin, ends)
        take_rows(margin, begin, own, MARGIN)
        for k in range(count):
            write_rows(of, ends, k, own, k, out, begin // B, first + k, every + first + k)
            raise_lost(of, ends, own, k)
        for m in range(min(B, n - begin)):
            lost[begin + m] = of[LOST + m]


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
    b, m = i // B, i % B
    upper = np.inf
    upper_slope = 0.0
    lower = -np.inf
    lower_slope = 0.0
    above = below = -1
    for k in range(rows.shape[1]):
        p, known = rows[b, k, m], rows[b, k, B + m] * y
        down, up = rows[b, k, 2 * B + m] - known, rows[b, k, 3 * B + m] - known
        # A division only where the row is narrower than all before it.
        if p > 0.0:
            if up < upper * p:
                upper, upper_slope, above = up / p, -rows[b, k, B + m] / p, k
            if down > lower * p:
                lower, lower_slope, below = down / p, -rows[b, k, B + m] / p, k
        elif p < 0.0:
            if down > upper * p:
                upper, upper_slope, above = down / p, -rows[b, k, B + m] / p, k
            if up < lower * p:
                lower, lower_slope, below = up / p, -rows[b, k, B + m] / p, k
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
    b, m = i // B, i % B
    y = np.inf
    if r < np.inf:
        if c1 > 0.0:
            y = min(y, r / c1)
        if c0 > 0.0:
            y = min(y, shift + r / half * math.hypot(1.0, half / c0))
    for k in range(rows.shape[1]):
        p, q = rows[b, k, m], rows[b, k, B + m]
        if p == 0.0 and q != 0.0:
            y = min(y, rows[b, k, 3 * B + m] / q if q > 0.0 else rows[b, k, 2 * B + m] / q)
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
) -> tuple[float, float, int, int]:
    """Interval of y for a given x, and the rows that bound it from above and below."""
    b, m = i // B, i % B
    upper = np.inf
    lower = -np.inf
    above = below = -1
    for k in range(rows.shape[1]):
        q, known = rows[b, k, B + m], rows[b, k, m] * x
        # Where q is tiny and x at the row's edge, rounding must not decide on y.
        least, most = rows[b, k, 2 * B + m], rows[b, k, 3 * B + m]
        down = least - ROUNDING * (abs(least) + abs(known)) - known
        up = most + ROUNDING * (abs(most) + abs(known)) - known
        if q > 0.0:
            if up < upper * q:
                upper, above = up / q, k
            if down > lower * q:
                lower, below = down / q, k
        elif q < 0.0:
            if down > upper * q:
                upper, above = down / q, k
            if up < lower * q:
                lower, below = up / q, k
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
    return upper, lower, above, below


@compiled(inner=True)
def _count_broken(
    rows: FloatArray, b: int, k: int, low: int, play: float, lanes: FloatArray
) -> int:
    """The number of intervals whose x and y break one row by more than a share of its terms.

    Args:
        rows: The rows, as in `reach`.
        b: The block.
        k: The row.
        low: The first of CHUNK intervals of the block.
        play: The share.
        lanes: x and y.
    """
    broken, m0 = 0, low & (B - 1)
    for m in range(CHUNK):
        one, other = rows[b, k, m0 + m] * lanes[m], rows[b, k, B + m0 + m] * lanes[CHUNK + m]
        low_, high = rows[b, k, 2 * B + m0 + m], rows[b, k, 3 * B + m0 + m]
        if play > 0.0:
            slack = play * (abs(one) + abs(other))
            low_, high = low_ - slack, high + slack
        broken += (one + other > high) | (one + other < low_)
    return broken


@compiled(inner=True)
def _breaks(x: float, y: float, rows: FloatArray, b: int, m: int, k: int, play: float) -> bool:
    """Whether x and y break row k of an interval by more than a share of its terms."""
    one, other = rows[b, k, m] * x, rows[b, k, B + m] * y
    slack = play * (abs(one) + abs(other))
    above = one + other > rows[b, k, 3 * B + m] + slack
    return bool(above | (one + other < rows[b, k, 2 * B + m] - slack))


@compiled(inner=True)
def _twin(k: int, count: int) -> int:
    """The row of the same limit as row k at the other end of the interval; -1 for -1."""
    if k < 0:
        return k
    return k - count // 2 if k >= count // 2 else k + count // 2


@compiled(inner=True)
def _keeps(x: float, y: float, rows: FloatArray, i: int, first: int, second: int) -> bool:
    """Whether x and y keep all rows of interval i; other arguments as in `_find_broken`."""
    b, m, every, broken = i // B, i % B, rows.shape[1], 0
    for k in range(every):
        value = rows[b, k, m] * x + rows[b, k, B + m] * y
        broken += (value > rows[b, k, 3 * B + m]) | (value < rows[b, k, 2 * B + m])
    if broken:
        for k in (first, second):
            if k >= 0:
                for row in (k, _twin(k, every)):
                    broken -= _breaks(x, y, rows, b, m, row, 0.0)
                    broken += _breaks(x, y, rows, b, m, row, EDGE)
            if k == second or second == _twin(k, every):
                break
    return broken == 0


@compiled(inner=True)
def _find_broken(
    rows: FloatArray, i: int, last: int, first: int, second: int, lanes: FloatArray
) -> int:
    """The first of some intervals of a chunk whose x and y break a row; `last` if there is none.

    Args:
        rows: The rows, as in `reach`.
        i: The first of the intervals.
        last: The one after the last of them, or before it if they are looked at backwards.
        first: A row on whose edge x and y are, and the same limit at the other end of the interval
            perhaps too: these two may be broken by rounding; -1 for none.
        second: Another such row, or -1.
        lanes: x and y of the intervals, and zeros. All zeros afterwards.
    """
    every, step, found = rows.shape[1], 1 if last > i else -1, i
    if abs(last - i) > FEW:
        twin, other, broken = _twin(first, every), _twin(second, every), 0
        for k in range(every):
            edge = k == first or k == second or k == twin or k == other
            play = EDGE if edge else 0.0
            broken += _count_broken(rows, i // B, k, i % B - i % CHUNK, play, lanes)
        if broken == 0:
            found = last
    while found != last:
        m = found % CHUNK
        if not _keeps(lanes[m], lanes[CHUNK + m], rows, found, first, second):
            break
        found += step
    for at in range(i, last, step):
        m = at % CHUNK
        lanes[m] = lanes[CHUNK + m] = 0.0
    return found


@compiled(inner=True)
def _draw_lines(
    rows: FloatArray, i: int, count: int, k: int, side: float, of: int, at: int, lanes: FloatArray
) -> None:
    """Write the ends that a row leaves of x for a given y, or of y for a given x, as lines.

    The end of x is `line - steep y`. The divisions are done here for many intervals at once, as one
    interval waits for the other only for what follows.

    Args:
        rows: The rows, as in `reach`.
        i: The first of some intervals of a chunk.
        count: How many they are.
        k: The row; the same limit at the other end of the interval has the lines after these.
        side: 1.0 for upper ends, -1.0 for lower ones.
        of: 0 for ends of x, B for those of y.
        at: Where the lines begin.
        lanes: Output: `line` and `steep` of one row and of the other, CHUNK each.
    """
    b, m0, at0 = i // B, i & (B - 1), at + (i & (CHUNK - 1))
    for row, to in ((k, at0), (_twin(k, rows.shape[1]), at0 + 2 * CHUNK)):
        for m in range(count):
            own, other = rows[b, row, of + m0 + m], rows[b, row, B - of + m0 + m]
            low, high = rows[b, row, 2 * B + m0 + m], rows[b, row, 3 * B + m0 + m]
            # Without `own` there is no number, and nothing below it.
            inverse = 1.0 / own
            low, high = low * inverse, high * inverse
            lanes[to + m] = max(low, high) if side > 0.0 else min(low, high)
            lanes[to + CHUNK + m] = other * inverse


@compiled(inner=True, fastmath=FUSED)
def _guess_x(y: float, lanes: FloatArray, m: int, cut: bool) -> tuple[float, float, bool]:
    """The largest x of an interval if rows bound it whose lines are drawn.

    Args:
        y: Largest x at the end of the interval.
        lanes: Lines from UPPER on, and if `cut` from LOWER on, as `_draw_lines` writes them.
        m: The place of the interval in its chunk.
        cut: Whether the lower lines bound y.

    Returns:
        x, y, and whether they can be.
    """
    # With a skew the same limit binds at both ends: which one is first is a matter of rounding.
    x, steep = lanes[UPPER + m] - lanes[UPPER + CHUNK + m] * y, lanes[UPPER + CHUNK + m]
    other = lanes[UPPER + 2 * CHUNK + m] - lanes[UPPER + 3 * CHUNK + m] * y
    if other < x:
        x, steep = other, lanes[UPPER + 3 * CHUNK + m]
    if cut:
        least, rise = lanes[LOWER + m] - lanes[LOWER + CHUNK + m] * y, lanes[LOWER + CHUNK + m]
        other = lanes[LOWER + 2 * CHUNK + m] - lanes[LOWER + 3 * CHUNK + m] * y
        if other > least:
            least, rise = other, lanes[LOWER + 3 * CHUNK + m]
        if x >= least or steep <= rise:
            return 0.0, y, False
        # Where both lines meet, y is this much smaller.
        less = (x - least) / (rise - steep)
        x, y = x + steep * less, y - less
    return x, y, steep <= 0.0 and x >= 0.0 and y >= 0.0


@compiled(inner=True, fastmath=FUSED)
def _guess_y(x: float, most: float, lanes: FloatArray, at: int, m: int) -> float:
    """The largest y of an interval up to `most` if the row bounds it whose lines begin at `at`."""
    y = most
    for line_at in (at + m, at + 2 * CHUNK + m):
        line, fall = lanes[line_at], lanes[line_at + CHUNK] * x
        up = line - fall + ROUNDING * (abs(line) + abs(fall))
        y = up if up < y else y
    return y


@compiled(inner=True)
def _guess_back(
    i: int,
    count: int,
    rows: FloatArray,
    ceiling: FloatArray,
    above: int,
    below: int,
    most: FloatArray,
    follows: BoolArray,
    lanes: FloatArray,
) -> tuple[int, bool]:
    """Go back through a chunk from interval i while the same rows bound x as before.

    One guess follows from the other; whether they keep all rows is looked at for all at once.

    Args:
        i: The interval.
        count: Largest number of intervals.
        rows: The rows, as in `reach`.
        ceiling: Largest x at the grid points, (n + 1,).
        above: The row that bounds x from above; -1 if the ceiling does.
        below: The row that bounds x from below, where both bound y, or the ceiling does and y
            follows from the row; -1 if y is not bounded.
        most: The largest x after the interval i, and before it as the output, (n + 1,).
        follows: Output: whether the largest x after an interval can be reached from that before
            it, (n,); perhaps not if it is false.
        lanes: Memory, see LANES.

    Returns:
        The interval before those that agree, and whether it is in the chunk and does not.
    """
    k, y = i, most[i + 1]
    end = max(i - i % CHUNK, i - count + 1)
    if above >= 0:
        _draw_lines(rows, end, i + 1 - end, above, 1.0, 0, UPPER, lanes)
        if below >= 0:
            _draw_lines(rows, end, i + 1 - end, below, -1.0, 0, LOWER, lanes)
    elif below >= 0:
        _draw_lines(rows, end, i + 1 - end, below, 1.0, B, LOWER, lanes)
    while k >= end:
        x, agrees = ceiling[k], True
        if above >= 0:
            x, y, agrees = _guess_x(y, lanes, k % CHUNK, below >= 0)
        elif below >= 0:
            y = _guess_y(x, y, lanes, LOWER, k % CHUNK)
            agrees = y >= 0.0
        if not (agrees and x < np.inf):
            break
        lanes[k % CHUNK], lanes[CHUNK + k % CHUNK] = x, y
        most[k] = y = min(x, ceiling[k])
        # Of an x above the ceiling only that is known which is not taken.
        follows[k] = below < 0 and x <= ceiling[k]
        k -= 1
    broken = _find_broken(rows, i, k, above, below, lanes)
    return broken, broken >= end


@compiled(inner=True)
def _guess_on(
    i: int,
    count: int,
    rows: FloatArray,
    most: FloatArray,
    above: int,
    below: int,
    x: FloatArray,
    lanes: FloatArray,
) -> tuple[int, bool]:
    """Go on through a chunk from interval i while the same row bounds y as before.

    Args:
        i: The interval.
        count: Largest number of intervals.
        rows: The rows, as in `reach`.
        most: The largest x from which the end can be reached, (n + 1,).
        above: The row that bounds y from above; -1 for none.
        below: The row that bounds y from below, on whose edge y is where it bounds `most`; or -1.
        x: The largest x up to the interval i, and after it as the output, (n + 1,).
        lanes: Memory, see LANES.

    Returns:
        The interval after those that agree, and whether it is in the chunk and does not.
    """
    k, last = i, min(i - i % CHUNK + CHUNK, i + count, len(x) - 1)
    if above >= 0:
        _draw_lines(rows, i, last - i, above, 1.0, B, UPPER, lanes)
    while k < last:
        m, y = k % CHUNK, most[k + 1]
        if above >= 0:
            y = _guess_y(x[k], y, lanes, UPPER, m)
        if not 0.0 <= y < np.inf:
            break
        lanes[m], lanes[CHUNK + m], x[k + 1] = x[k], y, y
        k += 1
    broken = _find_broken(rows, i, k, above, below, lanes)
    return broken, broken < last


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
        rows: What `pack` writes, (blocks, rows, 4 B).
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
    follows = np.empty(n, np.bool_)
    most[n] = end
    lanes = filled(LANES, 0.0)
    i, count = n, FEW
    while i > 0:
        i -= 1
        if guesses and not discs:
            i, differs = _guess_back(i, count, rows, ceiling, above, below, most, follows, lanes)
            # Many at once where the same rows bind for long, few where they change.
            count = FEW if differs else min(2 * count, CHUNK)
            if not differs:
                i += 1
                continue
        half = 0.5 / width[i]
        cap = ceiling[i]
        y = most[i + 1]
        shift = shifts[i]
        if discs:
            c0, c1, r = c[0, i], c[1, i], radius[i]
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
        if not cut and up >= cap:
            # The ceiling may be below what y asks for; a smaller y leads to it then.
            above, below = -1, below if down > cap else -1
        elif not cut:
            below = -1
        guesses = slope >= 0.0 and (above >= 0 or not cut)
        follows[i] = y == most[i + 1] and min(up, cap) >= down
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
            up, guesses, follows[i] = best, False, False
        most[i] = min(up, cap)
    if start == np.inf:
        start = most[0]
    if start > most[0] * (1 + PLAY):
        return x, most, 0
    x[0] = min(start, most[0])
    above, below, i, count = -1, -1, 0, FEW
    while i < n:
        # All rows allow these two: the pass before has looked.
        if follows[i] and x[i] == most[i]:
            x[i + 1] = most[i + 1]
            i += 1
            continue
        if not discs:
            i, differs = _guess_on(i, count, rows, most, above, below, x, lanes)
            count = FEW if differs else min(2 * count, CHUNK)
            if not differs:
                continue
        half = 0.5 / width[i]
        if discs:
            c0, c1, r = c[0, i], c[1, i], radius[i]
        up, down, above, below = _of_y(x[i], rows, i, half, c0, c1, r, shifts[i])
        y = min(up, most[i + 1])
        # Both ends of the interval of y are rounded; next to the edge of a disc under a root.
        slack = 1e-12 * (abs(down) + most[i + 1] + x[i])
        if r < np.inf:
            slack += 1e-7 * r / half
        if y < down - slack:
            return x, most, i
        x[i + 1] = max(y, 0.0)
        i += 1
    return x, most, -1


@compiled(inner=True)
def steer(
    width: float,
    first: float,
    last: float,
    ends: tuple[float, float, float, float],
    lows: tuple[float, float],
    highs: tuple[float, float],
    most: float,
    skew: float,
) -> tuple[float, float]:
    """The larger use of rows on one interval, and the slope of u for the row, see below.

    Args:
        width: Length of the interval.
        first: x at its start.
        last: x at its end.
        ends: Coefficients of u and those of x of one row, at the start and the end each.
        lows: Lower bounds there.
        highs: Upper bounds there.
        most: The largest use of the rows before.
        skew: The slope for these.
    """
    a0, a1, b0, b1 = ends
    inertia = min(abs(a0), abs(a1))
    if a0 * a1 <= 0.0 or inertia < VANISHED * abs(a0 + a1):
        return most, skew
    u = (last - first) / (2.0 * width)
    v0, v1 = a0 * u + b0 * first, a1 * u + b1 * last
    bounds = highs if v0 > 0.0 else lows
    # On a tie the first one, so that rounding does not choose. Few rows need the divisions.
    enough = most * (1 + 1e-9)
    if abs(v0) <= enough * abs(bounds[0]) and abs(v1) <= enough * abs(bounds[1]):
        return most, skew
    used = max(v0 / bounds[0], v1 / bounds[1])
    if used > enough:
        u0, u1 = (bounds[0] - b0 * first) / a0, (bounds[1] - b1 * last) / a1
        if abs(a0 * (u1 - u0)) < LARGEST_CHANGE * abs(bounds[0]):
            return used, (u1 - u0) / width
    return most, skew


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
    by_end, by_interval = low.shape[0] - 1, min(low.shape[1] - 1, 1)
    for i in range(len(width)):
        if most[i] == np.inf:
            continue
        at = i * by_interval
        for k in range(a.shape[2]):
            lows, highs = (low[0, at, k], low[by_end, at, k]), (high[0, at, k], high[by_end, at, k])
            ends = a[0, i, k], a[1, i, k], b[0, i, k], b[1, i, k]
            most[i], skew[i] = steer(width[i], x[i], x[i + 1], ends, lows, highs, most[i], skew[i])


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
