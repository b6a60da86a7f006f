"""Creation of arms from robot descriptions (URDF)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path as FilePath
from typing import TYPE_CHECKING

import numpy as np

from armcontour.core import file_access
from armcontour.core.errors import InvalidInput
from armcontour.core.frames import Frame
from armcontour.core.text import list_some, plain_number
from armcontour.files.robots.moveit_limits import (
    KINDS,
    SOFT,
    Table,
    make_limits,
    narrow_range,
    override_limits,
)
from armcontour.files.robots.urdf_tree import (
    ARM_TYPES,
    MAX_NAMED,
    ArmOptions,
    Joint,
    Tree,
    read_tree,
)
from armcontour.robot.chain import Chain, joint_rows
from armcontour.robot.closed_form_kinematics import ClosedForm
from armcontour.robot.limits import JOINT_RANGE, Limits, or_unlimited
from armcontour.robot.scene import ArmShapes
from armcontour.robot.serial import SerialArm

if TYPE_CHECKING:
    from armcontour.files.robots.urdf_chain import Description

# Links that are the tip if the options do not name it (REP 199), the preferred first.
TOOL_FRAMES = ("tool0", "flange")
# Number of joints of robots that stand on a column; they have a closed form.
ROBOT_JOINTS = 6
# Advice for an arm without acceleration limits.
HINT = (
    "specify a joint_limits.yaml of MoveIt (arm.joint_limits of a job, joint_limits= of load_arm) "
    "with has_acceleration_limits and max_acceleration for every joint, or set "
    "limits.joint_acceleration"
)
# Limits of descriptions by name: the attributes of the limit element. The first is also the kind of
# limit in joint_limits.yaml. The smallest value applies, in both directions.
DESCRIBED_LIMITS = {
    "joint_velocity": ("velocity",),
    "joint_torque": ("effort",),
    "joint_acceleration": ("acceleration", "deceleration"),
    "joint_jerk": ("jerk",),
}
# Ranges whose ends are between these values [rad] are rejected, because they are probably in
# degrees. Usual arms turn by at most 2.5 turns.
MAX_RADIANS = 16.0
MAX_DEGREES = 3601.0
# Assumed time from rest to the largest speed of a joint if acceleration limits are missing [s]. The
# joint_limits.yaml of Universal Robots has 180 deg/s and 180 deg/s², "for planning".
ASSUMED_RISE_TIME = 1.0
ASSUMED_NOTE = (
    f"it has no acceleration limits{{}}, so each joint is assumed to reach its largest speed in "
    f"{ASSUMED_RISE_TIME:g} s; specify the manufacturer's values with joint_limits or "
    "limits.joint_acceleration"
)


def read_arm(file: FilePath, options: ArmOptions) -> SerialArm:
    """Read a serial arm from a robot description.

    The arm has the joints between two links of the description, `options.base` and `options.tip`.
    Other joints stay at 0, or at the end of their range that is nearest to 0; joints that mimic a
    joint follow it, as in the linkage of a palletizer.

    Args:
        file: The description (URDF).
        options: Options of the arm:

            - `tip`: Link at the end of the arm; by default `tool0`, or `flange` without a `tool0`.
            - `base`: Link at the start of the arm; by default the root of the description.
            - `part`: Link that carries the part. The joints between it and the base are the axes of
              a positioner. By default the part does not move.
            - `tilt`: Largest angle between the tool axis and gravity [rad], for a positioner; by
              default any angle.
            - `joint_limits`: A joint_limits.yaml of MoveIt, whose limits replace those of the
              description.

            `load_arm` applies the options `calibration` and `srdf`.

    Raises:
        InvalidInput: The file cannot be read or is not a valid description; a link does not exist;
            the tip is not specified and the description has neither `tool0` nor `flange`; a joint
            between base and tip is neither revolute nor prismatic, or mimics a joint that is not
            between them; a joint
            that moves the part also moves the tip; or a limit is missing or wrong.
    """
    from armcontour.files.robots.collision_shapes import missing_meshes
    from armcontour.files.robots.urdf_chain import Description

    tree = read_tree(str(file), file_access.read_bytes(file, "robot description"))
    start = tree.root if options.base is None else tree.check_link("base", options.base)
    route = tree.between(start, options.tip or _default_tip(tree, start))
    moving = [x for x in route if x.kind != "fixed"]
    following = _following_joints(moving)
    moving = [x for x in moving if x not in following]
    _check_moving_joints(tree, moving)
    turning = [] if options.part is None else _part_joints(tree, start, options.part, moving)
    moving = turning + moving
    description = Description(tree, route, moving, start, len(turning), following)
    chain = description.chain()
    described = _limits(tree, moving, options.joint_limits, has_bodies=chain.masses is not None)
    limits = described.limits
    if options.part is not None:
        chain = description.cell(chain, limits, options.part, options.tilt)
    chain = chain.replace(columns=_columns(chain))
    notes = (
        *description.notes,
        _note_ranges(moving),
        described.note,
        missing_meshes(tree),
        _note_without_shape(description),
        _note_columns(chain),
    )
    arm = SerialArm(
        name=tree.name,
        chain=chain,
        limits=limits,
        source=tree.file,
        limits_hint="" if limits.joint_acceleration is not None else HINT,
        notes=tuple(f"{file.name}: {x}." for x in notes if x),
        assumed_limits=described.assumed,
    )
    if all(x.find("collision") is None for x in tree.links.values()):
        return arm
    return arm.with_shapes(partial(_shapes, arm, description))


def _columns(chain: Chain) -> tuple[int, ...]:
    """Return the indices of revolute joints that carry a robot of six joints, from the floor."""
    first = chain.floor_link
    robot = np.arange(len(chain) - ROBOT_JOINTS, len(chain))
    before = [k for k in range(first, int(robot[0])) if not chain.slides[k]]
    if not before or chain.followers:
        return ()
    own = chain.replace(
        **joint_rows(chain, robot), positioner=None, floor_link=0, floor=Frame(), base=Frame()
    )
    return tuple(before) if ClosedForm.from_chain(own) is not None else ()


def _note_columns(chain: Chain) -> str:
    """Return a note on rotating columns, which exports write as external axes."""
    if not chain.columns:
        return ""
    names = ", ".join(chain.joints[k] for k in chain.columns)
    return f"{names} counts as an external axis, because it carries a robot of six joints"


def _note_ranges(moving: list[Joint]) -> str:
    """Return a note on the ranges of continuous joints, which have none by their type."""
    names = [x.name for x in moving if x.kind == "continuous" and _has_range(x)]
    if not names:
        return ""
    return (
        f"the ranges of {list_some(names, MAX_NAMED)} are ignored, because the type of these "
        "joints is continuous; for a range, use the type revolute"
    )


def _has_range(joint: Joint) -> bool:
    """Return whether a joint has a lower or an upper limit that is not 0."""
    limit = joint.element.find("limit")
    return limit is not None and any(
        plain_number(limit.get(key)) not in (None, 0) for key in ("lower", "upper")
    )


def _note_without_shape(description: Description) -> str:
    """Return a note on links whose shapes are left out, because their joints follow others."""
    count = len(description.moving)
    left_out = [
        name
        for name, (number, _) in description.link_frames().items()
        if number > count and description.tree.links[name].find("collision") is not None
    ]
    if not left_out:
        return ""
    return (
        f"the shapes of {list_some(left_out, MAX_NAMED)} are left out, because joints that follow "
        "others carry these links; the clearance does not include them"
    )


def _shapes(arm: SerialArm, description: Description) -> ArmShapes:
    """Return the shapes of a description's links; links after the last moving link are tools."""
    # Imported here, because the import loads compiled code of motions.
    from armcontour.files.robots.collision_shapes import link_shapes
    from armcontour.files.robots.urdf_chain import Description
    from armcontour.verification.clearance.body_pairs import exclude_touching

    tree = description.tree
    carried = description.shape_frames(arm.chain)
    # Links that are not below the base are fixed, because their joints do not move.
    others = Description(tree, (), (), tree.root).link_frames()
    floor = carried[description.base][0]
    base_in_root = others[description.base][1]
    root_to_floor = arm.chain.floor @ base_in_root.inverse
    fixed = {
        x: (floor, root_to_floor @ place) for x, (_, place) in others.items() if x not in carried
    }
    last = description.moving[-1].child
    shapes = link_shapes(tree, {**fixed, **carried}, last)
    source = f"collision elements of {FilePath(tree.file).name}"
    return exclude_touching(arm.with_shapes(ArmShapes(shapes=shapes, source=source)))


