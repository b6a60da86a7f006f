"""Which contours hold which: against sampled outlines, and where sampling would go wrong."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import armcontour as ac
from armcontour.geometry import Arc, Line, Path
from armcontour.geometry.cutting import reverse_path
from armcontour.program.nesting import nest

UP = np.array([0.0, 0.0, 1.0])


def circle(x: float, y: float, radius: float) -> ac.Contour:
    return ac.Contour(path=Path.from_segments([Arc.circle((x + radius, y), (x, y))]))


def parents(*contours: ac.Contour, up: np.ndarray = UP) -> list[int]:
    return nest(contours, up).parents.tolist()


def test_the_parent_is_the_smallest_contour_around_whatever_the_order() -> None:
    rings = [circle(0, 0, 0.01), circle(0, 0, 0.04), circle(0, 0, 0.02), circle(0.1, 0, 0.03)]
    mark = ac.Contour(path=Path.polyline([[0.1, 0.0], [0.11, 0.0]]))
    assert parents(*rings, mark) == [2, -1, 1, -1, 3]


def test_areas_are_those_of_the_arcs_with_their_sign() -> None:
    hole = circle(0, 0, 0.02)
    turned = ac.Contour(path=reverse_path(hole.path))
    d_shape = ac.Contour(
        path=Path.from_segments(
            [
                Line(start=(0, 0), end=(0.02, 0)),
                Arc(start=(0.02, 0), center=(0.02, 0.01), angle=np.pi),
                Line(start=(0.02, 0.02), end=(0, 0.02)),
                Line(start=(0, 0.02), end=(0, 0)),
            ]
        )
    )
    areas = nest([hole, turned, d_shape], UP).areas
    circle_area = np.pi * 4e-4
    expected = [circle_area, -circle_area, 4e-4 + np.pi * 1e-4 / 2]
    np.testing.assert_allclose(areas, expected, rtol=1e-12)


@pytest.mark.parametrize("off", [1e-6, -1e-6])
def test_a_micrometre_beside_an_arc_is_inside_or_outside(off: float) -> None:
    # Between the chords of any sampling and the arc.
    angle = 0.3
    at = (0.5 - off) * np.array([np.cos(angle), np.sin(angle)])
    mark = ac.Contour(path=Path.polyline([at, at * (1 - off)]))
    assert parents(circle(0, 0, 0.5), mark) == [-1, 0 if off > 0 else -1]


def test_contours_are_seen_from_above_also_where_their_plane_is_tilted() -> None:
    program = ac.Program(moves=(circle(0, 0, 0.05), circle(0.02, 0, 0.01)))
    frame = ac.Frame.rpy((0.4, 0.1, 0.2), (0.4, -0.3, 1.0))
    for up in (frame.rotation[:, 2], UP):
        assert parents(*program.placed(frame).contours, up=up) == [-1, 0]


@given(st.integers(0, 10_000))
@settings(max_examples=15)
def test_the_winding_number_is_that_of_a_fine_polygon(seed: int) -> None:
    rng = np.random.default_rng(seed)
    angles = np.sort(rng.uniform(0, 2 * np.pi, 6))
    knots = rng.uniform(0.5, 1.0, 6)[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    segments = []
    for a, b in zip(knots, np.roll(knots, -1, axis=0), strict=True):
        if rng.random() < 0.5:
            segments.append(Line(start=a, end=b))
        else:
            middle = (a + b) / 2 + rng.uniform(-0.3, 0.3) * np.array([a[1] - b[1], b[0] - a[0]])
            segments.append(Arc.through(a, middle, b))
    path = Path.from_segments(segments)
    places = rng.uniform(-1.2, 1.2, (10, 2))
    fine = path(np.linspace(0, path.length, 4001)[:-1])
    marks = [ac.Contour(path=Path.polyline([x, x + 1e-3])) for x in places]
    holds = nest([ac.Contour(path=path), *marks], UP).holds[0, 1:]
    turned = np.unwrap(np.arctan2(*(np.append(fine, fine[:1], axis=0)[:, None] - places).T), axis=1)
    wound = np.round((turned[:, -1] - turned[:, 0]) / (2 * np.pi)).astype(int)
    clear = np.min(np.linalg.norm(fine[:, None] - places, axis=2), axis=0) > 5e-3
    assert (holds == (wound != 0))[clear].all()


def test_a_point_at_the_height_of_a_vertex_that_is_off_by_rounding_is_inside() -> None:
    # The arc ends 2e-17 above the start of the line after it, at the height of the mark.
    arc = Arc(start=(0.05, 0.06), center=(0.0, 0.06), angle=-0.5)
    end = Path.from_segments([arc]).vertices[-1]
    low = [end[0], end[1] - 2e-17 - 1e-18]
    path = Path.from_segments(
        [arc, Line(start=low, end=(-0.05, 0.0)), Line(start=(-0.05, 0.0), end=(0.05, 0.06))]
    )
    for y in (end[1], low[1], np.nextafter(end[1], 0)):
        mark = ac.Contour(path=Path.polyline([[0.03, y], [0.031, y]]))
        assert parents(ac.Contour(path=path), mark) == [-1, 0]
