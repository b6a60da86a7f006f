"""Mending of vertices that printed coordinates have bent: exactly tangent again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from armcontour._checks import FloatArray, IntArray
from armcontour.frames import angle_between
from armcontour.geometry.biarcs import biarcs, distance, unit
from armcontour.geometry.blends import WIDEST
from armcontour.geometry.path import Path
from armcontour.geometry.rounding import RoundedPath, blend_vertices
from armcontour.geometry.segments import EVERY, REPEATED_POINT, TANGENT_TOLERANCE, Segments

# Turns above this are corners however short their segments are [rad].
LARGEST_KINK = 0.05
# Places at which the blends of a seam are compared with the path, as shares of their lengths.
SHARES = np.linspace(0.0, 1.0, 9)
# How often the blends of a seam are halved before the seam is left as it is.
MOST_HALVINGS = 20


@dataclass(frozen=True, slots=True, kw_only=True)
class Printed:
    """What the decimals of printed coordinates can hold.

    Args:
        point: Distance by which printing can have moved a point [m].
        angle: Angle by which printing can have turned the ends of an arc, beyond what follows from
            its points, as where it is given by an angle or a bulge [rad].
        by_radius: Whether arcs are given by end points and radius, which hardly define the tangents
            of half a circle.
    """

    point: float
    angle: float = 0.0
    by_radius: bool = False

    def turns(self, rows: Segments) -> FloatArray:
        """Angles by which printing can have turned the ends of lines and arcs [rad], (n,)."""
        k, arc = rows.curvatures, rows.curvatures > 0
        size = np.minimum(rows.lengths, 1 / np.where(arc, k, 1 / rows.lengths))
        turn = 2 * self.point / size + np.where(arc, self.angle, 0.0)
        if self.by_radius:
            # The derivative of asin(chord / 2 r) by chord and r; at half a circle its square root.
            flat = np.maximum(np.abs(np.cos(k * rows.lengths / 2)), np.sqrt(2 * self.point * k))
            turn = turn + np.where(arc, 2 * self.point * k / np.maximum(flat, 1e-300), 0.0)
        return np.asarray(turn)


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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Kinks:
    """The vertices of a path to mend.

    Args:
        path: The path.
        vertex: Segments after which the vertices are, (n,).
        turn: The path's turns there [rad], (n,).
        allowed: Largest distances between both paths there [m], (n,).
        seam: Largest turn to mend where the path closes [rad], and largest distance there [m].
    """

    path: Path
    vertex: IntArray
    turn: FloatArray
    allowed: FloatArray
    seam: tuple[float, float]


def mend_vertices(path: Path, printed: Printed) -> Mended | None:
    """Make vertices tangent at which printing can have made the turn; None if there are none.

    At most half of each segment changes per vertex. Vertices stay if a segment beside them has the
    tolerance 0.

    Args:
        path: A path without tool orientation.
        printed: What the decimals of the path's coordinates can hold.
    """
    return mend_paths([path], [printed], [np.inf])[0]


def mend_paths(
    paths: Sequence[Path], printed: Sequence[Printed], most: Sequence[float]
) -> list[Mended | None]:
    """`mend_vertices` of many paths at once, all in the plane or all in space.

    Args:
        paths: The paths.
        printed: What the decimals of each path's coordinates can hold.
        most: Largest distance between both paths [m], where it is less than printing moves a point.
    """
    kinks = [_find_kinks(*x) for x in zip(paths, printed, most, strict=True)]
    found: list[Mended | None] = [None] * len(kinks)
    which = [i for i, x in enumerate(kinks) if len(x.vertex)]
    if which:
        for i, inner in zip(which, _mend_inside([kinks[i] for i in which]), strict=True):
            found[i] = inner
    return [_with_seam(x, inner) for x, inner in zip(kinks, found, strict=True)]


def _find_kinks(path: Path, printed: Printed, most: float) -> _Kinks:
    """The vertices of a path that printing can have bent."""
    turns, held = path.turns, printed.turns(path.segments)
    own = np.where(np.isnan(path.tolerances), np.inf, path.tolerances)
    own = np.minimum(own, min(printed.point, most))
    allowed = np.minimum(own[:-1], own[1:])
    largest = np.minimum(held[:-1] + held[1:], LARGEST_KINK)
    vertex = np.flatnonzero((turns > TANGENT_TOLERANCE) & (turns <= largest) & (allowed > 0))
    return _Kinks(
        path=path,
        vertex=vertex,
        turn=turns[vertex],
        allowed=allowed[vertex],
        seam=(min(held[0] + held[-1], LARGEST_KINK), min(own[0], own[-1])),
    )


def _with_seam(kinks: _Kinks, inner: Mended | None) -> Mended | None:
    """What is mended inside of a path, and where it closes; None for nothing."""
    seam = _mend_seam(kinks.path if inner is None else inner.path, *kinks.seam)
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


def _mend_inside(kinks: Sequence[_Kinks]) -> list[Mended | None]:
    """Mend the vertices between segments of paths, None where no blend fits any of them.

    All are mended in one path, with lines from each to the next.
    """
    tables: list[Segments] = []
    first: list[int] = []
    count = 0
    for i, x in enumerate(kinks):
        if i:
            ends = np.concatenate([kinks[i - 1].path.segments[-1:].ends, x.path.starts[:1]])
            if np.linalg.norm(ends[1] - ends[0]) > REPEATED_POINT:
                tables.append(Segments.lines(ends))
                count += 1
        first.append(count)
        tables.append(x.path.segments)
        count += len(x.path)
    whole = Path(segments=Segments.join(tables))
    vertex = np.concatenate([i + x.vertex for i, x in zip(first, kinks, strict=True)])
    turn, allowed = (np.concatenate([getattr(x, y) for x in kinks]) for y in ("turn", "allowed"))
    found = blend_vertices(whole, vertex, turn, allowed)
    # Where paths begin and end, the new path has a break, up to rounding.
    places = found.place(whole.breaks)
    rows = np.searchsorted((found.breaks[1:] + found.breaks[:-1]) / 2, places)
    mended, corner = [], 0
    for i, x in zip(first, kinks, strict=True):
        part, own = slice(i, i + len(x.path) + 1), slice(corner, corner + len(x.vertex))
        mended.append(_part(found, x.path, rows[part], places[part], own))
        corner += len(x.vertex)
    return mended


def _part(
    found: RoundedPath, path: Path, rows: IntArray, places: FloatArray, corners: slice
) -> Mended | None:
    """What was mended of one of several paths; None for nothing.

    Args:
        found: All paths, mended.
        path: The path.
        rows: The segments of `found` from which on the path's segments lie, and their end.
        places: Arc lengths on `found` of the path's breaks [m].
        corners: The path's vertices among the corners of `found`.
    """
    done = ~found.corners.stopped[corners]
    if not done.any():
        return None
    mended = Path(segments=found.segments[rows[0] : rows[-1]], merged=path.merged)
    return Mended(
        path=mended,
        before=path.breaks,
        after=np.minimum(places - places[0], mended.length),
        count=int(done.sum()),
        kink=float(found.corners.turn[corners][done].max()),
        deviation=float(found.corners.error[corners][done].max()),
    )


def _mend_seam(path: Path, most: float, allowed: float) -> Mended | None:
    """Mend the vertex at which a closed path starts and ends, which stays where it is.

    Args:
        path: The path.
        most: Largest turn to mend [rad].
        allowed: Largest distance between both paths [m].
    """
    rows, n = path.segments, len(path)
    first, last = rows[:1], rows[n - 1 :]
    ahead, back = first.tangents, last.end_tangents
    kink = float(angle_between(back, ahead)[0])
    apart = float(np.linalg.norm(last.ends - first.starts))
    if n < 2 or apart > REPEATED_POINT or not (TANGENT_TOLERANCE < kink <= most and allowed > 0):
        return None
    bend = max(rows.curvatures[0], rows.curvatures[-1])
    t = min(rows.lengths[0] / 2, rows.lengths[-1] / 2, WIDEST / bend if bend > 0 else np.inf)
    middle = unit(ahead + back)
    for _ in range(MOST_HALVINGS):
        end = np.array([t])
        leaving = biarcs(first.starts, middle, first.at(EVERY, end), first.at(EVERY, end, 1))
        begin = rows.lengths[-1:] - t
        arriving = biarcs(last.at(EVERY, begin), last.at(EVERY, begin, 1), last.ends, middle)
        off = max(
            float(distance(_samples(first, 0.0, t), *leaving)[0]),
            float(distance(_samples(last, float(begin[0]), t), *arriving)[0]),
        )
        if off <= allowed:
            break
        t /= 2
    else:
        return None
    lengths = [sum(float(x.lengths[0]) for x in arcs) for arcs in (leaving, arriving)]
    total = path.length
    return Mended(
        path=Path(segments=_with_ends(rows, leaving, arriving, t), merged=path.merged),
        before=np.array([0.0, t, total - t, total]),
        after=np.cumsum([0.0, lengths[0], total - 2 * t, lengths[1]]),
        count=1,
        kink=kink,
        deviation=off,
    )


def _samples(row: Segments, begin: float, length: float) -> FloatArray:
    """Points along a part of one segment [m], (1, places, dimension)."""
    return row.at(np.zeros(len(SHARES), dtype=np.intp), begin + length * SHARES)[None]


def _with_ends(
    rows: Segments,
    leaving: tuple[Segments, Segments],
    arriving: tuple[Segments, Segments],
    t: float,
) -> Segments:
    """The segments with their first and last length t [m] replaced by two arcs each."""
    n = len(rows)
    begin, end = np.zeros(n), rows.lengths.copy()
    begin[0], end[-1] = t, end[-1] - t
    demands = ("speeds", "tolerances", "tags")
    first, last = (
        {x: getattr(rows, x)[i].copy() for x in demands} for i in (slice(1), slice(n - 1, n))
    )
    return Segments.join(
        [
            *(x.replace(**first) for x in leaving),
            rows.cut(np.arange(n), begin, end),
            *(x.replace(**last) for x in arriving),
        ]
    )
