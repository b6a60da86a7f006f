"""Collision elements of robot descriptions (URDF), and excluded pairs of links (SRDF)."""

from __future__ import annotations

import os
import re
import xml.etree.ElementTree as ET
from collections.abc import Collection, Mapping
from pathlib import Path as FilePath

from armcontour.core.checks import LONGEST_NAME, FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.frames import Frame
from armcontour.core.guesses import suggest
from armcontour.core.text import list_some, make_printable, shorten, show
from armcontour.files.mesh_file import MESHES, read_mesh
from armcontour.files.robots.urdf_chain import origin_of, read_attribute, read_numbers
from armcontour.files.robots.urdf_tree import MAX_NAMED, Tree, parse_xml
from armcontour.robot.scene import Box, Capsule, Cylinder, LeftOut, LinkShape, Shape, Sphere

# Maximum number of files that a note lists.
MAX_FILES = 4
# Maximum number of parent folders in which the package of a description is searched.
MAX_UP = 4
# Number of characters of a package's manifest in which its name is searched.
LONGEST_MANIFEST = 65_536


def excluded_pairs_of(
    content: bytes, location: FilePath, links: Collection[str]
) -> tuple[LeftOut, ...]:
    """Return the pairs of links that an SRDF file excludes from distance checks, with reasons."""
    # Typical reasons are "Never" (the pair never touched in random configurations) and "Default"
    # (the pair always touched).
    disabled = _disabled_pairs(content, location)
    every = {x.first for x in disabled} | {x.second for x in disabled}
    if every and not every & set(links):
        raise InvalidInput(
            f"{location} names no link of the arm that has a shape. It names "
            f"{list_some(sorted(every), MAX_NAMED)}, but the links with shapes are "
            f"{list_some(sorted(set(links)), MAX_NAMED)}."
        )
    pairs = {frozenset((x.first, x.second)): x for x in disabled}
    return tuple(x for pair, x in pairs.items() if pair <= set(links))


def note_unknown_links(
    content: bytes, location: FilePath, description: str, links: Collection[str]
) -> str:
    """Return a note on links that an SRDF file names, but an arm does not have.

    - `description`: file of the arm.
    - `links`: names of the arm's links.
    """
    named: dict[str, None] = {}
    for pair in _disabled_pairs(content, location):
        named |= {pair.first: None, pair.second: None}
    unknown = []
    for name in named:
        if name not in links:
            meant = suggest(name, links, "")
            unknown.append(f"{show(name)} ({meant})" if meant else show(name))
    if not unknown:
        return ""
    return (
        f"{location.name}: pairs of links with {list_some(unknown, MAX_NAMED)} are ignored, "
        f"because {FilePath(description).name} has no links with these names."
    )


def _disabled_pairs(content: bytes, location: FilePath) -> list[LeftOut]:
    """Return the pairs of links that an SRDF file excludes, whether or not the arm has them."""
    robot = parse_xml(str(location), content)
    if robot.tag != "robot":
        raise InvalidInput(
            f"{location} is not an SRDF file, because its root element is <{robot.tag}>, not "
            "<robot>."
        )
    return [_pair(x, location) for x in robot.findall("disable_collisions")]


def _pair(element: ET.Element, location: FilePath) -> LeftOut:
    """Return the pair of links that an element excludes, with the reason in the file."""
    first, second = (element.get(key, "").strip() for key in ("link1", "link2"))
    if not first or not second or first == second:
        raise InvalidInput(
            f"{location}: {element.tag} must have two different links, link1 and link2, but has "
            f"{show(first)} and {show(second)}."
        )
    reason = shorten(make_printable(element.get("reason", "").strip()), LONGEST_NAME)
    reason = reason or "no reason given"
    return LeftOut(first=first, second=second, reason=f"{location.name}: {reason}")


def link_shapes(
    tree: Tree,
    carried: Mapping[str, tuple[int, Frame]],
    last: str = "",
) -> tuple[LinkShape, ...]:
    """Return the shapes of the links of a description; links after the link `last` are tools.

    `carried` has the index of the chain's link and the frame in it of each link, by name.
    """
    shapes = []
    for name, (link, frame) in carried.items():
        tool = last in carried and link == carried[last][0] and name != last
        location = f"A collision of the link {name} of {tree.file}"
        for element in tree.links[name].findall("collision"):
            geometry = element.find("geometry")
            if geometry is None or len(geometry) != 1:
                raise InvalidInput(
                    f"{location} must have exactly one geometry: a box, cylinder, capsule, sphere "
                    "or mesh."
                )
            place = frame @ origin_of(element, location)
            shape = _shape_of(tree, geometry[0], location)
            body = LinkShape(name=name, link=link, shape=shape, place=place, tool=tool)
            shapes.append(body.with_hull())
    return tuple(shapes)


