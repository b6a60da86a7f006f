"""Nesting of contours, and requirements of a pierce."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.geometry.tables import arc, line, path_of, refused

import armcontour as ac
from armcontour.geometry import Arc, Path
from armcontour.program import Lead, Pierce, Process, Switch
from armcontour.program.nesting import find_nesting

LINE = ac.Path.polyline([(0.3, 0.1), (0.4, 0.1)])
LASER = Switch(name="laser")


def test_a_pierce_needs_a_switch_and_an_active_lead():
    pierce = Pierce(time=0.3)
    idle = Lead(length=5e-3)
    high = Process(pierce=Pierce(time=0.1, height=1e-3), switch=LASER)
    refused(
        # Letters of a text would be names of outputs that do not exist, and the laser on in rapids.
        (lambda: Process(off_between="spindle"), "off_between", "list of names", "'spindle'"),
        (lambda: Process(switch="laser"), "switch of a process must be a Switch", "not 'laser'"),
        (lambda: Process(pierce=pierce), "switch"),
        (lambda: Process(pierce=pierce, switch=LASER, lead_in=idle), "active"),
        (lambda: Pierce(time=0.0), "time of a pierce"),
        (lambda: Pierce(time=0.1, height=-1e-3), "height of a pierce"),
        (lambda: ac.prepare(LINE, high), "plane"),
    )
    marked = Process(pierce=pierce, switch=LASER, by_layer={"MARK": {"pierce": None}})
    cut, mark = (marked.of_contour(ac.Contour(path=LINE, layer=x)) for x in ("CUT", "MARK"))
    assert cut.begins_on and not mark.begins_on


UP = np.array([0.0, 0.0, 1.0])


def circle(x, y, radius):
    return ac.Contour(path=path_of(Arc.circle((x + radius, y), (x, y))))


def polyline(*points, **values):
    return ac.Contour(path=Path.polyline(points), **values)


def parents(*contours, up=UP):
    return find_nesting(contours, up).parents.tolist()


def test_parents_and_areas_of_contours_are_exact_for_arcs():
    hole = circle(0, 0, 0.02)
    turned = ac.Contour(path=hole.path.reversed())
    half = arc((0.02, 0), (0.02, 0.01), np.pi)
    top = line((0.02, 0.02), (0, 0.02))
    side = line((0, 0.02), (0, 0))
    d_shape = ac.Contour(path=path_of(line((0, 0), (0.02, 0)), half, top, side))
    areas = find_nesting([hole, turned, d_shape], UP).areas
    expected = [np.pi * 4e-4, -np.pi * 4e-4, 4e-4 + np.pi * 1e-4 / 2]
    np.testing.assert_allclose(areas, expected, rtol=1e-12)
    # Between the chords of any sampling and the arc.
    for offset in (1e-6, -1e-6):
        point = (0.5 - offset) * np.array([np.cos(0.3), np.sin(0.3)])
        mark = polyline(point, point * (1 - offset))
        assert parents(circle(0, 0, 0.5), mark) == [-1, 0 if offset > 0 else -1]


@given(st.integers(0, 10_000))
@settings(max_examples=15)
def test_the_winding_number_equals_that_of_a_fine_polygon(seed):
    rng = np.random.default_rng(seed)
    angles = np.sort(rng.uniform(0, 2 * np.pi, 6))
    knots = rng.uniform(0.5, 1.0, 6)[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    segments = []
    for a, b in zip(knots, np.roll(knots, -1, axis=0), strict=True):
        if rng.random() < 0.5:
            segments.append(line(a, b))
        else:
            middle = (a + b) / 2 + rng.uniform(-0.3, 0.3) * np.array([a[1] - b[1], b[0] - a[0]])
            segments.append(Arc.through(a, middle, b))
    path = path_of(*segments)
    places = rng.uniform(-1.2, 1.2, (10, 2))
    fine = path(np.linspace(0, path.length, 4001)[:-1])
    marks = [polyline(x, x + 1e-3) for x in places]
    holds = find_nesting([ac.Contour(path=path), *marks], UP).contains[0, 1:]
    turned = np.unwrap(np.arctan2(*(np.append(fine, fine[:1], axis=0)[:, None] - places).T), axis=1)
    wound = np.round((turned[:, -1] - turned[:, 0]) / (2 * np.pi)).astype(int)
    clear = np.min(np.linalg.norm(fine[:, None] - places, axis=2), axis=0) > 5e-3
    assert (holds == (wound != 0))[clear].all()


def test_a_point_level_with_a_rounded_vertex_is_inside():
    # The arc ends 2e-17 above the start of the line after it, at the height of the mark.
    first = arc((0.05, 0.06), (0.0, 0.06), -0.5)
    end = path_of(first).vertices[-1]
    low = [end[0], end[1] - 2e-17 - 1e-18]
    path = path_of(first, line(low, (-0.05, 0.0)), line((-0.05, 0.0), (0.05, 0.06)))
    for y in (end[1], low[1], np.nextafter(end[1], 0)):
        assert parents(ac.Contour(path=path), polyline([0.03, y], [0.031, y])) == [-1, 0]
