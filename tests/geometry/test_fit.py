"""Curves as tangent arcs, compared with the curves at thousands of points."""

from math import comb

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import BSpline, CubicSpline
from scipy.spatial import cKDTree
from tests.geometry.tables import each, refused

import armcontour as ac
from armcontour.geometry.arc_fit import fit_many

QUARTER = np.pi / 2


def fitted(curve, breaks, tolerance):
    rows = np.zeros(len(breaks), dtype=np.intp)
    knots = np.array(breaks, dtype=float)
    (segments,) = fit_many(lambda _, t, order: curve(t, order), knots, rows, tolerance)
    return ac.Path(segments=segments)


def ellipse(a, b):
    def curve(t, order):
        c, s = np.cos(t), np.sin(t)
        return np.column_stack([a * c, b * s] if order == 0 else [-a * s, b * c])

    return curve


def bezier(*points):
    p = np.array(points, dtype=float)

    def curve(t, order):
        q = p if order == 0 else (len(p) - 1) * np.diff(p, axis=0)
        n = len(q) - 1
        return sum(np.outer(comb(n, k) * t**k * (1 - t) ** (n - k), q[k]) for k in range(n + 1))

    return curve


def judged(curve, breaks, tolerance, *, corners=0, places=3001):
    """The path, once it is near the curve both ways, on it at its breaks, and tangent."""
    path = fitted(curve, breaks, tolerance)
    parameter = np.linspace(breaks[0], breaks[-1], places)
    dense = curve(parameter, 0)
    assert path.project(dense).distance.max() <= tolerance
    assert path.project(curve(np.array(breaks, dtype=float), 0)).distance.max() < 2e-9
    step = np.linalg.norm(np.diff(dense, axis=0), axis=1).max()
    along = path(np.linspace(0, path.length, 2001))
    # The nearest sample is at most half a step from the nearest point.
    assert cKDTree(dense).query(along)[0].max() <= np.hypot(tolerance, step / 2) + 1e-12
    np.testing.assert_allclose(path.vertices[[0, -1]], dense[[0, -1]], atol=1e-9)
    assert corners is None or (path.turns > 1e-9).sum() == corners
    assert path.turns[path.turns <= 1e-9].max(initial=0.0) < 2e-12
    return path


CURVES = {
    "quarter ellipse": (ellipse(0.05, 0.025), [0, QUARTER], 0),
    "ellipse": (ellipse(0.05, 0.025), [0, 4 * QUARTER], 0),
    "ellipse from anywhere": (ellipse(0.05, 0.025), [0.3, 0.3 + 4 * QUARTER], 0),
    "flat ellipse": (ellipse(0.05, 0.0005), np.arange(5) * QUARTER, 0),
    "wave": (bezier((0, 0), (0.5, 1), (0.5, -1), (1, 0)), [0, 1], 0),
    "first point repeated": (bezier((0, 0), (0, 0), (1, 1), (2, 0)), [0, 1], 0),
    "last point repeated": (bezier((0, 0), (1, 1), (2, 0), (2, 0)), [0, 1], 0),
    "first point thrice": (bezier((0, 0), (0, 0), (0, 0), (2, 1), (3, 0)), [0, 1], 0),
    # Tiny corners next to a cusp depend on the tolerance.
    "cusp": (bezier((0, 0), (1, 1), (0, 1), (1, 0)), [0, 1], None),
    "cusp aside": (bezier((0, 0), (2, 2), (-1.5, 0.5), (1, 0)), [0, 1], 0),
    "tight loop": (bezier((0, 0), (1.1, 1), (-0.1, 1), (1, 0)), [0, 1], 0),
    "loop that closes with a corner": (bezier((0, 0), (1, 1), (-1, 1), (0, 0)), [0, 1], 0),
    "space": (bezier((0, 0, 0), (1, 1, 1), (-1, 1, 2), (0, 0, 3)), [0, 1], 0),
    "breaks in between": (bezier((0, 0), (1, 2), (2, -1), (3, 1)), [0, 0.1, 0.11, 0.7, 1], 0),
}


@each("tolerance", [1e-3, 1e-5, 1e-7])
@each("name", CURVES)
def test_fitted_arcs_are_tangent_and_within_the_tolerance_in_both_directions(name, tolerance):
    curve, breaks, corners = CURVES[name]
    path = judged(curve, breaks, tolerance, corners=corners)
    # Pairs of arcs are of third order, so a million times the accuracy takes a hundred times more.
    size = np.linalg.norm(curve(np.linspace(breaks[0], breaks[-1], 99), 0), axis=1).max()
    assert len(path) <= 8 * len(breaks) + 8 * (size / tolerance) ** (1 / 3)


@given(
    st.lists(st.tuples(*[st.floats(-1, 1, width=32)] * 2), min_size=3, max_size=5, unique=True),
    st.sampled_from([1e-3, 1e-5]),
)
def test_fitted_arcs_approximate_random_bezier_curves(points, tolerance):
    curve = bezier(*points)
    try:
        path = fitted(curve, [0, 1], tolerance)
    except ac.InvalidInput as error:
        assert "no length" in str(error) and np.ptp(np.array(points), axis=0).max() < 1e-8
        return
    dense = curve(np.linspace(0, 1, 1501), 0)
    assert path.project(dense).distance.max() <= tolerance
    assert len(path) < 300


ROUND = [
    ([0, 4 * QUARTER], 1),
    (np.arange(5) * QUARTER, 1),
    ([0.3, 2.9], 1),
    ([0, 12 * QUARTER], 4),
    ([0, 7.0], 2),
]


