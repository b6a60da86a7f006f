"""Make a chain of moving joints from a robot description, with all other joints locked."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from armcontour.core import checks
from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.frames import Frame, exp, from_rpy, to_rpy
from armcontour.core.text import list_some, plain_number, show
from armcontour.files.robots.tree import Joint, Tree
from armcontour.robot.chain import Chain, check_inertia
from armcontour.robot.dynamics import pinocchio

# Longest sequence of joints of which each mimics the next; grippers have about 3.
MOST_MIMICS = 50
# Largest number of held joints in a note.
MOST_HELD = 8
# Largest position, axis component, mass or inertia [SI]: products of larger numbers may overflow.
LARGEST = 1e9
TENSOR = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


class Description:
    """The part of a robot description that belongs to an arm.

    Args:
        tree: The robot description.
        route: The joints from base to tip.
        moving: The joints of the route that move.
        locked: Positions of locked joints [rad or m].
        base: Fixed link at the start of the arm.

    Attributes:
        notes: What is left out of the chain or held still beside it; filled by `chain`.
    """

    def __init__(
        self,
        tree: Tree,
        route: Sequence[Joint],
        moving: Sequence[Joint],
        locked: Mapping[str, float],
        base: str,
    ) -> None:
        self.tree = tree
        self.moving = moving
        self.locked = locked
        self.base = base
        self.tip = route[-1].child if route else base
        self.below = tree.below(base)
        self.notes: list[str] = []
        self._names = {joint.name for joint in moving}

    def chain(self) -> Chain:
        """The chain of the moving joints, with the bodies that move with each joint.

        Raises:
            InvalidInput: A number that is none, or a joint that cannot be locked.
        """
        heavy = self._has_bodies()
        self._note_held_joints()
        pin, text = pinocchio(), self._rewrite(heavy)
        try:
            model = pin.buildModelFromXML(text)
        except (RuntimeError, ValueError) as error:
            raise InvalidInput(f"{self.tree.file} cannot be read: {error}.") from None
        ids = range(1, model.njoints)
        tip = model.frames[model.getFrameId(self.tip, pin.FrameType.BODY)].placement
        bodies: dict[str, Any] = {}
        if heavy:
            inertias = [model.inertias[i] for i in ids]
            bodies["masses"] = [x.mass for x in inertias]
            bodies["centers"] = [x.lever for x in inertias]
            # Symmetric only up to rounding.
            bodies["inertias"] = [(x.inertia + x.inertia.T) / 2 for x in inertias]
        return Chain(
            joints=tuple(joint.name for joint in self.moving),
            rotations=np.array([model.jointPlacements[i].rotation for i in ids]),
            positions=np.array([model.jointPlacements[i].translation for i in ids]),
            axes=np.array([self._axis(joint) for joint in self.moving]),
            viscous=np.array([self._loss(joint, "damping") for joint in self.moving]),
            coulomb=np.array([self._loss(joint, "friction") for joint in self.moving]),
            tip=Frame(position=tip.translation, rotation=tip.rotation),
            **bodies,
        )

    def carried(self) -> dict[str, tuple[int, Frame]]:
        """Of every link: which link of the chain carries it, and its frame there."""
        number = {joint.name: k for k, joint in enumerate(self.moving, start=1)}
        found = {self.base: (0, Frame())}
        for joint in self.below:
            if joint.name in number:
                found[joint.child] = number[joint.name], Frame()
            else:
                link, place = found[joint.parent]
                xyz, rpy = self._locked_origin(joint)
                here = Frame(position=xyz, rotation=from_rpy(rpy))
                found[joint.child] = link, place @ here
        return found

    def _rewrite(self, heavy: bool) -> str:
        """Write a description (URDF) of the arm alone, in which locked joints are fixed joints.

        Args:
            heavy: Whether the links have masses.
        """
        robot = ET.Element("robot", name="arm")
        ET.SubElement(robot, "link", name=self.base)
        for joint in self.below:
            link = ET.SubElement(robot, "link", name=joint.child)
            inertial = self.tree.links[joint.child].find("inertial")
            if heavy and inertial is not None:
                # These elements define the body; nothing else is copied.
                body = ET.SubElement(link, "inertial")
                for part in ("origin", "mass", "inertia"):
                    found = inertial.find(part)
                    if found is not None:
                        ET.SubElement(body, part, dict(found.attrib))
        for joint in self.below:
            moves = joint.name in self._names
            kind = "revolute" if moves else "fixed"
            element = ET.SubElement(robot, "joint", name=joint.name, type=kind)
            ET.SubElement(element, "parent", link=joint.parent)
            ET.SubElement(element, "child", link=joint.child)
            origin = self._origin(joint) if moves else self._locked_origin(joint)
            ET.SubElement(element, "origin", xyz=_words(origin[0]), rpy=_words(origin[1]))
            if moves:
                ET.SubElement(element, "axis", xyz=_words(self._axis(joint)))
                # pinocchio stores the angle of a joint without limits as two numbers. The true
                # ranges are in `Limits`.
                ends = {"lower": "-6", "upper": "6", "effort": "1", "velocity": "1"}
                ET.SubElement(element, "limit", ends)
        return ET.tostring(robot, encoding="unicode")

    def _locked_origin(self, joint: Joint) -> tuple[FloatArray, FloatArray]:
        """Position [m] and roll, pitch, yaw [rad] of the link after a locked joint."""
        xyz, rpy = self._origin(joint)
        value = self._locked_position(joint, ())
        if not abs(value) <= LARGEST:
            raise InvalidInput(
                f"Joint {joint.name} of {self.tree.file} is locked at {value:g}, beyond "
                f"{LARGEST:g}: give a position that it can take."
            )
        if value == 0:
            return xyz, rpy
        place, along = Frame(position=xyz, rotation=from_rpy(rpy)), self._axis(joint) * value
        if joint.kind == "prismatic":
            return xyz + place.rotation @ along, rpy
        return xyz, to_rpy(place.rotation @ exp(along))

    def _locked_position(self, joint: Joint, mimics: tuple[str, ...]) -> float:
        """Position of a locked joint: as given, as the mimicked joint requires, or nearest to 0.

        Args:
            joint: The joint.
            mimics: Names of the joints that mimic this joint, directly or through others.
        """
        file, given = self.tree.file, self.locked.get(joint.name)
        if joint.kind in ("fixed", "planar", "floating"):
            if given is not None:
                raise InvalidInput(
                    f"Joint {joint.name} of {file} is {joint.kind} and cannot be locked at a value."
                )
            return 0.0
        if joint.master is not None and given is None:
            return self._mimicking_position(joint, (*mimics, joint.name))
        value = 0.0 if given is None else checks.check_number(f"position of {joint.name}", given)
        lower, upper = (joint.number("limit", key, file) for key in ("lower", "upper"))
        if joint.kind != "continuous" and lower is not None and upper is not None:
            if given is None and lower <= upper:
                return min(max(value, lower), upper)
            if given is not None and not lower <= value <= upper:
                unit = _unit(joint)
                raise InvalidInput(
                    f"Joint {joint.name} of {file} is locked at {value:g} {unit}, outside its "
                    f"range from {lower:g} to {upper:g} {unit}: give its position, with "
                    f"locked={{{joint.name!r}: ...}} (in a job, arm.locked)."
                )
        return value

    def _mimicking_position(self, joint: Joint, mimics: tuple[str, ...]) -> float:
        """Position of a joint that mimics another joint; joints of the arm count as being at 0."""
        master = self.tree.joints.get(joint.master or "")
        if master is None or master.name in mimics or len(mimics) > MOST_MIMICS:
            raise InvalidInput(
                f"Joint {joint.name} of {self.tree.file} mimics no joint that could move it."
            )
        file = self.tree.file
        factor = joint.number("mimic", "multiplier", file)
        offset = joint.number("mimic", "offset", file) or 0.0
        position = 0.0
        if master.name not in self._names:
            position = self._locked_position(master, mimics)
        return (1.0 if factor is None else factor) * position + offset

    def _note_held_joints(self) -> None:
        """Note where joints beside the chain stand; joints that were locked are not named."""
        held = [
            f"{joint.name} at {self._locked_position(joint, ()):.6g} {_unit(joint)}"
            for joint in self.below
            if joint.kind not in ("fixed", "planar", "floating")
            and joint.name not in {*self._names, *self.locked}
            and not self._follows_arm(joint)
        ]
        if held:
            self.notes.append(
                f"joints beside the arm are held still, {list_some(held, MOST_HELD)}: other "
                "positions are given with locked= (in a job, arm.locked)"
            )

    def _follows_arm(self, joint: Joint) -> bool:
        """Whether a joint mimics a joint of the arm, directly or through other joints."""
        for _ in range(MOST_MIMICS):
            master = None if joint.name in self.locked else self.tree.joints.get(joint.master or "")
            if master is None:
                return False
            if master.name in self._names:
                return True
            joint = master
        return False

    def _has_bodies(self) -> bool:
        """Whether the links that the arm moves have masses; notes why not, if some have."""
        faults, heavy = self._faults()
        if heavy and faults:
            others = f", and {len(faults) - 1} more" if len(faults) > 1 else ""
            self.notes.append(
                f"masses, torques and limits of effort are left out, since {faults[0]}{others}; "
                "only kinematics are known"
            )
        elif not heavy and any(
            joint.number("limit", "effort", self.tree.file) is not None for joint in self.moving
        ):
            self.notes.append(
                "no link has a mass, so limits of effort are left out; only kinematics are known"
            )
        return heavy and not faults

    def _faults(self) -> tuple[list[str], bool]:
        """What keeps the links from being bodies, and whether any link has inertial data."""
        faults: list[str] = []
        after: dict[str, str] = {}
        weight: dict[str, float] = {joint.child: 0.0 for joint in self.moving}
        known = False
        for joint in self.below:
            moves = joint.name in self._names
            carrier = joint.child if moves else after.get(joint.parent)
            if carrier is None:
                continue
            after[joint.child] = carrier
            inertial = self.tree.links[joint.child].find("inertial")
            if inertial is not None:
                known = True
                mass = self._mass(joint.child, inertial, faults)
                # A link on a fixed joint, such as a mere frame, may have the mass 0.
                if moves and mass == 0:
                    faults.append(f"the link {joint.child}, which a joint moves, has the mass 0 kg")
                weight[carrier] += mass
            if self._follows_arm(joint) and self._weighs(joint.child):
                faults.append(f"joint {joint.name} moves a mass along with joint {joint.master}")
        bare = [f"the link {link} has no mass" for link, mass in weight.items() if mass <= 0]
        return faults or bare, known

    def _weighs(self, link: str) -> bool:
        """Whether a link, or one that hangs on it, has a mass other than 0."""
        links = [link, *(joint.child for joint in self.tree.below(link))]
        masses = [self.tree.links[x].find("inertial/mass") for x in links]
        return any(x is not None and plain_number(x.get("value")) != 0 for x in masses)

    def _mass(self, link: str, inertial: ET.Element, faults: list[str]) -> float:
        """Mass of a link [kg]; adds to `faults` why no body can have its mass and inertia."""
        where = f"The link {link} of {self.tree.file}"
        mass = attribute(where, inertial.find("mass"), "mass", "value")
        if mass < 0:
            faults.append(f"the link {link} has the mass {mass:g} kg")
        tensor = inertial.find("inertia")
        xx, xy, xz, yy, yz, zz = (attribute(where, tensor, "inertia", key) for key in TENSOR)
        try:
            check_inertia(f"the link {link}", [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        except InvalidInput as error:
            text = str(error).rstrip(".")
            faults.append(text[0].lower() + text[1:])
        origin = inertial.find("origin")
        for key in ("xyz", "rpy"):
            three(where, key, "0 0 0" if origin is None else origin.get(key, "0 0 0"))
        return mass

    def _origin(self, joint: Joint) -> tuple[FloatArray, FloatArray]:
        """Position [m] and roll, pitch, yaw [rad] of a joint relative to its parent link."""
        return origin_of(joint.element, f"Joint {joint.name} of {self.tree.file}")

    def _axis(self, joint: Joint) -> FloatArray:
        """Unit vector of a joint axis, (3,)."""
        where = f"Joint {joint.name} of {self.tree.file}"
        found = joint.element.find("axis")
        axis = three(where, "axis", "1 0 0" if found is None else found.get("xyz", "1 0 0"))
        size = float(np.linalg.norm(axis))
        if size == 0:
            raise InvalidInput(f"{where} has an axis of length 0: give it a direction.")
        return axis / size

    def _loss(self, joint: Joint, key: str) -> float:
        """Friction coefficient of a joint: its damping or its friction; 0 by default."""
        value = joint.number("dynamics", key, self.tree.file) or 0.0
        if value < 0:
            raise InvalidInput(
                f"Joint {joint.name} of {self.tree.file} has the {key} {value:g}: it must not be "
                "negative."
            )
        return value


def _unit(joint: Joint) -> str:
    """The unit of a joint's position."""
    return "m" if joint.kind == "prismatic" else "rad"


