"""The P-PI cascade: simulation, compensation, saturation."""

import dataclasses
import math

import numpy as np
import pytest

import armcontour as ac
from armcontour.core.errors import InvalidInput
from armcontour.motion import SetPoints

CYCLE = 8e-3  # s, between set-points
SLIDING = 5e-3  # rad/s, at which friction is 1/√2 of what it is at high speeds
ARM = ac.PlanarTwoLink(name="rods", links=(0.25, 0.25), base=0.0, limits=ac.Limits())
T = np.arange(40) * CYCLE
Q = np.stack([0.3 + 0.05 * np.sin(20 * T) * T / T[-1], 0.2 - 0.3 * T**2], axis=1)


@pytest.fixture(scope="module")
def plan():
    corner = ac.Path.polyline([(0.3, 0.2), (0.36, 0.2), (0.36, 0.26)])
    path = ac.round_corners(corner, tolerance=2e-3, continuity="curvature")
    limits = ac.Limits(joint_acceleration=[5.0, 5.0], joint_jerk=[60.0, 60.0], speed=0.1)
    plan = ac.plan(path, ARM, limits, ac.Optimal(intervals=300))
    # Its set-points have no limits.
    return dataclasses.replace(plan, limits=None)


@pytest.mark.parametrize("limit", [math.inf, 1.5])
def test_a_drive_with_a_cycle_follows_its_difference_equation(plan, limit):
    """As a controller computes it: once per cycle, with sums in place of integrals."""
    drive_cycle = 3e-3
    dead_time = 5e-3
    servo = ac.ServoModel(
        kp=12.0, kv=80.0, ki=6.0, dead_time=dead_time, velocity_feedforward=0.4, friction=3e-4,
        acceleration_feedforward=0.3, drive_cycle=drive_cycle, acceleration_limit=limit,
    )  # fmt: skip
    set_points = SetPoints(cycle=CYCLE, q=Q, trajectory=plan, method="none")
    # Results that fall in the middle of cycles.
    execution = ac.simulate(set_points, ac.ServoPlant(ARM, servo), resolution=CYCLE / 2)
    for j in range(2):
        times = (np.arange(-2, 100)) * drive_cycle
        u = np.interp(times - dead_time, T, Q[:, j])
        du = np.diff(u)[1:] / drive_cycle
        ddu = np.diff(u, 2) / drive_cycle**2
        q = Q[0, j]
        w = 0.0
        x = 0.0
        positions = []
        for k in range(100):
            error = 12.0 * (u[k + 2] - q) + 0.4 * du[k] - w
            x += drive_cycle * error
            rub = 12.0 * 80.0 * 3e-4 * du[k] / np.hypot(du[k], SLIDING)
            z = 80.0 * (error + 6.0 * x) + 0.3 * ddu[k] - rub
            a = np.clip(z, -limit, limit)
            x -= drive_cycle * (z - a) / 80.0
            for t in np.arange(len(execution.t)) * CYCLE / 2 - k * drive_cycle:
                if -1e-9 < t < drive_cycle - 1e-9:
                    positions.append(q + w * t + a * t * t / 2)
            q = q + w * drive_cycle + a * drive_cycle**2 / 2
            w = w + a * drive_cycle
        n = min(len(positions), 2 * len(Q))
        np.testing.assert_allclose(execution.q[:n, j], positions[:n], atol=1e-12)
        assert (execution.saturated_time[j] > 0.02) == np.isfinite(limit)


@pytest.mark.parametrize("drive_cycle", [0.0, 4e-3])
def test_the_integrator_does_not_wind_up(plan, drive_cycle):
    """A step of 1 rad overshoots as without an integrator; an integral that goes on adds 2 rad."""
    q = np.vstack([np.zeros((1, 2)), np.ones((200, 2))])
    set_points = SetPoints(cycle=CYCLE, q=q, trajectory=plan, method="none")
    for limit, overshoot in ((2.0, 0.225), (8.0, 0.0)):
        for ki in (0.0, 10.0):
            servo = ac.ServoModel(
                kp=4.0, kv=80.0, ki=ki, drive_cycle=drive_cycle, acceleration_limit=limit
            )
            execution = ac.simulate(set_points, ac.ServoPlant(ARM, servo), resolution=CYCLE)
            assert (execution.saturated_time > 0.2).all()
            assert execution.q.max() - 1 == pytest.approx(overshoot, abs=0.01)


