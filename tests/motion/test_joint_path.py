"""Joint paths: exact for quintics, equal to SciPy's spline, two-sided, immutable."""

import numpy as np
from numpy.polynomial import Polynomial
from scipy.interpolate import CubicSpline

import armcontour as ac


def derivatives(polynomials, s, count):
    """Value and derivatives of one polynomial per joint."""
    return [np.stack([p.deriv(k)(s) for p in polynomials], axis=-1) for k in range(count)]


def test_hermite_is_exact_for_quintics():
    rng = np.random.default_rng(0)
    polynomials = [Polynomial(rng.normal(size=6)) for _ in range(3)]
    breaks = np.array([-0.5, 0.1, 0.2, 1.5])
    ends = (derivatives(polynomials, x, 3) for x in (breaks[:-1], breaks[1:]))
    path = ac.JointPath.hermite(breaks, *ends)
    s = np.linspace(-0.5, 1.5, 101)
    for order, expected in enumerate(derivatives(polynomials, s, 6)):
        # The third to fifth derivative come from differences over a short interval.
        tolerance = (1e-10 if order < 3 else 1e-7) * np.abs(expected).max()
        np.testing.assert_allclose(path(s, order), expected, atol=tolerance)
    np.testing.assert_array_equal(path(s, 6), 0)
    assert path.dof == 3 and abs(path.length - 2.0) < 1e-12
    assert path(0.1).shape == (3,) and path(np.zeros((2, 4)), 1).shape == (2, 4, 3)


def test_hermite_meets_any_data_at_both_ends():
    rng = np.random.default_rng(1)
    breaks = np.cumsum(rng.uniform(0.1, 1, 6))
    begin, end = rng.normal(size=(2, 3, 5, 2))
    end[0, :-1] = begin[0, 1:]  # positions are continuous, derivatives need not be
    path = ac.JointPath.hermite(breaks, tuple(begin), tuple(end))
    for order in range(3):
        np.testing.assert_allclose(path(breaks[:-1], order, side="right"), begin[order], atol=1e-9)
        np.testing.assert_allclose(path(breaks[1:], order, side="left"), end[order], atol=1e-9)
    np.testing.assert_array_equal(path.stops, breaks[1:-1])  # where the direction jumps


def test_spline_is_scipys():
    for n in (3, 4, 20):
        rng = np.random.default_rng(n)
        points, own = rng.normal(size=(n, 2)), np.cumsum(rng.uniform(0.1, 1, n))
        chords = np.cumsum([0, *np.linalg.norm(np.diff(points, axis=0), axis=1)])
        for given, s, ends in (
            (given, s, ends)
            for given, s in ((own, own), (None, chords))
            for ends in ("natural", "clamped")
        ):
            path = ac.JointPath.spline(points, given, ends=ends)
            reference, at = CubicSpline(s, points, bc_type=ends), np.linspace(s[0], s[-1], 77)
            for k in range(3):
                case = f"{n} points, {ends}, order {k}"
                np.testing.assert_allclose(path(at, k), reference(at, k), atol=1e-8, err_msg=case)
            assert path.tool_path is None and len(path.stops) == 0
    line = ac.JointPath.spline([(0.0, 1.0), (3.0, 5.0)])
    np.testing.assert_allclose(line([0.0, 2.5, 5.0]), [(0, 1), (1.5, 3), (3, 5)], atol=1e-14)
    np.testing.assert_allclose(line(1.0, 1), (0.6, 0.8))


def test_refusals(refuses):
    two = [(0.0, 1.0), (1.0, 1.0)]
    for points, s in (
        ([(0.0, 1.0)], None),
        ([0.0, 1.0], None),
        ([(0.0, 1.0), *two], None),  # a point twice
        (two, [1.0, 0.0]),
        (two, [0.0, 1.0, 2.0]),
        ([(0.0, np.nan), (1.0, 1.0)], None),
    ):
        refuses(lambda x=points, s=s: ac.JointPath.spline(x, s), ac.InvalidInput)
    good = {"breaks": np.array([0.0, 1.0]), "coefficients": np.zeros((1, 6, 2))}
    assert ac.JointPath(**good).dof == 2
    for change in (
        {"breaks": np.array([0.0])},
        {"coefficients": np.zeros((2, 6, 2))},
        {"coefficients": np.zeros((1, 4, 2))},
        {"coefficients": np.zeros((1, 6))},
        {"breaks": np.array([1.0, 1.0])},
        {"coefficients": np.full((1, 6, 2), np.nan)},
    ):
        refuses(lambda x=change: ac.JointPath(**good | x), ac.InvalidInput)
    path = ac.JointPath.spline(two, [1.0, 2.0])
    for s in (0.9, 2.1, np.nan):
        words = "outside the joint path", "from 1 to 2"
        refuses(lambda s=s: path([1.5, s]), ac.InvalidInput, *words, s=s)


def test_a_joint_path_may_not_jump_and_stops_at_its_own_breaks(refuses):
    line = np.zeros((2, 6, 1))
    line[:, 1] = line[1, 0] = 1.0

    def make(**more):
        return ac.JointPath(breaks=[0.0, 1.0, 2.0], coefficients=line, **more)

    assert len(make().stops) == 0
    for stop in (0.5, 3.0, 2.0):
        refuses(lambda stop=stop: make(stops=[stop]), ac.InvalidInput)
    line[1, 0] = 1.1
    refuses(make, ac.InvalidInput, "Joint 1 jumps by 0.1 rad", joint=1, s=1.0)


def test_short_intervals_far_along_a_path_do_not_bend_by_rounding():
    # Lengths are exact, but the breaks are their sums, rounded to about 1e-14 m at 50 m.
    exact = np.concatenate([[0.0], np.cumsum(np.tile([5e-4, 2e-9, 5e-4, 3e-11], 50))])
    s, values = 50.0 + exact, (np.sin(exact), np.cos(exact), -np.sin(exact))
    ends = (tuple(x[own, None] for x in values) for own in (slice(-1), slice(1, None)))
    path = ac.JointPath.hermite(s, *ends)
    at = (s[:-1, None] + np.diff(s)[:, None] * np.linspace(0, 1, 7)).ravel()
    assert np.abs(path(at, 2)).max() < 0.2
    np.testing.assert_allclose(path(at)[:, 0], np.sin(at - 50.0), atol=1e-12)
