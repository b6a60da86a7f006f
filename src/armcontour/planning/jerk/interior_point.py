"""Feasible interior-point method for the fastest speed along a path; compiled.

The unknowns are the middle control points d of `a = ds²` on n cells, between the values of a at
both ends. Each row couples three neighbours, so each step solves a pentadiagonal system. Every
iterate satisfies every row. See docs/concepts/jerk_limited.md.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.kernel_cache import FUSED, compiled
from armcontour.core.simd import LANES, choose, higher, highest, load, lower, lowest, store

# Largest step, as a fraction of the step to the nearest bound.
STEP_SHARE = 0.995
# The same share for vector rows, which limit the norm of a vector
ROUND_STEP_SHARE = 0.9
# A step that violates a row by rounding is shortened by this factor.
STEP_SHORTENING = 0.5
# Largest number of times that a step is shortened.
MAX_SHORTENINGS = 30
# The barrier is reduced by this factor after an iteration that satisfies the two conditions below.
# Faster reduction leads to tiny steps.
REDUCTION = 0.15
# The barrier is reduced only if Newton's decrement is below this share of the gap.
CENTERED = 0.1
# The barrier is reduced only if the steps of slacks and multipliers exceed this share of Newton's
# step.
LONG_NEWTON_STEP = 0.3
# A tangent is moved if its rows retain at least this fraction of their slack.
MIN_SLACK = 0.1
# Gauss-Legendre nodes on [0, 1] for the duration of a cell.
NODES = 0.5 + 0.5 * np.array([-math.sqrt(0.6), 0.0, math.sqrt(0.6)])
# Gauss-Legendre weights of these nodes.
WEIGHTS = np.array([5.0, 8.0, 5.0]) / 18.0
# Offsets of vectors in the table of rows: coefficients, bounds of plain rows, multipliers, and
# inverse slacks, which are replaced by changes of the multipliers
LOW, HIGH, DUALS, INVERSES, ROW = (k * LANES for k in (3, 4, 5, 7, 9))
# Offsets in the table of tangents: value at a = 0, slope in a, and rows of the control points of a
LEVEL, SLOPE, RAISED = (k * LANES for k in range(3))
# Smallest pivot of the scaled matrix.
RIDGE = 1e-14
# Smallest divisor of relative slacks, which prevents a division by zero.
SMALLEST_DIVISOR = 1e-300


class JerkSection(NamedTuple):
    """Optimization problem of one section with n cells, which are divided into m parts."""

    # A row `(x, y, z)` of cell i means `x d[i] + y d[i + 1] + z d[i + 2]`, where d[0] and d[n + 1]
    # are the values of `a = ds²` at the start and the end, which are 0.

    width: FloatArray  # Lengths of the cells [m], (n,)
    # begin, end: Rows of the first and last control point of a on each cell, (n, 3) each
    begin: FloatArray
    end: FloatArray
    # Lengths of the cells of uniform jerk before the first and after the last cell [m], (2,); 0 if
    # none
    ramps: FloatArray
    cell: IntArray  # The cell of each part, (m,)
    plain: FloatArray  # Rows `low <= row <= high` of each part, (m, k, 3)
    low: FloatArray  # low, high: Bounds of the plain rows, (m, k)
    high: FloatArray
    # Rows `|row| <= jerk f`, where f is a control point of a tangent of a^(-1/2), which is a lower
    # bound of a^(-1/2), (m, l, 3)
    curved: FloatArray
    jerk: FloatArray  # Limits of the curved rows, (l,)
    curved_points: IntArray  # Index of the control point f of each curved row, (l,)
    # Rows of the control points of a on each part, as a polynomial of the degree of the curved
    # rows, (m, j, 3)
    raised: FloatArray
    # Point of contact of the tangent of each part with a^(-1/2) at the start [m²/s²], (m,)
    about: FloatArray
    round: FloatArray  # Vector rows `|vector| <= radius`, (m, o, 2, 3)
    radius: FloatArray  # Radii of the vector rows, (m, o)


class _Blocks(NamedTuple):
    """Plain and curved rows in blocks: LANES parts are processed together."""

    # Parts that are missing in the last block have rows without bounds. All arrays are flat.
    near: FloatArray  # Control points of a in the rows of each part, (blocks, 3, LANES)
    step: FloatArray  # Their changes in Newton's step, (blocks, 3, LANES)
    rows: FloatArray  # Two bounds of each row: below and above it, (blocks, k + l, ROW)
    tangents: FloatArray  # Tangents below a^(-1/2), (blocks, 2 + 3 j, LANES)


class _Duals(NamedTuple):
    """Slacks, multipliers, or their changes, of rows that are in no block."""

    round: FloatArray
    positive: FloatArray


class _JerkIterate(NamedTuple):
    """Arrays of one iterate, changed in place."""

    d: FloatArray  # Control points of a [m²/s²], (n + 2,)
    blocks: _Blocks
    slack: _Duals
    dual: _Duals


class _PendingStep(NamedTuple):
    """What an iteration leaves to the next one, which does it while it reads the rows."""

    change: _Duals  # Changes of the multipliers that are in no block
    share: float  # Fraction of the changes of all multipliers
    moves_tangents: bool  # True if the tangents are not at d yet


@compiled(inner=True, allocates=True)
def _new_duals(p: JerkSection) -> _Duals:
    """Make zero multipliers, or slacks, for all rows that are in no block."""
    return _Duals(np.zeros(p.radius.shape), np.zeros(len(p.width) + 2))


# Rows are read as scalars, because array views would cost more than the arithmetic.


@compiled(inner=True, inline="always")
def _end_value(rows: FloatArray, i: int, d: FloatArray) -> float:
    """Return the product of row i and three consecutive control points."""
    return float(rows[i, 0] * d[i] + rows[i, 1] * d[i + 1] + rows[i, 2] * d[i + 2])


@compiled(inner=True, inline="always")
def _row_value(rows: FloatArray, c: int, r: int, i: int, d: FloatArray) -> float:
    """Return the product of row r of part c and the control points of its cell i."""
    return float(rows[c, r, 0] * d[i] + rows[c, r, 1] * d[i + 1] + rows[c, r, 2] * d[i + 2])


@compiled(inner=True, inline="always")
def _axis_value(rows: FloatArray, c: int, r: int, k: int, i: int, d: FloatArray) -> float:
    """Return component k of vector row r of part c, with the control points of its cell i."""
    x = rows[c, r, k, 0]
    y = rows[c, r, k, 1]
    z = rows[c, r, k, 2]
    return float(x * d[i] + y * d[i + 1] + z * d[i + 2])


@compiled(inner=True, inline="always")
def _mean(p: JerkSection, c: int, d: FloatArray) -> float:
    """Return the mean of the raised rows of part c."""
    total = 0.0
    for k in range(p.raised.shape[1]):
        total += _row_value(p.raised, c, k, p.cell[c], d)
    return float(total / p.raised.shape[1])


@compiled(inner=True, inline="always")
def _vector(p: JerkSection, c: int, r: int, i: int, d: FloatArray) -> Any:
    """Return both components of vector row r of part c."""
    return _axis_value(p.round, c, r, 0, i, d), _axis_value(p.round, c, r, 1, i, d)


@compiled(inner=True, inline="always")
def _round_slack(bound: float, vector: Any) -> float:
    """Return the slack of the limit `|vector| <= bound`; -1 if the bound is not positive."""
    x, y = vector
    return bound - (x * x + y * y) / bound if bound > 0.0 else -1.0


@compiled(inner=True, allocates=True)
def _new_blocks(p: JerkSection) -> _Blocks:
    """Make the blocks: the rows of LANES parts side by side, for vector instructions."""
    m = len(p.cell)
    plain = p.plain.shape[1]
    curved = p.curved.shape[1]
    j = p.raised.shape[1]
    count = -(-m // LANES)
    size = RAISED + 3 * j * LANES
    rows = np.zeros(count * (plain + curved) * ROW)
    tangents = np.zeros(count * size)
    for c in range(count * LANES):
        first = c // LANES * (plain + curved) * ROW + c % LANES
        for r in range(plain):
            at = first + r * ROW
            rows[at + LOW] = p.low[c, r] if c < m else -math.inf
            rows[at + HIGH] = p.high[c, r] if c < m else math.inf
            for k in range(3 if c < m else 0):
                rows[at + k * LANES] = p.plain[c, r, k]
        for r in range(curved if c < m else 0):
            for k in range(3):
                rows[first + (plain + r) * ROW + k * LANES] = p.curved[c, r, k]
        at = c // LANES * size + c % LANES
        about = p.about[c] if c < m else 1.0
        tangents[at + LEVEL] = 1.5 / math.sqrt(about)
        tangents[at + SLOPE] = -0.5 / (about * math.sqrt(about))
        for r in range(j if c < m else 0):
            for k in range(3):
                tangents[at + RAISED + (3 * r + k) * LANES] = p.raised[c, r, k]
    return _Blocks(np.zeros(count * 3 * LANES), np.zeros(count * 3 * LANES), rows, tangents)


@compiled(inner=True)
def _spread(p: JerkSection, d: FloatArray, near: FloatArray) -> None:
    """Write, for each part, the three control points that its rows multiply, into `near`."""
    for c in range(len(p.cell)):
        at = c // LANES * 3 * LANES + c % LANES
        for k in range(3):
            near[at + k * LANES] = d[p.cell[c] + k]


@compiled(inner=True)
def _load_row(table: FloatArray, at: int) -> Any:
    """Load the three coefficients of a row, each for LANES parts."""
    return load(table, at), load(table, at + LANES), load(table, at + 2 * LANES)


@compiled(inner=True)
def _dot(row: Any, near: Any) -> Any:
    """Return the product of a row and three control points, for LANES parts."""
    return row[0] * near[0] + row[1] * near[1] + row[2] * near[2]


@compiled(inner=True)
def _tangent_row(p: JerkSection, tangents: FloatArray, b: int, r: int) -> Any:
    """Return level, slope and raised row of the tangent that bounds curved row r."""
    at = b * (RAISED + 3 * p.raised.shape[1] * LANES)
    row = _load_row(tangents, at + RAISED + 3 * p.curved_points[r] * LANES)
    return p.jerk[r] * load(tangents, at + LEVEL), p.jerk[r] * load(tangents, at + SLOPE), row


@compiled(inner=True)
def _slacks(p: JerkSection, blocks: _Blocks, b: int, r: int, near: Any) -> Any:
    """Return the slacks below and above row r in block b."""
    plain = p.plain.shape[1]
    at = (b * (plain + p.curved.shape[1]) + r) * ROW
    f = _dot(_load_row(blocks.rows, at), near)
    if r < plain:
        return f - load(blocks.rows, at + LOW), load(blocks.rows, at + HIGH) - f
    level, slope, row = _tangent_row(p, blocks.tangents, b, r - plain)
    bound = level + slope * _dot(row, near)
    return bound + f, bound - f


@compiled(inner=True, fastmath=FUSED)
def _is_inside(p: JerkSection, d: FloatArray, blocks: _Blocks, slack: _Duals) -> bool:
    """Return whether d satisfies all rows; writes its slacks. The ends have no bound."""
    _spread(p, d, blocks.near)
    smallest = load(blocks.near, 0) * 0.0 + math.inf
    for b in range(len(blocks.near) // (3 * LANES)):
        near = _load_row(blocks.near, b * 3 * LANES)
        for r in range(p.plain.shape[1] + p.curved.shape[1]):
            below, above = _slacks(p, blocks, b, r, near)
            smallest = lower(below, lower(above, smallest))
    inside = lowest(smallest) > 0.0
    for c in range(p.round.shape[0]):
        for r in range(p.round.shape[1]):
            slack.round[c, r] = _round_slack(p.radius[c, r], _vector(p, c, r, p.cell[c], d))
            inside &= slack.round[c, r] > 0.0
    for i in range(1, len(d) - 1):
        slack.positive[i] = d[i]
        # The comparison is also false if d is NaN.
        inside &= d[i] > 0.0
    return bool(inside)


@compiled()
def limit_steps(values: FloatArray, steps: FloatArray) -> None:
    """Reduce values in place until neighbours differ by at most `steps`, (n - 1,)."""
    for i in range(1, len(values)):
        values[i] = min(values[i], values[i - 1] + steps[i - 1])
    for i in range(len(values) - 1, 0, -1):
        values[i - 1] = min(values[i - 1], values[i] + steps[i - 1])


@compiled()
def least_slacks(p: JerkSection, d: FloatArray) -> FloatArray:
    """Return the smallest relative slack in each cell, (n,); positive if d satisfies all rows."""
    # Tangents are moved to d, from where `improve` starts.
    shares = np.ones(len(p.width))
    for c in range(len(p.cell)):
        i = p.cell[c]
        p.about[c] = about = _mean(p, c, d)
        smallest = shares[i] if d[i + 1] > 0.0 else -1.0
        for r in range(p.plain.shape[1]):
            f = _row_value(p.plain, c, r, i, d)
            low = p.low[c, r]
            high = p.high[c, r]
            if high < math.inf:
                smallest = min(smallest, (high - f) / max(abs(high), abs(f), SMALLEST_DIVISOR))
            if low > -math.inf:
                smallest = min(smallest, (f - low) / max(abs(low), abs(f), SMALLEST_DIVISOR))
        for r in range(p.curved.shape[1]):
            square = _row_value(p.raised, c, p.curved_points[r], i, d)
            bound = p.jerk[r] * (1.5 - 0.5 * square / about) / math.sqrt(about)
            f = abs(_row_value(p.curved, c, r, i, d))
            smallest = min(smallest, (bound - f) / max(abs(bound), SMALLEST_DIVISOR))
        for r in range(p.round.shape[1]):
            slack = _round_slack(p.radius[c, r], _vector(p, c, r, i, d))
            smallest = min(smallest, slack / max(abs(p.radius[c, r]), SMALLEST_DIVISOR))
        shares[i] = smallest
    return shares


@compiled(inner=True, inline="always")
def _add_cell(bands: FloatArray, right: FloatArray, i: int, h: Any, g: Any) -> None:
    """Add second derivatives and right-hand sides of cell i to the bands of the system."""
    bands[0, i] += h[0]
    bands[1, i] += h[1]
    bands[2, i] += h[2]
    bands[0, i + 1] += h[3]
    bands[1, i + 1] += h[4]
    bands[0, i + 2] += h[5]
    right[i] += g[0]
    right[i + 1] += g[1]
    right[i + 2] += g[2]


@compiled(inner=True, inline="always")
def _accumulate(
    h: tuple[float, float, float, float, float, float],
    g: tuple[float, float, float],
    row: tuple[float, float, float],
    weight: float,
    push: float,
) -> Any:
    """Add one row to the second derivatives and right-hand sides of a cell."""
    x, y, z = row
    squares = (
        h[0] + weight * x * x,
        h[1] + weight * x * y,
        h[2] + weight * x * z,
        h[3] + weight * y * y,
        h[4] + weight * y * z,
        h[5] + weight * z * z,
    )
    return squares, (g[0] + push * x, g[1] + push * y, g[2] + push * z)


@compiled(inner=True)
def _add_durations(p: JerkSection, d: FloatArray, bands: FloatArray, right: FloatArray) -> float:
    """Add second derivatives and negative gradient of the duration; return the duration [s].

    The duration of a cell is the integral of `a^(-1/2)`, by Gauss-Legendre quadrature. On a cell of
    uniform jerk with length h it is `3 h a^(-1/2)`, with a at its moving end.
    """
    n = len(p.width)
    total = 0.0
    for i in range(n):
        first = _end_value(p.begin, i, d)
        last = _end_value(p.end, i, d)
        h = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        g = (0.0, 0.0, 0.0)
        for k in range(3):
            x = NODES[k]
            b0 = (1.0 - x) * (1.0 - x)
            b1 = 2.0 * x * (1.0 - x)
            b2 = x * x
            a = b0 * first + b1 * d[i + 1] + b2 * last
            part = WEIGHTS[k] * p.width[i] / math.sqrt(a)
            total += part
            row = (
                b0 * p.begin[i, 0] + b2 * p.end[i, 0],
                b0 * p.begin[i, 1] + b2 * p.end[i, 1] + b1,
                b0 * p.begin[i, 2] + b2 * p.end[i, 2],
            )
            h, g = _accumulate(h, g, row, 0.75 * part / (a * a), 0.5 * part / a)
        _add_cell(bands, right, i, h, g)
    for side in range(2):
        i = 0 if side == 0 else n - 1
        rows = p.begin if side == 0 else p.end
        a = _end_value(rows, i, d)
        part = 3.0 * p.ramps[side] / math.sqrt(a)
        total += part
        row = (rows[i, 0], rows[i, 1], rows[i, 2])
        h = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        g = (0.0, 0.0, 0.0)
        h, g = _accumulate(h, g, row, 0.75 * part / (a * a), 0.5 * part / a)
        _add_cell(bands, right, i, h, g)
    return total


@compiled(inner=True, fastmath=FUSED)
def _take_dual_step(rows: FloatArray, at: int, share: float) -> Any:
    """Change a multiplier of LANES parts by the fraction `share` of its step; return it."""
    dual = load(rows, at + DUALS) + share * load(rows, at + INVERSES)
    store(rows, at + DUALS, dual)
    return dual


@compiled(inner=True, fastmath=FUSED)
def _move_tangents(p: JerkSection, blocks: _Blocks, b: int, lanes: FloatArray) -> None:
    """Move the tangents of a block to d where every row retains the share MIN_SLACK of its slack.

    - `lanes`: scratch array of at least two vectors.
    """
    tangents = blocks.tangents
    j = p.raised.shape[1]
    near = _load_row(blocks.near, b * 3 * LANES)
    at = b * (RAISED + 3 * j * LANES)
    mean = near[0] * 0.0
    for k in range(j):
        mean = mean + _dot(_load_row(tangents, at + RAISED + 3 * k * LANES), near) / float(j)
    store(lanes, 0, mean)
    for lane in range(LANES):
        root = 1.0 / math.sqrt(lanes[lane]) if lanes[lane] > 0.0 else 1.0
        lanes[LANES + lane] = 1.5 * root
    level = load(lanes, LANES)
    slope = level / (-3.0 * mean)
    worst = near[0] * 0.0
    for r in range(p.curved.shape[1]):
        before = _slacks(p, blocks, b, p.plain.shape[1] + r, near)
        old_level, old_slope, row = _tangent_row(p, tangents, b, r)
        square = _dot(row, near)
        jerk = p.jerk[r]
        rise = jerk * (level + slope * square) - old_level - old_slope * square
        for k in range(2):
            worst = lower(before[k] * (1.0 - MIN_SLACK) + rise, worst)
    store(tangents, at + LEVEL, choose(worst, 0.0, load(tangents, at + LEVEL), level))
    store(tangents, at + SLOPE, choose(worst, 0.0, load(tangents, at + SLOPE), slope))


@compiled(inner=True, fastmath=FUSED, allocates=True)
def _add_barriers(
    p: JerkSection,
    iterate: _JerkIterate,
    mu: float,
    pending: _PendingStep,
    bands: FloatArray,
    right: FloatArray,
) -> None:
    """Take the pending step of the multipliers, and add the barriers `-mu log s` of all rows.

    A row with the slack s and the multiplier y adds `(ds/dd)' (y / s) (ds/dd)` to the second
    derivatives, and `(mu / s) ds/dd` to the right side. Writes the inverse slacks of blocks.

    All that an iteration does with a block before Newton's system is done here, because the rows of
    all blocks do not fit into the fast caches.
    """
    n = len(p.width)
    d, blocks, slack, dual = iterate
    plain = p.plain.shape[1]
    curved = p.curved.shape[1]
    rows = blocks.rows
    sums = np.empty(9 * LANES)
    _add_scaled(dual.round, pending.change.round, pending.share)
    _add_scaled(dual.positive, pending.change.positive, pending.share)
    # Plain and curved rows, LANES parts at a time
    for b in range(len(blocks.near) // (3 * LANES)):
        near = _load_row(blocks.near, b * 3 * LANES)
        if pending.moves_tangents:
            _move_tangents(p, blocks, b, sums)
        zero = near[0] * 0.0
        h = (zero, zero, zero, zero, zero, zero)
        g = (zero, zero, zero)
        for r in range(plain + curved):
            at = (b * (plain + curved) + r) * ROW
            slacks = _slacks(p, blocks, b, r, near)
            row = _load_row(rows, at)
            below, above = 1.0 / slacks[0], 1.0 / slacks[1]
            one = _take_dual_step(rows, at, pending.share) * below
            other = _take_dual_step(rows, at + LANES, pending.share) * above
            store(rows, at + INVERSES, below)
            store(rows, at + INVERSES + LANES, above)
            if r < plain:
                h, g = _accumulate(h, g, row, one + other, mu * (below - above))
                continue
            _, slope, raised = _tangent_row(p, blocks.tangents, b, r - plain)
            u = slope * raised[0]
            v = slope * raised[1]
            w = slope * raised[2]
            h, g = _accumulate(h, g, (u + row[0], v + row[1], w + row[2]), one, mu * below)
            h, g = _accumulate(h, g, (u - row[0], v - row[1], w - row[2]), other, mu * above)
        for k in range(6):
            store(sums, k * LANES, h[k])
        for k in range(3):
            store(sums, (6 + k) * LANES, g[k])
        for lane in range(min(LANES, len(p.cell) - b * LANES)):
            x = sums[lane::LANES]
            squares = x[0], x[1], x[2], x[3], x[4], x[5]
            _add_cell(bands, right, p.cell[b * LANES + lane], squares, (x[6], x[7], x[8]))
    # Vector rows
    for c in range(len(p.cell) if p.round.shape[1] else 0):
        i = p.cell[c]
        squares = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        gradient = (0.0, 0.0, 0.0)
        for r in range(p.round.shape[1]):
            bound = p.radius[c, r]
            vector = _vector(p, c, r, i, d)
            one = 1.0 / slack.round[c, r]
            weight = dual.round[c, r]
            slope = _round_slope(p, c, r, vector)
            squares, gradient = _accumulate(squares, gradient, slope, weight * one, mu * one)
            for k in range(2):
                row = (p.round[c, r, k, 0], p.round[c, r, k, 1], p.round[c, r, k, 2])
                squares, gradient = _accumulate(squares, gradient, row, 2.0 * weight / bound, 0.0)
        _add_cell(bands, right, i, squares, gradient)
    # Positive control points
    for i in range(n + 2):
        if slack.positive[i] > 0.0:
            bands[0, i] += dual.positive[i] / slack.positive[i]
            right[i] += mu / slack.positive[i]


@compiled(inner=True, inline="always")
def _round_slope(p: JerkSection, c: int, r: int, vector: Any) -> Any:
    """Return the derivatives of a vector row's slack `radius - |vector|² / radius`, (x, y, z)."""
    u = vector[0] / p.radius[c, r]
    v = vector[1] / p.radius[c, r]
    rows = p.round
    return (
        -2.0 * (u * rows[c, r, 0, 0] + v * rows[c, r, 1, 0]),
        -2.0 * (u * rows[c, r, 0, 1] + v * rows[c, r, 1, 1]),
        -2.0 * (u * rows[c, r, 0, 2] + v * rows[c, r, 1, 2]),
    )


