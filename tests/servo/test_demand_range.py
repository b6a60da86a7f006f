"""The range of the demand is found over all time, also in saturation under held set-points."""

from __future__ import annotations

import numpy as np
import pytest

import armcontour as ac
from armcontour.servo.simulation import Simulation

PERIOD, BOUND = 1e-3, 3.0


def integrate(q, servo, every):
    """Lowest and highest demand of a joint under held set-points, integrated in small steps."""
    kp, kv, late = float(servo.kp), float(servo.kv), float(servo.dead_time)
    x, v, seen = q[0], 0.0, [0.0, 0.0]
    for i in range(round(60 * PERIOD / every)):
        k = int((i * every - late) / PERIOD + 1e-6) if i * every >= late - 1e-12 else 0
        u = q[min(k, len(q) - 1)]
        demand = kv * (kp * (u - x) - v)
        seen = [min(seen[0], demand), max(seen[1], demand)]
        a = min(max(demand, -BOUND), BOUND)
        x += every * (v + every * a / 2)
        v += every * a
    return np.array(seen)


@pytest.mark.parametrize("dead_time", [0.0, 0.97e-3])
@pytest.mark.parametrize("steps", [1, 3])
def test_held_set_points_while_the_joint_saturates(dead_time, steps):
    random = np.random.default_rng(5)
    q = np.cumsum(np.append(np.zeros(5), random.normal(0, 2e-3, 35)))
    servo = ac.ServoModel(kp=25.0, kv=150.0, dead_time=dead_time, interpolation="step")
    bound = np.array([BOUND])
    own = Simulation(q[:, None], PERIOD, servo.for_joints(1), -bound, bound, steps=steps)
    found = own.run(0, 60, q[:1], np.zeros(1))
    assert found.saturated[0] > 5 * PERIOD
    true = integrate(q, servo, 1e-5)
    np.testing.assert_allclose([found.lowest[0], found.highest[0]], true, rtol=2e-3)
