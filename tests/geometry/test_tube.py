"""Tubes around paths, nearest points, and vertices displaced by printed digits."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.geometry.tables import arc, each, line, path_of, refused

import armcontour as ac
from armcontour.geometry import Tube, round_path
from armcontour.geometry.arc_fit import draw_with_arcs
from armcontour.geometry.path import cut_path
from armcontour.geometry.rounding.tangent_repair import repair_tangents

CORNER = [(0, 0), (0.1, 0), (0.1, 0.1)]


def places_of(rounded):
    """Arc lengths on the objective and on its rounded path that belong together."""
    c = rounded.corners
    vertices = rounded.objective.breaks[c.vertex]
    s = np.unique(
        np.concatenate(
            [
                [0.0],
                vertices - c.tangent,
                vertices,
                vertices + c.tangent,
                [rounded.objective.length],
            ]
        )
    )
    return np.stack([s, np.maximum.accumulate(rounded.place(s))], axis=1)


def evenly(objective, path):
    """Places in proportion to arc length."""
    return np.array([(0.0, 0.0), (objective.length, path.length)])


def sampled_distance(path, objective, places, reach, n=400):
    """Distances of points of a path from their own parts of the objective, and their segments."""
    s = np.linspace(0, path.length, n)
    objective_s = np.interp(s, places[:, 1], places[:, 0])
    distances = []
    for point, a in zip(path(s), objective_s, strict=True):
        part = cut_path(objective, max(a - reach, 0.0), min(a + reach, objective.length))
        distances.append(part.project([point]).distance[0])
    return np.array(distances), path.locate(s)


def test_tolerances_of_segments_limit_both_sides_of_the_tube():
    second = ((1, 0), (1, 1))
    third = ((1, 1), (0, 1))
    lines = line((0, 0), (1, 0)), line(*second, tolerance=1e-3), line(*third, tolerance=4e-3)
    tube = Tube.around(path_of(*lines), 5e-3)
    np.testing.assert_array_equal(tube.tolerance, [5e-3, 1e-3, 4e-3])
    np.testing.assert_array_equal(tube.vertex_tolerance, [1e-3, 1e-3])


def largest(proof):
    """The largest value of a proof, of the points of the path and the corners of the objective."""
    return max(*proof.segments, *proof.vertices)


def test_stopping_at_every_vertex_keeps_tolerance_zero():
    for points in (CORNER, [(0, 0, 0), (1, 0.3, 0.2), (0.01, 0.3, 0.1)]):
        path = ac.Path.polyline(points)
        proof = Tube.around(path, 0.0).prove(path, evenly(path, path), 0.0)
        assert largest(proof) <= proof.slack and abs(largest(proof)) < 1e-15


@each("turn", [0.3, np.pi / 2, 3.0])
@each("shape", ["arc", "parabola"])
def test_the_corner_is_the_point_of_a_rounded_path_that_limits_the_tube(turn, shape):
    path = ac.Path.polyline([(-1, 0), (0, 0), (np.cos(turn), np.sin(turn))])
    rounded = round_path(path, tolerance=5e-3, curve=shape)
    just, less = (
        Tube.around(path, 5e-3 * x).prove(rounded, places_of(rounded), 0.5) for x in (1, 1 - 1e-6)
    )
    assert largest(just) <= just.slack and abs(largest(just)) < just.slack
    assert just.segments.max() < 0
    assert largest(less) == pytest.approx(5e-9, rel=1e-5)


@given(st.integers(0, 2**32 - 1), st.sampled_from([2, 3]), st.booleans())
def test_no_sample_exceeds_the_proven_bounds_of_the_tube(seed, dimension, bent):
    rng = np.random.default_rng(seed)
    points = np.cumsum(rng.normal(size=(5, dimension)), axis=0)
    objective = ac.Path.polyline(points)
    path = round_path(objective, tolerance=0.3, curve="parabola")
    places = places_of(path)
    if bent:
        # Arcs around arcs, and places that are not the best ones.
        spline = ac.Path.spline(points)
        objective, _ = draw_with_arcs(spline, 1e-2)
        path, _ = draw_with_arcs(spline, rng.choice([0.1, 0.02]))
        places = evenly(objective, path)
    reach = rng.choice([0.05, 0.3, 2.0])
    tolerance = rng.uniform(0.01, 0.4)
    proof = Tube.around(objective, tolerance).prove(path, places, reach)
    distance, segment = sampled_distance(path, objective, places, reach, 12)
    excess = distance - tolerance
    assert (excess <= proof.segments[segment] + proof.slack).all()


def test_the_deviation_at_vertices_equals_that_of_a_dense_sample():
    rng = np.random.default_rng(5)
    path = ac.Path.polyline(np.cumsum(rng.normal(size=(8, 3)), axis=0))
    rounded = ac.round_corners(path, tolerance=0.2)
    places = places_of(rounded)
    proof = Tube.around(path, 0.1).prove(rounded, places, 0.5)
    breaks = path.breaks[1:-1]
    for i, s in enumerate(breaks):
        low, high = np.interp([s - 0.5, s + 0.5], places[:, 0], places[:, 1])
        gaps = np.linalg.norm(rounded(np.linspace(low, high, 20001)) - path(s), axis=1)
        assert proof.vertices[i] == pytest.approx(gaps.min() - 0.1, abs=1e-7)


def test_invalid_tubes_and_paths_are_refused():
    path = ac.Path.polyline(CORNER)
    space = ac.Path.polyline([(0, 0, 0), (0.2, 0, 0)])
    bent = ac.round_corners(path, tolerance=1e-3, continuity="curvature")
    prove = Tube.around(path, 1e-3).prove
    refused(
        (lambda: Tube.around(path, -1e-3), "tolerance must not be negative"),
        (lambda: Tube.around(path, [1e-3, 1e-3]), "2 values, but the path has 1 vertices"),
        (lambda: Tube.around(bent, 1e-3), "transition between", {"index": 1}),
        (
            lambda: prove(space, evenly(path, space), 0.1),
            "same number of coordinates, but have 3 and 2",
        ),
        (lambda: prove(path, [(0, 0), (0.1, 0.1)], 0.1), "from the start to the end"),
    )


LAST = 1e-6  # three decimals of a millimetre
PRINTED = np.sqrt(0.5) * LAST


def printed_arc(start, end, center):
    """An arc whose centre is moved to where both ends are as far away, as in G-code."""
    middle = (start + end) / 2
    chord = end - start
    across = np.array([-chord[1], chord[0]]) / np.linalg.norm(chord)
    center = middle + across * ((center - middle) @ across)
    u, v = start - center, end - center
    return arc(start, center, float(np.arctan2(u[0] * v[1] - u[1] * v[0], u @ v)))


def rounded_rectangle(step=LAST, turn=23.0, wide=0.08, high=0.05, r=0.008):
    """A closed rectangle with round corners, whose points and centres are printed."""
    c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    x, y = wide / 2, high / 2
    segments = []
    points = []
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
    a = path(path.length, 1, side="left")
    b = path(0.0, 1)
    return 2 * np.arctan2(np.linalg.norm(a - b), np.linalg.norm(a + b))


@each("decimals", [2, 3, 4, 5, 6])
def test_a_printed_rounded_rectangle_is_tangent_again(decimals):
    step = 10.0 ** -(decimals + 3)
    path = rounded_rectangle(step)
    assert (path.turns > 1e-9).sum() >= 5
    repair = repair_tangents(path, np.sqrt(0.5) * step)
    assert (repair.path.turns <= 1e-9).all() and seam_kink(repair.path) <= 1e-9
    assert repair.count == (path.turns > 1e-9).sum() + (seam_kink(path) > 1e-9)
    assert repair.kink == pytest.approx(max(path.turns.max(), seam_kink(path)), rel=1e-6)
    # In both directions, the distance is at most the stated one and the printing error.
    assert repair.deviation <= np.sqrt(0.5) * step
    s = np.linspace(0, repair.path.length, 2001)
    there = path.project(repair.path(s)).distance.max()
    back = repair.path.project(path(np.linspace(0, path.length, 2001))).distance.max()
    assert max(there, back) <= repair.deviation * 1.001 + 1e-15
    assert max(there, back) >= repair.deviation * 0.5
    # Ends stay, and so do places along the path.
    np.testing.assert_allclose(repair.path.vertices[[0, -1]], path.vertices[[0, -1]], atol=1e-15)
    positions = np.linspace(0, path.length, 301)
    np.testing.assert_allclose(repair.path(repair.place(positions)), path(positions), atol=2 * step)
    assert repair.after[-1] == pytest.approx(repair.path.length, rel=1e-14)


def test_exact_paths_and_corners_do_not_change():
    assert repair_tangents(rounded_rectangle(1e-15), PRINTED) is None
    # A corner of 1° is far above what three decimals hold over centimetres.
    bend = np.radians(1.0)
    points = [(0, 0), (0.05, 0), (0.05 + 0.05 * np.cos(bend), 0.05 * np.sin(bend)), (0.05, 0.2)]
    assert repair_tangents(ac.Path.polyline(points), PRINTED) is None
    # The tolerance of 1 um allows any turn, but turns above 0.05 rad are not repaired.
    short = ac.Path.polyline([(0, 0), (1e-6, 0), (1e-6, 1e-6), (0, 1e-6), (0, 2e-6)])
    assert repair_tangents(short, PRINTED) is None
    # One corner and one printed vertex: only that one changes.
    path = ac.Path.polyline([(0, 0), (0.03, 4e-7), (0.07, 0), (0.07, 0.04)])
    repair = repair_tangents(path, PRINTED)
    assert repair.count == 1
    np.testing.assert_allclose(repair.path.turns.max(), path.turns[1], rtol=1e-9)
    np.testing.assert_array_equal(repair.path.vertices[-2:], path.vertices[-2:])
    assert repair.deviation < 4e-7


def test_tolerances_of_segments_above_zero_limit_the_repair_of_tangents():
    a = (0.0, 0.0)
    b = (0.03, 4e-7)
    c = (0.07, 0.0)
    some, none = (path_of(line(a, b, tolerance=x), line(b, c, tolerance=x)) for x in (1e-8, 0.0))
    assert repair_tangents(some, PRINTED).deviation == pytest.approx(1e-8, rel=1e-6)
    # A repaired vertex is no corner, so a corner tolerance of 0 does not keep it.
    unlimited = repair_tangents(path_of(line(a, b), line(b, c)), PRINTED)
    assert repair_tangents(none, PRINTED).deviation == pytest.approx(unlimited.deviation)


@given(
    st.lists(st.tuples(st.floats(1e-3, 0.05), st.floats(-1.5, 1.5)), min_size=2, max_size=8),
    st.integers(3, 6),
)
def test_printed_tangent_arcs_are_tangent_again(parts, decimals):
    step = 10.0 ** -(decimals + 3)
    position = np.array([0.31, 0.12])
    heading = 0.37
    segments = []
    start = np.round(position / step) * step
    for radius, angle in parts:
        turn = np.copysign(max(abs(angle), 0.3), angle)
        center = position + radius * np.sign(turn) * np.array([-np.sin(heading), np.cos(heading)])
        c, s = np.cos(turn), np.sin(turn)
        position = center + np.array([[c, -s], [s, c]]) @ (position - center)
        heading += turn
        end = np.round(position / step) * step
        segments.append(printed_arc(start, end, np.round(center / step) * step))
        start = end
    path = path_of(*segments)
    repair = repair_tangents(path, np.sqrt(0.5) * step)
    if repair is None:
        assert (path.turns <= 1e-9).all()
        return
    assert (repair.path.turns <= 1e-9).all()
    assert repair.deviation <= np.sqrt(0.5) * step
    s = np.linspace(0, repair.path.length, 401)
    assert path.project(repair.path(s)).distance.max() <= repair.deviation * 1.001 + 1e-14


@each("turn", [1e-3, 1e-6])
def test_a_slight_corner_that_uses_its_whole_tolerance_is_proven(turn):
    # The middle of the arc is as far from both lines as from the corner, to a millionth.
    path = ac.Path.polyline([(-1, 0), (0, 0), (np.cos(turn), np.sin(turn))])
    rounded = ac.round_corners(path, tolerance=turn * 1e-3)
    assert rounded.corners.error[0] == pytest.approx(turn * 1e-3)
    proof = Tube.around(path, turn * 1e-3).prove(rounded, places_of(rounded), 0.5)
    assert largest(proof) <= proof.slack


def test_shortcut_to_neighbouring_pass_leaves_tube():
    path = ac.Path.polyline([(0, 0), (1, 0), (1, 0.004), (0, 0.004)])
    short = ac.Path.polyline([(0, 0), (0.5, 0), (0.5, 0.004), (0, 0.004)])
    assert path.project(short(np.linspace(0, short.length, 1001))).distance.max() < 0.0021
    proof = Tube.around(path, 0.005).prove(short, evenly(path, short), 0.02)
    assert largest(proof) > proof.slack
    # Even if the places leave the rest of the path out, its corners are missed.
    jumps = [(0, 0), (0.502, 0.502), (1.502, 0.502), (2.004, 1.004)]
    jump = Tube.around(path, 0.005).prove(short, np.array(jumps), 0.02)
    np.testing.assert_allclose(jump.vertices, 0.5 - 0.005, rtol=1e-4)
    assert jump.segments.max() < 0


def test_a_path_may_not_change_its_branch_at_a_crossing():
    path = ac.Path.polyline([(0, 0), (1, 0), (1, 1), (0.5, 1), (0.5, -1)])
    # At the crossing (0.5, 0) it takes the other line.
    turned = ac.Path.polyline([(0, 0), (0.5, 0), (0.5, -1)])
    assert path.project(turned(np.linspace(0, turned.length, 101))).distance.max() < 1e-12
    proof = Tube.around(path, 0.01).prove(turned, evenly(path, turned), 0.05)
    assert largest(proof) > proof.slack
    same = Tube.around(path, 0.01).prove(path, evenly(path, path), 0.05)
    assert largest(same) <= same.slack and same.segments.max() == pytest.approx(-0.01)
