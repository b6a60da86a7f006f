"""A short motion of an arm in the plane with masses, friction and drives."""

import numpy as np
import pytest

import armcontour as ac

LIMITS = ac.Limits.only(joint_acceleration=[2.0, 2.0], joint_torque=[40.0, 40.0], speed=0.15)


@pytest.fixture(scope="package")
def planar():
    """Arm, servo, path, set-points."""
    arm = ac.load_arm("pmk3s").with_dynamics(
        armature=0.05, payload=ac.Payload(mass=0.5, center=np.array([0.215, 0.0, 0.0]))
    )
    servo = ac.ServoModel(kp=25.0, kv=150.0, dead_time=2e-3)
    path = ac.Path.polyline([(0.30, 0.20), (0.34, 0.20), (0.34, 0.23)])
    rounded = ac.round_corners(path, tolerance=1e-3)
    plan = ac.plan(rounded, arm, LIMITS, ac.Optimal(intervals=400, configuration="positive"))
    set_points = ac.compensate(plan, servo, ac.InverseDynamics(), arm=arm, cycle=8e-3)
    return arm, servo, rounded, set_points
