"""Corner rounding: replaces corners by arcs within a corner error, (10)-(16), or by parabolas.

The *corner error* is the gap between the corner point and the arc, as in the paper's Fig. 3:
`gap = r (1 - cos h) / cos h` for radius r and half the turn h. Elsewhere two other lengths are
called tolerance: the arc's distance from the path, `r (1 - cos h) = gap cos h`, and the tangent
length, `r tan h`, which is the part of each line that the arc replaces. Beside an arc a corner is
replaced by two tangent arcs (blends.py); parabolas are in corner_curves.py. See
docs/concepts/rounding.md.
"""

from __future__ import annotations

import dataclasses
from collections import Counter
from dataclasses import dataclass
from functools import cache, lru_cache
from itertools import combinations
from typing import Literal, TypeAlias, get_args

import numpy as np
import numpy.typing as npt

from armcontour import _checks
from armcontour._checks import BoolArray, FloatArray, IntArray, Value
from armcontour._describing import brief, line_up, mm, several
from armcontour.errors import InvalidInput
from armcontour.geometry.blends import Blends, Bounds, make_blends, widest_blends
from armcontour.geometry.corner_curves import ARC, PARABOLA, SMOOTH, CornerCurve
from armcontour.geometry.orientation import SAME_ORIENTATION, Orientation
from armcontour.geometry.path import EVERY_VERTEX, Path
from armcontour.geometry.replacing import fit_lengths, replace_vertices
from armcontour.geometry.rounded_orientation import (
    NOWHERE,
    find_kinks,
    follow_rounded,
    largest_blend,
    largest_tangent,
    middle_of,
    round_orientation,
)
from armcontour.geometry.segments import REPEATED_POINT, TANGENT_TOLERANCE, Segments
from armcontour.geometry.shaped import ShapedPath

