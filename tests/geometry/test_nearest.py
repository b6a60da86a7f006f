"""Nearest points: hand-made cases. The exhaustive comparison is in tests/oracle."""

import numpy as np
import pytest
from tests.geometry.tables import arc, each, path_of, refused

import armcontour as ac


def circle(angle=2 * np.pi):
    return path_of(arc((3.0, 1.0), (1.0, 1.0), angle))


ROOT = np.sqrt(2)
BEHIND = np.hypot(0.1, 1)
FLAT = ac.Path.polyline([(0, 0), (4, 0)])
RISING = ac.Path.polyline([(0, 0, 0), (0, 0, 2)])
HALF = path_of(arc((1, 0, 0), (0, 0, 0), np.pi, normal=(0, 0, 1)))
UPPER = [(1, 4), (1, 2), (3.5, 1), (-2, 1), (1 + ROOT, 1 + ROOT), (2.9, 0), (-0.9, 0)]
SHARES = np.array([1, 1, 0, 2, 0.5, 0, 2])
BY_HAND = (  # path, points, distances, arc lengths
    (FLAT, [(1, 2), (-3, 4), (7, -4), (2, 0)], [2, 5, 5, 0], [1, 0, 4, 2]),
    (RISING, [(3, 4, 1), (0, 1, 3)], [5, ROOT], [1, 2]),
    # The last two points are behind the half circle, nearer to one of its ends.
    (circle(np.pi), UPPER, [1, 1, 0.5, 1, 0, BEHIND, BEHIND], np.pi * SHARES),
    (HALF, [(0, 2, 1)], [ROOT], [np.pi / 2]),  # off the plane of the arc
)


@each("path, points, distance, s", BY_HAND)
def test_by_hand(path, points, distance, s):
    found = path.project(points)
    np.testing.assert_allclose(found.distance, distance, atol=1e-15)
    np.testing.assert_allclose(found.s, s, atol=1e-12)


def test_circles_have_no_blind_spot_and_one_distance_from_their_centre():
    for angle in (1.0, np.pi, 2 * np.pi, -2 * np.pi):
        found = circle(angle).project([(1.0, 1.0)])
        assert found.distance[0] == pytest.approx(2.0, rel=1e-14)
    assert HALF.project([(0, 0, 3)]).distance[0] == pytest.approx(np.sqrt(10))
    phase = np.linspace(-np.pi, np.pi, 721)
    unit = np.stack([np.cos(phase), np.sin(phase)], axis=1)
    for radius in (0.5, 3.5):
        found = circle().project(1.0 + radius * unit)
        np.testing.assert_allclose(found.distance, abs(radius - 2.0), rtol=1e-13)
        around = np.mod(found.s / 2.0 - phase + np.pi, 2 * np.pi) - np.pi
        np.testing.assert_allclose(around, 0, atol=1e-12)


def test_refused_queries():
    path = ac.Path.polyline([(0, 0), (1, 0)])
    refused(
        (lambda: path.project([(0, 0, 0)]), "have 3 coordinates", "the path has 2"),
        (lambda: path.project([(0, np.nan)]), "points to project", "finite", {"index": 0}),
        (lambda: path.project([0, 1]), "points to project", "(2,)"),
    )
