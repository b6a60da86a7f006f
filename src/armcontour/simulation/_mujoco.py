"""The MuJoCo model of a chain of rigid bodies, in the frame of the chain's base."""

from __future__ import annotations

import ctypes
import importlib
import os
from pathlib import Path as FilePath
from typing import Any, NamedTuple

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.robot.chain import Chain
from armcontour.simulation._stepping import Functions

# MuJoCo models friction as a stiff constraint, so a joint that sticks still creeps. With the
# standard stiffness the position loop would remove the offset of a sticking joint within a second.
# With the stiffest constraint (the largest impedance that MuJoCo accepts, and the shortest time in
# steps in which a joint may be stopped) the offset remains for hours.
STIFFEST = 0.9999
SHORTEST_STEPS = 2.0
# Inertia that counts as zero: as a fraction of the arm's largest one, and absolute [kg m²].
SINGULAR = 1e-12
NOTHING = 1e-13


class Springs(NamedTuple):
    """The springs between drives and links.

    Attributes:
        stiffness: Torque per angle between motor and link [N m/rad], (dof,).
        damping: Torque per velocity between motor and link [N m s/rad], (dof,).
    """

    stiffness: FloatArray
    damping: FloatArray


def load() -> Any:
    """The module mujoco, imported at first use.

    Raises:
        InvalidInput: mujoco is not installed.
    """
    try:
        # Imported by name, because mujoco has no type annotations.
        return importlib.import_module("mujoco")
    except ImportError:
        raise InvalidInput(
            "A rigid-body plant needs the package mujoco, which is not installed: "
            "pip install 'armcontour[experiment]'."
        ) from None


def functions() -> Functions:
    """Where the functions of MuJoCo are in memory."""
    # On Linux and macOS the symbols of a module include those of the libraries that it needs.
    module = FilePath(load()._functions.__file__)
    library = ctypes.CDLL(str(module.with_name("mujoco.dll") if os.name == "nt" else module))

    def find(name: str) -> int:
        return int(ctypes.cast(getattr(library, name), ctypes.c_void_p).value or 0)

    return Functions(find("mj_step"), find("mj_kinematics"), find("mj_comPos"), find("mj_rne"))


def build(chain: Chain, step: float, *, friction: bool, springs: Springs | None = None) -> Any:
    """Build the MuJoCo model of a chain.

    The degrees of freedom are those of the links. With springs those of the motors follow: rotors
    with the armature and the friction of the drives, each tied to its link by a fixed tendon, whose
    length is the angle between both.

    Args:
        chain: A chain with masses; its payload becomes part of the last link.
        step: Integration step [s].
        friction: Whether the model has the chain's viscous and Coulomb friction.
        springs: Springs between drives and links; None for rigid joints.

    Raises:
        InvalidInput: A joint moves no inertia, or mujoco is not installed.
    """
    mujoco = load()
    spec = mujoco.MjSpec()
    spec.option.timestep = step
    spec.option.gravity = np.array(chain.gravity)
    # The step is the cycle of the drives: the error of the integrator over a step is far below the
    # effect of keeping the torque constant over the step.
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    # Tolerance of the iteration for friction: about rounding, and as fast as the standard 1e-8.
    # With 0 every step would use the maximum number of iterations.
    spec.option.tolerance = 1e-12
    # A simulation that diverges is reported; MuJoCo must not reset it to the start.
    off = mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_AUTORESET
    if not friction or not np.any(chain.coulomb):
        # Dry friction is the only constraint; without any, the search for some takes time.
        off |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    spec.option.disableflags = off
    masses, moments = _add_links(mujoco, spec, chain)
    if springs is not None:
        _add_motors(mujoco, spec, len(chain))
        masses, moments = masses + [0.0] * len(chain), moments + [np.zeros(3)] * len(chain)
    model = spec.compile()
    if springs is not None:
        model.tendon_stiffness[:], model.tendon_damping[:] = springs
    # MuJoCo's compiler refuses rods, laminas with rounding errors, and links without mass; its
    # dynamics accept them, so masses and moments are set after compilation.
    model.body_mass[1:], model.body_inertia[1:] = masses, moments
    # Drives are the last degrees of freedom, and without springs the only ones.
    drives = slice(-len(chain), None)
    if friction:
        model.dof_damping[drives] = np.asarray(chain.viscous)
        model.dof_frictionloss[drives] = np.asarray(chain.coulomb)
    model.dof_solimp[:] = [STIFFEST, STIFFEST, 1e-3, 0.5, 2.0]
    set_step(model, step)
    # Joints that move no inertia are searched with additional inertia at every joint: without it
    # MuJoCo would write a warning to a file.
    for more in (1.0, 0.0):
        model.dof_armature[:] = more
        model.dof_armature[drives] += np.asarray(chain.armature)
        mujoco.mj_setConst(model, mujoco.MjData(model))
        if more:
            still = np.zeros(len(chain))
            _refuse_singular(chain, mass_matrix(model, still) - more * np.eye(model.nv), springs)
    return model


