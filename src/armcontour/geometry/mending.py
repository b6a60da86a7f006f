"""Mending of vertices that rounded coordinates have bent: exactly tangent again."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from armcontour.core.checks import FloatArray
from armcontour.core.frames import angle_between
from armcontour.geometry.biarcs import biarcs, distance, unit
from armcontour.geometry.blends import WIDEST
from armcontour.geometry.path import Path
from armcontour.geometry.rounding import blend_vertices
from armcontour.geometry.segments import EVERY, REPEATED_POINT, TANGENT_TOLERANCE, Segments

# Turns above this are corners however short their segments are [rad].
LARGEST_KINK = 0.05
# Places at which the blends of a seam are compared with the path, as shares of their lengths.
SHARES = np.linspace(0.0, 1.0, 9)
ALL = np.zeros(len(SHARES), dtype=np.intp)
# How often the blends of a seam are halved before the seam is left as it is.
MOST_HALVINGS = 20


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Mended:
    """A path with mended vertices.

    Args:
        path: The path.
        before: Arc lengths on the path before [m], increasing, (n,).
        after: The arc lengths on this path that correspond to them [m], (n,).
        count: Number of mended vertices.
        kink: Largest turn at one of them [rad].
        deviation: Largest distance between both paths [m].
    """

    path: Path
    before: FloatArray
    after: FloatArray
    count: int
    kink: float
    deviation: float

    def place(self, s: npt.ArrayLike) -> FloatArray:
        """Arc lengths on this path for arc lengths on the path before [m]."""
        return np.asarray(np.interp(np.asarray(s, dtype=np.float64), self.before, self.after))


def mend_vertices(path: Path, tolerance: float, most: float = np.inf) -> Mended | None:
    """Make vertices tangent whose turn disappears if points move a little; None if there are none.

    Moving both ends of a line by a distance turns it by up to twice the distance over its length,
    the ends of an arc over its length or radius. At most half of each segment changes per vertex.
    Vertices stay if a segment beside them has the tolerance 0. The vertex at which a closed path
    starts and ends stays where it is.

    Args:
        path: A path without tool orientation.
        tolerance: Distance by which points can move, and between both paths [m].
        most: Largest distance between both paths [m], if it is less.
    """
    rows, turns = path.segments, path.turns
    size = np.minimum(rows.lengths, 1 / np.maximum(rows.curvatures, 1 / rows.lengths))
    held = 2 * tolerance / size
    own = np.where(np.isnan(path.tolerances), np.inf, path.tolerances)
    own = np.minimum(own, min(tolerance, most))
    allowed = np.minimum(own[:-1], own[1:])
    largest = np.minimum(held[:-1] + held[1:], LARGEST_KINK)
    vertex = np.flatnonzero((turns > TANGENT_TOLERANCE) & (turns <= largest) & (allowed > 0))
    inner = None
    if len(vertex):
        found = blend_vertices(path, vertex, turns[vertex], allowed[vertex])
        corners, done = found.corners, ~found.corners.stopped
        if done.any():
            inner = Mended(
                path=Path(segments=found.segments, merged=path.merged),
                before=path.breaks,
                after=np.minimum(found.place(path.breaks), found.length),
                count=int(done.sum()),
                kink=float(corners.turn[done].max()),
                deviation=float(corners.error[done].max()),
            )
    start = path if inner is None else inner.path
    seam = _mend_seam(start, min(held[0] + held[-1], LARGEST_KINK), min(own[0], own[-1]))
    if inner is None or seam is None:
        return inner or seam
    return Mended(
        path=seam.path,
        before=inner.before,
        after=seam.place(inner.after),
        count=inner.count + 1,
        kink=max(inner.kink, seam.kink),
        deviation=max(inner.deviation, seam.deviation),
    )


def _mend_seam(path: Path, most: float, allowed: float) -> Mended | None:
    """Replace both ends of a closed path by two arcs each, which are tangent where it closes.

    Their lengths are halved from half of a segment on, until the distance is allowed.

    Args:
        path: The path.
        most: Largest turn to mend [rad].
        allowed: Largest distance between both paths [m].
    """
    rows = path.segments
    first, last = rows[:1], rows[-1:]
    kink = float(angle_between(last.end_tangents, first.tangents)[0])
    apart = float(np.linalg.norm(last.ends - first.starts))
    if len(rows) == 1 or apart > REPEATED_POINT or not allowed > 0:
        return None
    if not TANGENT_TOLERANCE < kink <= most:
        return None
    middle = unit(first.tangents + last.end_tangents)
    size = np.minimum(first.lengths, last.lengths) / 2
    size = np.minimum(
        size, WIDEST / np.maximum(np.maximum(first.curvatures, last.curvatures), 1e-300)
    )
    for _ in range(MOST_HALVINGS):
        begin = last.lengths - size
        leaving = biarcs(first.starts, middle, first.at(EVERY, size), first.at(EVERY, size, 1))
        arriving = biarcs(last.at(EVERY, begin), last.at(EVERY, begin, 1), last.ends, middle)
        off = max(
            float(distance(row.at(ALL, start + size * SHARES)[None], *arcs)[0])
            for row, start, arcs in ((first, 0.0, leaving), (last, begin, arriving))
        )
        if off <= allowed:
            break
        size = size / 2
    else:
        return None
    t, total = float(size[0]), path.length
    begin, end = np.zeros(len(rows)), rows.lengths.copy()
    begin[0], end[-1] = t, end[-1] - t
    names = ("speeds", "tolerances", "tags")
    ends = [
        x.replace(**{name: getattr(row, name) for name in names})
        for row, arcs in ((first, leaving), (last, arriving))
        for x in arcs
    ]
    table = Segments.join([*ends[:2], rows.cut(np.arange(len(rows)), begin, end), *ends[2:]])
    new = [float(sum(x.lengths[0] for x in arcs)) for arcs in (leaving, arriving)]
    return Mended(
        path=Path(segments=table, merged=path.merged),
        before=np.array([0.0, t, total - t, total]),
        after=np.cumsum([0.0, new[0], total - 2 * t, new[1]]),
        count=1,
        kink=kink,
        deviation=off,
    )
