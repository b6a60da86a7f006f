"""Entities chained into contours, from divided, shuffled and reversed drawings."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import armcontour as ac
from armcontour.files.drawings.entity_chains import DrawnEntity, chain_pieces
from armcontour.geometry.path import cut_path

TOLERANCE = 1e-5  # Largest gap between the ends of chained entities [m]
SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]


def entity(path, name="", layer="0"):
    return DrawnEntity(path=path, name=name, where=name, layer=layer)


def line(start, end, name="", layer="0"):
    return entity(ac.Path.polyline([start, end]), name, layer)


def lines(points=SQUARE, names="abcdefghij"):
    """Return lines between successive points."""
    return [line(*x) for x in zip(points, points[1:], names, strict=False)]


def arc(angle=np.pi):
    """An arc of radius 50 mm from the origin."""
    return ac.Path(segments=[ac.Arc(start=(0, 0), center=(0, 0.05), angle=angle)])


def chained(entities, tolerance=TOLERANCE):
    """Chain entities that are one contour, without skipped entities, and return the contour."""
    (contour,), notes = chain_pieces(entities, tolerance)
    assert not notes
    return contour


def gaps(path):
    """Return the gaps between successive segments, and between the end and the start [m], (n,)."""
    ends = path.on_segment(np.arange(len(path)), path.lengths)
    return np.linalg.norm(ends - np.roll(path.starts, -1, axis=0), axis=1)


@given(order=st.permutations(range(4)), turned=st.lists(st.booleans(), min_size=4, max_size=4))
def test_entities_in_any_order_and_direction_are_one_closed_contour(order, turned):
    entities = [lines([*SQUARE, SQUARE[0]])[i] for i in order]
    entities = [
        entity(x.path.reversed(), x.name) if back else x
        for x, back in zip(entities, turned, strict=True)
    ]
    contour = chained(entities)
    assert contour.closed and len(contour.path) == 4
    # The contour starts with the first entity and has its direction.
    assert contour.name == entities[0].name
    np.testing.assert_allclose(contour.path.starts[0], entities[0].path.starts[0], atol=1e-15)
    np.testing.assert_allclose(contour.path.tangents[0], entities[0].path.tangents[0], atol=1e-15)
    assert contour.path.length == pytest.approx(4)


def test_an_open_chain_starts_in_the_direction_of_its_first_entity():
    a, b, c = lines()
    contour = chained([a, b, c])
    assert (contour.name, contour.layer, contour.closed) == ("a", "0", False)
    np.testing.assert_array_equal(contour.path.vertices, SQUARE)
    contour = chained([b, c, a])
    assert contour.name == "b"
    np.testing.assert_array_equal(contour.path.vertices, SQUARE)
    contour = chained([entity(b.path.reversed(), "b"), c, a])
    np.testing.assert_allclose(contour.path.vertices, SQUARE[::-1], atol=1e-15)


def test_contours_have_the_order_of_their_first_entities_on_each_layer():
    square = lines(names="abcd")
    other = [line((1, 0), (2, 0), "x", "other"), line((5, 5), (6, 5), "y")]
    contours, _ = chain_pieces([square[2], other[0], other[1], square[0], square[1]], TOLERANCE)
    summary = [(x.name, x.layer, len(x.path)) for x in contours]
    assert summary == [("c", "0", 3), ("x", "other", 1), ("y", "0", 1)]


def test_a_closed_entity_is_not_chained_with_a_line_at_its_start():
    circle = ac.Path(segments=[ac.Arc.circle((1, 0), (0, 0))])
    entities = [entity(circle, "circle"), line((1, 0), (3, 0), "line")]
    contours, _ = chain_pieces(entities, TOLERANCE)
    assert [x.closed for x in contours] == [True, False]
    for contour, drawn in zip(contours, entities, strict=True):
        np.testing.assert_array_equal(contour.path.vertices, drawn.path.vertices)


def test_only_entities_of_the_same_group_are_chained():
    row = [dataclasses.replace(line((k, 0), (k + 1, 0)), group=k) for k in range(3)]
    assert [x.layer for x in chain_pieces(row, TOLERANCE)[0]] == ["0"] * 3
    chained([dataclasses.replace(x, group=7) for x in row])


def test_at_a_junction_the_chain_continues_with_the_smallest_turn():
    stem, side, ahead = (line(*x) for x in (SQUARE[:2], SQUARE[1:3], ((1, 0), (2, 0.1))))
    for entities in ([stem, side, ahead], [side, ahead, stem], [ahead, stem, side]):
        contours, _ = chain_pieces(entities, TOLERANCE)
        chains_found = {frozenset(np.ravel(x.path.vertices[:, 0])) for x in contours}
        assert chains_found == {frozenset([0.0, 1.0, 2.0]), frozenset([1.0])}


def test_at_a_junction_with_equal_turns_the_chain_continues_with_the_earlier_entity():
    stem = line((0, 0), (1, 0), "stem")
    left_turn = line((1, 0), (2, 1), "left")
    right_turn = line((1, 0), (2, -1), "right")
    for earlier, later in ((left_turn, right_turn), (right_turn, left_turn)):
        chain, rest = chain_pieces([stem, earlier, later], TOLERANCE)[0]
        assert rest.name == later.name
        assert chain.path.vertices[-1, 1] == earlier.path.vertices[-1, 1]


def test_at_a_junction_ends_that_touch_come_before_ends_with_a_gap():
    stem = line((0, 0), (1, 0), "stem")
    touching = line((1, 0), (1, 1), "touches")
    with_gap = line((1, 5e-6), (2, 0), "gap")
    chain, rest = chain_pieces([stem, with_gap, touching], TOLERANCE)[0]
    assert (chain.name, rest.name) == ("stem", "gap")
    assert len(chain.path) == 2 and chain.path.vertices[-1].tolist() == [1, 1]


def divided_contour(seed, dimension, largest_shift):
    """Divide a closed contour into shuffled, reversed and shifted entities; return both."""
    rng = np.random.default_rng(seed)
    corner = np.array([(0, 0), (0.1, 0), (0.1, 0.06), (0, 0.06), (0, 0)])
    whole = ac.round_corners(ac.Path.polyline(corner), tolerance=5e-3)
    if dimension == 3:
        whole = whole.lifted()
    cuts = np.sort(np.concatenate([whole.breaks, rng.uniform(0, whole.length, 6)]))
    cuts = cuts[np.concatenate([[True], np.diff(cuts) > 1e-4])]
    cuts[-1] = whole.length
    entities = []
    for a, b in zip(cuts, cuts[1:], strict=False):
        part = cut_path(whole, a, b)
        shift = rng.normal(size=dimension)
        shift *= rng.uniform(0, largest_shift) / np.linalg.norm(shift)
        starts = part.starts + shift
        shifted = ac.Path(segments=dataclasses.replace(part.segments, starts=starts))
        entities.append(entity(shifted.reversed() if rng.random() < 0.5 else shifted))
    return [entities[i] for i in rng.permutation(len(entities))], whole


@pytest.mark.parametrize("dimension", [2, 3])
def test_gaps_are_closed_and_no_point_moves_by_more_than_the_tolerance(dimension):
    for seed in range(8):
        entities, _ = divided_contour(seed, dimension, 0.45 * TOLERANCE)
        contour = chained(entities)
        path = contour.path
        assert contour.closed and gaps(path).max() < 1e-9, seed
        assert len(path) == sum(len(x.path) for x in entities)
        for x in entities:
            points = x.path(np.linspace(0, x.path.length, 50))
            assert path.project(points).distance.max() <= TOLERANCE, seed
        # Arcs are arcs of the same angle.
        turns = np.concatenate([x.path.curvatures * x.path.lengths for x in entities])
        np.testing.assert_allclose(
            np.sort(path.curvatures * path.lengths), np.sort(turns), atol=1e-9
        )


@pytest.mark.parametrize("dimension", [2, 3])
def test_entities_that_meet_exactly_are_not_changed(dimension):
    for seed in range(4):
        entities, whole = divided_contour(seed, dimension, 0.0)
        contour = chained(entities)
        assert contour.closed
        # Rounding is no gap, so tangent arcs stay tangent: one corner remains.
        sharp = np.flatnonzero(contour.path.turns > 1e-9)
        assert len(sharp) <= 1
        np.testing.assert_allclose(contour.path.vertices[sharp + 1], 0, atol=1e-12)
        assert contour.path.length == pytest.approx(whole.length, rel=1e-12)


def test_gaps_up_to_the_tolerance_are_closed():
    entities = [line((0, 0), (1, 0), "a"), line((1, 1.1e-5), (1, 1), "b")]
    assert len(chain_pieces(entities, TOLERANCE)[0]) == 2
    assert len(chain_pieces(entities, 2e-5)[0]) == 1


def test_the_end_of_an_arc_is_moved_to_the_middle_of_a_gap():
    """A similarity moves it, so the angle of the arc does not change."""
    path = chained([entity(arc(), "arc"), line((0, 0.1 + 4e-6), (-1, 0.1), "line")]).path
    np.testing.assert_allclose(path.vertices[1], (0, 0.1 + 2e-6), atol=1e-12)
    np.testing.assert_allclose(path.curvatures[0] * path.lengths[0], np.pi)
    np.testing.assert_allclose(1 / path.curvatures[0], 0.05 + 1e-6, atol=1e-12)


def test_an_arc_of_almost_a_full_circle_is_closed_by_a_line():
    """A similarity that makes its ends meet would make it many times larger."""
    contour = chained([entity(arc(2 * np.pi - 1e-4))])
    assert contour.closed
    assert contour.path.length == pytest.approx((2 * np.pi - 1e-4) * 0.05 + 5e-6, abs=1e-8)
    assert contour.path.curvatures.max() == 20
    lines = contour.path.lengths[contour.path.curvatures == 0]
    assert lines.sum() == pytest.approx(5e-6, rel=1e-3)


def test_an_entity_whose_ends_meet_within_the_tolerance_is_closed():
    contour = chained([entity(ac.Path.polyline([*SQUARE, (0, 4e-6)]), "a")])
    assert contour.closed and len(contour.path) == 4
    np.testing.assert_allclose(contour.path.vertices[[0, -1]], [(0, 2e-6)] * 2, atol=1e-15)


def test_duplicate_entities_are_skipped_and_named():
    entities = [
        *lines(),
        line((1, 0), (0, 0), "back"),
        entity(arc(), "arc"),
        entity(arc().reversed(), "arc again"),
        line((0, 0), (1, 0), "elsewhere", "other"),
        # These entities have equal ends and lengths, but are different.
        entity(ac.Path.polyline([(9, 0), (9, 1), (10, 0)]), "one way"),
        entity(ac.Path.polyline([(9, 0), (10, -1), (10, 0)]), "other way"),
    ]
    contours, (note,) = chain_pieces(entities, TOLERANCE)
    assert note.endswith(": back, arc again.")
    assert "elsewhere" in {x.name for x in contours}
    total = sum(x.path.length for x in contours)
    assert total == pytest.approx(3 + arc().length + 1 + 2 * (1 + np.sqrt(2)))


def test_contours_shorter_than_the_tolerance_are_skipped():
    contours, (note,) = chain_pieces([*lines(), line((5, 5), (5, 5 + 3e-6), "dust")], TOLERANCE)
    assert len(contours) == 1 and "0.01 mm" in note and note.endswith(": dust.")


def test_closed_contours_smaller_than_the_tolerance_are_skipped():
    speck = 1e-7 * np.array([[0, 0], [30, 5], [0, 9], [9, 30], [25, 0], [0, 0]])
    for path in (
        ac.Path(segments=[ac.Arc.circle((4.9e-6, 0), (0, 0))]),
        ac.Path.polyline(speck),
        ac.Path.polyline([(0, 0), (6e-6, 0), (0, 0)]),
    ):
        contours, (note,) = chain_pieces([*lines(), entity(path, "speck")], TOLERANCE)
        assert len(contours) == 1 and note.endswith(": speck.")
    chained([entity(ac.Path(segments=[ac.Arc.circle((6e-6, 0), (0, 0))]), "dot")])


def test_segments_keep_their_speeds_and_tags():
    def limited_line(start, end, speed, tag):
        return entity(
            ac.Path.polyline([start, end], segment_limits=ac.SegmentLimits(speed=speed, tag=tag)),
            tag,
        )

    path = chained(
        [limited_line((0, 0), (1, 0), 0.1, "a"), limited_line((2, 0), (1, 3e-6), 0.2, "b")]
    ).path
    assert path.tags == ("a", "b") and path.speeds.tolist() == [0.1, 0.2]
