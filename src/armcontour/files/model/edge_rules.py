"""Rules that name edges of a model by what they are, because indices and names do not last."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

from armcontour.core.errors import InvalidInput
from armcontour.core.fields import Checked, declared
from armcontour.core.quantities import AtLeast, Choice, Distance, Items, Length, Name, Size

# Extensions of models.
MODELS = (".step", ".stp")
CONVEX = "convex"
CONCAVE = "concave"
SMOOTH = "smooth"
BORDER = "border"
FOLDS = (CONVEX, CONCAVE, SMOOTH, BORDER)
LOOPS = ("outer", "inner", "all")
LINE = "line"
CIRCLE = "circle"
ELLIPSE = "ellipse"
CURVE = "curve"
KINDS = (LINE, CIRCLE, ELLIPSE, CURVE)
# Largest coordinate of a point that a rule may have [m].
FARTHEST = 1000.0
Place = Annotated[list[Length], Items(3, 3)]


@declared()
class FaceRule(Checked):
    """A face of a model.

    >>> from armcontour.files.model import FaceRule
    >>> FaceRule(near=[0.0, 0.0, 0.025]).near
    [0.0, 0.0, 0.025]

    Args:
        near: A point on the face, not on its edges, in the coordinates of the file [m].

    Raises:
        InvalidInput: The point does not have three numbers, or is farther than 1000 m.
    """

    near: Place

    def _check_together(self) -> None:
        _check_point(self.near)


def _check_point(point: Sequence[float]) -> None:
    """Check that a point of a rule has three coordinates that a part can have."""
    if len(point) != 3:
        raise InvalidInput(f"near must be a point of three numbers, but has {len(point)}.")
    farthest = max(map(abs, point))
    if farthest > FARTHEST:
        raise InvalidInput(
            f"near has a coordinate of {farthest:.3g} m, but at most {FARTHEST:g} m are allowed. "
            "Check its unit."
        )


@declared()
class EdgeRule(Checked):
    """Edges of a model that satisfy all given conditions.

    >>> from armcontour.files.model import EdgeRule
    >>> EdgeRule(kind="circle", radius=0.005).label
    'circle'

    Args:
        seams: Names of two parts, between which the edges are seams: the lines along which their
            surfaces meet.
        open: For seams, least free distance from the edge along the bisector of its faces [m], so
            that seams inside a tube are left out.
        fold: How the faces at the edge meet: "convex", "concave", "smooth" (within 1 degree), or
            "border" for an edge of only one face.
        face: A face, whose edges are selected.
        loop: With `face`, its "outer" boundary, its "inner" ones, or "all", the default.
        part: Name of a part, whose edges are selected.
        kind: "line", "circle", "ellipse" or "curve".
        radius: Radius of a circle [m].
        color: Colour of one of the faces at the edge: a name, or "#rrggbb".
        near: A point on the edge, in the coordinates of the file [m]; selects the nearest edge.
        index: Number of the edge in the table of `armcontour show`, from 1. It changes if the file
            changes.
        layer: Layer of the contours that the edges become.

    Raises:
        InvalidInput: Conditions are missing or contradict one another, or a value is invalid.
    """

    seams: Annotated[tuple[Name, ...], Items(2, 2)] | None = None
    open: Distance | None = None
    fold: Annotated[str, Choice(FOLDS)] | None = None
    face: FaceRule | None = None
    loop: Annotated[str, Choice(LOOPS)] | None = None
    part: Name | None = None
    kind: Annotated[str, Choice(KINDS)] | None = None
    radius: Size | None = None
    color: Name | None = None
    near: Place | None = None
    index: Annotated[int, AtLeast(1)] | None = None
    layer: Name = ""

    def _check_together(self) -> None:
        if self.near is not None:
            _check_point(self.near)
        if self.seams is not None and (len(self.seams) != 2 or len(set(self.seams)) != 2):
            raise InvalidInput(
                "seams must name two different parts, such as [post, plate], but is "
                f"[{', '.join(self.seams)}]."
            )
        if self.open is not None and self.seams is None:
            raise InvalidInput("open applies to seams only. Add seams, or remove open.")
        if self.loop is not None and self.face is None:
            raise InvalidInput("loop applies to a face only. Add face, or remove loop.")
        if self.seams is not None and (self.face is not None or self.part is not None):
            raise InvalidInput("A rule with seams must not have face or part. Remove them.")
        if self.radius is not None and self.kind not in (None, CIRCLE):
            raise InvalidInput(f"Only circles have a radius, but kind is {self.kind}.")

    @property
    def label(self) -> str:
        """Name of the contours that the rule selects, without their numbers."""
        if self.seams is not None:
            return f"seam {'/'.join(self.seams)}"
        if self.face is not None:
            return "face"
        if self.radius is not None:
            return CIRCLE
        return self.kind or self.fold or "edge"

    @property
    def words(self) -> str:
        """The conditions as text, for messages."""
        shown = []
        for name in ("seams", "open", "fold", "face", "loop", "part", "kind", "radius", "color"):
            value = getattr(self, name)
            if value is None:
                continue
            if name in ("open", "radius"):
                value = f"{value * 1e3:g} mm"
            if name == "face":
                value = f"near {point_text(self.face.near)}" if self.face else ""
            if name == "seams":
                value = f"[{', '.join(value)}]"
            shown.append(f"{name}: {value}")
        return ", ".join(shown)


def point_text(point: Sequence[float]) -> str:
    """Return a point as text, in mm."""
    return "[" + ", ".join(f"{x * 1e3:g}" for x in point) + "] mm"
