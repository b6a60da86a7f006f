"""Make arms from robot descriptions: URDF, and xacro files that expand to URDF."""

from __future__ import annotations

import math
import re
from functools import partial
from pathlib import Path as FilePath
from typing import TYPE_CHECKING

from armcontour.core import file_access
from armcontour.core.errors import InvalidInput
from armcontour.core.text import list_some
from armcontour.files.robots.arm_options import ArmOptions, locked_position
from armcontour.files.robots.moveit_limits import KINDS, SOFT, Table, limits_of, narrow, override
from armcontour.files.robots.tree import MAX_NAMED, TURNING, Joint, Tree, read_tree
from armcontour.robot.limits import JOINT_LIMITS, JOINT_RANGE, Limits
from armcontour.robot.scene import ArmShapes
from armcontour.robot.serial import SerialArm

if TYPE_CHECKING:
    from armcontour.files.robots.collision import Packages
    from armcontour.files.robots.urdf_chain import Description

LINK = re.compile(r"<link[\s>/]")
HINT = (
    "give the arm a joint_limits.yaml of MoveIt (arm.joint_limits of a job, joint_limits= of "
    "load_arm) with has_acceleration_limits and max_acceleration for every joint, or set "
    "limits.joint_acceleration"
)
# Limits that a description gives in its limit elements; attribute of the element and kind in
# joint_limits.yaml.
GIVEN = {"joint_velocity": "velocity", "joint_torque": "effort"}
# Ranges above the first limit [rad] are refused, because usual arms have at most 2.5 turns; below
# the second one [degrees] they may be in degrees.
MAX_RADIANS = 16.0
MAX_DEGREES = 3601.0
# Time from rest to the largest speed of a joint if no accelerations are given [s]. Universal
# Robots' joint_limits.yaml has 180 deg/s and 180 deg/s², "for planning".
RISE = 1.0
ASSUMED = (
    f"it gives no accelerations, so each joint is assumed to reach its largest speed in {RISE:g} "
    "s: give the maker's values with joint_limits or limits.joint_acceleration"
)


def arm_of_tree(tree: Tree, options: ArmOptions) -> SerialArm:
    """Make a serial arm from a robot description."""
    from armcontour.files.robots.collision import missing_meshes
    from armcontour.files.robots.tip import choose_tip
    from armcontour.files.robots.urdf_chain import Description

    file, positions = tree.file, dict[str, float]()
    for name in options.locked or ():
        if name not in tree.joints:
            raise InvalidInput(
                f"{file} has no joint {name!r} to be locked: its joints are "
                f"{list_some(list(tree.joints), MAX_NAMED)}."
            )
        slides = tree.joints[name].kind == "prismatic"
        positions[name] = locked_position(options, name, slides=slides)
    start = tree.root if options.base is None else tree.link("base", options.base)
    end, chosen = options.tip or "", ""
    if options.tip is None:
        end, chosen = choose_tip(tree, start, positions)
    route = tree.between(start, end)
    moving = [x for x in route if x.kind != "fixed" and x.name not in positions]
    _check_moving_joints(tree, moving)
    description = Description(tree, route, moving, positions, start)
    chain = description.chain()
    limits, lacking = _limits(tree, moving, options.limits_file, heavy=chain.masses is not None)
    missing = missing_meshes(tree, options.packages)
    notes = (chosen, *description.notes, lacking, missing)
    arm = SerialArm(
        name=tree.name,
        chain=chain,
        limits=limits,
        source=file,
        limits_hint=_hint(limits, heavy=chain.masses is not None),
        notes=tuple(f"{FilePath(file).name}: {x}." for x in notes if x),
    )
    if all(x.find("collision") is None for x in tree.links.values()):
        return arm
    return arm.with_shapes(partial(_shapes, arm, description, options.packages))


