"""The path of the tool as a function of arc length, without time."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import field, fields, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from armcontour.core import checks, pictures
from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import Checked, checked, declared
from armcontour.core.frames import IN_PLANE, Frame, Pose, angle_between
from armcontour.core.quantities import (
    ConeAngle,
    Distance,
    Factor,
    Size,
    SpeedLimit,
    Tolerance,
)
from armcontour.core.text import short_repr
from armcontour.geometry.orientation import Orientation
from armcontour.geometry.primitives import NO_LIMITS, Arc, Line, SegmentLimits, tabulate
from armcontour.geometry.projection import Projection, find_nearest
from armcontour.geometry.segments import REPEATED_POINT, TANGENT_TOLERANCE, Segments, close_gaps

PLANAR_PATH = "A tool orientation requires a path in space. Use points with three coordinates."
EVERY_VERTEX = checks.freeze(np.empty(0, dtype=np.intp))
# An orientation's break that is nearer than this to a vertex of the path, in metres plus the same
# fraction of the path length, is moved to the vertex. The differences come from remainders that
# corner rounding discards, and from rounding errors of summed lengths.
SAME_BREAK = 1e-12


# The class has no slots, because a frozen class with slots raises an unclear error if a property is
# assigned.
@declared(eq=False, slots=False)
class Path(Checked):
    """A continuous chain of lines and arcs in the plane or in space, as a function of arc length.

    Rounding and smoothing insert transitions, along which the curvature changes. Splines consist of
    transitions.

    >>> line = ac.Path.polyline([(0.0, 0.0), (0.3, 0.0), (0.3, 0.4)])
    >>> line.length, line(0.1), line(0.1, 1)
    (0.7, array([0.1, 0. ]), array([1., 0.]))

    Args:
        segments: The lines and arcs in the order of travel, each of which starts at the end of the
            previous one. The attribute is the table of the n segments, with columns that are
            properties of the path.
        merged: Indices of the input points that are no vertices, because they repeat the previous
            one or because a repair of rounded coordinates replaced them.
        waypoints: Indices of the vertices at which the other input points are located; by default
            all vertices. A spline has more vertices than points.
        orientation: Tool orientation along a path in space, or None; `oriented`, `pointing` and
            `following_tangent` set it.
        smoothing: Largest distance by which the transitions of `smooth_curvature` changed the path
            [m], an upper bound; 0 without them.

    Attributes:
        breaks: Arc lengths at which the segments start and end, from 0 [m], (n + 1,).

    Raises:
        InvalidInput: A segment is not a Line or Arc, or there is a gap between segments; with the
            index of the segment.
    """

    segments: Segments = field(kw_only=False)
    merged: tuple[int, ...] = ()
    waypoints: IntArray = field(default_factory=lambda: EVERY_VERTEX)
    orientation: Orientation | None = None
    smoothing: Distance = 0.0
    breaks: FloatArray = field(init=False, repr=False)

    if TYPE_CHECKING:

        def __init__(
            self,
            segments: Segments | Iterable[Line | Arc],
            *,
            merged: tuple[int, ...] = (),
            waypoints: IntArray = EVERY_VERTEX,
            orientation: Orientation | None = None,
            smoothing: float = 0.0,
        ) -> None: ...

    def __post_init__(self) -> None:
        if not isinstance(self.segments, Segments):
            object.__setattr__(self, "segments", tabulate(self.segments))
        Checked.__post_init__(self)

    def _check_together(self) -> None:
        object.__setattr__(self, "segments", self.segments.check())
        n = len(self.segments)
        if self.waypoints is EVERY_VERTEX:
            waypoints = np.arange(n + 1)
            waypoints.setflags(write=False)
        else:
            waypoints = _check_waypoints(self.waypoints, n)
        object.__setattr__(self, "waypoints", waypoints)
        object.__setattr__(self, "breaks", checks.frozen_array(self.segments.breaks))
        if self.orientation is not None:
            object.__setattr__(self, "orientation", self._snap_breaks(self.orientation))

    @classmethod
    @checked
    def polyline(
        cls,
        points: npt.ArrayLike,
        *,
        closed: bool = False,
        segment_limits: SegmentLimits = NO_LIMITS,
    ) -> Path:
        """Return the path of straight lines through `points`.

        Args:
            points: The vertices [m], (n, 2) or (n, 3); repeated points are merged.
            closed: Whether a last line leads back to the first point.
            segment_limits: Speed, corner error and tag of all segments.

        Raises:
            InvalidInput: The points have a wrong shape, or fewer than two of them differ.
        """
        coordinates = checks.points("points of a path", points)
        if closed:
            coordinates = np.concatenate([coordinates, coordinates[:1]])
        indices = _find_distinct(coordinates)
        if len(indices) < 2:
            raise InvalidInput(
                f"A path needs at least two different points, but {len(coordinates)} "
                f"point{'s were' if len(coordinates) != 1 else ' was'} given"
                f"{' that are all the same' if len(coordinates) > 1 else ''}."
            )
        return Path(
            segments=Segments.lines(
                coordinates[indices], **segment_limits.columns(len(indices) - 1)
            ),
            merged=_find_missing(len(coordinates), indices),
        )

    @classmethod
    def line(
        cls,
        start: Sequence[float],
        end: Sequence[float],
        *,
        segment_limits: SegmentLimits = NO_LIMITS,
    ) -> Path:
        """Return the path of one straight line.

        Args:
            start: First point [m], 2 or 3 coordinates.
            end: Last point [m].
            segment_limits: Speed, corner error and tag of the line.
        """
        return cls.polyline([start, end], segment_limits=segment_limits)

    @classmethod
    def arc(
        cls,
        start: Sequence[float],
        end: Sequence[float],
        *,
        via: Sequence[float],
        segment_limits: SegmentLimits = NO_LIMITS,
    ) -> Path:
        """Return the path of one circular arc through a third point.

        `Arc` is specified by its centre and angle instead.

        Args:
            start: First point [m], 2 or 3 coordinates.
            end: Last point [m].
            via: A point of the arc between its ends [m].
            segment_limits: Speed, corner error and tag of the arc.
        """
        return cls(segments=[Arc.through(start, via, end, segment_limits=segment_limits)])

    @classmethod
    @checked
    def circle(
        cls, center: Sequence[float], radius: Size, *, segment_limits: SegmentLimits = NO_LIMITS
    ) -> Path:
        """Return the counter-clockwise circle that starts on the +x side of its centre.

        In space the z coordinate is constant; `Arc.circle` makes other circles.

        Args:
            center: Centre of the circle [m], 2 or 3 coordinates.
            radius: Radius of the circle [m].
            segment_limits: Speed, corner error and tag of the circle.
        """
        middle = checks.points("center of a circle", [center])[0]
        start = middle + np.eye(len(middle))[0] * radius
        normal = (0.0, 0.0, 1.0) if len(middle) == 3 else None
        return cls(
            segments=[Arc.circle(start, middle, normal=normal, segment_limits=segment_limits)]
        )

    @classmethod
    @checked
    def spline(
        cls,
        points: npt.ArrayLike,
        *,
        tolerance: Tolerance = 1e-6,
        closed: bool = False,
        segment_limits: SegmentLimits = NO_LIMITS,
    ) -> Path:
        """Return the cubic spline through `points`, as transitions with continuous curvature.

        Args:
            points: Points of the spline [m], (n, 2) or (n, 3); repeated points are merged.
            tolerance: Largest distance between the spline and the path [m].
            closed: Whether the spline is periodic; its last point must then repeat the first.
            segment_limits: Speed, corner error and tag of all segments.

        Raises:
            InvalidInput: Fewer than two points differ, the ends of a closed spline differ, or the
                tolerance is below 1e-9 m.
        """
        from armcontour.geometry.spline import fit_spline

        coordinates = checks.points("points of a spline", points)
        indices = _find_distinct(coordinates)
        if len(indices) < 2:
            raise InvalidInput("A spline needs at least two different points.")
        if tolerance < REPEATED_POINT:
            raise InvalidInput(
                f"The spline tolerance must be at least {REPEATED_POINT:g} m, but is "
                f"{tolerance:g} m."
            )
        segments, waypoints = fit_spline(coordinates[indices], tolerance, closed)
        return Path(
            segments=segments.replace(**segment_limits.columns(len(segments))),
            merged=_find_missing(len(coordinates), indices),
            waypoints=waypoints,
        )

    def oriented(self, rotations: Any, *, axis_only: bool = False) -> Path:
        """Return the path with a constant tool orientation, or with one per waypoint.

        The waypoints are the points that the path was made of. Between them the tool turns by the
        shortest rotation, at a constant rate over arc length. Along a spline its rate is
        continuous, so that the tool does not stop at waypoints.

        Args:
            rotations: Tool axes in the path's coordinates, as columns: one rotation or one per
                waypoint; matrices, quaternions (x, y, z, w) or a scipy Rotation.
            axis_only: Only the tool axis (z) is prescribed; rotation about it is free.

        Raises:
            InvalidInput: The path lies in the plane, the rotations are not valid, their number
                differs from that of the waypoints, or neighbours differ by half a turn.
        """
        from armcontour.geometry import prescribed_orientation

        orientation = prescribed_orientation.orient_by_rotations(
            self.segments, self.waypoints, self.merged, rotations, axis_only=axis_only
        )
        return replace(self, orientation=orientation)

    def pointing(self, directions: npt.ArrayLike) -> Path:
        """Return the path with a constant direction of the tool axis (z), or with one per waypoint.

        Rotation about the tool axis is free, as in cutting, dispensing and welding. Between
        waypoints the axis turns on the shortest way at a constant rate over arc length; along a
        spline, its rate is continuous.

        Args:
            directions: One direction, (3,), or one per waypoint, (n, 3).

        Raises:
            InvalidInput: The path lies in the plane, or a direction is not a vector with a length.
        """
        from armcontour.geometry import prescribed_orientation

        orientation = prescribed_orientation.orient_by_axes(
            self.segments, self.waypoints, self.merged, directions
        )
        return replace(self, orientation=orientation)

    def following_tangent(
        self, up: npt.ArrayLike, *, tool: Any | None = None, axis_only: bool = False
    ) -> Path:
        """Return the path with a tool orientation at a fixed angle to the tangent.

        Args:
            up: Direction that is not parallel to the first tangent, (3,). Its component
                perpendicular to the tangent is the z axis of the path's frame, whose x axis is the
                tangent. The frame never turns about the tangent.
            tool: Rotation of the tool in the path's frame; by default the tool axis is opposite to
                `up`.
            axis_only: Only the tool axis (z) is prescribed; rotation about it is free.

        Raises:
            InvalidInput: The path lies in the plane, `up` lies along the first tangent, or the
                path turns back by 180°.
        """
        from armcontour.geometry import prescribed_orientation

        if self.dimension != 3:
            raise InvalidInput(PLANAR_PATH)
        orientation = prescribed_orientation.follow_tangent(
            self.segments, up, tool, axis_only=axis_only
        )
        return replace(self, orientation=orientation)

    @checked
    def with_cone(self, cone: ConeAngle) -> Path:
        """Return the path with a cone around its tool axis, within which the tool may lean.

        The tool point stays on the path. The planner leans the tool where the arm can then move
        faster, reach the path, or pass obstacles and singularities.

            seam = path.pointing((0, 0, -1)).with_cone(np.radians(10))

        Args:
            cone: Largest angle between the tool axis and the prescribed one [rad], up to 60 deg; 0
                for the prescribed axis.

        Raises:
            InvalidInput: The path has no tool orientation or prescribes a whole rotation, or the
                angle is out of range.
        """
        if self.orientation is None:
            raise InvalidInput(
                "A cone is around the prescribed tool axis, but the path prescribes none. Specify "
                "the axis first, for example with path.pointing(direction)."
            )
        return replace(self, orientation=self.orientation.with_cone(cone))

    @checked
    def placed(self, frame: Pose, *, scale: Factor = 1.0) -> Path:
        """Return the path transformed from a frame to its parent frame.

        Speeds, tolerances and tool orientation move with it. A path in the plane becomes a path in
        space if the frame lifts or tilts it.

            seam = Path.polyline([(0, 0), (0.1, 0)]).placed(Frame((0.4, 0.0, 0.2)))

        Args:
            frame: A Frame, a 4 by 4 transform, a pinocchio.SE3 or a position [m].
            scale: Factor of all lengths, before the path is placed.

        Raises:
            InvalidInput: `frame` is no frame, or the scale is not above zero.
        """
        frame = Frame.from_pose(frame)
        factor = scale
        path = self if frame.is_planar_transform else self.lifted()
        d = path.dimension
        orientation = path.orientation
        if orientation is not None:
            orientation = orientation.place(frame.rotation, factor)
        segments = path.segments.place(frame.rotation[:d, :d], frame.position[:d], factor)
        return path._plain(
            segments=segments, orientation=orientation, smoothing=factor * path.smoothing
        )

    def lifted(self) -> Path:
        """Return a path in the plane as a path in space at z = 0; a path in space is unchanged."""
        return self if self.dimension == 3 else self._plain(segments=self.segments.lift())

    def _plain(self, **changed: object) -> Path:
        """Return a `Path` with some attributes changed, without the attributes of a subclass."""
        attributes = {x.name: getattr(self, x.name) for x in fields(Path) if x.init}
        return Path(**{**attributes, **changed})

    def reversed(self) -> Path:
        """Return the path from its end to its start, with the same tool orientation at every point.

        back_and_forth = path + path.reversed()
        """
        n = len(self)
        segments = self.segments.reverse_rows(np.arange(n)[::-1], np.full(n, True))
        return Path(
            segments=segments.replace(checked=True),
            waypoints=n - self.waypoints[::-1],
            orientation=None if self.orientation is None else self.orientation.reverse(),
            smoothing=self.smoothing,
        )

    def joined(self, *others: Path) -> Path:
        """Join this path and others; each must start at the end of the previous one.

        `path + other` joins one other path.

            contour = lead_in.joined(circle, lead_out)

        Args:
            others: The other paths, in order.

        Raises:
            InvalidInput: There is a gap; some paths lie in the plane and others in space; or only
                some have an orientation.
        """
        paths: tuple[Path, ...] = checks.check_sequence("joined", (self, *others), Path, "Paths")
        if len(paths) == 1:
            return self
        if len({x.dimension for x in paths}) > 1:
            raise InvalidInput("Paths to join must all be in the plane or all in space.")
        oriented = [x.orientation for x in paths if x.orientation is not None]
        if oriented and len(oriented) < len(paths):
            raise InvalidInput("Paths to join must all have an orientation, or none.")
        ends = np.array([x.segments[-1:].ends[0] for x in paths[:-1]])
        gaps = np.linalg.norm(ends - [x.starts[0] for x in paths[1:]], axis=1)
        # If a gap is too wide, the check of all segments reports it.
        fits = bool((gaps <= REPEATED_POINT).all())
        before = np.cumsum([0, *(len(x) for x in paths)])
        waypoints = [x.waypoints[:-1] + k for x, k in zip(paths, before, strict=False)]
        return Path(
            segments=Segments.join([x.segments for x in paths], checked=fits),
            waypoints=np.concatenate([*waypoints, before[-1:]]),
            orientation=Orientation.join(oriented, [x.length for x in paths]) if oriented else None,
            smoothing=max(x.smoothing for x in paths),
        )

    def __add__(self, other: Path) -> Path:
        """Return this path with another one appended, as by `joined`."""
        return self.joined(other) if isinstance(other, Path) else NotImplemented

    @property
    def starts(self) -> FloatArray:
        """First point of every segment [m], (n, dimension)."""
        return self.segments.starts

    @property
    def tangents(self) -> FloatArray:
        """Unit tangents at the segments' starts, (n, dimension)."""
        return self.segments.tangents

    @property
    def normals(self) -> FloatArray:
        """Unit normals at the segments' starts, towards the centres, (n, dimension).

        A normal is zero for a line, and for a transition that starts straight.
        """
        return self.segments.normals

    @property
    def curvatures(self) -> FloatArray:
        """Curvatures of the segments [1/m], zero for lines, upper bounds for transitions, (n,)."""
        return self.segments.curvatures

    @property
    def lengths(self) -> FloatArray:
        """Lengths of the segments [m], (n,)."""
        return self.segments.lengths

    @property
    def speeds(self) -> FloatArray:
        """Assigned velocities of the segments [m/s], NaN for segments without one, (n,)."""
        return self.segments.speeds

    @property
    def tolerances(self) -> FloatArray:
        """Maximum permitted corner error of each segment [m], NaN if not specified, (n,)."""
        return self.segments.tolerances

    @property
    def vertex_tolerances(self) -> FloatArray:
        """Largest corner error at every vertex between segments [m], infinite if not specified."""
        tolerances = np.where(np.isnan(self.tolerances), np.inf, self.tolerances)
        return np.minimum(tolerances[:-1], tolerances[1:])

    @property
    def tags(self) -> tuple[str | None, ...]:
        """Tag of each segment; None for a segment without one."""
        return tuple(self.segments.tags.tolist())

    @property
    def length(self) -> float:
        """Arc length of the whole path [m]."""
        return float(self.breaks[-1])

    @property
    def dimension(self) -> int:
        """Number of coordinates of a point: 2 in the plane, 3 in space."""
        return self.segments.dimension

    def __len__(self) -> int:
        """Number of segments."""
        return len(self.segments)

    def __call__(self, s: npt.ArrayLike, order: int = 0, *, side: str = "right") -> FloatArray:
        """Return the point (order 0) or derivative with respect to arc length at `s`.

        Args:
            s: Arc lengths [m], any shape, within the path.
            order: Order of the derivative: 0, 1, 2, ...
            side: At a vertex, the derivative on the segment after ("right") or before it ("left").

        Returns:
            Shape `s.shape + (dimension,)` [m, -, 1/m, ...].

        Raises:
            InvalidInput: An arc length is no number or outside the path, or the order is invalid.
        """
        arc_lengths = checks.clip_within("arc length", s, 0.0, self.length, "m", "the path")
        i = self.locate(arc_lengths, side=side)
        return self.segments.evaluate(i, arc_lengths - self.breaks[i], checks.derivative(order))

    def locate(self, s: npt.ArrayLike, *, side: str = "right") -> IntArray:
        """Return the index of the segment that contains each arc length.

        Args:
            s: Arc lengths [m], any shape.
            side: "right" for the segment after a vertex, "left" for the segment before the vertex.
        """
        return checks.locate(self.breaks, s, side)

    @checked
    def assigned_speeds(
        self, limit: SpeedLimit | None, s: npt.ArrayLike | None = None, *, side: str = "right"
    ) -> FloatArray:
        """Return the assigned velocities [m/s]: the segments' speeds, at most a limit; inf without.

        Args:
            limit: Largest assigned velocity [m/s], such as `limits.speed`, or None.
            s: Arc lengths [m], any shape; by default there is one value per segment.
            side: "right" for the segment after a vertex, "left" for the segment before the vertex.
        """
        speeds = np.fmin(self.speeds, np.inf if limit is None else limit)
        return speeds if s is None else np.asarray(speeds[self.locate(s, side=side)])

    def on_segment(self, i: IntArray, u: FloatArray, order: int = 0) -> FloatArray:
        """Return the point or derivative at distance `u` [m] from the start of segment `i`.

        Args:
            i: Indices of segments, (n,).
            u: Distances from the starts of these segments [m], (n,).
            order: Order of the derivative, 0 for the point.
        """
        return self.segments.evaluate(i, u, order)

    def project(self, points: npt.ArrayLike) -> Projection:
        """Return the distance and arc length of the path point nearest to each query point.

        The result is exact on lines and arcs.

        The first call builds a spatial index, which later calls use. A query then takes a time
        proportional to the logarithm of the segment count.

        Args:
            points: Query points [m], (n, dimension).

        Raises:
            InvalidInput: The points have another dimension than the path, or are not finite.
        """
        return find_nearest(self.segments, points)

    __repr__ = short_repr
    plot = pictures.plot
    _repr_html_ = pictures.draw_as_html

    @property
    def turns(self) -> FloatArray:
        """Angle between the tangents at every vertex between segments [rad], (n - 1,)."""
        if len(self) == 1:
            return np.empty(0)
        return angle_between(self.segments.end_tangents[:-1], self.tangents[1:])

    @property
    def stops(self) -> FloatArray:
        """Arc lengths [m] at which the tool stops, because a tangent, orientation or rate jumps."""
        inner = self.breaks[1:-1].copy()
        corners = inner[self.turns > TANGENT_TOLERANCE] if len(inner) else inner
        if self.orientation is None or not len(orientation_stops := self.orientation.stops):
            return corners
        return np.union1d(corners, orientation_stops)

    @property
    def vertices(self) -> FloatArray:
        """Start point of the path and end points of all segments [m], (n + 1, dimension)."""
        return np.concatenate([self.starts, self.end[None]])

    @property
    def start(self) -> FloatArray:
        """First point [m], (dimension,)."""
        return np.asarray(self.starts[0])

    @property
    def end(self) -> FloatArray:
        """Last point of the path [m], (dimension,)."""
        last = slice(len(self) - 1, None)
        return np.asarray(self.segments.evaluate(last, self.lengths[last])[0])

    def _snap_breaks(self, orientation: Orientation) -> Orientation:
        """Move the orientation's breaks to those of the path that differ by rounding errors."""
        if self.dimension != 3:
            raise InvalidInput(PLANAR_PATH)
        whole = len(orientation) == 1 and orientation.breaks[1] == self.length
        if whole or np.array_equal(orientation.breaks, self.breaks):
            return orientation
        slack = SAME_BREAK * (1 + self.length)
        if abs(orientation.breaks[-1] - self.length) > slack * len(self):
            raise InvalidInput(
                f"The orientation is for a path of {orientation.breaks[-1]:.9g} m, but the path is "
                f"{self.length:.9g} m long."
            )
        nearest = np.clip(np.searchsorted(self.breaks, orientation.breaks), 1, len(self))
        low = self.breaks[nearest - 1]
        high = self.breaks[nearest]
        targets = np.where(orientation.breaks - low < high - orientation.breaks, low, high)
        distances = np.abs(targets - orientation.breaks)
        # If two breaks are near one vertex, only the nearer break is moved.
        previous = np.append(np.inf, distances[:-1])
        following = np.append(distances[1:], np.inf)
        previous[1:][targets[1:] != targets[:-1]] = np.inf
        following[:-1][targets[1:] != targets[:-1]] = np.inf
        nearer = (distances < previous) & (distances <= following)
        snapped = np.where((distances <= slack) & nearer, targets, orientation.breaks)
        snapped[-1] = self.length
        return replace(orientation, breaks=snapped)


