"""Compiled kinematics of a chain: poses, joint axes, Jacobians and bias accelerations."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from armcontour._checks import FloatArray
from armcontour._kernels import compiled


@compiled(inner=True)
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
    """
    # Number by number, as views of small arrays cost more than the arithmetic: a.. is the rotation
    # up to here, m.. the same times the rotation of the next joint frame.
    a00, a01, a02 = base[0, 0], base[0, 1], base[0, 2]
    a10, a11, a12 = base[1, 0], base[1, 1], base[1, 2]
    a20, a21, a22 = base[2, 0], base[2, 1], base[2, 2]
    x, y, z = base[0, 3], base[1, 3], base[2, 3]
    for k in range(len(q)):
        p0, p1, p2 = positions[k, 0], positions[k, 1], positions[k, 2]
        x += a00 * p0 + a01 * p1 + a02 * p2
        y += a10 * p0 + a11 * p1 + a12 * p2
        z += a20 * p0 + a21 * p1 + a22 * p2
        p0, p1, p2 = rotations[k, 0, 0], rotations[k, 1, 0], rotations[k, 2, 0]
        m00 = a00 * p0 + a01 * p1 + a02 * p2
        m10 = a10 * p0 + a11 * p1 + a12 * p2
        m20 = a20 * p0 + a21 * p1 + a22 * p2
        p0, p1, p2 = rotations[k, 0, 1], rotations[k, 1, 1], rotations[k, 2, 1]
        m01 = a00 * p0 + a01 * p1 + a02 * p2
        m11 = a10 * p0 + a11 * p1 + a12 * p2
        m21 = a20 * p0 + a21 * p1 + a22 * p2
        p0, p1, p2 = rotations[k, 0, 2], rotations[k, 1, 2], rotations[k, 2, 2]
        m02 = a00 * p0 + a01 * p1 + a02 * p2
        m12 = a10 * p0 + a11 * p1 + a12 * p2
        m22 = a20 * p0 + a21 * p1 + a22 * p2
        origins[k, 0], origins[k, 1], origins[k, 2] = x, y, z
        e, f, g = axes[k, 0], axes[k, 1], axes[k, 2]
        directions[k, 0] = m00 * e + m01 * f + m02 * g
        directions[k, 1] = m10 * e + m11 * f + m12 * g
        directions[k, 2] = m20 * e + m21 * f + m22 * g
        # The rotation about the joint axis, column by column.
        c, s = math.cos(q[k]), math.sin(q[k])
        v = 2.0 * math.sin(0.5 * q[k]) ** 2
        p0, p1, p2 = c + e * e * v, f * e * v + g * s, g * e * v - f * s
        a00 = m00 * p0 + m01 * p1 + m02 * p2
        a10 = m10 * p0 + m11 * p1 + m12 * p2
        a20 = m20 * p0 + m21 * p1 + m22 * p2
        p0, p1, p2 = e * f * v - g * s, c + f * f * v, g * f * v + e * s
        a01 = m00 * p0 + m01 * p1 + m02 * p2
        a11 = m10 * p0 + m11 * p1 + m12 * p2
        a21 = m20 * p0 + m21 * p1 + m22 * p2
        p0, p1, p2 = e * g * v + f * s, f * g * v - e * s, c + g * g * v
        a02 = m00 * p0 + m01 * p1 + m02 * p2
        a12 = m10 * p0 + m11 * p1 + m12 * p2
        a22 = m20 * p0 + m21 * p1 + m22 * p2
    for j in range(4):
        p0, p1, p2 = end[0, j], end[1, j], end[2, j]
        pose[0, j] = a00 * p0 + a01 * p1 + a02 * p2
        pose[1, j] = a10 * p0 + a11 * p1 + a12 * p2
        pose[2, j] = a20 * p0 + a21 * p1 + a22 * p2
    pose[0, 3] += x
    pose[1, 3] += y
    pose[2, 3] += z


@compiled(inner=True)
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


@compiled(inner=True)
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
