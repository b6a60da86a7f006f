"""What stands in an arm's cell, and how near the arm may come to it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Literal

import numpy as np

from armcontour.core import checks
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import Checked
from armcontour.core.frames import Frame
from armcontour.core.quantities import Choice, Distance, Length, Name
from armcontour.robot.scene.shapes import HalfSpace, Shape

# What obstacles are fixed to: the base of the arm, or the part, whose frame paths are given in.
BASE, PART = "base", "part"
# The name by which an obstacle allows the tool to touch.
TOOL = "tool"
# The name of a floor as an obstacle. Two floors have no height and are no obstacles: the plane in
# which the base is mounted, above which links should stay; and nothing at all.
FLOOR = "floor"
AT_BASE: Literal["base"] = "base"
NO_FLOOR: Literal["none"] = "none"


@checks.explain_calls
@dataclass(frozen=True, slots=True, kw_only=True)
class Margins(Checked):
    """How near bodies may come to each other, by the kinds of pairs.

    Args:
        environment: A link and an obstacle [m].
        own: Two links of the arm [m].
        tool: The tool and anything else [m].
    """

    environment: Distance = 0.005
    own: Distance = 0.002
    tool: Distance = 0.002


MARGINS = Margins()


@checks.explain_calls
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Obstacle(Checked):
    """A body that stands in the cell.

    Args:
        name: Its name, for messages.
        shape: Its shape.
        place: The frame of its shape, in the frame of what it is fixed to.
        fixed_to: "base", or "part" for what moves with the part when the part is placed elsewhere.
        margin: How near links and tool may come to it [m]; None is the margin of the scene.
        allow: Names of links that may touch it; "tool" is the tool.

    Raises:
        InvalidInput: A wrong name, margin, or something else that it is fixed to.
    """

    name: Name = field(kw_only=False)
    shape: Shape = field(kw_only=False)
    place: Frame = field(default_factory=Frame)
    fixed_to: Annotated[str, Choice((BASE, PART))] = BASE
    margin: Distance | None = None
    allow: tuple[Name, ...] = ()


@checks.explain_calls
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scene(Checked):
    """The obstacles in an arm's cell.

    Args:
        obstacles: The obstacles, of different names.
        margins: How near bodies may come to each other.
        floor: Height of the floor in the frame of the arm's base [m], an obstacle of the name
            "floor". By default "base": links should stay above the plane in which the base is
            mounted, unless an obstacle is a half-space below the base. "none" says that nothing is
            there, as on a pedestal or a wall.

    Raises:
        InvalidInput: Two obstacles of one name, or another word for the floor.
    """

    obstacles: tuple[Obstacle, ...] = field(default=(), kw_only=False)
    margins: Margins = MARGINS
    floor: Length | Annotated[str, Choice((AT_BASE, NO_FLOOR))] = AT_BASE

    def _check_together(self) -> None:
        if not isinstance(self.floor, str):
            place = Frame(position=np.array([0.0, 0.0, self.floor]))
            floor = Obstacle(name=FLOOR, shape=HalfSpace(), place=place)
            # A copy of a scene with a floor has it already.
            others = (x for x in self.obstacles if not _is_same(x, floor))
            object.__setattr__(self, "obstacles", (*others, floor))
        seen: set[str] = set()
        for x in self.obstacles:
            if x.name in seen:
                raise InvalidInput(f"Two obstacles of the scene have the name {x.name!r}.")
            seen.add(x.name)

    @property
    def has_mounting_plane(self) -> bool:
        """Whether links should stay above the plane in which the base is mounted."""
        return self.floor == AT_BASE and not any(
            isinstance(x.shape, HalfSpace) and x.fixed_to == BASE and x.place.rotation[2, 2] > 0.5
            for x in self.obstacles
        )


def _is_same(first: Obstacle, second: Obstacle) -> bool:
    """Whether two obstacles are the same half-space."""
    named = (first.name, first.fixed_to) == (second.name, second.fixed_to)
    same = isinstance(first.shape, HalfSpace) and named
    return same and bool(np.array_equal(first.place.matrix, second.place.matrix))
