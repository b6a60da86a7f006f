"""Splines as chains of transitions, against scipy's cubic spline."""

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation
from tests.geometry.tables import each, refused

import armcontour as ac

RANDOM = np.random.default_rng(0)
CURVES = {
    "two points": ([(0, 0), (1, 0.5)], False),
    "two points in space": ([(0, 0, 0), (1, 0.5, 0.2)], False),
    "on a line": ([(0, 0), (1, 0), (2, 0), (5, 0)], False),
    "plane": (RANDOM.normal(size=(12, 2)), False),
    "space": (RANDOM.normal(size=(12, 3)), False),
    "square": ([(0, 0), (1, 0), (1, 1), (0, 1), (0, 0)], True),
    "closed in space": ([*(p := RANDOM.normal(size=(8, 3))), p[0]], True),
    "sharp zigzag": ([(0, 0), (1, 0), (0, 1e-3), (1, 2e-3), (0, 3e-3)], False),
    "near duplicates": ([(0, 0), (1, 0), (1, 1e-6), (2, 1), (2 + 2e-9, 1)], False),
    "small": (1e-3 * RANDOM.normal(size=(6, 3)), False),
}


def scipys(points, closed):
    points = np.array(points, dtype=float)
    parameter = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    if closed:
        points[-1] = points[0]
    return CubicSpline(parameter, points, bc_type="periodic" if closed else "natural"), parameter


@each("tolerance", [1e-4, 1e-7])
@each("name", CURVES)
def test_paths_stay_within_their_tolerance_of_the_spline(name, tolerance):
    points, closed = CURVES[name]
    path = ac.Path.spline(points, tolerance=tolerance, closed=closed)
    curve, parameter = scipys(points, closed)
    dense = curve(np.linspace(parameter[0], parameter[-1], 2001))
    # Compared at nine places of every interval: between them it may be a little more.
    assert path.project(dense).distance.max() <= 1.1 * tolerance
    assert path.project(np.array(points, dtype=float)).distance.max() < 1e-12
    # And the other way round: no transition leaves the spline.
    back = np.linalg.norm(path(np.linspace(0, path.length, 250))[:, None] - dense, axis=2)
    assert (
        back.min(axis=1).max() <= tolerance + np.linalg.norm(np.diff(dense, axis=0), axis=1).max()
    )
    assert path.turns.max(initial=0.0) < 1e-12
    assert len(path.stops) == 0
    ends = path.vertices[[0, -1]]
    np.testing.assert_allclose(ends, np.array(points)[[0, -1]], atol=1e-12)


def test_a_closed_spline_is_smooth_at_its_start():
    points, _ = CURVES["square"]
    closed = ac.Path.spline(points, closed=True)
    np.testing.assert_allclose(closed(0.0, 1), closed(closed.length, 1), atol=1e-12)
    # By symmetry the square's spline has its tangents along the diagonals at the corners.
    np.testing.assert_allclose(closed(0.0, 1), np.array([1, -1]) / np.sqrt(2), atol=1e-12)


@each("name", ["plane", "space", "square", "closed in space", "small"])
def test_the_curvature_of_a_spline_equals_that_of_scipy_and_is_continuous(name):
    points, closed = CURVES[name]
    path = ac.Path.spline(points, closed=closed)
    inner = path.breaks[1:-1]
    before, right = (path(inner, 2, side=side) for side in ("left", "right"))
    size = np.linalg.norm(path(inner, 2), axis=1).max()
    assert np.linalg.norm(before - right, axis=1).max() < 1e-12 * size
    if closed:
        np.testing.assert_allclose(
            path(0.0, 2), path(path.length, 2, side="left"), atol=1e-9 * size
        )
    curve, parameter = scipys(points, closed)
    first = curve(parameter[1:-1], 1)
    second = curve(parameter[1:-1], 2)
    tangent = first / np.linalg.norm(first, axis=1, keepdims=True)
    across = second - np.sum(second * tangent, axis=1, keepdims=True) * tangent
    bend = across / np.sum(first**2, axis=1, keepdims=True)
    curvature = path(path.breaks[path.waypoints][1:-1], 2)
    np.testing.assert_allclose(curvature, bend, rtol=1e-9, atol=1e-9 * size)
    # The parameter is the arc length within a millionth.
    speed = np.linalg.norm(path(np.linspace(0, path.length, 9001), 1), axis=1)
    assert np.abs(speed - 1).max() < 1e-6


