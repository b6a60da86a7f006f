"""What a plan takes of its limits at any time: proven, where a check looks at some times only."""

from __future__ import annotations

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.geometry import ShapedPath
from armcontour.motion import (
    JointPath,
    PathLaw,
    Trajectory,
    largest_shares,
)
from armcontour.robot import Arm, Limits
from armcontour.verification import check

# A limit is exceeded by a share above 1 and this: rounding.
KEPT = 1e-9
# Places per interval at which a plan is checked against its limits between all samples.
POINTS = 5


def largest_uses(plan: Trajectory, arm: Arm, limits: Limits) -> dict[str, float]:
    """The larger share of each limit: what a check finds, and what is bounded at any time."""
    uses = bound_uses(plan, arm, limits)
    for x in check(plan, arm, limits, points=POINTS).uses:
        uses[x.name] = max(uses.get(x.name, 0.0), x.ratio)
    return uses


def bound_uses(plan: Trajectory, arm: Arm, limits: Limits) -> dict[str, float]:
    """Shares of limits that a plan takes; one of at most 1 + KEPT is not exceeded at any time.

    The tool is taken to be where its path is: limits of the tool are those of the path speed.

    Args:
        plan: Of laws along joint paths.
        arm: The arm.
        limits: The limits.
    """
    joints = np.stack([*limits.acceleration_bounds(arm.dof), *limits.velocity_bounds(arm.dof)])
    found = np.zeros(6)
    for law in plan.laws:
        assert isinstance(law, PathLaw)
        speeds = _highest_speeds(law.joint_path, limits)
        found = np.maximum(found, largest_shares(law, joints, speeds, 1 + KEPT))
    acceleration, velocity = found[:4].reshape(2, 2).max(axis=1).tolist()
    speed, bent = found[4:].tolist()
    return {
        "joint_acceleration": acceleration,
        "joint_velocity": velocity,
        "speed": speed,
        "centripetal_acceleration": bent**2,
    }


def _highest_speeds(joint_path: JointPath, limits: Limits) -> FloatArray:
    """Path speeds that limits of speed and of centripetal acceleration allow, (pieces, 2).

    Where the curvature varies along a segment, as on shaped paths and transitions, the latter is
    not bounded here: a check looks at places there.
    """
    breaks, path = joint_path.breaks, joint_path.tool_path
    found = np.full((len(breaks) - 1, 2), np.inf)
    if path is None:
        return found
    # Breaks of the tool path are breaks of the joint path.
    segment = path.locate(np.clip((breaks[:-1] + breaks[1:]) / 2, 0.0, path.length))
    found[:, 0] = np.fmin(path.speeds[segment], np.inf if limits.speed is None else limits.speed)
    varies = path.segments.bent[segment] | (isinstance(path, ShapedPath) and path.curve is not None)
    if limits.centripetal_acceleration is not None:
        bent = np.where(varies, 0.0, np.abs(path.curvatures[segment]))
        with np.errstate(divide="ignore"):
            found[:, 1] = np.sqrt(limits.centripetal_acceleration / bent)
    return found
