"""Laws and joint paths: closed forms, derivatives, proven bounds."""

import itertools

import numpy as np
import pytest
from numpy.polynomial import Polynomial
from scipy.interpolate import CubicSpline

import armcontour as ac
from armcontour.motion import LapLaw, PathLaw, Rates, largest_shares


def test_laps_are_the_parabolas_of_equation_21():
    laps = LapLaw(
        breaks=np.array([0.0, 2.0, 3.0]),
        q=np.array([[0.0, 1.0], [4.0, 1.0], [6.0, 0.0]]),
        dq=np.array([[1.0, 0.0], [3.0, 0.0]]),
        ddq=np.array([[1.0, 0.0], [-2.0, -2.0]]),
    )
    i = np.array([0, 0, 1, 1])
    t = np.array([0.5, 2.0, 2.0, 2.5])
    for order, expected in enumerate(
        (
            [(0.625, 1), (4, 1), (4, 1), (4 + 1.5 - 0.25, 0.75)],
            [(1.5, 0), (3, 0), (3, 0), (2, -1)],
            [(1, 0), (1, 0), (-2, -2), (-2, -2)],
        )
    ):
        np.testing.assert_allclose(laps.on_interval(i, t, order), expected)


PATH = ac.JointPath.spline(np.random.default_rng(0).normal(size=(7, 2)), np.linspace(0, 1.2, 7))


def path_law(rates, path=PATH, breaks=(0.0, 1.0, 2.0), s=(0.0, 0.6, 1.2)):
    """Two intervals of 1 s, over the first and the second half of the path."""
    rates = Rates(*np.transpose(rates), jerk=np.zeros(len(rates)))
    return PathLaw(joint_path=path, breaks=np.array(breaks), s=np.array(s), rates=rates)


def test_a_path_law_has_derivatives_by_the_chain_rule_on_each_side_of_breaks():
    # Uniform acceleration, then uniform braking.
    law = path_law([[0.2, 0.8, 0.0], [1.0, -0.8, 0.0]])
    s_of = [Polynomial([0.0, 0.2, 0.4]), Polynomial([0.6, 1.0, -0.4])]
    for k in (0, 1):
        t = np.linspace(k, k + 1, 21)
        i = np.full(21, k)
        for order in range(3):
            expected = s_of[k].deriv(order)(t - k)
            np.testing.assert_allclose(law.path_position(i, t, order), expected, atol=1e-13)
        np.testing.assert_allclose(law.on_interval(i, t, 0), PATH(s_of[k](t - k)), atol=1e-12)
    # Acceleration that changes on the way, slow enough to stay inside the interval.
    law = path_law([[0.2, 0.3, 0.2], [0.5, -0.1, -0.3]])
    h = 1e-6
    t = np.array([0.11, 0.37, 0.83, 1.21, 1.57, 1.93])
    i = (t > 1).astype(int)
    for order in (1, 2):
        for value, near in ((law.path_position, 1e-8), (law.on_interval, 1e-7)):
            after, before = (value(i, t + x, order - 1) for x in (h, -h))
            np.testing.assert_allclose(value(i, t, order), (after - before) / (2 * h), atol=near)
        assert np.ptp(law.path_position(i, t, order)[:3]) > 0.05
    # Both sides of a kink at s = 1: at the common time each interval keeps its own side.
    coefficients = np.zeros((2, 6, 1))
    coefficients[:, :2, 0] = [(0.0, 1.0), (1.0, -5.0)]
    path = ac.JointPath(breaks=np.array([0.0, 1.0, 2.0]), coefficients=coefficients)
    law = path_law([[0.3, 0, 0]] * 2, path, (0.0, 1 / 0.3, 2 / 0.3), (0.0, 1.0, 2.0))
    times = np.array([1 / 0.3, 1 / 0.3])
    np.testing.assert_allclose(law.on_interval(np.array([0, 1]), times, 1), [[0.3], [-1.5]])


def test_breaks_in_disorder_are_refused():
    line = ac.JointPath.spline([(0.0,), (1.0,)])
    for breaks in ([0.0], [1.0, 2.0], [0.0, 1.0, 1.0], [0.0, 2.0, 1.0]):
        n = len(breaks)
        arrays = {"q": np.zeros((n, 1)), "dq": np.zeros((n - 1, 1)), "ddq": np.zeros((n - 1, 1))}
        with pytest.raises(ac.InvalidInput, match="start at 0 and increase"):
            LapLaw(breaks=np.array(breaks), **arrays)
        with pytest.raises(ac.InvalidInput, match="start at 0 and increase"):
            path_law(np.zeros((n - 1, 3)), line, breaks, np.zeros(n))


