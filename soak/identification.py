"""Identification of simulated joints and robots: do intervals of 95 % hold the true values?

The logs come from a simulation that shares nothing with the estimator: Runge and Kutta's steps, far
below a sample. They have white noise, whose estimates are compared with the Cramér-Rao bound by
differences of that simulation; or positions of encoders of few bits. Robots are those of the plant
of MuJoCo.
"""

from __future__ import annotations

import math
from itertools import product

import numpy as np
from numba import njit

import armcontour as ac
from armcontour import identification
from armcontour.motion import Log, TaughtData
from soak import Outcome

NAMES = ("kp", "kv", "dead_time", "acceleration")
LIMIT = 20.0  # rad/s²
# Of logs with white noise: its size [rad], the time of a sample [s], gains and dead times.
NOISE, INTERVAL = 1e-4, 1e-3
GRID = tuple(product((10.0, 25.0, 60.0), (60.0, 150.0, 300.0), (0.0, 12.3e-3, 100e-3)))
WIDE = 4.5  # standard deviations of the bound that no error exceeds
# Of encoders: bits, noise [rad], duration and sample time [s], dry friction [rad/s²].
BITS, NOISES, SECONDS, SAMPLE, FRICTION = (12, 14, 16, 19), (0.0, 5e-5), 20.0, 2e-3, 1.5
# Of robots: time of a set-point [s], duration [s], noise [rad].
PERIOD, DURATION, OF_ROBOTS = 4e-3, 8.0, 1e-5
HOME = np.array([0.3, -1.5, 1.5, -1.2, -1.5, 0.0])
COULOMB = np.array([6.0, 6.0, 4.0, 1.5, 1.5, 1.5])
VISCOUS = np.array([8.0, 8.0, 5.0, 2.0, 2.0, 2.0])


@njit(cache=True)
def _command(t, u, linear, before, lead, at):
    if at < t[0]:
        return before
    if at >= t[-1]:
        last = 0.0 if linear else lead * (u[-1] - u[-2]) / (t[-1] - t[-2])
        return u[-1] + last
    k = np.searchsorted(t, at, side="right") - 1
    if not linear:
        return u[k] + (lead * (u[k] - u[k - 1]) / (t[k] - t[k - 1]) if k > 0 else 0.0)
    return u[k] + (u[k + 1] - u[k]) * (lead + at - t[k]) / (t[k + 1] - t[k])


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


def demand(t, u, kp, kv, delay):
    """Largest acceleration demand of a joint without a limit [rad/s²]."""
    q = move(t, u, kp=kp, kv=kv, delay=delay, steps=2)
    step = t[1] - t[0]
    return float(np.abs(np.diff(q, 2)).max() / step**2)


def commands(kind, kp, kv, delay, seed):
    """Times and set-points of a kind of log."""
    if kind in ("multisine", "saturating"):
        t = np.arange(60_000 if kind == "multisine" else 10_000) * INTERVAL
        u = multisine(t, 25.0, seed)
        share = 0.85 if kind == "multisine" else 2.0
        return t, u * share * LIMIT / demand(t, u, kp, kv, delay)
    t = np.arange(4000) * INTERVAL
    if kind == "step":
        return t, np.where(t >= 0.3, 0.85 * LIMIT / (kp * kv), 0.0)
    if kind == "large step":
        return t, np.where(t >= 0.3, 0.5, 0.0)
    if kind == "ramp":
        return t, np.clip(t - 0.3, 0.0, 2.0) * 0.3
    raise ValueError(kind)


def simulated(t, u, kp, kv, delay, limit):
    """What the joint does; with finer steps where it starts with a jolt."""
    return move(t, u, kp=kp, kv=kv, delay=delay, limit=limit, steps=10 if len(t) > 5000 else 400)