@compiled(inner=True, inline="always")
def _longest_steps(slack: float, dual: float, rise: float, change: float, reach: Any) -> Any:
    """Reduce the longest steps of slacks and multipliers so that one more bound is satisfied."""
    one, other = reach
    if -rise * one > STEP_SHARE * slack:
        one = -STEP_SHARE * slack / rise
    if -change * other > STEP_SHARE * dual:
        other = -STEP_SHARE * dual / change
    return one, other


@compiled(inner=True, inline="always")
def _longest_round_step(bound: float, vector: Any, change: Any, slack: float) -> float:
    """Return the longest step that keeps 1 - ROUND_STEP_SHARE of a vector row's slack."""
    # With the remaining slack `left`, `bound² - |vector|² - left bound >= 0` is quadratic in the
    # step.
    start = ROUND_STEP_SHARE * bound * slack
    linear = -2.0 * (vector[0] * change[0] + vector[1] * change[1])
    square = -(change[0] ** 2) - change[1] ** 2
    inner = linear * linear - 4.0 * square * start
    if linear > 0.0 and square >= 0.0:
        return math.inf
    root = math.sqrt(inner)
    step = (linear + root) / (-2.0 * square) if linear > 0.0 else 2.0 * start / (root - linear)
    return float(step)


@compiled(inner=True)
def _change_dual(rows: FloatArray, at: int, rise: Any, mu: float, decrease: Any) -> Any:
    """Write the change of a multiplier; returns the largest decreases of slack and multiplier."""
    inverse = load(rows, at + INVERSES)
    dual = load(rows, at + DUALS)
    change = (mu - dual * rise) * inverse - dual
    store(rows, at + INVERSES, change)
    # Comparisons with NaN are false, so rows without a bound do not count.
    return higher(-1.0 * rise * inverse, decrease[0]), higher(-1.0 * change / dual, decrease[1])


