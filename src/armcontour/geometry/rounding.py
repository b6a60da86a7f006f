"""Corner rounding: every corner of a path becomes an arc that keeps a corner error, (10)-(16).

The *corner error* is the gap between the corner point and the arc, as in the paper's Fig. 3. Two
other lengths are called tolerance elsewhere; with half the turn h, `gap = r (1 - cos h) / cos h`,
the arc's distance from the path is `r (1 - cos h) = gap cos h`, and the tangent length (the part of
each line that the arc replaces) is `r tan h`. See docs/concepts/rounding.md.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from armcontour import _checks
from armcontour._checks import BoolArray, FloatArray, IntArray
from armcontour.errors import InvalidInput
from armcontour.geometry.path import EVERY_VERTEX, Path
from armcontour.geometry.rounded_orientation import (
    find_kinks,
    follow_rounded,
    largest_tangent,
    round_orientation,
)
from armcontour.geometry.segments import REPEATED_POINT, TANGENT_TOLERANCE, Segments

# A rest of a line between two arcs that is shorter than this is left out [m]: it is rounding.
SLIVER = 1e-12


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Corners:
    """The corners of an objective path and what became of each, in path order.

    Args:
        vertex: Index of the corner among the vertices of the objective path, from 0, (n,).
        point: The corner points [m], (n, dimension).
        turn: Angle between the lines [rad], above 0 and at most pi, (n,).
        radius: Radius of the arc [m], 0 where the tool stops at the corner, (n,).
        error: Corner error: gap between corner point and arc [m], (n,).
        tangent: Tangent length [m], (n,).
        start, end: Arc length on the rounded path where the arc starts and ends [m], (n,).
        shrunk: True where the arc is smaller than its position asks for, because its lines are
            short or its orientation turns too far, (n,).
        speed: Largest speed on the arc under the given acceleration, (16) [m/s], (n,); NaN if no
            acceleration was given.
        angular_error: Angle between the tool's orientation in the middle of the arc and that at the
            corner point [rad], (n,), or that between the tool axes where only they count; 0 where
            the orientation follows the tangent or is not given.
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

    def __post_init__(self) -> None:
        for name in self.__slots__:
            object.__setattr__(self, name, _checks.lock_copy(getattr(self, name)))

    def __len__(self) -> int:
        """Number of corners."""
        return len(self.vertex)

    @property
    def stopped(self) -> BoolArray:
        """True where the corner stays sharp and the tool has to stop, (n,)."""
        return np.asarray(self.radius == 0)


