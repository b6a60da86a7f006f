"""Feasible interior-point method for the fastest speed along a path; compiled.

The unknowns are the middle control points d of `a = ds²` on n cells, between the values of a at
both ends. Each row couples three neighbours, so each step solves a pentadiagonal system. Every
iterate satisfies every row. See docs/concepts/jerk.md.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.kernels import compiled

# Largest step, as a share of the step to the nearest bound.
NEAREST = 0.995
# The same share for vector rows, which limit the norm of a vector
NEAREST_ROUND = 0.9
# A step that violates a row by rounding is shortened by this factor, at most this many times.
SHORTENING, MAX_SHORTENINGS = 0.5, 30
# The barrier is reduced by the factor REDUCTION once Newton's decrement is below the share CENTERED
# of the gap, and the steps of slacks and multipliers exceed the share LONG_STEP of Newton's step.
# Faster reduction leads to tiny steps.
REDUCTION, CENTERED, LONG_STEP = 0.15, 0.1, 0.3
# A tangent is moved if its rows retain at least this share of their slack.
MIN_SLACK = 0.1
# Gauss-Legendre nodes and weights on [0, 1] for the duration of a cell.
NODES = 0.5 + 0.5 * np.array([-math.sqrt(0.6), 0.0, math.sqrt(0.6)])
WEIGHTS = np.array([5.0, 8.0, 5.0]) / 18.0
# Smallest pivot of the scaled matrix.
RIDGE = 1e-14
TINY = 1e-300


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
    # Point of contact of the tangent of each part with a^(-1/2) [m²/s²], (m,); changed during
    # the search
    about: FloatArray
    round: FloatArray  # Vector rows `|vector| <= radius`, (m, o, 2, 3)
    radius: FloatArray  # Radii of the vector rows, (m, o)


class _Duals(NamedTuple):
    """One number for each bound of each row: slacks, multipliers, or their changes."""

    low: FloatArray
    high: FloatArray
    curved: FloatArray
    round: FloatArray
    positive: FloatArray


class _Iterate(NamedTuple):
    """Arrays of one iterate, changed in place."""

    d: FloatArray  # Control points of a [m²/s²], (n + 2,)
    tangents: FloatArray  # Tangent of the current part, see `_write_tangents`, (j, 4)
    slack: _Duals
    dual: _Duals


@compiled(inner=True, allocates=True)
def _new_duals(p: JerkSection) -> _Duals:
    n = len(p.cell)
    return _Duals(
        np.zeros(p.low.shape),
        np.zeros(p.low.shape),
        np.zeros((n, p.curved.shape[1], 2)),
        np.zeros((n, p.round.shape[1])),
        np.zeros(len(p.width) + 2),
    )


# Rows are read as scalars, because array views would cost more than the arithmetic.


@compiled(inner=True, inline="always")
def _end_value(rows: FloatArray, i: int, d: FloatArray) -> float:
    return float(rows[i, 0] * d[i] + rows[i, 1] * d[i + 1] + rows[i, 2] * d[i + 2])


@compiled(inner=True, inline="always")
def _row_value(rows: FloatArray, c: int, r: int, i: int, d: FloatArray) -> float:
    return float(rows[c, r, 0] * d[i] + rows[c, r, 1] * d[i + 1] + rows[c, r, 2] * d[i + 2])


@compiled(inner=True, inline="always")
def _axis_value(rows: FloatArray, c: int, r: int, k: int, i: int, d: FloatArray) -> float:
    x, y, z = rows[c, r, k, 0], rows[c, r, k, 1], rows[c, r, k, 2]
    return float(x * d[i] + y * d[i + 1] + z * d[i + 2])


@compiled(inner=True, inline="always")
def _write_tangents(p: JerkSection, c: int, d: FloatArray, tangents: FloatArray) -> None:
    """Write the control points of the tangent below a^(-1/2) in part c with derivatives, (j, 4)."""
    i = p.cell[c]
    root = 1.0 / math.sqrt(p.about[c])
    half = 0.5 * root / p.about[c]
    for k in range(p.raised.shape[1]):
        tangents[k, 0] = 1.5 * root - half * _row_value(p.raised, c, k, i, d)
        tangents[k, 1] = -half * p.raised[c, k, 0]
        tangents[k, 2] = -half * p.raised[c, k, 1]
        tangents[k, 3] = -half * p.raised[c, k, 2]


@compiled(inner=True, inline="always")
def _mean(p: JerkSection, c: int, d: FloatArray) -> float:
    total = 0.0
    for k in range(p.raised.shape[1]):
        total += _row_value(p.raised, c, k, p.cell[c], d)
    return float(total / p.raised.shape[1])


@compiled(inner=True, inline="always")
def _vector(p: JerkSection, c: int, r: int, i: int, d: FloatArray) -> Any:
    return _axis_value(p.round, c, r, 0, i, d), _axis_value(p.round, c, r, 1, i, d)


@compiled(inner=True, inline="always")
def _round_slack(bound: float, vector: Any) -> float:
    """Slack of the limit `|vector| <= bound`; -1 if the bound is not positive."""
    x, y = vector
    return bound - (x * x + y * y) / bound if bound > 0.0 else -1.0


@compiled(inner=True)
def _write_slacks(p: JerkSection, d: FloatArray, tangents: FloatArray, slack: _Duals) -> bool:
    """Write the slacks of d; returns true if all are positive. The ends have no bound."""
    smallest = math.inf
    for c in range(len(p.cell)):
        i = p.cell[c]
        _write_tangents(p, c, d, tangents)
        for r in range(p.plain.shape[1]):
            f = _row_value(p.plain, c, r, i, d)
            slack.high[c, r], slack.low[c, r] = p.high[c, r] - f, f - p.low[c, r]
            smallest = min(smallest, slack.high[c, r], slack.low[c, r])
        for r in range(p.curved.shape[1]):
            bound, f = p.jerk[r] * tangents[p.curved_points[r], 0], _row_value(p.curved, c, r, i, d)
            slack.curved[c, r, 0], slack.curved[c, r, 1] = bound - f, bound + f
            smallest = min(smallest, slack.curved[c, r, 0], slack.curved[c, r, 1])
        for r in range(p.round.shape[1]):
            slack.round[c, r] = _round_slack(p.radius[c, r], _vector(p, c, r, i, d))
            smallest = min(smallest, slack.round[c, r])
    for i in range(1, len(d) - 1):
        slack.positive[i] = d[i]
        smallest = min(smallest, d[i])
    # The comparison is also false if a slack is NaN.
    return smallest > 0.0


@compiled()
def limit_steps(values: FloatArray, steps: FloatArray) -> None:
    """Reduce values in place until neighbours differ by at most `steps`, (n - 1,)."""
    for i in range(1, len(values)):
        values[i] = min(values[i], values[i - 1] + steps[i - 1])
    for i in range(len(values) - 1, 0, -1):
        values[i - 1] = min(values[i - 1], values[i] + steps[i - 1])


@compiled()
def least_slacks(p: JerkSection, d: FloatArray) -> FloatArray:
    """Smallest relative slack of d in each cell, (n,); positive if d satisfies all rows."""
    # Tangents are moved to d, from where `improve` starts.
    for c in range(len(p.cell)):
        p.about[c] = _mean(p, c, d)
    slack, tangents = _new_duals(p), np.empty((p.raised.shape[1], 4))
    _write_slacks(p, d, tangents, slack)
    shares = np.ones(len(p.width))
    for c in range(len(p.cell)):
        i = p.cell[c]
        smallest = shares[i] if d[i + 1] > 0.0 else -1.0
        _write_tangents(p, c, d, tangents)
        for r in range(p.plain.shape[1]):
            f = abs(_row_value(p.plain, c, r, i, d))
            if p.high[c, r] < math.inf:
                smallest = min(smallest, slack.high[c, r] / max(abs(p.high[c, r]), f, TINY))
            if p.low[c, r] > -math.inf:
                smallest = min(smallest, slack.low[c, r] / max(abs(p.low[c, r]), f, TINY))
        for r in range(p.curved.shape[1]):
            upper, lower = slack.curved[c, r, 0], slack.curved[c, r, 1]
            # The sum of both slacks is twice the bound.
            smallest = min(smallest, min(upper, lower) / max(abs(upper + lower) / 2, TINY))
        for r in range(p.round.shape[1]):
            smallest = min(smallest, slack.round[c, r] / max(abs(p.radius[c, r]), TINY))
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
    """Add second derivatives and negative gradient of the duration; returns the duration [s]."""
    n = len(p.width)
    total = 0.0
    for i in range(n):
        first, last = _end_value(p.begin, i, d), _end_value(p.end, i, d)
        h = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        g = (0.0, 0.0, 0.0)
        for k in range(3):
            x = NODES[k]
            b0, b1, b2 = (1.0 - x) * (1.0 - x), 2.0 * x * (1.0 - x), x * x
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
        h, g = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        h, g = _accumulate(h, g, row, 0.75 * part / (a * a), 0.5 * part / a)
        _add_cell(bands, right, i, h, g)
    return total


@compiled(inner=True)
def _add_barriers(
    p: JerkSection, iterate: _Iterate, mu: float, bands: FloatArray, right: FloatArray
) -> None:
    n, (d, tangents, slack, dual) = len(p.width), iterate
    for c in range(len(p.cell)):
        i = p.cell[c]
        _write_tangents(p, c, d, tangents)
        h = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        g = (0.0, 0.0, 0.0)
        for r in range(p.plain.shape[1]):
            weight, push = 0.0, 0.0
            if p.high[c, r] < math.inf:
                one = 1.0 / slack.high[c, r]
                weight += dual.high[c, r] * one
                push -= mu * one
            if p.low[c, r] > -math.inf:
                one = 1.0 / slack.low[c, r]
                weight += dual.low[c, r] * one
                push += mu * one
            row = (p.plain[c, r, 0], p.plain[c, r, 1], p.plain[c, r, 2])
            h, g = _accumulate(h, g, row, weight, push)
        for r in range(p.curved.shape[1]):
            k = p.curved_points[r]
            x, y, z = tangents[k, 1], tangents[k, 2], tangents[k, 3]
            for side in range(2):
                sign = -1.0 if side == 0 else 1.0
                one = 1.0 / slack.curved[c, r, side]
                row = (
                    p.jerk[r] * x + sign * p.curved[c, r, 0],
                    p.jerk[r] * y + sign * p.curved[c, r, 1],
                    p.jerk[r] * z + sign * p.curved[c, r, 2],
                )
                h, g = _accumulate(h, g, row, dual.curved[c, r, side] * one, mu * one)
        for r in range(p.round.shape[1]):
            bound, vector = p.radius[c, r], _vector(p, c, r, i, d)
            one, weight = 1.0 / slack.round[c, r], dual.round[c, r]
            h, g = _accumulate(h, g, _round_slope(p, c, r, vector), weight * one, mu * one)
            for k in range(2):
                row = (p.round[c, r, k, 0], p.round[c, r, k, 1], p.round[c, r, k, 2])
                h, g = _accumulate(h, g, row, 2.0 * weight / bound, 0.0)
        _add_cell(bands, right, i, h, g)
    for i in range(n + 2):
        if slack.positive[i] > 0.0:
            bands[0, i] += dual.positive[i] / slack.positive[i]
            right[i] += mu / slack.positive[i]


@compiled(inner=True, inline="always")
def _round_slope(p: JerkSection, c: int, r: int, vector: Any) -> Any:
    """Derivatives of the slack `radius - |vector|² / radius` of a vector row, (x, y, z)."""
    u, v, rows = vector[0] / p.radius[c, r], vector[1] / p.radius[c, r], p.round
    return (
        -2.0 * (u * rows[c, r, 0, 0] + v * rows[c, r, 1, 0]),
        -2.0 * (u * rows[c, r, 0, 1] + v * rows[c, r, 1, 1]),
        -2.0 * (u * rows[c, r, 0, 2] + v * rows[c, r, 1, 2]),
    )


@compiled(inner=True, inline="always")
def _longest_steps(slack: float, dual: float, rise: float, change: float, reach: Any) -> Any:
    """Reduce the longest steps of slacks and multipliers so that one more bound is satisfied."""
    one, other = reach
    if -rise * one > NEAREST * slack:
        one = -NEAREST * slack / rise
    if -change * other > NEAREST * dual:
        other = -NEAREST * dual / change
    return one, other


@compiled(inner=True, inline="always")
def _longest_round_step(bound: float, vector: Any, change: Any, slack: float) -> float:
    """Longest step that uses at most the share NEAREST_ROUND of the slack of a vector row."""
    # With the remaining slack `left`, `bound² - |vector|² - left bound >= 0` is quadratic in the
    # step.
    start = NEAREST_ROUND * bound * slack
    linear = -2.0 * (vector[0] * change[0] + vector[1] * change[1])
    square = -(change[0] ** 2) - change[1] ** 2
    inner = linear * linear - 4.0 * square * start
    if linear > 0.0 and square >= 0.0:
        return math.inf
    root = math.sqrt(inner)
    step = (linear + root) / (-2.0 * square) if linear > 0.0 else 2.0 * start / (root - linear)
    return float(step)


@compiled(inner=True)
def _dual_changes(
    p: JerkSection, iterate: _Iterate, step: FloatArray, mu: float, change: _Duals
) -> tuple[float, float]:
    """Write the changes of all multipliers; returns the longest steps of slacks and multipliers."""
    n, (d, tangents, slack, dual) = len(p.width), iterate
    reach = (1.0, 1.0)
    for c in range(len(p.cell)):
        i = p.cell[c]
        _write_tangents(p, c, d, tangents)
        for r in range(p.plain.shape[1]):
            rise = _row_value(p.plain, c, r, i, step)
            if p.high[c, r] < math.inf:
                room, old = slack.high[c, r], dual.high[c, r]
                new = (mu + old * rise) / room - old
                reach = _longest_steps(room, old, -rise, new, reach)
                change.high[c, r] = new
            if p.low[c, r] > -math.inf:
                room, old = slack.low[c, r], dual.low[c, r]
                new = (mu - old * rise) / room - old
                reach = _longest_steps(room, old, rise, new, reach)
                change.low[c, r] = new
        for r in range(p.curved.shape[1]):
            k = p.curved_points[r]
            x, y, z = tangents[k, 1], tangents[k, 2], tangents[k, 3]
            common = p.jerk[r] * (x * step[i] + y * step[i + 1] + z * step[i + 2])
            rise = _row_value(p.curved, c, r, i, step)
            for side in range(2):
                rate = common - rise if side == 0 else common + rise
                room, old = slack.curved[c, r, side], dual.curved[c, r, side]
                new = (mu - old * rate) / room - old
                reach = _longest_steps(room, old, rate, new, reach)
                change.curved[c, r, side] = new
        for r in range(p.round.shape[1]):
            vector = _vector(p, c, r, i, d)
            x, y, z = _round_slope(p, c, r, vector)
            rise = x * step[i] + y * step[i + 1] + z * step[i + 2]
            room, old = slack.round[c, r], dual.round[c, r]
            new = (mu - old * rise) / room - old
            one, other = _longest_steps(room, old, 0.0, new, reach)
            change_of = _vector(p, c, r, i, step)
            longest = _longest_round_step(p.radius[c, r], vector, change_of, room)
            reach = min(one, longest), other
            change.round[c, r] = new
    for i in range(n + 2):
        if slack.positive[i] > 0.0:
            room, old = slack.positive[i], dual.positive[i]
            new = (mu - old * step[i]) / room - old
            reach = _longest_steps(room, old, step[i], new, reach)
            change.positive[i] = new
    return reach


@compiled(inner=True)
def _move_tangents(p: JerkSection, d: FloatArray, tangents: FloatArray, slack: _Duals) -> None:
    """Move the tangent of each part to d if every row retains the share MIN_SLACK of its slack."""
    for c in range(len(p.cell)):
        i, before = p.cell[c], p.about[c]
        p.about[c] = _mean(p, c, d)
        _write_tangents(p, c, d, tangents)
        good = True
        for r in range(p.curved.shape[1]):
            bound, f = p.jerk[r] * tangents[p.curved_points[r], 0], _row_value(p.curved, c, r, i, d)
            good &= bound - f >= MIN_SLACK * slack.curved[c, r, 0]
            good &= bound + f >= MIN_SLACK * slack.curved[c, r, 1]
        if not good:
            p.about[c] = before
            continue
        for r in range(p.curved.shape[1]):
            bound, f = p.jerk[r] * tangents[p.curved_points[r], 0], _row_value(p.curved, c, r, i, d)
            slack.curved[c, r, 0], slack.curved[c, r, 1] = bound - f, bound + f


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
    """Fix both ends in Newton's system."""
    last = len(right) - 1
    bands[0, 0], bands[1, 0], bands[2, 0], right[0] = 1.0, 0.0, 0.0, 0.0
    bands[0, last], bands[1, last - 1], bands[2, last - 2], right[last] = 1.0, 0.0, 0.0, 0.0


