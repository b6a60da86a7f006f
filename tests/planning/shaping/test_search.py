"""The search of shaped paths: starts, curves, kinematics, rows and their program."""

from types import SimpleNamespace

import numpy as np
import pytest

import armcontour as ac
from armcontour.geometry import Tube
from armcontour.planning.shaping.curves import draw
from armcontour.planning.shaping.nodes import place_nodes
from armcontour.planning.shaping.search import explain_unshaped, make_searches
from armcontour.planning.shaping.spline_rows import JointSpline, assemble, span_rows
from armcontour.planning.shaping.starts import (
    ARCS,
    PARABOLAS,
    STOPS,
    Timer,
    make_starts,
    prove,
)

LINES = ac.Path.polyline([(0.35, 0.10), (0.41, 0.15), (0.28, 0.30), (0.35, 0.35)])


@pytest.mark.parametrize("centripetal", [0.09, None])
def test_every_iteration_is_within_the_tube_and_no_slower(arm, centripetal):
    limits = ac.Limits.only(
        speed=0.15, joint_acceleration=0.72, centripetal_acceleration=centripetal
    ).for_joints(2)
    tube, options = Tube.around(LINES, 1e-3), ac.Shaped(tolerance=1e-3)
    timer = Timer(arm, limits, "positive", None, 800)
    search = next(make_searches(LINES, tube, timer, options))
    durations = []
    for _, candidate in zip(range(8), search.run(), strict=False):
        durations.append(candidate.duration)
        proof = prove(tube, candidate.path, candidate.places)
        spreads = candidate.path.curve.spreads
        assert (proof.segments + np.repeat(spreads, 2) <= proof.slack).all()
        assert (proof.vertices + spreads.max() <= proof.slack).all()
        # What the tool draws is the spline of the best state.
        assert len(search.state.h) == len(search.nodes)
        np.testing.assert_allclose(search.state.h.sum(), candidate.duration, rtol=1e-9)
    # The first spline may be slower than the start that it is drawn from.
    assert all(b <= a for a, b in zip(durations[:-1], durations[1:], strict=True))
    assert durations[-1] < 0.97 * search.start.duration


def test_what_is_not_shaped(arm, limits):
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


def test_starts_use_all_of_the_tolerance():
    options = ac.Shaped(tolerance=5e-3)
    starts = make_starts(LINES, tube_of(LINES, options), options)
    assert set(starts) == {STOPS, ARCS, PARABOLAS}
    for name in (ARCS, PARABOLAS):
        path, _ = starts[name]
        for errors in (path.project(LINES.vertices[1:3]).distance, path.corners.error):
            np.testing.assert_allclose(errors, 5e-3, rtol=1e-9)
    # A share of the tolerance is one of each vertex' own.
    points, segment_limits = (
        [(0, 0), (0.1, 0), (0.1, 0.1), (0.2, 0.1)],
        ac.SegmentLimits(tolerance=1e-3),
    )
    path = ac.Path.polyline(points, segment_limits=segment_limits)
    start_path, _ = make_starts(path, tube_of(path, options), options, 0.7)[ARCS]
    np.testing.assert_allclose(start_path.corners.error, 0.7e-3, rtol=1e-9)


def test_the_nearest_point_of_a_corner_passes_it():
    options = ac.Shaped(tolerance=2e-3)
    for turn in (0.3, 1.5, 2.6, 3.0):
        end = np.array([0.1, 0]) + 0.1 * np.array([np.cos(turn), np.sin(turn)])
        path = ac.Path.polyline([(0, 0), (0.1, 0), end])
        arcs, places = make_starts(path, tube_of(path, options), options)[ARCS]
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
    arcs, _ = make_starts(path, tube_of(path, options), options)[ARCS]
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
    objective, configuration, start = ac.Path.from_segments(lines), "positive", None
    if arm.dimension == 3:
        objective = objective.oriented(DOWN)
        configuration, start = None, ac.trace(objective, arm)(0.0)
    tube, options = Tube.around(objective, TOLERANCE), ac.Shaped(tolerance=TOLERANCE)
    timer = Timer(arm, arm.limits.for_joints(arm.dof), configuration, start)
    path, places = make_starts(objective, tube, options, 0.7)[PARABOLAS]
    candidate = timer.candidate(PARABOLAS, path, places)
    return arm, objective, tube, place_nodes(candidate, tube, arm, configuration)