@dataclass(frozen=True, kw_only=True, eq=False)
class RoundedPath(Path):
    """A path whose corners were rounded; it remembers how, and from what.

    Args:
        objective: The path before rounding.
        corners: What became of each of its corners.
    """

    objective: Path
    corners: Corners

    def place(self, s: npt.ArrayLike) -> FloatArray:
        """Arc lengths on this path of those on the objective path [m]; on an arc, by their share.

        Args:
            s: Arc lengths of the objective path [m], any shape.
        """
        c = self.corners
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
) -> RoundedPath:
    """Replace every corner by the arc that the paper's case I or case II asks for.

    Case II: `tolerance` bounds the corner error, and the radius is the largest that keeps it, (15).
    Case I: `speed` is the lowest speed allowed on the corner; under `acceleration` this gives the
    smallest radius (13) and the smallest corner error (14). Where both are given, `tolerance`
    caps the corner error of case I.

    Each value is one for all corners, or one per vertex between segments (vertices where the path
    goes straight on ignore theirs). A tolerance of the path's own segments caps the corner error.
    Arcs that would overlap shrink, each as far as its own lines ask. A zero radius (zero
    tolerance, a turn of 180°, a corner beside an arc) leaves the corner as a full stop.

    The tool's orientation is rounded with the position: `angular_tolerance` bounds how far it is
    off in the middle of a corner, and makes arcs smaller where it has to. It also rounds what only
    the orientation does at a vertex where the path goes straight on. An orientation that follows
    the tangent may leave it by that angle where lines and arcs meet.

    Args:
        path: The objective path.
        tolerance: Largest corner error [m].
        speed: Lowest corner speed [m/s].
        acceleration: Centripetal acceleration at that speed [m/s²]; with `tolerance` alone it is
            only used to report the corner speed (16).
        angular_tolerance: Largest angle by which the orientation may be off [rad].

    Raises:
        InvalidInput: Neither case given, a negative value, a wrong number of values, or no
            angular tolerance where the orientation needs one.
    """
    if tolerance is None and (speed is None or acceleration is None):
        raise InvalidInput(
            "Corners need a tolerance (case II), or a speed and an acceleration (case I): in "
            "Python arguments of round_corners, in a job keys of corners."
        )
    turn = path.turns
    corner = np.flatnonzero(turn > TANGENT_TOLERANCE)
    kinked = np.setdiff1d(find_kinks(path), corner)
    angle = _angular_tolerance(path, angular_tolerance, kinked)
    half = turn[corner] / 2
    radius, pull = _required_radius(path, corner, half, (tolerance, speed, acceleration))
    straight_sides = (path.curvatures[corner] == 0) & (path.curvatures[corner + 1] == 0)
    reach = np.minimum(radius * np.tan(half), largest_tangent(path, corner, half, angle))
    wanted = np.where(straight_sides, reach, 0.0)
    # An arc below the resolution of a point is no arc; at a turn of 180° every radius vanishes.
    wanted[wanted <= REPEATED_POINT] = 0.0
    wanted[np.pi - turn[corner] <= TANGENT_TOLERANCE] = 0.0
    # Where only the orientation turns, it shares the segments with the corners.
    which, halves = np.concatenate([corner, kinked]), np.append(half, np.zeros(len(kinked)))
    turning = largest_tangent(path, kinked, halves[len(corner) :], angle)
    order = np.argsort(which)
    tangents = np.empty(len(which))
    tangents[order] = _fit(np.concatenate([wanted, turning])[order], which[order], path.lengths)
    tangent = tangents[: len(corner)]
    # A micro-segment between two corners can leave an arc below that resolution too.
    tangent[tangent <= REPEATED_POINT / 4] = 0.0
    shrunk = tangent < radius * np.tan(half) * (1 - 1e-12)
    shrunk &= straight_sides & (wanted > 0)
    radius = np.where(tangent > 0, np.where(shrunk, tangent / np.tan(half), radius), 0.0)
    speeds = np.sqrt(pull * radius)
    rounded, of = _assemble(path, corner, half, radius, tangent, shrunk, speeds)
    return _with_orientation(rounded, of, which, halves, tangents, angle)


def _required_radius(
    path: Path,
    corner: IntArray,
    half: FloatArray,
    given: tuple[npt.ArrayLike | None, npt.ArrayLike | None, npt.ArrayLike | None],
) -> tuple[FloatArray, FloatArray]:
    """Radii that case I or case II asks for, and the acceleration at each corner, (n,) each.

    Args:
        path: The objective path.
        corner: Segments after which there is a corner, (n,).
        half: Half of the turn at each [rad], (n,).
        given: Tolerance, speed and acceleration as in `round_corners`.

    Raises:
        InvalidInput: Values that are none.
    """
    tolerance, speed, acceleration = given
    vertices = len(path) - 1
    allowed = _per_vertex("corner error tolerance", tolerance, vertices, "m", np.inf)
    slowest = _per_vertex("corner speed", speed, vertices, "m/s", np.nan)
    pull = _per_vertex("corner acceleration", acceleration, vertices, "m/s²", np.nan)
    if acceleration is not None and vertices:
        _checks.positive("corner acceleration", pull.min(), "m/s²")
    own = np.where(np.isnan(path.tolerances), np.inf, path.tolerances)
    allowed = np.minimum(allowed, np.minimum(own[:-1], own[1:]))
    radius = _largest_radius(allowed[corner], half)
    if speed is not None:
        radius = np.minimum(radius, slowest[corner] ** 2 / pull[corner])
    return radius, pull[corner]


def _with_orientation(
    rounded: RoundedPath,
    of: IntArray,
    which: IntArray,
    half: FloatArray,
    tangent: FloatArray,
    angle: float,
) -> RoundedPath:
    """The rounded path with the orientation of its objective path, rounded too.

    Args:
        rounded: The path without it.
        of: As `_assemble` tells.
        which: Segments after which it may turn: at corners, and then at kinks, (k,).
        half: Half of the turn at each [rad], (k,).
        tangent: Tangent length of each [m], (k,).
        angle: Largest angle by which it may be off [rad].
    """
    path = rounded.objective
    if path.orientation is None:
        return rounded
    if path.orientation.follows:
        orientation = follow_rounded(rounded.segments, path, of, angle)
        return dataclasses.replace(rounded, orientation=orientation)
    orientation, off = round_orientation(path, which, half, tangent)
    corners = dataclasses.replace(rounded.corners, angular_error=off[: len(rounded.corners)])
    return dataclasses.replace(rounded, orientation=orientation, corners=corners)


