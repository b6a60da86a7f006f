"""Tool orientation of shaped paths: near that at the place, without stops, along the tangent."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from tests.geometry.tables import arc, each, path_of

import armcontour as ac
from armcontour.core.frames import angle_between, exp, log, shortest
from armcontour.geometry import orient_shaped, round_with_parabolas
from armcontour.geometry.prescribed_orientation import carry_frame

POINTS = [(0, 0, 0), (0.1, 0, 0), (0.1, 0.1, 0.02), (0.2, 0.1, 0.05), (0.15, 0.02, 0)]
BASE = ac.Path.polyline(POINTS)


def shaped(objective, tolerance=0.005):
    """A path of many arcs near an objective, without orientation, and the places."""
    bare = ac.Path(segments=objective.segments)
    path = round_with_parabolas(bare, tolerance=tolerance)
    c = path.corners
    vertices = objective.breaks[c.vertex]
    s = np.unique(
        np.concatenate(
            [[0.0], vertices - c.tangent, vertices, vertices + c.tangent, [objective.length]]
        )
    )
    return path, np.stack([s, np.maximum.accumulate(path.place(s))], axis=1)


def off_place(path, objective, places, n=3001):
    """Angles between the tool and its orientation at the place on the objective."""
    s = np.linspace(0, path.length, n)
    actual = path.orientation(s)
    expected = objective.orientation(np.interp(s, places[:, 1], places[:, 0]))
    if objective.orientation.axis_only:
        return angle_between(actual[:, :, 2], expected[:, :, 2])
    return np.linalg.norm(log(actual @ np.swapaxes(expected, 1, 2)), axis=1)


def off_tangent(path, n=3001):
    """Angles between the tangent and the direction that goes with it, x of the tool."""
    s = np.linspace(0, path.length, n)
    return angle_between(path.orientation(s)[:, :, 0], path(s, 1))


@each("tolerance", [1e-3, 0.02])
def test_a_tool_that_follows_the_tangent_follows_that_of_the_path(tolerance):
    objective = BASE.following_tangent((0, 0, 1))
    path, places = shaped(objective)
    oriented, error = orient_shaped(path, objective, places, tolerance)
    assert oriented.orientation.follows and len(oriented.stops) == 0
    assert off_tangent(oriented).max() <= error + 1e-9 <= tolerance + 2e-9
    # The corners are rounded in their planes, so that the tool arrives as on the objective.
    ends = oriented.orientation([0, oriented.length])
    np.testing.assert_allclose(ends, objective.orientation([0, objective.length]), atol=1e-9)


def test_a_path_out_of_the_corners_planes_does_not_turn_the_tool_about_the_tangent():
    objective = BASE.following_tangent((0, 0, 1))
    # Through points beside the lines, by turns to all sides.
    places_along = np.linspace(0, BASE.length, 25)
    beside = BASE(places_along) + 0.004 * np.random.default_rng(2).normal(size=(25, 3))
    path = ac.Path.spline(np.vstack([POINTS[:1], beside[1:-1], POINTS[-1:]]), tolerance=1e-4)
    places = np.stack([places_along, path.breaks[path.waypoints]], axis=1)
    oriented, error = orient_shaped(path, objective, places, 0.02)
    assert len(oriented.stops) == 0
    assert off_tangent(oriented).max() <= error + 1e-9 < 0.0202
    start = exp(shortest(objective.tangents[0], path.tangents[0])) @ objective.orientation(0.0)
    np.testing.assert_allclose(oriented.orientation(0.0), start, atol=1e-12)
    middle = (objective.breaks[1:] + objective.breaks[:-1]) / 2
    s = np.interp(middle, places[:, 0], places[:, 1])
    tilt = exp(shortest(objective(middle, 1), path(s, 1)))
    nearest_rotation = tilt @ objective.orientation(middle)
    twist = np.linalg.norm(
        log(oriented.orientation(s) @ np.swapaxes(nearest_rotation, 1, 2)), axis=1
    )
    drift = carry_frame(path.segments, start)(s) @ np.swapaxes(nearest_rotation, 1, 2)
    assert np.linalg.norm(log(drift), axis=1).max() > 0.1
    assert twist.max() < 0.02


@given(st.integers(0, 2**32 - 1), st.booleans())
def test_random_places_keep_the_tolerance_without_stops(seed, axis_only):
    rng = np.random.default_rng(seed)
    points = np.cumsum(rng.normal(size=(5, 3)), axis=0)
    objective = ac.Path.polyline(points).oriented(
        exp(rng.normal(size=(5, 3)) * 0.5), axis_only=axis_only
    )
    path, places = shaped(objective, tolerance=0.05)
    # Places that go forward unevenly, by half to twice of what they did.
    steps = np.diff(places, axis=0)[:, 1] * rng.uniform(0.5, 1, size=len(places) - 1)
    uneven = np.append(0.0, np.cumsum(steps))
    both = np.stack([places[:, 0], uneven * path.length / uneven[-1]], axis=1)
    tolerance = 10.0 ** rng.uniform(-3, -1)
    oriented, error = orient_shaped(path, objective, both, tolerance)
    assert len(oriented.stops) == 0
    assert off_place(oriented, objective, both, 401).max() <= error * 1.05
    assert error <= tolerance


def test_a_whole_turn_of_the_path_keeps_to_its_tangent():
    def circle(*normal):
        return path_of(arc((0.1, 0, 0), (0, 0, 0), 1.99 * np.pi, normal=normal))

    objective, path = circle(0, 0, 1).following_tangent((0, 0, 1)), circle(0, 0.05, 1)
    places = np.array([(0, 0), (objective.length, path.length)])
    oriented, error = orient_shaped(path, objective, places, 0.01)
    assert len(oriented.stops) == 0 and error <= 0.01
    assert off_tangent(oriented).max() <= error + 1e-9
    # Half way round the path goes 0.05 to the other side: so does the tool.
    s = [path.length / 2]
    tilt = exp(shortest(objective(s, 1), path(s, 1))) @ objective.orientation(s)
    assert np.linalg.norm(log(oriented.orientation(s) @ np.swapaxes(tilt, 1, 2))) < 0.01
