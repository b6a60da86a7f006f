"""Make arms from robot descriptions: URDF, and xacro files that expand to URDF."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path as FilePath

from armcontour import _files
from armcontour._text import list_some
from armcontour._xacro.expanding import expand_xacro
from armcontour.arms.serial import SerialArm
from armcontour.errors import InvalidInput
from armcontour.io.robots.description import Description
from armcontour.io.robots.joint_limits import Table, limits_of, override
from armcontour.io.robots.tree import MOST_NAMED, TURNING, Joint, Tree, read_tree

DESCRIPTIONS = (".urdf", ".xacro")
HINT = (
    "give load_arm a joint_limits.yaml of MoveIt, joint_limits=..., with has_acceleration_limits "
    "and max_acceleration for every joint, or set joint_acceleration with limits.replace"
)


def arm_of_tree(
    tree: Tree,
    *,
    tip: str | None = None,
    base: str | None = None,
    joint_limits: FilePath | None = None,
    locked: Mapping[str, float] | None = None,
) -> SerialArm:
    """Make a serial arm from a robot description.

    Args:
        tree: The description, from `read_description`.
        tip: Link at the end of the arm, whose frame is the tip; by default the only end.
        base: Fixed link at the start of the arm; by default the root.
        joint_limits: MoveIt file whose values replace those of the description.
        locked: Positions of locked joints, by name [rad or m]. Joints that are not between base
            and tip are locked at 0 by default.

    Raises:
        InvalidInput: A description that gives no serial arm.
    """
    file = tree.file
    route = tree.between(base, tip)
    positions = dict(locked or {})
    for name in positions:
        if name not in tree.joints:
            raise InvalidInput(
                f"{file} has no joint {name!r} to be locked: its joints are "
                f"{list_some(list(tree.joints), MOST_NAMED)}."
            )
    moving = [x for x in route if x.kind != "fixed" and x.name not in positions]
    _refuse_joints(tree, moving)
    description = Description(tree, route, moving, positions, tree.root if base is None else base)
    chain = description.chain()
    table = _limits(tree, moving, checked=joint_limits is None)
    if joint_limits is not None:
        override(table, chain.joints, joint_limits)
    limits = limits_of(table, chain.joints, file)
    source = file
    if chain.masses is None and limits.joint_torque is not None:
        # Descriptions give effort limits, but without masses no torque can be computed.
        limits = limits.replace(joint_torque=None)
        source += " (no link has a mass, so limits of effort are left out)"
    return SerialArm(
        name=tree.name,
        chain=chain,
        limits=limits,
        source=source,
        limits_hint=HINT if limits.joint_acceleration is None else "",
    )


def read_description(file: FilePath, *, trust_xacro: bool = False) -> Tree:
    """Read the links and joints of a robot description.

    Args:
        file: A .urdf file, or a .xacro file, which the package xacro expands.
        trust_xacro: Whether a .xacro file may be expanded: such a file is a program.

    Raises:
        InvalidInput: No such file, a .xacro file that is not trusted, or no description.
    """
    content: bytes | str = _files.read_bytes(file, "robot description")
    if is_xacro(file):
        if not trust_xacro:
            raise InvalidInput(
                f"{file} is not loaded, since a xacro file is a program that can run anything on "
                "this computer: if you trust it, say so with --trust-xacro (in Python, "
                "trust_xacro=True)."
            )
        content = expand_xacro(file)
    return read_tree(str(file), content)


def is_description(file: str | FilePath) -> bool:
    """Whether a file is a robot description, by its ending."""
    return FilePath(file).suffix.lower() in DESCRIPTIONS


def is_xacro(file: str | FilePath) -> bool:
    """Whether a file is a xacro program, by its ending."""
    return FilePath(file).suffix.lower() == ".xacro"


def _refuse_joints(tree: Tree, moving: list[Joint]) -> None:
    """Refuse moving joints that do not turn, or that mimic another joint."""
    if not moving:
        raise InvalidInput(f"No joint turns between base and tip in {tree.file}: choose others.")
    for joint in moving:
        if joint.kind not in TURNING:
            raise InvalidInput(
                f"Joint {joint.name} of {tree.file} is {joint.kind}, and an arm takes joints that "
                "turn: choose a base and a tip without it between them, or lock it with "
                f"locked={{{joint.name!r}: ...}} (in a job, arm.locked)."
            )
        if joint.element.find("mimic") is not None:
            raise InvalidInput(
                f"Joint {joint.name} of {tree.file} mimics another, and the joints of an arm move "
                "by themselves: choose a base and a tip without it between them, or lock it "
                f"with locked={{{joint.name!r}: ...}} (in a job, arm.locked)."
            )


def _limits(tree: Tree, moving: list[Joint], *, checked: bool) -> Table:
    """Limits of the moving joints in the description.

    With `checked` every joint must have velocity and effort limits, because no other file adds
    them.
    """
    table: Table = {
        name: [None] * len(moving)
        for name in ("joint_acceleration", "joint_deceleration", "joint_jerk")
    }
    for name in ("joint_velocity", "joint_torque", "joint_lower", "joint_upper"):
        table[name] = []
    for joint in moving:
        limit = joint.element.find("limit")
        for name, key in (("joint_velocity", "velocity"), ("joint_torque", "effort")):
            value = joint.number("limit", key, tree.file)
            if value is None and checked:
                lacking = "limit element" if limit is None else f"{key} in its limit element"
                raise InvalidInput(
                    f"Joint {joint.name} of {tree.file} has no {lacking}: add it, or give "
                    "joint_limits."
                )
            table[name].append(value)
        for name, key in (("joint_lower", "lower"), ("joint_upper", "upper")):
            value = None
            if limit is not None and joint.kind != "continuous":
                # By the format, a missing attribute of a limit element means 0.
                value = joint.number("limit", key, tree.file) or 0.0
            table[name].append(value)
    return table
