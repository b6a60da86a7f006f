"""Compiled plan on a grid, first without margins, then with margins that are proven to suffice.

On each interval u is linear in s with a slope k that is chosen in advance. With the mean m of u and
the half change t = k w / 2, u is m - t and m + t at the ends, and x at the end is x + 2 w m. All
limits of an interval are therefore half-planes and conics in the plane of x and m.
docs/concepts/time_optimal.md has the derivation.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.core.kernel_cache import FUSED, compiled
from armcontour.core.simd import LANES, choose, higher, highest, load, lower, lowest, size, store
from armcontour.motion.kernels import interval_time
from armcontour.planning.topp.limit_forms import (
    BACKWARD,
    BY_CONSTANT,
    BY_SLOPE,
    BY_U,
    BY_X,
    DEVIATION,
    FORWARD,
    HIGH,
    HIGHEST,
    LANE,
    LARGEST,
    LOW,
    LOWEST,
    ROWS,
    SIGN,
    A,
    B,
    Friction,
    GridLimits,
    Intervals,
    LinearRows,
    Rounds,
)

Vector = Any  # SIMD vector of LANES numbers

FOUND, FINER, STUCK, START, END, UNLIMITED = range(6)
# factor that puts the result of a Newton step inside the limits despite rounding
INSIDE = 1 - 1e-14
LARGEST_X = 1e100  # initial x of Newton's method without a ceiling
# a Newton step to less than this fraction of x has the rounding error ROUNDED, because its result
# is a small difference of large numbers
FAR = 1e-3
ROUNDED = 1e-12  # rounding error of such a step, as a fraction of x before the step
SLACK = 1e-9  # relative rounding error of the ends of a range of u
END_TOLERANCE = 1e-7  # relative tolerance of x at the start and the end of the path
ROUNDING = 2e-15  # rounding error of differences of x, as a fraction of x
TINY = 1e-14  # a coefficient below this fraction of its terms is zero
NEAR = 0.01  # u is at its bound within this fraction of its range
BELOW_CEILING = 1 - 1e-6  # above this fraction of its ceiling, x is limited by the ceiling only
LARGEST_TURN = 0.25  # largest change of u by a slope, as a fraction of its range
NO_PLAN_MARGIN = (
    4e-2  # margin reported for intervals without a plan, because a finer grid may have a plan
)
# intervals closer than this (in indices) to the one where the plan fails are refined
REFINED_NEIGHBOURS = 10
# largest fraction of the limit at rest that the offset of a line above friction uses
MAX_OFFSET_SHARE = 0.5
NEGLIGIBLE = 1e-150  # coefficients below this are zero
BLOCK = 1 << 13  # number of stored intervals, which limits the memory
MIN_DIVISOR = 1e-300  # lower bound of divisors; its root is far below any path speed
MAX_STEPS = 100  # Newton steps to the largest x of an interval
# plans of a grid: without friction and margins, with friction, and also with margins
FREE, WITH_FRICTION, WITH_MARGINS = range(3)


class Rules(NamedTuple):
    """Parameters of the planner on a grid."""

    start: float = 0.0  # ds² at the start [m²/s²]; infinite for the largest feasible value
    end: float = 0.0  # ds² at the end [m²/s²]; infinite for the largest feasible value
    max_margin: float = 1e-2  # Largest fraction of a limit that margins may take
    # If margins exceed `max_margin`, slopes are first set to zero on intervals whose margins exceed
    # this share
    steady: float = 0.999
    headroom: float = 1.05  # Factor of the bounds of x and u relative to the plan without margins
    close: float = 1.02  # The same factor relative to a proven plan
    # U, the bound of |u|, includes this many neighbours on each side, because switching points move
    window: int = 1
    # Smallest U: this fraction of the largest |u| on the path, or of x divided by the width of the
    # interval if that is less, because |u| is unbounded where dq_ds vanishes
    floor: float = 1e-3
    tangents: int = 2  # Largest number of plans without margins in which friction is linearized
    near: float = 1e-2  # Relative change of x below which the linearization of friction is accepted
    tries: int = 30  # Largest number of plans on a grid
    # With more intervals, a plan that fails with margins is an error instead of FINER
    enough: int = 20_000
    # Bounds are tightened while this reduces the duration by more than this share
    gain: float = 1e-6


class MotionBounds(NamedTuple):
    """Bounds |u| <= `u` and `x_min` <= x <= `x` for valid margins, and slopes `k`, (n,) each."""

    x: FloatArray
    x_min: FloatArray
    u: FloatArray
    k: FloatArray


class GridPlan(NamedTuple):
    """A plan, or the reason why none exists."""

    x: FloatArray  # ds² at the ends of the intervals, (n + 1,)
    k: FloatArray  # Derivatives of dds in s, (n,)
    lost: FloatArray  # Fraction of limits that margins take, (n,)
    outcome: int  # FOUND, or FINER, STUCK, START, END, UNLIMITED
    interval: int
    allowed: float  # With START and END: the largest feasible ds² at this end [m²/s²]


class PassSquares(NamedTuple):
    """Results of a backward and a forward pass: ds² at the grid points [m²/s²], (n + 1,) each."""

    cap: FloatArray  # The smaller of the caps on both sides of a point
    reachable: FloatArray  # Largest value from which the end can be reached
    x: FloatArray  # The plan


class LimitLines(NamedTuple):
    """Limits in the plane of x at the start and m, the mean of u, of each interval."""

    # Tilts, bottoms and tops of the lines `bottom <= m + tilt x <= top` of the stored intervals,
    # flat. Every group of LANES joints or rows has LANES lines for the start of an interval and
    # LANES lines for the end.
    table: FloatArray
    width: int  # Number of lines of an interval
    # Index of the interval in each slot, (slots,); at most BLOCK intervals are stored
    slot_interval: IntArray
    # p, q, d0, d1 and d2 of the conics `|m + p x + q|² <= d0 + 2 d1 x - d2 x²` of the stored
    # intervals, (slots, conics, 5)
    conics: FloatArray
    cap: FloatArray  # Largest x at the start and at the end, (n, 2)
    lost: FloatArray  # Fraction of limits that margins take, (n,)
    scratch: FloatArray


class Row(NamedTuple):
    """A row `low <= a u + b x <= high` at one end of an interval; LANES rows, if of vectors."""

    a: float | Vector
    b: float | Vector
    low: float | Vector
    high: float | Vector


@compiled(inner=True, fastmath=FUSED)
def _margin(rise: FloatArray, i: int, r: int, bounds: MotionBounds) -> float:
    """Margin of row r on interval i that is valid within the bounds."""
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

    Rows without m become a ceiling of x, because rest satisfies every row.

    - `location`: interval, end and first line.
    - `motion`: length of the interval, and half of the change of u.
    """
    i, end, line = location
    w, turn = motion
    a = row.a
    b = row.b
    shift = turn - 2 * turn * end
    low, high = row.low + shift * a, row.high + shift * a
    by_mean = a + (2 * w * end) * b
    bends = 2 * w * size(b)
    magnitude = size(by_mean)
    threshold = TINY * (size(a) + bends)
    alone = size(a) - TINY * bends
    if lowest(lower(magnitude - threshold, alone)) <= 0.0:
        largest = choose(NEGLIGIBLE, size(b), higher(low / b, high / b), math.inf)
        ceiling = higher(choose(threshold, magnitude, math.inf, largest), 0.0)
        lines.cap[i, 0] = min(lines.cap[i, 0], lowest(ceiling))
        ceiling = higher(choose(0.0, alone, math.inf, largest), 0.0)
        lines.cap[i, end] = min(lines.cap[i, end], lowest(ceiling))
        magnitude = choose(threshold, magnitude, choose(0.0, alone, magnitude, 0.0), 0.0)
    inverse = 1.0 / choose(NEGLIGIBLE, magnitude, by_mean, 1.0)
    low, high = low * inverse, high * inverse
    first = 3 * lines.width * (i & (len(lines.slot_interval) - 1)) + line
    last = first + 2 * lines.width
    bottom = choose(NEGLIGIBLE, magnitude, lower(low, high), -math.inf)
    top = choose(NEGLIGIBLE, magnitude, higher(low, high), math.inf)
    store(lines.table, first, choose(NEGLIGIBLE, magnitude, b * inverse, 0.0))
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


