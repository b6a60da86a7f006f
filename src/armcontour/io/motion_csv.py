"""Motions as CSV text: taught data, planned trajectories, torques."""

from __future__ import annotations

from collections.abc import Sequence

from armcontour._checks import FloatArray
from armcontour.arms import Arm
from armcontour.io.exports.text import csv_text
from armcontour.motion import TaughtData, Trajectory


def taught_csv(taught: TaughtData, joint_names: Sequence[str]) -> str:
    """Taught data as CSV: a header with units, then t and q of every joint."""
    return _csv([f"{name} [rad]" for name in joint_names], [taught.t, taught.q])


def planned_csv(trajectory: Trajectory, period: float, joint_names: Sequence[str] = ()) -> str:
    """The realizable trajectory as CSV: t, then q, dq and ddq of every joint.

    Args:
        trajectory: The trajectory.
        period: Time between rows; the last row is the end [s].
        joint_names: Names of the joints; numbers by default, and where a name is but a number.
    """
    x = trajectory.sample(period)
    called = [name.removeprefix("joint ") for name in joint_names]
    names = [
        f"{quantity} {name} [{unit}]"
        for quantity, unit in (("q", "rad"), ("dq", "rad/s"), ("ddq", "rad/s^2"))
        for name in called or range(1, trajectory.dof + 1)
    ]
    return _csv(names, [x.t, x.q, x.dq, x.ddq])


def torque_csv(trajectory: Trajectory, arm: Arm, period: float) -> str:
    """Torques of the realizable trajectory as CSV: t, then the torque of every joint's drive.

    Args:
        trajectory: The trajectory.
        arm: The arm, with bodies.
        period: Time between rows; the last row is the end [s].
    """
    x = trajectory.sample(period)
    return _csv([f"{name} [N m]" for name in arm.joint_names], [x.t, arm.torque(x.q, x.dq, x.ddq)])


def _csv(names: Sequence[str], columns: Sequence[FloatArray]) -> str:
    return csv_text(["t [s]", *names], columns)
