"""Arms from models of other libraries: `pinocchio.Model`, and MJCF files through MuJoCo."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from armcontour.core import checks, file_access
from armcontour.core.errors import InvalidInput
from armcontour.core.frames import Frame
from armcontour.core.text import list_some
from armcontour.files.robots.joint_limits import Table, limits_of, override
from armcontour.files.robots.options import ArmOptions, locked_position
from armcontour.files.robots.tree import MOST_NAMED
from armcontour.files.robots.urdf import HINT, assume_accelerations
from armcontour.robot.chain import Chain
from armcontour.robot.limits import JOINT_LIMITS, JOINT_RANGE, Limits
from armcontour.robot.serial import SerialArm

# Larger numbers stand for limits that are not given.
LARGEST = 1e9


def arm_of_model(model: Any, source: str, options: ArmOptions) -> SerialArm:
    """Make a serial arm from a `pinocchio.Model`: the joints between its universe and a frame.

    Args:
        model: The model.
        source: Where it comes from, for messages.
        options: Tip, limits and locked joints; other joints that do not move the tip are locked at
            0.

    Raises:
        InvalidInput: There is no such frame or joint, or a joint of the arm does not turn.
    """
    from armcontour.files.robots.tip import TOOL_FRAMES
    from armcontour.robot.dynamics import pinocchio

    pin, names = pinocchio(), [x.name for x in model.frames]
    tip = options.tip
    if tip is None:
        tip = next((x for x in TOOL_FRAMES if x in names), None)
    if tip not in names:
        own = [x for x in names if x not in model.names]
        raise InvalidInput(
            f"{source} has no frame {tip!r}: say which one is the tip with tip=, one of "
            f"{list_some(own, MOST_NAMED)}."
            if tip is not None
            else f"Say which frame of {source} is the tip with tip=, one of "
            f"{list_some(own, MOST_NAMED)}."
        )
    held = options.locked or {}
    frame, at = model.frames[model.getFrameId(tip)], _held_at(pin, model, source, options)
    ids = [i for i in model.supports[frame.parentJoint] if i > 0 and model.names[i] not in held]
    if not ids:
        raise InvalidInput(f"No joint of {source} moves the frame {tip}: choose another tip.")
    data, columns = model.createData(), [model.idx_vs[i] for i in ids]
    axes = []
    for i, v in zip(ids, columns, strict=True):
        twist = pin.computeJointJacobian(model, data, at, i)[:, v]
        if model.nvs[i] != 1 or np.abs(twist[:3]).max() > 0:
            name = model.names[i]
            raise InvalidInput(
                f"Joint {name} of {source} does not turn about one axis, as joints of an arm do: "
                f"choose another tip, or lock it with locked={{{name!r}: ...}}."
            )
        axes.append(twist[3:])
    pin.forwardKinematics(model, data, at)
    # Each joint, with all that it carries, belongs to the moving joint before it, or to the base.
    carrier = [0] * model.njoints
    for i in range(1, model.njoints):
        carrier[i] = i if i in ids else carrier[model.parents[i]]
    inside = [data.oMi[carrier[i]].inverse() * data.oMi[i] for i in range(model.njoints)]
    places = [data.oMi[carrier[model.parents[i]]].inverse() * data.oMi[i] for i in ids]
    carried = {i: pin.Inertia.Zero() for i in (0, *ids)}
    for i in range(model.njoints):
        carried[carrier[i]] += inside[i].act(model.inertias[i])
    inertias = [carried[i] for i in ids]
    bodies: dict[str, Any] = {}
    if all(x.mass > 0 for x in inertias):
        bodies["masses"] = [x.mass for x in inertias]
        bodies["centers"] = [x.lever for x in inertias]
        # Symmetric only up to rounding.
        bodies["inertias"] = [(x.inertia + x.inertia.T) / 2 for x in inertias]
    end = inside[frame.parentJoint] * frame.placement
    chain = Chain(
        joints=tuple(model.names[i] for i in ids),
        rotations=np.array([x.rotation for x in places]),
        positions=np.array([x.translation for x in places]),
        axes=np.array(axes),
        armature=model.armature[columns],
        viscous=model.damping[columns],
        coulomb=np.array(model.upperDryFrictionLimit)[columns],
        tip=Frame(end.translation, end.rotation),
        gravity=model.gravity.linear,
        **bodies,
    )
    limits, note = _limits(model, ids, chain, source, options.limits_file)
    return SerialArm(
        name=checks.check_name("name of a model", model.name or "model"),
        chain=chain,
        limits=limits,
        source=source,
        limits_hint=HINT if limits.joint_acceleration is None else "",
        notes=(f"{source}: {note}.",) if note else (),
    )


def _held_at(pin: Any, model: Any, source: str, options: ArmOptions) -> Any:
    """Configuration of a model with all joints at 0 but those that are locked elsewhere."""
    step = np.zeros(model.nv)
    for name in options.locked or ():
        if name not in list(model.names)[1:]:
            raise InvalidInput(
                f"{source} has no joint {name!r} to be locked: its joints are "
                f"{list_some(list(model.names)[1:], MOST_NAMED)}."
            )
        joint = model.joints[model.getJointId(name)]
        slides = "Prismatic" in joint.shortname()
        step[joint.idx_v] = locked_position(options, name, slides=slides)
    return pin.integrate(model, pin.neutral(model), step)


def _limits(
    model: Any, ids: Sequence[int], chain: Chain, source: str, file: FilePath | None
) -> tuple[Limits, str]:
    """Limits of some joints of a model, and a note of those that are assumed."""

    def known(values: Sequence[float]) -> list[float | None]:
        return [float(x) if abs(x) < LARGEST else None for x in values]

    table: Table = {name: [None] * len(chain) for name in (*JOINT_LIMITS, *JOINT_RANGE)}
    velocity = known([model.velocityLimit[model.idx_vs[i]] for i in ids])
    effort = known([model.effortLimit[model.idx_vs[i]] for i in ids])
    lacking = []
    for name, values in (("joint_velocity", velocity), ("joint_torque", effort)):
        if not all(values):
            lacking.append(name)
        elif name == "joint_velocity" or chain.masses is not None:
            table[name] = list(values)
    # A joint without a range may have two numbers for its angle.
    for name, ends in zip(JOINT_RANGE, ("lower", "upper"), strict=True):
        of = getattr(model, f"{ends}PositionLimit")
        table[name] = known([of[model.idx_qs[i]] if model.nqs[i] == 1 else np.inf for i in ids])
    if file is not None:
        override(table, chain.joints, file)
    limits = limits_of(table, chain.joints, source)
    missing = [x for x in lacking if getattr(limits, x) is None]
    note = f"it does not give {' and '.join(missing)} of all joints" if missing else ""
    return assume_accelerations(limits, note)


def read_mjcf(file: FilePath) -> Any:
    """The `pinocchio.Model` of an MJCF file, with a frame for each body and each site.

    Raises:
        InvalidInput: MuJoCo is not installed, or the file is none of its models.
    """
    from armcontour.robot.dynamics import pinocchio

    pin = pinocchio()
    file_access.read_bytes(str(file), "robot description")
    try:
        mujoco = import_module("mujoco")
    except ImportError:
        raise InvalidInput(
            f"{file} is read by the package mujoco, which is not installed: "
            "pip install 'armcontour[experiment]'."
        ) from None
    try:
        mj = mujoco.MjModel.from_xml_path(str(file))
    except ValueError as error:
        reason = str(error).strip().splitlines()[0].rstrip(".")
        raise InvalidInput(f"{file} is no model of MuJoCo: {reason}.") from None
    model, places = pin.Model(), [(0, pin.SE3.Identity())]
    model.name, model.gravity.linear = file.stem, np.array(mj.opt.gravity)

    def pose(position: Any, quaternion: Any) -> Any:
        return pin.SE3(pin.Quaternion(*quaternion).matrix(), np.array(position))

    limits: list[tuple[int, int]] = []
    for b in range(1, mj.nbody):
        body = mj.body(b)
        parent, place = places[mj.body_parentid[b]]
        place = place * pose(mj.body_pos[b], mj.body_quat[b])
        for j in range(mj.body_jntadr[b], mj.body_jntadr[b] + mj.body_jntnum[b]):
            kind, axis = mujoco.mjtJoint(mj.jnt_type[j]), np.array(mj.jnt_axis[j])
            anchor = pin.SE3(np.eye(3), np.array(mj.jnt_pos[j]))
            start = float(mj.qpos0[mj.jnt_qposadr[j]])
            if kind == mujoco.mjtJoint.mjJNT_HINGE:
                joint, back = pin.JointModelRevoluteUnaligned(axis), (-start, 0.0)
            elif kind == mujoco.mjtJoint.mjJNT_SLIDE:
                joint, back = pin.JointModelPrismaticUnaligned(axis), (0.0, -start)
            else:
                ball = kind == mujoco.mjtJoint.mjJNT_BALL
                joint, back = (
                    pin.JointModelSpherical() if ball else pin.JointModelFreeFlyer(),
                    (0, 0),
                )
            zero = pin.SE3(pin.exp3(back[0] * axis), back[1] * axis)
            name = mj.joint(j).name or f"joint {j + 1}"
            parent = model.addJoint(parent, joint, place * anchor * zero, name)
            limits.append((parent, j))
            place = anchor.inverse()
        own = pose(mj.body_ipos[b], mj.body_iquat[b])
        turned = own.rotation @ np.diag(mj.body_inertia[b]) @ own.rotation.T
        inertia = pin.Inertia(float(mj.body_mass[b]), own.translation, turned)
        model.appendBodyToJoint(parent, inertia, place)
        places.append((parent, place))
        _add_frame(pin, model, body.name or f"body {b}", parent, place)
    for s in range(mj.nsite):
        parent, place = places[mj.site_bodyid[s]]
        inside = place * pose(mj.site_pos[s], mj.site_quat[s])
        _add_frame(pin, model, mj.site(s).name or f"site {s}", parent, inside)
    for i, j in limits:
        if model.nvs[i] == 1:
            _limit_joint(model, i, mj, j)
    return model


def _add_frame(pin: Any, model: Any, name: str, joint: int, place: Any) -> None:
    model.addFrame(pin.Frame(name, joint, place, pin.FrameType.OP_FRAME))


def _limit_joint(model: Any, i: int, mj: Any, j: int) -> None:
    """Set range, torque, friction and armature of joint i of a model from joint j of MuJoCo."""
    q, v, dof = model.idx_qs[i], model.idx_vs[i], mj.jnt_dofadr[j]
    low, high = mj.jnt_range[j] if mj.jnt_limited[j] else (-np.inf, np.inf)
    model.lowerPositionLimit[q], model.upperPositionLimit[q] = low, high
    most = float(np.abs(mj.jnt_actfrcrange[j]).min()) if mj.jnt_actfrclimited[j] else np.inf
    driven = (mj.actuator_trntype == 0) & (mj.actuator_trnid[:, 0] == j)
    for a in np.flatnonzero(driven & (mj.actuator_forcelimited > 0)):
        force = np.abs(mj.actuator_forcerange[a] * mj.actuator_gear[a, 0]).min()
        most = min(most, float(force))
    model.effortLimit[v], model.velocityLimit[v] = most, np.inf
    model.armature[v] = mj.dof_armature[dof]
    model.damping[v] = np.ravel(mj.dof_damping[dof])[0]
    model.upperDryFrictionLimit[v] = mj.dof_frictionloss[dof]