# What does not jump along a rounded path: its tangent, or its curvature, too.
Continuity: TypeAlias = Literal["tangent", "curvature"]
CONTINUITIES: tuple[Continuity, ...] = get_args(Continuity)
# A blend of continuous curvature is at least this long on either side: shorter ones have too few
# digits, and no motion passes them faster than a full stop [m].
SHORTEST_SMOOTH = 1e-6
# Planes that differ by less than this are one [rad].
SAME_PLANE = 1e-9
# A blend counts as one that uses its tolerance within this fraction, by which its search may miss.
FULL = 1e-6
# Why the tool stops at a corner.
TURN_BACK = "turn-back"
NO_TOLERANCE = "tolerance zero"
NO_ANGLE = "angular tolerance zero"
OUT_OF_PLANE = "tangent followed out of its plane"
NO_ROOM = "no room"
NOT_ROUNDED = "rounding off"
NOT_FASTER = "faster than a curve"
ORIENTATION = "tool orientation"
# What is wanted of corners, with units.
WISHES = {"corner error tolerance": "m", "corner speed": "m/s", "corner acceleration": "m/s²"}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Corners(Value):
    """The n corners of an objective path in path order, and the arcs that replace them.

    Args:
        vertex: Index of the corner among the vertices of the objective path, from 0, (n,).
        point: The corner points [m], (n, dimension).
        turn: Angle between the lines [rad], above 0 and at most pi, (n,).
        radius: Radius of the arc, beside an arc the smaller one of the two [m], 0 if the tool stops
            at the corner, (n,).
        error: Corner error: gap between corner point and arc [m], (n,).
        tangent: Tangent length [m], (n,).
        start, end: Arc lengths on the rounded path at which the arc starts and ends [m], (n,).
        shrunk: True if the arc is smaller than its case requires, because its lines are too short
            or its orientation turns too much, (n,).
        speed: Largest speed on the arc under the given acceleration, (16) [m/s], (n,); NaN if no
            acceleration was given.
        angular_error: Angle between the tool orientation in the middle of the arc and that at the
            corner point [rad], (n,); between the tool axes if only they are prescribed; 0 if the
            orientation follows the tangent or is missing.
        reason: Why the tool stops at the corner, such as "turn-back", "tolerance zero" or
            "no room"; None if it does not, (n,).
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
    reason: npt.NDArray[np.object_]

    def __post_init__(self) -> None:
        for name in self.__slots__:
            object.__setattr__(self, name, _checks.lock_copy(getattr(self, name)))

    def __len__(self) -> int:
        """Number of corners."""
        return len(self.vertex)

    @property
    def stopped(self) -> BoolArray:
        """True for corners that stay sharp, so that the tool has to stop, (n,)."""
        return np.asarray(self.radius == 0)


@dataclass(frozen=True, kw_only=True, eq=False)
class RoundedPath(Path):
    """A path with rounded corners, together with its objective path and its corners.

    Args:
        objective: The path before rounding.
        corners: The corners of the objective path, and their arcs.
    """

    objective: Path
    corners: Corners

    def __str__(self) -> str:
        """As of any path, and how the corners were rounded."""
        c = self.corners
        stops = int((c.radius == 0).sum())
        rounded = several(len(c) - stops, "corner")
        return line_up(
            self._title("Rounded path"),
            [
                ("rounded", f"{rounded}, {stops} with a stop" if stops else rounded),
                ("largest corner error", mm(float(c.error.max())) if len(c) else ""),
                *self._rows,
            ],
        )

    __repr__ = brief

    def place(self, s: npt.ArrayLike) -> FloatArray:
        """Arc lengths on this path that correspond to arc lengths on the objective path [m].

        Within a rounded corner the correspondence is linear.

        Args:
            s: Arc lengths of the objective path [m], any shape.
        """
        c = self.corners
        if self.segments is self.objective.segments:
            return np.clip(np.asarray(s, dtype=np.float64), 0.0, self.length)
        at = self.objective.breaks[c.vertex]
        before = np.concatenate([[0.0], np.stack([at - c.tangent, at + c.tangent], axis=1).ravel()])
        after = np.concatenate([[0.0], np.stack([c.start, c.end], axis=1).ravel()])
        ends = self.objective.length, self.length
        places = np.interp(
            np.asarray(s, dtype=np.float64), np.append(before, ends[0]), np.append(after, ends[1])
        )
        return np.asarray(places)


def round_corners(
    path: Path,
    *,
    tolerance: npt.ArrayLike | None = None,
    speed: npt.ArrayLike | None = None,
    acceleration: npt.ArrayLike | None = None,
    angular_tolerance: float | None = None,
    continuity: Continuity = "tangent",
) -> RoundedPath:
    """Replace every corner of a path by an arc, by the paper's case I or case II.

    Case II: `tolerance` bounds the corner error, and the radius is the largest that keeps it, (15).
    Case I: `speed` is the lowest speed allowed on the corner; under `acceleration` this gives the
    smallest radius (13) and the smallest corner error (14). With both, `tolerance` caps the corner
    error of case I.

    Each value holds for all corners, or there is one per vertex between segments (values of
    vertices without a corner are ignored). Tolerances of the path's own segments cap the corner
    error. Arcs that would overlap shrink until they fit their segments. Where no arc is possible
    (zero tolerance, a turn of 180°, segments without room) the corner stays sharp, and the tool
    stops there; `corners.reason` says why. A corner beside an arc becomes two tangent arcs.

    With continuity "curvature" the curvature does not jump either, so that a motion with a limit of
    jerk need not stop: a corner between two lines becomes a smooth bend, with the same corner error
    on more of both lines, whose radius in the middle is `corners.radius`. Beside an arc it becomes
    a connection; where the turn is too sharp for one, two tangent arcs, at whose ends it jumps.

    The tool orientation is rounded with the position. `angular_tolerance` bounds its deviation in
    the middle of a corner, and reduces arcs if necessary. It also rounds vertices at which only the
    angular rate jumps. An orientation that follows the tangent may leave it by that angle where
    lines and arcs meet.

    Args:
        path: The objective path.
        tolerance: Largest corner error [m], a number or (vertices,).
        speed: Lowest corner speed [m/s], a number or (vertices,).
        acceleration: Centripetal acceleration at that speed [m/s²], a number or (vertices,); with
            `tolerance` alone it is only used to report the corner speed (16).
        angular_tolerance: Largest angle between the orientation and its value at the vertex [rad].
        continuity: "tangent", or "curvature" for corners that can be run without stopping under a
            limit of jerk.

    Raises:
        InvalidInput: Neither case is given, a value is negative, the number of values is wrong, the
            continuity is neither of them, or the orientation needs an angular tolerance.
    """
    _checks.choice("continuity", continuity, CONTINUITIES)
    if tolerance is None and (speed is None or acceleration is None):
        raise InvalidInput(
            "Corners need a tolerance (case II), or a speed and an acceleration (case I): in "
            "Python arguments of round_corners, in a job keys of corners."
        )
    curve = SMOOTH if continuity == "curvature" else ARC
    return _round_all(path, (tolerance, speed, acceleration), angular_tolerance, curve)


def round_with_parabolas(
    path: Path, *, tolerance: npt.ArrayLike, angular_tolerance: float | None = None
) -> RoundedPath:
    """Replace every corner between two lines by a parabola, drawn as tangent arcs.

    This is a shape for a tool whose acceleration is limited, and that is slower in the middle of a
    corner: a parabola is longer than the arc with the same corner error, and bends less at its
    ends. Stops, room and tolerances are those of `round_corners`, and so are corners beside arcs
    and the tool orientation. In `corners`, `radius` is the smallest one, in the middle. A corner
    at which it would be less than a nanometre stays sharp: "no room".

    Args:
        path: The objective path.
        tolerance: Largest corner error [m], a number or (vertices,); every point of a parabola is
            within it of one of both lines.
        angular_tolerance: As in `round_corners` [rad].

    Raises:
        InvalidInput: A tolerance is negative, the number of values is wrong, or the orientation
            needs an angular tolerance.
    """
    return _round_all(path, (tolerance, None, None), angular_tolerance, PARABOLA)


def count_full_stops(path: Path) -> dict[str, int]:
    """How many full stops a path has inside, by their reasons.

    The reasons are those of `Corners.reason`, "rounding off" for corners that were not rounded,
    "faster than a curve" for those of a shaped path, and "tool orientation" where only the
    orientation or its rate jumps.

    Args:
        path: The path, rounded, shaped, or neither.
    """
    if isinstance(path, RoundedPath):
        reasons = [x for x in path.corners.reason.tolist() if x is not None]
    else:
        sharp = path.turns > TANGENT_TOLERANCE
        back = np.pi - path.turns <= TANGENT_TOLERANCE
        why = np.full(len(sharp), NOT_ROUNDED, dtype=object)
        if isinstance(path, ShapedPath):
            why[:] = NOT_FASTER
            why[_allowed_at_vertices(path) == 0] = NO_TOLERANCE
        reasons = np.where(back, TURN_BACK, why)[sharp].tolist()
    reasons += [ORIENTATION] * (len(path.stops) - len(reasons))
    return dict(sorted(Counter(reasons).items()))


def _allowed_at_vertices(path: ShapedPath) -> FloatArray:
    """Tolerance at the objective's vertex nearest to each vertex of a shaped path [m], (n,)."""
    objective = path.objective
    s = np.interp(path.breaks[1:-1], path.places[:, 1], path.places[:, 0])
    middles = (objective.breaks[1:] + objective.breaks[:-1]) / 2
    vertex = np.searchsorted(middles, s).clip(1, max(len(objective) - 1, 1))
    own = np.append(objective.tolerances, np.nan)
    return np.asarray(np.fmin(np.fmin(own[vertex - 1], own[vertex]), path.tolerance))


