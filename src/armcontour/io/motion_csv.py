"""Write taught data, planned trajectories and torques as CSV."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path as FilePath

from armcontour.arms import Arm
from armcontour.io.exports.text import csv_pieces, joint_columns, write_pieces
from armcontour.motion import Samples, TaughtData


def write_taught(file: FilePath, taught: TaughtData, joint_names: Sequence[str]) -> None:
    """Write taught data as CSV: t, then q of every joint."""
    write_pieces(file, csv_pieces(*joint_columns(taught.t, joint_names, q=taught.q)))


def write_planned(file: FilePath, x: Samples, joint_names: Sequence[str] = ()) -> None:
    """Write the realizable trajectory as CSV: t, then q, dq and ddq of every joint.

    Args:
        file: The file.
        x: Samples of the trajectory; the last row is the end.
        joint_names: Names of the joints; numbers by default.
    """
    names = joint_names or [f"joint {j + 1}" for j in range(x.q.shape[1])]
    write_pieces(file, csv_pieces(*joint_columns(x.t, names, q=x.q, dq=x.dq, ddq=x.ddq)))


def write_torque(file: FilePath, x: Samples, arm: Arm) -> None:
    """Write torques of the realizable trajectory as CSV: t, then the torque of every drive.

    Args:
        file: The file.
        x: Samples of the trajectory; the last row is the end.
        arm: The arm, with bodies.
    """
    torque = arm.torque(x.q, x.dq, x.ddq)
    write_pieces(file, csv_pieces(*joint_columns(x.t, arm.joint_names, torque=torque)))
