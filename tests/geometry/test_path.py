"""Paths: evaluation against independent formulas, two-sidedness, what they merge and refuse."""

from __future__ import annotations

import dataclasses
from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import armcontour as ac
from armcontour.geometry import Segments, angle_between

R = 0.3


def rotated(vector, axis, angle):
    """Rodrigues' rotation by SciPy, which shares nothing with the path's own formula."""
    axis = np.asarray(axis, float) / np.linalg.norm(axis)
    return Rotation.from_rotvec(np.outer(np.atleast_1d(angle), axis)).apply(vector)


def winding_path():
    """In the plane: line, left arc, line, right full circle, line."""
    return ac.Path.from_segments(
        [
            ac.Line(start=(0, 0), end=(1, 0)),
            ac.Arc(start=(1, 0), center=(1, R), angle=np.pi / 2),
            ac.Line(start=(1 + R, R), end=(1 + R, 1)),
            ac.Arc(start=(1 + R, 1), center=(1 + 2 * R, 1), angle=-2 * np.pi),
            ac.Line(start=(1 + R, 1), end=(2, 1.5)),
        ]
    )


def space_path():
    """In space: line, arc about an oblique axis, line on."""
    normal = np.array([1.0, -2.0, 0.5])
    direction = np.cross(normal, [0.3, 0.1, 1.0])
    direction /= np.linalg.norm(direction)
    inward = np.cross(normal, direction) / np.linalg.norm(normal)
    start = np.array([0.1, 0.2, 0.3])
    corner = start + 0.7 * direction
    center = corner + R * inward
    arc = ac.Arc(start=corner, center=center, angle=2.2, normal=normal)
    end = center + rotated(corner - center, normal, 2.2)[0]
    leaving = rotated(direction, normal, 2.2)[0]
    return ac.Path.from_segments(
        [ac.Line(start=start, end=corner), arc, ac.Line(start=end, end=end + 0.4 * leaving)]
    )


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("angle", [0.1, np.pi, 4.0, 2 * np.pi])
def test_plane_arc_is_a_rotation_about_its_centre(sign, angle):
    center, start = np.array([0.4, -0.2]), np.array([0.5, 0.1])
    path = ac.Path.from_segments([ac.Arc(start=start, center=center, angle=sign * angle)])
    radius = np.linalg.norm(start - center)
    assert path.length == pytest.approx(radius * angle, rel=1e-14)
    s = np.linspace(0, path.length, 37)
    phase = np.arctan2(*(start - center)[::-1]) + sign * s / radius
    circle = center + radius * np.stack([np.cos(phase), np.sin(phase)], axis=-1)
    np.testing.assert_allclose(path(s), circle, atol=1e-14)
    # By hand, with respect to s: each derivative is a quarter turn on and divided by the radius.
    for order in (1, 2, 3):
        turned = phase + sign * order * np.pi / 2
        expected = radius ** (1 - order) * np.stack([np.cos(turned), np.sin(turned)], axis=-1)
        np.testing.assert_allclose(path(s, order), expected, rtol=1e-12, atol=1e-11)


def test_space_arc_turns_by_the_right_hand_rule():
    path = space_path()
    corner = path.vertices[1]
    center = corner + R * path.normals[1]
    u = np.linspace(0, R * 2.2, 23)
    expected = center + rotated(corner - center, [1.0, -2.0, 0.5], u / R)
    np.testing.assert_allclose(path(path.breaks[1] + u), expected, atol=1e-14)
    backwards = ac.Path.from_segments(
        [ac.Arc(start=corner, center=center, angle=-1.0, normal=(1.0, -2.0, 0.5))]
    )
    np.testing.assert_allclose(
        backwards(backwards.length),
        center + rotated(corner - center, [1.0, -2.0, 0.5], -1.0)[0],
        atol=1e-14,
    )


@pytest.mark.parametrize("path", [winding_path(), space_path()], ids=["plane", "space"])
@pytest.mark.parametrize("order", [1, 2, 3])
def test_derivatives_agree_with_differences(path, order):
    step = 1e-5
    inside = np.concatenate(
        [np.linspace(a + 2 * step, b - 2 * step, 19) for a, b in pairwise(path.breaks)]
    )
    lower = [path(inside + k * step, order - 1) for k in (-1, 1)]
    difference = (lower[1] - lower[0]) / (2 * step)
    np.testing.assert_allclose(path(inside, order), difference, atol=2e-8 / R**order)


