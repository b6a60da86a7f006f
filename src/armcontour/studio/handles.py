"""Handles: waypoints and obstacles that the page can edit, and the plane of the picture."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from armcontour.core import checks
from armcontour.core.checks import FloatArray, frozen_array
from armcontour.core.errors import InvalidInput
from armcontour.core.frames import Frame
from armcontour.core.quantities import Quantity, unit_of, write_like
from armcontour.core.text import Keys, show
from armcontour.files.file_keys import in_si
from armcontour.files.job_arm import frame_of
from armcontour.files.job_file import GEOMETRY_KEYS
from armcontour.files.job_model import FrameModel, PathModel
from armcontour.files.job_text_edits import Change, change_data
from armcontour.files.model.edge_picking import EdgePicker
from armcontour.files.model.edge_rules import EdgeRule
from armcontour.files.scene_file import SceneModel
from armcontour.geometry import Segments
from armcontour.jobs import Job
from armcontour.program import Program
from armcontour.report.arm_frame import matrix
from armcontour.report.triangles import triangles_of
from armcontour.report.view import Plane, View, in_space
from armcontour.robot.scene import BASE, PART, HalfSpace, Obstacle
from armcontour.studio.model_reader import is_model_file

# Role, keys, position in the part frame [m] (None if computed) and coordinates as written.
PointRecord: TypeAlias = tuple[str, Keys, FloatArray | None, Sequence[Any]]
# Quantities of the values that users write in a job:
LENGTH = Quantity("m", "1 mm")
ANGLE = Quantity("rad", "90 deg")
# Maximum distance at which a point counts as lying on a plane or line [m].
FLAT = 1e-9
# If the absolute x component of a normal is at least this, the normal counts as parallel to x.
STEEP = 0.9
AXES = frozen_array(np.eye(3))
PLANAR = Plane(origin=np.zeros(3), x=AXES[0], y=AXES[1])
# Maximum rounding error of written coordinates [m].
EXACT = 1e-13
# Kinds of a path, which are also its keys in the job file:
POINTS = "points"
SEGMENTS = "segments"
FILE = "file"
# Roles of a waypoint, see `Waypoint.role`:
POINT = "point"
VIA = "via"
CENTER = "center"
END = "end"
# Kind of an empty path.
BLANK = "blank"
# Side length of an empty path's picture [m].
BLANK_SIDE = 0.2
FROM_FILE = "The contours come from {file}, so their points cannot be moved."
COMPUTED = "The centre and the angle of its arc determine this end. Move the centre instead."


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Waypoint:
    """A point of the path in the job file: end of a segment, via point or centre of an arc.

    Args:
        index: Index in `Handles.waypoints`.
        keys: Keys in the file; () if the point is computed.
        point: Position in the work frame [m], (3,).
        uv: Position in the picture [m], (2,).
        written: Coordinates as written in the file.
        role: "point"; "via" or "center" of an arc; "end" of an arc around a centre.
    """

    index: int
    keys: Keys
    point: FloatArray
    uv: FloatArray
    written: tuple[Any, ...]
    role: str = POINT

    @property
    def why_not(self) -> str | None:
        """Reason why the point cannot be moved; None if it can be moved."""
        return None if self.keys else COMPUTED


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Handles:
    """Waypoints of a job in the plane of the picture.

    Args:
        job: The job.
        kind: Kind of the path: "points", "segments", "file" or "blank".
        file: Drawing of the path, as named in the job.
        frame: Part frame.
        plane: Plane of the picture.
        centre: Centre of the path in the picture [m], (2,).
        waypoints: Segment ends in path order, then via points and centres of arcs.
        why_not: Reason why no point can be moved; None if points can be moved.
    """

    job: Job
    kind: str
    file: str | None
    frame: Frame
    plane: Plane
    centre: FloatArray
    waypoints: tuple[Waypoint, ...]
    why_not: str | None

    @property
    def editable(self) -> bool:
        """True if points can be moved, added and removed."""
        return self.why_not is None

    @property
    def ends(self) -> tuple[Waypoint, ...]:
        """Waypoints at the ends of segments, in path order."""
        return tuple(x for x in self.waypoints if x.role in (POINT, END))

    @property
    def origin(self) -> Waypoint:
        """Origin of the part frame as a waypoint: reference for new points without neighbours."""
        position = self.frame.position
        written = ("0 mm",) * self.job.arm.dimension
        return Waypoint(
            index=0, keys=(), point=position, uv=self.plane.uv(position), written=written
        )

    @property
    def axes(self) -> dict[str, Any]:
        """Axes of displayed coordinates: x and y of the part frame, or right and up in the picture.

        The part frame is used if its x-y plane is parallel to the picture.
        """
        rotation = self.frame.rotation
        if abs(abs(self.plane.normal @ rotation[:, 2]) - 1) > FLAT:
            return {"names": ["right", "up"], "origin": [0, 0], "x": [1, 0], "y": [0, 1]}
        x, y = self.plane.uv(self.plane.origin + rotation.T[:2])
        return {"names": ["x", "y"], "origin": self.plane.uv(self.frame.position), "x": x, "y": y}

    def is_removable(self, point: Waypoint) -> bool:
        """Return whether the waypoint can be removed from the path."""
        ends = self.ends
        is_start_of_arc = point.index == 0 and ends[1].role == END
        return point.role in (POINT, END) and len(ends) > 2 and not is_start_of_arc

    def is_divisible(self, index: int) -> bool:
        """Return whether the segment that ends at waypoint `index` is no arc and can be divided."""
        arcs = {x.keys[2] for x in self.waypoints if x.role in (VIA, CENTER)}
        return index - 1 not in arcs

    def to_file(
        self, uv: npt.ArrayLike, like: Waypoint, *, within: float = EXACT
    ) -> tuple[Any, ...]:
        """Convert a point in the picture [m] to job file coordinates, formatted like `like`."""
        moved = like.point + self.plane.lift(uv) - self.plane.lift(like.uv)
        back = self.frame.inverse
        new_values = (back.position + back.rotation @ moved)[: len(like.written)]
        old_values = (back.position + back.rotation @ like.point)[: len(like.written)]
        coordinates = []
        for new, old, text in zip(new_values, old_values, like.written, strict=True):
            if abs(new - old) <= EXACT:
                coordinates.append(text)
            else:
                coordinates.append(write_like(float(new), text, LENGTH, within=within))
        return tuple(coordinates)


def handles_of(job: Job, data: Mapping[str, Any]) -> Handles:
    """Make the handles of a job; `data` is the data of its file."""
    path = data.get("path") or {}
    si = in_si(path, PathModel)
    frame = frame_of("path.frame", FrameModel(**(si.get("frame") or {})))
    kind = next((x for x in (POINTS, SEGMENTS) if path.get(x) is not None), FILE)
    records = [] if kind == FILE else list(_read_points(kind, path, si))
    ends = _ends(job, records)
    points = [
        ends[k] if point is None else frame.position + frame.rotation @ in_space(point)
        for k, (_, _, point, _) in enumerate(records)
    ]
    in_plane = kind == FILE or all(x[2] is None or len(x[2]) == 2 for x in records)
    plane = _plane_of(job, frame if in_plane else None, points)
    file = path.get("file")
    return Handles(
        job=job,
        kind=kind,
        file=file,
        frame=frame,
        plane=plane,
        centre=_centre(plane, job.program),
        waypoints=tuple(
            Waypoint(index=k, keys=x[1], point=at, uv=plane.uv(at), written=tuple(x[3]), role=x[0])
            for k, (x, at) in enumerate(zip(records, points, strict=True))
        ),
        why_not=FROM_FILE.format(file=file) if kind == FILE else None,
    )


def drawing_view(drawing: Program, frame: Frame, dimension: int) -> View:
    """Make the view of a drawing in its own coordinates: the path's picture in the part frame."""
    plane = PLANAR
    back = frame.inverse
    if dimension == 3:
        plane = _plane_across(frame.rotation[:, 2], frame.position)
    x, y = (back.rotation @ axis for axis in (plane.x, plane.y))
    plane = Plane(origin=back.position + back.rotation @ plane.origin, x=x, y=y)
    return View(plane, _centre(plane, drawing))


