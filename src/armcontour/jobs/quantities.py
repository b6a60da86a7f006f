"""What a run came to beyond its evaluation: torques, and how the tool turns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour import _checks
from armcontour._checks import FloatArray
from armcontour.arms import Arm, SerialArm
from armcontour.jobs.study import ExperimentResult, RunResult
from armcontour.motion import Execution, Trajectory

# Times at which a plan is looked at, beside its breaks.
PLACES = 4000


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Torques:
    """Torques of the drives over time.

    Args:
        t: Times [s], (n,).
        values: (n, dof) [N m].
    """

    t: FloatArray
    values: FloatArray

    def __post_init__(self) -> None:
        for name in ("t", "values"):
            object.__setattr__(self, name, _checks.lock_floats(getattr(self, name)))

    @property
    def peak(self) -> FloatArray:
        """Largest amount of each joint's torque [N m], (dof,)."""
        return np.asarray(np.abs(self.values).max(axis=0))


def assumed_numbers(arm: Arm) -> str:
    """Which numbers of an arm's bodies are assumed, and by what rule; empty if none."""
    return "" if arm.chain is None else arm.chain.assumed


def planned_torques(result: RunResult) -> Torques | None:
    """Torques that the plan takes; where they jump, both sides. None without bodies."""
    arm, plan = result.execution.arm, result.trajectory
    if not arm.has_bodies:
        return None
    t = np.union1d(np.linspace(0, plan.duration, PLACES), plan.breaks)
    # At the ends there is one side only.
    left = torques_at(arm, plan, t[1:], side="left")
    right = torques_at(arm, plan, t[:-1])
    values = np.empty((2 * len(left), arm.dof))
    values[::2], values[1::2] = right, left
    return Torques(t=np.repeat(t, 2)[1:-1], values=values)


def applied_torques(experiment: ExperimentResult) -> Torques | None:
    """Torques that the drives gave in an experiment."""
    done = experiment.execution
    return None if done.torque is None else Torques(t=done.t, values=done.torque)


def torques_at(arm: Arm, plan: Trajectory, t: FloatArray, *, side: str = "right") -> FloatArray:
    """Torques of a plan at some times, (n, dof) [N m]."""
    return arm.torque(*(plan(t, order, side=side) for order in (0, 1, 2)))


def angular_speed(execution: Execution) -> FloatArray | None:
    """Rate at which the tool turned [rad/s], (n,); None for an arm in the plane."""
    if not isinstance(execution.arm, SerialArm):
        return None
    twist = execution.arm.tool_twist(execution.q, execution.dq)
    return np.asarray(np.linalg.norm(twist[:, 3:], axis=1))
