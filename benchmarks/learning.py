"""Learning from a run, against the simulation of that run on rigid bodies."""

from __future__ import annotations

import armcontour as ac
from armcontour.motion import smooth
from benchmarks import ur5e
from benchmarks.measured import Measured, paired

RUNS = 5
LIMITS = ac.Limits(joint_velocity=3.14, joint_acceleration=6.4, speed=0.25)
SERVO = ac.ServoModel(kp=25.0, kv=150.0)
POINTS = ((0.350, 0.100), (0.410, 0.150), (0.280, 0.300), (0.350, 0.350))


def measure() -> list[Measured]:
    """The first call for the UR5e's square, and for the paper's job."""
    square = ac.round_corners(ur5e.square(), tolerance=ur5e.CORNER_ERROR)
    arm, paper = ur5e.load(), ac.load_arm("pmk3s")
    strokes = ac.round_corners(ac.Path.polyline(POINTS), tolerance=5e-3, acceleration=0.09)
    slow = ac.Limits(speed=0.15, joint_acceleration=0.72, centripetal_acceleration=0.09)
    return [
        _learn("the UR5e's square", arm, square, LIMITS, 0.02, "3 s"),
        _learn("the paper's job", paper, strokes, slow, 4e-3, "0.5 s"),
    ]


def _learn(
    what: str, arm: ac.Arm, path: ac.Path, limits: ac.Limits, window: float, bar: str
) -> Measured:
    plan = smooth(ac.plan(path, arm, limits.for_joints(arm.dof)), window)
    taught = ac.compensate(plan, SERVO, method="inverse")
    plant = ac.RigidBodyPlant(arm, SERVO.replace(kp=24.0))
    executed = ac.execute(taught, plant)
    times = paired(
        lambda: ac.learn(taught, executed, arm=arm, servo=SERVO),
        lambda: ac.execute(taught, plant),
        RUNS,
    )
    return Measured(f"learn, {what}", times[0], "one run simulated", times[1], f"<= {bar}")