def origin_of(element: ET.Element, where: str) -> tuple[FloatArray, FloatArray]:
    """Position [m] and roll, pitch, yaw [rad] of an element's origin."""
    found = element.find("origin")
    words = ["0 0 0"] * 2 if found is None else [found.get(x, "0 0 0") for x in ("xyz", "rpy")]
    return three(where, "xyz", words[0]), three(where, "rpy", words[1])


def attribute(where: str, element: ET.Element | None, tag: str, key: str) -> float:
    """A number in an attribute of an element."""
    given = None if element is None else element.get(key)
    value = plain_number(given)
    if value is None or abs(value) > LARGEST:
        raise InvalidInput(
            f"{where} needs a number as {key} of its {tag}, up to {LARGEST:g}, not {show(given)}."
        )
    return value


def three(where: str, what: str, words: str) -> FloatArray:
    """Three numbers in the text of an attribute."""
    found = np.array([plain_number(x) for x in words.split()], dtype=np.float64)
    if found.shape != (3,) or not (np.abs(found) <= LARGEST).all():
        raise InvalidInput(
            f"{where} needs three numbers as its {what}, up to {LARGEST:g}, not {show(words)}."
        )
    return found


def _words(numbers: FloatArray) -> str:
    """Numbers as the text of an attribute."""
    return " ".join(repr(float(x)) for x in numbers)