def _default_tip(tree: Tree, base: str) -> str:
    """Return the tip of a description if the options do not name it: `tool0`, else `flange`."""
    tip = next((x for x in TOOL_FRAMES if x in tree.links), None)
    if tip is not None:
        return tip
    below = tree.below(base)
    if all(x.kind == "fixed" for x in below):
        raise InvalidInput(
            f"{tree.file} does not describe an arm, because no joint below the link {base} moves."
        )
    ends = [x.child for x in below if not tree.child_joints(x.child)]
    raise InvalidInput(
        f"{tree.file} has no link {' or '.join(TOOL_FRAMES)}, so its tip must be specified with "
        f"tip= (in a job, arm.tip; on the command line, --arm JOB). Links without a child are "
        f"{list_some(ends, MAX_NAMED)}."
    )


def _part_joints(tree: Tree, base: str, part: str, arm: list[Joint]) -> list[Joint]:
    """Return joints of a positioner, from the part to the base; checks that they are a branch."""
    joints = [x for x in tree.between(base, part, "part") if x.kind != "fixed"][::-1]
    shared = next((x.name for x in joints if x in arm), None)
    if shared is not None:
        raise InvalidInput(
            f"The part {part} of {tree.file} is on the branch of the arm, because joint {shared} "
            "moves both. Choose another part or base."
        )
    _check_moving_joints(tree, joints, "part")
    return joints


