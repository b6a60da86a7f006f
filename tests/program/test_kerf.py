"""Kerf: offset contours against formulas and the independent checker of the soak."""

import ezdxf
import numpy as np
import pytest
from soak import kerf as judge
from tests.geometry.tables import each, line, path_of, refused

import armcontour as ac
from armcontour.core.errors import InvalidInput
from armcontour.geometry import Arc, Path
from armcontour.program import Contour, Event, Lead, Process, Program, Rapid, prepare

SQUARE = Path.polyline([[0, 0], [0.1, 0], [0.1, 0.06], [0, 0.06], [0, 0]])
LEFT = [[0.06, 0.022], [0.04, 0.022], [0.04, 0.04], [0, 0.04], [0, 0]]
RIGHT = [[0.06, 0.018], [0.06, 0], [0.1, 0], [0.1, 0.04], [0.06, 0.04]]
DUMBBELL = Path.polyline([[0, 0], [0.04, 0], [0.04, 0.018], *RIGHT, *LEFT])
BEND = Path.polyline([[0, 0], [0.05, 0], [0.05, 0.05]])


def circle(x, y, radius, name="", layer=""):
    path = Path(segments=[Arc.circle((x + radius, y), (x, y))])
    return Contour(path=path, name=name, layer=layer)


def cut(*contours, kerf, **values):
    moves = tuple(Contour(path=x) if isinstance(x, Path) else x for x in contours)
    return prepare(Program(moves=moves), Process(kerf=kerf, begin="drawn", **values))


def names(program):
    return [x.name for x in program.contours]


def radii(program):
    return [1 / x.path.curvatures[0] for x in program.contours]


def area(path):
    points = path(np.linspace(0, path.length, 20_001))
    x, y = points.T
    return abs(float(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]))) / 2


def test_lines_and_corners_are_offset_outside_and_inside():
    d = 1e-4
    for drawn in (SQUARE, SQUARE.reversed()):
        (offset_contour,) = cut(drawn, kerf=2 * d).contours
        assert offset_contour.closed and len(offset_contour.path) == 8
        assert sorted(offset_contour.path.curvatures.tolist()) == pytest.approx(
            [0] * 4 + [1 / d] * 4
        )
        assert offset_contour.path.length == pytest.approx(0.32 + 2 * np.pi * d, abs=1e-14)
        assert np.linalg.norm(offset_contour.path(0.0)) == pytest.approx(d, abs=1e-12)
        assert not (offset_contour.path.turns > 1e-9).any()
    drawn = Contour(path=SQUARE), circle(-0.1, 0, 0.03), circle(0, 0, 0.2)
    inner, small, outer = cut(*drawn, kerf=0.002).contours
    np.testing.assert_allclose(np.ptp(inner.path.vertices, axis=0), [0.098, 0.058], atol=1e-15)
    assert len(inner.path) == 4
    assert 1 / small.path.curvatures == pytest.approx([0.029], abs=1e-15)
    assert 1 / outer.path.curvatures == pytest.approx([0.201], abs=1e-15)
    center = outer.path.starts[0] + outer.path.normals[0] / outer.path.curvatures[0]
    np.testing.assert_allclose(center, [0, 0], atol=1e-15)


def test_a_contour_that_the_kerf_divides_becomes_several_named_contours():
    drawn = circle(0.05, 0.02, 0.2, name="outline"), Contour(path=DUMBBELL, name="slot")
    cut_program = cut(*drawn, kerf=0.005)
    assert names(cut_program) == ["slot/1", "slot/2", "outline"]
    # A square, and what the tool reaches into the mouth, between circles around its vertices.
    d = 2.5e-3
    half = 2e-3
    mouth = 2 * d * half - half * np.sqrt(d**2 - half**2) - d**2 * np.arcsin(half / d)
    areas = [area(x.path) for x in cut_program.contours[:2]]
    assert areas == pytest.approx([0.035**2 + mouth] * 2, abs=1e-10)
    assert np.linalg.norm(cut_program.contours[0].path(0.0) - [0.0025, 0.0025]) < 1e-12
    assert names(cut(*drawn, kerf=0.003)) == ["slot", "outline"]


def test_a_kerf_too_wide_for_a_hole_is_refused_on_every_layer():
    outline = circle(0, 0, 0.05, layer="CUT")
    for layer in ("CUT", "HOLES"):
        hole = circle(0.01, 0, 0.0045, name="hole 7", layer=layer)
        cut_program = cut(outline, hole, kerf=1.2e-3)
        assert radii(cut_program) == pytest.approx([3.9e-3, 50.6e-3], abs=1e-15)
        with pytest.raises(InvalidInput, match=r"contour 2 \(hole 7\): a kerf of 12 mm") as caught:
            cut(outline, hole, kerf=12e-3)
        assert caught.value.allowed == pytest.approx(9e-3, rel=1e-3)
        assert len(cut(outline, hole, kerf=8.9e-3).contours) == 2
        near = circle(0.101, 0, 0.05, layer=layer)
        refused((lambda x=near: cut(outline, x, kerf=1.2e-3),))


