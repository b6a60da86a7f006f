"""The search of shaped paths: starts, curves, kinematics, rows and their program."""

import numpy as np
import pytest

import armcontour as ac
from armcontour.geometry import Tube
from armcontour.planning.shaping.shape_search import explain_unshaped, make_searches
from armcontour.planning.shaping.shape_starts import (
    ARCS,
    PARABOLAS,
    STOPS,
    Timer,
    make_starts,
    prove,
)
from armcontour.planning.shaping.spline_nodes import place_nodes
from armcontour.planning.shaping.spline_rows import JointSpline, assemble, span_rows
from armcontour.planning.shaping.tool_path_fit import draw

LINES = ac.Path.polyline([(0.35, 0.10), (0.41, 0.15), (0.28, 0.30), (0.35, 0.35)])


@pytest.mark.parametrize("centripetal", [0.09, None])
def test_the_search_stays_within_the_tube_and_gets_faster(arm, centripetal):
    limits = ac.Limits.only(
        speed=0.15, joint_acceleration=0.72, centripetal_acceleration=centripetal
    ).for_joints(2)
    tube = Tube.around(LINES, 1e-3)
    options = ac.Shaped(tolerance=1e-3)
    timer = Timer(arm, limits, "positive", None, 800)
    search = next(make_searches(LINES, tube, timer, options.tolerances))
    for iterations in (1, 8):
        search = next(make_searches(LINES, tube, timer, options.tolerances))
        candidate = search.run(iterations, lambda share: None)
        proof = prove(tube, candidate.path, candidate.places)
        spreads = candidate.path.curve.spreads
        assert (proof.segments + np.repeat(spreads, 2) <= proof.slack).all()
        assert (proof.vertices + spreads.max() <= proof.slack).all()
        # The timing of the spline, which compares shapes, is close to that of the traced path.
        assert len(search.durations) == iterations
        assert search.durations[-1] == pytest.approx(candidate.duration, rel=2e-3)
    assert (np.diff(search.durations) <= 0).all()
    assert candidate.duration < 0.97 * search.start.duration


def test_unsupported_paths_keep_their_start_with_a_note(arm, limits):
    exact = ac.Path.polyline(LINES.vertices, segment_limits=ac.SegmentLimits(tolerance=0.0))
    path = ac.shape(exact, arm, limits, ac.Shaped(tolerance=1e-3))
    assert "a line has no tolerance" in path.outcome.note
    assert path.outcome.durations["shaped"] == min(path.outcome.durations.values())
    assert explain_unshaped(LINES, Tube.around(LINES, 1e-3)) is None
    # A tolerance of zero stops at every vertex.
    plan = ac.plan(LINES, arm, limits, ac.Shaped(tolerance=0.0))
    np.testing.assert_allclose(plan.path.stops, LINES.breaks[1:-1])
    assert plan.duration == ac.plan(LINES, arm, limits).duration
    assert plan.method == "shaped" and plan.path.outcome.start == "stops"


def tube_of(path, options):
    return Tube.around(path, options.tolerance)


def test_the_starts_of_the_search_use_the_whole_tolerance():
    options = ac.Shaped(tolerance=5e-3)
    starts = make_starts(LINES, tube_of(LINES, options), options.tolerances)
    assert set(starts) == {STOPS, ARCS, PARABOLAS}
    for name in (ARCS, PARABOLAS):
        path, _ = starts[name]
        for errors in (path.project(LINES.vertices[1:3]).distance, path.corners.error):
            np.testing.assert_allclose(errors, 5e-3, rtol=1e-9)
    # A share of the tolerance is one of each vertex' own.
    points = [(0, 0), (0.1, 0), (0.1, 0.1), (0.2, 0.1)]
    segment_limits = ac.SegmentLimits(tolerance=1e-3)
    path = ac.Path.polyline(points, segment_limits=segment_limits)
    start_path, _ = make_starts(path, tube_of(path, options), options.tolerances, 0.7)[ARCS]
    np.testing.assert_allclose(start_path.corners.error, 0.7e-3, rtol=1e-9)


