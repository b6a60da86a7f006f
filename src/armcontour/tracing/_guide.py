"""Compiled cubic splines through joint positions and null-space rows: the redundancy's guide."""

from __future__ import annotations

import numpy as np

from armcontour._checks import BoolArray, FloatArray, IntArray
from armcontour._kernels import compiled

# A spline overshoots if it leaves a chord by more than this fraction of the largest step next to
# it, and by more than the floor [rad].
SWING = 0.1
SWING_FLOOR = 0.01


@compiled()
def turn_bases(w: FloatArray, turns: FloatArray, q: FloatArray) -> FloatArray:
    """Joint positions beside bases that each turn from the one before, (n, dof + free dof).

    Args:
        w: Bases of the null space, (n, free, dof).
        turns: How the basis of a knot turns against that of the knot before, (n - 1, free, free).
        q: Joint positions [rad], (n, dof).
    """
    n, free, dof = w.shape
    values = np.empty((n, dof + free * dof))
    turn, before = np.empty((free, free)), np.empty((free, free))
    for a in range(free):
        for b in range(free):
            turn[a, b] = 1.0 if a == b else 0.0
    for i in range(n):
        if i > 0:
            for a in range(free):
                for b in range(free):
                    before[a, b] = turn[a, b]
            for a in range(free):
                for b in range(free):
                    turn[a, b] = 0.0
                    for c in range(free):
                        turn[a, b] += before[a, c] * turns[i - 1, c, b]
        for k in range(dof):
            values[i, k] = q[i, k]
            for a in range(free):
                value = 0.0
                for b in range(free):
                    value += turn[a, b] * w[i, b, k]
                values[i, dof + a * dof + k] = value
    return values


@compiled(inner=True)
def solve_slopes(below: FloatArray, own: FloatArray, above: FloatArray, slopes: FloatArray) -> None:
    """Solve tridiagonal equations by elimination with pivoting; `slopes` become the solutions.

    Args:
        below: The matrix below its diagonal, (n,), overwritten as all others.
        own: Its diagonal, (n,).
        above: Above its diagonal, (n,).
        slopes: The right sides, (n, values).
    """
    n, values = slopes.shape
    for i in range(n - 1):
        if abs(own[i]) >= abs(below[i]):
            factor = below[i] / own[i]
            own[i + 1] -= factor * above[i]
            # From here on `below` is the second diagonal above.
            below[i] = 0.0
            for j in range(values):
                slopes[i + 1, j] -= factor * slopes[i, j]
            continue
        factor = own[i] / below[i]
        own[i], above[i], own[i + 1] = below[i], own[i + 1], above[i] - factor * own[i + 1]
        below[i] = above[i + 1]
        above[i + 1] *= -factor
        for j in range(values):
            value = slopes[i, j] - factor * slopes[i + 1, j]
            slopes[i, j] = slopes[i + 1, j]
            slopes[i + 1, j] = value
    for i in range(n - 1, -1, -1):
        for j in range(values):
            value = slopes[i, j]
            if i + 1 < n:
                value -= above[i] * slopes[i + 1, j]
            if i + 2 < n:
                value -= below[i] * slopes[i + 2, j]
            slopes[i, j] = value / own[i]


@compiled(inner=True, allocates=True)
def write_slopes(s: FloatArray, values: FloatArray, slopes: FloatArray) -> None:
    """Write the slopes of the cubic spline through values at its knots, (n, values).

    The third derivative does not jump at the second knot nor at the last but one ("not a knot").
    Through two points the spline is a line, through three a parabola.

    Args:
        s: The knots, (n,).
        values: The values, (n, values).
        slopes: Output: the slopes.
    """
    n, size = values.shape
    below, own, above = np.empty(n), np.empty(n), np.empty(n)
    for j in range(size):
        for i in range(n - 1):
            slopes[i, j] = (values[i + 1, j] - values[i, j]) / (s[i + 1] - s[i])
        slopes[n - 1, j] = slopes[n - 2, j]
        if n == 3:
            bend = (slopes[1, j] - slopes[0, j]) / (s[2] - s[0])
            slopes[0, j] -= bend * (s[1] - s[0])
            slopes[2, j] += bend * (s[2] - s[1])
            slopes[1, j] = slopes[0, j] + 2.0 * bend * (s[1] - s[0])
    if n <= 3:
        return
    for i in range(1, n - 1):
        below[i - 1], above[i] = s[i + 1] - s[i], s[i] - s[i - 1]
        own[i] = 2.0 * (s[i + 1] - s[i - 1])
    first, last = s[2] - s[0], s[n - 1] - s[n - 3]
    own[0], above[0], above[n - 1] = s[2] - s[1], first, 0.0
    own[n - 1], below[n - 2] = s[n - 2] - s[n - 3], last
    for j in range(size):
        a, b, c = s[1] - s[0], s[2] - s[1], slopes[0, j]
        start = ((a + 2.0 * first) * b * c + a * a * slopes[1, j]) / first
        for i in range(1, n - 1):
            before, c = c, slopes[i, j]
            slopes[i, j] = 3.0 * ((s[i + 1] - s[i]) * before + (s[i] - s[i - 1]) * c)
        a, b = s[n - 1] - s[n - 2], s[n - 2] - s[n - 3]
        slopes[n - 1, j] = (a * a * before + (2.0 * last + a) * b * c) / last
        slopes[0, j] = start
    solve_slopes(below, own, above, slopes)


