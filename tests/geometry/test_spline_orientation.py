"""Tool orientations along splines: continuous rates, and plans for any number of waypoints."""

import math
import warnings
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import armcontour as ac
from armcontour.core.frames import log

ARM = ac.load_arm("ur5e")


def curve(count):
    """Return points of a smooth curve, and the tool axes and tool orientations at these points."""
    a = np.linspace(0, 1, count)
    points = np.c_[0.45 + 0.03 * np.sin(2 * a), -0.15 + 0.3 * a, 0.25 + 0.02 * np.sin(1.6 * a)]
    tilt = math.radians(30) * np.sin(2 * (a - 0.5))
    lean = math.radians(20) * np.cos(2.5 * a)
    axes = np.c_[np.sin(tilt), np.sin(lean), -np.cos(tilt)]
    rotations = Rotation.from_euler("xyz", np.c_[math.pi + tilt, lean, a])
    return points, axes / np.linalg.norm(axes, axis=1)[:, None], rotations.as_matrix()


def pointing(count):
    points, axes, _ = curve(count)
    return ac.Path.spline(points).pointing(axes)


def oriented(count):
    points, _, rotations = curve(count)
    return ac.Path.spline(points).oriented(rotations)


@pytest.mark.parametrize("count", [3, 5, 40])
def test_tool_axes_at_waypoints_are_kept(count):
    _, axes, _ = curve(count)
    path = pointing(count)
    at_waypoints = path.orientation(path.breaks[path.waypoints])
    np.testing.assert_allclose(at_waypoints[:, :, 2], axes, atol=1e-12)


@pytest.mark.parametrize("count", [3, 5, 40])
def test_orientations_at_waypoints_are_kept(count):
    _, _, rotations = curve(count)
    path = oriented(count)
    at_waypoints = path.orientation(path.breaks[path.waypoints])
    np.testing.assert_allclose(at_waypoints, rotations, atol=1e-12)


@pytest.mark.parametrize("make_path", [pointing, oriented])
def test_turning_rate_and_acceleration_are_continuous_at_breaks(make_path):
    orientation = make_path(9).orientation
    inner = orientation.breaks[1:-1]
    before, after = (orientation.rates(inner, side=side) for side in ("left", "right"))
    axis = orientation(inner)[:, :, 2]
    for left, right in zip(before, after, strict=True):
        step = right - left
        if orientation.axis_only:
            # The rotation about the tool axis is free, so its rate may jump.
            step -= (step * axis).sum(axis=1, keepdims=True) * axis
        assert np.abs(step).max() < 1e-8 * np.abs(orientation.rates(inner)[0]).max()


@pytest.mark.parametrize("make_path", [pointing, oriented])
def test_turning_rate_is_the_derivative_of_the_orientation(make_path):
    orientation = make_path(9).orientation
    s = np.linspace(0.01, orientation.breaks[-1] - 0.01, 50)
    h = 1e-6
    turn = orientation(s + h) @ np.swapaxes(orientation(s - h), 1, 2)
    rate = Rotation.from_matrix(turn).as_rotvec() / (2 * h)
    np.testing.assert_allclose(orientation.rates(s)[0], rate, atol=1e-5)


@pytest.mark.parametrize("jerk", [None, 100.0])
@pytest.mark.parametrize("make_path", [pointing, oriented])
def test_plan_duration_of_a_smooth_curve_does_not_depend_on_the_number_of_points(make_path, jerk):
    limits = ARM.limits.replace(joint_jerk=jerk)
    durations = []
    for count in (5, 9, 65, 500):
        path = make_path(count)
        assert not len(path.stops)
        durations.append(ac.plan(path, ARM, limits).duration)
    assert np.ptp(durations) < 0.01 * durations[0]


@pytest.mark.parametrize("make_path", [pointing, oriented])
def test_a_jerk_limit_adds_no_stop(make_path):
    path = make_path(17)
    limits = ARM.limits.replace(joint_jerk=100.0)
    planned = ac.plan(path, ARM, limits)
    assert planned.duration < 1.1 * ac.plan(path, ARM).duration


def test_a_constant_rate_stays_nearly_constant():
    x = np.linspace(0, 0.4, 5)
    spline = ac.Path.spline(np.c_[x, 0.01 * np.sin(3 * x), 0 * x])
    spin = np.outer(np.arange(5), math.radians(60) * np.array([0.6, 0, 0.8]))
    orientation = spline.oriented(Rotation.from_rotvec(spin)).orientation
    rates = np.linalg.norm(orientation.rates(np.linspace(0, spline.length, 101))[0], axis=1)
    np.testing.assert_allclose(rates, math.radians(240) / spline.length, rtol=0.02)


