"""Corner rounding within a corner error, by arcs as in (10)-(16) of the paper or other curves.

The *corner error* is the gap between the corner point and the arc, as in the paper's Fig. 3:
`gap = r (1 - cos h) / cos h` for radius r and half the turn h. Other texts call two other lengths
tolerance: the arc's distance from the path, `r (1 - cos h) = gap cos h`, and the tangent length,
`r tan h`, which is the part of each line that the arc replaces. Two tangent arcs replace a corner
next to an arc (arc_corners.py). The other curves are in line_corners.py. See
docs/concepts/corners.md.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, fields, replace
from itertools import combinations
from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from armcontour.core import checks
from armcontour.core.checks import BoolArray, FloatArray, Frozen, IntArray, ObjectArray
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import checked
from armcontour.core.text import short_repr
from armcontour.geometry.orientation import SAME_ORIENTATION, Orientation
from armcontour.geometry.path import EVERY_VERTEX, Path
from armcontour.geometry.rounding.collinear_lines import MergedLines, merge_lines
from armcontour.geometry.rounding.corner_curves import (
    choose_curves,
    draw_curves,
    insert_curves,
    share_segments,
)
from armcontour.geometry.rounding.line_corners import (
    ARC,
    PARABOLA,
    SMOOTH,
    CornerBounds,
    LineCorner,
)
from armcontour.geometry.rounding.rounded_orientation import (
    NO_VERTICES,
    check_even,
    find_kinks,
    follow_rounded,
    jumps_at,
    largest_blend,
    middle_of_half_length,
    round_orientation,
)
from armcontour.geometry.segments import TANGENT_TOLERANCE, Segments
from armcontour.geometry.shaped_path import ShapedPath

# Curves that replace corners between two lines.
Curve: TypeAlias = Literal["arc", "smooth", "parabola"]
CURVES: dict[Curve, LineCorner] = {"arc": ARC, "smooth": SMOOTH, "parabola": PARABOLA}
# Number of points from which the extent of a path is computed.
SAMPLES = 65
# Corner tolerances up to this are not compared with the extent of the path [m].
LARGEST_USUAL_TOLERANCE = 0.02
# Planes whose normals differ by less than this angle [rad] count as equal.
SAME_PLANE = 1e-9
# Largest distance of vertices from a line that replaces nearly collinear lines [m]: the rounding
# error of coordinates with three decimals in mm or four in inches, as for
# `ReadOptions.repair_vertices`.
PRINTING_ERROR = 2e-6
# Largest fraction of the smallest corner error that this distance may be.
PRINTING_ERROR_SHARE = 0.1
# Reasons for a stop at a corner.
TURN_BACK = "turn-back"
NO_TOLERANCE = "tolerance zero"
NO_ANGLE = "angular tolerance zero"
OUT_OF_PLANE = "tangent followed out of its plane"
NO_ROOM = "no room"
NOT_ROUNDED = "rounding off"
NOT_FASTER = "faster than a curve"
ORIENTATION = "tool orientation"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Corners(Frozen):
    """The n corners of an objective path in path order, and the arcs that replace them.

    Args:
        vertex: Index of the corner among the objective path's vertices, from 0, (n,).
        point: The corner points [m], (n, dimension).
        turn: Angle between the lines [rad], above 0 and at most pi, (n,).
        radius: Radius of the arc, next to an arc the smaller of the two radii [m], 0 if the tool
            stops at the corner, (n,).
        error: Corner error: gap between corner point and arc [m], (n,).
        tangent: Tangent length [m], (n,).
        start, end: Arc lengths on the rounded path at which the arc starts and ends [m], (n,).
        shrunk: True if the arc is smaller than its case requires, because its lines are too short
            or its orientation turns too much, (n,).
        speed: Largest speed on the arc under the specified acceleration, (16) [m/s], (n,); NaN
            without an acceleration.
        angular_error: Angle between the tool orientations at the arc's middle and at the corner
            point [rad], (n,); between the tool axes if only they are prescribed; 0 if the
            orientation follows the tangent or is missing.
        reason: Reason for the stop at the corner, such as "turn-back", "tolerance zero" or "no
            room"; None without a stop, (n,).
    """

    vertex: IntArray
    point: FloatArray
    turn: FloatArray
    radius: FloatArray
    error: FloatArray
    tangent: FloatArray
    start: FloatArray
    end: FloatArray
    shrunk: BoolArray
    speed: FloatArray
    angular_error: FloatArray
    reason: ObjectArray

    def __len__(self) -> int:
        """Number of corners."""
        return len(self.vertex)

    @property
    def stopped(self) -> BoolArray:
        """Mask of the corners that stay sharp, so that the tool stops there, (n,)."""
        return np.asarray(self.radius == 0)


@dataclass(frozen=True, kw_only=True, eq=False)
class RoundedPath(Path):
    """A path with rounded corners, together with its objective path and its corners.

    Args:
        objective: The path before rounding.
        corners: The corners of the objective path, and their arcs.
        deviation: Largest corner error [m], including the distance between nearly collinear lines
            of the objective and the line that replaces them; 0 without corners.
    """

    objective: Path
    corners: Corners
    deviation: float = 0.0

    __repr__ = short_repr

    def place(self, s: npt.ArrayLike) -> FloatArray:
        """Return arc lengths on this path that correspond to arc lengths on the objective path [m].

        Within a rounded corner the correspondence is linear.

        Args:
            s: Arc lengths of the objective path [m], any shape.
        """
        s = checks.floats("arc lengths", s, "m")
        c = self.corners
        if self.segments is self.objective.segments:
            return np.clip(s, 0.0, self.length)
        corner_s = self.objective.breaks[c.vertex]
        before = np.concatenate(
            [[0.0], np.stack([corner_s - c.tangent, corner_s + c.tangent], axis=1).ravel()]
        )
        after = np.concatenate([[0.0], np.stack([c.start, c.end], axis=1).ravel()])
        ends = self.objective.length, self.length
        arc_lengths = np.interp(s, np.append(before, ends[0]), np.append(after, ends[1]))
        return np.asarray(arc_lengths)


@checked
def round_path(
    path: Path,
    *,
    tolerance: npt.ArrayLike | None = None,
    speed: npt.ArrayLike | None = None,
    acceleration: npt.ArrayLike | None = None,
    angular_tolerance: float | None = None,
    curve: Curve = "arc",
) -> RoundedPath:
    """Replace every corner of a path by a curve, by the paper's case I or case II.

    Case II: `tolerance` bounds the corner error, and the radius is the largest that satisfies it,
    (15). Case I: `speed` is the lowest speed allowed on the corner; under `acceleration` it gives
    the smallest radius (13) and the smallest corner error (14). With both, `tolerance` caps the
    corner error of case I.

    Each value is one number for all corners, or one per vertex between segments (values of vertices
    without a corner are ignored). Tolerances of the path's segments cap the corner error. Curves
    that would overlap shrink until they fit their segments. Where no curve is possible (zero
    tolerance, a turn of 180°, segments without room) the corner stays sharp, and the tool stops
    there; `corners.reason` reports the cause.

    - "arc": an arc between two lines, two tangent arcs next to an arc.
    - "smooth": a curve with continuous curvature, so a motion with a jerk limit need not stop. It
      has the same corner error and uses more of both lines; `corners.radius` is its radius in the
      middle. A corner next to an arc becomes a connection, or two tangent arcs if the turn is too
      sharp, at whose ends the curvature jumps.
    - "parabola": tangent arcs along a parabola between two lines, two tangent arcs next to an arc.
      This shape suits a tool with limited acceleration that is slower in the middle of a corner: a
      parabola is longer than the arc with the same corner error, and has less curvature at its
      ends. `corners.radius` is the smallest radius, in the middle.

    The tool orientation is rounded with the position. `angular_tolerance` bounds its deviation in
    the middle of a corner, and reduces curves if necessary. It also applies to vertices at which
    only the angular rate jumps. An orientation that follows the tangent may deviate from it by that
    angle where lines and arcs meet.

    Args:
        path: The objective path.
        tolerance: Largest corner error [m], a number or one per vertex.
        speed: Lowest speed on a corner [m/s], a number or one per vertex.
        acceleration: Centripetal acceleration at that speed [m/s²], a number or one per vertex.
        angular_tolerance: Largest angle between the tool orientation and its value at the vertex
            [rad].
        curve: The curve at corners.

    Raises:
        InvalidInput: Neither case is specified, a value is negative, their number is wrong, or
            the orientation needs an angular tolerance.
    """
    if tolerance is None and (speed is None or acceleration is None):
        raise InvalidInput(
            "Corners need a tolerance (case II), or a speed and an acceleration (case I). Specify "
            "them as arguments of round_corners in Python, or as keys of corners in a job."
        )
    n = len(path) - 1
    error = checks.per_vertex("corner error tolerance", tolerance, n, "m")
    slowest = checks.per_vertex("corner speed", speed, n, "m/s")
    accelerations = np.full(n, np.nan)
    if acceleration is not None:
        accelerations = checks.per_vertex("corner acceleration", acceleration, n, "m/s²")
        if n:
            checks.positive("corner acceleration", accelerations.min(), "m/s²")
    turn = path.turns
    sharp = turn > TANGENT_TOLERANCE
    if not (isinstance(path, RoundedPath) or sharp.any()) and _turns_smoothly(path):
        return _without_corners(path)
    if isinstance(path, RoundedPath):
        check_even(path)
    kinked = find_kinks(path)
    kinked = kinked[~sharp[kinked]]
    angle = check_angular_tolerance(path, angular_tolerance, kinked)
    if n == 0 and (path.orientation is None or path.orientation.fixed):
        # This shortcut saves time, because a program can have thousands of circles.
        return _without_corners(path)
    error = np.minimum(error, path.vertex_tolerances)
    merged = _merge_printed_lines(path, sharp, error)
    if merged.path is not path:
        turn = merged.path.turns
    corner = np.flatnonzero(turn > TANGENT_TOLERANCE)
    if len(kinked):
        kinked = np.setdiff1d(np.searchsorted(merged.vertex, kinked), corner)
    # Index of each corner among the inner vertices of the given path.
    source = merged.vertex[corner]
    # A corner and the lines next to it deviate by at most the corner error together.
    line_deviation = np.maximum(merged.deviation[corner], merged.deviation[corner + 1])
    error = np.maximum(error[source] - line_deviation, 0.0)
    infinite = np.full(len(corner), np.inf)
    requirements = _Requirements(
        error=error,
        radius=infinite if speed is None else slowest[source] ** 2 / accelerations[source],
        tangent=infinite,
        acceleration=accelerations[source],
    )
    rounded = _round(merged.path, corner, turn[corner], requirements, CURVES[curve], kinked, angle)
    if merged.path is path:
        return rounded
    return replace(
        rounded,
        objective=path,
        corners=replace(rounded.corners, vertex=source + 1),
        deviation=float(
            np.max(rounded.corners.error + line_deviation, initial=merged.deviation.max())
        ),
    )


def _merge_printed_lines(path: Path, sharp: BoolArray, error: FloatArray) -> MergedLines:
    """Merge lines that are collinear up to the rounding of their coordinates.

    - `sharp`: mask of the inner vertices that are corners, (n,).
    - `error`: largest corner errors [m], (n,).
    """
    n = len(sharp)
    rounds = sharp & (error > 0)
    if not rounds.any():
        return MergedLines(path=path, vertex=np.arange(n), deviation=np.zeros(n + 1))
    largest = min(PRINTING_ERROR, PRINTING_ERROR_SHARE * error[rounds].min())
    return merge_lines(path, np.where(sharp & ~rounds, 0.0, largest))


def describe_large_tolerance(path: Path, tolerance: npt.ArrayLike | None) -> list[str]:
    """Return a sentence if the corner tolerance [m] exceeds the path's extent."""
    largest = 0.0 if tolerance is None else float(np.max(tolerance, initial=0.0))
    if largest <= LARGEST_USUAL_TOLERANCE:
        return []
    extent = float(np.ptp(path(np.linspace(0.0, path.length, SAMPLES)), axis=0).max())
    if largest <= extent:
        return []
    return [
        f"the corner tolerance of {largest:g} m is larger than the path, which extends over "
        f"{extent:.4g} m. The tolerance is in metres. For {largest:g} mm, specify "
        f"{largest / 1e3:g} in Python or `tolerance: {largest:g} mm` in a job."
    ]


