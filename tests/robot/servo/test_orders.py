"""Joints of different orders, dry friction, drive cycles and logs."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import armcontour as ac
from armcontour.motion import SetPoints
from armcontour.robot.servo.simulation import JointServo, LoggedCommand, follow

CYCLE = 4e-3  # s, between set-points
SLIDING = 5e-3  # rad/s, at which friction is 1/√2 of what it is at high speeds
ARM = ac.PlanarTwoLink(name="rods", links=(0.25, 0.25), base=0.0, limits=ac.Limits())
T = np.arange(60) * CYCLE
Q = np.stack([0.3 + 0.05 * np.sin(20 * T) * T / T[-1], 0.2 - 0.3 * T**2], axis=1)


@pytest.fixture(scope="module")
def execute():
    path = ac.Path.polyline([(0.30, 0.20), (0.36, 0.20)])
    limits = ac.Limits(joint_acceleration=[20.0, 20.0], speed=0.2)
    plan = ac.plan(path, ARM, limits, ac.Optimal(intervals=20))
    set_points = SetPoints(cycle=CYCLE, q=Q, trajectory=plan, method="none")
    return lambda servo: ac.simulate(set_points, ac.ServoPlant(ARM, servo), resolution=CYCLE)


def slope(q, k):
    """Slope of the line from set-point k to the next one."""
    return (q[k + 1] - q[k]) / CYCLE if 0 <= k < len(q) - 1 else 0.0


def test_each_joint_has_its_own_order(execute):
    dead_times = (5.3e-3, 6.1e-3)
    servo = ac.ServoModel(
        order=("first", "delay"),
        kp=(20.0, np.inf),
        dead_time=dead_times,
        velocity_feedforward=(0.9, 0.0),
        acceleration_feedforward=(4e-3, 0.0),
        friction=(2e-4, 0.0),
    )
    execution = execute(servo)
    n = len(Q)
    delayed = np.interp(execution.t[:n] - dead_times[1], T, Q[:, 1])
    np.testing.assert_allclose(execution.q[:n, 1], delayed, atol=1e-12)
    state = Q[0, 0]
    positions = [Q[0, 0]]
    edges = np.union1d(T, np.arange(-2, n) * CYCLE + dead_times[0])
    for begin, end in zip(edges[2:-1], edges[3:], strict=True):
        k = int(np.floor(((begin + end) / 2 - dead_times[0]) / CYCLE))
        rate = slope(Q[:, 0], k)
        bend = (rate - slope(Q[:, 0], k - 1)) / CYCLE if k >= 0 else 0.0
        rub = 2e-4 * rate / np.hypot(rate, SLIDING)

        def law(t, q, k=k, rate=rate, bend=bend, rub=rub):
            u = Q[max(k, 0), 0] + (rate * (t - dead_times[0] - k * CYCLE) if k >= 0 else 0.0)
            return 20.0 * (u - rub - q) + 0.9 * rate + 4e-3 * bend

        state = solve_ivp(law, (begin, end), [state], rtol=1e-10, atol=1e-13).y[0, -1]
        if abs(end / CYCLE - round(end / CYCLE)) < 1e-6:
            positions.append(state)
    np.testing.assert_allclose(execution.q[: len(positions), 0], positions, atol=1e-10)
    assert len(positions) > 50


def test_joints_without_a_model_follow_their_command(execute):
    servo = ac.ServoModel(order=("second", "unknown"), kp=(20.0, np.inf), kv=(90.0, np.inf))
    execution = execute(servo)
    np.testing.assert_allclose(execution.q[: len(Q), 1], Q[:, 1], atol=1e-12)


def test_the_servo_model_follows_an_irregular_log_like_the_plant(execute):
    servo = ac.ServoModel(kp=20.0, kv=90.0, dead_time=5.3e-3, velocity_feedforward=0.9)
    execution = execute(servo)
    more = np.sort(np.concatenate([T, T[:-1] + np.random.default_rng(0).uniform(0, CYCLE, 59)]))
    every = JointServo(
        kp=np.array([20.0, 5.0]), kv=90.0, velocity_feedforward=0.9, dead_time=5.3e-3
    )
    for j in range(2):
        command = LoggedCommand(more, np.interp(more, T, Q[:, j]))
        response = follow(command, every, Q[0, j], 0.0)[0]
        np.testing.assert_allclose(response[np.isin(more, T)], execution.q[: len(T), j], atol=1e-12)


@pytest.mark.parametrize("feed", [0.0, 0.9])
@pytest.mark.parametrize("kind", [{"kv": 150.0}, {"order": "first"}])
def test_set_points_compensate_dry_friction(kind, feed):
    path = ac.round_corners(ac.Path.polyline([(0.30, 0.20), (0.36, 0.20)]), tolerance=2e-3)
    plan = ac.plan(
        path, ARM, ac.Limits(joint_acceleration=[5.0, 5.0], speed=0.1), ac.Optimal(intervals=200)
    )
    errors = []
    for friction in (0.0, 1e-4):
        servo = ac.ServoModel(kp=20.0, velocity_feedforward=feed, friction=friction, **kind)
        set_points = ac.compensate(plan, servo, ac.Inverse(), cycle=CYCLE)
        execution = ac.simulate(set_points, ac.ServoPlant(ARM, servo))
        inside = (execution.t > 0.1) & (execution.t < plan.duration - 0.1)
        errors.append(
            np.abs((execution.q - plan(np.clip(execution.t, 0, plan.duration)))[inside]).mean()
        )
    assert errors[1] < errors[0] + 0.1 * 1e-4


def test_a_drive_cycle_does_not_change_joints_of_order_delay(execute):
    dead_time = 5e-3
    servo = ac.ServoModel(
        order=("delay", "first"), kp=(np.inf, 20.0), dead_time=(dead_time, 0.0), drive_cycle=1e-3
    )
    execution = execute(servo)
    n = len(Q)
    np.testing.assert_allclose(execution.q[:n, 0], np.interp(T - dead_time, T, Q[:, 0]), atol=1e-12)
    q = Q[0, 1]
    positions = []
    for m in range(4 * (n - 1)):
        positions.append(q)
        q += 1e-3 * 20.0 * (np.interp(m * 1e-3, T, Q[:, 1]) - q)
    np.testing.assert_allclose(execution.q[: n - 1, 1], positions[::4], atol=1e-12)


def test_acceleration_jumps_do_not_saturate_a_drive_with_a_cycle(rounded, arm, limits):
    plan = ac.plan(rounded, arm, limits, ac.Optimal(reserve=0.02))
    servo = ac.ServoModel(kp=25.0, kv=150.0, drive_cycle=1e-3)
    exact = ac.Inverse(command_limits=ac.Limits(joint_acceleration=np.inf))
    set_points = ac.compensate(plan, servo, exact, cycle=CYCLE)
    execution = ac.simulate(set_points, ac.ServoPlant(arm, servo))
    assert np.all(np.abs(execution.demand) < limits.joint_acceleration)
    assert ac.evaluate(execution, rounded).contour_error.rms < 2e-8