def test_a_layer_can_have_its_own_kerf():
    outline = circle(0, 0, 0.05, layer="A")
    hole = circle(0, 0, 0.02, layer="B")
    by_layer = {"B": {"kerf": 4e-3}}
    cut_program = cut(outline, hole, kerf=1e-3, by_layer=by_layer)
    assert radii(cut_program) == pytest.approx([0.018, 0.0505], abs=1e-15)
    other = circle(0.1025, 0, 0.05, layer="B")
    assert len(cut(outline, other, kerf=1e-3).contours) == 2
    refused((lambda: cut(outline, other, kerf=1e-3, by_layer=by_layer),))
    # A kerf of zero states that the process cuts.
    cut_program = cut(outline, hole, kerf=0.0)
    assert [x.layer for x in cut_program.contours] == ["B", "A"] and cut_program.contours[
        0
    ].path is hole.path


def test_contours_that_cross_themselves_or_are_too_near_are_refused():
    eight = Path.polyline([[0, 0], [0.1, 0.1], [0.1, 0], [0, 0.1], [0, 0]])
    a = circle(0, 0, 0.05, name="a")
    b = circle(0.1001, 0, 0.05, name="b")
    across = circle(0.05, 0, 0.05, name="c")
    led = Contour(path=SQUARE, work=(0.01, 0.1))
    # An island that the cut of its hole goes around.
    rings = [circle(0, 0, r, name=str(r)) for r in (0.05, 0.02, 0.0199)]
    ramp = Path.polyline([[0, 0, 0], [0.1, 0, 0], [0.1, 0.1, 0.01], [0, 0, 0]])
    refused(
        (lambda: cut(eight, kerf=1e-3), "contour 1 crosses", "(50, 50) mm"),
        (lambda: cut(a, b, kerf=2e-4), "contour 1 (a) and contour 2 (b) cross", "kerf of 0.2 mm"),
        (lambda: cut(a, across, kerf=2e-3), "contour 1 (a) and contour 2 (c) cross"),
        (lambda: cut(*rings, kerf=2e-3), "0.02", "0.0199", "nearer"),
        (lambda: cut(led, kerf=1e-3), "already has leads"),
        (lambda: cut(ramp, kerf=1e-3), "contour 1 leaves the plane"),
        (lambda: Process(kerf=-1e-3), "kerf"),
        (lambda: Process(kerf_side="top"), "kerf_side"),
    )
    assert len(cut(a, b, kerf=0.99e-4).contours) == 2
    assert len(cut(*rings, kerf=0.9e-4).contours) == 3


def test_open_contours_are_offset_only_if_a_side_is_given():
    mark = Contour(path=BEND, name="mark")
    cut_program = cut(mark, circle(0, 0, 0.2), kerf=2e-3)
    assert any(x.path is BEND for x in cut_program.contours)
    (note,) = cut_program.notes
    assert "contour 1 (mark) is not offset" in note
    cut_left = cut(mark, kerf=2e-3, kerf_side="left").path
    np.testing.assert_allclose(
        cut_left.vertices, [[0, 1e-3], [0.049, 1e-3], [0.049, 0.05]], atol=1e-15
    )
    right = cut(mark, kerf=2e-3, kerf_side="right").path
    assert len(right) == 3 and right.curvatures[1] == pytest.approx(1e3)
    np.testing.assert_allclose(right([0, right.length]), [[0, -1e-3], [0.051, 0.05]], atol=1e-15)


def test_random_cuts_keep_their_distance_to_open_contours_or_are_refused():
    rng = np.random.default_rng(3)
    refusals = 0
    for _ in range(80):
        points = np.cumsum(rng.uniform(-0.02, 0.02, (int(rng.integers(3, 7)), 2)), axis=0)
        kerf = float(rng.choice([1e-3, 4e-3, 8e-3]))
        try:
            offset_path = cut(Path.polyline(points), kerf=kerf, kerf_side="left").path
        except InvalidInput:
            refusals += 1
            continue
        samples = offset_path(np.linspace(0, offset_path.length, 500))
        a = points[:-1]
        b = points[1:]
        share = ((samples[:, None] - a) * (b - a)).sum(2) / ((b - a) ** 2).sum(1)
        foot = a + np.clip(share, 0, 1)[:, :, None] * (b - a)
        assert np.linalg.norm(samples[:, None] - foot, axis=2).min() >= kerf / 2 - 1e-9
    assert 5 < refusals < 65


