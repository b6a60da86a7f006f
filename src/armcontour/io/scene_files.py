"""Read files of obstacles: descriptions of cells (URDF), and scenes of MoveIt (.scene)."""

from __future__ import annotations

from pathlib import Path as FilePath

import numpy as np

from armcontour import _files
from armcontour._checks import FloatArray
from armcontour._text import plain_number, show
from armcontour.errors import InvalidInput, locate_errors
from armcontour.frames import Frame, exp, rotations
from armcontour.io.robots.collision import Packages, collisions, shape_of
from armcontour.io.robots.description import Description
from armcontour.io.robots.tree import read_tree
from armcontour.scene import Box, Cylinder, HalfSpace, Mesh, Obstacle, Shape, Sphere

URDF, SCENE = ".urdf", ".scene"
# What is said of the sizes of shapes of a scene, in one line.
SIZES = {
    "box": ("x", "y", "z"),
    "sphere": ("the radius",),
    "cylinder": ("the radius", "length"),
    "cone": ("the radius", "length"),
}
# A cone is replaced by a pyramid around it with so many sides, 0.5 % wider at its edges.
SIDES = 32
# Largest number of bodies, and of points and triangles of one mesh.
MOST_BODIES, MOST_POINTS = 10_000, 1_000_000


def read_scene_file(
    file: str | FilePath,
    *,
    unit: str | None = None,
    packages: Packages | None = None,
) -> tuple[Obstacle, ...]:
    """Read the obstacles of a file, in its own frame.

    Args:
        file: A description of a cell (.urdf), of which the `<collision>` elements are obstacles and
            moving joints stand still, at 0 or at the end of their range that is nearest to 0; or a
            scene of MoveIt (.scene), of which a plane is the half-space away from its normal.
        unit: Unit of the lengths of meshes that a description names without a scale; metres by
            default.
        packages: Folders of ROS packages of a description; others are looked for near the file.

    Raises:
        InvalidInput: No such file, another format, or a body that is none.
    """
    place = FilePath(file)
    kind = place.suffix.lower()
    if kind == URDF:
        return _read_urdf(place, unit, packages)
    if kind == SCENE:
        return _Lines(place).obstacles()
    raise InvalidInput(
        f"The file of obstacles {place} is not read: name a {URDF} file or a {SCENE} file of MoveIt"
        ", and meshes under the key meshes."
    )


def _read_urdf(
    place: FilePath, unit: str | None, packages: Packages | None
) -> tuple[Obstacle, ...]:
    """The collision elements of a description, where its links stand."""
    tree = read_tree(str(place), _files.read_bytes(place, "description of a cell"))
    found: list[Obstacle] = []
    for link, (_, frame) in Description(tree, (), (), {}, tree.root).carried().items():
        for k, x in enumerate(collisions(tree, link)):
            with locate_errors(place.name):
                shape = shape_of(tree, x, packages, unit)
                name = link if k == 0 else f"{link} {k + 1}"
                found.append(Obstacle(name=name, shape=shape, place=frame @ x.place))
    if not found:
        raise InvalidInput(f"{place} has no collision elements, so it describes no obstacles.")
    return tuple(found)


