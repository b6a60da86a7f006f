"""Arcs through three points and full circles."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import armcontour as ac
from armcontour.frames import exp


def circle_of(points):
    """Centre and radius of the circle through three points of space, by linear equations."""
    a, b, c = points
    normal = np.cross(b - a, c - a)
    rows = np.array([b - a, c - a, normal])
    right = [(b @ b - a @ a) / 2, (c @ c - a @ a) / 2, normal @ a]
    center = np.linalg.solve(rows, right)
    return center, np.linalg.norm(a - center)


@given(
    seed=st.integers(0, 2**32 - 1),
    dimension=st.sampled_from([2, 3]),
    first=st.floats(0.05, 6.2),
    share=st.floats(0.05, 0.95),
)
def test_an_arc_through_three_points(seed, dimension, first, share):
    rng = np.random.default_rng(seed)
    radius, side = 10.0 ** rng.uniform(-2, 1), rng.choice([-1.0, 1.0])
    phases = rng.uniform(0, 2 * np.pi) + side * np.array([0.0, share * first, first])
    points = np.zeros((3, 3))
    points[:, :2] = radius * np.column_stack([np.cos(phases), np.sin(phases)])
    if dimension == 3:
        points = points @ exp(rng.normal(size=3)).T
    points = points[:, :dimension] + rng.normal(size=dimension)
    path = ac.Path.from_segments([ac.Arc.through(*points)])
    assert path.length == pytest.approx(radius * first, rel=1e-9)
    assert path.curvatures[0] == pytest.approx(1 / radius, rel=1e-9)
    scale = 1e-9 * (1 + radius)
    np.testing.assert_allclose(path(0.0), points[0], atol=scale)
    np.testing.assert_allclose(path(path.length), points[2], atol=scale)
    np.testing.assert_allclose(path(share * path.length), points[1], atol=scale)


def test_the_circle_is_the_one_through_the_points():
    points = np.array([(0.1, 0.2, 0.3), (0.4, 0.1, 0.5), (0.2, 0.6, 0.4)])
    center, radius = circle_of(points)
    arc = ac.Arc.through(*points)
    np.testing.assert_allclose(arc.center, center, atol=1e-12)
    path = ac.Path.from_segments([arc])
    off = np.linalg.norm(path(np.linspace(0, path.length, 100)) - center, axis=1)
    np.testing.assert_allclose(off, radius, rtol=1e-12)


def test_a_flat_arc_keeps_its_end_points():
    # A sagitta of a micrometre on a metre.
    path = ac.Path.from_segments([ac.Arc.through((0, 0), (0.5, 1e-6), (1, 0))])
    np.testing.assert_allclose(path(path.length), (1, 0), atol=1e-9)
    assert path.curvatures[0] == pytest.approx(8e-6, rel=1e-5)


@pytest.mark.parametrize(
    "points",
    [
        [(0, 0), (1, 0), (2, 0)],
        [(0, 0, 0), (1, 1, 1), (2, 2, 2)],
        [(0, 0), (2, 0), (1, 0)],
        [(0, 0), (0, 0), (1, 1)],
        [(0, 0), (1, 1), (1, 1)],
        [(0, 0), (0, 0), (0, 0)],
        [(0, 0), (0.5, 1e-14), (1, 0)],
        [(0, 0, 0), (1, 0, 0), (0, 0, 0)],
    ],
)
def test_three_points_on_a_line_make_no_arc(points, refuses):
    refuses(lambda: ac.Arc.through(*points), ac.InvalidInput, "lie on one line")


def test_points_of_other_kinds_are_refused(refuses):
    words = ("all have 2 or all have 3",)
    refuses(lambda: ac.Arc.through((0, 0), (1, 0, 0), (1, 1)), ac.InvalidInput, *words)
    refuses(lambda: ac.Arc.through((0,), (1,), (2,)), ac.InvalidInput, *words)
    refuses(
        lambda: ac.Arc.through((0, 0), (np.nan, 0), (1, 1)), ac.InvalidInput, "via point", "finite"
    )


def test_a_full_circle_through_two_points_of_the_plane():
    path = ac.Path.from_segments([ac.Arc.through((0, 0), (2, 0), (0, 0))])
    assert path.length == pytest.approx(2 * np.pi)
    np.testing.assert_allclose(path(np.pi), (2, 0), atol=1e-12)
    np.testing.assert_allclose(path(path.length), (0, 0), atol=1e-12)


def test_full_circles():
    flat = ac.Path.from_segments([ac.Arc.circle((1, 0), (0, 0))])
    np.testing.assert_allclose(flat(np.pi / 2), (0, 1), atol=1e-12)
    assert flat.length == pytest.approx(2 * np.pi)
    upright = ac.Path.from_segments([ac.Arc.circle((1, 0, 5), (0, 0, 5), normal=(0, -2, 0))])
    np.testing.assert_allclose(upright(np.pi / 2), (0, 0, 6), atol=1e-12)
    np.testing.assert_allclose(upright(upright.length), (1, 0, 5), atol=1e-12)


def test_a_circle_in_space_needs_a_normal_across_its_radius(refuses):
    for normal, words in ((None, "needs its normal"), ((1, 0, 0), "right angles to its radius")):
        arc = ac.Arc.circle((1, 0, 0), (0, 0, 0), normal=normal)
        refuses(lambda a=arc: ac.Path.from_segments([a]), ac.InvalidInput, words)