def count_full_stops(path: Path) -> dict[str, int]:
    """Return the number of full stops inside a path for each reason, {reason: number}.

    The reasons are those of `Corners.reason`, "rounding off" for corners that were not rounded,
    "faster than a curve" for corners of a shaped path, and "tool orientation" where only the
    orientation or its rate jumps.
    """
    if isinstance(path, RoundedPath):
        reasons = [x for x in path.corners.reason.tolist() if x is not None]
    else:
        sharp = path.turns > TANGENT_TOLERANCE
        back = np.pi - path.turns <= TANGENT_TOLERANCE
        sharp_reasons = np.full(len(sharp), NOT_ROUNDED, dtype=object)
        if isinstance(path, ShapedPath):
            tolerances = _tolerances_of_vertices(path)
            sharp_reasons[:] = np.where(tolerances == 0, NO_TOLERANCE, NOT_FASTER)
        reasons = np.where(back, TURN_BACK, sharp_reasons)[sharp].tolist()
    reasons += [ORIENTATION] * (len(path.stops) - len(reasons))
    return dict(sorted(Counter(reasons).items()))


def _tolerances_of_vertices(path: ShapedPath) -> FloatArray:
    """Return the tolerance at each inner vertex of a shaped path [m], (n - 1,).

    It is the tolerance at the nearest vertex of the objective.
    """
    objective = path.objective
    s = np.interp(path.breaks[1:-1], path.places[:, 1], path.places[:, 0])
    middles = (objective.breaks[1:] + objective.breaks[:-1]) / 2
    vertex = np.searchsorted(middles, s).clip(1, max(len(objective) - 1, 1))
    tolerances = np.append(objective.tolerances, np.nan)
    return np.asarray(np.fmin(np.fmin(tolerances[vertex - 1], tolerances[vertex]), path.tolerance))


