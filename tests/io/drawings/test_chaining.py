"""Pieces chained into contours: drawings cut up, shuffled and turned round, and put together."""

from __future__ import annotations

import dataclasses
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import armcontour as ac
from armcontour.geometry.cutting import cut_path, reverse_path
from armcontour.geometry.placing import lift_path
from armcontour.io.drawings.chaining import Piece, chain_pieces

TOLERANCE = 1e-5


def line(start, end, name="", layer="0"):
    return Piece(path=ac.Path.polyline([start, end]), name=name, layer=layer)


def pieces(points, names="abcdefghij", closed=False):
    points = [*points, points[0]] if closed else points
    return [line(*x) for x in zip(points, points[1:], names, strict=False)]


def gaps(path):
    """What is between the segments, and between the end and the start."""
    ends = path.on_segment(np.arange(len(path)), path.lengths)
    return np.linalg.norm(ends - np.roll(path.starts, -1, axis=0), axis=1)


SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]


def test_lines_in_order_are_one_contour():
    (contour,), notes = chain_pieces(pieces(SQUARE), TOLERANCE)
    assert (contour.name, contour.layer, contour.closed, notes) == ("a", "0", False, [])
    np.testing.assert_array_equal(contour.path.vertices, SQUARE)


@given(order=st.permutations(range(4)), turned=st.lists(st.booleans(), min_size=4, max_size=4))
def test_pieces_in_any_order_and_direction_are_one_closed_contour(order, turned):
    given_ = []
    for i in order:
        x = pieces(SQUARE, closed=True)[i]
        path = reverse_path(x.path) if turned[i] else x.path
        given_.append(Piece(path=path, name=x.name, layer=x.layer))
    (contour,), notes = chain_pieces(given_, TOLERANCE)
    assert contour.closed and len(contour.path) == 4 and not notes
    # It starts with its first piece, in the direction of that.
    assert contour.name == given_[0].name
    np.testing.assert_allclose(contour.path.starts[0], given_[0].path.starts[0], atol=1e-15)
    np.testing.assert_allclose(contour.path.tangents[0], given_[0].path.tangents[0], atol=1e-15)
    assert contour.path.length == pytest.approx(4)


def test_a_chain_that_is_open_starts_at_an_end_in_the_direction_of_its_first_piece():
    a, b, c = pieces(SQUARE)
    (contour,), _ = chain_pieces([b, c, a], TOLERANCE)
    assert contour.name == "b"
    np.testing.assert_array_equal(contour.path.vertices, SQUARE)
    back = Piece(path=reverse_path(b.path), name="b", layer="0")
    (contour,), _ = chain_pieces([back, c, a], TOLERANCE)
    np.testing.assert_allclose(contour.path.vertices, SQUARE[::-1], atol=1e-15)


def test_contours_are_in_the_order_of_their_first_pieces_and_layers_stay_apart():
    first = pieces(SQUARE, names="abcd")
    other = [line((1, 0), (2, 0), "x", "other"), line((5, 5), (6, 5), "y")]
    contours, _ = chain_pieces([first[2], other[0], other[1], first[0], first[1]], TOLERANCE)
    assert [(x.name, x.layer, len(x.path)) for x in contours] == [
        ("c", "0", 3),
        ("x", "other", 1),
        ("y", "0", 1),
    ]


def test_a_piece_that_stays_alone_keeps_its_path():
    circle = ac.Path.from_segments([ac.Arc.circle((1, 0), (0, 0))])
    given_ = [
        Piece(path=circle, name="circle", layer="0"),
        # It ends where the circle starts, which is closed.
        line((1, 0), (3, 0), "line"),
    ]
    contours, _ = chain_pieces(given_, TOLERANCE)
    assert [x.path for x in contours] == [circle, given_[1].path]
    assert [x.closed for x in contours] == [True, False]


def test_where_three_ends_meet_the_smallest_turn_goes_on():
    stem, side, on = (
        line((0, 0), (1, 0), "stem"),
        line((1, 0), (1, 1), "side"),
        line((1, 0), (2, 0.1), "on"),
    )
    for given_ in ([stem, side, on], [side, on, stem], [on, stem, side]):
        contours, _ = chain_pieces(given_, TOLERANCE)
        assert {frozenset(np.ravel(x.path.vertices[:, 0])) for x in contours} == {
            frozenset([0.0, 1.0, 2.0]),
            frozenset([1.0]),
        }


