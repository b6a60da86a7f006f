"""Arms from models of other libraries: `pinocchio.Model`, and MJCF files read by MuJoCo."""

from __future__ import annotations

from importlib import import_module
from itertools import pairwise
from pathlib import Path as FilePath
from typing import Any, TypeAlias

import numpy as np

from armcontour.core import checks, file_access
from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.frames import Frame
from armcontour.core.text import list_some
from armcontour.files.robots.arm_options import ArmOptions, locked_position
from armcontour.files.robots.moveit_limits import Table, limits_of, override_limits
from armcontour.files.robots.tree import MAX_NAMED
from armcontour.files.robots.urdf import HINT, assume_accelerations
from armcontour.robot.chain import Chain, merge_bodies
from armcontour.robot.limits import JOINT_LIMITS, JOINT_RANGE
from armcontour.robot.serial import SerialArm

# Larger limits are treated as missing [SI].
MAX_LIMIT = 1e9

# Mass [kg], centre of mass [m] and inertia about it [kg m²].
Body: TypeAlias = tuple[float, FloatArray, FloatArray]


def arm_of_model(model: Any, options: ArmOptions) -> SerialArm:
    """Make a serial arm from the joints of a `pinocchio.Model` between its universe and a frame."""
    from armcontour.robot.dynamics import pinocchio

    pin, source, names = pinocchio(), "the model", list(model.names)
    frame = model.frames[_find_tip([x.name for x in model.frames], names, source, options)]
    held = _locked_indices(names[1:], source, options)
    step = np.zeros(model.nv)
    for k in held:
        joint = model.joints[k + 1]
        slides = "Prismatic" in joint.shortname()
        step[joint.idx_v] = locked_position(options, names[k + 1], slides=slides)
    posture = pin.integrate(model, pin.neutral(model), step)
    ids = [i for i in model.supports[frame.parentJoint] if i > 0 and i - 1 not in held]
    data, columns = model.createData(), [model.idx_vs[i] for i in ids]
    axes = []
    for i, v in zip(ids, columns, strict=True):
        twist = pin.computeJointJacobian(model, data, posture, i)[:, v]
        if model.nvs[i] != 1 or np.abs(twist[:3]).max() > 0:
            raise _not_revolute(names[i], source)
        axes.append(twist[3:])
    pin.forwardKinematics(model, data, posture)
    links: list[list[Body]] = [[] for _ in (0, *ids)]
    # The body of a locked joint moves with the nearest moving joint before it, or with the base
    # (index 0) if there is none.
    carrier = [0] * model.njoints
    for i in range(model.njoints):
        carrier[i] = ids.index(i) + 1 if i in ids else carrier[model.parents[i]]
        body = data.oMi[i].act(model.inertias[i])
        links[carrier[i]].append((body.mass, body.lever, body.inertia))
    table: Table = {
        "joint_velocity": [model.velocityLimit[v] for v in columns],
        "joint_torque": [model.effortLimit[v] for v in columns],
    }
    # A continuous joint has two numbers for its angle (cosine and sine), so that it has no range.
    for name, ends in zip(JOINT_RANGE, ("lower", "upper"), strict=True):
        limit = getattr(model, f"{ends}PositionLimit")
        table[name] = [limit[model.idx_qs[i]] if model.nqs[i] == 1 else np.inf for i in ids]
    return _make_arm(
        model.name or "model",
        source,
        options,
        table,
        places=[Frame(data.oMi[i]) for i in ids],
        links=links[1:],
        end=Frame(data.oMi[frame.parentJoint] * frame.placement),
        joints=tuple(names[i] for i in ids),
        axes=np.array(axes),
        armature=model.armature[columns],
        viscous=model.damping[columns],
        coulomb=np.array(model.upperDryFrictionLimit)[columns],
        gravity=model.gravity.linear,
    )


