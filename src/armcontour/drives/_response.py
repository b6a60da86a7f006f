"""Compiled response of joints to small torques, step by step."""

from __future__ import annotations

import numpy as np

from armcontour._checks import FloatArray
from armcontour._kernels import compiled


@compiled()
def respond(
    mass: FloatArray, damping: FloatArray, stiffness: FloatArray, step: float, torque: FloatArray
) -> FloatArray:
    """Deviations by the method of Newmark with constant mean acceleration, from rest.

    `M (x[k+1] - 2 x[k] + x[k-1]) / h² + D (x[k+1] - x[k-1]) / 2h + K mean(x) = mean(f)` with
    `mean(x) = (x[k+1] + 2 x[k] + x[k-1]) / 4`; of second order, and stable for every step.

    Args:
        mass: M at the times, (n, dof, dof).
        damping: D at the times, (n, dof, dof).
        stiffness: K at the times, (n, dof, dof).
        step: h [s].
        torque: f at the times for several cases, (n, dof, cases).

    Returns:
        x, (n, dof, cases).
    """
    n, dof, cases = torque.shape
    found = np.zeros((n, dof, cases))
    right = np.zeros((dof, cases))
    for k in range(n - 1):
        ahead = mass[k] / step**2 + damping[k] / (2 * step) + stiffness[k] / 4
        here = 2 * mass[k] / step**2 - stiffness[k] / 2
        before = mass[k] / step**2 - damping[k] / (2 * step) + stiffness[k] / 4
        earlier = k - 1 if k > 0 else 0
        for i in range(dof):
            for c in range(cases):
                value = (torque[earlier, i, c] + 2 * torque[k, i, c] + torque[k + 1, i, c]) / 4
                for j in range(dof):
                    value += here[i, j] * found[k, j, c] - before[i, j] * found[earlier, j, c]
                right[i, c] = value
        found[k + 1] = np.linalg.solve(ahead, right)
    return found
