"""Compiled inverse dynamics of a chain: joint torques of many states at once.

The recursive Newton-Euler algorithm (Featherstone, Rigid Body Dynamics Algorithms, 2008, 5.3) in
the frames of the links, whose z axes are the joint axes. States are computed in blocks, link by
link.
"""

from __future__ import annotations

import numpy as np

from armcontour._checks import FloatArray
from armcontour._kernels import FUSED, compiled
from armcontour.arms._blocks import B, write_sines

# Rows of a link: cosine and sine of its joint, first and second derivative of the joint; three each
# of force and moment about the joint of the motion whose accelerations are the first derivatives,
# of force and moment of the motion with both, and of the first moment of all that the joint
# carries; gravity along x and y.
LINK_ROWS = 21
FIRST, SECOND = 2, 3
# Rows that `write_terms` leaves: moments about the joint axes.
OF_U, OF_X, WEIGHT = 9, 15, 16
# Rows of the motion that goes from link to link, three each: angular velocity, velocity, angular
# acceleration, acceleration, gravity.
MOTION_ROWS = 15


@compiled(inner=True, fastmath=FUSED)
def go_outward(link: FloatArray, motion: FloatArray, own: FloatArray) -> None:
    """Take the motion of a block from one link to the next, and write the wrenches of that link.

    Args:
        link: Numbers of the link, as `Dynamics` packs them.
        motion: Motion rows, of the link before; of this link afterwards.
        own: Rows of the link.
    """
    r00, r01, r02, r10, r11, r12 = link[0], link[1], link[2], link[3], link[4], link[5]
    r20, r21, r22, p0, p1, p2 = link[6], link[7], link[8], link[9], link[10], link[11]
    mass, h0, h1, h2 = link[12], link[13], link[14], link[15]
    xx, xy, xz, yy, yz, zz = link[16], link[17], link[18], link[19], link[20], link[21]
    for i in range(B):
        c, s, rate, bend = own[i], own[B + i], own[2 * B + i], own[3 * B + i]
        # The origin of the joint, still in the frame of the link before.
        w0, w1, w2 = motion[i], motion[B + i], motion[2 * B + i]
        e0, e1, e2 = motion[6 * B + i], motion[7 * B + i], motion[8 * B + i]
        v0, v1, v2 = w1 * p2 - w2 * p1, w2 * p0 - w0 * p2, w0 * p1 - w1 * p0
        a0 = motion[9 * B + i] + e1 * p2 - e2 * p1 + w1 * v2 - w2 * v1
        a1 = motion[10 * B + i] + e2 * p0 - e0 * p2 + w2 * v0 - w0 * v2
        a2 = motion[11 * B + i] + e0 * p1 - e1 * p0 + w0 * v1 - w1 * v0
        v0 += motion[3 * B + i]
        v1 += motion[4 * B + i]
        v2 += motion[5 * B + i]
        g0, g1, g2 = motion[12 * B + i], motion[13 * B + i], motion[14 * B + i]
        # Into the frame of this link: by the fixed rotation, then by the turn about z.
        x, y = r00 * w0 + r10 * w1 + r20 * w2, r01 * w0 + r11 * w1 + r21 * w2
        w2 = r02 * w0 + r12 * w1 + r22 * w2 + rate
        w0, w1 = c * x + s * y, c * y - s * x
        x, y = r00 * e0 + r10 * e1 + r20 * e2, r01 * e0 + r11 * e1 + r21 * e2
        e2 = r02 * e0 + r12 * e1 + r22 * e2 + bend
        e0, e1 = c * x + s * y + w1 * rate, c * y - s * x - w0 * rate
        x, y = r00 * v0 + r10 * v1 + r20 * v2, r01 * v0 + r11 * v1 + r21 * v2
        v2 = r02 * v0 + r12 * v1 + r22 * v2
        v0, v1 = c * x + s * y, c * y - s * x
        x, y = r00 * a0 + r10 * a1 + r20 * a2, r01 * a0 + r11 * a1 + r21 * a2
        a2 = r02 * a0 + r12 * a1 + r22 * a2
        a0, a1 = c * x + s * y, c * y - s * x
        x, y = r00 * g0 + r10 * g1 + r20 * g2, r01 * g0 + r11 * g1 + r21 * g2
        g2 = r02 * g0 + r12 * g1 + r22 * g2
        g0, g1 = c * x + s * y, c * y - s * x
        motion[i], motion[B + i], motion[2 * B + i] = w0, w1, w2
        motion[3 * B + i], motion[4 * B + i], motion[5 * B + i] = v0, v1, v2
        motion[6 * B + i], motion[7 * B + i], motion[8 * B + i] = e0, e1, e2
        motion[9 * B + i], motion[10 * B + i], motion[11 * B + i] = a0, a1, a2
        motion[12 * B + i], motion[13 * B + i], motion[14 * B + i] = g0, g1, g2
        own[19 * B + i], own[20 * B + i] = g0, g1
        own[16 * B + i], own[17 * B + i], own[18 * B + i] = h0, h1, h2
        # Wrenches: mass times acceleration, and what the inertia about the joint takes.
        u0, u1, u2 = w1 * h2 - w2 * h1, w2 * h0 - w0 * h2, w0 * h1 - w1 * h0
        x = xx * w0 + xy * w1 + xz * w2
        y = xy * w0 + yy * w1 + yz * w2
        z = xz * w0 + yz * w1 + zz * w2
        own[4 * B + i] = mass * v0 + u0
        own[5 * B + i] = mass * v1 + u1
        own[6 * B + i] = mass * v2 + u2
        own[7 * B + i] = x + h1 * v2 - h2 * v1
        own[8 * B + i] = y + h2 * v0 - h0 * v2
        own[9 * B + i] = z + h0 * v1 - h1 * v0
        own[10 * B + i] = mass * a0 + e1 * h2 - e2 * h1 + w1 * u2 - w2 * u1
        own[11 * B + i] = mass * a1 + e2 * h0 - e0 * h2 + w2 * u0 - w0 * u2
        own[12 * B + i] = mass * a2 + e0 * h1 - e1 * h0 + w0 * u1 - w1 * u0
        own[13 * B + i] = xx * e0 + xy * e1 + xz * e2 + w1 * z - w2 * y + h1 * a2 - h2 * a1
        own[14 * B + i] = xy * e0 + yy * e1 + yz * e2 + w2 * x - w0 * z + h2 * a0 - h0 * a2
        own[15 * B + i] = xz * e0 + yz * e1 + zz * e2 + w0 * y - w1 * x + h0 * a1 - h1 * a0