def test_a_tool_that_follows_a_spline_in_space_does_not_stop():
    path = ac.Path.spline(WAYPOINTS).following_tangent([0, 0, 1])
    assert len(path.stops) == 0 and len(path) > 10
    breaks = path.breaks[1:-1]
    np.testing.assert_allclose(path.orientation(breaks)[:, :, 0], path(breaks, 1), atol=1e-9)
    s = np.linspace(0, path.length, 999)
    axes = path.orientation(s)[:, :, 0]
    tangents = path(s, 1)
    assert np.linalg.norm(axes - tangents, axis=1).max() < 1e-3
    # It does not turn about the tangent.
    rates, _ = path.orientation.rates(s)
    assert np.abs(np.sum(rates * tangents, axis=1)).max() < 2e-3 * np.abs(rates).max()
    assert len(ac.round_corners(path, tolerance=1e-3, angular_tolerance=0.1).stops) == 0


def test_repeated_points_are_merged_and_speeds_and_collinear_points_kept():
    segment_limits = ac.SegmentLimits(speed=0.1, tolerance=1e-3, tag="seam")
    path = ac.Path.spline([(0, 0), (1, 0), (1, 0), (2, 1)], segment_limits=segment_limits)
    assert path.merged == (2,)
    assert set(path.speeds) == {0.1} and set(path.tags) == {"seam"}
    plain = ac.Path.spline([(0, 0), (1, 0), (2, 1)])
    np.testing.assert_array_equal(path.starts, plain.starts)
    flat = [(0, 0), (1, 0), (2, 0), (5, 0)]
    path = ac.Path.spline(flat)
    np.testing.assert_allclose(path.vertices[path.waypoints], flat)


def test_invalid_splines_are_refused():
    options = (
        ([(0, 0)], {}, "at least two different points"),
        ([(0, 0), (0, 0)], {}, "at least two different points"),
        ([(0, 0), (1, 0)], {"tolerance": 0.0}, "tolerance must"),
        ([(0, 0), (1, 0), (1, 1)], {"closed": True}, "must end at its first point"),
        ([(0, 0), (1, np.inf)], {}, "finite"),
        ([(0, 0), (1, 0), (0, 0)], {}, "reverses its direction near"),
        ([(0, 0), (1, 0), (0.2, 0), (1, 0)], {}, "reverses its direction near"),
    )
    refused(*((lambda x=x, y=y: ac.Path.spline(x, **y), word) for x, y, word in options))


WAYPOINTS = np.array([(0.4, -0.2, 0.3), (0.5, -0.1, 0.35), (0.5, 0.2, 0.3), (0.4, 0.25, 0.4)])
TURNS = Rotation.from_rotvec([[0, 0, 0], [0.2, 0.1, 0.3], [0, 0.3, 0.1], [0.1, 0, -0.2]])


@each("closed", [False, True])
def test_an_orientation_per_point_is_interpolated_without_stops(closed):
    points = WAYPOINTS
    turns = TURNS
    if closed:
        points = np.vstack([points, points[:1]])
        turns = TURNS[[0, 1, 2, 3, 0]]
    plain = ac.Path.spline(points, closed=closed)
    waypoints = plain.breaks[plain.waypoints]
    assert len(plain) > 20 and len(waypoints) == len(points)
    np.testing.assert_allclose(plain(waypoints), points, atol=1e-12)
    path = plain.oriented(turns)
    np.testing.assert_allclose(path.orientation(waypoints), turns.as_matrix(), atol=1e-12)
    # Between two points the rate is continuous, so there is neither a stop nor a corner to round.
    assert len(path.stops) == 0
    rounded = ac.round_corners(path, tolerance=1e-3, angular_tolerance=0.01)
    assert len(rounded.stops) == 0
    s = np.linspace(0, path.length, 999)
    np.testing.assert_allclose(rounded.orientation(s), path.orientation(s), atol=1e-12)
