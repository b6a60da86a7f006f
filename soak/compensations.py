"""Contour errors of compensations on the servo model and on rigid bodies.

`python -m soak.compensations` prints the table of docs/guides/compensations.md: one plan, robots
with other gains, delays and payloads. The topic `compensations` compares the default with none.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator

import numpy as np

import armcontour as ac
from armcontour.jobs.methods import COMPENSATIONS
from soak import Outcome

NAMES = ("none", "inverse", "pole_placement", "inverse_dynamics")
KP = 25.0  # 1/s, nominal
KV = 150.0  # 1/s, nominal
CYCLE = 2e-3  # s, between set-points
# Gains of robots differ from the nominal ones by at most this share.
GAINS = 0.2
# Number of robots with such gains.
DRAWN = 6
Plant = Callable[[ac.ServoModel], ac.ServoPlant | ac.RigidBodyPlant]


def run(seed: int) -> Outcome:
    """Compare the default compensation with none for a random path, arm and gains."""
    rng = np.random.default_rng(seed)
    name = str(rng.choice(["ur5e", "ur10e", "panda", "fr3"]))
    arm = ac.load_arm(name, tool=ac.Frame(position=(0.0, 0.0, rng.uniform(0, 0.2))))
    arm = arm.with_dynamics(armature=rng.choice([0.02, 0.1, 0.3]))
    spread = rng.uniform(-0.1, 0.1, (int(rng.integers(2, 6)), 3)) * (1, 1, rng.uniform(0, 1))
    path = ac.Path.polyline(spread + (0.45, 0.0, 0.3)).pointing((0.0, 0.0, -1.0))
    servo = ac.ServoModel(kp=rng.uniform(15, 40), kv=rng.uniform(100, 250))
    limits = arm.limits.replace(
        speed=rng.uniform(0.05, 0.25),
        joint_acceleration=rng.uniform(0.8, 1.0) * arm.limits.joint_acceleration,
        centripetal_acceleration=1.0,
    )
    try:
        path = ac.round_corners(path, tolerance=rng.uniform(1e-4, 1e-3))
        plan = ac.plan(path, arm, limits)
    except ac.ArmContourError:
        return Outcome(kind=name, result="not planned")
    errors = []
    for method in ("none", "inverse"):
        set_points = ac.compensate(plan, servo, COMPENSATIONS[method](), arm=arm, cycle=CYCLE)
        execution = ac.simulate(set_points, ac.RigidBodyPlant(arm, servo))
        errors.append(ac.evaluate(execution, path).contour_error)
    none, default = errors
    ratio = max(default.rms / none.rms, default.max / none.max)
    notes = [f"{ratio:.3f} of the error without compensation"] if ratio > 1 else []
    return Outcome(kind=name, result="compared", notes=notes)


def square() -> tuple[ac.Arm, ac.Path]:
    """Make a square of 100 mm for a UR5e with a tool of 120 mm and drives of 0.1 kg m²."""
    arm = ac.load_arm("ur5e", tool=ac.Frame(position=(0.0, 0.0, 0.12))).with_dynamics(armature=0.1)
    corners = [(0.38, -0.05, 0.1), (0.48, -0.05, 0.1), (0.48, 0.05, 0.1), (0.38, 0.05, 0.1)]
    path = ac.Path.polyline([*corners, corners[0]]).pointing((0.0, 0.0, -1.0))
    return arm, ac.round_corners(path, tolerance=2.5e-4)


def rows(reserve: float) -> Iterator[str]:
    """Yield the rows of the table for one reserve of the plan."""
    arm, path = square()
    limits = arm.limits.replace(speed=0.1, centripetal_acceleration=1.0)
    plan = ac.plan(path, arm, limits, ac.Optimal(reserve=reserve))
    nominal = ac.ServoModel(kp=KP, kv=KV)
    set_points = [
        ac.compensate(plan, nominal, COMPENSATIONS[x](), cycle=CYCLE, arm=arm) for x in NAMES
    ]
    loaded = arm.with_dynamics(payload=ac.Payload(mass=0.2, center=(0.0, 0.0, 0.05)))
    rough = arm.with_dynamics(coulomb=1.0, viscous=1.0)
    robots: dict[str, list[ac.ServoModel]] = {
        "as modelled": [nominal],
        f"gains within {GAINS:.0%}": [nominal.replace(**near(k, arm.dof)) for k in range(DRAWN)],
        "1 ms more delay": [delayed(nominal, 1e-3)],
        "2 ms more delay": [delayed(nominal, 2e-3)],
    }
    rows_found: list[tuple[str, str, Plant, list[ac.ServoModel]]] = []
    for name, servos in robots.items():
        rows_found.append(("servo model", name, lambda x: ac.ServoPlant(arm, x), servos))
    for name, servos in robots.items():
        rows_found.append(("bodies", name, lambda x: ac.RigidBodyPlant(arm, x), servos))
    for name, true in (("0.2 kg more", loaded), ("friction of 1 N m, 1 N m s/rad", rough)):
        plant = lambda x, true=true: ac.RigidBodyPlant(true, x, controller=arm)  # noqa: E731
        rows_found.append(("bodies", name, plant, [nominal]))
    for judge, name, plant, servos in rows_found:
        cells = []
        for x in set_points:
            errors = [ac.evaluate(ac.simulate(x, plant(s)), path).contour_error for s in servos]
            rms = np.median([e.rms for e in errors])
            maximum = max(e.max for e in errors)
            cells.append(f"{rms * 1e3:.4f} / {maximum * 1e3:.3f}")
        yield f"| {judge} | {reserve:.0%} | {name} | " + " | ".join(cells) + " |"


def near(seed: int, dof: int) -> dict[str, np.ndarray]:
    """Draw the gains of a robot near the model."""
    shares = np.random.default_rng(seed).uniform(1 - GAINS, 1 + GAINS, (2, dof))
    return {"kp": KP * shares[0], "kv": KV * shares[1]}


def delayed(servo: ac.ServoModel, delay: float) -> ac.ServoModel:
    """Return a servo whose velocity loop takes its command later [s], to first order."""
    gain = 1 - servo.kp * delay
    return servo.replace(kp=servo.kp / gain, kv=servo.kv * gain)


def main() -> None:
    """Print the table."""
    warnings.simplefilter("ignore")
    print("| judged on | reserve | robot | " + " | ".join(f"`{x}`" for x in NAMES) + " |")
    print("|---|---|---|" + "---|" * len(NAMES))
    for reserve in (0.0, 0.02, 0.1):
        for row in rows(reserve):
            print(row, flush=True)


if __name__ == "__main__":
    main()
