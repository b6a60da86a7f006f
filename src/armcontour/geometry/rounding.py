"""Corner rounding: replaces corners by arcs within a corner error, (10)-(16), or by parabolas.

The *corner error* is the gap between the corner point and the arc, as in the paper's Fig. 3:
`gap = r (1 - cos h) / cos h` for radius r and half the turn h. Elsewhere two other lengths are
called tolerance: the arc's distance from the path, `r (1 - cos h) = gap cos h`, and the tangent
length, `r tan h`, which is the part of each line that the arc replaces. Beside an arc a corner is
replaced by two tangent arcs (blends.py); parabolas are in corner_curves.py. See
docs/concepts/rounding.md.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, fields
from itertools import combinations
from typing import Literal, TypeAlias, get_args

import numpy as np
import numpy.typing as npt

from armcontour.core import checks
from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.core.describing import count_noun, format_table, short_repr
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import Checked, checked
from armcontour.core.render import number
from armcontour.geometry.corner_curves import (
    ARC,
    PARABOLA,
    SMOOTH,
    Bounds,
    CornerKind,
    LineCorner,
)
from armcontour.geometry.orientation import SAME_ORIENTATION
from armcontour.geometry.path import EVERY_VERTEX, Path
from armcontour.geometry.replacing import fit_lengths, replace_vertices
from armcontour.geometry.rounded_orientation import (
    NOWHERE,
    find_kinks,
    follow_rounded,
    largest_blend,
    middle_of,
    round_orientation,
)
from armcontour.geometry.segments import TANGENT_TOLERANCE, Segments
from armcontour.geometry.shaped import ShapedPath

# What does not jump along a rounded path: its tangent, or its curvature, too.
Continuity: TypeAlias = Literal["tangent", "curvature"]
CONTINUITIES: tuple[Continuity, ...] = get_args(Continuity)
# A blend of continuous curvature is at least this long on either side: shorter ones have too few
# digits, and no motion passes them faster than a full stop [m].
SHORTEST_SMOOTH = 1e-6
# Planes that differ by less than this are one [rad].
SAME_PLANE = 1e-9
# Why the tool stops at a corner.
TURN_BACK = "turn-back"
NO_TOLERANCE = "tolerance zero"
NO_ANGLE = "angular tolerance zero"
OUT_OF_PLANE = "tangent followed out of its plane"
NO_ROOM = "no room"
NOT_ROUNDED = "rounding off"
NOT_FASTER = "faster than a curve"
ORIENTATION = "tool orientation"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Corners(Checked):
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

    @property
    def deviation(self) -> float:
        """Largest corner error [m]; 0 without corners."""
        return float(self.corners.error.max(initial=0.0))

    def __str__(self) -> str:
        """As of any path, and how the corners were rounded."""
        c = self.corners
        stops = int((c.radius == 0).sum())
        rounded = count_noun(len(c) - stops, "corner")
        return format_table(
            self._title("Rounded path"),
            [
                ("rounded", f"{rounded}, {stops} with a stop" if stops else rounded),
                ("largest corner error", number(c.error.max(), "m") if len(c) else ""),
                *self._rows,
            ],
        )

    __repr__ = short_repr

    def place(self, s: npt.ArrayLike) -> FloatArray:
        """Arc lengths on this path that correspond to arc lengths on the objective path [m].

        Within a rounded corner the correspondence is linear.

        Args:
            s: Arc lengths of the objective path [m], any shape.
        """
        s, c = checks.floats("arc lengths", s, "m"), self.corners
        if self.segments is self.objective.segments:
            return np.clip(s, 0.0, self.length)
        at = self.objective.breaks[c.vertex]
        before = np.concatenate([[0.0], np.stack([at - c.tangent, at + c.tangent], axis=1).ravel()])
        after = np.concatenate([[0.0], np.stack([c.start, c.end], axis=1).ravel()])
        ends = self.objective.length, self.length
        places = np.interp(s, np.append(before, ends[0]), np.append(after, ends[1]))
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
    checks.check_choice("continuity", continuity, CONTINUITIES)
    if tolerance is None and (speed is None or acceleration is None):
        raise InvalidInput(
            "Corners need a tolerance (case II), or a speed and an acceleration (case I): in "
            "Python arguments of round_corners, in a job keys of corners."
        )
    curve = SMOOTH if continuity == "curvature" else ARC
    return _round_all(path, (tolerance, speed, acceleration), angular_tolerance, curve)


@checked
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
            # Tolerances at the objective's vertices nearest to those of the path.
            objective = path.objective
            s = np.interp(path.breaks[1:-1], path.places[:, 1], path.places[:, 0])
            middles = (objective.breaks[1:] + objective.breaks[:-1]) / 2
            vertex = np.searchsorted(middles, s).clip(1, max(len(objective) - 1, 1))
            own = np.append(objective.tolerances, np.nan)
            allowed = np.fmin(np.fmin(own[vertex - 1], own[vertex]), path.tolerance)
            why[:] = np.where(allowed == 0, NO_TOLERANCE, NOT_FASTER)
        reasons = np.where(back, TURN_BACK, why)[sharp].tolist()
    reasons += [ORIENTATION] * (len(path.stops) - len(reasons))
    return dict(sorted(Counter(reasons).items()))


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
    none = np.full(len(vertex), np.inf)
    most = np.minimum(path.lengths[vertex], path.lengths[vertex + 1]) / 2
    return _round(path, vertex, turn, (tolerance, none, most, np.nan * none), ARC, NOWHERE, np.inf)


def _round_all(
    path: Path,
    given: tuple[npt.ArrayLike | None, npt.ArrayLike | None, npt.ArrayLike | None],
    angular_tolerance: float | None,
    curve: LineCorner,
) -> RoundedPath:
    """The path with all corners replaced; tolerance, speed and acceleration are given."""
    tolerance, speed, acceleration = given
    n = len(path) - 1
    error = checks.per_vertex("corner error tolerance", tolerance, n, "m")
    slowest = checks.per_vertex("corner speed", speed, n, "m/s")
    accelerations = np.full(n, np.nan)
    if acceleration is not None:
        accelerations = checks.per_vertex("corner acceleration", acceleration, n, "m/s²")
        if n:
            checks.positive("corner acceleration", accelerations.min(), "m/s²")
    turn = path.turns
    corner, kinked = np.flatnonzero(turn > TANGENT_TOLERANCE), find_kinks(path)
    if len(kinked):
        kinked = np.setdiff1d(kinked, corner)
    angle = needed_angle(path, angular_tolerance, kinked)
    if n == 0 and (path.orientation is None or path.orientation.fixed):
        # Programs have thousands of circles.
        return _without_corners(path)
    own = np.where(np.isnan(path.tolerances), np.inf, path.tolerances)
    error = np.minimum(error, np.minimum(own[:-1], own[1:]))[corner]
    none = np.full(len(corner), np.inf)
    enough = none if speed is None else slowest[corner] ** 2 / accelerations[corner]
    wanted = error, enough, none, accelerations[corner]
    return _round(path, corner, turn[corner], wanted, curve, kinked, angle)


def _without_corners(path: Path) -> RoundedPath:
    """A path of one segment as a rounded path."""
    none = np.empty(0)
    numbers = ("turn", "radius", "error", "tangent", "start", "end", "speed", "angular_error")
    corners = Corners(
        vertex=NOWHERE,
        point=np.empty((0, path.dimension)),
        shrunk=NOWHERE > 0,
        reason=none.astype(object),
        **dict.fromkeys(numbers, none),
    )
    kept = {x.name: getattr(path, x.name) for x in fields(Path) if x.init}
    return RoundedPath(**kept, objective=path, corners=corners)


def _round(
    path: Path,
    corner: IntArray,
    turn: FloatArray,
    wanted: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
    curve: LineCorner,
    kinked: IntArray,
    angle: float,
) -> RoundedPath:
    """The rounded path.

    Args:
        path: The objective path.
        corner: Segments after which there is a corner, (n,).
        turn: The path's turns there [rad], (n,).
        wanted: Largest corner errors [m], radii that are large enough for the corner speeds [m],
            largest tangent lengths [m], and centripetal accelerations of the corner speeds [m/s²],
            (n,) each.
        curve: The curve that replaces corners between two lines.
        kinked: Segments after which only the angular rate jumps, (k,).
        angle: Angular tolerance [rad].
    """
    n, rows = len(corner), path.segments
    *limits, acceleration = wanted
    bounds = Bounds(
        before=rows[corner],
        after=rows[corner + 1],
        half=turn / 2,
        **dict(zip(("error", "radius", "tangent"), limits, strict=True)),
        turn=largest_blend(path, corner, angle),
    )
    follows = path.orientation is not None and path.orientation.follows
    turns_back = np.pi - 2 * bounds.half <= TANGENT_TOLERANCE
    # A frame that follows the tangent out of the plane would come round turned about it.
    flat = _in_plane(bounds) if follows else np.ones(n, dtype=bool)
    free = (bounds.error > 0) & (bounds.radius > 0) & flat & ~turns_back
    bent = (bounds.before.curvatures > 0) | (bounds.after.curvatures > 0)
    # A connection that is too short or not possible leaves the corner to a pair of arcs.
    kinds: list[tuple[CornerKind, float]] = [(curve, 0.0)]
    if (free & bent).any():
        from armcontour.geometry.blends import CONNECTION, PAIR

        kinds += [(CONNECTION, SHORTEST_SMOOTH)] if curve.smooth else []
        kinds.append((PAIR, 0.0))
    fitted, least, parts = np.zeros(n), np.zeros(n), []
    for kind, shortest in kinds:
        part = np.flatnonzero(free & (bent != isinstance(kind, LineCorner)))
        if len(part):
            found, small = kind.fit(bounds[part]), kind.shortest(bounds.half[part])
            fits = found > np.maximum(small, shortest)
            part = part[fits]
            fitted[part], least[part], free[part] = found[fits], small[fits], False
        parts.append(part)
    # Blends of the orientation alone share the segments with the corners' curves.
    which = np.concatenate([corner, kinked])
    middle = middle_of(curve.smooth)
    order, tangents = np.argsort(which), np.empty(len(which))
    kinks = largest_blend(path, kinked, angle) / (0.5 - 2 * middle)
    tangents[order] = fit_lengths(
        np.concatenate([fitted, kinks])[order], which[order], rows.lengths
    )
    # On a very short segment between two corners the curves may be too small.
    tangent = tangents[:n]
    tangent[tangent <= least / 4] = 0.0
    radius, error, length, shrunk = np.zeros(n), np.zeros(n), np.zeros(n), fitted > 0
    tables, after = [rows[:0]], [NOWHERE]
    for (kind, _), part in zip(kinds, parts, strict=True):
        part = part[tangent[part] > 0]
        if len(part):
            drawn = kind.draw(bounds[part], tangent[part])
            radius[part], error[part], shrunk[part] = drawn.radius, drawn.error, drawn.shrunk
            length[part] = np.bincount(drawn.of, drawn.rows.lengths, minlength=len(part))
            tables, after = [*tables, drawn.rows], [*after, corner[part[drawn.of]]]
    cut = np.zeros(len(path) + 1)
    cut[which + 1] = np.append(tangent, np.zeros(len(kinked)))
    table, source, _ = replace_vertices(rows, cut, Segments.join(tables), np.concatenate(after))
    table = table.check()
    ends = np.append(0.0, table.breaks[1:])[np.searchsorted(source, corner, side="right")]
    lengths = np.append(length, 2 * tangents[n:])
    orientation, off = path.orientation, np.zeros(len(which))
    if follows:
        cut[which + 1] = tangents
        orientation = follow_rounded(table, path, source, cut[:-1], angle, smooth=curve.smooth)
    elif orientation is not None:
        whole = table.breaks[-1]
        orientation, off = round_orientation(
            path, which, tangents, lengths, whole, smooth=curve.smooth
        )
    reasons = np.full(n, NO_ROOM, dtype=object)
    reasons[(angle == 0) & (bounds.turn == 0)] = NO_ANGLE
    reasons[(bounds.error == 0) | (bounds.radius == 0)] = NO_TOLERANCE
    reasons[~flat] = OUT_OF_PLANE
    if path.orientation is not None and not follows:
        reasons[path.orientation.jumps[corner] > SAME_ORIENTATION] = ORIENTATION
    reasons[turns_back] = TURN_BACK
    reasons[radius > 0] = None
    return RoundedPath(
        segments=table,
        merged=path.merged,
        # The arc does not pass the waypoint of its corner, so that all vertices become waypoints.
        waypoints=EVERY_VERTEX if (radius > 0).any() else path.waypoints,
        orientation=orientation,
        objective=path,
        corners=Corners(
            vertex=corner + 1,
            point=path.starts[corner + 1],
            turn=2 * bounds.half,
            radius=radius,
            error=error,
            tangent=tangent,
            start=ends - length,
            end=ends,
            shrunk=shrunk,
            speed=np.sqrt(acceleration * radius),
            angular_error=off[:n],
            reason=reasons,
        ),
    )


def _in_plane(bounds: Bounds) -> BoolArray:
    """Mask of the corners whose two segments lie in one plane, (n,)."""
    before, after = bounds.before, bounds.after
    if before.dimension == 2 or not len(before):
        return np.ones(len(before), dtype=bool)
    sides = [
        np.cross(before.tangents, before.normals),
        np.cross(after.tangents, after.normals),
        np.cross(before.end_tangents, after.tangents),
    ]
    off = [np.linalg.norm(np.cross(a, b), axis=1) for a, b in combinations(sides, 2)]
    return np.asarray(np.max(off, axis=0) <= SAME_PLANE)


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
        return checks.not_negative("angular tolerance", given, "rad")
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
