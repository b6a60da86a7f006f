"""Evaluation of executions with known errors."""

from dataclasses import replace
from functools import partial
from itertools import product

import numpy as np
import pytest
from scipy.integrate import trapezoid

import armcontour as ac
from armcontour.motion import LapLaw


def by_hand(arm, t, tool, demand=None, planned=None):
    """An execution whose tool is at `tool` at times `t`; velocities by differences."""
    t = np.asarray(t, float)
    tool = np.asarray(tool, float)
    q = arm.joint_position(tool)
    dq = np.gradient(q, t, axis=0)
    demand = np.zeros_like(q) if demand is None else np.asarray(demand, float)
    where = q if planned is None else arm.joint_position(np.asarray(planned, float))
    law = LapLaw(breaks=t, q=where, dq=np.diff(where, axis=0) / np.diff(t)[:, None],
                 ddq=np.zeros((len(t) - 1, 2)))  # fmt: skip
    trajectory = ac.Trajectory(laws=(law,), method="hand")
    return ac.Execution(
        arm=arm,
        set_points=ac.SetPoints(cycle=0.01, q=q[-1:], trajectory=trajectory, method="hand"),
        t=t,
        q=q,
        dq=dq,
        ddq=np.clip(demand, -0.72, 0.72),
        demand=demand,
        demand_range=np.stack([demand.min(axis=0), demand.max(axis=0)]),
        saturated_time=np.array([0.5, 0.0]),
    )


LINE = ac.Path.polyline([(0.3, 0.2), (0.4, 0.2)])
T = np.linspace(0, 2, 201)
ALONG = np.stack([0.3 + 0.1 * T / 2, np.full_like(T, 0.2)], axis=1)


def test_delay_along_path_causes_no_contour_error(arm):
    evaluation = ac.evaluate(by_hand(arm, T, ALONG), LINE, objective=LINE)
    assert evaluation.contour_error.max < 1e-15 and evaluation.objective_error.max < 1e-15
    assert evaluation.tracking_error.max < 1e-15
    np.testing.assert_allclose(evaluation.contour_error.s, 0.1 * T / 2, atol=1e-12)
    # And only there.
    with_error = ALONG + np.outer(np.isclose(T, 1.3), (0, 1e-6))
    evaluation = ac.evaluate(by_hand(arm, T, with_error), LINE)
    error = evaluation.contour_error
    assert error.max == pytest.approx(1e-6, rel=1e-6) and error.rms > 0
    assert (error.t_max, error.s_max) == pytest.approx((1.3, 0.065))
    # Without an objective there are no corners.
    assert (
        evaluation.objective_error is None
        and evaluation.objective_coverage_error is None
        and evaluation.corners == ()
    )
    delayed_x = np.clip(ALONG[:, :1] - 0.01, 0.3, None)
    tool = np.concatenate([delayed_x, ALONG[:, 1:]], axis=1)
    evaluation = ac.evaluate(by_hand(arm, T, tool, planned=ALONG), LINE)
    assert evaluation.contour_error.max < 1e-15
    assert evaluation.tracking_error.max == pytest.approx(0.01, rel=1e-9)
    expected = np.sqrt(trapezoid(np.minimum(0.1 * T / 2, 0.01) ** 2, T) / 2)
    assert evaluation.tracking_error.rms == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("in_space", [False, True])
