"""Leads on the side of the waste, whichever way contours are drawn and wherever they lie."""

from __future__ import annotations

import numpy as np
import pytest

import armcontour as ac
from armcontour.geometry.cutting import reverse_path
from armcontour.program.scrap_side import waste_sides

UP = np.array([0.0, 0.0, 1.0])
OUTLINE = ac.Path.polyline([(0, 0), (0.1, 0), (0.1, 0.06), (0, 0.06), (0, 0)])
HOLE = ac.Path.from_segments([ac.Arc.circle((0.03, 0.03), (0.02, 0.03))])
ISLAND = ac.Path.from_segments([ac.Arc.circle((0.024, 0.03), (0.02, 0.03))])
OPEN = ac.Path.polyline([(0.05, 0.01), (0.09, 0.05)])


def contours(*paths, layer="CUT"):
    return [ac.Contour(path=x, layer=layer) for x in paths]


def test_waste_is_outside_of_outlines_inside_of_holes_and_left_of_open_contours():
    sides = waste_sides(contours(OUTLINE, HOLE, ISLAND, OPEN), UP)
    assert sides == ["right", "left", "right", "left"]
    turned = [reverse_path(x) for x in (OUTLINE, HOLE, ISLAND)]
    assert waste_sides(contours(*turned), UP) == ["left", "right", "left"]


def test_only_contours_of_the_same_layer_hold_holes():
    marks = contours(HOLE, layer="MARK")
    assert waste_sides([*contours(OUTLINE), *marks], UP) == ["right", "right"]


def test_in_space_it_is_looked_at_from_above():
    frame = ac.Frame.rpy((0.4, 0.1, 0.2), (0.4, -0.3, 1.0))
    program = ac.Program(moves=tuple(contours(OUTLINE, HOLE))).placed(frame)
    assert waste_sides(program.contours, frame.rotation[:, 2]) == ["right", "left"]
    assert waste_sides(program.contours, -frame.rotation[:, 2]) == ["left", "right"]


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
