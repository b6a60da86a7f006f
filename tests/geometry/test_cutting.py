"""Parts of paths, joined, placed, flattened and reversed paths, by their points and orientation."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import armcontour as ac
from armcontour.frames import Frame
from armcontour.geometry.cutting import cut_path, join_paths, reverse_path
from armcontour.geometry.placing import drop_z, keeps_plane, lift_path, place_path

TURN = 1.2
END = (1 + 0.5 * np.sin(TURN), 0.5 - 0.5 * np.cos(TURN))
PLANE = ac.Path.from_segments(
    [
        ac.Line(start=(0, 0), end=(1, 0), demand=ac.Demand(speed=0.1, tag="in")),
        ac.Arc(start=(1, 0), center=(1, 0.5), angle=TURN, demand=ac.Demand(tolerance=1e-3)),
        ac.Line(start=END, end=(0, 2), demand=ac.Demand(speed=0.2, tag="out")),
    ]
)
SPACE = ac.Path.from_segments(
    [
        ac.Line(start=(0, 0, 0), end=(1, 0, 0)),
        ac.Arc(start=(1, 0, 0), center=(1, 0.5, 0), angle=TURN, normal=(0, 0, 1)),
        ac.Line(start=(*END, 0), end=(0, 2, 1)),
        ac.Line(start=(0, 2, 1), end=(1, 2, 1)),
    ]
)
TURNS = Rotation.from_rotvec(
    [[0, 0, 0], [0.1, 0.2, 0.3], [0.5, 0, 0], [0, 0.3, 0.1], [0.2, 0.2, 0.2]]
)
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
}
held = pytest.mark.parametrize("name", HELD)
# Between joints, where there is no side to choose.
SHARES = np.linspace(0, 1, 778)[1:-1]


def alike(path, other, s, at, *, direction=1):
    """Two paths have the same points, tangents and orientation at these places of theirs."""
    np.testing.assert_allclose(path(s), other(at), atol=1e-12)
    np.testing.assert_allclose(path(s, 1), direction * other(at, 1), atol=1e-9)
    assert (path.orientation is None) == (other.orientation is None)
    if path.orientation is not None:
        np.testing.assert_allclose(path.orientation(s), other.orientation(at), atol=1e-9)


@held
@given(cut=st.lists(st.floats(0, 1), min_size=2, max_size=2).map(sorted))
def test_a_part_is_the_path_between_two_places(name, cut):
    path = HELD[name]
    begin, end = np.array(cut) * path.length
    if end - begin <= 1e-6:
        return
    found = cut_path(path, begin, end)
    assert found.length == pytest.approx(end - begin, abs=3e-9)
    s = SHARES * found.length
    alike(found, path, s, begin + s)


def test_a_part_keeps_what_is_asked_of_its_segments():
    found = cut_path(PLANE, 0.5, 1.1)
    assert found.tags == ("in", None) and found.speeds[0] == 0.1
    assert np.isnan(found.speeds[1]) and found.tolerances[1] == 1e-3
    np.testing.assert_allclose(found.lengths, [0.5, 0.1])


def test_the_whole_is_a_part():
    for path in HELD.values():
        found = cut_path(path, 0.0, path.length)
        np.testing.assert_array_equal(found.lengths, path.lengths)
        np.testing.assert_array_equal(found.starts, path.starts)


def test_what_is_no_part_is_refused(refuses):
    refuses(
        lambda: cut_path(PLANE, -0.1, 1),
        ac.InvalidInput,
        "begin",
        "within the path",
        allowed=PLANE.length,
    )
    refuses(lambda: cut_path(PLANE, 0, 9), ac.InvalidInput, "end of a part", s=9.0)
    refuses(lambda: cut_path(PLANE, 0.5, 0.5), ac.InvalidInput, "no path between")
    refuses(lambda: cut_path(PLANE, 0.5, 0.2), ac.InvalidInput, "no path between")


@held
def test_parts_put_together_are_the_path(name):
    path = HELD[name]
    cuts = np.array([0, 0.31, 0.62, 1]) * path.length
    found = join_paths([cut_path(path, a, b) for a, b in zip(cuts, cuts[1:], strict=False)])
    assert found.length == pytest.approx(path.length, rel=1e-12)
    alike(found, path, SHARES * path.length, SHARES * path.length)
    assert join_paths([path]) is path


def test_what_cannot_be_joined_is_refused(refuses):
    line = ac.Path.polyline([(0, 0), (1, 0)])
    far = ac.Path.polyline([(2, 0), (3, 0)])
    refuses(lambda: join_paths([]), ac.InvalidInput, "no path to join")
    refuses(lambda: join_paths([line, far]), ac.InvalidInput, "must be continuous")
    refuses(lambda: join_paths([line, lift_path(line)]), ac.InvalidInput, "plane or all in space")
    one = lift_path(line)
    other = ac.Path.polyline([(1, 0, 0), (2, 0, 0)]).oriented(Rotation.identity())
    refuses(lambda: join_paths([one, other]), ac.InvalidInput, "orientation, or none")


FRAME = Frame(position=[1, 2, 3], rotation=Rotation.from_rotvec([0.3, -0.2, 0.9]).as_matrix())
FLAT = Frame(position=[1, 2, 0], rotation=Rotation.from_rotvec([0, 0, 0.9]).as_matrix())


@held
@pytest.mark.parametrize("scale", [1.0, 0.25])
def test_a_placed_path_is_seen_from_where_its_frame_stands(name, scale):
    path = HELD[name]
    found = place_path(path, FRAME, scale=scale)
    s = SHARES * path.length
    seen = (FRAME.rotation @ (scale * lift_path(path)(s)).T).T + FRAME.position
    assert found.length == pytest.approx(scale * path.length, rel=1e-12)
    np.testing.assert_allclose(found(scale * s), seen, atol=1e-12)
    if path.orientation is not None:
        turned = FRAME.rotation @ path.orientation(s)
        np.testing.assert_allclose(found.orientation(scale * s), turned, atol=1e-9)


def test_a_path_in_the_plane_stays_there_where_its_frame_does():
    assert keeps_plane(FLAT) and not keeps_plane(FRAME)
    found = place_path(PLANE, FLAT, scale=2.0)
    assert found.dimension == 2
    s = SHARES * PLANE.length
    seen = 2 * PLANE(s) @ FLAT.rotation[:2, :2].T + FLAT.position[:2]
    np.testing.assert_allclose(found(2 * s), seen, atol=1e-12)
    np.testing.assert_array_equal(found.tags, PLANE.tags)
    np.testing.assert_array_equal(found.speeds, PLANE.speeds)


def test_a_scale_must_be_above_zero(refuses):
    refuses(lambda: place_path(PLANE, FLAT, scale=0.0), ac.InvalidInput, "scale", "above zero")


def test_in_space_and_back():
    there = lift_path(PLANE)
    assert there.dimension == 3 and lift_path(there) is there and drop_z(PLANE) is PLANE
    s = SHARES * PLANE.length
    np.testing.assert_array_equal(there(s), np.pad(PLANE(s), ((0, 0), (0, 1))))
    np.testing.assert_allclose(drop_z(there)(s), PLANE(s), atol=1e-15)
    assert drop_z(there).tags == PLANE.tags


def test_a_flattened_path_is_its_shadow():
    up = ac.Path.polyline([(0, 0, 0), (0, 0, 1), (1, 0, 1), (1, 1, 2), (1, 1, 0)])
    found = drop_z(up)
    # What only goes up and down is gone.
    np.testing.assert_allclose(found.vertices, [(0, 0), (1, 0), (1, 1)], atol=1e-15)
    np.testing.assert_allclose(found.lengths, [1, 1])


def test_what_has_no_shadow_of_lines_and_arcs_is_refused(refuses):
    arc = ac.Path.from_segments(
        [ac.Arc(start=(1, 0, 0), center=(0, 0, 0), angle=1, normal=(0, 1, 0))]
    )
    refuses(lambda: drop_z(arc), ac.InvalidInput, "Segment 1", "leaves the plane", index=0)
    up = ac.Path.polyline([(0, 0, 0), (0, 0, 1)])
    refuses(lambda: drop_z(up), ac.InvalidInput, "only goes up and down")


@held
def test_a_reversed_path_runs_the_same_way_back(name):
    path = HELD[name]
    found = reverse_path(path)
    s = SHARES * path.length
    alike(found, path, s, path.length - s, direction=-1)
    assert found.tags == path.tags[::-1]
    np.testing.assert_array_equal(found.speeds, path.speeds[::-1])
    np.testing.assert_array_equal(found.tolerances, path.tolerances[::-1])
    np.testing.assert_allclose(found.stops, (path.length - path.stops)[::-1], atol=1e-12)
    np.testing.assert_array_equal(found.waypoints, len(path) - path.waypoints[::-1])


@held
def test_a_path_reversed_twice_is_itself(name):
    path = HELD[name]
    found = reverse_path(reverse_path(path))
    alike(found, path, SHARES * path.length, SHARES * path.length)


# What rounding makes of an even turning differs a little with the direction.
@pytest.mark.parametrize("name", ["plane", "space", "following"])
def test_a_path_can_be_rounded_before_it_is_reversed_or_after(name):
    path, options = HELD[name], {"tolerance": 0.01}
    if path.orientation is not None:
        options["angular_tolerance"] = 0.05
    before = reverse_path(ac.round_corners(path, **options))
    after = ac.round_corners(reverse_path(path), **options)
    s = SHARES * min(before.length, after.length)
    alike(before, after, s, s)


def test_a_reversed_circle_is_the_circle_the_other_way_round():
    circle = ac.Path.from_segments([ac.Arc.circle((1, 0), (0, 0))])
    found = reverse_path(circle)
    np.testing.assert_allclose(found(np.pi / 2), (0, -1), atol=1e-15)
    np.testing.assert_allclose(found([0, found.length]), [(1, 0), (1, 0)], atol=1e-15)


def test_a_part_of_a_path_that_follows_its_tangent_is_rounded_as_the_whole():
    # Rounding takes a piece's start for its rotation, so a part must begin with its own.
    path = ac.Path.from_segments(
        [
            ac.Line(start=(0, 0, 0), end=(0.1, 0, 0)),
            ac.Arc(start=(0.1, 0, 0), center=(0.1, 0.05, 0), angle=1.2, normal=(0, 0, 1)),
        ]
    ).following_tangent((0, 0, 1))
    begin = 0.1 + 0.02
    cut = ac.round_corners(
        cut_path(path, begin, path.length), tolerance=1e-3, angular_tolerance=1e-3
    )
    s = np.linspace(0, cut.length, 20)
    np.testing.assert_allclose(cut.orientation(s), path.orientation(s + begin), atol=2e-3)
    whole = ac.round_corners(path, tolerance=1e-3, angular_tolerance=1e-3)
    again = cut_path(whole, 0.03, 0.11)
    at = np.linspace(0, again.length, 40)
    np.testing.assert_allclose(again.orientation(at), whole.orientation(at + 0.03), atol=1e-12)
    assert again.orientation.f[0, 0] == 0.0


def test_a_part_of_next_to_nothing_on_both_sides_of_a_joint_is_refused(refuses):
    path = ac.Path.polyline([[0, 0], [1, 0], [1, 1]])
    refuses(lambda: cut_path(path, 1 - 0.8e-9, 1 + 0.8e-9), ac.InvalidInput, "no path between")


@pytest.mark.parametrize("off", [-0.9e-9, -1e-11, 0.0, 1e-11, 0.9e-9])
def test_a_part_that_begins_beside_a_joint_can_be_rounded_with_its_orientation(off):
    path = ac.Path.polyline([[0, 0, 0], [0.05, 0.05, 0], [0.1, 0, 0], [0.2, 0, 0]])
    turning = path.pointing([[0, 0, -1], [0.1, 0, -1], [0, 0.1, -1], [0, 0, -1]])
    for cut in (
        cut_path(turning, turning.breaks[1] + off, turning.length),
        cut_path(turning, 0.0, turning.breaks[2] + off),
    ):
        np.testing.assert_array_equal(cut.orientation.breaks, cut.breaks)
        ac.round_corners(cut, tolerance=1e-3, angular_tolerance=0.1)


def test_a_rounded_path_that_is_placed_elsewhere_does_not_remember_old_corners():
    corner = ac.Path.polyline([[0, 0], [1, 0], [1, 1]])
    rounded = ac.round_corners(corner, tolerance=1e-2)
    frame = Frame(position=[1.0, 2.0, 0.0])
    for moved in (place_path(rounded, frame, scale=2.0), lift_path(rounded)):
        assert type(moved) is ac.Path
    found = place_path(rounded, frame, scale=2.0)
    s = np.linspace(0, rounded.length, 9)
    np.testing.assert_allclose(found(2 * s), rounded(s) * 2 + [1.0, 2.0], atol=1e-14)