def test_unexplained_errors_are_bounded_along_and_across_the_path(arm, in_space):
    path = LINE
    if in_space:
        arm = ac.load_arm("ur5e")
        path = ac.Path.polyline([(0.4, -0.1, 0.3), (0.5, 0.1, 0.4)]).pointing([0.0, 0.0, -1.0])
    plan = ac.plan(path, arm, ac.Limits.only(joint_acceleration=2.0, speed=0.1))
    model_error = np.array([1e-4, 3e-4, 2e-4, 1e-4, 5e-4, 1e-4])[: arm.dof]
    servo = ac.ServoModel(kp=25.0, order="first", model_error=model_error)
    execution = ac.simulate(ac.compensate(plan, servo, ac.Inverse()), ac.ServoPlant(arm, servo))
    evaluation = ac.evaluate(execution, path)
    along, across = 0.0, 0.0
    unit = np.diff(path([0.0, path.length]), axis=0)[0] / path.length
    for signs in product((-1, 1), repeat=arm.dof):
        moved = arm.tool_position(execution.q + signs * model_error) - execution.tool
        ahead = moved @ unit
        along = max(along, np.abs(ahead).max())
        across = max(across, np.linalg.norm(moved - ahead[:, None] * unit, axis=1).max())
    # To first order, a joint at its worst can be reached along the path, and in the plane.
    assert evaluation.model_error == pytest.approx((along, across), rel=0.5 if in_space else 2e-3)
    assert evaluation.model_error[0] == pytest.approx(along, rel=2e-3)
    assert evaluation.model_error[1] > across * (1 - 2e-3)
    assert f"{evaluation.model_error[1] * 1e3:.3g} mm" in str(evaluation)
    plain = ac.simulate(execution.set_points, ac.ServoPlant(arm, servo.replace(model_error=None)))
    assert ac.evaluate(plain, path).model_error is None


def test_errors_count_until_the_tool_stays_slow(arm):
    # It runs at 50 mm/s, creeps at 0.5 mm/s, runs again until 1.2 s, and creeps.
    speed = np.where((T < 0.4) | ((T > 0.8) & (T <= 1.2)), 0.05, 5e-4)
    x = 0.3 + np.concatenate([[0], np.cumsum(speed[1:] * np.diff(T))])
    execution = by_hand(arm, T, ALONG)
    law = LapLaw(
        breaks=np.array([0.0, 0.5]), q=execution.q[:2], dq=execution.dq[:1], ddq=execution.dq[:1]
    )
    short = ac.Trajectory(laws=(law,), method="hand")
    set_points = ac.SetPoints(cycle=0.1, q=execution.q[:1], trajectory=short, method="hand")
    creeping = by_hand(arm, T, np.stack([x, np.full_like(x, 0.2)], axis=1))
    evaluation = ac.evaluate(replace(creeping, set_points=set_points), LINE)
    assert evaluation.settled == pytest.approx(1.2, abs=0.011)
    assert evaluation.speed == pytest.approx(0.05, rel=1e-3)
    # Not before the end of the plan, even if the tool is slow or at rest before.
    for tool in (np.tile((0.3, 0.2), (len(T), 1)), creeping.tool):
        evaluation = ac.evaluate(by_hand(arm, T, tool), LINE)
        assert evaluation.duration == evaluation.settled == evaluation.end_time == 2.0
    evaluation = ac.evaluate(replace(execution, set_points=set_points), LINE)
    assert evaluation.duration == 0.5 and evaluation.end_time == evaluation.settled == 2.0


def test_the_maximum_counts_until_rest_and_the_rms_until_the_tool_is_slow(arm):
    # It runs along the line for 1 s, and creeps sideways at 0.5 mm/s for another second.
    tool = np.stack([0.3 + 0.1 * np.minimum(T, 1.0), 0.2 + 5e-4 * np.maximum(T - 1.0, 0.0)], axis=1)
    execution = by_hand(arm, T, tool)
    laws = (
        LapLaw(
            breaks=np.array([0.0, 1.0]),
            q=execution.q[:2],
            dq=execution.dq[:1],
            ddq=execution.dq[:1],
        ),
    )
    plan = replace(execution.set_points, trajectory=ac.Trajectory(laws=laws, method="hand"))
    evaluation = ac.evaluate(replace(execution, set_points=plan), LINE)
    assert evaluation.end_time == evaluation.settled == pytest.approx(1.0, abs=0.011)
    error = evaluation.contour_error
    assert error.max == pytest.approx(5e-4, rel=1e-3) and error.t_max == T[-1]
    assert error.rms < 5e-6
    until_end = ac.evaluate(replace(execution, set_points=plan), LINE, end_time=1.5).contour_error
    assert (until_end.max, until_end.t_max) == (pytest.approx(2.5e-4, rel=0.03), 1.5)
    assert until_end.rms == pytest.approx(2.5e-4 / 3, rel=0.03)


