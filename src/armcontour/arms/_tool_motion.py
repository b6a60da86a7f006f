"""Compiled motion of the tool of a chain: pose, velocity, acceleration and jerk of many states.

States are computed in blocks, from joint to joint, along the axes of the work frame. For every
joint there is a vector to its origin, from that of the joint before, and its axis; both turn with
the link before.
"""

from __future__ import annotations

import numpy as np

from armcontour._checks import FloatArray
from armcontour._kernels import FUSED, compiled
from armcontour.arms._blocks import B, write_sines

# Rows of the state that goes from joint to joint, three each: columns of the rotation, position,
# vector to the joint, its axis; then velocity and angular velocity, acceleration and angular
# acceleration, jerk and second derivative of the angular velocity.
ROWS = 36
# Rows of a joint: cosine, sine, first to third derivative.
JOINT_ROWS = 5


@compiled(inner=True, fastmath=FUSED)
def go_on(link: FloatArray, joint: FloatArray, state: FloatArray) -> None:
    """Take pose, vector and axis of a block from one joint to the next.

    Args:
        link: Rotation and position of the joint's frame in the one before, 12 numbers; its z axis
            is the joint axis.
        joint: Rows of the joint.
        state: Rows of the state.
    """
    r00, r01, r02, r10, r11, r12 = link[0], link[1], link[2], link[3], link[4], link[5]
    r20, r21, r22, p0, p1, p2 = link[6], link[7], link[8], link[9], link[10], link[11]
    for i in range(B):
        c, s = joint[i], joint[B + i]
        for k in range(3):
            # Row k of the rotation.
            x, y, z = state[k * B + i], state[(3 + k) * B + i], state[(6 + k) * B + i]
            along = x * p0 + y * p1 + z * p2
            state[(9 + k) * B + i] += along
            state[(12 + k) * B + i] = along
            first, second = x * r00 + y * r10 + z * r20, x * r01 + y * r11 + z * r21
            axis = x * r02 + y * r12 + z * r22
            state[(15 + k) * B + i] = state[(6 + k) * B + i] = axis
            state[k * B + i] = c * first + s * second
            state[(3 + k) * B + i] = c * second - s * first


@compiled(inner=True, fastmath=FUSED)
def add_velocity(joint: FloatArray, state: FloatArray) -> None:
    """Take velocity and angular velocity from one joint to the next."""
    for i in range(B):
        rate = joint[2 * B + i]
        l0, l1, l2 = state[12 * B + i], state[13 * B + i], state[14 * B + i]
        w0, w1, w2 = state[21 * B + i], state[22 * B + i], state[23 * B + i]
        state[18 * B + i] += w1 * l2 - w2 * l1
        state[19 * B + i] += w2 * l0 - w0 * l2
        state[20 * B + i] += w0 * l1 - w1 * l0
        state[21 * B + i] = w0 + rate * state[15 * B + i]
        state[22 * B + i] = w1 + rate * state[16 * B + i]
        state[23 * B + i] = w2 + rate * state[17 * B + i]


@compiled(inner=True, fastmath=FUSED)
def add_acceleration(joint: FloatArray, state: FloatArray) -> None:
    """Take the acceleration and the angular acceleration on; before `add_velocity`."""
    for i in range(B):
        rate, second = joint[2 * B + i], joint[3 * B + i]
        l0, l1, l2 = state[12 * B + i], state[13 * B + i], state[14 * B + i]
        d0, d1, d2 = state[15 * B + i], state[16 * B + i], state[17 * B + i]
        w0, w1, w2 = state[21 * B + i], state[22 * B + i], state[23 * B + i]
        e0, e1, e2 = state[27 * B + i], state[28 * B + i], state[29 * B + i]
        x, y, z = w1 * l2 - w2 * l1, w2 * l0 - w0 * l2, w0 * l1 - w1 * l0
        state[24 * B + i] += e1 * l2 - e2 * l1 + w1 * z - w2 * y
        state[25 * B + i] += e2 * l0 - e0 * l2 + w2 * x - w0 * z
        state[26 * B + i] += e0 * l1 - e1 * l0 + w0 * y - w1 * x
        state[27 * B + i] = e0 + second * d0 + rate * (w1 * d2 - w2 * d1)
        state[28 * B + i] = e1 + second * d1 + rate * (w2 * d0 - w0 * d2)
        state[29 * B + i] = e2 + second * d2 + rate * (w0 * d1 - w1 * d0)


