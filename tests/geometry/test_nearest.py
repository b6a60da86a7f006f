"""Nearest points: hand-made cases. The exhaustive comparison is in tests/oracle."""

from __future__ import annotations

import numpy as np
import pytest

import armcontour as ac


def circle(radius=2.0, angle=2 * np.pi, center=(1.0, 1.0)):
    start = (center[0] + radius, center[1])
    return ac.Path.from_segments([ac.Arc(start=start, center=center, angle=angle)])


def test_by_hand_on_a_line():
    path = ac.Path.polyline([(0, 0), (4, 0)])
    found = path.project([(1, 2), (-3, 4), (7, -4), (2, 0)])
    np.testing.assert_allclose(found.distance, [2, 5, 5, 0])
    np.testing.assert_allclose(found.s, [1, 0, 4, 2])


def test_by_hand_on_an_arc():
    path = circle(angle=np.pi)  # the upper half
    found = path.project([(1, 4), (1, 2), (3.5, 1), (-2, 1), (1 + np.sqrt(2), 1 + np.sqrt(2))])
    np.testing.assert_allclose(found.distance, [1, 1, 0.5, 1, 0], atol=1e-15)
    np.testing.assert_allclose(found.s, np.pi * np.array([1, 1, 0, 2, 0.5]), atol=1e-12)


def test_behind_an_arc_the_nearer_end_is_found():
    path = circle(angle=np.pi)
    found = path.project([(2.9, 0.0), (-0.9, 0.0)])
    np.testing.assert_allclose(found.distance, np.hypot(0.1, 1.0))
    np.testing.assert_allclose(found.s, [0, 2 * np.pi], atol=1e-12)


@pytest.mark.parametrize("angle", [1.0, np.pi, 2 * np.pi, -2 * np.pi])
def test_from_the_centre_every_place_is_the_radius_away(angle):
    found = circle(angle=angle).project([(1.0, 1.0)])
    assert found.distance[0] == pytest.approx(2.0, rel=1e-14)


def test_full_circle_has_no_blind_spot():
    phase = np.linspace(-np.pi, np.pi, 721)
    unit = np.stack([np.cos(phase), np.sin(phase)], axis=1)
    for radius in (0.5, 3.5):
        found = circle().project(1.0 + radius * unit)
        np.testing.assert_allclose(found.distance, abs(radius - 2.0), rtol=1e-13)
        around = np.mod(found.s / 2.0 - phase + np.pi, 2 * np.pi) - np.pi
        np.testing.assert_allclose(around, 0, atol=1e-12)


def test_a_line_in_space():
    path = ac.Path.polyline([(0, 0, 0), (0, 0, 2)])
    found = path.project([(3, 4, 1), (0, 1, 3)])
    np.testing.assert_allclose(found.distance, [5, np.sqrt(2)])
    np.testing.assert_allclose(found.s, [1, 2])


def test_off_the_plane_of_an_arc():
    path = ac.Path.from_segments(
        [ac.Arc(start=(1, 0, 0), center=(0, 0, 0), angle=np.pi, normal=(0, 0, 1))]
    )
    found = path.project([(0, 2, 1), (0, 0, 3)])
    np.testing.assert_allclose(found.distance, [np.sqrt(2), np.sqrt(10)])
    assert found.s[0] == pytest.approx(np.pi / 2)


def test_the_order_of_queries_is_kept():
    path = ac.Path.polyline(np.random.default_rng(3).random((200, 2)))
    queries = np.random.default_rng(4).random((500, 2))
    together = path.project(queries)
    alone = np.array([path.project(queries[i : i + 1]).distance[0] for i in range(0, 500, 25)])
    np.testing.assert_allclose(together.distance[::25], alone, rtol=1e-12)


@pytest.mark.parametrize(
    ("points", "words", "data"),
    [
        ([(0, 0, 0)], ("have 3 coordinates", "the path has 2"), {}),
        ([(0, np.nan)], ("points to project", "finite"), {"index": 0}),
        ([0, 1], ("points to project", "(2,)"), {}),
    ],
)
def test_refused_queries(points, words, data, refuses):
    path = ac.Path.polyline([(0, 0), (1, 0)])
    refuses(lambda: path.project(points), ac.InvalidInput, *words, **data)
