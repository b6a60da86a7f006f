"""Cells with external axes, and paths for them, which are made of a few numbers."""

from __future__ import annotations

from functools import cache

import numpy as np
from scipy.spatial.transform import Rotation

import armcontour as ac
from armcontour.core.frames import Frame

DOWN = (0.0, 0.0, -1.0)
# Place of the base of the arm that hangs from the gantry, with the gantry at 0.
HUNG = Frame(position=(0.0, 0.0, 2.2), rotation=np.diag([1.0, -1.0, -1.0]))
TORCH = Frame(position=(0.0, 0.0, 0.3))
TILT = np.radians(10)


def on_rail(lower=0.0, upper=3.0):
    """A UR10e with a torch on a rail along y."""
    rail = ac.Rail(
        axis=(0.0, 1.0, 0.0), lower=lower, upper=upper, velocity=1.0, acceleration=1.0, mass=120.0
    )
    return ac.load_arm("ur10e", tool=TORCH).with_rail(rail)


def on_positioner(tilt=TILT):
    """A UR10e with a torch on a rail, and a positioner that tilts and turns the part."""
    usual = {"velocity": np.radians(60), "acceleration": np.radians(100), "mass": 30.0}
    turns = {"lower": -np.radians(400), "upper": np.radians(400)}
    tilts = {"lower": -np.radians(100), "upper": np.radians(100)}
    axes = (
        ac.PositionerAxis(name="tilt", axis=(0, 1, 0), origin=(0.9, 0, 0.3), **tilts, **usual),
        ac.PositionerAxis(name="turn", axis=(0, 0, 1), origin=(0.9, 0, 0.4), **turns, **usual),
    )
    rail = ac.Rail(axis=(0, 1, 0), lower=-1.5, upper=1.5, velocity=0.8, acceleration=1.5, mass=80.0)
    arm = ac.load_arm("ur10e", tool=TORCH, work=Frame((0.9, 0.0, 0.4))).with_rail(rail)
    return arm.with_positioner(ac.Positioner(axes=axes, tilt=tilt))


@cache
def described(*, gantry, table):
    """Text of a URDF: a UR10e, under a gantry or on the floor, with or without a turntable."""
    chain = ac.load_arm("ur10e").chain
    limits = ac.load_arm("ur10e").limits
    links = ["world"]
    joints = []

    def add(name, kind, parent, child, place, axis, lower, upper, velocity):
        xyz = " ".join(f"{x:.12g}" for x in place.position)
        roll, pitch, yaw = rpy_of(place.rotation)
        links.append(child)
        joints.append(
            f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="{xyz}" rpy="{roll:.15g} {pitch:.15g} {yaw:.15g}"/>'
            f'<axis xyz="{" ".join(f"{x:.12g}" for x in axis)}"/>'
            f'<limit lower="{lower}" upper="{upper}" velocity="{velocity}" effort="100"/></joint>'
        )

    before = "world"
    place = Frame()
    if gantry:
        for name, axis, end in (("gx", (1, 0, 0), 6.0), ("gy", (0, 1, 0), 3.0)):
            add(name, "prismatic", before, name, Frame(), axis, 0.0, end, 1.0)
            before = name
        place = HUNG
    for k, name in enumerate(chain.joints):
        own = place @ Frame(position=chain.positions[k], rotation=chain.rotations[k])
        ends = limits.joint_lower[k], limits.joint_upper[k], limits.joint_velocity[k]
        add(name, "revolute", before, f"link_{k}", own, chain.axes[k], *ends)
        before = f"link_{k}"
        place = Frame()
    add("flange", "fixed", before, "tool0", chain.tip @ TORCH, (0, 0, 1), 0, 0, 1)
    if table:
        pose = Frame(position=(0.9, 0.0, 0.1))
        add("turn", "revolute", "world", "table", pose, (0, 0, 1), -7.0, 7.0, 1.0)
    return (
        '<robot name="cell">' + "".join(f'<link name="{x}"/>' for x in links) + "".join(joints)
    ) + "</robot>"