@pytest.fixture(scope="module")
def drawn(case):
    arm, objective, _, nodes = case
    spline = JointSpline(q=nodes.q, h=np.diff(nodes.times), rest=nodes.rest)
    return draw(spline, arm, objective, nodes.s_objective, nodes.tolerance), spline


def test_arcs_are_tangent_and_near_the_curve_between_samples(drawn):
    shape_drawn, _ = drawn
    path = ac.Path(segments=shape_drawn.segments)
    assert path.turns.max() < 1e-9
    curve, s = shape_drawn.curve, shape_drawn.curve.breaks
    assert s[-1] == pytest.approx(path.length, abs=1e-12)
    for share in np.linspace(0, 1, 97):
        samples = s[:-1] + share * np.diff(s)
        on = curve.on_piece(np.arange(len(samples)), samples)
        distances = np.linalg.norm(on - path(np.minimum(samples, path.length)), axis=1)
        assert (distances <= curve.spreads + 1e-13).all()
    assert curve.spreads.max() < 1e-3 * TOLERANCE


def test_the_curve_is_that_of_the_spline(case, drawn):
    arm = case[0]
    shaped, spline = drawn
    knots = arm.tool_position(spline.knots)
    np.testing.assert_allclose(ac.Path(segments=shaped.segments)(shaped.knots), knots, atol=1e-9)
    # The middle of a span is on the curve, too.
    a = np.diff(spline.velocities, axis=0) / spline.h[:, None]
    h = spline.h[:, None]
    middle = arm.tool_position(spline.knots[:-1] + spline.velocities[:-1] * h / 2 + a * h**2 / 8)
    s = np.linspace(0, shaped.curve.breaks[-1], 200_001)
    piece = np.clip(np.searchsorted(shaped.curve.breaks, s) - 1, 0, len(shaped.curve.breaks) - 2)
    points = shaped.curve.on_piece(piece, s)
    pitch = s[1]
    for point, low, high in zip(middle, shaped.knots[:-1], shaped.knots[1:], strict=True):
        part = points[(s >= low - pitch) & (s <= high + pitch)]
        assert np.linalg.norm(part - point, axis=1).min() < pitch


def test_places_lead_to_the_end_and_parts_take_the_least_speed_of_their_segments(case, drawn):
    objective, shaped = case[1], drawn[0]
    assert (np.diff(shaped.places, axis=0) >= 0).all()
    end = [objective.length, shaped.segments.breaks[-1]]
    np.testing.assert_allclose(shaped.places[[0, -1]], [[0.0, 0.0], end])
    middle = (shaped.segments.breaks[:-1] + shaped.segments.breaks[1:]) / 2
    speeds = objective.speeds[
        objective.locate(np.interp(middle, shaped.places[:, 1], shaped.places[:, 0]))
    ]
    assigned = np.isfinite(speeds)
    assert (shaped.segments.speeds[assigned] <= speeds[assigned]).all()
    # Parts that lie along two segments are short.
    other = ~np.isclose(shaped.segments.speeds, speeds, equal_nan=True)
    assert 0 < other.sum() <= 20


def test_nodes_are_dense_at_corners_and_fixed_where_the_arm_rests(case):
    _, objective, tube, nodes = case
    assert nodes.fixed[[0, -1]].all() and not nodes.fixed[1:-1].any()
    assert nodes.rest.sum() == 2
    gaps = np.linalg.norm(np.diff(nodes.points, axis=0), axis=1)
    for k, corner in enumerate(objective.vertices[tube.vertex]):
        node = int(np.argmin(np.linalg.norm(nodes.points - corner, axis=1)))
        assert abs(nodes.s_objective[node] - objective.breaks[tube.vertex[k]]) < TOLERANCE
        assert (nodes.vertex[node - 1 : node + 2] == k).all()
        assert gaps[node] < 0.2 * TOLERANCE < gaps.max()


