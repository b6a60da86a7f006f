"""MuJoCo model of a kinematic chain: its integration steps and its stability."""

from __future__ import annotations

import ctypes
import importlib
import os
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.errors import ExecutionError, InvalidInput
from armcontour.core.sampled_data import spread_indices
from armcontour.motion import SetPoints
from armcontour.robot.bodies import merge_bodies
from armcontour.robot.chain import Chain
from armcontour.simulation.drive_loop import Functions

# MuJoCo models friction as a stiff constraint, so a sticking joint creeps. With the standard
# stiffness, the position loop would remove a sticking joint's offset within a second. With the
# stiffest constraint, the offset remains for hours. This is the largest impedance that MuJoCo
# accepts.
MAX_IMPEDANCE = 0.9999
# Shortest time in which a constraint can stop a joint [integration steps].
STOPPING_STEPS = 2.0
# An inertia counts as zero if it is at most this fraction of the arm's largest inertia ...
ZERO_INERTIA_SHARE = 1e-12
# ... or at most this [kg m²].
ZERO_INERTIA = 1e-13
# Beginning of the names of joints, which their index in the chain follows.
LINK = "link "
# Stability is checked at up to this number of set-points before the simulation.
MAX_CHECKS = 50
# Largest product of an integration step and the fastest rate of viscous damping; the integrator is
# stable up to 2.8.
MAX_DAMPING_PER_STEP = 0.5
# Largest number of integration steps in a step of the drives.
MAX_INTEGRATION_STEPS = 50


def import_mujoco() -> Any:
    """Import mujoco; if it is missing, raise an error with the installation command."""
    try:
        # Import by name, because mujoco has no type annotations.
        return importlib.import_module("mujoco")
    except ImportError:
        raise InvalidInput(
            "A rigid-body plant requires the package mujoco, which is not installed. Install it "
            "with: pip install 'armcontour[experiment]'."
        ) from None


def function_addresses() -> Functions:
    """Return the addresses of MuJoCo's functions that compiled code calls."""
    # On Linux and macOS, symbols of a module include the symbols of its libraries.
    module = FilePath(import_mujoco()._functions.__file__)
    library = ctypes.CDLL(str(module.with_name("mujoco.dll") if os.name == "nt" else module))

    def find(name: str) -> int:
        return int(ctypes.cast(getattr(library, name), ctypes.c_void_p).value or 0)

    return Functions(find("mj_step"), find("mj_kinematics"), find("mj_comPos"), find("mj_rne"))


def build_model(chain: Chain, step: float, *, friction: bool) -> Any:
    """Build the MuJoCo model of a chain; its payload becomes part of the last link.

    The joints of a positioner are before those of the arm, from the floor; see `order_of`.

    - `step`: integration step [s].
    - `friction`: whether the joints have viscous and dry friction.
    """
    mujoco = import_mujoco()
    spec = mujoco.MjSpec()
    spec.option.timestep = step
    spec.option.gravity = np.array(chain.gravity)
    # This integrator's error is far below the effect of holding a torque for a drive cycle.
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    # The friction solver ends near rounding errors, which takes no longer than the default 1e-8.
    # With 0, every step would use the maximum number of iterations.
    spec.option.tolerance = 1e-12
    # MuJoCo must not reset a diverging simulation, because divergence is reported as an error.
    disabled = mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_AUTORESET
    if not friction or not np.any(chain.coulomb):
        # Without dry friction, nothing is constrained, and searching for constraints takes time.
        disabled |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    spec.option.disableflags = disabled
    masses, moments = _add_links(mujoco, spec, chain)
    model = spec.compile()
    # Masses and moments are set after compilation, because MuJoCo's compiler rejects rods, laminas
    # with rounding errors, and links without mass, although the dynamics support them.
    model.body_mass[1:] = masses
    model.body_inertia[1:] = moments
    order = order_of(model)
    if friction:
        model.dof_damping[:] = np.asarray(chain.viscous)[order]
        model.dof_frictionloss[:] = np.asarray(chain.coulomb)[order]
    model.dof_solimp[:] = [MAX_IMPEDANCE, MAX_IMPEDANCE, 1e-3, 0.5, 2.0]
    set_step(model, step)
    # Joints without inertia are detected while every joint has an additional inertia, because
    # MuJoCo would otherwise write a warning to a file.
    for added_inertia in (1.0, 0.0):
        model.dof_armature[:] = added_inertia + np.asarray(chain.armature)[order]
        mujoco.mj_setConst(model, mujoco.MjData(model))
        if added_inertia:
            q = np.zeros(len(chain))
            _check_inertia(chain, mass_matrix(model, q) - added_inertia * np.eye(model.nv))
    return model


