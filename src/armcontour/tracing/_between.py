"""Compiled check of quintics between exact knots: how far they take the tool off its path."""

from __future__ import annotations

import math

import numpy as np

from armcontour._checks import FloatArray
from armcontour._kernels import compiled
from armcontour._quintics import ROUNDING
from armcontour.arms._chain import write_kinematics


@compiled(inner=True)
def write_quintic(
    h: float,
    q0: float,
    d0: float,
    c0: float,
    q1: float,
    d1: float,
    c1: float,
    j: int,
    out: FloatArray,
) -> None:
    """Write the quintic of one joint into column j of `out`, (6, dof), as `_quintics.quintic`."""
    a1, a2 = d0 * h, c0 * (h * h) / 2
    value = q1 - q0 - a1 - a2
    slope = d1 * h - a1 - 2 * a2
    bend = c1 * (h * h) - 2 * a2
    out[0, j], out[1, j], out[2, j] = q0, a1, a2
    cubic, quartic = slope - bend / 3, (bend - 2 * slope) / 4
    if abs(value - cubic - quartic) <= ROUNDING * (1 + abs(q0) + abs(q1)):
        out[3, j], out[4, j], out[5, j] = cubic, quartic, 0.0
    else:
        out[3, j] = 10 * value - 4 * slope + bend / 2
        out[4, j] = -15 * value + 7 * slope - bend
        out[5, j] = 6 * value - 3 * slope + bend / 2


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
def errors_between(
    rotations: FloatArray,
    positions: FloatArray,
    axes: FloatArray,
    base: FloatArray,
    end: FloatArray,
    width: FloatArray,
    first: FloatArray,
    last: FloatArray,
    places: FloatArray,
    targets: FloatArray,
    task: int,
    tolerance: float,
    angular: float,
) -> tuple[FloatArray, FloatArray]:
    """The largest error of the tool on quintics between knots, and joint positions on them.

    Args:
        rotations: Rotations of the joint frames, (dof, 3, 3).
        positions: Positions of the joint frames [m], (dof, 3).
        axes: Joint axes in the joint frames, (dof, 3).
        base: Base in the work frame, (3, 4).
        end: Tool in the frame of the last link, (3, 4).
        width: Lengths of the intervals [m], (n,).
        first: q, dq_ds and d2q_ds2 at the starts of the intervals, (3, n, dof).
        last: The same at their ends, (3, n, dof).
        places: Shares of an interval at which the tool is compared, (places,).
        targets: Poses of the tool there, all intervals at the first place before those at the
            second, (places n, 3, 4).
        task: Task dimension: 6, 5 or 3.
        tolerance: Largest distance of the tool from its place [m].
        angular: Largest angle of the tool from its orientation [rad].

    Returns:
        The errors over their tolerances, (n,), and joint positions, (places, n, dof).
    """
    n, dof = first.shape[1], first.shape[2]
    errors, q = np.zeros(n), np.empty((len(places), n, dof))
    origins, directions = np.empty((dof, 3)), np.empty((dof, 3))
    pose, c = np.empty((3, 4)), np.empty((6, dof))
    for i in range(n):
        for j in range(dof):
            write_quintic(
                width[i],
                first[0, i, j],
                first[1, i, j],
                first[2, i, j],
                last[0, i, j],
                last[1, i, j],
                last[2, i, j],
                j,
                c,
            )
        for p in range(len(places)):
            for j in range(dof):
                value, power = 0.0, 1.0
                for k in range(6):
                    value += power * c[k, j]
                    power *= places[p]
                q[p, i, j] = value
            here = q[p, i]
            write_kinematics(rotations, positions, axes, base, end, here, origins, directions, pose)
            error = tool_error(pose, targets[p * n + i], task, tolerance, angular)
            if not error <= errors[i]:
                errors[i] = error
    return errors, q
