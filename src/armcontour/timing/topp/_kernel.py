"""The compiled plan on a grid: first without margins, then with margins that the plan proves.

On each interval u is linear in s with a slope k that is chosen beforehand. With its mean m and half
its change t = k w / 2, it is m - t and m + t at the ends, and x at the end is x + 2 w m. All limits
of an interval are then lines and conics in the plane of x and m. docs/concepts/optimal.md has the
mathematics.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from armcontour._checks import BoolArray, FloatArray
from armcontour._kernels import FUSED, compiled
from armcontour.motion._intervals import interval_time
from armcontour.timing.topp.limits import (
    ALONE,
    BY_SLOPE,
    BY_U,
    BY_X,
    HIGH,
    LARGEST,
    LOW,
    OFF,
    SIGN,
    A,
    B,
    Friction,
    Intervals,
    Limits,
    Rounds,
    Rows,
)

FOUND, FINER, STUCK, START, END, UNLIMITED = range(6)
INSIDE = 1 - 1e-14  # a step of Newton ends inside by this share, far more than rounding
LARGEST_X = 1e100  # from which Newton starts without a ceiling
FAR, ROUNDED = 1e-3, 1e-12  # a step to less than the share FAR of x has the error ROUNDED of it
SLACK = 1e-9  # ends of a range of u that differ by this share differ by rounding
PLAY = 1e-7  # share by which x at an end may miss what was asked for
TINY = 1e-14  # share of its terms, each with rounding, below which a coefficient is zero
NEAR = 0.01  # nearer to its bound than this share of its range, u is at the bound
BELOW_CEILING = 1 - 1e-6  # where x is at its ceiling, nothing else binds
LARGEST_TURN = 0.25  # a slope changes u by less than this share of its range
NO_WAY = 4e-2  # the share that stands for margins that leave no plan: a finer grid may have one
AROUND = 10  # intervals next to one that leaves no plan, that are made finer with it
SHARE_AT_REST = 0.5  # a line above friction takes at most this share of what is left at rest
LEAST = 1e-300  # keeps divisions finite; its root is far below any path speed


class Rules(NamedTuple):
    """What a plan may do.

    Args:
        start: ds² at the start; infinite for the largest.
        end: ds² at the end; infinite for the largest.
        most: Largest share of a limit that margins may take.
        steady: Where margins take more than this, slopes are left out first.
        headroom: Bounds of x and u are those of the plan before times this.
        close: The same of bounds around a proven plan.
        window: U is the largest |u| of so many neighbours either way, as switches move.
        floor: U is at least this share of the largest |u| of all.
        tangents: Most plans without margins in which friction is linear near the plan before.
        near: Error of x, as a share, below which such a plan is near enough.
        tries: Most plans on a grid.
        enough: With more intervals, what margins do not allow is refused.
        gain: Bounds come closer while that gains more than this share of the duration.
    """

    start: float = 0.0
    end: float = 0.0
    most: float = 1e-2
    steady: float = 0.999
    headroom: float = 1.05
    close: float = 1.02
    window: int = 1
    floor: float = 1e-3
    tangents: int = 2
    near: float = 1e-2
    tries: int = 30
    enough: int = 20_000
    gain: float = 1e-6


class Bounds(NamedTuple):
    """For a plan with slopes k margins hold while |u| <= u and least <= x <= x, (n,) each."""

    x: FloatArray
    least: FloatArray
    u: FloatArray
    k: FloatArray


class Plan(NamedTuple):
    """A plan, or why there is none.

    Args:
        x: ds² at the ends of the intervals, (n + 1,).
        k: Slopes of dds over s, (n,).
        lost: Share of limits that margins take, (n,).
        outcome: FOUND, or FINER, STUCK, START, END, UNLIMITED.
        place: Where there is none: an interval.
        allowed: With START and END: the largest ds² there.
    """

    x: FloatArray
    k: FloatArray
    lost: FloatArray
    outcome: int
    place: int
    allowed: float


class Lines(NamedTuple):
    """The limits of one try, in the plane of x at the start and the mean u of each interval.

    Args:
        of: `bottom <= m + tilt x <= top`: tilt, bottom and top, (n, lines, 3).
        conics: `|m + p x + q|² <= d0 + 2 d1 x - d2 x²`: p, q, d0, d1 and d2, (n, conics, 5).
        cap: Largest x at the start and at the end, (n, 2).
        lost: Share of limits that margins take, (n,).
    """

    of: FloatArray
    conics: FloatArray
    cap: FloatArray
    lost: FloatArray


@compiled(inner=True)
def _row(ends: FloatArray, i: int, end: int, r: int) -> tuple[float, float, float, float]:
    return ends[i, end, r, A], ends[i, end, r, B], ends[i, end, r, LOW], ends[i, end, r, HIGH]


@compiled(inner=True, fastmath=FUSED)
def _margin(rise: FloatArray, i: int, r: int, bounds: Bounds) -> float:
    by = rise[i, r, BY_U] * bounds.u[i] + rise[i, r, BY_X] * bounds.x[i]
    return float(by + rise[i, r, BY_SLOPE] * abs(bounds.k[i]) + rise[i, r, ALONE])


@compiled(inner=True, fastmath=FUSED)
def _draw_line(
    lines: Lines, i: int, line: int, by_mean: float, by_x: float, low: float, high: float
) -> None:
    """Draw `low <= by_mean m + by_x x <= high`."""
    if by_mean == 0.0:
        lines.of[i, line, 0], lines.of[i, line, 1], lines.of[i, line, 2] = 0.0, -math.inf, math.inf
        return
    inverse = 1.0 / by_mean
    low, high = low * inverse, high * inverse
    lines.of[i, line, 0] = by_x * inverse
    if inverse > 0.0:
        lines.of[i, line, 1], lines.of[i, line, 2] = low, high
    else:
        lines.of[i, line, 1], lines.of[i, line, 2] = high, low


@compiled(inner=True, fastmath=FUSED)
def _draw_row(
    lines: Lines,
    i: int,
    line: int,
    of: tuple[float, float, float, float],
    motion: tuple[float, float],
    end: int,
) -> None:
    """Draw `low <= a u + b x <= high` at one end; where no m is left, it is a ceiling of x."""
    a, b, low, high = of
    w, turn = motion
    shift = a * turn
    if end == 1:
        shift = -shift
    low, high, bends = low + shift, high + shift, 2 * w * abs(b)
    by_mean = a if end == 0 else a + 2 * w * b
    side = -1
    if abs(by_mean) <= TINY * (abs(a) + bends):
        side = 0
    elif abs(a) <= TINY * bends:
        side = end
    if side >= 0:
        if b != 0.0:
            most = (high if b > 0.0 else low) / b
            lines.cap[i, side] = min(lines.cap[i, side], max(most, 0.0))
        by_mean = 0.0
    _draw_line(lines, i, line, by_mean, b, low, high)


class Bracket(NamedTuple):
    """A range of x on an interval: the smallest x, and the roots of the smallest and largest."""

    least: float
    low: float
    high: float


@compiled(inner=True)
def bracket(least: float, most: float) -> Bracket:
    """The bracket from one x to another."""
    return Bracket(least, math.sqrt(least), math.sqrt(max(most, LEAST)))


@compiled(inner=True)
def friction_row(
    friction: Friction, i: int, j: int, towards: float, room: float, within: Bracket
) -> tuple[float, float, float]:
    """What takes the place of friction in the row of one limit of joint j on interval i.

    Where the joint may turn round, it is the largest friction on the interval. Else it is the
    friction at each end times a line in x in place of the root of x. The line below the root is the
    chord. The line above is the tangent that is as far above the root at both ends of the bracket;
    of a smaller x if its offset takes too much of what is left at rest; or the line of that offset
    that meets the root at the smallest x.

    Args:
        friction: The friction.
        i: The interval.
        j: The joint.
        towards: 1 for the upper limit, -1 for the lower one.
        room: What is left of the limit at rest.
        within: The range of x.

    Returns:
        The largest friction, or 0; offset and slope of the line, or 0.
    """
    largest, sign = friction.within[i, j, LARGEST], friction.within[i, j, SIGN]
    if sign == 0.0:
        return towards * largest * within.high, 0.0, 0.0
    total = within.low + within.high
    if sign != towards:
        slope = 1 / total
        return 0.0, within.low * within.high * slope, slope
    offset = total / 4
    if offset * largest > SHARE_AT_REST * room:
        offset = max(SHARE_AT_REST * room / largest, LEAST)
    if offset >= within.low / 2:
        return 0.0, offset, 1 / (4 * offset)
    return 0.0, offset, (within.low - offset) / within.least


@compiled(inner=True)
def friction_rise(
    friction: Friction, i: int, j: int, offset: float, slope: float, w: float
) -> tuple[float, float, float, float]:
    """What a line in place of the root of x adds to the rise of a row: by U, X, slope, and alone.

    Its product with x bends as those of b do; friction itself is off its chord.

    Args:
        friction: The friction.
        i: The interval.
        j: The joint.
        offset: Of the line of `friction_row`.
        slope: Of the line.
        w: Length of the interval.
    """
    v0, v1, off = friction.viscous[i, 0, j], friction.viscous[i, 1, j], friction.within[i, j, OFF]
    by_slope = slope * max(abs(v0), abs(v1)) * w * w / 4
    return slope * abs(v1 - v0) * w / 2, slope * off, by_slope, offset * off


@compiled(inner=True)
def _products(ends: FloatArray, i: int, end: int, r: int) -> tuple[float, float, float]:
    """The products a a, a b and b b of the vectors at one end of an interval."""
    aa = ab = bb = 0.0
    for d in range(3):
        a, b = ends[i, end, r, A, d], ends[i, end, r, B, d]
        aa, ab, bb = aa + a * a, ab + a * b, bb + b * b
    return aa, ab, bb


@compiled(inner=True)
def _draw_conic(
    lines: Lines,
    i: int,
    r: int,
    ends: FloatArray,
    square: float,
    motion: tuple[float, float],
    end: int,
) -> None:
    """Draw `|a u + b x|² <= square` at one end of an interval."""
    w, turn = motion
    out = lines.conics[i, 2 * r + end]
    for d in range(5):
        out[d] = 0.0
    # The vector that multiplies m is a at the start, and a + 2 w b at the end.
    step = 2 * w * end
    a0, a1, a2 = ends[i, end, r, A, 0], ends[i, end, r, A, 1], ends[i, end, r, A, 2]
    b0, b1, b2 = ends[i, end, r, B, 0], ends[i, end, r, B, 1], ends[i, end, r, B, 2]
    e0, e1, e2 = a0 + step * b0, a1 + step * b1, a2 + step * b2
    ee, eb = e0 * e0 + e1 * e1 + e2 * e2, e0 * b0 + e1 * b1 + e2 * b2
    aa, bb = a0 * a0 + a1 * a1 + a2 * a2, b0 * b0 + b1 * b1 + b2 * b2
    if ee <= TINY**2 * (aa + 4 * w * w * bb):
        # x alone, at the start.
        out[2] = math.inf
        if bb > 0.0:
            most = math.sqrt(square / bb) - 2 * w * abs(turn)
            lines.cap[i, 0] = min(lines.cap[i, 0], max(most, 0.0))
        return
    c0, c1, c2 = a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0
    spread = (c0 * c0 + c1 * c1 + c2 * c2) / (ee * ee)
    out[0], out[4] = eb / ee, spread
    if end == 0:
        out[1], out[2] = -turn, square / ee
    else:
        out[1] = turn * (1 - step * out[0])
        out[2] = square / ee - spread * (step * turn) ** 2
        out[3] = step * spread * turn
    # Beyond this x there is no m.
    if spread > 0.0:
        root = math.sqrt(max(out[3] * out[3] + spread * out[2], 0.0))
        lines.cap[i, 0] = min(lines.cap[i, 0], max((out[3] + root) / spread * INSIDE, 0.0))


@compiled()
def rows_with_friction(width: FloatArray, limits: Limits, bounds: Bounds, margins: bool) -> Rows:
    """The rows with lines for friction: upper limits, then lower ones, then those without friction.

    Args:
        width: Lengths of the intervals, (n,).
        limits: The limits.
        bounds: The bounds, of which the range of x counts.
        margins: Whether friction counts where a joint may turn round, and rises.
    """
    ends, friction, rise = limits.rows.ends, limits.friction, limits.rows.rise
    n, count, rubbing = rise.shape[0], rise.shape[1], friction.within.shape[1]
    found = Rows(np.empty((n, 2, count + rubbing, 4)), np.empty((n, count + rubbing, 4)))
    for i in range(n):
        within = bracket(bounds.least[i], bounds.x[i])
        for r in range(count + rubbing):
            side = 0 if r < rubbing else 1 if r < 2 * rubbing else 2
            j = r - min(side, 1) * rubbing
            found.ends[i, :, r], found.rise[i, r] = ends[i, :, j], rise[i, j]
            if side == 2:
                continue
            towards, which = 1.0 - 2.0 * side, HIGH if side == 0 else LOW
            rest = min(towards * ends[i, 0, j, which], towards * ends[i, 1, j, which])
            most, offset, slope = friction_row(friction, i, j, towards, rest, within)
            for end in range(2):
                viscous = friction.viscous[i, end, j]
                found.ends[i, end, r, B] += viscous * slope
                found.ends[i, end, r, which] -= viscous * offset + (most if margins else 0.0)
                found.ends[i, end, r, LOW + HIGH - which] = -towards * math.inf
            by_u, by_x, by_slope, alone = friction_rise(friction, i, j, offset, slope, width[i])
            found.rise[i, r, BY_U] += by_u
            found.rise[i, r, BY_X] += by_x
            found.rise[i, r, BY_SLOPE] += by_slope
            found.rise[i, r, ALONE] += alone
    return found


@compiled(inner=True, fastmath=FUSED)
def _draw_friction(
    lines: Lines, limits: Limits, bounds: Bounds, i: int, motion: tuple[float, float], margins: bool
) -> None:
    """Draw the rows with friction on interval i; arguments as in `_draw`."""
    ends, friction, rises = limits.rows.ends, limits.friction, limits.rows.rise
    within = bracket(bounds.least[i], bounds.x[i])
    for j in range(friction.within.shape[1]):
        a0, a1, b0, b1 = ends[i, 0, j, A], ends[i, 1, j, A], ends[i, 0, j, B], ends[i, 1, j, B]
        rise = _margin(rises, i, j, bounds) if margins else 0.0
        turn = max(abs(a0), abs(a1)) * abs(motion[1])
        v0, v1 = friction.viscous[i, 0, j], friction.viscous[i, 1, j]
        for side in range(2):
            towards = 1.0 - 2.0 * side
            which = HIGH if side == 0 else LOW
            limit0, limit1 = ends[i, 0, j, which], ends[i, 1, j, which]
            rest = min(towards * limit0, towards * limit1)
            most, offset, slope = friction_row(friction, i, j, towards, rest, within)
            room = rise
            if margins:
                of = friction_rise(friction, i, j, offset, slope, motion[0])
                room += of[0] * bounds.u[i] + of[1] * bounds.x[i] + of[2] * abs(bounds.k[i]) + of[3]
                left = rest - towards * most - offset * max(towards * v0, towards * v1, 0.0)
                _lose(lines, i, room, turn, left)
            else:
                most = 0.0  # rest is allowed where gravity takes all of the torque
            limit0 -= most + v0 * offset + towards * room
            limit1 -= most + v1 * offset + towards * room
            low0, high0 = (-math.inf, limit0) if side == 0 else (limit0, math.inf)
            low1, high1 = (-math.inf, limit1) if side == 0 else (limit1, math.inf)
            line = 2 * (j + side * rises.shape[1])
            _draw_row(lines, i, line, (a0, b0 + v0 * slope, low0, high0), motion, 0)
            _draw_row(lines, i, line + 1, (a1, b1 + v1 * slope, low1, high1), motion, 1)


@compiled(inner=True)
def _lose(lines: Lines, i: int, room: float, turn: float, rest: float) -> None:
    """Count the share `room` of what a limit leaves at rest; all where rest may not be allowed."""
    if room + turn > rest:
        lines.lost[i] = max(lines.lost[i], 1.0)
    elif room > lines.lost[i] * rest:
        lines.lost[i] = room / rest


@compiled(inner=True, fastmath=FUSED)
def _draw_caps(
    lines: Lines, limits: Limits, bounds: Bounds, i: int, w: float, margins: bool
) -> None:
    """Write the ceilings of x on interval i; arguments as in `_draw`."""
    squares, cap0, cap1 = limits.squares, limits.ceiling[i, 0], limits.ceiling[i, 1]
    lowest, steepest = min(cap0, cap1), 0.0
    for r in range(squares.most.shape[1]):
        b0, b1, most = squares.ends[i, 0, r], squares.ends[i, 1, r], squares.most[i, r]
        room, steepest = 1.0, max(steepest, b0, b1)
        if margins:
            room -= _margin(squares.rise, i, r, bounds)
        if most == 0.0 or room >= most * max(cap0, cap1):
            continue
        # Both ends with the margin, or both slow enough for the largest b of the interval.
        tight = 1.0 / most
        at0, at1 = (room / b0, room / b1) if room > 0.0 else (0.0, 0.0)
        if margins and at0 + at1 < 2 * tight:
            at0 = at1 = tight
        cap0, cap1 = min(cap0, at0), min(cap1, at1)
    # Where u falls, x lies above its chord.
    sag = max(-bounds.k[i], 0.0) * w * w / 4
    lines.cap[i, 0], lines.cap[i, 1] = cap0 - sag, cap1 - sag
    lines.lost[i] = 0.0
    if steepest > 0.0 and lowest > 0.0:
        lines.lost[i] = 1.0 - min(cap0, cap1) / min(lowest, 1.0 / steepest)


@compiled(inner=True, fastmath=FUSED)
def _draw(
    width: FloatArray, limits: Limits, bounds: Bounds, changed: BoolArray, kind: int, lines: Lines
) -> None:
    """Draw the limits for a plan within bounds, on the intervals that changed.

    Args:
        width: Lengths of the intervals, (n,).
        limits: The limits.
        bounds: The bounds.
        changed: Whether to draw each interval, (n,).
        kind: 2 with margins, 1 without them, 0 without viscous friction too.
        lines: Output.
    """
    rows, rounds, margins = limits.rows, limits.rounds, kind == 2
    count, rubs = rows.rise.shape[1], limits.friction.within.shape[1] if kind > 0 else 0
    for i in range(len(width)):
        if not changed[i]:
            continue
        w, turn, room = width[i], bounds.k[i] * width[i] / 2, 0.0
        _draw_caps(lines, limits, bounds, i, w, margins)
        if rubs > 0:
            _draw_friction(lines, limits, bounds, i, (w, turn), margins)
        for r in range(rubs, count):
            a0, b0, low0, high0 = _row(rows.ends, i, 0, r)
            a1, b1, low1, high1 = _row(rows.ends, i, 1, r)
            if margins:
                room = _margin(rows.rise, i, r, bounds)
                rest = min(min(high0, -low0), min(high1, -low1))
                _lose(lines, i, room, max(abs(a0), abs(a1)) * abs(turn), rest)
            _draw_row(lines, i, 2 * r, (a0, b0, low0 + room, high0 - room), (w, turn), 0)
            _draw_row(lines, i, 2 * r + 1, (a1, b1, low1 + room, high1 - room), (w, turn), 1)
        for r in range(rounds.radius.shape[1]):
            radius = rounds.radius[i, r]
            if margins:
                room = _margin(rounds.rise, i, r, bounds)
                first, _, _ = _products(rounds.ends, i, 0, r)
                last, _, _ = _products(rounds.ends, i, 1, r)
                _lose(lines, i, room, math.sqrt(max(first, last)) * abs(turn), radius)
            square = max(radius - room, 0.0) ** 2
            for end in range(2):
                _draw_conic(lines, i, r, rounds.ends, square, (w, turn), end)


@compiled(inner=True, fastmath=FUSED)
def _means(lines: Lines, i: int, x: float) -> tuple[float, float, float, float, int]:
    """Range of the mean u for x, how fast its bottom and its top fall with x, the line below."""
    of = lines.of
    low, high, below, above = -math.inf, math.inf, -1, -1
    for k in range(of.shape[1]):
        moved = of[i, k, 0] * x
        bottom, top = of[i, k, 1] - moved, of[i, k, 2] - moved
        if top < high:
            high, above = top, k
        if bottom > low:
            low, below = bottom, k
    low_tilt = of[i, below, 0] if below >= 0 else 0.0
    high_tilt = of[i, above, 0] if above >= 0 else 0.0
    for k in range(lines.conics.shape[1]):
        p, q, d0, d1, d2 = lines.conics[i, k]
        root = math.sqrt(max(d0 + x * (2 * d1 - d2 * x), LEAST))
        bend = (d1 - d2 * x) / root
        bottom, top = -p * x - q - root, -p * x - q + root
        if top < high:
            high, high_tilt = top, p - bend
        if bottom > low:
            low, low_tilt, below = bottom, p + bend, -1
    return low, high, low_tilt, high_tilt, below


@compiled(inner=True, allocates=True, fastmath=FUSED)
def _sweep(
    width: FloatArray, lines: Lines, rules: Rules, cap: FloatArray, most: FloatArray, x: FloatArray
) -> int:
    """Write the largest x that lead from start to end, backward and forward.

    Backward: the range of the mean u is concave in x and not empty for x = 0, so Newton's steps
    come down from the cap to the largest x that has a range.

    Args:
        width: Lengths of the intervals, (n,).
        lines: The limits.
        rules: The rules.
        cap: Takes the lower cap of both sides of every point, (n + 1,).
        most: Takes the largest x from which the end is reached, (n + 1,).
        x: Takes the plan, (n + 1,).

    Returns:
        -1, or the interval on which no motion is allowed.
    """
    n, below, mean = len(width), -1, np.empty(len(width))
    cap[0], cap[n] = lines.cap[0, 0], lines.cap[n - 1, 1]
    for i in range(1, n):
        cap[i] = min(lines.cap[i - 1, 1], lines.cap[i, 0])
    most[n] = min(rules.end, cap[n])
    if most[n] == math.inf:
        most[n] = 0.0
    for i in range(n - 1, -1, -1):
        steep, y = 0.5 / width[i], most[i + 1]
        # The line of y and one that bounds m from below bound x: the one of the interval before.
        here = min(cap[i], LARGEST_X)
        if below >= 0:
            tilt, bottom = lines.of[i, below, 0], lines.of[i, below, 1]
            if tilt < steep and y * steep - bottom < (steep - tilt) * here:
                here = max((y * steep - bottom) / (steep - tilt) * INSIDE, 0.0)
        for _ in range(100):
            low, high, low_tilt, high_tilt, below = _means(lines, i, here)
            if (y - here) * steep < high:
                high, high_tilt = (y - here) * steep, steep
            if -here * steep > low:
                low, low_tilt = -here * steep, steep
            if low <= high:
                break
            there = here - (low - high) / (high_tilt - low_tilt)
            # Next to nothing, a difference of large numbers: a step ends a little above it.
            here = there * INSIDE if there > FAR * here else max(there, 0.0) + ROUNDED * here
        else:
            return i
        most[i], mean[i] = here, high
    x[0] = min(rules.start, most[0])
    for i in range(n):
        steep, high = 0.5 / width[i], mean[i]
        if x[i] < most[i]:
            low, high, _, _, _ = _means(lines, i, x[i])
            high = min(high, (most[i + 1] - x[i]) * steep)
            if low > high + SLACK * (abs(low) + abs(high) + most[i + 1] * steep):
                return i
        x[i + 1] = min(max(x[i] + 2 * width[i] * high, 0.0), most[i + 1])
    return -1


@compiled(inner=True, fastmath=FUSED)
def _roots(rounds: Rounds, i: int, end: int, r: int, x: float) -> tuple[float, float]:
    """The smallest and the largest u that a vector allows."""
    aa = ab = bb = 0.0
    for d in range(3):
        a, b = rounds.ends[i, end, r, A, d], rounds.ends[i, end, r, B, d] * x
        aa, ab, bb = aa + a * a, ab + a * b, bb + b * b
    if aa == 0.0:
        return -math.inf, math.inf
    root = math.sqrt(max(ab * ab - aa * (bb - rounds.radius[i, r] ** 2), 0.0))
    return (-ab - root) / aa, (-ab + root) / aa


@compiled(inner=True, fastmath=FUSED)
def range_of(limits: Limits, i: int, end: int, x: float) -> tuple[float, float, int, int]:
    """The smallest and the largest u at one end of an interval, and the bounds that do so."""
    rows, viscous, rounds = limits.rows.ends, limits.friction.viscous, limits.rounds
    low, high, below, above = -math.inf, math.inf, -1, -1
    for r in range(rows.shape[2]):
        a, by_x = rows[i, end, r, A], rows[i, end, r, B] * x
        if a == 0.0:
            continue
        if r < viscous.shape[2]:
            by_x += viscous[i, end, r] * math.sqrt(x)
        inverse = 1.0 / a
        first = (rows[i, end, r, LOW] - by_x) * inverse
        last = (rows[i, end, r, HIGH] - by_x) * inverse
        bottom, top = 2 * r, 2 * r + 1
        if inverse < 0.0:
            first, last, bottom, top = last, first, top, bottom
        if first > low:
            low, below = first, bottom
        if last < high:
            high, above = last, top
    for r in range(rounds.radius.shape[1]):
        first, last = _roots(rounds, i, end, r, x)
        if first > low:
            low, below = first, 2 * (rows.shape[2] + r)
        if last < high:
            high, above = last, 2 * (rows.shape[2] + r) + 1
    return low, high, below, above


@compiled(inner=True, fastmath=FUSED)
def _steer(
    width: FloatArray, limits: Limits, cap: FloatArray, x: FloatArray, bounds: Bounds
) -> None:
    """Write slopes with which u stays at its bound on the whole interval."""
    for i in range(len(width)):
        w, x0, x1 = width[i], x[i], x[i + 1]
        bounds.k[i] = 0.0
        if not (0.0 < x0 < cap[i] * BELOW_CEILING and 0.0 < x1 < cap[i + 1] * BELOW_CEILING):
            continue
        mean = (x1 - x0) / (2 * w)
        low0, high0, _, _ = range_of(limits, i, 0, x0)
        low1, high1, _, _ = range_of(limits, i, 1, x1)
        near0, near1 = NEAR * (high0 - low0), NEAR * (high1 - low1)
        turn = 0.0
        if high0 - mean < near0 or high1 - mean < near1:
            turn = high1 - high0
            if mean - low0 < near0 or mean - low1 < near1:
                turn = 0.0
        elif mean - low0 < near0 or mean - low1 < near1:
            turn = low1 - low0
        small = abs(turn) < LARGEST_TURN * min(high0 - low0, high1 - low1)
        # x must not dip deeply.
        if small and 8 * turn * w <= x0 + x1:
            bounds.k[i] = turn / w


@compiled(inner=True, fastmath=FUSED)
def _sizes(width: FloatArray, x: FloatArray, k: FloatArray, i: int) -> tuple[float, float, float]:
    """The largest and the smallest x, and the largest |u|, on an interval."""
    w, first, last = width[i], x[i], x[i + 1]
    mean, turn = (last - first) / (2 * w), abs(k[i]) * w / 2
    sag = turn * w / 2
    return max(first, last) + sag, max(min(first, last) - sag, 0.0), abs(mean) + turn


@compiled(inner=True, allocates=True, fastmath=FUSED)
def _enclose(
    width: FloatArray, x: FloatArray, rules: Rules, headroom: float, bounds: Bounds
) -> None:
    """Write bounds around a plan; u of its neighbours counts too, as switches move."""
    n, fastest = len(width), 0.0
    rates = np.empty(n)
    for i in range(n):
        largest, least, rates[i] = _sizes(width, x, bounds.k, i)
        bounds.x[i], bounds.least[i] = headroom * largest, least / headroom
        fastest = max(fastest, rates[i])
    for i in range(n):
        most = rules.floor * fastest
        for m in range(max(i - rules.window, 0), min(i + rules.window + 1, n)):
            most = max(most, headroom * rates[m])
        bounds.u[i] = most


@compiled(inner=True, fastmath=FUSED)
def _widen(
    width: FloatArray, x: FloatArray, rules: Rules, bounds: Bounds, rubs: bool, changed: BoolArray
) -> bool:
    """The proof: say whether a plan is within its bounds; where it is not, widen them."""
    holds = True
    for i in range(len(width)):
        largest, least, rate = _sizes(width, x, bounds.k, i)
        out = largest > bounds.x[i] or rate > bounds.u[i]
        if rubs and least < bounds.least[i]:
            out, bounds.least[i] = True, least / (rules.headroom * rules.headroom)
        if out:
            bounds.x[i] = max(bounds.x[i], rules.headroom * largest)
            bounds.u[i] = max(bounds.u[i], 1.2 * rate)
        speeds = math.sqrt(x[i]) + math.sqrt(x[i + 1])
        if 4 * bounds.k[i] * width[i] ** 2 > speeds**2:  # x would dip deeply
            bounds.k[i], out = 0.0, True
        changed[i] = out
        holds &= not out
    return holds


@compiled(inner=True)
def _unlimited(limits: Limits) -> int:
    """The first interval on which nothing limits the acceleration; -1 for none."""
    ends, rounds = limits.rows.ends, limits.rounds.ends
    for i in range(ends.shape[0]):
        limited = False
        for r in range(ends.shape[2]):
            for end in range(2):
                both = ends[i, end, r, LOW] > -math.inf and ends[i, end, r, HIGH] < math.inf
                limited |= both and ends[i, end, r, A] != 0.0
            if limited:
                break
        for r in range(rounds.shape[2]):
            for end in range(2):
                aa, _, _ = _products(rounds, i, end, r)
                limited |= aa > 0.0
        if not limited:
            return i
    return -1


@compiled(inner=True)
def _worst(lost: FloatArray) -> int:
    """The interval on which margins take the largest share."""
    worst = 0
    for i in range(len(lost)):
        if lost[i] > lost[worst]:
            worst = i
    return worst


@compiled(inner=True)
def _duration(width: FloatArray, x: FloatArray, k: FloatArray) -> float:
    total = 0.0
    for i in range(len(width)):
        total += interval_time(width[i], math.sqrt(x[i]), math.sqrt(x[i + 1]), k[i])
    return total


@compiled(inner=True)
def _is_near(x: FloatArray, bounds: Bounds, near: float) -> bool:
    """Whether a plan is near that about which friction is linear; makes it that plan."""
    found = True
    for i in range(len(bounds.x)):
        middle = (x[i] + x[i + 1]) / 2
        found &= abs(middle - bounds.x[i]) <= near * bounds.x[i]
        bounds.x[i] = bounds.least[i] = middle
    return found


@compiled(inner=True)
def _judge_ends(stuck: int, rules: Rules, most: FloatArray, x: FloatArray) -> tuple[int, float]:
    """The outcome of a sweep, and the largest ds² at the end that is too fast."""
    n = len(x) - 1
    if rules.start < math.inf and min(rules.start, most[0]) < rules.start * (1 - PLAY):
        return START, most[0]
    if stuck >= 0:
        return STUCK, 0.0
    if rules.end < math.inf and x[n] < rules.end * (1 - PLAY):
        return END, x[n]
    return FOUND, 0.0


@compiled(inner=True)
def _drop_slopes(bounds: Bounds, lost: FloatArray, most: float, changed: BoolArray) -> bool:
    """Leave out slopes where margins take more than a share, and say whether there were any."""
    again = False
    for i in range(len(lost)):
        changed[i] = lost[i] > most and bounds.k[i] != 0.0
        if changed[i]:
            bounds.k[i], again = 0.0, True
    return again


@compiled()
def plan_on_grid(grid: Intervals, limits: Limits, rules: Rules) -> Plan:
    """Plan without margins; then with margins for bounds around that plan, until it is within.

    With one try only: the plan without margins, and FINER.

    Args:
        grid: The intervals.
        limits: The limits.
        rules: The rules.
    """
    n, count = len(grid.piece), limits.rows.rise.shape[1]
    rubbing, rounds = limits.friction.within.shape[1], limits.rounds.radius.shape[1]
    width, x, most, cap = np.empty(n), np.zeros(n + 1), np.empty(n + 1), np.empty(n + 1)
    bounds = Bounds(np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n))
    changed = np.ones(n, np.bool_)
    of, conics = np.empty((n, 2 * (count + rubbing), 3)), np.empty((n, 2 * rounds, 5))
    lines = Lines(of, conics, np.empty((n, 2)), np.zeros(n))
    found, lost, shortest = np.zeros(n + 1), np.zeros(n), math.inf
    slopes, kind, tangents = np.zeros(n), 0, 0
    for i in range(n):
        width[i] = grid.s[i + 1] - grid.s[i]
        # Without friction there are no lines for it.
        for line in range(2 * count, of.shape[1]):
            of[i, line, 0], of[i, line, 1], of[i, line, 2] = 0.0, -math.inf, math.inf
    place = _unlimited(limits)
    if place >= 0:
        return Plan(x, bounds.k, lost, UNLIMITED, place, 0.0)
    for _ in range(rules.tries):
        _draw(width, limits, bounds, changed, kind, lines)
        worst = _worst(lines.lost)
        if kind == 2 and lines.lost[worst] > rules.most:
            if _drop_slopes(bounds, lines.lost, max(rules.most, rules.steady), changed):
                continue
            break
        stuck = _sweep(width, lines, rules, cap, most, x)
        outcome, allowed = _judge_ends(stuck, rules, most, x)
        if outcome != FOUND:
            if shortest < math.inf:
                break
            if kind == 2 and n <= rules.enough:
                # Near the place where the motion gets stuck; anywhere if an end is too fast.
                for i in range(n):
                    if stuck < 0 or abs(i - stuck) < AROUND:
                        lines.lost[i] = max(lines.lost[i], NO_WAY)
                return Plan(x, bounds.k, lines.lost, FINER, max(stuck, 0), 0.0)
            return Plan(x, bounds.k, lines.lost, outcome, stuck, allowed)
        if kind < 2:
            near = _is_near(x, bounds, rules.near)
            kind = 1
            if rubbing and not near and tangents < rules.tangents:
                tangents += 1
                continue
            _steer(width, limits, cap, x, bounds)
            _enclose(width, x, rules, rules.headroom, bounds)
            changed[:] = True
            kind = 2
        elif _widen(width, x, rules, bounds, rubbing > 0, changed):
            if not rubbing:
                return Plan(x, bounds.k, lines.lost, FOUND, -1, 0.0)
            duration = _duration(width, x, bounds.k)
            better = duration < shortest * (1 - rules.gain)
            if duration < shortest:
                shortest = duration
                found, slopes, lost = x.copy(), bounds.k.copy(), lines.lost.copy()
            if not better:
                break
            _enclose(width, x, rules, rules.close, bounds)
            changed[:] = True
    if shortest < math.inf:
        return Plan(found, slopes, lost, FOUND, -1, 0.0)
    worst = _worst(lines.lost)
    if lines.lost[worst] <= rules.most:
        for i in range(n):
            if changed[i]:
                lines.lost[i] = NO_WAY
        worst = _worst(lines.lost)
    return Plan(x, bounds.k, lines.lost, FINER, worst, 0.0)