def test_demands_are_compared_with_the_limit_of_their_direction(arm):
    demand = np.zeros((len(T), 2))
    demand[50] = (1.44, -0.36)
    execution = by_hand(arm, T, ALONG, demand)
    limits = ac.Limits.only(joint_acceleration=[0.72, 0.36], speed=0.1)
    evaluation = ac.evaluate(execution, LINE, limits=limits)
    np.testing.assert_allclose(evaluation.demand, (1.44, 0.36))
    np.testing.assert_allclose(evaluation.demand_ratio, (2.0, 1.0))
    assert evaluation.speed_ratio == pytest.approx(0.5, rel=1e-3)
    np.testing.assert_allclose(evaluation.saturated, (0.25, 0.0))  # of 2 s
    free = ac.evaluate(execution, LINE, limits=ac.Limits.only())
    np.testing.assert_array_equal(free.demand_ratio, 0)
    assert np.isnan(free.speed_ratio)
    by_arm = ac.evaluate(execution, LINE)
    np.testing.assert_allclose(by_arm.demand_ratio, (2.0, 0.5))
    demand = np.zeros((len(T), 2))
    demand[100] = (0.9, 0.3)
    demand[120] = (-0.6, -0.6)
    executed = by_hand(arm, T, ALONG, demand=demand)
    both = ac.Limits.only(joint_acceleration=1.0)
    assert ac.evaluate(executed, LINE, limits=both).demand_ratio.tolist() == [0.9, 0.6]
    weak = both.replace(joint_acceleration=[[-0.5, 1.0], [-2.0, 1.0]])
    evaluation = ac.evaluate(executed, LINE, limits=weak)
    np.testing.assert_allclose(evaluation.demand_ratio, [1.2, 0.3])
    np.testing.assert_array_equal(evaluation.demand, [0.9, 0.6])


def test_errors_relative_to_the_objective_path_include_rounding(arm, objective, rounded):
    t = np.linspace(0, 2, 5001)
    tool = rounded(np.linspace(0, rounded.length, 5001))
    evaluation = ac.evaluate(by_hand(arm, t, tool), rounded, objective=objective)
    assert evaluation.contour_error.max < 1e-14
    # The arc's middle is the corner error times the cosine of half the turn off the lines: a
    # ridge, of which the samples miss up to half their spacing of 70 um.
    half = rounded.corners.turn / 2
    deepest = (5e-3 * np.cos(half)).max()
    assert evaluation.objective_error.max == pytest.approx(deepest, abs=3.5e-5)
    # The other direction: the corners themselves are missed by the corner error.
    assert evaluation.objective_coverage_error.max == pytest.approx(5e-3, abs=1e-6)
    assert evaluation.coverage_error.max < 1e-6


def test_invalid_options_of_evaluate_are_refused(arm, refuses):
    execution = by_hand(arm, T, ALONG)
    three = ac.Limits.only(joint_acceleration=[1, 2, 3])
    for path, options, words in (
        (LINE, {"end_time": 0.0}, "above zero"),
        (LINE, {"end_time": np.nan}, "finite"),
        (LINE, {"limits": three}, "joint_acceleration has 3 values"),
        (ac.Path.polyline([(0, 0, 0), (1, 0, 0)]), {}, "must have 3"),
    ):
        refuses(partial(ac.evaluate, execution, path, **options), ac.InvalidInput, words)


def test_a_rotated_tool_has_that_orientation_error():
    arm = ac.load_arm("ur5e")
    down = np.diag([1.0, -1.0, -1.0])
    bare = ac.Path.polyline([(0.45, -0.05, 0.25), (0.45, 0.05, 0.25)])
    line = bare.oriented(down)
    planned = ac.plan(line, arm, arm.limits.replace(speed=0.1))
    q = planned(np.arange(0.0, planned.duration, 4e-3)) + np.array([0, 0, 0, 0, 0, 0.01])
    turned = ac.SetPoints(cycle=4e-3, q=q, trajectory=planned, method="none")
    executed = ac.simulate(turned, ac.ServoPlant(arm, ac.ServoModel(kp=25.0, kv=150.0)))
    assert ac.evaluate(executed, line).orientation_error.rms == pytest.approx(0.01, rel=1e-3)
    # The tool is rotated about its own axis. This is no error if only the axis is specified.
    free = bare.oriented(down, axis_only=True)
    assert ac.evaluate(executed, free).orientation_error.max < 2e-3