def is_blank(data: Mapping[str, Any]) -> bool:
    """Return whether the path of a job is still empty, or a CAD model without selected edges."""
    path = data.get("path")
    if not isinstance(path, Mapping):
        return False
    return has_no_edges(path) or not any(path.get(x) for x in (*GEOMETRY_KEYS, FILE))


def has_no_edges(path: Mapping[str, Any]) -> bool:
    """Return whether a path is a CAD model with an empty list of rules."""
    return is_model_file(path.get(FILE)) and path.get("edges") == []


def blank_handles(data: Mapping[str, Any], make_job: Callable[[Any], Job]) -> Handles:
    """Make the handles of a job with an empty path."""
    path = data["path"]
    # A line replaces the missing path. A path with orientations needs points in space.
    is_model = has_no_edges(path)
    dimension = 3 if is_model or "orientation" in path else 2
    line = [[0.0] * dimension, [BLANK_SIDE, BLANK_SIDE, 0.0][:dimension]]
    if not is_model:
        drawn = change_data(data, [Change(("path", POINTS), line)])
        return replace(handles_of(make_job(drawn), drawn), kind=BLANK, waypoints=())
    # Other keys of the path are about the file. The scene may be about it, as well.
    kept = {key: path[key] for key in ("frame",) if key in path}
    others = {key: x for key, x in data.items() if key != "scene"}
    drawn = {**others, "path": {**kept, POINTS: line}}
    file = path[FILE]
    return replace(
        handles_of(make_job(drawn), drawn),
        kind=FILE,
        file=file,
        waypoints=(),
        why_not=FROM_FILE.format(file=file),
    )


