"""Tool orientation along a path: rates, stops, blends, smoothing and refusals."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.geometry.tables import arc, each, line, path_of, refused

import armcontour as ac
from armcontour.core.frames import exp, log
from armcontour.geometry.orientation import Orientation

DOWN = np.diag([1.0, -1.0, -1.0])
POINTS = np.array([(0.0, 0, 0), (0.1, 0, 0), (0.1, 0.2, 0), (0.2, 0.2, 0.1), (0.3, 0.1, 0.1)])
PATH = ac.Path.polyline(POINTS)
REPEATED = [(0, 0, 0), (0.1, 0, 0), (0.1, 0, 0), (0.2, 0, 0)]


def turns(count, spread=1.0, seed=0):
    return Rotation.from_rotvec(
        spread * np.random.default_rng(seed).uniform(-1, 1, size=(count, 3))
    ).as_matrix()


def smooth(n=5):
    """Pieces with everything in them: three rotations at once, all of changing rate."""
    random = np.random.default_rng(3)
    breaks = np.concatenate([[0.0], np.cumsum(random.uniform(0.1, 0.3, n))])
    vectors = dict.fromkeys(("first", "second", "third"), (n, 3))
    shapes = vectors | dict.fromkeys(("f", "g", "h"), (n, 4))
    rates = {k: random.normal(size=size) for k, size in shapes.items()}
    return Orientation(breaks=breaks, starts=turns(n), **rates)


def rounded(path, angular_tolerance):
    return ac.round_corners(path, tolerance=0.02, angular_tolerance=angular_tolerance).orientation


PIECES = {
    "random pieces": smooth(),
    "rounded": rounded(PATH.oriented(turns(5)), 0.2),
    "following": rounded(PATH.following_tangent([0, 0, 1.0]), 0.05),
}


@each("name", PIECES)
def test_angular_rates_are_the_derivatives_of_the_rotations(name):
    orientation = PIECES[name]
    share = np.linspace(0.01, 0.99, 41)
    i = np.repeat(np.arange(len(orientation)), len(share))
    width = np.diff(orientation.breaks)
    u = (width[:, None] * share).ravel()
    step = 1e-4 * width[i]
    rate, change = orientation.rates_on_piece(i, u)

    def turned(k):
        ahead, behind = (orientation.on_piece(i, u + x * step) for x in (k, -k))
        return log(ahead @ np.swapaxes(behind, -1, -2)) / (2 * k * step[:, None])

    # Central differences with Richardson's step: what they leave is of order 4.
    size = 1 + np.abs(rate).max()
    np.testing.assert_allclose((4 * turned(1) - turned(2)) / 3, rate, atol=1e-8 * size)
    ahead, behind = (orientation.rates_on_piece(i, u + k * step)[0] for k in (1, -1))
    numeric = (ahead - behind) / (2 * step[:, None])
    np.testing.assert_allclose(numeric, change, atol=1e-5 * (1 + np.abs(change).max()))


def test_the_tool_turns_uniformly_between_the_rotations_of_waypoints():
    rotations = turns(5)
    orientation = PATH.oriented(rotations).orientation
    np.testing.assert_allclose(orientation(PATH.breaks), rotations, atol=1e-14)
    middle = (PATH.breaks[:-1] + PATH.breaks[1:]) / 2
    half = Rotation.from_matrix(rotations[:-1]), Rotation.from_matrix(rotations[1:])
    step = (half[1] * half[0].inv()).as_rotvec()
    expected = (Rotation.from_rotvec(step / 2) * half[0]).as_matrix()
    np.testing.assert_allclose(orientation(middle), expected, atol=1e-14)
    rate, change = orientation.rates(middle)
    np.testing.assert_allclose(rate, step / PATH.lengths[:, None], rtol=1e-12)
    np.testing.assert_allclose(change, 0, atol=1e-14)


def test_the_tool_stops_where_its_rate_of_turning_jumps():
    evenly = exp(np.array([[0, 0, 0.0], [0, 0, 0.2], [0, 0, 0.4], [0, 0, 0.3]]))
    oriented = ac.Path.polyline([(x, 0, 0) for x in range(4)]).oriented(evenly)
    np.testing.assert_array_equal(oriented.stops, [2.0])
    np.testing.assert_allclose(oriented.orientation.kinks, [0, 0.3], atol=1e-12)
    np.testing.assert_allclose(oriented.orientation.jumps, [0, 0], atol=1e-15)
    # Turning about the tool's axis is no kink where it is free.
    straight = ac.Path.polyline([(x, 0, 0) for x in range(3)])
    spun, tilted = (DOWN @ exp(np.array([[0, 0, 0], [x, 0, 0.5], [x, 0, -0.5]])) for x in (0, 0.2))
    np.testing.assert_array_equal(straight.oriented(spun).stops, [1.0])
    free = straight.oriented(spun, axis_only=True)
    assert len(free.stops) == 0 and len(ac.round_corners(free, tolerance=0).stops) == 0
    np.testing.assert_array_equal(straight.oriented(tilted, axis_only=True).stops, [1.0])
    # Rounding of the given rotations turns nothing, though points nanometres apart would make a
    # rate of the last digits.
    points = [(0, 0, 0), (0.1, 0, 0), (0.1 + 2e-9, 0, 0), (0.2, 0, 0)]
    same = Rotation.from_rotvec([0.3, 0.2, 0.1])
    rotations = np.array([same.as_matrix(), (same * same * same.inv()).as_matrix()] * 2)
    path = ac.Path.polyline(points).oriented(rotations)
    assert len(path.stops) == 0 and not path.orientation.first.any()


def test_jumps_of_orientation_are_angles_at_repeated_points():
    last = exp([0, 0, 3.0])
    starts = np.stack([np.eye(3), last, exp([1e-7, 0, 0]) @ last])
    sharp = Orientation.even(np.ones(3), starts, np.zeros((3, 3)))
    np.testing.assert_allclose(sharp.jumps, [3.0, 1e-7], rtol=1e-7)
    np.testing.assert_array_equal(sharp.stops, [1.0, 2.0])
    tilted = exp(np.array([[0, 0, 0.0], [0.3, 0, 0]]))
    free = Orientation.even(np.ones(2), tilted, np.zeros((2, 3)), axis_only=True)
    np.testing.assert_allclose(free.jumps, [0.3])
    rotations = turns(4)
    rotations[2] = rotations[1]
    path = ac.Path.polyline(REPEATED)
    by_point = path.oriented(rotations).orientation
    by_kept = path.oriented(rotations[[0, 1, 3]]).orientation
    np.testing.assert_array_equal(by_point.starts, by_kept.starts)
    np.testing.assert_allclose(by_point(path.length), rotations[3], atol=1e-14)


def test_invalid_orientations_are_refused():
    flat = ac.Path.polyline(POINTS[:, :2])
    repeated = ac.Path.polyline(REPEATED)
    back = ac.Path.polyline([(0, 0, 0), (1, 0, 0), (2, 0, 0), (1, 0, 0)])
    half = np.tile(DOWN, (5, 1, 1))
    half[3:] = np.eye(3)
    spot = [(0, 0, -1), (0, 0, -1), (0, 1, -1), (0, 0, -1)]
    other = ac.Path.polyline(POINTS * 1.01).oriented(DOWN).orientation
    refused(
        # A path does not turn on the spot, nor by half a turn.
        (lambda: repeated.oriented(turns(4)), "Waypoint 3", {"index": 2}),
        (lambda: repeated.pointing(spot), "Waypoint 3", {"index": 2}),
        (lambda: PATH.oriented(half), "waypoints 3 and 4 differ by half a turn", {"index": 2}),
        (lambda: PATH.pointing(half[:, 2]), "waypoints 3 and 4 differ", {"index": 2}),
        (lambda: flat.oriented(DOWN), "requires a path in space"),
        (lambda: flat.pointing([0, 0, -1]), "requires a path in space"),
        (lambda: flat.following_tangent([0, 0, 1]), "requires a path in space"),
        (lambda: PATH.pointing([0, 0, 0]), "no length"),
        (lambda: PATH.pointing([[0, 0, 1]] * 4 + [[0, 0, 0]]), "no length"),
        (lambda: PATH.pointing([0, 1]), "3 numbers"),
        (lambda: PATH.pointing(1.0), "3 numbers"),
        (lambda: PATH.pointing([0, 0, np.nan]), "finite"),
        (lambda: PATH.following_tangent([2.0, 0, 0]), "along the first tangent"),
        (lambda: PATH.following_tangent([-1.0, 1e-8, 0]), "along the first tangent"),
        (lambda: PATH.following_tangent([0, 0, 0]), "along the first tangent"),
        (lambda: PATH.following_tangent([0, 1]), "3 numbers"),
        (lambda: PATH.following_tangent([0, 0, 1], tool=turns(2)), "one rotation"),
        (
            lambda: back.following_tangent([0, 0, 1]),
            *("after segment 2", "180°", {"index": 1, "point": (2, 0, 0)}),
        ),
        (lambda: dataclasses.replace(PATH, orientation=other), "is for a path of"),
    )
    for n in (1, 2, 4, 6):
        words = f"has {n} values", "the path has 5 waypoints"
        refused((lambda n=n: PATH.oriented(turns(n)), *words))
        refused((lambda n=n: PATH.pointing(np.ones((n, 3))), *words))
    half[3:] = exp([np.pi - 1e-5, 0, 0]) @ DOWN
    assert np.isfinite(PATH.oriented(half).orientation(0.3)).all()
    good = Orientation.even(np.ones(2), np.tile(DOWN, (2, 1, 1)), np.zeros((2, 3)))
    fields = ("breaks", "starts", "first", "second", "third", "f", "g", "h")
    fields = {name: getattr(good, name) for name in fields}
    changes = (
        {"breaks": [0.0, 1.0]},
        {"breaks": [0.0, 1.0, 1.0]},
        {"breaks": [0.1, 1.0, 2.0]},
        {"first": np.full((2, 3), np.nan)},
        {"f": np.zeros((2, 3))},
        {"third": np.zeros((3, 3))},
    )
    refused(*((lambda x=x: Orientation(**fields | x), "orientation") for x in changes))


def test_pointing_sets_the_tool_axis_without_spin():
    directions = np.random.default_rng(1).normal(size=(5, 3))
    directions[:, 2] -= 3
    path = PATH.pointing(directions)
    axes = path.orientation(path.breaks)[:, :, 2]
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    np.testing.assert_allclose(axes, unit, atol=1e-14)
    assert path.orientation.axis_only
    s = np.linspace(0, path.length, 200)
    spin = np.sum(path.orientation.rates(s)[0] * path.orientation(s)[:, :, 2], axis=1)
    np.testing.assert_allclose(spin, 0, atol=1e-12)
    one = PATH.pointing([0, 0, -2.0]).orientation
    np.testing.assert_allclose(one(s)[:, :, 2], np.tile([0, 0, -1.0], (200, 1)), atol=1e-15)
    assert len(one.stops) == 0


def test_a_tool_that_follows_the_tangent_does_not_spin_about_it():
    bend = arc((0.2, 0, 0), (0.2, 0.1, 0), 2.0, normal=(0, 0, 1))
    path = path_of(line((0, 0, 0), (0.2, 0, 0)), bend)
    tool = turns(1)[0]
    s = np.linspace(0, path.length, 301)
    held = path.following_tangent([0.3, 0, 1.0], tool=tool).orientation(s)
    by_default = path.following_tangent([0, 0, 1.0]).orientation(s)
    # The frame's axes: R tool^T e.
    for rotation, x, z, up in ((held, tool[0], tool[2], 1), (by_default, (1, 0, 0), (0, 0, 1), -1)):
        np.testing.assert_allclose(rotation @ x, path(s, 1), atol=1e-14)
        np.testing.assert_allclose(rotation @ z, np.tile([0, 0, up], (301, 1)), atol=1e-14)
    # Parallel transport: after three turns about a cube's corner, the frame is rotated.
    points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (1, 1, 1), (2, 1, 1)]
    path = ac.Path.polyline(points).following_tangent([0, 0, 1])
    starts = path.orientation.starts
    for k in range(1, 4):
        turn = log(starts[k] @ starts[k - 1].T)
        assert np.abs(path.tangents[k - 1 : k + 1] @ turn).max() < 1e-14
        assert np.linalg.norm(turn) == pytest.approx(np.pi / 2)
    np.testing.assert_allclose(path.orientation.jumps, np.pi / 2)
    np.testing.assert_array_equal(path.stops, path.breaks[1:-1])


def test_breaks_of_the_orientation_equal_those_of_the_path_exactly():
    random = np.random.default_rng(8)
    path = ac.Path.polyline(np.cumsum(random.normal(size=(1000, 3)), axis=0))
    path = path.oriented(Rotation.from_rotvec(0.3 * random.normal(size=(1000, 3))))
    rounded = ac.round_corners(path, tolerance=0.05, angular_tolerance=0.3)
    apart = np.setdiff1d(rounded.orientation.breaks, rounded.breaks)
    near = np.abs(apart[:, None] - rounded.breaks).min(axis=1)
    assert len(near) == 0 or near.min() > 1e-9
    assert rounded.orientation.breaks[-1] == rounded.length
