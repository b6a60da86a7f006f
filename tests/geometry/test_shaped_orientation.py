"""Orientation of shaped paths stays within its tolerance and needs no stops."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

import armcontour as ac
from armcontour.core.frames import angle_between, exp, log
from armcontour.geometry import orient_shaped, round_path

POINTS = [(0, 0, 0), (0.1, 0, 0), (0.1, 0.1, 0.02), (0.2, 0.1, 0.05), (0.15, 0.02, 0)]
BASE = ac.Path.polyline(POINTS)


def shaped(objective, tolerance=0.005):
    """A path of many arcs near an objective, without orientation, and the places."""
    bare = ac.Path(segments=objective.segments)
    path = round_path(bare, tolerance=tolerance, curve="parabola")
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


@given(st.integers(0, 2**32 - 1), st.booleans())
def test_random_shaped_paths_stay_within_the_tolerance_without_stops(seed, axis_only):
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
