"""Corners as parabolas: closed forms, short lines, stops, orientation."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.geometry.tables import each, line, path_of

import armcontour as ac
from armcontour.geometry import count_full_stops, round_path

TURNS = [1e-7, 0.01, 0.5, np.pi / 2, 2.5, 3.1]


def corner(turn, leg=10.0):
    """One corner at the origin between two legs."""
    return ac.Path.polyline([(-leg, 0), (0, 0), (leg * np.cos(turn), leg * np.sin(turn))])


def bezier(path, length, n=2001):
    """Points of the quadratic Bézier curve across the corner of a path of two lines."""
    a, v, b = path.vertices
    p0 = v - length * path.tangents[0]
    p2 = v + length * path.tangents[1]
    t = np.linspace(0, 1, n)[:, None]
    return (1 - t) ** 2 * p0 + 2 * t * (1 - t) * v + t**2 * p2


@each("turn", TURNS)
def test_the_arcs_follow_the_parabola(turn):
    error = min(0.005, turn)
    path = corner(turn)
    rounded = round_path(path, tolerance=error, curve="parabola")
    c = rounded.corners
    half = turn / 2
    leg = min(2 * error / np.sin(half), 10.0)
    assert c.tangent[0] == pytest.approx(leg, rel=1e-9)
    assert c.error[0] == pytest.approx(leg * np.sin(half) / 2, rel=1e-9)
    assert c.radius[0] == pytest.approx(leg * np.cos(half) ** 2 / np.sin(half), rel=1e-7)
    assert rounded.project(bezier(path, leg)).distance.max() < 3e-4 * c.error[0] + 1e-15
    assert rounded.project([(0.0, 0.0)]).distance[0] == pytest.approx(c.error[0], rel=1e-9)
    assert len(rounded.stops) == 0
    # No point is farther from the lines than the apex.
    far = path.project(rounded(np.linspace(c.start[0], c.end[0], 4001))).distance.max()
    assert far <= c.error[0] * np.cos(turn / 2) + 1e-14


def test_parabolas_keep_the_plane_and_speeds_and_corners_next_to_arcs():
    flat = np.array([(0.350, 0.100), (0.410, 0.150), (0.280, 0.300), (0.350, 0.350)])
    basis = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0][:, :2]
    plane = round_path(ac.Path.polyline(flat), tolerance=5e-3, curve="parabola")
    space = round_path(ac.Path.polyline(flat @ basis.T), tolerance=5e-3, curve="parabola")
    s = np.linspace(0, plane.length, 301)
    np.testing.assert_allclose(space(s), plane(s) @ basis.T, atol=1e-14)
    # Speeds, tolerances and tags are those of the lines.
    first = line((0, 0), (1, 0), speed=0.2, tolerance=1e-3, tag="x")
    path = path_of(first, line((1, 0), (1, 1), speed=0.1, tag="x"))
    rounded = round_path(path, tolerance=0.1, curve="parabola")
    assert rounded.corners.error[0] == pytest.approx(1e-3)
    assert rounded.speeds[0] == 0.2 and (rounded.speeds[1:] == 0.1).all()
    assert set(rounded.tags) == {"x"} and (rounded.tolerances[:-1] == 1e-3).all()
    # `place` maps a vertex to the middle of its corner.
    path = ac.Path.polyline([(0, 0), (1, 0), (1, 1), (2, 1)])
    rounded = round_path(path, tolerance=[0.02, 0.05], curve="parabola")
    distances = np.linalg.norm(rounded(rounded.place(path.breaks)) - path.vertices, axis=1)
    np.testing.assert_allclose(distances, [0, 0.02, 0.05, 0], atol=1e-12)
    # Corners next to arcs equal those of round_corners.
    path = path_of(ac.Arc.through((0, 0), (1, 0.3), (2, 0)), line((2, 0), (3, 0)))
    parabola, same = (round_path(path, tolerance=0.01, curve=x) for x in ("parabola", "arc"))
    np.testing.assert_array_equal(parabola.starts, same.starts)
    np.testing.assert_array_equal(parabola.corners.error, same.corners.error)
    # A parabola too tight to draw stays a corner.
    for less, reason in ((5e-4, "no room"), (1e-3, None)):
        rounding = round_path(corner(np.pi - less), tolerance=0.005, curve="parabola")
        assert rounding.corners.reason.tolist() == [reason] and (len(rounding) == 2) == bool(reason)


def test_parabolas_shrink_on_short_lines_and_stop_like_arcs():
    path = ac.Path.polyline([(0, 0), (1, 0), (1, 0.01), (2, 0.01)])
    c = round_path(path, tolerance=0.1, curve="parabola").corners
    np.testing.assert_allclose(c.tangent, 0.005, rtol=1e-12)
    assert c.shrunk.all() and (c.error < 0.1).all()
    uneven = round_path(path, tolerance=[1e-3, 0.1], curve="parabola").corners
    legs = 2e-3 / np.sin(np.pi / 4)
    np.testing.assert_allclose(uneven.tangent, [legs, 0.01 - legs], rtol=1e-12)
    path = ac.Path.polyline([(0, 0), (1, 0), (1, 1), (0, 1), (0.5, 1), (2, 3)])
    tolerance = [0.0, 0.01, 0.01, 0.01]
    parabolas = round_path(path, tolerance=tolerance, curve="parabola")
    arcs = ac.round_corners(path, tolerance=tolerance)
    assert parabolas.corners.reason.tolist() == arcs.corners.reason.tolist()
    assert parabolas.corners.reason.tolist() == ["tolerance zero", None, "turn-back", None]
    assert count_full_stops(parabolas) == {"tolerance zero": 1, "turn-back": 1}


def test_a_rotating_tool_stays_within_its_angular_tolerance():
    path = ac.Path.polyline([(0, 0, 0), (1, 0, 0), (1, 1, 0), (1, 1, 1)])
    path = path.pointing([(0, 0, -1), (0, 1, -1), (1, 0, -1), (1, 0, 0)])
    rounded = round_path(path, tolerance=0.05, angular_tolerance=0.02, curve="parabola")
    c = rounded.corners
    assert len(rounded.stops) == 0 and (c.angular_error <= 0.02 * (1 + 1e-9)).all()
    assert c.angular_error.max() == pytest.approx(0.02, rel=1e-3)
    assert (c.error < 0.05).all()
    path = ac.Path.polyline([(0, 0, 0), (1, 0, 0), (1, 1, 0)]).following_tangent((0, 0, 1))
    rounded = round_path(path, tolerance=0.05, angular_tolerance=0.02, curve="parabola")
    s = np.linspace(0, rounded.length, 2001)
    along = rounded.orientation(s)[:, :, 0]
    angles = np.arccos(np.clip(np.sum(along * rounded(s, 1), axis=1), -1, 1))
    assert len(rounded.stops) == 0 and angles.max() <= 0.02


@given(st.integers(0, 2**32 - 1), st.sampled_from([2, 3]))
def test_random_polylines_stay_within_the_tolerance_in_both_directions(seed, dimension):
    rng = np.random.default_rng(seed)
    points = np.cumsum(rng.normal(size=(6, dimension)) * 10.0 ** rng.uniform(-3, 0), axis=0)
    path = ac.Path.polyline(points)
    tolerance = rng.choice([0.0, 1e-4, 1e-2], size=4)
    rounded = round_path(path, tolerance=tolerance, curve="parabola")
    c = rounded.corners
    assert (c.error <= tolerance * (1 + 1e-12)).all()
    # Project to the two lines of the corner only, because a crossing line may be nearer.
    for i in np.flatnonzero(~c.stopped):
        corner_path = ac.Path.polyline(points[i : i + 3])
        s = np.linspace(c.start[i], c.end[i], 301)
        assert corner_path.project(rounded(s)).distance.max() <= c.error[i] + 1e-13
        gap = np.linalg.norm(rounded((c.start[i] + c.end[i]) / 2) - c.point[i])
        assert gap == pytest.approx(c.error[i], rel=1e-9)
    assert len(rounded.stops) == c.stopped.sum()
