"""Creation of a chain from the moving joints of a robot description; other joints do not move."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.frames import Frame, exp, from_rpy, rotations
from armcontour.core.text import list_some, plain_number, show
from armcontour.files.robots.urdf_tree import Joint, Tree
from armcontour.robot.bodies import check_inertia, merge_bodies
from armcontour.robot.chain import Chain, Follower, joint_rows
from armcontour.robot.external_axes import Positioner, PositionerAxis
from armcontour.robot.limits import Limits

# Maximum number of joints in a row that mimic the next; grippers have about 3.
MAX_MIMICS = 50
# Maximum number of joints outside the arm that a note lists.
MAX_HELD = 8
# Largest position, axis component, mass or inertia [SI]; products of larger numbers may overflow.
LARGEST = 1e9
# Masses [kg] and radii of gyration [m] above these values get a note, because links of the largest
# robots have about 3 t and are about 3 m long. The file then probably has other units.
HEAVIEST = 20_000.0
LARGEST_GYRATION = 10.0
# Maximum number of faults in inertial data that a note lists.
MAX_FAULTS = 4
TENSOR = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


class Description:
    """The part of a robot description that belongs to an arm.

    Args:
        tree: The robot description.
        route: All joints from the base to the tip.
        moving: The joints of the arm; first those of a positioner, from the part to the base.
        base: Name of the base link.
        axes: Number of joints of the positioner.
        following: Joints between base and tip that mimic a joint of the arm.
    """

    def __init__(
        self,
        tree: Tree,
        route: Sequence[Joint],
        moving: Sequence[Joint],
        base: str,
        axes: int = 0,
        following: Sequence[Joint] = (),
    ) -> None:
        self.tree = tree
        self.moving = moving
        self.base = base
        self.tip = route[-1].child if route else base
        self.below = tree.below(base)
        self.axes = axes
        self.following = following
        self.notes: list[str] = []
        self._names = {joint.name for joint in moving}

    def chain(self) -> Chain:
        """Return the chain of the moving joints, with the bodies that move with each joint.

        Both branches, to the part and to the tip, start at the base.
        """
        carried = self.link_frames()
        has_bodies = self._check_bodies(carried)
        self._note_held_joints()
        places = [carried[joint.parent][1] @ self._joint_frame(joint) for joint in self.moving]
        bodies: dict[str, Any] = {}
        if has_bodies:
            links: list[Any] = [[] for _ in self.moving]
            for name, (link, place) in carried.items():
                body = self._body(name) if link else None
                if body is not None:
                    mass, frame, inertia = body
                    frame = place @ frame
                    rotated_inertia = frame.rotation @ inertia @ frame.rotation.T
                    links[link - 1].append((mass, frame.position, rotated_inertia))
            joined = zip(*map(merge_bodies, links), strict=True)
            bodies = dict(zip(("masses", "centers", "inertias"), joined, strict=True))
        return Chain(
            joints=tuple(joint.name for joint in self.moving),
            rotations=np.array([x.rotation for x in places]),
            positions=np.array([x.position for x in places]),
            axes=np.array([self._axis(joint) for joint in self.moving]),
            viscous=np.array([self._friction(joint, "damping") for joint in self.moving]),
            coulomb=np.array([self._friction(joint, "friction") for joint in self.moving]),
            prismatic=tuple(joint.kind == "prismatic" for joint in self.moving),
            followers=self._followers(carried),
            tip=carried[self.tip][1],
            **bodies,
        )

    def _followers(self, carried: Mapping[str, tuple[int, Frame]]) -> tuple[Follower, ...]:
        """Return the joints between base and tip that follow a joint of the arm.

        `carried`: see `link_frames`.
        """
        followers = []
        after = 0
        for joint in self.following:
            link, place = carried[joint.parent]
            # A link beyond those of the arm is carried by the previous follower.
            after = link - 1 if link <= len(self.moving) else after
            leader, factor, offset = self._leader_of(joint)
            axis = self._axis(joint)
            at_zero = origin_of(joint.element, f"Joint {joint.name} of {self.tree.file}")
            at_zero = at_zero @ Frame(rotation=exp(offset * axis))
            followers.append(
                Follower(
                    after=after, leader=leader, factor=factor, place=place @ at_zero, axis=axis
                )
            )
        return tuple(followers)

    def _leader_of(self, joint: Joint) -> tuple[int, float, float]:
        """Return the index of the arm's joint that a joint mimics, its factor and its offset."""
        names = [x.name for x in self.moving]
        factor = 1.0
        offset = 0.0
        while joint.name not in names:
            own = joint.number("mimic", "multiplier", self.tree.file)
            own = 1.0 if own is None else own
            offset += factor * (joint.number("mimic", "offset", self.tree.file) or 0.0)
            factor *= own
            joint = self.tree.joints[joint.master or ""]
        return names.index(joint.name), factor, offset

    def link_frames(self) -> dict[str, tuple[int, Frame]]:
        """Map each link to the moving link that carries it (0: the base), and its frame there."""
        # Joints that follow others carry links of their own, with the numbers after the arm's.
        carriers = (*self.moving, *self.following)
        number = {joint.name: k for k, joint in enumerate(carriers, start=1)}
        frames = {self.base: (0, Frame())}
        for joint in self.below:
            if joint.name in number:
                frames[joint.child] = number[joint.name], Frame()
            else:
                link, place = frames[joint.parent]
                frames[joint.child] = link, place @ self._joint_frame(joint)
        return frames

    def cell(self, rows: Chain, limits: Limits, part: str, tilt: float | None) -> Chain:
        """Make the chain from the part over the base to the tip.

        Args:
            rows: Joints of both branches, first those that move the part, in frames of the base.
            limits: Limits of these joints.
            part: Link that carries the part.
            tilt: Largest angle between the tool axis and gravity [rad]; None for any angle.

        Raises:
            InvalidInput: A joint that moves the part has no range, velocity or acceleration.
        """
        frames = self.axis_frames()
        from_base = range(self.axes - 1, -1, -1)
        axes = tuple(self._positioner_axis(rows, limits, k, frames[k + 1]) for k in from_base)
        link, place = self.link_frames()[part]
        arm = rows.replace(
            **joint_rows(rows, np.arange(self.axes, len(rows))),
            followers=tuple(x.shifted(-self.axes) for x in rows.followers),
            base=(frames[link] @ place).inverse,
        )
        cell = arm.on_positioner(Positioner(axes=axes, tilt=tilt))
        # A Positioner has no friction.
        return cell.replace(viscous=rows.viscous, coulomb=rows.coulomb)

    def _positioner_axis(self, rows: Chain, limits: Limits, k: int, frame: Frame) -> PositionerAxis:
        """Make the axis of joint k, which moves the part, in the joint's frame."""
        lower, upper = limits.joint_range(len(rows))
        velocity, acceleration = (
            np.abs(limits.bounds(x, len(rows))).min(axis=0)[k]
            for x in ("joint_velocity", "joint_acceleration")
        )
        slides = bool(rows.slides[k])
        needed = [velocity, acceleration, *([lower[k], upper[k]] if slides else [])]
        if not np.isfinite(needed).all():
            words = (
                "a range, a velocity and an acceleration"
                if slides
                else ("a velocity and an acceleration")
            )
            raise InvalidInput(
                f"Joint {rows.joints[k]} of {self.tree.file} requires {words}, because it moves "
                "the part. Specify them in the file or with joint_limits."
            )
        bodies = {}
        if rows.masses is not None:
            assert rows.centers is not None and rows.inertias is not None
            bodies = {
                "mass": rows.masses[k],
                "center": frame.position + frame.rotation @ rows.centers[k],
                "inertia": frame.rotation @ rows.inertias[k] @ frame.rotation.T,
            }
        return PositionerAxis(
            name=rows.joints[k],
            axis=frame.rotation @ rows.axes[k],
            origin=frame.position,
            lower=lower[k] if np.isfinite(lower[k]) else None,
            upper=upper[k] if np.isfinite(upper[k]) else None,
            velocity=velocity,
            acceleration=acceleration,
            prismatic=slides,
            **bodies,
        )

    def axis_frames(self) -> dict[int, Frame]:
        """Return the frames of a positioner's joints (1: next to the part) and of the base (0)."""
        carried = self.link_frames()
        frames = {0: Frame()}
        for k in range(self.axes, 0, -1):
            joint = self.moving[k - 1]
            link, place = carried[joint.parent]
            frames[k] = frames[link] @ place @ self._joint_frame(joint)
        return frames

    def shape_frames(self, chain: Chain) -> dict[str, tuple[int, Frame]]:
        """Return `link_frames` for the links of the chain, whose first link carries the part."""
        frames_of_chain = {}
        frames = self.axis_frames()
        for name, (number, place) in self.link_frames().items():
            if number > len(self.moving):
                continue
            link = number
            if number in frames:
                link = number - 1 if number else self.axes
                # The links of a positioner and the base have parallel frames at 0.
                offset = Frame(position=-chain.positions[:link].sum(axis=0))
                place = offset @ frames[number] @ place
            frames_of_chain[name] = link, place
        return frames_of_chain

    def _joint_frame(self, joint: Joint) -> Frame:
        """Return the frame of a joint's child link in the parent link.

        Joints of the arm are at 0, other joints at the position that they keep.
        """
        place = origin_of(joint.element, f"Joint {joint.name} of {self.tree.file}")
        value = 0.0 if joint.name in self._names else self._held_position(joint, ())
        if not abs(value) <= LARGEST:
            raise InvalidInput(
                f"The position of joint {joint.name} of {self.tree.file} must be at most "
                f"{LARGEST:g}, but is {value:g}."
            )
        if value == 0:
            return place
        along = self._axis(joint) * value
        if joint.kind == "prismatic":
            return place @ Frame(position=along)
        return place @ Frame(rotation=exp(along))

    def _held_position(self, joint: Joint, mimics: tuple[str, ...]) -> float:
        """Return the position that a joint outside the arm keeps [rad or m].

        It is that of the mimicked joint, or the position in the joint's range nearest to 0.

        `mimics`: names of the joints that mimic this joint, to detect a loop.
        """
        file = self.tree.file
        if joint.kind in ("fixed", "planar", "floating"):
            return 0.0
        if joint.master is not None:
            return self._mimicking_position(joint, (*mimics, joint.name))
        lower, upper = (joint.number("limit", key, file) for key in ("lower", "upper"))
        if joint.kind != "continuous" and lower is not None and upper is not None:
            if lower > upper:
                raise InvalidInput(
                    f"{file}: the lower end of the range of joint {joint.name} must be at most the "
                    f"upper end, but the range is from {lower:g} to {upper:g} {_unit(joint)}."
                )
            return min(max(0.0, lower), upper)
        return 0.0

    def _mimicking_position(self, joint: Joint, mimics: tuple[str, ...]) -> float:
        """Return the position of a joint that mimics another [rad or m], with the arm at 0."""
        master = self.tree.joints.get(joint.master or "")
        if master is None or master.name in mimics or len(mimics) > MAX_MIMICS:
            raise InvalidInput(
                f"Joint {joint.name} of {self.tree.file} must mimic an existing joint without a "
                f"loop, but mimics {show(joint.master)}."
            )
        file = self.tree.file
        factor = joint.number("mimic", "multiplier", file)
        offset = joint.number("mimic", "offset", file) or 0.0
        position = 0.0 if master.name in self._names else self._held_position(master, mimics)
        return (1.0 if factor is None else factor) * position + offset

    def _note_held_joints(self) -> None:
        """Add a note on the positions of joints outside the arm."""
        held = [
            f"{joint.name} at {self._held_position(joint, ()):.6g} {_unit(joint)}"
            for joint in self.below
            if self._is_held(joint)
        ]
        if held:
            self.notes.append(
                f"joints outside the arm do not move, {list_some(held, MAX_HELD)}; to change "
                "their positions, make them fixed in the file, with other origins"
            )

    def _is_held(self, joint: Joint) -> bool:
        """Return whether a movable joint neither belongs to the arm nor follows it."""
        if joint.kind in ("fixed", "planar", "floating") or joint.name in self._names:
            return False
        return not self._follows_arm(joint)

    def _follows_arm(self, joint: Joint) -> bool:
        """Return whether a joint mimics a joint of the arm, directly or through other joints."""
        for _ in range(MAX_MIMICS):
            master = self.tree.joints.get(joint.master or "")
            if master is None:
                return False
            if master.name in self._names:
                return True
            joint = master
        return False

    def _check_bodies(self, carried: Mapping[str, tuple[int, Frame]]) -> bool:
        """Return whether all links that the arm moves have valid masses; note ignored data.

        `carried`: see `link_frames`.
        """
        faults, has_bodies = self._inertia_faults(carried)
        if has_bodies and faults:
            self.notes.append(
                "masses, torques and effort limits are ignored, because "
                f"{list_some(faults, MAX_FAULTS)}; only kinematics are known"
            )
        elif not has_bodies and any(
            joint.number("limit", "effort", self.tree.file) is not None for joint in self.moving
        ):
            self.notes.append(
                "effort limits are ignored, because no link has a mass; only kinematics are known"
            )
        if has_bodies and not faults:
            self._note_implausible_bodies(carried)
        return has_bodies and not faults

    def _note_implausible_bodies(self, carried: Mapping[str, tuple[int, Frame]]) -> None:
        """Note moving links whose masses or inertias are possible, but not those of an arm."""
        found = []
        for joint in self.below:
            link, _ = carried[joint.child]
            body = self._body(joint.child) if 0 < link <= len(self.moving) else None
            if body is None:
                continue
            mass, _, inertia = body
            moment = float(np.linalg.eigvalsh(inertia)[-1])
            if mass > HEAVIEST:
                found.append(f"the link {joint.child} has the mass {mass:g} kg")
            elif moment > mass * LARGEST_GYRATION**2:
                found.append(
                    f"the link {joint.child} has a moment of inertia of {moment:.4g} kg m² at a "
                    f"mass of {mass:g} kg"
                )
        if found:
            self.notes.append(
                f"{list_some(found, MAX_FAULTS)}, which no link of an arm has; torques depend on "
                "it. Check that the units are kg and kg m²"
            )

    def _inertia_faults(self, carried: Mapping[str, tuple[int, Frame]]) -> tuple[list[str], bool]:
        """Describe faults in the inertial data; also return whether any link has such data."""
        faults = [f"joint {x.name} of the arm follows joint {x.master}" for x in self.following]
        # Mass that moves with each joint [kg].
        moved_masses = [0.0] * len(self.moving)
        has_bodies = False
        if self.following:
            has_bodies = any(x.find("inertial") is not None for x in self.tree.links.values())
        for joint in self.below:
            link, _ = carried[joint.child]
            if not 0 < link <= len(self.moving):
                continue
            body = self._body(joint.child)
            if body is not None:
                has_bodies = True
                mass = body[0]
                if mass < 0:
                    faults.append(f"the link {joint.child} has the mass {mass:g} kg")
                try:
                    check_inertia(f"the link {joint.child}", body[2])
                except InvalidInput as error:
                    text = str(error).rstrip(".")
                    faults.append(text[0].lower() + text[1:])
                # A link on a fixed joint may have the mass 0, because it can be only a frame.
                if joint.name in self._names and mass == 0:
                    faults.append(f"the link {joint.child}, which a joint moves, has the mass 0 kg")
                moved_masses[link - 1] += mass
            if self._follows_arm(joint) and self._has_mass(joint.child):
                faults.append(f"joint {joint.name} moves a mass along with joint {joint.master}")
        without_mass = [
            f"the link {joint.child} has no mass"
            for joint, mass in zip(self.moving, moved_masses, strict=True)
            if mass <= 0
        ]
        return faults or without_mass, has_bodies

    def _has_mass(self, link: str) -> bool:
        """Return whether a link, or a link below it, has a mass other than 0."""
        links = [link, *(joint.child for joint in self.tree.below(link))]
        masses = [self.tree.links[x].find("inertial/mass") for x in links]
        return any(x is not None and plain_number(x.get("value")) != 0 for x in masses)

    def _body(self, link: str) -> tuple[float, Frame, FloatArray] | None:
        """Read a link's mass [kg], frame at its centre of mass, and inertia there [kg m²], (3, 3).

        None if the link has no inertial data.
        """
        inertial = self.tree.links[link].find("inertial")
        where = f"The link {link} of {self.tree.file}"
        if inertial is None:
            return None
        mass = read_attribute(where, inertial.find("mass"), "mass", "value")
        tensor = inertial.find("inertia")
        xx, xy, xz, yy, yz, zz = (read_attribute(where, tensor, "inertia", key) for key in TENSOR)
        inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        return mass, origin_of(inertial, where), inertia

    def _axis(self, joint: Joint) -> FloatArray:
        """Return the unit vector of a joint axis, (3,)."""
        where = f"Joint {joint.name} of {self.tree.file}"
        element = joint.element.find("axis")
        words = "1 0 0" if element is None else element.get("xyz", "1 0 0")
        axis = read_numbers(where, "axis", words)
        size = float(np.linalg.norm(axis))
        if size == 0:
            raise InvalidInput(f"{where} has a zero axis. Specify a direction.")
        return axis / size

    def _friction(self, joint: Joint, key: str) -> float:
        """Return the damping [N m s/rad, N s/m] or friction [N m, N] of a joint; 0 if missing."""
        value = joint.number("dynamics", key, self.tree.file) or 0.0
        if value < 0:
            raise InvalidInput(
                f"The {key} of joint {joint.name} of {self.tree.file} must not be negative, but is "
                f"{value:g}."
            )
        return value


