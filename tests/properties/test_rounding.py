"""Properties of rounded corners and of their orientation."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import armcontour as ac
from armcontour.core.frames import log
from armcontour.geometry import angle_between

coordinates = st.floats(-1, 1, width=32)
polylines = (
    st.lists(st.tuples(coordinates, coordinates), min_size=3, max_size=8, unique=True)
    .map(np.array)
    .filter(lambda p: np.linalg.norm(np.diff(p, axis=0), axis=1).min() > 1e-3)
)
tolerances = st.floats(1e-5, 1.0)


def gentle(path):
    """No turn so near to straight back or straight on that rounding decides what it is."""
    return len(path.turns) > 0 and ((path.turns > 1e-4) & (path.turns < np.pi - 1e-4)).all()


@given(polylines, tolerances)
def test_every_rounded_corner_uses_its_tolerance_or_half_of_a_line(points, tolerance):
    path = ac.Path.polyline(points)
    if not gentle(path):
        return
    corners = ac.round_corners(path, tolerance=tolerance).corners
    half_turn = corners.turn / 2
    cosine = np.cos(half_turn)
    required = tolerance * cosine / (1 - cosine) * np.tan(half_turn)
    half_lines = np.minimum(path.lengths[:-1], path.lengths[1:]) / 2
    assert (corners.tangent >= np.minimum(required, half_lines) * (1 - 1e-6)).all()
    assert (corners.shrunk | np.isclose(corners.tangent, required, rtol=1e-6)).all()


SEEDS = st.integers(0, 2**32 - 1)


def random_path(rng):
    """A polyline in space with collinear points, and a rotation at every point."""
    n = int(rng.integers(3, 9))
    scale = 10.0 ** rng.uniform(-2, 0.5)
    points = scale * rng.uniform(-1, 1, size=(n, 3))
    for i in range(1, n - 1):
        kind = rng.random()
        if kind < 0.15:
            points[i] = points[i - 1] + rng.uniform(0.1, 0.9) * (points[i + 1] - points[i - 1])
        elif kind < 0.25:
            points[i] = points[i - 1] + scale * 10.0 ** rng.uniform(-4, -1) * rng.normal(size=3)
    vectors = 10.0 ** rng.uniform(-3, 0.3) * rng.uniform(-1, 1, size=(n, 3))
    if rng.random() < 0.2:
        vectors[1:] = vectors[0]
    return ac.Path.polyline(points), Rotation.from_rotvec(vectors), scale


def rounded(path, tolerance, angular):
    return ac.round_corners(path, tolerance=tolerance, angular_tolerance=angular)


def angles(first, second):
    return np.linalg.norm(log(first @ np.swapaxes(second, -1, -2)), axis=-1)


def axis_angles(first, second):
    return angle_between(first[..., 2], second[..., 2])


def random_oriented_corners(seed, axis_only):
    """A random path with rotations, its rounded path, and both tolerances."""
    rng = np.random.default_rng(seed)
    path, rotations, scale = random_path(rng)
    path = path.oriented(rotations, axis_only=axis_only)
    tolerance = scale * 10.0 ** rng.uniform(-4, 0)
    angular_tolerance = 10.0 ** rng.uniform(-4, 0)
    return path, rounded(path, tolerance, angular_tolerance), tolerance, angular_tolerance


@given(seed=SEEDS, axis_only=st.booleans())
def test_middle_of_each_corner_is_within_both_tolerances(seed, axis_only):
    path, result, tolerance, angular_tolerance = random_oriented_corners(seed, axis_only)
    corners = result.corners
    middle = (corners.start + corners.end) / 2
    errors = np.linalg.norm(result(middle) - corners.point, axis=1)
    assert (errors <= tolerance + 1e-12).all()
    np.testing.assert_allclose(errors, corners.error, atol=1e-12)
    at_corner = path.orientation.starts[corners.vertex]
    angle_of = axis_angles if axis_only else angles
    turned = angle_of(result.orientation(middle), at_corner)
    assert (turned <= angular_tolerance + 1e-9).all()
    np.testing.assert_allclose(turned, corners.angular_error, atol=1e-9)


@given(seed=SEEDS, axis_only=st.booleans())
def test_tool_stops_at_no_rounded_corner_with_orientation(seed, axis_only):
    _, result, *_ = random_oriented_corners(seed, axis_only)
    assert not result.corners.stopped.any()
    assert result.orientation.jumps.max(initial=0.0) <= 1e-9
    assert len(result.stops) == 0


@given(seed=SEEDS, axis_only=st.booleans())
def test_orientation_between_corners_and_at_the_ends_is_unchanged(seed, axis_only):
    path, result, *_ = random_oriented_corners(seed, axis_only)
    orientation = result.orientation
    # In the middle of a line nothing changes, unless a corner takes more than half of it.
    middles = (path.breaks[:-1] + path.breaks[1:]) / 2
    projection = result.project(path(middles))
    is_eased = orientation.second[orientation.locate(projection.s)].any(axis=1)
    unchanged = (projection.distance <= 1e-12) & ~is_eased
    before = path.orientation(middles[unchanged])
    after = orientation(projection.s[unchanged])
    assert angles(after, before).max(initial=0.0) <= 1e-7
    ends = orientation(np.array([0.0, result.length]))
    assert angles(ends, path.orientation(np.array([0.0, path.length]))).max() <= 1e-9


@given(seed=SEEDS)
def test_a_tool_that_follows_the_tangent_stays_within_its_tolerance(seed):
    rng = np.random.default_rng(seed)
    path, _, scale = random_path(rng)
    path = path.following_tangent(rng.normal(size=3), tool=Rotation.random(None, rng))
    angular = 10.0 ** rng.uniform(-4, -0.5)
    made = rounded(path, scale * 10.0 ** rng.uniform(-4, 0), angular)
    # The tangent as the tool sees it is one direction, but for the tolerance.
    tangent_in_tool = path.orientation.starts[0].T @ path.tangents[0]
    share = np.linspace(0, 1, 13)
    i = np.repeat(np.arange(len(made.orientation)), len(share))
    u = (np.diff(made.orientation.breaks)[:, None] * share).ravel()
    s = np.clip(made.orientation.breaks[i] + u, 0, made.length)
    along = np.einsum("nij,j->ni", made.orientation.on_piece(i, u), tangent_in_tool)
    errors = np.linalg.norm(along - made(s, 1), axis=1)
    assert errors.max() <= angular + 1e-7
    assert made.orientation.jumps.max(initial=0.0) <= 1e-8
    assert len(made.stops) == 0


BATCH = 800


def random_points(rng):
    """A polyline of 3 to 10 points with every nuisance that user files have."""
    dimension = int(rng.integers(2, 4))
    n = int(rng.integers(3, 11))
    scale = 10.0 ** rng.uniform(-3, 1)
    points = scale * rng.uniform(-1, 1, size=(n, dimension))
    if rng.random() < 0.3:  # mixed scales: some steps a thousandth of the others, or less
        steps = np.diff(points, axis=0) * 10.0 ** rng.uniform(-4, 0, size=(n - 1, 1))
        points = np.concatenate([points[:1], points[0] + np.cumsum(steps, axis=0)])
    for i in range(1, n - 1):
        kind = rng.random()
        if kind < 0.08:  # on the line between its neighbours
            points[i] = points[i - 1] + rng.random() * (points[i + 1] - points[i - 1])
        elif kind < 0.14:  # repeated, exactly or to rounding
            points[i] = points[i - 1] + rng.choice([0.0, 1e-13, 5e-10])
        elif kind < 0.20:  # straight back
            points[i + 1] = points[i] + rng.uniform(0.1, 1.5) * (points[i - 1] - points[i])
        elif kind < 0.28:  # micro-segment
            points[i] = points[i - 1] + 10.0 ** rng.uniform(-8.5, -5) * rng.normal(size=dimension)
    tolerance = 0.0 if rng.random() < 0.05 else scale * 10.0 ** rng.uniform(-6, 0.5)
    return points, tolerance


def distances(points, starts, tangents, lengths):
    """From every point to the nearest of the segments, by clamped projection on each."""
    to = points[:, None, :] - starts
    along = np.clip((to * tangents).sum(axis=2), 0.0, lengths)
    return np.sqrt((((to - along[..., None] * tangents) ** 2).sum(axis=2)).min(axis=1))


@pytest.fixture(scope="module")
def corpus():
    """Random polylines, and their rounded paths with the tolerance."""
    rng = np.random.default_rng(1000)
    found = []
    for _ in range(BATCH):
        points, tolerance = random_points(rng)
        path = ac.Path.polyline(points)
        found.append((path, ac.round_corners(path, tolerance=tolerance), tolerance))
    return found


def test_corpus_contains_all_kinds_of_corners(corpus):
    rounded_count = sum(np.count_nonzero(result.curvatures) for _, result, _ in corpus)
    assert rounded_count > 3 * BATCH
    assert sum(result.corners.shrunk.sum() for _, result, _ in corpus) > BATCH
    assert sum(result.corners.stopped.sum() for _, result, _ in corpus) > BATCH / 5
    assert sum(len(path.merged) for path, *_ in corpus) > BATCH / 5


def test_arcs_stay_within_the_tolerance_of_random_polylines(corpus):
    fractions = np.array([0.0, 0.25, 0.5, 0.75, 1.0])
    for path, result, tolerance in corpus:
        arcs = np.flatnonzero(result.curvatures)
        if len(arcs) == 0:
            continue
        u = result.lengths[arcs, None] * fractions
        samples = result.on_segment(np.repeat(arcs, len(fractions)), u.ravel())
        errors = distances(samples, path.starts, path.tangents, path.lengths)
        assert errors.max() <= tolerance + 1e-12
        # And each corner is as near to the middle of its arc.
        middles = samples[2 :: len(fractions)]
        corners = result.corners.point[~result.corners.stopped]
        assert np.linalg.norm(middles - corners, axis=1).max() <= tolerance + 1e-12


def test_tangents_jump_only_where_the_tool_stops(corpus):
    for _, result, _ in corpus:
        np.testing.assert_array_less(-1e-12, result.lengths)
        jumps = result.breaks[1:-1][result.turns > 1e-9]
        stops = result.corners.start[result.corners.stopped]
        np.testing.assert_allclose(jumps, stops, atol=1e-12)


def test_rounded_path_keeps_both_ends_and_is_not_longer(corpus):
    for path, result, _ in corpus:
        np.testing.assert_allclose(result.vertices[[0, -1]], path.vertices[[0, -1]], atol=1e-12)
        assert result.length <= path.length * (1 + 1e-12)


def test_rounded_corners_do_not_overlap(corpus):
    for path, result, _ in corpus:
        corners = result.corners
        assert (corners.start[1:] >= corners.end[:-1] - 1e-12).all()
        lines = np.diff(path.breaks[[0, *corners.vertex, -1]])
        used = np.array([0.0, *corners.tangent, 0.0])
        assert (used[:-1] + used[1:] <= lines + 1e-12).all()


CORNER_AND_TURNS = ac.Path.polyline(
    [(0, 0, 0), (1, 0, 0), (2, 0, 0), (2, 1, 0), (2, 2, 1)]
).oriented(Rotation.from_rotvec([[0, 0, 0], [0, 0, 0.1], [0, 0, 0.4], [0, 0, 0.3], [0, 0, 0.1]]))
CORNER = ac.Path.polyline([(0, 0, 0), (0.7, 0, 0), (0.7, 0.7, 0)])


def test_angular_tolerance_of_zero_stops_the_tool_at_jumps_of_the_angular_rate():
    result = rounded(CORNER_AND_TURNS, 0.1, 0.0)
    np.testing.assert_allclose(result.stops, [1.0, 2.0, 3.0])
    assert result.corners.stopped.all()
    assert (result.corners.angular_error == 0).all()


@pytest.mark.parametrize(
    "rotation",
    [
        Rotation.from_rotvec(np.outer([0, 1, 2], [0.11, 0.07, 0.2])),
        Rotation.from_rotvec([0.1, 0.2, 0.3]),
    ],
    ids=["uniform rate", "constant"],
)
def test_angular_tolerance_of_zero_needs_no_stop_at_a_continuous_angular_rate(rotation):
    result = rounded(CORNER.oriented(rotation), 0.1, 0.0)
    assert len(result.stops) == 0
    assert not result.corners.stopped.any()


def test_angular_tolerance_of_zero_stops_a_tool_along_the_tangent_at_both_ends_of_an_arc():
    result = rounded(CORNER.following_tangent([0, 0, 1]), 0.1, 0.0)
    np.testing.assert_allclose(result.stops, [result.corners.start[0], result.corners.end[0]])
