"""Paths, segments and arcs: formulas, merged points and refusals."""

import dataclasses
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from tests.geometry.tables import arc, each, line, path_of, refused

import armcontour as ac
from armcontour.core.frames import Frame, exp
from armcontour.geometry import Segments, angle_between

R = 0.3
NORMAL = np.array([1.0, -2.0, 0.5])


def rotated(vector, axis, angle):
    """Rodrigues' rotation by SciPy, which shares nothing with the path's own formula."""
    axis = np.asarray(axis, float) / np.linalg.norm(axis)
    return Rotation.from_rotvec(np.outer(np.atleast_1d(angle), axis)).apply(vector)


def winding_path():
    """In the plane: line, left arc, line, right full circle, line."""
    return path_of(
        line((0, 0), (1, 0)),
        arc((1, 0), (1, R), np.pi / 2),
        line((1 + R, R), (1 + R, 1)),
        arc((1 + R, 1), (1 + 2 * R, 1), -2 * np.pi),
        line((1 + R, 1), (2, 1.5)),
    )


def space_path():
    """In space: line, arc about an oblique axis, line on."""
    direction = np.cross(NORMAL, [0.3, 0.1, 1.0])
    direction /= np.linalg.norm(direction)
    inward = np.cross(NORMAL, direction) / np.linalg.norm(NORMAL)
    start = np.array([0.1, 0.2, 0.3])
    corner = start + 0.7 * direction
    center = corner + R * inward
    bend = arc(corner, center, 2.2, normal=NORMAL)
    end = center + rotated(corner - center, NORMAL, 2.2)[0]
    leaving = rotated(direction, NORMAL, 2.2)[0]
    return path_of(line(start, corner), bend, line(end, end + 0.4 * leaving))


PATHS = [winding_path(), space_path()]


@each("angle", [0.1, np.pi, 4.0, 2 * np.pi, -0.1, -np.pi, -4.0, -2 * np.pi])
def test_a_plane_arc_rotates_its_start_about_its_centre(angle):
    center = np.array([0.4, -0.2])
    start = np.array([0.5, 0.1])
    sign = np.sign(angle)
    path = path_of(arc(start, center, angle))
    radius = np.linalg.norm(start - center)
    assert path.length == pytest.approx(radius * abs(angle), rel=1e-14)
    s = np.linspace(0, path.length, 37)
    phase = np.arctan2(*(start - center)[::-1]) + sign * s / radius
    circle = center + radius * np.stack([np.cos(phase), np.sin(phase)], axis=-1)
    np.testing.assert_allclose(path(s), circle, atol=1e-14)
    # By hand, with respect to s: each derivative is a quarter turn on and divided by the radius.
    for order in (1, 2, 3):
        turned = phase + sign * order * np.pi / 2
        expected = radius ** (1 - order) * np.stack([np.cos(turned), np.sin(turned)], axis=-1)
        np.testing.assert_allclose(path(s, order), expected, rtol=1e-12, atol=1e-11)


def test_a_space_arc_turns_about_its_normal_by_the_right_hand_rule():
    path = space_path()
    corner = path.vertices[1]
    center = corner + R * path.normals[1]
    u = np.linspace(0, R * 2.2, 23)
    expected = center + rotated(corner - center, NORMAL, u / R)
    np.testing.assert_allclose(path(path.breaks[1] + u), expected, atol=1e-14)
    backwards = path_of(arc(corner, center, -1.0, normal=NORMAL))
    expected = center + rotated(corner - center, NORMAL, -1.0)[0]
    np.testing.assert_allclose(backwards(backwards.length), expected, atol=1e-14)


@each("path, order", [(x, k) for x in PATHS for k in (1, 2, 3)])
def test_derivatives_of_paths_agree_with_differences(path, order):
    step = 1e-5
    ends = pairwise(path.breaks)
    inside = np.concatenate([np.linspace(a + 2 * step, b - 2 * step, 19) for a, b in ends])
    lower = [path(inside + k * step, order - 1) for k in (-1, 1)]
    difference = (lower[1] - lower[0]) / (2 * step)
    np.testing.assert_allclose(path(inside, order), difference, atol=2e-8 / R**order)


