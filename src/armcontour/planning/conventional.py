"""The conventional method that the paper compares with: uniform speed along the raw path."""

from __future__ import annotations

from armcontour.motion import JointPath, LawPhase, Method, Trajectory
from armcontour.planning.common import (
    check_kept,
    law_peaks,
    path_law,
    require_speed,
    segment_speeds,
    tool_path_of,
)
from armcontour.robot import Arm, Limits


def plan_conventional(joint_path: JointPath, arm: Arm, limits: Limits) -> Trajectory:
    """Plan uniform tool speed from the first instant to the last, whatever the joint limits.

    Velocities jump at corners and at both ends. Limits of joint velocity and acceleration are not
    checked, as in Sec. IV of the paper. Limits of torque and of angular motion are checked between
    the jumps.

    Raises:
        InvalidInput: The limits have no assigned velocity.
        NotRealizable: A torque or the angular motion of the tool would break its limit.
    """
    path = tool_path_of(joint_path, "conventional")
    speeds = segment_speeds(path, require_speed(limits, "conventional"))
    law = path_law(joint_path, path.breaks, speeds, speeds)
    check_kept(
        [law],
        arm,
        limits,
        ("joint_torque", "angular_speed", "angular_acceleration"),
        where="At uniform speed along the path",
        t=0.0,
        mends="a lower assigned velocity or the method optimal helps",
    )
    stretch = LawPhase(
        name="whole path",
        kind="uniform",
        t=(0.0, float(law.breaks[-1])),
        s=(0.0, path.length),
        **law_peaks([law], arm),
    )
    return Trajectory(laws=(law,), method=Method.CONVENTIONAL, path=path, stretches=(stretch,))
