"""Paths drawn by splines of the joints, and the nodes that the splines start from."""

import numpy as np
import pytest

import armcontour as ac
from armcontour.geometry import Tube
from armcontour.timing.shaping.curves import draw
from armcontour.timing.shaping.nodes import place_nodes
from armcontour.timing.shaping.rows import Spline
from armcontour.timing.shaping.starts import PARABOLAS, Timer, make_starts
from armcontour.timing.shaping.wishes import Wishes

TOLERANCE = 2e-3
DOWN = np.diag([1.0, -1.0, -1.0])


@pytest.fixture(scope="module", params=["pmk3s", "ur5e"])
def case(request):
    """The objective, its tube, the nodes along its parabolas, and the spline through them."""
    arm = ac.load_arm(request.param)
    corners = np.array([(0.0, 0.0), (0.10, 0.0), (0.10, 0.06), (0.02, 0.06)]) + (0.28, 0.16)
    if arm.dimension == 3:
        corners = np.column_stack([corners + (0.15, -0.1), [0.30, 0.31, 0.30, 0.32]])
    lines = [
        ac.Line(start=corners[k], end=corners[k + 1], demand=ac.Demand(speed=v))
        for k, v in enumerate((0.3, 0.1, None))
    ]
    objective, branch, start = ac.Path.from_segments(lines), "positive", None
    if arm.dimension == 3:
        objective = objective.oriented(DOWN)
        branch, start = None, ac.trace(objective, arm)(0.0)
    tube, wishes = Tube.of(objective, TOLERANCE), Wishes(tolerance=TOLERANCE)
    timer = Timer(arm, arm.limits.for_joints(arm.dof), branch, start)
    path, places = make_starts(objective, tube, wishes, 0.7)[PARABOLAS]
    candidate = timer.candidate(PARABOLAS, path, places)
    return arm, objective, tube, place_nodes(candidate, tube, arm, branch)


@pytest.fixture(scope="module")
def drawn(case):
    arm, objective, _, nodes = case
    spline = Spline(q=nodes.q, h=np.diff(nodes.times), rest=nodes.rest)
    return draw(spline, arm, objective, nodes.place, nodes.tolerance), spline


def test_arcs_are_tangent_and_near_the_curve_between_samples(drawn):
    found, _ = drawn
    path = ac.Path(segments=found.segments)
    assert path.turns.max() < 1e-9
    curve, s = found.curve, found.curve.breaks
    assert s[-1] == pytest.approx(path.length, abs=1e-12)
    for share in np.linspace(0, 1, 97):
        at = s[:-1] + share * np.diff(s)
        on = curve.on_piece(np.arange(len(at)), at)
        off = np.linalg.norm(on - path(np.minimum(at, path.length)), axis=1)
        assert (off <= curve.spreads + 1e-13).all()
    assert curve.spreads.max() < 1e-3 * TOLERANCE


def test_the_curve_is_that_of_the_spline(case, drawn):
    arm = case[0]
    found, spline = drawn
    knots = arm.forward(spline.knots)
    np.testing.assert_allclose(ac.Path(segments=found.segments)(found.knots), knots, atol=1e-9)
    # The middle of a span is on the curve, too.
    a = np.diff(spline.velocities, axis=0) / spline.h[:, None]
    h = spline.h[:, None]
    middle = arm.forward(spline.knots[:-1] + spline.velocities[:-1] * h / 2 + a * h**2 / 8)
    s = np.linspace(0, found.curve.breaks[-1], 200_001)
    piece = np.clip(np.searchsorted(found.curve.breaks, s) - 1, 0, len(found.curve.breaks) - 2)
    points = found.curve.on_piece(piece, s)
    pitch = s[1]
    for point, low, high in zip(middle, found.knots[:-1], found.knots[1:], strict=True):
        part = points[(s >= low - pitch) & (s <= high + pitch)]
        assert np.linalg.norm(part - point, axis=1).min() < pitch


def test_places_lead_to_the_end_and_parts_take_the_least_speed_of_their_segments(case, drawn):
    objective, found = case[1], drawn[0]
    assert (np.diff(found.places, axis=0) >= 0).all()
    end = [objective.length, found.segments.breaks[-1]]
    np.testing.assert_allclose(found.places[[0, -1]], [[0.0, 0.0], end])
    middle = (found.segments.breaks[:-1] + found.segments.breaks[1:]) / 2
    own = objective.speeds[
        objective.locate(np.interp(middle, found.places[:, 1], found.places[:, 0]))
    ]
    given = np.isfinite(own)
    assert (found.segments.speeds[given] <= own[given]).all()
    # Parts that lie along two segments are short.
    other = ~np.isclose(found.segments.speeds, own, equal_nan=True)
    assert 0 < other.sum() <= 20


def test_nodes_are_dense_at_corners_and_fixed_where_the_arm_rests(case):
    _, objective, tube, nodes = case
    assert nodes.fixed[[0, -1]].all() and not nodes.fixed[1:-1].any()
    assert nodes.rest.sum() == 2
    gaps = np.linalg.norm(np.diff(nodes.points, axis=0), axis=1)
    for k, corner in enumerate(objective.vertices[tube.vertex]):
        at = int(np.argmin(np.linalg.norm(nodes.points - corner, axis=1)))
        assert abs(nodes.place[at] - objective.breaks[tube.vertex[k]]) < TOLERANCE
        assert (nodes.vertex[at - 1 : at + 2] == k).all()
        assert gaps[at] < 0.2 * TOLERANCE < gaps.max()


def test_bounds_of_offsets_keep_control_points_in_the_tube(case):
    _, _, tube, nodes = case
    limits = nodes.bounds(tube, np.full(len(nodes), 1e-3))
    assert not limits[nodes.fixed].any() and (limits[~nodes.fixed].max(axis=1) > 0).all()
    windows = tube.windows(nodes.place, nodes.reach)
    near = nodes.vertex >= 0
    corners = tube.objective.vertices[np.append(tube.vertex, 0)[nodes.vertex]]
    for side, most in zip(nodes.sides, limits.T, strict=True):
        for share in (0.3, 1.0):
            off = nodes.frames @ side * (share * most)[:, None]
            points = nodes.points + off
            assert (tube.margin(points, windows) >= 0).all()
            assert (np.linalg.norm(points - corners, axis=1)[near] <= TOLERANCE).all()
    # No limit is much less than it has to be: next to the lines it is a circle's.
    middle = limits[np.argmax(np.diff(nodes.place))]
    assert middle.min() > 0.9 * TOLERANCE
