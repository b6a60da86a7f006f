"""The quadratic program of the shaping, against SciPy's linear programs and Clarabel."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import sparse
from scipy.optimize import linprog

from armcontour.timing.shaping._quadratic import solve_program


@pytest.mark.parametrize("k", [1, 2, 3])
@pytest.mark.parametrize("n", [1, 2, 7])
def test_nearly_linear_programs(n: int, k: int) -> None:
    """Rows with and without zeros at their ends, between the first node and the last."""
    rng = np.random.default_rng(10 * n + k)
    cost = rng.normal(size=(n, k))
    rows = rng.normal(size=(n, 6, 3 * k))
    # Some rows touch few unknowns, one is empty, and the last ones keep the solution finite.
    rows[:, 0, :k] = rows[:, 1, 2 * k :] = rows[:, 2] = 0.0
    box = np.zeros((n, 2 * k, 3 * k))
    for j in range(k):
        box[:, 2 * j, k + j], box[:, 2 * j + 1, k + j] = 1.0, -1.0
    rows = np.concatenate([rows, box], axis=1)
    bounds = np.concatenate([rng.uniform(0.1, 1.0, (n, 6)), np.full((n, 2 * k), 0.7)], axis=1)
    bounds[:, 2] = -1.0  # left out, as its row is empty
    x, iterations = solve_program(cost, rows, bounds, np.full((n, k), 1e-9))
    dense = np.zeros((n, rows.shape[1], (n + 2) * k))
    for i in range(n):
        dense[i, :, i * k : (i + 3) * k] = rows[i]
    matrix = np.delete(dense, 2, axis=1).reshape(-1, (n + 2) * k)[:, k:-k]
    exact = linprog(cost.ravel(), matrix, np.delete(bounds, 2, axis=1).ravel(), bounds=(None, None))
    assert iterations > 0
    assert float((matrix @ x.ravel() - np.delete(bounds, 2, axis=1).ravel()).max()) < 1e-7
    assert float(cost.ravel() @ x.ravel()) == pytest.approx(exact.fun, abs=1e-6)


def test_no_solution_is_told() -> None:
    """An unknown would be at most -1 and at least 1."""
    rows = np.array([[[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]]])
    _, iterations = solve_program(
        np.ones((1, 1)), rows, np.array([[-1.0, -1.0]]), np.full((1, 1), 1e-6)
    )
    assert iterations < 0


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
    clarabel = pytest.importorskip("clarabel")
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