@pytest.mark.parametrize("path", [winding_path(), space_path()], ids=["plane", "space"])
def test_arc_length_is_the_parameter(path):
    s = np.linspace(0, path.length, 1001)
    np.testing.assert_allclose(np.linalg.norm(path(s, 1), axis=-1), 1, rtol=1e-13)
    chords = np.linalg.norm(np.diff(path(np.linspace(0, path.length, 200001)), axis=0), axis=1)
    assert chords.sum() == pytest.approx(path.length, rel=1e-5)


def test_both_sides_of_a_joint():
    path = winding_path()
    at = path.breaks[4]  # where the circle is left for an oblique line
    np.testing.assert_allclose(path(at, 1, side="left"), (0, 1), atol=1e-12)
    np.testing.assert_allclose(
        path(at, 1, side="right"), np.array([0.7, 0.5]) / np.hypot(0.7, 0.5), atol=1e-12
    )
    np.testing.assert_allclose(path(at, 2, side="left"), (1 / R, 0), atol=1e-12)
    np.testing.assert_array_equal(path(at, 2, side="right"), (0, 0))
    np.testing.assert_allclose(path(at, side="left"), path(at, side="right"), atol=1e-14)


def test_at_the_ends_both_sides_are_the_inner_one():
    path = winding_path()
    for at in (0.0, path.length):
        np.testing.assert_array_equal(path(at, 1, side="left"), path(at, 1, side="right"))


def test_stops_turns_and_vertices():
    path = winding_path()
    turn = np.arctan2(0.7, 0.5)
    np.testing.assert_allclose(path.turns, [0, 0, 0, turn], atol=1e-12)
    np.testing.assert_array_equal(path.stops, path.breaks[4:5])
    np.testing.assert_allclose(
        path.vertices, [(0, 0), (1, 0), (1 + R, R), (1 + R, 1), (1 + R, 1), (2, 1.5)], atol=1e-12
    )
    assert path.dimension == 2 and len(path) == 5


def test_shapes_follow_the_argument():
    path = winding_path()
    assert path(0.1).shape == (2,)
    assert path(np.zeros((3, 4)), 1).shape == (3, 4, 2)
    assert path([]).shape == (0, 2)
    assert space_path()([0.1, 0.2]).shape == (2, 3)


@pytest.mark.parametrize("radius", [1e-6, 1.0, 1e9])
def test_arcs_of_any_radius_keep_their_accuracy(radius):
    angle = min(1.0, 1.0 / radius)
    path = ac.Path.from_segments([ac.Arc(start=(0, 0), center=(0, radius), angle=angle)])
    s = np.linspace(0, path.length, 11)
    expected = np.stack(
        [radius * np.sin(s / radius), 2 * radius * np.sin(s / radius / 2) ** 2], axis=-1
    )
    np.testing.assert_allclose(path(s), expected, rtol=1e-13, atol=1e-15 * path.length)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-6, 1.0, np.pi - 1e-7, np.pi])
def test_angle_between_is_accurate_at_both_ends(angle):
    first, second = np.array([1.0, 0.0]), np.array([np.cos(angle), np.sin(angle)])
    assert angle_between(first, second) == pytest.approx(angle, rel=1e-8, abs=1e-16)


def test_polyline_keeps_its_points_and_lengths():
    points = np.array([(0.35, 0.1), (0.41, 0.15), (0.28, 0.3), (0.35, 0.35)])
    path = ac.Path.polyline(points)
    np.testing.assert_allclose(path.vertices, points, atol=1e-15)
    np.testing.assert_allclose(path(path.breaks), points, atol=1e-15)
    lengths = [np.hypot(0.06, 0.05), np.hypot(0.13, 0.15), np.hypot(0.07, 0.05)]
    np.testing.assert_allclose(path.lengths, lengths, rtol=1e-14)
    assert path.merged == ()


def test_repeated_points_are_merged_and_named():
    path = ac.Path.polyline([(0, 0), (0, 0), (1, 0), (1, 1e-10), (1, -1e-10), (1, 1), (1, 1)])
    assert path.merged == (1, 3, 4, 6)
    np.testing.assert_array_equal(path.vertices, [(0, 0), (1, 0), (1, 1)])


def test_a_slow_creep_is_not_merged_away():
    # Each step is below the resolution, but the way is not: it must not vanish.
    creep = np.stack([np.arange(11) * 4e-10, np.zeros(11)], axis=1)
    path = ac.Path.polyline(creep)
    assert path.length == pytest.approx(3.6e-9, rel=1e-6)
    assert path.merged == (1, 2, 4, 5, 7, 8, 10)


