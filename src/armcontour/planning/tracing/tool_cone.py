"""Joint paths along which the tool leans within a cone around the required tool axis.

The tool point stays exactly on the path. Both directions in which the tool leans and its rotation
about its axis are null-space motions of the task "position" (task dimension 3), which smoothing
chooses; `PostureCost` has a cost for an angle near the cone.
"""

from __future__ import annotations

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import Unreachable
from armcontour.core.frames import angle_between
from armcontour.core.quintics import to_bernstein
from armcontour.geometry import Orientation, Path
from armcontour.motion import JointPath
from armcontour.motion.derivative_bounds import joint_travel
from armcontour.planning.tracing.angle_check import find_excess
from armcontour.robot import SerialArm

# Relative allowance for the rounding of angles that are compared with the cone.
CONE_ROUNDING = 1e-9
# Number of points per interval of a joint path at which the largest angle is searched.
POINTS_PER_INTERVAL = 5


def cone_of(path: Path) -> float:
    """Return the largest angle between tool axis and required axis that a path allows [rad]."""
    return 0.0 if path.orientation is None else path.orientation.cone


def lean_angles(joint_path: JointPath, arm: SerialArm, s: FloatArray) -> FloatArray:
    """Return the angles between the tool axis and the required one [rad], (n,).

    - `joint_path`: joint path along a tool path with an orientation.
    - `s`: arc lengths [m], (n,).
    """
    path = joint_path.tool_path
    assert path is not None and path.orientation is not None
    tool_axis = arm.poses(joint_path(s))[:, :, 2]
    return np.asarray(angle_between(tool_axis, path.orientation(s)[:, :, 2]))


def largest_lean(joint_path: JointPath, arm: SerialArm) -> float:
    """Return the largest angle between the tool axis and the required one at many points [rad]."""
    places = np.linspace(0.0, 1.0, POINTS_PER_INTERVAL, endpoint=False)
    inner = joint_path.breaks[:-1, None] + np.diff(joint_path.breaks)[:, None] * places
    s = np.append(inner.ravel(), joint_path.breaks[-1])
    return float(lean_angles(joint_path, arm, s).max())


def check_cone(joint_path: JointPath, arm: SerialArm, cone: float) -> None:
    """Raise Unreachable where the tool leans more than a cone, at any point of the path.

    - `joint_path`: joint path along a tool path with an orientation.
    - `cone`: largest angle allowed [rad].
    """
    path = joint_path.tool_path
    assert path is not None and path.orientation is not None
    # The angle changes at most by the travel of the joints and by the turn of the required axis.
    breaks, travel = joint_travel(joint_path)
    turned = (travel * ~arm.chain.slides).sum(axis=1)
    s = np.union1d(breaks, path.orientation.breaks)
    s = s[(s >= breaks[0]) & (s <= breaks[-1])]
    change = np.interp(s, breaks, turned) + np.interp(
        s, path.orientation.breaks, _turn_bounds(path.orientation)
    )
    excess = find_excess(
        s, change, lambda x: lean_angles(joint_path, arm, x), cone * (1 + CONE_ROUNDING)
    )
    if excess is not None:
        raise Unreachable(
            f"At {excess.s:.6g} m along the path the tool axis would be "
            f"{np.degrees(excess.angle):.4g} deg from the required one, but at most "
            f"{np.degrees(cone):.4g} deg are allowed. Allow a larger cone, or move the path or the "
            "arm.",
            point=path(excess.s).tolist(),
            s=excess.s,
            limit="cone",
            needed=excess.angle,
            allowed=cone,
        )


def _turn_bounds(orientation: Orientation) -> FloatArray:
    """Bound the turn of an orientation from its start to each of its breaks [rad], (n + 1,)."""
    width = np.diff(orientation.breaks)
    turn = np.zeros(len(width))
    for rotation, polynomial in (("first", "f"), ("second", "g"), ("third", "h")):
        coefficients = getattr(orientation, polynomial)
        order = np.arange(1, coefficients.shape[1])
        # The derivative over the fraction of the piece is within the hull of its Bernstein
        # coefficients.
        slopes = coefficients[:, 1:] * order * width[:, None] ** order
        hull = slopes @ to_bernstein(len(order) - 1).T
        turn += np.abs(hull).max(axis=1) * np.linalg.norm(getattr(orientation, rotation), axis=1)
    return np.append(0.0, np.cumsum(turn))
