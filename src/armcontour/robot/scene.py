"""Shapes of an arm's links and tool, obstacles in its cell, and margins between them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Annotated, Literal

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import Checked, declared
from armcontour.core.frames import Frame
from armcontour.core.guesses import ExplainedABC
from armcontour.core.quantities import Axes, Choice, Distance, Length, Name, Quantity, Size

# Allowed largest sizes of meshes [m]. A mesh outside this range was probably read in another unit.
SMALLEST = 1e-3
LARGEST = 20.0
# Number of heights of a mesh's corners that are computed at once, which limits the memory.
HEIGHTS_AT_ONCE = 1 << 18
# Radius of the capsule that replaces a tool without shapes [m].
ASSUMED_RADIUS = 0.01
# Distance from the end of this capsule to the tool point [m].
ASSUMED_GAP = 0.02
# Frames to which obstacles are fixed:
BASE = "base"  # The base of the arm.
PART = "part"  # The part, which has the frame of the paths.
# Name of the tool in `allow` of an obstacle.
TOOL = "tool"
# Name of the obstacle that represents a floor of a specified height. The values `AT_BASE` and
# `NO_FLOOR` add no obstacle; with `AT_BASE`, links should stay above the mounting plane of the
# base.
FLOOR = "floor"
AT_BASE: Literal["base"] = "base"
NO_FLOOR: Literal["none"] = "none"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Shape(Checked, ABC, metaclass=ExplainedABC):
    """A shape in its own frame."""

    @property
    @abstractmethod
    def ball(self) -> tuple[FloatArray, float]:
        """Centre [m], (3,), and radius [m] of a bounding ball."""

    @abstractmethod
    def farthest(self, directions: FloatArray) -> FloatArray:
        """Return the farthest point of the shape along each direction [m], (n, 3).

        Args:
            directions: Unit vectors, (n, 3).

        Raises:
            InvalidInput: The shape is unbounded.
        """


@declared(eq=False)
class Sphere(Shape):
    """A ball about the origin.

    Args:
        radius: Radius [m].
    """

    radius: Size = field(kw_only=False)

    @property
    def ball(self) -> tuple[FloatArray, float]:
        """Centre [m], (3,), and radius [m] of the ball itself."""
        return np.zeros(3), self.radius

    def farthest(self, directions: FloatArray) -> FloatArray:
        """Return the point of the surface along each direction [m], (n, 3).

        Args:
            directions: Unit vectors, (n, 3).
        """
        return self.radius * directions


@declared(eq=False)
class Capsule(Shape):
    """All points near a segment of the z axis that is centred at the origin.

    Args:
        radius: Distance from the segment to the surface [m].
        length: Length of the segment, without the round ends [m].
    """

    radius: Size = field(kw_only=False)
    length: Size = field(kw_only=False)

    @property
    def ball(self) -> tuple[FloatArray, float]:
        """Centre [m], (3,), and radius [m] of a bounding ball."""
        return np.zeros(3), self.length / 2 + self.radius

    def farthest(self, directions: FloatArray) -> FloatArray:
        """Return the point of an end's ball along each direction [m], (n, 3).

        Args:
            directions: Unit vectors, (n, 3).
        """
        points = self.radius * directions
        points[:, 2] += np.copysign(self.length / 2, directions[:, 2])
        return points


@declared(eq=False)
class Cylinder(Shape):
    """A round cylinder along the z axis, centred at the origin.

    Args:
        radius: Radius [m].
        length: Length [m].
    """

    radius: Size = field(kw_only=False)
    length: Size = field(kw_only=False)

    @property
    def ball(self) -> tuple[FloatArray, float]:
        """Centre [m], (3,), and radius [m] of a bounding ball."""
        return np.zeros(3), float(np.hypot(self.length / 2, self.radius))

    def farthest(self, directions: FloatArray) -> FloatArray:
        """Return the point of an end's rim along each direction [m], (n, 3).

        All points of an end are farthest along the axis; then the point is its centre.

        Args:
            directions: Unit vectors, (n, 3).
        """
        across = np.hypot(directions[:, 0], directions[:, 1])
        points = np.zeros_like(directions)
        tilted = across > 0
        points[tilted, :2] = self.radius * directions[tilted, :2] / across[tilted, None]
        points[:, 2] = np.copysign(self.length / 2, directions[:, 2])
        return points


@declared(eq=False)
class Box(Shape):
    """A box about the origin.

    Args:
        size: Lengths along x, y and z [m], (3,).
    """

    size: Annotated[FloatArray, Quantity("m", "5 mm", "positive"), Axes(3)] = field(kw_only=False)

    @property
    def ball(self) -> tuple[FloatArray, float]:
        """Centre [m], (3,), and radius [m] of a bounding ball."""
        return np.zeros(3), float(np.linalg.norm(self.size) / 2)

    def farthest(self, directions: FloatArray) -> FloatArray:
        """Return the corner that is farthest along each direction [m], (n, 3).

        Args:
            directions: Unit vectors, (n, 3).
        """
        return np.copysign(self.size / 2, directions)


@declared(eq=False)
class HalfSpace(Shape):
    """All points below the plane z = 0, such as a table or a floor."""

    @property
    def ball(self) -> tuple[FloatArray, float]:
        """The origin, and an infinite radius, because a half-space is unbounded."""
        return np.zeros(3), np.inf

    def farthest(self, directions: FloatArray) -> FloatArray:
        """Refuse, because a half-space is unbounded.

        Args:
            directions: Unit vectors, (n, 3).
        """
        raise InvalidInput("A half-space has no farthest points, because it is unbounded.")


@declared(eq=False, weakref_slot=True)
class Mesh(Shape):
    """A triangle mesh, or the convex hull of points.

    Args:
        points: Corners of the triangles [m], (n, 3).
        triangles: Indices of each triangle's three corners, (m, 3); None for the convex hull.
        source: Where the mesh comes from, for messages.

    Raises:
        InvalidInput: The points lie in a plane, or a triangle has an index without a point.
    """

    points: Annotated[FloatArray, Quantity("m"), Axes("points", 3)] = field(kw_only=False)
    triangles: Annotated[IntArray, Axes("triangles", 3)] | None = None
    source: str = ""
    _hull: Mesh | None = field(init=False, default=None, repr=False)

    def _check_together(self) -> None:
        """Check that the points span a volume, and that triangles have existing points."""
        who = self.source or "a mesh"
        points = self.points
        corners = self.triangles
        if len(points) < 4:
            raise InvalidInput(f"{who} must have at least 4 points, but has {len(points)}.")
        spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
        if spread[2] <= 1e-9 * spread[0]:
            raise InvalidInput(
                f"The points of {who} are in a plane, but a body must have a volume."
            )
        if corners is None:
            return
        if not len(corners) or corners.min() < 0 or corners.max() >= len(points):
            raise InvalidInput(f"A triangle of {who} has the index of a point that does not exist.")

    @property
    def hull(self) -> Mesh:
        """Convex hull of the mesh: the same points, without triangles."""
        if self.triangles is None:
            return self
        if self._hull is None:
            # The hull is cached, because the collision library keeps its data for as long as the
            # mesh lives.
            object.__setattr__(self, "_hull", Mesh(points=self.points, source=self.source))
        assert self._hull is not None
        return self._hull

    @property
    def size(self) -> float:
        """Largest of the extents along x, y and z [m]."""
        return float(np.ptp(self.points, axis=0).max())

    @property
    def ball(self) -> tuple[FloatArray, float]:
        """Centre [m], (3,), and radius [m] of a bounding ball."""
        middle = (self.points.max(axis=0) + self.points.min(axis=0)) / 2
        return middle, float(np.linalg.norm(self.points - middle, axis=1).max())

    def farthest(self, directions: FloatArray) -> FloatArray:
        """Return the corner that is farthest along each direction [m], (n, 3).

        Args:
            directions: Unit vectors, (n, 3).
        """
        corners = np.empty(len(directions), dtype=np.intp)
        at_once = max(1, HEIGHTS_AT_ONCE // len(self.points))
        for start in range(0, len(directions), at_once):
            heights = directions[start : start + at_once] @ self.points.T
            corners[start : start + at_once] = heights.argmax(axis=1)
        return self.points[corners]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LinkShape(Checked):
    """A shape that moves with a link or with the tool, or a fixed body (link 0).

    Args:
        name: Name of the link, or of the body that a job adds to it; for messages and exclusions.
        link: 0 for the base (with a positioner for the table), i for the link after joint i.
        shape: The shape.
        place: Frame of the shape in the link frame; by default the same.
        tool: True if the shape belongs to the tool, or to a part that the tool holds.
        exact: Exact shape if `shape` is its convex hull; it is used where the hull violates the
            margin. None if `shape` is exact.
        assumed: True if the shape is only assumed.
        on_floor: True if the shape stands on the floor, even with a positioner.

    Raises:
        InvalidInput: A half-space would move with a link.
    """

    name: Name
    link: int
    shape: Shape
    place: Frame = field(default_factory=Frame)
    tool: bool = False
    exact: Shape | None = None
    assumed: bool = False
    on_floor: bool = False

    def _check_together(self) -> None:
        """Check that no half-space moves with a link."""
        if isinstance(self.shape, HalfSpace) and (self.link or self.tool) and not self.on_floor:
            raise InvalidInput(
                f"The shape of {self.name} must not be a half-space, which cannot move with a link."
            )

    def with_hull(self) -> LinkShape:
        """Return the shape with a mesh replaced by its convex hull, and the mesh as `exact`."""
        if not isinstance(self.shape, Mesh) or self.shape.triangles is None:
            return self
        return replace(self, shape=self.shape.hull, exact=self.shape)


@dataclass(frozen=True, slots=True, kw_only=True)
class LeftOut:
    """Two bodies whose distance is not checked.

    Args:
        first, second: Names of links, obstacles or other bodies.
        reason: Why their distance is not checked.
    """

    first: str
    second: str
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ArmShapes(Checked):
    """The shapes of an arm's links and tool.

    Args:
        shapes: The shapes; a link may have several.
        left_out: Pairs of links whose distance is not checked, with the reasons. The distance
            between neighbouring links is never checked.
        source: Where the shapes come from, and their licence.

    Raises:
        InvalidInput: A pair in `left_out` has a link without a shape.
    """

    shapes: tuple[LinkShape, ...]
    left_out: tuple[LeftOut, ...] = ()
    source: str = ""

    def _check_together(self) -> None:
        """Check that every excluded link has a shape."""
        names = {x.name for x in self.shapes}
        for pair in self.left_out:
            for name in (pair.first, pair.second):
                if name not in names:
                    raise InvalidInput(
                        f"The pair {pair.first}, {pair.second} cannot be excluded, because {name} "
                        f"has no shape. The arm has shapes of {', '.join(sorted(names))}."
                    )

    def with_tool(self, shapes: Iterable[LinkShape]) -> ArmShapes:
        """Return the shapes with the tool's shapes replaced by `shapes`."""
        links = tuple(x for x in self.shapes if not x.tool)
        return replace(self, shapes=(*links, *(replace(x, tool=True) for x in shapes)))


