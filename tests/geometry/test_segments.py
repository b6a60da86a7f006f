"""The table of segments: what it shares, what it checks and when it checks again."""

import dataclasses

import numpy as np
import pytest
from tests.geometry.tables import arc, each, path_of, refused

import armcontour as ac
from armcontour.frames import Frame
from armcontour.geometry import Segments
from armcontour.geometry.cutting import join_paths
from armcontour.geometry.placing import lift_path, place_path

ROUNDED = ac.round_corners(ac.Path.polyline([(0, 0), (1, 0), (1, 2), (3, 3)]), tolerance=0.1)


def gapped(gap):
    """Two lines with a gap between them, in the direction of y."""
    lines = Segments.lines(np.array([(0.0, 0), (1, 0), (2, 0)]))
    return dataclasses.replace(lines, starts=lines.starts + np.array([(0, 0), (0, gap)]))


def test_a_path_of_checked_segments_shares_them():
    path = lift_path(ROUNDED)
    others = path.oriented(np.eye(3)), path.following_tangent((0, 0, 1))
    for other in (*others, dataclasses.replace(path, merged=(1,))):
        assert other.segments is path.segments
    queries = np.random.default_rng(0).normal(size=(50, 3))
    plain, held = path.project(queries), others[0].project(queries)
    np.testing.assert_array_equal(plain.s, held.s)
    np.testing.assert_array_equal(plain.distance, held.distance)


def test_a_path_that_comes_apart_where_it_is_placed_or_joined_is_refused():
    near, far = ac.Path(segments=gapped(0.9e-9)), Frame.rpy([1e9, 1e9, 0], [0, 0, 1])
    assert place_path(near, Frame(position=[1, 2, 3])).length == 2
    away, n = place_path(ROUNDED, Frame(position=[9, 9, 0])), len(ROUNDED)
    refused(
        (lambda: place_path(near, Frame(), scale=10), "Segment 2", {"index": 1}),
        (lambda: place_path(ROUNDED, far), "must be continuous"),
        (lambda: join_paths([ROUNDED, away]), f"Segment {n + 1}", {"index": n}),
    )


def test_a_table_owns_its_columns_and_new_ones_are_locked():
    starts, ones = np.zeros((1, 2)), np.ones(1)
    bare = {"normals": np.zeros((1, 2)), "curvatures": np.zeros(1), "lengths": ones}
    given = Segments(starts=starts, tangents=np.array([(1.0, 0.0)]), **bare)
    starts[0] = 7.0
    assert given.starts[0].tolist() == [0, 0]
    longer = given.replace(lengths=np.full(1, 2.0))
    for table in (given, longer, longer[:1], Segments.join([given, longer])):
        with pytest.raises(ValueError, match="read-only"):
            table.lengths[0] = 3.0


def test_segments_run_backwards_are_the_same_points():
    table = ROUNDED.segments
    n = len(table)
    back = table.run(np.arange(n), np.arange(n) % 2 == 0)
    share = np.linspace(0, 1, 9)[:, None] * table.lengths
    every = np.broadcast_to(np.arange(n), share.shape)
    turned = np.where(np.arange(n) % 2 == 0, table.lengths - share, share)
    np.testing.assert_allclose(back.at(every, turned), table.at(every, share), atol=1e-13)


@each("dimension", [2, 3])
def test_the_extent_is_that_of_dense_points_and_never_inside(dimension):
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


def test_nothing_is_left_of_a_transition_that_is_cut_at_both_ends():
    path = ac.round_corners(
        ac.Path.polyline([(0, 0), (1, 0), (1, 2)]), tolerance=0.1, continuity="curvature"
    )
    rows = path.segments
    (bent,) = np.nonzero(rows.bent)
    middle = rows.lengths[bent] / 2
    cut = rows.cut(bent, middle, middle)
    assert len(bent) and (cut.lengths == 0).all() and (cut.curvatures == 0).all()