@each("path", PATHS)
def test_a_path_is_evaluated_by_arc_length_for_arrays_of_any_shape(path):
    s = np.linspace(0, path.length, 1001)
    np.testing.assert_allclose(np.linalg.norm(path(s, 1), axis=-1), 1, rtol=1e-13)
    chords = np.linalg.norm(np.diff(path(np.linspace(0, path.length, 50001)), axis=0), axis=1)
    assert chords.sum() == pytest.approx(path.length, rel=1e-5)
    for shape in ((), (0,), (2,), (3, 4)):
        for order in (0, 1):
            assert path(np.zeros(shape), order).shape == (*shape, path.dimension)


def test_a_path_has_one_sided_derivatives_and_turns_and_stops_at_vertices():
    path = winding_path()
    s = path.breaks[4]  # where the circle is left for an oblique line
    leaving = np.array([0.7, 0.5]) / np.hypot(0.7, 0.5)
    np.testing.assert_allclose(path(s, 1, side="left"), (0, 1), atol=1e-12)
    np.testing.assert_allclose(path(s, 1, side="right"), leaving, atol=1e-12)
    np.testing.assert_allclose(path(s, 2, side="left"), (1 / R, 0), atol=1e-12)
    np.testing.assert_array_equal(path(s, 2, side="right"), (0, 0))
    np.testing.assert_allclose(path(s, side="left"), path(s, side="right"), atol=1e-14)
    for end in (0.0, path.length):  # there both sides are the inner one
        np.testing.assert_array_equal(path(end, 1, side="left"), path(end, 1, side="right"))
    np.testing.assert_allclose(path.turns, [0, 0, 0, np.arctan2(0.7, 0.5)], atol=1e-12)
    np.testing.assert_array_equal(path.stops, path.breaks[4:5])
    vertices = [(0, 0), (1, 0), (1 + R, R), (1 + R, 1), (1 + R, 1), (2, 1.5)]
    np.testing.assert_allclose(path.vertices, vertices, atol=1e-12)
    assert path.dimension == 2 and len(path) == 5


@each("radius", [1e-6, 1.0, 1e9])
def test_arcs_of_any_radius_keep_their_accuracy(radius):
    path = path_of(arc((0, 0), (0, radius), min(1.0, 1.0 / radius)))
    s = np.linspace(0, path.length, 11)
    x = radius * np.sin(s / radius)
    y = 2 * radius * np.sin(s / radius / 2) ** 2
    np.testing.assert_allclose(path(s), np.stack([x, y], 1), rtol=1e-13, atol=1e-15 * path.length)


@each("angle", [0.0, 1e-12, 1e-6, 1.0, np.pi - 1e-7, np.pi])
def test_angle_between_is_accurate_near_zero_and_pi(angle):
    first = np.array([1.0, 0.0])
    second = np.array([np.cos(angle), np.sin(angle)])
    assert angle_between(first, second) == pytest.approx(angle, rel=1e-8, abs=1e-16)


def test_a_polyline_keeps_its_points_and_merges_repeated_points():
    points = np.array([(0.35, 0.1), (0.41, 0.15), (0.28, 0.3), (0.35, 0.35)])
    path = ac.Path.polyline(points)
    np.testing.assert_allclose(path.vertices, points, atol=1e-15)
    np.testing.assert_allclose(path(path.breaks), points, atol=1e-15)
    lengths = [np.hypot(0.06, 0.05), np.hypot(0.13, 0.15), np.hypot(0.07, 0.05)]
    np.testing.assert_allclose(path.lengths, lengths, rtol=1e-14)
    assert path.merged == ()
    path = ac.Path.polyline([(0, 0), (0, 0), (1, 0), (1, 1e-10), (1, -1e-10), (1, 1), (1, 1)])
    assert path.merged == (1, 3, 4, 6)
    np.testing.assert_array_equal(path.vertices, [(0, 0), (1, 0), (1, 1)])
    # Each step of a slow creep is below the resolution, but the way is not: it must not vanish.
    creep = ac.Path.polyline(np.stack([np.arange(11) * 4e-10, np.zeros(11)], axis=1))
    assert creep.length == pytest.approx(3.6e-9, rel=1e-6)
    assert creep.merged == (1, 2, 4, 5, 7, 8, 10)