def obstacles_of(
    data: Mapping[str, Any], job: Job, plane: Plane, frame: Frame
) -> list[dict[str, Any]]:
    """List the obstacles in the job file, with their places and outlines.

    `place` is the pose in the base frame, or in the work frame if it is fixed to the part; `plane`
    is the plane of the picture in the frame of the keys of the obstacle.
    """
    scene = data.get("scene") or {}
    written = scene.get("obstacles") or []
    si = in_si(scene, SceneModel).get("obstacles") or []
    bodies = {} if job.scene is None else {x.name: x for x in job.scene.obstacles}
    base = job.arm.chain.base
    frames = {BASE: base, PART: frame}
    rows = []
    for k, x in enumerate(si):
        body = bodies[x["name"]]
        rows.append(
            {
                **{**x, "index": k, "written": written[k], "unit": _unit(written[k])},
                **{"fixed_to": body.fixed_to, "place": matrix(body.place)},
                "plane": plane_in(plane, frames[body.fixed_to]),
                **_outline(body, base, plane),
            }
        )
    return rows


def _outline(obstacle: Obstacle, base: Frame, plane: Plane) -> dict[str, Any]:
    """Return an obstacle's position and outline in the picture [m], and its axes; {} without.

    The outline, (n, 2), and the axes, (3, 2), are relative to the position.
    """
    if isinstance(obstacle.shape, HalfSpace):
        return {}
    from scipy.spatial import ConvexHull

    pose = base @ obstacle.place if obstacle.fixed_to == BASE else obstacle.place
    corners = triangles_of(obstacle.shape).reshape(-1, 3) @ pose.rotation.T
    flat, axes = (plane.uv(plane.origin + x) for x in (corners, pose.rotation.T))
    outline = flat[ConvexHull(flat).vertices]
    return {"uv": plane.uv(pose.position), "outline": outline, "axes": axes}


def plane_in(plane: Plane, frame: Frame) -> dict[str, Any]:
    """Return the plane of the picture in another frame, such as that of the base."""
    back = frame.inverse
    x, y, normal = (back.rotation @ axis for axis in (plane.x, plane.y, plane.normal))
    origin = back.position + back.rotation @ plane.origin
    return {"origin": origin, "x": x, "y": y, "normal": normal}


def _unit(body: Mapping[str, Any]) -> tuple[str, float]:
    """Return the unit in which a body's lengths are written, and its factor to m."""
    return unit_of((body.get("at") or body.get("size") or [body.get("radius")])[0], LENGTH)