def blend_vertices(
    path: Path, vertex: IntArray, turn: FloatArray, tolerance: FloatArray
) -> RoundedPath:
    """Replace some vertices by arcs; an arc replaces at most half of either segment.

    - `vertex`: index of the segment before each vertex, increasing, (n,).
    - `turn`: turn of the path at each vertex [rad], (n,).
    - `tolerance`: largest distance of each vertex from the new path [m], (n,).
    """
    n = len(vertex)
    requirements = _Requirements(
        error=tolerance,
        radius=np.full(n, np.inf),
        tangent=np.minimum(path.lengths[vertex], path.lengths[vertex + 1]) / 2,
        acceleration=np.full(n, np.nan),
    )
    return _round(path, vertex, turn, requirements, ARC, kinked=NO_VERTICES, angle=np.inf)


def _turns_smoothly(path: Path) -> bool:
    """Return whether the tool turns at an angular rate that never jumps."""
    orientation = path.orientation
    if orientation is None or orientation.fixed or orientation.follows:
        return False
    return not len(orientation.stops)


def _without_corners(path: Path) -> RoundedPath:
    """Return a path without corners as a rounded path."""
    none = np.empty(0)
    numbers = ("turn", "radius", "error", "tangent", "start", "end", "speed", "angular_error")
    corners = Corners(
        vertex=NO_VERTICES,
        point=np.empty((0, path.dimension)),
        shrunk=NO_VERTICES > 0,
        reason=none.astype(object),
        **dict.fromkeys(numbers, none),
    )
    attributes = {x.name: getattr(path, x.name) for x in fields(Path) if x.init}
    return RoundedPath(**attributes, objective=path, corners=corners)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Requirements:
    """Requirements at n corners."""

    error: FloatArray  # Largest corner errors [m], (n,)
    radius: FloatArray  # Radii that the corner speeds require [m], infinite without a speed, (n,)
    tangent: FloatArray  # Largest tangent lengths [m], (n,)
    acceleration: FloatArray  # Centripetal accelerations [m/s²], NaN without one, (n,)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Obstacles:
    """Masks of the corners that no curve can replace, (n,) each."""

    no_tolerance: BoolArray
    out_of_plane: BoolArray
    turns_back: BoolArray

    @property
    def free(self) -> BoolArray:
        """Mask of the corners that a curve may replace, (n,)."""
        return ~(self.no_tolerance | self.out_of_plane | self.turns_back)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _BlendedVertices:
    """The vertices at which the orientation is blended: n corners, then k kinks."""

    vertex: IntArray  # Index of the segment before each vertex, (n + k,)
    tangent: FloatArray  # Length that the blend replaces on either side [m], (n + k,)
    length: FloatArray  # Lengths of the blends [m], (n + k,)