def test_a_grid_is_chained_into_its_straight_lines():
    k = np.arange(6.0)
    given_ = [line((x, y), (x + 1, y)) for x in k[:-1] for y in k[1:-1]]
    given_ += [line((x, y), (x, y + 1)) for x in k[1:-1] for y in k[:-1]]
    contours, _ = chain_pieces(given_, TOLERANCE)
    assert len(contours) == 8
    assert all(x.path.turns.max() == 0 and x.path.length == 5 for x in contours)


def test_of_equal_turns_the_earlier_piece_goes_on():
    stem = line((0, 0), (1, 0), "stem")
    left, right = line((1, 0), (2, 1), "left"), line((1, 0), (2, -1), "right")
    for a, b in ((left, right), (right, left)):
        contours, _ = chain_pieces([stem, a, b], TOLERANCE)
        assert (
            contours[1].name == b.name
            and contours[0].path.vertices[-1, 1] == a.path.vertices[-1, 1]
        )


def test_ends_that_touch_come_before_ends_with_a_gap():
    contours, _ = chain_pieces(
        [
            line((0, 0), (1, 0), "a"),
            line((1, 5e-6), (2, 0), "gap"),
            line((1, 0), (1, 1), "touches"),
        ],
        TOLERANCE,
    )
    assert [x.name for x in contours] == ["a", "gap"]
    assert len(contours[0].path) == 2 and contours[0].path.vertices[-1].tolist() == [1, 1]


def rough(seed, dimension, size):
    """A closed contour of lines and arcs, cut up, its pieces moved a little; and the whole."""
    rng = np.random.default_rng(seed)
    corner = np.array([(0, 0), (0.1, 0), (0.1, 0.06), (0, 0.06), (0, 0)])
    whole = ac.round_corners(ac.Path.polyline(corner), tolerance=5e-3)
    if dimension == 3:
        whole = lift_path(whole)
    cuts = np.sort(np.concatenate([whole.breaks, rng.uniform(0, whole.length, 6)]))
    cuts = cuts[np.concatenate([[True], np.diff(cuts) > 1e-4])]
    cuts[-1] = whole.length
    found = []
    for i, (a, b) in enumerate(zip(cuts, cuts[1:], strict=False)):
        x = cut_path(whole, a, b)
        shift = rng.normal(size=dimension)
        shift *= rng.uniform(0, size) / np.linalg.norm(shift)
        moved = ac.Path(segments=dataclasses.replace(x.segments, starts=x.starts + shift))
        found.append(
            Piece(path=reverse_path(moved) if rng.random() < 0.5 else moved, name=f"{i}", layer="0")
        )
    return [found[i] for i in rng.permutation(len(found))], whole


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("seed", range(8))
def test_gaps_are_closed_and_no_point_moves_by_more_than_the_tolerance(seed, dimension):
    given_, whole = rough(seed, dimension, 0.45 * TOLERANCE)
    (contour,), notes = chain_pieces(given_, TOLERANCE)
    assert contour.closed and not notes
    assert gaps(contour.path).max() < 1e-9
    assert len(contour.path) == sum(len(x.path) for x in given_)
    for x in given_:
        at = x.path(np.linspace(0, x.path.length, 50))
        assert contour.path.project(at).distance.max() <= TOLERANCE
    # Arcs are arcs of the same angle.
    turns = sorted(
        k * u for x in given_ for k, u in zip(x.path.curvatures, x.path.lengths, strict=True)
    )
    np.testing.assert_allclose(
        np.sort(contour.path.curvatures * contour.path.lengths), turns, atol=1e-9
    )


@pytest.mark.parametrize("seed", range(4))
def test_what_meets_exactly_stays_as_it_is(seed):
    given_, whole = rough(seed, 2, 0.0)
    (contour,), _ = chain_pieces(given_, TOLERANCE)
    assert contour.closed
    # Tangent arcs stay tangent, as no gap of rounding is closed: what is left is the one corner.
    sharp = np.flatnonzero(contour.path.turns > 1e-9)
    np.testing.assert_allclose(
        contour.path.vertices[sharp + 1], np.zeros((len(sharp), 2)), atol=1e-12
    )
    assert len(sharp) <= 1
    assert contour.path.length == pytest.approx(whole.length, rel=1e-12)