def arm_of_mjcf(file: FilePath, options: ArmOptions) -> SerialArm:
    """Make a serial arm from the joints of an MJCF file between its world and a body or site."""
    mujoco, model = _read_mjcf(file)
    data, source = mujoco.MjData(model), str(file)
    names = [model.joint(j).name or f"joint {j + 1}" for j in range(model.njnt)]
    kinds, hinge = [mujoco.mjtJoint(x) for x in model.jnt_type], mujoco.mjtJoint.mjJNT_HINGE
    slide, held = mujoco.mjtJoint.mjJNT_SLIDE, _locked_indices(names, source, options)
    bodies = [model.body(b).name or f"body {b}" for b in range(model.nbody)]
    sites = [model.site(k).name or f"site {k}" for k in range(model.nsite)]
    tip = _find_tip([*bodies, *sites], bodies[:1], source, options)
    on_site = tip >= model.nbody
    joints = [range(x, x + n) for x, n in zip(model.body_jntadr, model.body_jntnum, strict=True)]
    route: list[int] = []
    body = model.site_bodyid[tip - model.nbody] if on_site else tip
    while body:
        route = [*joints[body], *route]
        body = model.body_parentid[body]
    ids = [j for j in route if j not in held]
    step = np.zeros(model.nv)
    for j, kind in enumerate(kinds):
        if kind in (hinge, slide):
            data.qpos[model.jnt_qposadr[j]] = 0.0
        if j in held:
            step[model.jnt_dofadr[j]] = locked_position(options, names[j], slides=kind == slide)
    for j in ids:
        if kinds[j] != hinge:
            raise _not_revolute(names[j], source)
    mujoco.mj_integratePos(model, data.qpos, step, 1.0)
    mujoco.mj_kinematics(model, data)
    links: list[list[Body]] = [[] for _ in (0, *ids)]
    carrier = [0] * model.nbody
    for b in range(1, model.nbody):
        moving = [ids.index(j) + 1 for j in joints[b] if j in ids]
        carrier[b] = moving[-1] if moving else carrier[model.body_parentid[b]]
        turn = data.ximat[b].reshape(3, 3)
        inertia = turn @ np.diag(model.body_inertia[b]) @ turn.T
        links[carrier[b]].append((float(model.body_mass[b]), np.array(data.xipos[b]), inertia))
    turns = data.xmat.reshape(-1, 3, 3)
    places = [Frame(data.xanchor[j], turns[model.jnt_bodyid[j]]) for j in ids]
    ends = (data.site_xpos, data.site_xmat) if on_site else (data.xpos, data.xmat)
    point, turn = (x[tip - model.nbody if on_site else tip] for x in ends)
    ranges = np.where(model.jnt_limited[ids, None], model.jnt_range[ids], (-np.inf, np.inf))
    dofs = model.jnt_dofadr[ids]
    table: Table = {
        "joint_velocity": [np.inf] * len(ids),
        "joint_torque": [_largest_torque(model, j) for j in ids],
        **dict(zip(JOINT_RANGE, ranges.T.tolist(), strict=True)),
    }
    return _make_arm(
        file.stem,
        source,
        options,
        table,
        places=places,
        links=links[1:],
        end=Frame(point, turn.reshape(3, 3)),
        joints=tuple(names[j] for j in ids),
        axes=np.array([x.rotation.T @ data.xaxis[j] for x, j in zip(places, ids, strict=True)]),
        armature=model.dof_armature[dofs],
        viscous=model.dof_damping.reshape(model.nv, -1)[dofs, 0],
        coulomb=model.dof_frictionloss[dofs],
        gravity=np.array(model.opt.gravity),
    )


def _read_mjcf(file: FilePath) -> tuple[Any, Any]:
    """Read an MJCF file; returns the module `mujoco` and its model."""
    file_access.read_bytes(str(file), "robot description")
    try:
        mujoco = import_module("mujoco")
    except ImportError:
        raise InvalidInput(
            f"Reading {file} requires the package mujoco, which is not installed. Install it with "
            "pip install 'armcontour[experiment]'."
        ) from None
    try:
        return mujoco, mujoco.MjModel.from_xml_path(str(file))
    except ValueError as error:
        reason = str(error).strip().splitlines()[0].rstrip(".")
        raise InvalidInput(f"{file} is not a valid model of MuJoCo: {reason}.") from None


