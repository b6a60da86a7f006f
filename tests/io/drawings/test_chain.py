"""Chains of lines and elliptical arcs, by their points."""

from __future__ import annotations

import numpy as np
import pytest

import armcontour as ac
from armcontour.io.drawings.affine import WITHOUT_Z, Affine
from armcontour.io.drawings.chain import Chain, draw_plain
from armcontour.io.drawings.shapes import Outline, paths_of
from armcontour.io.drawings.splines import Spline


def arc(a, b, angle, centre=(0.0, 0.0)):
    cosine, sine = np.array([a, 0.0]), np.array([0.0, b])
    return Chain.arc(np.array(centre), cosine, sine, angle)


@pytest.mark.parametrize("angle", [0.1, 3.0, 5.5, 2 * np.pi])
def test_an_arc_of_a_circle_is_one_arc(angle):
    table = arc(0.02, 0.02, angle).to_segments(1e-5)
    assert len(table) == 1
    np.testing.assert_allclose(table.curvatures * 0.02, 1, rtol=1e-12)
    np.testing.assert_allclose(table.lengths, 0.02 * angle, rtol=1e-12)


@pytest.mark.parametrize("angle", [0.1, 3.0, 4.5])
def test_an_arc_that_is_nearly_round_is_one_arc_through_its_ends(angle):
    chain = arc(0.02, 0.02 + 5e-8, angle)
    table = chain.to_segments(1e-5)
    assert len(table) == 1
    np.testing.assert_allclose(table.ends, chain.ends, atol=1e-14)
    t = np.linspace(0, angle, 101)
    wanted = np.column_stack([0.02 * np.cos(t), (0.02 + 5e-8) * np.sin(t)])
    assert ac.Path(segments=table).project(wanted).distance.max() < 1e-7


@pytest.mark.parametrize(("b", "angle"), [(0.01, 1.0), (0.01, 2 * np.pi), (0.02 + 5e-8, 5.5)])
def test_other_arcs_are_tangent_arcs_within_the_tolerance(b, angle):
    (path,) = paths_of([Outline([arc(0.02, b, angle)])], 1e-5)
    t = np.linspace(0, angle, 2001)
    wanted = np.column_stack([0.02 * np.cos(t), b * np.sin(t)])
    assert path.project(wanted).distance.max() <= 1e-5
    assert len(path) > 2 and path.turns.max() < 1e-9


def test_a_short_arc_of_a_huge_circle_ends_where_it_is_drawn():
    radius, half = 1e9, 0.5
    rise = half**2 / (2 * radius)
    ends = np.array([(-half, 0.0), (half, 0.0)])
    centre = np.array([0.0, -(radius - rise)])
    chain = Chain.arc(
        centre, ends[0] - centre, np.array([radius, half]), 2 * np.arcsin(half / radius), ends
    )
    table = chain.to_segments(1e-5)
    np.testing.assert_allclose(table.ends, ends[1:], atol=1e-12)
    # Not the centre counts for how far it reaches, but the arc.
    assert np.abs(chain.reach).max() < 1


def test_halves_of_a_chain_are_the_chain():
    chain = Chain.join([arc(0.02, 0.01, 4.0), Chain.straight(np.array([(0.0, 0), (1, 2)]))])
    halves = chain.halve()
    assert len(halves.angles) == 4
    np.testing.assert_array_equal(halves.ends[1::2], chain.ends)
    t = 0.75 * 4.0
    expected = (0.02 * np.cos(t), 0.01 * np.sin(t))
    start, cosine, sine = (x[1] for x in (halves.starts, halves.cosines, halves.sines))
    np.testing.assert_allclose(start + (np.cos(1) - 1) * cosine + np.sin(1) * sine, expected)


def test_maps_follow_each_other():
    rng = np.random.default_rng(1)
    first, second = (Affine(rng.normal(size=(3, 3)), rng.normal(size=3)) for _ in range(2))
    points = rng.normal(size=(5, 3))
    np.testing.assert_allclose((second @ first)(points), second(first(points)))
    np.testing.assert_array_equal(WITHOUT_Z(points), points[:, :2])


def test_beziers_in_a_row_are_one_spline():
    points = np.array([(0, 0), (1, 2), (2, 2), (3, 0), (4, -2), (5, 1), (6, 0)]) * 1e-2
    (path,) = paths_of([Outline([Spline(points=points)])], 1e-6)
    t = np.linspace(0, 1, 500)[:, None]
    for a, b, c, d in (points[:4], points[3:]):
        wanted = (1 - t) ** 3 * a + 3 * (1 - t) ** 2 * t * b + 3 * (1 - t) * t**2 * c + t**3 * d
        assert path.project(wanted).distance.max() <= 1e-6
    np.testing.assert_allclose(path.vertices[[0, -1]], points[[0, -1]], atol=1e-15)


def test_a_shape_of_no_length_is_no_path():
    point = np.zeros((2, 2))
    assert paths_of([Outline([Chain.straight(point), arc(1e-12, 1e-12, 3.0)])], 1e-5) == [None]


def test_chains_that_are_drawn_together_are_the_same_segments():
    points = np.array([[0.0, 0.0], [0.01, 0.0], [0.01, 0.02], [0.0, 0.0]])
    straight, circle = Chain.straight(points), arc(0.02, 0.02, 2 * np.pi, (0.1, 0.0))
    beside = Chain.straight(points[:2] + 0.5)
    slot = Chain.join([Chain.straight(points[:2]), arc(0.01, 0.01, 1.0)])
    repeated = Chain.straight(points[[0, 0, 1]])
    chains = [straight, circle, arc(0.02, 0.01, 1.0), beside, repeated, slot, arc(1e-12, 1e-12, 3)]
    drawn = draw_plain([*chains, Chain.straight(points[:1])], 1e-5)
    assert [x is None for x in drawn] == [False, False, True, False, True, False, True, True]
    for chain, found in zip(chains, drawn, strict=False):
        if found is not None:
            wanted = chain.to_segments(1e-5)
            for name in ("starts", "tangents", "normals", "curvatures", "lengths"):
                assert np.array_equal(getattr(found, name), getattr(wanted, name)), name
    assert draw_plain([], 1e-5) == []