@each("held", ["pointing", "following"])
def test_in_space_the_cut_is_in_the_plane_of_the_contour(held):
    frame = ac.Frame.rpy((0.4, 0.1, 0.2), (0.4, -0.3, 1.0))
    up = frame.rotation[:, 2]
    placed = Program.from_path(SQUARE).placed(frame).path
    placed = placed.pointing(-up) if held == "pointing" else placed.following_tangent(up)
    offset_path = cut(placed, kerf=2e-3, up=up).path
    expected = cut(SQUARE, kerf=2e-3).placed(frame).path
    apart = expected.project(offset_path(np.linspace(0, offset_path.length, 99))).distance
    assert apart.max() < 1e-12 and offset_path.length == pytest.approx(expected.length, abs=1e-12)
    places = np.linspace(0.001, offset_path.length - 1e-3, 50)
    axes = offset_path.orientation(places)
    np.testing.assert_allclose(axes[:, :, 2], np.tile(-up, (50, 1)), atol=1e-12)
    if held == "following":
        np.testing.assert_allclose(axes[:, :, 0], offset_path(places, 1), atol=1e-9)


def test_events_and_rapids_and_leads_move_with_the_kerf():
    corner = (0.1, 0.06)
    first = line((0, 0), (0.1, 0), speed=0.02, tolerance=1e-3)
    path = path_of(first, line((0.1, 0), corner), line(corner, (0, 0)))
    events = (Event(name="gas", s=0.05), Event(name="gas", value=False, s=path.length))
    to, away = (Rapid(path=Path.polyline(x)) for x in ([[-0.1, 0], [0, 0]], [[0, 0], [-0.1, 0]]))
    moves = (to, Contour(path=path, events=events, keep_start=True), away)
    before, contour, after = prepare(Program(moves=moves), Process(kerf=2e-3)).moves
    below = np.abs(contour.path(contour.path.breaks[:-1] + 1e-6)[:, 1] + 1e-3) < 1e-9
    assert (contour.path.speeds[below] == 0.02).all() and below.sum() >= 1
    on, switch_off = contour.events
    np.testing.assert_allclose(contour.path(on.s), [0.05, -1e-3], atol=1e-12)
    assert switch_off.s == contour.path.length
    np.testing.assert_array_equal(before.path(before.path.length), contour.path(0.0))
    np.testing.assert_allclose(after.path(0.0), contour.path(contour.path.length), atol=1e-9)
    lead = Lead(length=4e-3, shape="arc")
    cut_program = cut(circle(0, 0, 0.05), circle(0, 0, 0.02), kerf=1e-3, lead_in=lead)
    inner, outer = (np.linalg.norm(x.path(0.0)) for x in cut_program.contours)
    assert inner < 0.0195 < 0.0505 < outer


@each("seed", range(20))
def test_random_contours_keep_the_distance_everywhere(seed):
    judge.run_offset(seed)


@each("bulge", [0.0, 1e-13, 1e-10, 1e-9, 1e-8, 1e-7, 1e-6, 1e-5])
@each("decimals", [3, 4, 5, 7, 9])
def test_nearly_straight_arcs_and_tangent_vertices_have_a_kerf(tmp_path, bulge, decimals):
    # A slot in any direction, with vertices on its straight sides, and with rounded coordinates.
    turn = 0.1 + 0.7 * decimals
    c, s = np.cos(turn), np.sin(turn)
    sides = [(20 * x, -9) for x in (-3, -1, 0, 3)]
    sides += [(20 * x, 9) for x in (3, 1, -1, -3)]
    points = [
        (round(300 + c * x - s * y, decimals), round(s * x + c * y, decimals)) for x, y in sides
    ]
    bulges = [bulge, -bulge, bulge / 3, 1.0, -bulge, bulge, bulge, 1.0]
    document = ezdxf.new(units=4)
    corners = [(x, y, b) for (x, y), b in zip(points, bulges, strict=True)]
    document.modelspace().add_lwpolyline(corners, format="xyb", close=True)
    document.saveas(tmp_path / "slot.dxf")
    for error in (0.0, 2e-6):
        options = ac.ReadOptions(repair_vertices=error)
        drawn = ac.read_path(tmp_path / "slot.dxf", options).contours[0]
        for side, change in (("left", -1), ("right", 1)):
            (offset_contour,) = cut(drawn, kerf=1e-3, kerf_side=side).contours
            length = drawn.path.length + change * np.pi * 1e-3
            assert offset_contour.closed
            assert offset_contour.path.length == pytest.approx(length, abs=1e-7)
