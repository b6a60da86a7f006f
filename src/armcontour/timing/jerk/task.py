"""What is asked of a plan with limits of jerk."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour._checks import FloatArray
from armcontour.arms import Arm, Limits
from armcontour.arms.limits import or_unlimited
from armcontour.timing.constraints import Constraint

# Largest number of iterations of each pass.
MOST_ITERATIONS = 150


@dataclass(frozen=True, slots=True)
class JerkLimits:
    """Limits of jerk, infinite where there is none.

    Args:
        joint: Of each joint [rad/s³], (dof,).
        path: Of the arc length [m/s³].
        tool: Of the tool [m/s³].
    """

    joint: FloatArray
    path: float
    tool: float

    @classmethod
    def of(cls, limits: Limits, dof: int) -> JerkLimits | None:
        """The limits of jerk among limits; None if there are none."""
        if limits.joint_jerk is None and limits.path_jerk is None and limits.tool_jerk is None:
            return None
        joint = or_unlimited(limits.joint_jerk, dof)
        path, tool = (np.inf if x is None else x for x in (limits.path_jerk, limits.tool_jerk))
        if not (np.isfinite(joint).any() or np.isfinite([path, tool]).any()):
            return None
        return cls(np.broadcast_to(joint, (dof,)), float(path), float(tool))


@dataclass(frozen=True, slots=True)
class Task:
    """A planning problem with limits of jerk.

    Args:
        arm: The arm.
        active: The constraints of the planner without jerk.
        jerk: The limits of jerk.
        start_speed, end_speed: Path speeds at the start and the end [m/s].
        cells: About so many cells; None for the default.
        iterations: Largest number of iterations of each pass; any number gives a plan that keeps
            all limits.
    """

    arm: Arm
    active: tuple[Constraint, ...]
    jerk: JerkLimits
    start_speed: float = 0.0
    end_speed: float = 0.0
    cells: int | None = None
    iterations: int = MOST_ITERATIONS