def _check_waypoints(waypoints: npt.ArrayLike, n: int) -> IntArray:
    """Return read-only waypoints; raise InvalidInput unless they increase from 0 to n."""
    indices = checks.indices("waypoints of a path", waypoints)
    if (
        indices.ndim != 1
        or len(indices) < 2
        or (indices[0], indices[-1]) != (0, n)
        or not (indices[1:] > indices[:-1]).all()
    ):
        raise InvalidInput(
            f"waypoints of a path must be indices of vertices that increase from 0 to {n}."
        )
    return checks.freeze(indices)


def _find_missing(count: int, remaining: IntArray) -> tuple[int, ...]:
    """Return the indices below `count` that are not in `remaining`."""
    if len(remaining) == count:
        return ()
    return tuple(np.setdiff1d(np.arange(count), remaining).tolist())


def _find_distinct(points: FloatArray) -> IntArray:
    """Return indices of the points that differ from the previous remaining point."""
    none = np.zeros(max(len(points) - 1, 0), dtype=bool)
    _, mask = close_gaps(points[:-1], points[1:], none, REPEATED_POINT)
    return np.flatnonzero(np.append(True, mask))


class _PathPart(NamedTuple):
    """The part of a path between two arc lengths, by the segments that it cuts."""

    begin: float  # Arc length at which the part starts [m]
    i: IntArray  # Indices of its segments, (n,)
    u0: FloatArray  # Distance along each segment at which the part starts [m], (n,)
    u1: FloatArray  # Distance along each segment at which it ends [m], (n,)

    def orientation_of(self, path: Path) -> Orientation | None:
        """Return the orientation of the part; None if the path has none."""
        # The orientation is cut at the same arc lengths as the segments.
        length = float((self.u1 - self.u0).sum())
        whole = path.orientation
        return None if whole is None else whole.cut(self.begin, length, REPEATED_POINT)