def _largest_torque(model: Any, j: int) -> float:
    """Torque limit of joint j of a MuJoCo model [N m]; infinity if it has none."""
    largest = (
        float(np.abs(model.jnt_actfrcrange[j]).min()) if model.jnt_actfrclimited[j] else np.inf
    )
    driven = (model.actuator_trntype == 0) & (model.actuator_trnid[:, 0] == j)
    for a in np.flatnonzero(driven & (model.actuator_forcelimited > 0)):
        force = np.abs(model.actuator_forcerange[a] * model.actuator_gear[a, 0]).min()
        largest = min(largest, float(force))
    return largest


def _find_tip(names: list[str], others: list[str], source: str, options: ArmOptions) -> int:
    """Index in `names` of the frame at the tip; messages do not list the frames `others`."""
    from armcontour.files.robots.tip import TOOL_FRAMES

    tip = options.tip
    if tip is None:
        tip = next((x for x in TOOL_FRAMES if x in names), None)
    if tip in names:
        return names.index(tip)
    known = list_some([x for x in names if x not in others], MAX_NAMED)
    raise InvalidInput(
        f"{source} has no frame {tip!r}. Specify one of its frames as the tip with tip=: {known}."
        if tip is not None
        else f"The tip of {source} is missing. Specify one of its frames with tip=: {known}."
    )


def _locked_indices(names: list[str], source: str, options: ArmOptions) -> list[int]:
    """Indices in `names` of the locked joints."""
    for name in options.locked or ():
        if name not in names:
            raise InvalidInput(
                f"The joint {name!r} cannot be locked, because {source} has only the joints "
                f"{list_some(names, MAX_NAMED)}."
            )
    return [names.index(x) for x in options.locked or ()]


def _not_revolute(name: str, source: str) -> InvalidInput:
    """Error for a joint of an arm that is not revolute."""
    return InvalidInput(
        f"Joint {name} of {source} must be revolute, as all joints of an arm. Choose another tip, "
        f"or lock the joint with locked={{{name!r}: ...}}."
    )


def _make_arm(
    name: str,
    source: str,
    options: ArmOptions,
    values: Table,
    *,
    places: list[Frame],
    links: list[list[Body]],
    end: Frame,
    **others: Any,
) -> SerialArm:
    """Make the arm of a model.

    All frames and bodies are in the frame of the base, at the zero position of the moving joints.
    `values` are limits by name, `places` the frames of the joints, `links` the bodies that move
    with each joint, `end` the frame of the tip, and `others` further fields of the chain.
    """
    if not places:
        raise InvalidInput(f"No joint of {source} moves its tip. Choose another tip.")
    inside = [x.inverse @ y for x, y in pairwise([Frame(), *places, end])]
    if all(sum(mass for mass, *_ in link) > 0 for link in links):
        bodies = []
        for place, link in zip(places, links, strict=True):
            mass, center, inertia = merge_bodies(link)
            back = place.rotation.T
            turned = back @ inertia @ back.T
            bodies.append((mass, back @ (center - place.position), (turned + turned.T) / 2))
        joined = zip(*bodies, strict=True)
        others |= dict(zip(("masses", "centers", "inertias"), joined, strict=True))
    chain = Chain(
        rotations=np.array([x.rotation for x in inside[:-1]]),
        positions=np.array([x.position for x in inside[:-1]]),
        tip=inside[-1],
        **others,
    )
    table: Table = {x: [None] * len(chain) for x in (*JOINT_LIMITS, *JOINT_RANGE)}
    lacking = []
    for key, limit in values.items():
        known = [float(x) if abs(x) < MAX_LIMIT else None for x in limit]
        if key in JOINT_RANGE:
            table[key] = known
        elif not all(known):
            lacking.append(key)
        elif key == "joint_velocity" or chain.masses is not None:
            table[key] = known
    if options.limits_file is not None:
        override_limits(table, chain.joints, options.limits_file)
    limits = limits_of(table, chain.joints, source)
    missing = [x for x in lacking if getattr(limits, x) is None]
    lack = f"it does not specify {' and '.join(missing)} for all joints" if missing else ""
    limits, assumed = assume_accelerations(limits, chain.joints)
    note = "; ".join(x for x in (lack, assumed) if x)
    return SerialArm(
        name=checks.check_name("name of a model", name),
        chain=chain,
        limits=limits,
        source=source,
        limits_hint=HINT if limits.joint_acceleration is None else "",
        notes=(f"{source}: {note}.",) if note else (),
    )
