"""Corner rounding: closed forms of one corner, shrinking, and refusals."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.geometry.tables import arc, each, line, path_of, refused

import armcontour as ac
from armcontour.geometry import corner_error, count_full_stops

TURNS = [0.01, 0.5, np.pi / 2, 2.5, 3.1]


def corner(turn, leg=10.0):
    """One corner at the origin between two legs of 10 m."""
    return ac.Path.polyline([(-leg, 0), (0, 0), (leg * np.cos(turn), leg * np.sin(turn))])


@each("turn", TURNS)
def test_a_tolerance_gives_the_largest_radius_of_equation_15(turn):
    error = 0.01
    rounded = ac.round_corners(corner(turn), tolerance=error, acceleration=0.09)
    cosine = np.cos(turn / 2)
    radius = error * cosine / (1 - cosine)  # (15) as printed
    assert rounded.corners.radius[0] == pytest.approx(radius, rel=1e-9)
    assert rounded.corners.speed[0] == pytest.approx(np.sqrt(0.09 * radius), rel=1e-9)  # (16)
    assert rounded.corners.tangent[0] == pytest.approx(radius * np.tan(turn / 2), rel=1e-9)
    assert not rounded.corners.shrunk[0]
    # (11), measured on the drawn path: the gap between corner and arc.
    middle = rounded((rounded.corners.start[0] + rounded.corners.end[0]) / 2)
    assert np.linalg.norm(middle) == pytest.approx(error, rel=1e-9)
    assert rounded.project([(0.0, 0.0)]).distance[0] == pytest.approx(error, rel=1e-9)


@each("turn", TURNS)
def test_a_speed_gives_the_radius_of_13_and_the_error_of_14(turn):
    v = 0.03
    a = 0.09
    rounded = ac.round_corners(corner(turn), speed=v, acceleration=a)
    cosine = np.cos(turn / 2)
    assert rounded.corners.radius[0] == pytest.approx(v**2 / a, rel=1e-12)  # (13)
    error = v**2 * (1 - cosine) / (a * cosine)  # (14) as printed
    assert rounded.corners.error[0] == pytest.approx(error, rel=1e-9)
    assert rounded.corners.speed[0] == pytest.approx(v, rel=1e-12)


def test_both_cases_are_capped_by_the_tolerance_and_tiny_turns_keep_their_digits():
    path = corner(np.pi / 2)
    case_one = {"speed": 0.3, "acceleration": 0.09}
    free = ac.round_corners(path, **case_one).corners
    capped = ac.round_corners(path, **case_one, tolerance=0.01).corners
    assert free.error[0] > 0.01 and capped.speed[0] < 0.3
    assert capped.error[0] == pytest.approx(0.01)
    loose = ac.round_corners(path, **case_one, tolerance=100.0).corners
    np.testing.assert_array_equal(loose.radius, free.radius)
    # (10): r (1 - cos h) / cos h is r h² / 2 for small h; printed, it cancels to nothing.
    error = corner_error(np.array([2.0]), np.array([1e-9]))
    assert error[0] == pytest.approx(1e-18, rel=1e-12)


def test_values_of_joints_and_segments_cap_the_corners():
    path = ac.Path.polyline([(0, 0), (1, 0), (1, 1), (0, 1), (0, 2)])
    corners = ac.round_corners(path, tolerance=[0.01, 0.0, 0.02]).corners
    np.testing.assert_allclose(corners.error, [0.01, 0, 0.02], atol=1e-15)
    np.testing.assert_array_equal(corners.stopped, [False, True, False])
    np.testing.assert_array_equal(corners.vertex, [1, 2, 3])
    np.testing.assert_array_equal(corners.point, [(1, 0), (1, 1), (0, 1)])
    points = (0, 0), (1, 0), (1, 1), (0, 1)
    values = {"speed": 0.2}, {"speed": 0.1, "tolerance": 2e-3}, {"tolerance": 1e-3}
    lines = (line(a, b, tag="x", **x) for a, b, x in zip(points, points[1:], values, strict=False))
    rounded = ac.round_corners(path_of(*lines), tolerance=1.5e-3)
    np.testing.assert_allclose(rounded.corners.error, [1.5e-3, 1e-3])
    assert rounded.tags == ("x",) * 5
    np.testing.assert_array_equal(rounded.speeds, [0.2, 0.1, 0.1, 0.1, np.nan])


def test_zero_tolerance_straight_vertices_and_turn_backs_stay_sharp():
    path = ac.Path.polyline([(0, 0), (1, 0), (1, 1), (2, 1)])
    before = path.starts.copy(), path.lengths.copy()
    rounded = ac.round_corners(path, tolerance=0.0)
    assert len(rounded) == 3 and rounded.corners.stopped.all()
    np.testing.assert_array_equal(rounded.stops, path.stops)
    np.testing.assert_array_equal(rounded.starts, path.starts)
    # The input is left alone.
    ac.round_corners(path, tolerance=0.1)
    np.testing.assert_array_equal(path.starts, before[0])
    np.testing.assert_array_equal(path.lengths, before[1])
    straight = ac.Path.polyline([(0, 0), (1, 0), (3, 0)])
    rounded = ac.round_corners(straight, tolerance=0.1)
    assert len(rounded.corners) == 0 and rounded.length == straight.length
    np.testing.assert_array_equal(rounded.breaks, straight.breaks)
    assert rounded.objective is straight
    back = ac.round_corners(ac.Path.polyline([(0, 0), (1, 0), (0.5, 0)]), tolerance=0.1).corners
    assert back.turn[0] == pytest.approx(np.pi) and back.stopped[0]
    assert back.reason.tolist() == ["turn-back"]
    with pytest.raises(ValueError, match="read-only"):
        back.radius[0] = 1.0


def bridge():
    """Half a circle between two lines, with a corner of 90° at either end."""
    return path_of(line((0, 0), (1, 0)), arc((1, 0), (2, 0), -np.pi), line((3, 0), (4, 0)))


def test_a_corner_next_to_an_arc_becomes_two_tangent_arcs():
    path = bridge()
    tolerance = 0.05
    rounded = ac.round_corners(path, tolerance=tolerance, acceleration=0.09)
    corners = rounded.corners
    assert len(rounded.stops) == 0 and not corners.shrunk.any()
    assert corners.reason.tolist() == [None, None]
    np.testing.assert_allclose(corners.error, tolerance, rtol=1e-6)
    np.testing.assert_allclose(rounded.project(corners.point).distance, corners.error, rtol=1e-9)
    assert (rounded.turns <= 1e-9).all()
    assert corners.radius[0] == pytest.approx(1 / rounded.curvatures[1:3].max(), rel=1e-12)
    np.testing.assert_allclose(corners.speed, np.sqrt(0.09 * corners.radius))
    # The path is symmetric, and so are its corners.
    np.testing.assert_allclose(corners.tangent[0], corners.tangent[1], rtol=1e-6)
    np.testing.assert_allclose(rounded(rounded.length / 2), (2, 1), atol=1e-9)


def test_corner_at_large_arc_equals_corner_of_lines_and_speed_gives_smallest_blend():
    turn = 1.2
    big = 1e7
    normal = np.array([-np.sin(turn), np.cos(turn)])
    bent = path_of(line((-1, 0), (0, 0)), arc((0, 0), big * normal, 1 / big))
    corners = ac.round_corners(bent, tolerance=1e-3).corners
    straight = ac.round_corners(corner(turn), tolerance=1e-3).corners
    for name in ("radius", "tangent", "error", "start", "end"):
        rest = 9.0 if name in ("start", "end") else 0.0
        expected = getattr(straight, name)[0] - rest
        assert getattr(corners, name)[0] == pytest.approx(expected, rel=1e-5)
    path = bridge()
    v = 0.03
    a = 0.09
    corners = ac.round_corners(path, speed=v, acceleration=a).corners
    np.testing.assert_allclose(corners.radius, v**2 / a, rtol=1e-6)
    np.testing.assert_allclose(corners.speed, v, rtol=1e-6)
    assert not corners.shrunk.any()
    capped = ac.round_corners(path, speed=v, acceleration=a, tolerance=1e-4).corners
    assert (capped.error <= 1e-4).all() and (capped.speed < v).all()


def test_a_rounded_path_reports_its_stops_and_their_reasons():
    path = path_of(line((0, 0), (1, 0)), arc((1, 0), (2, 0), -0.2))
    corners = ac.round_corners(path, tolerance=0.0).corners
    assert corners.stopped.all() and corners.reason.tolist() == ["tolerance zero"]
    path = ac.Path.polyline([(0, 0), (1, 0), (1 + 2e-9, 0), (1 + 2e-9, 1), (0, 1)])
    tiny = ac.round_corners(path, tolerance=[1e-3, 1e-10, 1e-3]).corners
    assert tiny.reason.tolist() == ["no room", None]
    path = ac.Path.polyline([(0, 0, 0), (1, 0, 0), (1, 1, 0), (1, 0.5, 0), (2, 0.5, 0)])
    some, none = (count_full_stops(ac.round_corners(path, tolerance=x)) for x in (0.01, 0.0))
    assert count_full_stops(path) == {"rounding off": 2, "turn-back": 1}
    assert some == {"turn-back": 1} and none == {"tolerance zero": 2, "turn-back": 1}
    turns = Rotation.from_euler("x", [[0.0], [0.1], [0.4]])
    turning = ac.Path.polyline([(0, 0, 0), (1, 0, 0), (2, 0, 0)]).oriented(turns)
    assert count_full_stops(turning) == {"tool orientation": 1}
    assert count_full_stops(bridge()) == {"rounding off": 2}


def test_a_tool_follows_the_tangent_over_corners_next_to_arcs():
    path = ac.Path(segments=bridge().segments.lift()).following_tangent((0, 0, 1))
    rounded = ac.round_corners(path, tolerance=0.05, angular_tolerance=1e-3)
    s = np.linspace(0, rounded.length, 999)
    cosine = np.sum(rounded.orientation(s)[:, :, 0] * rounded(s, 1), axis=1)
    assert np.arccos(np.clip(cosine, -1, 1)).max() <= 1.001e-3
    assert len(rounded.stops) == 0


@each("axis_only", [False, True])
def test_the_orientation_is_rounded_over_corners_next_to_arcs(axis_only):
    held = [(0, 0, 0), (0.1, 0.2, 0), (0.3, -0.1, 0.2), (0.2, 0.1, 0)]
    turned = Rotation.from_euler("xyz", held).as_matrix()
    path = ac.Path(segments=bridge().segments.lift()).oriented(turned, axis_only=axis_only)
    loose = ac.round_corners(path, tolerance=0.05, angular_tolerance=1.0)
    tight = ac.round_corners(path, tolerance=0.05, angular_tolerance=2e-3)
    assert not loose.corners.shrunk.any() and tight.corners.shrunk.any()
    for rounded, allowed in ((loose, 1.0), (tight, 2e-3)):
        assert len(rounded.stops) == 0
        middle = (rounded.corners.start + rounded.corners.end) / 2
        vertex_rotations = path.orientation(path.breaks[rounded.corners.vertex])
        there = rounded.orientation(middle)
        if axis_only:
            cosine = np.sum(there[:, :, 2] * vertex_rotations[:, :, 2], axis=1)
            angle = np.arccos(np.clip(cosine, -1, 1))
        else:
            angle = Rotation.from_matrix(there @ vertex_rotations.transpose(0, 2, 1)).magnitude()
        assert angle.max() <= allowed
        np.testing.assert_allclose(rounded.corners.angular_error, angle, atol=1e-7)


def test_corners_next_to_arcs_of_other_planes_are_rounded():
    first = arc((1, 0, 0), (1, 0, 0.5), 1.5, normal=(0, -1, 0))
    after = path_of(first)
    end = after.vertices[-1]
    ahead = after(after.length, 1, side="left")
    path = path_of(first, line(end, end + np.cross(ahead, (0, 1, 0)) + (0, 1.0, 0)))
    rounded = ac.round_corners(path, tolerance=5e-3)
    assert len(rounded.stops) == 0 and (rounded.turns <= 1e-9).all()
    np.testing.assert_allclose(rounded.corners.error, 5e-3, rtol=1e-6)
    s = np.linspace(0, rounded.length, 500)
    assert path.project(rounded(s)).distance.max() <= 5e-3
    # A frame that follows the tangent there would come round turned: the tool stops instead.
    followed = path.following_tangent((0, 1, 0))
    stopped = ac.round_corners(followed, tolerance=5e-3, angular_tolerance=1e-3).corners
    assert stopped.reason.tolist() == ["tangent followed out of its plane"]


def test_round_corners_refuses_wrong_values_and_warns_of_large_tolerances():
    path = ac.Path.polyline([(0, 0), (1, 0), (1, 1), (0, 1)])
    options = (
        ({}, "tolerance (case II)", "speed and an acceleration (case I)"),
        ({"speed": 0.1}, "case I"),
        ({"acceleration": 0.1}, "case II"),
        ({"tolerance": -1e-3}, "tolerance", "-0.001 m"),
        ({"tolerance": np.nan}, "tolerance", "finite"),
        ({"tolerance": [1e-3] * 3}, "tolerance has 3 values", "2 vertices"),
        ({"tolerance": [[1e-3, 1e-3]]}, "tolerance has 2 values"),
        ({"tolerance": "wide"}, "tolerance", "quantity in m"),
        ({"tolerance": 1e-3, "continuity": "G2"}, "continuity"),
        ({"speed": -0.1, "acceleration": 0.1}, "corner speed", "-0.1 m/s"),
        ({"speed": 0.1, "acceleration": 0.0}, "corner acceleration", "above zero"),
        ({"tolerance": 1e-3, "acceleration": -0.5}, "corner acceleration", "-0.5 m/s²"),
        ({"speed": [0.1], "acceleration": 0.1}, "corner speed has 1 values", "2 vertices"),
    )
    refused(*((lambda x=x: ac.round_corners(path, **x), *more) for x, *more in options))
    path = ac.Path.polyline([(0, 0), (0.1, 0), (0.1, 0.1)])
    with pytest.warns(UserWarning, match="For 2 mm, specify 0.002"):
        ac.round_corners(path, tolerance=2)


def test_a_corner_with_a_jump_of_orientation_is_not_rounded():
    first = ac.Path.polyline([(0, 0, 0), (1, 0, 0)]).pointing((0, 0, -1))
    second = ac.Path.polyline([(1, 0, 0), (1, 1, 0)]).pointing((0, 1, -1))
    rounded = ac.round_corners(first.joined(second), tolerance=0.01)
    assert rounded.corners.reason.tolist() == ["tool orientation"]
    ends = rounded.orientation([0, rounded.length])[:, :, 2]
    np.testing.assert_allclose(ends, [(0, 0, -1), (0, np.sqrt(0.5), -np.sqrt(0.5))], atol=1e-15)
    np.testing.assert_array_equal(rounded.stops, [1.0])