class Bracket(NamedTuple):
    """Range of x on an interval: smallest x, and roots of the smallest and the largest x."""

    smallest: float
    low: float
    high: float


@compiled(inner=True)
def bracket(smallest: float, largest: float) -> Bracket:
    """Make the bracket from the smallest to the largest x."""
    return Bracket(smallest, math.sqrt(smallest), math.sqrt(max(largest, MIN_DIVISOR)))


@compiled(inner=True)
def bound_friction(
    friction: Friction, i: int, j: int, towards: float, room: float, within: Bracket
) -> tuple[float, float, float]:
    """Upper bound, linear in x, of friction in the row of one limit of joint j on interval i.

    If the joint may reverse, the bound is the largest friction on the interval. Otherwise it is the
    friction at each end of the interval, multiplied by a line in x that bounds the root of x. The
    lower line is the chord of the root. The upper line is the tangent with equal excess at both
    ends of the bracket. The friction of its offset may be at most the share MAX_OFFSET_SHARE of
    `room`, the limit at rest. If it is larger, the upper line is the tangent at a smaller x that
    has the allowed offset. If this x is below the smallest x, the upper line has the allowed offset
    and passes through the root at the smallest x.

    Returns the largest friction, or 0; offset and slope of the line, or 0.

    - `towards`: 1 for the upper limit, -1 for the lower one.
    - `within`: the bracket of x.
    """
    largest = friction.within[i, j, LARGEST]
    sign = friction.within[i, j, SIGN]
    if sign == 0.0:
        return towards * largest * within.high, 0.0, 0.0
    total = within.low + within.high
    if sign != towards:
        slope = 1 / total
        return 0.0, within.low * within.high * slope, slope
    offset = total / 4
    if offset * largest > MAX_OFFSET_SHARE * room:
        offset = max(MAX_OFFSET_SHARE * room / largest, MIN_DIVISOR)
    if offset >= within.low / 2:
        return 0.0, offset, 1 / (4 * offset)
    return 0.0, offset, (within.low - offset) / within.smallest


@compiled(inner=True)
def friction_rise(
    friction: Friction, i: int, j: int, offset: float, slope: float, w: float
) -> tuple[float, float, float, float]:
    """Rise that the line of `bound_friction` adds to a row: factors of U, X, slope and 1.

    The slope of the line adds to b, so its product with x curves as b x does. In addition, the
    friction deviates from its chord.

    `w` is the length of the interval.
    """
    v0 = friction.viscous[i, 0, j]
    v1 = friction.viscous[i, 1, j]
    deviation = friction.within[i, j, DEVIATION]
    by_slope = slope * max(abs(v0), abs(v1)) * w * w / 4
    return slope * abs(v1 - v0) * w / 2, slope * deviation, by_slope, offset * deviation


