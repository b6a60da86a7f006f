"""Smoothing: the way along a path averaged over time, on the same path."""

import numpy as np
import pytest

import armcontour as ac
from armcontour.motion import PathLaw, SmoothedLaw, smooth

WINDOWS = [(8e-3,), (4e-3, 4e-3), (30e-3, 7e-3)]


@pytest.fixture(scope="module")
def planned(rounded, arm, limits):
    return ac.plan(rounded, arm, limits)


def of(law, t, order=0):
    """S of a law and its rates, at rest before it begins and after its end."""
    t = np.clip(np.atleast_1d(t), 0.0, law.breaks[-1])
    i = np.clip(np.searchsorted(law.breaks, t) - 1, 0, len(law.breaks) - 2)
    return law.path_position(i, t, order)


@pytest.mark.parametrize("windows", WINDOWS)
def test_the_way_is_the_mean_over_the_windows(planned, windows):
    base, law = planned.laws[0], smooth(planned, *windows).laws[0]
    assert isinstance(base, PathLaw) and isinstance(law, SmoothedLaw)

    def mean(t, lengths):
        begin = t - lengths[0]
        if len(lengths) == 2:
            x = np.linspace(begin, t, 301)
            return np.trapezoid([mean(y, lengths[1:]) for y in x], x) / lengths[0]
        inside = base.breaks[(base.breaks > begin) & (base.breaks < t)]
        places = np.concatenate([[begin], inside, [t]])
        a, b = places[:-1], places[1:]
        # Simpson's rule is exact to rounding on intervals that short.
        parts = (b - a) / 6 * (of(base, a) + 4 * of(base, (a + b) / 2) + of(base, b))
        return parts.sum() / lengths[0]

    end = law.breaks[-1]
    for t in (1e-3, 0.011, 1.2345, 0.8 * end, end - 2e-3):
        assert of(law, t)[0] == pytest.approx(mean(t, windows), abs=2e-9)
    assert end == pytest.approx(base.breaks[-1] + sum(windows), rel=1e-15)


@pytest.mark.parametrize("windows", WINDOWS)
def test_rates_are_derivatives_and_both_ends_at_rest_where_the_plan_is(planned, windows):
    law = smooth(planned, *windows)
    t = np.random.default_rng(0).uniform(2e-5, law.duration - 2e-5, 3000)
    h = 4e-6
    # Across a break a difference is of both sides.
    t = t[np.searchsorted(law.breaks, t - h) == np.searchsorted(law.breaks, t + h)]
    assert len(t) > 1000
    np.testing.assert_allclose((law(t + h) - law(t - h)) / (2 * h), law(t, 1), atol=1e-8)
    np.testing.assert_allclose((law(t + h, 1) - law(t - h, 1)) / (2 * h), law(t, 2), atol=1e-6)
    np.testing.assert_array_equal(law(0.0), planned(0.0))
    end, side = law.duration, {"side": "left"}
    np.testing.assert_allclose(law(end, **side), planned(planned.duration, **side), atol=1e-15)
    for order in (1, 2):
        assert np.abs(law(0.0, order)).max() == 0
        assert np.abs(law(end, order, **side)).max() < 1e-10


def test_the_tool_stays_on_the_path(planned, arm, rounded):
    law = smooth(planned, 0.1, 0.05)
    t = np.linspace(0, law.duration, 20_000)
    assert rounded.project(arm.tool_position(law(t))).distance.max() < 2e-9


def test_speeds_and_path_accelerations_never_exceed_the_plans_largest(planned):
    base = planned.laws[0]
    ends = base.path_position(np.arange(len(base.rates.ds)), base.breaks[1:], 2)
    largest = max(np.abs(base.rates.dds).max(), np.abs(ends).max())
    for windows in WINDOWS:
        law = smooth(planned, *windows).laws[0]
        t = np.linspace(0, law.breaks[-1], 50_000)
        assert of(law, t, 1).max() <= base.speeds.max() * (1 + 1e-12)
        assert np.abs(of(law, t, 2)).max() <= largest * (1 + 1e-9)


