"""Solids of a STEP file with their names, colours and places, read by OCCT; in the kernel process.

The kernel library changed the names of its collections between the versions 7.9 and 8.0. This
module and `step_geometry` use no collections, so they work with both.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
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

# Names of the casts in version 8.0; those of version 7.9 end with _s.
as_edge = getattr(TopoDS, "Edge", None) or TopoDS.Edge_s
as_face = getattr(TopoDS, "Face", None) or TopoDS.Face_s
SOLID = TopAbs_ShapeEnum.TopAbs_SOLID
SHELL = TopAbs_ShapeEnum.TopAbs_SHELL
FACE = TopAbs_ShapeEnum.TopAbs_FACE
# Entity of a file that names other files.
EXTERNAL = b"DOCUMENT_FILE"
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
    if not reader.Transfer(document):
        raise Unreadable("has no shapes")
    parts = _Collector(document).parts()
    solids = [x for x in parts if x.solid]
    faces = [as_face(x) for part in parts for x in explore(part.shape, FACE)]
    if faces and all(BRep_Tool.Surface_s(x) is None for x in faces):
        raise Unreadable("has triangles but no surfaces, so its edges are not known")
    empty = [x.name for x in parts if not any(explore(x.shape, FACE))]
    if empty and EXTERNAL in file.read_bytes():
        raise Unreadable(f"has no shape of {empty[0]}")
    return solids or [x for x in parts if any(explore(x.shape, FACE))]


class _Collector:
    """Collects the parts of a document, with the places of their assemblies."""

    def __init__(self, document: Any) -> None:
        self.shapes = XCAFDoc_DocumentTool.ShapeTool_s(document.Main())
        self.colors = XCAFDoc_DocumentTool.ColorTool_s(document.Main())
        self.found: list[PlacedPart] = []

    def parts(self) -> list[PlacedPart]:
        """Return all parts of the document."""
        for label in _children(self.shapes.Label()):
            if XCAFDoc_ShapeTool.IsFree_s(label) and XCAFDoc_ShapeTool.IsShape_s(label):
                self._walk(label, TopLoc_Location(), ())
        return self.found

    def _walk(self, label: Any, location: Any, names: tuple[str, ...]) -> None:
        """Add the parts below a label, which `location` places."""
        if not XCAFDoc_ShapeTool.IsAssembly_s(label):
            self._add(label, location, "/".join(names) or _name_of(label))
            return
        for child in _children(label):
            referred = TDF_Label()
            if XCAFDoc_ShapeTool.GetReferredShape_s(child, referred):
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