@compiled(inner=True, fastmath=FUSED)
def _dual_changes(
    p: JerkSection, iterate: _JerkIterate, step: FloatArray, mu: float, change: _Duals
) -> tuple[float, float]:
    """Write the changes of all multipliers; returns the longest steps of slacks and multipliers."""
    n = len(p.width)
    d, blocks, slack, dual = iterate
    plain = p.plain.shape[1]
    curved = p.curved.shape[1]
    _spread(p, step, blocks.step)
    zero = load(blocks.near, 0) * 0.0
    decrease = (zero, zero)
    for b in range(len(blocks.near) // (3 * LANES)):
        far = _load_row(blocks.step, b * 3 * LANES)
        for r in range(plain + curved):
            at = (b * (plain + curved) + r) * ROW
            rise = _dot(_load_row(blocks.rows, at), far)
            common = zero
            if r >= plain:
                _, slope, row = _tangent_row(p, blocks.tangents, b, r - plain)
                common = slope * _dot(row, far)
            decrease = _change_dual(blocks.rows, at, common + rise, mu, decrease)
            decrease = _change_dual(blocks.rows, at + LANES, common - rise, mu, decrease)
    one = highest(decrease[0])
    other = highest(decrease[1])
    reach = (STEP_SHARE / max(one, STEP_SHARE), STEP_SHARE / max(other, STEP_SHARE))
    for c in range(p.round.shape[0]):
        i = p.cell[c]
        for r in range(p.round.shape[1]):
            vector = _vector(p, c, r, i, d)
            x, y, z = _round_slope(p, c, r, vector)
            rise_of = x * step[i] + y * step[i + 1] + z * step[i + 2]
            room = slack.round[c, r]
            old = dual.round[c, r]
            new = (mu - old * rise_of) / room - old
            one, other = _longest_steps(room, old, 0.0, new, reach)
            change_of = _vector(p, c, r, i, step)
            longest = _longest_round_step(p.radius[c, r], vector, change_of, room)
            reach = min(one, longest), other
            change.round[c, r] = new
    for i in range(n + 2):
        if slack.positive[i] > 0.0:
            room = slack.positive[i]
            old = dual.positive[i]
            new = (mu - old * step[i]) / room - old
            reach = _longest_steps(room, old, step[i], new, reach)
            change.positive[i] = new
    return reach


@compiled(inner=True, allocates=True)
def _solve_bands(bands: FloatArray, right: FloatArray) -> None:
    """Solve a symmetric pentadiagonal system in place, by LDLᵀ with a scaled diagonal."""
    n = len(right)
    scale = np.empty(n)
    for i in range(n):
        scale[i] = 1.0 / math.sqrt(bands[0, i])
    for i in range(n):
        right[i] *= scale[i]
        bands[0, i] = 1.0 + RIDGE
        if i < n - 1:
            bands[1, i] *= scale[i] * scale[i + 1]
        if i < n - 2:
            bands[2, i] *= scale[i] * scale[i + 2]
    for i in range(n):
        pivot = max(bands[0, i], RIDGE)
        bands[0, i] = pivot
        if i < n - 1:
            one = bands[1, i] / pivot
            bands[0, i + 1] -= one * bands[1, i]
            right[i + 1] -= one * right[i]
            if i < n - 2:
                two = bands[2, i] / pivot
                bands[1, i + 1] -= one * bands[2, i]
                bands[0, i + 2] -= two * bands[2, i]
                right[i + 2] -= two * right[i]
                bands[2, i] = two
            bands[1, i] = one
    for i in range(n - 1, -1, -1):
        total = right[i] / bands[0, i]
        if i < n - 1:
            total -= bands[1, i] * right[i + 1]
        if i < n - 2:
            total -= bands[2, i] * right[i + 2]
        right[i] = total
    for i in range(n):
        right[i] *= scale[i]


@compiled(inner=True)
def _fix_ends(bands: FloatArray, right: FloatArray) -> None:
    """Fix both ends of d in Newton's system: their equations become `step = 0`."""
    last = len(right) - 1
    bands[0, 0] = 1.0
    bands[1, 0] = 0.0
    bands[2, 0] = 0.0
    right[0] = 0.0
    bands[0, last] = 1.0
    bands[1, last - 1] = 0.0
    bands[2, last - 2] = 0.0
    right[last] = 0.0


@compiled(inner=True)
def _take_step(d: FloatArray, step: FloatArray, share: float, trial: FloatArray) -> None:
    """Write the control points after the fraction `share` of a step into `trial`."""
    for i in range(len(d)):
        trial[i] = d[i] + share * step[i]


@compiled(inner=True)
def _count_bounds(p: JerkSection, dual: _Duals) -> float:
    """Count the bounds of all rows, with those of d > 0."""
    count = 2 * p.curved.shape[0] * p.curved.shape[1] + dual.round.size
    for c in range(p.low.shape[0]):
        for r in range(p.low.shape[1]):
            count += (p.low[c, r] > -math.inf) + (p.high[c, r] < math.inf)
    return float(count + len(p.width))


@compiled(inner=True)
def _add_scaled(dual: FloatArray, change: FloatArray, share: float) -> None:
    """Add `share` times the change to multipliers."""
    flat = dual.reshape(-1)
    changes = change.reshape(-1)
    for i in range(flat.size):
        flat[i] += share * changes[i]


@compiled()
def improve(p: JerkSection, d: FloatArray, tolerance: float, max_iterations: int) -> int:
    """Improve a strictly feasible d in place until its gap is small; return the iterations.

    The duration T(d) is minimized with slacks s(d) > 0 and multipliers y > 0 of all bounds. Each
    iteration takes Newton's step for

        dT/dd = sum(y ds/dd),  s y = mu,

    and mu is reduced while the steps are long (primal-dual method; Nocedal and Wright, Numerical
    Optimization, 2006, chapter 19). The number of bounds times mu is the duality gap.

    - `d`: control points of a [m²/s²], (n + 2,); the ends are fixed.
    - `tolerance`: largest gap, as a fraction of the duration.
    """
    n = len(p.width)
    blocks = _new_blocks(p)
    slack = _new_duals(p)
    dual = _new_duals(p)
    change = _new_duals(p)
    iterate = _JerkIterate(d, blocks, slack, dual)
    bands = np.zeros((3, n + 2))
    right = np.zeros(n + 2)
    trial = np.zeros(n + 2)
    _is_inside(p, d, blocks, slack)
    size = _add_durations(p, d, bands, right)
    bounds = _count_bounds(p, dual)
    mu = size / bounds
    # Without multipliers and without a step, the changes are the multipliers on the central path.
    _add_barriers(p, iterate, mu, _PendingStep(change, 0.0, False), bands, right)
    _dual_changes(p, iterate, trial, mu, change)
    dual_share = 1.0
    for iteration in range(max_iterations):
        # Newton's system, and its solution
        bands[:] = 0.0
        right[:] = 0.0
        size = _add_durations(p, d, bands, right)
        pending = _PendingStep(change, dual_share, iteration > 0)
        _add_barriers(p, iterate, mu, pending, bands, right)
        _fix_ends(bands, right)
        trial[:] = right
        _solve_bands(bands, right)
        decrement = 0.0
        for i in range(n + 2):
            decrement += trial[i] * right[i]
        # Longest feasible step
        share, dual_share = _dual_changes(p, iterate, right, mu, change)
        _take_step(d, right, share, trial)
        halvings = 0
        while not _is_inside(p, trial, blocks, slack):
            # Rounding errors close to a bound can violate a row.
            halvings = halvings + 1
            share = share * STEP_SHORTENING
            if halvings > MAX_SHORTENINGS:
                return iteration
            _take_step(d, right, share, trial)
        # A smaller barrier near the central path
        d[:] = trial
        if decrement < CENTERED * bounds * mu and min(share, dual_share) > LONG_NEWTON_STEP:
            if bounds * mu <= 0.5 * tolerance * size:
                return iteration + 1
            mu *= REDUCTION
    return max_iterations