def _round(
    path: Path,
    corner: IntArray,
    turn: FloatArray,
    requirements: _Requirements,
    curve: LineCorner,
    kinked: IntArray,
    angle: float,
) -> RoundedPath:
    """Replace corners by curves within `requirements`, and blend the orientation at vertices.

    - `corner`: index of the segment before each corner, (n,).
    - `turn`: turns [rad], (n,).
    - `kinked`: vertices without a corner at which the angular rate jumps, (k,).
    - `angle`: angular tolerance [rad].
    """
    bounds = CornerBounds(
        before=path.segments[corner],
        after=path.segments[corner + 1],
        half=turn / 2,
        error=requirements.error,
        radius=requirements.radius,
        tangent=requirements.tangent,
        turn=largest_blend(path, corner, angle),
    )
    obstacles = _find_obstacles(path, bounds)
    choice = choose_curves(bounds, curve, obstacles.free)
    half_lengths = largest_blend(path, kinked, angle) / middle_of_half_length(curve.smooth)
    fitted = share_segments(path.segments, corner, choice, kinked, half_lengths)
    drawn = draw_curves(bounds, choice, fitted.tangent)
    table, source = insert_curves(path.segments, corner, fitted.tangent, drawn)
    blended = _BlendedVertices(
        vertex=np.concatenate([corner, kinked]),
        tangent=np.concatenate([fitted.tangent, fitted.blend]),
        length=np.concatenate([drawn.length, 2 * fitted.blend]),
    )
    orientation, angular_errors = _blend_orientation(
        path, table, source, blended, angle, smooth=curve.smooth
    )
    ends = np.append(0.0, table.breaks[1:])[np.searchsorted(source, corner, side="right")]
    rounded = drawn.radius > 0
    return RoundedPath(
        segments=table,
        merged=path.merged,
        # An arc does not pass through the waypoint at its corner, so all vertices become waypoints.
        waypoints=EVERY_VERTEX if rounded.any() else path.waypoints,
        orientation=orientation,
        smoothing=path.smoothing,
        objective=path,
        deviation=float(drawn.error.max(initial=0.0)),
        corners=Corners(
            vertex=corner + 1,
            point=path.starts[corner + 1],
            turn=2 * bounds.half,
            radius=drawn.radius,
            error=drawn.error,
            tangent=fitted.tangent,
            start=ends - drawn.length,
            end=ends,
            shrunk=drawn.shrunk,
            speed=np.sqrt(requirements.acceleration * drawn.radius),
            angular_error=angular_errors[: len(corner)],
            reason=_find_reasons(path, corner, bounds, obstacles, angle, rounded),
        ),
    )


