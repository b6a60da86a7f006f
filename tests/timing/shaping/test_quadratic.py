"""The compiled solver of shaping's quadratic programs against Clarabel."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import sparse

from armcontour.timing.shaping._quadratic import solve_program

clarabel = pytest.importorskip("clarabel")


def random_program(seed, n, k, m):
    """A program that has a solution, and whose unknowns rows bound on both sides."""
    random = np.random.default_rng(seed)
    rows = random.normal(size=(n, m + 2 * k, 3 * k))
    rows[random.random(rows.shape) < 0.3] = 0.0
    # Rows of zeros are left out, whatever their bound.
    rows[:, 0] = 0.0
    rows[:, m:] = 0.0
    for j in range(k):
        rows[:, m + 2 * j, k + j], rows[:, m + 2 * j + 1, k + j] = 1.0, -1.0
    bounds = random.uniform(0.0, 1.0, rows.shape[:2])
    bounds[:, 0] = -1.0
    cost = random.normal(size=(n, k))
    # The first node has none before it, the last one none after it.
    rows[0, :, :k], rows[-1, :, 2 * k :] = 0.0, 0.0
    return cost, rows, bounds, np.full((n, k), 1e-3)


def solve_by_clarabel(cost, rows, bounds, weight):
    n, k = cost.shape
    used = rows.any(axis=2)
    matrix = np.zeros((n, rows.shape[1], n + 2, k))
    for i in range(n):
        matrix[i, :, i : i + 3] = rows[i].reshape(-1, 3, k)
    matrix = sparse.csc_matrix(matrix[:, :, 1:-1][used].reshape(int(used.sum()), n * k))
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-11
    square = sparse.csc_matrix(sparse.diags(weight.ravel()))
    cones = [clarabel.NonnegativeConeT(matrix.shape[0])]
    solver = clarabel.DefaultSolver(square, cost.ravel(), matrix, bounds[used], cones, settings)
    return np.array(solver.solve().x).reshape(n, k)


@pytest.mark.parametrize("n", [1, 2, 30])
@pytest.mark.parametrize(("k", "m"), [(2, 4), (3, 10)])
def test_the_solution_is_that_of_another_solver(n, k, m):
    for seed in range(4):
        cost, rows, bounds, weight = random_program(seed, n, k, m)
        found, iterations = solve_program(cost, rows, bounds, weight)
        assert 0 < iterations < 40
        expected = solve_by_clarabel(cost, rows, bounds, weight)

        def value(x, cost=cost, weight=weight):
            return np.sum(cost * x) + np.sum(weight * x**2) / 2

        assert value(found) == pytest.approx(value(expected), rel=1e-6, abs=1e-6)
        np.testing.assert_allclose(found, expected, atol=1e-4)


def test_a_program_without_a_solution_is_told():
    # x <= -1 and -x <= -1.
    rows = np.zeros((1, 2, 3))
    rows[0, :, 1] = 1.0, -1.0
    _, iterations = solve_program(np.ones((1, 1)), rows, -np.ones((1, 2)), np.ones((1, 1)))
    assert iterations < 0
