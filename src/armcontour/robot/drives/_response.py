"""Compiled response of joints to torques, step by step, with dry friction."""

from __future__ import annotations

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.kernels import compiled

# Friction torques of coupled joints are found one joint after the other until none changes by more
# than this part of the largest one; a few rounds do, since the drives dominate the coupling.
EXACT = 1e-10
ROUNDS = 60


@compiled()
def spread(
    mass: FloatArray,
    damping: FloatArray,
    stiffness: FloatArray,
    step: float,
    torque: FloatArray,
    hold: FloatArray,
    moved: FloatArray,
    coulomb: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Deviations from a motion under torques, from rest, and the torques of dry friction.

    By the method of Newmark with constant mean acceleration, of second order and stable for every
    step: `M (x[k+1] - 2 x[k] + x[k-1]) / h² + D (x[k+1] - x[k-1]) / 2h + K mean(x) = f[k]` with
    `mean(x) = (x[k+1] + 2 x[k] + x[k-1]) / 4`. Friction brakes with the Coulomb torque, or holds a
    joint at rest with what it takes, up to that torque.

    Args:
        mass: M at the times, (n, dof, dof).
        damping: D at the times, (n, dof, dof).
        stiffness: K at the times, (n, dof, dof).
        step: h [s].
        torque: f, means about the times, for several cases [N m], (n, dof, cases).
        hold: Share of M / h² + D / 2h + K / 4 by which a joint that sticks is stiffer from each
            time to the next, (n, dof); 0 for others.
        moved: What the motion moves from each time to the next [rad], (n - 1, dof).
        coulomb: Coulomb friction [N m], (dof,).

    Returns:
        Deviations [rad], and friction torques in each step [N m], (n, dof, cases) each.
    """
    n, dof, cases = torque.shape
    found, friction = np.zeros((n, dof, cases)), np.zeros((n, dof, cases))
    right, free, enough = np.zeros(dof), np.zeros(dof), EXACT * coulomb.max()
    for k in range(n - 1):
        m, d, s = mass[k] / step**2, damping[k] / (2 * step), stiffness[k] / 4
        ahead, here, before = m + d + s, 2 * m - 2 * s, m - d + s
        for i in range(dof):
            more = hold[k, i] * ahead[i, i]
            ahead[i, i] += more
            here[i, i] += more
        inverse, earlier = np.linalg.inv(ahead), max(k - 1, 0)
        for c in range(cases):
            brake = friction[k, :, c]
            brake[:] = friction[earlier, :, c]
            for i in range(dof):
                right[i] = torque[k, i, c]
                for j in range(dof):
                    right[i] += here[i, j] * found[k, j, c] - before[i, j] * found[earlier, j, c]
            for i in range(dof):
                free[i] = 0.0
                for j in range(dof):
                    free[i] += inverse[i, j] * right[j]
            for _ in range(ROUNDS):
                change = 0.0
                for i in range(dof):
                    # What the joint would still move, and the friction that stops it.
                    rest = moved[k, i] + free[i] - found[k, i, c]
                    for j in range(dof):
                        rest -= inverse[i, j] * brake[j]
                    wanted = brake[i] + rest / inverse[i, i]
                    new = min(max(wanted, -coulomb[i]), coulomb[i])
                    change = max(change, abs(new - brake[i]))
                    brake[i] = new
                if change <= enough:
                    break
            for i in range(dof):
                found[k + 1, i, c] = free[i]
                for j in range(dof):
                    found[k + 1, i, c] -= inverse[i, j] * brake[j]
    friction[n - 1] = friction[max(n - 2, 0)]
    return found, friction
