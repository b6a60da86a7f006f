"""Compiled interior-point method for quadratic programs whose rows couple three neighbours.

The program is `min c x + weight |x|² / 2` with `rows x <= bounds`. The unknowns of a node are
contiguous, and a row depends only on the unknowns of its node and of both neighbours. The normal
matrix is therefore banded, and an iteration takes time in proportion to the number of nodes. The
method is Mehrotra's, with one correction of a predicted step.
"""

from __future__ import annotations

import math

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.kernel_cache import FUSED, compiled

# Average product of slack and multiplier below which the iterations converge, as a fraction of the
# largest cost; rows and unknowns are scaled to the order of 1.
GAP = 1e-8
# Largest violation of a row below which the iterations converge.
VIOLATION = 1e-8
# Largest number of iterations.
MAX_ITERATIONS = 60
# Largest step, as a fraction of the step to the boundary.
STEP_SHARE = 0.995
# Smallest initial slack.
FIRST_SLACK = 0.1


@compiled(fastmath=FUSED)
def solve_program(
    cost: FloatArray, rows: FloatArray, bounds: FloatArray, weight: FloatArray
) -> tuple[FloatArray, int]:
    """Solve the quadratic program; without convergence the result is the last iterate.

    Returns the unknowns, (n, k), and the number of iterations; negative if they did not converge.

    - `cost`: cost of the unknowns, (n, k).
    - `rows`: coefficients of the rows of each node, for the unknowns of the previous node, of the
      node itself and of the next node, (n, m, 3 k); rows of zeros are ignored.
    - `bounds`: upper bounds of the rows, (n, m).
    - `weight`: positive weights of the squares of the unknowns, (n, k).
    """
    n, k = cost.shape
    first, ends, values, bound = _pack(rows, bounds)
    count = len(bound)
    c = cost.ravel()
    w = weight.ravel()
    largest = 0.0
    for a in range(n * k):
        largest = max(largest, abs(c[a]))
    x = np.zeros(n * k)
    slack = np.maximum(bound, FIRST_SLACK)
    # Initial multipliers are proportional to the cost.
    dual = largest * 0.1 / slack
    matrix = np.empty((n * k, 3 * k))
    step = np.empty(n * k)
    primal = np.empty(count)
    d_slack = np.empty(count)
    d_dual = np.empty(count)
    complement = np.empty(count)
    for iteration in range(MAX_ITERATIONS):
        gap = 0.0
        worst = 0.0
        for r in range(count):
            primal[r] = _row_product(first, ends, values, x, r) + slack[r] - bound[r]
            complement[r] = slack[r] * dual[r]
            gap += complement[r]
            worst = max(worst, abs(primal[r]))
        gap /= max(count, 1)
        if gap < GAP * largest and worst < VIOLATION:
            return x.reshape(n, k), iteration
        _normal_matrix(first, ends, values, slack, dual, w, matrix)
        if not _factor(matrix):
            return x.reshape(n, k), -iteration - 1
        # The target of the predictor is zero complementarity. The target of the corrector is a
        # fraction of the average complementarity.
        for corrected in range(2):
            for a in range(n * k):
                step[a] = -c[a] - w[a] * x[a]
            for r in range(count):
                value = dual[r] + (dual[r] * primal[r] - complement[r]) / slack[r]
                shift = first[r] - ends[r]
                for p in range(ends[r], ends[r + 1]):
                    step[shift + p] -= values[p] * value
            _solve(matrix, step)
            for r in range(count):
                change = -primal[r] - _row_product(first, ends, values, step, r)
                d_slack[r] = change
                d_dual[r] = -(complement[r] + dual[r] * change) / slack[r]
            step_length = _longest_step(slack, dual, d_slack, d_dual)
            if corrected:
                break
            after = 0.0
            for r in range(count):
                after += (slack[r] + step_length * d_slack[r]) * (dual[r] + step_length * d_dual[r])
            target = (after / max(count, 1) / gap) ** 3 * gap
            for r in range(count):
                complement[r] += d_slack[r] * d_dual[r] - target
        step_length = min(1.0, STEP_SHARE * step_length)
        for a in range(n * k):
            x[a] += step_length * step[a]
        for r in range(count):
            slack[r] += step_length * d_slack[r]
            dual[r] += step_length * d_dual[r]
    return x.reshape(n, k), -MAX_ITERATIONS