class _Lines:
    """The lines of a scene of MoveIt.

    Args:
        place: The file.
    """

    def __init__(self, place: FilePath) -> None:
        text = _files.read_text(place, "scene of MoveIt")
        self._place = place
        self._lines = [
            (number, line.strip())
            for number, line in enumerate(text.splitlines(), start=1)
            if line.strip()
        ]
        # The line that is read next; the first one is the name of the scene.
        self._at = 0 if self._lines and self._lines[0][1].startswith("*") else 1

    def obstacles(self) -> tuple[Obstacle, ...]:
        """The obstacles of the scene.

        Raises:
            InvalidInput: A line of another form.
        """
        found: list[Obstacle] = []
        while (line := self._next("* and the name of an object, or a dot at the end")) != ".":
            if not line.startswith("*") or not line[1:].strip():
                raise self._wrong("* and the name of an object, or a dot at the end")
            found += self._object(line[1:].strip())
            if len(found) > MOST_BODIES:
                raise InvalidInput(f"{self._place} has more than {MOST_BODIES:,} bodies.")
        return tuple(found)

    def _object(self, name: str) -> list[Obstacle]:
        """The bodies of an object, whose own pose comes first in the newer of both dialects."""
        newer = self._at < len(self._lines) and len(self._lines[self._at][1].split()) == 3
        frame = self._pose() if newer else Frame()
        found = []
        for k in range(self._count("the number of shapes", MOST_BODIES)):
            shape, own = self._shape()
            place = frame @ self._pose() @ own
            self._numbers(4, "the colour of a shape")
            body = name if k == 0 else f"{name} {k + 1}"
            with locate_errors(str(self._place)):
                found.append(Obstacle(name=body, shape=shape, place=place))
        for _ in range(self._count("the number of subframes", MOST_BODIES) if newer else 0):
            self._next("the name of a subframe")
            self._pose()
        return found

    def _shape(self) -> tuple[Shape, Frame]:
        """A shape, and its frame in that of the file's shape."""
        kind = self._next("the kind of a shape")
        if kind == "plane":
            return HalfSpace(), self._plane()
        if kind == "mesh":
            return self._mesh(), Frame()
        if kind not in SIZES:
            raise self._wrong(f"{', '.join(SIZES)}, plane or mesh")
        numbers = self._numbers(len(SIZES[kind]), f"{' and '.join(SIZES[kind])} of a {kind}")
        with locate_errors(self._here):
            if kind == "box":
                return Box(size=numbers), Frame()
            if kind == "sphere":
                return Sphere(radius=float(numbers[0])), Frame()
            body = Cylinder(radius=float(numbers[0]), length=float(numbers[1]))
            return (body if kind == "cylinder" else _around_cone(body)), Frame()

    def _plane(self) -> Frame:
        """The frame of a half-space whose surface is the plane a x + b y + c z + d = 0."""
        *normal, offset = self._numbers(4, "the four numbers of a plane").tolist()
        length = float(np.linalg.norm(normal))
        if length == 0:
            raise self._wrong("a plane whose normal has a length")
        z = np.array(normal) / length
        return Frame(position=-offset / length * z, rotation=upright(z))

    def _mesh(self) -> Mesh:
        """A mesh: numbers of points and triangles, points, triangles."""
        points, triangles = (int(x) for x in self._numbers(2, "numbers of points and triangles"))
        if not (4 <= points <= MOST_POINTS and 4 <= triangles <= MOST_POINTS):
            raise self._wrong(f"4 to {MOST_POINTS:,} points and triangles")
        corners = np.array([self._numbers(3, "a point of a mesh") for _ in range(points)])
        faces = np.array([self._numbers(3, "a triangle of a mesh") for _ in range(triangles)])
        if not ((faces >= 0) & (faces < points) & (faces == np.round(faces))).all():
            raise self._wrong(f"triangles of the mesh's points, from 0 to {points - 1}")
        with locate_errors(self._here):
            return Mesh(points=corners, triangles=faces.astype(np.intp), source="a mesh")

    def _pose(self) -> Frame:
        """A pose: a position, and a quaternion in the next line."""
        position = self._numbers(3, "the position of a pose")
        turn = self._numbers(4, "the quaternion of a pose")
        with locate_errors(self._here):
            return Frame(position=position, rotation=rotations("quaternion", turn))

    def _count(self, what: str, most: int) -> int:
        """A whole number from 0."""
        (found,) = self._numbers(1, what)
        if not (found == int(found) and 0 <= found <= most):
            raise self._wrong(f"{what}, from 0 to {most:,}")
        return int(found)

    def _numbers(self, count: int, what: str) -> FloatArray:
        """The numbers of the next line, (count,)."""
        found = [plain_number(x) for x in self._next(what).split()]
        if len(found) != count or None in found:
            raise self._wrong(f"{what}, {count} number{'s' if count > 1 else ''}")
        return np.array(found, dtype=np.float64)

    def _next(self, what: str) -> str:
        """The next line, which must hold something."""
        if self._at >= len(self._lines):
            raise InvalidInput(f"{self._place} ends early: {what} is missing.")
        self._at += 1
        return self._lines[self._at - 1][1]

    @property
    def _here(self) -> str:
        """The line that was read last, for messages."""
        return f"{self._place}, line {self._lines[self._at - 1][0]}"

    def _wrong(self, what: str) -> InvalidInput:
        """The error for the line that was read last."""
        line = self._lines[self._at - 1][1]
        return InvalidInput(f"{self._here}: {what} is needed, not {show(line)}.")


def upright(z: FloatArray) -> FloatArray:
    """A rotation whose z axis has a given direction, (3, 3).

    Args:
        z: The direction, of length 1, (3,).
    """
    axis = np.array([-z[1], z[0], 0.0])
    size = float(np.linalg.norm(axis))
    if size == 0:
        return np.diag([1.0, z[2], z[2]])
    return exp(axis / size * np.arctan2(size, z[2]))


def _around_cone(cone: Cylinder) -> Mesh:
    """A pyramid around a cone of some radius and length, with its tip upwards."""
    turn = 2 * np.pi / SIDES * np.arange(SIDES)
    radius, half = cone.radius / np.cos(np.pi / SIDES), cone.length / 2
    bottom = [radius * np.cos(turn), radius * np.sin(turn), np.full(SIDES, -half)]
    return Mesh(points=np.vstack([np.column_stack(bottom), [0.0, 0.0, half]]), source="a cone")
