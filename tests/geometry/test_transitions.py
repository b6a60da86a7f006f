"""Transitions as segments: what every operation on paths makes of them, and their smoothness."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation
from tests.geometry.tables import each, jumps, refused

import armcontour as ac
from armcontour.frames import Frame
from armcontour.geometry.placing import drop_z, lift_path, place_path
from armcontour.geometry.transitions import UNEVEN

POINTS = [(0.0, 0.0), (0.1, 0.0), (0.13, 0.08), (0.02, 0.1)]


@pytest.fixture(scope="module")
def smooth():
    return ac.round_corners(ac.Path.polyline(POINTS), tolerance=3e-3, continuity="curvature")


def places(path, n=4001):
    return np.linspace(0, path.length, n)


@given(
    turn=st.floats(1e-5, np.pi - 1e-3),
    error=st.floats(1e-6, 1e-2),
    legs=st.tuples(st.floats(1e-3, 1.0), st.floats(1e-3, 1.0)),
    tilt=st.floats(0, 6),
)
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
    found = solve_ivp(change, (0, size), start, t_eval=s, rtol=1e-12, atol=1e-14).y[:2].T
    # Off by the quintics, far below any tolerance.
    assert np.abs(path(c.start[0] + s) - found).max() < 2e-7 * size
    bend = np.linalg.norm(path(c.start[0] + s, 2), axis=1)
    wanted = (1 - (2 * s / size - 1) ** 2) ** 2 / c.radius[0]
    assert np.abs(bend - wanted).max() < 1e-4 / c.radius[0]


def test_no_point_of_a_smooth_corner_is_farther_from_the_lines_than_its_middle(smooth):
    c, objective = smooth.corners, smooth.objective
    places = (np.linspace(*x, 999) for x in zip(c.start, c.end, strict=True))
    far = [objective.project(smooth(s)).distance.max() for s in places]
    assert (far <= c.error * np.cos(c.turn / 2) * (1 + 1e-9)).all()


def test_neighbours_share_their_line_as_arcs_do_and_some_corners_stay_sharp():
    path = ac.Path.polyline([(0, 0), (0.1, 0), (0.1, 0.01), (0.2, 0.01)])
    found = ac.round_corners(path, tolerance=0.02, continuity="curvature").corners
    np.testing.assert_allclose(found.tangent, 0.005, rtol=1e-12)
    assert found.shrunk.all() and found.reason.tolist() == [None, None]
    points = [(0, 0), (0.1, 0), (0, 0), (0, 0.1), (1e-9, 0.1 + 2e-9), (0.1, 0.1)]
    for continuity in ("tangent", "curvature"):
        sharp = ac.round_corners(ac.Path.polyline(points), tolerance=1e-3, continuity=continuity)
        assert sharp.corners.reason[0] == "turn-back"
    assert "no room" in sharp.corners.reason


def test_nearest_points_are_on_the_curve(smooth):
    s = places(smooth, 999)
    normal = smooth(s, 1) @ [[0, 1], [-1, 0]]
    for off in (0.0, 2e-4):
        found = smooth.project(smooth(s) + off * normal)
        np.testing.assert_allclose(found.distance, off, atol=1.1e-9)
        np.testing.assert_allclose(found.s, s, atol=2e-8)
    assert found.s.max() <= smooth.length


def test_placed_lifted_and_dropped_it_is_the_same(smooth):
    s, frame = places(smooth), Frame.rpy((0.1, 0.2, 0.3), (0.4, 0.5, 0.6))
    space = place_path(smooth, frame, scale=2.0)
    wanted = 2 * np.pad(smooth(s), ((0, 0), (0, 1))) @ frame.rotation.T + frame.position
    np.testing.assert_allclose(space(2 * s), wanted, atol=1e-14)
    assert jumps(space, 2).max() < 1e-12
    np.testing.assert_allclose(drop_z(lift_path(smooth))(s), smooth(s), rtol=1e-12, atol=1e-18)
    with pytest.raises(ac.InvalidInput, match="curve that leaves the plane"):
        drop_z(space)


def test_the_extent_is_that_of_dense_points(smooth):
    points = smooth(places(smooth, 400_001))
    low, high = smooth.segments.extent
    assert (low <= points.min(axis=0)).all()
    assert (high >= points.max(axis=0)).all()
    np.testing.assert_allclose([low, high], [points.min(axis=0), points.max(axis=0)], atol=1e-11)


def test_columns_that_do_not_fit_are_refused(smooth):
    def with_quintics(given):
        return lambda: ac.Path(segments=smooth.segments.replace(quintics=given))

    broken = smooth.segments.quintics.copy()
    broken[1, 2] = np.nan
    refused(
        (with_quintics(np.zeros((len(smooth), 4, 2))), "6 coefficients"),
        (with_quintics(broken), "NaN altogether"),
    )


def test_a_kerf_runs_beside_transitions(smooth):
    process = ac.Process(kerf=1e-3, kerf_side="left")
    beside = ac.prepare(ac.Program.of(smooth), process).path
    distance = smooth.project(beside(np.linspace(0, beside.length, 2001))).distance
    assert np.abs(distance - 0.5e-3).max() < 2e-7