@compiled(inner=True)
def _square_of_a(ends: FloatArray, i: int, end: int, r: int) -> float:
    """Square of the vector a of limit r at one end of interval i."""
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
    """Write the conic `|a u + b x|² <= square` at one end of an interval."""
    w, turn = motion
    out = lines.conics[i & (len(lines.slot_interval) - 1), 2 * r + end]
    for d in range(5):
        out[d] = 0.0
    # The factor of m is a at the start, and a + 2 w b at the end.
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
    if ee <= TINY**2 * (aa + 4 * w * w * bb):
        # Without m, the limit is a ceiling of x at the start.
        out[2] = math.inf
        if bb > 0.0:
            largest = math.sqrt(square / bb) - 2 * w * abs(turn)
            lines.cap[i, 0] = min(lines.cap[i, 0], max(largest, 0.0))
        return
    # The cross product e x b equals a x b. It has the rounding error of the vectors.
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
        lines.cap[i, 0] = min(lines.cap[i, 0], max((out[3] + root) / spread * INSIDE, 0.0))


@compiled(inner=True)
def _row_end(ends: FloatArray, i: int, end: int, r: int) -> Row:
    """Row r at one end of interval i."""
    return Row(ends[i, end, r, A], ends[i, end, r, B], ends[i, end, r, LOW], ends[i, end, r, HIGH])


@compiled(inner=True)
def _subtract_friction(
    row: Row, viscous: float, line: tuple[float, float, float], towards: float
) -> Row:
    """One limit of a row, less the friction of the line of `bound_friction`.

    - `viscous`: friction at x = 1.
    - `line`: largest friction, offset and slope.
    - `towards`: 1 for the upper limit, -1 for the lower one.
    """
    largest, offset, slope = line
    b = row.b + viscous * slope
    less = viscous * offset + largest
    if towards > 0.0:
        return Row(row.a, b, -math.inf, row.high - less)
    return Row(row.a, b, row.low - less, math.inf)


@compiled(inner=True)
def _linear_row(
    limits: GridLimits, i: int, r: int, w: float, within: Bracket, margins: bool
) -> tuple[Row, Row, tuple[float, float, float, float]]:
    """Row r of interval i at its start and at its end, and its rise.

    Rows with friction come first: all upper limits, then all lower limits. `margins` adds the
    friction of joints that may reverse.
    """
    friction = limits.friction
    count = limits.friction.within.shape[1]
    j = r if r < count else r - count
    start = _row_end(limits.rows.ends, i, 0, j)
    end = _row_end(limits.rows.ends, i, 1, j)
    rise = limits.rows.rise
    by_u = rise[i, j, BY_U]
    by_x = rise[i, j, BY_X]
    by_slope = rise[i, j, BY_SLOPE]
    alone = rise[i, j, BY_CONSTANT]
    if r < 2 * count:
        towards = 1.0
        room = min(start.high, end.high)
        if r >= count:
            towards = -1.0
            room = min(-start.low, -end.low)
        largest, offset, slope = bound_friction(friction, i, j, towards, room, within)
        line = largest * margins, offset, slope
        start = _subtract_friction(start, friction.viscous[i, 0, j], line, towards)
        end = _subtract_friction(end, friction.viscous[i, 1, j], line, towards)
        added = friction_rise(friction, i, j, offset, slope, w)
        by_u = by_u + added[BY_U]
        by_x = by_x + added[BY_X]
        by_slope = by_slope + added[BY_SLOPE]
        alone = alone + added[BY_CONSTANT]
    return start, end, (by_u, by_x, by_slope, alone)


@compiled()
def rows_with_friction(
    width: FloatArray, limits: GridLimits, bounds: MotionBounds, margins: bool
) -> LinearRows:
    """Linear rows: upper limits with friction, lower limits with friction, other rows.

    - `width`: lengths of the intervals, (n,).
    - `bounds`: bounds of the plan, which include the range of x.
    - `margins`: true to add the friction of joints that may reverse.
    """
    n = len(width)
    count = limits.rows.rise.shape[1] + limits.friction.within.shape[1]
    rows = LinearRows(np.empty((n, 2, count, 4)), np.empty((n, count, 4)))
    for i in range(n):
        within = bracket(bounds.x_min[i], bounds.x[i])
        for r in range(count):
            start, end, rise = _linear_row(limits, i, r, width[i], within, margins)
            for k in range(4):
                rows.ends[i, 0, r, k] = start[k]
                rows.ends[i, 1, r, k] = end[k]
                rows.rise[i, r, k] = rise[k]
    return rows


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
    """Write the ceilings of x on interval i; arguments as in `_write_interval_limits`."""
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


@compiled(inner=True)
def _coefficients(grid: Intervals, i: int, joint: int, power: int) -> Vector:
    """Coefficients of x^power of LANES joints on the piece of an interval."""
    return load(grid.coefficients, (6 * grid.piece[i] + power) * grid.dof + joint)


