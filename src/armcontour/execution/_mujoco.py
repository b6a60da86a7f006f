"""A chain of rigid bodies in MuJoCo, in the frame of the chain's base."""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np

from armcontour._checks import FloatArray
from armcontour.arms.chain import Chain
from armcontour.errors import InvalidInput

# MuJoCo's friction is a stiff constraint: a joint that sticks still creeps, and the position loop
# would walk it out of the dead band in a second with the standard stiffness. With the stiffest one
# (the largest impedance that MuJoCo takes, and the time in which a step may stop a joint) the
# offset keeps for hours.
STIFFEST = 0.9999
SHORTEST_STEPS = 2.0
# Inertia that is none: as a share of the arm's largest, and at all [kg m²].
SINGULAR = 1e-12
NOTHING = 1e-13


def load() -> Any:
    """The module mujoco.

    Raises:
        InvalidInput: It is not installed.
    """
    try:
        # By name: mujoco carries no types.
        return importlib.import_module("mujoco")
    except ImportError:
        raise InvalidInput(
            "A rigid-body plant needs the package mujoco, which is not installed: install "
            "armcontour[experiment]."
        ) from None


def build(chain: Chain, step: float, *, friction: bool) -> Any:
    """The model of a chain that has masses.

    Args:
        chain: With masses; its payload is part of the last link.
        step: Step of integration [s].
        friction: With viscous and Coulomb friction; else without both.

    Raises:
        InvalidInput: A joint that turns nothing, or mujoco is not installed.
    """
    mujoco = load()
    spec = mujoco.MjSpec()
    spec.option.timestep = step
    spec.option.gravity = np.array(chain.gravity)
    # Its error over a step is far below what holding the torque for that step does: the step is the
    # drive's, not the integrator's.
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    # Of the iteration for friction: down to rounding, and no slower than the standard 1e-8. At 0 it
    # would go on to its last iteration in every step.
    spec.option.tolerance = 1e-12
    # What goes wrong is reported, not put back to the beginning.
    spec.option.disableflags = (
        mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_AUTORESET
    )
    masses, moments = _add_links(mujoco, spec, chain, friction)
    model = spec.compile()
    # MuJoCo's compiler refuses rods, laminas off by rounding, and drives that turn nothing but
    # themselves; its dynamics takes them.
    model.body_mass[1:], model.body_inertia[1:] = masses, moments
    # What turns nothing is looked for with more inertia at every joint: without, MuJoCo would write
    # what it finds wrong to a file.
    for more in (1.0, 0.0):
        model.dof_armature[:] = np.asarray(chain.armature) + more
        mujoco.mj_setConst(model, mujoco.MjData(model))
        if more:
            still = np.zeros(len(chain))
            _refuse_singular(chain, mass_matrix(model, still) - more * np.eye(len(chain)))
    return model


def mass_matrix(model: Any, q: FloatArray) -> FloatArray:
    """Torque per joint acceleration at a pose, armature included, (dof, dof) [kg m²]."""
    mujoco = load()
    data = mujoco.MjData(model)
    data.qpos[:] = q
    for compute in (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_crb):
        compute(model, data)
    found = np.empty((model.nv, model.nv))
    for column, unit in zip(found, np.eye(model.nv), strict=True):
        mujoco.mj_mulM(model, data, column, unit)
    return found


def _refuse_singular(chain: Chain, matrix: FloatArray) -> None:
    values, vectors = np.linalg.eigh(matrix)
    if values[0] <= max(SINGULAR * values[-1], NOTHING):
        j = int(np.argmax(np.abs(vectors[:, 0])))
        raise InvalidInput(
            f"Joint {j + 1} ({chain.joints[j]}) turns no inertia, so its torque moves nothing: "
            "give the link after it a mass and an inertia, or its drive an armature."
        )


def _add_links(
    mujoco: Any, spec: Any, chain: Chain, friction: bool
) -> tuple[list[float], list[FloatArray]]:
    """Give a specification the links of a chain; their masses and principal moments."""
    viscous, coulomb = np.asarray(chain.viscous), np.asarray(chain.coulomb)
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
        body.add_joint(
            type=mujoco.mjtJoint.mjJNT_HINGE,
            axis=chain.axes[k],
            armature=np.asarray(chain.armature)[k],
            damping=viscous[k] if friction else 0.0,
            frictionloss=coulomb[k] if friction else 0.0,
            solref_friction=[SHORTEST_STEPS * spec.option.timestep, 1.0],
            solimp_friction=[STIFFEST, STIFFEST, 1e-3, 0.5, 2.0],
        )
        masses.append(mass)
        moments.append(np.maximum(principal, 0.0))
    return masses, moments


def _link(chain: Chain, k: int) -> tuple[float, FloatArray, FloatArray]:
    """Mass, centre and inertia about it of a link, with the payload if it carries that."""
    assert chain.masses is not None and chain.centers is not None and chain.inertias is not None
    mass, center, inertia = float(chain.masses[k]), chain.centers[k], chain.inertias[k]
    load = chain.payload
    if load is None or load.mass == 0.0 or k + 1 < len(chain):
        return mass, center, inertia
    at = chain.tip.position + chain.tip.rotation @ load.center
    turned = chain.tip.rotation @ load.inertia @ chain.tip.rotation.T
    total = mass + load.mass
    apart = at - center
    # Steiner, for two bodies about their common centre.
    between = mass * load.mass / total * (apart @ apart * np.eye(3) - np.outer(apart, apart))
    return total, center + load.mass / total * apart, inertia + turned + between


def _quaternion(mujoco: Any, rotation: FloatArray) -> FloatArray:
    found = np.empty(4)
    mujoco.mju_mat2Quat(found, np.array(rotation).ravel())
    return found