def test_demands_reach_the_path():
    demand = ac.Demand(speed=0.1, tolerance=1e-3, tag="weld")
    path = ac.Path.from_segments(
        [ac.Line(start=(0, 0), end=(1, 0), demand=demand), ac.Line(start=(1, 0), end=(2, 0))]
    )
    np.testing.assert_array_equal(path.speeds, [0.1, np.nan])
    np.testing.assert_array_equal(path.tolerances, [1e-3, np.nan])
    assert path.tags == ("weld", None)
    everywhere = ac.Path.polyline([(0, 0), (1, 0), (1, 1)], demand=demand)
    np.testing.assert_array_equal(everywhere.speeds, [0.1, 0.1])
    assert everywhere.tags == ("weld", "weld")


@pytest.mark.parametrize(
    ("points", "words", "data"),
    [
        ([(0, 0)], ("two different points", "1 point was given"), {}),
        ([], ("2 or 3 coordinates",), {}),
        ([(0, 0), (0, 0), (0, 1e-10)], ("3 points were given", "all the same"), {}),
        ([(0, 0), (np.nan, 1), (1, 1)], ("points of a path", "finite", "nan at index 1, 0"),
         {"index": 1}),
        ([(0, 0), (1, np.inf)], ("finite", "inf at index 1, 1"), {"index": 1}),
        ([(0, 0), (1, 1, 1)], ("points of a path", "numbers in m"), {}),
        ([(0, 0, 0, 0), (1, 1, 1, 1)], ("2 or 3 coordinates", "(2, 4)"), {}),
        ([0, 1, 2], ("2 or 3 coordinates", "(3,)"), {}),
        ([("a", 0), (1, 1)], ("points of a path", "numbers in m"), {}),
        (None, ("points of a path",), {}),
    ],
)  # fmt: skip
def test_polyline_refuses(points, words, data, refuses):
    refuses(lambda: ac.Path.polyline(points), ac.InvalidInput, *words, **data)


def test_a_gap_is_refused_with_its_place(refuses):
    segments = [
        ac.Line(start=(0, 0), end=(1, 0)),
        ac.Arc(start=(1, 0), center=(1, 1), angle=np.pi / 2),
        ac.Line(start=(2, 1.002), end=(2, 2)),
    ]
    refuses(
        lambda: ac.Path.from_segments(segments),
        ac.InvalidInput,
        "Segment 3",
        "0.002 m from the end of segment 2",
        "continuous",
        index=2,
        point=(2, 1.002),
        needed=0.002,
        allowed=1e-9,
    )


@pytest.mark.parametrize("s", [-1e-6, 2.1, np.nan])
def test_outside_the_path_is_refused(s, refuses):
    path = ac.Path.polyline([(0, 0), (2, 0)])
    refuses(lambda: path([0.5, s]), ac.InvalidInput, "outside the path", "2 m", s=s, allowed=2.0)


def test_rounding_beyond_the_end_is_not_outside():
    path = ac.Path.polyline([(0, 0), (2, 0)])
    np.testing.assert_array_equal(path(2 * (1 + 1e-15)), (2, 0))


GOOD = {
    "starts": np.zeros((1, 2)),
    "tangents": np.array([[1.0, 0.0]]),
    "normals": np.zeros((1, 2)),
    "curvatures": np.zeros(1),
    "lengths": np.ones(1),
}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"starts": np.zeros((0, 2))}, ("at least one segment",)),
        ({"starts": np.zeros((1, 4))}, ("starts", "2 or 3 coordinates")),
        ({"tangents": np.ones((2, 2))}, ("tangents", "shape (1, 2)")),
        ({"curvatures": np.array([np.nan])}, ("curvatures", "finite")),
        ({"curvatures": np.array([-1.0])}, ("curvatures not negative",)),
        ({"lengths": np.zeros(1)}, ("lengths must be above zero",)),
        ({"speeds": np.ones(2)}, ("speeds", "one per segment (1)")),
        ({"tolerances": np.ones(3)}, ("tolerances", "one per segment")),
        ({"tags": ("a", "b")}, ("tags", "one per segment")),
    ],
)
def test_arrays_that_do_not_fit_are_refused(change, words, refuses):
    assert ac.Path(segments=Segments(**GOOD)).length == 1.0
    refuses(lambda: ac.Path(segments=Segments(**GOOD | change)), ac.InvalidInput, *words)


def test_a_path_is_frozen_and_owns_its_arrays():
    lengths = np.ones(1)
    path = ac.Path(segments=Segments(**GOOD | {"lengths": lengths}))
    lengths[0] = 7.0
    assert path.lengths[0] == 1.0
    for name in ("starts", "tangents", "lengths", "breaks", "speeds"):
        with pytest.raises(ValueError, match="read-only"):
            getattr(path, name)[0] = 2.0
    with pytest.raises(dataclasses.FrozenInstanceError):
        path.lengths = lengths
