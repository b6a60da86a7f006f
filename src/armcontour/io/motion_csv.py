"""Write taught data, planned trajectories and torques as CSV."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path as FilePath

from armcontour.arms import Arm
from armcontour.io.exports.text import csv_pieces, joint_columns, write_pieces
from armcontour.motion import TaughtData, Trajectory


def write_taught(file: FilePath, taught: TaughtData, joint_names: Sequence[str]) -> None:
    """Write taught data as CSV: t, then q of every joint."""
    write_pieces(file, csv_pieces(*joint_columns(taught.t, joint_names, q=taught.q)))


def write_planned(
    file: FilePath, trajectory: Trajectory, period: float, joint_names: Sequence[str] = ()
) -> None:
    """Write the realizable trajectory as CSV: t, then q, dq and ddq of every joint.

    Args:
        file: The file.
        trajectory: The trajectory.
        period: Time between rows; the last row is the end [s].
        joint_names: Names of the joints; numbers by default.
    """
    x = trajectory.sample(period)
    names = joint_names or [f"joint {j + 1}" for j in range(trajectory.dof)]
    write_pieces(file, csv_pieces(*joint_columns(x.t, names, q=x.q, dq=x.dq, ddq=x.ddq)))


def write_torque(file: FilePath, trajectory: Trajectory, arm: Arm, period: float) -> None:
    """Write torques of the realizable trajectory as CSV: t, then the torque of every drive.

    Args:
        file: The file.
        trajectory: The trajectory.
        arm: The arm, with bodies.
        period: Time between rows; the last row is the end [s].
    """
    x = trajectory.sample(period)
    torque = arm.torque(x.q, x.dq, x.ddq)
    write_pieces(file, csv_pieces(*joint_columns(x.t, arm.joint_names, torque=torque)))
