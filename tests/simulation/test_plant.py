"""All plants of the package are immutable."""

from dataclasses import FrozenInstanceError

import pytest

import armcontour as ac
from armcontour.simulation import Plant

SERVO = ac.ServoModel(kp=25.0, kv=150.0)


class Counting(Plant):
    """A plant of a user's own may keep what it likes."""

    def __init__(self, inner):
        self.inner = inner
        self.runs = 0

    def run(self, set_points, resolution):
        self.runs += 1
        return self.inner.run(set_points, resolution)


def test_users_can_simulate_plants_of_their_own(arm):
    path = ac.Path.polyline([(0.35, 0.10), (0.36, 0.10)])
    plan = ac.plan(path, arm, arm.limits.replace(speed=0.1))
    set_points = ac.compensate(plan, SERVO, ac.NoCompensation(), cycle=4e-3)
    plant = Counting(ac.ServoPlant(arm, SERVO))
    assert ac.simulate(set_points, plant).t.size and plant.runs == 1
    with pytest.raises(FrozenInstanceError):
        plant.inner.servo = SERVO
