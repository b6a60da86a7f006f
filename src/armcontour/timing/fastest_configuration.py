"""Of all configurations that complete a path, the one that does so fastest."""

from __future__ import annotations

import numpy.typing as npt

from armcontour.arms import Arm, Limits
from armcontour.errors import ArmContourError
from armcontour.geometry import Path
from armcontour.motion import JointPath
from armcontour.timing.optimal import plan_optimal
from armcontour.tracing import trace_all

# Configurations are compared by plans on a grid of about so many intervals.
ROUGHLY = 400


def trace_fastest(
    path: Path,
    arm: Arm,
    limits: Limits | None = None,
    *,
    branch: str | None = None,
    start: npt.ArrayLike | None = None,
) -> JointPath:
    """The joint path of the configuration whose optimal plan takes the least time.

    Args:
        path: A tool path.
        arm: The arm.
        limits: They rule the ranges of the joints too; by default the arm's own.
        branch: For an arm in the plane: the branch, as in `trace`; there is nothing to choose then.
        start: For an arm in space: joint positions near to those to start in.

    Raises:
        Unreachable: No configuration completes the path.
        InvalidInput: A path that does not fit the arm.
    """
    bounds = (arm.limits if limits is None else limits).for_joints(arm.dof)
    found = trace_all(path, arm, limits=bounds, branch=branch, start=start)
    if len(found) == 1:
        return found[0]
    best, least = found[0], float("inf")
    for joint_path in found:
        try:
            duration = plan_optimal(joint_path, arm, bounds, intervals=ROUGHLY).duration
        except ArmContourError:
            # If none can be planned so, the plan of the first says why.
            continue
        if duration < least:
            best, least = joint_path, duration
    return best
