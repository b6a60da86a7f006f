"""Joint paths: exact for quintics, equal to SciPy's spline, two-sided, immutable."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.polynomial import Polynomial
from scipy.interpolate import CubicSpline

import armcontour as ac


def sampled(polynomials, s):
    """Value and two derivatives of one polynomial per joint."""
    return tuple(
        np.stack([p.deriv(k)(s) if k else p(s) for p in polynomials], axis=-1) for k in range(3)
    )


def quintics(seed=0):
    rng = np.random.default_rng(seed)
    return [Polynomial(rng.normal(size=6)) for _ in range(3)]


def test_hermite_is_exact_for_quintics():
    polynomials = quintics()
    breaks = np.array([-0.5, 0.1, 0.2, 1.5])
    path = ac.JointPath.hermite(
        breaks, sampled(polynomials, breaks[:-1]), sampled(polynomials, breaks[1:])
    )
    s = np.linspace(-0.5, 1.5, 101)
    for order in range(6):
        expected = np.stack([p.deriv(order)(s) if order else p(s) for p in polynomials], axis=-1)
        scale = np.abs(expected).max()
        # The third to fifth derivative come from differences over a short interval.
        tolerance = 1e-10 if order < 3 else 1e-7
        np.testing.assert_allclose(path(s, order), expected, atol=tolerance * scale)
    np.testing.assert_array_equal(path(s, 6), 0)
    assert path.dof == 3 and path.length == pytest.approx(2.0)


def test_hermite_meets_any_data_at_both_ends():
    rng = np.random.default_rng(1)
    breaks = np.cumsum(rng.uniform(0.1, 1, 6))
    begin, end = rng.normal(size=(2, 3, 5, 2))
    end[0, :-1] = begin[0, 1:]  # positions are continuous, derivatives need not be
    path = ac.JointPath.hermite(breaks, tuple(begin), tuple(end))
    for order in range(3):
        right = path(breaks[:-1], order, side="right")
        left = path(breaks[1:], order, side="left")
        np.testing.assert_allclose(right, begin[order], atol=1e-9)
        np.testing.assert_allclose(left, end[order], atol=1e-9)
    np.testing.assert_array_equal(path.stops, breaks[1:-1])  # where the direction jumps


def test_a_joint_path_may_not_jump_and_stops_at_its_own_breaks(refuses):
    line = np.zeros((2, 6, 1))
    line[:, 1] = 1.0
    line[1, 0] = 1.0
    assert len(ac.JointPath(breaks=[0.0, 1.0, 2.0], coefficients=line).stops) == 0
    for stop in (0.5, 3.0, 2.0):
        refuses(
            lambda stop=stop: ac.JointPath(breaks=[0.0, 1.0, 2.0], coefficients=line, stops=[stop]),
            ac.InvalidInput,
            "no inner break",
        )
    line[1, 0] = 1.1
    refuses(
        lambda: ac.JointPath(breaks=[0.0, 1.0, 2.0], coefficients=line),
        ac.InvalidInput,
        "Joint 1 jumps by 0.1 rad",
        joint=1,
        s=1.0,
    )


@pytest.mark.parametrize("n", [3, 4, 20])
@pytest.mark.parametrize("given", [True, False])
@pytest.mark.parametrize("ends", ["natural", "clamped"])
def test_spline_is_scipys(n, given, ends):
    rng = np.random.default_rng(n)
    points = rng.normal(size=(n, 2))
    chords = np.linalg.norm(np.diff(points, axis=0), axis=1)
    s = np.cumsum(rng.uniform(0.1, 1, n)) if given else np.concatenate([[0], np.cumsum(chords)])
    path = ac.JointPath.spline(points, s if given else None, ends=ends)
    reference = CubicSpline(s, points, bc_type=ends)
    at = np.linspace(s[0], s[-1], 77)
    for order in range(3):
        np.testing.assert_allclose(path(at, order), reference(at, order), atol=1e-8)
    assert path.tool_path is None and len(path.stops) == 0


def test_spline_of_two_points_is_a_line():
    path = ac.JointPath.spline([(0.0, 1.0), (3.0, 5.0)])
    np.testing.assert_allclose(path([0.0, 2.5, 5.0]), [(0, 1), (1.5, 3), (3, 5)], atol=1e-14)
    np.testing.assert_allclose(path(1.0, 1), (0.6, 0.8))


@pytest.mark.parametrize(
    ("points", "s", "words"),
    [
        ([(0.0, 1.0)], None, ("at least two rows",)),
        ([0.0, 1.0], None, ("at least two rows",)),
        ([(0.0, 1.0), (0.0, 1.0), (1.0, 1.0)], None, ("increase", "repeated points")),
        ([(0.0, 1.0), (1.0, 1.0)], [1.0, 0.0], ("increase",)),
        ([(0.0, 1.0), (1.0, 1.0)], [0.0, 1.0, 2.0], ("one per point",)),
        ([(0.0, np.nan), (1.0, 1.0)], None, ("joint positions", "finite")),
    ],
)
def test_spline_refuses(points, s, words, refuses):
    refuses(lambda: ac.JointPath.spline(points, s), ac.InvalidInput, *words)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"breaks": np.array([0.0])}, ("shape (intervals, 6, dof)",)),
        ({"coefficients": np.zeros((2, 6, 2))}, ("shape (intervals, 6, dof)",)),
        ({"coefficients": np.zeros((1, 4, 2))}, ("shape (intervals, 6, dof)",)),
        ({"coefficients": np.zeros((1, 6))}, ("shape (intervals, 6, dof)",)),
        ({"breaks": np.array([1.0, 1.0])}, ("breaks must increase",)),
        ({"coefficients": np.full((1, 6, 2), np.nan)}, ("finite",)),
    ],
)
def test_arrays_that_do_not_fit_are_refused(change, words, refuses):
    good = {"breaks": np.array([0.0, 1.0]), "coefficients": np.zeros((1, 6, 2))}
    assert ac.JointPath(**good).dof == 2
    refuses(lambda: ac.JointPath(**good | change), ac.InvalidInput, *words)


@pytest.mark.parametrize("s", [0.9, 2.1, np.nan])
def test_outside_is_refused(s, refuses):
    path = ac.JointPath.spline([(0.0, 0.0), (1.0, 1.0)], [1.0, 2.0])
    refuses(lambda: path([1.5, s]), ac.InvalidInput, "outside the joint path", "from 1 to 2", s=s)


def test_shapes_follow_the_argument():
    path = ac.JointPath.spline(np.eye(3))
    assert path(0.1).shape == (3,)
    assert path(np.zeros((2, 4)), 1).shape == (2, 4, 3)


def test_it_owns_its_arrays():
    breaks, coefficients = np.array([0.0, 1.0]), np.ones((1, 6, 2))
    path = ac.JointPath(breaks=breaks, coefficients=coefficients)
    breaks[1] = coefficients[0, 0, 0] = 9.0
    assert path.breaks[1] == 1.0 and path.coefficients[0, 0, 0] == 1.0
    for array in (path.breaks, path.coefficients, path.stops):
        assert not array.flags.writeable


def test_short_intervals_far_along_a_path_do_not_bend_by_rounding():
    # Lengths are exact, but the breaks are their sums, rounded to about 1e-14 m at 50 m.
    lengths = np.tile([5e-4, 2e-9, 5e-4, 3e-11], 50)
    s = 50.0 + np.concatenate([[0.0], np.cumsum(lengths)])
    exact = np.concatenate([[0.0], np.cumsum(lengths)])
    begin = tuple(x[:-1, None] for x in (np.sin(exact), np.cos(exact), -np.sin(exact)))
    end = tuple(x[1:, None] for x in (np.sin(exact), np.cos(exact), -np.sin(exact)))
    path = ac.JointPath.hermite(s, begin, end)
    at = (s[:-1, None] + np.diff(s)[:, None] * np.linspace(0, 1, 7)).ravel()
    assert np.abs(path(at, 2)).max() < 0.2
    np.testing.assert_allclose(path(at)[:, 0], np.sin(at - 50.0), atol=1e-12)