def blend_vertices(
    path: Path, vertex: IntArray, turn: FloatArray, tolerance: FloatArray
) -> RoundedPath:
    """The path with some of its vertices blended and all others kept.

    A blend takes at most half of either segment.

    Args:
        path: The path, without tool orientation.
        vertex: Segments after which the vertices are, increasing, (n,).
        turn: The path's turns there [rad], (n,).
        tolerance: Largest distance of each vertex from the new path [m], (n,).
    """
    half = turn / 2
    radius = ARC.largest_radius(tolerance, half)
    wishes = _Wishes(
        corner=vertex,
        half=half,
        error=tolerance,
        enough=np.full(len(vertex), np.inf),
        radius=radius,
        acceleration=np.full(len(vertex), np.nan),
        most=np.minimum(path.lengths[vertex], path.lengths[vertex + 1]) / 2,
        curve=ARC,
        long=ARC.length(half),
    )
    return _round(path, wishes, NOWHERE, np.inf)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Wishes:
    """What is wanted of n corners.

    Args:
        corner: Segments after which there is a corner, (n,).
        half: Half of the turn at each corner [rad], (n,).
        error: Largest corner error [m], (n,).
        enough: Radius that is large enough for the corner speed [m], infinite without one, (n,).
        radius: Smallest radius of the curve between two lines by case I or case II [m], (n,).
        acceleration: Centripetal acceleration of the corner speed [m/s²], (n,).
        most: Largest tangent lengths [m], (n,).
        curve: The curve that replaces corners between two lines.
        long: Length of that curve over its smallest radius, (n,).
    """

    corner: IntArray
    half: FloatArray
    error: FloatArray
    enough: FloatArray
    radius: FloatArray
    acceleration: FloatArray
    most: FloatArray
    curve: CornerCurve
    long: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Found:
    """How n corners are rounded.

    Args:
        tangent: Tangent lengths [m], 0 for a sharp corner, (n,).
        radius: Smallest radius of what replaces each corner [m], 0 for a sharp corner, (n,).
        length: Length of what replaces each corner [m], (n,).
        error: Corner error [m], (n,).
        shrunk: Mask of corners that are rounded less than their case requires, (n,).
        bent: Mask of corners beside an arc, (n,).
        blends: Blends of the rounded ones among them.
    """

    tangent: FloatArray
    radius: FloatArray
    length: FloatArray
    error: FloatArray
    shrunk: BoolArray
    bent: BoolArray
    blends: Blends


