"""What stands in an arm's cell, and how near the arm may come to it."""

from __future__ import annotations

from dataclasses import dataclass, field

from armcontour import _checks
from armcontour._quantities import Distance
from armcontour.errors import InvalidInput
from armcontour.frames import Frame
from armcontour.scene.shapes import Shape

# What obstacles are fixed to: the base of the arm, or the part, whose frame paths are given in.
BASE, PART = "base", "part"
# The name by which an obstacle allows the tool to touch.
TOOL = "tool"


@_checks.explain_calls
@dataclass(frozen=True, slots=True, kw_only=True)
class Margins:
    """How near bodies may come to each other, by the kinds of pairs.

    Args:
        environment: A link and an obstacle [m].
        own: Two links of the arm [m].
        tool: The tool and anything else [m].
    """

    environment: Distance = 0.005
    own: Distance = 0.002
    tool: Distance = 0.002

    def __post_init__(self) -> None:
        for name in ("environment", "own", "tool"):
            value = _checks.not_negative(f"margin {name}", getattr(self, name), "m")
            object.__setattr__(self, name, value)


MARGINS = Margins()


@_checks.explain_calls
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Obstacle:
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

    name: str = field(kw_only=False)
    shape: Shape = field(kw_only=False)
    place: Frame = field(default_factory=Frame)
    fixed_to: str = BASE
    margin: float | None = None
    allow: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        _checks.check_name("name of an obstacle", self.name)
        _checks.choice(f"fixed_to of {self.name}", self.fixed_to, (BASE, PART))
        if self.margin is not None:
            value = _checks.not_negative(f"margin of {self.name}", self.margin, "m")
            object.__setattr__(self, "margin", value)
        object.__setattr__(self, "allow", _checks.check_names("allow", self.allow))


@_checks.explain_calls
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scene:
    """The obstacles in an arm's cell.

    Args:
        obstacles: The obstacles, of different names.
        margins: How near bodies may come to each other.

    Raises:
        InvalidInput: Two obstacles of one name.
    """

    obstacles: tuple[Obstacle, ...] = field(default=(), kw_only=False)
    margins: Margins = MARGINS

    def __post_init__(self) -> None:
        found = _checks.listed("obstacles of a scene", self.obstacles, Obstacle, "Obstacles")
        object.__setattr__(self, "obstacles", found)
        _checks.refuse_other("A Scene", self.margins, Margins)
        seen: set[str] = set()
        for x in self.obstacles:
            if x.name in seen:
                raise InvalidInput(f"Two obstacles of the scene have the name {x.name!r}.")
            seen.add(x.name)