def rpy_of(rotation):
    """Roll, pitch and yaw of a rotation matrix [rad], for URDF."""
    pitch = -np.arcsin(np.clip(rotation[2, 0], -1, 1))
    if abs(rotation[2, 0]) > 1 - 1e-9:
        return np.arctan2(-rotation[1, 2], rotation[1, 1]), pitch, 0.0
    roll = np.arctan2(rotation[2, 1], rotation[2, 2])
    return roll, pitch, np.arctan2(rotation[1, 0], rotation[0, 0])


def tool_poses(first, q):
    """Tool poses of a UR10e with a torch behind a transform `first`, by products of motions."""
    chain = ac.load_arm("ur10e").chain
    found = []
    for before, row in zip(first, q, strict=True):
        pose = before
        for k, angle in enumerate(row):
            step = np.eye(4)
            step[:3, :3] = (
                chain.rotations[k] @ Rotation.from_rotvec(angle * chain.axes[k]).as_matrix()
            )
            step[:3, 3] = chain.positions[k]
            pose = pose @ step
        found.append(pose @ chain.tip.homogeneous @ TORCH.homogeneous)
    return np.array(found)


def shifts(along):
    """Transforms by distances along the axes x, y and z, (n, 3)."""
    found = np.tile(np.eye(4), (len(along), 1, 1))
    found[:, :3, 3] = along
    return found


def from_description(folder, **options):
    """The arm of `described`; accelerations come from a file of limits."""
    file = folder / "cell.urdf"
    file.write_text(described(**options))
    lines = ["joint_limits:"]
    for name in ac.load_arm("ur10e").chain.joints:
        lines.append(f"  {name}: {{has_acceleration_limits: true, max_acceleration: 8.0}}")
    for name in ("gx", "gy", "turn"):
        lines.append(f"  {name}: {{has_acceleration_limits: true, max_acceleration: 1.0}}")
    own = [x for x in lines if not any(y in x for y in ("gx", "gy", "turn"))]
    own += [x for x in lines if "gx" in x or "gy" in x] if options["gantry"] else []
    own += [x for x in lines if "turn" in x] if options["table"] else []
    (folder / "limits.yaml").write_text("\n".join(own) + "\n")
    part = "table" if options["table"] else None
    return ac.load_arm(file, tip="tool0", joint_limits=folder / "limits.yaml", part=part)


def seam(length=2.5, first=0.25):
    """A fillet seam along y."""
    ends = (0.7, first, 0.0), (0.7, first + length, 0.0)
    return ac.Path.polyline(ends).pointing((0.7071, 0.0, -0.7071))


def zigzag():
    """Five rows along y, 2.5 m long."""
    points = []
    for k in range(5):
        rows = (0.25, 2.75) if k % 2 == 0 else (2.75, 0.25)
        points += [(0.6 + 0.06 * k, y, 0.0) for y in rows]
    return ac.round_corners(ac.Path.polyline(points).pointing(DOWN), tolerance=2e-3)


def circle(x, y, z, radius=0.06):
    """A circle in a horizontal plane, with the tool downwards."""
    angles = np.linspace(0, 2 * np.pi, 61)
    points = [(x + radius * np.cos(a), y + radius * np.sin(a), z) for a in angles]
    return ac.round_corners(ac.Path.polyline(points).pointing(DOWN), tolerance=2e-4)


def saddle(large=0.11, small=0.057, shift=(0.0, 0.0, 0.0)):
    """Seam of a branch on a pipe, with the tool axis in the bisector of the walls."""
    t = np.linspace(0, 2 * np.pi, 61)
    points = np.column_stack([small * np.cos(t), small * np.sin(t), np.zeros(61)])
    points[:, 2] = np.sqrt(large**2 - points[:, 1] ** 2)
    points[-1] = points[0]
    branch = np.column_stack([np.cos(t), np.sin(t), 0 * t])
    pipe = np.column_stack([0 * t, points[:, 1], points[:, 2]]) / large
    return ac.Path.spline(points + np.array(shift)).pointing(-(branch + pipe))