@compiled(inner=True, fastmath=FUSED)
def go_inward(link: FloatArray, own: FloatArray, before: FloatArray) -> None:
    """Add the wrenches and the first moment of a link to those of the link before.

    Args:
        link: Numbers of the link.
        own: Rows of the link.
        before: Rows of the link before.
    """
    r00, r01, r02, r10, r11, r12 = link[0], link[1], link[2], link[3], link[4], link[5]
    r20, r21, r22, p0, p1, p2 = link[6], link[7], link[8], link[9], link[10], link[11]
    carried = link[22]
    for i in range(B):
        c, s = own[i], own[B + i]
        for k in range(4, 16, 6):
            x = c * own[k * B + i] - s * own[(k + 1) * B + i]
            y = s * own[k * B + i] + c * own[(k + 1) * B + i]
            z = own[(k + 2) * B + i]
            f0, f1, f2 = (
                r00 * x + r01 * y + r02 * z,
                r10 * x + r11 * y + r12 * z,
                r20 * x + r21 * y + r22 * z,
            )
            before[k * B + i] += f0
            before[(k + 1) * B + i] += f1
            before[(k + 2) * B + i] += f2
            x = c * own[(k + 3) * B + i] - s * own[(k + 4) * B + i]
            y = s * own[(k + 3) * B + i] + c * own[(k + 4) * B + i]
            z = own[(k + 5) * B + i]
            before[(k + 3) * B + i] += r00 * x + r01 * y + r02 * z + p1 * f2 - p2 * f1
            before[(k + 4) * B + i] += r10 * x + r11 * y + r12 * z + p2 * f0 - p0 * f2
            before[(k + 5) * B + i] += r20 * x + r21 * y + r22 * z + p0 * f1 - p1 * f0
        x = c * own[16 * B + i] - s * own[17 * B + i]
        y = s * own[16 * B + i] + c * own[17 * B + i]
        z = own[18 * B + i]
        before[16 * B + i] += r00 * x + r01 * y + r02 * z + carried * p0
        before[17 * B + i] += r10 * x + r11 * y + r12 * z + carried * p1
        before[18 * B + i] += r20 * x + r21 * y + r22 * z + carried * p2


