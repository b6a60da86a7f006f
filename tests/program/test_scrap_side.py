"""Leads on the waste side, for any direction and position of contours."""

import numpy as np
import pytest
from tests.geometry.tables import each

import armcontour as ac
from armcontour.core.errors import InvalidInput
from armcontour.program import Lead, Leads
from armcontour.program.kerf import waste_sides

PLAIN = ac.Process()
OUTLINE = ac.Path.polyline([(0, 0), (0.1, 0), (0.1, 0.06), (0, 0.06), (0, 0)])
CENTER = np.array([0.02, 0.03])


def circle(radius, center=CENTER):
    start = (center[0] + radius, center[1])
    return ac.Path(segments=[ac.Arc.circle(start, center)])


# Circles around the same centre: the hole of a part, and an island inside it.
HOLE = circle(0.01)
ISLAND = circle(0.004)
OPEN = ac.Path.polyline([(0.05, 0.01), (0.09, 0.05)])


def contours(*paths, layer="CUT"):
    return [ac.Contour(path=x, layer=layer) for x in paths]


def prepared(moves, *lengths, **values):
    return ac.prepare(ac.Program(moves=tuple(moves)), ac.Process(**values), *lengths)


def lead(length=4e-3):
    return Lead(length=length, shape="arc")


def ends(contour):
    return contour.path([0.0, contour.path.length])


def test_waste_is_outside_outlines_and_inside_holes_of_cut_layers():
    sides = waste_sides(contours(OUTLINE, HOLE, ISLAND, OPEN), PLAIN)
    assert sides == ["right", "left", "right", "left"]
    turned = [x.reversed() for x in (OUTLINE, HOLE, ISLAND)]
    assert waste_sides(contours(*turned), PLAIN) == ["left", "right", "left"]
    # A hole is a hole whatever layers it and its outline are on.
    contour_list = [
        *contours(OUTLINE),
        *contours(HOLE, layer="HOLES"),
        *contours(ISLAND, layer="PARTS"),
    ]
    assert waste_sides(contour_list, PLAIN) == ["right", "left", "right"]
    # In space, the view is along the negative `up`.
    frame = ac.Frame.rpy((0.4, 0.1, 0.2), (0.4, -0.3, 1.0))
    placed = ac.Program(moves=tuple(contours(OUTLINE, HOLE))).placed(frame).contours
    up = frame.rotation[:, 2]
    assert waste_sides(placed, ac.Process(up=up)) == ["right", "left"]
    assert waste_sides(placed, ac.Process(up=-up)) == ["left", "right"]
    ring = circle(0.015)
    contour_list = [*contours(OUTLINE, HOLE), *contours(ring, layer="MARK")]
    assert waste_sides(contour_list, PLAIN)[1] == "right"
    marked = {"kerf": 1e-3, "by_layer": {"MARK": {"kerf": None}}}
    assert waste_sides(contour_list, ac.Process(**marked)) == ["right", "left", "left"]
    hole, mark, outline = prepared(contour_list, **marked).contours
    assert mark.path is ring
    np.testing.assert_allclose(1 / hole.path.curvatures, 9.5e-3)
    assert outline.path.vertices.min() == pytest.approx(-5e-4)


def test_arcs_of_leads_lie_in_the_waste():
    for paths in ((OUTLINE, HOLE), (OUTLINE.reversed(), HOLE.reversed())):
        # What lies inside is cut first.
        prepared_program = prepared(contours(*paths), lead_in=lead(), lead_out=lead(), overlap=2e-3)
        hole, outline = prepared_program.contours
        assert hole.closed and outline.closed
        inside = [((ends(x) > 0) & (ends(x) < [0.1, 0.06])).all() for x in (hole, outline)]
        assert inside == [True, False]
        assert (np.linalg.norm(ends(hole) - CENTER, axis=1) < 0.01).all()
    # After a resume, the remaining contours determine the sides.
    rest = prepared(
        contours(OUTLINE, HOLE), lead_in=lead(), order="drawn", resume_at=OUTLINE.length
    )
    (hole,) = rest.contours
    assert np.linalg.norm(hole.path(0.0) - CENTER) < 0.01


def longest(*moves, **values):
    """What the refusal of a lead says is the longest that fits [m]."""
    with pytest.raises(InvalidInput) as caught:
        prepared(moves, **{"order": "drawn", **values})
    return caught.value.allowed


def test_a_lead_that_leaves_its_hole_is_refused_with_the_longest_valid_one():
    (plate,) = contours(OUTLINE)
    small = circle(3e-3)
    for layer in ("CUT", "HOLES"):
        (hole,) = contours(small, layer=layer)
        fits = longest(plate, hole, lead_in=lead(0.02))
        # A quarter circle of the hole's own radius runs along the hole.
        assert fits == pytest.approx(3e-3 * np.pi / 2, rel=0.02)
        assert longest(plate, hole, lead_out=lead(0.02)) == pytest.approx(fits)
        prepared_program = prepared(
            (plate, hole), lead_in=lead(0.99 * fits), lead_out=lead(0.99 * fits)
        )
        (inner,) = (
            x for x in prepared_program.contours if x.layer == layer and x.path.length < 0.1
        )
        assert (np.linalg.norm(ends(inner) - CENTER, axis=1) < 3e-3).all()
    # One of automatic length is shortened to what fits, with a note.
    lengths = [Leads(before=4e-3), Leads(before=0.02)]
    moves = plate, ac.Contour(path=small, name="small")
    prepared_program = prepared(moves, lengths, lead_in=Lead(shape="arc"), order="drawn")
    outer, hole = prepared_program.contours
    assert outer.work[0] == pytest.approx(4e-3)
    assert hole.work[0] == pytest.approx(3e-3 * np.pi / 2, rel=0.02)
    assert sum("small" in x and "lead-in" in x for x in prepared_program.notes) == 1


