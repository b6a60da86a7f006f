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
from armcontour.geometry.segments import REPEATED_POINT, TANGENT_TOLERANCE, Segments

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
    if not paths:
        return []
    kinks = [_find_kinks(*x) for x in zip(paths, printed, most, strict=True)]
    found: list[Mended | None] = [None] * len(kinks)
    which = [i for i, x in enumerate(kinks) if len(x.vertex)]
    if which:
        for i, inner in zip(which, _mend_inside([kinks[i] for i in which]), strict=True):
            found[i] = inner
    seams = _mend_seams(
        [x.path if y is None else y.path for x, y in zip(kinks, found, strict=True)],
        np.array([x.seam for x in kinks]),
    )
    return [_combine(*x) for x in zip(found, seams, strict=True)]


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


def _combine(inner: Mended | None, seam: Mended | None) -> Mended | None:
    """What is mended inside of a path, and then where it closes; None for nothing."""
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


def _mend_seams(paths: Sequence[Path], seam: FloatArray) -> list[Mended | None]:
    """Mend the vertices at which closed paths start and end; these vertices stay where they are.

    Args:
        paths: The paths.
        seam: Largest turn to mend [rad], and largest distance between both paths [m], (n, 2).
    """
    counts = np.array([len(x) for x in paths])
    whole = Segments.join([x.segments for x in paths])
    last = np.cumsum(counts) - 1
    rows, ends = whole[last - counts + 1], whole[last]
    kink = angle_between(ends.end_tangents, rows.tangents)
    apart = np.linalg.norm(ends.ends - rows.starts, axis=1)
    most, allowed = seam.T
    bent = (kink > TANGENT_TOLERANCE) & (kink <= most) & (allowed > 0)
    which = np.flatnonzero(bent & (counts > 1) & (apart <= REPEATED_POINT))
    found: list[Mended | None] = [None] * len(paths)
    if len(which):
        size, off = _seam_sizes(rows[which], ends[which], allowed[which])
        fits = np.isfinite(size)
        which, size, off = which[fits], size[fits], off[fits]
    if len(which):
        listed = which.tolist()
        done = _blend_seams([paths[i] for i in listed], size)
        for i, (path, before, after), far in zip(listed, done, off.tolist(), strict=True):
            found[i] = Mended(
                path=path,
                before=before,
                after=after,
                count=1,
                kink=float(kink[i]),
                deviation=far,
            )
    return found


def _seam_sizes(
    first: Segments, last: Segments, allowed: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Lengths of the blends at the seams of paths, and their distances from the paths [m], (n,).

    The lengths are halved from half of a segment on, until the distance is allowed; NaN where that
    does not suffice.

    Args:
        first: The first segments of the paths.
        last: Their last segments.
        allowed: Largest distances [m], (n,).
    """
    bend = np.maximum(first.curvatures, last.curvatures)
    widest = np.where(bend > 0, WIDEST / np.where(bend > 0, bend, 1.0), np.inf)
    size = np.minimum(np.minimum(first.lengths, last.lengths) / 2, widest)
    off = np.full(len(size), np.nan)
    todo = np.arange(len(size))
    for _ in range(MOST_HALVINGS):
        a, b, t = first[todo], last[todo], size[todo]
        leaving, arriving = _seam_blends(a, b, t)
        off[todo] = np.maximum(
            distance(_samples(a, np.zeros_like(t), t), *leaving),
            distance(_samples(b, b.lengths - t, t), *arriving),
        )
        todo = todo[~(off[todo] <= allowed[todo])]
        if not len(todo):
            return size, off
        size[todo] /= 2
    size[todo] = np.nan
    return size, off


_Arcs = tuple[Segments, Segments]


def _seam_blends(first: Segments, last: Segments, size: FloatArray) -> tuple[_Arcs, _Arcs]:
    """The two arcs from each seam on, and the two to it, of a length on each path [m], (n,)."""
    rows = np.arange(len(size))
    middle = unit(first.tangents + last.end_tangents)
    begin = last.lengths - size
    leaving = biarcs(first.starts, middle, first.at(rows, size), first.at(rows, size, 1))
    arriving = biarcs(last.at(rows, begin), last.at(rows, begin, 1), last.ends, middle)
    return leaving, arriving


def _samples(rows: Segments, begin: FloatArray, length: FloatArray) -> FloatArray:
    """Points along a part of every segment [m], (n, places, dimension)."""
    places = begin[:, None] + length[:, None] * SHARES
    return rows.at(np.broadcast_to(np.arange(len(begin))[:, None], places.shape), places)


def _blend_seams(
    paths: Sequence[Path], size: FloatArray
) -> list[tuple[Path, FloatArray, FloatArray]]:
    """Closed paths with blends at their seams: path, and arc lengths before and after [m].

    Args:
        paths: The paths.
        size: Length at their starts and ends that is replaced by two arcs each [m], (n,).
    """
    counts = np.array([len(x) for x in paths])
    rows = Segments.join([x.segments for x in paths])
    m, n = len(paths), len(rows)
    last = np.cumsum(counts) - 1
    first = last - counts + 1
    leaving, arriving = _seam_blends(rows[first], rows[last], size)
    begin, end = np.zeros(n), rows.lengths.copy()
    begin[first], end[last] = size, end[last] - size
    demands = ("speeds", "tolerances", "tags")
    parts = [
        *(x.replace(**{y: getattr(rows, y)[first] for y in demands}) for x in leaving),
        rows.cut(np.arange(n), begin, end),
        *(x.replace(**{y: getattr(rows, y)[last] for y in demands}) for x in arriving),
    ]
    # The rows of each path in `parts`: its two first arcs, its segments, its two last arcs.
    of = np.arange(m)
    start = first + 4 * of
    order = np.empty(n + 4 * m, dtype=np.intp)
    order[start], order[start + 1] = of, m + of
    order[np.arange(n) + 4 * np.repeat(of, counts) + 2] = 2 * m + np.arange(n)
    order[start + counts + 2], order[start + counts + 3] = 2 * m + n + of, 3 * m + n + of
    tables = Segments.join(parts)[order].split(np.append(start, n + 4 * m))
    new = [first_arc.lengths + second_arc.lengths for first_arc, second_arc in (leaving, arriving)]
    found = []
    for k, (path, table) in enumerate(zip(paths, tables, strict=True)):
        t, total = float(size[k]), path.length
        before = np.array([0.0, t, total - t, total])
        after = np.cumsum([0.0, new[0][k], total - 2 * t, new[1][k]])
        found.append((Path(segments=table, merged=path.merged), before, after))
    return found