def _shapes(arm: SerialArm, description: Description, packages: Packages | None) -> ArmShapes:
    """The shapes of the links of a description; links below its last link belong to the tool."""
    # Imported here, because it loads the compiled code of motions.
    from armcontour.files.robots.collision import link_shapes
    from armcontour.files.robots.urdf_chain import Description
    from armcontour.verification.clearance.distances import exclude_touching

    tree, carried = description.tree, description.carried()
    # Links that the base does not carry are fixed, with all joints locked.
    others = Description(tree, (), (), description.locked, tree.root).carried()
    back = others[description.base][1].inverse
    still = {name: (0, back @ place) for name, (_, place) in others.items() if name not in carried}
    last = description.moving[-1].child
    shapes = link_shapes(tree, {**still, **carried}, packages, last)
    source = f"collision elements of {FilePath(tree.file).name}"
    return exclude_touching(arm.with_shapes(ArmShapes(shapes=shapes, source=source)))


def read_description(file: FilePath, options: ArmOptions, *, trust_xacro: bool) -> Tree:
    """Read the links and joints of a robot description."""
    content: bytes | str = file_access.read_bytes(file, "robot description")
    if file.suffix.lower() == ".xacro":
        if not trust_xacro:
            raise InvalidInput(
                f"{file} is not loaded, since a xacro file is a program that can run anything on "
                "this computer: if you trust it, say so with --trust-xacro (in Python, "
                "trust_xacro=True)."
            )
        from armcontour.files.robots.xacro_file import expand_xacro

        content = expand_xacro(file, packages=options.packages, arguments=options.arguments)
        if LINK.search(content) is None:
            raise InvalidInput(
                f"{file} makes no links: it only defines macros, or properties, for other files; "
                "name the .xacro file that uses them."
            )
    elif options.arguments:
        raise InvalidInput(f"{file} takes no arguments: these are of .xacro files.")
    return read_tree(str(file), content)


def _check_moving_joints(tree: Tree, moving: list[Joint]) -> None:
    """Check that moving joints turn and are independent."""
    if not moving:
        raise InvalidInput(f"No joint turns between base and tip in {tree.file}: choose others.")
    for joint in moving:
        if joint.kind not in TURNING:
            raise InvalidInput(
                f"Joint {joint.name} of {tree.file} is {joint.kind}, and an arm takes joints that "
                f"turn: choose a base and a tip without it between them{_or_lock(joint)}."
            )
        if joint.master is not None:
            raise InvalidInput(
                f"Joint {joint.name} of {tree.file} mimics another, and the joints of an arm move "
                f"by themselves: choose a base and a tip without it between them{_or_lock(joint)}."
            )


def _or_lock(joint: Joint) -> str:
    """The advice to lock a joint, as the end of a message; empty if it has no single position."""
    if joint.kind in ("planar", "floating"):
        return ""
    return f", or lock it with locked={{{joint.name!r}: ...}} (in a job, arm.locked)"


def _limits(
    tree: Tree, moving: list[Joint], file: FilePath | None, *, heavy: bool
) -> tuple[Limits, str]:
    """Limits of the moving joints, and a note of those that are not given."""
    names = [joint.name for joint in moving]
    table = _table(tree, moving)
    soft = _soften(table, moving, tree.file)
    stated: Table = {**table, **{name: [None] * len(moving) for name in JOINT_RANGE}}
    stated = {name: list(values) for name, values in stated.items()}
    described = {name: list(table[name]) for name in GIVEN}
    if file is not None:
        override(table, names, file)
        override(stated, names, file)
    _check_radians(table, stated, moving, tree.file)
    lacking = {}
    for name, key in GIVEN.items():
        lacking_joints = [x for x, value in zip(names, table[name], strict=True) if value is None]
        # `limits_of` refuses limits that a file gives to some joints only.
        if lacking_joints and table[name] == described[name]:
            table[name] = [None] * len(moving)
            lacking[key] = f"no {key} of {list_some(lacking_joints, MAX_NAMED)}"
    if not heavy:
        table["joint_torque"] = [None] * len(moving)
        lacking.pop("effort", None)
    note = "; ".join(x for x in (soft, _note(lacking, moving)) if x)
    return assume_accelerations(limits_of(table, names, tree.file), note)


