"""The compiled kinematics of a chain: poses, Jacobians and their drift, many states at a time."""

from __future__ import annotations

import math

import numpy as np

from armcontour._checks import FloatArray
from armcontour._kernels import compiled


@compiled()
def write_rotation(axis: FloatArray, angle: float, out: FloatArray) -> None:
    """Write the rotation by `angle` about a unit vector into `out`, (3, 3)."""
    c, s = math.cos(angle), math.sin(angle)
    v = 2.0 * math.sin(0.5 * angle) ** 2
    x, y, z = axis[0], axis[1], axis[2]
    out[0, 0], out[0, 1], out[0, 2] = c + x * x * v, x * y * v - z * s, x * z * v + y * s
    out[1, 0], out[1, 1], out[1, 2] = y * x * v + z * s, c + y * y * v, y * z * v - x * s
    out[2, 0], out[2, 1], out[2, 2] = z * x * v - y * s, z * y * v + x * s, c + z * z * v


@compiled()
def times(a: FloatArray, b: FloatArray, out: FloatArray) -> None:
    """Write the product of two matrices of 3 by 3 into `out`, which is neither of them."""
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]


@compiled()
def place(
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
    """Where everything is at one joint position.

    Args:
        rotations: Of the chain, (dof, 3, 3).
        positions: Of the chain, (dof, 3).
        axes: Of the chain, (dof, 3).
        base: Base in work coordinates: rotation and, in column 3, position, (3, 4).
        end: Tool in the frame of the last link: rotation and position, (3, 4).
        q: Joint positions, (dof,).
        origins: Takes a point of every joint's axis, (dof, 3).
        directions: Takes every joint's axis, (dof, 3).
        pose: Takes the tool's rotation and, in column 3, its position, (3, 4).
        scratch: Memory, (3, 3, 3).
    """
    here, turn, moved = scratch[0], scratch[1], scratch[2]
    here[:, :] = base[:, :3]
    x, y, z = base[0, 3], base[1, 3], base[2, 3]
    for k in range(len(q)):
        p = positions[k]
        x += here[0, 0] * p[0] + here[0, 1] * p[1] + here[0, 2] * p[2]
        y += here[1, 0] * p[0] + here[1, 1] * p[1] + here[1, 2] * p[2]
        z += here[2, 0] * p[0] + here[2, 1] * p[1] + here[2, 2] * p[2]
        times(here, rotations[k], moved)
        origins[k, 0], origins[k, 1], origins[k, 2] = x, y, z
        a = axes[k]
        for i in range(3):
            directions[k, i] = moved[i, 0] * a[0] + moved[i, 1] * a[1] + moved[i, 2] * a[2]
        write_rotation(a, q[k], turn)
        times(moved, turn, here)
    for i in range(3):
        for j in range(3):
            pose[i, j] = here[i, 0] * end[0, j] + here[i, 1] * end[1, j] + here[i, 2] * end[2, j]
    for i in range(3):
        along = here[i, 0] * end[0, 3] + here[i, 1] * end[1, 3] + here[i, 2] * end[2, 3]
        pose[i, 3] = along + (x if i == 0 else y if i == 1 else z)


@compiled()
def jacobian(
    origins: FloatArray, directions: FloatArray, pose: FloatArray, out: FloatArray
) -> None:
    """Write the Jacobian of the tool's velocity and angular velocity into `out`, (6, dof)."""
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


@compiled()
def drift(
    origins: FloatArray, directions: FloatArray, pose: FloatArray, dq: FloatArray, out: FloatArray
) -> None:
    """Write `dJ/dt dq`, the tool's acceleration and angular acceleration at ddq = 0, into `out`.

    Every link's frame is carried along: its angular velocity, its angular acceleration, and the
    acceleration of its joint's origin. (6,)
    """
    w0 = w1 = w2 = 0.0
    e0 = e1 = e2 = 0.0
    a0 = a1 = a2 = 0.0
    n = len(dq)
    for k in range(n):
        # A joint's axis is carried by the link before it: its rate adds omega x axis dq.
        d = directions[k]
        r0, r1, r2 = d[0] * dq[k], d[1] * dq[k], d[2] * dq[k]
        e0 += w1 * r2 - w2 * r1
        e1 += w2 * r0 - w0 * r2
        e2 += w0 * r1 - w1 * r0
        w0 += r0
        w1 += r1
        w2 += r2
        if k + 1 < n:
            l0 = origins[k + 1, 0] - origins[k, 0]
            l1 = origins[k + 1, 1] - origins[k, 1]
            l2 = origins[k + 1, 2] - origins[k, 2]
        else:
            l0 = pose[0, 3] - origins[k, 0]
            l1 = pose[1, 3] - origins[k, 1]
            l2 = pose[2, 3] - origins[k, 2]
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
    """Tool poses, (n, 3, 4), and origins and axes of all joints, (n, dof, 3) each."""
    n, dof = q.shape
    found = np.empty((n, 3, 4))
    origins, directions = np.empty((n, dof, 3)), np.empty((n, dof, 3))
    scratch = np.empty((3, 3, 3))
    for i in range(n):
        place(
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
    """Jacobians of velocity and angular velocity, (n, 6, dof)."""
    n, dof = origins.shape[0], origins.shape[1]
    out = np.empty((n, 6, dof))
    for i in range(n):
        jacobian(origins[i], directions[i], pose[i], out[i])
    return out


@compiled()
def drifts(
    origins: FloatArray, directions: FloatArray, pose: FloatArray, dq: FloatArray
) -> FloatArray:
    """`dJ/dt dq` of every state, (n, 6)."""
    n = len(origins)
    out = np.empty((n, 6))
    for i in range(n):
        drift(origins[i], directions[i], pose[i], dq[i], out[i])
    return out


@compiled()
def twists(
    origins: FloatArray, directions: FloatArray, pose: FloatArray, dq: FloatArray
) -> FloatArray:
    """Velocities and angular velocities of joint velocities, (n, 6), without the Jacobians."""
    n, dof = dq.shape
    out = np.zeros((n, 6))
    for i in range(n):
        for k in range(dof):
            a, rate = directions[i, k], dq[i, k]
            x = pose[i, 0, 3] - origins[i, k, 0]
            y = pose[i, 1, 3] - origins[i, k, 1]
            z = pose[i, 2, 3] - origins[i, k, 2]
            out[i, 0] += rate * (a[1] * z - a[2] * y)
            out[i, 1] += rate * (a[2] * x - a[0] * z)
            out[i, 2] += rate * (a[0] * y - a[1] * x)
            for j in range(3):
                out[i, 3 + j] += rate * a[j]
    return out