@compiled(inner=True, allocates=True, fastmath=FUSED)
def _pack(
    rows: FloatArray, bounds: FloatArray
) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
    """Pack the nonzero rows, each from its first to its last nonzero coefficient."""
    # Returns the first unknown of each row, (p,); the start and end of the coefficients of each row
    # among all coefficients, (p + 1,); the coefficients; and the bounds, (p,).
    n, m, width = rows.shape
    k = width // 3
    first = np.empty(n * m, dtype=np.int64)
    ends = np.zeros(n * m + 1, dtype=np.int64)
    values = np.empty(n * m * width)
    bound = np.empty(n * m)
    count = 0
    for i in range(n):
        low = k if i == 0 else 0
        high = 2 * k if i == n - 1 else 3 * k
        for r in range(m):
            begin, end = low, high
            while begin < end and rows[i, r, begin] == 0.0:
                begin += 1
            while end > begin and rows[i, r, end - 1] == 0.0:
                end -= 1
            if begin == end:
                continue
            offset = ends[count]
            for j in range(begin, end):
                values[offset + j - begin] = rows[i, r, j]
            first[count] = (i - 1) * k + begin
            bound[count] = bounds[i, r]
            ends[count + 1] = offset + end - begin
            count += 1
    return first[:count], ends[: count + 1], values[: ends[count]], bound[:count]


@compiled(inner=True, fastmath=FUSED, inline="always")
def _row_product(
    first: IntArray, ends: IntArray, values: FloatArray, x: FloatArray, r: int
) -> float:
    value = 0.0
    shift = first[r] - ends[r]
    for p in range(ends[r], ends[r + 1]):
        value += values[p] * x[shift + p]
    return value


@compiled(inner=True, fastmath=FUSED)
def _normal_matrix(
    first: IntArray,
    ends: IntArray,
    values: FloatArray,
    slack: FloatArray,
    dual: FloatArray,
    weight: FloatArray,
    matrix: FloatArray,
) -> None:
    """Write the lower bands of the normal matrix; entry (a, b) is in `matrix[a, last + b - a]`."""
    last = matrix.shape[1] - 1
    matrix[:] = 0.0
    for a in range(len(weight)):
        matrix[a, last] = weight[a]
    for r in range(len(slack)):
        ratio = dual[r] / slack[r]
        begin = ends[r]
        length = ends[r + 1] - ends[r]
        for a in range(length):
            scaled = ratio * values[begin + a]
            row = matrix[first[r] + a]
            for b in range(a + 1):
                row[last - a + b] += scaled * values[begin + b]


@compiled(inner=True, fastmath=FUSED)
def _factor(matrix: FloatArray) -> bool:
    """Replace a banded matrix by its Cholesky factor, with the inverse of its diagonal."""
    last = matrix.shape[1] - 1
    for a in range(matrix.shape[0]):
        low = max(0, a - last)
        row = matrix[a]
        for b in range(low, a):
            other = matrix[b]
            value = row[last + b - a]
            for c in range(low, b):
                value -= row[last + c - a] * other[last + c - b]
            row[last + b - a] = value * other[last]
        value = row[last]
        for c in range(low, a):
            value -= row[last + c - a] ** 2
        if not value > 0.0:
            return False
        row[last] = 1.0 / math.sqrt(value)
    return True


@compiled(inner=True, fastmath=FUSED)
def _solve(matrix: FloatArray, x: FloatArray) -> None:
    """Replace the right side x by the solution, given the factor that `_factor` computes."""
    last = matrix.shape[1] - 1
    size = len(x)
    for a in range(size):
        value = x[a]
        for b in range(max(0, a - last), a):
            value -= matrix[a, last + b - a] * x[b]
        x[a] = value * matrix[a, last]
    for a in range(size - 1, -1, -1):
        x[a] *= matrix[a, last]
        for b in range(max(0, a - last), a):
            x[b] -= matrix[a, last + b - a] * x[a]


@compiled(inner=True, fastmath=FUSED)
def _longest_step(
    slack: FloatArray, dual: FloatArray, d_slack: FloatArray, d_dual: FloatArray
) -> float:
    step_length = 1.0
    for r in range(len(slack)):
        if d_slack[r] < 0.0:
            step_length = min(step_length, -slack[r] / d_slack[r])
        if d_dual[r] < 0.0:
            step_length = min(step_length, -dual[r] / d_dual[r])
    return step_length