def set_step(model: Any, step: float) -> None:
    """Set the integration step of a model [s]."""
    model.opt.timestep = step
    model.dof_solref[:] = [SHORTEST_STEPS * step, 1.0]


def mass_matrix(model: Any, q: FloatArray) -> FloatArray:
    """Mass matrix at positions of the links, including the armature [kg m²].

    Its rows are the model's degrees of freedom, (dof, dof), or (2 dof, 2 dof) with springs.
    """
    return np.asarray(mass_matrices(model, q[None])[0])


def mass_matrices(model: Any, q: FloatArray) -> FloatArray:
    """Mass matrices as `mass_matrix` gives them, (k, n, n), at many positions, (k, dof)."""
    mujoco = load()
    # Memory for a state takes longer than a matrix.
    data, units = mujoco.MjData(model), np.eye(model.nv)
    found = np.empty((len(q), model.nv, model.nv))
    for place, matrix in zip(q, found, strict=True):
        data.qpos[: len(place)] = place
        for compute in (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_crb):
            compute(model, data)
        for column, unit in zip(matrix, units, strict=True):
            mujoco.mj_mulM(model, data, column, unit)
    return found


def weight(model: Any, data: Any, q: FloatArray) -> FloatArray:
    """Torques that hold the links against gravity at their positions q [N m], (dof,).

    Args:
        model: The model.
        data: A state without velocities, of which the positions are lost.
        q: The positions [rad], (dof,).
    """
    mujoco, found = load(), np.zeros(model.nv)
    data.qpos[: len(q)] = q
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_rne(model, data, 0, found)
    return found[: len(q)]


def _refuse_singular(chain: Chain, matrix: FloatArray, springs: Springs | None) -> None:
    """Refuse a chain with a singular mass matrix.

    Raises:
        InvalidInput: Names the joint that moves no inertia.
    """
    values, vectors = np.linalg.eigh(matrix)
    if values[0] <= max(SINGULAR * values[-1], NOTHING):
        j = int(np.argmax(np.abs(vectors[:, 0]))) % len(chain)
        drive = f"{', or' if springs is None else ' and'} its drive an armature"
        raise InvalidInput(
            f"Joint {j + 1} ({chain.joints[j]}) turns no inertia, so its torque moves nothing: "
            f"give the link after it a mass and an inertia{drive}."
        )


def _add_links(mujoco: Any, spec: Any, chain: Chain) -> tuple[list[float], list[FloatArray]]:
    """Add the links of a chain to a specification; returns masses and principal moments."""
    body, masses, moments = spec.worldbody, [], []
    for k in range(len(chain)):
        mass, center, inertia = _link(chain, k)
        principal, axes = np.linalg.eigh(inertia)
        axes[:, 2] *= np.sign(np.linalg.det(axes))
        body = body.add_body(
            pos=chain.positions[k],
            quat=_quaternion(mujoco, chain.rotations[k]),
            mass=1.0,
            ipos=center,
            iquat=_quaternion(mujoco, axes),
            inertia=np.ones(3),
            explicitinertial=True,
        )
        body.add_joint(name=f"link {k}", type=mujoco.mjtJoint.mjJNT_HINGE, axis=chain.axes[k])
        masses.append(mass)
        moments.append(np.maximum(principal, 0.0))
    return masses, moments


def _add_motors(mujoco: Any, spec: Any, count: int) -> None:
    """Add a rotor per drive to a specification, and a tendon between rotor and link."""
    for k in range(count):
        rotor = spec.worldbody.add_body(mass=1.0, inertia=np.ones(3), explicitinertial=True)
        rotor.add_joint(name=f"motor {k}", type=mujoco.mjtJoint.mjJNT_HINGE)
        spring = spec.add_tendon(springlength=[0.0, 0.0])
        spring.wrap_joint(f"motor {k}", 1.0)
        spring.wrap_joint(f"link {k}", -1.0)


def _link(chain: Chain, k: int) -> tuple[float, FloatArray, FloatArray]:
    """Mass, centre of mass and inertia about it of link k; the last link includes the payload."""
    assert chain.masses is not None and chain.centers is not None and chain.inertias is not None
    mass, center, inertia = float(chain.masses[k]), chain.centers[k], chain.inertias[k]
    load = chain.payload
    if load is None or load.mass == 0.0 or k + 1 < len(chain):
        return mass, center, inertia
    at = chain.tip.position + chain.tip.rotation @ load.center
    turned = chain.tip.rotation @ load.inertia @ chain.tip.rotation.T
    total = mass + load.mass
    apart = at - center
    # Parallel axis theorem for two bodies about their common centre of mass.
    between = mass * load.mass / total * (apart @ apart * np.eye(3) - np.outer(apart, apart))
    return total, center + load.mass / total * apart, inertia + turned + between


def _quaternion(mujoco: Any, rotation: FloatArray) -> FloatArray:
    """The quaternion of a rotation matrix, in MuJoCo's order w, x, y, z."""
    found = np.empty(4)
    mujoco.mju_mat2Quat(found, np.array(rotation).ravel())
    return found
