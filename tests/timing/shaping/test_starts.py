"""Starts of shaping: within the tube, as large as their zones let them be, and their places."""

from __future__ import annotations

import numpy as np
import pytest

import armcontour as ac
from armcontour.geometry import Tube
from armcontour.timing.shaping.places import match, prove
from armcontour.timing.shaping.starts import ARCS, PARABOLAS, STOPS, make_starts
from armcontour.timing.shaping.wishes import Wishes

LINES = ac.Path.polyline([(0.35, 0.10), (0.41, 0.15), (0.28, 0.30), (0.35, 0.35)])


def tube_of(path: ac.Path, wishes: Wishes) -> Tube:
    return Tube.of(path, wishes.tolerance, line_tolerance=wishes.line_tolerance, zone=wishes.zone)


def test_starts_use_all_of_the_tolerance():
    wishes = Wishes(tolerance=5e-3)
    starts = make_starts(LINES, tube_of(LINES, wishes), wishes)
    assert set(starts) == {STOPS, ARCS, PARABOLAS}
    for name in (ARCS, PARABOLAS):
        path, _ = starts[name]
        off = path.project(LINES.vertices[1:3]).distance
        np.testing.assert_allclose(off, 5e-3, rtol=1e-9)
        np.testing.assert_allclose(path.corners.error, 5e-3, rtol=1e-9)


def test_a_share_of_the_tolerance_is_one_of_each_vertex_own():
    path = ac.Path.polyline(
        [(0, 0), (0.1, 0), (0.1, 0.1), (0.2, 0.1)], demand=ac.Demand(tolerance=1e-3)
    )
    wishes = Wishes(tolerance=5e-3)
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


@pytest.mark.parametrize("turn", [0.3, 1.5, 2.6, 3.0])
def test_the_nearest_point_of_a_corner_passes_it(turn):
    end = np.array([0.1, 0]) + 0.1 * np.array([np.cos(turn), np.sin(turn)])
    path = ac.Path.polyline([(0, 0), (0.1, 0), end])
    wishes = Wishes(tolerance=2e-3)
    tube = tube_of(path, wishes)
    arcs, places = make_starts(path, tube, wishes)[ARCS]
    assert (np.diff(places, axis=0) >= 0).all()
    # By symmetry the middle of the arc passes the corner, and each half belongs to its line.
    middle = (arcs.corners.start[0] + arcs.corners.end[0]) / 2
    before = places[places[:, 1] < middle - 1e-9]
    after = places[places[:, 1] > middle + 1e-9]
    assert (before[:, 0] <= 0.1 + 1e-12).all() and (after[:, 0] >= 0.1 - 1e-12).all()
    off = np.linalg.norm(arcs(before[:, 1]) - path(before[:, 0]), axis=1)
    np.testing.assert_allclose(off, np.abs(arcs(before[:, 1])[:, 1]), atol=1e-9)


def test_a_corner_that_turns_back_is_a_stop():
    path = ac.Path.polyline([(0, 0), (0.1, 0), (0.02, 0), (0.02, 0.1)])
    wishes = Wishes(tolerance=2e-3)
    arcs, _ = make_starts(path, tube_of(path, wishes), wishes)[ARCS]
    assert len(arcs.stops) == 1 and arcs.corners.reason[0] == "turn-back"
