"""Properties of rounded corners and of their orientation."""

import numpy as np
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


@given(seed=SEEDS, axis_only=st.booleans())
def test_position_and_orientation_stay_within_their_tolerances_together(seed, axis_only):
    rng = np.random.default_rng(seed)
    path, rotations, scale = random_path(rng)
    path = path.oriented(rotations, axis_only=axis_only)
    tolerance = scale * 10.0 ** rng.uniform(-4, 0)
    angular = 10.0 ** rng.uniform(-4, 0)
    made = rounded(path, tolerance, angular)
    corners = made.corners
    orientation = made.orientation
    assert not corners.stopped.any()
    # In the middle of a corner, both the point and the rotation are near those of the corner.
    middle = (corners.start + corners.end) / 2
    errors = np.linalg.norm(made(middle) - corners.point, axis=1)
    assert (errors <= tolerance + 1e-12).all()
    np.testing.assert_allclose(errors, corners.error, atol=1e-12)
    at_corner = path.orientation.starts[corners.vertex]
    apart = axis_angles if axis_only else angles
    turned = apart(orientation(middle), at_corner)
    assert (turned <= angular + 1e-9).all()
    np.testing.assert_allclose(turned, corners.angular_error, atol=1e-9)
    # No jump and no kink is left, so that nothing has to stop.
    assert orientation.jumps.max(initial=0.0) <= 1e-9
    assert len(made.stops) == 0
    # Halfway along a line nothing has changed, unless a corner takes more than half of it.
    middles = (path.breaks[:-1] + path.breaks[1:]) / 2
    projection = made.project(path(middles))
    eased = orientation.second[orientation.locate(projection.s)].any(axis=1)
    on = (projection.distance <= 1e-12) & ~eased
    before = path.orientation(middles[on])
    assert angles(orientation(projection.s[on]), before).max(initial=0.0) <= 1e-7
    # It begins and ends as it was.
    ends = orientation(np.array([0.0, made.length]))
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


def test_random_polylines_are_rounded_within_their_tolerance():
    """Judge tolerance, tangents, ends and overlap."""
    rng = np.random.default_rng(1000)
    rounded_ones = stopped_ones = shrunk_ones = merged_ones = 0
    for _ in range(BATCH):
        points, tolerance = random_points(rng)
        path = ac.Path.polyline(points)
        rounded = ac.round_corners(path, tolerance=tolerance)
        corners = rounded.corners
        # Deviation: samples of every arc, and every corner to the middle of its arc.
        arcs = np.flatnonzero(rounded.curvatures)
        u = rounded.lengths[arcs, None] * np.array([0.0, 0.25, 0.5, 0.75, 1.0])
        on_arcs = rounded.on_segment(np.repeat(arcs, 5), u.ravel())
        if len(arcs):
            errors = distances(on_arcs, path.starts, path.tangents, path.lengths)
            assert errors.max() <= tolerance + 1e-12
            gap = np.linalg.norm(on_arcs[2::5] - corners.point[~corners.stopped], axis=1)
            assert gap.max() <= tolerance + 1e-12
        # Tangents: continuous but for the full stops that are recorded.
        np.testing.assert_array_less(-1e-12, rounded.lengths)
        jumps = rounded.breaks[1:-1][rounded.turns > 1e-9]
        np.testing.assert_allclose(jumps, corners.start[corners.stopped], atol=1e-12)
        # Ends, length, order, and no overlap on any line.
        np.testing.assert_allclose(rounded.vertices[[0, -1]], path.vertices[[0, -1]], atol=1e-12)
        assert rounded.length <= path.length * (1 + 1e-12)
        assert (corners.start[1:] >= corners.end[:-1] - 1e-12).all()
        corner_s = path.breaks[[0, *corners.vertex, -1]]
        cut = np.array([0.0, *corners.tangent, 0.0])
        assert (cut[:-1] + cut[1:] <= np.diff(corner_s) + 1e-12).all()
        rounded_ones += len(arcs)
        stopped_ones += int(corners.stopped.sum())
        shrunk_ones += int(corners.shrunk.sum())
        merged_ones += len(path.merged)
    # The corpus contains all kinds of corners.
    assert rounded_ones > 3 * BATCH and shrunk_ones > BATCH
    assert stopped_ones > BATCH / 5 and merged_ones > BATCH / 5


def test_an_angular_tolerance_of_zero_stops_the_tool_at_corners():
    line = ac.Path.polyline([(0, 0, 0), (1, 0, 0), (2, 0, 0), (2, 1, 0), (2, 2, 1)])
    turns = Rotation.from_rotvec([[0, 0, 0], [0, 0, 0.1], [0, 0, 0.4], [0, 0, 0.3], [0, 0, 0.1]])
    made = rounded(line.oriented(turns), 0.1, 0.0)
    np.testing.assert_allclose(made.stops, [1.0, 2.0, 3.0])
    assert made.corners.stopped.all() and (made.corners.angular_error == 0).all()
    # The tool does not stop where the angular rate is continuous up to rounding errors.
    corner = ac.Path.polyline([(0, 0, 0), (0.7, 0, 0), (0.7, 0.7, 0)])
    steady = Rotation.from_rotvec(np.outer([0, 1, 2], [0.11, 0.07, 0.2]))
    for held in (corner.oriented(steady), corner.oriented(Rotation.from_rotvec([0.1, 0.2, 0.3]))):
        rounded_path = rounded(held, 0.1, 0.0)
        assert len(rounded_path.stops) == 0 and not rounded_path.corners.stopped.any()
    followed = rounded(corner.following_tangent([0, 0, 1]), 0.1, 0.0)
    np.testing.assert_allclose(followed.stops, [followed.corners.start[0], followed.corners.end[0]])
