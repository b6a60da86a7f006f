"""Learning on random robots, judged by their true motion.

Every robot differs from its model in payload, friction, loop gains, dead time and noise. Its logs
have one sample per millisecond, encoder noise, and their own clock. The UR5e has the friction and
payload of the reference problem; other robots have them in proportion to torque and mass.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from benchmarks import ur5e
from scipy.interpolate import CubicSpline

import armcontour as ac
from armcontour.robot.nominal_robot import nominal_inertia
from soak import Outcome

ARMS = ("pmk3s", "ur5e", "panda")
ARMATURE = 0.1  # kg m²
ACCELERATION = 6.4  # rad/s², limit of the joints along the square
SLOW = 0.72  # rad/s², limit of the joints in the paper's job
COULOMB = (6, 6, 4, 1.5, 1.5, 1.5)  # N m, friction of the UR5e's joints
VISCOUS = (8, 8, 5, 2, 2, 2)  # N m s/rad, friction of the UR5e's joints
# Largest payload of the UR5e [kg]; other arms have one in proportion to their masses.
PAYLOAD = 5.0
# Mass of the UR5e [kg].
MASS = 20.6
# Smallest and largest noise of the encoders [rad].
NOISES = (1e-6, 1e-4)
# Gains kp differ from the nominal one by at most this share.
GAINS = 0.1
# Largest dead time [s].
DEAD_TIME = 10e-3
# The robot's clock is faster or slower by at most this share.
CLOCK = 0.01
INTERVAL = 1e-3
# Drives that never saturate: saturation is another topic.
STRONG = ac.Limits(joint_torque=1e5)
RUNS = 8
# Final error divided by the error due to noise, which nearly all robots achieve.
OVER_NOISE = 2.0
# The error of the last run may exceed LAST_TO_BEST times that of the best run by so many standard
# deviations of noise.
SURE = 3.0
# Largest ratio of the last run's error to the best run's, beside noise.
LAST_TO_BEST = 1.2
# With another servo the error of the last run may exceed LAST_TO_BEST times that of the best run by
# this instead [m]. Where all errors are above it, learning must not go on.
SMALL = 5e-6
POINTS = ((0.350, 0.100), (0.410, 0.150), (0.280, 0.300), (0.350, 0.350))


@dataclass(frozen=True)
class Task:
    """A job, planned for the nominal arm."""

    arm: ac.Arm
    path: ac.Path
    set_points: ac.SetPoints
    acceleration: float  # rad/s²


SERVO = ac.ServoModel(kp=25.0, kv=150.0)


def task(name):
    """Return the paper's job on its arm, and a square on the other arms."""
    arm = ac.load_arm(name)
    if name == "pmk3s":
        path = ac.round_corners(
            ac.Path.polyline(POINTS), tolerance=5e-3, acceleration=0.09, continuity="curvature"
        )
        limits = arm.limits.replace(
            speed=0.15,
            joint_acceleration=SLOW,
            joint_jerk=SLOW / 4e-3,
            centripetal_acceleration=0.09,
        )
    else:
        arm = arm._copy(chain=arm.chain.replace(armature=np.full(arm.dof, ARMATURE)))
        path = ac.round_corners(ur5e.square(), tolerance=0.25e-3, continuity="curvature")
        limits = ac.Limits(
            joint_velocity=2.0,
            joint_acceleration=ACCELERATION,
            joint_jerk=50 * ACCELERATION,
            speed=0.25,
        )
    plan = ac.plan(path, arm, limits.for_joints(arm.dof))
    set_points = ac.compensate(plan, SERVO, ac.Inverse())
    return Task(arm, path, set_points, SLOW if name == "pmk3s" else ACCELERATION)


cached_task = cache(task)


def draw(task, rng, seed):
    """Draw a robot: a function from the run number to its plant, and its encoder noise."""
    chain = task.arm.chain
    dof = task.arm.dof
    inertia = nominal_inertia(task.arm)
    inertias = nominal_inertia(ur5e_arm())
    torque = inertia * task.acceleration / ACCELERATION
    coulomb = float(np.median(np.array(COULOMB) / inertias)) * torque
    viscous = float(np.median(np.array(VISCOUS) / inertias)) * torque
    if dof == len(COULOMB):
        coulomb = np.array(COULOMB)
        viscous = np.array(VISCOUS)
    factor = rng.uniform(0, 2)
    payload = rng.uniform(0, PAYLOAD) * float(np.sum(chain.masses)) / MASS
    true = task.arm._copy(
        chain=chain.replace(
            payload=ac.Payload(mass=payload), coulomb=factor * coulomb, viscous=factor * viscous
        )
    )
    noise = float(np.exp(rng.uniform(*np.log(NOISES))))
    servo = SERVO.replace(
        kp=25.0 * rng.uniform(1 - GAINS, 1 + GAINS, dof), dead_time=rng.uniform(0, DEAD_TIME)
    )

    def plant(run):
        return ac.RigidBodyPlant(
            true,
            servo,
            STRONG.for_joints(dof),
            noise=noise,
            controller=task.arm,
            seed=1000 * seed + run,
        )

    return plant, noise


