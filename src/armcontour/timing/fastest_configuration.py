"""Choice of the configuration in which an arm completes a path in the least time."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from armcontour.arms import Arm, Limits
from armcontour.arms.limits import or_unlimited
from armcontour.errors import ArmContourError
from armcontour.geometry import Path
from armcontour.motion import JointPath
from armcontour.timing._least_duration import least_duration
from armcontour.timing.optimal import plan_optimal
from armcontour.tracing import trace_all

# Configurations are compared by coarse plans with about this many grid intervals.
ROUGHLY = 400
# A configuration is not planned if this share of its lower bound exceeds a plan: the bound keeps
# limits at points, and may miss what happens between them.
SURE = 0.998


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
    at_least = [bound_duration(x, rough) for x in found]
    best, least = 0, float("inf")
    for i in np.argsort(at_least, kind="stable"):
        if SURE * at_least[i] > least:
            break
        try:
            duration = plan_optimal(found[i], arm, rough, intervals=ROUGHLY).duration
        except ArmContourError:
            # If no configuration can be planned, the plan of the first one raises the reason.
            continue
        # Among equals the first one counts, whichever was planned first.
        if duration < least or (duration == least and i < best):
            best, least = int(i), duration
    return found[best]


def bound_duration(joint_path: JointPath, limits: Limits) -> float:
    """A duration that no motion from rest to rest along a joint path falls below [s].

    It takes account of the joints' velocities and accelerations, the tool's speed and, on arcs, its
    centripetal acceleration; torques and all other limits are left out.

    Args:
        joint_path: A traced path.
        limits: The limits.
    """
    breaks, dof = joint_path.breaks, joint_path.dof
    rests = np.isin(breaks, joint_path.stops)
    rests[[0, -1]] = True
    ceilings = np.full(len(breaks) - 1, np.inf)
    path = joint_path.tool_path
    if path is not None:
        segment = path.locate((breaks[:-1] + breaks[1:]) / 2)
        speed = np.inf if limits.speed is None else limits.speed
        across = [limits.centripetal_acceleration, limits.tool_acceleration]
        most = min((x for x in across if x is not None), default=np.inf)
        bend = np.where(path.segments.bent, 0.0, path.curvatures)
        with np.errstate(divide="ignore"):
            ceilings = np.minimum(np.fmin(path.speeds, speed) ** 2, most / bend)[segment]
    velocity = or_unlimited(limits.joint_velocity, dof)
    low, high = (np.array(x) for x in limits.acceleration_bounds(dof))
    return float(
        least_duration(breaks, joint_path.coefficients, rests, ceilings, velocity, low, high)
    )