def test_a_path_has_the_speeds_and_tolerances_of_its_segments():
    segment_limits = {"speed": 0.1, "tolerance": 1e-3, "tag": "weld"}
    path = path_of(line((0, 0), (1, 0), **segment_limits), line((1, 0), (2, 0)))
    np.testing.assert_array_equal(path.speeds, [0.1, np.nan])
    np.testing.assert_array_equal(path.tolerances, [1e-3, np.nan])
    assert path.tags == ("weld", None)
    everywhere = ac.Path.polyline(
        [(0, 0), (1, 0), (1, 1)], segment_limits=ac.SegmentLimits(**segment_limits)
    )
    np.testing.assert_array_equal(everywhere.speeds, [0.1, 0.1])
    assert everywhere.tags == ("weld", "weld")
    assert ac.SegmentLimits(tolerance=0.0).tolerance == 0.0


def test_invalid_points_and_arc_lengths_are_refused():
    nan = np.nan
    polylines = (
        ([(0, 0)], "two different points", "1 point was given"),
        ([], "2 or 3 coordinates"),
        ([(0, 0), (0, 0), (0, 1e-10)], "3 points were given", "all the same"),
        ([(0, 0), (nan, 1), (1, 1)], "nan at index 1, 0", {"index": 1}),
        ([(0, 0), (1, np.inf)], "inf at index 1, 1", {"index": 1}),
        ([(0, 0), (1, 1, 1)], "numbers in m"),
        ([(0, 0, 0, 0), (1, 1, 1, 1)], "2 or 3 coordinates", "(2, 4)"),
        ([0, 1, 2], "2 or 3 coordinates", "(3,)"),
        ([("a", 0), (1, 1)], "numbers in m"),
        (None, "points of a path"),
    )
    refused(*((lambda x=x: ac.Path.polyline(x), *more) for x, *more in polylines))
    path = ac.Path.polyline([(0, 0), (2, 0)])
    outside = {"s": -1e-6, "allowed": 2.0}, {"s": 2.1}
    refused(*((lambda x=x: path([0.5, x["s"]]), "outside the path", x) for x in outside))
    refused((lambda: path([0.5, nan]), "outside the path"))
    # Rounding beyond the end is not outside.
    np.testing.assert_array_equal(path(2 * (1 + 1e-15)), (2, 0))


ROUNDED = ac.round_corners(ac.Path.polyline([(0, 0), (1, 0), (1, 2), (3, 3)]), tolerance=0.1)


def gapped(gap):
    """Two lines with a gap between them, in the direction of y."""
    lines = Segments.lines(np.array([(0.0, 0), (1, 0), (2, 0)]))
    return dataclasses.replace(lines, starts=lines.starts + np.array([(0, 0), (0, gap)]))


