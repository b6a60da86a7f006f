"""A feasible interior point method for the fastest speed along a path; compiled.

The unknowns are the middle control points d of `a = ds²` on n cells, between the values of a at
both ends. Each row couples three neighbours, so that every step solves a system of five diagonals.
Every iterate keeps every row. See docs/concepts/jerk.md.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour._kernels import compiled

# Share of the way to the nearest row that a step may go.
NEAREST = 0.995
# A step is shortened by this factor, at most so often, until it keeps all curved rows.
SHORTER, MOST_SHORTER = 0.7, 60
# The barrier falls by this factor, once Newton's decrement is below this share of the gap and the
# step was longer than this share: faster rules end in tiny steps.
FALL, CENTERED, LONG = 0.15, 0.1, 0.3
# Gauss-Legendre nodes and weights on [0, 1], of the duration of a cell.
NODES = 0.5 + 0.5 * np.array([-math.sqrt(0.6), 0.0, math.sqrt(0.6)])
WEIGHTS = np.array([5.0, 8.0, 5.0]) / 18.0
# The scaled diagonal is at least this far above zero.
RIDGE = 1e-14
# What is minimized: the duration, or the speed at the start or at the end, with a minus sign.
DURATION, START, END = 0, 1, 2


class Section(NamedTuple):
    """The problem between two rests, or other ends.

    A row `(x, y, z)` of cell i means `x d[i] + y d[i + 1] + z d[i + 2]`, where d[0] and d[n + 1]
    are the values of a at the start and the end.

    Args:
        width: Lengths of the cells [m], (n,).
        begin, end: Rows of the first and last control point of a on each cell, (n, 3) each.
        ramps: Lengths of the cells of uniform jerk before the first and after the last cell [m],
            (2,); 0 where there is none.
        plain: Rows `low <= row <= high`, (n, m, 3).
        low, high: Their bounds, (n, m).
        curved: Rows `|row| <= jerk f`, where f is a control point of the tangent below a^(-1/2),
            (n, k, 3).
        jerk: Their limits, (k,).
        of: The control point of each, (k,).
        raised: Rows of the control points of a as a polynomial of the degree of the curved rows,
            (n, j, 3).
        round: Vectors of rows, `|vector| <= radius`, or `<= radius f - margin`, (n, l, 3, 3).
        radius, margin: Of the round rows, (n, l).
        round_of: The control point of each, or -1 for a fixed radius, (l,).
    """

    width: FloatArray
    begin: FloatArray
    end: FloatArray
    ramps: FloatArray
    plain: FloatArray
    low: FloatArray
    high: FloatArray
    curved: FloatArray
    jerk: FloatArray
    of: IntArray
    raised: FloatArray
    round: FloatArray
    radius: FloatArray
    margin: FloatArray
    round_of: IntArray


class _Duals(NamedTuple):
    """One number for each bound of each row; slacks, multipliers, or their changes."""

    low: FloatArray
    high: FloatArray
    curved: FloatArray
    round: FloatArray
    positive: FloatArray


@compiled()
def _duals(p: Section) -> _Duals:
    n = len(p.width)
    return _Duals(
        np.zeros(p.low.shape),
        np.zeros(p.low.shape),
        np.zeros((n, p.curved.shape[1], 2)),
        np.zeros((n, p.round.shape[1])),
        np.zeros(n + 2),
    )


@compiled(inline="always")
def _of(row: FloatArray, i: int, d: FloatArray) -> float:
    """The value of a row of cell i."""
    return float(row[0] * d[i] + row[1] * d[i + 1] + row[2] * d[i + 2])


@compiled(inline="always")
def _add_square(bands: FloatArray, i: int, v: FloatArray, weight: float) -> None:
    """Add `weight v vᵀ` of cell i to the diagonals."""
    bands[0, i] += weight * v[0] * v[0]
    bands[1, i] += weight * v[0] * v[1]
    bands[2, i] += weight * v[0] * v[2]
    bands[0, i + 1] += weight * v[1] * v[1]
    bands[1, i + 1] += weight * v[1] * v[2]
    bands[0, i + 2] += weight * v[2] * v[2]


@compiled(inline="always")
def _add_row(vector: FloatArray, i: int, v: FloatArray, weight: float) -> None:
    """Add `weight v` of cell i to a vector."""
    for k in range(3):
        vector[i + k] += weight * v[k]


@compiled(inline="always")
def _tangent(raised: FloatArray, i: int, d: FloatArray, slope: FloatArray) -> float:
    """A control point of the tangent below a^(-1/2) in cell i, and its slope, (3,)."""
    x = d[i + 1]
    root = 1.0 / math.sqrt(x)
    half = 0.5 * root / x
    point = _of(raised, i, d)
    for k in range(3):
        slope[k] = -half * raised[k]
    slope[1] += 1.5 * half * (point / x - 1.0)
    return float(1.5 * root - half * point)


@compiled(inline="always")
def _radius(p: Section, i: int, r: int, d: FloatArray, slope: FloatArray) -> float:
    """The radius of a round row, and its slope, (3,)."""
    k = p.round_of[r]
    if k < 0:
        for j in range(3):
            slope[j] = 0.0
        return float(p.radius[i, r] - p.margin[i, r])
    found = p.radius[i, r] * _tangent(p.raised[i, k], i, d, slope)
    for j in range(3):
        slope[j] *= p.radius[i, r]
    return float(found - p.margin[i, r])


@compiled()
def slacks(p: Section, d: FloatArray, found: _Duals) -> float:
    """Write how far d is from every bound into `found`; returns the least share of any bound."""
    n = len(p.width)
    least = math.inf
    slope = np.empty(3)
    for i in range(n):
        for r in range(p.plain.shape[1]):
            f = _of(p.plain[i, r], i, d)
            high, low = p.high[i, r] - f, f - p.low[i, r]
            found.high[i, r], found.low[i, r] = high, low
            if high < math.inf:
                least = min(least, high / max(abs(p.high[i, r]), abs(f), 1e-300))
            if low < math.inf:
                least = min(least, low / max(abs(p.low[i, r]), abs(f), 1e-300))
        for r in range(p.curved.shape[1]):
            bound = p.jerk[r] * _tangent(p.raised[i, p.of[r]], i, d, slope)
            f = _of(p.curved[i, r], i, d)
            found.curved[i, r, 0], found.curved[i, r, 1] = bound - f, bound + f
            least = min(least, (bound - abs(f)) / max(abs(bound), abs(f)))
        for r in range(p.round.shape[1]):
            bound = _radius(p, i, r, d, slope)
            square = 0.0
            for k in range(3):
                square += _of(p.round[i, r, k], i, d) ** 2
            # Without a radius the row is broken, whatever the vector.
            found.round[i, r] = bound - square / bound if bound > 0.0 else -1.0
            least = min(least, found.round[i, r] / max(abs(bound), 1e-300))
        found.positive[i + 1] = d[i + 1]
        least = min(least, 1.0 if d[i + 1] > 0.0 else -1.0)
    for k in (0, n + 1):
        found.positive[k] = d[k]
    return least


@compiled()
def least_slack(p: Section, d: FloatArray) -> float:
    """The least share of any bound that d leaves; positive where d keeps every row."""
    return slacks(p, d, _duals(p))


@compiled()
def _add_durations(p: Section, d: FloatArray, bands: FloatArray, right: FloatArray) -> float:
    """Duration [s]; adds its second derivatives and subtracts its gradient."""
    n = len(p.width)
    total = 0.0
    b = np.empty(3)
    for i in range(n):
        first, last = _of(p.begin[i], i, d), _of(p.end[i], i, d)
        for g in range(3):
            x = NODES[g]
            b0, b1, b2 = (1.0 - x) * (1.0 - x), 2.0 * x * (1.0 - x), x * x
            a = b0 * first + b1 * d[i + 1] + b2 * last
            part = WEIGHTS[g] * p.width[i] / math.sqrt(a)
            total += part
            for k in range(3):
                b[k] = b0 * p.begin[i, k] + b2 * p.end[i, k]
            b[1] += b1
            _add_square(bands, i, b, 0.75 * part / (a * a))
            _add_row(right, i, b, 0.5 * part / a)
    for side in range(2):
        if p.ramps[side] > 0.0:
            i = 0 if side == 0 else n - 1
            row = p.begin[0] if side == 0 else p.end[n - 1]
            a = _of(row, i, d)
            part = 3.0 * p.ramps[side] / math.sqrt(a)
            total += part
            _add_square(bands, i, row, 0.75 * part / (a * a))
            _add_row(right, i, row, 0.5 * part / a)
    return total


@compiled()
def _add_bounds(
    p: Section,
    d: FloatArray,
    slack: _Duals,
    dual: _Duals,
    mu: float,
    bands: FloatArray,
    right: FloatArray,
) -> None:
    """Add what the barriers of all bounds contribute to Newton's system."""
    n = len(p.width)
    v, u, slope = np.empty(3), np.empty(3), np.empty(3)
    for i in range(n):
        for r in range(p.plain.shape[1]):
            weight, push = 0.0, 0.0
            if p.high[i, r] < math.inf:
                weight += dual.high[i, r] / slack.high[i, r]
                push -= mu / slack.high[i, r]
            if p.low[i, r] > -math.inf:
                weight += dual.low[i, r] / slack.low[i, r]
                push += mu / slack.low[i, r]
            if weight > 0.0:
                _add_square(bands, i, p.plain[i, r], weight)
                _add_row(right, i, p.plain[i, r], push)
        for r in range(p.curved.shape[1]):
            _tangent(p.raised[i, p.of[r]], i, d, slope)
            for side in range(2):
                sign = -1.0 if side == 0 else 1.0
                for k in range(3):
                    v[k] = p.jerk[r] * slope[k] + sign * p.curved[i, r, k]
                room = slack.curved[i, r, side]
                _add_square(bands, i, v, dual.curved[i, r, side] / room)
                _add_row(right, i, v, mu / room)
        for r in range(p.round.shape[1]):
            bound = _radius(p, i, r, d, slope)
            _round_slope(p, i, r, d, bound, slope, v)
            room, weight = slack.round[i, r], dual.round[i, r]
            _add_square(bands, i, v, weight / room)
            _add_row(right, i, v, mu / room)
            for k in range(3):
                f = _of(p.round[i, r, k], i, d)
                for j in range(3):
                    u[j] = p.round[i, r, k, j] - f / bound * slope[j]
                _add_square(bands, i, u, 2.0 * weight / bound)
    for i in range(n + 2):
        if slack.positive[i] > 0.0:
            bands[0, i] += dual.positive[i] / slack.positive[i]
            right[i] += mu / slack.positive[i]


