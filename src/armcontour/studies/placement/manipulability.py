"""How well an arm moves its tool in all directions that a task asks for."""

from __future__ import annotations

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.robot import Arm, SerialArm


def least_singular_value(arm: Arm, q: FloatArray, task: int) -> float:
    """The least singular value of the tool's motion per motion of the joints, over some postures.

    Its rows are the velocity of the tool point [m/rad] and, where the task asks for an orientation,
    the angular velocity [rad/rad]: along and about all axes for the task 6, without turning about
    the tool axis for 5. It is 0 in a singularity.

    Args:
        arm: The arm.
        q: Joint positions [rad], (n, dof).
        task: Task dimension: 6, 5 or 3; 2 for an arm in the plane.
    """
    if not isinstance(arm, SerialArm) or task == 3:
        rows = arm.tool_jacobian(q)
    else:
        rows = arm.jacobian(q)
        if task == 5:
            # Turning about x and y of the tool.
            _, turned = arm.pose(q)
            across = np.swapaxes(turned[:, :, :2], 1, 2) @ rows[:, 3:]
            rows = np.concatenate([rows[:, :3], across], axis=1)
    return float(np.linalg.svd(rows, compute_uv=False)[:, -1].min())