@compiled(inner=True, fastmath=FUSED)
def path_slopes(grid: Intervals, i: int, joint: int, end: int) -> tuple[Vector, Vector]:
    """dq_ds and d2q_ds2 of LANES joints at an end of an interval."""
    k = grid.piece[i]
    scale = 1.0 / (grid.breaks[k + 1] - grid.breaks[k])
    x = (grid.s[i + end] - grid.breaks[k]) * scale
    c1 = _coefficients(grid, i, joint, 1)
    c2 = _coefficients(grid, i, joint, 2)
    c3 = _coefficients(grid, i, joint, 3)
    c4 = _coefficients(grid, i, joint, 4)
    c5 = _coefficients(grid, i, joint, 5)
    first = c1 + x * (2.0 * c2 + x * (3.0 * c3 + x * (4.0 * c4 + (5.0 * x) * c5)))
    second = 2.0 * c2 + x * (6.0 * c3 + x * (12.0 * c4 + (20.0 * x) * c5))
    return scale * first, (scale * scale) * second


@compiled(inner=True, fastmath=FUSED)
def _derivative_bounds(grid: Intervals, i: int, joint: int) -> tuple[Vector, Vector]:
    """Bounds of |d3q_ds3| and |d4q_ds4| on an interval, by Taylor expansion about its middle."""
    k = grid.piece[i]
    scale = 1.0 / (grid.breaks[k + 1] - grid.breaks[k])
    begin = grid.breaks[k]
    middle = ((grid.s[i] + grid.s[i + 1]) / 2 - begin) * scale
    half = (grid.s[i + 1] - grid.s[i]) / 2 * scale
    cube = scale * scale * scale
    c3 = _coefficients(grid, i, joint, 3)
    c4 = _coefficients(grid, i, joint, 4)
    c5 = _coefficients(grid, i, joint, 5)
    q5 = 120.0 * size(c5)
    q4 = size(24.0 * c4 + (120.0 * middle) * c5) + half * q5
    q3 = size(6.0 * c3 + middle * (24.0 * c4 + (60.0 * middle) * c5))
    return cube * (q3 + half * (q4 - (half / 2) * q5)), (cube * scale) * q4


