"""Reader of a robot description (URDF) as a checked tree of links and joints."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path as FilePath

from armcontour.core.checks import check_name
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import Checked, declared
from armcontour.core.file_access import ENDINGS
from armcontour.core.text import list_some, plain_number, show
from armcontour.robot.external_axes import Tilt

# Extension of robot descriptions.
DESCRIPTION = ".urdf"
# Longest name of a robot, joint or link [characters]. It is large, because some
# packages add prefixes to names.
MAX_CHARACTERS = 1000
# Options that are valid for any arm; the others are only for robot descriptions.
ANY_OPTIONS = ("joint_limits", "srdf", "calibration")
# Types of joints whose position is one angle or one distance.
ARM_TYPES = ("revolute", "continuous", "prismatic")
JOINT_TYPES = (*ARM_TYPES, "fixed", "planar", "floating")
# Attributes of the elements that determine the motion of an arm (URDF 1.2), by tag. `dont_collapse`
# is an extension of simulators that merge links.
ATTRIBUTES = {
    "joint": {"name", "type", "dont_collapse"},
    "origin": {"xyz", "rpy", "quat_xyzw"},
    "axis": {"xyz"},
    "limit": {"lower", "upper", "effort", "velocity", "acceleration", "deceleration", "jerk"},
}
# Maximum number of names that a message lists.
MAX_NAMED = 40


@declared()
class ArmOptions(Checked):
    """Options for loading an arm: keys of a job's arm, and arguments of `load_arm`.

    Args:
        tip: Link at the end of the arm, for a robot description (.urdf); by default `tool0`, or
            `flange` if there is no `tool0`.
        base: Fixed link at the start of the arm, for a robot description; by default the root.
        part: Link that carries the part, for a robot description of a cell: the joints between it
            and the base are the axes of a positioner, and its frame is the default work frame.
        tilt: Largest angle between the tool axis and gravity [rad]: the positioner turns the part
            so that the tool points downwards. By default any angle is allowed.
        joint_limits: A joint_limits.yaml of MoveIt, which replaces limits of the arm's own file.
            Its default scaling factors are not applied.
        calibration: File of UR's `ur_calibration` for a built-in UR arm (.yaml): the transforms of
            the six links of your robot, which differ from the nominal ones by up to centimetres at
            the tool.
        srdf: A file of MoveIt (.srdf) with the pairs of links that may touch each other.

    Raises:
        InvalidInput: A value has the wrong type.
    """

    tip: str | None = None
    base: str | None = None
    part: str | None = None
    tilt: Tilt | None = None
    joint_limits: str | FilePath | None = None
    calibration: str | FilePath | None = None
    srdf: str | FilePath | None = None

    def _check_together(self) -> None:
        if self.tilt is not None and self.part is None:
            raise InvalidInput("tilt requires part, the link of a description that carries a part.")


def refuse_urdf_options(options: ArmOptions, arm: str) -> None:
    """Refuse options that only .urdf files have; `arm` names the arm in the message."""
    for option in fields(ArmOptions):
        if option.name not in ANY_OPTIONS and getattr(options, option.name):
            raise InvalidInput(
                f"{arm} has no option {option.name}, which is valid only for .urdf files."
            )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Joint:
    """A joint of a robot description."""

    name: str
    kind: str
    parent: str
    child: str
    element: ET.Element

    @property
    def master(self) -> str | None:
        """Name of the joint that this joint mimics; None if this joint is independent."""
        element = self.element.find("mimic")
        return None if element is None else element.get("joint", "")

    def number(self, tag: str, key: str, source: str) -> float | None:
        """Return the number in the attribute `key` of the joint's element `tag`; None without it.

        `source`: the file, for messages.
        """
        element = self.element.find(tag)
        text = None if element is None else element.get(key)
        value = plain_number(text)
        if text is not None and value is None:
            raise InvalidInput(
                f"{source}: {key} of the {tag} of joint {self.name} must be one finite number, but "
                f"is {show(text)}."
            )
        return value


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Tree:
    """Links and joints of a robot description."""

    file: str  # Path of the file
    name: str  # Name of the robot
    links: Mapping[str, ET.Element]  # XML elements of the links, by name
    joints: Mapping[str, Joint]  # Joints by name, in the order of the file
    # Parent joint of each link except the root, by name of the link
    parent_joints: Mapping[str, Joint] = field(default_factory=dict)
    # Child joints of each link, by name of the link
    _carried: dict[str, list[Joint]] = field(init=False, default_factory=dict)

    def __post_init__(self) -> None:
        for joint in self.joints.values():
            self._carried.setdefault(joint.parent, []).append(joint)

    @property
    def root(self) -> str:
        """Name of the root link, which has no parent joint."""
        return next(link for link in self.links if link not in self.parent_joints)

    def child_joints(self, link: str) -> list[Joint]:
        """Child joints of a link."""
        return self._carried.get(link, [])

    def below(self, link: str) -> list[Joint]:
        """Return all joints below a link, parents before children."""
        joints: list[Joint] = []
        waiting = [link]
        while waiting:
            nearest = self.child_joints(waiting.pop())
            joints += nearest
            waiting += [joint.child for joint in nearest]
        return joints

    def between(self, base: str, tip: str, role: str = "tip") -> list[Joint]:
        """Return the joints on the path from the link `base` to the link `tip`, in this order."""
        link = self.check_link(role, tip)
        start = self.check_link("base", base)
        joints: list[Joint] = []
        # The joints are collected from the tip to the base, and reversed at the end.
        while link != start:
            if link not in self.parent_joints:
                raise InvalidInput(
                    f"The {role} {tip} is not below the base {start} in {self.file}. Choose "
                    f"another base, such as {self.root}."
                )
            joints.append(self.parent_joints[link])
            link = joints[-1].parent
        return joints[::-1]

    def check_link(self, role: str, name: str) -> str:
        """Check that a link exists, and return its name; `role` is for messages."""
        if name not in self.links:
            raise InvalidInput(
                f"The {role} must be a link of {self.file}, but is {name!r}. The links are "
                f"{list_some(list(self.links), MAX_NAMED)}."
            )
        return name


def read_tree(file: str, content: bytes | str) -> Tree:
    """Read and check the tree of links and joints in a robot description."""
    robot = parse_xml(file, content)
    if robot.tag != "robot":
        raise InvalidInput(
            f"{file} is not a robot description, because its root element is <{robot.tag}>, not "
            "<robot>."
        )
    check_name(f"name of the robot of {file}", robot.get("name", ""), longest=MAX_CHARACTERS)
    if _needs_xacro(robot):
        raise InvalidInput(f"{file} has xacro elements that are not expanded. {ENDINGS['.xacro']}.")
    links: dict[str, ET.Element] = {}
    version = robot.get("version", "1.0")
    for element in (*robot.findall("link"), *robot.findall("joint")):
        _check_attributes(file, element, version)
    for element in robot.findall("link"):
        name = _required_name(file, element)
        if name in links:
            raise InvalidInput(f"{file} has two links with the name {name}.")
        links[name] = element
    joints, above = _joints(file, robot, links)
    roots = [name for name in links if name not in above]
    if not links:
        raise InvalidInput(f"{file} is a robot description without links.")
    if len(roots) > 1:
        raise InvalidInput(
            f"{file} must have only one link without a parent joint, but has "
            f"{list_some(roots, MAX_NAMED)}."
        )
    tree = Tree(
        file=file, name=robot.get("name") or file, links=links, joints=joints, parent_joints=above
    )
    if not roots or len(tree.below(roots[0])) < len(joints):
        raise InvalidInput(f"The links of {file} must form a tree, but some joints form a loop.")
    return tree


def _needs_xacro(robot: ET.Element) -> bool:
    """Return whether a description must be expanded by xacro.

    Definitions of properties and arguments that no attribute uses have no effect.
    """
    used = {str(x.tag).rpartition("xacro}")[2] for x in robot if _is_xacro(x)}
    if not used <= {"property", "arg"}:
        return True
    return bool(used) and any(
        mark in value for x in robot.iter() for value in x.attrib.values() for mark in ("${", "$(")
    )


def _is_xacro(element: ET.Element) -> bool:
    """Return whether an element is in a namespace of xacro."""
    return str(element.tag).startswith("{") and "xacro" in str(element.tag)


def _check_attributes(file: str, element: ET.Element, version: str) -> None:
    """Check that URDF has the attributes of a link or joint, because others have no effect."""
    for part in element.iter():
        known = ATTRIBUTES.get(part.tag, set(part.attrib))
        # ROS ignores quaternions in files of version 1.0.
        unknown = sorted(part.attrib.keys() - (known - {"quat_xyzw"} if version < "1.1" else known))
        if unknown:
            fix = "Correct or remove it"
            if unknown[0] in known:
                fix = f'Specify <robot version="1.1">, which has {unknown[0]}'
            raise InvalidInput(
                f"{file}: <{part.tag}> of the {element.tag} {show(element.get('name'))} has the "
                f"attribute {unknown[0]}, which URDF {version} does not have. {fix}."
            )


def _joints(
    file: str, robot: ET.Element, links: Mapping[str, ET.Element]
) -> tuple[dict[str, Joint], dict[str, Joint]]:
    """Return a robot's joints by name, and the parent joint of each link by the link's name."""
    joints: dict[str, Joint] = {}
    above: dict[str, Joint] = {}
    for element in robot.findall("joint"):
        joint = _joint(file, element, links)
        if joint.name in joints:
            raise InvalidInput(f"{file} has two joints with the name {joint.name}.")
        if joint.child in above:
            raise InvalidInput(
                f"The links of {file} must form a tree, but the link {joint.child} has two parent "
                f"joints, {above[joint.child].name} and {joint.name}."
            )
        joints[joint.name] = above[joint.child] = joint
    return joints, above


def parse_xml(file: str, content: bytes | str) -> ET.Element:
    """Parse an XML document and return its root element."""
    # A text is encoded as UTF-8, even if its first line names another encoding.
    data = content.encode() if isinstance(content, str) else content
    parser = ET.XMLParser(encoding="utf-8" if isinstance(content, str) else None)
    try:
        return ET.fromstring(data, parser)
    except (ET.ParseError, ValueError, LookupError) as error:
        raise InvalidInput(f"{file} is not valid XML: {error}.") from None


def _required_name(file: str, element: ET.Element) -> str:
    """Return the name of a link or joint; InvalidInput if it is missing."""
    name = element.get("name")
    if not name:
        raise InvalidInput(f"{file} has a {element.tag} without a name.")
    check_name(f"name of a {element.tag} of {file}", name, longest=MAX_CHARACTERS)
    return name


def _joint(file: str, element: ET.Element, links: Mapping[str, ET.Element]) -> Joint:
    """Make the joint of an XML element; its parent and child must be existing links."""
    name = _required_name(file, element)
    kind = element.get("type") or ""
    if kind not in JOINT_TYPES:
        raise InvalidInput(
            f"The type of joint {name} in {file} must be one of {', '.join(JOINT_TYPES)}, but is "
            f"{kind!r}."
        )
    ends = []
    for tag in ("parent", "child"):
        end = element.find(tag)
        link = None if end is None else end.get("link")
        if link not in links:
            raise InvalidInput(
                f"The {tag} of joint {name} in {file} must be an existing link, but is {link!r}."
            )
        ends.append(str(link))
    return Joint(name=name, kind=kind, parent=ends[0], child=ends[1], element=element)
