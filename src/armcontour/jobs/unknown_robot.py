"""A robot that is not quite the job's, for simulations of learning."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from armcontour._checks import FloatArray
from armcontour.arms.chain import Payload
from armcontour.errors import InvalidInput
from armcontour.execution import RigidBodyPlant
from armcontour.jobs.experiment import Experiment, build_plant
from armcontour.jobs.job import Job
from armcontour.jobs.learning import Robot
from armcontour.jobs.results import RunResult

# Mass that the arm carries and nobody knows of, as a share of the mass that its joints move. On a
# UR5e it is 2 kg of the 5 kg that it may carry.
HEAVIER = 0.1
# Its weight takes no more than this share of a drive's torque.
LOAD = 0.05
# Dry friction as a share of the torque limit, and viscous friction at the velocity limit as a share
# of it. On a UR5e they are 6 N m and 5 N m s/rad at its large joints.
COULOMB, VISCOUS = 0.04, 0.1
# A joint that is so far off [rad] gets the torque that stands for its torque limit where that is
# larger: drives of little inertia are not strong, and have little friction.
FAR_OFF = 0.1
# Largest relative error of the position loop gains, which are drawn evenly.
GAINS = 0.05
# Noise of measured positions [rad]: an encoder of 17 bits.
NOISE = 1e-5


def unknown_robot(job: Job, plan: RunResult, seed: int | None = None) -> tuple[Robot, str]:
    """The robot of a simulation of learning, and what nobody knows of it.

    It is that of the run's experiment, if this or the job's plant differs from the nominal robot.
    Else the robot carries a tenth of its own mass more (less, if its weight took more than 5 % of a
    torque limit), has dry friction of 4 % of the torque limits, viscous friction of 10 % of them at
    the velocity limits, position loop gains that are off by up to 5 %, and encoders with a noise of
    10 µrad.

    Args:
        job: The job.
        plan: The plan of the run.
        seed: Seed of the noise, and of the drawn gains; that of the experiment, or 0, by default.

    Raises:
        InvalidInput: The arm has no masses, or the servo is of first order.
    """
    if not job.arm.has_bodies:
        raise InvalidInput(
            f"The arm {job.arm.name} has no masses, which simulated rigid bodies need: give its "
            "links masses and inertias, or learn from the log of a robot."
        )
    experiment = plan.run.experiment or Experiment()
    first = experiment.seed if seed is None else seed
    servo = job.plant_servo.for_joints(job.arm.dof)
    about = "; ".join(x for x in (experiment.unknown, _other_servo(job)) if x)
    if not about:
        experiment = _assumed(job, plan, experiment)
        off = np.random.default_rng(first).uniform(-GAINS, GAINS, job.arm.dof)
        servo = servo.replace(kp=servo.kp * (1 + off))
        changes = ", ".join(f"{100 * x:+.1f}" for x in off)
        about = f"{experiment.unknown}; gains K_p that differ by {changes} %"

    def robot(k: int) -> RigidBodyPlant:
        # Noise is another one in every run.
        return build_plant(replace(experiment, seed=first + k), job.arm, servo, plan.run.limits)

    return robot, about


def _other_servo(job: Job) -> str:
    """In which values the plant's servo differs from the nominal one, in words."""
    dof = job.arm.dof
    known, own = job.servo.for_joints(dof), job.plant_servo.for_joints(dof)
    names = ("kp", "kv", "dead_time", "inertia")
    found = [x for x in names if not np.array_equal(getattr(known, x), getattr(own, x))]
    return f"{' and '.join(found)} of the job's plant" if found else ""


def _assumed(job: Job, plan: RunResult, experiment: Experiment) -> Experiment:
    """An experiment with a load, friction and noise that nobody knows of."""
    chain = job.arm.chain
    assert chain is not None and chain.masses is not None
    assert chain.coulomb is not None and chain.viscous is not None
    nominal = build_plant(experiment, job.arm, job.servo, plan.run.limits)
    stiffness = nominal.nominal_inertia * nominal.kv * nominal.servo.kp
    torque = np.minimum(nominal.torque_limit, FAR_OFF * stiffness)
    given = (x for x in (plan.run.limits, job.arm.limits) if x.joint_velocity is not None)
    bounds = next((x.velocity_bounds(job.arm.dof) for x in given), (-1.0, 1.0))
    fastest = np.maximum(*np.abs(bounds))
    own = chain.payload or Payload(mass=0.0)
    return replace(
        experiment,
        payload=replace(own, mass=float(_short(own.mass + _load(job, plan, torque)))),
        coulomb=_short(chain.coulomb + COULOMB * torque),
        viscous=_short(chain.viscous + VISCOUS * torque / fastest),
        noise=max(experiment.noise, NOISE),
        friction=True,
    )


def _load(job: Job, plan: RunResult, torque: FloatArray) -> float:
    """Mass that the robot carries beside its payload [kg]."""
    arm, chain = job.arm, job.arm.chain
    assert chain is not None and chain.masses is not None
    own = chain.payload or Payload(mass=0.0)
    heavier = arm.with_dynamics(payload=replace(own, mass=own.mass + 1.0))
    q = plan.taught.q
    weight = np.abs(heavier.dynamics.gravity(q) - arm.dynamics.gravity(q)).max(axis=0)
    most = float((LOAD * torque / np.maximum(weight, 1e-9)).min())
    return min(HEAVIER * float(chain.masses.sum()), most)


def _short(values: npt.ArrayLike) -> FloatArray:
    """Numbers with two digits: what is assumed has no more."""
    return np.asarray(np.vectorize(lambda x: float(f"{x:.2g}"))(values))
