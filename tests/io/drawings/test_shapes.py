"""Shapes of drawings: chains of lines and elliptical arcs, and splines as Bézier curves."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import BSpline

import armcontour as ac
from armcontour.io.drawings.chain import Chain, draw_plain
from armcontour.io.drawings.shapes import Outline, paths_of
from armcontour.io.drawings.splines import Spline, fit_splines

TOLERANCE = 1e-5


def arc(a, b, angle, centre=(0.0, 0.0)):
    return Chain.arc(np.array(centre), np.array([a, 0.0]), np.array([0.0, b]), angle)


def on_ellipse(a, b, t):
    return np.column_stack([a * np.cos(t), b * np.sin(t)])


def test_arcs_that_are_round_or_nearly_round_are_one_arc_through_their_ends():
    for angle in (0.1, 3.0, 4.5, 5.5, 2 * np.pi):
        table = arc(0.02, 0.02, angle).to_segments(TOLERANCE)
        assert len(table) == 1
        np.testing.assert_allclose(table.curvatures * 0.02, 1, rtol=1e-12)
        np.testing.assert_allclose(table.lengths, 0.02 * angle, rtol=1e-12)
        if angle < 5:
            chain = arc(0.02, 0.02 + 5e-8, angle)
            table = chain.to_segments(TOLERANCE)
            assert len(table) == 1
            np.testing.assert_allclose(table.ends, chain.ends, atol=1e-14)
            wanted = on_ellipse(0.02, 0.02 + 5e-8, np.linspace(0, angle, 101))
            assert ac.Path(segments=table).project(wanted).distance.max() < 1e-7
    # Others are tangent arcs within the tolerance.
    for b, angle in ((0.01, 1.0), (0.01, 2 * np.pi), (0.02 + 5e-8, 5.5)):
        (path,) = paths_of([Outline([arc(0.02, b, angle)])], TOLERANCE)
        wanted = on_ellipse(0.02, b, np.linspace(0, angle, 2001))
        assert path.project(wanted).distance.max() <= TOLERANCE
        assert len(path) > 2 and path.turns.max() < 1e-9
    # A shape of no length is no path.
    point = Chain.straight(np.zeros((2, 2)))
    assert paths_of([Outline([point, arc(1e-12, 1e-12, 3.0)])], TOLERANCE) == [None]


def test_a_short_arc_of_a_huge_circle_ends_where_it_is_drawn():
    radius, half = 1e9, 0.5
    ends = np.array([(-half, 0.0), (half, 0.0)])
    centre = np.array([0.0, half**2 / (2 * radius) - radius])
    sine, angle = np.array([radius, half]), 2 * np.arcsin(half / radius)
    chain = Chain.arc(centre, ends[0] - centre, sine, angle, ends)
    np.testing.assert_allclose(chain.to_segments(TOLERANCE).ends, ends[1:], atol=1e-12)
    # `reach` is the extent of the arc, not of the circle.
    assert np.abs(chain.reach).max() < 1


def test_chains_that_are_drawn_together_are_the_same_segments():
    points = np.array([[0.0, 0.0], [0.01, 0.0], [0.01, 0.02], [0.0, 0.0]])
    straight, circle = Chain.straight(points), arc(0.02, 0.02, 2 * np.pi, (0.1, 0.0))
    beside, repeated = Chain.straight(points[:2] + 0.5), Chain.straight(points[[0, 0, 1]])
    slot = Chain.join([Chain.straight(points[:2]), arc(0.01, 0.01, 1.0)])
    chains = [straight, circle, arc(0.02, 0.01, 1.0), beside, repeated, slot, arc(1e-12, 1e-12, 3)]
    drawn = draw_plain([*chains, Chain.straight(points[:1])], TOLERANCE)
    assert [x is None for x in drawn] == [False, False, True, False, True, False, True, True]
    for chain, found in zip(chains, drawn, strict=False):
        if found is not None:
            wanted = chain.to_segments(TOLERANCE)
            for name in ("starts", "tangents", "normals", "curvatures", "lengths"):
                assert np.array_equal(getattr(found, name), getattr(wanted, name)), name
    assert draw_plain([], TOLERANCE) == []


CUBICS = np.array([(0, 0), (1, 2), (2, 2), (3, 0), (4, -2), (5, 1), (6, 0)]) * 1e-2


def test_beziers_that_meet_at_a_knot_of_one_more_than_their_degree_are_one_spline():
    (path,) = paths_of([Outline([Spline(points=CUBICS)])], 1e-6)
    t = np.linspace(0, 1, 500)[:, None]
    for a, b, c, d in (CUBICS[:4], CUBICS[3:]):
        wanted = (1 - t) ** 3 * a + 3 * (1 - t) ** 2 * t * b + 3 * (1 - t) * t**2 * c + t**3 * d
        assert path.project(wanted).distance.max() <= 1e-6
    np.testing.assert_allclose(path.vertices[[0, -1]], CUBICS[[0, -1]], atol=1e-15)
    knots, points = np.repeat([0.0, 1.0, 2.0], 4), CUBICS[[0, 1, 2, 3, 3, 4, 5, 6]]
    both = Spline.from_knots(points, np.ones(8), knots, 3)
    np.testing.assert_allclose(both.points, CUBICS, atol=1e-16)
    points[4:, 1] += 1e-4
    assert Spline.from_knots(points, np.ones(8), knots, 3) is None


@given(seed=st.integers(0, 2**32), degree=st.integers(2, 5), extra=st.integers(0, 6))
@settings(max_examples=15)
def test_a_b_spline_with_any_knots_and_weights_is_followed(seed, degree, extra):
    rng = np.random.default_rng(seed)
    n = degree + 1 + extra
    points, weights = rng.uniform(-0.05, 0.05, (n, 2)), rng.uniform(0.3, 3.0, n)
    knots = np.sort(np.round(rng.uniform(0, 4, n + degree + 1), 1)) * 0.7
    knots[: degree + 1], knots[-degree - 1 :] = -0.7, 3.5
    spline = Spline.from_knots(points, weights, knots, degree)
    if np.unique(knots[1:-1], return_counts=True)[1].max(initial=0) > degree + 1 or spline is None:
        # A gap: the curve on both sides of a knot that occurs too often.
        assert np.unique(knots[degree + 1 : n], return_counts=True)[1].max() > degree
        return
    whole = BSpline(knots, np.column_stack([weights[:, None] * points, weights]), degree)
    value = whole(np.linspace(-0.7, 3.5, 3001))
    ((_, segments),) = fit_splines([spline], TOLERANCE)
    path = ac.Path(segments=segments)
    assert path.project(value[:, :2] / value[:, 2:]).distance.max() <= TOLERANCE


def test_many_curves_at_once_are_what_each_is_alone(monkeypatch):
    monkeypatch.setattr("armcontour.io.drawings.splines.AT_ONCE", 20)
    rng = np.random.default_rng(4)
    counts = 3 * rng.integers(1, 6, 16) + 1
    splines = [Spline(points=rng.uniform(0, 0.1, (n, 2)), degree=3) for n in counts]
    splines[7] = Spline(points=splines[7].points, weights=rng.uniform(1, 2, len(splines[7].points)))
    splines[9] = Spline(points=rng.uniform(0, 0.1, (5, 2)), degree=2)
    together = dict(fit_splines(splines, TOLERANCE))
    assert sorted(together) == list(range(16))
    for i, spline in enumerate(splines):
        ((_, alone),) = fit_splines([spline], TOLERANCE)
        assert len(alone) == len(together[i])
        np.testing.assert_allclose(alone.starts, together[i].starts, atol=1e-12)
        np.testing.assert_allclose(alone.lengths, together[i].lengths, atol=1e-12)
    told = []
    assert None not in paths_of([Outline([x]) for x in splines], TOLERANCE, tell=told.append)
    assert len(told) > 1 and told == sorted(told) and told[-1] == 1.0


def test_the_curve_that_cannot_be_fitted_is_named():
    good = Outline([Spline(points=CUBICS[:4])])
    # The control points are more than a nanometre apart, the points of the curve are not.
    bad = Outline([Spline(points=np.array([(0, 0), (1.2, 1), (1.2, 1), (0.1, 0)]) * 1e-9)])
    with pytest.raises(ac.InvalidInput, match="has no length") as caught:
        paths_of([good, good, bad, good], TOLERANCE)
    assert caught.value.index == 2