def _shape_of(tree: Tree, element: ET.Element, location: str) -> Shape:
    """Read a child of a `geometry` element, such as <box>; `location` is for messages."""
    kind = element.tag
    if kind == "box":
        return Box(size=read_numbers(location, "size", element.get("size", "")))
    if kind == "sphere":
        return Sphere(radius=read_attribute(location, element, kind, "radius"))
    if kind in ("cylinder", "capsule"):
        radius, length = (read_attribute(location, element, kind, x) for x in ("radius", "length"))
        return (Cylinder if kind == "cylinder" else Capsule)(radius=radius, length=length)
    if kind != "mesh":
        raise InvalidInput(
            f"{location} must be a box, cylinder, capsule, sphere or mesh, but is "
            f"{show(str(kind))}."
        )
    scale: FloatArray | None = None
    if "scale" in element.attrib:
        scale = read_numbers(location, "scale", element.get("scale", ""))
        # Many programs always write scale factors of 1, so a factor of 1 does not confirm the unit
        # m.
        scale = None if (scale == 1).all() else scale
    name = element.get("filename", "")
    file = find_mesh(tree, name)
    if file is None or not file.is_file():
        raise InvalidInput(
            f"{location} names the mesh {show(name)}, which does not exist"
            f"{'' if file is None else f' ({file})'}. {_advise_mesh(name)}."
        )
    return read_mesh(file, scale=scale)


def find_mesh(tree: Tree, name: str) -> FilePath | None:
    """File that a description names by package://, file:// or a path; None if it is not found."""
    folder = FilePath(tree.file).absolute().parent
    scheme, _, path = name.rpartition("://")
    if not path or scheme not in ("", "package", "file"):
        return None
    if scheme != "package":
        return folder / path
    package, _, path = path.partition("/")
    root = find_near(folder, package)
    return None if root is None else root / path


def missing_meshes(tree: Tree) -> str:
    """Note on missing and unsupported meshes of collision elements; empty if there are none."""
    names = list[str]()
    for link in tree.links.values():
        names += [x.get("filename", "") for x in link.iterfind("collision/geometry/mesh")]
    lacking = []
    # Each folder is searched only once, for its first mesh.
    roots: dict[str, FilePath | None] = {}
    for name in dict.fromkeys(names):
        folder = os.path.dirname(name)
        if folder not in roots:
            file = find_mesh(tree, name)
            roots[folder] = None if file is None else file.parent
        root = roots[folder]
        exists = root is not None and (root / os.path.basename(name)).is_file()
        if not exists or not name.lower().endswith(MESHES):
            lacking.append(name)
    if not lacking:
        return ""
    return (
        f"the clearance is unknown, because meshes are missing or have an unsupported format: "
        f"{list_some([show(x) for x in lacking], MAX_FILES)}. "
        f"{_advise_mesh(lacking[0])}"
    )


def _advise_mesh(name: str) -> str:
    """Advice, as a sentence without a period, for a mesh that is missing or unsupported."""
    if not name.lower().endswith(MESHES):
        return f"Convert it to {' or '.join(MESHES)}"
    if name.startswith("package://"):
        return f"Copy the folder {name.split('/')[2]} of this ROS package next to the description"
    return "Copy it to this path, relative to the description"


def find_near(folder: FilePath, name: str) -> FilePath | None:
    """Nearest folder of a ROS package: a parent with its name or manifest, or a parent's subfolder.

    A repository often gives the folder another name than the package.
    """
    for near in (folder, *folder.parents[:MAX_UP]):
        if near.name == name or _package_of(near) == name:
            return near
        if (near / name).is_dir():
            return near / name
    return None


def _package_of(folder: FilePath) -> str:
    """Name of the ROS package whose manifest `package.xml` is in a folder; empty without one."""
    manifest = folder / "package.xml"
    if not manifest.is_file():
        return ""
    with manifest.open(encoding="utf-8", errors="replace") as file:
        text = file.read(LONGEST_MANIFEST)
    name = re.search(r"<name>\s*([^<\s]+)\s*</name>", text)
    return name.group(1) if name else ""