def test_bounds_of_offsets_keep_control_points_in_the_tube(case):
    _, _, tube, nodes = case
    limits = nodes.bounds(tube, np.full(len(nodes), 1e-3))
    assert not limits[nodes.fixed].any() and (limits[~nodes.fixed].max(axis=1) > 0).all()
    windows = tube.windows(nodes.s_objective, nodes.reach)
    near = nodes.vertex >= 0
    corners = tube.objective.vertices[np.append(tube.vertex, 0)[nodes.vertex]]
    for side, bound in zip(nodes.sides, limits.T, strict=True):
        for share in (0.3, 1.0):
            offset = nodes.frames @ side * (share * bound)[:, None]
            points = nodes.points + offset
            assert (tube.margin(points, windows) >= 0).all()
            assert (np.linalg.norm(points - corners, axis=1)[near] <= TOLERANCE).all()
    # No limit is much less than it has to be: next to the lines it is a circle's.
    middle = limits[np.argmax(np.diff(nodes.s_objective))]
    assert middle.min() > 0.9 * TOLERANCE


N, STEP = 9, 1e-6
NO_SPEEDS = np.full(N, np.inf)
# Spans whose velocities are well above zero at both ends.
MOVING = ~np.isin(np.arange(N), (0, 4, 5, N - 1))
ENDS = slice(0, N), slice(1, N + 1)


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


def slope(arm, spline, limits, speeds=NO_SPEEDS, **change):
    """Central difference of rows by a change of velocities before and after, and span times.

    Every span becomes a spline of its own, so that its two velocities are independent.
    """
    values = []
    for sign in (1, -1):
        change_of_spans = {"before": 0.0, "after": 0.0, "time": 0.0} | {
            k: sign * x for k, x in change.items()
        }
        for i in range(N):
            e = spline.velocities
            part = SimpleNamespace(
                q=spline.q[i : i + 1],
                h=spline.h[i : i + 1] + change_of_spans["time"],
                velocities=np.stack(
                    [e[i] + change_of_spans["before"], e[i + 1] + change_of_spans["after"]]
                ),
                knots=spline.knots[i : i + 2],
            )
            values.append(span_rows(part, arm, limits, speeds[i : i + 1]).value)
    up, down = np.concatenate(values[:N]), np.concatenate(values[N:])
    return ((up - down) / (2 * STEP))[MOVING]


def check_derivatives(arm, spline, limits, columns, speeds=NO_SPEEDS):
    """Compare derivatives by both velocities and the span time with central differences."""
    rows = span_rows(spline, arm, limits, speeds)
    both = {"before": rows.before, "after": rows.after}
    scale = sum(np.abs(x[MOVING][:, columns]).max() for x in both.values())
    near = 1e-6 * max(scale, 1.0)
    for j, unit in enumerate(STEP * np.eye(arm.dof)):
        for name, derivative in both.items():
            expected = slope(arm, spline, limits, speeds, **{name: unit})[:, columns]
            np.testing.assert_allclose(derivative[MOVING][:, columns, j], expected, atol=near)
    time = rows.time[MOVING][:, columns]
    expected = slope(arm, spline, limits, speeds, time=STEP)[:, columns]
    np.testing.assert_allclose(time, expected, rtol=1e-6, atol=1e-6 * np.abs(time).max())


def accelerations(spline):
    return np.diff(spline.velocities, axis=0) / spline.h[:, None]


def test_rows_of_joint_acceleration_take_each_direction_by_its_own_limit(moving):
    arm, spline = moving
    limits = ac.Limits.only(joint_acceleration=[[-3.0, 2.0]]).for_joints(arm.dof)
    rows, a = span_rows(spline, arm, limits, NO_SPEEDS), accelerations(spline)
    expected = np.concatenate([a - 2.0, -a - 3.0], axis=1) * spline.h[:, None]
    np.testing.assert_allclose(rows.value, expected, atol=1e-12)
    assert (rows.scale > 0).all()
    check_derivatives(arm, spline, limits, slice(None))


def test_rows_of_joint_velocity(moving):
    arm, spline = moving
    # Far below the limit a row is left out: this one is near for all.
    velocity = float(np.abs(spline.velocities).max())
    limits = ac.Limits.only(joint_velocity=velocity).for_joints(arm.dof)
    rows, e = span_rows(spline, arm, limits, NO_SPEEDS), spline.velocities[1:]
    np.testing.assert_allclose(rows.value, np.concatenate([e, -e], axis=1) - velocity)
    near = rows.value > -0.5 * velocity
    both = np.concatenate([np.eye(arm.dof), -np.eye(arm.dof)])
    np.testing.assert_array_equal(rows.after[near], np.broadcast_to(both, rows.after.shape)[near])
    assert not rows.before.any() and not rows.time.any()


