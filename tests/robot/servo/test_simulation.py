"""Held set-points during saturation."""

import numpy as np

import armcontour as ac
from armcontour.robot.servo.simulation import ServoSimulation

CYCLE = 1e-3  # s, between set-points
BOUND = 3.0  # rad/s², at which the demand saturates


def integrate(q, servo, every):
    """Lowest and highest demand of a joint under held set-points, integrated in small steps."""
    kp = float(servo.kp)
    kv = float(servo.kv)
    dead_time = float(servo.dead_time)
    x = q[0]
    v = 0.0
    demand_range = [0.0, 0.0]
    for i in range(round(60 * CYCLE / every)):
        k = int((i * every - dead_time) / CYCLE + 1e-6) if i * every >= dead_time - 1e-12 else 0
        u = q[min(k, len(q) - 1)]
        demand = kv * (kp * (u - x) - v)
        demand_range = [min(demand_range[0], demand), max(demand_range[1], demand)]
        a = min(max(demand, -BOUND), BOUND)
        x += every * (v + every * a / 2)
        v += every * a
    return np.array(demand_range)


def test_held_set_points_are_simulated_during_saturation():
    random = np.random.default_rng(5)
    q = np.cumsum(np.append(np.zeros(5), random.normal(0, 2e-3, 35)))
    bound = np.array([BOUND])
    for dead_time in (0.0, 0.97e-3):
        servo = ac.ServoModel(kp=25.0, kv=150.0, dead_time=dead_time, interpolation="step")
        true = integrate(q, servo, 1e-5)
        for steps in (1, 3):
            simulation = ServoSimulation(
                q[:, None], CYCLE, servo.for_joints(1), -bound, bound, steps=steps
            )
            end = simulation.run(0, 60, q[:1], np.zeros(1))
            assert end.saturated[0] > 5 * CYCLE
            np.testing.assert_allclose([end.lowest[0], end.highest[0]], true, rtol=2e-3)