def test_two_windows_make_path_accelerations_continuous_and_their_rate_finite(planned, rounded):
    smoothed = smooth(planned, 4e-3, 4e-3)
    law = smoothed.laws[0]
    k = np.arange(1, len(law.breaks) - 1)
    before, after = (law.path_position(i, law.breaks[1:-1], 2) for i in (k - 1, k))
    np.testing.assert_allclose(before, after, atol=1e-9)
    jump = np.abs(np.diff(planned.laws[0].rates.dds)).max()
    t = np.linspace(0, law.breaks[-1], 400_001)
    rate = np.diff(of(law, t, 2)) / (t[1] - t[0])
    # A jump is drawn out over a window, and the second one does not make that steeper.
    assert 0.5 * jump / 4e-3 < np.abs(rate).max() < 2.5 * jump / 4e-3
    # Between a line and an arc only the bend jumps.
    for s in rounded.breaks[1:-1]:
        k = int(np.flatnonzero(law.s == s)[0])
        t = law.breaks[k]
        ds = law.path_position(np.array([k]), np.array([t]), 1)[0]
        bend = law.joint_path(s, 2, side="right") - law.joint_path(s, 2, side="left")
        jump = smoothed(t, 2, side="right") - smoothed(t, 2, side="left")
        np.testing.assert_allclose(jump, bend * ds**2, atol=1e-9)
        np.testing.assert_allclose(smoothed(t, 1, side="left"), smoothed(t, 1), atol=1e-10)


def test_stops_stay_stops(arm, limits):
    planned = ac.plan(ac.Path.polyline([(0.35, 0.10), (0.41, 0.15), (0.28, 0.30)]), arm, limits)
    law = smooth(planned, 8e-3, 4e-3)
    assert len(law.laws) == 2
    assert law.duration == pytest.approx(planned.duration + 2 * 12e-3, abs=1e-12)
    stop = law.starts[1]
    assert max(np.abs(law(stop, 1, side=x)).max() for x in ("left", "right")) < 1e-10
    np.testing.assert_allclose(arm.tool_position(law(stop)), (0.41, 0.15), atol=1e-9)


def test_a_window_may_be_longer_than_the_motion(arm, limits):
    planned = ac.plan(ac.Path.polyline([(0.35, 0.10), (0.352, 0.10)]), arm, limits)
    law, middle = smooth(planned, 3 * planned.duration).laws[0], 2 * planned.duration
    # Everything is within the window then: uniform speed.
    assert of(law, middle, 1)[0] == pytest.approx(0.002 / (3 * planned.duration))
    assert of(law, middle, 2)[0] == 0


def test_it_is_compensated_and_executed_like_any_other(planned, arm, limits, rounded, servo):
    law, slow = smooth(planned, 8e-3, 8e-3), limits.replace(joint_acceleration=2.0)
    taught = ac.compensate(law, servo, method="inverse", period=1e-3)
    executed = ac.execute(taught, ac.ServoPlant(arm, servo, slow))
    found = ac.evaluate(executed, rounded, limits=limits)
    assert found.contour_error.max < 1e-6 and found.duration == law.duration


def test_what_cannot_be_smoothed_is_refused(planned, mac, rounded, arm, limits, refuses):
    moving = ac.plan(rounded, arm, limits, start_speed=0.01)
    for given in (
        (planned,), (planned, 1e-3, 1e-3, 1e-3), (planned, 0.0), (mac, 1e-3), (moving, 1e-3),
    ):  # fmt: skip
        refuses(lambda x=given: smooth(*x), ac.InvalidInput)
    # A joint path with clamped ends is named the ends that would do.
    ur5e, points = ac.load_arm("ur5e"), np.random.default_rng(1).uniform(-1.0, 1.0, (5, 6))
    with pytest.raises(ac.InvalidInput, match="natural"):
        ac.plan(ac.JointPath.spline(points, ends="clamped"), ur5e, smoothing=0.02)
    assert ac.plan(ac.JointPath.spline(points), ur5e, smoothing=0.02).duration > 0
