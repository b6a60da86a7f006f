"""The quadratic program of the shaping, against SciPy's linear programs and Clarabel."""

import itertools

import numpy as np
import pytest
from scipy import sparse
from scipy.optimize import linprog

from armcontour.planning.shaping.quadratic_program import solve_program

# Accuracy of the solutions, relative to the largest cost.
GAP = 1e-8


def test_quadratic_programs_with_tiny_quadratic_terms_are_solved():
    """Rows with and without zeros at their ends, between the first node and the last."""
    for n, k in itertools.product((1, 2, 7), (1, 2, 3)):
        rng = np.random.default_rng(10 * n + k)
        cost = rng.normal(size=(n, k))
        rows = rng.normal(size=(n, 6, 3 * k))
        # Some rows touch few unknowns, one is empty, and the last ones keep the solution finite.
        rows[:, 0, :k] = rows[:, 1, 2 * k :] = rows[:, 2] = 0.0
        rows = np.concatenate([rows, np.tile(box(k), (n, 1, 1))], axis=1)
        bounds = [rng.uniform(0.1, 1.0, (n, 6)), np.full((n, 2 * k), 0.7)]
        bounds = np.concatenate(bounds, axis=1)
        bounds[:, 2] = -1.0  # left out, as its row is empty
        x, iterations = solve_program(cost, rows, bounds, np.full((n, k), 1e-9), GAP)
        matrix = dense(np.delete(rows, 2, axis=1))
        upper = np.delete(bounds, 2, axis=1).ravel()
        exact = linprog(cost.ravel(), matrix, upper, bounds=(None, None))
        assert iterations > 0, (n, k)
        assert float((matrix @ x.ravel() - upper).max()) < 1e-7, (n, k)
        assert float(cost.ravel() @ x.ravel()) == pytest.approx(exact.fun, abs=1e-6), (n, k)
    # An unknown that would be at most -1 and at least 1.
    rows = np.array([[[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]]])
    bounds = np.array([[-1.0, -1.0]])
    _, iterations = solve_program(np.ones((1, 1)), rows, bounds, np.full((1, 1), 1e-6), GAP)
    assert iterations < 0


def box(k):
    """Rows that bound k unknowns on both sides."""
    rows = np.zeros((2 * k, 3 * k))
    for j in range(k):
        rows[2 * j, k + j] = 1.0
        rows[2 * j + 1, k + j] = -1.0
    return rows


def dense(rows):
    """The rows of all nodes as one matrix of the unknowns."""
    n, m, width = rows.shape
    k = width // 3
    matrix = np.zeros((n, m, (n + 2) * k))
    for i in range(n):
        matrix[i, :, i * k : (i + 3) * k] = rows[i]
    return matrix.reshape(-1, (n + 2) * k)[:, k:-k]


def random_program(seed, n, k, m):
    """A program that has a solution, and whose unknowns rows bound on both sides."""
    random = np.random.default_rng(seed)
    rows = random.normal(size=(n, m + 2 * k, 3 * k))
    rows[random.random(rows.shape) < 0.3] = 0.0
    # Rows of zeros are left out, whatever their bound.
    rows[:, 0] = 0.0
    rows[:, m:] = box(k)
    bounds = random.uniform(0.0, 1.0, rows.shape[:2])
    bounds[:, 0] = -1.0
    cost = random.normal(size=(n, k))
    # The first node has none before it, the last one none after it.
    rows[0, :, :k] = 0.0
    rows[-1, :, 2 * k :] = 0.0
    return cost, rows, bounds, np.full((n, k), 1e-3)


def solve_by_clarabel(cost, rows, bounds, weight):
    clarabel = pytest.importorskip("clarabel")
    n, k = cost.shape
    used = rows.any(axis=2)
    matrix = sparse.csc_matrix(dense(rows)[used.ravel()])
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-11
    square = sparse.csc_matrix(sparse.diags(weight.ravel()))
    cones = [clarabel.NonnegativeConeT(matrix.shape[0])]
    solver = clarabel.DefaultSolver(square, cost.ravel(), matrix, bounds[used], cones, settings)
    return np.array(solver.solve().x).reshape(n, k)


@pytest.mark.parametrize("n", [1, 2, 30])
def test_the_solution_equals_that_of_another_solver(n):
    for k, m, seed in itertools.product((2, 3), (4, 10), range(2)):
        cost, rows, bounds, weight = random_program(seed, n, k, m)
        solution, iterations = solve_program(cost, rows, bounds, weight, GAP)
        assert 0 < iterations < 40
        expected = solve_by_clarabel(cost, rows, bounds, weight)

        values = [np.sum(cost * x) + np.sum(weight * x**2) / 2 for x in (solution, expected)]
        assert values[0] == pytest.approx(values[1], rel=1e-6, abs=1e-6), (k, m, seed)
        np.testing.assert_allclose(solution, expected, atol=1e-4)