def _unit(joint: Joint) -> str:
    """Return the unit of a joint's position."""
    return "m" if joint.kind == "prismatic" else "rad"


def origin_of(element: ET.Element, where: str) -> Frame:
    """Return the frame that an element's origin describes."""
    origin = element.find("origin")
    words = {} if origin is None else origin.attrib
    position = read_numbers(where, "xyz", words.get("xyz", "0 0 0"))
    rotation = from_rpy(read_numbers(where, "rpy", words.get("rpy", "0 0 0")))
    if "quat_xyzw" in words:
        if "rpy" in words:
            raise InvalidInput(f"{where} has an origin with rpy and quat_xyzw. Remove one of them.")
        quaternion = read_numbers(where, "quat_xyzw", words["quat_xyzw"], 4)
        rotation = rotations(f"{where}: quat_xyzw", quaternion)
    return Frame(position=position, rotation=rotation)


def read_attribute(where: str, element: ET.Element | None, tag: str, key: str) -> float:
    """Return the number in the attribute `key` of an element.

    `where`, `tag`: the owner of the element and its tag, for messages.
    """
    text = None if element is None else element.get(key)
    value = plain_number(text)
    if value is None or abs(value) > LARGEST:
        raise InvalidInput(
            f"{where}: {key} of the {tag} must be a number of at most {LARGEST:g}, but is "
            f"{show(text)}."
        )
    return value


def read_numbers(where: str, name: str, words: str, count: int = 3) -> FloatArray:
    """Return the numbers in the text `words` of an attribute, (count,).

    `where`, `name`: the owner of the attribute and its name, for messages.
    """
    numbers = np.array([plain_number(x) for x in words.split()], dtype=np.float64)
    if numbers.shape != (count,) or not (np.abs(numbers) <= LARGEST).all():
        raise InvalidInput(
            f"{where}: {name} must be {count} numbers of at most {LARGEST:g}, but is {show(words)}."
        )
    return numbers
