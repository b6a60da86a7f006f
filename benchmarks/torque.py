"""Plan with torque limits, against toppra with pinocchio's RNEA, on 1,000 points.

A UR5e follows a spline through random joint positions. Joint velocity and torque limits are active.
Every time includes the spline, the constraints, the solution and the law. toppra calls `pin.rnea`
for every point, as its users do.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec
from typing import Any

import numpy as np

import armcontour as ac
from armcontour.core.checks import FloatArray
from benchmarks import ur5e
from benchmarks.measured import Bar, Line, Missing, Pair, timed

POINTS = 1000
# Places of a traced path that are toppra's waypoints.
PLACES = 400
# Waypoints of the spline.
WAYPOINTS = 6
# Largest joint position of a waypoint, in both directions [rad].
REACH = 1.5
AT = np.linspace(0, 1, WAYPOINTS)
WAY = np.random.default_rng(3).uniform(-REACH, REACH, (WAYPOINTS, 6))
# Less than the arm has, so that they bind, on two joints.
TORQUE = np.array([60.0, 120.0, 60.0, 12.0, 8.0, 4.0])  # N m
VELOCITY = 3.14  # rad/s, limit of every joint
ACCELERATION = 40.0  # rad/s², limit of every joint


def lines() -> list[Line]:
    """Return the only line."""
    title = f"plan with torque limits, {POINTS} points"
    peer = "toppra and RNEA (Seidel)"
    return [Line("torque/spline", title, peer, _prepare, Bar(ratio=1 / 20))]


def _prepare() -> Pair:
    arm = ur5e.load()
    limits = ac.Limits.only(
        joint_velocity=VELOCITY, joint_acceleration=ACCELERATION, joint_torque=TORQUE
    )
    limits = limits.for_joints(arm.dof)
    options = ac.Optimal(intervals=POINTS - 1)

    def ours() -> ac.Trajectory:
        return ac.plan(ac.JointPath.spline(WAY, AT), arm, limits, options)

    theirs = toppra_planner(arm, limits, AT, WAY)

    def notes() -> list[str]:
        planned = ours()
        t = np.linspace(0, planned.duration, 20 * POINTS)
        used = np.abs(arm.torque(*(planned(t, order) for order in range(3)))).max(axis=0) / TORQUE
        shares = ", ".join(f"{x:.3f}" for x in used)
        return [f"{planned.duration:.4f} s, torques used {shares}; toppra: {theirs():.4f} s"]

    return Pair(timed(ours), timed(theirs), notes)


def toppra_planner(
    arm: ac.SerialArm, limits: ac.Limits, parameters: FloatArray, way: FloatArray
) -> Callable[[], float]:
    """Return a call that plans with toppra through waypoints and returns the duration [s].

    Args:
        arm: The arm, with masses.
        limits: Of joint velocity, acceleration and torque.
        parameters: Path parameters of the waypoints, from 0 to 1.
        way: The waypoints [rad], (n, dof).
    """
    if find_spec("toppra") is None:
        raise Missing("toppra is not installed, which has wheels for linux-x86_64")
    import pinocchio as pin
    import toppra
    from toppra.algorithm import TOPPRA
    from toppra.constraint import (
        DiscretizationType,
        JointAccelerationConstraint,
        JointTorqueConstraint,
        JointVelocityConstraint,
    )

    toppra.setup_logging("CRITICAL")
    model = _model(pin, arm)
    data = model.createData()
    scheme = DiscretizationType.Interpolation
    velocity, torque = (_per_joint(arm, x) for x in (limits.joint_velocity, limits.joint_torque))
    acceleration = np.column_stack(limits.acceleration_bounds(arm.dof))

    def inverse_dynamics(q: FloatArray, dq: FloatArray, ddq: FloatArray) -> FloatArray:
        return np.array(pin.rnea(model, data, q, dq, ddq))

    def plan() -> float:
        constraints = [
            JointVelocityConstraint(np.column_stack([-velocity, velocity])),
            JointAccelerationConstraint(acceleration, scheme),
            JointTorqueConstraint(
                inverse_dynamics, np.column_stack([-torque, torque]), np.zeros(arm.dof), scheme
            ),
        ]
        law = TOPPRA(
            constraints,
            toppra.SplineInterpolator(parameters, way, bc_type="natural"),
            gridpoints=np.linspace(0, 1, POINTS),
            solver_wrapper="seidel",
            parametrizer="ParametrizeConstAccel",
        ).compute_trajectory(0, 0)
        return float("nan") if law is None else float(law.duration)

    return plan


def _per_joint(arm: ac.SerialArm, value: Any) -> FloatArray:
    return np.broadcast_to(np.asarray(value, dtype=float), arm.dof).copy()


def _model(pin: Any, arm: ac.SerialArm) -> Any:
    """Make the model of an arm with masses and without a payload."""
    chain = arm.chain
    model = pin.Model()
    model.gravity.linear = np.asarray(chain.gravity)
    base = pin.SE3(np.asarray(chain.base.rotation), np.asarray(chain.base.position))
    parent = 0
    for k, name in enumerate(chain.joints):
        placement = pin.SE3(np.asarray(chain.rotations[k]), np.asarray(chain.positions[k]))
        if k == 0:
            placement = base * placement
        joint = pin.JointModelRevoluteUnaligned(np.asarray(chain.axes[k]))
        parent = model.addJoint(parent, joint, placement, name)
        body = pin.Inertia(
            float(chain.masses[k]), np.asarray(chain.centers[k]), np.asarray(chain.inertias[k])
        )
        model.appendBodyToJoint(parent, body, pin.SE3.Identity())
    return model
