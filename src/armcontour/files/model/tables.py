"""What the kernel process finds in a CAD file, as plain arrays in metres; it imports no kernel."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.polynomial import chebyshev

from armcontour.core.checks import FloatArray, IntArray

# Kinds of surfaces whose normal follows from a point.
PLANE = "plane"
CYLINDER = "cylinder"
CONE = "cone"
SPHERE = "sphere"
TORUS = "torus"
# Surfaces that consist of straight lines.
RULED = (PLANE, CYLINDER, CONE)
Point = tuple[float, float, float]
# Points per piece at which the extent of a series is computed.
CLOSE_POINTS = 16


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Request:
    """What the kernel process computes besides the tables.

    Args:
        seams: Pairs of part names whose seams are computed.
        points: Points whose nearest faces are searched [m].
        triangles: Whether the surfaces of parts are divided into triangles.
    """

    seams: tuple[tuple[str, str], ...] = ()
    points: tuple[Point, ...] = ()
    triangles: bool = False

    def covers(self, other: Request) -> bool:
        """Return whether the answer to this request also answers another one."""
        return (
            set(other.seams) <= set(self.seams)
            and set(other.points) <= set(self.points)
            and (self.triangles or not other.triangles)
        )

    def joined(self, other: Request) -> Request:
        """Return a request that covers both; what this one has stays first."""
        return Request(
            seams=tuple(dict.fromkeys((*self.seams, *other.seams))),
            points=tuple(dict.fromkeys((*self.points, *other.points))),
            triangles=self.triangles or other.triangles,
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Samples:
    """A vector along a curve as Chebyshev series on k pieces.

    Args:
        breaks: Fractions of the curve at which the pieces start and end, from 0 to 1, (k + 1,).
        series: Coefficients of each piece, (k, terms, 3).
    """

    breaks: FloatArray
    series: FloatArray

    def __call__(self, u: FloatArray, order: int = 0) -> FloatArray:
        """Return the vector, or its derivative by the fraction `u` of the curve, (n, 3)."""
        piece = np.clip(np.searchsorted(self.breaks, u, side="right") - 1, 0, len(self.series) - 1)
        begin = self.breaks[piece]
        width = self.breaks[piece + 1] - begin
        x = 2 * (u - begin) / width - 1
        series = self.series if order == 0 else chebyshev.chebder(self.series, order, axis=1)
        terms = chebyshev.chebvander(x, series.shape[1] - 1)
        values = np.einsum("nt,ntd->nd", terms, series[piece])
        return np.asarray(values * (2 / width[:, None]) ** order)

    @property
    def extent(self) -> FloatArray:
        """Smallest and largest coordinates, (2, 3), of points close to one another."""
        inside = np.linspace(0, 1, CLOSE_POINTS, endpoint=False)
        u = (self.breaks[:-1, None] + np.diff(self.breaks)[:, None] * inside).ravel()
        points = self(np.append(u, 1.0))
        return np.stack([points.min(axis=0), points.max(axis=0)])

    def scaled(self, factor: float) -> Samples:
        """Return the vector times a factor."""
        return replace(self, series=self.series * factor)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Conic:
    """A circle or an ellipse: `center + x cos(a) + y sin(a)` for a from `begin` to `end`.

    Args:
        center: Centre [m], (3,).
        x, y: Semi-axes [m], (3,).
        begin, end: Angles at the ends [rad].
    """

    center: FloatArray
    x: FloatArray
    y: FloatArray
    begin: float
    end: float

    def __call__(self, u: FloatArray, order: int = 0) -> FloatArray:
        """Return points, or derivatives by the fraction `u` of the curve, (n, 3)."""
        sweep = self.end - self.begin
        angle = (self.begin + sweep * u + order * np.pi / 2)[:, None]
        turned = np.cos(angle) * self.x + np.sin(angle) * self.y
        return np.asarray(self.center + turned if order == 0 else sweep**order * turned)

    @property
    def extent(self) -> FloatArray:
        """Smallest and largest coordinates [m], (2, 3)."""
        farthest = np.arctan2(self.y, self.x)
        angles = np.concatenate([farthest, farthest + np.pi])
        u = ((angles - self.begin) % (2 * np.pi)) / (self.end - self.begin)
        points = self(np.concatenate([[0.0, 1.0], u[u <= 1]]))
        return np.stack([points.min(axis=0), points.max(axis=0)])

    def scaled(self, factor: float) -> Conic:
        """Return the curve scaled about the origin."""
        return replace(self, center=self.center * factor, x=self.x * factor, y=self.y * factor)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Straight:
    """A straight line.

    Args:
        start, end: Its ends [m], (3,).
    """

    start: FloatArray
    end: FloatArray

    def __call__(self, u: FloatArray, order: int = 0) -> FloatArray:
        """Return points, or derivatives by the fraction `u` of the curve, (n, 3)."""
        along = self.end - self.start
        if order == 0:
            return np.asarray(self.start + u[:, None] * along)
        return np.tile(along if order == 1 else 0 * along, (len(u), 1))

    @property
    def extent(self) -> FloatArray:
        """Smallest and largest coordinates [m], (2, 3)."""
        return np.stack([np.minimum(self.start, self.end), np.maximum(self.start, self.end)])

    def scaled(self, factor: float) -> Straight:
        """Return the line scaled about the origin."""
        return replace(self, start=self.start * factor, end=self.end * factor)


Curve = Straight | Conic | Samples


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Surface:
    """A plane, cylinder, cone, sphere or torus.

    Args:
        kind: Kind of the surface.
        center: A point of the plane or the axis, the centre of a sphere or torus [m], (3,).
        axis: Normal of a plane, or the axis, (3,).
        slope: Semi-angle of a cone [rad], or major radius of a torus [m].
        sign: 1 if the outward normal of the face is that of `normals`, or -1.
    """

    kind: str
    center: FloatArray
    axis: FloatArray
    slope: float = 0.0
    sign: float = 1.0

    def normals(self, points: FloatArray) -> FloatArray:
        """Return unit normals at points of the surface, out of the solid, (n, 3)."""
        if self.kind == PLANE:
            return np.tile(self.sign * self.axis, (len(points), 1))
        across = points - self.center
        if self.kind != SPHERE:
            across = across - (across @ self.axis)[:, None] * self.axis
            across = across / np.linalg.norm(across, axis=1, keepdims=True)
        if self.kind == CONE:
            across = np.cos(self.slope) * across - np.sin(self.slope) * self.axis
        if self.kind == TORUS:
            across = points - self.center - self.slope * across
        size = np.linalg.norm(across, axis=1, keepdims=True)
        return np.asarray(self.sign * across / size)

    def scaled(self, factor: float) -> Surface:
        """Return the surface scaled about the origin."""
        slope = self.slope * factor if self.kind == TORUS else self.slope
        return replace(self, center=self.center * factor, slope=slope)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Part:
    """A solid of a model; without solids, a shell or the faces of one.

    Args:
        name: Its name in the file, with those of the assemblies that contain it.
        color: Colour `#rrggbb`; empty if the file has none.
        solid: Whether it is a solid.
        extent: Smallest and largest coordinates [m], (2, 3).
        faces: Number of its faces.
        points: Corners of its triangles [m], (n, 3); none unless they were requested.
        triangles: Its triangles as indices of corners, (m, 3).
    """

    name: str
    color: str
    solid: bool
    extent: FloatArray
    faces: int
    points: FloatArray
    triangles: IntArray

    def scaled(self, factor: float) -> Part:
        """Return the part scaled about the origin."""
        return replace(self, extent=self.extent * factor, points=self.points * factor)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Loop:
    """A closed chain of edges that bounds a face.

    Args:
        outer: Whether it is the outer boundary.
        edges: Indices of its edges, (n,).
    """

    outer: bool
    edges: tuple[int, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Face:
    """A face of a part.

    Args:
        part: Index of its part.
        kind: Kind of its surface.
        color: Colour `#rrggbb` of the face or of its part; empty if the file has none.
        surface: Its surface; None if the normals are sampled along edges.
        loops: Its boundaries; none for faces of seams.
    """

    part: int
    kind: str
    color: str
    surface: Surface | None
    loops: tuple[Loop, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Use:
    """An edge as part of the boundary of a face.

    Args:
        face: Index of the face.
        forward: Whether the boundary runs along the curve of the edge, with the face on its left.
        normals: Outward normals along the edge; None if they follow from the surface.
    """

    face: int
    forward: bool
    normals: Samples | None


@dataclass(frozen=True, kw_only=True, eq=False)
class Edge:
    """An edge of a model: the boundary of one face, or the line along which two faces meet.

    Args:
        kind: "line", "circle", "ellipse" or "curve".
        curve: Its curve.
        length: Length [m].
        radius: Radius of a circle [m]; NaN for other curves.
        turn: Angle from face to face in its middle [rad]: positive if convex, negative if concave;
            NaN if it does not have two faces.
        uses: Faces that it bounds.
        inside: Whether it closes one face, as the line along a cylinder does.
        seam: Names of the parts between which it is a seam, as in `Request.seams`; None otherwise.
        opening: For a seam, the distance to the first face along the bisector of its faces [m].
    """

    kind: str
    curve: Curve
    length: float
    radius: float
    turn: float
    uses: tuple[Use, ...]
    inside: bool
    seam: tuple[str, str] | None = None
    opening: float = np.inf

    @cached_property
    def ends(self) -> FloatArray:
        """Points at both ends [m], (2, 3)."""
        return self.curve(np.array([0.0, 1.0]))

    @cached_property
    def extent(self) -> FloatArray:
        """Smallest and largest coordinates [m], (2, 3)."""
        return self.curve.extent

    @property
    def closed(self) -> bool:
        """True if the edge ends where it starts."""
        return bool(np.linalg.norm(self.ends[1] - self.ends[0]) <= SAME_END)

    def scaled(self, factor: float) -> Edge:
        """Return the edge scaled about the origin."""
        return replace(
            self,
            curve=self.curve.scaled(factor),
            length=self.length * factor,
            radius=self.radius * factor,
            opening=self.opening * factor,
        )


# Ends closer than this are one end [m]. Files state coordinates with errors of micrometres.
SAME_END = 1e-5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Tables:
    """The parts, faces and edges of a model.

    Args:
        parts: Parts.
        faces: Faces of the parts, then those of seams.
        edges: Edges of the parts, then seams.
        unit: Length of the unit in the file [m]; NaN if the file has several.
        nearest: For each point of the request, the indices of the nearest faces, and their distance
            [m].
        gaps: For each pair of names of the request, the distance between the parts [m].
        request: What was requested.
    """

    parts: tuple[Part, ...]
    faces: tuple[Face, ...]
    edges: tuple[Edge, ...]
    unit: float
    nearest: tuple[tuple[tuple[int, ...], float], ...]
    gaps: tuple[float, ...]
    request: Request

    def scaled(self, factor: float, request: Request) -> Tables:
        """Return the tables scaled about the origin, with the request in scaled coordinates."""
        faces = [
            x if x.surface is None else replace(x, surface=x.surface.scaled(factor))
            for x in self.faces
        ]
        return Tables(
            parts=tuple(x.scaled(factor) for x in self.parts),
            faces=tuple(faces),
            edges=tuple(x.scaled(factor) for x in self.edges),
            unit=self.unit,
            nearest=tuple((near, distance * factor) for near, distance in self.nearest),
            gaps=tuple(x * factor for x in self.gaps),
            request=request,
        )


def fit_series(values: FloatArray) -> FloatArray:
    """Return Chebyshev coefficients of values at `NODES`, (terms, dimension)."""
    return np.asarray(TO_SERIES @ values)


# Number of nodes per piece, their places from -1 to 1, and the matrix from values to coefficients.
COUNT = 11
NODES = np.asarray(chebyshev.chebpts1(COUNT))
TO_SERIES = np.linalg.inv(chebyshev.chebvander(NODES, COUNT - 1))
