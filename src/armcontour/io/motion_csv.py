"""Write taught data, planned trajectories and torques as CSV text."""

from __future__ import annotations

from collections.abc import Sequence

from armcontour.arms import Arm
from armcontour.io.exports.text import csv_text, joint_columns
from armcontour.motion import TaughtData, Trajectory


def taught_csv(taught: TaughtData, joint_names: Sequence[str]) -> str:
    """Taught data as CSV: t, then q of every joint."""
    return csv_text(*joint_columns(taught.t, joint_names, q=taught.q))


def planned_csv(trajectory: Trajectory, period: float, joint_names: Sequence[str] = ()) -> str:
    """The realizable trajectory as CSV: t, then q, dq and ddq of every joint.

    Args:
        trajectory: The trajectory.
        period: Time between rows; the last row is the end [s].
        joint_names: Names of the joints; numbers by default.
    """
    x = trajectory.sample(period)
    names = joint_names or [f"joint {j + 1}" for j in range(trajectory.dof)]
    return csv_text(*joint_columns(x.t, names, q=x.q, dq=x.dq, ddq=x.ddq))


def torque_csv(trajectory: Trajectory, arm: Arm, period: float) -> str:
    """Torques of the realizable trajectory as CSV: t, then the torque of every joint's drive.

    Args:
        trajectory: The trajectory.
        arm: The arm, with bodies.
        period: Time between rows; the last row is the end [s].
    """
    x = trajectory.sample(period)
    torque = arm.torque(x.q, x.dq, x.ddq)
    return csv_text(*joint_columns(x.t, arm.joint_names, torque=torque))
