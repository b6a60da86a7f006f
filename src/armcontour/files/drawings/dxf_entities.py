"""Shapes of DXF entities, in the coordinates of the drawing or the block around them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.files.drawings.arc_chain import Affine, ArcChain
from armcontour.files.drawings.outlines import BezierSpline, Shape

# An arc with a smaller swept angle [rad] is a full circle whose angles have been rounded.
NO_SWEEP = 1e-8
# Maximum degree of a spline.
MAX_DEGREE = 25
# Maximum number of points in a spline.
MAX_POINTS = 100_000
# Flag of a polyline vertex that is a control point of a spline frame and is not drawn.
FRAME_POINT = 16
# Flag of a closed spline.
CLOSED_SPLINE = 1
# A segment with a smaller bulge is a line, because the arc deviates from the chord by only half the
# bulge times the length of the chord.
NO_BULGE = 1e-12
# Attributes that the DXF format requires. They are checked because ezdxf has default values for
# missing ones.
REQUIRED = {
    "LINE": ("start", "end"),
    "ARC": ("center", "radius", "start_angle", "end_angle"),
    "CIRCLE": ("center", "radius"),
    "ELLIPSE": ("center", "major_axis", "ratio"),
    "INSERT": ("name", "insert"),
}
# Types of entities that are skipped with a note: texts, dimensions, points, filled areas, bodies,
# images and infinite lines. Types in neither table are unknown and are refused.
NO_CONTOUR = frozenset(
    {
        *("TEXT", "MTEXT", "ATTRIB", "ATTDEF", "RTEXT", "ARCALIGNEDTEXT", "SHAPE", "ACAD_TABLE"),
        *("DIMENSION", "ARC_DIMENSION", "LARGE_RADIAL_DIMENSION", "LEADER", "MULTILEADER"),
        *("MLEADER", "TOLERANCE", "POINT", "HATCH", "MPOLYGON", "SOLID", "TRACE", "WIPEOUT"),
        *("3DFACE", "3DSOLID", "MESH", "BODY", "REGION", "SURFACE", "EXTRUDEDSURFACE"),
        *("LOFTEDSURFACE", "PLANESURFACE", "REVOLVEDSURFACE", "SWEPTSURFACE", "NURBSURFACE"),
        *("IMAGE", "OLEFRAME", "OLE2FRAME", "PDFUNDERLAY", "DWFUNDERLAY", "DGNUNDERLAY"),
        *("POINTCLOUD", "ACDBPOINTCLOUDEX", "XLINE", "RAY", "VIEWPORT", "LIGHT", "SUN", "CAMERA"),
        *("SECTIONOBJECT", "SECTION", "GEOPOSITIONMARKER", "COORDINATION_MODEL", "POLYLINE"),
    }
)


class Unreadable(Exception):
    """A defect of an entity; its text completes a sentence that starts with the entity's name."""


def line(entity: Any) -> Shape | None:
    """Return the shape of a LINE, whose points are in world coordinates."""
    ends = _numbers("ends", [tuple(entity.dxf.start), tuple(entity.dxf.end)])
    return ArcChain.straight(ends)


def circle(entity: Any) -> Shape | None:
    """Return the shape of a CIRCLE, in the plane normal to its extrusion."""
    return _arc(entity, 0.0, 2 * np.pi)


def arc(entity: Any) -> Shape | None:
    """Shape of an ARC, which is counter-clockwise in the plane normal to its extrusion."""
    start, end = _numbers("angles", [entity.dxf.start_angle, entity.dxf.end_angle])
    return _arc(entity, np.radians(start), _swept_angle(np.radians((end - start) % 360.0)))


def _arc(entity: Any, start: float, sweep: float) -> Shape | None:
    """Return the shape of an ARC or CIRCLE with a start angle and a swept angle [rad]."""
    axes = plane_axes(entity.dxf.extrusion)
    centre = axes @ _numbers("centre", tuple(entity.dxf.center))
    radius = float(_numbers("radius", entity.dxf.radius))
    if radius < 0:
        raise Unreadable(f"has the radius {radius:g}, but it must not be negative")
    c, s = np.cos(start), np.sin(start)
    cosine = radius * (axes @ [c, s, 0.0])
    sine = radius * (axes @ [-s, c, 0.0])
    return ArcChain.arc(centre, cosine, sine, sweep)


def ellipse(entity: Any) -> Shape | None:
    """Return the shape of an ELLIPSE, whose vectors are in world coordinates."""
    major = _numbers("major axis", tuple(entity.dxf.major_axis))
    normal = plane_axes(entity.dxf.extrusion)[:, 2]
    ratio = float(_numbers("ratio", entity.dxf.ratio))
    minor = ratio * np.cross(normal, major)
    start, end = _numbers("parameters", [entity.dxf.start_param, entity.dxf.end_param])
    sweep = _swept_angle((end - start) % (2 * np.pi))
    if sweep == 2 * np.pi and start % (2 * np.pi) < NO_SWEEP:
        start = 0.0
    c, s = np.cos(start), np.sin(start)
    centre = _numbers("centre", tuple(entity.dxf.center))
    return ArcChain.arc(centre, c * major + s * minor, c * minor - s * major, sweep)