@compiled(inline="always")
def _round_slope(
    p: Section,
    i: int,
    r: int,
    d: FloatArray,
    bound: float,
    slope: FloatArray,
    v: FloatArray,
) -> None:
    """Write the slope of `bound - |vector|² / bound` into v."""
    square = 0.0
    for k in range(3):
        v[k] = 0.0
    for k in range(3):
        f = _of(p.round[i, r, k], i, d)
        square += f * f
        for j in range(3):
            v[j] -= 2.0 * f / bound * p.round[i, r, k, j]
    for j in range(3):
        v[j] += (1.0 + square / (bound * bound)) * slope[j]


@compiled(inline="always")
def _change(slack: float, dual: float, rise: float, mu: float, reach: FloatArray) -> float:
    """The change of a multiplier; shortens the reach of the step, (slack, multiplier)."""
    change = mu / slack - dual - dual / slack * rise
    if rise < 0.0 and -NEAREST * slack / rise < reach[0]:
        reach[0] = -NEAREST * slack / rise
    if change < 0.0 and -NEAREST * dual / change < reach[1]:
        reach[1] = -NEAREST * dual / change
    return change


@compiled()
def _changes(
    p: Section,
    d: FloatArray,
    step: FloatArray,
    slack: _Duals,
    dual: _Duals,
    mu: float,
    change: _Duals,
) -> FloatArray:
    """Write the changes of all multipliers; returns the longest steps of slacks and multipliers."""
    n = len(p.width)
    reach = np.ones(2)
    v, slope = np.empty(3), np.empty(3)
    for i in range(n):
        for r in range(p.plain.shape[1]):
            rise = _of(p.plain[i, r], i, step)
            if p.high[i, r] < math.inf:
                change.high[i, r] = _change(slack.high[i, r], dual.high[i, r], -rise, mu, reach)
            if p.low[i, r] > -math.inf:
                change.low[i, r] = _change(slack.low[i, r], dual.low[i, r], rise, mu, reach)
        for r in range(p.curved.shape[1]):
            _tangent(p.raised[i, p.of[r]], i, d, slope)
            common = p.jerk[r] * _of(slope, i, step)
            rise = _of(p.curved[i, r], i, step)
            for side in range(2):
                own = common - rise if side == 0 else common + rise
                change.curved[i, r, side] = _change(
                    slack.curved[i, r, side], dual.curved[i, r, side], own, mu, reach
                )
        for r in range(p.round.shape[1]):
            bound = _radius(p, i, r, d, slope)
            _round_slope(p, i, r, d, bound, slope, v)
            change.round[i, r] = _change(
                slack.round[i, r], dual.round[i, r], _of(v, i, step), mu, reach
            )
    for i in range(n + 2):
        if slack.positive[i] > 0.0:
            change.positive[i] = _change(slack.positive[i], dual.positive[i], step[i], mu, reach)
    return reach