@compiled(inner=True)
def _take_step(d: FloatArray, step: FloatArray, share: float, trial: FloatArray) -> None:
    for i in range(len(d)):
        trial[i] = d[i] + share * step[i]


@compiled(inner=True)
def _count_bounds(p: JerkSection, dual: _Duals) -> float:
    count = dual.curved.size + dual.round.size
    for c in range(p.low.shape[0]):
        for r in range(p.low.shape[1]):
            count += (p.low[c, r] > -math.inf) + (p.high[c, r] < math.inf)
    return float(count + len(p.width))


@compiled(inner=True)
def _central_duals(p: JerkSection, slack: _Duals, mu: float, dual: _Duals) -> None:
    """Write the multipliers on the central path with the barrier parameter mu."""
    for c in range(p.low.shape[0]):
        for r in range(p.low.shape[1]):
            dual.low[c, r] = mu / slack.low[c, r] if p.low[c, r] > -math.inf else 0.0
            dual.high[c, r] = mu / slack.high[c, r] if p.high[c, r] < math.inf else 0.0
        for r in range(p.curved.shape[1]):
            for side in range(2):
                dual.curved[c, r, side] = mu / slack.curved[c, r, side]
        for r in range(p.round.shape[1]):
            dual.round[c, r] = mu / slack.round[c, r]
    for i in range(len(slack.positive)):
        if slack.positive[i] > 0.0:
            dual.positive[i] = mu / slack.positive[i]


