"""Entities chained into contours, from divided, shuffled and reversed drawings."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import armcontour as ac
from armcontour.files.drawings.entity_chains import DrawnEntity, chain_pieces
from armcontour.geometry.path import cut_path

TOLERANCE = 1e-5
SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]


def piece(path, name="", layer="0"):
    return DrawnEntity(path=path, name=name, layer=layer)


def line(start, end, name="", layer="0"):
    return piece(ac.Path.polyline([start, end]), name, layer)


def pieces(points=SQUARE, names="abcdefghij"):
    return [line(*x) for x in zip(points, points[1:], names, strict=False)]


def arc(angle=np.pi):
    """An arc of radius 50 mm from the origin."""
    return ac.Path(segments=[ac.Arc(start=(0, 0), center=(0, 0.05), angle=angle)])


def chained(given_, tolerance=TOLERANCE):
    """The one contour of pieces that leave nothing out."""
    (contour,), notes = chain_pieces(given_, tolerance)
    assert not notes
    return contour


def gaps(path):
    """Distances between the segments, and between the end and the start."""
    ends = path.on_segment(np.arange(len(path)), path.lengths)
    return np.linalg.norm(ends - np.roll(path.starts, -1, axis=0), axis=1)


@given(order=st.permutations(range(4)), turned=st.lists(st.booleans(), min_size=4, max_size=4))
def test_entities_in_any_order_and_direction_are_one_closed_contour(order, turned):
    given_ = [pieces([*SQUARE, SQUARE[0]])[i] for i in order]
    given_ = [
        piece(x.path.reversed(), x.name) if back else x
        for x, back in zip(given_, turned, strict=True)
    ]
    contour = chained(given_)
    assert contour.closed and len(contour.path) == 4
    # It starts with its first piece, in the direction of that.
    assert contour.name == given_[0].name
    np.testing.assert_allclose(contour.path.starts[0], given_[0].path.starts[0], atol=1e-15)
    np.testing.assert_allclose(contour.path.tangents[0], given_[0].path.tangents[0], atol=1e-15)
    assert contour.path.length == pytest.approx(4)


def test_an_open_chain_starts_in_the_direction_of_its_first_entity():
    a, b, c = pieces()
    contour = chained([a, b, c])
    assert (contour.name, contour.layer, contour.closed) == ("a", "0", False)
    np.testing.assert_array_equal(contour.path.vertices, SQUARE)
    contour = chained([b, c, a])
    assert contour.name == "b"
    np.testing.assert_array_equal(contour.path.vertices, SQUARE)
    contour = chained([piece(b.path.reversed(), "b"), c, a])
    np.testing.assert_allclose(contour.path.vertices, SQUARE[::-1], atol=1e-15)


def test_contours_have_the_order_of_their_first_entities_on_each_layer():
    first = pieces(names="abcd")
    other = [line((1, 0), (2, 0), "x", "other"), line((5, 5), (6, 5), "y")]
    contours, _ = chain_pieces([first[2], other[0], other[1], first[0], first[1]], TOLERANCE)
    summary = [(x.name, x.layer, len(x.path)) for x in contours]
    assert summary == [("c", "0", 3), ("x", "other", 1), ("y", "0", 1)]
    # A piece that stays alone keeps its path. The line ends where the closed circle starts.
    circle = ac.Path(segments=[ac.Arc.circle((1, 0), (0, 0))])
    given_ = [piece(circle, "circle"), line((1, 0), (3, 0), "line")]
    contours, _ = chain_pieces(given_, TOLERANCE)
    assert [(x.path, x.closed) for x in contours] == [(circle, True), (given_[1].path, False)]
    # Pieces may be kept apart.
    apart = [dataclasses.replace(line((k, 0), (k + 1, 0)), group=k) for k in range(3)]
    assert [x.layer for x in chain_pieces(apart, TOLERANCE)[0]] == ["0"] * 3
    chained([dataclasses.replace(x, group=7) for x in apart])


def test_at_a_junction_the_chain_continues_with_the_smallest_turn():
    stem, side, on = (line(*x) for x in (SQUARE[:2], SQUARE[1:3], ((1, 0), (2, 0.1))))
    for given_ in ([stem, side, on], [side, on, stem], [on, stem, side]):
        contours, _ = chain_pieces(given_, TOLERANCE)
        chains_found = {frozenset(np.ravel(x.path.vertices[:, 0])) for x in contours}
        assert chains_found == {frozenset([0.0, 1.0, 2.0]), frozenset([1.0])}
    stem = line((0, 0), (1, 0), "stem")
    left_turn = line((1, 0), (2, 1), "left")
    right = line((1, 0), (2, -1), "right")
    # Of equal turns, the earlier piece goes on.
    for a, b in ((left_turn, right), (right, left_turn)):
        one, other = chain_pieces([stem, a, b], TOLERANCE)[0]
        assert other.name == b.name and one.path.vertices[-1, 1] == a.path.vertices[-1, 1]

    # Ends that touch come before ends with a gap.
    touches = line((1, 0), (1, 1), "touches")
    gap = line((1, 5e-6), (2, 0), "gap")
    one, other = chain_pieces([stem, gap, touches], TOLERANCE)[0]
    assert (one.name, other.name) == ("stem", "gap")
    assert len(one.path) == 2 and one.path.vertices[-1].tolist() == [1, 1]


def rough(seed, dimension, size):
    """A closed contour of lines and arcs, cut up, its pieces moved a little; and the whole."""
    rng = np.random.default_rng(seed)
    corner = np.array([(0, 0), (0.1, 0), (0.1, 0.06), (0, 0.06), (0, 0)])
    whole = ac.round_corners(ac.Path.polyline(corner), tolerance=5e-3)
    if dimension == 3:
        whole = whole.lifted()
    cuts = np.sort(np.concatenate([whole.breaks, rng.uniform(0, whole.length, 6)]))
    cuts = cuts[np.concatenate([[True], np.diff(cuts) > 1e-4])]
    cuts[-1] = whole.length
    pieces = []
    for a, b in zip(cuts, cuts[1:], strict=False):
        x = cut_path(whole, a, b)
        shift = rng.normal(size=dimension)
        shift *= rng.uniform(0, size) / np.linalg.norm(shift)
        moved = ac.Path(segments=dataclasses.replace(x.segments, starts=x.starts + shift))
        pieces.append(piece(moved.reversed() if rng.random() < 0.5 else moved))
    return [pieces[i] for i in rng.permutation(len(pieces))], whole


@pytest.mark.parametrize("dimension", [2, 3])
def test_gaps_are_closed_and_no_point_moves_by_more_than_the_tolerance(dimension):
    for seed in range(8):
        given_, _ = rough(seed, dimension, 0.45 * TOLERANCE)
        contour = chained(given_)
        path = contour.path
        assert contour.closed and gaps(path).max() < 1e-9, seed
        assert len(path) == sum(len(x.path) for x in given_)
        for x in given_:
            points = x.path(np.linspace(0, x.path.length, 50))
            assert path.project(points).distance.max() <= TOLERANCE, seed
        # Arcs are arcs of the same angle.
        turns = np.concatenate([x.path.curvatures * x.path.lengths for x in given_])
        np.testing.assert_allclose(
            np.sort(path.curvatures * path.lengths), np.sort(turns), atol=1e-9
        )
    # Entities that meet exactly are not changed.
    for seed in range(4):
        given_, whole = rough(seed, dimension, 0.0)
        contour = chained(given_)
        assert contour.closed
        # Rounding is no gap, so tangent arcs stay tangent: one corner remains.
        sharp = np.flatnonzero(contour.path.turns > 1e-9)
        assert len(sharp) <= 1
        np.testing.assert_allclose(contour.path.vertices[sharp + 1], 0, atol=1e-12)
        assert contour.path.length == pytest.approx(whole.length, rel=1e-12)


def test_gaps_are_closed_by_moving_the_ends_of_lines_and_arcs():
    given_ = [line((0, 0), (1, 0), "a"), line((1, 1.1e-5), (1, 1), "b")]
    assert len(chain_pieces(given_, TOLERANCE)[0]) == 2
    assert len(chain_pieces(given_, 2e-5)[0]) == 1
    # The end of an arc goes to the middle of the gap by a similarity.
    path = chained([piece(arc(), "arc"), line((0, 0.1 + 4e-6), (-1, 0.1), "line")]).path
    np.testing.assert_allclose(path.vertices[1], (0, 0.1 + 2e-6), atol=1e-12)
    np.testing.assert_allclose(path.curvatures[0] * path.lengths[0], np.pi)
    np.testing.assert_allclose(1 / path.curvatures[0], 0.05 + 1e-6, atol=1e-12)
    # A similarity that makes the ends of nearly a circle meet would make it many times larger.
    contour = chained([piece(arc(2 * np.pi - 1e-4))])
    assert contour.closed
    assert contour.path.length == pytest.approx((2 * np.pi - 1e-4) * 0.05 + 5e-6, abs=1e-8)
    assert contour.path.curvatures.max() == 20
    lines = contour.path.lengths[contour.path.curvatures == 0]
    assert lines.sum() == pytest.approx(5e-6, rel=1e-3)
    # A piece whose ends meet within the tolerance is closed.
    contour = chained([piece(ac.Path.polyline([*SQUARE, (0, 4e-6)]), "a")])
    assert contour.closed and len(contour.path) == 4
    np.testing.assert_allclose(contour.path.vertices[[0, -1]], [(0, 2e-6)] * 2, atol=1e-15)


def test_duplicate_entities_are_skipped_and_named():
    given_ = [
        *pieces(),
        line((1, 0), (0, 0), "back"),
        piece(arc(), "arc"),
        piece(arc().reversed(), "arc again"),
        line((0, 0), (1, 0), "elsewhere", "other"),
        # The same ends and the same length are not the same piece.
        piece(ac.Path.polyline([(9, 0), (9, 1), (10, 0)]), "one way"),
        piece(ac.Path.polyline([(9, 0), (10, -1), (10, 0)]), "other way"),
    ]
    contours, (note,) = chain_pieces(given_, TOLERANCE)
    assert note.endswith(": back, arc again.")
    assert "elsewhere" in {x.name for x in contours}
    total = sum(x.path.length for x in contours)
    assert total == pytest.approx(3 + arc().length + 1 + 2 * (1 + np.sqrt(2)))


def test_short_contours_are_skipped_and_segments_keep_their_speeds():
    contours, (note,) = chain_pieces([*pieces(), line((5, 5), (5, 5 + 3e-6), "dust")], TOLERANCE)
    assert len(contours) == 1 and "0.01 mm" in note and note.endswith(": dust.")
    # Closed contours, too, by their extent.
    speck = 1e-7 * np.array([[0, 0], [30, 5], [0, 9], [9, 30], [25, 0], [0, 0]])
    for path in (
        ac.Path(segments=[ac.Arc.circle((4.9e-6, 0), (0, 0))]),
        ac.Path.polyline(speck),
        ac.Path.polyline([(0, 0), (6e-6, 0), (0, 0)]),
    ):
        contours, (note,) = chain_pieces([*pieces(), piece(path, "speck")], TOLERANCE)
        assert len(contours) == 1 and note.endswith(": speck.")
    chained([piece(ac.Path(segments=[ac.Arc.circle((6e-6, 0), (0, 0))]), "dot")])

    # Demands and tags go with their segments.
    def limited_line(start, end, speed, tag):
        return piece(
            ac.Path.polyline([start, end], segment_limits=ac.SegmentLimits(speed=speed, tag=tag)),
            tag,
        )

    path = chained(
        [limited_line((0, 0), (1, 0), 0.1, "a"), limited_line((2, 0), (1, 3e-6), 0.2, "b")]
    ).path
    assert path.tags == ("a", "b") and path.speeds.tolist() == [0.1, 0.2]