@compiled()
def _near_enough(p: Section, d: FloatArray, old: _Duals) -> bool:
    """Whether d keeps a share of its old slack on every curved and round row."""
    n = len(p.width)
    share = 1.0 - NEAREST
    slope = np.empty(3)
    for i in range(n):
        for r in range(p.curved.shape[1]):
            bound = p.jerk[r] * _tangent(p.raised[i, p.of[r]], i, d, slope)
            f = _of(p.curved[i, r], i, d)
            if bound - f < share * old.curved[i, r, 0] or bound + f < share * old.curved[i, r, 1]:
                return False
        for r in range(p.round.shape[1]):
            bound = _radius(p, i, r, d, slope)
            square = 0.0
            for k in range(3):
                square += _of(p.round[i, r, k], i, d) ** 2
            if bound <= 0.0 or bound - square / bound < share * old.round[i, r]:
                return False
    return True


@compiled()
def _solve_bands(bands: FloatArray, right: FloatArray) -> None:
    """Solve a symmetric system of five diagonals in place, by LDLᵀ with a scaled diagonal."""
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


@compiled()
def _hold(bands: FloatArray, right: FloatArray, free: int) -> None:
    """Take the ends out of Newton's system, but for a free one."""
    last = len(right) - 1
    if free != START:
        bands[0, 0], bands[1, 0], bands[2, 0], right[0] = 1.0, 0.0, 0.0, 0.0
    if free != END:
        bands[0, last], bands[1, last - 1], bands[2, last - 2], right[last] = 1.0, 0.0, 0.0, 0.0