def order_of(model: Any) -> IntArray:
    """Return the index in the chain of each joint of a model, (dof,)."""
    names = [model.joint(k).name for k in range(model.njnt)]
    return np.array([int(x.removeprefix(LINK)) for x in names], dtype=np.intp)


def set_step(model: Any, step: float) -> None:
    """Set the integration step of a model [s]."""
    model.opt.timestep = step
    model.dof_solref[:] = [STOPPING_STEPS * step, 1.0]


def mass_matrix(model: Any, q: FloatArray) -> FloatArray:
    """Return the mass matrix M(q) at the links' positions q [kg m²], (dof, dof).

    It includes the drives' inertias (armature).
    """
    return np.asarray(mass_matrices(model, q[None])[0])


def mass_matrices(model: Any, q: FloatArray) -> FloatArray:
    """Return the mass matrices at k positions of the links [kg m²], (k, dof, dof).

    - `q`: positions of the links [rad], (k, dof).
    """
    mujoco = import_mujoco()
    # One state is used for all positions, because allocating it takes longer than a matrix.
    data = mujoco.MjData(model)
    units = np.eye(model.nv)
    order = order_of(model)
    matrices = np.empty((len(q), model.nv, model.nv))
    for position, matrix in zip(q, matrices, strict=True):
        data.qpos[:] = position[order]
        for compute in (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_crb):
            compute(model, data)
        for column, unit in zip(matrix, units, strict=True):
            mujoco.mj_mulM(model, data, column, unit)
    in_chain = np.argsort(order)
    return matrices[:, in_chain][:, :, in_chain]


def gravity_torques(model: Any, data: Any, q: FloatArray) -> FloatArray:
    """Return gravity torques at the links' positions q [N m], (dof,); overwrite `data`."""
    mujoco = import_mujoco()
    torque = np.zeros(model.nv)
    order = order_of(model)
    data.qpos[:] = q[order]
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_rne(model, data, 0, torque)
    return torque[np.argsort(order)]


def _check_inertia(chain: Chain, matrix: FloatArray) -> None:
    """Raise an error if the mass matrix is singular; the message names the joint."""
    values, vectors = np.linalg.eigh(matrix)
    if values[0] <= max(ZERO_INERTIA_SHARE * values[-1], ZERO_INERTIA):
        j = int(np.argmax(np.abs(vectors[:, 0])))
        raise InvalidInput(
            f"Every joint must move an inertia, but joint {j + 1} ({chain.joints[j]}) moves none. "
            "Specify mass and inertia of the link after the joint, or an armature of its drive."
        )


def _add_links(mujoco: Any, spec: Any, chain: Chain) -> tuple[list[float], list[FloatArray]]:
    """Add the links of a chain to a specification; return masses and principal moments."""
    masses: list[float] = []
    moments: list[FloatArray] = []
    first = chain.floor_link
    part = chain.part_branch
    branches = [(chain.arm_branch, range(first, len(chain)))]
    if part is not None:
        branches.insert(0, (part, range(first - 1, -1, -1)))
    for branch, numbers in branches:
        _add_branch(mujoco, spec, branch, numbers, masses, moments)
    return masses, moments


def _add_branch(
    mujoco: Any,
    spec: Any,
    chain: Chain,
    numbers: range,
    masses: list[float],
    moments: list[FloatArray],
) -> None:
    """Add the links of a branch from the floor, and append their masses and principal moments.

    - `numbers`: index of each joint of the branch in the whole chain.
    """
    body = spec.worldbody
    slides = chain.slides
    for k, number in enumerate(numbers):
        mass, center, inertia = _link_body(chain, k)
        principal, axes = np.linalg.eigh(inertia)
        axes[:, 2] *= np.sign(np.linalg.det(axes))
        body = body.add_body(
            pos=chain.positions[k],
            quat=_to_quaternion(mujoco, chain.rotations[k]),
            mass=1.0,
            ipos=center,
            iquat=_to_quaternion(mujoco, axes),
            inertia=np.ones(3),
            explicitinertial=True,
        )
        kinds = mujoco.mjtJoint
        kind = kinds.mjJNT_SLIDE if slides[k] else kinds.mjJNT_HINGE
        body.add_joint(name=f"{LINK}{number}", type=kind, axis=chain.axes[k])
        masses.append(mass)
        moments.append(np.maximum(principal, 0.0))