def lwpolyline(entity: Any) -> Shape | None:
    """Return the shape of an LWPOLYLINE, in the plane normal to its extrusion."""
    rows = _numbers("vertices", [tuple(x) for x in entity.get_points("xyb")]).reshape(-1, 3)
    elevation = float(_numbers("elevation", entity.dxf.elevation))
    points = np.column_stack([rows[:, :2], np.full(len(rows), elevation)])
    return _polyline_shape(
        points, rows[:, 2], bool(entity.closed), plane_axes(entity.dxf.extrusion)
    )


def polyline(entity: Any) -> Shape | None:
    """Return the shape of a POLYLINE, in the plane normal to its extrusion or in space."""
    vertices = [x for x in entity.vertices if not x.dxf.flags & FRAME_POINT]
    points = _numbers("vertices", [tuple(x.dxf.location) for x in vertices]).reshape(-1, 3)
    if entity.is_3d_polyline:
        return _polyline_shape(points, np.zeros(len(points)), bool(entity.is_closed), np.eye(3))
    points[:, 2] = float(_numbers("elevation", entity.dxf.elevation[2]))
    bulges = _numbers("bulges", [x.dxf.bulge for x in vertices])
    axes = plane_axes(entity.dxf.extrusion)
    return _polyline_shape(points, bulges, bool(entity.is_closed), axes)


def _polyline_shape(
    points: FloatArray, bulges: FloatArray, closed: bool, axes: FloatArray
) -> Shape | None:
    """Return the shape of a polyline; None if it has no segment."""
    points = points @ axes.T
    if closed:
        points = np.concatenate([points, points[:1]])
    bulges = bulges[: len(points) - 1]
    if len(points) < 2:
        return None
    return _bulge_polyline(points, bulges, axes) if bulges.any() else ArcChain.straight(points)


def _bulge_polyline(points: FloatArray, bulges: FloatArray, axes: FloatArray) -> ArcChain:
    """Return the lines and arcs of an open polyline with bulges."""
    # A bulge is the tangent of a quarter of the arc's swept angle.
    chord = np.diff(points, axis=0)
    bent = (np.abs(bulges) > NO_BULGE) & (np.abs(chord).max(axis=1, initial=0.0) > 0)
    b = np.where(bent, bulges, 1.0)[:, None]
    perpendicular = np.cross(axes[:, 2], chord)
    # Vectors from the centres to the starts, computed without a difference of large numbers.
    cosines = -chord / 2 - perpendicular * (1 - b * b) / (4 * b)
    sines = np.sign(b) * np.cross(axes[:, 2], cosines)
    return ArcChain(
        starts=points[:-1],
        ends=points[1:],
        cosines=np.where(bent[:, None], cosines, 0.0),
        sines=np.where(bent[:, None], sines, 0.0),
        angles=np.where(bent, 4 * np.arctan(np.abs(bulges)), 0.0),
    )


def spline(entity: Any) -> Shape | None:
    """Shape of a SPLINE, from its control points or, if it has none, through its fit points."""
    if entity.control_point_count() == 0:
        return _fit_spline(entity)
    points = _numbers("control points", [tuple(x) for x in entity.control_points])
    n = len(points)
    degree = int(entity.dxf.degree)
    if not 1 <= degree <= MAX_DEGREE:
        raise Unreadable(f"has degree {degree}, but it must be from 1 to {MAX_DEGREE}")
    _check_point_count(n)
    knots = _numbers("knots", list(entity.knots))
    if n <= degree or len(knots) != n + degree + 1:
        raise Unreadable(
            f"has degree {degree}, {n} control points and {len(knots)} knots, but must have more "
            f"than {degree} points, and {degree + 1} knots more than points"
        )
    if (np.diff(knots) < 0).any() or knots[n] <= knots[degree]:
        raise Unreadable("must have increasing knots, but its knots do not increase")
    weights = _numbers("weights", list(entity.weights) or np.ones(n))
    if len(weights) != n or not (weights > 0).all() or weights.max() > 1e9 * weights.min():
        raise Unreadable(f"must have {n} weights above zero, with a ratio of at most 1e9")
    # Knots are scaled to 0 to 1, so that very small or large knots cause no loss of precision.
    knots = (knots - knots[degree]) / (knots[n] - knots[degree])
    curve = BezierSpline.from_knots(points, weights, knots, degree)
    if curve is None:
        raise Unreadable(
            f"must be continuous, but has a gap at a knot that occurs more than {degree} times"
        )
    return curve