@pytest.mark.parametrize("interpolation", ["linear", "step", "cubic"])
@pytest.mark.parametrize("feed", [(0.0, 0.0), (0.9, 0.0), (0.9, 0.4)])
def test_set_points_compensate_the_cascade(plan, interpolation, feed):
    if feed[1] and interpolation != "linear":
        return
    errors = []
    for ki, cycle in ((0.0, 4e-3), (8.0, 4e-3), (8.0, 1e-3)):
        servo = ac.ServoModel(
            kp=(12.0, 9.0), kv=80.0, ki=(ki, ki / 2), interpolation=interpolation,
            velocity_feedforward=feed[0], acceleration_feedforward=feed[1], dead_time=6e-3,
        )  # fmt: skip
        set_points = ac.compensate(plan, servo, ac.Inverse(), cycle=cycle)
        execution = ac.simulate(set_points, ac.ServoPlant(ARM, servo), resolution=1e-3)
        inside = (execution.t > 0) & (execution.t < plan.duration)
        errors.append(np.abs(execution.q[inside] - plan(execution.t[inside])).max())
        if set_points.truncated is not None:
            after = execution.t > plan.duration
            error = np.abs(execution.q[after] - set_points.q[-1]).max(axis=0)
            assert (error < set_points.truncated).all() and (error > set_points.truncated / 3).any()
    assert errors[1] < 1.2 * errors[0] + 1e-9
    assert errors[2] < errors[1] / 3


@pytest.mark.parametrize("drive_cycle", [1e-3, 8e-3])
@pytest.mark.parametrize("feed", [0.0, 0.9])
def test_set_points_compensate_drives_with_a_cycle(plan, drive_cycle, feed):
    errors = []
    for ki in (0.0, 8.0):
        options = {"velocity_feedforward": feed, "dead_time": 6e-3, "drive_cycle": drive_cycle}
        servo = ac.ServoModel(kp=12.0, kv=80.0, ki=ki, **options)
        set_points = ac.compensate(plan, servo, ac.Inverse(), cycle=1e-3)
        execution = ac.simulate(set_points, ac.ServoPlant(ARM, servo), resolution=1e-3)
        inside = (execution.t > 0) & (execution.t < plan.duration)
        errors.append(np.abs(execution.q[inside] - plan(execution.t[inside])).max())
    # Accelerations that are held for 8 ms are 20 µrad off between the cycles.
    largest = (1e-4 if feed else 3e-5) * drive_cycle / 8e-3 + 1e-5 * (feed > 0)
    assert errors[1] < 1.2 * errors[0] < largest


def test_the_frequency_response_equals_a_simulated_sine():
    servo = ac.ServoModel(
        kp=12.0, kv=80.0, ki=6.0, velocity_feedforward=0.7, acceleration_feedforward=0.3,
        dead_time=5e-3, interpolation="linear",
    )  # fmt: skip
    w = 15.0
    t = np.arange(2000) * 1e-3
    ramp = np.clip(t / 0.5, 0, 1) ** 2
    q = 0.01 * (np.sin(w * t) * ramp)[:, None] * [1.0, 0.5]
    rest = ac.Trajectory(laws=(ac.dwell_law(q[0], t[-1]),), method="rest")
    set_points = ac.SetPoints(cycle=1e-3, q=q, trajectory=rest, method="none")
    execution = ac.simulate(set_points, ac.ServoPlant(ARM, servo, ac.Limits()), resolution=1e-3)
    settled = t > 1.9
    gain = servo.response([1j * w])[0, 0] * np.exp(1j * w * t[settled])
    # Acceleration feed-forward of lines is half an interval late, 1e-4 of the amplitude.
    np.testing.assert_allclose(execution.q[: len(t)][settled, 0], 0.01 * gain.imag, atol=2e-5)
    # The cascade settles as its slowest pole.
    poles = np.roots([1.0, 80.0, 80.0 * 18.0, 80.0 * 12.0 * 6.0])
    assert servo.slowest == pytest.approx(-poles.real.max(), rel=1e-9)


def test_integrators_of_other_orders_are_refused(plan, refuses):
    for parameters, words in (
        ({"kp": 5.0, "order": "first", "ki": 1.0}, "integral gain of the velocity loop"),
        ({"kp": 5.0, "kv": 50.0, "ki": -1.0}, "ki of a servo model must not be negative"),
        (
            {
                "kp": 5.0, "kv": 50.0, "ki": 1.0, "interpolation": "cubic",
                "velocity_feedforward": 1.0, "acceleration_feedforward": 0.1,
            },
            "only for linear set-points",
        ),
    ):  # fmt: skip
        refuses(lambda parameters=parameters: ac.ServoModel(**parameters), InvalidInput, words)
    servo = ac.ServoModel(kp=5.0, kv=50.0, ki=1.0)
    words = "and without integrator"
    poles = lambda: ac.compensate(plan, servo, ac.PolePlacement())  # noqa: E731
    refuses(poles, InvalidInput, words)
    assert "ki 1 1/s" in str(servo)