GOOD = line((0, 0), (1, 0))
DEMANDS = (
    ({"speed": 0.0}, "speed of segment limits", "0 m/s"),
    ({"speed": -1.0}, "speed of segment limits", "-1 m/s"),
    ({"speed": np.nan}, "speed of segment limits", "finite"),
    ({"speed": [1.0, 2.0]}, "speed of segment limits", "one number"),
    ({"tolerance": -1e-3}, "tolerance of segment limits", "-0.001 m"),
    ({"tolerance": np.inf}, "tolerance of segment limits", "finite"),
)
SEGMENTS = (
    ([GOOD, line((1, 0), (1, 0))], "Segment 2", "zero length", {"index": 1, "point": (1, 0)}),
    ([line((0, np.nan), (1, 0))], "start of segment 1", "finite", {"index": 1}),
    ([line((0, 0), ("a", 0))], "end of segment 1", "numbers in m"),
    ([GOOD, line((1, 0), (1, 0, 0))], "points of segment 2", {"index": 1}),
    ([line((0,), (1,))], "points of segment 1", {"index": 0}),
    ([GOOD, arc((1, 0), (1, 0), 1.0)], "Segment 2", "radius 0 m", {"index": 1}),
    ([arc((1, 0), (0, 0), 0.0)], "Segment 1", "angle 0 rad", {"index": 0}),
    ([arc((1, 0), (0, 0), -6.3)], "Segment 1", "-6.3 rad", {"index": 0}),
    ([arc((1, 0), (0, 0), np.inf)], "angle of segment 1", "finite"),
    ([arc((1, 0), (0, 0), 1.0, normal=(0, 0, 1))], "Segment 1", "not have a normal"),
    ([arc((1, 0, 0), (1, 1, 0), 1.0)], "Segment 1", "needs a normal", {"index": 0}),
    ([arc((1, 0, 0), (0, 0, 0), 1.0, normal=(1, 0, 1))], "normal of segment 1", {"index": 0}),
    ([arc((1, 0, 0), (0, 0, 0), 1.0, normal=(0, 0, 0))], "normal of segment 1"),
    ([GOOD, line((0, 0, 0), (1, 0, 0))], "same number of coordinates"),
    ([], "at least one segment"),
    ([GOOD, ((1, 0), (2, 0))], "Segment 2", "Line or an Arc", "tuple", {"index": 1}),
    (
        [GOOD, arc((1, 0), (1, 1), np.pi / 2), line((2, 1.002), (2, 2))],
        *("Segment 3", "0.002 m from the end of segment 2"),
        {"index": 2, "point": (2, 1.002), "needed": 0.002, "allowed": 1e-9},
    ),
)
COLUMNS = {
    "starts": np.zeros((1, 2)),
    "tangents": np.array([[1.0, 0.0]]),
    "normals": np.zeros((1, 2)),
    "curvatures": np.zeros(1),
    "lengths": np.ones(1),
}
ODD_COLUMNS = (
    ({"starts": np.zeros((0, 2))}, "at least one segment"),
    ({"starts": np.zeros((1, 4))}, "starts", "2 or 3 coordinates"),
    ({"tangents": np.ones((2, 2))}, "tangents", "shape (1, 2)"),
    ({"curvatures": np.array([np.nan])}, "curvatures", "finite"),
    ({"curvatures": np.array([-1.0])}, "curvatures not negative"),
    ({"lengths": np.zeros(1)}, "lengths must be above zero"),
    ({"speeds": np.ones(2)}, "speeds", "one value per segment (1)"),
    ({"tolerances": np.ones(3)}, "tolerances", "one value per segment"),
    ({"tags": ("a", "b")}, "tags", "one value per segment"),
)


def path_with(**columns):
    return ac.Path(segments=Segments(**COLUMNS | columns))


def test_segments_and_values_of_the_wrong_size_are_refused():
    assert path_with().length == 1.0
    refused(*((lambda x=x: ac.SegmentLimits(**x), *more) for x, *more in DEMANDS))
    refused(*((lambda x=x: path_of(*x), *more) for x, *more in SEGMENTS))
    refused(*((lambda x=x: path_with(**x), *more) for x, *more in ODD_COLUMNS))


def test_paths_with_gaps_are_refused():
    near = ac.Path(segments=gapped(0.9e-9))
    far = Frame.rpy([1e9, 1e9, 0], [0, 0, 1])
    assert near.placed(Frame(position=[1, 2, 3])).length == 2
    away = ROUNDED.placed(Frame(position=[9, 9, 0]))
    n = len(ROUNDED)
    refused(
        (lambda: near.placed(Frame(), scale=10), "Segment 2", {"index": 1}),
        (lambda: ROUNDED.placed(far), "must be continuous"),
        (lambda: ROUNDED.joined(away), f"Segment {n + 1}", {"index": n}),
    )