@compiled()
def _move(d: FloatArray, step: FloatArray, share: float, trial: FloatArray) -> None:
    for i in range(len(d)):
        trial[i] = d[i] + share * step[i]


@compiled()
def _count(p: Section, dual: _Duals) -> float:
    """Number of bounds."""
    found = dual.curved.size + dual.round.size
    for i in range(p.low.shape[0]):
        for r in range(p.low.shape[1]):
            found += (p.low[i, r] > -math.inf) + (p.high[i, r] < math.inf)
    return float(found + len(p.width))


@compiled()
def _start_duals(p: Section, slack: _Duals, mu: float, dual: _Duals) -> None:
    """Multipliers on the central path of mu."""
    for i in range(p.low.shape[0]):
        for r in range(p.low.shape[1]):
            dual.low[i, r] = mu / slack.low[i, r] if p.low[i, r] > -math.inf else 0.0
            dual.high[i, r] = mu / slack.high[i, r] if p.high[i, r] < math.inf else 0.0
        for r in range(p.curved.shape[1]):
            for side in range(2):
                dual.curved[i, r, side] = mu / slack.curved[i, r, side]
        for r in range(p.round.shape[1]):
            dual.round[i, r] = mu / slack.round[i, r]
    for i in range(len(slack.positive)):
        if slack.positive[i] > 0.0:
            dual.positive[i] = mu / slack.positive[i]


