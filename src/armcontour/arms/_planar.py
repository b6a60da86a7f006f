"""Compiled kinematics of the planar two-link arm: tool points and their derivatives."""

from __future__ import annotations

import numpy as np

from armcontour._checks import FloatArray
from armcontour._kernels import compiled
from armcontour.arms._blocks import B, write_sines


@compiled()
def tool_motion(
    base: float,
    links: tuple[float, float],
    order: int,
    q: FloatArray,
    first: FloatArray,
    second: FloatArray,
    third: FloatArray,
) -> FloatArray:
    """Tool points, or their derivatives up to an order.

    Args:
        base: Distance of the first joint from the origin, along x [m].
        links: Lengths of the links [m].
        order: Order of the highest derivative, 0 to 3; without derivatives, points are given.
        q: Joint positions [rad], (n, 2).
        first: First derivatives, (n, 2); read if the order asks for them, as the next two.
        second: Second derivatives, (n, 2).
        third: Third derivatives, (n, 2).

    Returns:
        Points, (n, 2), or all derivatives side by side, (n, 2 order).
    """
    n = len(q)
    found = np.zeros((n, 2 * max(order, 1)))
    sines = np.empty(2 * B)
    for begin in range(0, n, B):
        for k in range(2):
            for i in range(B):
                # The last block is filled up with the last state.
                at = min(begin + i, n - 1)
                sines[i] = q[at, 0] + k * q[at, 1]
            write_sines(sines)
            length = links[k]
            for i in range(min(B, n - begin)):
                at, c, s = begin + i, length * sines[i], length * sines[B + i]
                if order == 0:
                    found[at, 0] += s + (1 - k) * base
                    found[at, 1] += c
                    continue
                rate = first[at, 0] + k * first[at, 1]
                found[at, 0] += c * rate
                found[at, 1] -= s * rate
                if order > 1:
                    bend = second[at, 0] + k * second[at, 1]
                    found[at, 2] += c * bend - s * rate * rate
                    found[at, 3] -= s * bend + c * rate * rate
                    if order > 2:
                        jerk = third[at, 0] + k * third[at, 1] - rate * rate * rate
                        found[at, 4] += c * jerk - 3 * s * rate * bend
                        found[at, 5] -= s * jerk + 3 * c * rate * bend
    return found
