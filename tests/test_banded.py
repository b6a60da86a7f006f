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
