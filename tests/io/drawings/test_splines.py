"""Splines as Bézier curves, and many of them fitted at once."""

from __future__ import annotations

import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import BSpline

import armcontour as ac
from armcontour.io.drawings.shapes import Outline, paths_of
from armcontour.io.drawings.splines import Spline, fit_splines

TOLERANCE = 1e-5


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


def test_beziers_that_meet_at_a_knot_of_one_more_than_their_degree_are_one_curve():
    a = np.array([(0, 0), (1, 2), (2, 2), (3, 0)]) * 1e-2
    b = np.array([(3, 0), (4, -2), (5, 1), (6, 0)]) * 1e-2
    knots = np.repeat([0.0, 1.0, 2.0], 4)
    both = Spline.from_knots(np.concatenate([a, b]), np.ones(8), knots, 3)
    np.testing.assert_allclose(both.points, np.concatenate([a, b[1:]]), atol=1e-16)
    apart = np.concatenate([a, b + [0, 1e-4]])
    assert Spline.from_knots(apart, np.ones(8), knots, 3) is None


def test_many_curves_at_once_are_what_each_is_alone():
    rng = np.random.default_rng(4)
    splines = [
        Spline(points=rng.uniform(0, 0.1, (3 * n + 1, 2)), degree=3)
        for n in rng.integers(1, 6, 40).tolist()
    ]
    splines[7] = Spline(points=splines[7].points, weights=rng.uniform(1, 2, len(splines[7].points)))
    splines[9] = Spline(points=rng.uniform(0, 0.1, (5, 2)), degree=2)
    together = dict(fit_splines(splines, TOLERANCE))
    assert sorted(together) == list(range(40))
    for i, spline in enumerate(splines):
        ((_, alone),) = fit_splines([spline], TOLERANCE)
        assert len(alone) == len(together[i])
        np.testing.assert_allclose(alone.starts, together[i].starts, atol=1e-12)
        np.testing.assert_allclose(alone.lengths, together[i].lengths, atol=1e-12)


def test_the_curve_that_cannot_be_fitted_is_named():
    good = Outline([Spline(points=np.array([(0, 0), (1, 2), (2, 2), (3.0, 0)]) * 1e-2)])
    # Its control points are further apart than a nanometre, its own points are not.
    bad = Outline([Spline(points=np.array([(0, 0), (1.2, 1), (1.2, 1), (0.1, 0)]) * 1e-9)])
    with pytest.raises(ac.InvalidInput, match="has no length") as caught:
        paths_of([good, good, bad, good], 1e-5)
    assert caught.value.index == 2


def test_thousands_of_curves_are_fast():
    rng = np.random.default_rng(1)
    corners = rng.uniform(0, 1, (5000, 1, 2)) + rng.uniform(0, 0.01, (5000, 4, 2))
    outlines = [Outline([Spline(points=x)]) for x in corners]
    told = []
    began = time.process_time()
    paths = paths_of(outlines, TOLERANCE, tell=told.append)
    # On a quiet machine 0.8 s; one after the other they take 7 s.
    assert time.process_time() - began < 5.0
    assert len(paths) == 5000 and None not in paths
    assert told == sorted(told) and told[-1] == 1.0