def _round_all(
    path: Path,
    given: tuple[npt.ArrayLike | None, npt.ArrayLike | None, npt.ArrayLike | None],
    angular_tolerance: float | None,
    curve: CornerCurve,
) -> RoundedPath:
    """The path with all corners replaced; tolerance, speed and acceleration are given."""
    if len(path) == 1 and (path.orientation is None or path.orientation.fixed):
        # Programs have thousands of circles; values are checked for them, too.
        needed_angle(path, angular_tolerance, NOWHERE)
        plain = [x for x in given if x is None or type(x) is float]
        if len(plain) == len(given):
            _check_numbers(*plain)
        else:
            _wishes(path, NOWHERE, np.empty(0), given, curve)
        return _without_corners(path)
    turn = path.turns
    corner = np.flatnonzero(turn > TANGENT_TOLERANCE)
    kinked = find_kinks(path)
    if len(kinked):
        kinked = np.setdiff1d(kinked, corner)
    angle = needed_angle(path, angular_tolerance, kinked)
    wishes = _wishes(path, corner, turn[corner] / 2, given, curve)
    return _round(path, wishes, kinked, angle)


@lru_cache(maxsize=32)
def _check_numbers(*given: float | None) -> None:
    """Check tolerance, speed and acceleration, one number each, as `_wishes` does.

    Raises:
        InvalidInput: A value is negative or not a number.
    """
    for (name, unit), value in zip(WISHES.items(), given, strict=True):
        _checks.per_vertex(name, value, 0, unit)


