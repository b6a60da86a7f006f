"""A robot with a load, friction, gains and noise that the controller of the corner job ignores."""

from armcontour.jobs import Experiment, build_plant
from armcontour.robot import Payload
from armcontour.simulation import RigidBodyPlant


def loaded_robot(job, plan, seed=0) -> RigidBodyPlant:
    """The rigid bodies of a run of the corner job, with the noise of a seed."""
    experiment = Experiment(
        payload=Payload(mass=0.12),
        coulomb=[0.0025, 0.0007],
        viscous=[0.0064, 0.0017],
        noise=1e-5,
        seed=seed,
    )
    servo = job.servo.for_joints(2).replace(kp=[25.34, 24.42])
    return build_plant(experiment, job.arm, servo, plan.run.limits)