def _following_joints(route: list[Joint]) -> list[Joint]:
    """Return the revolute joints of a route that mimic one of its joints, before the last joint."""
    names = {x.name for x in route if x.master is None}
    last = max((k for k, x in enumerate(route) if x.master is None), default=0)
    following: list[Joint] = []
    for joint in route[:last]:
        if joint.master in names and joint.kind in ("revolute", "continuous"):
            following.append(joint)
            names.add(joint.name)
    return following


def _check_moving_joints(tree: Tree, moving: list[Joint], end: str = "tip") -> None:
    """Check that there are moving joints, and that they have one position and are independent."""
    if not moving:
        raise InvalidInput(
            f"No joint moves between base and {end} in {tree.file}. Choose another base or {end}."
        )
    for joint in moving:
        if joint.kind not in ARM_TYPES:
            raise InvalidInput(
                f"Joint {joint.name} of {tree.file} is {joint.kind}, but the joints of an arm must "
                f"be revolute or prismatic. Choose a base and a {end} without it between "
                f"them, or make it fixed in the file."
            )
        if joint.master is not None:
            raise InvalidInput(
                f"Joint {joint.name} of {tree.file} mimics {joint.master}. Only a revolute joint "
                "before the last joint of an arm can follow another one, which is between the same "
                f"base and tip. Choose a base and a {end} without it between them, or make it "
                "fixed in the file."
            )


@dataclass(frozen=True, slots=True)
class _DescribedLimits:
    """Limits of a description."""

    limits: Limits
    note: str  # On missing and assumed limits; empty without them
    assumed: Limits | None = None  # Limits that are assumed for all joints; None without them


def _limits(
    tree: Tree, moving: list[Joint], file: str | FilePath | None, *, has_bodies: bool
) -> _DescribedLimits:
    """Read the limits of the moving joints, and note which are missing or assumed.

    Args:
        tree: The description.
        moving: The joints.
        file: A joint_limits.yaml, whose limits replace those of the description.
        has_bodies: Whether the links have masses. Otherwise torque limits are not used.
    """
    names = [joint.name for joint in moving]
    table = _table(tree, moving)
    _apply_soft_limits(table, moving, tree.file)
    stated: Table = {**table, **{name: [None] * len(moving) for name in JOINT_RANGE}}
    stated = {name: list(values) for name, values in stated.items()}
    if file is not None:
        override_limits(table, names, file)
        override_limits(stated, names, file)
    if not has_bodies:
        table["joint_torque"] = [None] * len(moving)
    described = make_limits(table, names, tree.file, [x.kind == "prismatic" for x in moving])
    _check_radians(table, stated, moving, tree.file)
    limits, assumed_note = assume_accelerations(described, names)
    missing = _missing_limits_note(limits, moving, has_bodies=has_bodies)
    note = "; ".join(x for x in (missing, assumed_note) if x)
    if not assumed_note or described.joint_acceleration is not None:
        return _DescribedLimits(limits, note)
    assumed = Limits(joint_acceleration=limits.joint_acceleration)
    return _DescribedLimits(limits, note, assumed)