def cut_path(path: Path, begin: float, end: float) -> Path:
    """Cut out the part between two arc lengths, with speeds, tolerances and orientation.

    `begin`, `end`: arc lengths at which the part starts and ends [m].
    """
    part = _find_part(path, begin, end)
    return Path(
        segments=path.segments.cut(part.i, part.u0, part.u1).replace(checked=True),
        orientation=part.orientation_of(path),
        smoothing=path.smoothing,
    )


def start_at(path: Path, start: float) -> Path:
    """Return a closed path that starts, and ends, at another of its points.

    This is faster than joining the parts after and before the point.

    `start`: arc length of the point on the given path [m], inside the path.
    """
    parts = (_find_part(path, start, path.length), _find_part(path, 0.0, start))
    i, u0, u1 = (np.concatenate([getattr(x, name) for x in parts]) for name in ("i", "u0", "u1"))
    gap = np.linalg.norm(path.segments[-1:].ends[0] - path.starts[0])
    # If the gap is too wide, the check of all segments reports it.
    segments = path.segments.cut(i, u0, u1).replace(checked=bool(gap <= REPEATED_POINT))
    orientation = None
    if path.orientation is not None:
        oriented = [x.orientation_of(path) for x in parts]
        lengths = [float(np.cumsum(x.u1 - x.u0)[-1]) for x in parts]
        orientation = Orientation.join([x for x in oriented if x is not None], lengths)
    return Path(segments=segments, orientation=orientation, smoothing=path.smoothing)