def _find_obstacles(path: Path, bounds: CornerBounds) -> _Obstacles:
    """Find the corners that no curve can replace."""
    orientation = path.orientation
    if orientation is not None and orientation.follows:
        # If the segments at a corner lie in different planes, a frame that follows the tangent
        # along the curve has an additional rotation about the tangent at the end of the curve.
        out_of_plane = ~_in_plane(bounds)
    else:
        out_of_plane = np.zeros(len(bounds.half), dtype=bool)
    return _Obstacles(
        no_tolerance=(bounds.error == 0) | (bounds.radius == 0),
        out_of_plane=out_of_plane,
        turns_back=np.pi - 2 * bounds.half <= TANGENT_TOLERANCE,
    )


def _find_reasons(
    path: Path,
    corner: IntArray,
    bounds: CornerBounds,
    obstacles: _Obstacles,
    angle: float,
    rounded: BoolArray,
) -> ObjectArray:
    """Return the reason why each corner stays sharp; None if a curve replaces it, (n,).

    - `angle`: angular tolerance [rad].
    - `rounded`: mask of the corners that a curve replaces, (n,).
    """
    orientation = path.orientation
    # Later reasons replace earlier ones.
    reasons = np.full(len(corner), NO_ROOM, dtype=object)
    reasons[(angle == 0) & (bounds.turn == 0)] = NO_ANGLE
    reasons[obstacles.no_tolerance] = NO_TOLERANCE
    reasons[obstacles.out_of_plane] = OUT_OF_PLANE
    if orientation is not None and not orientation.follows:
        reasons[jumps_at(path, corner) > SAME_ORIENTATION] = ORIENTATION
    reasons[obstacles.turns_back] = TURN_BACK
    reasons[rounded] = None
    return reasons