def assume_accelerations(limits: Limits, joints: Sequence[str]) -> tuple[Limits, str]:
    """Limits with accelerations derived from velocities where they are missing, and a note."""
    current = or_unlimited(limits.joint_acceleration, len(joints))
    missing = np.isinf(current)
    fastest = or_unlimited(limits.joint_velocity, len(joints))
    assumed = np.where(missing, fastest / ASSUMED_RISE_TIME, current)
    if not missing.any() or np.isinf(assumed).any():
        return limits, ""
    lacking = [name for name, x in zip(joints, missing, strict=True) if x]
    some = "" if missing.all() else f" of {list_some(lacking, MAX_NAMED)}"
    return limits.replace(joint_acceleration=assumed), ASSUMED_NOTE.format(some)


def _table(tree: Tree, moving: list[Joint]) -> Table:
    """Return the table of the limits in a description; limits of at most 0 count as missing."""
    table: Table = {name: [] for name in (*DESCRIBED_LIMITS, *JOINT_RANGE)}
    for joint in moving:
        for name, keys in DESCRIBED_LIMITS.items():
            values = (joint.number("limit", key, tree.file) for key in keys)
            table[name].append(min((x for x in values if x is not None and x > 0), default=None))
        for name, key in zip(JOINT_RANGE, ("lower", "upper"), strict=True):
            value = None
            if joint.kind != "continuous" and joint.element.find("limit") is not None:
                # In URDF, a missing lower or upper attribute means 0.
                value = joint.number("limit", key, tree.file) or 0.0
            table[name].append(value)
    return table


def _apply_soft_limits(table: Table, moving: list[Joint], file: str) -> None:
    """Narrow ranges to the soft limits of safety controllers."""
    for k, joint in enumerate(moving):
        low, high = (joint.number("safety_controller", key, file) for key in SOFT)
        # A safety controller that limits only the speed has no soft limits, or both are 0.
        if joint.kind != "continuous" and low is not None and high is not None and low < high:
            narrow_range(table, k, low, high)


def _check_radians(table: Table, stated: Table, moving: list[Joint], file: str) -> None:
    """Check that joint ranges are not probably in degrees; `stated` ranges are not checked."""
    for k, joint in enumerate(moving):
        low, high = (table[name][k] or 0.0 for name in JOINT_RANGE)
        # For joints without a range, descriptions often have plus and minus a power of ten.
        endless = low == -high and math.log10(high or 1.0).is_integer()
        is_stated = any(stated[name][k] is not None for name in JOINT_RANGE)
        angular = joint.kind != "prismatic"
        if angular and MAX_RADIANS < max(-low, high) < MAX_DEGREES and not (endless or is_stated):
            raise InvalidInput(
                f"{file}: the range of joint {joint.name} from {low:g} to {high:g} rad is "
                f"{(high - low) / (2 * math.pi):.0f} turns. If the values are degrees, convert "
                f"them to radians, {math.radians(low):.4g} to {math.radians(high):.4g}. If they "
                "are correct, repeat them with has_position_limits, min_position and max_position "
                "in a joint_limits.yaml."
            )


def _missing_limits_note(limits: Limits, moving: list[Joint], *, has_bodies: bool) -> str:
    """Note on the limits that joints of a description do not have; empty if it has all."""
    lacking = {}
    for name, (kind, *_) in DESCRIBED_LIMITS.items():
        unlimited = np.isinf(or_unlimited(getattr(limits, name), len(moving)))
        expected = name == "joint_velocity" or has_bodies and name == "joint_torque"
        if unlimited.any() and (expected or not unlimited.all()):
            joints = [x.name for x, none in zip(moving, unlimited, strict=True) if none]
            lacking[kind] = f"no {kind} of {list_some(joints, MAX_NAMED)}"
    bounded = [x for x in moving if x.kind != "continuous"]
    endless = [x.name for x in bounded if x.element.find("limit") is None]
    if endless:
        lacking["position"] = f"no range of {list_some(endless, MAX_NAMED)}"
    if not lacking:
        return ""
    keys = ", ".join(f"has_{kind}_limits and {'/'.join(KINDS[kind])}" for kind in lacking)
    return (
        f"it has {' and '.join(lacking.values())} (values of at most 0 are ignored), so these "
        f"joints have no such limits; specify them with joint_limits ({keys}) or with limits"
    )
