"""Solids of a STEP file with their names, colours and places, read by OCCT; in the kernel process.

The kernel library changed the names of its collections between the versions 7.9 and 8.0. This
module and `step_geometry` use no collections, so they work with both.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path as FilePath
from typing import Any

from OCP.BRep import BRep_Tool
from OCP.IFSelect import IFSelect_ReturnStatus
from OCP.Quantity import Quantity_Color
from OCP.STEPCAFControl import STEPCAFControl_Reader
from OCP.TCollection import TCollection_AsciiString, TCollection_ExtendedString
from OCP.TDataStd import TDataStd_Name
from OCP.TDF import TDF_ChildIterator, TDF_Label
from OCP.TDocStd import TDocStd_Document
from OCP.TopAbs import TopAbs_ShapeEnum
from OCP.TopExp import TopExp_Explorer
from OCP.TopLoc import TopLoc_Location
from OCP.TopoDS import TopoDS
from OCP.XCAFDoc import XCAFDoc_ColorType, XCAFDoc_DocumentTool, XCAFDoc_ShapeTool

from armcontour.core.text import count_noun, show

# Names of the casts in version 8.0; those of version 7.9 end with _s.
as_edge = getattr(TopoDS, "Edge", None) or TopoDS.Edge_s
as_face = getattr(TopoDS, "Face", None) or TopoDS.Face_s
SOLID = TopAbs_ShapeEnum.TopAbs_SOLID
SHELL = TopAbs_ShapeEnum.TopAbs_SHELL
FACE = TopAbs_ShapeEnum.TopAbs_FACE
# Type of the entity that names another file.
EXTERNAL = "StepBasic_DocumentFile"
# Beginnings of the types of shapes and their geometry. Their contexts only describe tolerances.
SHAPES = ("StepShape_", "StepGeom_")
CONTEXT = "Context"
# Types of solids.
SOLIDS = (
    "StepShape_ManifoldSolidBrep",
    "StepShape_BrepWithVoids",
    "StepShape_FacetedBrep",
    "StepShape_FacetedBrepAndBrepWithVoids",
)
# Largest number of parts in all places.
MOST_PARTS = 2000
# Beginning of the names that programs give to references between the parts of an assembly.
REFERENCE = "=>"


class Unreadable(Exception):
    """The file has no solids that can be used; the text completes a sentence about the file."""


@dataclass(kw_only=True)
class PlacedPart:
    """A solid in the coordinates of the whole file [mm].

    Args:
        name: Names of the assemblies and of the solid, joined by "/".
        shape: The placed shape of the kernel.
        solid: Whether it is a solid, and not a shell or a group of faces.
        color: Colour `#rrggbb`; empty if the file has none.
        face_colors: Colours of single faces, by the hash of the placed face.
    """

    name: str
    shape: Any
    solid: bool
    color: str
    face_colors: dict[int, str] = field(default_factory=dict)


def explore(shape: Any, kind: Any) -> Iterator[Any]:
    """Yield the parts of a shape that are of one kind, such as its faces."""
    explorer = TopExp_Explorer(shape, kind)
    while explorer.More():
        yield explorer.Current()
        explorer.Next()


def read_parts(file: FilePath) -> list[PlacedPart]:
    """Read the solids of a file; shells and faces only if it has no solids.

    Raises:
        Unreadable: The file cannot be read, or has no surfaces.
    """
    document = TDocStd_Document(TCollection_ExtendedString("XCAF"))
    reader = STEPCAFControl_Reader()
    reader.SetNameMode(True)
    reader.SetColorMode(True)
    if reader.ReadFile(str(file)) != IFSelect_ReturnStatus.IFSelect_RetDone:
        raise Unreadable("cannot be read as STEP")
    declared = _read_solids(reader.ChangeReader().WS().Model())
    if not reader.Transfer(document):
        raise Unreadable("has no shapes")
    parts = _Collector(document).parts()
    solids = [x for x in parts if x.solid]
    _check_solids(declared, parts)
    faces = [as_face(x) for part in parts for x in explore(part.shape, FACE)]
    if faces and all(BRep_Tool.Surface_s(x) is None for x in faces):
        raise Unreadable("has triangles but no surfaces, so its edges are not known")
    return solids or [x for x in parts if any(explore(x.shape, FACE))]


@dataclass(frozen=True, kw_only=True)
class _Solids:
    """Number of solids, and of the faces of their outer shells."""

    count: int
    faces: int


def _read_solids(model: Any) -> _Solids:
    """Return which solids a file declares.

    Raises:
        Unreadable: It names other files, or a shape has a wrong value or reference, instead of
            which the kernel would use another one.
    """
    count = 0
    faces = 0
    for k in range(1, model.NbEntities() + 1):
        entity = model.Value(k)
        kind = entity.DynamicType().Name()
        if kind == EXTERNAL:
            raise Unreadable("refers to other files")
        is_shape = kind.startswith(SHAPES) and CONTEXT not in kind
        if is_shape and model.Check(k, True).NbFails():
            name = kind.partition("_")[2]
            raise Unreadable(
                f"has a wrong value or reference ({name}), so a part would be wrong or missing"
            )
        if kind in SOLIDS:
            count += 1
            outer = entity.Outer()
            faces += 0 if outer is None else outer.NbCfsFaces()
    return _Solids(count=count, faces=faces)


def _check_solids(declared: _Solids, parts: Sequence[PlacedPart]) -> None:
    """Refuse a file of which the kernel has not made all solids with all faces."""
    # The same solid can be at several places.
    made = {}
    for part in parts:
        if part.solid:
            body = part.shape.Located(TopLoc_Location())
            made[hash(body)] = body
    if len(made) < declared.count:
        names = [x.name for x in parts if not x.solid]
        which = f" (not {show(names[0])})" if names else ""
        raise Unreadable(
            f"has {count_noun(declared.count, 'solid')}, of which the CAD kernel can make only "
            f"{len(made)}{which}"
        )
    faces = sum(1 for x in made.values() for _ in explore(x, FACE))
    if faces < declared.faces:
        raise Unreadable(
            f"has solids with {declared.faces} faces, of which the CAD kernel can make only {faces}"
        )


class _Collector:
    """Collects the parts of a document, with the places of their assemblies."""

    def __init__(self, document: Any) -> None:
        self.shapes = XCAFDoc_DocumentTool.ShapeTool_s(document.Main())
        self.colors = XCAFDoc_DocumentTool.ColorTool_s(document.Main())
        self.found: list[PlacedPart] = []
        # Numbers of parts by the tags of their labels
        self.counts: dict[int, int] = {}

    def parts(self) -> list[PlacedPart]:
        """Return all parts of the document."""
        labels = [
            x
            for x in _children(self.shapes.Label())
            if XCAFDoc_ShapeTool.IsFree_s(x) and XCAFDoc_ShapeTool.IsShape_s(x)
        ]
        # A few small assemblies inside one another can have billions of parts.
        count = sum(self._count(x) for x in labels)
        if count > MOST_PARTS:
            raise Unreadable(
                f"has {count} parts, but at most {MOST_PARTS} can be read: leave out the small ones"
            )
        for label in labels:
            self._walk(label, TopLoc_Location(), ())
        return self.found

    def _count(self, label: Any) -> int:
        """Return the number of parts below a label."""
        # All definitions are children of one label, so their tags differ.
        tag = label.Tag()
        if tag in self.counts:
            return self.counts[tag]
        if XCAFDoc_ShapeTool.IsAssembly_s(label):
            count = sum(self._count(x) for _, x in _components(label))
        else:
            shape = XCAFDoc_ShapeTool.GetShape_s(label)
            bodies = [_count_some(shape, kind) for kind in (SOLID, SHELL)]
            count = bodies[0] or bodies[1] or 1
        self.counts[tag] = count
        return count

    def _walk(self, label: Any, location: Any, names: tuple[str, ...]) -> None:
        """Add the parts below a label, which `location` places."""
        if not XCAFDoc_ShapeTool.IsAssembly_s(label):
            self._add(label, location, "/".join(names) or _name_of(label))
            return
        for child, referred in _components(label):
            own = _name_of(child)
            name = own if own and not own.startswith(REFERENCE) else _name_of(referred)
            place = location.Multiplied(XCAFDoc_ShapeTool.GetLocation_s(child))
            self._walk(referred, place, (*names, name))

    def _add(self, label: Any, location: Any, name: str) -> None:
        """Add the solids of a label; its shells or faces if it has none."""
        shape = XCAFDoc_ShapeTool.GetShape_s(label)
        bodies = list(explore(shape, SOLID))
        solid = bool(bodies)
        bodies = bodies or list(explore(shape, SHELL)) or [shape]
        color = self._color_of(shape)
        for k, body in enumerate(bodies):
            part = PlacedPart(
                name=f"{name}[{k + 1}]" if len(bodies) > 1 else name,
                shape=body.Moved(location),
                solid=solid,
                color=color or self._color_of(body),
            )
            for face in explore(body, FACE):
                own = self._color_of(face)
                if own:
                    part.face_colors[hash(face.Moved(location))] = own
            self.found.append(part)

    def _color_of(self, shape: Any) -> str:
        """Return the colour `#rrggbb` of a shape; empty if it has none."""
        color = Quantity_Color()
        for kind in (XCAFDoc_ColorType.XCAFDoc_ColorSurf, XCAFDoc_ColorType.XCAFDoc_ColorGen):
            if self.colors.GetColor(shape, kind, color):
                linear = (color.Red(), color.Green(), color.Blue())
                return "#" + "".join(f"{round(255 * _encode(x)):02x}" for x in linear)
        return ""


def _children(label: Any) -> Iterator[Any]:
    """Yield the labels below a label."""
    iterator = TDF_ChildIterator(label, False)
    while iterator.More():
        yield iterator.Value()
        iterator.Next()


def _components(assembly: Any) -> Iterator[tuple[Any, Any]]:
    """Yield the labels of the components of an assembly, each with the label of its definition."""
    for child in _children(assembly):
        referred = TDF_Label()
        if XCAFDoc_ShapeTool.GetReferredShape_s(child, referred):
            yield child, referred


def _count_some(shape: Any, kind: Any) -> int:
    """Return the number of parts of a shape that are of one kind, if it is not too large."""
    return sum(1 for _ in islice(explore(shape, kind), MOST_PARTS + 1))


def _name_of(label: Any) -> str:
    """Return the name of a label; empty if it has none."""
    # To ask for an attribute that a label does not have ends the process.
    if not label.IsAttribute(TDataStd_Name.GetID_s()):
        return ""
    attribute = TDataStd_Name()
    label.FindAttribute(TDataStd_Name.GetID_s(), attribute)
    return str(TCollection_AsciiString(attribute.Get()).ToCString())


def _encode(linear: float) -> float:
    """Return the sRGB value of a linear colour component, both from 0 to 1."""
    if linear <= 0.0031308:
        return 12.92 * linear
    return 1.055 * math.exp(math.log(linear) / 2.4) - 0.055
