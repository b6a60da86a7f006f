"""Main module of the kernel process: reads one STEP file with OCCT, and writes its `Tables`.

It is called with the STEP file, the pickled request and the file for the pickled answer: `Tables`,
or a text that completes a sentence about the file.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path as FilePath
from typing import Any

import numpy as np
from OCP.Bnd import Bnd_Box
from OCP.BRep import BRep_Builder
from OCP.BRepAlgoAPI import BRepAlgoAPI_Fuse
from OCP.BRepBndLib import BRepBndLib
from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeVertex
from OCP.BRepExtrema import BRepExtrema_DistShapeShape
from OCP.BRepMesh import BRepMesh_IncrementalMesh
from OCP.gp import gp_Dir, gp_Lin, gp_Pnt
from OCP.IntCurvesFace import IntCurvesFace_ShapeIntersector
from OCP.StlAPI import StlAPI_Writer
from OCP.TopoDS import TopoDS_Compound

from armcontour.core.checks import FloatArray, IntArray
from armcontour.files.model.step_document import (
    FACE,
    PlacedPart,
    Unreadable,
    explore,
    read_parts,
)
from armcontour.files.model.step_geometry import MILLIMETRE, KernelEdge, Topology
from armcontour.files.model.tables import RULED, Edge, Face, Part, Point, Request, Tables

# Largest distance of triangles from their surface [mm], and largest angle between neighbours [rad].
TRIANGLE_ERROR = 0.1
TRIANGLE_ANGLE = 0.6
# Distance by which the kernel makes boxes larger than their shapes [m].
BOX_GAP = 1e-5
# Faces that are nearest to a point within this distance are all named [mm].
SAME_DISTANCE = 1e-3
# A ray along the bisector of a seam starts at this distance, and ends at the other one [mm].
RAY_START = 0.1
RAY_END = 1e5
# Fractions of a seam at which the ray is cast.
RAY_PLACES = (0.25, 0.5, 0.75)
# Below this length, the sum of two unit normals has no direction.
OPPOSITE = 1e-6
# Units of length by their names in STEP [m].
UNITS = {
    "INCH": 0.0254,
    "FOOT": 0.3048,
    "MILLI": 1e-3,
    "CENTI": 1e-2,
    "DECI": 1e-1,
    "MICRO": 1e-6,
    "METRE": 1.0,
}
STL_RECORD = np.dtype([("normal", "<f4", 3), ("points", "<f4", (3, 3)), ("attribute", "<u2")])
STL_HEADER = 84


def answer(question: tuple[bytes, Request], folder: FilePath) -> Tables | str:
    """Return the tables of a file, or the end of a sentence about it.

    Args:
        question: Content of the file, and what is requested.
        folder: Empty folder.
    """
    content, request = question
    file = folder / "model.step"
    file.write_bytes(content)
    try:
        return make_tables(file, request, folder / "triangles.stl")
    except Unreadable as error:
        return str(error)


def make_tables(file: FilePath, request: Request, scratch: FilePath) -> Tables:
    """Return the tables of a file; `scratch` is a file that may be written."""
    placed = read_parts(file)
    if not placed:
        raise Unreadable("has no solids or surfaces")
    topology = Topology()
    for index, part in enumerate(placed):
        topology.add_part(index, part)
    edges = [x.table(None, np.inf) for x in topology.edges]
    faces = topology.face_tables(loops=True)
    parts = []
    for index, part in enumerate(placed):
        extent = _extent(index, topology, edges)
        parts.append(_describe_part(part, extent, request.triangles, scratch))
    gaps = []
    for names in request.seams:
        more_faces, more_edges, gap = _seams(placed, names, len(faces))
        faces += more_faces
        edges += more_edges
        gaps.append(gap)
    return Tables(
        parts=tuple(parts),
        faces=tuple(faces),
        edges=tuple(edges),
        unit=_unit_of(file),
        nearest=tuple(_nearest_faces(topology, x) for x in request.points),
        gaps=tuple(gaps),
        request=request,
    )


def _describe_part(
    part: PlacedPart, extent: FloatArray, triangles: bool, scratch: FilePath
) -> Part:
    """Return the table of a part."""
    points = np.empty((0, 3))
    corners = np.empty((0, 3), dtype=np.intp)
    if triangles:
        points, corners = _triangles(part.shape, scratch)
    return Part(
        name=part.name,
        color=part.color,
        solid=part.solid,
        extent=extent,
        faces=sum(1 for _ in explore(part.shape, FACE)),
        points=points,
        triangles=corners,
    )


def _extent(index: int, topology: Topology, edges: Sequence[Edge]) -> FloatArray:
    """Return the smallest and largest coordinates of a part [m], (2, 3).

    - `index`: index of the part.
    - `edges`: tables of the edges of the topology.
    """
    # Planes, cylinders and cones consist of straight lines that end at edges, so their edges have
    # the extreme points.
    own = {x for x, edge in enumerate(topology.edges) if edge.uses[0].face.part == index}
    corners = [edges[x].curve.extent for x in own]
    low = np.min([x[0] for x in corners], axis=0)
    high = np.max([x[1] for x in corners], axis=0)
    for face in topology.faces:
        if face.part != index or face.kind in RULED:
            continue
        # The exact box of a face takes long, so it is computed only if the face may stick out.
        wide = _box(BRepBndLib.Add_s, face.shape, False)
        if (wide[0] < low - BOX_GAP).any() or (wide[1] > high + BOX_GAP).any():
            exact = _box(BRepBndLib.AddOptimal_s, face.shape, False, False)
            low = np.minimum(low, exact[0])
            high = np.maximum(high, exact[1])
    return np.stack([low, high])


def _box(add: Callable[..., None], shape: Any, *options: bool) -> FloatArray:
    """Return the bounding box of a shape by a function of the kernel [m], (2, 3)."""
    box = Bnd_Box()
    add(shape, box, *options)
    ends = (box.CornerMin(), box.CornerMax())
    return np.array([[x.X(), x.Y(), x.Z()] for x in ends]) * MILLIMETRE


def _triangles(shape: Any, scratch: FilePath) -> tuple[FloatArray, IntArray]:
    """Return the corners [m], (n, 3), and the triangles of a shape, (m, 3)."""
    BRepMesh_IncrementalMesh(shape, TRIANGLE_ERROR, False, TRIANGLE_ANGLE, False)
    # The kernel writes a file faster than single triangles can be read in Python.
    writer = StlAPI_Writer()
    writer.ASCIIMode = False
    if not writer.Write(shape, str(scratch)):
        return np.empty((0, 3)), np.empty((0, 3), dtype=np.intp)
    records = np.frombuffer(scratch.read_bytes()[STL_HEADER:], dtype=STL_RECORD)
    corners = records["points"].reshape(-1, 3)
    points, index = np.unique(corners, axis=0, return_inverse=True)
    triangles = index.reshape(-1, 3)
    a, b, c = points[triangles].astype(np.float64).swapaxes(0, 1)
    flat = ~np.cross(b - a, c - a).any(axis=1)
    return points.astype(np.float64) * MILLIMETRE, triangles[~flat]


def _seams(
    placed: Sequence[PlacedPart], names: tuple[str, str], first_face: int
) -> tuple[list[Face], list[Edge], float]:
    """Return the faces and edges of the seams between two parts, and the parts' distance [m].

    A seam is an edge of the united parts whose faces come from both.

    - `first_face`: index of the first returned face.
    """
    groups = [[k for k, x in enumerate(placed) if x.name == name] for name in names]
    if not all(groups):
        # The selection refuses rules with unknown parts.
        return [], [], np.nan
    first, second = (_compound([placed[k].shape for k in group]) for group in groups)
    gap = BRepExtrema_DistShapeShape(first, second).Value() * MILLIMETRE
    union = BRepAlgoAPI_Fuse(first, second)
    if not union.IsDone():
        raise Unreadable(f"has parts that cannot be united: {' and '.join(names)}")
    origin: dict[int, tuple[int, str]] = {}
    for k in (*groups[0], *groups[1]):
        for face in explore(placed[k].shape, FACE):
            color = placed[k].face_colors.get(hash(face), placed[k].color)
            images = [face, *union.Modified(face)]
            origin |= {hash(x): (k, color) for x in images if hash(x) not in origin}
    topology = Topology()
    for face in explore(union.Shape(), FACE):
        part, color = origin.get(hash(face), (-1, ""))
        topology.add_face(face, part, color)
    seams = [x for x in topology.edges if _is_seam(x, groups)]
    rays = IntCurvesFace_ShapeIntersector()
    rays.Load(_compound([x.shape for x in placed]), SAME_DISTANCE)
    edges = [x.table(names, _opening(x, rays)) for x in seams]
    faces = topology.face_tables(loops=False)
    edges = [_shift_faces(x, first_face) for x in edges]
    return faces, edges, gap


def _is_seam(edge: KernelEdge, groups: Sequence[Sequence[int]]) -> bool:
    """Return whether the two faces of an edge come from different groups of parts."""
    parts = [x.face.part for x in edge.uses]
    if len(parts) != 2:
        return False
    a, b = (next((g for g, group in enumerate(groups) if x in group), -1) for x in parts)
    return {a, b} == {0, 1}


def _opening(edge: KernelEdge, rays: Any) -> float:
    """Return the shortest distance from a seam to a face along the bisector [mm]."""
    nearest = np.inf
    for share in RAY_PLACES:
        t = edge.begin + share * (edge.end - edge.begin)
        out = np.sum([x.normal(t) for x in edge.uses], axis=0)
        if np.linalg.norm(out) < OPPOSITE:
            return 0.0
        line = gp_Lin(gp_Pnt(*edge.point(t)), gp_Dir(*(float(x) for x in out)))
        rays.Perform(line, RAY_START, RAY_END)
        for k in range(rays.NbPnt()):
            nearest = min(nearest, rays.WParameter(k + 1))
    return nearest


def _shift_faces(edge: Edge, by: int) -> Edge:
    """Return an edge whose face indices are moved."""
    return replace(edge, uses=tuple(replace(x, face=x.face + by) for x in edge.uses))


def _nearest_faces(topology: Topology, point: Point) -> tuple[tuple[int, ...], float]:
    """Return the indices of the faces nearest to a point, and their distance [m]."""
    vertex = BRepBuilderAPI_MakeVertex(gp_Pnt(*(x / MILLIMETRE for x in point))).Vertex()
    distances = np.full(len(topology.faces), np.inf)
    boxes = [_distance_to_box(x.shape, vertex) for x in topology.faces]
    for k in np.argsort(boxes):
        if boxes[k] > distances.min() + SAME_DISTANCE:
            break
        distances[k] = BRepExtrema_DistShapeShape(vertex, topology.faces[k].shape).Value()
    nearest = np.flatnonzero(distances <= distances.min() + SAME_DISTANCE)
    return tuple(nearest.tolist()), float(distances.min()) * MILLIMETRE


def _distance_to_box(shape: Any, vertex: Any) -> float:
    """Return the distance between the bounding boxes of a shape and a vertex [mm]."""
    boxes = []
    for x in (shape, vertex):
        box = Bnd_Box()
        BRepBndLib.Add_s(x, box, False)
        boxes.append(box)
    return float(boxes[0].Distance(boxes[1]))


def _compound(shapes: Sequence[Any]) -> Any:
    """Return one shape that consists of several."""
    if len(shapes) == 1:
        return shapes[0]
    whole = TopoDS_Compound()
    builder = BRep_Builder()
    builder.MakeCompound(whole)
    for shape in shapes:
        builder.Add(whole, shape)
    return whole


def _unit_of(file: FilePath) -> float:
    """Return the length of the unit that a file declares [m]; NaN if it declares several."""
    text = file.read_bytes().decode("latin-1").upper()
    converted = r"CONVERSION_BASED_UNIT\s*\(\s*'\s*(INCH|FOOT)\s*'"
    found = {UNITS[x] for x in re.findall(converted, text)}
    # The definition of an inch also contains a metric unit, which is no unit of coordinates.
    if not found:
        prefixes = re.findall(r"SI_UNIT\s*\(\s*(\$|\.[A-Z]+\.)\s*,\s*\.METRE\.", text)
        found = {UNITS.get(x.strip("."), 1.0) for x in prefixes}
    return found.pop() if len(found) == 1 else float("nan")