@declared()
class Margins(Checked):
    """Smallest allowed distances between bodies, by the kind of pair.

    Args:
        environment: A link and an obstacle [m].
        own: Two links of the arm [m].
        tool: The tool and anything else [m].
    """

    environment: Distance = 0.005
    own: Distance = 0.002
    tool: Distance = 0.002


MARGINS = Margins()


@declared(eq=False)
class Obstacle(Checked):
    """A body in the cell.

    >>> from armcontour.robot.scene import Sphere
    >>> ball = ac.Obstacle(name="ball", shape=Sphere(radius=0.05), place=ac.Frame((0.5, 0.2, 0.1)))

    Args:
        name: Name of the obstacle, for messages.
        shape: Shape of the obstacle.
        place: Frame of the shape in the frame of `fixed_to`; by default the same frame.
        fixed_to: "base", or "part" for an obstacle that moves with the part.
        margin: Smallest allowed distance of links and tool [m]; None is the margin of the scene.
        allow: Names of links, and of obstacles that move with the part, that may touch the
            obstacle; "tool" is the tool.

    Raises:
        InvalidInput: The name, the margin or `fixed_to` is invalid.
    """

    name: Name = field(kw_only=False)
    shape: Shape = field(kw_only=False)
    place: Frame = field(default_factory=Frame)
    fixed_to: Annotated[str, Choice((BASE, PART))] = BASE
    margin: Distance | None = None
    allow: tuple[Name, ...] = ()