def test_the_middle_of_a_starting_arc_belongs_to_its_corner():
    options = ac.Shaped(tolerance=2e-3)
    for turn in (0.3, 1.5, 2.6, 3.0):
        end = np.array([0.1, 0]) + 0.1 * np.array([np.cos(turn), np.sin(turn)])
        path = ac.Path.polyline([(0, 0), (0.1, 0), end])
        arcs, places = make_starts(path, tube_of(path, options), options.tolerances)[ARCS]
        assert (np.diff(places, axis=0) >= 0).all(), turn
        # By symmetry the middle of the arc passes the corner; each half belongs to its line.
        middle = (arcs.corners.start[0] + arcs.corners.end[0]) / 2
        before = places[places[:, 1] < middle - 1e-9]
        after = places[places[:, 1] > middle + 1e-9]
        assert (before[:, 0] <= 0.1 + 1e-12).all() and (after[:, 0] >= 0.1 - 1e-12).all(), turn
        distances = np.linalg.norm(arcs(before[:, 1]) - path(before[:, 0]), axis=1)
        np.testing.assert_allclose(distances, np.abs(arcs(before[:, 1])[:, 1]), atol=1e-9)
    # A corner that turns back is a stop.
    path = ac.Path.polyline([(0, 0), (0.1, 0), (0.02, 0), (0.02, 0.1)])
    arcs, _ = make_starts(path, tube_of(path, options), options.tolerances)[ARCS]
    assert len(arcs.stops) == 1 and arcs.corners.reason[0] == "turn-back"


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
        ac.Line(start=corners[k], end=corners[k + 1], segment_limits=ac.SegmentLimits(speed=v))
        for k, v in enumerate((0.3, 0.1, None))
    ]
    objective = ac.Path(segments=lines)
    configuration = "positive"
    start = None
    if arm.dimension == 3:
        objective = objective.oriented(DOWN)
        configuration = None
        start = ac.trace(objective, arm)(0.0)
    tube = Tube.around(objective, TOLERANCE)
    options = ac.Shaped(tolerance=TOLERANCE)
    timer = Timer(arm, arm.limits.for_joints(arm.dof), configuration, start)
    path, places = make_starts(objective, tube, options.tolerances, 0.7)[PARABOLAS]
    candidate = timer.candidate(PARABOLAS, path, places)
    return arm, objective, tube, place_nodes(candidate, tube, arm, configuration)


@pytest.fixture(scope="module")
def drawn(case):
    arm, objective, _, nodes = case
    spline = JointSpline(q=nodes.q, h=np.diff(nodes.times), rest=nodes.rest)
    s_knots = spline.at_knots(nodes.s_objective[:, None])[:, 0]
    return draw(spline, arm, objective, s_knots, nodes.tolerance), spline


# Spans of the spline.
N = 9
# Step of the unknowns for differences.
STEP = 1e-6
NO_SPEEDS = np.full(N, np.inf)
# Spans whose velocities are well above zero at both ends.
MOVING = ~np.isin(np.arange(N), (0, 4, 5, N - 1))


@pytest.fixture(scope="module", params=["pmk3s", "ur5e"])
def moving(request):
    """An arm, and a spline of its joints that bends everywhere and rests once in between."""
    random = np.random.default_rng(3)
    arm = ac.load_arm(request.param)
    middle = [0.4, 1.1] if arm.dof == 2 else [0.3, -1.2, 1.6, -1.9, -1.5, 0.2]
    q = np.array(middle) + 0.02 * np.cumsum(random.normal(size=(N, arm.dof)), axis=0)
    rest = np.isin(np.arange(N + 1), (0, 5, N))
    q[5] = q[4]
    return arm, JointSpline(q=q, h=random.uniform(0.02, 0.05, N), rest=rest)


def test_the_derivatives_of_the_program_agree_with_differences(moving):
    arm, spline = moving
    k = arm.dimension - 1
    steps = np.random.default_rng(5).normal(size=(N, arm.dof, k))
    unit = np.where(MOVING, 1e-3, 0.0)
    limits = ac.Limits.only(joint_acceleration=2.0).for_joints(arm.dof)
    rows = span_rows(spline, arm, limits, NO_SPEEDS)
    matrix, bounds = assemble(spline, rows, steps, unit)
    np.testing.assert_allclose(bounds, -rows.value / rows.scale)

    def value(x):
        q = spline.q + np.einsum("njk,nk->nj", steps, x[:, :k] * unit[:, None])
        changed = JointSpline(q=q, h=spline.h * (1 + x[:, k]), rest=spline.rest)
        return span_rows(changed, arm, limits, NO_SPEEDS).value / rows.scale

    near = 1e-6 * max(np.abs(matrix).max(), 1.0)
    for node in range(N):
        for j in range(k + 1):
            x = np.zeros((N, k + 1))
            x[node, j] = STEP
            expected = (value(x) - value(-x)) / (2 * STEP)
            for offset in (-1, 0, 1):
                if 0 <= node - offset < N:
                    column = matrix[node - offset, :, (offset + 1) * (k + 1) + j]
                    np.testing.assert_allclose(column, expected[node - offset], atol=near)
