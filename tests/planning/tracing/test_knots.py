"""First knots: compiled, they are where the formulas put them."""

import numpy as np

import armcontour as ac
from armcontour.planning.tracing.knots import first_knots


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
    assert np.abs(arm.tool_position(traced(s)) - small(s)).max() < 1e-10