def _read_points(
    kind: str, path: Mapping[str, Any], si: Mapping[str, Any]
) -> Iterator[PointRecord]:
    """Yield the points of a waypoint path: segment ends, then via points and centres."""
    if kind != SEGMENTS:
        for k, (written, point) in enumerate(zip(path[POINTS], si[POINTS], strict=True)):
            yield POINT, ("path", POINTS, k), np.array(point), written
        return
    yield POINT, ("path", "start"), np.array(si["start"]), path["start"]
    both = list(zip(path[SEGMENTS], si[SEGMENTS], strict=True))
    for k, (written, point) in enumerate(both):
        if written.get("to") is None:
            yield END, (), None, [0.0] * len(si["start"])
        else:
            yield POINT, ("path", SEGMENTS, k, "to"), np.array(point["to"]), written["to"]
    for k, (written, point) in enumerate(both):
        for role in (VIA, CENTER):
            if written.get(role) is not None:
                yield role, ("path", SEGMENTS, k, role), np.array(point[role]), written[role]


def _ends(job: Job, records: Sequence[PointRecord]) -> FloatArray:
    """Return the ends of all segments [m], (n + 1, 3); (0, 3) if none has to be computed."""
    if all(x[2] is not None for x in records):
        return np.empty((0, 3))
    return np.array([in_space(x) for x in job.program.contours[0].path.vertices])


def _plane_of(job: Job, frame: Frame | None, points: Sequence[FloatArray]) -> Plane:
    """Return the picture plane: the x-y plane of `frame`, or the points' plane without one."""
    if job.arm.dimension == 2:
        return PLANAR
    if frame is not None:
        return _plane_across(frame.rotation[:, 2], frame.position)
    middle = np.mean(points, axis=0)
    offsets = np.array(points) - middle
    along = np.linalg.svd(offsets)[2]
    normal = along[2]
    if np.abs(offsets @ along[1]).max() <= FLAT:
        # The points are on a line. Of the planes through this line, the one nearest to horizontal
        # is used.
        up = AXES[2] if abs(along[0][2]) < 1 - FLAT else AXES[1]
        normal = up - (up @ along[0]) * along[0]
    elif np.abs(offsets @ along[2]).max() > FLAT:
        # The axis nearest to the normal replaces the normal, so that the plane does not change
        # while a point is dragged.
        normal = AXES[int(np.argmax(np.abs(normal)))]
    normal = normal / np.linalg.norm(normal)
    plane = _plane_across(normal, middle)
    upwards = normal[2] if abs(normal[2]) > 0.5 else plane.y[2]
    return plane if upwards > 0 else _plane_across(-normal, middle)


def _plane_across(normal: FloatArray, point: FloatArray) -> Plane:
    """Return the plane through a point with a normal, and x near the work frame's x."""
    nearest = int(np.argmax(np.abs(normal)))
    if abs(normal[nearest]) >= 1 - FLAT**2:
        normal = AXES[nearest] * np.sign(normal[nearest])
    # If the normal is nearly parallel to x, the plane's x axis is near the y axis instead.
    along = AXES[0] if nearest != 0 or abs(normal[0]) < STEEP else AXES[1]
    x = along - (along @ normal) * normal
    x = x / np.linalg.norm(x)
    origin = (normal @ point) * normal
    return Plane(origin=origin + 0.0, x=x + 0.0, y=np.cross(normal, x) + 0.0)


def _centre(plane: Plane, program: Program) -> FloatArray:
    """Return a program's centre in the picture [m], (2,)."""
    uv = plane.uv(_vertices(program))
    return np.asarray((uv.min(axis=0) + uv.max(axis=0)) / 2)


def _vertices(program: Program) -> FloatArray:
    """Return the ends of all segments in a program [m], (n, dimension)."""
    # All segments in one table, because a program may have thousands of contours.
    table = Segments.join([x.path.segments for x in program.contours])
    return np.concatenate([table.starts, table.ends])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EditState:
    """Data, shown run and handles before an edit.

    Args:
        data: Data of the document.
        run: Name of the shown run.
        handles: Handles of the job.
        picker: Edges of its CAD model; None without a model, or while it is read.
        rules: Rules that select edges; None if none is selected.
    """

    data: Mapping[str, Any]
    run: str
    handles: Handles
    picker: EdgePicker | None = None
    rules: tuple[EdgeRule, ...] | None = None


def uv_of(name: str, value: Any) -> FloatArray:
    """Read a point in the picture [m] from an edit; returns an array (2,)."""
    coordinates = checks.check_numbers(name, value, "m")
    if coordinates.shape != (2,):
        raise InvalidInput(
            f"{name} must be a list of two coordinates in the picture, but is {show(value)}."
        )
    return coordinates
