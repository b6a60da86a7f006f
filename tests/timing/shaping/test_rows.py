"""Rows of shaping's quadratic program: their values and their derivatives by finite differences."""

from types import SimpleNamespace

import numpy as np
import pytest

import armcontour as ac
from armcontour.timing.shaping.rows import Spline, assemble, span_rows

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
    return arm, Spline(q=q, h=random.uniform(0.02, 0.05, N), rest=rest)


def slope(arm, spline, limits, speeds=NO_SPEEDS, **change):
    """Central difference of rows by a change of velocities before and after, and span times.

    Every span becomes a spline of its own, so that its two velocities are independent.
    """
    found = []
    for sign in (1, -1):
        own = {"before": 0.0, "after": 0.0, "time": 0.0} | {k: sign * x for k, x in change.items()}
        for i in range(N):
            e = spline.velocities
            part = SimpleNamespace(
                q=spline.q[i : i + 1],
                h=spline.h[i : i + 1] + own["time"],
                velocities=np.stack([e[i] + own["before"], e[i + 1] + own["after"]]),
                knots=spline.knots[i : i + 2],
            )
            found.append(span_rows(part, arm, limits, speeds[i : i + 1]).value)
    up, down = np.concatenate(found[:N]), np.concatenate(found[N:])
    return ((up - down) / (2 * STEP))[MOVING]


def check_derivatives(arm, spline, limits, columns, speeds=NO_SPEEDS):
    """Compare derivatives by both velocities and the span time with central differences."""
    rows = span_rows(spline, arm, limits, speeds)
    both = {"before": rows.before, "after": rows.after}
    scale = sum(np.abs(x[MOVING][:, columns]).max() for x in both.values())
    near = 1e-6 * max(scale, 1.0)
    for j, unit in enumerate(STEP * np.eye(arm.dof)):
        for name, own in both.items():
            expected = slope(arm, spline, limits, speeds, **{name: unit})[:, columns]
            np.testing.assert_allclose(own[MOVING][:, columns, j], expected, atol=near)
    time = rows.time[MOVING][:, columns]
    expected = slope(arm, spline, limits, speeds, time=STEP)[:, columns]
    np.testing.assert_allclose(time, expected, rtol=1e-6, atol=1e-6 * np.abs(time).max())


def accelerations(spline):
    return np.diff(spline.velocities, axis=0) / spline.h[:, None]


def test_rows_of_joint_acceleration_take_each_direction_by_its_own_limit(moving):
    arm, spline = moving
    limits = ac.Limits(joint_acceleration=2.0, joint_deceleration=3.0).for_joints(arm.dof)
    rows, a = span_rows(spline, arm, limits, NO_SPEEDS), accelerations(spline)
    expected = np.concatenate([a - 2.0, -a - 3.0], axis=1) * spline.h[:, None]
    np.testing.assert_allclose(rows.value, expected, atol=1e-12)
    assert (rows.scale > 0).all()
    check_derivatives(arm, spline, limits, slice(None))


def test_rows_of_joint_velocity(moving):
    arm, spline = moving
    # Far below the limit a row is left out: this one is near for all.
    most = float(np.abs(spline.velocities).max())
    limits = ac.Limits(joint_velocity=most).for_joints(arm.dof)
    rows, e = span_rows(spline, arm, limits, NO_SPEEDS), spline.velocities[1:]
    np.testing.assert_allclose(rows.value, np.concatenate([e, -e], axis=1) - most)
    near = rows.value > -0.5 * most
    both = np.concatenate([np.eye(arm.dof), -np.eye(arm.dof)])
    np.testing.assert_array_equal(rows.after[near], np.broadcast_to(both, rows.after.shape)[near])
    assert not rows.before.any() and not rows.time.any()


def test_rows_of_the_tool_speed_know_segments_with_speeds_of_their_own(moving):
    arm, spline = moving
    speeds = np.where(np.arange(N) % 2, np.inf, 0.3)
    rows = span_rows(spline, arm, ac.Limits(), speeds)
    speed = np.linalg.norm(arm.tool_velocity(spline.knots[1:], spline.velocities[1:]), axis=1)
    given = np.isfinite(speeds)
    np.testing.assert_allclose(rows.value[given, 0], speed[given] - 0.3)
    assert (rows.value[~given] < -0.9 * rows.scale[~given]).all()
    # Far below the speed a row is left out: these are at it.
    check_derivatives(arm, spline, ac.Limits(), slice(None), speed)


