"""Simulated robots that differ from their models in load, friction and gains."""

import numpy as np

import armcontour as ac

SERVO = ac.ServoModel(kp=25.0, kv=150.0)
GAINS = (23.0, 26.5)
POINTS = [(0.35, 0.10), (0.38, 0.13), (0.35, 0.16)]


def with_inertias():
    arm = ac.load_arm("pmk3s")
    return arm._copy(chain=arm.chain.replace(armature=np.array([0.02, 0.005])))


def rounded(points=POINTS, tolerance=2e-3):
    path = ac.Path.polyline(points)
    return ac.round_corners(path, tolerance=tolerance, continuity="curvature")


def gentle_plan(path, arm, limits, rise=0.005):
    """The fastest plan whose accelerations take a time to rise to their limits [s]."""
    jerk = np.min(limits.joint_acceleration) / rise
    return ac.plan(path, arm, limits.replace(joint_jerk=jerk))


def loaded(arm, *, seed=0, dead_time=0.0, noise=0.0):
    chain = arm.chain.replace(
        payload=ac.Payload(mass=0.05), coulomb=np.array([0.3, 0.05]), viscous=np.array([0.4, 0.05])
    )
    return ac.RigidBodyPlant(
        arm._copy(chain=chain),
        SERVO.replace(kp=GAINS, dead_time=dead_time),
        ac.Limits.only(joint_torque=1e3).for_joints(2),
        noise=noise,
        seed=seed,
        controller=arm,
    )


def rods():
    """A planar arm without masses."""
    limits = ac.Limits.only(joint_velocity=[3.0, 3.0], joint_acceleration=[5.0, 5.0])
    return ac.PlanarTwoLink(name="rods", links=(0.25, 0.25), base=0.0, limits=limits)
