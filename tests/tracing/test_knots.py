"""First knots: compiled, they are where the formulas put them."""

import numpy as np

import armcontour as ac
from armcontour.tracing._knots import cut_cells
from armcontour.tracing.knots import first_knots


def test_cells_are_cut_into_equal_intervals():
    for seed in range(20):
        rng = np.random.default_rng(seed)
        u0 = rng.choice([0.0, 0.3], 6)
        # Widths that are whole multiples of the step, too, so that rounding decides.
        u1 = u0 + rng.choice([rng.uniform(1e-3, 2), 0.25, 1.0], 6)
        width, turning = u1 - u0, rng.choice([0.0, 2.0, 40.0], 6)
        s0, finer, step, turn = np.cumsum(width) - width, int(rng.integers(1, 4)), 1 / 16, 0.5
        parts = np.ceil(finer * width / step), np.ceil(finer * width * turning / turn)
        count = np.maximum(1, np.maximum(*parts)).astype(int)
        cell, (begin, end, s) = cut_cells(u0, u1, s0, turning, finer, step, turn)
        assert np.array_equal(cell, np.repeat(np.arange(6), count)), seed
        for k in range(6):
            own, edges = cell == k, u0[k] + width[k] / count[k] * np.arange(count[k] + 1)
            edges[-1] = u1[k]
            assert np.array_equal(begin[own], edges[:-1]) and np.array_equal(end[own], edges[1:])
            np.testing.assert_allclose(s[own], s0[k] + edges[:-1] - u0[k], atol=1e-15, rtol=0)


def circle(radius):
    """A circle in front of an arm, along which the tool points down and may turn."""
    arc = ac.Arc.circle([0.4 + radius, 0.1, 0.1], [0.4, 0.1, 0.1], normal=[0, 0, 1])
    return ac.Path.from_segments([arc]).pointing([0, 0, -1])


def test_a_small_path_has_no_more_knots_than_its_turns_ask_for():
    arm = ac.load_arm("ur5e")
    small, large = circle(2e-3), circle(0.1)
    # 0.5 rad apart at most; the plain step would be a sixteenth of the diameter, 51 knots.
    assert len(first_knots(small, arm.span)) == 13
    assert len(first_knots(small, 0.0)) == 51
    assert len(first_knots(large, arm.span)) == len(first_knots(large, 0.0)) == 51
    traced = ac.trace(small, arm)
    s = np.linspace(0.0, small.length, 2000)
    assert np.abs(arm.forward(traced(s)) - small(s)).max() < 1e-10
