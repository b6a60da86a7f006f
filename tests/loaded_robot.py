"""A robot with a load, friction, gains and noise that its controller does not model."""

from armcontour.robot import Payload
from armcontour.simulation import RigidBodyPlant


def loaded_robot(job, plan, seed=0) -> RigidBodyPlant:
    """The rigid bodies of a run of the corner job, with the noise of a seed."""
    robot = job.arm.with_dynamics(
        payload=Payload(mass=0.12), coulomb=[0.0025, 0.0007], viscous=[0.0064, 0.0017]
    )
    servo = job.servo.for_joints(2).replace(kp=[25.34, 24.42])
    return RigidBodyPlant(robot, servo, plan.run.limits, noise=1e-5, seed=seed, controller=job.arm)
