"""`Conventional`: uniform tool speed, with which the paper compares its method in Sec. IV."""

from __future__ import annotations

import numpy as np

from armcontour.core.fields import declared
from armcontour.motion import JointPath, LawPhase, Method, Trajectory
from armcontour.paper.laws import law_peaks, path_law, require_speed, tool_path_of
from armcontour.planning import PlanOptions
from armcontour.planning.law_checks import check_limits
from armcontour.robot import Arm, Limits

# Limits that the conventional method ignores.
IGNORED = (
    "speed",
    "centripetal_acceleration",
    "joint_velocity",
    "joint_acceleration",
    "tool_acceleration",
)


@declared(eq=False)
class Conventional(PlanOptions):
    """Options of the method "conventional", uniform tool speed: those of `PlanOptions`.

    >>> straight = ac.Path.polyline([(0.30, 0.20), (0.33, 0.20)])
    >>> ac.plan(straight, arm, limits, ac.Conventional()).method
    <Method.CONVENTIONAL: 'conventional'>
    """

    method = Method.CONVENTIONAL
    passes_corners = True
    ignores_joint_limits = True

    def time(self, joint_path: JointPath, arm: Arm, limits: Limits) -> Trajectory:
        """Plan the motion along a contour at uniform tool speed."""
        return plan_conventional(joint_path, arm, limits)


def plan_conventional(joint_path: JointPath, arm: Arm, limits: Limits) -> Trajectory:
    """Plan uniform tool speed from start to end, without regard to the joint limits.

    Velocities jump at corners and at both ends. Joint velocity and acceleration are not checked, as
    in Sec. IV of the paper. Limits of torque and of angular motion are checked between the jumps.
    """
    path = tool_path_of(joint_path, "conventional")
    speeds = np.fmin(path.speeds, require_speed(limits, "conventional"))
    law = path_law(joint_path, path.breaks, speeds, speeds)
    check_limits(
        [law],
        arm,
        limits,
        ignored=IGNORED,
        location="At uniform speed along the path",
        t=0.0,
        remedy="Reduce the assigned velocity, or plan by the method optimal",
    )
    stretch = LawPhase(
        name="whole path",
        kind="uniform",
        t=(0.0, float(law.breaks[-1])),
        s=(0.0, path.length),
        **law_peaks([law], arm),
    )
    return Trajectory(laws=(law,), method=Method.CONVENTIONAL, path=path, stretches=(stretch,))
