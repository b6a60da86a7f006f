"""Smoothing: the way along a path averaged over time, on the same path."""

import numpy as np
import pytest

import armcontour as ac
from armcontour.motion import PathLaw, SmoothedLaw, smooth

WINDOWS = [(8e-3,), (4e-3, 4e-3), (30e-3, 7e-3)]


@pytest.fixture(scope="module")
def arm():
    return ac.load_arm("pmk3s")


@pytest.fixture(scope="module")
def limits(arm):
    return arm.limits.replace(speed=0.15, centripetal_acceleration=0.09, joint_acceleration=0.72)


@pytest.fixture(scope="module")
def path():
    points = [(0.350, 0.100), (0.410, 0.150), (0.280, 0.300), (0.350, 0.350)]
    return ac.round_corners(ac.Path.polyline(points), tolerance=5e-3)


@pytest.fixture(scope="module")
def planned(path, arm, limits):
    return ac.plan(path, arm, limits)


def way(law, t):
    """S of a law, at rest before it begins and after its end."""
    if t <= 0 or t >= law.breaks[-1]:
        return law.s[0] if t <= 0 else law.s[-1]
    i = np.array([min(np.searchsorted(law.breaks, t), len(law.breaks) - 1) - 1])
    return float(law.path_position(i, np.array([t]))[0])


def of(law, t, order):
    t = np.atleast_1d(t)
    i = np.clip(np.searchsorted(law.breaks, t) - 1, 0, len(law.breaks) - 2)
    return law.path_position(i, t, order)


@pytest.mark.parametrize("windows", WINDOWS)
def test_the_way_is_the_mean_over_the_windows(planned, windows):
    base, law = planned.laws[0], smooth(planned, *windows).laws[0]
    assert isinstance(base, PathLaw) and isinstance(law, SmoothedLaw)

    def mean(t, lengths):
        if not lengths:
            return way(base, t)
        if len(lengths) == 1:
            begin = t - lengths[0]
            inside = base.breaks[(base.breaks > begin) & (base.breaks < t)]
            places = np.concatenate([[begin], inside, [t]])
            # Simpson's rule is exact to rounding on intervals that short.
            total = 0.0
            for a, b in zip(places[:-1], places[1:], strict=True):
                total += (b - a) / 6 * (way(base, a) + 4 * way(base, (a + b) / 2) + way(base, b))
            return total / lengths[0]
        x = np.linspace(t - lengths[0], t, 301)
        return np.trapezoid([mean(y, lengths[1:]) for y in x], x) / lengths[0]

    end = law.breaks[-1]
    for t in (1e-3, 0.011, 1.2345, 0.8 * end, end - 2e-3):
        assert of(law, t, 0)[0] == pytest.approx(mean(t, windows), abs=2e-9)
    assert end == pytest.approx(base.breaks[-1] + sum(windows), rel=1e-15)


@pytest.mark.parametrize("windows", WINDOWS)
def test_velocity_and_acceleration_are_the_derivatives(planned, windows):
    law = smooth(planned, *windows)
    t = np.random.default_rng(0).uniform(2e-5, law.duration - 2e-5, 3000)
    h = 4e-6
    # Across a break a difference is of both sides.
    t = t[np.searchsorted(law.breaks, t - h) == np.searchsorted(law.breaks, t + h)]
    assert len(t) > 1000
    np.testing.assert_allclose((law(t + h) - law(t - h)) / (2 * h), law(t, 1), atol=1e-8)
    np.testing.assert_allclose((law(t + h, 1) - law(t - h, 1)) / (2 * h), law(t, 2), atol=1e-6)


@pytest.mark.parametrize("windows", WINDOWS)
def test_it_begins_and_ends_at_rest_where_the_plan_does(planned, windows):
    law = smooth(planned, *windows)
    np.testing.assert_array_equal(law(0.0), planned(0.0))
    end, side = law.duration, {"side": "left"}
    np.testing.assert_allclose(law(end, **side), planned(planned.duration, side="left"), atol=1e-15)
    for order in (1, 2):
        assert np.abs(law(0.0, order)).max() == 0
        assert np.abs(law(end, order, **side)).max() < 1e-10


def test_the_tool_stays_on_the_path(planned, arm, path):
    law = smooth(planned, 0.1, 0.05)
    t = np.linspace(0, law.duration, 20_000)
    assert path.project(arm.forward(law(t))).distance.max() < 2e-9


def test_speeds_and_path_accelerations_never_exceed_the_plans_largest(planned):
    base = planned.laws[0]
    i = np.arange(len(base.rates.ds))
    ends = base.path_position(i, base.breaks[1:], 2)
    largest = max(np.abs(base.rates.dds).max(), np.abs(ends).max())
    for windows in WINDOWS:
        law = smooth(planned, *windows).laws[0]
        t = np.linspace(0, law.breaks[-1], 50_000)
        assert of(law, t, 1).max() <= base.speeds.max() * (1 + 1e-12)
        assert np.abs(of(law, t, 2)).max() <= largest * (1 + 1e-9)


