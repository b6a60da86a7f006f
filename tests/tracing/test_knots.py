"""First knots: compiled, they are where the formulas put them."""

from __future__ import annotations

import numpy as np
import pytest

import armcontour as ac
from armcontour.tracing._knots import cut_cells, find_ends
from armcontour.tracing.knots import first_knots


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


def circle(radius: float) -> ac.Path:
    """A circle in front of an arm, along which the tool points down and may turn."""
    arc = ac.Arc.circle([0.4 + radius, 0.1, 0.1], [0.4, 0.1, 0.1], normal=[0, 0, 1])
    return ac.Path.from_segments([arc]).pointing([0, 0, -1])


def test_a_small_path_has_no_more_knots_than_its_turns_ask_for() -> None:
    arm = ac.load_arm("ur5e")
    small, large = circle(2e-3), circle(0.1)
    # 0.5 rad apart at most; the plain step would be a sixteenth of the diameter, 51 knots.
    assert len(first_knots(small, arm.span)) == 13
    assert len(first_knots(small, 0.0)) == 51
    assert len(first_knots(large, arm.span)) == len(first_knots(large, 0.0)) == 51
    traced = ac.trace(small, arm)
    s = np.linspace(0.0, small.length, 2000)
    assert np.abs(arm.forward(traced(s)) - small(s)).max() < 1e-10


def test_places_are_starts_and_those_ends_that_are_no_starts() -> None:
    segment, piece = np.array([0, 0, 0, 1, 1]), np.array([0, 0, 1, 1, 1])
    u0, u1 = np.array([0.0, 0.1, 0.2, 0.0, 0.3]), np.array([0.1, 0.2, 0.3, 0.25, 0.5])
    row, u, ends = find_ends(segment, piece, u0, u1)
    assert row.tolist() == [0, 1, 2, 3, 4, 1, 2, 3, 4]
    assert u.tolist() == [0.0, 0.1, 0.2, 0.0, 0.3, 0.2, 0.3, 0.25, 0.5]
    assert ends.tolist() == [1, 5, 6, 7, 8]
    assert np.array_equal(u[ends], u1)