@compiled()
def _climb(dual: FloatArray, change: FloatArray, share: float) -> None:
    """Add a share of the changes to multipliers."""
    flat, more = dual.reshape(-1), change.reshape(-1)
    for i in range(flat.size):
        flat[i] += share * more[i]


@compiled()
def improve(
    p: Section, d: FloatArray, goal: int, target: float, tolerance: float, most: int
) -> int:
    """Improve a strictly feasible d in place until its gap is small; returns the iterations.

    Args:
        p: The problem.
        d: Control points of a [m²/s²], (n + 2,); those of the ends stay, but for the goal's.
        goal: DURATION, START or END: what is minimized, or maximized for the two others.
        target: The value of a at which the search for START or END ends.
        tolerance: Share of the optimum within which the result is.
        most: Largest number of iterations.
    """
    n = len(p.width)
    slack, dual, change = _duals(p), _duals(p), _duals(p)
    bands, right, trial = np.zeros((3, n + 2)), np.zeros(n + 2), np.empty(n + 2)
    end = 0 if goal == START else n + 1
    # A fixed end has no barrier.
    slacks(p, d, slack)
    for k in (0, n + 1):
        if goal == DURATION or k != end:
            slack.positive[k] = 0.0
    size = _add_durations(p, d, bands, right) if goal == DURATION else target
    bounds = _count(p, dual)
    mu = size / bounds
    _start_duals(p, slack, mu, dual)
    for iteration in range(most):
        bands[:], right[:] = 0.0, 0.0
        if goal == DURATION:
            size = _add_durations(p, d, bands, right)
        else:
            right[end] += 1.0
        _add_bounds(p, d, slack, dual, mu, bands, right)
        _hold(bands, right, goal)
        trial[:] = right
        _solve_bands(bands, right)
        decrement = 0.0
        for i in range(n + 2):
            decrement += trial[i] * right[i]
        reach = _changes(p, d, right, slack, dual, mu, change)
        share = reach[0]
        landed = goal != DURATION and d[end] + share * right[end] >= target
        if landed:
            share = (target - d[end]) / right[end]
        _move(d, right, share, trial)
        shortened = 0
        while not _near_enough(p, trial, slack):
            share *= SHORTER
            shortened += 1
            landed = False
            if shortened > MOST_SHORTER:
                return iteration
            _move(d, right, share, trial)
        d[:] = trial
        if landed:
            d[end] = target
        slacks(p, d, slack)
        for k in (0, n + 1):
            if goal == DURATION or k != end:
                slack.positive[k] = 0.0
        if landed:
            return iteration + 1
        _climb(dual.low, change.low, reach[1])
        _climb(dual.high, change.high, reach[1])
        _climb(dual.curved, change.curved, reach[1])
        _climb(dual.round, change.round, reach[1])
        _climb(dual.positive, change.positive, reach[1])
        if decrement < CENTERED * bounds * mu and min(share, reach[1]) > LONG:
            if bounds * mu <= 0.5 * tolerance * size:
                return iteration + 1
            mu *= FALL
    return most