LIMITS = ac.Limits(joint_velocity=[1.0, 2.0], joint_acceleration=[3.0, 2.0])


def derivatives(polynomials, s, count):
    """Value and derivatives of one polynomial per joint."""
    return [np.stack([p.deriv(k)(s) for p in polynomials], axis=-1) for k in range(count)]


def test_hermite_interpolation_is_exact_for_quintics():
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


def test_hermite_interpolation_meets_any_data_at_both_ends():
    rng = np.random.default_rng(1)
    breaks = np.cumsum(rng.uniform(0.1, 1, 6))
    begin, end = rng.normal(size=(2, 3, 5, 2))
    end[0, :-1] = begin[0, 1:]  # positions are continuous, derivatives need not be
    path = ac.JointPath.hermite(breaks, tuple(begin), tuple(end))
    for order in range(3):
        np.testing.assert_allclose(path(breaks[:-1], order, side="right"), begin[order], atol=1e-9)
        np.testing.assert_allclose(path(breaks[1:], order, side="left"), end[order], atol=1e-9)
    np.testing.assert_array_equal(path.stops, breaks[1:-1])  # where the direction jumps


def test_joint_splines_equal_those_of_scipy():
    for n in (3, 4, 20):
        rng = np.random.default_rng(n)
        points = rng.normal(size=(n, 2))
        parameters = np.cumsum(rng.uniform(0.1, 1, n))
        chords = np.cumsum([0, *np.linalg.norm(np.diff(points, axis=0), axis=1)])
        ways = ((parameters, parameters), (None, chords))
        for (specified, s), ends in itertools.product(ways, ("natural", "clamped")):
            path = ac.JointPath.spline(points, specified, ends=ends)
            reference = CubicSpline(s, points, bc_type=ends)
            u = np.linspace(s[0], s[-1], 77)
            for k in range(3):
                case = f"{n} points, {ends}, order {k}"
                np.testing.assert_allclose(path(u, k), reference(u, k), atol=1e-8, err_msg=case)
            assert path.tool_path is None and len(path.stops) == 0
    line = ac.JointPath.spline([(0.0, 1.0), (3.0, 5.0)])
    np.testing.assert_allclose(line([0.0, 2.5, 5.0]), [(0, 1), (1.5, 3), (3, 5)], atol=1e-14)
    np.testing.assert_allclose(line(1.0, 1), (0.6, 0.8))