def test_a_lead_that_crosses_another_contour_is_refused():
    other = ac.Path.polyline([(0.02, -0.002), (0.08, -0.002), (0.08, -0.02), (0.02, -0.002)])
    moves = *contours(OUTLINE, layer="A"), *contours(other, layer="B")
    # The arc of this length touches the other contour with its free end.
    assert longest(*moves, lead_in=lead(0.02)) == pytest.approx(2e-3 * np.pi / 2, rel=0.01)
    by_layer = {"B": {"kerf": None, "lead_in": None}}
    marked = prepared(moves, kerf=1e-6, by_layer=by_layer, lead_in=lead(0.02), order="drawn")
    assert marked.contours[0].work[0] == pytest.approx(0.02)


def test_random_leads_lie_in_the_waste_or_are_refused():
    rng = np.random.default_rng(7)
    refusals = 0
    for _ in range(30):
        n = int(rng.integers(3, 8))
        angles = 2 * np.pi * (np.arange(n) + 0.4 * rng.random(n)) / n
        radius = 0.01 * rng.uniform(0.3, 1, n)
        points = np.column_stack([np.cos(angles), np.sin(angles)]) * radius[:, None] + (0.04, 0.03)
        points = np.vstack([points, points[:1]])[:: rng.choice([-1, 1])]
        moves = *contours(OUTLINE), *contours(ac.Path.polyline(points), layer="HOLES")
        length = rng.uniform(1e-3, 8e-3)
        both = {"lead_in": lead(length), "lead_out": lead(length), "order": "drawn"}
        try:
            prepared_program = prepared(moves, begin=str(rng.choice(["drawn", "auto"])), **both)
        except InvalidInput as error:
            assert error.allowed < length
            refusals += 1
            continue
        path = prepared_program.contours[1].path
        on, work_end = prepared_program.contours[1].work
        share = np.linspace(0, 0.98, 30)
        for p in (*path(share * on), *path(path.length - share * (path.length - work_end))):
            # The winding number of the hole around the point.
            a = np.arctan2(*(points - p).T[::-1])
            turns = (np.diff(a) + np.pi) % (2 * np.pi) - np.pi
            assert abs(round(turns.sum() / (2 * np.pi))) == 1
    assert 4 < refusals < 26


# ------------------------------------------------------------------------------------- direction


def turns_left(path, up=(0.0, 0.0, 1.0)):
    """Whether a closed path is counter-clockwise, by the area of a polygon."""
    points = path(np.linspace(0, path.length, 2001))
    points = np.pad(points, ((0, 0), (0, 3 - path.dimension)))
    area = np.cross(points[:-1], points[1:]).sum(axis=0)
    return bool(area @ up > 0)


@each(
    "direction, turning_left",
    [
        ("climb", [False, True, False]),
        ("conventional", [True, False, True]),
        ("clockwise", [False] * 3),
        ("counterclockwise", [True] * 3),
    ],
)
def test_closed_contours_run_in_the_direction_of_the_process(direction, turning_left):
    frame = ac.Frame.rpy((0.4, 0.1, 0.2), (0.4, -0.3, 1.0))
    up = frame.rotation[:, 2]
    drawn = OUTLINE, HOLE, ISLAND
    # As mirrored blocks of a drawing are: any of them runs the other way.
    for mask in range(8):
        paths = [x.reversed() if mask & 1 << k else x for k, x in enumerate(drawn)]
        moves = [*contours(*paths), *contours(OPEN)]
        for values in ({}, {"kerf": 1e-3}):
            prepared_contours = prepared(
                moves, direction=direction, order="drawn", **values
            ).contours
            assert [turns_left(x.path) for x in prepared_contours[:3]] == turning_left
            np.testing.assert_array_equal(prepared_contours[3].path.vertices, OPEN.vertices)
    placed = ac.Program(moves=tuple(moves)).placed(frame)
    prepared_contours = ac.prepare(placed, ac.Process(direction=direction, up=up)).contours
    assert [turns_left(x.path, up) for x in prepared_contours[:3]] == turning_left


def test_a_layer_has_its_own_direction_unless_its_contours_have_events():
    moves = [*contours(OUTLINE), *contours(HOLE, layer="HOLES")]
    by_layer = {"HOLES": {"direction": "clockwise"}}
    prepared_contours = prepared(
        moves, direction="counterclockwise", by_layer=by_layer, order="drawn"
    ).contours
    assert [turns_left(x.path) for x in prepared_contours] == [True, False]
    end, inner = (
        ac.Contour(path=OUTLINE, name="rim", events=(ac.Event(name="glue", s=s),))
        for s in (OUTLINE.length, 0.05)
    )
    (prepared_contours,) = prepared([end], direction="clockwise").contours
    assert [x.s for x in prepared_contours.events] == pytest.approx([prepared_contours.path.length])
    with pytest.raises(InvalidInput, match=r"contour 1 \(rim\) .* clockwise.* glue"):
        prepared([inner], direction="clockwise")
    assert prepared([inner], direction="counterclockwise").contours[0].events[0].s == 0.05
