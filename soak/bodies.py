"""Coverage of the 95 % intervals of `identify` with an arm, on robots of the plant of MuJoCo.

`python -m soak.bodies --seeds 16` draws robots with payload, friction, gains and dead time, logs a
motion of 8 s of each at 1 kHz and at 125 Hz, and counts how many true values lie in their
intervals. Coverage per parameter should be from 90 to 99 %; 125 Hz logs do not hold every
set-point, for which intervals allow.
"""

from __future__ import annotations

import argparse
from collections import defaultdict

import numpy as np

import armcontour as ac
from armcontour.identification import RobotIdentification, identify
from armcontour.motion import Log, TaughtData

PERIOD = 4e-3
DURATION = 8.0
NOISE = 1e-5
HOME = np.array([0.3, -1.5, 1.5, -1.2, -1.5, 0.0])
COULOMB = np.array([6.0, 6.0, 4.0, 1.5, 1.5, 1.5])
VISCOUS = np.array([8.0, 8.0, 5.0, 2.0, 2.0, 2.0])


def main() -> None:
    """Draw robots, identify them, and print the coverage of each parameter."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=16)
    parser.add_argument("--first", type=int, default=0)
    given = parser.parse_args()
    inside: dict[tuple[int, str], list[bool]] = defaultdict(list)
    for seed in range(given.first, given.first + given.seeds):
        for every in (1, 8):
            for name, hit in examine(seed, every).items():
                inside[every, name.split()[0]].append(hit)
            every_hit = [x for (e, _), y in inside.items() if e == every for x in y]
            print(
                f"seed {seed}, every {every} ms: {np.mean(every_hit) * 100:.1f} % so far",
                flush=True,
            )
    for (every, name), hits in sorted(inside.items()):
        print(f"every {every} ms, {name}: {np.mean(hits) * 100:.1f} % of {len(hits)}")


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
    found = identify(log, arm=nominal, servo=servo, gravity="nominal")
    return _inside(found, kp, viscous, coulomb, mass, center, scale, delay)


def _inside(
    found: RobotIdentification,
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
    plant = ac.RigidBodyPlant(true, servo, limits, noise=NOISE, seed=seed, known=known)
    done = ac.execute(taught, plant)
    n = int((len(q) - 1) * PERIOD / 1e-3) + 1
    at = done.t[:n:every]
    command = np.stack([np.interp(at, taught.t, x) for x in q.T], axis=1)
    return Log(
        t=at, command=command, measured=done.q[:n:every] + rng.normal(0, NOISE, command.shape)
    )


if __name__ == "__main__":
    main()
