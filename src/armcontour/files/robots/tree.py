"""Read a robot description (URDF) as a tree of links and joints, and check it."""

from __future__ import annotations

import io
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass, field

from armcontour.core.checks import check_name
from armcontour.core.errors import InvalidInput
from armcontour.core.text import list_some, plain_number, show
from armcontour.files.robots.arm_options import MAX_CHARACTERS

# Kinds of joints whose position is one angle.
TURNING = ("revolute", "continuous")
KINDS = (*TURNING, "fixed", "prismatic", "planar", "floating")
# Deepest nesting of elements; the format needs 6.
DEEPEST = 100
# Robots have about 100 links.
MAX_LINKS = 1000
# Elements of all kinds: visuals, transmissions, plugins of simulators.
MAX_ELEMENTS = 200_000
# Largest number of names in a message.
MAX_NAMED = 40


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
        """Name of the joint that this joint mimics; None if it moves independently."""
        element = self.element.find("mimic")
        return None if element is None else element.get("joint", "")

    def number(self, tag: str, key: str, source: str) -> float | None:
        """The number in attribute `key` of the joint's element `tag`; None without one."""
        element = self.element.find(tag)
        text = None if element is None else element.get(key)
        value = plain_number(text)
        if text is not None and value is None:
            raise InvalidInput(
                f"{source}: {key} of the {tag} of joint {self.name} must be one finite number, not "
                f"{show(text)}."
            )
        return value


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Tree:
    """Links and joints of a robot description."""

    file: str  # Name of the file, for messages
    name: str
    links: Mapping[str, ET.Element]  # XML elements of the links, by name
    joints: Mapping[str, Joint]  # Joints by name, in the order of the file
    # The joint that carries each link except the root.
    above: Mapping[str, Joint] = field(default_factory=dict)
    _carried: dict[str, list[Joint]] = field(init=False, default_factory=dict)

    def __post_init__(self) -> None:
        for joint in self.joints.values():
            self._carried.setdefault(joint.parent, []).append(joint)

    @property
    def root(self) -> str:
        """The link that no joint moves."""
        return next(link for link in self.links if link not in self.above)

    def from_link(self, link: str) -> list[Joint]:
        """The joints attached to a link."""
        return self._carried.get(link, [])

    def below(self, link: str) -> list[Joint]:
        """All joints below a link, parents before children."""
        joints: list[Joint] = []
        waiting = [link]
        while waiting:
            nearest = self.from_link(waiting.pop())
            joints += nearest
            waiting += [joint.child for joint in nearest]
        return joints

    def between(self, base: str, tip: str) -> list[Joint]:
        """The joints from the link `base` to the link `tip`."""
        link, start = self.link("tip", tip), self.link("base", base)
        joints: list[Joint] = []
        # From the tip up to the base; reversed at the end.
        while link != start:
            if link not in self.above:
                raise InvalidInput(
                    f"The base {start} does not carry the tip {tip} in {self.file}: choose a "
                    f"base above it, such as {self.root}."
                )
            joints.append(self.above[link])
            link = joints[-1].parent
        return joints[::-1]

    def link(self, role: str, name: str) -> str:
        """The name of a link, which must exist."""
        if name not in self.links:
            raise InvalidInput(
                f"{self.file} has no link {name!r} to be the {role}: its links are "
                f"{list_some(list(self.links), MAX_NAMED)}."
            )
        return name


def read_tree(file: str, content: bytes | str) -> Tree:
    """Read and check the tree of links and joints in a robot description."""
    robot = parse_xml(file, content)
    if robot.tag != "robot":
        raise InvalidInput(
            f"{file} is not a robot description: it holds <{robot.tag}>, not <robot>."
        )
    check_name(f"name of the robot of {file}", robot.get("name", ""), longest=MAX_CHARACTERS)
    if any(str(element.tag).startswith("{") and "xacro" in str(element.tag) for element in robot):
        raise InvalidInput(
            f"{file} holds xacro that is not expanded: name it .xacro, and say "
            "with --trust-xacro that you trust it, to load it."
        )
    links: dict[str, ET.Element] = {}
    for element in robot.findall("link"):
        name = _required_name(file, element)
        if name in links:
            raise InvalidInput(f"{file} has two links of the name {name}.")
        links[name] = element
    joints, above = _joints(file, robot, links)
    roots = [name for name in links if name not in above]
    if not links:
        raise InvalidInput(f"{file} is a robot description without links.")
    if len(roots) > 1:
        raise InvalidInput(
            f"{file} is in parts: the links {list_some(roots, MAX_NAMED)} hang on nothing."
        )
    tree = Tree(file=file, name=robot.get("name") or file, links=links, joints=joints, above=above)
    if not roots or len(tree.below(roots[0])) < len(joints):
        raise InvalidInput(f"In {file} some joints make a loop: the links must make a tree.")
    return tree