@compiled(inner=True, fastmath=FUSED)
def write_terms(
    links: FloatArray, gravity: FloatArray, rows: FloatArray, motion: FloatArray
) -> None:
    """Write the coefficients of a block: of dds, of ds², and the torque of gravity, for all links.

    Args:
        links: Numbers of the links, as `Dynamics` packs them, (dof, 24).
        gravity: Acceleration of gravity in the frame of the base [m/s²], (3,).
        rows: Rows of the links, (dof, LINK_ROWS * B), with joint positions in row 0 and their
            derivatives in FIRST and SECOND; the coefficients are written into OF_U, OF_X and
            WEIGHT.
        motion: Memory for the motion, (MOTION_ROWS * B,).
    """
    dof = len(links)
    for m in range(MOTION_ROWS * B):
        motion[m] = gravity[m // B - 12] if m >= 12 * B else 0.0
    for j in range(dof):
        write_sines(rows[j])
        go_outward(links[j], motion, rows[j])
    for j in range(dof - 1, 0, -1):
        go_inward(links[j], rows[j], rows[j - 1])
    for j in range(dof):
        own, armature = rows[j], links[j, 23]
        for i in range(B):
            own[OF_U * B + i] += armature * own[FIRST * B + i]
            own[OF_X * B + i] += armature * own[SECOND * B + i]
            weight = own[17 * B + i] * own[19 * B + i] - own[16 * B + i] * own[20 * B + i]
            own[WEIGHT * B + i] = weight


@compiled()
def path_terms(
    links: FloatArray, gravity: FloatArray, q: FloatArray, first: FloatArray, second: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Coefficients a, b, c of the torque `a dds + b ds² + c` of all states, (n, dof) each.

    Args:
        links: Numbers of the links, as `Dynamics` packs them, (dof, 24).
        gravity: Acceleration of gravity in the frame of the base [m/s²], (3,).
        q: Joint positions [rad], (n, dof).
        first: First derivatives, (n, dof).
        second: Second derivatives, (n, dof).
    """
    n, dof = q.shape
    a, b, c = np.empty((n, dof)), np.empty((n, dof)), np.empty((n, dof))
    rows, motion = np.empty((dof, LINK_ROWS * B)), np.empty(MOTION_ROWS * B)
    for begin in range(0, n, B):
        for j in range(dof):
            own = rows[j]
            for i in range(B):
                # The last block is filled up with the last state.
                at = min(begin + i, n - 1)
                own[i] = q[at, j]
                own[FIRST * B + i], own[SECOND * B + i] = first[at, j], second[at, j]
        write_terms(links, gravity, rows, motion)
        for j in range(dof):
            own = rows[j]
            for i in range(min(B, n - begin)):
                a[begin + i, j], b[begin + i, j] = own[OF_U * B + i], own[OF_X * B + i]
                c[begin + i, j] = own[WEIGHT * B + i]
    return a, b, c