def _link_body(chain: Chain, k: int) -> tuple[float, FloatArray, FloatArray]:
    """Return link k's mass, centre of mass and central inertia; the last link has the payload."""
    assert chain.masses is not None and chain.centers is not None and chain.inertias is not None
    mass = float(chain.masses[k])
    center = chain.centers[k]
    inertia = chain.inertias[k]
    payload = chain.payload
    if payload is None or payload.mass == 0.0 or k + 1 < len(chain):
        return mass, center, inertia
    payload_center = chain.tip.position + chain.tip.rotation @ payload.center
    turned = chain.tip.rotation @ payload.inertia @ chain.tip.rotation.T
    return merge_bodies([(mass, center, inertia), (payload.mass, payload_center, turned)])


def _to_quaternion(mujoco: Any, rotation: FloatArray) -> FloatArray:
    """Convert a rotation matrix to a quaternion in MuJoCo's order, w, x, y, z, (4,)."""
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, np.array(rotation).ravel())
    return quaternion


def count_parts(
    model: Any, set_points: SetPoints, step: float, loop: FloatArray, viscous: FloatArray
) -> int:
    """Count the integration steps per step of the drives; refuse unstable drives.

    Viscous friction damps joints with the rates of M⁻¹ D, with the mass matrix M and the friction
    coefficients D. The fastest rate times an integration step may be at most
    `MAX_DAMPING_PER_STEP`.

    A drive holds its torque for a step h. The velocity loops have the rates of M⁻¹ K, with
    K = J K_v; they are stable if the fastest rate times h is below 2.

    Args:
        model: The MuJoCo model.
        set_points: The set-points, at which M is computed.
        step: Step h of the drives [s].
        loop: K [N m s/rad], (dof,).
        viscous: D [N m s/rad], (dof,).

    Raises:
        ExecutionError: A rate is too fast.
    """
    largest = 1
    checked = spread_indices(len(set_points.q), MAX_CHECKS)
    for i, mass in zip(checked, mass_matrices(model, set_points.q[checked]), strict=True):
        t = float(set_points.start_time + i * set_points.cycle)
        rates = np.linalg.eigvals(np.linalg.solve(mass, np.diag(viscous)))
        parts = int(np.ceil(np.abs(rates).max() * step / MAX_DAMPING_PER_STEP))
        if parts > MAX_INTEGRATION_STEPS:
            raise ExecutionError(
                f"Viscous friction of the joints requires {parts} integration steps in a step of "
                f"{step:.3g} s at t = {t:.4g} s, but at most {MAX_INTEGRATION_STEPS} are "
                "supported. Reduce the viscous friction, increase the inertias of drives "
                "(armature), or shorten the step.",
                t=t,
                needed=float(parts),
                allowed=float(MAX_INTEGRATION_STEPS),
            )
        largest = max(largest, parts)
        # K^½ M⁻¹ K^½ is symmetric and has the eigenvalues of M⁻¹ K.
        root = np.sqrt(loop)
        values, vectors = np.linalg.eigh(root[:, None] * np.linalg.inv(mass) * root)
        fastest = float(values[-1])
        if fastest * step >= 2:
            j = int(np.argmax(np.abs(vectors[:, -1])))
            raise ExecutionError(
                f"Joint {j + 1} is unstable at t = {t:.4g} s, because its drive holds a torque for "
                f"a step of {step:.3g} s, but corrects its velocity at a rate of {fastest:.4g} "
                f"1/s. Shorten the step to {1 / fastest:.2g} s, reduce the gains of the servo, or "
                "specify the inertias of the drives (armature) of the arm if they are missing.",
                t=t,
                joint=j,
                limit="step",
                needed=step,
                allowed=2 / fastest,
            )
    return largest