@each("dimension", [2, 3])
def test_the_extent_of_a_path_encloses_dense_points_tightly(dimension):
    rng = np.random.default_rng(dimension)
    for _ in range(30):
        arcs = []
        start = rng.normal(size=dimension)
        for _ in range(4):
            center = start + rng.normal(size=dimension)
            normal = np.cross(center - start, rng.normal(size=3)) if dimension == 3 else None
            arcs.append(arc(start, center, rng.uniform(0.1, 6.2), normal=normal))
            start = path_of(arcs[-1]).vertices[-1]
        path = path_of(*arcs)
        low, high = path.segments.extent
        points = path(np.union1d(np.linspace(0, path.length, 20_000), path.breaks))
        assert (points >= low - 1e-12).all() and (points <= high + 1e-12).all()
        # A chord of 1/20000 of the length is off by less than its square over eight radii.
        np.testing.assert_allclose([points.min(axis=0), points.max(axis=0)], [low, high], atol=1e-5)


@given(
    seed=st.integers(0, 2**32 - 1),
    dimension=st.sampled_from([2, 3]),
    first=st.floats(0.05, 6.2),
    share=st.floats(0.05, 0.95),
)
def test_an_arc_passes_through_three_points(seed, dimension, first, share):
    rng = np.random.default_rng(seed)
    radius = 10.0 ** rng.uniform(-2, 1)
    side = rng.choice([-1.0, 1.0])
    phases = rng.uniform(0, 2 * np.pi) + side * np.array([0.0, share * first, first])
    points = np.zeros((3, 3))
    points[:, :2] = radius * np.column_stack([np.cos(phases), np.sin(phases)])
    if dimension == 3:
        points = points @ exp(rng.normal(size=3)).T
    points = points[:, :dimension] + rng.normal(size=dimension)
    path = path_of(ac.Arc.through(*points))
    assert path.length == pytest.approx(radius * first, rel=1e-9)
    assert path.curvatures[0] == pytest.approx(1 / radius, rel=1e-9)
    points_on_arc = path(np.array([0, share, 1]) * path.length)
    np.testing.assert_allclose(points_on_arc, points, atol=1e-9 * (1 + radius))


def test_arcs_through_collinear_points_and_circles_without_plane_are_refused():
    on_a_line = (
        [(0, 0), (1, 0), (2, 0)],
        [(0, 0, 0), (1, 1, 1), (2, 2, 2)],
        [(0, 0), (2, 0), (1, 0)],
        [(0, 0), (0, 0), (1, 1)],
        [(0, 0), (1, 1), (1, 1)],
        [(0, 0), (0, 0), (0, 0)],
        [(0, 0), (0.5, 1e-14), (1, 0)],
        [(0, 0, 0), (1, 0, 0), (0, 0, 0)],
    )
    refused(*((lambda x=x: ac.Arc.through(*x), "lie on one line") for x in on_a_line))

    def circle(normal):
        return lambda: path_of(ac.Arc.circle((1, 0, 0), (0, 0, 0), normal=normal))

    refused(
        (lambda: ac.Arc.through((0, 0), (1, 0, 0), (1, 1)), "all have 2 or all have 3"),
        (lambda: ac.Arc.through((0,), (1,), (2,)), "all have 2 or all have 3"),
        (lambda: ac.Arc.through((0, 0), (np.nan, 0), (1, 1)), "via point", "finite"),
        (circle(None), "needs a normal"),
        (circle((1, 0, 0)), "perpendicular to its radius"),
    )


def test_full_circles_are_closed_in_the_plane_and_in_space():
    through = path_of(ac.Arc.through((0, 0), (2, 0), (0, 0)))
    flat = path_of(ac.Arc.circle((1, 0), (0, 0)))
    upright = path_of(ac.Arc.circle((1, 0, 5), (0, 0, 5), normal=(0, -2, 0)))
    quarter = (flat, 0.25, (0, 1)), (upright, 0.25, (0, 0, 6))
    for path, share, point in ((through, 0.5, (2, 0)), *quarter):
        assert path.length == pytest.approx(2 * np.pi)
        np.testing.assert_allclose(path(share * path.length), point, atol=1e-12)
        np.testing.assert_allclose(path(path.length), path(0.0), atol=1e-12)
