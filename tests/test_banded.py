"""Banded equations against SciPy's."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import solveh_banded

from armcontour._banded import solve_banded


@given(st.integers(0, 30), st.integers(1, 4), st.integers(1, 3), st.integers(0, 10**6))
def test_solutions_are_those_of_scipy(m, width, sides, seed):
    drawn = np.random.default_rng(seed)
    bands = drawn.uniform(-1.0, 1.0, (m, width))
    # Diagonally dominant, with either sign of the neighbours.
    bands[:, 0] = 2.0 * width + drawn.uniform(0.0, 1.0, m)
    right = drawn.normal(size=(m, sides))
    lower = bands.T.copy()
    found = right.copy()
    # Entries beyond the last column are never read.
    for i in range(m):
        bands[i, m - i :] = np.nan
    solve_banded(bands, found)
    if m:
        np.testing.assert_allclose(found, solveh_banded(lower, right, lower=True), atol=1e-13)


def test_a_column_is_one_right_side_and_a_band_may_be_wider_than_the_matrix():
    right = np.array([[2.0], [3.0]])
    solve_banded(np.array([[2.0], [3.0]]), right)
    assert right.tolist() == [[1.0], [1.0]]
    for m in (1, 2):
        right = np.ones((m, 2))
        solve_banded(np.full((m, 5), [4.0, 1.0, 1.0, 1.0, 1.0]), right)
        np.testing.assert_allclose(right, 1 / (3 + m))
