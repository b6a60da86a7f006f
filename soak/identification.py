"""Identification of simulated joints and robots: do intervals of 95 % contain the true values?

The logs come from a simulation that shares nothing with the estimator: Runge and Kutta's steps, far
below a sample, with white noise. Another program of the same joint is predicted, too. Robots are
those of the plant of MuJoCo.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

import armcontour as ac
from armcontour.control.identification import BodyIdentification
from armcontour.motion import Log, SetPoints
from soak import Outcome

# Names of the parameters of `move` in results.
NAMES = {
    "kp": "kp",
    "kv": "kv",
    "delay": "dead_time",
    "feed": "velocity_feedforward",
    "limit": "acceleration_limit",
}
LIMIT = 20.0  # rad/s²
# Noise [rad], and times of a sample of the kinds of logs and of drawn ones [s].
NOISE, INTERVAL, SAMPLE = 1e-5, 1e-3, 2e-3
# Of robots: time of a set-point [s], duration [s], noise [rad].
CYCLE, DURATION, OF_ROBOTS = 4e-3, 8.0, 1e-5
HOME = np.array([0.3, -1.5, 1.5, -1.2, -1.5, 0.0])
COULOMB = np.array([6.0, 6.0, 4.0, 1.5, 1.5, 1.5])
VISCOUS = np.array([8.0, 8.0, 5.0, 2.0, 2.0, 2.0])


@njit(cache=True)
def _command(t, u, linear, before, lead, start):
    if start < t[0]:
        return before
    if start >= t[-1]:
        last = 0.0 if linear else lead * (u[-1] - u[-2]) / (t[-1] - t[-2])
        return u[-1] + last
    k = np.searchsorted(t, start, side="right") - 1
    if not linear:
        return u[k] + (lead * (u[k] - u[k - 1]) / (t[k] - t[k - 1]) if k > 0 else 0.0)
    return u[k] + (u[k + 1] - u[k]) * (lead + start - t[k]) / (t[k + 1] - t[k])


@njit(cache=True)
def _run(t, u, linear, before, kp, kv, delay, limit, q0, dq0, steps, friction, feed):
    out = np.empty(len(t))
    out[0] = q = q0
    w = dq0
    for i in range(len(t) - 1):
        h = (t[i + 1] - t[i]) / steps
        for m in range(steps):
            now = t[i] + m * h
            # Right of the start, left of the end: a set-point that arrives there acts there.
            a = _command(t, u, linear, before, feed / kp, now + 1e-12 - delay)
            b = _command(t, u, linear, before, feed / kp, now + h / 2 - delay)
            c = _command(t, u, linear, before, feed / kp, now + h - 1e-12 - delay)
            k1 = min(max(kv * (kp * (a - q) - w), -limit), limit)
            q2, w2 = q + h / 2 * w, w + h / 2 * k1
            k2 = min(max(kv * (kp * (b - q2) - w2), -limit), limit)
            q3, w3 = q + h / 2 * w2, w + h / 2 * k2
            k3 = min(max(kv * (kp * (b - q3) - w3), -limit), limit)
            q4, w4 = q + h * w3, w + h * k3
            k4 = min(max(kv * (kp * (c - q4) - w4), -limit), limit)
            q += h / 6 * (w + 2 * w2 + 2 * w3 + w4)
            w += h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
            # Dry friction takes up to this much of the velocity in a step, and stops it at most.
            w = math.copysign(max(abs(w) - h * friction, 0.0), w)
        out[i + 1] = q
    return out


def move(
    t,
    u,
    *,
    kp,
    kv,
    delay=0.0,
    limit=math.inf,
    linear=True,
    before=None,
    q0=None,
    dq0=0.0,
    steps=10,
    friction=0.0,
    feed=0.0,
):
    """Positions at t [rad] of a joint under the set-points u; `before` holds before the first.

    Dry friction brakes with a constant acceleration [rad/s²]; steps are to be fine with it.
    Velocity feed-forward `feed` adds to the command, over kp, the rate of lines, or that up to held
    ones.
    """
    before = u[0] if before is None else before
    q0 = before if q0 is None else q0
    return _run(t, u, linear, before, kp, kv, delay, limit, q0, dq0, steps, friction, feed)


def multisine(t, highest, seed, lowest=0.5):
    """Equal lines every 0.5 Hz, random phases, largest value about 1."""
    rng = np.random.default_rng(seed)
    lines = np.arange(lowest, highest + 0.25, 0.5)
    u = np.zeros_like(t)
    for f, phase in zip(lines, rng.uniform(0, 2 * np.pi, len(lines)), strict=True):
        u += np.sin(2 * np.pi * f * t + phase)
    return u / np.abs(u).max()


def commands(kind, kp, kv, delay, seed):
    """Times and set-points of a kind of log."""
    if kind == "multisine":
        t = np.arange(8000) * INTERVAL
        return t, 5e-3 * multisine(t, 25.0, seed)
    t = np.arange(4000) * INTERVAL
    if kind == "step":
        return t, np.where(t >= 0.3, 0.85 * LIMIT / (kp * kv), 0.0)
    if kind == "large step":
        return t, np.where(t >= 0.3, 0.5, 0.0)
    raise ValueError(kind)


def draw(seed):
    """A drawn joint, two logs of it with white noise, and its true parameters by name."""
    rng = np.random.default_rng([21, seed])
    servo = {
        "kp": math.exp(rng.uniform(math.log(12), math.log(45))),
        "kv": math.exp(rng.uniform(math.log(80), math.log(250))),
        "delay": rng.uniform(2e-3, 20e-3),
        "feed": float(rng.choice([0.0, 0.9])),
        "limit": float(rng.choice([math.inf, 12.0])),
    }
    logs = []
    for k in range(2):
        t = np.arange(5000) * SAMPLE
        u = 4e-3 * multisine(t, 20.0, 2 * seed + k)
        u -= u[0]
        q = move(t, u, **servo, steps=40)
        logs.append(Log(t=t, command=u, measured=q + NOISE * rng.normal(size=len(t))))
    return logs, servo


def examine(seed: int, every: int) -> dict[str, bool]:
    """Whether the true values of a drawn robot lie in their 95 % intervals, by name."""
    rng = np.random.default_rng(seed)
    nominal = ac.load_arm("ur5e").with_dynamics(armature=0.1)
    scale, mass = rng.uniform(0.8, 1.2), rng.uniform(0.0, 4.0)
    center = rng.uniform(-0.05, 0.05, 3) + [0, 0, 0.05]
    coulomb, viscous = COULOMB * rng.uniform(0, 2, 6), VISCOUS * rng.uniform(0, 2, 6)
    true = nominal.with_dynamics(
        payload=ac.Payload(mass=mass, center=center),
        coulomb=coulomb,
        viscous=viscous,
        armature=0.1 * scale,
    )
    kp, delay = 25.0 * rng.uniform(0.9, 1.1, 6), rng.uniform(0, 10e-3)
    servo = ac.ServoModel(kp=25.0, kv=150.0)
    log = record(true, servo.replace(kp=kp, dead_time=delay), nominal, seed, every)
    identification = ac.identify_bodies(log, nominal, servo, ac.BodyFit(gravity="nominal"))
    return _inside(identification, kp, viscous, coulomb, mass, center, scale, delay)


def _inside(
    identification: BodyIdentification,
    kp: np.ndarray,
    viscous: np.ndarray,
    coulomb: np.ndarray,
    mass: float,
    center: np.ndarray,
    scale: float,
    delay: float,
) -> dict[str, bool]:
    """Whether true values lie in the intervals of the parameters that are determined."""
    true = {"payload_mass": mass, "armature": scale, "dead_time": delay}
    true |= {f"payload_center_{x}": c for x, c in zip("xyz", center, strict=True)}
    pairs = [(x.name, x, true[x.name]) for x in identification.estimates]
    for j, joint in enumerate(identification.joints):
        joint_values = {"kp": kp[j], "viscous": viscous[j], "coulomb": coulomb[j]}
        pairs += [(f"{n} {j + 1}", getattr(joint, n), value) for n, value in joint_values.items()]
    return {name: bool(x.low <= value <= x.high) for name, x, value in pairs if x.determined}


def record(
    true: ac.SerialArm, servo: ac.ServoModel, model: ac.SerialArm, seed: int, every: int
) -> Log:
    """A log of a smooth motion; the controller holds the nominal arm against gravity."""
    rng = np.random.default_rng(1000 + seed)
    t = np.arange(0, DURATION, CYCLE)
    window = np.clip(np.minimum(t, DURATION - t) / 0.5, 0, 1)
    window = (window**3 * (10 - 15 * window + 6 * window**2))[:, None]
    lines = np.arange(1, int(DURATION) + 1)[:, None] / DURATION
    phase = rng.uniform(0, 2 * np.pi, (len(lines), len(HOME)))
    size = rng.normal(size=(len(lines), len(HOME))) / np.sqrt(len(lines))
    waves = np.sin(2 * np.pi * lines * t[:, None, None] + phase)
    q = HOME + 0.4 * window * np.einsum("kj,tkj->tj", size, waves)
    plan = ac.plan(ac.JointPath.spline(np.stack([HOME, HOME + 0.1])), model)
    set_points = SetPoints(cycle=CYCLE, q=q, trajectory=plan, method="none")
    limits = ac.Limits.only(joint_torque=np.full(len(HOME), 1e4))
    plant = ac.RigidBodyPlant(true, servo, limits, noise=OF_ROBOTS, seed=seed, controller=model)
    execution = ac.simulate(set_points, plant)
    n = int((len(q) - 1) * CYCLE / 1e-3) + 1
    times = execution.t[:n:every]
    command = np.stack([np.interp(times, set_points.t, x) for x in q.T], axis=1)
    return Log(
        t=times,
        command=command,
        measured=execution.q[:n:every] + rng.normal(0, OF_ROBOTS, command.shape),
    )


def run(seed: int) -> Outcome:
    """Identify a joint or a robot of a sort that depends on the seed."""
    number = seed // 2
    if seed % 2:
        every = (1, 8)[number % 2]
        covered = examine(number, every)
        names = {f"robot, every {every} ms, {x.split()[0]}": y for x, y in covered.items()}
        return Outcome(kind="robot", result="identified", covered=names)
    (one, other), truth = draw(number)
    identification = ac.identify(one)
    joint, notes = identification.joints[0], []
    if not joint.written:
        return Outcome(kind="joint", result="no model", notes=[joint.note], covered={})
    predicted = identification.predict(other)
    if predicted.rms[0] > 0.3 * predicted.tracking_rms[0]:
        notes.append(f"errs by {predicted.rms[0]:.3g} rad on another program")
    if not math.isnan(joint.acceleration_limit.value) and truth["limit"] == math.inf:
        notes.append("finds a limit where there is none")
    same = {NAMES[x] for x, y in truth.items() if y not in (0.0, math.inf)} == set(joint.parameters)
    covered = {
        f"joint, {NAMES[x]}": bool(
            getattr(joint, NAMES[x]).low <= y <= getattr(joint, NAMES[x]).high
        )
        for x, y in truth.items()
        if same and NAMES[x] in joint.parameters
    }
    return Outcome(kind="joint", result=joint.order, notes=notes, covered=covered)