def test_gaps_wider_than_the_tolerance_stay():
    given_ = [line((0, 0), (1, 0), "a"), line((1, 1.1e-5), (1, 1), "b")]
    assert len(chain_pieces(given_, TOLERANCE)[0]) == 2
    assert len(chain_pieces(given_, 2e-5)[0]) == 1


def test_the_end_of_an_arc_goes_to_the_middle_of_the_gap_by_a_similarity():
    half = ac.Path.from_segments([ac.Arc(start=(0, 0), center=(0, 0.05), angle=np.pi)])
    given_ = [Piece(path=half, name="arc", layer="0"), line((0, 0.1 + 4e-6), (-1, 0.1), "line")]
    (contour,), _ = chain_pieces(given_, TOLERANCE)
    np.testing.assert_allclose(contour.path.vertices[1], (0, 0.1 + 2e-6), atol=1e-12)
    np.testing.assert_allclose(contour.path.curvatures[0] * contour.path.lengths[0], np.pi)
    np.testing.assert_allclose(1 / contour.path.curvatures[0], 0.05 + 1e-6, atol=1e-12)


def test_an_arc_that_is_nearly_a_circle_is_closed_by_a_line():
    arc = ac.Path.from_segments([ac.Arc(start=(0, 0), center=(0, 0.05), angle=2 * np.pi - 1e-4)])
    (contour,), notes = chain_pieces([Piece(path=arc, name="arc", layer="0")], TOLERANCE)
    # To scale it so that its ends meet would make it many times larger.
    assert contour.closed and not notes
    assert contour.path.length == pytest.approx(arc.length + 5e-6, abs=1e-8)
    assert contour.path.curvatures.max() == 20
    lines = contour.path.lengths[contour.path.curvatures == 0]
    assert lines.sum() == pytest.approx(5e-6, rel=1e-3)


def test_a_piece_whose_ends_meet_within_the_tolerance_is_closed():
    bent = ac.Path.polyline([*SQUARE, (0, 4e-6)])
    (contour,), _ = chain_pieces([Piece(path=bent, name="a", layer="0")], TOLERANCE)
    assert contour.closed and len(contour.path) == 4
    np.testing.assert_allclose(contour.path.vertices[[0, -1]], [(0, 2e-6)] * 2, atol=1e-15)


def test_pieces_on_others_are_left_out_and_named():
    arc = ac.Path.from_segments([ac.Arc(start=(0, 0), center=(0, 0.05), angle=np.pi)])
    given_ = [
        *pieces(SQUARE),
        line((1, 0), (0, 0), "back"),
        Piece(path=arc, name="arc", layer="0"),
        Piece(path=reverse_path(arc), name="arc again", layer="0"),
        line((0, 0), (1, 0), "elsewhere", "other"),
        # The same ends and the same length are not the same piece.
        Piece(path=ac.Path.polyline([(9, 0), (9, 1), (10, 0)]), name="one way", layer="0"),
        Piece(path=ac.Path.polyline([(9, 0), (10, -1), (10, 0)]), name="other way", layer="0"),
    ]
    contours, notes = chain_pieces(given_, TOLERANCE)
    assert notes == ["Left out because they lie exactly on others: back, arc again."]
    assert "elsewhere" in {x.name for x in contours}
    total = sum(x.path.length for x in contours)
    assert total == pytest.approx(3 + arc.length + 1 + 2 * (1 + np.sqrt(2)))


def test_pieces_shorter_than_the_tolerance_are_part_of_their_chain():
    # A circle of 1 mm of lines of 3 µm, in no order.
    t = np.linspace(0, 2 * np.pi, 1001)
    points = 0.5e-3 * np.column_stack([np.cos(t), np.sin(t)])
    points[-1] = points[0]
    given_ = [line(a, b) for a, b in zip(points, points[1:], strict=False)]
    order = np.random.default_rng(0).permutation(len(given_))
    (contour,), notes = chain_pieces([given_[i] for i in order], TOLERANCE)
    assert contour.closed and len(contour.path) == 1000 and not notes