def ur5e_arm():
    """Load the UR5e with its drives."""
    arm = ac.load_arm("ur5e")
    return arm._copy(chain=arm.chain.replace(armature=np.full(6, ARMATURE)))


def record(executed, noise, clock, rng):
    """Record the log of an execution, with its own clock."""
    begin = executed.t[0] - rng.uniform(0.02, 0.2)
    end = executed.t[-1]
    t = np.arange(begin, end, INTERVAL)
    q = CubicSpline(executed.t, executed.q)(np.clip(t, executed.t[0], None))
    set_points = executed.set_points
    command = np.stack([np.interp(t, set_points.t, x) for x in set_points.q.T], axis=1)
    return ac.Log(
        t=(t - begin) * clock,
        command=command,
        measured=q + rng.normal(0.0, noise, q.shape),
    )


def repeat(task, plant, noise, clock, rng, runs):
    """Set-points of the last run, its execution, true errors of all runs [m], and lessons."""
    set_points = task.set_points
    errors = []
    lessons = []
    for run in range(runs + 1):
        execution = ac.simulate(set_points, plant(run))
        errors.append(ac.evaluate(execution, task.path).contour_error.rms)
        if run == runs or (lessons and lessons[-1].finished):
            break
        set_points = ac.learn(
            set_points, record(execution, noise, clock, rng), arm=task.arm, servo=SERVO
        )
        lessons.append(set_points)
    return set_points, execution, np.array(errors), lessons


def teach(task, rng, seed, runs):
    """Return the true errors of all runs [m], and what noise alone leaves of the best run [m]."""
    plant, noise = draw(task, rng, seed)
    clock = rng.uniform(1 - CLOCK, 1 + CLOCK)
    set_points, done, errors, _ = repeat(task, plant, noise, clock, rng, runs)
    again = ac.simulate(set_points, plant(runs + 1))
    size = min(len(again.q), len(done.q))
    apart = np.linalg.norm(again.tool[:size] - done.tool[:size], axis=1)
    return errors, float(np.sqrt(np.mean(apart**2) / 2))


def wrong_model(task, seed, runs=RUNS):
    """Return true errors [m] and lessons of a robot whose servo differs much from the model.

    Gains by up to 40 %, feed-forward from 0 to 1 that the model lacks, dead time up to 12 ms; every
    second robot has joints that move independently, the others rigid bodies with friction.
    """
    rng = np.random.default_rng([seed, 7])
    dof = task.arm.dof
    servo = SERVO.replace(
        kp=25.0 * rng.uniform(0.6, 1.4, dof), kv=150.0 * rng.uniform(0.6, 1.4, dof),
        velocity_feedforward=rng.uniform(0, 1), dead_time=rng.uniform(0, 12e-3),
    )  # fmt: skip
    noise = 10 ** rng.uniform(-7, -5)
    torque = rng.uniform(0, 2) * nominal_inertia(task.arm) * task.acceleration
    true = task.arm.with_dynamics(coulomb=0.1 * torque, viscous=0.1 * torque)

    def plant(run):
        if seed % 2:
            return ac.ServoPlant(task.arm, servo, saturation="none")
        return ac.RigidBodyPlant(
            true,
            servo,
            STRONG.for_joints(dof),
            noise=noise,
            controller=task.arm,
            seed=1000 * seed + run,
        )

    _, _, errors, lessons = repeat(task, plant, noise, 1.0, rng, runs)
    return errors, lessons


def run(seed: int) -> Outcome:
    """Teach a random robot, and judge all of its runs."""
    name = ARMS[seed % len(ARMS)]
    task = cached_task(name)
    rng = np.random.default_rng([seed, ARMS.index(name)])
    errors, floor = teach(task, rng, seed, RUNS)
    notes = []
    if errors[-1] > LAST_TO_BEST * errors.min() + SURE * floor:
        notes.append("the last run is worse than the best")
    if errors.max() > 1.1 * errors[0]:
        notes.append("diverges")
    near_noise = errors[-1] <= OVER_NOISE * floor
    shown = [f"{x}: " + " ".join(f"{1e3 * y:.4f}" for y in errors) + " mm" for x in notes]
    return Outcome(kind=name, result="near noise" if near_noise else "above noise", notes=shown)


def run_wrong_model(seed: int) -> Outcome:
    """Teach a robot whose servo differs by much from its model."""
    errors, lessons = wrong_model(cached_task(ARMS[0]), seed)
    last = lessons[-1]
    notes = []
    if errors[:7].min() > SMALL and not last.finished:
        notes.append("stays above 0.005 mm without a reason")
    if errors[-1] > LAST_TO_BEST * errors.min() + SMALL:
        notes.append("the last run is worse than the best")
    shown = [f"{x}: " + " ".join(f"{1e3 * y:.4f}" for y in errors) + " mm" for x in notes]
    return Outcome(result="finished" if last.finished else "goes on", notes=shown)