def test_rows_of_the_tool_speed_know_segments_with_speeds_of_their_own(moving):
    arm, spline = moving
    speeds = np.where(np.arange(N) % 2, np.inf, 0.3)
    rows = span_rows(spline, arm, ac.Limits.only(), speeds)
    speed = np.linalg.norm(arm.tool_velocity(spline.knots[1:], spline.velocities[1:]), axis=1)
    assigned = np.isfinite(speeds)
    np.testing.assert_allclose(rows.value[assigned, 0], speed[assigned] - 0.3)
    assert (rows.value[~assigned] < -0.9 * rows.scale[~assigned]).all()
    # Far below the speed a row is left out: these are at it.
    check_derivatives(arm, spline, ac.Limits.only(), slice(None), speed)


@pytest.mark.parametrize("name", ["tool_acceleration", "centripetal_acceleration"])
def test_rows_of_the_tool_acceleration_hold_its_own_direction(moving, name):
    arm, spline = moving
    limits, bound = ac.Limits.only(**{name: 0.7}), 0.7
    rows = span_rows(spline, arm, limits, NO_SPEEDS)
    per_end, e = rows.value.shape[1] // 2, spline.velocities
    for last, end in enumerate(ENDS):
        velocity, acceleration = arm.tool_motion(spline.knots[end], e[end], accelerations(spline))
        if name.startswith("c"):
            # The part across the motion.
            size = np.linalg.norm(velocity, axis=1, keepdims=True)
            tangent = velocity / np.maximum(size, 1e-300)
            acceleration = (
                acceleration - np.sum(acceleration * tangent, axis=1, keepdims=True) * tangent
            )
        expected = (np.linalg.norm(acceleration, axis=1) - bound) * spline.h
        largest = rows.value[:, last * per_end : (last + 1) * per_end].max(axis=1)
        np.testing.assert_allclose(largest[MOVING], expected[MOVING], rtol=1e-6, atol=1e-9)
    # Other directions turn with the first one: their derivatives are those of fixed directions.
    check_derivatives(arm, spline, limits, [0, per_end])


def test_rows_of_joint_torques(moving):
    """Coriolis torques count by the speed of all joints together.

    Their derivative in the direction of the motion is exact, if friction is left out.
    """
    arm, spline = moving
    if not arm.has_bodies:
        return
    limits = ac.Limits.only(joint_torque=20.0).for_joints(arm.dof)
    rows, e, a = span_rows(spline, arm, limits, NO_SPEEDS), spline.velocities, accelerations(spline)
    mass = arm.dynamics.mass_matrix(spline.knots)
    still, bias = (arm.dynamics.torque(spline.knots, x, 0 * e) for x in (0 * e, e))
    for last, (end, way) in enumerate(zip(ENDS, (rows.before, rows.after), strict=True)):
        torque = arm.torque(spline.knots[end], e[end], a)
        expected = (np.concatenate([torque, -torque], axis=1) - 20.0) * spline.h[:, None]
        first = 2 * arm.dof * last
        torques = rows.value[:, first : first + 2 * arm.dof]
        np.testing.assert_allclose(torques, expected, rtol=1e-9, atol=1e-9)
        along = np.einsum("nij,nj->ni", way[:, first : first + arm.dof], e[end])
        inertia = (1.0 if last else -1.0) * np.einsum("nij,nj->ni", mass[end], e[end])
        expected = inertia + 2 * spline.h[:, None] * (bias - still)[end]
        np.testing.assert_allclose(along, expected, rtol=1e-9, atol=1e-9)
    # The velocity at the other end acts by the acceleration alone, and so does the span time.
    start, end, near = slice(0, 2 * arm.dof), slice(2 * arm.dof, None), 1e-6
    near *= np.abs(rows.after).max()
    for j, unit in enumerate(STEP * np.eye(arm.dof)):
        for name, derivative, part in (("after", rows.after, start), ("before", rows.before, end)):
            expected = slope(arm, spline, limits, **{name: unit})[:, part]
            np.testing.assert_allclose(derivative[MOVING][:, part, j], expected, atol=near)
    time = slope(arm, spline, limits, time=STEP)
    np.testing.assert_allclose(rows.time[MOVING], time, rtol=1e-5, atol=1e-5)


def test_the_program_has_the_derivatives_by_offsets_and_span_times(moving):
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