def _fit_spline(entity: Any) -> Shape | None:
    """Return the cubic spline through the fit points; None if all fit points coincide.

    The parameter is the chord length, as in CAD programs.
    """
    from scipy.interpolate import make_interp_spline

    points = _numbers("fit points", [tuple(x) for x in entity.fit_points]).reshape(-1, 3)
    _check_point_count(len(points))
    closed = bool(entity.dxf.flags & CLOSED_SPLINE)
    if closed and len(points):
        points = np.concatenate([points, points[:1]])
    step = np.linalg.norm(np.diff(points, axis=0), axis=1)
    scale = np.abs(points).max(initial=0.0)
    points = points[np.concatenate([[True], step > 1e-12 * scale])] if len(points) else points
    if len(points) < 2:
        return None
    parameters = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    ends: Any = "natural"
    if closed and len(points) > 3:
        ends = "periodic"
    elif not closed and entity.dxf.hasattr("start_tangent") and entity.dxf.hasattr("end_tangent"):
        t = _numbers("tangents", [tuple(entity.dxf.start_tangent), tuple(entity.dxf.end_tangent)])
        size = np.linalg.norm(t, axis=1)
        if (size == 0).any():
            raise Unreadable("must not have an end tangent of length zero")
        # Derivatives by the parameter from 0 to 1.
        ends = tuple([(1, parameters[-1] * (x / y))] for x, y in zip(t, size, strict=True))
    curve = make_interp_spline(parameters / parameters[-1], points, k=3, bc_type=ends)
    return BezierSpline.from_knots(curve.c, np.ones(len(curve.c)), curve.t, 3)


def _check_point_count(n: int) -> None:
    """Check that a spline has at most `MAX_POINTS` points."""
    if n > MAX_POINTS:
        raise Unreadable(f"has {n} points, but at most {MAX_POINTS} are allowed")


# Functions for the types of entities that draw a contour.
SHAPES: dict[str, Callable[[Any], Shape | None]] = {
    "LINE": line,
    "ARC": arc,
    "CIRCLE": circle,
    "ELLIPSE": ellipse,
    "LWPOLYLINE": lwpolyline,
    "POLYLINE": polyline,
    "SPLINE": spline,
    "HELIX": spline,
}


def check_required(entity: Any) -> None:
    """Check that an entity has its required attributes."""
    for name in REQUIRED.get(entity.dxftype(), ()):
        if not entity.dxf.hasattr(name):
            raise Unreadable(f"has no {name.replace('_', ' ')}, which DXF requires")


def insert_grid(entity: Any) -> tuple[int, int]:
    """Return the numbers of rows and columns of INSERT copies; 1 if the spacing is 0."""
    dxf = entity.dxf
    rows, columns = (max(int(x), 1) for x in (dxf.row_count, dxf.column_count))
    return rows if dxf.row_spacing else 1, columns if dxf.column_spacing else 1


def insert_transforms(entity: Any, base: FloatArray) -> tuple[Affine, FloatArray]:
    """Return the affine map of an INSERT's first copy, and offsets of all copies from it, (n, 3).

    Both are in units of the drawing; `base` is the base point of the block.
    """
    dxf = entity.dxf
    axes = plane_axes(dxf.extrusion)
    turn = np.radians(float(_numbers("rotation", dxf.rotation)))
    c, s = np.cos(turn), np.sin(turn)
    rotation = axes @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    linear = rotation * _numbers("scale", [dxf.xscale, dxf.yscale, dxf.zscale])
    insertion = axes @ _numbers("insertion point", tuple(dxf.insert))
    rows, columns = insert_grid(entity)
    step = _numbers("spacing", [dxf.column_spacing, dxf.row_spacing])
    k = np.arange(rows * columns)
    offsets = np.column_stack([k % columns * step[0], k // columns * step[1], np.zeros(len(k))])
    return Affine(linear, insertion - linear @ base), offsets @ rotation.T


def check_clip(entity: Any) -> None:
    """Check that an INSERT is not clipped."""
    from ezdxf.xclip import XClip

    clip = XClip(entity)
    if clip.has_clipping_path and clip.is_clipping_enabled:
        raise Unreadable("is clipped (XCLIP), which is not supported")


def plane_axes(extrusion: Any) -> FloatArray:
    """Return the axes of an entity's plane as columns, by DXF's arbitrary axis algorithm."""
    if tuple(extrusion) == (0.0, 0.0, 1.0):
        # Nearly all entities lie in the plane of the drawing.
        return np.eye(3)
    normal = _numbers("extrusion", tuple(extrusion))
    size = np.linalg.norm(normal)
    if normal.shape != (3,) or not 0 < size < np.inf:
        raise Unreadable("must not have an extrusion of length zero")
    z = normal / size
    # The algorithm uses the world's y axis instead of z if the normal is close to z.
    near = abs(z[0]) < 1 / 64 and abs(z[1]) < 1 / 64
    x = np.cross([0.0, 1.0, 0.0] if near else [0.0, 0.0, 1.0], z)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def _swept_angle(angle: float) -> float:
    """Return the swept angle [rad]; a full turn if the angle is approximately zero."""
    return 2 * np.pi if angle < NO_SWEEP else float(angle)


def _numbers(name: str, values: Any) -> FloatArray:
    """Convert values to an array of finite numbers; `name` is for the message."""
    try:
        array = np.array(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise Unreadable(f"has values that are not numbers for its {name}") from None
    if not np.isfinite(array).all():
        raise Unreadable(f"has numbers that are not finite for its {name}")
    return array