def _find_part(path: Path, begin: float, end: float) -> _PathPart:
    """Find the segments between two arc lengths [m]; raise InvalidInput if there are none."""
    for name, s in (("begin", begin), ("end", end)):
        value = checks.check_number(name, s, "m")
        if not -REPEATED_POINT <= value <= path.length + REPEATED_POINT:
            raise InvalidInput(
                f"{name} of a part must lie within the path of {path.length:.9g} m, but is "
                f"{value:.9g} m.",
                s=value,
                allowed=path.length,
            )
    begin = max(begin, 0.0)
    end = min(end, path.length)
    # Remainders of segments shorter than the resolution of a point are discarded.
    first = int(path.locate(begin + REPEATED_POINT))
    last = int(path.locate(end - REPEATED_POINT, side="left"))
    if end - begin <= REPEATED_POINT or first > last:
        raise InvalidInput(
            f"The part from {begin:.9g} to {end:.9g} m of the path has no length. The end must be "
            f"greater than the start by more than {REPEATED_POINT:g} m."
        )
    begin = max(begin, float(path.breaks[first]))
    end = min(end, float(path.breaks[last + 1]))
    i = np.arange(first, last + 1)
    u0 = np.zeros(len(i))
    u1 = path.lengths[i].copy()
    u0[0] = begin - path.breaks[first]
    u1[-1] = min(end - path.breaks[last], u1[-1])
    return _PathPart(begin, i, u0, u1)


