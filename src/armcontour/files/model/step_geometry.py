"""Faces and edges of placed shapes as plain tables, computed by OCCT; in the kernel process."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from OCP.BRep import BRep_Tool
from OCP.BRepAdaptor import BRepAdaptor_Curve, BRepAdaptor_Curve2d, BRepAdaptor_Surface
from OCP.BRepTools import BRepTools
from OCP.GCPnts import GCPnts_AbscissaPoint
from OCP.GeomAbs import GeomAbs_CurveType, GeomAbs_SurfaceType
from OCP.gp import gp_Pnt, gp_Vec
from OCP.TopAbs import TopAbs_Orientation, TopAbs_ShapeEnum

from armcontour.files.model import tables
from armcontour.files.model.edge_rules import CIRCLE, CURVE, ELLIPSE, LINE
from armcontour.files.model.step_document import FACE, PlacedPart, as_edge, as_face, explore
from armcontour.files.model.tables import (
    Conic,
    Curve,
    Edge,
    Face,
    Loop,
    Samples,
    Straight,
    Surface,
    Use,
)

EDGE = TopAbs_ShapeEnum.TopAbs_EDGE
WIRE = TopAbs_ShapeEnum.TopAbs_WIRE
MILLIMETRE = 1e-3
Vector = tuple[float, float, float]
SURFACES = {
    GeomAbs_SurfaceType.GeomAbs_Plane: (tables.PLANE, "Plane"),
    GeomAbs_SurfaceType.GeomAbs_Cylinder: (tables.CYLINDER, "Cylinder"),
    GeomAbs_SurfaceType.GeomAbs_Cone: (tables.CONE, "Cone"),
    GeomAbs_SurfaceType.GeomAbs_Sphere: (tables.SPHERE, "Sphere"),
    GeomAbs_SurfaceType.GeomAbs_Torus: (tables.TORUS, "Torus"),
}
# Largest error of a series of points [mm], and of one of normals [1].
POINT_ERROR = 1e-5
NORMAL_ERROR = 1e-5
# A piece is halved at most this number of times; at a kink of a normal it is then tiny.
MAX_HALVINGS = 12
# Number of last coefficients that show the error of a series.
LAST_TERMS = 2
# Steps by which a point is moved on a surface whose normal vanishes there, such as a pole
# [parameter of the surface].
ASIDE = (0.0, 1e-6, -1e-6, 1e-4, -1e-4)
# Largest number of steps to the point of a surface that is nearest to a point, and distance below
# which two points are one place of the surface [mm].
PROJECTIONS = 3
SAME_PLACE = 1e-5
# A cross product below this fraction of the product of its factors is zero.
NO_NORMAL = 1e-12


@dataclass
class KernelFace:
    """A face of the kernel, and its outward normals."""

    shape: Any
    part: int
    color: str
    sign: float = field(init=False)
    surface: Any = field(init=False)
    table: Surface | None = field(init=False)

    def __post_init__(self) -> None:
        reversed_ = self.shape.Orientation() == TopAbs_Orientation.TopAbs_REVERSED
        self.sign = -1.0 if reversed_ else 1.0
        self.surface = BRepAdaptor_Surface(self.shape)
        self.table = _describe_surface(self.surface)
        self.signed = False

    @property
    def kind(self) -> str:
        """Kind of the surface."""
        return "freeform" if self.table is None else self.table.kind

    def normal(self, u: float, v: float, near: Vector) -> Vector:
        """Return the outward unit normal at the point of the surface that is nearest to a point.

        - `u`, `v`: parameters of a point of the surface close to it.
        - `near`: the point [mm].
        """
        point = gp_Pnt()
        du = gp_Vec()
        dv = gp_Vec()
        for _ in range(PROJECTIONS):
            self.surface.D1(u, v, point, du, dv)
            step = _step_towards(_xyz(du), _xyz(dv), _difference(near, _xyz(point)))
            if step is None:
                break
            u += step[0]
            v += step[1]
        for aside in ASIDE:
            self.surface.D1(u + aside, v + aside, point, du, dv)
            normal = du.Crossed(dv)
            size = normal.Magnitude()
            if size > NO_NORMAL * (1 + du.Magnitude() * dv.Magnitude()):
                scale = self.sign / size
                return scale * normal.X(), scale * normal.Y(), scale * normal.Z()
        return 0.0, 0.0, 0.0


def _step_towards(du: Vector, dv: Vector, offset: Vector) -> tuple[float, float] | None:
    """Return the change of parameters that moves a point of a surface by an offset along it.

    None if it moves by less than SAME_PLACE, or if the derivatives are parallel.

    - `du`, `dv`: derivatives of the point by its parameters.
    """
    uu = _dot(du, du)
    vv = _dot(dv, dv)
    uv = _dot(du, dv)
    determinant = uu * vv - uv * uv
    if determinant <= NO_NORMAL * uu * vv:
        return None
    along_u = _dot(du, offset)
    along_v = _dot(dv, offset)
    x = (vv * along_u - uv * along_v) / determinant
    y = (uu * along_v - uv * along_u) / determinant
    if x * x * uu + y * y * vv <= SAME_PLACE**2:
        return None
    return x, y


def _describe_surface(surface: Any) -> Surface | None:
    """Return the table of a surface whose normals follow from points; None for other surfaces."""
    kind, name = SURFACES.get(surface.GetType(), ("", ""))
    if not kind:
        return None
    shape = getattr(surface, name)()
    position = shape.Position()
    slope = 0.0
    if kind == tables.CONE:
        slope = shape.SemiAngle()
    if kind == tables.TORUS:
        slope = shape.MajorRadius() * MILLIMETRE
        if shape.MinorRadius() >= shape.MajorRadius():
            return None
    center = np.array(_xyz(position.Location())) * MILLIMETRE
    axis = np.array(_xyz(position.Direction()))
    return Surface(kind=kind, center=center, axis=axis, slope=slope)


@dataclass
class KernelUse:
    """An edge as part of the boundary of a face."""

    face: KernelFace
    index: int  # Index of the face
    edge: Any  # The oriented edge
    curve: Any  # Its curve in space
    forward: bool
    flat_curve: Any = None

    def normal(self, t: float) -> Vector:
        """Return the outward normal of the face at a parameter of the edge."""
        if self.flat_curve is None:
            self.flat_curve = BRepAdaptor_Curve2d(self.edge, self.face.shape)
        place = self.flat_curve.Value(t)
        # The curve in space and that on the surface may differ by the tolerance of the file.
        return self.face.normal(place.X(), place.Y(), _xyz(self.curve.Value(t)))


class KernelEdge:
    """An edge of the kernel, with the faces that it bounds."""

    def __init__(self, shape: Any) -> None:
        self.shape = shape
        self.curve = BRepAdaptor_Curve(shape)
        self.begin: float = self.curve.FirstParameter()
        self.end: float = self.curve.LastParameter()
        self.uses: list[KernelUse] = []
        self.inside = False

    def point(self, t: float) -> Vector:
        """Return a point of the curve [mm]."""
        return _xyz(self.curve.Value(t))

    def tangent(self, t: float) -> Vector:
        """Return the derivative of the curve by its parameter [mm]."""
        point = gp_Pnt()
        slope = gp_Vec()
        self.curve.D1(t, point, slope)
        return slope.X(), slope.Y(), slope.Z()

    def turn(self) -> float:
        """Return the angle from the first face to the second in the middle of the edge [rad]."""
        if len(self.uses) != 2:
            return math.nan
        middle = (self.begin + self.end) / 2
        first, second = (x.normal(middle) for x in self.uses)
        along = self.tangent(middle)
        size = math.hypot(*along)
        if size == 0:
            return math.nan
        direction = 1 / size if self.uses[0].forward else -1 / size
        sine = direction * _dot(along, _cross(first, second))
        return math.atan2(sine, _dot(first, second))

    def table(self, seam: tuple[str, str] | None, opening: float) -> Edge:
        """Return the edge as a table."""
        kind, curve = self._describe_curve()
        radius = math.nan
        if kind == CIRCLE:
            radius = self.curve.Circle().Radius() * MILLIMETRE
        return Edge(
            kind=kind,
            curve=curve,
            length=GCPnts_AbscissaPoint.Length_s(self.curve) * MILLIMETRE,
            radius=radius,
            turn=self.turn(),
            uses=tuple(self._describe_use(x) for x in self.uses),
            inside=self.inside,
            seam=seam,
            opening=opening * MILLIMETRE,
        )

    def _describe_curve(self) -> tuple[str, Curve]:
        """Return the kind of the curve, and the curve [m]."""
        kind = self.curve.GetType()
        if kind == GeomAbs_CurveType.GeomAbs_Line:
            start, end = (np.array(self.point(t)) * MILLIMETRE for t in (self.begin, self.end))
            return LINE, Straight(start=start, end=end)
        if kind == GeomAbs_CurveType.GeomAbs_Circle:
            circle = self.curve.Circle()
            return CIRCLE, self._conic(circle, circle.Radius(), circle.Radius())
        if kind == GeomAbs_CurveType.GeomAbs_Ellipse:
            ellipse = self.curve.Ellipse()
            return ELLIPSE, self._conic(ellipse, ellipse.MajorRadius(), ellipse.MinorRadius())
        return CURVE, self._sample(self.point, POINT_ERROR, MILLIMETRE)

    def _conic(self, shape: Any, major: float, minor: float) -> Conic:
        """Return a circle or an ellipse of the kernel."""
        return Conic(
            center=np.array(_xyz(shape.Location())) * MILLIMETRE,
            x=np.array(_xyz(shape.XAxis().Direction())) * major * MILLIMETRE,
            y=np.array(_xyz(shape.YAxis().Direction())) * minor * MILLIMETRE,
            begin=self.begin,
            end=self.end,
        )

    def _describe_use(self, use: KernelUse) -> Use:
        """Return the use of the edge by a face; finds the sign of the face's surface."""
        face = use.face
        if face.table is None:
            normals = self._sample(use.normal, NORMAL_ERROR, 1.0)
            return Use(face=use.index, forward=use.forward, normals=normals)
        if not face.signed:
            middle = (self.begin + self.end) / 2
            point = np.array([self.point(middle)]) * MILLIMETRE
            outward = float(face.table.normals(point)[0] @ np.array(use.normal(middle)))
            face.table = replace(face.table, sign=1.0 if outward > 0 else -1.0)
            face.signed = True
        return Use(face=use.index, forward=use.forward, normals=None)

    def _sample(self, value: Callable[[float], Vector], error: float, scale: float) -> Samples:
        """Return a vector along the edge as series, each within the error."""
        knots = self._knots()
        todo = [(self.begin, self.end, 0)]
        done: list[tuple[float, Any]] = []
        while todo:
            begin, end, depth = todo.pop()
            places = begin + (end - begin) * (tables.NODES + 1) / 2
            series = tables.fit_series(np.array([value(float(t)) for t in places]))
            if depth < MAX_HALVINGS and np.abs(series[-LAST_TERMS:]).max() > error:
                middle = _inner_knot(knots, begin, end)
                todo += [(middle, end, depth + 1), (begin, middle, depth + 1)]
            else:
                done.append((begin, series * scale))
        span = self.end - self.begin
        breaks = [(begin - self.begin) / span for begin, _ in done]
        return Samples(
            breaks=np.array([*breaks, 1.0]), series=np.array([series for _, series in done])
        )

    def _knots(self) -> list[float]:
        """Return the parameters at which the curve may be less smooth."""
        if self.curve.GetType() != GeomAbs_CurveType.GeomAbs_BSplineCurve:
            return []
        spline = self.curve.BSpline()
        return [spline.Knot(k + 1) for k in range(spline.NbKnots())]