@each("breaks, count", ROUND)
def test_a_fitted_circle_is_one_arc_per_turn(breaks, count):
    path = judged(ellipse(0.05, 0.05), breaks, 1e-5)
    assert len(path) == count
    np.testing.assert_allclose(path.curvatures, 20, rtol=1e-12)
    assert path.length == pytest.approx(0.05 * (breaks[-1] - breaks[0]), rel=1e-12)
    assert (path.curvatures * path.lengths <= 2 * np.pi * (1 + 1e-12)).all()


def rational(points, weights, knots, degree):
    """A rational spline and its derivative."""
    weights = np.array(weights)[:, None]
    whole = BSpline(knots, np.hstack([np.array(points) * weights, weights]), degree)

    def curve(t, order):
        h = whole(t)
        dh = whole(t, 1)
        p = h[:, :2] / h[:, 2:]
        return p if order == 0 else (dh[:, :2] - p * dh[:, 2:]) / h[:, 2:]

    return curve


def test_breaks_of_a_curve_become_corners_or_tangent_vertices():
    def curve(t, order):
        u = t - 1
        before = [t, 0 * t] if order == 0 else [1 + 0 * t, 0 * t]
        after = [1 + np.sin(u), 1 - np.cos(u)] if order == 0 else [np.cos(u), np.sin(u)]
        return np.where((t < 1)[:, None], np.column_stack(before), np.column_stack(after))

    path = judged(curve, [0, 1, 2], 1e-5)
    np.testing.assert_allclose(path.curvatures, [0, 1], atol=1e-12)

    def curve(t, order):
        u = t - 0.5
        return np.column_stack([t, np.abs(u)] if order == 0 else [1 + 0 * t, np.sign(u)])

    path = judged(curve, [0, 0.5, 1], 1e-5, corners=1)
    assert len(path) == 2
    np.testing.assert_allclose(path.turns, np.pi / 2)


def test_closed_curves_and_curves_with_zero_speed_are_fitted():
    # A closed curve that is smooth where it starts is closed to the last digit.
    path = fitted(ellipse(0.05, 0.025), [0.4, 0.4 + 2 * np.pi], 1e-5)
    np.testing.assert_allclose(path(0.0), path(path.length), atol=1e-15)
    np.testing.assert_allclose(path(0.0, 1), path(path.length, 1), atol=1e-14)
    # At both ends two control points are one: the tangent there points to the next but one.
    path = fitted(bezier((0, 0), (0, 0), (1, 2), (3, 1), (3, 1)), [0, 1], 1e-6)
    np.testing.assert_allclose(path(0.0, 1), np.array([1, 2]) / np.sqrt(5), atol=1e-9)
    np.testing.assert_allclose(path(path.length, 1), np.array([2, -1]) / np.sqrt(5), atol=1e-9)
    # A curve too small for the tolerance keeps its ends.
    ends = [(1, 1), (1 + 1e-8, 1 + 1e-8)]
    path = fitted(bezier(ends[0], (1 + 1e-8, 1), ends[1]), [0, 1], 1e-5)
    np.testing.assert_allclose(path.vertices[[0, -1]], ends, atol=1e-15)
    # A quarter of an ellipse of 50 mm takes few arcs.
    assert len(fitted(ellipse(0.05, 0.025), [0, QUARTER], 1e-5)) <= 14
    assert len(fitted(ellipse(0.05, 0.025), np.arange(5) * QUARTER, 1e-5)) <= 56


def test_invalid_curves_are_refused(monkeypatch):
    round_ = ellipse(1, 1)
    none = bezier((0, 0), (0, 0), (0, 0))
    refused(
        (lambda: fitted(none, [0, 1], 1e-5), "no length", "(0.0, 0.0)"),
        (lambda: fitted(round_, [0, 1], 0.0), "tolerance", "above zero"),
        (lambda: fitted(round_, [0, 1], 1e-10), "tolerance", "at least 1e-09 m"),
        (lambda: fitted(ellipse(np.inf, 1), [0.1, 1], 1e-5), "finite"),
    )
    monkeypatch.setattr("armcontour.geometry.arc_fit.MAX_INTERVALS", 100)
    refused((lambda: fitted(ellipse(1, 0.5), [0, 6], 1e-8), "more than 200 arcs", "1e-08 m"))


@each("seed", range(8))
def test_rational_splines_with_very_different_weights_are_fitted(seed):
    # Nearly all of such a curve may lie within a thousandth of its parameters.
    rng = np.random.default_rng(seed)
    weights = np.exp(rng.uniform(-6, 6, 8))
    points = rng.normal(size=(8, 2))
    inner = np.sort(rng.random(4))
    curve = rational(points, weights, [0, 0, 0, 0, *inner, 1, 1, 1, 1], 3)
    path = fitted(curve, [0, *inner, 1], 1e-5)
    dense = curve(np.linspace(0, 1, 30001), 0)
    assert path.project(dense).distance.max() <= 1e-5
    assert path.turns.max() < 1e-9 and len(path) < 400


def test_coincident_breaks_and_thousands_of_intervals_are_fitted():
    def curve(t, order):
        # It waits at (1, 0) from 1 to 2, but for steps of less than a nanometre.
        wait = np.clip(t - 1, 0, 1)
        x = t - wait * (1 - 1e-9)
        rate = np.where((t > 1) & (t < 2), 1e-9, 1.0)
        return np.column_stack([x, 0 * t] if order == 0 else [rate, 0 * t])

    path = fitted(curve, np.concatenate([[0], np.linspace(1, 2, 50), [3]]), 1e-5)
    assert path.length == pytest.approx(2, abs=1e-8) and len(path) <= 4
    t = np.arange(4001.0)
    spline = CubicSpline(t, np.column_stack([np.cos(t / 100), np.sin(t / 76)]))
    path = fitted(lambda x, order: spline(x, order), t, 1e-5)
    assert len(path) <= 8002 and path.turns.max() < 1e-9