@declared(eq=False)
class Scene(Checked):
    """The obstacles in an arm's cell.

    >>> from armcontour.robot.scene import Sphere
    >>> ac.Scene(obstacles=(ac.Obstacle(name="ball", shape=Sphere(radius=0.05)),)).floor
    'base'

    Args:
        obstacles: The obstacles, of different names.
        margins: Smallest allowed distances.
        floor: Height of the floor in the frame of the arm's base [m]; the floor becomes an obstacle
            of the name "floor", and this field "none". By default "base": links should stay above
            the mounting plane of the base, unless an obstacle is a half-space below the base.
            "none" omits the floor, for example for an arm on a pedestal or a wall.

    Raises:
        InvalidInput: Two obstacles have one name, or the word for the floor is unknown.
    """

    obstacles: tuple[Obstacle, ...] = field(default=(), kw_only=False)
    margins: Margins = MARGINS
    floor: Length | Annotated[str, Choice((AT_BASE, NO_FLOOR))] = AT_BASE

    def _check_together(self) -> None:
        """Replace a floor height by an obstacle, and check that all names differ."""
        if not isinstance(self.floor, str):
            frame = Frame(position=np.array([0.0, 0.0, self.floor]))
            floor = Obstacle(name=FLOOR, shape=HalfSpace(), place=frame)
            # A copy of the scene must not add the floor again.
            object.__setattr__(self, "obstacles", (*self.obstacles, floor))
            object.__setattr__(self, "floor", NO_FLOOR)
        names: set[str] = set()
        for obstacle in self.obstacles:
            if obstacle.name in names:
                raise InvalidInput(f"Two obstacles of the scene have the name {obstacle.name!r}.")
            names.add(obstacle.name)

    @property
    def has_mounting_plane(self) -> bool:
        """True if links should stay above the mounting plane of the base."""
        return self.floor == AT_BASE and not any(_is_ground(x) for x in self.obstacles)


def _is_ground(obstacle: Obstacle) -> bool:
    """Return whether an obstacle is a half-space fixed to the base, with its plane facing up."""
    if not isinstance(obstacle.shape, HalfSpace) or obstacle.fixed_to != BASE:
        return False
    return bool(obstacle.place.rotation[2, 2] > 0.5)