def bound(t, u, kp, kv, delay, limit):
    """Standard deviations of the Cramér-Rao bound; the limit's is infinite if it is not reached."""
    limit = min(limit, 1e9)  # differences need a number
    truth = np.array([kp, kv, delay, limit])
    steps = (1e-4 * kp, 1e-4 * kv, 1e-5, 1e-4 * limit)
    columns = []
    for i, step in enumerate(steps):
        ends = []
        for sign in (1, -1):
            p = truth.copy()
            p[i] += sign * step
            # Set-points are of the log; a dead time below zero takes the next one early.
            ends.append(simulated(t, u, *p))
        columns.append((ends[0] - ends[1]) / (2 * step))
    jacobian = np.array(columns)
    seen = np.abs(jacobian).max(axis=1) > 0
    sd = np.full(4, math.inf)
    information = jacobian[seen] @ jacobian[seen].T
    scale = np.sqrt(np.diag(information))
    inverse = np.linalg.inv(information / np.outer(scale, scale))
    sd[seen] = NOISE * np.sqrt(np.diag(inverse)) / scale
    return sd


def case(kind, kp, kv, delay, seed, samples=None):
    """The joint that is identified from a log with white noise, the truth, and the bound."""
    t, u = (x[:samples] for x in commands(kind, kp, kv, delay, seed=1))
    q = simulated(t, u, kp, kv, delay, LIMIT)
    noise = np.random.default_rng([seed, int(kp), int(kv), int(delay * 1e4)]).normal(size=len(t))
    log = Log(t=t, command=u, measured=q + NOISE * noise)
    joint = identification.identify(log).joints[0]
    return joint, (kp, kv, delay, LIMIT), bound(t, u, kp, kv, delay, LIMIT)


def excitation(t, highest, seed, lowest=0.5):
    """The excitation of the guide: lines one per duration apart, with low peaks."""
    n = len(t)
    f = np.fft.rfftfreq(n, t[1] - t[0])
    band = (f >= lowest) & (f <= highest)
    lines = band * np.exp(2j * np.pi * np.random.default_rng(seed).uniform(size=len(f)))
    for _ in range(50):
        u = np.fft.irfft(lines, n)
        top = 1.7 * np.std(u)
        lines = band * np.exp(1j * np.angle(np.fft.rfft(np.clip(u, -top, top))))
    u = np.fft.irfft(lines, n)
    return u / np.abs(u).max()


def simulate(bits, noise, seed, friction=0.0):
    """A log of an encoder of one joint, and its true gains and dead time."""
    rng = np.random.default_rng([seed, bits, int(noise * 1e6), 0])
    truth = (
        math.exp(rng.uniform(math.log(12), math.log(45))),
        math.exp(rng.uniform(math.log(80), math.log(250))),
        rng.uniform(2e-3, 20e-3),
    )
    t = np.arange(int(SECONDS / SAMPLE)) * SAMPLE
    u = excitation(t, 25.0, seed)
    u = u * 0.85 * LIMIT / demand(t, u, *truth)
    kp, kv, delay = truth
    u = u - u[0]
    q = move(t, u, kp=kp, kv=kv, delay=delay, limit=LIMIT, friction=friction)
    step = 2 * math.pi / 2**bits
    zero = rng.uniform(0, step)
    y = step * np.round((q + noise * rng.normal(size=len(t)) + zero) / step) - zero
    return Log(t=t, command=u, measured=y), truth


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
    found = identification.identify(log, arm=nominal, servo=servo, gravity="nominal")
    return _inside(found, kp, viscous, coulomb, mass, center, scale, delay)