def _inner_knot(knots: Sequence[float], begin: float, end: float) -> float:
    """Return the knot nearest to the middle of an interval; the middle if no knot is inside."""
    middle = (begin + end) / 2
    margin = 1e-9 * (end - begin)
    inside = [x for x in knots if begin + margin < x < end - margin]
    return min(inside, key=lambda x: abs(x - middle)) if inside else middle


def _dot(a: Vector, b: Vector) -> float:
    """Return the scalar product; faster than NumPy for single vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: Vector, b: Vector) -> Vector:
    """Return the cross product."""
    x = a[1] * b[2] - a[2] * b[1]
    y = a[2] * b[0] - a[0] * b[2]
    z = a[0] * b[1] - a[1] * b[0]
    return x, y, z


def _difference(a: Vector, b: Vector) -> Vector:
    """Return a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def _xyz(vector: Any) -> Vector:
    """Return the coordinates of a point, vector or direction of the kernel."""
    return vector.X(), vector.Y(), vector.Z()


class Topology:
    """Faces and edges, in the order in which they are added."""

    def __init__(self) -> None:
        self.faces: list[KernelFace] = []
        self.edges: list[KernelEdge] = []
        self._by_hash: dict[int, list[int]] = defaultdict(list)

    def add_part(self, index: int, part: PlacedPart) -> None:
        """Add the faces and edges of a part."""
        for shape in explore(part.shape, FACE):
            color = part.face_colors.get(hash(shape), part.color)
            self.add_face(shape, index, color)

    def add_face(self, shape: Any, part: int, color: str) -> None:
        """Add a face with its edges."""
        face = KernelFace(as_face(shape), part, color)
        if BRep_Tool.Surface_s(face.shape) is None:
            return
        index = len(self.faces)
        self.faces.append(face)
        for oriented in explore(shape, EDGE):
            edge_shape = as_edge(oriented)
            if BRep_Tool.Degenerated_s(edge_shape):
                continue
            edge = self.edges[self._index_of(edge_shape)]
            edge.inside |= any(x.face is face for x in edge.uses)
            forward = oriented.Orientation() == TopAbs_Orientation.TopAbs_FORWARD
            edge.uses.append(KernelUse(face, index, edge_shape, edge.curve, forward))

    def _index_of(self, shape: Any) -> int:
        """Return the index of an edge, which is added if it is new."""
        candidates = self._by_hash[hash(shape)]
        for index in candidates:
            if self.edges[index].shape.IsSame(shape):
                return index
        candidates.append(len(self.edges))
        self.edges.append(KernelEdge(shape))
        return candidates[-1]

    def face_tables(self, *, loops: bool) -> list[Face]:
        """Return the faces; call `edge_tables` before, which finds the signs of surfaces."""
        return [
            Face(
                part=x.part,
                kind=x.kind,
                color=x.color,
                surface=x.table,
                loops=self._loops(x.shape) if loops else (),
            )
            for x in self.faces
        ]

    def _loops(self, face: Any) -> tuple[Loop, ...]:
        """Return the boundaries of a face."""
        outer = BRepTools.OuterWire_s(face)
        loops = []
        for wire in explore(face, WIRE):
            edges = [as_edge(x) for x in explore(wire, EDGE)]
            indices = [self._index_of(x) for x in edges if not BRep_Tool.Degenerated_s(x)]
            if indices:
                loops.append(Loop(outer=bool(wire.IsSame(outer)), edges=tuple(indices)))
        return tuple(loops)
