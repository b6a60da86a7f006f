"""A path: what the tool draws, with no time in it."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from armcontour import _checks
from armcontour._checks import FloatArray, IntArray
from armcontour.errors import InvalidInput
from armcontour.frames import angle_between
from armcontour.geometry import orienting
from armcontour.geometry.cell_index import CellIndex
from armcontour.geometry.orientation import Orientation
from armcontour.geometry.projection import PIECES_PER_SEGMENT, Projection, pieces_wanted
from armcontour.geometry.segments import NO_DEMAND, Arc, Demand, Line, arc_frame, line_frame
from armcontour.geometry.tree_index import SegmentIndex

# Points closer than this are one point: a nanometre is below what any arm can resolve.
REPEATED_POINT = 1e-9
# Tangents closer than this [rad] are one tangent: at 1 m/s the step in velocity is 1 nm/s.
TANGENT_TOLERANCE = 1e-9
PLANE = "A tool is oriented in space: give the points of the path three coordinates."
NOT_GIVEN = _checks.locked([])
EVERY_VERTEX = _checks.locked_copy(np.empty(0, dtype=np.intp))
# Breaks of an orientation this near to a joint of its path are that joint, in metres and in path
# lengths: what rounding of corners leaves out, and what adding lengths up rounds.
SAME_BREAK = 1e-12


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Path:
    """A continuous chain of lines and arcs in the plane or in space, callable in arc length.

    Segment i is `starts[i] + tangents[i] sin(k u)/k + inwards[i] (1 - cos(k u))/k` with
    `k = curvatures[i]` and `0 <= u <= lengths[i]`; for a line k is 0. Build one with `polyline`
    or `from_segments`.

    Args:
        starts: First point of every segment [m], (n, 2) or (n, 3).
        tangents: Unit tangents there, same shape.
        inwards: Unit vectors towards the arcs' centres, zero for lines, same shape.
        curvatures: (n,) [1/m], zero for lines.
        lengths: (n,) [m], above zero.
        speeds: (n,) assigned velocity of the segment [m/s], NaN where it has none of its own.
        tolerances: (n,) largest corner error of the segment [m], NaN where it has none.
        tags: Free text per segment.
        merged: Indices of the input points that were left out because they repeat the one before.
        waypoints: Vertices at which the input points that were kept lie; by default every vertex is
            one. A spline has more vertices than points.
        orientation: How the tool is held along the path, in space only; None says nothing of it.
            `oriented`, `pointing` and `following_tangent` give it.

    Raises:
        InvalidInput: Arrays that do not fit, or a gap between segments.
    """

    starts: FloatArray
    tangents: FloatArray
    inwards: FloatArray
    curvatures: FloatArray
    lengths: FloatArray
    speeds: FloatArray = field(default_factory=lambda: NOT_GIVEN)
    tolerances: FloatArray = field(default_factory=lambda: NOT_GIVEN)
    tags: tuple[str | None, ...] = ()
    merged: tuple[int, ...] = ()
    waypoints: IntArray = field(default_factory=lambda: EVERY_VERTEX)
    orientation: Orientation | None = None
    breaks: FloatArray = field(init=False, repr=False)
    _index: list[SegmentIndex | CellIndex] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        starts = _checks.points("starts", self.starts)
        n = len(starts)
        if n == 0:
            raise InvalidInput("A path needs at least one segment.")
        for name in ("starts", "tangents", "inwards", "curvatures", "lengths"):
            array = _checks.locked(getattr(self, name))
            shape = starts.shape if name in ("starts", "tangents", "inwards") else (n,)
            if array.shape != shape or not np.isfinite(array).all():
                raise InvalidInput(f"{name} of a path must be finite and of shape {shape}.")
            object.__setattr__(self, name, array)
        if (self.lengths <= 0).any() or (self.curvatures < 0).any():
            raise InvalidInput("Segment lengths must be above zero and curvatures not negative.")
        for name in ("speeds", "tolerances"):
            values = getattr(self, name)
            array = _checks.locked(np.full(n, np.nan) if values is NOT_GIVEN else values)
            if array.shape != (n,):
                raise InvalidInput(f"{name} of a path must be one per segment ({n}).")
            object.__setattr__(self, name, array)
        if (self.speeds <= 0).any() or (self.tolerances < 0).any():
            raise InvalidInput("Segment speeds must be above zero and tolerances not negative.")
        if (np.abs(np.linalg.norm(self.tangents, axis=1) - 1) > REPEATED_POINT).any():
            raise InvalidInput("The tangents of a path must be unit vectors.")
        if len(self.tags) not in (0, n):
            raise InvalidInput(f"tags of a path must be one per segment ({n}).")
        object.__setattr__(self, "tags", tuple(self.tags) or (None,) * n)
        at = np.arange(n + 1) if self.waypoints is EVERY_VERTEX else np.asarray(self.waypoints)
        if at.ndim != 1 or len(at) < 2 or (at[0], at[-1]) != (0, n) or (np.diff(at) <= 0).any():
            raise InvalidInput(f"waypoints of a path must increase from 0 to {n}.")
        object.__setattr__(self, "waypoints", _checks.locked_copy(at))
        object.__setattr__(
            self, "breaks", _checks.locked(np.concatenate([[0.0], np.cumsum(self.lengths)]))
        )
        object.__setattr__(self, "_index", [])
        self._refuse_gaps()
        if self.orientation is not None:
            object.__setattr__(self, "orientation", self._fitting(self.orientation))

    @classmethod
    def polyline(cls, points: npt.ArrayLike, *, demand: Demand = NO_DEMAND) -> Path:
        """Straight lines through `points`, (n, 2) or (n, 3) [m]; repeated points are merged.

        Args:
            points: The vertices [m], (n, 2) or (n, 3).
            demand: Speed, corner error and tag of all segments.

        Raises:
            InvalidInput: Not such points, or fewer than two different ones.
        """
        given = _checks.points("points of a path", points)
        kept = _without_repeats(given)
        if len(kept) < 2:
            raise InvalidInput(
                f"A path needs at least two different points, but {len(given)} "
                f"point{'s were' if len(given) != 1 else ' was'} given"
                f"{' that are all the same' if len(given) > 1 else ''}."
            )
        vertices = given[kept]
        steps = np.diff(vertices, axis=0)
        lengths = np.linalg.norm(steps, axis=1)
        n = len(steps)
        return Path(
            starts=vertices[:-1],
            tangents=steps / lengths[:, None],
            inwards=np.zeros_like(steps),
            curvatures=np.zeros(n),
            lengths=lengths,
            speeds=np.full(n, np.nan if demand.speed is None else demand.speed),
            tolerances=np.full(n, np.nan if demand.tolerance is None else demand.tolerance),
            tags=(demand.tag,) * n,
            merged=tuple(np.setdiff1d(np.arange(len(given)), kept).tolist()),
        )

    @classmethod
    def from_segments(cls, segments: Iterable[Line | Arc]) -> Path:
        """A chain of lines and arcs, each starting where the one before ends.

        Args:
            segments: The lines and arcs, in the order of travel.

        Raises:
            InvalidInput: A segment that is none, or a gap, with the segment's index.
        """
        listed = list(segments)
        for i, x in enumerate(listed):
            if not isinstance(x, (Line, Arc)):
                raise InvalidInput(
                    f"Segment {i + 1} must be a Line or an Arc, not a {type(x).__name__}.", index=i
                )
        frames = [
            line_frame(x, i) if isinstance(x, Line) else arc_frame(x, i)
            for i, x in enumerate(listed)
        ]
        if not frames:
            raise InvalidInput("A path needs at least one segment.")
        if len({len(frame.start) for frame in frames}) > 1:
            raise InvalidInput("All segments of a path must have the same number of coordinates.")
        demands = [x.demand for x in listed]
        return Path(
            starts=np.array([x.start for x in frames]),
            tangents=np.array([x.tangent for x in frames]),
            inwards=np.array([x.inward for x in frames]),
            curvatures=np.array([x.curvature for x in frames]),
            lengths=np.array([x.length for x in frames]),
            speeds=np.array([np.nan if x.speed is None else x.speed for x in demands]),
            tolerances=np.array([np.nan if x.tolerance is None else x.tolerance for x in demands]),
            tags=tuple(x.tag for x in demands),
        )

    @classmethod
    def spline(
        cls,
        points: npt.ArrayLike,
        *,
        tolerance: float = 1e-6,
        closed: bool = False,
        demand: Demand = NO_DEMAND,
    ) -> Path:
        """The cubic spline through `points`, as tangent arcs within `tolerance` of it.

        Args:
            points: (n, 2) or (n, 3) [m]; repeated points are merged.
            tolerance: Largest distance between the spline and the arcs [m].
            closed: Whether the spline goes on smoothly from the last point, which must repeat the
                first, to the first.
            demand: What the process asks of it.

        Raises:
            InvalidInput: Fewer than two different points, or a closed spline that is not closed.
        """
        from armcontour.geometry.spline import arcs_along

        given = _checks.points("points of a spline", points)
        kept = _without_repeats(given)
        if len(kept) < 2:
            raise InvalidInput("A spline needs at least two different points.")
        if _checks.positive("spline tolerance", tolerance, "m") < REPEATED_POINT:
            raise InvalidInput(
                f"The spline tolerance must be at least {REPEATED_POINT:g} m, but is "
                f"{tolerance:g} m."
            )
        frames, waypoints = arcs_along(given[kept], tolerance, closed)
        n = len(frames.lengths)
        return Path(
            starts=frames.starts,
            tangents=frames.tangents,
            inwards=frames.inwards,
            curvatures=frames.curvatures,
            lengths=frames.lengths,
            speeds=np.full(n, np.nan if demand.speed is None else demand.speed),
            tolerances=np.full(n, np.nan if demand.tolerance is None else demand.tolerance),
            tags=(demand.tag,) * n,
            merged=tuple(np.setdiff1d(np.arange(len(given)), kept).tolist()),
            waypoints=waypoints,
        )

    def oriented(self, rotations: Any, *, axis_only: bool = False) -> Path:
        """The same path with the tool held in one way, or in a given way at every waypoint.

        Between waypoints, the points that the path was made of, the tool turns evenly, by the
        shortest rotation.

        Args:
            rotations: Tool axes in the path's coordinates, as columns: one rotation or one per
                waypoint; matrices, quaternions (x, y, z, w) or a rotation of scipy.
            axis_only: Only the tool axis (z) counts; turning about it is free.

        Raises:
            InvalidInput: A path in the plane; no rotations or a wrong number of them; or
                neighbours that differ by half a turn.
        """
        found = orienting.held(self, rotations, axis_only=axis_only)
        return dataclasses.replace(self, orientation=found)

    def pointing(self, directions: npt.ArrayLike) -> Path:
        """The same path with the tool axis (z) in one direction, or in one per waypoint.

        Turning about the tool axis is free, as in cutting, dispensing and welding.

        Args:
            directions: (3,) or one per waypoint, (n, 3).

        Raises:
            InvalidInput: A path in the plane, or directions that are none.
        """
        found = orienting.pointing(self, directions)
        return dataclasses.replace(self, orientation=found)

    def following_tangent(
        self, up: npt.ArrayLike, *, tool: Any | None = None, axis_only: bool = False
    ) -> Path:
        """The same path with the tool held at a fixed angle to the tangent.

        Args:
            up: Direction across the first tangent; it makes z of the path's frame, whose x is the
                tangent. The frame is carried along without turning about the tangent.
            tool: The tool in the path's frame; by default its axis points against `up`.
            axis_only: Only the tool axis (z) counts; turning about it is free.

        Raises:
            InvalidInput: A path in the plane, `up` along the first tangent, or a turn of 180°.
        """
        if self.dimension != 3:
            raise InvalidInput(PLANE)
        found = orienting.following(self, up, tool, axis_only=axis_only)
        return dataclasses.replace(self, orientation=found)

    @property
    def length(self) -> float:
        """Arc length of the whole path [m]."""
        return float(self.breaks[-1])

    @property
    def dimension(self) -> int:
        """2 in the plane, 3 in space."""
        return int(self.starts.shape[1])

    def __len__(self) -> int:
        """Number of segments."""
        return len(self.lengths)

    def __call__(self, s: npt.ArrayLike, order: int = 0, *, side: str = "right") -> FloatArray:
        """Point (order 0) or derivative with respect to arc length at `s`.

        Args:
            s: Arc lengths [m], any shape, within the path.
            order: 0, 1, 2, ...
            side: "right" or "left": whose derivative to take at a joint between segments.

        Returns:
            Shape `s.shape + (dimension,)` [m, -, 1/m, ...].

        Raises:
            InvalidInput: An arc length outside the path.
        """
        at = _within(s, self.length)
        i = self.locate(at, side=side)
        return self.on_segment(i, at - self.breaks[i], order)

    def locate(self, s: npt.ArrayLike, *, side: str = "right") -> IntArray:
        """Index of the segment that contains each arc length.

        Args:
            s: Arc lengths [m], any shape.
            side: "right" for the segment after a vertex, "left" for the segment before the vertex.
        """
        found = np.searchsorted(self.breaks, s, side=_checks.side(side)) - 1
        return np.clip(found, 0, len(self) - 1)

    def on_segment(self, i: IntArray, u: FloatArray, order: int = 0) -> FloatArray:
        """Point or derivative at distance `u` [m] from the start of segment `i`.

        Args:
            i: Indices of segments, (n,).
            u: Distances from the starts of these segments [m], (n,).
            order: Order of the derivative, 0 for the point.
        """
        k = self.curvatures[i]
        angle = k * u
        if order == 0:
            along = u * np.sinc(angle / np.pi)
            inward = u * (angle / 2) * np.sinc(angle / (2 * np.pi)) ** 2
            result = (
                self.starts[i]
                + along[..., None] * self.tangents[i]
                + inward[..., None] * self.inwards[i]
            )
        else:
            phase = angle + (order - 1) * np.pi / 2 if order > 1 else angle
            scale = k ** (order - 1)
            result = (scale * np.cos(phase))[..., None] * self.tangents[i] + (
                scale * np.sin(phase)
            )[..., None] * self.inwards[i]
        return np.asarray(result)

    def project(self, points: npt.ArrayLike) -> Projection:
        """The nearest point of the path for each of `points`, (n, dimension) [m].

        Exact on lines and arcs. A spatial index is built at the first call and kept; a query then
        costs about the logarithm of the number of segments.

        Args:
            points: The points [m], (n, dimension).

        Raises:
            InvalidInput: Points of another dimension, or not finite.
        """
        queries = _checks.points("points to project", points)
        if queries.shape[1] != self.dimension:
            raise InvalidInput(
                f"Points to project have {queries.shape[1]} coordinates, "
                f"the path has {self.dimension}."
            )
        if not self._index:
            self._index.append(self._build_index())
        return self._index[0].nearest(queries)

    def _build_index(self) -> SegmentIndex | CellIndex:
        """Cells for a path so tangled that a tree would need too many pieces, else a tree."""
        tangled = pieces_wanted(self) > PIECES_PER_SEGMENT * len(self)
        return (CellIndex if tangled and self.dimension == 2 else SegmentIndex).build(self)

    @property
    def turns(self) -> FloatArray:
        """Angle between the tangents at every joint between segments [rad], (n - 1,)."""
        i = np.arange(len(self) - 1)
        before = self.on_segment(i, self.lengths[:-1], 1)
        return angle_between(before, self.tangents[1:])

    @property
    def stops(self) -> FloatArray:
        """Arc lengths [m] where the tangent or the rate of turning jumps: no motion passes them."""
        corners = self.breaks[1:-1][self.turns > TANGENT_TOLERANCE]
        return corners if self.orientation is None else np.union1d(corners, self.orientation.stops)

    @property
    def vertices(self) -> FloatArray:
        """The segments' ends, (n + 1, dimension) [m]."""
        last = self.on_segment(np.array([len(self) - 1]), self.lengths[-1:])
        return np.concatenate([self.starts, last])

    def _fitting(self, orientation: Orientation) -> Orientation:
        """The orientation with its breaks on the path's own where they are the same.

        Raises:
            InvalidInput: A path in the plane, or an orientation of another length.
        """
        if self.dimension != 3:
            raise InvalidInput(PLANE)
        slack = SAME_BREAK * (1 + self.length)
        if abs(orientation.breaks[-1] - self.length) > slack * len(self):
            raise InvalidInput(
                f"The orientation is for a path of {orientation.breaks[-1]:.9g} m, but the path is "
                f"{self.length:.9g} m long."
            )
        nearest = np.clip(np.searchsorted(self.breaks, orientation.breaks), 1, len(self))
        low, high = self.breaks[nearest - 1], self.breaks[nearest]
        own = np.where(orientation.breaks - low < high - orientation.breaks, low, high)
        off = np.abs(own - orientation.breaks)
        # Of two near the same joint the nearer one is it.
        first, again = np.append(np.inf, off[:-1]), np.append(off[1:], np.inf)
        first[1:][own[1:] != own[:-1]] = np.inf
        again[:-1][own[1:] != own[:-1]] = np.inf
        nearer = (off < first) & (off <= again)
        snapped = np.where((off <= slack) & nearer, own, orientation.breaks)
        snapped[-1] = self.length
        return dataclasses.replace(orientation, breaks=snapped)

    def _refuse_gaps(self) -> None:
        i = np.arange(len(self) - 1)
        gaps = np.linalg.norm(self.on_segment(i, self.lengths[:-1]) - self.starts[1:], axis=1)
        if (gaps > REPEATED_POINT).any():
            first = int(np.argmax(gaps > REPEATED_POINT))
            point = self.starts[first + 1].tolist()
            raise InvalidInput(
                f"Segment {first + 2} starts at {tuple(point)} m, {gaps[first]:.3g} m from the end "
                f"of segment {first + 1}: a path must be continuous.",
                index=first + 1,
                point=point,
                needed=float(gaps[first]),
                allowed=REPEATED_POINT,
            )


def _within(s: npt.ArrayLike, length: float) -> FloatArray:
    at = np.asarray(s, dtype=np.float64)
    slack = 1e-12 * max(length, 1e-3)
    outside = ~((at >= -slack) & (at <= length + slack))
    if outside.any():
        value = float(at[outside].flat[0])
        raise InvalidInput(
            f"Arc length {value:g} m lies outside the path, which runs from 0 to {length:.9g} m.",
            s=value,
            allowed=length,
        )
    return np.asarray(np.clip(at, 0.0, length))


def _without_repeats(points: FloatArray) -> IntArray:
    """Indices of the points that differ from the last one kept."""
    if len(points) < 2 or (np.linalg.norm(np.diff(points, axis=0), axis=1) > REPEATED_POINT).all():
        return np.arange(len(points))
    kept = [0]
    for i in range(1, len(points)):
        if np.linalg.norm(points[i] - points[kept[-1]]) > REPEATED_POINT:
            kept.append(i)
    return np.array(kept)
