"""Compiled interior-point method for quadratic programs whose rows each touch three neighbours.

The program is `min c x + weight |x|² / 2` with `rows x <= bounds`. The unknowns of a node stand
together, and a row touches the unknowns of its node and of both neighbours only. The normal matrix
is then banded, and an iteration takes time in proportion to the number of nodes. The method is
Mehrotra's, with one correction of a predicted step.
"""

from __future__ import annotations

import math

import numpy as np

from armcontour._checks import BoolArray, FloatArray
from armcontour._kernels import FUSED, compiled

# Iterations end when the average product of slack and multiplier, and the largest violation of a
# row, are below these; rows and unknowns are scaled to the order of 1.
GAP = 1e-9
VIOLATION = 1e-8
MOST_ITERATIONS = 60
# A step goes this share of the way to the boundary at most.
WAY = 0.995
# The first slack is at least this.
FIRST_SLACK = 1e-2


@compiled(fastmath=FUSED)
def solve_program(
    cost: FloatArray, rows: FloatArray, bounds: FloatArray, weight: FloatArray
) -> tuple[FloatArray, int]:
    """Solve the program; the solution of an unfinished one is its last iterate.

    Args:
        cost: Cost of the unknowns, (n, k).
        rows: Coefficients of the rows of each node, for the unknowns of the node before, its own
            and those of the node after, (n, m, 3 k); rows of zeros are left out.
        bounds: Upper bounds of the rows, (n, m).
        weight: Weights of the squares of the unknowns, above zero, (n, k).

    Returns:
        The unknowns, (n, k), and the number of iterations; negative if they did not converge.
    """
    n, k = cost.shape
    m = rows.shape[1]
    x = np.zeros((n, k))
    slack, dual = np.ones((n, m)), np.ones((n, m))
    used = np.zeros((n, m), dtype=np.bool_)
    count = 0
    for i in range(n):
        for r in range(m):
            for j in range(3 * k):
                if rows[i, r, j] != 0.0:
                    used[i, r] = True
            if used[i, r]:
                count += 1
                slack[i, r] = max(bounds[i, r], FIRST_SLACK)
                dual[i, r] = 1.0 / slack[i, r]
    largest = 0.0
    for i in range(n):
        for j in range(k):
            largest = max(largest, abs(cost[i, j]))
    # The multipliers start in proportion to the cost.
    for i in range(n):
        for r in range(m):
            dual[i, r] *= largest * 0.1
    band = 3 * k
    matrix = np.empty((n * k, band))
    step, right = np.empty((n, k)), np.empty((n, k))
    primal = np.zeros((n, m))
    d_slack, d_dual = np.zeros((n, m)), np.zeros((n, m))
    complement = np.zeros((n, m))
    for iteration in range(MOST_ITERATIONS):
        gap, worst = _residuals(x, rows, bounds, slack, dual, used, primal)
        gap /= max(count, 1)
        if gap < GAP * largest and worst < VIOLATION:
            return x, iteration
        _fill(rows, slack, dual, used, weight, matrix)
        if not _factor(matrix, band):
            return x, -iteration - 1
        # The predictor goes for complementarity at once, the corrector for a share of it.
        for i in range(n):
            for r in range(m):
                complement[i, r] = slack[i, r] * dual[i, r]
        _direction(
            cost, rows, x, slack, dual, used, weight, primal, complement, matrix, right, step
        )
        _rest_of_step(rows, step, slack, dual, used, primal, complement, d_slack, d_dual)
        way = _longest(slack, dual, used, d_slack, d_dual)
        after = 0.0
        for i in range(n):
            for r in range(m):
                if used[i, r]:
                    after += (slack[i, r] + way * d_slack[i, r]) * (dual[i, r] + way * d_dual[i, r])
        after /= max(count, 1)
        aim = (after / gap) ** 3 * gap
        for i in range(n):
            for r in range(m):
                if used[i, r]:
                    complement[i, r] = slack[i, r] * dual[i, r] + d_slack[i, r] * d_dual[i, r] - aim
        _direction(
            cost, rows, x, slack, dual, used, weight, primal, complement, matrix, right, step
        )
        _rest_of_step(rows, step, slack, dual, used, primal, complement, d_slack, d_dual)
        way = min(1.0, WAY * _longest(slack, dual, used, d_slack, d_dual))
        for i in range(n):
            for j in range(k):
                x[i, j] += way * step[i, j]
            for r in range(m):
                if used[i, r]:
                    slack[i, r] += way * d_slack[i, r]
                    dual[i, r] += way * d_dual[i, r]
    return x, -MOST_ITERATIONS


@compiled(fastmath=FUSED)
def _times(rows: FloatArray, x: FloatArray, i: int, r: int) -> float:
    """Value of row r of node i."""
    n, k = x.shape
    value = 0.0
    for o in range(3):
        at = i + o - 1
        if 0 <= at < n:
            for j in range(k):
                value += rows[i, r, o * k + j] * x[at, j]
    return value