def _blend_orientation(
    path: Path,
    table: Segments,
    source: IntArray,
    blended: _BlendedVertices,
    angle: float,
    *,
    smooth: bool,
) -> tuple[Orientation | None, FloatArray]:
    """Blend the orientation along a rounded path.

    Returns the orientation, and its deviation at each blended vertex [rad], (n + k,).

    - `table`: segments of the rounded path.
    - `source`: index of the `path` segment that contains each of them, or that is before its
      corner.
    - `angle`: angular tolerance [rad].
    - `smooth`: true if the derivative of the angular rate must not jump.
    """
    orientation = path.orientation
    none = np.zeros(len(blended.vertex))
    if orientation is None:
        return None, none
    if orientation.follows:
        cut = np.zeros(len(path))
        cut[blended.vertex + 1] = blended.tangent
        return follow_rounded(table, path, source, cut, angle, smooth=smooth), none
    return round_orientation(
        path, blended.vertex, blended.tangent, blended.length, table.breaks[-1], smooth=smooth
    )


def _in_plane(bounds: CornerBounds) -> BoolArray:
    """Return the mask of the corners whose two segments lie in one plane, (n,)."""
    before, after = bounds.before, bounds.after
    if before.dimension == 2 or not len(before):
        return np.ones(len(before), dtype=bool)
    sides = [
        np.cross(before.tangents, before.normals),
        np.cross(after.tangents, after.normals),
        np.cross(before.end_tangents, after.tangents),
    ]
    tilts = [np.linalg.norm(np.cross(a, b), axis=1) for a, b in combinations(sides, 2)]
    return np.asarray(np.max(tilts, axis=0) <= SAME_PLANE)


def check_angular_tolerance(path: Path, tolerance: float | None, kinked: IntArray) -> float:
    """Return the angular tolerance [rad]; infinite if it is neither specified nor required.

    - `tolerance`: the specified tolerance [rad].
    - `kinked`: index of the segment before each vertex at which only the angular rate jumps, (k,).
    """
    if tolerance is not None:
        return checks.not_negative("angular tolerance", tolerance, "rad")
    orientation = path.orientation
    if orientation is not None and (orientation.follows or len(kinked)):
        cause = (
            "follows the tangent"
            if orientation.follows
            else f"changes its angular rate after segment {int(kinked[0]) + 1}, where the path has "
            "no corner"
        )
        raise InvalidInput(
            f"The tool orientation {cause}, so rounding requires an angular tolerance. Specify "
            "round_corners(angular_tolerance=...) in rad in Python, or corners.angular_tolerance "
            "in a job. With an angular tolerance of 0 the tool stops there."
        )
    return np.inf
