"""Paths with continuous curvature: transitions, and corners next to arcs."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from tests.geometry.tables import arc, each, jumps, line, path_of, refused

import armcontour as ac
from armcontour.geometry import Segments
from armcontour.geometry.biarcs import UNEVEN
from armcontour.program import smooth_curvature

DOWN = np.diag([1.0, -1.0, -1.0])


def slot(radius=0.015, straight=0.05):
    """Two lines and two half circles; the second line has demands of its own."""
    width = 2 * radius
    return path_of(
        line((0, 0), (straight, 0)),
        arc((straight, 0), (straight, radius), np.pi),
        line((straight, width), (0, width), speed=0.02, tag="slow"),
        arc((0, width), (0, radius), np.pi),
    )


def chain(turns, radii, dimension, seed):
    """Tangent arcs, and lines for infinite radii, in planes that change at every vertex."""
    rng = np.random.default_rng(seed)
    rows = []
    point = np.zeros(dimension)
    tangent = np.eye(dimension)[0]
    for turn, radius in zip(turns, radii, strict=True):
        across = rng.normal(size=dimension)
        across -= (across @ tangent) * tangent
        across /= np.linalg.norm(across)
        bend = 0.0 if np.isinf(radius) else 1 / radius
        length = turn * (0.02 if np.isinf(radius) else radius)
        row = Segments(
            starts=point[None],
            tangents=tangent[None],
            normals=across[None] * (bend > 0),
            curvatures=np.array([bend]),
            lengths=np.array([length]),
        )
        rows.append(row)
        point = row.ends[0]
        tangent = row.end_tangents[0] / np.linalg.norm(row.end_tangents[0])
    return ac.Path(segments=Segments.join(rows))


def deviation(path, smooth, n=4001):
    """Largest distances of dense points of either path from the other."""
    return max(
        path.project(smooth(np.linspace(0, smooth.length, n))).distance.max(),
        smooth.project(path(np.linspace(0, path.length, n))).distance.max(),
    )


@each("tolerance", [1e-7, 1e-5, 1e-4])
def test_slot_transitions_are_smooth_and_use_whole_tolerance(tolerance):
    path = slot()
    smooth = smooth_curvature(path, tolerance=tolerance)
    assert jumps(smooth).max() < 1e-11
    assert jumps(smooth, 1).max() < 1e-12
    assert 0.9 * tolerance < deviation(path, smooth) + 1e-9 < tolerance + 2.1e-9
    speed = np.linalg.norm(smooth(np.linspace(0, smooth.length, 4001), 1), axis=1)
    assert np.abs(speed - 1).max() < UNEVEN
    np.testing.assert_allclose(smooth.vertices[[0, -1]], path.vertices[[0, -1]], atol=1e-15)


@settings(max_examples=15)
@given(
    turns=st.lists(st.floats(0.01, 2.5), min_size=2, max_size=6),
    radii=st.lists(st.sampled_from([1e-3, 0.01, 0.05, 1.0, np.inf]), min_size=6, max_size=6),
    tolerance=st.floats(1e-7, 1e-3),
    dimension=st.sampled_from([2, 3]),
    seed=st.integers(0, 99),
)
def test_random_chains_stay_within_their_tolerance(turns, radii, tolerance, dimension, seed):
    path = chain(turns, radii[: len(turns)], dimension, seed)
    smooth = smooth_curvature(path, tolerance=tolerance)
    assert deviation(path, smooth) <= tolerance + 1.1e-9
    assert jumps(smooth, 1).max() < 1e-11
    assert jumps(smooth).max() < 1e-9
    assert len(smooth.stops) == 0


def test_jumps_are_smoothed_only_where_there_is_room():
    path = path_of(arc((0.1, 0), (0, 0), 2 * np.pi))
    assert smooth_curvature(path, tolerance=1e-5) is path
    r = 0.01
    path = path_of(arc((0, 0), (0, r), np.pi / 2), arc((r, r), (2 * r, r), -np.pi / 2))
    smooth = smooth_curvature(path, tolerance=1e-5)
    assert jumps(smooth).max() < 1e-11
    assert 0.9e-5 < deviation(path, smooth) < 1e-5 + 1e-9
    # Where there is no room the jump stays.
    path = path_of(line((0, 0), (5e-7, 0)), arc((5e-7, 0), (5e-7, 0.01), 1.0))
    assert jumps(smooth_curvature(path, tolerance=1e-5)).max() > 0.5
    refused(
        (lambda: smooth_curvature(path, tolerance=0), "above zero"),
        (lambda: smooth_curvature("slot", tolerance=1e-5), "Path or a Program"),
    )


def test_speeds_and_tags_of_segments_stay_on_their_sides():
    path = slot()
    smooth = smooth_curvature(path, tolerance=1e-4)
    slow = np.flatnonzero(smooth.speeds == 0.02)
    assert {smooth.tags[i] for i in slow} == {"slow"}
    ends = smooth.vertices[[slow[0], slow[-1] + 1]]
    # The vertices have moved by less than the tolerance.
    assert np.linalg.norm(ends - path.vertices[[2, 3]], axis=1).max() < 1e-4


def test_tolerances_of_segments_limit_the_deviation_at_their_ends():
    fine = slot().segments.replace(tolerances=np.array([np.nan, np.nan, 1e-6, np.nan]))
    path = ac.Path(segments=fine)
    smooth = smooth_curvature(path, tolerance=1e-4)
    s = np.linspace(0, smooth.length, 20_001)
    projection = path.project(smooth(s))
    at_first_vertex = np.abs(projection.s - path.breaks[1]) < 0.01
    assert 0.9e-4 < projection.distance[at_first_vertex].max() < 1e-4 + 1e-9
    at_fine_vertices = projection.s > path.breaks[1] + 0.03
    assert projection.distance[at_fine_vertices].max() < 1e-6 + 1e-9


def test_events_and_work_of_a_contour_stay_at_their_points():
    path = slot()
    events = tuple(ac.Event(name=f"e{i}", s=s) for i, s in enumerate((0.01, 0.05, 0.08, 0.15)))
    contour = ac.Contour(path=path, events=events, work=(0.02, 0.14))
    smooth = smooth_curvature(ac.Program(moves=(contour,)), tolerance=1e-5).contours[0]
    before, after = ([*(e.s for e in x.events), *x.work] for x in (contour, smooth))
    assert np.linalg.norm(path(before) - smooth.path(after), axis=1).max() < 1.1e-5


@each("kind", ["fixed", "turning", "following"])
def test_the_tool_orientation_is_kept_and_does_not_jump(kind):
    space = slot().lifted()
    paths = {
        "fixed": lambda: space.oriented(DOWN),
        "following": lambda: space.following_tangent((0, 0, 1)),
        "turning": lambda: space.oriented(
            Rotation.from_rotvec(space.breaks[:, None] * [0.1, 0.2, 3.0]).as_matrix() @ DOWN
        ),
    }
    path = paths[kind]()
    smooth = smooth_curvature(path, tolerance=1e-4)
    o = smooth.orientation
    breaks = smooth.orientation.breaks[1:-1]
    size = np.abs(o.rates(np.linspace(0, smooth.length, 999))).max(axis=(1, 2))
    for before, after, bound in zip(
        o.rates(breaks, side="left"), o.rates(breaks), size, strict=True
    ):
        assert np.abs(before - after).max(initial=0.0) <= 1e-10 * bound
    assert len(smooth.stops) == 0
    s = np.linspace(0, 1, 999)
    differences = smooth.orientation(s * smooth.length) - path.orientation(s * path.length)
    assert np.abs(differences).max() < {"fixed": 1e-14, "turning": 1e-3, "following": 0.1}[kind]


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
    first = rows[0].reverse_rows(np.array([0]), np.array([True]))
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
    smooth = ac.round_corners(path, tolerance=tolerance, continuity="curvature")
    c = smooth.corners
    assert c.reason[0] is None
    assert c.error[0] <= tolerance * (1 + 1e-12)
    vertex = path.starts[1]
    s = np.linspace(c.start[0], c.end[0], 1001)
    assert smooth.project(vertex[None]).distance[0] == pytest.approx(c.error[0], abs=1.1e-9)
    positions = path.breaks[1] + np.linspace(-c.tangent[0], c.tangent[0], 1001)
    away = path.project(smooth(s)).distance.max(), smooth.project(path(positions)).distance.max()
    assert max(away) <= tolerance * (1 + 1e-3) + 1.1e-9
    if smooth.segments.is_transition.any():
        assert jumps(smooth, 1).max() < 1e-11
        assert jumps(smooth).max() < 1e-9
        assert np.abs(np.linalg.norm(smooth(s, 1), axis=1) - 1).max() < UNEVEN
    assert len(smooth.stops) == 0