def test_invalid_joint_paths_are_refused(refuses):
    two = [(0.0, 1.0), (1.0, 1.0)]
    for points, s in (
        ([(0.0, 1.0)], None),
        ([0.0, 1.0], None),
        ([(0.0, 1.0), *two], None),  # a point twice
        *(([*two, (1.0 + x, 1.0 - x), (2.0, 0.0)], None) for x in (1e-16, 1e-15, 1e-14, 1e-13)),
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


def test_joint_paths_that_jump_are_refused_and_corners_are_stops(refuses):
    line = np.zeros((2, 6, 1))
    line[:, 1] = line[1, 0] = 1.0

    def make(**more):
        return ac.JointPath(breaks=[0.0, 1.0, 2.0], coefficients=line, **more)

    assert len(make().stops) == 0
    for stop in (0.5, 3.0, 2.0):
        refuses(lambda stop=stop: make(stops=[stop]), ac.InvalidInput)
    line[1, 0] = 1.1
    refuses(make, ac.InvalidInput, "Joint 1 jumps by 0.1 rad", joint=0, s=1.0)


# The peaks of the laws below are above the largest value at dense places by less.
NEAR = 1e-5


def planned(jerk):
    arm = ac.load_arm("ur5e")
    path = ac.Path.polyline([(0.45, -0.1, 0.2), (0.6, 0.1, 0.25), (0.4, 0.2, 0.3)])
    continuity = "tangent" if jerk is None else "curvature"
    path = ac.round_corners(path, tolerance=5e-3, continuity=continuity)
    limits = ac.Limits(speed=0.2, joint_acceleration=2.0, joint_jerk=jerk)
    return ac.plan(path.oriented(np.diag([1, -1, -1])), arm, limits, ac.Optimal(intervals=200))


@pytest.fixture(scope="module", params=[None, 20.0], ids=str)
def case(request):
    """A law, and limits that it takes in full."""
    law = planned(request.param).laws[0]
    return law, *limits_of(law)


def dense(law):
    """The largest of every joint's states and of ds, at 60 places of every interval, (4, ...)."""
    shares = (1 - np.cos(np.linspace(0, np.pi, 60))) / 2
    i = np.repeat(np.arange(len(law.breaks) - 1), 60)
    width = np.diff(law.breaks)[:, None]
    t = np.clip((law.breaks[:-1, None] + width * shares).ravel(), law.breaks[i], law.breaks[i + 1])
    ddq = law.on_interval(i, t, 2)
    dq = law.on_interval(i, t, 1)
    ends = [ddq.min(axis=0), ddq.max(axis=0), dq.min(axis=0), dq.max(axis=0)]
    return np.array(ends), law.path_position(i, t, 1).max()


def limits_of(law):
    """Limits that the densest look at a law takes in full, each by a joint of its own or by ds."""
    ends, ds = dense(law)
    pieces = len(law.joint_path.breaks) - 1
    sign = np.array([[-1], [1], [-1], [1]])
    # A joint at rest has only rounding errors.
    return sign * np.maximum(sign * ends, 1e-4), np.tile([ds, 2 * ds], (pieces, 1))


def test_proven_ratios_are_not_exceeded_at_random_times(case):
    law, limits, speeds = case
    shares = largest_shares(law, limits, speeds, 1 + NEAR)
    assert (shares <= 1 + NEAR).all()
    # Of what is proven, the share is that in the middles of intervals.
    assert shares == pytest.approx([1, 1, 1, 1, 1, 0.5], rel=5e-3)
    # At random times the ratio is not larger.
    t = np.random.default_rng(0).uniform(0, law.breaks[-1], 50_000)
    i = np.clip(np.searchsorted(law.breaks, t) - 1, 0, len(law.breaks) - 2)
    for values, bounds in ((law.on_interval(i, t, k), limits[4 - 2 * k :][:2]) for k in (1, 2)):
        assert max((values / x).max() for x in bounds) <= 1 + NEAR
    assert (law.path_position(i, t, 1) / speeds[0, 0]).max() <= max(1 + NEAR, shares[4])
    none = np.inf * limits, np.full_like(speeds, np.inf)
    np.testing.assert_array_equal(largest_shares(law, *none, 1.0), 0.0)


@pytest.mark.parametrize("jerk", [None, 10.0])
def test_peaks_within_long_intervals_are_found(jerk):
    # Few and long intervals, on which a bound has to make up for what its polynomial leaves out.
    random = np.random.default_rng(1)
    arm = ac.load_arm("ur5e")
    limits = ac.Limits(joint_acceleration=2.0, joint_velocity=1.0, joint_jerk=jerk)
    for k in range(6 if jerk is None else 3):
        joint_path = ac.JointPath.spline(random.uniform(-1.5, 1.5, (4, 6)))
        law = ac.plan(joint_path, arm, limits, ac.Optimal(intervals=12)).laws[0]
        full, speeds = limits_of(law)
        for row in range(4):
            only = 1e3 * np.sign(full)
            only[row] = full[row]
            shares = largest_shares(law, only, 100 * speeds, 1 - 1e-7)
            assert shares[row] > 1 - 1e-7, (k, row)
        shares = largest_shares(law, 100 * full, speeds, 1 - 1e-7)
        assert shares[4] > 1 - 1e-7, k


def test_rounding_errors_do_not_bend_short_intervals_of_long_paths():
    # Lengths are exact, but the breaks are their sums, rounded to about 1e-14 m at 50 m.
    exact = np.concatenate([[0.0], np.cumsum(np.tile([5e-4, 2e-9, 5e-4, 3e-11], 50))])
    s = 50.0 + exact
    values = (np.sin(exact), np.cos(exact), -np.sin(exact))
    ends = (tuple(x[rows, None] for x in values) for rows in (slice(-1), slice(1, None)))
    path = ac.JointPath.hermite(s, *ends)
    s_inside = (s[:-1, None] + np.diff(s)[:, None] * np.linspace(0, 1, 7)).ravel()
    assert np.abs(path(s_inside, 2)).max() < 0.2
    np.testing.assert_allclose(path(s_inside)[:, 0], np.sin(s_inside - 50.0), atol=1e-12)