def _angular_tolerance(path: Path, given: float | None, kinked: IntArray) -> float:
    """The angular tolerance [rad], infinite where none is given and none is needed.

    Raises:
        InvalidInput: A negative one, or none where the orientation needs one.
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


def corner_error(radius: FloatArray, half_turn: FloatArray) -> FloatArray:
    """Gap between corner point and arc [m], from (10): `r (1 - cos h) / cos h`."""
    return np.asarray(radius * 2 * np.sin(half_turn / 2) ** 2 / np.cos(half_turn))


def _largest_radius(error: FloatArray, half: FloatArray) -> FloatArray:
    """Radius whose corner error is `error`, (11), without cancellation at small turns."""
    return np.asarray(error * np.cos(half) / (2 * np.sin(half / 2) ** 2))


def _per_vertex(
    name: str, values: npt.ArrayLike | None, vertices: int, unit: str, default: float
) -> FloatArray:
    if values is None:
        return np.full(vertices, default)
    array = _checks.numbers(name, values, unit)
    if array.ndim and array.shape != (vertices,):
        raise InvalidInput(
            f"{name} has {array.size} values, but the path has {vertices} vertices between "
            f"segments: give one value for all or {vertices}."
        )
    if array.size and (array < 0).any():
        raise InvalidInput(f"{name} must not be negative, but is {array.min():g} {unit}.")
    return np.broadcast_to(array, (vertices,)).copy()


def _fit(wanted: FloatArray, corner: IntArray, lengths: FloatArray) -> FloatArray:
    """Tangent lengths that fit their lines.

    A corner may always take half of a line, and what the other corner of the line leaves over. The
    rule looks at two neighbours only, gives a corner the same in either direction of travel, and
    never fails.
    """
    at = np.zeros(len(lengths) + 1)
    at[corner + 1] = wanted
    room_before = np.maximum(lengths / 2, lengths - at[:-1])  # for the corner at a segment's end
    room_after = np.maximum(lengths / 2, lengths - at[1:])  # for the corner at its start
    return np.asarray(np.minimum(wanted, np.minimum(room_before[corner], room_after[corner + 1])))


def _assemble(
    path: Path,
    corner: IntArray,
    half: FloatArray,
    radius: FloatArray,
    tangent: FloatArray,
    shrunk: BoolArray,
    speed: FloatArray,
) -> tuple[RoundedPath, IntArray]:
    """The rounded path, and of which objective segment each of its segments is, or comes after."""
    n, rounded = len(path), radius > 0
    cut = np.zeros(n + 1)
    cut[corner + 1] = tangent
    # Only lines give something up to a corner.
    lines = path.segments.replace(
        starts=path.starts + cut[:-1, None] * path.tangents,
        lengths=path.lengths - cut[:-1] - cut[1:],
    )
    which = corner[rounded]
    before, after = path.segments[which], path.segments[which + 1]
    across = np.sum(before.tangents * after.tangents, axis=1, keepdims=True)
    normals = after.tangents - across * before.tangents
    arcs = before.replace(
        starts=after.starts - tangent[rounded, None] * before.tangents,
        normals=normals / np.linalg.norm(normals, axis=1, keepdims=True),
        curvatures=1 / radius[rounded],
        lengths=radius[rounded] * 2 * half[rounded],
        # An arc lies on both its lines: the lower of their speeds and tolerances holds on it.
        speeds=np.fmin(before.speeds, after.speeds),
        tolerances=np.fmin(before.tolerances, after.tolerances),
    )
    # Each segment, and the arc after it.
    of = np.append(np.arange(n), which)
    in_order = np.argsort(of, kind="stable")
    of, table = of[in_order], Segments.join([lines, arcs])[in_order]
    used = (table.lengths > SLIVER) | (in_order >= n)
    ends = np.cumsum(np.where(used, table.lengths, 0.0))[
        np.searchsorted(of, corner, side="right") - 1
    ]
    rounded_path = RoundedPath(
        segments=table[used],
        merged=path.merged,
        # An arc leaves the waypoint of its corner aside: then every vertex is one.
        waypoints=EVERY_VERTEX if rounded.any() else path.waypoints,
        objective=path,
        corners=Corners(
            vertex=corner + 1,
            point=path.starts[corner + 1],
            turn=2 * half,
            radius=radius,
            error=corner_error(radius, half),
            tangent=tangent,
            start=ends - radius * 2 * half,
            end=ends,
            shrunk=shrunk,
            speed=speed,
            angular_error=np.zeros(len(corner)),
        ),
    )
    return rounded_path, of[used]