@compiled(inner=True)
def overshoots(values: FloatArray, c: FloatArray, s: FloatArray, i: int) -> bool:
    """Whether the spline overshoots between knots i and i + 1.

    Args:
        values: Values at the knots, (n, values).
        c: Coefficients of the spline, (n - 1, 6, values).
        s: The knots, (n,).
        i: Index of the interval.
    """
    n, size = values.shape
    largest = 0.0
    for k in range(max(i - 1, 0), min(i + 2, n - 1)):
        for j in range(size):
            largest = max(largest, abs(values[k + 1, j] - values[k, j]))
    bound = SWING * largest + SWING_FLOOR
    for x in (0.25, 0.5, 0.75):
        u = x * (s[i + 1] - s[i])
        for j in range(size):
            rest = u * (c[i, 1, j] + u * (c[i, 2, j] + u * c[i, 3, j]))
            if abs(rest - x * (values[i + 1, j] - values[i, j])) > bound:
                return True
    return False


@compiled()
def fit_splines(s: FloatArray, values: FloatArray, cuts: IntArray) -> tuple[FloatArray, BoolArray]:
    """Cubic splines through values, one per section.

    Args:
        s: The knots, (n,).
        values: The values, (n, values).
        cuts: Indices of the knots at which sections begin, and of the last knot, (sections + 1,).

    Returns:
        Coefficients of powers of the distance from the knot before, from 1 to u⁵, (n - 1, 6,
        values), and for each section whether its spline overshoots.
    """
    n, size = values.shape
    c, swings = np.empty((n - 1, 6, size)), np.empty(len(cuts) - 1, np.bool_)
    slopes = np.empty((n, size))
    for m in range(len(cuts) - 1):
        first, last = cuts[m], cuts[m + 1]
        at, here = s[first : last + 1], values[first : last + 1]
        write_slopes(at, here, slopes[: len(at)])
        for i in range(first, last):
            width = s[i + 1] - s[i]
            for j in range(size):
                begin, end = slopes[i - first, j], slopes[i - first + 1, j]
                slope = (values[i + 1, j] - values[i, j]) / width
                bend = (begin + end - 2.0 * slope) / width
                c[i, 0, j], c[i, 1, j] = values[i, j], begin
                c[i, 2, j], c[i, 3, j] = (slope - begin) / width - bend, bend / width
                c[i, 4, j] = c[i, 5, j] = 0.0
        swings[m] = False
        for i in range(last - first):
            if last - first > 1 and overshoots(here, c[first:last], at, i):
                swings[m] = True
                break
    return c, swings


@compiled()
def guide_at(c: FloatArray, at: IntArray, u: FloatArray, dof: int) -> tuple[FloatArray, FloatArray]:
    """Rows w and joint positions g of the guide with two derivatives each.

    Args:
        c: Coefficients as in `fit_splines`, (n, 6, dof + free dof).
        at: Indices of intervals, (k,).
        u: Distances from their starts [m], (k,).
        dof: Number of joints.

    Returns:
        w, (k, 3, free, dof), and g, (k, 3, dof).
    """
    n, size = len(at), c.shape[2]
    w, g = np.empty((n, 3, size - dof)), np.empty((n, 3, dof))
    for i in range(n):
        x = u[i]
        for j in range(size):
            value = slope = bend = 0.0
            for k in range(5, -1, -1):
                bend = bend * x + 2.0 * slope
                slope = slope * x + value
                value = value * x + c[at[i], k, j]
            if j < dof:
                g[i, 0, j], g[i, 1, j], g[i, 2, j] = value, slope, bend
            else:
                w[i, 0, j - dof], w[i, 1, j - dof], w[i, 2, j - dof] = value, slope, bend
    return w.reshape(n, 3, size // dof - 1, dof), g
