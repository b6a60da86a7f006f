"""Robots that are not quite their models, and logs of them, by the plant of MuJoCo."""

import numpy as np

import armcontour as ac
from armcontour.motion import Log, SetPoints

CYCLE = 4e-3
NOISE = 1e-5
NOMINAL, LOADED = (ac.BodyFit(gravity=x) for x in ("nominal", "loaded"))
HOME = np.array([0.3, -1.5, 1.5, -1.2, -1.5, 0.0])
COULOMB = np.array([6.0, 6.0, 4.0, 1.5, 1.5, 1.5])
VISCOUS = np.array([8.0, 8.0, 5.0, 2.0, 2.0, 2.0])
KP = np.array([25.0, 24.0, 26.0, 23.0, 25.0, 25.5])


def nominal_arm():
    return ac.load_arm("ur5e").with_dynamics(armature=0.1)


def true_arm(nominal, payload=None):
    load = payload or ac.Payload(mass=2.0, center=[0.02, 0.0, 0.05])
    return nominal.with_dynamics(payload=load, coulomb=COULOMB, viscous=VISCOUS)


def nominal_servo():
    return ac.ServoModel(kp=25.0, kv=150.0)


def set_points(seed, duration, joints=(0, 1, 2, 3, 4, 5), reach=0.4):
    """Set-points of joints that wander smoothly, from rest to rest, every 4 ms."""
    rng = np.random.default_rng(seed)
    t = np.arange(0, duration, CYCLE)
    window = np.clip(np.minimum(t, duration - t) / 0.5, 0, 1)
    window = (window**3 * (10 - 15 * window + 6 * window**2))[:, None]
    lines = np.arange(1, int(1.0 * duration) + 1) / duration
    phase = rng.uniform(0, 2 * np.pi, (len(lines), len(HOME)))
    size = rng.normal(size=(len(lines), len(HOME))) / np.sqrt(len(lines))
    waves = np.einsum(
        "kj,tkj->tj", size, np.sin(2 * np.pi * lines[:, None] * t[:, None, None] + phase)
    )
    moves = np.isin(np.arange(len(HOME)), joints)
    return HOME + reach * window * waves * moves


def record(arm, servo, q, *, every=4, noise=NOISE, seed=0, **options):
    """A log of set-points that a plant executed, a sample every so many milliseconds."""
    plan = ac.plan(ac.JointPath.spline(np.stack([q[0], q[0] + 0.1])), arm)
    set_points = SetPoints(cycle=CYCLE, q=q, trajectory=plan, method="none")
    limits = ac.Limits(joint_torque=np.full(arm.dof, 1e4))
    plant = ac.RigidBodyPlant(arm, servo, limits, noise=noise, seed=seed, **options)
    execution = ac.simulate(set_points, plant)
    n = int((len(q) - 1) * CYCLE / 1e-3) + 1
    t = execution.t[:n:every]
    command = np.stack([np.interp(t, set_points.t, x) for x in q.T], axis=1)
    shaken = np.random.default_rng(seed + 1000).normal(0, noise, (len(t), arm.dof))
    return Log(t=t, command=command, measured=execution.q[:n:every] + shaken, source="run.csv")


def planar(armature):
    """What is identified of a loaded arm without gravity, and its friction [N m]."""
    nominal = ac.load_arm("pmk3s").with_dynamics(armature=armature)
    coulomb = np.array([0.8, 0.4])
    true = nominal.with_dynamics(
        payload=ac.Payload(mass=1.0, center=[0.02, 0.01, 0.03]),
        coulomb=coulomb,
        viscous=[0.9, 0.5],
        armature=1.15 * armature if armature else [0.05, 0.03],
    )
    q = np.array([0.4, 1.2]) + (set_points(3, 4.0) - HOME)[:, :2]
    servo = nominal_servo().replace(kp=np.array([26.0, 24.0]), dead_time=5e-3)
    log = record(true, servo, q, controller=nominal)
    return ac.identify_bodies(log, nominal, nominal_servo(), NOMINAL), coulomb