def _without_corners(path: Path) -> RoundedPath:
    """A path of one segment as a rounded path."""
    return RoundedPath(
        segments=path.segments,
        orientation=path.orientation,
        merged=path.merged,
        waypoints=path.waypoints,
        objective=path,
        corners=_no_corners(path.dimension),
    )


@cache
def _no_corners(dimension: int) -> Corners:
    """The corners of a path in the plane or in space that has none."""
    numbers = np.empty(0)
    return Corners(
        vertex=NOWHERE,
        point=np.empty((0, dimension)),
        turn=numbers,
        radius=numbers,
        error=numbers,
        tangent=numbers,
        start=numbers,
        end=numbers,
        shrunk=NOWHERE > 0,
        speed=numbers,
        angular_error=numbers,
        reason=np.empty(0, dtype=object),
    )


def _round(path: Path, wishes: _Wishes, kinked: IntArray, angle: float) -> RoundedPath:
    """The rounded path, by what is wanted of its corners.

    Args:
        path: The objective path.
        wishes: What is wanted of its corners.
        kinked: Segments after which only the angular rate jumps, (k,).
        angle: Angular tolerance [rad].
    """
    tangents, wanted, smooth = _tangent_lengths(path, wishes, kinked, angle)
    found = _rounded_corners(path, wishes, tangents[: len(wishes.corner)], wanted, smooth)
    table, source, ends = _replace_corners(path, wishes, found)
    which = np.concatenate([wishes.corner, kinked])
    lengths = np.append(found.length, 2 * tangents[len(wishes.corner) :])
    tangents = np.append(found.tangent, tangents[len(wishes.corner) :])
    even = wishes.curve.smooth
    orientation, off = _rounded_orientation(
        path, table, source, which, tangents, lengths, angle, smooth=even
    )
    corner = wishes.corner
    return RoundedPath(
        segments=table,
        merged=path.merged,
        # The arc does not pass the waypoint of its corner, so that all vertices become waypoints.
        waypoints=EVERY_VERTEX if (found.radius > 0).any() else path.waypoints,
        orientation=orientation,
        objective=path,
        corners=Corners(
            vertex=corner + 1,
            point=path.starts[corner + 1],
            turn=2 * wishes.half,
            radius=found.radius,
            error=found.error,
            tangent=found.tangent,
            start=ends - found.length,
            end=ends,
            shrunk=found.shrunk,
            speed=np.sqrt(wishes.acceleration * found.radius),
            angular_error=off[: len(corner)],
            reason=_stop_reasons(path, wishes, found, angle),
        ),
    )


def _rounded_corners(
    path: Path, wishes: _Wishes, tangent: FloatArray, wanted: FloatArray, smooth: BoolArray
) -> _Found:
    """How corners are rounded with given tangent lengths [m], where others were wanted, (n,).

    Args:
        path: The objective path.
        wishes: What is wanted of its corners.
        tangent: The tangent lengths [m], (n,).
        wanted: Those that were wanted [m], (n,).
        smooth: Mask of the corners beside arcs whose blends have continuous curvature, (n,).
    """
    corner, half = wishes.corner, wishes.half
    bent = _beside_arcs(path, corner)
    stretch = wishes.curve.stretch(half)
    shrunk = (tangent < wishes.radius * stretch * (1 - 1e-12)) & (wanted > 0)
    radius = np.where(tangent > 0, np.where(shrunk, tangent / stretch, wishes.radius), 0.0)
    length, error = radius * wishes.long, wishes.curve.error(radius, half)
    drawn = np.flatnonzero(bent & (tangent > 0))
    before = after = path.segments[:0]
    if len(drawn):
        before, after = path.segments[corner[drawn]], path.segments[corner[drawn] + 1]
    blends = make_blends(before, after, tangent[drawn], smooth[drawn])
    if len(drawn):
        radius[drawn], length[drawn], error[drawn] = blends.radius, blends.lengths, blends.error
        full = blends.error >= wishes.error[drawn] * (1 - FULL)
        shrunk[drawn] = ~(full | (blends.bend <= (1 + FULL) / wishes.enough[drawn]))
    return _Found(
        tangent=tangent,
        radius=radius,
        length=length,
        error=error,
        shrunk=shrunk,
        bent=bent,
        blends=blends,
    )


