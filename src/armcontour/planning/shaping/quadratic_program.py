"""Compiled interior-point method for quadratic programs whose rows couple three neighbours.

The program is `min c x + weight |x|² / 2` with `rows x <= bounds`. The unknowns of a node are
contiguous, and a row depends only on the unknowns of its node and of both neighbours. The normal
matrix is therefore banded, and an iteration takes time in proportion to the number of nodes. The
method is Mehrotra's, with one correction of a predicted step.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.kernel_cache import FUSED, compiled

# Largest violation of a row below which the iterations converge.
VIOLATION = 1e-8
# Largest number of iterations.
MAX_PROGRAM_ITERATIONS = 60
# Largest step, as a fraction of the step to the boundary.
STEP_SHARE = 0.995
# Smallest initial slack.
FIRST_SLACK = 0.1


class ProgramSolution(NamedTuple):
    """Result of `solve_program`."""

    x: FloatArray  # Unknowns, (n, k)
    iterations: int  # Number of iterations; negative if they did not converge


class _Rows(NamedTuple):
    """The p rows that are not zero, each from its first to its last nonzero coefficient."""

    first: IntArray  # First unknown of each row, (p,)
    ends: IntArray  # Starts and ends of the rows among all coefficients, (p + 1,)
    values: FloatArray  # Coefficients of all rows
    bound: FloatArray  # Upper bounds, (p,)


class _ProgramIterate(NamedTuple):
    """An iterate, or its change."""

    x: FloatArray  # Unknowns, flat, (n k,)
    slack: FloatArray  # Slacks s of the rows, (p,)
    dual: FloatArray  # Multipliers y of the rows, (p,)


class _Residuals(NamedTuple):
    """Residuals of the conditions of a minimum."""

    primal: FloatArray  # `rows x + s - bounds`, (p,)
    complement: FloatArray  # `s y`, less what the corrector adds, (p,)


@compiled(fastmath=FUSED)
def solve_program(
    cost: FloatArray, rows: FloatArray, bounds: FloatArray, weight: FloatArray, gap_share: float
) -> ProgramSolution:
    """Solve the quadratic program; without convergence the result is the last iterate.

    At the minimum, slacks s and multipliers y, both nonnegative, satisfy

        rows x + s = bounds,  c + weight x + rows' y = 0,  s y = 0.

    Mehrotra's method (SIAM J. Optim. 2, 575-601, 1992) solves these conditions: Newton's step to
    products s y of zero predicts which products can be reached, and a second step with the same
    matrix corrects the first one.

    - `cost`: cost of the unknowns, (n, k).
    - `rows`: coefficients of the rows of each node, for the unknowns of the previous node, of the
      node itself and of the next node, (n, m, 3 k); rows of zeros are ignored.
    - `bounds`: upper bounds of the rows, (n, m).
    - `weight`: positive weights of the squares of the unknowns, (n, k).
    - `gap_share`: average product of slack and multiplier below which the iterations converge, as a
      fraction of the largest cost; rows and unknowns are scaled to the order of 1.
    """
    n, k = cost.shape
    packed = _pack(rows, bounds)
    count = len(packed.bound)
    c = cost.ravel()
    w = weight.ravel()
    largest = 0.0
    for a in range(n * k):
        largest = max(largest, abs(c[a]))
    slack = np.maximum(packed.bound, FIRST_SLACK)
    # Initial multipliers are proportional to the cost.
    point = _ProgramIterate(np.zeros(n * k), slack, largest * 0.1 / slack)
    step = _ProgramIterate(np.empty(n * k), np.empty(count), np.empty(count))
    residuals = _Residuals(np.empty(count), np.empty(count))
    matrix = np.empty((n * k, 3 * k))
    for iteration in range(MAX_PROGRAM_ITERATIONS):
        gap, worst = _write_residuals(packed, point, residuals)
        if gap < gap_share * largest and worst < VIOLATION:
            return ProgramSolution(point.x.reshape(n, k), iteration)
        _normal_matrix(packed, point, w, matrix)
        if not _factor(matrix):
            return ProgramSolution(point.x.reshape(n, k), -iteration - 1)
        # Predictor: its target is zero complementarity.
        _write_step(packed, point, residuals, matrix, c, w, step)
        length = _longest_step(point, step)
        # Corrector: its target is a fraction of the average complementarity.
        target = (_gap_after(point, step, length) / gap) ** 3 * gap
        for r in range(count):
            residuals.complement[r] += step.slack[r] * step.dual[r] - target
        _write_step(packed, point, residuals, matrix, c, w, step)
        length = _longest_step(point, step)
        _take_step(point, step, min(1.0, STEP_SHARE * length))
    return ProgramSolution(point.x.reshape(n, k), -MAX_PROGRAM_ITERATIONS)


@compiled(inner=True, allocates=True, fastmath=FUSED)
def _pack(rows: FloatArray, bounds: FloatArray) -> _Rows:
    """Pack the rows that are not zero, without their leading and trailing zeros."""
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
    return _Rows(first[:count], ends[: count + 1], values[: ends[count]], bound[:count])


@compiled(inner=True, fastmath=FUSED, inline="always")
def _row_product(rows: _Rows, x: FloatArray, r: int) -> float:
    """Return the product of row r and the unknowns x."""
    value = 0.0
    shift = rows.first[r] - rows.ends[r]
    for p in range(rows.ends[r], rows.ends[r + 1]):
        value += rows.values[p] * x[shift + p]
    return value


@compiled(inner=True, fastmath=FUSED)
def _write_residuals(rows: _Rows, point: _ProgramIterate, out: _Residuals) -> tuple[float, float]:
    """Write the residuals; return mean complementarity slack * dual and largest row violation."""
    count = len(rows.bound)
    gap = 0.0
    worst = 0.0
    for r in range(count):
        out.primal[r] = _row_product(rows, point.x, r) + point.slack[r] - rows.bound[r]
        out.complement[r] = point.slack[r] * point.dual[r]
        gap += out.complement[r]
        worst = max(worst, abs(out.primal[r]))
    return gap / max(count, 1), worst


@compiled(inner=True, fastmath=FUSED)
def _normal_matrix(
    rows: _Rows, point: _ProgramIterate, weight: FloatArray, matrix: FloatArray
) -> None:
    """Write the normal matrix `weight + rows' (y / s) rows`.

    Entry (a, b) of its lower bands is in `matrix[a, last + b - a]`.
    """
    last = matrix.shape[1] - 1
    matrix[:] = 0.0
    for a in range(len(weight)):
        matrix[a, last] = weight[a]
    for r in range(len(rows.bound)):
        ratio = point.dual[r] / point.slack[r]
        begin = rows.ends[r]
        length = rows.ends[r + 1] - rows.ends[r]
        for a in range(length):
            scaled = ratio * rows.values[begin + a]
            row = matrix[rows.first[r] + a]
            for b in range(a + 1):
                row[last - a + b] += scaled * rows.values[begin + b]


@compiled(inner=True, fastmath=FUSED)
def _write_step(
    rows: _Rows,
    point: _ProgramIterate,
    residuals: _Residuals,
    factor: FloatArray,
    cost: FloatArray,
    weight: FloatArray,
    step: _ProgramIterate,
) -> None:
    """Write Newton's step that removes the residuals, given the factor of the normal matrix."""
    slack = point.slack
    dual = point.dual
    primal = residuals.primal
    complement = residuals.complement
    # Right side of the normal equations
    for a in range(len(cost)):
        step.x[a] = -cost[a] - weight[a] * point.x[a]
    for r in range(len(rows.bound)):
        value = dual[r] + (dual[r] * primal[r] - complement[r]) / slack[r]
        shift = rows.first[r] - rows.ends[r]
        for p in range(rows.ends[r], rows.ends[r + 1]):
            step.x[shift + p] -= rows.values[p] * value
    _solve(factor, step.x)
    # Changes of slacks and multipliers
    for r in range(len(rows.bound)):
        change = -primal[r] - _row_product(rows, step.x, r)
        step.slack[r] = change
        step.dual[r] = -(complement[r] + dual[r] * change) / slack[r]


@compiled(inner=True, fastmath=FUSED)
def _gap_after(point: _ProgramIterate, step: _ProgramIterate, length: float) -> float:
    """Return the average product s y after a step of a given length."""
    count = len(point.slack)
    after = 0.0
    for r in range(count):
        slack = point.slack[r] + length * step.slack[r]
        after += slack * (point.dual[r] + length * step.dual[r])
    return after / max(count, 1)


@compiled(inner=True, fastmath=FUSED)
def _take_step(point: _ProgramIterate, step: _ProgramIterate, length: float) -> None:
    """Move an iterate in place by a step of a length."""
    for a in range(len(point.x)):
        point.x[a] += length * step.x[a]
    for r in range(len(point.slack)):
        point.slack[r] += length * step.slack[r]
        point.dual[r] += length * step.dual[r]


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
def _longest_step(point: _ProgramIterate, step: _ProgramIterate) -> float:
    """Return the longest step, at most 1, that keeps slacks and multipliers nonnegative."""
    length = 1.0
    for r in range(len(point.slack)):
        if step.slack[r] < 0.0:
            length = min(length, -point.slack[r] / step.slack[r])
        if step.dual[r] < 0.0:
            length = min(length, -point.dual[r] / step.dual[r])
    return length