def test_a_micro_piece_between_gaps_makes_no_nonsense():
    given_ = [
        line((0, 0), (1, 0), "a"),
        line((1 + 3e-6, 0), (1 + 5e-6, 0), "micro"),
        line((1 + 8e-6, 0), (2, 0), "b"),
    ]
    contours, notes = chain_pieces(given_, TOLERANCE)
    assert sum(x.path.length for x in contours) == pytest.approx(2, abs=2e-5)
    assert [x.name for x in contours] == ["a"]
    assert gaps(contours[0].path)[:-1].max(initial=0) < 1e-9


def test_an_open_contour_shorter_than_the_tolerance_is_left_out_and_named():
    contours, notes = chain_pieces(
        [*pieces(SQUARE), line((5, 5), (5, 5 + 3e-6), "dust")], TOLERANCE
    )
    assert len(contours) == 1
    assert notes == ["Left out because their ends are one point within 1e-05 m: dust."]
    dot = ac.Path.from_segments([ac.Arc.circle((1e-6, 0), (0, 0))])
    contours, notes = chain_pieces([Piece(path=dot, name="dot", layer="0")], TOLERANCE)
    assert len(contours) == 1 and not notes


def test_demands_and_tags_go_with_their_segments():
    def asked(start, end, speed, tag):
        found = ac.Path.polyline([start, end], demand=ac.Demand(speed=speed, tag=tag))
        return Piece(path=found, name=tag, layer="0")

    (contour,), _ = chain_pieces(
        [asked((0, 0), (1, 0), 0.1, "a"), asked((2, 0), (1, 3e-6), 0.2, "b")], TOLERANCE
    )
    assert contour.path.tags == ("a", "b") and contour.path.speeds.tolist() == [0.1, 0.2]


def test_what_cannot_be_chained_is_refused(refuses):
    flat = line((0, 0), (1, 0))
    deep = Piece(path=lift_path(flat.path), name="", layer="0")
    held = Piece(path=deep.path.oriented(Rotation.identity()), name="", layer="0")
    refuses(lambda: chain_pieces([flat, deep], TOLERANCE), ac.InvalidInput, "plane or all in space")
    refuses(lambda: chain_pieces([held], TOLERANCE), ac.InvalidInput, "orientation")
    refuses(lambda: chain_pieces([flat], 0.0), ac.InvalidInput, "join tolerance", "above zero")
    assert chain_pieces([], TOLERANCE) == ([], [])


def circle_of_lines(n=20_000):
    t = np.linspace(0, 2 * np.pi, n + 1)
    p = np.column_stack([np.cos(t), np.sin(t)])
    p[-1] = p[0]
    order = np.random.default_rng(0).permutation(n)
    return p[:-1][order], p[1:][order], 1


def star(n=6_000):
    t = np.linspace(0, 2 * np.pi, n, endpoint=False)
    return np.zeros((n, 2)), np.column_stack([np.cos(t), np.sin(t)]), n // 2


def repeated(n=6_000):
    return np.zeros((n, 2)), np.ones((n, 2)), 1


@pytest.mark.parametrize("make", [circle_of_lines, star, repeated])
def test_thousands_of_pieces_take_no_time_to_speak_of(make):
    starts, ends, count = make()
    given_ = [line(a, b) for a, b in zip(starts, ends, strict=True)]
    begin = time.process_time()
    contours, _ = chain_pieces(given_, TOLERANCE)
    assert time.process_time() - begin < 2.5  # they take 0.4 s each
    assert len(contours) == count


def test_pieces_that_are_to_stay_apart_are_not_chain_pieces():
    pieces = [dataclasses.replace(line((k, 0), (k + 1, 0)), apart=k) for k in range(3)]
    contours, _ = chain_pieces(pieces, TOLERANCE)
    assert [x.layer for x in contours] == ["0"] * 3
    together = [dataclasses.replace(x, apart=7) for x in pieces]
    assert len(chain_pieces(together, TOLERANCE)[0]) == 1


def test_a_copy_that_is_cut_into_more_segments_is_left_out():
    once = line((0, 0), (2, 1), "whole")
    twice = Piece(path=ac.Path.polyline([(2, 1), (1.2, 0.6), (0, 0)]), name="parts", layer="0")
    (contour,), notes = chain_pieces([once, twice], TOLERANCE)
    assert contour.name == "whole"
    assert notes == ["Left out because they lie exactly on others: parts."]
