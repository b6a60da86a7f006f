"""Starts of the search, and its iterations: within the tube, each no slower than the last."""

import numpy as np
import pytest

import armcontour as ac
from armcontour.geometry import Tube
from armcontour.timing.shaping.places import match, prove
from armcontour.timing.shaping.search import make_searches, why_not
from armcontour.timing.shaping.starts import ARCS, PARABOLAS, STOPS, Timer, make_starts
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


def test_what_is_not_shaped(arm, limits):
    path = ac.shape(LINES, arm, limits, tolerance=1e-3, line_tolerance=0.0, zone=0.01)
    assert "lines without a tolerance" in path.outcome.note
    assert path.outcome.durations["shaped"] == min(path.outcome.durations.values())
    assert why_not(LINES, Tube.of(LINES, 1e-3)) is None
    # A tolerance of zero stops at every vertex.
    plan = ac.plan(LINES, arm, limits, method="shaped", tolerance=0.0)
    np.testing.assert_allclose(plan.path.stops, LINES.breaks[1:-1])
    assert plan.duration == ac.plan(LINES, arm, limits).duration
    assert plan.method == "shaped" and plan.path.outcome.start == "stops"


def tube_of(path, wishes):
    return Tube.of(path, wishes.tolerance, line_tolerance=wishes.line_tolerance, zone=wishes.zone)


def test_starts_use_all_of_the_tolerance():
    wishes = Wishes(tolerance=5e-3)
    starts = make_starts(LINES, tube_of(LINES, wishes), wishes)
    assert set(starts) == {STOPS, ARCS, PARABOLAS}
    for name in (ARCS, PARABOLAS):
        path, _ = starts[name]
        for off in (path.project(LINES.vertices[1:3]).distance, path.corners.error):
            np.testing.assert_allclose(off, 5e-3, rtol=1e-9)
    # A share of the tolerance is one of each vertex' own.
    points, own = [(0, 0), (0.1, 0), (0.1, 0.1), (0.2, 0.1)], ac.Demand(tolerance=1e-3)
    path = ac.Path.polyline(points, demand=own)
    found, _ = make_starts(path, tube_of(path, wishes), wishes, 0.7)[ARCS]
    np.testing.assert_allclose(found.corners.error, 0.7e-3, rtol=1e-9)


def test_corners_are_as_large_as_their_zones_allow():
    wishes = Wishes(tolerance=5e-3, line_tolerance=1e-4, zone=6e-3)
    tube = tube_of(LINES, wishes)
    free = Wishes(tolerance=5e-3)
    for name in (ARCS, PARABOLAS):
        path, places = make_starts(LINES, tube, wishes)[name]
        assert prove(tube, path, places).ok
        whole, _ = make_starts(LINES, tube_of(LINES, free), free)[name]
        assert (path.corners.error < whole.corners.error).all()
        # A twentieth more would leave the zone.
        round_ = ac.round_corners if name == ARCS else ac.geometry.round_with_parabolas
        larger = round_(LINES, tolerance=np.array(path.corners.error) * 1.05)
        s = np.array([0, larger.length])
        wide = match(tube, larger, np.stack([s * LINES.length / larger.length, s], axis=1), 0.03)
        assert not prove(tube, larger, wide).ok


def test_the_nearest_point_of_a_corner_passes_it():
    wishes = Wishes(tolerance=2e-3)
    for turn in (0.3, 1.5, 2.6, 3.0):
        end = np.array([0.1, 0]) + 0.1 * np.array([np.cos(turn), np.sin(turn)])
        path = ac.Path.polyline([(0, 0), (0.1, 0), end])
        arcs, places = make_starts(path, tube_of(path, wishes), wishes)[ARCS]
        assert (np.diff(places, axis=0) >= 0).all(), turn
        # By symmetry the middle of the arc passes the corner; each half belongs to its line.
        middle = (arcs.corners.start[0] + arcs.corners.end[0]) / 2
        before = places[places[:, 1] < middle - 1e-9]
        after = places[places[:, 1] > middle + 1e-9]
        assert (before[:, 0] <= 0.1 + 1e-12).all() and (after[:, 0] >= 0.1 - 1e-12).all(), turn
        off = np.linalg.norm(arcs(before[:, 1]) - path(before[:, 0]), axis=1)
        np.testing.assert_allclose(off, np.abs(arcs(before[:, 1])[:, 1]), atol=1e-9)
    # A corner that turns back is a stop.
    path = ac.Path.polyline([(0, 0), (0.1, 0), (0.02, 0), (0.02, 0.1)])
    arcs, _ = make_starts(path, tube_of(path, wishes), wishes)[ARCS]
    assert len(arcs.stops) == 1 and arcs.corners.reason[0] == "turn-back"
