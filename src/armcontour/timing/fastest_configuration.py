"""Choice of the configuration in which an arm completes a path in the least time."""

from __future__ import annotations

import numpy.typing as npt

from armcontour.arms import Arm, Limits
from armcontour.errors import ArmContourError
from armcontour.geometry import Path
from armcontour.motion import JointPath
from armcontour.timing.optimal import plan_optimal
from armcontour.tracing import trace_all

# Configurations are compared by coarse plans with about this many grid intervals.
ROUGHLY = 400


def trace_fastest(
    path: Path,
    arm: Arm,
    limits: Limits | None = None,
    *,
    branch: str | None = None,
    start: npt.ArrayLike | None = None,
) -> JointPath:
    """Trace a path in the configuration whose optimal plan takes the least time.

    Args:
        path: A tool path.
        arm: The arm.
        limits: Limits, including the joint ranges, without those of jerk; by default the arm's own.
        branch: For an arm in the plane: the branch, as in `trace`, which leaves no choice.
        start: For an arm in space: joint positions near the required start [rad], (dof,).

    Raises:
        Unreachable: No configuration completes the path.
        InvalidInput: The path does not fit the arm.
    """
    bounds = (arm.limits if limits is None else limits).for_joints(arm.dof)
    # Limits of jerk cost much time here, and favour no configuration.
    rough = bounds.without_jerk
    found = trace_all(path, arm, limits=bounds, branch=branch, start=start)
    if len(found) == 1:
        return found[0]
    best, least = found[0], float("inf")
    for joint_path in found:
        try:
            duration = plan_optimal(joint_path, arm, rough, intervals=ROUGHLY).duration
        except ArmContourError:
            # If no configuration can be planned, the plan of the first one raises the reason.
            continue
        if duration < least:
            best, least = joint_path, duration
    return best
