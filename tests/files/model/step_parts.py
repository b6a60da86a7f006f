"""STEP files that OCCT makes, with closed forms of what is in them; lengths are in mm."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("OCP")

from OCP.BRepAlgoAPI import BRepAlgoAPI_Common, BRepAlgoAPI_Cut, BRepAlgoAPI_Fuse
from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeEdge, BRepBuilderAPI_MakeFace
from OCP.BRepFilletAPI import BRepFilletAPI_MakeFillet
from OCP.BRepPrimAPI import (
    BRepPrimAPI_MakeBox,
    BRepPrimAPI_MakeCylinder,
    BRepPrimAPI_MakePrism,
)
from OCP.gp import gp_Ax1, gp_Ax2, gp_Dir, gp_Pnt, gp_Trsf, gp_Vec
from OCP.Interface import Interface_Static
from OCP.Quantity import Quantity_Color, Quantity_TypeOfColor
from OCP.STEPCAFControl import STEPCAFControl_Writer
from OCP.TCollection import TCollection_ExtendedString
from OCP.TDataStd import TDataStd_Name
from OCP.TDocStd import TDocStd_Document
from OCP.TopAbs import TopAbs_ShapeEnum
from OCP.TopExp import TopExp_Explorer
from OCP.TopLoc import TopLoc_Location
from OCP.XCAFDoc import XCAFDoc_ColorType, XCAFDoc_DocumentTool

Z = (0.0, 0.0, 1.0)
X = (1.0, 0.0, 0.0)


@dataclass(frozen=True)
class Named:
    """A shape with its name, place and colour (red, green, blue from 0 to 1)."""

    name: str
    shape: Any
    place: Any = None
    color: tuple[float, float, float] | None = None


def cylinder(radius: float, height: float, at: Any = (0, 0, 0), axis: Any = Z) -> Any:
    """Return a cylinder from a point along an axis."""
    return BRepPrimAPI_MakeCylinder(gp_Ax2(gp_Pnt(*at), gp_Dir(*axis)), radius, height).Shape()


def box(low: Any, high: Any) -> Any:
    """Return a box between two corners."""
    return BRepPrimAPI_MakeBox(gp_Pnt(*low), gp_Pnt(*high)).Shape()


def cut(shape: Any, *tools: Any) -> Any:
    """Return a shape without others."""
    for tool in tools:
        shape = BRepAlgoAPI_Cut(shape, tool).Shape()
    return shape


def fused(first: Any, second: Any) -> Any:
    """Return two shapes as one."""
    return BRepAlgoAPI_Fuse(first, second).Shape()


def placed(x: float, y: float, z: float, axis: Any = None, angle: float = 0.0) -> Any:
    """Return a location: first a rotation about an axis through the origin, then a shift."""
    turn = gp_Trsf()
    if axis is not None:
        turn.SetRotation(gp_Ax1(gp_Pnt(0, 0, 0), gp_Dir(*axis)), angle)
    shift = gp_Trsf()
    shift.SetTranslation(gp_Vec(x, y, z))
    return TopLoc_Location(shift.Multiplied(turn))


def write(file: Path, *parts: Named, unit: str = "MM") -> Path:
    """Write parts to a STEP file; several become an assembly."""
    Interface_Static.SetCVal_s("write.step.unit", unit)
    document = TDocStd_Document(TCollection_ExtendedString("XCAF"))
    shapes = XCAFDoc_DocumentTool.ShapeTool_s(document.Main())
    colors = XCAFDoc_DocumentTool.ColorTool_s(document.Main())
    top = shapes.NewShape() if len(parts) > 1 else None
    if top is not None:
        TDataStd_Name.Set_s(top, TCollection_ExtendedString("assembly"))
    for part in parts:
        label = shapes.AddShape(part.shape, False)
        TDataStd_Name.Set_s(label, TCollection_ExtendedString(part.name))
        if part.color is not None:
            color = Quantity_Color(*part.color, Quantity_TypeOfColor.Quantity_TOC_sRGB)
            colors.SetColor(label, color, XCAFDoc_ColorType.XCAFDoc_ColorSurf)
        if top is not None:
            component = shapes.AddComponent(top, label, part.place or TopLoc_Location())
            TDataStd_Name.Set_s(component, TCollection_ExtendedString(part.name))
    shapes.UpdateAssemblies()
    writer = STEPCAFControl_Writer()
    writer.SetNameMode(True)
    writer.SetColorMode(True)
    writer.Transfer(document)
    writer.Write(str(file))
    Interface_Static.SetCVal_s("write.step.unit", "MM")
    return file


def edges(shape: Any) -> list[Any]:
    """Return the edges of a shape, each once."""
    from OCP.TopoDS import TopoDS

    as_edge = getattr(TopoDS, "Edge", None) or TopoDS.Edge_s
    explorer = TopExp_Explorer(shape, TopAbs_ShapeEnum.TopAbs_EDGE)
    found: list[Any] = []
    while explorer.More():
        edge = as_edge(explorer.Current())
        if not any(x.IsSame(edge) for x in found):
            found.append(edge)
        explorer.Next()
    return found


# Radii of the main pipe (along x) and of the branch (along z), and their wall.
MAIN = 60.0
BRANCH = 40.0
WALL = 5.0


def saddle(file: Path, unit: str = "MM") -> Path:
    """Write two pipes, of which the branch stands on the main pipe."""
    left = (-150, 0, 0)
    main = cut(cylinder(MAIN, 300, left, X), cylinder(MAIN - WALL, 300, left, X))
    tube = cut(cylinder(BRANCH, 150), cylinder(BRANCH - WALL, 150))
    branch = cut(tube, cylinder(MAIN, 300, left, X))
    parts = (Named("main pipe", main), Named("branch", branch))
    return write(file, *parts, unit=unit)


def square_tube(length: float, size: float = 60.0, wall: float = 4.0) -> Any:
    """Return a square tube along x."""
    half = size / 2
    inner = half - wall
    outside = box((0, -half, -half), (length, half, half))
    return cut(outside, box((-1, -inner, -inner), (length + 1, inner, inner)))


def frame(file: Path) -> Path:
    """Write a post on a plate, with an arm on the post."""
    plate = Named("plate", box((-100, -100, 0), (100, 100, 12)), color=(0.5, 0.5, 0.5))
    upright = placed(0, 0, 12, (0, 1, 0), -math.pi / 2)
    post = Named("post", square_tube(300), upright, (0.3, 0.5, 0.8))
    arm = Named("arm", square_tube(250), placed(30, 0, 250), (1.0, 0.0, 0.0))
    return write(file, plate, post, arm)


def rounded_box(low: Any, high: Any, radius: float) -> Any:
    """Return a box whose edges along z are rounded."""
    from OCP.BRepAdaptor import BRepAdaptor_Curve

    shape = box(low, high)
    fillet = BRepFilletAPI_MakeFillet(shape)
    for edge in edges(shape):
        if abs(BRepAdaptor_Curve(edge).Line().Direction().Z()) > 0.9:
            fillet.Add(radius, edge)
    return fillet.Shape()


def sheet(file: Path) -> Path:
    """Write a sheet on a free-form surface, with a rounded outline and two holes."""
    from OCP.GeomAPI import GeomAPI_PointsToBSplineSurface

    try:
        from OCP.collections import Array2_gp_Pnt as PointTable
    except ImportError:
        from OCP.TColgp import TColgp_Array2OfPnt as PointTable
    rows = 13
    columns = 10
    points = PointTable(1, rows, 1, columns)
    for i in range(rows):
        for j in range(columns):
            x = -220 + 440 * i / (rows - 1)
            y = -170 + 340 * j / (columns - 1)
            z = 25 * math.cos(x / 110) * math.cos(y / 140) + 0.0004 * x * y
            points.SetValue(i + 1, j + 1, gp_Pnt(x, y, z))
    surface = GeomAPI_PointsToBSplineSurface(points).Surface()
    face = BRepBuilderAPI_MakeFace(surface, 1e-6).Face()
    thick = BRepPrimAPI_MakePrism(face, gp_Vec(0, 0, 2)).Shape()
    outline = rounded_box((-180, -130, -200), (180, 130, 200), 40.0)
    holes = [cylinder(r, 600, (x, y, -300)) for x, y, r in ((-80, 20, 25), (90, -30, 35))]
    trimmed = BRepAlgoAPI_Common(thick, cut(outline, *holes)).Shape()
    return write(file, Named("sheet", trimmed))


def block(file: Path) -> Path:
    """Write a block of 100 x 60 x 20 with rounded corners and two holes of radius 5."""
    shape = rounded_box((0, 0, 0), (100, 60, 20), 12.0)
    holes = [cylinder(5, 40, (x, 30, -10)) for x in (30, 70)]
    return write(file, Named("block", cut(shape, *holes), color=(0.0, 0.0, 1.0)))


def line_edge(start: Any, end: Any) -> Any:
    """Return a single edge, which has no face."""
    return BRepBuilderAPI_MakeEdge(gp_Pnt(*start), gp_Pnt(*end)).Shape()
