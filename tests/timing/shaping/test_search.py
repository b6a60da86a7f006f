"""The search: what it gains on the paper's job, monotone, from each start within the tube."""

from __future__ import annotations

import numpy as np
import pytest

import armcontour as ac
from armcontour.geometry import Tube
from armcontour.timing.shaping.places import prove
from armcontour.timing.shaping.search import make_searches, why_not
from armcontour.timing.shaping.starts import Timer
from armcontour.timing.shaping.wishes import Wishes

LINES = ac.Path.polyline([(0.35, 0.10), (0.41, 0.15), (0.28, 0.30), (0.35, 0.35)])


@pytest.mark.parametrize("centripetal", [0.09, None])
def test_every_iteration_is_within_the_tube_and_no_slower(arm, centripetal):
    limits = ac.Limits(
        speed=0.15, joint_acceleration=0.72, centripetal_acceleration=centripetal
    ).for_joints(2)
    tube, wishes = Tube.of(LINES, 1e-3), Wishes(tolerance=1e-3)
    timer = Timer(arm, limits, None, None, 800)
    search = next(make_searches(LINES, tube, timer, wishes))
    durations = []
    for _, found in zip(range(8), search.run(), strict=False):
        durations.append(found.duration)
        proof = prove(tube, found.path, found.places)
        spreads = found.path.curve.spreads
        assert (proof.segments + np.repeat(spreads, 2) <= proof.slack).all()
        assert (proof.vertices + spreads.max() <= proof.slack).all()
        # What the tool draws is the spline of the best state.
        assert len(search.state.h) == len(search.nodes)
        np.testing.assert_allclose(search.state.h.sum(), found.duration, rtol=1e-9)
    # The first spline may be slower than the start that it is drawn from.
    assert all(b <= a for a, b in zip(durations[:-1], durations[1:], strict=True))
    assert durations[-1] < 0.97 * search.start.duration


def test_lines_without_a_tolerance_are_not_shaped(arm, limits):
    path = ac.shape(LINES, arm, limits, tolerance=1e-3, line_tolerance=0.0, zone=0.01)
    assert "lines without a tolerance" in path.outcome.note
    assert path.outcome.durations["shaped"] == min(path.outcome.durations.values())
    assert why_not(LINES, Tube.of(LINES, 1e-3)) is None


def test_a_tolerance_of_zero_stops_at_every_vertex(arm, limits):
    plan = ac.plan(LINES, arm, limits, method="shaped", tolerance=0.0)
    np.testing.assert_allclose(plan.path.stops, LINES.breaks[1:-1])
    assert plan.duration == ac.plan(LINES, arm, limits).duration
    assert plan.method == "shaped" and plan.path.outcome.start == "stops"