def test_a_reversed_spline_keeps_its_orientations():
    path = oriented(9)
    whole = path.orientation
    s = np.linspace(0, path.length, 40)
    np.testing.assert_allclose(whole.reverse()(path.length - s), whole(s), atol=1e-12)


def test_a_part_of_a_spline_keeps_orientations_and_rates():
    path = oriented(9)
    whole = path.orientation
    begin = 0.31 * path.length
    length = 0.5 * path.length
    part = whole.cut(begin, length, 1e-9)
    s = np.linspace(0, length, 40)
    np.testing.assert_allclose(part(s), whole(begin + s), atol=1e-12)
    for rate_of_part, rate in zip(part.rates(s), whole.rates(begin + s), strict=True):
        np.testing.assert_allclose(rate_of_part, rate, atol=1e-9 * np.abs(rate).max())


def test_a_spline_without_corners_is_rounded_to_itself():
    path = pointing(9)
    rounded = ac.round_corners(path, tolerance=1e-4)
    assert len(rounded.corners.vertex) == 0
    assert ac.plan(rounded, ARM).duration == pytest.approx(ac.plan(path, ARM).duration)


def test_jump_of_turning_rate_is_reported_as_full_stop():
    points, axes, _ = curve(3)
    straight = np.linspace(points[0], points[-1], 3)
    path = ac.Path.polyline(straight).pointing(axes)
    with pytest.warns(UserWarning, match="1 full stop inside the path, the first at s = 0.15"):
        ac.plan(path, ARM)
    blended = ac.round_corners(path, tolerance=1e-4, angular_tolerance=0.01)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ac.plan(blended, ARM)


def test_tool_stops_once_where_spline_orientation_meets_fixed_orientation():
    points, axes, _ = curve(5)
    spline = pointing(5)
    end = spline.end
    line = ac.Path.polyline([end, end + 0.05 * spline(spline.length, 1)])
    joined = spline + line.pointing(axes[[-1, -1]])
    assert len(joined.orientation.stops) == 1


@pytest.mark.parametrize("axis_only", [True, False])
@pytest.mark.parametrize("continuity", ["tangent", "curvature"])
def test_a_corner_beside_a_spline_is_rounded_without_a_stop(axis_only, continuity):
    waypoints = np.array([(0.4, 0, 0.2), (0.45, 0.03, 0.2), (0.5, 0.01, 0.22), (0.56, 0.02, 0.2)])
    spline = ac.Path.spline(waypoints)
    end = spline.end
    line = ac.Path.line(tuple(end), tuple(end + [0.01, 0.08, 0.0]))
    turns = Rotation.from_euler("xy", [(0, 0), (0.2, 0.1), (0.1, 0.3), (0.3, 0.2), (0.3, 0.2)])
    down = Rotation.from_euler("x", np.pi)
    joined = spline + line
    path = replace(joined, waypoints=np.append(spline.waypoints, len(joined)))
    path = path.oriented((turns * down).as_matrix(), axis_only=axis_only)
    rounded = ac.round_corners(path, tolerance=2e-3, angular_tolerance=0.05, continuity=continuity)
    assert len(rounded.corners) == 1 and not rounded.corners.stopped.any()
    assert not len(rounded.stops)
    # The corner has its orientation in the middle, and the spline keeps its own.
    middle = (rounded.corners.start[0] + rounded.corners.end[0]) / 2
    s = np.linspace(0, 0.8 * spline.length, 20)
    for place, source in ((middle, spline.length), (s, s)):
        made = rounded.orientation(place)
        given = path.orientation(source)
        columns = slice(2, 3) if axis_only else slice(None)
        np.testing.assert_allclose(made[..., columns], given[..., columns], atol=1e-5)
    # Rates are the derivatives of the rotations.
    s = np.linspace(1e-3, rounded.length - 1e-3, 60)
    h = 1e-6
    turned = log(rounded.orientation(s + h) @ np.swapaxes(rounded.orientation(s - h), 1, 2)) / (
        2 * h
    )
    rates = rounded.orientation.rates(s)[0]
    if axis_only:
        axis = rounded.orientation(s)[:, :, 2]
        turned, rates = (
            x - np.sum(x * axis, axis=1, keepdims=True) * axis for x in (turned, rates)
        )
    np.testing.assert_allclose(rates, turned, atol=1e-4 * np.abs(rates).max())
