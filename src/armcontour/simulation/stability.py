"""Integration steps of rigid bodies, and the refusal of sampled drives that are unstable."""

from __future__ import annotations

from typing import Any

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import ExecutionError
from armcontour.motion import SetPoints
from armcontour.simulation._mujoco import Springs, mass_matrices

# Number of set-points at which a run is checked before the simulation.
LOOKS = 50
# The simulation integrates over parts of a step, in which the fastest motion of springs and viscous
# friction has this phase [rad] or decay; its method is stable up to 2.8. At most so many parts.
PHASE = 0.5
MOST_PARTS = 50


def count_parts(
    model: Any,
    set_points: SetPoints,
    step: float,
    loop: FloatArray,
    viscous: FloatArray,
    springs: Springs | None,
) -> int:
    """Number of parts in which a step of the drives is integrated.

    With a torque that is constant for a step h, a mode of rigid joints is stable if the rate of its
    velocity loop, K_v J / M, times h is below 2. With springs, unstable drives are found by the
    simulation.

    Args:
        model: MuJoCo's model of the arm.
        set_points: The set-points, some of which are checked.
        step: Step of the drives [s].
        loop: J K_v [N m s/rad], (dof,).
        viscous: Viscous friction of the drives [N m s/rad], (dof,).
        springs: Springs between drives and links; None for rigid joints.

    Raises:
        ExecutionError: A joint is unstable at a set-point, or there would be too many parts.
    """
    k, d = (np.zeros_like(loop),) * 2 if springs is None else springs
    pulls = np.ones((1, 1)) if springs is None else np.array([[1.0, -1.0], [-1.0, 1.0]])
    stiffness, damping = np.kron(pulls, np.diag(k)), np.kron(pulls, np.diag(d))
    damping[-len(loop) :, -len(loop) :] += np.diag(viscous)
    most, n = 1, len(damping)
    looks = np.unique(np.linspace(0, len(set_points.q) - 1, LOOKS).astype(int))
    for i, mass in zip(looks, mass_matrices(model, set_points.q[looks]), strict=True):
        t = float(set_points.start_time + i * set_points.cycle)
        state = np.eye(2 * n, k=n)
        state[n:] = -np.linalg.solve(mass, np.hstack([stiffness, damping]))
        parts = int(np.ceil(np.abs(np.linalg.eigvals(state)).max() * step / PHASE))
        if parts > MOST_PARTS:
            raise ExecutionError(
                f"Springs or viscous friction of the joints take {parts} integration steps in a "
                f"step of {step:.3g} s at t = {t:.4g} s, and at most {MOST_PARTS} are made: reduce "
                "joint_stiffness, joint_damping or viscous friction, raise the inertias of drives "
                "(armature), or shorten the step.",
                t=t,
                needed=float(parts),
                allowed=float(MOST_PARTS),
            )
        most = max(most, parts)
        if springs is not None:
            continue
        rate = np.sqrt(loop)
        values, vectors = np.linalg.eigh(rate[:, None] * np.linalg.inv(mass) * rate)
        fastest = float(values[-1])
        if fastest * step >= 2:
            j = int(np.argmax(np.abs(vectors[:, -1])))
            raise ExecutionError(
                f"Joint {j + 1} is unstable at t = {t:.4g} s: its drive keeps a torque for a step "
                f"of {step:.3g} s and corrects its velocity at a rate of {fastest:.4g} 1/s; "
                f"shorten the step to {1 / fastest:.2g} s, lower the servo's gains, or give the "
                "arm the inertias of its drives if they are missing.",
                t=t,
                joint=j,
                limit="step",
                needed=step,
                allowed=2 / fastest,
            )
    return most
