"""Corner rounding: what holds for every path."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import armcontour as ac

BATCH = 800  # tests/slow has 10,000


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


def check_polylines(seed, count):
    """Round random polylines and judge tolerance, tangents, ends and overlap."""
    rng = np.random.default_rng(seed)
    rounded_ones = stopped_ones = shrunk_ones = merged_ones = 0
    for _ in range(count):
        points, tolerance = random_points(rng)
        path = ac.Path.polyline(points)
        rounded = ac.round_corners(path, tolerance=tolerance)
        corners = rounded.corners
        # Deviation: samples of every arc, and every corner to the middle of its arc.
        arcs = np.flatnonzero(rounded.curvatures)
        u = rounded.lengths[arcs, None] * np.array([0.0, 0.25, 0.5, 0.75, 1.0])
        on_arcs = rounded.on_segment(np.repeat(arcs, 5), u.ravel())
        if len(arcs):
            off = distances(on_arcs, path.starts, path.tangents, path.lengths)
            assert off.max() <= tolerance + 1e-12
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
        cut = np.zeros(len(path) + 1)
        cut[corners.vertex] = corners.tangent
        assert (cut[:-1] + cut[1:] <= path.lengths * (1 + 1e-12)).all()
        rounded_ones += len(arcs)
        stopped_ones += int(corners.stopped.sum())
        shrunk_ones += int(corners.shrunk.sum())
        merged_ones += len(path.merged)
    # The corpus does hold what it is meant to hold.
    assert rounded_ones > 3 * count and shrunk_ones > count
    assert stopped_ones > count / 5 and merged_ones > count / 5


def test_random_polylines():
    check_polylines(1000, BATCH)


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
def test_reversing_the_path_reverses_the_corners(points, tolerance):
    path, back = ac.Path.polyline(points), ac.Path.polyline(points[::-1])
    if not gentle(path):
        return
    there = ac.round_corners(path, tolerance=tolerance)
    again = ac.round_corners(back, tolerance=tolerance)
    np.testing.assert_allclose(again.corners.radius[::-1], there.corners.radius, rtol=1e-9)
    s = np.linspace(0, there.length, 57)
    assert again.length == pytest.approx(there.length, rel=1e-12)
    np.testing.assert_allclose(again((there.length - s).clip(0, again.length)), there(s), atol=1e-9)


SHIFTS = st.tuples(coordinates, coordinates)


@given(polylines, tolerances, st.floats(0, 6.28), st.floats(1e-3, 1e3), SHIFTS)
def test_rounding_commutes_with_moving_turning_and_scaling(points, tolerance, angle, scale, shift):
    path = ac.Path.polyline(points)
    if not gentle(path):
        return
    rotation = Rotation.from_euler("z", angle).as_matrix()[:2, :2]

    def move(x):
        return scale * (x @ rotation.T + np.array(shift))

    first = ac.round_corners(path, tolerance=tolerance)
    moved = ac.round_corners(ac.Path.polyline(move(points)), tolerance=scale * tolerance)
    np.testing.assert_allclose(moved.corners.radius, scale * first.corners.radius, rtol=1e-7)
    s = np.linspace(0, first.length, 57)
    found = moved((scale * s).clip(0, moved.length))
    np.testing.assert_allclose(found, move(first(s)), atol=1e-8 * scale)


@given(polylines, tolerances)
def test_every_corner_gets_what_it_asks_for_or_half_of_a_line(points, tolerance):
    path = ac.Path.polyline(points)
    if not gentle(path):
        return
    found = ac.round_corners(path, tolerance=tolerance).corners
    half_turn = found.turn / 2
    cosine = np.cos(half_turn)
    wanted = tolerance * cosine / (1 - cosine) * np.tan(half_turn)
    half_lines = np.minimum(path.lengths[:-1], path.lengths[1:]) / 2
    assert (found.tangent >= np.minimum(wanted, half_lines) * (1 - 1e-6)).all()
    assert (found.shrunk | np.isclose(found.tangent, wanted, rtol=1e-6)).all()