def drop_z(path: Path) -> Path:
    """Project a path in space onto the x-y plane, without its orientation."""
    if path.dimension == 2:
        return path
    across = (np.abs(path.tangents[:, 2]) + np.abs(path.normals[:, 2]) > IN_PLANE) & (
        path.curvatures > 0
    )
    quintics = path.segments.quintics
    if quintics.size:
        across |= np.abs(quintics[:, :, 2]).max(axis=1) > IN_PLANE
    if across.any():
        i = int(np.argmax(across))
        raise InvalidInput(
            f"Segment {i + 1} cannot be projected onto the x-y plane, because it is an arc or a "
            "transition that is not parallel to this plane.",
            index=i,
        )
    # Ratio of each segment's length in the plane to its length in space.
    ratio = np.linalg.norm(path.tangents[:, :2], axis=1)
    mask = ratio * path.lengths > REPEATED_POINT
    if not mask.any():
        raise InvalidInput(
            "The path is vertical, so its projection onto the x-y plane has no length."
        )
    rows = path.segments[mask]
    shortening = ratio[mask]
    return Path(
        segments=rows.replace(
            starts=rows.starts[:, :2],
            tangents=rows.tangents[:, :2] / shortening[:, None],
            normals=rows.normals[:, :2],
            lengths=rows.lengths * shortening,
            quintics=rows.quintics[:, :, :2],
        )
    )


def has_length_without_z(path: Path) -> bool:
    """Return whether the projection of a path onto the x-y plane has any length."""
    lengths = np.linalg.norm(path.tangents[:, :2], axis=1) * path.lengths
    return bool(((lengths > REPEATED_POINT) | (path.curvatures > 0)).any())


def arc_lengths_without_z(path: Path, s: FloatArray) -> FloatArray:
    """Return arc lengths on the projected path for arc lengths `s` on a path in space [m]."""
    ratio = np.linalg.norm(path.tangents[:, :2], axis=1)
    lengths = np.where(path.curvatures > 0, 1.0, ratio) * path.lengths
    ends = np.cumsum(np.where(lengths > REPEATED_POINT, lengths, 0.0))
    return np.asarray(np.interp(s, path.breaks, np.append(0.0, ends)))