def _beside_arcs(path: Path, corner: IntArray) -> BoolArray:
    """Mask of the corners of which a side is an arc, (n,)."""
    return np.asarray((path.curvatures[corner] > 0) | (path.curvatures[corner + 1] > 0))


def _stop_reasons(
    path: Path, wishes: _Wishes, found: _Found, angle: float
) -> npt.NDArray[np.object_]:
    """Why the tool stops at each corner; None where it does not, (n,)."""
    reasons = np.full(len(wishes.corner), NO_ROOM, dtype=object)
    if angle == 0:
        reasons[_largest_tangent(path, wishes, angle) == 0] = NO_ANGLE
    reasons[(wishes.error == 0) | (wishes.enough == 0)] = NO_TOLERANCE
    if path.orientation is not None and path.orientation.follows:
        reasons[~_in_plane(path, wishes.corner)] = OUT_OF_PLANE
    elif path.orientation is not None:
        reasons[path.orientation.jumps[wishes.corner] > SAME_ORIENTATION] = ORIENTATION
    reasons[np.pi - 2 * wishes.half <= TANGENT_TOLERANCE] = TURN_BACK
    reasons[found.radius > 0] = None
    return reasons


def _in_plane(path: Path, corner: IntArray) -> BoolArray:
    """Mask of the corners whose two segments lie in one plane, (n,)."""
    if path.dimension == 2 or not len(corner):
        return np.ones(len(corner), dtype=bool)
    before, after = path.segments[corner], path.segments[corner + 1]
    sides = [
        np.cross(before.tangents, before.normals),
        np.cross(after.tangents, after.normals),
        np.cross(before.end_tangents, after.tangents),
    ]
    off = [np.linalg.norm(np.cross(a, b), axis=1) for a, b in combinations(sides, 2)]
    return np.asarray(np.max(off, axis=0) <= SAME_PLANE)


