"""Dead time is found where there is some, and not in noise or friction."""

import pytest

import armcontour as ac
from armcontour.motion import smooth

from .robots import SERVO

pytest.importorskip("mujoco")


@pytest.fixture(scope="module")
def taught(arm):
    path = ac.Path.polyline([(0.30, 0.20), (0.34, 0.20)])
    plan = smooth(ac.plan(path, arm, ac.Limits(speed=0.15, joint_acceleration=[0.72, 0.72])), 0.02)
    return ac.compensate(plan, SERVO, method="inverse_dynamics", arm=arm)


def found(arm, taught, dead_time, noise, seed=0, servo=SERVO, **dynamics):
    """The dead time that learning finds [s]."""
    true = arm.with_dynamics(**dynamics) if dynamics else arm
    servo = servo.replace(dead_time=dead_time)
    robot = ac.RigidBodyPlant(true, servo, known=arm, noise=noise, seed=seed)
    done = ac.execute(taught, robot, resolution=1e-3)
    return ac.learn(taught, done, arm=arm, servo=SERVO).delay


# With a load and friction; tests/slow has more noise and seeds.
TRUE = {
    "servo": SERVO.replace(kp=[25.35, 24.43]),
    "payload": ac.Payload(mass=0.12),
    "viscous": [6.4e-3, 1.7e-3],
    "coulomb": [2.5e-3, 6.9e-4],
}


@pytest.mark.parametrize(
    ("dead_time", "noise", "seed", "expected", "near"),
    [
        (0.0, 0.0, 0, 0.0, 0.3e-3),
        (0.0, 1e-4, 1, 0.0, 0.3e-3),
        (2e-3, 1e-4, 0, 0.0, 0.0),  # noise hides it: it is taken for none
        (10e-3, 1e-5, 0, 10e-3, 1.5e-3),
    ],
)
def test_dead_time_is_found_beside_friction_and_noise(
    arm, taught, dead_time, noise, seed, expected, near
):
    assert abs(found(arm, taught, dead_time, noise, seed, **TRUE) - expected) <= near


def test_dead_time_of_an_arm_like_its_model_is_found_well(arm, taught):
    assert found(arm, taught, 5e-3, 1e-5) == pytest.approx(5e-3, abs=0.3e-3)
