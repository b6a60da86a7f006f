"""Contour errors of the default compensation on rigid bodies, compared with no compensation."""

from __future__ import annotations

import numpy as np

import armcontour as ac
from soak import Outcome

PERIOD = 4e-3


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
    for method in ("none", None):
        taught = ac.compensate(plan, servo, method=method, arm=arm, period=PERIOD)
        done = ac.execute(taught, ac.RigidBodyPlant(arm, servo))
        errors.append(ac.evaluate(done, path).contour_error)
    none, default = errors
    ratio = max(default.rms / none.rms, default.max / none.max)
    notes = [f"{ratio:.3f} of the error without compensation"] if ratio > 1 else []
    return Outcome(kind=name, result="compared", notes=notes)
