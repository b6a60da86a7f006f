"""Compiled kinematics of a chain: poses, joint axes, Jacobians and bias accelerations."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from armcontour._checks import FloatArray
from armcontour._kernels import compiled


@compiled()
def write_rotation(axis: FloatArray, angle: float, out: FloatArray) -> None:
    """Write the rotation matrix of a turn by `angle` about the unit vector `axis` into `out`."""
    c, s = math.cos(angle), math.sin(angle)
    v = 2.0 * math.sin(0.5 * angle) ** 2
    x, y, z = axis[0], axis[1], axis[2]
    out[0, 0], out[0, 1], out[0, 2] = c + x * x * v, x * y * v - z * s, x * z * v + y * s
    out[1, 0], out[1, 1], out[1, 2] = y * x * v + z * s, c + y * y * v, y * z * v - x * s
    out[2, 0], out[2, 1], out[2, 2] = z * x * v - y * s, z * y * v + x * s, c + z * z * v


@compiled()
def write_product(a: FloatArray, b: FloatArray, out: FloatArray) -> None:
    """Write the product of two 3 by 3 matrices into `out`, which must be a third array."""
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]


@compiled()
def write_kinematics(
    rotations: FloatArray,
    positions: FloatArray,
    axes: FloatArray,
    base: FloatArray,
    end: FloatArray,
    q: FloatArray,
    origins: FloatArray,
    directions: FloatArray,
    pose: FloatArray,
    scratch: FloatArray,
) -> None:
    """Write the joint origins, the joint axes and the tool pose of one state into arrays.

    All results are in the work frame. A pose is a rotation with the position in column 3.

    Args:
        rotations: Rotations of the joint frames at q = 0, each in the frame of the link before,
            (dof, 3, 3).
        positions: Positions of the joint frames, each in the frame of the link before [m],
            (dof, 3).
        axes: Joint axes in the joint frames, (dof, 3).
        base: Pose of the base in the work frame, (3, 4).
        end: Pose of the tool in the frame of the last link, (3, 4).
        q: Joint positions [rad], (dof,).
        origins: Output: a point on each joint axis [m], (dof, 3).
        directions: Output: the joint axes, (dof, 3).
        pose: Output: the pose of the tool, (3, 4).
        scratch: Memory for intermediate results, (3, 3, 3).
    """
    here, turn, moved = scratch[0], scratch[1], scratch[2]
    here[:, :] = base[:, :3]
    x, y, z = base[0, 3], base[1, 3], base[2, 3]
    for k in range(len(q)):
        p = positions[k]
        x += here[0, 0] * p[0] + here[0, 1] * p[1] + here[0, 2] * p[2]
        y += here[1, 0] * p[0] + here[1, 1] * p[1] + here[1, 2] * p[2]
        z += here[2, 0] * p[0] + here[2, 1] * p[1] + here[2, 2] * p[2]
        write_product(here, rotations[k], moved)
        origins[k, 0], origins[k, 1], origins[k, 2] = x, y, z
        a = axes[k]
        for i in range(3):
            directions[k, i] = moved[i, 0] * a[0] + moved[i, 1] * a[1] + moved[i, 2] * a[2]
        write_rotation(a, q[k], turn)
        write_product(moved, turn, here)
    for i in range(3):
        for j in range(3):
            pose[i, j] = here[i, 0] * end[0, j] + here[i, 1] * end[1, j] + here[i, 2] * end[2, j]
    for i in range(3):
        along = here[i, 0] * end[0, 3] + here[i, 1] * end[1, 3] + here[i, 2] * end[2, 3]
        pose[i, 3] = along + (x if i == 0 else y if i == 1 else z)


@compiled()
def write_jacobian(
    origins: FloatArray, directions: FloatArray, pose: FloatArray, out: FloatArray
) -> None:
    """Write the geometric Jacobian of the tool of one state into `out`, (6, dof).

    Rows 0 to 2 are of the velocity, rows 3 to 5 of the angular velocity.
    """
    for k in range(len(origins)):
        a = directions[k]
        x, y, z = (
            pose[0, 3] - origins[k, 0],
            pose[1, 3] - origins[k, 1],
            pose[2, 3] - origins[k, 2],
        )
        out[0, k] = a[1] * z - a[2] * y
        out[1, k] = a[2] * x - a[0] * z
        out[2, k] = a[0] * y - a[1] * x
        out[3, k], out[4, k], out[5, k] = a[0], a[1], a[2]


@compiled(inline="always")
def _link(origins: FloatArray, pose: FloatArray, k: int) -> Any:
    """The vector from the origin of joint k to that of the next one, or to the tool point [m]."""
    x, y, z = origins[k, 0], origins[k, 1], origins[k, 2]
    if k + 1 < len(origins):
        return origins[k + 1, 0] - x, origins[k + 1, 1] - y, origins[k + 1, 2] - z
    return pose[0, 3] - x, pose[1, 3] - y, pose[2, 3] - z


@compiled()
def write_bias_acceleration(
    origins: FloatArray, directions: FloatArray, pose: FloatArray, dq: FloatArray, out: FloatArray
) -> None:
    """Write the bias acceleration `dJ/dt dq` of one state into `out`, (6,).

    This is the acceleration and angular acceleration of the tool at ddq = 0. The loop computes
    from link to link the angular velocity, the angular acceleration and the acceleration of the
    next joint's origin.
    """
    w0 = w1 = w2 = 0.0
    e0 = e1 = e2 = 0.0
    a0 = a1 = a2 = 0.0
    for k in range(len(dq)):
        # The link before the joint turns the joint axis, which adds omega x axis dq.
        d = directions[k]
        r0, r1, r2 = d[0] * dq[k], d[1] * dq[k], d[2] * dq[k]
        e0 += w1 * r2 - w2 * r1
        e1 += w2 * r0 - w0 * r2
        e2 += w0 * r1 - w1 * r0
        w0 += r0
        w1 += r1
        w2 += r2
        l0, l1, l2 = _link(origins, pose, k)
        c0, c1, c2 = w1 * l2 - w2 * l1, w2 * l0 - w0 * l2, w0 * l1 - w1 * l0
        a0 += e1 * l2 - e2 * l1 + w1 * c2 - w2 * c1
        a1 += e2 * l0 - e0 * l2 + w2 * c0 - w0 * c2
        a2 += e0 * l1 - e1 * l0 + w0 * c1 - w1 * c0
    out[0], out[1], out[2], out[3], out[4], out[5] = a0, a1, a2, e0, e1, e2


@compiled()
def poses(
    rotations: FloatArray,
    positions: FloatArray,
    axes: FloatArray,
    base: FloatArray,
    end: FloatArray,
    q: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Tool poses, (n, 3, 4), and origins and axes of all joints, (n, dof, 3) each.

    The arguments are those of `write_kinematics`, with q as (n, dof).
    """
    n, dof = q.shape
    found = np.empty((n, 3, 4))
    origins, directions = np.empty((n, dof, 3)), np.empty((n, dof, 3))
    scratch = np.empty((3, 3, 3))
    for i in range(n):
        write_kinematics(
            rotations,
            positions,
            axes,
            base,
            end,
            q[i],
            origins[i],
            directions[i],
            found[i],
            scratch,
        )
    return found, origins, directions


@compiled()
def jacobians(origins: FloatArray, directions: FloatArray, pose: FloatArray) -> FloatArray:
    """Geometric Jacobians of all states, (n, 6, dof), from the results of `poses`."""
    n, dof = origins.shape[0], origins.shape[1]
    out = np.empty((n, 6, dof))
    for i in range(n):
        write_jacobian(origins[i], directions[i], pose[i], out[i])
    return out