def test_two_windows_make_path_accelerations_continuous_and_their_rate_finite(planned):
    law = smooth(planned, 4e-3, 4e-3).laws[0]
    before, after = (law.path_position(i, law.breaks[1:-1], 2) for i in _both(law))
    np.testing.assert_allclose(before, after, atol=1e-9)
    base = planned.laws[0]
    jump = np.abs(np.diff(base.rates.dds)).max()
    t = np.linspace(0, law.breaks[-1], 400_001)
    rate = np.diff(of(law, t, 2)) / (t[1] - t[0])
    # A jump is drawn out over a window, and the second one does not make that steeper.
    assert 0.5 * jump / 4e-3 < np.abs(rate).max() < 2.5 * jump / 4e-3


def _both(law):
    k = np.arange(1, len(law.breaks) - 1)
    return k - 1, k


def test_at_a_joint_between_line_and_arc_only_the_bend_jumps(planned, path):
    law = smooth(planned, 4e-3, 4e-3)
    inner = law.laws[0]
    for s in path.breaks[1:-1]:
        k = int(np.flatnonzero(inner.s == s)[0])
        t = inner.breaks[k]
        ds = inner.path_position(np.array([k]), np.array([t]), 1)[0]
        bend = [inner.joint_path(s, 2, side=x) for x in ("left", "right")]
        jump = law(t, 2, side="right") - law(t, 2, side="left")
        np.testing.assert_allclose(jump, (bend[1] - bend[0]) * ds**2, atol=1e-9)
        np.testing.assert_allclose(law(t, 1, side="left"), law(t, 1), atol=1e-10)


def test_stops_stay_stops(arm, limits):
    path = ac.Path.polyline([(0.35, 0.10), (0.41, 0.15), (0.28, 0.30)])
    planned = ac.plan(path, arm, limits)
    law = smooth(planned, 8e-3, 4e-3)
    assert len(law.laws) == 2
    assert law.duration == pytest.approx(planned.duration + 2 * 12e-3, abs=1e-12)
    stop = law.starts[1]
    assert np.abs(law(stop, 1)).max() < 1e-10 and np.abs(law(stop, 1, side="left")).max() < 1e-10
    np.testing.assert_allclose(arm.forward(law(stop)), (0.41, 0.15), atol=1e-9)


def test_a_window_may_be_longer_than_the_motion(arm, limits):
    planned = ac.plan(ac.Path.polyline([(0.35, 0.10), (0.352, 0.10)]), arm, limits)
    law = smooth(planned, 3 * planned.duration)
    middle = 2 * planned.duration
    # Everything is within the window then: uniform speed.
    assert of(law.laws[0], middle, 1)[0] == pytest.approx(0.002 / (3 * planned.duration))
    assert of(law.laws[0], middle, 2)[0] == 0


def test_it_is_compensated_and_executed_like_any_other(planned, arm, limits, path):
    law = smooth(planned, 8e-3, 8e-3)
    servo = ac.ServoModel(kp=25.0, kv=150.0)
    slow = limits.replace(joint_acceleration=2.0)
    taught = ac.compensate(law, servo, method="inverse", period=1e-3)
    executed = ac.execute(taught, ac.ServoPlant(arm, servo, slow))
    found = ac.evaluate(executed, path, limits=limits)
    assert found.contour_error.max < 1e-6
    assert found.duration == law.duration


def test_what_cannot_be_smoothed_is_refused(planned, path, arm, limits, refuses):
    refuses(lambda: smooth(planned), ac.InvalidInput, "one or two windows", "0")
    refuses(lambda: smooth(planned, 1e-3, 1e-3, 1e-3), ac.InvalidInput, "3")
    refuses(lambda: smooth(planned, 0.0), ac.InvalidInput, "window", "above zero")
    mac = ac.plan(path, arm, limits, method="mac")
    refuses(lambda: smooth(mac, 1e-3), ac.InvalidInput, "mac", "optimal")
    moving = ac.plan(path, arm, limits, start_speed=0.01)
    refuses(lambda: smooth(moving, 1e-3), ac.InvalidInput, "begins at 0.01 m/s", "start_speed")


def test_a_joint_path_with_clamped_ends_is_refused_with_the_ends_that_would_do() -> None:
    ur5e = ac.load_arm("ur5e")
    points = np.random.default_rng(1).uniform(-1.0, 1.0, (5, 6))
    with pytest.raises(ac.InvalidInput, match=r"rad/s along the joint path .*natural"):
        ac.plan(ac.JointPath.spline(points, ends="clamped"), ur5e, smoothing=0.02)
    assert ac.plan(ac.JointPath.spline(points), ur5e, smoothing=0.02).duration > 0
