"""Parts of paths; joined, placed and reversed paths; transitions."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation
from tests.geometry.tables import arc, each, jumps, line, path_of, refused

import armcontour as ac
from armcontour.core.frames import Frame
from armcontour.geometry.biarcs import UNEVEN
from armcontour.geometry.path import cut_path, drop_z

TURN = 1.2
END = (1 + 0.5 * np.sin(TURN), 0.5 - 0.5 * np.cos(TURN))
PLANE = path_of(
    line((0, 0), (1, 0), speed=0.1, tag="in"),
    arc((1, 0), (1, 0.5), TURN, segment_limits=ac.SegmentLimits(tolerance=1e-3)),
    line(END, (0, 2), speed=0.2, tag="out"),
)
SPACE = path_of(
    line((0, 0, 0), (1, 0, 0)),
    arc((1, 0, 0), (1, 0.5, 0), TURN, normal=(0, 0, 1)),
    line((*END, 0), (0, 2, 1)),
    line((0, 2, 1), (1, 2, 1)),
)
TURNS = Rotation.from_rotvec(
    [[0, 0, 0], [0.1, 0.2, 0.3], [0.5, 0, 0], [0, 0.3, 0.1], [0.2, 0.2, 0.2]]
)
BENT = {"tolerance": 0.01, "angular_tolerance": 0.05, "continuity": "curvature"}
HELD = {
    "plane": PLANE,
    "space": SPACE,
    "turning": SPACE.oriented(TURNS),
    "pointing": SPACE.pointing(TURNS.as_matrix()[:, :, 2]),
    "following": SPACE.following_tangent((0, 0, 1)),
    "rounded": ac.round_corners(SPACE.oriented(TURNS), tolerance=0.01, angular_tolerance=0.05),
    "rounded, following": ac.round_corners(
        SPACE.following_tangent((0, 0, 1)), tolerance=0.01, angular_tolerance=0.05
    ),
    "transitions": ac.round_corners(PLANE, tolerance=0.01, continuity="curvature"),
    "transitions, turning": ac.round_corners(SPACE.oriented(TURNS), **BENT),
    "transitions, following": ac.round_corners(SPACE.following_tangent((0, 0, 1)), **BENT),
}
held = each("path", list(HELD.values()))
# Between joints, where there is no side to choose.
SHARES = np.linspace(0, 1, 778)[1:-1]


def alike(path, other, s, other_s, *, direction=1):
    """Two paths have the same points, tangents and orientation at these places of theirs."""
    np.testing.assert_allclose(path(s), other(other_s), atol=1e-12)
    np.testing.assert_allclose(path(s, 1), direction * other(other_s, 1), atol=1e-9)
    np.testing.assert_allclose(path(s, 2), other(other_s, 2), rtol=1e-8, atol=1e-7)
    assert (path.orientation is None) == (other.orientation is None)
    if path.orientation is not None:
        np.testing.assert_allclose(path.orientation(s), other.orientation(other_s), atol=1e-9)


@held
@settings(max_examples=10)
@given(cut=st.lists(st.floats(0, 1), min_size=2, max_size=2).map(sorted))
def test_a_part_of_a_path_equals_the_path_between_two_arc_lengths(path, cut):
    begin, end = np.array(cut) * path.length
    if end - begin <= 1e-6:
        return
    part = cut_path(path, begin, end)
    assert part.length == pytest.approx(end - begin, abs=3e-9)
    s = SHARES * part.length
    alike(part, path, s, begin + s)


@held
def test_the_joined_parts_of_a_path_equal_the_path(path):
    cuts = np.array([0, 0.31, 0.62, 1]) * path.length
    first, *others = [cut_path(path, a, b) for a, b in zip(cuts, cuts[1:], strict=False)]
    joined = first.joined(*others)
    assert joined.length == pytest.approx(path.length, rel=1e-12)
    alike(joined, path, SHARES * path.length, SHARES * path.length)
    assert path.joined() is path


def test_invalid_cuts_joins_placements_and_projections_are_refused():
    flat = ac.Path.polyline([(0, 0), (1, 0)])
    far = ac.Path.polyline([(2, 0), (3, 0)])
    one = flat.lifted()
    corner = ac.Path.polyline([[0, 0], [1, 0], [1, 1]])
    other = ac.Path.polyline([(1, 0, 0), (2, 0, 0)]).oriented(Rotation.identity())
    leaning = path_of(arc((1, 0, 0), (0, 0, 0), 1, normal=(0, 1, 0)))
    up = ac.Path.polyline([(0, 0, 0), (0, 0, 1)])
    refused(
        (lambda: cut_path(PLANE, -0.1, 1), "begin", "within the path", {"allowed": PLANE.length}),
        (lambda: cut_path(PLANE, 0, 9), "end of a part", {"s": 9.0}),
        (lambda: cut_path(PLANE, 0.5, 0.5), "has no length"),
        (lambda: cut_path(PLANE, 0.5, 0.2), "has no length"),
        # Next to nothing on both sides of a joint.
        (lambda: cut_path(corner, 1 - 0.8e-9, 1 + 0.8e-9), "has no length"),
        (lambda: flat.joined(far), "must be continuous"),
        (lambda: flat.joined(one), "plane or all in space"),
        (lambda: one.joined(other), "orientation, or none"),
        (lambda: PLANE.placed(FLAT, scale=0.0), "scale"),
        (lambda: drop_z(leaning), "Segment 1", "not parallel to this plane", {"index": 0}),
        (lambda: drop_z(up), "path is vertical"),
    )


FRAME = Frame(position=[1, 2, 3], rotation=Rotation.from_rotvec([0.3, -0.2, 0.9]).as_matrix())
FLAT = Frame(position=[1, 2, 0], rotation=Rotation.from_rotvec([0, 0, 0.9]).as_matrix())


@each("path, scale", [(x, scale) for x in HELD.values() for scale in (1.0, 0.25)])
def test_a_placed_path_has_the_coordinates_of_its_frame(path, scale):
    placed = path.placed(FRAME, scale=scale)
    s = SHARES * path.length
    expected = (FRAME.rotation @ (scale * path.lifted()(s)).T).T + FRAME.position
    assert placed.length == pytest.approx(scale * path.length, rel=1e-12)
    np.testing.assert_allclose(placed(scale * s), expected, atol=1e-12)
    if path.orientation is not None:
        turned = FRAME.rotation @ path.orientation(s)
        np.testing.assert_allclose(placed.orientation(scale * s), turned, atol=1e-9)


def test_a_planar_path_stays_planar_if_its_frame_is_planar():
    assert FLAT.is_planar_transform and not FRAME.is_planar_transform
    placed = PLANE.placed(FLAT, scale=2.0)
    s = SHARES * PLANE.length
    assert placed.dimension == 2
    expected = 2 * PLANE(s) @ FLAT.rotation[:2, :2].T + FLAT.position[:2]
    np.testing.assert_allclose(placed(2 * s), expected, atol=1e-12)
    np.testing.assert_array_equal(placed.tags, PLANE.tags)
    np.testing.assert_array_equal(placed.speeds, PLANE.speeds)
    # In space and back.
    there = PLANE.lifted()
    assert there.dimension == 3 and there.lifted() is there and drop_z(PLANE) is PLANE
    np.testing.assert_array_equal(there(s), np.pad(PLANE(s), ((0, 0), (0, 1))))
    np.testing.assert_allclose(drop_z(there)(s), PLANE(s), atol=1e-15)
    assert drop_z(there).tags == PLANE.tags
    # A flattened path is its shadow: what only goes up and down is gone.
    up = ac.Path.polyline([(0, 0, 0), (0, 0, 1), (1, 0, 1), (1, 1, 2), (1, 1, 0)])
    placed = drop_z(up)
    np.testing.assert_allclose(placed.vertices, [(0, 0), (1, 0), (1, 1)], atol=1e-15)
    np.testing.assert_allclose(placed.lengths, [1, 1])


@held
def test_a_reversed_path_has_the_same_points_in_reverse_order(path):
    reversed_path = path.reversed()
    s = SHARES * path.length
    alike(reversed_path, path, s, path.length - s, direction=-1)
    assert reversed_path.tags == path.tags[::-1]
    np.testing.assert_array_equal(reversed_path.speeds, path.speeds[::-1])
    np.testing.assert_array_equal(reversed_path.tolerances, path.tolerances[::-1])
    np.testing.assert_allclose(reversed_path.stops, (path.length - path.stops)[::-1], atol=1e-12)
    np.testing.assert_array_equal(reversed_path.waypoints, len(path) - path.waypoints[::-1])
    alike(reversed_path.reversed(), path, s, s)


# What rounding makes of an even turning differs a little with the direction.


def test_part_of_a_path_that_follows_its_tangent_is_rounded_like_the_whole():
    # Rounding takes a piece's start for its rotation, so a part must begin with its own.
    bend = arc((0.1, 0, 0), (0.1, 0.05, 0), 1.2, normal=(0, 0, 1))
    path = path_of(line((0, 0, 0), (0.1, 0, 0)), bend).following_tangent((0, 0, 1))
    begin = 0.1 + 0.02
    fine = {"tolerance": 1e-3, "angular_tolerance": 1e-3}
    cut = ac.round_corners(cut_path(path, begin, path.length), **fine)
    s = np.linspace(0, cut.length, 20)
    np.testing.assert_allclose(cut.orientation(s), path.orientation(s + begin), atol=2e-3)
    whole = ac.round_corners(path, **fine)
    again = cut_path(whole, 0.03, 0.11)
    positions = np.linspace(0, again.length, 40)
    np.testing.assert_allclose(
        again.orientation(positions), whole.orientation(positions + 0.03), atol=1e-12
    )
    assert again.orientation.f[0, 0] == 0.0


def places(path, n=4001):
    return np.linspace(0, path.length, n)


@given(
    turn=st.floats(1e-5, np.pi - 1e-3),
    error=st.floats(1e-6, 1e-2),
    legs=st.tuples(st.floats(1e-3, 1.0), st.floats(1e-3, 1.0)),
    tilt=st.floats(0, 6),
)
# Just above the largest turns of one and of two quintics in each half.
@example(turn=0.0969, error=1e-3, legs=(1.0, 1.0), tilt=0)
@example(turn=0.0207, error=1e-3, legs=(1.0, 1.0), tilt=0)
def test_a_smooth_corner_keeps_its_error_and_its_curvature_is_continuous(turn, error, legs, tilt):
    a, b = legs
    points = np.array([(-a, 0, 0), (0, 0, 0), (b * np.cos(turn), b * np.sin(turn), 0)])
    points = points @ Rotation.from_euler("xyz", (tilt, 1, 2)).as_matrix().T + [0.3, 0.2, 0.1]
    path = ac.round_corners(ac.Path.polyline(points), tolerance=error, continuity="curvature")
    c = path.corners
    assert c.error[0] <= error * (1 + 1e-12)
    assert c.shrunk[0] or c.error[0] == pytest.approx(error, rel=1e-12)
    assert c.tangent[0] <= min(legs) * (1 + 1e-12)
    middle = path((c.start + c.end) / 2)[0]
    assert np.linalg.norm(middle - points[1]) == pytest.approx(c.error[0], rel=1e-11, abs=1e-15)
    near = np.linalg.norm(path(places(path)) - points[1], axis=1).min()
    assert near >= c.error[0] * (1 - 1e-9) - 1e-15
    assert jumps(path, 1).max() < 1e-12
    assert jumps(path, 2).max() < 1e-12
    assert np.linalg.norm(path(c.start, 2)) < 1e-9 / c.radius[0]
    speed = np.linalg.norm(path(places(path), 1), axis=1)
    assert np.abs(speed - 1).max() < UNEVEN
    assert len(path.stops) == 0


@each("turn", [0.3, np.pi / 2, 2.6])
def test_a_smooth_corner_has_the_stated_curvature(turn):
    # The curve whose curvature is (1 - x²)² / r, by another integration.
    points = [(-1, 0), (0, 0), (np.cos(turn), np.sin(turn))]
    path = ac.round_corners(ac.Path.polyline(points), tolerance=0.02, continuity="curvature")
    c = path.corners
    size = c.end[0] - c.start[0]
    assert size == pytest.approx(c.radius[0] * turn * 15 / 8, rel=1e-12)

    def change(s, y):
        x = 2 * s / size - 1
        return np.cos(y[2]), np.sin(y[2]), (1 - x * x) ** 2 / c.radius[0]

    s = np.linspace(0, size, 60)
    start = [-c.tangent[0], 0, 0]
    integrated = solve_ivp(change, (0, size), start, t_eval=s, rtol=1e-12, atol=1e-14).y[:2].T
    # Off by the quintics, far below any tolerance.
    assert np.abs(path(c.start[0] + s) - integrated).max() < 2e-7 * size
    bend = np.linalg.norm(path(c.start[0] + s, 2), axis=1)
    curvature = (1 - (2 * s / size - 1) ** 2) ** 2 / c.radius[0]
    assert np.abs(bend - curvature).max() < 1e-4 / c.radius[0]


def test_neighbouring_corners_share_their_line_or_stay_sharp():
    path = ac.Path.polyline([(0, 0), (0.1, 0), (0.1, 0.01), (0.2, 0.01)])
    corners = ac.round_corners(path, tolerance=0.02, continuity="curvature").corners
    np.testing.assert_allclose(corners.tangent, 0.005, rtol=1e-12)
    assert corners.shrunk.all() and corners.reason.tolist() == [None, None]
    points = [(0, 0), (0.1, 0), (0, 0), (0, 0.1), (1e-9, 0.1 + 2e-9), (0.1, 0.1)]
    for continuity in ("tangent", "curvature"):
        sharp = ac.round_corners(ac.Path.polyline(points), tolerance=1e-3, continuity=continuity)
        assert sharp.corners.reason[0] == "turn-back"
    assert "no room" in sharp.corners.reason


@each("offset", [-0.9e-9, -1e-11, 0.0, 1e-11, 0.9e-9])
def test_a_part_that_begins_at_a_vertex_can_be_rounded_with_its_orientation(offset):
    path = ac.Path.polyline([[0, 0, 0], [0.05, 0.05, 0], [0.1, 0, 0], [0.2, 0, 0]])
    turning = path.pointing([[0, 0, -1], [0.1, 0, -1], [0, 0.1, -1], [0, 0, -1]])
    for cut in (
        cut_path(turning, turning.breaks[1] + offset, turning.length),
        cut_path(turning, 0.0, turning.breaks[2] + offset),
    ):
        np.testing.assert_array_equal(cut.orientation.breaks, cut.breaks)
        ac.round_corners(cut, tolerance=1e-3, angular_tolerance=0.1)
