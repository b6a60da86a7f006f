"""Compiled linear rows of an interval, with lines in x that bound the root of x in friction."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.kernel_cache import compiled
from armcontour.planning.topp.limit_forms import (
    BY_CONSTANT,
    BY_SLOPE,
    BY_U,
    BY_X,
    DEVIATION,
    HIGH,
    LARGEST,
    LOW,
    SIGN,
    A,
    B,
    Friction,
    GridLimits,
    LinearRows,
    MotionBounds,
)

Vector = Any  # SIMD vector of LANES numbers

# Largest fraction of the limit at rest that the offset of a line above friction uses.
MAX_OFFSET_SHARE = 0.5
# Lower bound of divisors; its root is far below any path speed.
MIN_DIVISOR = 1e-300


class Row(NamedTuple):
    """A row `low <= a u + b x <= high` at one end of an interval; LANES rows, if of vectors."""

    a: float | Vector
    b: float | Vector
    low: float | Vector
    high: float | Vector


class Rise(NamedTuple):
    """Margin of a row inside an interval: factors of U, X, slope and 1, as in `limit_forms`."""

    by_u: float
    by_x: float
    by_slope: float
    constant: float


class IntervalRow(NamedTuple):
    """A row at the start and at the end of an interval, and its margin."""

    start: Row
    end: Row
    rise: Rise


class FrictionLine(NamedTuple):
    """Bound of the friction in a row: `largest`, or `offset + slope x` times the one at x = 1."""

    largest: float  # Largest friction of a joint that may reverse, otherwise 0
    offset: float  # 0 for a joint that may reverse
    slope: float  # 0 for a joint that may reverse


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
) -> FrictionLine:
    """Bound the friction of joint j on interval i from above by a line in x, for one limit.

    If the joint may reverse, the bound is the largest friction on the interval. Otherwise it is the
    friction at each end of the interval, multiplied by a line in x that bounds the root of x. The
    lower line is the chord of the root. The upper line is the tangent with equal excess at both
    ends of the bracket. The friction of its offset may be at most the share MAX_OFFSET_SHARE of
    `room`, the limit at rest. If it is larger, the upper line is the tangent at a smaller x that
    has the allowed offset. If this x is below the smallest x, the upper line has the allowed offset
    and passes through the root at the smallest x.

    - `towards`: 1 for the upper limit, -1 for the lower one.
    - `within`: the bracket of x.
    """
    largest = friction.within[i, j, LARGEST]
    sign = friction.within[i, j, SIGN]
    if sign == 0.0:
        return FrictionLine(towards * largest * within.high, 0.0, 0.0)
    total = within.low + within.high
    if sign != towards:
        slope = 1 / total
        return FrictionLine(0.0, within.low * within.high * slope, slope)
    offset = total / 4
    if offset * largest > MAX_OFFSET_SHARE * room:
        offset = max(MAX_OFFSET_SHARE * room / largest, MIN_DIVISOR)
    if offset >= within.low / 2:
        return FrictionLine(0.0, offset, 1 / (4 * offset))
    return FrictionLine(0.0, offset, (within.low - offset) / within.smallest)


@compiled(inner=True)
def friction_rise(friction: Friction, i: int, j: int, line: FrictionLine, w: float) -> Rise:
    """Return the rise that a friction line adds to a row.

    The slope of the line adds to b, so its product with x curves as b x does. In addition, the
    friction deviates from its chord.

    `w` is the length of the interval.
    """
    v0 = friction.viscous[i, 0, j]
    v1 = friction.viscous[i, 1, j]
    deviation = friction.within[i, j, DEVIATION]
    by_slope = line.slope * max(abs(v0), abs(v1)) * w * w / 4
    by_u = line.slope * abs(v1 - v0) * w / 2
    return Rise(by_u, line.slope * deviation, by_slope, line.offset * deviation)


@compiled(inner=True)
def _row_end(ends: FloatArray, i: int, end: int, r: int) -> Row:
    """Return row r at one end of interval i."""
    return Row(ends[i, end, r, A], ends[i, end, r, B], ends[i, end, r, LOW], ends[i, end, r, HIGH])


@compiled(inner=True)
def _subtract_friction(row: Row, viscous: float, line: FrictionLine, towards: float) -> Row:
    """Return one limit of a row, less the friction that `bound_friction` bounds.

    - `viscous`: friction at x = 1.
    - `towards`: 1 for the upper limit, -1 for the lower one.
    """
    b = row.b + viscous * line.slope
    less = viscous * line.offset + line.largest
    if towards > 0.0:
        return Row(row.a, b, -math.inf, row.high - less)
    return Row(row.a, b, row.low - less, math.inf)


@compiled(inner=True)
def linear_row(
    limits: GridLimits, i: int, r: int, w: float, within: Bracket, margins: bool
) -> IntervalRow:
    """Return row r of interval i.

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
        bound = bound_friction(friction, i, j, towards, room, within)
        line = FrictionLine(bound.largest * margins, bound.offset, bound.slope)
        start = _subtract_friction(start, friction.viscous[i, 0, j], line, towards)
        end = _subtract_friction(end, friction.viscous[i, 1, j], line, towards)
        added = friction_rise(friction, i, j, line, w)
        by_u = by_u + added.by_u
        by_x = by_x + added.by_x
        by_slope = by_slope + added.by_slope
        alone = alone + added.constant
    return IntervalRow(start, end, Rise(by_u, by_x, by_slope, alone))


@compiled()
def rows_with_friction(
    width: FloatArray, limits: GridLimits, bounds: MotionBounds, margins: bool
) -> LinearRows:
    """Make the linear rows: upper limits with friction, lower limits with friction, other rows.

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
            start, end, rise = linear_row(limits, i, r, width[i], within, margins)
            for k in range(4):
                rows.ends[i, 0, r, k] = start[k]
                rows.ends[i, 1, r, k] = end[k]
                rows.rise[i, r, k] = rise[k]
    return rows
