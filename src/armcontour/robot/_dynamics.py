"""Compiled inverse dynamics of a chain: joint torques of many states at once."""

# The recursive Newton-Euler algorithm (Featherstone, Rigid Body Dynamics Algorithms, 2008, 5.3) in
# the frames of the links, whose z axes are the joint axes. States are computed in blocks, link by
# link.

from __future__ import annotations

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.kernels import FUSED, compiled
from armcontour.robot.kernels import (
    B,
    add,
    cross,
    get,
    into_link,
    out_of_link,
    put,
    rotation_of,
    write_sines,
)

# Rows of a link: cosine and sine of its joint, first and second derivative of the joint; three each
# of force and moment about the joint of the motion whose accelerations are the first derivatives,
# of force and moment of the motion with both, and of the first moment of all that the joint
# carries; gravity along x and y.
LINK_ROWS = 21
# Rows of the motion that goes from link to link, three each: angular velocity, velocity, angular
# acceleration, acceleration, gravity.
MOTION_ROWS = 15


@compiled(inner=True, fastmath=FUSED)
def go_outward(links: FloatArray, j: int, motion: FloatArray, own: FloatArray) -> None:
    """Take the motion of a block from one link to the next, and write the wrenches of that link."""
    x, r, mass = links[j], rotation_of(links, j), links[j, 12]
    p, h = (x[9], x[10], x[11]), (x[13], x[14], x[15])
    # Columns of the inertia.
    i0, i1, i2 = (x[16], x[17], x[18]), (x[17], x[19], x[20]), (x[18], x[20], x[21])
    for i in range(B):
        c, s, rate, bend = own[i], own[B + i], own[2 * B + i], own[3 * B + i]
        # The origin of the joint, still in the frame of the link before.
        w, e = get(motion, 0, i), get(motion, 6, i)
        turned = cross(w, p)
        v = add(get(motion, 3, i), 1.0, turned)
        a = add(add(get(motion, 9, i), 1.0, cross(e, p)), 1.0, cross(w, turned))
        w = into_link(r, c, s, w)
        w = w[0], w[1], w[2] + rate
        e = into_link(r, c, s, e)
        e = e[0] + w[1] * rate, e[1] - w[0] * rate, e[2] + bend
        v, a = into_link(r, c, s, v), into_link(r, c, s, a)
        g = into_link(r, c, s, get(motion, 12, i))
        put(motion, 0, i, w)
        put(motion, 3, i, v)
        put(motion, 6, i, e)
        put(motion, 9, i, a)
        put(motion, 12, i, g)
        own[19 * B + i], own[20 * B + i] = g[0], g[1]
        put(own, 16, i, h)
        # Wrenches: mass times acceleration, and what the inertia about the joint takes.
        u = cross(w, h)
        spin = add(add(add((0.0, 0.0, 0.0), w[0], i0), w[1], i1), w[2], i2)
        put(own, 4, i, add(u, mass, v))
        put(own, 7, i, add(spin, 1.0, cross(h, v)))
        put(own, 10, i, add(add(cross(e, h), 1.0, cross(w, u)), mass, a))
        turned = add(add(add(cross(w, spin), e[0], i0), e[1], i1), e[2], i2)
        put(own, 13, i, add(turned, 1.0, cross(h, a)))


@compiled(inner=True, fastmath=FUSED)
def go_inward(links: FloatArray, j: int, own: FloatArray, before: FloatArray) -> None:
    """Add the wrenches and the first moment of a link to those of the link before."""
    r, carried = rotation_of(links, j), links[j, 22]
    p = links[j, 9], links[j, 10], links[j, 11]
    for i in range(B):
        c, s = own[i], own[B + i]
        for k in range(4, 16, 6):
            force = out_of_link(r, c, s, get(own, k, i))
            put(before, k, i, add(get(before, k, i), 1.0, force))
            turned = add(out_of_link(r, c, s, get(own, k + 3, i)), 1.0, cross(p, force))
            put(before, k + 3, i, add(get(before, k + 3, i), 1.0, turned))
        moved = add(out_of_link(r, c, s, get(own, 16, i)), carried, p)
        put(before, 16, i, add(get(before, 16, i), 1.0, moved))


@compiled(fastmath=FUSED)
def path_terms(
    links: FloatArray, gravity: FloatArray, q: FloatArray, first: FloatArray, second: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Coefficients a, b, c of the torque `a dds + b ds² + c` of all states, (n, dof) each."""
    # links (dof, 24), gravity (3,) [m/s²], q (n, dof) [rad], first (n, dof), second (n, dof).
    n, dof = q.shape
    a, b, c = np.empty((n, dof)), np.empty((n, dof)), np.empty((n, dof))
    rows, motion = np.empty((dof, LINK_ROWS * B)), np.empty(MOTION_ROWS * B)
    for begin in range(0, n, B):
        for j in range(dof):
            own = rows[j]
            for i in range(B):
                # The last block is filled up with the last state.
                at = min(begin + i, n - 1)
                own[i], own[2 * B + i], own[3 * B + i] = q[at, j], first[at, j], second[at, j]
        for m in range(MOTION_ROWS * B):
            motion[m] = gravity[m // B - 12] if m >= 12 * B else 0.0
        for j in range(dof):
            write_sines(rows[j])
            go_outward(links, j, motion, rows[j])
        for j in range(dof - 1, 0, -1):
            go_inward(links, j, rows[j], rows[j - 1])
        for j in range(dof):
            own, armature = rows[j], links[j, 23]
            for i in range(min(B, n - begin)):
                at = begin + i
                # Moments about the joint axis.
                a[at, j] = own[9 * B + i] + armature * first[at, j]
                b[at, j] = own[15 * B + i] + armature * second[at, j]
                c[at, j] = own[17 * B + i] * own[19 * B + i] - own[16 * B + i] * own[20 * B + i]
    return a, b, c
