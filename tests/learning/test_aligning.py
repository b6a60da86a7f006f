"""Dead time is found where there is some, and not in noise or friction."""

from __future__ import annotations

import numpy as np
import pytest

import armcontour as ac
from armcontour.motion import smooth

pytest.importorskip("mujoco")
SERVO = ac.ServoModel(kp=25.0, kv=150.0)


@pytest.fixture(scope="module")
def arm():
    return ac.load_arm("pmk3s")


@pytest.fixture(scope="module")
def taught(arm):
    path = ac.Path.polyline([(0.30, 0.20), (0.34, 0.20)])
    plan = smooth(ac.plan(path, arm, ac.Limits(speed=0.15, joint_acceleration=[0.72, 0.72])), 0.02)
    return ac.compensate(plan, SERVO, method="inverse_dynamics", arm=arm)


@pytest.fixture(scope="module")
def true(arm):
    """The arm with a load, and with friction."""
    return arm.with_dynamics(
        payload=ac.Payload(mass=0.12), viscous=[6.4e-3, 1.7e-3], coulomb=[2.5e-3, 6.9e-4]
    )


def found(arm, taught, true, dead_time, noise, seed=0):
    """The dead time that learning finds [s]."""
    servo = SERVO.replace(kp=[25.35, 24.43], dead_time=dead_time)
    robot = ac.RigidBodyPlant(true, servo, known=arm, noise=noise, seed=seed)
    done = ac.execute(taught, robot, resolution=1e-3)
    return ac.learn(taught, done, arm=arm, servo=SERVO).delay


@pytest.mark.parametrize("noise", [0.0, 1e-5, 1e-4])
def test_friction_and_noise_are_no_dead_time(arm, taught, true, noise):
    for seed in range(3 if noise else 1):
        assert abs(found(arm, taught, true, 0.0, noise, seed)) < 0.3e-3


@pytest.mark.parametrize(("dead_time", "noise"), [(5e-3, 0.0), (5e-3, 1e-5), (10e-3, 1e-5)])
def test_dead_time_is_found_beside_friction_and_noise(arm, taught, true, dead_time, noise):
    assert found(arm, taught, true, dead_time, noise) == pytest.approx(dead_time, abs=1.5e-3)


def test_dead_time_that_noise_hides_is_taken_for_none(arm, taught, true):
    assert found(arm, taught, true, 2e-3, 1e-4) == 0.0


def test_dead_time_of_an_arm_like_its_model_is_found_well(arm, taught):
    robot = ac.RigidBodyPlant(arm, SERVO.replace(dead_time=5e-3), known=arm, noise=1e-5)
    lesson = ac.learn(taught, ac.execute(taught, robot), arm=arm, servo=SERVO)
    assert np.abs(lesson.delay - 5e-3) < 0.3e-3
