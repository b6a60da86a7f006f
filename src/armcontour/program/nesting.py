"""Closed contours and the contours inside them, seen from above; exact for lines and arcs.

A point is inside a contour if its winding number is not zero. It is the winding number of the
chords' polygon, plus one turn for every arc with the point between its chord and its curve.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.core.sampled_data import number_parts
from armcontour.geometry import Path
from armcontour.geometry.biarcs import draw_arcs
from armcontour.geometry.segments import Segments
from armcontour.program.moves import Contour

# Number of chords per quarter circle on a tilted arc, whose projection is not an arc.
CHORDS = 32
# A unit vector with a smaller component along `up` counts as perpendicular to `up`.
MAX_SLOPE = 1e-6
NO_CHORDS = np.empty((0, 8))
# About this number of point-chord pairs are tested together, to limit the memory.
PAIRS_AT_ONCE = 200_000


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Nesting:
    """Areas of contours, and the contours inside each of them."""

    # True in row i and column k if contour k is inside the closed contour i, (n, n)
    contains: BoolArray
    # Area of every contour [m²], positive if it is counter-clockwise; 0 if open, (n,)
    areas: FloatArray

    @property
    def parents(self) -> IntArray:
        """Index of the smallest contour around each contour, (n,); -1 for outer contours."""
        sizes = np.where(self.contains, np.abs(self.areas)[:, None], np.inf)
        smallest = np.argmin(sizes, axis=0)
        return np.where(self.contains.any(axis=0), smallest, -1)


def find_nesting(contours: Sequence[Contour], up: FloatArray) -> Nesting:
    """Determine which contours are inside which closed contours; contours must not cross.

    In space, `up` is the direction from which the contours are viewed, (3,).
    """
    chords = [_close_chords(find_chords(x.path, up)) if x.closed else NO_CHORDS for x in contours]
    starts = np.array([project_along_up(x.path(0.0), up) for x in contours])
    contains = np.array([_contains_points(x, starts) for x in chords])
    np.fill_diagonal(contains, False)
    areas = np.array([_area(x) for x in chords])
    # If two contours seem to be inside each other because of rounding, the smaller one is inside.
    contains &= np.abs(areas)[:, None] > np.where(areas == 0, 0.0, np.abs(areas))[None, :]
    return Nesting(contains=contains, areas=areas)


def wind_around(paths: Sequence[Path], points: FloatArray) -> IntArray:
    """Return the winding numbers of closed paths in the plane around points, (n,)."""
    chords = [_close_chords(find_chords(x, np.eye(3)[2])) for x in paths]
    return _windings(np.concatenate(chords), points)


def project_along_up(points: FloatArray, up: FloatArray) -> FloatArray:
    """Project points or vectors along `up`, (..., 2); points in the plane are unchanged."""
    return points if points.shape[-1] == 2 else np.asarray(points @ perpendicular_axes(up))


def perpendicular_axes(up: FloatArray) -> FloatArray:
    """Return two unit vectors as columns that form a right-handed frame with `up`, (3, 2)."""
    x_axis = np.cross(np.eye(3)[int(np.argmin(np.abs(up)))], up)
    x_axis /= np.linalg.norm(x_axis)
    return np.stack([x_axis, np.cross(up, x_axis)], axis=1)


def find_chords(path: Path, up: FloatArray) -> FloatArray:
    """Return the chords of a path's segments, projected along `up`, (m, 8).

    Columns: start x, y, end x, y, centre x, y, radius [m], and turn: 1 for arcs to the left, -1 for
    arcs to the right, 0 for lines. An arc is at most half a circle.
    """
    rows = _split_arcs(draw_arcs(path.segments)[0], up)
    a = project_along_up(rows.starts, up)
    b = project_along_up(rows.ends, up)
    bent = rows.curvatures > 0
    radius = np.where(bent, 1 / np.where(bent, rows.curvatures, 1.0), 0.0)
    tangents = project_along_up(rows.tangents, up)
    normals = project_along_up(rows.normals, up)
    turn = np.sign(tangents[:, 0] * normals[:, 1] - tangents[:, 1] * normals[:, 0])
    return np.column_stack([a, b, a + radius[:, None] * normals, radius, np.where(bent, turn, 0)])


def _split_arcs(rows: Segments, up: FloatArray) -> Segments:
    """Divide arcs into at most half circles, and replace tilted arcs by chords."""
    sweeps = rows.curvatures * rows.lengths
    pieces = np.where(sweeps > np.pi / 2, 4, 1)
    tilted = np.zeros(len(rows), dtype=bool)
    if rows.dimension == 3:
        tilted = np.hypot(rows.tangents @ up, rows.normals @ up) > MAX_SLOPE
        tilted &= rows.curvatures > 0
        pieces[tilted] = CHORDS * np.ceil(sweeps[tilted] / (np.pi / 2)).astype(int)
    if (pieces == 1).all():
        return rows
    row, number = number_parts(pieces)
    step = (rows.lengths / pieces)[row]
    cut = rows.cut(row, number * step, (number + 1) * step)
    straight = tilted[row]
    curvatures = np.where(straight, 0.0, cut.curvatures)
    ends = np.concatenate([cut.starts[1:], rows.ends[-1:]])
    chords = ends - cut.starts
    lengths = np.where(straight, np.linalg.norm(chords, axis=1), cut.lengths)
    tangents = np.where(straight[:, None], chords / lengths[:, None], cut.tangents)
    return cut.replace(curvatures=curvatures, lengths=lengths, tangents=tangents)


def _close_chords(chords: FloatArray) -> FloatArray:
    """Add a chord across the gap between end and start, which leads or an overlap can cause."""
    closing_chord = np.concatenate([chords[-1, 2:4], chords[0, :2], np.zeros(4)])
    closed_chords = np.vstack([chords, closing_chord])
    # A ray through even a tiny gap would miss the contour.
    closed_chords[:, 2:4] = np.roll(closed_chords[:, :2], -1, axis=0)
    return closed_chords


def _contains_points(chords: FloatArray, points: FloatArray) -> BoolArray:
    """Return the mask of the points inside a closed contour, (n,); all false without chords.

    - `chords`: chords of the contour from `find_chords`, closed, (m, 8).
    - `points`: the points [m], (n, 2).
    """
    if not len(chords):
        return np.zeros(len(points), np.bool_)
    # A box around all chords and all circles of arcs contains the contour.
    centers = chords[:, 4:6]
    radius = chords[:, 6:7]
    bent = chords[:, 7:8] != 0
    low = np.minimum(chords[:, :2], np.where(bent, centers - radius, np.inf)).min(axis=0)
    high = np.maximum(chords[:, :2], np.where(bent, centers + radius, -np.inf)).max(axis=0)
    inside: BoolArray = ((points >= low) & (points <= high)).all(axis=1)
    near = np.flatnonzero(inside)
    inside[near] = _windings(chords, points[near]) != 0
    return inside


def _windings(chords: FloatArray, points: FloatArray) -> IntArray:
    """Return the winding numbers of closed contours around points, (n,).

    A chord from a to b that crosses the horizontal ray to the right of a point counts +1 if it runs
    upwards, and -1 if it runs downwards. For a point between a chord and its arc, the direction of
    the arc is added.

    - `chords`: chords of the contours from `find_chords`, closed, (m, 8).
    - `points`: the points [m], (n, 2).
    """
    if len(points) * len(chords) > PAIRS_AT_ONCE and len(points) > 1:
        return np.concatenate([_windings(chords, x) for x in np.array_split(points, 2)])
    x, y = points[:, :1], points[:, 1:]
    ax, ay, bx, by, cx, cy, radius, turn = chords.T
    # A point on a chord counts as shifted to the right by an infinitesimal distance, and upwards by
    # an even smaller distance.
    side = (bx - ax) * (y - ay) - (x - ax) * (by - ay)
    on_left = (side > 0) | ((side == 0) & ((by < ay) | ((by == ay) & (bx > ax))))
    upward = (ay <= y) & (y < by) & on_left
    downward = (by <= y) & (y < ay) & ~on_left
    under_arc = (on_left == (turn < 0)) & (np.hypot(x - cx, y - cy) < radius)
    windings = upward.astype(int) - downward + np.where(under_arc, turn, 0).astype(int)
    return np.asarray(windings.sum(axis=1))


def _area(chords: FloatArray) -> float:
    """Return a closed contour's area [m²], positive if counter-clockwise; 0 without chords."""
    if not len(chords):
        return 0.0
    a = chords[:, :2] - chords[0, :2]
    b = chords[:, 2:4] - chords[0, :2]
    polygon_area = float(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])) / 2
    # Circular segments between the chords and their arcs.
    radius = chords[:, 6]
    turn = chords[:, 7]
    half_chord = np.linalg.norm(b - a, axis=1) / 2
    angle = 2 * np.arcsin(np.minimum(half_chord / np.where(radius > 0, radius, np.inf), 1.0))
    return polygon_area + float(np.sum(turn * radius**2 * (angle - np.sin(angle)))) / 2