@compiled(inner=True, fastmath=FUSED)
def add_jerk(joint: FloatArray, state: FloatArray) -> None:
    """Take the jerk and the second derivative of the angular velocity on; before the others.

    A vector l of a link has the derivatives `l1 = w x l`, `l2 = e x l + w x l1` and
    `l3 = f x l + 2 e x l1 + w x l2`. So has the axis of the next joint.
    """
    for i in range(B):
        rate, second, third = joint[2 * B + i], joint[3 * B + i], joint[4 * B + i]
        w0, w1, w2 = state[21 * B + i], state[22 * B + i], state[23 * B + i]
        e0, e1, e2 = state[27 * B + i], state[28 * B + i], state[29 * B + i]
        f0, f1, f2 = state[33 * B + i], state[34 * B + i], state[35 * B + i]
        x, y, z = state[12 * B + i], state[13 * B + i], state[14 * B + i]
        x1, y1, z1 = w1 * z - w2 * y, w2 * x - w0 * z, w0 * y - w1 * x
        x2 = e1 * z - e2 * y + w1 * z1 - w2 * y1
        y2 = e2 * x - e0 * z + w2 * x1 - w0 * z1
        z2 = e0 * y - e1 * x + w0 * y1 - w1 * x1
        state[30 * B + i] += f1 * z - f2 * y + 2 * (e1 * z1 - e2 * y1) + w1 * z2 - w2 * y2
        state[31 * B + i] += f2 * x - f0 * z + 2 * (e2 * x1 - e0 * z1) + w2 * x2 - w0 * z2
        state[32 * B + i] += f0 * y - f1 * x + 2 * (e0 * y1 - e1 * x1) + w0 * y2 - w1 * x2
        x, y, z = state[15 * B + i], state[16 * B + i], state[17 * B + i]
        x1, y1, z1 = w1 * z - w2 * y, w2 * x - w0 * z, w0 * y - w1 * x
        x2 = e1 * z - e2 * y + w1 * z1 - w2 * y1
        y2 = e2 * x - e0 * z + w2 * x1 - w0 * z1
        z2 = e0 * y - e1 * x + w0 * y1 - w1 * x1
        state[33 * B + i] = f0 + x * third + 2 * x1 * second + x2 * rate
        state[34 * B + i] = f1 + y * third + 2 * y1 * second + y2 * rate
        state[35 * B + i] = f2 + z * third + 2 * z1 * second + z2 * rate


@compiled(fastmath=FUSED)
def tool_motion(
    links: FloatArray,
    order: int,
    q: FloatArray,
    first: FloatArray,
    second: FloatArray,
    third: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Poses of the tool, and the derivatives of its place up to an order.

    Args:
        links: Rotation and position of the frames of all joints and of the tool, each in the one
            before, with z along the joint axis, (dof + 1, 12). The first is in the work frame.
        order: Order of the highest derivative, 0 to 3; without derivatives, poses are given.
        q: Joint positions [rad], (n, dof).
        first: First derivatives, (n, dof); read if the order asks for them, as the next two.
        second: Second derivatives, (n, dof).
        third: Third derivatives, (n, dof).

    Returns:
        For order 0 rotations row by row and positions, (n, 12), else nothing, (0, 12); velocity and
        angular velocity, their derivatives, and their second derivatives, (n, 6 order).
    """
    n, dof = q.shape
    poses = np.empty((n if order == 0 else 0, 12))
    found = np.empty((n, 6 * order))
    joint, state = np.empty(JOINT_ROWS * B), np.empty(ROWS * B)
    for begin in range(0, n, B):
        for i in range(ROWS * B):
            # The rotation is none at first.
            state[i] = 1.0 if i < 9 * B and i // B % 4 == 0 else 0.0
        for j in range(dof + 1):
            for i in range(JOINT_ROWS * B):
                joint[i] = 0.0
            if j < dof:
                for i in range(B):
                    # The last block is filled up with the last state.
                    at = min(begin + i, n - 1)
                    joint[i] = q[at, j]
                    if order > 0:
                        joint[2 * B + i] = first[at, j]
                    if order > 1:
                        joint[3 * B + i] = second[at, j]
                    if order > 2:
                        joint[4 * B + i] = third[at, j]
            write_sines(joint)
            go_on(links[j], joint, state)
            if order > 2:
                add_jerk(joint, state)
            if order > 1:
                add_acceleration(joint, state)
            if order > 0:
                add_velocity(joint, state)
        for i in range(min(B, n - begin)):
            for k in range(6 * order):
                found[begin + i, k] = state[(18 + k) * B + i]
            if order == 0:
                for k in range(3):
                    for column in range(4):
                        poses[begin + i, 4 * k + column] = state[(3 * column + k) * B + i]
    return poses, found
