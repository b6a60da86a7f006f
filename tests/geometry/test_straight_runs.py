"""Lines divided into collinear parts give the same corners as whole lines."""

import numpy as np
import pytest
from tests.geometry.tables import arc, each, line, path_of

import armcontour as ac
from armcontour.core.frames import exp
from armcontour.geometry.rounding.tangent_repair import repair_tangents

PLANE = np.array([[0.30, 0.20], [0.3411, 0.213], [0.335, 0.259], [0.33, 0.24], [0.30, 0.237]])
SPACE = np.array([[0.45, -0.1, 0.3], [0.52, -0.08, 0.31], [0.5, 0.05, 0.35], [0.47, 0.06, 0.33]])
CLOSED = np.array([[0.32, 0.2], [0.36, 0.2], [0.36, 0.25], [0.3, 0.23], [0.3, 0.2], [0.32, 0.2]])
TURN = np.array([[0.8, 0.6], [-0.6, 0.8]])
SHAPES = {"plane": PLANE, "space": SPACE, "closed": CLOSED}
PIECES = (2, 3, 10, 100, 1000)
WAYS = {
    "arcs": {"tolerance": 1e-3},
    "smooth": {"tolerance": 1e-3, "continuity": "curvature"},
    "speed": {"speed": 0.03, "acceleration": 1.0},
}


def divide(points, count):
    """Points of a polyline with `count` equal pieces per line."""
    lines = zip(points[:-1], points[1:], strict=True)
    return np.concatenate(
        [*(np.linspace(a, b, count, endpoint=False) for a, b in lines), points[-1:]]
    )


def moves(points, step, decimals):
    """Points of a polyline in moves of `step` [m], in mm with some decimals as in a file."""
    pieces = []
    for a, b in zip(points[:-1], points[1:], strict=True):
        size = np.linalg.norm(b - a)
        pieces.append(a + (b - a) * (np.arange(0, size, step) / size)[:, None])
    return np.round(np.concatenate([*pieces, points[-1:]]), decimals + 3)


def same_curve(one, other, atol):
    assert one.length == pytest.approx(other.length, abs=10 * atol)
    s = np.linspace(0, 1, 999)
    np.testing.assert_allclose(one(s * one.length), other(s * other.length), atol=10 * atol)


