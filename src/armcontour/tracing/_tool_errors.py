"""Compiled errors of the tool: how far joint positions take it off its path."""

from __future__ import annotations

import math

import numpy as np

from armcontour._checks import FloatArray
from armcontour._kernels import compiled
from armcontour.arms._chain import write_kinematics


@compiled(inner=True)
def tool_error(
    pose: FloatArray, target: FloatArray, task: int, tolerance: float, angular: float
) -> float:
    """Larger of position error and orientation error from a target, (3, 4), over its tolerance."""
    square = 0.0
    for i in range(3):
        square += (pose[i, 3] - target[i, 3]) ** 2
    error = math.sqrt(square) / tolerance
    if task == 3:
        return error
    square = 0.0
    for i in range(3):
        for j in range(2 if task == 5 else 0, 3):
            square += (pose[i, j] - target[i, j]) ** 2
    angle = math.sqrt(square) if task == 5 else math.sqrt(square) / math.sqrt(2.0)
    # Not a number stays what it is.
    return error if error != error or error >= angle / angular else angle / angular


@compiled()
def tool_errors(
    rotations: FloatArray,
    positions: FloatArray,
    axes: FloatArray,
    base: FloatArray,
    end: FloatArray,
    q: FloatArray,
    targets: FloatArray,
    task: int,
    tolerance: float,
    angular: float,
) -> FloatArray:
    """Errors of the tool at joint positions, over their tolerances, (n,).

    Args:
        rotations: Rotations of the joint frames, (dof, 3, 3).
        positions: Positions of the joint frames [m], (dof, 3).
        axes: Joint axes in the joint frames, (dof, 3).
        base: Base in the work frame, (3, 4).
        end: Tool in the frame of the last link, (3, 4).
        q: Joint positions [rad], (n, dof).
        targets: Poses that the tool should have, (n, 3, 4).
        task: Task dimension: 6, 5 or 3.
        tolerance: Largest distance of the tool from its place [m].
        angular: Largest angle of the tool from its orientation [rad].
    """
    n, dof = q.shape
    errors = np.empty(n)
    origins, directions, pose = np.empty((dof, 3)), np.empty((dof, 3)), np.empty((3, 4))
    for i in range(n):
        write_kinematics(rotations, positions, axes, base, end, q[i], origins, directions, pose)
        errors[i] = tool_error(pose, targets[i], task, tolerance, angular)
    return errors
