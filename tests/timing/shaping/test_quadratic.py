"""The quadratic program of the shaping, against SciPy's linear programs."""

from __future__ import annotations

import numpy as np
import pytest
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