def _tangent_lengths(
    path: Path, wishes: _Wishes, kinked: IntArray, angle: float
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Tangent lengths that keep the tolerances and fit the segments.

    Args:
        path: The objective path.
        wishes: What is wanted of its corners, n of them.
        kinked: Segments after which only the angular rate jumps, (k,).
        angle: Angular tolerance [rad].

    Returns:
        Tangent lengths of corners, then of kinks [m], (n + k,); 0 for sharp corners. Those that
        the corners would take if their segments were long enough [m], (n,). And the mask of the
        corners beside arcs whose blends have continuous curvature, (n,).
    """
    corner, half = wishes.corner, wishes.half
    bent = _beside_arcs(path, corner)
    allowed = _largest_tangent(path, wishes, angle)
    wanted = np.minimum(wishes.radius * wishes.curve.stretch(half), allowed)
    smooth = np.zeros(len(corner), dtype=bool)
    if bent.any():
        wanted[bent], smooth[bent] = _wanted_blends(path, wishes, bent, angle)
    wanted = np.minimum(wanted, wishes.most)
    # Arcs smaller than the resolution of a point are dropped; at a turn of 180° no radius is left.
    shortest = np.where(bent, REPEATED_POINT, wishes.curve.shortest(half))
    wanted[wanted <= shortest] = 0.0
    wanted[np.pi - 2 * half <= TANGENT_TOLERANCE] = 0.0
    # Blends of the orientation alone share the segments with the corners' arcs.
    which = np.concatenate([corner, kinked])
    even = wishes.curve.smooth
    blends = largest_tangent(path, kinked, np.full(len(kinked), 2.0), angle, smooth=even)
    order = np.argsort(which)
    tangents = np.empty(len(which))
    tangents[order] = fit_lengths(
        np.concatenate([wanted, blends])[order], which[order], path.lengths
    )
    # A very short segment between two corners can leave an arc below that resolution, too.
    tangent = tangents[: len(corner)]
    tangent[tangent <= shortest / 4] = 0.0
    return tangents, wanted, smooth


def _largest_tangent(path: Path, wishes: _Wishes, angle: float) -> FloatArray:
    """Largest tangent lengths of corners between two lines that keep the angular tolerance [m]."""
    ratio = wishes.long / wishes.curve.stretch(wishes.half)
    return largest_tangent(path, wishes.corner, ratio, angle, smooth=wishes.curve.smooth)


def _wanted_blends(
    path: Path, wishes: _Wishes, bent: BoolArray, angle: float
) -> tuple[FloatArray, BoolArray]:
    """Tangent lengths of corners beside arcs [m], if nothing else used their segments.

    Where the curvature must not jump, but no such blend is possible, a pair of arcs is taken.

    Args:
        path: The objective path.
        wishes: What is wanted of its corners.
        bent: Mask of the corners beside arcs.
        angle: Angular tolerance [rad].

    Returns:
        The tangent lengths, and the mask of the blends with continuous curvature.
    """
    corner = wishes.corner[bent]
    bounds = Bounds(
        error=wishes.error[bent],
        radius=wishes.enough[bent],
        turn=largest_blend(path, corner, angle),
        tangent=wishes.most[bent],
        middle=middle_of(wishes.curve.smooth),
        smooth=wishes.curve.smooth,
    )
    free = (bounds.error > 0) & (bounds.radius > 0)
    if path.orientation is not None and path.orientation.follows:
        # A frame that follows the tangent out of the plane would come round turned about it.
        free &= _in_plane(path, corner)
    sides = path.segments[corner], path.segments[corner + 1]
    found = np.where(free, widest_blends(*sides, bounds), 0.0)
    smooth = bounds.smooth & (found > SHORTEST_SMOOTH)
    rest = np.flatnonzero(free & ~smooth)
    if bounds.smooth and len(rest):
        plain = dataclasses.replace(bounds, smooth=False)[rest]
        found[rest] = widest_blends(sides[0][rest], sides[1][rest], plain)
    return found, smooth


def _wishes(
    path: Path,
    corner: IntArray,
    half: FloatArray,
    given: tuple[npt.ArrayLike | None, npt.ArrayLike | None, npt.ArrayLike | None],
    curve: CornerCurve,
) -> _Wishes:
    """What is wanted of the corners, by case I or case II.

    Args:
        path: The objective path.
        corner: Segments after which there is a corner, (n,).
        half: Half of the turn at each corner [rad], (n,).
        given: Tolerance, speed and acceleration as in `round_corners`.
        curve: The curve that replaces corners between two lines.

    Raises:
        InvalidInput: A value is negative or not a number, or their number is wrong.
    """
    tolerance, speed, acceleration = given
    vertices = len(path) - 1
    allowed = _checks.per_vertex("corner error tolerance", tolerance, vertices, "m")
    slowest = _checks.per_vertex("corner speed", speed, vertices, "m/s")
    accelerations = np.full(vertices, np.nan)
    if acceleration is not None:
        accelerations = _checks.per_vertex("corner acceleration", acceleration, vertices, "m/s²")
        if vertices:
            _checks.positive("corner acceleration", accelerations.min(), "m/s²")
    own = np.where(np.isnan(path.tolerances), np.inf, path.tolerances)
    allowed = np.minimum(allowed, np.minimum(own[:-1], own[1:]))[corner]
    enough = np.full(len(corner), np.inf)
    if speed is not None:
        enough = slowest[corner] ** 2 / accelerations[corner]
    return _Wishes(
        corner=corner,
        half=half,
        error=allowed,
        enough=enough,
        radius=np.minimum(curve.largest_radius(allowed, half), enough),
        acceleration=accelerations[corner],
        most=np.full(len(corner), np.inf),
        curve=curve,
        long=curve.length(half),
    )


def _rounded_orientation(
    path: Path,
    table: Segments,
    source: IntArray,
    which: IntArray,
    tangent: FloatArray,
    length: FloatArray,
    angle: float,
    *,
    smooth: bool,
) -> tuple[Orientation | None, FloatArray]:
    """The rounded orientation, and its angular errors in the middles of what is replaced [rad].

    Args:
        path: The objective path.
        table: The segments of the rounded path.
        source: Index of the objective segment of each of them, from `_replace_corners`.
        which: Segments after which there is a corner, then those after which there is a kink, (k,).
        tangent: Tangent length of each of these vertices [m], (k,).
        length: Length of what replaces them [m], (k,).
        angle: Angular tolerance [rad].
        smooth: Whether the derivative of the angular rate must not jump.
    """
    if path.orientation is None:
        return None, np.zeros(len(which))
    if path.orientation.follows:
        cut = np.zeros(len(path))
        cut[which + 1] = tangent
        found = follow_rounded(table, path, source, cut, angle, smooth=smooth)
        return found, np.zeros(len(which))
    whole = table.breaks[-1]
    return round_orientation(path, which, tangent, length, whole, smooth=smooth)


def needed_angle(path: Path, given: float | None, kinked: IntArray) -> float:
    """The angular tolerance [rad], infinite if none is given and none is needed.

    Args:
        path: The objective path.
        given: The given tolerance [rad].
        kinked: Segments after which only the angular rate jumps, (k,).

    Raises:
        InvalidInput: The tolerance is negative, or missing though the orientation needs one.
    """
    if given is not None:
        return _checks.not_negative("angular tolerance", given, "rad")
    orientation = path.orientation
    if orientation is not None and (orientation.follows or len(kinked)):
        why = (
            "follows the tangent"
            if orientation.follows
            else f"turns at another rate after segment {int(kinked[0]) + 1}, where the path goes "
            "straight on"
        )
        raise InvalidInput(
            f"The tool's orientation {why}: give an angular tolerance by which it may be off (in "
            "Python round_corners(angular_tolerance=...) in rad, in a job "
            "corners.angular_tolerance; 0 stops there)."
        )
    return np.inf


def _replace_corners(
    path: Path, wishes: _Wishes, found: _Found
) -> tuple[Segments, IntArray, FloatArray]:
    """Segments of the rounded path.

    Args:
        path: The objective path.
        wishes: What was wanted of its corners, n of them.
        found: How they are rounded.

    Returns:
        The segments; for each, the index of its objective segment, or of the one before its
        corner; and the arc lengths at which the corners' arcs end [m], (n,).
    """
    corner, n = wishes.corner, len(path)
    cut = np.zeros(n + 1)
    cut[corner + 1] = found.tangent
    plain = (found.radius > 0) & ~found.bent
    blended = corner[(found.tangent > 0) & found.bent]
    before = corner[plain]
    curves, row = wishes.curve.draw(
        path.segments[before], path.segments[before + 1], found.radius[plain], wishes.half[plain]
    )
    drawn = Segments.join([curves, found.blends.rows] if len(blended) else [curves])
    after = np.concatenate([before[row], blended[found.blends.of]])
    table, source, _ = replace_vertices(path.segments, cut, drawn, after)
    table = table.check()
    ends = np.append(0.0, np.cumsum(table.lengths))[np.searchsorted(source, corner, side="right")]
    return table, source, ends
