"""Shapes of an arm's links and tool, and the pairs of them that are not looked at."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

from armcontour.core.errors import InvalidInput
from armcontour.core.fields import Checked
from armcontour.core.frames import Frame
from armcontour.core.quantities import Name
from armcontour.robot.scene.shapes import HalfSpace, Mesh, Shape

# Radius of the capsule that stands for a tool whose shapes are not given, and where it ends before
# the tool point [m].
ASSUMED_RADIUS, ASSUMED_GAP = 0.01, 0.02


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LinkShape(Checked):
    """A shape that moves with a link, or with the tool.

    Args:
        name: Name of the link, for messages and exceptions.
        link: 0 for the base, i for the link after the i-th joint.
        shape: The shape.
        place: The frame of the shape, in the frame of the link.
        tool: Whether the shape is the tool's, or that of a part that the tool holds.
        exact: The body itself, where `shape` is a larger convex one. Where `shape` comes too near,
            this one decides.
        assumed: Whether nobody gave the shape.
    """

    name: Name
    link: int
    shape: Shape
    place: Frame = field(default_factory=Frame)
    tool: bool = False
    exact: Shape | None = None
    assumed: bool = False

    def _check_together(self) -> None:
        if isinstance(self.shape, HalfSpace):
            raise InvalidInput(
                f"The shape of {self.name} is a half-space, which moves with no link."
            )

    def with_hull(self) -> LinkShape:
        """The same; a mesh becomes its convex hull, with the mesh as the body itself."""
        if not isinstance(self.shape, Mesh) or self.shape.triangles is None:
            return self
        return replace(self, shape=self.shape.hull, exact=self.shape)


@dataclass(frozen=True, slots=True, kw_only=True)
class LeftOut:
    """Two shapes of an arm whose distance is not looked at.

    Args:
        first, second: Names of the links.
        reason: Why not.
    """

    first: str
    second: str
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ArmShapes(Checked):
    """The shapes of an arm's links and tool.

    Args:
        shapes: The shapes. A link may have several.
        left_out: Pairs of links whose distance is not looked at, with the reasons. Neighbouring
            links are left out anyway.
        source: Where the shapes come from, and their licence.

    Raises:
        InvalidInput: A pair that is left out names a link without a shape.
    """

    shapes: tuple[LinkShape, ...]
    left_out: tuple[LeftOut, ...] = ()
    source: str = ""

    def _check_together(self) -> None:
        names = {x.name for x in self.shapes}
        for x in self.left_out:
            for name in (x.first, x.second):
                if name not in names:
                    raise InvalidInput(
                        f"The pair {x.first}, {x.second} cannot be left out: {name} has no shape; "
                        f"shapes are those of {', '.join(sorted(names))}."
                    )

    def with_tool(self, shapes: Iterable[LinkShape]) -> ArmShapes:
        """The same links with other shapes of the tool.

        Args:
            shapes: Shapes of the tool.
        """
        links = tuple(x for x in self.shapes if not x.tool)
        return replace(self, shapes=(*links, *(replace(x, tool=True) for x in shapes)))