@pytest.mark.parametrize("name", ["tool_acceleration", "centripetal_acceleration"])
def test_rows_of_the_tool_acceleration_hold_its_own_direction(moving, name):
    arm, spline = moving
    limits, most = ac.Limits(**{name: 0.7}), 0.7
    rows = span_rows(spline, arm, limits, NO_SPEEDS)
    per_end, e = rows.value.shape[1] // 2, spline.velocities
    for last, end in enumerate(ENDS):
        velocity, found = arm.tool_motion(spline.knots[end], e[end], accelerations(spline))
        if name.startswith("c"):
            # The part across the motion.
            size = np.linalg.norm(velocity, axis=1, keepdims=True)
            tangent = velocity / np.maximum(size, 1e-300)
            found = found - np.sum(found * tangent, axis=1, keepdims=True) * tangent
        expected = (np.linalg.norm(found, axis=1) - most) * spline.h
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
    limits = ac.Limits(joint_torque=20.0).for_joints(arm.dof)
    rows, e, a = span_rows(spline, arm, limits, NO_SPEEDS), spline.velocities, accelerations(spline)
    mass = arm.dynamics.mass_matrix(spline.knots)
    still, bias = (arm.dynamics.torque(spline.knots, x, 0 * e) for x in (0 * e, e))
    for last, (end, way) in enumerate(zip(ENDS, (rows.before, rows.after), strict=True)):
        torque = arm.torque(spline.knots[end], e[end], a)
        expected = (np.concatenate([torque, -torque], axis=1) - 20.0) * spline.h[:, None]
        first = 2 * arm.dof * last
        found = rows.value[:, first : first + 2 * arm.dof]
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)
        along = np.einsum("nij,nj->ni", way[:, first : first + arm.dof], e[end])
        inertia = (1.0 if last else -1.0) * np.einsum("nij,nj->ni", mass[end], e[end])
        expected = inertia + 2 * spline.h[:, None] * (bias - still)[end]
        np.testing.assert_allclose(along, expected, rtol=1e-9, atol=1e-9)
    # The velocity at the other end acts by the acceleration alone, and so does the span time.
    start, end, near = slice(0, 2 * arm.dof), slice(2 * arm.dof, None), 1e-6
    near *= np.abs(rows.after).max()
    for j, unit in enumerate(STEP * np.eye(arm.dof)):
        for name, own, part in (("after", rows.after, start), ("before", rows.before, end)):
            expected = slope(arm, spline, limits, **{name: unit})[:, part]
            np.testing.assert_allclose(own[MOVING][:, part, j], expected, atol=near)
    time = slope(arm, spline, limits, time=STEP)
    np.testing.assert_allclose(rows.time[MOVING], time, rtol=1e-5, atol=1e-5)


def test_the_program_has_the_derivatives_by_offsets_and_span_times(moving):
    arm, spline = moving
    k = arm.dimension - 1
    steps = np.random.default_rng(5).normal(size=(N, arm.dof, k))
    unit = np.where(MOVING, 1e-3, 0.0)
    limits = ac.Limits(joint_acceleration=2.0).for_joints(arm.dof)
    rows = span_rows(spline, arm, limits, NO_SPEEDS)
    found, bounds = assemble(spline, rows, steps, unit)
    np.testing.assert_allclose(bounds, -rows.value / rows.scale)

    def value(x):
        q = spline.q + np.einsum("njk,nk->nj", steps, x[:, :k] * unit[:, None])
        changed = Spline(q=q, h=spline.h * (1 + x[:, k]), rest=spline.rest)
        return span_rows(changed, arm, limits, NO_SPEEDS).value / rows.scale

    near = 1e-6 * max(np.abs(found).max(), 1.0)
    for node in range(N):
        for j in range(k + 1):
            x = np.zeros((N, k + 1))
            x[node, j] = STEP
            expected = (value(x) - value(-x)) / (2 * STEP)
            for off in (-1, 0, 1):
                if 0 <= node - off < N:
                    column = found[node - off, :, (off + 1) * (k + 1) + j]
                    np.testing.assert_allclose(column, expected[node - off], atol=near)
