"""Where bodies of a chain are in the frames of others: compiled, as it is asked for in pairs."""

from __future__ import annotations

import math

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour._kernels import compiled


@compiled(inner=True)
def write_product(a: FloatArray, b: FloatArray, out: FloatArray) -> None:
    """Write the frame b, which is given in the frame a, in the frame of a; (3, 4) each."""
    for i in range(3):
        for j in range(4):
            value = a[i, 3] if j == 3 else 0.0
            for k in range(3):
                value += a[i, k] * b[k, j]
            out[i, j] = value


@compiled(inner=True)
def write_joint(rotation: FloatArray, axis: FloatArray, q: float, out: FloatArray) -> None:
    """Write the rotation of a link whose joint has turned, by Rodrigues' formula."""
    c, s = math.cos(q), math.sin(q)
    x, y, z = axis[0], axis[1], axis[2]
    rest = 1.0 - c
    for i in range(3):
        a, b, d = rotation[i, 0], rotation[i, 1], rotation[i, 2]
        along = (a * x + b * y + d * z) * rest
        out[i, 0] = c * a + s * (b * z - d * y) + along * x
        out[i, 1] = c * b + s * (d * x - a * z) + along * y
        out[i, 2] = c * d + s * (a * y - b * x) + along * z


@compiled()
def relative_places(
    rotations: FloatArray,
    positions: FloatArray,
    axes: FloatArray,
    q: FloatArray,
    links: IntArray,
    places: FloatArray,
    ends: IntArray,
    at: IntArray,
    pair: IntArray,
) -> FloatArray:
    """Frames of the second bodies of pairs in the frames of the first ones, (m, 3, 4).

    Args:
        rotations: Rotations of the joint frames, (dof, 3, 3).
        positions: Positions of the joint frames [m], (dof, 3).
        axes: Joint axes in the joint frames, (dof, 3).
        q: Joint positions [rad], (n, dof).
        links: Links of the bodies, (bodies,).
        places: Frames of the bodies in the frames of their links, (bodies, 3, 4).
        ends: The two bodies of every pair, (pairs, 2).
        at: Rows of the joint positions, (m,).
        pair: The pairs, (m,).
    """
    n, dof = q.shape
    frames, joint = np.zeros((n, dof + 1, 3, 4)), np.empty((3, 4))
    for i in range(n):
        for k in range(3):
            frames[i, 0, k, k] = 1.0
        for k in range(dof):
            write_joint(rotations[k], axes[k], q[i, k], joint)
            for j in range(3):
                joint[j, 3] = positions[k, j]
            write_product(frames[i, k], joint, frames[i, k + 1])
    found = np.empty((len(pair), 3, 4))
    first, second = np.empty((3, 4)), np.empty((3, 4))
    for m in range(len(pair)):
        a, b = ends[pair[m], 0], ends[pair[m], 1]
        write_product(frames[at[m], links[a]], places[a], first)
        write_product(frames[at[m], links[b]], places[b], second)
        for i in range(3):
            for j in range(4):
                value = 0.0
                for k in range(3):
                    part = second[k, j] - first[k, 3] if j == 3 else second[k, j]
                    value += first[k, i] * part
                found[m, i, j] = value
    return found
