"""Shapes of links in a robot description (URDF): its `<collision>` elements."""

from __future__ import annotations

import os
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path as FilePath

from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.frames import Frame, from_rpy
from armcontour.core.text import list_some, show
from armcontour.files.mesh_file import MESHES, read_mesh
from armcontour.files.robots.description import attribute, origin_of, three
from armcontour.files.robots.packages import find_near
from armcontour.files.robots.tree import Tree
from armcontour.robot.scene import Box, Capsule, Cylinder, LinkShape, Shape, Sphere

# Largest number of files in a note.
MOST_FILES = 4

# Folders of ROS packages, by name.
Packages = Mapping[str, str | FilePath]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Collision:
    """A collision element of a link.

    Args:
        where: The element, for messages.
        geometry: What its `geometry` holds.
        place: Its frame in the frame of the link.
    """

    where: str
    geometry: ET.Element
    place: Frame


def link_shapes(
    tree: Tree,
    carried: Mapping[str, tuple[int, Frame]],
    packages: Packages | None = None,
    last: str = "",
) -> tuple[LinkShape, ...]:
    """Shapes of links, with the names of the links.

    Args:
        tree: The description.
        carried: By the names of links: the link of the chain that carries it, and its frame there.
        packages: Folders of ROS packages; others are looked for near the file.
        last: The link after the last moving joint: what hangs on it is the tool's.

    Raises:
        InvalidInput: A mesh file is missing, or a geometry tag is unknown.
    """
    found = []
    for name, (link, frame) in carried.items():
        tool = last in carried and link == carried[last][0] and name != last
        for x in collisions(tree, name):
            shape = shape_of(tree, x, packages)
            body = LinkShape(name=name, link=link, shape=shape, place=frame @ x.place, tool=tool)
            found.append(body.with_hull())
    return tuple(found)


def collisions(tree: Tree, link: str) -> Iterator[Collision]:
    """The collision elements of a link."""
    for element in tree.links[link].findall("collision"):
        where = f"A collision of the link {link} of {tree.file}"
        geometry = element.find("geometry")
        if geometry is None or len(geometry) != 1:
            raise InvalidInput(f"{where} needs one geometry: a box, cylinder, sphere or mesh.")
        xyz, rpy = origin_of(element, where)
        yield Collision(
            where=where, geometry=geometry[0], place=Frame(position=xyz, rotation=from_rpy(rpy))
        )


def shape_of(
    tree: Tree, found: Collision, packages: Packages | None = None, unit: str | None = None
) -> Shape:
    """The shape of a collision element.

    Args:
        tree: The description.
        found: The element.
        packages: As in `link_shapes`.
        unit: Unit of a mesh without a scale; metres by default.

    Raises:
        InvalidInput: An unknown geometry, a number that is none, or a mesh that is not there.
    """
    kind, element, where = found.geometry.tag, found.geometry, found.where
    if kind == "box":
        return Box(size=three(where, "size", element.get("size", "")))
    if kind == "sphere":
        return Sphere(radius=attribute(where, element, kind, "radius"))
    if kind in ("cylinder", "capsule"):
        radius, length = (attribute(where, element, kind, x) for x in ("radius", "length"))
        return (Cylinder if kind == "cylinder" else Capsule)(radius=radius, length=length)
    if kind != "mesh":
        raise InvalidInput(
            f"{where} is a {show(str(kind))}: only boxes, cylinders, capsules, spheres and meshes "
            "are known."
        )
    scale: FloatArray | None = None
    if "scale" in element.attrib:
        scale = three(where, "scale", element.get("scale", ""))
        # Many programs write factors of 1, which say nothing of the unit.
        scale = None if (scale == 1).all() else scale
    name = element.get("filename", "")
    place = find_mesh(tree, name, packages)
    if place is None or not place.is_file():
        raise InvalidInput(
            f"{where} names the mesh {show(name)}, which is not there"
            f"{'' if place is None else f' ({place})'}: {_mend(name)}."
        )
    return read_mesh(place, unit=unit if scale is None else None, scale=scale)


def find_mesh(tree: Tree, name: str, packages: Packages | None) -> FilePath | None:
    """The file that a description names, by package://, file:// or a path; None without one.

    Args:
        tree: The description; relative paths are relative to its folder.
        name: The name of the file in the description.
        packages: As in `link_shapes`.
    """
    folder = FilePath(tree.file).absolute().parent
    scheme, _, path = name.rpartition("://")
    if not path or scheme not in ("", "package", "file"):
        return None
    if scheme != "package":
        return folder / path
    package, _, path = path.partition("/")
    given = (packages or {}).get(package)
    root = find_near(folder, package) if given is None else FilePath(given)
    return None if root is None else root / path


def missing_meshes(tree: Tree, packages: Packages | None) -> str:
    """A note of the meshes of collision elements that are not there; empty if all are."""
    names = [
        mesh.get("filename", "")
        for link in tree.links.values()
        for mesh in link.iterfind("collision/geometry/mesh")
    ]
    lacking = []
    # Packages are looked for once: the first mesh of each folder tells of the others.
    roots: dict[str, FilePath | None] = {}
    for name in dict.fromkeys(names):
        folder = os.path.dirname(name)
        if folder not in roots:
            place = find_mesh(tree, name, packages)
            roots[folder] = None if place is None else place.parent
        root = roots[folder]
        there = root is not None and (root / os.path.basename(name)).is_file()
        if not there or not name.lower().endswith(MESHES):
            lacking.append(name)
    if not lacking:
        return ""
    return (
        f"meshes are not there, or of no known format, so nothing can be said of clearance: "
        f"{list_some([show(x) for x in lacking], MOST_FILES)}; {_mend(lacking[0])}"
    )


def _mend(name: str) -> str:
    """What would help with a mesh that is not there, or not read."""
    if not name.lower().endswith(MESHES):
        return f"give it as {' or '.join(MESHES)}"
    if name.startswith("package://"):
        package = name.split("/")[2]
        return (
            f"say where its package is, packages={{{package!r}: FOLDER}} (in a job, arm.packages)"
        )
    return "put it there, relative to the description"
