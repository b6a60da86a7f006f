"""Make a chain of moving joints from a robot description, with all other joints locked."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from armcontour import _checks
from armcontour._checks import FloatArray
from armcontour._numbers import plain_number
from armcontour._text import show
from armcontour.arms.chain import Chain, refuse_inertia
from armcontour.arms.dynamics import pinocchio
from armcontour.errors import InvalidInput
from armcontour.frames import Frame, exp
from armcontour.io.robots.tree import Joint, Tree

# Longest sequence of joints of which each mimics the next; grippers have about 3.
MOST_MIMICS = 50
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
        self.tip = route[-1].child
        self.below = tree.below(base)
        self._names = {joint.name for joint in moving}

    def chain(self) -> Chain:
        """The chain of the moving joints, with the bodies that move with each joint.

        Raises:
            InvalidInput: An impossible body, or a joint that cannot be locked.
        """
        heavy = self._check_bodies()
        pin = pinocchio()
        try:
            model = pin.buildModelFromXML(self._rewrite(heavy))
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
        place, along = Frame.rpy(xyz, rpy), self._axis(joint) * value
        if joint.kind == "prismatic":
            return xyz + place.rotation @ along, rpy
        return xyz, _rpy(place.rotation @ exp(along))

    def _locked_position(self, joint: Joint, mimics: tuple[str, ...]) -> float:
        """Position of a locked joint: as given, as the mimicked joint requires, or 0.

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
        mimic = joint.element.find("mimic")
        if mimic is not None and given is None:
            return self._mimicking_position(joint, (*mimics, joint.name))
        value = 0.0 if given is None else _checks.number(f"position of {joint.name}", given)
        lower, upper = (joint.number("limit", key, file) for key in ("lower", "upper"))
        if joint.kind != "continuous" and lower is not None and upper is not None:
            if not lower <= value <= upper:
                unit = "m" if joint.kind == "prismatic" else "rad"
                raise InvalidInput(
                    f"Joint {joint.name} of {file} is locked at {value:g} {unit}, outside its "
                    f"range from {lower:g} to {upper:g} {unit}: give its position, with "
                    f"locked={{{joint.name!r}: ...}} (in a job, arm.locked)."
                )
        return value

    def _mimicking_position(self, joint: Joint, mimics: tuple[str, ...]) -> float:
        """Position of a joint that mimics another joint."""
        master = self.tree.joints.get(joint.element.find("mimic").get("joint", ""))  # type: ignore[union-attr]
        if master is None or master.name in mimics or len(mimics) > MOST_MIMICS:
            raise InvalidInput(
                f"Joint {joint.name} of {self.tree.file} mimics no joint that could move it."
            )
        if master.name in self._names:
            raise InvalidInput(
                f"Joint {joint.name} of {self.tree.file} mimics {master.name} of the arm: "
                "an arm cannot carry a joint that moves along with its own joints; lock it with "
                f"locked={{{joint.name!r}: ...}} (in a job, arm.locked)."
            )
        file = self.tree.file
        factor = joint.number("mimic", "multiplier", file)
        offset = joint.number("mimic", "offset", file) or 0.0
        position = self._locked_position(master, mimics)
        return (1.0 if factor is None else factor) * position + offset

    def _check_bodies(self) -> bool:
        """Check masses and inertias of all links; returns whether the links have masses."""
        file = self.tree.file
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
                mass = self._mass(joint.child, inertial)
                # A link on a fixed joint, such as a mere frame, may have the mass 0.
                if moves and mass == 0:
                    raise InvalidInput(
                        f"The link {joint.child} of {file} has the mass 0 kg: it must be above "
                        "zero, as a joint moves it."
                    )
                weight[carrier] += mass
        for link, mass in weight.items():
            if known and mass <= 0:
                raise InvalidInput(
                    f"The link {link} of {file} has no mass, but other links have: give it an "
                    "inertial element with a mass above zero, or leave all of them out."
                )
        return known

    def _mass(self, link: str, inertial: ET.Element) -> float:
        """Mass of a link [kg]; checks its inertia and its centre of mass, too."""
        where = f"The link {link} of {self.tree.file}"
        mass = _attribute(where, inertial.find("mass"), "mass", "value")
        if mass < 0:
            raise InvalidInput(f"{where} has the mass {mass:g} kg: it must be above zero.")
        tensor = inertial.find("inertia")
        xx, xy, xz, yy, yz, zz = (_attribute(where, tensor, "inertia", key) for key in TENSOR)
        refuse_inertia(
            f"the link {link} of {self.tree.file}", [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]
        )
        origin = inertial.find("origin")
        for key in ("xyz", "rpy"):
            _three(where, key, "0 0 0" if origin is None else origin.get(key, "0 0 0"))
        return mass

    def _origin(self, joint: Joint) -> tuple[FloatArray, FloatArray]:
        """Position [m] and roll, pitch, yaw [rad] of a joint relative to its parent link."""
        where = f"Joint {joint.name} of {self.tree.file}"
        found = joint.element.find("origin")
        words = ["0 0 0"] * 2 if found is None else [found.get(x, "0 0 0") for x in ("xyz", "rpy")]
        return _three(where, "xyz", words[0]), _three(where, "rpy", words[1])

    def _axis(self, joint: Joint) -> FloatArray:
        """Unit vector of a joint axis, (3,)."""
        where = f"Joint {joint.name} of {self.tree.file}"
        found = joint.element.find("axis")
        axis = _three(where, "axis", "1 0 0" if found is None else found.get("xyz", "1 0 0"))
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


def _attribute(where: str, element: ET.Element | None, tag: str, key: str) -> float:
    """A number in an attribute of an element."""
    given = None if element is None else element.get(key)
    value = plain_number(given)
    if value is None or abs(value) > LARGEST:
        raise InvalidInput(
            f"{where} needs a number as {key} of its {tag}, up to {LARGEST:g}, not {show(given)}."
        )
    return value


def _three(where: str, what: str, words: str) -> FloatArray:
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


def _rpy(rotation: FloatArray) -> FloatArray:
    """Roll, pitch and yaw of a rotation matrix [rad], (3,)."""
    pitch = np.arctan2(-rotation[2, 0], np.hypot(rotation[0, 0], rotation[1, 0]))
    if np.hypot(rotation[0, 0], rotation[1, 0]) < 1e-9:
        # Roll and yaw have the same axis: the whole rotation goes to roll.
        return np.array([np.arctan2(-rotation[1, 2], rotation[1, 1]), pitch, 0.0])
    roll = np.arctan2(rotation[2, 1], rotation[2, 2])
    return np.array([roll, pitch, np.arctan2(rotation[1, 0], rotation[0, 0])])
