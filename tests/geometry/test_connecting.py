"""Corners beside arcs with continuous curvature: tolerance, both ways, and smoothness."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.geometry.tables import jumps

import armcontour as ac
from armcontour.geometry import Segments
from armcontour.geometry.transitions import UNEVEN


def corner(turn, bends, lengths, sides=(0.3, 2.0), dimension=3):
    """Two lines or arcs that meet at a corner at the origin."""
    into = np.array([1.0, 0, 0])
    out = np.array([np.cos(turn), np.sin(turn), 0])
    rows = []
    for tangent, bend, length, side in zip((-into, out), bends, lengths, sides, strict=True):
        across = np.array([-tangent[1], tangent[0], 0])
        normal = np.cos(side) * across + np.sin(side) * np.array([0, 0, 1.0])
        if dimension == 2:
            normal = np.copysign(1, np.cos(side)) * across
        rows.append(
            Segments(
                starts=np.zeros((1, dimension)),
                tangents=tangent[None, :dimension],
                normals=normal[None, :dimension] * (bend > 0),
                curvatures=np.array([bend]),
                lengths=np.array([min(length, 6 / bend) if bend else length]),
            )
        )
    first = rows[0].run(np.array([0]), np.array([True]))
    return ac.Path(segments=Segments.join([first, rows[1]]))


@settings(max_examples=15)
@given(
    turn=st.floats(1e-6, 2.2),
    radii=st.tuples(st.floats(2e-3, 1.0), st.floats(2e-3, 1.0)),
    line=st.sampled_from([None, 0, 1]),
    lengths=st.tuples(st.floats(0.01, 0.1), st.floats(0.01, 0.1)),
    sides=st.tuples(st.floats(0, 6.2), st.floats(0, 6.2)),
    tolerance=st.floats(1e-5, 5e-3),
    dimension=st.sampled_from([2, 3]),
)
def test_both_paths_are_within_the_tolerance_of_each_other(
    turn, radii, line, lengths, sides, tolerance, dimension
):
    bends = [0.0 if i == line else 1 / radius for i, radius in enumerate(radii)]
    path = corner(turn, bends, lengths, sides, dimension)
    found = ac.round_corners(path, tolerance=tolerance, continuity="curvature")
    c = found.corners
    assert c.reason[0] is None
    assert c.error[0] <= tolerance * (1 + 1e-12)
    vertex = path.starts[1]
    s = np.linspace(c.start[0], c.end[0], 1001)
    assert found.project(vertex[None]).distance[0] == pytest.approx(c.error[0], abs=1.1e-9)
    at = path.breaks[1] + np.linspace(-c.tangent[0], c.tangent[0], 1001)
    away = path.project(found(s)).distance.max(), found.project(path(at)).distance.max()
    assert max(away) <= tolerance * (1 + 1e-3) + 1.1e-9
    if found.segments.bent.any():
        assert jumps(found, 1).max() < 1e-11
        assert jumps(found).max() < 1e-9
        assert np.abs(np.linalg.norm(found(s, 1), axis=1) - 1).max() < UNEVEN
    assert len(found.stops) == 0


def test_the_tolerance_is_used_unless_a_corner_speed_ends_the_search_early():
    def rounded(path, tolerance, **values):
        return ac.round_corners(path, tolerance=tolerance, continuity="curvature", **values)

    found = rounded(corner(1.2, (0.0, 20.0), (0.1, 0.1)), 2e-3)
    assert found.segments.bent.any() and not found.corners.shrunk[0]
    assert found.corners.error[0] == pytest.approx(2e-3, rel=1e-6)
    path = corner(0.4, (0.0, 2.0), (0.1, 0.1), dimension=2)
    wide, slow = rounded(path, 5e-3), rounded(path, 5e-3, speed=0.1, acceleration=2.0)
    assert 0.005 <= slow.corners.radius[0] * (1 + 1e-9) < wide.corners.radius[0]
    assert slow.corners.tangent[0] < wide.corners.tangent[0]
    # Sharp turns beside arcs keep their pairs of arcs.
    found = rounded(corner(3.0, (0.0, 5.0), (0.1, 0.1), dimension=2), 1e-3)
    assert found.corners.reason[0] is None and not found.segments.bent.any()


def test_corners_beside_transitions_are_rounded():
    points = [(0, 0), (0.1, 0), (0.1, 0.1), (0.2, 0.15)]
    once = ac.round_corners(ac.Path.polyline(points[:3]), tolerance=0.01, continuity="curvature")
    cut = ac.geometry.cutting.cut_path(once, 0, (once.corners.start + once.corners.end)[0] / 2)
    beside = ac.geometry.cutting.join_paths(
        [cut, ac.Path.polyline([cut(cut.length), cut(cut.length) + [0.0, 0.05]])]
    )
    for continuity in ("tangent", "curvature"):
        found = ac.round_corners(beside, tolerance=1e-5, continuity=continuity)
        assert found.corners.reason.tolist() == [None]
        assert found.corners.error[0] <= 1e-5 * (1 + 1e-9)
        assert len(found.stops) == 0