@compiled(inner=True)
def _add_scaled(dual: FloatArray, change: FloatArray, share: float) -> None:
    flat, changes = dual.reshape(-1), change.reshape(-1)
    for i in range(flat.size):
        flat[i] += share * changes[i]


@compiled()
def improve(p: JerkSection, d: FloatArray, tolerance: float, max_iterations: int) -> int:
    """Improve a strictly feasible d in place until its gap is small; returns the iterations."""
    # `d`: control points of a [m²/s²], (n + 2,); the ends are fixed.
    n = len(p.width)
    slack, dual, change = _new_duals(p), _new_duals(p), _new_duals(p)
    tangents = np.empty((p.raised.shape[1], 4))
    iterate = _Iterate(d, tangents, slack, dual)
    bands, right, trial = np.zeros((3, n + 2)), np.zeros(n + 2), np.empty(n + 2)
    _write_slacks(p, d, tangents, slack)
    size = _add_durations(p, d, bands, right)
    bounds = _count_bounds(p, dual)
    mu = size / bounds
    _central_duals(p, slack, mu, dual)
    for iteration in range(max_iterations):
        bands[:], right[:] = 0.0, 0.0
        size = _add_durations(p, d, bands, right)
        _add_barriers(p, iterate, mu, bands, right)
        _fix_ends(bands, right)
        trial[:] = right
        _solve_bands(bands, right)
        decrement = 0.0
        for i in range(n + 2):
            decrement += trial[i] * right[i]
        reach = _dual_changes(p, iterate, right, mu, change)
        share = reach[0]
        _take_step(d, right, share, trial)
        halvings = 0
        while not _write_slacks(p, trial, tangents, slack):
            # Rounding errors close to a bound can violate a row.
            halvings, share = halvings + 1, share * SHORTENING
            if halvings > MAX_SHORTENINGS:
                return iteration
            _take_step(d, right, share, trial)
        d[:] = trial
        _move_tangents(p, d, tangents, slack)
        _add_scaled(dual.low, change.low, reach[1])
        _add_scaled(dual.high, change.high, reach[1])
        _add_scaled(dual.curved, change.curved, reach[1])
        _add_scaled(dual.round, change.round, reach[1])
        _add_scaled(dual.positive, change.positive, reach[1])
        if decrement < CENTERED * bounds * mu and min(share, reach[1]) > LONG_STEP:
            if bounds * mu <= 0.5 * tolerance * size:
                return iteration + 1
            mu *= REDUCTION
    return max_iterations
