"""Drive torques and angular tool speeds of a run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour._checks import FloatArray
from armcontour.arms import Arm, SerialArm
from armcontour.core.fields import Checked
from armcontour.motion import Execution, Trajectory

# Number of times at which torques are computed, in addition to the breaks of the plan.
SAMPLES = 4000


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Torques(Checked):
    """Torques of the drives over time.

    Args:
        t: Times [s], (n,).
        values: Torques [N m], (n, dof).
    """

    t: FloatArray
    values: FloatArray

    @property
    def peak(self) -> FloatArray:
        """Largest amount of each joint's torque [N m], (dof,)."""
        return np.asarray(np.abs(self.values).max(axis=0))


def assumed_numbers(arm: Arm) -> str:
    """Which parameters of an arm's bodies are assumed, and by which rule; empty if none is."""
    return "" if arm.chain is None else arm.chain.assumed


def planned_torques(arm: Arm, plan: Trajectory) -> Torques | None:
    """Torques of a plan over time; None if the arm has no bodies.

    Every time appears twice, with the torques before and after a jump.
    """
    if not arm.has_bodies:
        return None
    t = np.union1d(np.linspace(0, plan.duration, SAMPLES), plan.breaks)
    # The first time has no left side, the last time has no right side.
    left = torques_at(arm, plan, t[1:], side="left")
    right = torques_at(arm, plan, t[:-1])
    values = np.empty((2 * len(left), arm.dof))
    values[::2], values[1::2] = right, left
    return Torques(t=np.repeat(t, 2)[1:-1], values=values)


def applied_torques(executed: Execution) -> Torques | None:
    """Torques of the drives in an experiment; None if it has none."""
    return None if executed.torque is None else Torques(t=executed.t, values=executed.torque)


def torques_at(arm: Arm, plan: Trajectory, t: FloatArray, *, side: str = "right") -> FloatArray:
    """Torques of a plan at the times t [s], (n,); returns (n, dof) [N m]."""
    return arm.torque(*(plan(t, order, side=side) for order in (0, 1, 2)))


def angular_speed(execution: Execution) -> FloatArray | None:
    """Angular speed of the tool [rad/s], (n,); None for a planar arm."""
    if not isinstance(execution.arm, SerialArm):
        return None
    twist = execution.arm.tool_twist(execution.q, execution.dq)
    return np.asarray(np.linalg.norm(twist[:, 3:], axis=1))