@compiled(fastmath=FUSED)
def _residuals(
    x: FloatArray,
    rows: FloatArray,
    bounds: FloatArray,
    slack: FloatArray,
    dual: FloatArray,
    used: BoolArray,
    primal: FloatArray,
) -> tuple[float, float]:
    """Write `rows x + slack - bounds`; give the sum of products and the largest violation."""
    gap, worst = 0.0, 0.0
    for i in range(rows.shape[0]):
        for r in range(rows.shape[1]):
            if used[i, r]:
                primal[i, r] = _times(rows, x, i, r) + slack[i, r] - bounds[i, r]
                gap += slack[i, r] * dual[i, r]
                worst = max(worst, abs(primal[i, r]))
    return gap, worst


@compiled(fastmath=FUSED)
def _fill(
    rows: FloatArray,
    slack: FloatArray,
    dual: FloatArray,
    used: BoolArray,
    weight: FloatArray,
    matrix: FloatArray,
) -> None:
    """Write the lower bands of the normal matrix; entry (a, b) stands at `matrix[a, a - b]`."""
    n, k = weight.shape
    matrix[:] = 0.0
    for i in range(n):
        for j in range(k):
            matrix[i * k + j, 0] = weight[i, j]
    for i in range(n):
        low, high = (k if i == 0 else 0), (2 * k if i == n - 1 else 3 * k)
        first = (i - 1) * k
        for r in range(rows.shape[1]):
            if not used[i, r]:
                continue
            ratio = dual[i, r] / slack[i, r]
            for a in range(low, high):
                scaled = ratio * rows[i, r, a]
                if scaled != 0.0:
                    for b in range(low, a + 1):
                        matrix[first + a, a - b] += scaled * rows[i, r, b]


@compiled(fastmath=FUSED)
def _factor(matrix: FloatArray, band: int) -> bool:
    """Replace a banded matrix by its Cholesky factor; false if the matrix is not positive."""
    n = matrix.shape[0]
    for a in range(n):
        for b in range(max(0, a - band + 1), a + 1):
            value = matrix[a, a - b]
            for c in range(max(0, a - band + 1), b):
                value -= matrix[a, a - c] * matrix[b, b - c]
            if b < a:
                matrix[a, a - b] = value / matrix[b, 0]
            else:
                if not value > 0.0:
                    return False
                matrix[a, 0] = math.sqrt(value)
    return True


@compiled(fastmath=FUSED)
def _direction(
    cost: FloatArray,
    rows: FloatArray,
    x: FloatArray,
    slack: FloatArray,
    dual: FloatArray,
    used: BoolArray,
    weight: FloatArray,
    primal: FloatArray,
    complement: FloatArray,
    matrix: FloatArray,
    right: FloatArray,
    step: FloatArray,
) -> None:
    """Write the Newton step of the unknowns for given products of slacks and multipliers."""
    n, k = x.shape
    for i in range(n):
        for j in range(k):
            right[i, j] = -cost[i, j] - weight[i, j] * x[i, j]
    for i in range(n):
        for r in range(rows.shape[1]):
            if not used[i, r]:
                continue
            value = dual[i, r] + (dual[i, r] * primal[i, r] - complement[i, r]) / slack[i, r]
            for o in range(3):
                at = i + o - 1
                if 0 <= at < n:
                    for j in range(k):
                        right[at, j] -= rows[i, r, o * k + j] * value
    band = matrix.shape[1]
    flat, source = step.reshape(-1), right.reshape(-1)
    size = n * k
    for a in range(size):
        value = source[a]
        for b in range(max(0, a - band + 1), a):
            value -= matrix[a, a - b] * flat[b]
        flat[a] = value / matrix[a, 0]
    for a in range(size - 1, -1, -1):
        value = flat[a]
        for b in range(a + 1, min(size, a + band)):
            value -= matrix[b, b - a] * flat[b]
        flat[a] = value / matrix[a, 0]


@compiled(fastmath=FUSED)
def _rest_of_step(
    rows: FloatArray,
    step: FloatArray,
    slack: FloatArray,
    dual: FloatArray,
    used: BoolArray,
    primal: FloatArray,
    complement: FloatArray,
    d_slack: FloatArray,
    d_dual: FloatArray,
) -> None:
    """Write the steps of slacks and multipliers that belong to a step of the unknowns."""
    for i in range(rows.shape[0]):
        for r in range(rows.shape[1]):
            if used[i, r]:
                change = -primal[i, r] - _times(rows, step, i, r)
                d_slack[i, r] = change
                d_dual[i, r] = -(complement[i, r] + dual[i, r] * change) / slack[i, r]


@compiled(fastmath=FUSED)
def _longest(
    slack: FloatArray, dual: FloatArray, used: BoolArray, d_slack: FloatArray, d_dual: FloatArray
) -> float:
    """The longest step, up to 1, that keeps slacks and multipliers positive."""
    way = 1.0
    for i in range(slack.shape[0]):
        for r in range(slack.shape[1]):
            if used[i, r]:
                if d_slack[i, r] < 0.0:
                    way = min(way, -slack[i, r] / d_slack[i, r])
                if d_dual[i, r] < 0.0:
                    way = min(way, -dual[i, r] / d_dual[i, r])
    return way
