"""Compiled limits of each interval as half-planes and conics in the plane of x and m.

On each interval u is linear in s with a slope k that is chosen in advance. With the mean m of u and
the half change t = k w / 2, u is m - t and m + t at the ends, and x at the end is x + 2 w m. All
limits of an interval are therefore half-planes and conics in the plane of x and m.
docs/concepts/time_optimal.md has the derivation.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.kernel_cache import FUSED, compiled
from armcontour.core.simd import LANES, choose, higher, highest, load, lower, lowest, size, store
from armcontour.planning.topp.friction_rows import Row, bracket, linear_row
from armcontour.planning.topp.joint_derivatives import derivative_bounds, next_joint, path_slopes
from armcontour.planning.topp.limit_forms import (
    BACKWARD,
    BY_CONSTANT,
    BY_SLOPE,
    BY_U,
    BY_X,
    FORWARD,
    HIGH,
    HIGHEST,
    LOW,
    LOWEST,
    ROWS,
    X_ROUNDING,
    A,
    B,
    GridLimits,
    Intervals,
    MotionBounds,
    Rounds,
)

Vector = Any  # SIMD vector of LANES numbers

# Factor that puts the result of a Newton step inside the limits despite rounding.
INSIDE_FACTOR = 1 - 1e-14
# A coefficient below this fraction of its terms is zero.
ZERO_SHARE = 1e-14
# Coefficients below this are zero.
NEGLIGIBLE_COEFFICIENT = 1e-150
# Number of stored intervals, which limits the memory.
STORED_INTERVALS = 1 << 13


class LimitLines(NamedTuple):
    """Limits in the plane of x at the start and m, the mean of u, of each interval."""

    # Tilts, bottoms and tops of the lines `bottom <= m + tilt x <= top` of the stored intervals,
    # flat. Every group of LANES joints or rows has LANES lines for the start of an interval and
    # LANES lines for the end.
    table: FloatArray
    width: int  # Number of lines of an interval
    # Index of the interval in each slot, (slots,); at most STORED_INTERVALS intervals are stored
    slot_interval: IntArray
    # p, q, d0, d1 and d2 of the conics `|m + p x + q|² <= d0 + 2 d1 x - d2 x²` of the stored
    # intervals, (slots, conics, 5)
    conics: FloatArray
    cap: FloatArray  # Largest x at the start and at the end, (n, 2)
    lost: FloatArray  # Fraction of limits that margins take, (n,)
    scratch: FloatArray


@compiled(inner=True, allocates=True)
def make_lines(limits: GridLimits, lost: FloatArray) -> LimitLines:
    """Make the lines for all limits, without any limit on an interval yet.

    - `lost`: array of the field `lost`.
    """
    n = len(lost)
    slots = 1
    joint_groups = len(limits.joints) // ROWS
    while slots < min(n, STORED_INTERVALS):
        slots *= 2
    rows = limits.rows.rise.shape[1] + limits.friction.within.shape[1]
    row_groups = (rows + LANES - 1) // LANES
    width = 2 * LANES * max(1, joint_groups + row_groups)
    lines = LimitLines(
        np.empty(3 * width * slots),
        width,
        np.full(slots, -1),
        np.empty((slots, 2 * limits.rounds.radius.shape[1], 5)),
        np.empty((n, 2)),
        lost,
        np.empty(9 * LANES),
    )
    if row_groups > 0 or joint_groups == 0:
        # Lines that are never written must not limit x or m.
        table = lines.table.reshape((slots, 3, width))
        for slot in range(slots):
            for line in range(width):
                table[slot, 0, line] = 0.0
                table[slot, 1, line] = -math.inf
                table[slot, 2, line] = math.inf
    return lines


@compiled(inner=True, fastmath=FUSED)
def _margin(rise: FloatArray, i: int, r: int, bounds: MotionBounds) -> float:
    """Return the margin of row r on interval i, which is valid within the bounds."""
    by = rise[i, r, BY_U] * bounds.u[i] + rise[i, r, BY_X] * bounds.x[i]
    return float(by + rise[i, r, BY_SLOPE] * abs(bounds.k[i]) + rise[i, r, BY_CONSTANT])


@compiled(inner=True, fastmath=FUSED)
def _write_half_plane(
    lines: LimitLines,
    location: tuple[int, int, int],
    motion: tuple[float, float],
    row: Row,
) -> None:
    """Write the half-planes `low <= a u + b x <= high` of LANES rows at one end of an interval.

    With the half change t of u, the rows are, at the start and at the end,

        low + a t <= a m + b x <= high + a t,
        low - a t <= (a + 2 w b) m + b x <= high - a t.

    They are divided by the factor of m. Rows without m become a ceiling of x, because rest
    satisfies every row.

    - `location`: interval, end and first line.
    - `motion`: w, the length of the interval, and t.
    """
    i, end, line = location
    w, turn = motion
    a = row.a
    b = row.b
    # Factor of m, and bounds of the row
    shift = turn - 2 * turn * end
    low, high = row.low + shift * a, row.high + shift * a
    by_mean = a + (2 * w * end) * b
    # Ceilings of rows whose factor of m is a rounding error
    bends = 2 * w * size(b)
    magnitude = size(by_mean)
    threshold = ZERO_SHARE * (size(a) + bends)
    alone = size(a) - ZERO_SHARE * bends
    if lowest(lower(magnitude - threshold, alone)) <= 0.0:
        largest = choose(NEGLIGIBLE_COEFFICIENT, size(b), higher(low / b, high / b), math.inf)
        ceiling = higher(choose(threshold, magnitude, math.inf, largest), 0.0)
        lines.cap[i, 0] = min(lines.cap[i, 0], lowest(ceiling))
        ceiling = higher(choose(0.0, alone, math.inf, largest), 0.0)
        lines.cap[i, end] = min(lines.cap[i, end], lowest(ceiling))
        magnitude = choose(threshold, magnitude, choose(0.0, alone, magnitude, 0.0), 0.0)
    # Lines `bottom <= m + tilt x <= top` of the other rows
    inverse = 1.0 / choose(NEGLIGIBLE_COEFFICIENT, magnitude, by_mean, 1.0)
    low, high = low * inverse, high * inverse
    first = 3 * lines.width * (i & (len(lines.slot_interval) - 1)) + line
    last = first + 2 * lines.width
    bottom = choose(NEGLIGIBLE_COEFFICIENT, magnitude, lower(low, high), -math.inf)
    top = choose(NEGLIGIBLE_COEFFICIENT, magnitude, higher(low, high), math.inf)
    store(lines.table, first, choose(NEGLIGIBLE_COEFFICIENT, magnitude, b * inverse, 0.0))
    store(lines.table, first + lines.width, bottom)
    store(lines.table, last, top)


@compiled(inner=True, fastmath=FUSED)
def _write_half_planes(
    lines: LimitLines,
    i: int,
    line: int,
    motion: tuple[float, float],
    rows: tuple[Row, Row],
    room: Vector,
    margins: bool,
) -> None:
    """Write LANES rows, less their margins, at both ends of interval i; record the margins."""
    start, end = rows
    if margins:
        remaining = lower(lower(start.high, 0.0 - start.low), lower(end.high, 0.0 - end.low))
        used = room + abs(motion[1]) * higher(size(start.a), size(end.a))
        # The share is 1 if rest may violate a limit.
        share = choose(0.0, room, choose(remaining, used, 1.0, room / remaining), 0.0)
        lines.lost[i] = max(lines.lost[i], highest(share))
    first = Row(start.a, start.b, start.low + room, start.high - room)
    last = Row(end.a, end.b, end.low + room, end.high - room)
    _write_half_plane(lines, (i, 0, line), motion, first)
    _write_half_plane(lines, (i, 1, line + LANES), motion, last)


@compiled(inner=True)
def _square_of_a(ends: FloatArray, i: int, end: int, r: int) -> float:
    """Return `|a|²` for the vector limit r at one end of interval i."""
    square = 0.0
    for d in range(3):
        square += ends[i, end, r, A, d] * ends[i, end, r, A, d]
    return square


@compiled(inner=True)
def _write_conic(
    lines: LimitLines,
    i: int,
    r: int,
    ends: FloatArray,
    square: float,
    motion: tuple[float, float],
    end: int,
) -> None:
    """Write the conic `|a u + b x|² <= square` at one end of an interval.

    The vector is `e m + b x`, plus or minus t a, where the factor e of m is a at the start and
    `a + 2 w b` at the end. Completing the square in m gives the conic

        (m + p x + q)² <= d0 + 2 d1 x - d2 x²,  p = e b / e e,  d2 = |e x b|² / (e e)²,

    with `q = -t`, `d0 = square / e e` and `d1 = 0` at the start. At the end, x is replaced by
    `x - 2 w t`, so `q = t (1 - 2 w p)`, `d1 = 2 w t d2` and `d0 = square / e e - d2 (2 w t)²`.

    - `motion`: w, the length of the interval, and t, the half change of u.
    """
    w, turn = motion
    out = lines.conics[i & (len(lines.slot_interval) - 1), 2 * r + end]
    for d in range(5):
        out[d] = 0.0
    # Vectors a, b and e, and their products
    step = 2 * w * end
    a0 = ends[i, end, r, A, 0]
    a1 = ends[i, end, r, A, 1]
    a2 = ends[i, end, r, A, 2]
    b0 = ends[i, end, r, B, 0]
    b1 = ends[i, end, r, B, 1]
    b2 = ends[i, end, r, B, 2]
    e0 = a0 + step * b0
    e1 = a1 + step * b1
    e2 = a2 + step * b2
    ee = e0 * e0 + e1 * e1 + e2 * e2
    eb = e0 * b0 + e1 * b1 + e2 * b2
    aa = a0 * a0 + a1 * a1 + a2 * a2
    bb = b0 * b0 + b1 * b1 + b2 * b2
    if ee <= ZERO_SHARE**2 * (aa + 4 * w * w * bb):
        # Without m, the limit is a ceiling of x at the start.
        out[2] = math.inf
        if bb > 0.0:
            largest = math.sqrt(square / bb) - 2 * w * abs(turn)
            lines.cap[i, 0] = min(lines.cap[i, 0], max(largest, 0.0))
        return
    # The cross product e x b equals a x b. Unlike `(e e) (b b) - (e b)²`, it has only the rounding
    # error of the vectors.
    c0 = e1 * b2 - e2 * b1
    c1 = e2 * b0 - e0 * b2
    c2 = e0 * b1 - e1 * b0
    spread = (c0 * c0 + c1 * c1 + c2 * c2) / (ee * ee)
    out[0] = eb / ee
    out[4] = spread
    if end == 0:
        out[1] = -turn
        out[2] = square / ee
    else:
        out[1] = turn * (1 - step * out[0])
        out[2] = square / ee - spread * (step * turn) ** 2
        out[3] = step * spread * turn
    # The ceiling of x is the largest x for which some m exists.
    if spread > 0.0:
        root = math.sqrt(max(out[3] * out[3] + spread * out[2], 0.0))
        lines.cap[i, 0] = min(lines.cap[i, 0], max((out[3] + root) / spread * INSIDE_FACTOR, 0.0))


@compiled(inner=True)
def _record_margin(lines: LimitLines, i: int, room: float, turn: float, remaining: float) -> None:
    """Record the fraction of a limit at rest that `room` takes; 1 if rest may violate the limit."""
    if room + turn > remaining:
        lines.lost[i] = max(lines.lost[i], 1.0)
    elif room > lines.lost[i] * remaining:
        lines.lost[i] = room / remaining


@compiled(inner=True, fastmath=FUSED)
def _write_ceilings(
    lines: LimitLines, limits: GridLimits, bounds: MotionBounds, i: int, w: float, margins: bool
) -> None:
    """Write the ceilings of x on interval i; arguments as in `write_interval_limits`."""
    squares = limits.squares
    cap0 = limits.ceiling[i, 0]
    cap1 = limits.ceiling[i, 1]
    lowest = min(cap0, cap1)
    steepest = 0.0
    for r in range(squares.largest.shape[1]):
        b0 = squares.ends[i, 0, r]
        b1 = squares.ends[i, 1, r]
        largest = squares.largest[i, r]
        room = 1.0
        steepest = max(steepest, b0, b1)
        if margins:
            room -= _margin(squares.rise, i, r, bounds)
        if largest == 0.0 or room >= largest * max(cap0, cap1):
            continue
        # Two conditions are sufficient: both ends satisfy their own `b x <= 1` with the margin
        # subtracted, or both ends satisfy it with the largest b of the interval. The less strict
        # one applies.
        tight = 1.0 / largest
        at0, at1 = (room / b0, room / b1) if room > 0.0 else (0.0, 0.0)
        if margins and at0 + at1 < 2 * tight:
            at0 = at1 = tight
        cap0 = min(cap0, at0)
        cap1 = min(cap1, at1)
    # If u decreases in s, x exceeds its chord by up to `sag`.
    sag = max(-bounds.k[i], 0.0) * w * w / 4
    lines.cap[i, 0] = cap0 - sag
    lines.cap[i, 1] = cap1 - sag
    lines.lost[i] = 0.0
    if steepest > 0.0 and lowest > 0.0:
        lines.lost[i] = 1.0 - min(cap0, cap1) / min(lowest, 1.0 / steepest)


@compiled(inner=True, fastmath=FUSED)
def _write_joint_half_planes(
    lines: LimitLines,
    grid: Intervals,
    limits: GridLimits,
    bounds: MotionBounds,
    i: int,
    location: tuple[int, int],
    margins: bool,
) -> None:
    """Write a group of joint bounds on interval i; `location` is the group and its first joint.

    With the derivatives q1 to q4 and the slope k of u, the acceleration g = q1 u + q2 x and the
    squared velocity h = q1² x of a joint have the second derivatives in s

        g'' = 5 q3 u + q4 x + 4 q2 k,  h'' = 8 q1 q2 u + 2 (q2² + q1 q3) x + 2 q1² k.

    Between the ends of an interval they exceed their chords by at most w² / 8 times these.
    """
    group, joint = location
    table = limits.joints
    offset = ROWS * group
    a0, b0 = path_slopes(grid, i, joint, 0)
    a1, b1 = path_slopes(grid, i, joint, 1)
    q3, q4 = derivative_bounds(grid, i, joint)
    w = grid.s[i + 1] - grid.s[i]
    slope = bounds.k[i]
    share = w * w / 8
    certain = share * q3
    q1 = higher(size(a0), size(a1)) + certain
    # Inverse square of the velocity limit; a joint that may reverse must satisfy both limits.
    back = load(table, offset + BACKWARD)
    forth = load(table, offset + FORWARD)
    by = choose(higher(a0, a1), 0.0 - certain, back, higher(forth, back))
    by = choose(certain, lower(a0, a1), forth, by)
    # Squared velocity as a fraction of its limit at x = 1, at both ends
    room = 0.0 * q1
    e0 = a0 * a0 * by
    e1 = a1 * a1 * by
    if margins:
        # Margin of the accelerations
        u = bounds.u[i]
        x = bounds.x[i]
        k = abs(slope)
        q2 = higher(size(b0), size(b1)) + w * q3
        room = (share * 5 * u) * q3 + (share * x) * q4 + (share * 4 * k) * q2
        room = room + (X_ROUNDING / w * x) * q1
        # The margin includes the rounding error of s.
        rounding = X_ROUNDING * max(abs(grid.s[i]), abs(grid.s[i + 1]))
        room = room + (rounding * u) * q2 + (rounding * x) * q3
        # Margin of the squared velocities
        second = (8 * u) * (q1 * q2) + (2 * x) * (q2 * q2 + q1 * q3) + (2 * k) * (q1 * q1)
        remaining = 1.0 - share * by * second
        largest = q1 * q1 * by
        plain = higher(e0, e1)
        # Two conditions are sufficient: both ends satisfy their own limit with the margin
        # subtracted, or both ends satisfy the limit with the largest h / x of the interval. The
        # less strict one applies.
        chord = choose(2.0 * e0 * e1, remaining * (e0 + e1) * largest, 1.0, 0.0)
        chord = choose(0.0, remaining, chord, 0.0)
        over = choose(0.0, chord, remaining, 1.0)
        e0 = choose(0.0, chord, e0, largest) / over
        e1 = choose(0.0, chord, e1, largest) / over
        gone = choose(0.0, plain, 1.0 - plain / higher(e0, e1), 0.0)
        lines.lost[i] = max(lines.lost[i], highest(gone))
    # If u decreases in s, x exceeds its chord by up to `sag`.
    sag = max(-slope, 0.0) * w * w / 4
    lines.cap[i, 0] = min(lines.cap[i, 0], 1.0 / highest(e0) - sag)
    lines.cap[i, 1] = min(lines.cap[i, 1], 1.0 / highest(e1) - sag)
    low = load(table, offset + LOWEST)
    high = load(table, offset + HIGHEST)
    rows = Row(a0, b0, low, high), Row(a1, b1, low, high)
    _write_half_planes(lines, i, 2 * LANES * group, (w, slope * w / 2), rows, room, margins)


@compiled(inner=True)
def _load_row(by_lane: FloatArray, first: int) -> Row:
    """Load LANES rows whose coefficients begin at index `first`."""
    return Row(
        load(by_lane, first + A * LANES),
        load(by_lane, first + B * LANES),
        load(by_lane, first + LOW * LANES),
        load(by_lane, first + HIGH * LANES),
    )


@compiled(inner=True)
def _write_row_half_planes(
    lines: LimitLines,
    limits: GridLimits,
    bounds: MotionBounds,
    i: int,
    first: int,
    w: float,
    margins: bool,
) -> None:
    """Write LANES rows of interval i from row `first` on, as half-planes."""
    # `by_lane` has LANES numbers for each coefficient of a row at its start, at its end, and for
    # its margin. Lanes without a row have no limit.
    by_lane = lines.scratch
    count = limits.rows.rise.shape[1] + limits.friction.within.shape[1]
    within = bracket(bounds.x_min[i], bounds.x[i])
    at_end = 4 * LANES
    at_margin = 8 * LANES
    for lane in range(LANES):
        start = end = Row(0.0, 0.0, -math.inf, math.inf)
        room = 0.0
        if first + lane < count:
            start, end, rise = linear_row(limits, i, first + lane, w, within, margins)
            if margins:
                by = rise.by_u * bounds.u[i] + rise.by_x * bounds.x[i]
                room = by + rise.by_slope * abs(bounds.k[i]) + rise.constant
        for k in range(4):
            by_lane[k * LANES + lane] = start[k]
            by_lane[at_end + k * LANES + lane] = end[k]
        by_lane[at_margin + lane] = room
    rows = _load_row(by_lane, 0), _load_row(by_lane, at_end)
    room_by_lane = load(by_lane, at_margin)
    # The lines of the joint bounds come first.
    line = 2 * (LANES * (len(limits.joints) // ROWS) + first)
    _write_half_planes(lines, i, line, (w, bounds.k[i] * w / 2), rows, room_by_lane, margins)


@compiled(inner=True, fastmath=FUSED)
def _write_conics(
    lines: LimitLines, rounds: Rounds, bounds: MotionBounds, i: int, w: float, margins: bool
) -> None:
    """Write the conics of interval i; arguments as in `write_interval_limits`."""
    ends = rounds.ends
    turn = bounds.k[i] * w / 2
    for r in range(rounds.radius.shape[1]):
        radius = rounds.radius[i, r]
        room = 0.0
        if margins:
            room = _margin(rounds.rise, i, r, bounds)
            by_u = math.sqrt(max(_square_of_a(ends, i, 0, r), _square_of_a(ends, i, 1, r)))
            _record_margin(lines, i, room, by_u * abs(turn), radius)
        square = max(radius - room, 0.0) ** 2
        for end in range(2):
            _write_conic(lines, i, r, ends, square, (w, turn), end)


@compiled(inner=True, fastmath=FUSED)
def write_interval_limits(
    grid: Intervals,
    limits: GridLimits,
    bounds: MotionBounds,
    i: int,
    margins: bool,
    lines: LimitLines,
) -> None:
    """Write all limits of interval i into `lines`, less their margins if `margins` is true."""
    groups = len(limits.joints) // ROWS
    count = limits.rows.rise.shape[1] + limits.friction.within.shape[1]
    w = grid.s[i + 1] - grid.s[i]
    lines.slot_interval[i & (len(lines.slot_interval) - 1)] = i
    _write_ceilings(lines, limits, bounds, i, w, margins)
    joint = 0
    for group in range(groups):
        _write_joint_half_planes(lines, grid, limits, bounds, i, (group, joint), margins)
        joint = next_joint(grid, joint)
    for r in range(0, count, LANES):
        _write_row_half_planes(lines, limits, bounds, i, r, w, margins)
    _write_conics(lines, limits.rounds, bounds, i, w, margins)
