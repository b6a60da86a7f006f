"""Evaluation: how far the tool was from the path, how fast, and what the joints had to give.

Shares only geometry and arms with what it judges.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour import _checks
from armcontour._checks import FloatArray
from armcontour.arms import Limits
from armcontour.arms.limits import or_unlimited
from armcontour.evaluation.corners import CornerDeviation, corner_deviations
from armcontour.evaluation.error_profile import ErrorProfile
from armcontour.geometry import Path
from armcontour.motion import Execution

# The tool is at rest below this speed [m/s].
REST_SPEED = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Evaluation:
    """What an execution was worth.

    Args:
        duration: Planned time of the motion [s].
        settled: Time after which the tool stays below 1 mm/s [s].
        until: End of the time that the errors cover [s].
        contour_error: Distance from the tool to the path [m].
        tracking_error: Distance from the tool to where it should be at that time [m].
        objective_error: Distance from the tool to the objective path, if one was given [m].
        corners: Cornering deviations (ISO 9283, 8.5) at the corners of the objective path.
        speed: Largest tool speed [m/s].
        speed_ratio: The same over the assigned velocity; NaN without one.
        demand: Largest acceleration that each joint was asked for [rad/s²], (dof,).
        demand_ratio: The same over its limit; 0 for a joint without one, (dof,).
        saturated: Share of the time for which each joint was saturated, (dof,).
    """

    duration: float
    settled: float
    until: float
    contour_error: ErrorProfile
    tracking_error: ErrorProfile
    objective_error: ErrorProfile | None
    corners: tuple[CornerDeviation, ...]
    speed: float
    speed_ratio: float
    demand: FloatArray
    demand_ratio: FloatArray
    saturated: FloatArray

    def __post_init__(self) -> None:
        for name in ("demand", "demand_ratio", "saturated"):
            object.__setattr__(self, name, _checks.locked(getattr(self, name)))


def evaluate(
    executed: Execution,
    path: Path,
    *,
    objective: Path | None = None,
    limits: Limits | None = None,
    until: float | None = None,
) -> Evaluation:
    """Judge an execution against the path that it was to follow.

    Errors are weighted by time, from 0 to `until`; behind its end the execution stands still.

    Args:
        executed: What the joints did.
        path: The path that the tool was to follow.
        objective: The path before rounding; gives `objective_error` and the corners.
        limits: By default the arm's own.
        until: End of the time that errors cover [s]; by default when the planned motion has ended
            and the tool is at rest.

    Raises:
        InvalidInput: A path of another dimension than the arm's, or a time that is not above zero.
    """
    bounds = (executed.arm.limits if limits is None else limits).for_joints(executed.arm.dof)
    t, tool, speed = executed.t, executed.tool, executed.tool_speed
    moving = np.flatnonzero(speed > REST_SPEED)
    settled = float(t[moving[-1]]) if len(moving) else 0.0
    trajectory = executed.taught.trajectory
    end = (
        max(trajectory.duration, settled)
        if until is None
        else _checks.positive("until", until, "s")
    )

    found = path.project(tool)
    planned = executed.arm.forward(trajectory(np.minimum(t, trajectory.duration)))
    off_objective = None if objective is None else objective.project(tool)
    allowed = or_unlimited(bounds.joint_acceleration, executed.arm.dof)
    return Evaluation(
        duration=trajectory.duration,
        settled=settled,
        until=end,
        contour_error=ErrorProfile.over_time(t, found.distance, found.s, end),
        tracking_error=ErrorProfile.over_time(
            t, np.linalg.norm(tool - planned, axis=1), found.s, end
        ),
        objective_error=(
            None
            if off_objective is None
            else ErrorProfile.over_time(t, off_objective.distance, off_objective.s, end)
        ),
        corners=() if objective is None else corner_deviations(tool[t <= end], objective),
        speed=float(speed.max()),
        speed_ratio=float(speed.max()) / (np.nan if bounds.speed is None else bounds.speed),
        demand=executed.peak_demand,
        demand_ratio=executed.peak_demand / allowed,
        saturated=executed.saturated_time / max(end, float(t[-1])),
    )