@each("way", WAYS)
@each("shape", SHAPES)
def test_corners_between_divided_lines_are_those_between_whole_lines(shape, way):
    points = SHAPES[shape]
    whole = ac.round_corners(ac.Path.polyline(points), **WAYS[way])
    # CLOSED starts inside a line, so its first and last points are ends, and no corners.
    assert len(whole.corners) == len(points) - 2 and not whole.corners.stopped.any()
    for count in PIECES:
        path = ac.Path.polyline(divide(points, count))
        rounded = ac.round_corners(path, **WAYS[way])
        for name in ("point", "radius", "error", "tangent", "start", "end"):
            expected = getattr(whole.corners, name)
            np.testing.assert_allclose(getattr(rounded.corners, name), expected, rtol=1e-9)
        same_curve(rounded, whole, 1e-12)
        # Corners and waypoints have the numbers of the objective, which is the path that was given.
        np.testing.assert_array_equal(rounded.corners.vertex, count * whole.corners.vertex)
        assert rounded.objective is path and rounded.deviation == pytest.approx(whole.deviation)
        middle = path.breaks[path.waypoints[count // 2]]
        np.testing.assert_allclose(rounded(rounded.place(middle)), path(middle), atol=1e-9)


@each("decimals", [3, 4])
@each("step", [4e-4, 1e-4, 2e-5])
def test_joined_lines_of_moves_with_few_decimals_stay_within_the_tolerance(decimals, step):
    for points, allowed in ((PLANE, 1e-3), (SPACE, 5e-5), (CLOSED, 1e-5)):
        path = ac.Path.polyline(moves(points, step, decimals))
        rounded = ac.round_corners(path, tolerance=allowed)
        assert len(rounded.corners) == len(points) - 2 and not rounded.corners.stopped.any()
        # The lines that replace the moves use a part of the tolerance, and both together fit.
        used = allowed - rounded.corners.error
        assert (used >= 0).all() and used.max() <= 0.1 * allowed
        assert rounded.deviation <= allowed * (1 + 1e-12)
        there = rounded.project(path.vertices).distance.max()
        back = path.project(rounded(np.linspace(0, rounded.length, 3001))).distance.max()
        assert max(there, back) <= rounded.deviation * (1 + 1e-9)


def test_divided_lines_are_joined_for_each_kind_of_orientation():
    limits = {"tolerance": 1e-3, "angular_tolerance": 0.1}
    rotations = np.array([np.eye(3), ac.Frame.rpy((0, 0, 0), (0.1, 0.2, 0.3)).rotation])

    def follows(path):
        return path.following_tangent((0, 0, 1))

    def constant(path):
        return path.oriented(rotations[1])

    def turns(path):
        return path.oriented(exp(path.breaks[:, None] / path.length * [0.2, 0.3, 0.4]))

    for make in (follows, constant, turns):
        whole = ac.round_corners(make(ac.Path.polyline(SPACE)), **limits)
        for points, atol in ((divide(SPACE, 100), 1e-9), (moves(SPACE, 4e-4, 3), 1e-2)):
            rounded = ac.round_corners(make(ac.Path.polyline(points)), **limits)
            assert len(rounded) == len(whole) and len(rounded.stops) == len(whole.stops)
            s = np.linspace(0, 1, 99)
            found, expected = (x.orientation(s * x.length) for x in (rounded, whole))
            np.testing.assert_allclose(found, expected, atol=atol)
    # The angular rate jumps inside a line, so the line is two pieces there.
    path = ac.Path.polyline([(0, 0, 0), (0.1, 0, 0), (0.2, 0, 0), (0.2, 0.1, 0)])
    turning = ac.round_corners(path.oriented([*rotations, rotations[1], rotations[1]]), **limits)
    assert len(turning.corners) == 1 and len(turning) == 4
    # A path that comes back has no orientation that is carried along it.
    there = follows(ac.Path.polyline(divide(SPACE, 20)))
    corners = ac.round_corners(there + there.reversed(), **limits).corners
    assert corners.reason.tolist() == [None, None, "turn-back", None, None]
    assert not corners.shrunk.any()


def test_reversals_and_different_moves_are_not_joined():
    allowed = {"tolerance": 1e-3}
    # Back along the same line.
    back = ac.Path.polyline([(0, 0), (0.05, 0), (0.1, 0), (0.05, 0), (0, 0), (0, 0.1)])
    corners = ac.round_corners(back, **allowed).corners
    assert corners.reason.tolist() == ["turn-back", None] and corners.error[1] == 1e-3
    # Repeated points, and pieces that rounding errors bend.
    tiny = [
        (0, 0),
        (0.04, 0.03),
        (0.04, 0.03),
        (0.04 + 8e-8, 0.03 + 6e-8),
        (0.08, 0.06),
        (0.08, 0.2),
    ]
    corners = ac.round_corners(ac.Path.polyline(tiny), **allowed).corners
    assert corners.vertex.tolist() == [3] and corners.error[0] == pytest.approx(1e-3, rel=1e-12)
    # A single vertex near a line is a corner.
    bent = ac.Path.polyline([(0, 0), (0.1, 1e-6), (0.2, 0), (0.2, 0.1)])
    assert len(ac.round_corners(bent, **allowed).corners) == 2
    # A tessellated curve.
    angle = np.linspace(0, 6, 1001)
    for curve in (0.1 * np.cos(angle), 0.02 * np.sin(9 * angle)):
        path = ac.Path.polyline(np.stack([curve, 0.1 * np.sin(angle)], axis=1))
        assert len(ac.round_corners(path, **allowed).corners) == 999
    # Another speed, tag or tolerance, and an arc.
    points = [(0, 0), (0.01, 0), (0.02, 0), (0.03, 0)]
    ends = list(zip(points[:-1], points[1:], strict=True))
    turn = line((0.03, 0), (0.03, 0.1))
    for values in ({"speed": 0.1}, {"tag": "a"}, {"tolerance": 2e-3}):
        lines = [line(*ends[0]), line(*ends[1], **values), line(*ends[2], **values)]
        rounded = ac.round_corners(path_of(*lines, turn), **allowed)
        assert len(rounded) == 4 and rounded.vertices[1] == pytest.approx((0.01, 0), abs=1e-15)
    lines = [line(*x) for x in ends]
    bend = arc((0.03, 0), (0.03, 0.02), np.pi / 2)
    rounded = ac.round_corners(path_of(*lines, bend, line((0.05, 0.02), (0.1, 0.02))), **allowed)
    assert len(rounded) == 5 and rounded.vertices[1] == pytest.approx((0.03, 0), abs=1e-15)


def test_the_repair_of_printed_vertices_aligns_moves_with_lines():
    arc_points = 0.02 * np.stack([np.sin(x := np.linspace(0, np.pi, 80)), 1 - np.cos(x)], axis=1)
    bow = np.concatenate([[(-0.05, 0)], arc_points, [(-0.05, 0.04), (-0.05, 0.02)]])
    for points, allowed in ((PLANE, 2e-6), (bow, 2e-6), (PLANE, 2e-7), (CLOSED @ TURN, 2e-6)):
        for step, decimals in ((4e-4, 3), (1e-4, 3), (4e-4, 4)):
            path = ac.Path.polyline(moves(points, step, decimals))
            repair = repair_tangents(path, allowed)
            there = repair.path.project(path.vertices).distance.max()
            back = path.project(
                repair.path(np.linspace(0, repair.path.length, 3001))
            ).distance.max()
            assert max(there, back) <= repair.deviation * (1 + 1e-9) <= allowed * (1 + 2e-9)
            s = np.linspace(0, path.length, 301)
            np.testing.assert_allclose(repair.path(repair.place(s)), path(s), atol=2e-6)
            if points is PLANE and (decimals == 4 or allowed == 2e-6):
                np.testing.assert_allclose(repair.path.vertices, PLANE, atol=1e-6)
    # Exactly collinear moves alone are not changed.
    assert repair_tangents(ac.Path.polyline(divide(PLANE, 64)), 2e-6) is None
