"""Which closed contours hold which contours, seen from above."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armcontour._checks import BoolArray, FloatArray, IntArray
from armcontour._sampling import number_parts
from armcontour.geometry import Path
from armcontour.geometry.biarcs import draw_arcs
from armcontour.geometry.segments import Segments
from armcontour.program.moves import Contour

# Chords of a quarter circle that is not seen from above as an arc.
CHORDS = 32
# A unit vector whose part across another is smaller is parallel to it.
PARALLEL = 1e-6
NONE = np.empty((0, 8))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Nesting:
    """Contours inside of others.

    Args:
        holds: True in row i and column k if the closed contour i holds contour k, (n, n).
        areas: Area of every contour [m²], positive if it is counter-clockwise; 0 if open, (n,).
    """

    holds: BoolArray
    areas: FloatArray

    @property
    def parents(self) -> IntArray:
        """The smallest contour that holds each contour; -1 for a contour that none holds, (n,)."""
        sizes = np.where(self.holds, np.abs(self.areas)[:, None], np.inf)
        found = np.argmin(sizes, axis=0)
        return np.where(self.holds.any(axis=0), found, -1)


def nest(contours: Sequence[Contour], up: FloatArray) -> Nesting:
    """Which closed contours hold which contours; these are taken not to cross.

    Args:
        contours: The contours.
        up: In space, the direction from which the contours are viewed, (3,).
    """
    from armcontour.program._inside import holders

    chords = [_closed(chords_of(x.path, up)) if x.closed else NONE for x in contours]
    starts = np.array([seen_from_above(x.path(0.0), up) for x in contours])
    boxes = np.array([_box(x) for x in chords])
    first = np.concatenate([[0], np.cumsum([len(x) for x in chords])])
    holds = holders(starts, np.concatenate(chords), first, boxes)
    areas = np.array([_area(x) for x in chords])
    # Of two contours from which each seems to hold the other, the larger one holds.
    holds &= np.abs(areas)[:, None] > np.where(areas == 0, 0.0, np.abs(areas))[None, :]
    return Nesting(holds=holds, areas=areas)


def seen_from_above(points: FloatArray, up: FloatArray) -> FloatArray:
    """Points or vectors projected along `up`, (..., 2); those in the plane as they are."""
    return points if points.shape[-1] == 2 else np.asarray(points @ axes_across(up))


def axes_across(up: FloatArray) -> FloatArray:
    """Two axes across `up`, as columns; with it they are right-handed, (3, 2)."""
    first = np.cross(np.eye(3)[int(np.argmin(np.abs(up)))], up)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(up, first)], axis=1)


def chords_of(path: Path, up: FloatArray) -> FloatArray:
    """The segments of a path seen from above, as a table for `_inside`, (m, 8)."""
    rows = _halved(draw_arcs(path.segments)[0], up)
    a, b = seen_from_above(rows.starts, up), seen_from_above(rows.ends, up)
    bent = rows.curvatures > 0
    radius = np.where(bent, 1 / np.where(bent, rows.curvatures, 1.0), 0.0)
    tangents, normals = seen_from_above(rows.tangents, up), seen_from_above(rows.normals, up)
    turn = np.sign(tangents[:, 0] * normals[:, 1] - tangents[:, 1] * normals[:, 0])
    return np.column_stack([a, b, a + radius[:, None] * normals, radius, np.where(bent, turn, 0)])


def _halved(rows: Segments, up: FloatArray) -> Segments:
    """Segments with arcs of half a circle at most; tilted arcs are replaced by chords."""
    sweeps = rows.curvatures * rows.lengths
    pieces = np.where(sweeps > np.pi / 2, 4, 1)
    if rows.dimension == 3:
        tilted = np.hypot(rows.tangents @ up, rows.normals @ up) > PARALLEL
        tilted &= rows.curvatures > 0
        pieces[tilted] = CHORDS * np.ceil(sweeps[tilted] / (np.pi / 2)).astype(int)
    else:
        tilted = np.zeros(len(rows), dtype=bool)
    if (pieces == 1).all():
        return rows
    i, k = number_parts(pieces)
    step = (rows.lengths / pieces)[i]
    cut = rows.cut(i, k * step, (k + 1) * step)
    straight = tilted[i]
    curvatures = np.where(straight, 0.0, cut.curvatures)
    ends = np.concatenate([cut.starts[1:], rows.ends[-1:]])
    chords = ends - cut.starts
    lengths = np.where(straight, np.linalg.norm(chords, axis=1), cut.lengths)
    tangents = np.where(straight[:, None], chords / lengths[:, None], cut.tangents)
    return cut.replace(curvatures=curvatures, lengths=lengths, tangents=tangents)


def _closed(chords: FloatArray) -> FloatArray:
    """Chords without any gap, with the line that closes them if leads or an overlap opened them."""
    line = np.concatenate([chords[-1, 2:4], chords[0, :2], np.zeros(4)])
    found = np.vstack([chords, line])
    # A ray through a gap, however small, would miss the contour.
    found[:, 2:4] = np.roll(found[:, :2], -1, axis=0)
    return found


def _box(chords: FloatArray) -> FloatArray:
    """Smallest and largest x, then y, of a closed contour; nothing is in that of none, (4,)."""
    if not len(chords):
        return np.array([np.inf, -np.inf, np.inf, -np.inf])
    # Circles of arcs bound them.
    centers, radius = chords[:, 4:6], chords[:, 6:7]
    bent = chords[:, 7:8] != 0
    low = np.minimum(chords[:, :2], np.where(bent, centers - radius, np.inf)).min(axis=0)
    high = np.maximum(chords[:, :2], np.where(bent, centers + radius, -np.inf)).max(axis=0)
    return np.array([low[0], high[0], low[1], high[1]])


def _area(chords: FloatArray) -> float:
    """Area of a closed contour [m²], positive if it is counter-clockwise; 0 without chords."""
    if not len(chords):
        return 0.0
    a, b = chords[:, :2] - chords[0, :2], chords[:, 2:4] - chords[0, :2]
    polygon = float(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])) / 2
    radius, turn = chords[:, 6], chords[:, 7]
    half = np.linalg.norm(b - a, axis=1) / 2
    angle = 2 * np.arcsin(np.minimum(half / np.where(radius > 0, radius, np.inf), 1.0))
    return polygon + float(np.sum(turn * radius**2 * (angle - np.sin(angle)))) / 2
