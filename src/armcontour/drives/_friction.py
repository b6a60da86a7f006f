"""Compiled steps of a closed loop with dry friction, by the method of `_response.spread`."""

from __future__ import annotations

import numpy as np

from armcontour._checks import FloatArray
from armcontour._kernels import compiled

# Friction torques of coupled joints are found one joint after the other until none changes by more
# than this part of the largest one; a few rounds do, since the drives dominate the coupling.
EXACT = 1e-10
ROUNDS = 60


@compiled()
def slide(
    mass: FloatArray,
    damping: FloatArray,
    stiffness: FloatArray,
    step: float,
    imbalance: FloatArray,
    moved: FloatArray,
    coulomb: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Correct a motion so that its torques balance with dry friction.

    `M x'' + D x' + K x + friction = imbalance`, x being the correction. Friction brakes with the
    Coulomb torque, or holds a joint at rest with what it takes, up to that torque.

    Args:
        mass: M at the times, (n, dof, dof).
        damping: D at the times, (n, dof, dof).
        stiffness: K at the times, (n, dof, dof).
        step: Time between two times [s].
        imbalance: Torque that the motion lacks, without friction [N m], (n, dof).
        moved: What the motion moves from each time to the next [rad], (n - 1, dof).
        coulomb: Coulomb friction [N m], (dof,).

    Returns:
        The correction [rad] and the friction torque in each step [N m], (n, dof) each.
    """
    n, dof = imbalance.shape
    found, friction = np.zeros((n, dof)), np.zeros((n, dof))
    right, free, brake = np.zeros(dof), np.zeros(dof), np.zeros(dof)
    enough = EXACT * coulomb.max()
    for k in range(n - 1):
        earlier = k - 1 if k > 0 else 0
        inverse = np.linalg.inv(mass[k] / step**2 + damping[k] / (2 * step) + stiffness[k] / 4)
        for i in range(dof):
            right[i] = imbalance[k, i]
            for j in range(dof):
                m, d, s = mass[k, i, j] / step**2, damping[k, i, j] / (2 * step), stiffness[k, i, j]
                right[i] += (2 * m - s / 2) * found[k, j] - (m - d + s / 4) * found[earlier, j]
        for i in range(dof):
            free[i] = 0.0
            for j in range(dof):
                free[i] += inverse[i, j] * right[j]
        for _ in range(ROUNDS):
            change = 0.0
            for i in range(dof):
                # What the joint would still move, and the friction that stops it.
                rest = moved[k, i] + free[i] - found[k, i]
                for j in range(dof):
                    rest -= inverse[i, j] * brake[j]
                wanted = brake[i] + rest / inverse[i, i]
                new = min(max(wanted, -coulomb[i]), coulomb[i])
                change = max(change, abs(new - brake[i]))
                brake[i] = new
            if change <= enough:
                break
        for i in range(dof):
            friction[k, i] = brake[i]
            found[k + 1, i] = free[i]
            for j in range(dof):
                found[k + 1, i] -= inverse[i, j] * brake[j]
    friction[n - 1] = friction[max(n - 2, 0)]
    return found, friction
