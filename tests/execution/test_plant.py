"""What holds of every plant of the package: once made, it does not change."""

import inspect
from dataclasses import FrozenInstanceError

import pytest

import armcontour as ac

SERVO = ac.ServoModel(kp=25.0, kv=150.0)


class Counting(ac.Plant):
    """A plant of a user's own may keep what it likes."""

    def __init__(self, inner):
        self.inner, self.runs = inner, 0

    def run(self, taught, resolution):
        self.runs += 1
        return self.inner.run(taught, resolution)


class Noted(ac.ServoPlant):
    """A plant of the package with more to it."""

    def __init__(self, arm, servo, note):
        super().__init__(arm, servo)
        self.note = note


def test_nothing_of_a_plant_can_be_set(arm):
    for plant, arrays in (
        (ac.ServoPlant(arm, SERVO), ("lower", "acceleration")),
        (ac.ServoPlant(arm, SERVO, saturation="none"), ("acceleration",)),
        (ac.RigidBodyPlant(arm, SERVO), ("reference", "nominal_inertia", "torque_limit")),
    ):
        for name in (*arrays, "arm", "servo"):
            with pytest.raises(FrozenInstanceError, match=f"^The {name} of a .*: make another one"):
                setattr(plant, name, None)
        for name in arrays:
            with pytest.raises(ValueError, match="read-only"):
                getattr(plant, name)[0] = 1.0
    names = list(inspect.signature(ac.ServoPlant).parameters)
    assert names == ["arm", "servo", "limits", "saturation"]


def test_users_make_plants_of_their_own(arm):
    path = ac.Path.polyline([(0.35, 0.10), (0.36, 0.10)])
    plan = ac.plan(path, arm, arm.limits.replace(speed=0.1))
    taught = ac.compensate(plan, SERVO, method="none", period=4e-3)
    plant = Counting(Noted(arm, SERVO, "mine"))
    assert ac.execute(taught, plant).t.size and plant.runs == 1
    assert plant.inner.note == "mine"
    with pytest.raises(FrozenInstanceError):
        plant.inner.note = "yours"