def _joints(
    file: str, robot: ET.Element, links: Mapping[str, ET.Element]
) -> tuple[dict[str, Joint], dict[str, Joint]]:
    """The joints of a robot by name, and the joint that carries each link."""
    joints: dict[str, Joint] = {}
    above: dict[str, Joint] = {}
    for element in robot.findall("joint"):
        joint = _joint(file, element, links)
        if joint.name in joints:
            raise InvalidInput(f"{file} has two joints of the name {joint.name}.")
        if joint.child in above:
            raise InvalidInput(
                f"In {file} the link {joint.child} hangs on two joints, {above[joint.child].name} "
                f"and {joint.name}: the links must make a tree, without loops."
            )
        joints[joint.name] = above[joint.child] = joint
    return joints, above


def parse_xml(file: str, content: bytes | str) -> ET.Element:
    """Parse an XML document and return its outermost element."""
    data = content.encode() if isinstance(content, str) else content
    # Text is encoded as UTF-8 above, even if its first line names another encoding.
    parser = ET.XMLParser(encoding="utf-8" if isinstance(content, str) else None)
    depth = links = 0
    root: ET.Element | None = None
    try:
        events = ET.iterparse(io.BytesIO(data), ("start", "end"), parser)
        for count, (event, element) in enumerate(events):
            root = element if root is None else root
            depth += 1 if event == "start" else -1
            links += event == "start" and depth == 2 and element.tag == "link"
            _check_document_size(file, depth, links, count // 2)
    except (ET.ParseError, ValueError, LookupError) as error:
        if isinstance(error, InvalidInput):
            raise
        raise InvalidInput(f"{file} is not XML: {error}.") from None
    if root is None:
        raise InvalidInput(f"{file} is not XML: it holds no element.")
    return root


def _check_document_size(file: str, depth: int, links: int, elements: int) -> None:
    """Check that a document is not deeper or larger than a robot description."""
    if depth > DEEPEST:
        raise InvalidInput(f"{file} has elements nested more than {DEEPEST} deep.")
    for count, maximum, kind in (
        (links, MAX_LINKS, "links"),
        (elements, MAX_ELEMENTS, "elements"),
    ):
        if count > maximum:
            raise InvalidInput(
                f"{file} has more than the {maximum} {kind} that are read: take out what does not "
                "belong to the arm."
            )


def _required_name(file: str, element: ET.Element) -> str:
    """The name of a link or joint."""
    name = element.get("name")
    if not name:
        raise InvalidInput(f"{file} has a {element.tag} without a name.")
    check_name(f"name of a {element.tag} of {file}", name, longest=MAX_CHARACTERS)
    return name


def _joint(file: str, element: ET.Element, links: Mapping[str, ET.Element]) -> Joint:
    """The joint of an XML element, whose links must exist."""
    name, kind = _required_name(file, element), element.get("type") or ""
    if kind not in KINDS:
        raise InvalidInput(
            f"In {file} joint {name} has the type {kind!r}: it must be one of {', '.join(KINDS)}."
        )
    ends = []
    for tag in ("parent", "child"):
        end = element.find(tag)
        link = None if end is None else end.get("link")
        if link not in links:
            raise InvalidInput(f"In {file} joint {name} has no {tag} that is a link, but {link!r}.")
        ends.append(str(link))
    return Joint(name=name, kind=kind, parent=ends[0], child=ends[1], element=element)
