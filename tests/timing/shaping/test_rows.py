"""Rows of shaping's quadratic program: their values and their derivatives by finite differences."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

import armcontour as ac
from armcontour.timing.shaping.rows import Spline, assemble, span_rows

N, STEP = 9, 1e-6
NO_SPEEDS = np.full(N, np.inf)


@pytest.fixture(scope="module", params=["pmk3s", "ur5e"])
def moving(request):
    """An arm, and a spline of its joints that bends everywhere and rests once in between."""
    random = np.random.default_rng(3)
    arm = ac.load_arm(request.param)
    middle = [0.4, 1.1] if arm.dof == 2 else [0.3, -1.2, 1.6, -1.9, -1.5, 0.2]
    q = np.array(middle) + 0.02 * np.cumsum(random.normal(size=(N, arm.dof)), axis=0)
    rest = np.zeros(N + 1, dtype=bool)
    rest[[0, 5, N]] = True
    q[5] = q[4]
    return arm, Spline(q=q, h=random.uniform(0.02, 0.05, N), rest=rest)


def frozen(spline, *, before=0.0, after=0.0, time=0.0):
    """The velocities and span times of a spline, a little changed at each end of each span.

    Every span becomes a spline of its own, so that its two velocities are independent.
    """
    e = spline.velocities
    return [
        SimpleNamespace(
            q=spline.q[i : i + 1],
            h=spline.h[i : i + 1] + time,
            velocities=np.stack([e[i] + before, e[i + 1] + after]),
            knots=spline.knots[i : i + 2],
        )
        for i in range(len(spline.q))
    ]


def values(arm, spline, limits, speeds=NO_SPEEDS, **change):
    parts = frozen(spline, **change)
    found = [span_rows(x, arm, limits, speeds[i : i + 1]) for i, x in enumerate(parts)]
    return np.concatenate([x.value for x in found])


def moved(spline):
    """Spans whose velocities are well above zero at both ends."""
    return ~(spline.rest[1:] | spline.rest[:-1])


def check_derivatives(arm, spline, limits, columns, speeds=NO_SPEEDS, on=None):
    """Compare derivatives by both velocities and the span time with central differences."""
    rows = span_rows(spline, arm, limits, speeds)
    on = moved(spline) if on is None else on

    def slope(**change):
        less = {name: -x for name, x in change.items()}
        up, down = (values(arm, spline, limits, speeds, **x) for x in (change, less))
        return ((up - down) / (2 * STEP))[on][:, columns]

    scale = np.abs(rows.before[on][:, columns]).max() + np.abs(rows.after[on][:, columns]).max()
    near = 1e-6 * max(scale, 1.0)
    for j, unit in enumerate(STEP * np.eye(arm.dof)):
        np.testing.assert_allclose(rows.before[on][:, columns, j], slope(before=unit), atol=near)
        np.testing.assert_allclose(rows.after[on][:, columns, j], slope(after=unit), atol=near)
    time = rows.time[on][:, columns]
    np.testing.assert_allclose(time, slope(time=STEP), rtol=1e-6, atol=1e-6 * np.abs(time).max())


def test_rows_of_joint_acceleration_take_each_direction_by_its_own_limit(moving):
    arm, spline = moving
    limits = ac.Limits(joint_acceleration=2.0, joint_deceleration=3.0).for_joints(arm.dof)
    rows = span_rows(spline, arm, limits, NO_SPEEDS)
    a = np.diff(spline.velocities, axis=0) / spline.h[:, None]
    expected = np.concatenate([a - 2.0, -a - 3.0], axis=1) * spline.h[:, None]
    np.testing.assert_allclose(rows.value, expected, atol=1e-12)
    assert (rows.scale > 0).all()
    check_derivatives(arm, spline, limits, slice(None))


def test_rows_of_joint_velocity(moving):
    arm, spline = moving
    # Far below the limit a row is left out: this one is near for all.
    most = float(np.abs(spline.velocities).max())
    limits = ac.Limits(joint_velocity=most).for_joints(arm.dof)
    rows = span_rows(spline, arm, limits, NO_SPEEDS)
    e = spline.velocities[1:]
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


def tool_acceleration(arm, spline, last, *, across):
    """Acceleration of the tool at one end of each span, or its part across the motion [m/s²]."""
    e = spline.velocities
    a = np.diff(e, axis=0) / spline.h[:, None]
    end = slice(last, N + last)
    velocity, found = arm.tool_motion(spline.knots[end], e[end], a)
    if across:
        tangent = velocity / np.maximum(np.linalg.norm(velocity, axis=1, keepdims=True), 1e-300)
        found = found - np.sum(found * tangent, axis=1, keepdims=True) * tangent
    return np.linalg.norm(found, axis=1)


@pytest.mark.parametrize("name", ["tool_acceleration", "centripetal_acceleration"])
def test_rows_of_the_tool_acceleration_hold_its_own_direction(moving, name):
    arm, spline = moving
    most = 0.7
    limits = ac.Limits(**{name: most})
    rows = span_rows(spline, arm, limits, NO_SPEEDS)
    per_end = rows.value.shape[1] // 2
    on = moved(spline)
    for last in (0, 1):
        size = tool_acceleration(arm, spline, last, across=name.startswith("c"))
        expected = (size - most) * spline.h
        largest = rows.value[:, last * per_end : (last + 1) * per_end].max(axis=1)
        np.testing.assert_allclose(largest[on], expected[on], rtol=1e-6, atol=1e-9)
    # Other directions turn with the first one: their derivatives are those of fixed directions.
    check_derivatives(arm, spline, limits, [0, per_end])


def test_rows_of_joint_torques(moving):
    arm, spline = moving
    if not arm.has_bodies:
        pytest.skip("no bodies")
    limits = ac.Limits(joint_torque=20.0).for_joints(arm.dof)
    rows = span_rows(spline, arm, limits, NO_SPEEDS)
    a = np.diff(spline.velocities, axis=0) / spline.h[:, None]
    for last in (0, 1):
        end = slice(last, N + last)
        torque = arm.torque(spline.knots[end], spline.velocities[end], a)
        expected = (np.concatenate([torque, -torque], axis=1) - 20.0) * spline.h[:, None]
        found = rows.value[:, 2 * arm.dof * last : 2 * arm.dof * (last + 1)]
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)
    # The velocity at the other end acts by the acceleration alone, and so does the span time.
    start, end = slice(0, 2 * arm.dof), slice(2 * arm.dof, None)
    on = moved(spline)

    def slope(**change):
        less = {name: -x for name, x in change.items()}
        up, down = (values(arm, spline, limits, **x) for x in (change, less))
        return ((up - down) / (2 * STEP))[on]

    near = 1e-6 * np.abs(rows.after).max()
    for j, unit in enumerate(STEP * np.eye(arm.dof)):
        after, before = slope(after=unit), slope(before=unit)
        np.testing.assert_allclose(rows.after[on][:, start, j], after[:, start], atol=near)
        np.testing.assert_allclose(rows.before[on][:, end, j], before[:, end], atol=near)
    np.testing.assert_allclose(rows.time[on], slope(time=STEP), rtol=1e-5, atol=1e-5)


def test_coriolis_torques_count_by_the_speed_of_all_joints_together(moving):
    """Their derivative in the direction of the motion is exact, if friction is left out."""
    arm, spline = moving
    if not arm.has_bodies:
        pytest.skip("no bodies")
    limits = ac.Limits(joint_torque=20.0).for_joints(arm.dof)
    rows, e = span_rows(spline, arm, limits, NO_SPEEDS), spline.velocities
    zero = np.zeros_like(e)
    mass = arm.dynamics.mass_matrix(spline.knots)
    still, bias = (arm.dynamics.torque(spline.knots, x, zero) for x in (zero, e))
    for last, way in ((0, rows.before), (1, rows.after)):
        end = slice(last, N + last)
        own = way[:, 2 * arm.dof * last : 2 * arm.dof * last + arm.dof]
        along = np.einsum("nij,nj->ni", own, e[end])
        sign = 1.0 if last else -1.0
        inertia = sign * np.einsum("nij,nj->ni", mass[end], e[end])
        expected = inertia + 2 * spline.h[:, None] * (bias - still)[end]
        np.testing.assert_allclose(along, expected, rtol=1e-9, atol=1e-9)


def test_the_program_has_the_derivatives_by_offsets_and_span_times(moving):
    arm, spline = moving
    random = np.random.default_rng(5)
    k = arm.dimension - 1
    steps = random.normal(size=(N, arm.dof, k))
    unit = np.where(np.isin(np.arange(N), [0, 4, 5, N - 1]), 0.0, 1e-3)
    limits = ac.Limits(joint_acceleration=2.0).for_joints(arm.dof)
    found, bounds = assemble(spline, span_rows(spline, arm, limits, NO_SPEEDS), steps, unit)
    rows = span_rows(spline, arm, limits, NO_SPEEDS)
    np.testing.assert_allclose(bounds, -rows.value / rows.scale)

    def value(x):
        q = spline.q + np.einsum("njk,nk->nj", steps, x[:, :k] * unit[:, None])
        changed = Spline(q=q, h=spline.h * (1 + x[:, k]), rest=spline.rest)
        return span_rows(changed, arm, limits, NO_SPEEDS).value / rows.scale

    for node in range(N):
        for j in range(k + 1):
            x = np.zeros((N, k + 1))
            x[node, j] = STEP
            slope = (value(x) - value(-x)) / (2 * STEP)
            for off in (-1, 0, 1):
                if 0 <= node - off < N:
                    column = found[node - off, :, (off + 1) * (k + 1) + j]
                    near = 1e-6 * max(np.abs(found).max(), 1.0)
                    np.testing.assert_allclose(column, slope[node - off], atol=near)