def assume_accelerations(limits: Limits, note: str) -> tuple[Limits, str]:
    """Derive missing joint accelerations from joint velocities, and add this to the note."""
    if limits.joint_acceleration is None and limits.joint_velocity is not None:
        limits = limits.replace(joint_acceleration=limits.joint_velocity / RISE)
        note = f"{note}; {ASSUMED}" if note else ASSUMED
    return limits, note


def _hint(limits: Limits, *, heavy: bool) -> str:
    """Advice for limiting accelerations; empty if they are limited."""
    if limits.joint_acceleration is not None:
        return ""
    if not heavy or limits.joint_torque is not None:
        return HINT
    return f"{HINT}; has_effort_limits and max_effort do as well, since the masses are known"


def _table(tree: Tree, moving: list[Joint]) -> Table:
    """Limits of the moving joints in the description; velocity and effort not above 0 are none."""
    table: Table = {name: [] for name in (*JOINT_LIMITS, *JOINT_RANGE)}
    for joint in moving:
        for name in JOINT_LIMITS:
            key = GIVEN.get(name)
            value = None if key is None else joint.number("limit", key, tree.file)
            table[name].append(None if value is None or value <= 0 else value)
        for name, key in zip(JOINT_RANGE, ("lower", "upper"), strict=True):
            value = None
            if joint.kind != "continuous" and joint.element.find("limit") is not None:
                # By the format, a missing attribute of a limit element means 0.
                value = joint.number("limit", key, tree.file) or 0.0
            table[name].append(value)
    return table


def _soften(table: Table, moving: list[Joint], file: str) -> str:
    """Narrow the ranges of joints to the soft limits of their safety controllers; give a note."""
    narrowed = []
    for k, joint in enumerate(moving):
        low, high = (joint.number("safety_controller", key, file) for key in SOFT)
        # Controllers of speed alone have no such limits, or two zeros.
        if joint.kind != "continuous" and low is not None and high is not None and low < high:
            before = [table[name][k] for name in JOINT_RANGE]
            narrow(table, k, low, high)
            if before != [table[name][k] for name in JOINT_RANGE]:
                narrowed.append(joint.name)
    if not narrowed:
        return ""
    return f"it has soft limits of {list_some(narrowed, MAX_NAMED)}, which are applied"


def _check_radians(table: Table, stated: Table, moving: list[Joint], file: str) -> None:
    """Check that ranges are not likely to be in degrees."""
    for k, joint in enumerate(moving):
        low, high = (table[name][k] or 0.0 for name in JOINT_RANGE)
        # Descriptions without ranges have symmetrical powers of ten.
        endless = low == -high and math.log10(high or 1.0).is_integer()
        is_stated = any(stated[name][k] is not None for name in JOINT_RANGE)
        if MAX_RADIANS < max(-low, high) < MAX_DEGREES and not (endless or is_stated):
            raise InvalidInput(
                f"{file}: the range of joint {joint.name} from {low:g} to {high:g} rad is "
                f"{(high - low) / (2 * math.pi):.0f} turns: if these are degrees, write radians, "
                f"{math.radians(low):.4g} to {math.radians(high):.4g}; if not, say so with "
                "has_position_limits, min_position and max_position in a joint_limits.yaml."
            )


def _note(lacking: dict[str, str], moving: list[Joint]) -> str:
    """A note of the kinds of limits that a description does not give; empty if it gives all."""
    endless = [x.name for x in moving if x.kind == "revolute" and x.element.find("limit") is None]
    if endless:
        lacking = {**lacking, "position": f"no range of {list_some(endless, MAX_NAMED)}"}
    if not lacking:
        return ""
    keys = ", ".join(f"has_{kind}_limits and {'/'.join(KINDS[kind])}" for kind in lacking)
    return (
        f"it gives {' and '.join(lacking.values())} (0 and less count as not given), so the "
        f"joints have no limits of {' and '.join(lacking)}: give them for every joint with "
        f"joint_limits ({keys}) or with limits"
    )
