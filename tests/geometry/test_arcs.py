"""Arcs through three points and full circles."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.geometry.tables import path_of, refused

import armcontour as ac
from armcontour.frames import exp


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
    path = path_of(ac.Arc.through(*points))
    assert path.length == pytest.approx(radius * first, rel=1e-9)
    assert path.curvatures[0] == pytest.approx(1 / radius, rel=1e-9)
    at = path(np.array([0, share, 1]) * path.length)
    np.testing.assert_allclose(at, points, atol=1e-9 * (1 + radius))


def test_the_circle_is_the_one_through_the_points_and_a_flat_arc_keeps_its_ends():
    a, b, c = points = np.array([(0.1, 0.2, 0.3), (0.4, 0.1, 0.5), (0.2, 0.6, 0.4)])
    # Its centre by linear equations.
    normal = np.cross(b - a, c - a)
    right = [(b @ b - a @ a) / 2, (c @ c - a @ a) / 2, normal @ a]
    center = np.linalg.solve(np.array([b - a, c - a, normal]), right)
    arc = ac.Arc.through(*points)
    np.testing.assert_allclose(arc.center, center, atol=1e-12)
    path = path_of(arc)
    off = np.linalg.norm(path(np.linspace(0, path.length, 100)) - center, axis=1)
    np.testing.assert_allclose(off, np.linalg.norm(a - center), rtol=1e-12)
    # A sagitta of a micrometre on a metre.
    path = path_of(ac.Arc.through((0, 0), (0.5, 1e-6), (1, 0)))
    np.testing.assert_allclose(path(path.length), (1, 0), atol=1e-9)
    assert path.curvatures[0] == pytest.approx(8e-6, rel=1e-5)


def test_three_points_on_a_line_and_circles_without_a_plane_make_no_arc():
    on_a_line = (
        [(0, 0), (1, 0), (2, 0)],
        [(0, 0, 0), (1, 1, 1), (2, 2, 2)],
        [(0, 0), (2, 0), (1, 0)],
        [(0, 0), (0, 0), (1, 1)],
        [(0, 0), (1, 1), (1, 1)],
        [(0, 0), (0, 0), (0, 0)],
        [(0, 0), (0.5, 1e-14), (1, 0)],
        [(0, 0, 0), (1, 0, 0), (0, 0, 0)],
    )
    refused(*((lambda x=x: ac.Arc.through(*x), "lie on one line") for x in on_a_line))

    def circle(normal):
        return lambda: path_of(ac.Arc.circle((1, 0, 0), (0, 0, 0), normal=normal))

    refused(
        (lambda: ac.Arc.through((0, 0), (1, 0, 0), (1, 1)), "all have 2 or all have 3"),
        (lambda: ac.Arc.through((0,), (1,), (2,)), "all have 2 or all have 3"),
        (lambda: ac.Arc.through((0, 0), (np.nan, 0), (1, 1)), "via point", "finite"),
        (circle(None), "needs its normal"),
        (circle((1, 0, 0)), "right angles to its radius"),
    )


def test_full_circles():
    through = path_of(ac.Arc.through((0, 0), (2, 0), (0, 0)))
    flat = path_of(ac.Arc.circle((1, 0), (0, 0)))
    upright = path_of(ac.Arc.circle((1, 0, 5), (0, 0, 5), normal=(0, -2, 0)))
    quarter = (flat, 0.25, (0, 1)), (upright, 0.25, (0, 0, 6))
    for path, share, point in ((through, 0.5, (2, 0)), *quarter):
        assert path.length == pytest.approx(2 * np.pi)
        np.testing.assert_allclose(path(share * path.length), point, atol=1e-12)
        np.testing.assert_allclose(path(path.length), path(0.0), atol=1e-12)