def _inside(
    found: identification.RobotIdentification,
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
    pairs = [(x.name, x, true[x.name]) for x in found.common]
    for j, joint in enumerate(found.joints):
        own = {"kp": kp[j], "viscous": viscous[j], "coulomb": coulomb[j]}
        pairs += [(f"{n} {j + 1}", getattr(joint, n), value) for n, value in own.items()]
    return {name: bool(x.low <= value <= x.high) for name, x, value in pairs if x.determined}


def record(
    true: ac.SerialArm, servo: ac.ServoModel, known: ac.SerialArm, seed: int, every: int
) -> Log:
    """A log of a smooth motion; the controller holds the nominal arm against gravity."""
    rng = np.random.default_rng(1000 + seed)
    t = np.arange(0, DURATION, PERIOD)
    window = np.clip(np.minimum(t, DURATION - t) / 0.5, 0, 1)
    window = (window**3 * (10 - 15 * window + 6 * window**2))[:, None]
    lines = np.arange(1, int(DURATION) + 1)[:, None] / DURATION
    phase = rng.uniform(0, 2 * np.pi, (len(lines), len(HOME)))
    size = rng.normal(size=(len(lines), len(HOME))) / np.sqrt(len(lines))
    waves = np.sin(2 * np.pi * lines * t[:, None, None] + phase)
    q = HOME + 0.4 * window * np.einsum("kj,tkj->tj", size, waves)
    plan = ac.plan(ac.JointPath.spline(np.stack([HOME, HOME + 0.1])), known)
    taught = TaughtData(period=PERIOD, q=q, trajectory=plan, method="none")
    limits = ac.Limits(joint_torque=np.full(len(HOME), 1e4))
    plant = ac.RigidBodyPlant(true, servo, limits, noise=OF_ROBOTS, seed=seed, known=known)
    done = ac.execute(taught, plant)
    n = int((len(q) - 1) * PERIOD / 1e-3) + 1
    at = done.t[:n:every]
    command = np.stack([np.interp(at, taught.t, x) for x in q.T], axis=1)
    return Log(
        t=at, command=command, measured=done.q[:n:every] + rng.normal(0, OF_ROBOTS, command.shape)
    )


def run(seed: int) -> Outcome:
    """Identify a joint or a robot of a sort that depends on the seed."""
    sort, number = ("white noise", "encoder", "robot")[seed % 3], seed // 3
    rng = np.random.default_rng((20, seed))
    if sort == "robot":
        every = (1, 8)[number % 2]
        covered = examine(number, every)
        names = {f"robot, every {every} ms, {x.split()[0]}": y for x, y in covered.items()}
        return Outcome(kind=sort, result="identified", covered=names)
    if sort == "white noise":
        kind = str(rng.choice(["multisine", "saturating", "large step"], p=[0.8, 0.1, 0.1]))
        gains = GRID[number % len(GRID)] if kind == "multisine" else (25.0, 150.0, 12.3e-3)
        joint, truth, sd = case(kind, *gains, number)
        errors = [
            (name, abs(x.value - true) / size)
            for name, x, true, size in zip(NAMES, joint.estimates, truth, sd, strict=False)
            if size < 0.1 * max(true, 1.0)
        ]
        notes = [f"{x}: off by {y:.1f} bounds, {kind} {gains}" for x, y in errors if y > WIDE]
        return Outcome(kind=sort, result=kind, notes=notes, covered=_covered(sort, joint, truth))
    friction = FRICTION if number % 4 == 3 else 0.0
    log, truth = simulate(int(rng.choice(BITS)), float(rng.choice(NOISES)), number, friction)
    joint = identification.identify(log).joints[0]
    if not friction:
        return Outcome(kind=sort, result="identified", covered=_covered(sort, joint, truth))
    notes = []
    if not any("friction" in x for x in joint.notes):
        notes.append("friction is not reported")
    if any(x.determined for x in joint.estimates):
        notes.append("a parameter counts as determined in spite of friction")
    return Outcome(kind="encoder, friction", result="identified", notes=notes)


def _covered(sort, joint, truth):
    """Whether intervals of determined parameters hold the true values."""
    found = zip(NAMES, joint.estimates, truth, strict=False)
    return {f"{sort}, {n}": bool(x.low <= y <= x.high) for n, x, y in found if x.determined}
