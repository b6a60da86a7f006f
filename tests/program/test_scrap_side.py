"""Leads on the side of the waste, whichever way contours are drawn and wherever they lie."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import armcontour as ac
from armcontour.errors import InvalidInput
from armcontour.geometry.cutting import reverse_path
from armcontour.program import Leads
from armcontour.program.scrap_side import waste_sides

PLAIN = ac.Process()
OUTLINE = ac.Path.polyline([(0, 0), (0.1, 0), (0.1, 0.06), (0, 0.06), (0, 0)])
HOLE = ac.Path.from_segments([ac.Arc.circle((0.03, 0.03), (0.02, 0.03))])
ISLAND = ac.Path.from_segments([ac.Arc.circle((0.024, 0.03), (0.02, 0.03))])
OPEN = ac.Path.polyline([(0.05, 0.01), (0.09, 0.05)])


def contours(*paths, layer="CUT"):
    return [ac.Contour(path=x, layer=layer) for x in paths]


def test_waste_is_outside_of_outlines_inside_of_holes_and_left_of_open_contours():
    sides = waste_sides(contours(OUTLINE, HOLE, ISLAND, OPEN), PLAIN)
    assert sides == ["right", "left", "right", "left"]
    turned = [reverse_path(x) for x in (OUTLINE, HOLE, ISLAND)]
    assert waste_sides(contours(*turned), PLAIN) == ["left", "right", "left"]


def test_a_hole_is_a_hole_whatever_layers_it_and_its_outline_are_on():
    found = [*contours(OUTLINE), *contours(HOLE, layer="HOLES"), *contours(ISLAND, layer="PARTS")]
    assert waste_sides(found, PLAIN) == ["right", "left", "right"]


def test_contours_of_layers_that_are_not_cut_hold_no_holes():
    ring = ac.Path.from_segments([ac.Arc.circle((0.035, 0.03), (0.02, 0.03))])
    found = [*contours(OUTLINE, HOLE), *contours(ring, layer="MARK")]
    assert waste_sides(found, PLAIN)[1] == "right"
    marked = ac.Process(kerf=1e-3, by_layer={"MARK": {"kerf": None}})
    assert waste_sides(found, marked) == ["right", "left", "left"]
    hole, mark, outline = ac.prepare(ac.Program(moves=tuple(found)), marked).contours
    assert mark.path is ring
    np.testing.assert_allclose(1 / hole.path.curvatures, 9.5e-3)
    assert outline.path.vertices.min() == pytest.approx(-5e-4)


def test_in_space_it_is_looked_at_from_above():
    frame = ac.Frame.rpy((0.4, 0.1, 0.2), (0.4, -0.3, 1.0))
    program = ac.Program(moves=tuple(contours(OUTLINE, HOLE))).placed(frame)
    assert waste_sides(program.contours, ac.Process(up=frame.rotation[:, 2])) == ["right", "left"]
    assert waste_sides(program.contours, ac.Process(up=-frame.rotation[:, 2])) == ["left", "right"]


@pytest.mark.parametrize("turned", [False, True])
def test_arcs_of_leads_lie_in_the_waste(turned):
    paths = [reverse_path(x) if turned else x for x in (OUTLINE, HOLE)]
    lead = ac.Lead(length=4e-3, shape="arc")
    process = ac.Process(lead_in=lead, lead_out=lead, overlap=2e-3)
    # What lies inside is cut first.
    hole, outline = ac.prepare(ac.Program(moves=tuple(contours(*paths))), process).contours
    for x in (outline, hole):
        assert x.closed
        ends = x.path([0.0, x.path.length])
        inside = (ends > 0).all() and (ends < [0.1, 0.06]).all()
        assert inside == (x is hole)
    away = np.linalg.norm(hole.path([0.0, hole.path.length]) - (0.02, 0.03), axis=1)
    assert (away < 0.01).all()


def test_where_it_is_resumed_the_sides_are_those_of_what_is_left():
    lead = ac.Lead(length=4e-3, shape="arc")
    program = ac.Program(moves=tuple(contours(OUTLINE, HOLE)))
    process = ac.Process(lead_in=lead, order="drawn", from_s=OUTLINE.length)
    rest = ac.prepare(program, process)
    (hole,) = rest.contours
    assert np.linalg.norm(hole.path(0.0) - (0.02, 0.03)) < 0.01


LEAD = ac.Lead(length=4e-3, shape="arc")


def circle(radius, center=(0.02, 0.03), **values):
    start = (center[0] + radius, center[1])
    return ac.Contour(path=ac.Path.from_segments([ac.Arc.circle(start, center)]), **values)


def refused_lead(*moves, **values):
    """What the refusal of a lead says is the longest that fits [m]."""
    with pytest.raises(InvalidInput) as caught:
        ac.prepare(ac.Program(moves=moves), ac.Process(**{"order": "drawn", **values}))
    return caught.value.allowed


def test_a_lead_that_leaves_its_hole_is_refused_on_every_layer_with_the_longest_that_fits():
    plate = contours(OUTLINE)[0]
    for layer in ("CUT", "HOLES"):
        hole = circle(3e-3, layer=layer)
        fits = refused_lead(plate, hole, lead_in=dataclasses.replace(LEAD, length=0.02))
        # A quarter circle of the hole's own radius runs along the hole.
        assert fits == pytest.approx(3e-3 * np.pi / 2, rel=0.02)
        assert refused_lead(
            plate, hole, lead_out=dataclasses.replace(LEAD, length=0.02)
        ) == pytest.approx(fits)
        short = dataclasses.replace(LEAD, length=0.99 * fits)
        done = ac.prepare(
            ac.Program(moves=(plate, hole)), ac.Process(lead_in=short, lead_out=short)
        )
        (inner,) = (x for x in done.contours if x.layer == layer and x.path.length < 0.1)
        assert (
            np.linalg.norm(inner.path([0.0, inner.path.length]) - (0.02, 0.03), axis=1) < 3e-3
        ).all()


def test_a_lead_of_automatic_length_is_shortened_to_what_fits_with_a_note():
    program = ac.Program(moves=(contours(OUTLINE)[0], circle(3e-3, name="small")))
    auto = ac.Lead(shape="arc")
    lengths = [Leads(before=4e-3), Leads(before=0.02)]
    done = ac.prepare(program, ac.Process(lead_in=auto, order="drawn"), lengths)
    outer, hole = done.contours
    assert outer.work[0] == pytest.approx(4e-3)
    assert hole.work[0] == pytest.approx(3e-3 * np.pi / 2, rel=0.02)
    assert sum("small" in x and "lead-in" in x for x in done.notes) == 1


def test_a_lead_that_crosses_another_contour_is_refused():
    other = ac.Path.polyline([(0.02, -0.002), (0.08, -0.002), (0.08, -0.02), (0.02, -0.002)])
    fits = refused_lead(
        *contours(OUTLINE, layer="A"),
        *contours(other, layer="B"),
        lead_in=dataclasses.replace(LEAD, length=0.02),
    )
    # The arc of this length touches the other contour with its free end.
    assert fits == pytest.approx(2e-3 * np.pi / 2, rel=0.01)
    marked = ac.Process(
        kerf=1e-6,
        by_layer={"B": {"kerf": None, "lead_in": None}},
        lead_in=dataclasses.replace(LEAD, length=0.02),
        order="drawn",
    )
    moves = (*contours(OUTLINE, layer="A"), *contours(other, layer="B"))
    assert ac.prepare(ac.Program(moves=moves), marked).contours[0].work[0] == pytest.approx(0.02)


@pytest.mark.parametrize("turned", [False, True])
def test_leads_at_a_corner_of_a_hole_lie_in_the_waste(turned):
    window = ac.Path.polyline(
        [(0.02, 0.02), (0.05, 0.02), (0.05, 0.04), (0.02, 0.04), (0.02, 0.02)]
    )
    window = reverse_path(window) if turned else window
    for more in ({}, {"overlap": 1e-3}, {"kerf": 1e-3}, {"kerf": 1e-3, "passes": 2}):
        process = ac.Process(begin="drawn", lead_in=LEAD, lead_out=LEAD, **more)
        hole, outline = ac.prepare(
            ac.Program(moves=tuple(contours(OUTLINE, window))), process
        ).contours
        on, off = hole.work
        path = hole.path
        for s in (np.linspace(0, 0.99 * on, 20), np.linspace(off + 0.04e-3, path.length, 20)):
            points = path(s)
            assert ((points > (0.02, 0.02)) & (points < (0.05, 0.04))).all()
        assert on == pytest.approx(4e-3) and path.length - off == pytest.approx(4e-3)


def test_leads_of_a_contour_that_has_an_overlap_already_touch_its_tangent():
    (around,) = ac.prepare(ac.Program(moves=(circle(0.01),)), ac.Process(overlap=2e-3)).contours
    done = ac.prepare(
        ac.Program(moves=(around,)), ac.Process(begin="drawn", lead_in=LEAD, lead_out=LEAD)
    ).path
    assert done.curvatures[[0, -1]] == pytest.approx([np.pi / 2 / 4e-3] * 2)


def test_random_leads_lie_in_the_waste_or_are_refused():
    rng = np.random.default_rng(7)
    refused = 0
    for _ in range(40):
        n = int(rng.integers(3, 8))
        angles = 2 * np.pi * (np.arange(n) + 0.4 * rng.random(n)) / n
        radius = 0.01 * rng.uniform(0.3, 1, n)
        points = np.column_stack([np.cos(angles), np.sin(angles)]) * radius[:, None] + (0.04, 0.03)
        points = np.vstack([points, points[:1]])[:: rng.choice([-1, 1])]
        hole = ac.Contour(path=ac.Path.polyline(points), layer="HOLES")
        lead = dataclasses.replace(LEAD, length=rng.uniform(1e-3, 8e-3))
        process = ac.Process(
            lead_in=lead, lead_out=lead, begin=str(rng.choice(["drawn", "auto"])), order="drawn"
        )
        try:
            done = ac.prepare(ac.Program(moves=(*contours(OUTLINE), hole)), process)
        except InvalidInput as error:
            assert error.allowed < lead.length
            refused += 1
            continue
        path, (on, off) = done.contours[1].path, done.contours[1].work
        share = np.linspace(0, 0.98, 30)
        for p in (*path(share * on), *path(path.length - share * (path.length - off))):
            # The winding number of the hole around the point.
            a = np.arctan2(*(points - p).T[::-1])
            turns = (np.diff(a) + np.pi) % (2 * np.pi) - np.pi
            assert abs(round(turns.sum() / (2 * np.pi))) == 1
    assert 5 < refused < 35