@compiled(inner=True)
def next_joint(grid: Intervals, joint: int) -> int:
    """First joint of the next group of joint bounds; 0 after the last group."""
    return joint + LANES if joint + LANES < grid.dof else 0


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
    """Write a group of joint bounds on interval i; `location` is the group and its first joint."""
    # With the derivatives q1 to q4 and the slope k of u, g = q1 u + q2 x has g'' = 5 q3 u + q4 x +
    # 4 q2 k, and h = q1² x has h'' = 8 q1 q2 u + 2 (q2² + q1 q3) x + 2 q1² k.
    group, joint = location
    table = limits.joints
    offset = ROWS * group
    a0, b0 = path_slopes(grid, i, joint, 0)
    a1, b1 = path_slopes(grid, i, joint, 1)
    q3, q4 = _derivative_bounds(grid, i, joint)
    w = grid.s[i + 1] - grid.s[i]
    slope = bounds.k[i]
    share = w * w / 8
    certain = share * q3
    q1 = higher(size(a0), size(a1)) + certain
    # A joint that may reverse must satisfy both bounds.
    back = load(table, offset + BACKWARD)
    forth = load(table, offset + FORWARD)
    by = choose(higher(a0, a1), 0.0 - certain, back, higher(forth, back))
    by = choose(certain, lower(a0, a1), forth, by)
    room = 0.0 * q1
    e0 = a0 * a0 * by
    e1 = a1 * a1 * by
    if margins:
        u = bounds.u[i]
        x = bounds.x[i]
        k = abs(slope)
        q2 = higher(size(b0), size(b1)) + w * q3
        room = (share * 5 * u) * q3 + (share * x) * q4 + (share * 4 * k) * q2
        room = room + (ROUNDING / w * x) * q1
        # The margin includes the rounding error of s.
        rounding = ROUNDING * max(abs(grid.s[i]), abs(grid.s[i + 1]))
        room = room + (rounding * u) * q2 + (rounding * x) * q3
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
            start, end, rise = _linear_row(limits, i, first + lane, w, within, margins)
            if margins:
                by = rise[BY_U] * bounds.u[i] + rise[BY_X] * bounds.x[i]
                room = by + rise[BY_SLOPE] * abs(bounds.k[i]) + rise[BY_CONSTANT]
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
    """Write the conics of interval i; arguments as in `_write_interval_limits`."""
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
def _write_interval_limits(
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


@compiled(inner=True, fastmath=FUSED)
def _mean_range(lines: LimitLines, i: int, x: float) -> tuple[float, float]:
    """Smallest and largest mean u of interval i for x at its start."""
    table = lines.table
    count = lines.width
    slot = i & (len(lines.slot_interval) - 1)
    first = 3 * count * slot
    tilted = x * load(table, first)
    bottom = load(table, first + count) - tilted
    top = load(table, first + 2 * count) - tilted
    for line in range(first + LANES, first + count, LANES):
        tilted = x * load(table, line)
        bottom = higher(bottom, load(table, line + count) - tilted)
        top = lower(top, load(table, line + 2 * count) - tilted)
    low = highest(bottom)
    high = lowest(top)
    for k in range(lines.conics.shape[1]):
        p, q, d0, d1, d2 = lines.conics[slot, k]
        root = math.sqrt(max(d0 + x * (2 * d1 - d2 * x), MIN_DIVISOR))
        low = max(low, -p * x - q - root)
        high = min(high, -p * x - q + root)
    return low, high


@compiled(inner=True, fastmath=FUSED)
def _mean_range_slopes(
    lines: LimitLines, i: int, x: float
) -> tuple[float, float, float, float, int]:
    """Range of the mean u at x, negative slopes of its ends in x, and index of its lower line."""
    table = lines.table
    count = lines.width
    slot = i & (len(lines.slot_interval) - 1)
    low = -math.inf
    high = math.inf
    below = -1
    above = -1
    for k in range(3 * count * slot, 3 * count * slot + count):
        moved = table[k] * x
        bottom = table[k + count] - moved
        top = table[k + 2 * count] - moved
        if top < high:
            high = top
            above = k
        if bottom > low:
            low = bottom
            below = k
    low_tilt = table[below] if below >= 0 else 0.0
    high_tilt = table[above] if above >= 0 else 0.0
    for k in range(lines.conics.shape[1]):
        p, q, d0, d1, d2 = lines.conics[slot, k]
        root = math.sqrt(max(d0 + x * (2 * d1 - d2 * x), MIN_DIVISOR))
        tilt = (d1 - d2 * x) / root
        bottom = -p * x - q - root
        top = -p * x - q + root
        if top < high:
            high = top
            high_tilt = p - tilt
        if bottom > low:
            low = bottom
            low_tilt = p + tilt
            below = -1
    return low, high, low_tilt, high_tilt, below - 3 * count * slot


@compiled(inner=True)
def _fastest_start(lines: LimitLines, w: float, ceiling: FloatArray) -> float:
    """ds² with the fastest motion on the first interval, if joints rest at the start at any ds."""
    # A ds² slightly below the largest one may allow a far larger u, because dq_ds is rounded.
    best = ceiling[0]
    fastest = 0.0
    for k in range(60, -1, -1):
        first = ceiling[0] * (1 - 0.5**k) if k < 60 else ceiling[0]
        _, high = _mean_range(lines, 0, first)
        last = min(first + 2 * w * high, ceiling[1])
        speeds = math.sqrt(first) + math.sqrt(max(last, 0.0))
        if speeds > fastest:
            best = first
            fastest = speeds
    return float(best)


@compiled(inner=True, fastmath=FUSED)
def _largest_start(
    lines: LimitLines, i: int, w: float, ceiling: float, last: float, below: int
) -> tuple[float, float, int, int]:
    """Largest x at the start of interval i from which x at its end is at most `last`.

    The range of the mean u is concave in x and not empty for x = 0, so Newton steps from the
    ceiling converge to the largest x with a range.

    Returns x; the largest mean u; the line that limits it from below, or -1; and FOUND, STUCK or
    UNLIMITED.

    - `w`: length of the interval.
    - `below`: the line that limits the mean u from below on interval i + 1, or -1.
    """
    steep = 0.5 / w
    x = ceiling
    high = 0.0
    # The same line on interval i and the largest x at its end give a first upper bound of x.
    if below >= 0:
        line = 3 * lines.width * (i & (len(lines.slot_interval) - 1)) + below
        tilt = lines.table[line]
        bottom = lines.table[line + lines.width]
        if tilt < steep and last * steep - bottom < (steep - tilt) * x:
            x = max((last * steep - bottom) / (steep - tilt) * INSIDE, 0.0)
    for _ in range(MAX_STEPS):
        low, high = _mean_range(lines, i, x)
        if low == -math.inf or high == math.inf:
            return x, high, below, UNLIMITED
        high = min(high, (last - x) * steep)
        if max(low, -x * steep) <= high:
            return x, high, below, FOUND
        low, high, low_tilt, high_tilt, below = _mean_range_slopes(lines, i, x)
        if (last - x) * steep < high:
            high = (last - x) * steep
            high_tilt = steep
        if -x * steep > low:
            low = -x * steep
            low_tilt = steep
        following = x - (low - high) / (high_tilt - low_tilt)
        # Near zero, x is a difference of large numbers, so a step ends slightly above the root.
        x = following * INSIDE if following > FAR * x else max(following, 0.0) + ROUNDED * x
    return x, high, below, STUCK


@compiled(inner=True, allocates=True, fastmath=FUSED)
def _backward_forward_pass(
    grid: Intervals,
    limits: GridLimits,
    bounds: MotionBounds,
    state: tuple[BoolArray, bool],
    lines: LimitLines,
    rules: Rules,
    squares: PassSquares,
) -> int:
    """Write the limits and the largest feasible x, by a backward and a forward pass.

    Returns -1 if a plan was found, the index of an interval on which no motion is allowed, or n
    plus the index of an interval without limits.

    - `state`: mask of the intervals to write, (n,), and true for limits with margins.
    - `squares`: output.
    """
    changed, margins = state
    cap, reachable, x = squares
    n = len(grid.piece)
    below = -1
    stuck = -1
    mean = np.empty(n)
    slots = len(lines.slot_interval) - 1
    # Interval i - 1 is written before interval i is planned, while the processor waits for data.
    for i in range(n, -1, -1):
        trial = math.inf
        if i > 0:
            if changed[i - 1] or lines.slot_interval[(i - 1) & slots] != i - 1:
                _write_interval_limits(grid, limits, bounds, i - 1, margins, lines)
            trial = lines.cap[i - 1, 1]
        if i < n:
            trial = min(trial, lines.cap[i, 0])
        cap[i] = trial
        if i == n:
            reachable[n] = min(rules.end, trial, LARGEST_X)
            continue
        if stuck >= n:
            low, high = _mean_range(lines, i, 0.0)
            if low > -math.inf and high < math.inf:
                break
            stuck = n + i
        if stuck >= 0:
            continue
        trial, mean[i], below, outcome = _largest_start(
            lines, i, grid.s[i + 1] - grid.s[i], min(trial, LARGEST_X), reachable[i + 1], below
        )
        reachable[i] = trial
        if outcome != FOUND:
            stuck = i if outcome == STUCK else n + i
    if stuck >= 0:
        return stuck
    x[0] = min(rules.start, reachable[0])
    if rules.start == math.inf:
        x[0] = _fastest_start(lines, grid.s[1] - grid.s[0], reachable)
    for i in range(n):
        w = grid.s[i + 1] - grid.s[i]
        high = mean[i]
        if x[i] < reachable[i]:
            if lines.slot_interval[i & slots] != i:
                _write_interval_limits(grid, limits, bounds, i, margins, lines)
            low, high = _mean_range(lines, i, x[i])
            steep = 0.5 / w
            high = min(high, (reachable[i + 1] - x[i]) * steep)
            if low > high + SLACK * (abs(low) + abs(high) + reachable[i + 1] * steep):
                return i
        x[i + 1] = min(max(x[i] + 2 * w * high, 0.0), reachable[i + 1])
    return -1


@compiled(inner=True, fastmath=FUSED)
def _round_range(rounds: Rounds, i: int, end: int, r: int, x: float) -> tuple[float, float]:
    """Smallest and largest u at one end of interval i within the limit r of a vector norm."""
    aa = ab = bb = 0.0
    for d in range(3):
        a = rounds.ends[i, end, r, A, d]
        b = rounds.ends[i, end, r, B, d] * x
        aa = aa + a * a
        ab = ab + a * b
        bb = bb + b * b
    if aa == 0.0:
        return -math.inf, math.inf
    root = math.sqrt(max(ab * ab - aa * (bb - rounds.radius[i, r] ** 2), 0.0))
    return (-ab - root) / aa, (-ab + root) / aa


@compiled(inner=True, fastmath=FUSED)
def _joint_acceleration_range(
    grid: Intervals, limits: GridLimits, location: tuple[int, int, int, int], x: float
) -> tuple[float, float, float, int, int]:
    """`acceleration_range` of a group of joint bounds.

    `location` is interval, end, group and first joint.
    """
    i, end, group, joint = location
    offset = ROWS * group
    a, b = path_slopes(grid, i, joint, end)
    magnitude = size(a)
    inverse = 1.0 / choose(NEGLIGIBLE, magnitude, a, 1.0)
    smallest = load(limits.joints, offset + LOWEST)
    largest = load(limits.joints, offset + HIGHEST)
    one = (smallest - x * b) * inverse
    other = (largest - x * b) * inverse
    bottom = choose(NEGLIGIBLE, magnitude, lower(one, other), -math.inf)
    top = choose(NEGLIGIBLE, magnitude, higher(one, other), math.inf)
    low = highest(bottom)
    high = lowest(top)
    # The active bounds are coded as twice the joint, plus one for an upper bound.
    lane = load(limits.joints, offset + LANE)
    below = highest(choose(bottom, low, -1.0, lane + choose(a, 0.0, 1.0, 0.0)))
    above = highest(choose(high, top, -1.0, lane + choose(a, 0.0, 0.0, 1.0)))
    wide = lowest(choose(NEGLIGIBLE, magnitude, size((largest - smallest) * inverse), math.inf))
    return low, high, wide, int(below) + 2 * LANES * group, int(above) + 2 * LANES * group


@compiled(inner=True, fastmath=FUSED)
def acceleration_range(
    grid: Intervals, limits: GridLimits, i: int, end: int, x: float
) -> tuple[float, float, float, int, int]:
    """Smallest and largest u at one end of an interval, narrowest range, and both active bounds."""
    # The narrowest range is the range of u within the tightest single limit.
    rows = limits.rows.ends
    viscous = limits.friction.viscous
    rounds = limits.rounds
    low = -math.inf
    high = math.inf
    wide = math.inf
    below = -1
    above = -1
    joint = 0
    for group in range(len(limits.joints) // ROWS):
        first, last, range_, bottom, top = _joint_acceleration_range(
            grid, limits, (i, end, group, joint), x
        )
        joint = next_joint(grid, joint)
        wide = min(wide, range_)
        if first > low:
            low = first
            below = -2 - bottom
        if last < high:
            high = last
            above = -2 - top
    for r in range(rows.shape[2]):
        a = rows[i, end, r, A]
        by_x = rows[i, end, r, B] * x
        if a == 0.0:
            continue
        if r < viscous.shape[2]:
            by_x += viscous[i, end, r] * math.sqrt(x)
        inverse = 1.0 / a
        wide = min(wide, (rows[i, end, r, HIGH] - rows[i, end, r, LOW]) * abs(inverse))
        first = (rows[i, end, r, LOW] - by_x) * inverse
        last = (rows[i, end, r, HIGH] - by_x) * inverse
        bottom = 2 * r
        top = 2 * r + 1
        if inverse < 0.0:
            first, last, bottom, top = last, first, top, bottom
        if first > low:
            low = first
            below = bottom
        if last < high:
            high = last
            above = top
    for r in range(rounds.radius.shape[1]):
        first, last = _round_range(rounds, i, end, r, x)
        wide = min(wide, last - first)
        if first > low:
            low = first
            below = 2 * (rows.shape[2] + r)
        if last < high:
            high = last
            above = 2 * (rows.shape[2] + r) + 1
    return low, high, wide, below, above


@compiled(inner=True, fastmath=FUSED)
def _choose_slopes(
    grid: Intervals, limits: GridLimits, cap: FloatArray, x: FloatArray, bounds: MotionBounds
) -> None:
    """Write slopes k with which u stays at its bound on the whole interval."""
    for i in range(len(grid.piece)):
        w = grid.s[i + 1] - grid.s[i]
        x0 = x[i]
        x1 = x[i + 1]
        bounds.k[i] = 0.0
        if not (0.0 < x0 < cap[i] * BELOW_CEILING and 0.0 < x1 < cap[i + 1] * BELOW_CEILING):
            continue
        mean = (x1 - x0) / (2 * w)
        low0, high0, wide0, _, _ = acceleration_range(grid, limits, i, 0, x0)
        low1, high1, wide1, _, _ = acceleration_range(grid, limits, i, 1, x1)
        falling = min((mean - low0) / wide0, (mean - low1) / wide1) < NEAR
        turn = 0.0
        if min((high0 - mean) / wide0, (high1 - mean) / wide1) < NEAR:
            turn = high1 - high0
            if falling:
                # If u is at both bounds, for example because of two joints, the mean change is
                # used.
                turn = (turn + low1 - low0) / 2
        elif falling:
            turn = low1 - low0
        small = abs(turn) < LARGEST_TURN * min(wide0, wide1)
        # x must not fall far below its values at the ends.
        if small and 8 * turn * w <= x0 + x1:
            bounds.k[i] = turn / w


@compiled(inner=True, fastmath=FUSED)
def _motion_extent(
    width: FloatArray, x: FloatArray, k: FloatArray, i: int
) -> tuple[float, float, float]:
    """Largest and smallest x, and largest |u|, of a motion on interval i."""
    w = width[i]
    first = x[i]
    last = x[i + 1]
    mean = (last - first) / (2 * w)
    turn = abs(k[i]) * w / 2
    sag = turn * w / 2
    return max(first, last) + sag, max(min(first, last) - sag, 0.0), abs(mean) + turn


@compiled(inner=True, allocates=True, fastmath=FUSED)
def _bound_motion(
    width: FloatArray, x: FloatArray, rules: Rules, headroom: float, bounds: MotionBounds
) -> None:
    """Write bounds of x and u around a plan."""
    # The bound of u includes the neighbours of an interval, because switching points move between
    # plans.
    n = len(width)
    fastest = 0.0
    rates = np.empty(n)
    for i in range(n):
        largest, smallest, rates[i] = _motion_extent(width, x, bounds.k, i)
        bounds.x[i] = headroom * largest
        bounds.x_min[i] = smallest / headroom
        fastest = max(fastest, rates[i])
    for i in range(n):
        largest_u = rules.floor * min(fastest, bounds.x[i] / width[i])
        for m in range(max(i - rules.window, 0), min(i + rules.window + 1, n)):
            largest_u = max(largest_u, headroom * rates[m])
        bounds.u[i] = largest_u


@compiled(inner=True, fastmath=FUSED)
def _prove_or_widen(
    width: FloatArray,
    x: FloatArray,
    rules: Rules,
    bounds: MotionBounds,
    has_friction: bool,
    changed: BoolArray,
) -> bool:
    """Test whether the plan is within its bounds, so that margins suffice; otherwise widen them."""
    holds = True
    for i in range(len(width)):
        largest, smallest, rate = _motion_extent(width, x, bounds.k, i)
        outside = largest > bounds.x[i] or rate > bounds.u[i]
        if has_friction and smallest < bounds.x_min[i]:
            outside = True
            bounds.x_min[i] = smallest / (rules.headroom * rules.headroom)
        if outside:
            bounds.x[i] = max(bounds.x[i], rules.headroom * largest)
            bounds.u[i] = max(bounds.u[i], 1.2 * rate)
        speeds = math.sqrt(x[i]) + math.sqrt(x[i + 1])
        # x would fall far below its values at the ends
        if 4 * bounds.k[i] * width[i] ** 2 > speeds**2:
            bounds.k[i] = 0.0
            outside = True
        changed[i] = outside
        holds &= not outside
    return holds


@compiled(inner=True)
def _largest_margin(lost: FloatArray) -> int:
    """Index of the interval whose margins take the largest fraction of a limit."""
    worst = 0
    for i in range(len(lost)):
        if lost[i] > lost[worst]:
            worst = i
    return worst


@compiled(inner=True)
def _duration(width: FloatArray, x: FloatArray, k: FloatArray) -> float:
    """Duration of a motion with ds² at the ends of the intervals and slopes k [s]."""
    total = 0.0
    for i in range(len(width)):
        total += interval_time(width[i], math.sqrt(x[i]), math.sqrt(x[i + 1]), k[i])
    return total


@compiled(inner=True)
def _linearize_friction(x: FloatArray, bounds: MotionBounds, near: float) -> bool:
    """Linearize friction about a plan, and test whether the plan is close to the previous one."""
    is_near = True
    for i in range(len(bounds.x)):
        middle = (x[i] + x[i + 1]) / 2
        is_near &= abs(middle - bounds.x[i]) <= near * bounds.x[i]
        bounds.x[i] = bounds.x_min[i] = middle
    return is_near


@compiled(inner=True)
def _pass_outcome(
    stuck: int, rules: Rules, reachable: FloatArray, x: FloatArray
) -> tuple[int, float]:
    """Outcome of a pass, and the largest ds² at an end whose speed is too high."""
    n = len(x) - 1
    if rules.start < math.inf and min(rules.start, reachable[0]) < rules.start * (
        1 - END_TOLERANCE
    ):
        return START, reachable[0]
    if stuck >= 0:
        return STUCK, 0.0
    if rules.end < math.inf and x[n] < rules.end * (1 - END_TOLERANCE):
        return END, x[n]
    return FOUND, 0.0


@compiled(inner=True)
def _drop_slopes(
    bounds: MotionBounds, lost: FloatArray, max_margin: float, changed: BoolArray
) -> bool:
    """Set slopes to zero where margins exceed `max_margin`, and return whether any was set."""
    dropped = False
    for i in range(len(lost)):
        changed[i] = lost[i] > max_margin and bounds.k[i] != 0.0
        if changed[i]:
            bounds.k[i] = 0.0
            dropped = True
    return dropped


def plan_on_grid(grid: Intervals, limits: GridLimits, rules: Rules) -> GridPlan:
    """Plan without margins, then with margins for bounds of x and u that contain the plan."""
    # If `rules.tries` is 1, the result is the plan without margins, with the outcome FINER.
    # Numba takes longer to return an array than NumPy to make one.
    n = len(grid.piece)
    x = np.zeros(n + 1)
    k = np.zeros(n)
    lost = np.zeros(n)
    return GridPlan(x, k, lost, *write_plan(grid, limits, rules, x, k, lost))


@compiled(inner=True, allocates=True)
def _make_lines(limits: GridLimits, lost: FloatArray) -> LimitLines:
    """Lines for the limits, without any limit on an interval yet; `lost` is the field's array."""
    n = len(lost)
    slots = 1
    joint_groups = len(limits.joints) // ROWS
    while slots < min(n, BLOCK):
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


@compiled()
def write_plan(
    grid: Intervals,
    limits: GridLimits,
    rules: Rules,
    x: FloatArray,
    k: FloatArray,
    lost: FloatArray,
) -> tuple[int, int, float]:
    """Write x, k and lost of a `GridPlan`, initially zero; return its other fields."""
    n = len(grid.piece)
    friction_rows = limits.friction.within.shape[1]
    width = np.empty(n)
    cap = np.empty(n + 1)
    reachable = np.empty(n + 1)
    squares = PassSquares(cap, reachable, x)
    bounds = MotionBounds(np.zeros(n), np.zeros(n), np.zeros(n), k)
    changed = np.ones(n, np.bool_)
    lines = _make_lines(limits, lost)
    x_best = x
    k_best = k
    lost_best = lost
    shortest = math.inf
    stage = FREE
    tangents = 0
    none = Friction(np.empty((n, 2, 0)), np.empty((n, 0, 3)))
    free = GridLimits(
        limits.rows, limits.squares, limits.rounds, none, limits.ceiling, limits.joints
    )
    for i in range(n):
        width[i] = grid.s[i + 1] - grid.s[i]
    for _ in range(rules.tries):
        used_limits = free if stage == FREE else limits
        margins = stage == WITH_MARGINS
        stuck = _backward_forward_pass(
            grid, used_limits, bounds, (changed, margins), lines, rules, squares
        )
        if stuck >= n:
            return UNLIMITED, stuck - n, 0.0
        worst = _largest_margin(lines.lost)
        if margins and lines.lost[worst] > rules.max_margin:
            if _drop_slopes(bounds, lines.lost, max(rules.max_margin, rules.steady), changed):
                continue
            break
        outcome, allowed = _pass_outcome(stuck, rules, reachable, x)
        if outcome != FOUND:
            if shortest < math.inf:
                break
            if margins and n <= rules.enough:
                # A finer grid is needed around the failure, or everywhere if the speed at an end is
                # too high.
                for i in range(n):
                    if stuck < 0 or abs(i - stuck) < REFINED_NEIGHBOURS:
                        lines.lost[i] = max(lines.lost[i], NO_PLAN_MARGIN)
                return FINER, max(stuck, 0), 0.0
            return outcome, stuck, allowed
        if not margins:
            near = _linearize_friction(x, bounds, rules.near)
            stage = WITH_FRICTION
            if friction_rows and not near and tangents < rules.tangents:
                tangents += 1
                continue
            _choose_slopes(grid, limits, cap, x, bounds)
            _bound_motion(width, x, rules, rules.headroom, bounds)
            changed[:] = True
            stage = WITH_MARGINS
        elif _prove_or_widen(width, x, rules, bounds, friction_rows > 0, changed):
            if not friction_rows:
                return FOUND, -1, 0.0
            duration = _duration(width, x, bounds.k)
            better = duration < shortest * (1 - rules.gain)
            if duration < shortest:
                shortest = duration
                x_best = x.copy()
                k_best = k.copy()
                lost_best = lost.copy()
            if not better:
                break
            _bound_motion(width, x, rules, rules.close, bounds)
            changed[:] = True
    if shortest < math.inf:
        x[:] = x_best
        k[:] = k_best
        lost[:] = lost_best
        return FOUND, -1, 0.0
    worst = _largest_margin(lines.lost)
    if lines.lost[worst] <= rules.max_margin:
        for i in range(n):
            if changed[i]:
                lines.lost[i] = NO_PLAN_MARGIN
        worst = _largest_margin(lines.lost)
    return FINER, worst, 0.0
