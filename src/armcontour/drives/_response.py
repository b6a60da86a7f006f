"""Compiled response of joints to small torques, step by step."""

from __future__ import annotations

import numpy as np

from armcontour._checks import BoolArray, FloatArray
from armcontour._kernels import compiled

# How much stiffer than inertia and drive a joint that sticks is held.
HELD = 1e6


@compiled()
def spread(
    mass: FloatArray,
    damping: FloatArray,
    stiffness: FloatArray,
    step: float,
    torque: FloatArray,
    held: BoolArray,
) -> FloatArray:
    """Deviations under small torques, from rest, while some joints may stick.

    By the method of Newmark with constant mean acceleration, of second order and stable for every
    step: `M (x[k+1] - 2 x[k] + x[k-1]) / h² + D (x[k+1] - x[k-1]) / 2h + K mean(x) = f[k]` with
    `mean(x) = (x[k+1] + 2 x[k] + x[k-1]) / 4`.

    Args:
        mass: M at the times, (n, dof, dof).
        damping: D at the times, (n, dof, dof).
        stiffness: K at the times, (n, dof, dof).
        step: h [s].
        torque: f, means about the times, for several cases [N m], (n, dof, cases).
        held: Whether a joint sticks from each time to the next, (n, dof).

    Returns:
        Deviations [rad], (n, dof, cases).
    """
    n, dof, cases = torque.shape
    found = np.zeros((n, dof, cases))
    right = np.zeros((dof, cases))
    for k in range(n - 1):
        m, d, s = mass[k] / step**2, damping[k] / (2 * step), stiffness[k] / 4
        ahead, here, before = m + d + s, 2 * m - 2 * s, m - d + s
        earlier = k - 1 if k > 0 else 0
        for i in range(dof):
            for c in range(cases):
                value = torque[k, i, c]
                for j in range(dof):
                    value += here[i, j] * found[k, j, c] - before[i, j] * found[earlier, j, c]
                right[i, c] = value
            if held[k, i]:
                hold = HELD * ahead[i, i]
                ahead[i, i] += hold
                for c in range(cases):
                    right[i, c] += hold * found[k, i, c]
        found[k + 1] = np.linalg.solve(ahead, right)
    return found
