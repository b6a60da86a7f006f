"""First knots: compiled, they are where the formulas put them."""

from __future__ import annotations

import numpy as np
import pytest

from armcontour.tracing._knots import cut_cells, find_ends


@pytest.mark.parametrize("seed", range(20))
def test_cells_are_cut_into_equal_intervals(seed: int) -> None:
    rng = np.random.default_rng(seed)
    u0 = rng.choice([0.0, 0.3], 6)
    # Widths that are whole multiples of the step, too, so that rounding decides.
    u1 = u0 + rng.choice([rng.uniform(1e-3, 2), 0.25, 1.0], 6)
    s0, turning = np.cumsum(u1 - u0) - (u1 - u0), rng.choice([0.0, 2.0, 40.0], 6)
    finer, step, turn = int(rng.integers(1, 4)), 1 / 16, 0.5
    width = u1 - u0
    count = np.maximum(
        1, np.maximum(np.ceil(finer * width / step), np.ceil(finer * width * turning / turn))
    ).astype(int)
    cell, (begin, end, s) = cut_cells(u0, u1, s0, turning, finer, step, turn)
    assert np.array_equal(cell, np.repeat(np.arange(6), count))
    for k in range(6):
        own = cell == k
        edges = u0[k] + width[k] / count[k] * np.arange(count[k] + 1)
        edges[-1] = u1[k]
        assert np.array_equal(begin[own], edges[:-1]) and np.array_equal(end[own], edges[1:])
        assert s[own] == pytest.approx(s0[k] + edges[:-1] - u0[k], abs=1e-15)


def test_places_are_starts_and_those_ends_that_are_no_starts() -> None:
    segment, piece = np.array([0, 0, 0, 1, 1]), np.array([0, 0, 1, 1, 1])
    u0, u1 = np.array([0.0, 0.1, 0.2, 0.0, 0.3]), np.array([0.1, 0.2, 0.3, 0.25, 0.5])
    row, u, ends = find_ends(segment, piece, u0, u1)
    assert row.tolist() == [0, 1, 2, 3, 4, 1, 2, 3, 4]
    assert u.tolist() == [0.0, 0.1, 0.2, 0.0, 0.3, 0.2, 0.3, 0.25, 0.5]
    assert ends.tolist() == [1, 5, 6, 7, 8]
    assert np.array_equal(u[ends], u1)
