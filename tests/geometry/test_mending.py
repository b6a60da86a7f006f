"""Vertices that printing has bent: which are mended, how far the path moves, and what stays."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.geometry.tables import arc, each, line, path_of

import armcontour as ac
from armcontour.geometry.mending import Printed, mend_paths, mend_vertices

LAST = 1e-6  # three decimals of a millimetre
PRINTED = Printed(point=np.sqrt(0.5) * LAST)


def printed_arc(start, end, center):
    """An arc whose centre is moved to where both ends are as far away, as in G-code."""
    middle, chord = (start + end) / 2, end - start
    across = np.array([-chord[1], chord[0]]) / np.linalg.norm(chord)
    center = middle + across * ((center - middle) @ across)
    u, v = start - center, end - center
    return arc(start, center, float(np.arctan2(u[0] * v[1] - u[1] * v[0], u @ v)))


def rounded_rectangle(step=LAST, turn=23.0, wide=0.08, high=0.05, r=0.008):
    """A closed rectangle with round corners, whose points and centres are printed."""
    c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    x, y = wide / 2, high / 2
    segments, points = [], []
    signs = (1, 1), (-1, 1), (-1, -1), (1, -1)
    for sx, sy in signs:
        pair = [(sx * x, sy * (y - r)), (sx * (x - r), sy * y)]
        points.append(pair if sx * sy > 0 else pair[::-1])

    def printed(p):
        turned = np.array([c * p[0] - s * p[1], s * p[0] + c * p[1]]) + (0.3, 0.1)
        return np.round(turned / step) * step

    for k, (sx, sy) in enumerate(signs):
        start, end = map(printed, points[k])
        segments.append(printed_arc(start, end, printed((sx * (x - r), sy * (y - r)))))
        segments.append(line(end, printed(points[(k + 1) % 4][0])))
    return path_of(*segments)


def seam_kink(path):
    a, b = path(path.length, 1, side="left"), path(0.0, 1)
    return 2 * np.arctan2(np.linalg.norm(a - b), np.linalg.norm(a + b))


@each("decimals", [2, 3, 4, 5, 6])
def test_a_printed_rounded_rectangle_is_tangent_again(decimals):
    step = 10.0 ** -(decimals + 3)
    path = rounded_rectangle(step)
    assert (path.turns > 1e-9).sum() >= 5
    found = mend_vertices(path, Printed(point=np.sqrt(0.5) * step))
    assert (found.path.turns <= 1e-9).all() and seam_kink(found.path) <= 1e-9
    assert found.count == (path.turns > 1e-9).sum() + (seam_kink(path) > 1e-9)
    assert found.kink == pytest.approx(max(path.turns.max(), seam_kink(path)), rel=1e-6)
    # Both ways, the paths are as near as it says, and nearer than printing moves a point.
    assert found.deviation <= np.sqrt(0.5) * step
    s = np.linspace(0, found.path.length, 2001)
    there = path.project(found.path(s)).distance.max()
    back = found.path.project(path(np.linspace(0, path.length, 2001))).distance.max()
    assert max(there, back) <= found.deviation * 1.001 + 1e-15
    assert max(there, back) >= found.deviation * 0.5
    # Ends stay, and so do places along the path.
    np.testing.assert_allclose(found.path.vertices[[0, -1]], path.vertices[[0, -1]], atol=1e-15)
    at = np.linspace(0, path.length, 301)
    np.testing.assert_allclose(found.path(found.place(at)), path(at), atol=2 * step)


def test_many_paths_are_mended_as_each_by_itself():
    straight = ac.Path.polyline([(0, 0), (0.03, 4e-7), (0.07, 0)])
    after = ac.Path.polyline([(0.07, 0), (0.10, -4e-7), (0.14, 0), (0.2, 0.3)])
    paths = [
        *(rounded_rectangle(LAST, turn) for turn in (23.0, 31.0)),
        *(straight, after, rounded_rectangle(1e-15), rounded_rectangle(LAST, 70.0)),
    ]
    together = mend_paths(paths, [PRINTED] * len(paths), [np.inf] * len(paths))
    assert sum(x is not None for x in together) == 5
    for path, found in zip(paths, together, strict=True):
        alone = mend_vertices(path, PRINTED)
        if alone is None:
            assert found is None
            continue
        for name in ("count", "kink", "deviation"):
            assert getattr(found, name) == pytest.approx(getattr(alone, name), rel=1e-9)
        np.testing.assert_allclose(found.path.vertices, alone.path.vertices, atol=1e-14)
        np.testing.assert_allclose(found.path.curvatures, alone.path.curvatures, atol=1e-6)
        np.testing.assert_allclose(found.after, alone.after, atol=1e-13)
        assert found.after[-1] == pytest.approx(found.path.length, rel=1e-14)


def test_exact_paths_are_left_alone_and_corners_stay_exactly():
    assert mend_vertices(rounded_rectangle(1e-15), PRINTED) is None
    assert mend_paths([], [], []) == []
    # A corner of 1° is far above what three decimals hold over centimetres.
    bend = np.radians(1.0)
    points = [(0, 0), (0.05, 0), (0.05 + 0.05 * np.cos(bend), 0.05 * np.sin(bend)), (0.05, 0.2)]
    assert mend_vertices(ac.Path.polyline(points), PRINTED) is None
    # A micrometre holds any turn, but nothing above 0.05 rad is mended.
    short = ac.Path.polyline([(0, 0), (1e-6, 0), (1e-6, 1e-6), (0, 1e-6), (0, 2e-6)])
    assert mend_vertices(short, PRINTED) is None
    # One corner and one printed vertex: only that one changes.
    path = ac.Path.polyline([(0, 0), (0.03, 4e-7), (0.07, 0), (0.07, 0.04)])
    found = mend_vertices(path, PRINTED)
    assert found.count == 1
    np.testing.assert_allclose(found.path.turns.max(), path.turns[1], rtol=1e-9)
    np.testing.assert_array_equal(found.path.vertices[-2:], path.vertices[-2:])
    assert found.deviation < 4e-7


def test_tolerances_of_segments_bound_it():
    a, b, c = (0.0, 0.0), (0.03, 4e-7), (0.07, 0.0)
    some, none = (path_of(line(a, b, tolerance=x), line(b, c, tolerance=x)) for x in (1e-8, 0.0))
    assert mend_vertices(some, PRINTED).deviation == pytest.approx(1e-8, rel=1e-6)
    assert mend_vertices(none, PRINTED) is None


@given(
    st.lists(st.tuples(st.floats(1e-3, 0.05), st.floats(-1.5, 1.5)), min_size=2, max_size=8),
    st.integers(3, 6),
)
def test_printed_tangent_arcs_are_tangent_again(parts, decimals):
    step = 10.0 ** -(decimals + 3)
    here, heading = np.array([0.31, 0.12]), 0.37
    segments, start = [], np.round(here / step) * step
    for radius, angle in parts:
        turn = np.copysign(max(abs(angle), 0.3), angle)
        center = here + radius * np.sign(turn) * np.array([-np.sin(heading), np.cos(heading)])
        c, s = np.cos(turn), np.sin(turn)
        here = center + np.array([[c, -s], [s, c]]) @ (here - center)
        heading += turn
        end = np.round(here / step) * step
        segments.append(printed_arc(start, end, np.round(center / step) * step))
        start = end
    path = path_of(*segments)
    found = mend_vertices(path, Printed(point=np.sqrt(0.5) * step))
    if found is None:
        assert (path.turns <= 1e-9).all()
        return
    assert (found.path.turns <= 1e-9).all()
    assert found.deviation <= np.sqrt(0.5) * step
    s = np.linspace(0, found.path.length, 401)
    assert path.project(found.path(s)).distance.max() <= found.deviation * 1.001 + 1e-14
