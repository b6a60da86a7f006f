"""Time the first call that learns from a run."""

from __future__ import annotations

import armcontour as ac
from benchmarks import reference, ur5e
from benchmarks.measured import Bar, Line, Pair, timed

LIMITS = ac.Limits(joint_velocity=3.14, joint_acceleration=6.4, speed=0.25)
SERVO = ac.ServoModel(kp=25.0, kv=150.0)
POINTS = ((0.350, 0.100), (0.410, 0.150), (0.280, 0.300), (0.350, 0.350))


def lines() -> list[Line]:
    """Return the lines for the first call on the UR5e's square, and on the paper's job."""
    peer = reference.NAME
    return [
        Line("learn/square", "learn, the UR5e's square", peer, _square, Bar(seconds=3)),
        # Half a second where the reference work takes 11.6 ms; half of it is SuperLU, which
        # factorizes 13 sparse matrices of 14,000 unknowns.
        Line("learn/paper", "learn, the paper's job", peer, _paper, Bar(ratio=43)),
    ]


def _square() -> Pair:
    square = ac.round_corners(ur5e.square(), tolerance=ur5e.CORNER_ERROR, continuity="curvature")
    return _learn(ur5e.load(), square, LIMITS.replace(joint_jerk=320.0))


def _paper() -> Pair:
    strokes = ac.round_corners(ac.Path.polyline(POINTS), tolerance=5e-3, acceleration=0.09)
    slow = ac.Limits(speed=0.15, joint_acceleration=0.72, centripetal_acceleration=0.09)
    return _learn(ac.load_arm("pmk3s"), strokes, slow)


def _learn(arm: ac.Arm, path: ac.Path, limits: ac.Limits) -> Pair:
    plan = ac.plan(path, arm, limits.for_joints(arm.dof))
    set_points = ac.compensate(plan, SERVO, ac.Inverse())
    plant = ac.RigidBodyPlant(arm, SERVO.replace(kp=24.0))
    executed = ac.simulate(set_points, plant)
    ours = timed(lambda: ac.learn(set_points, executed, arm=arm, servo=SERVO))
    return Pair(ours, timed(reference.work))
