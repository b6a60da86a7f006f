"""Chaining of drawn entities to contours."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from armcontour.core.checks import LONGEST_NAME, BoolArray, FloatArray, IntArray
from armcontour.core.sampled_data import number_parts
from armcontour.core.text import list_some, shorten
from armcontour.geometry import Path, Segments
from armcontour.geometry.origins import entity_origins
from armcontour.geometry.projection import group_points, nearest_points
from armcontour.geometry.segments import REPEATED_POINT
from armcontour.program import Contour
from armcontour.program.offset_curves import find_self_crossing

# Two pieces are the same if their points differ by at most this [m].
SAME_PIECE = 1e-9
# Pieces are compared only if their features are equal after rounding to this grid [m].
FEATURE_GRID = 1e-8
# Gaps up to this [m] stay open, because closing them would change the tangents of short segments.
MAX_OPEN_GAP = 0.5 * REPEATED_POINT
# Two ends touch if their distance is less than this fraction of the tolerance.
TOUCHING_SHARE = 0.01
# Number of candidates per end for joining: those with the smallest turns, or the nearest ones.
MAX_CANDIDATES = 8
# Turns that differ by less than this [rad] are equal, so that the order of the pieces decides.
SAME_TURN = 1e-6
# Distance between layers in an additional coordinate [m], which is larger than any tolerance.
LAYER_DISTANCE = 1e9


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DrawnEntity:
    """The path of a drawn entity, or of a part of it (a piece)."""

    path: Path
    name: str  # Name of the entity in the drawing
    where: str  # Name of the entity for messages
    layer: str
    group: int = 0  # Group number; pieces with different group numbers are never chained


def chain_pieces(
    pieces: Sequence[DrawnEntity], tolerance: float, *, counted: bool = False
) -> tuple[list[Contour], list[str]]:
    """Chain pieces whose ends are closer than a tolerance; returns contours and notes.

    Only pieces of the same layer are chained. Pieces can be reversed. The first piece of a contour
    determines the direction, the name and the position in the order. With `counted`, contours are
    named by layer and number on it instead, such as `CUT-3`. Closed pieces are not joined to
    others. If more than two ends meet, ends that touch are joined before ends with a gap, then
    pairs with a smaller turn first, then earlier pieces first. A gap is closed at its middle: the
    end of a line is moved, and an arc is scaled and rotated without a change of its angle. If an
    arc would move too far, a short line closes the gap. No point moves by more than the tolerance.

    Pieces that coincide with others of their layer are omitted, as are contours whose width and
    height are at most the tolerance, and lines up to this length at which a contour that crosses
    itself turns back.

    Args:
        pieces: The pieces.
        tolerance: Largest distance of ends that are joined [m].
        counted: Whether contours are named by layer and number.
    """
    if not pieces:
        return [], []
    table = EntitySegments(
        segments=Segments.join([x.path.segments for x in pieces]),
        first=np.concatenate([[0], np.cumsum([len(x.path) for x in pieces])]),
    )
    layers = _layer_numbers(pieces)
    repeated = _find_repeated(pieces, table, layers)
    lengths = table.lengths
    ends = EntityEnds.from_segments(table, layers, repeated)
    partner = find_partners(ends, tolerance)
    coinciding = [pieces[i].name for i in np.flatnonzero(repeated).tolist()]
    # The exact box of a path is needed only if start and middle of its piece are close together.
    small = np.abs(table.middles - table.starts).max(axis=1) <= tolerance
    contours: list[Contour] = []
    too_small = []
    with_hooks = []
    counts = Counter[str]()
    for chain, closed in _chains(partner, repeated):
        first = pieces[min(chain) // 2]
        if lengths[np.array(chain) // 2].sum() <= tolerance:
            too_small.append(first.name)
            continue
        is_single = len(chain) == 1 and not closed
        path = first.path if is_single else table.join(chain, closed, tolerance)
        may_be_small = not is_single or small[chain[0] // 2]
        if may_be_small and np.ptp(path.segments.extent, axis=0).max() <= tolerance:
            too_small.append(first.name)
            continue
        without_hooks = _remove_hooks(path, tolerance)
        if without_hooks is not path:
            with_hooks.append(first.name)
        layer = first.layer
        counts[layer] += 1
        name = _counted_name(layer, counts[layer]) if counted else first.name
        if is_single:
            without_hooks = _of_first_entity(without_hooks)
        contours.append(
            Contour(
                path=without_hooks,
                name=name,
                number=len(contours) + 1,
                layer=layer,
                entities=tuple(pieces[x // 2].where for x in chain),
            )
        )
    limit = f"the join tolerance of {1e3 * tolerance:g} mm"
    reasons = {
        "Skipped because they coincide with others": coinciding,
        f"Skipped because they are not larger than {limit}": too_small,
        f"Removed lines up to {limit} at which the contour turns back": with_hooks,
    }
    return contours, [f"{why}: {list_some(x, 6)}." for why, x in reasons.items() if x]


def _of_first_entity(path: Path) -> Path:
    """Return a path whose segments all have the first entity as their origin."""
    origins = np.full(len(path), entity_origins(0), dtype=np.intp)
    return replace(path, segments=path.segments.replace(origins=origins, checked=True))


def _counted_name(layer: str, number: int) -> str:
    """Return the name of a contour by its layer and its number on it, such as `CUT-3`."""
    suffix = f"-{number}"
    return shorten(layer, LONGEST_NAME - len(suffix)) + suffix


def _layer_numbers(pieces: Sequence[DrawnEntity]) -> IntArray:
    """Number pieces by layer and group, (n,); pieces with equal numbers may be chained."""
    # A dictionary needs less memory than numpy, which stores all texts with the maximum length.
    numbers: dict[tuple[str, int], int] = {}
    return np.array(
        [numbers.setdefault((x.layer, x.group), len(numbers)) for x in pieces], dtype=np.intp
    )


def _chains(partner: IntArray, omitted: BoolArray) -> list[tuple[list[int], bool]]:
    """Return the entries of each chain, and whether the chain is closed.

    Entry 2 i is piece i forwards, 2 i + 1 piece i backwards. `partner` is that of `find_partners`.
    """
    partner_of_end = partner.tolist()
    is_used = omitted.tolist()
    chains = []
    for i in range(len(is_used)):
        if is_used[i]:
            continue
        # Find the start of the chain, or go once around a closed chain.
        entry = 2 * i
        while partner_of_end[entry] >= 0:
            entry = partner_of_end[entry] ^ 1
            if entry == 2 * i:
                break
        closed = partner_of_end[entry] >= 0
        chain = []
        while entry >= 0 and not is_used[entry // 2]:
            is_used[entry // 2] = True
            chain.append(entry)
            entry = partner_of_end[entry ^ 1]
        chains.append((chain, closed))
    return chains


def _find_repeated(
    pieces: Sequence[DrawnEntity], table: EntitySegments, layers: IntArray
) -> BoolArray:
    """Return the mask of the pieces that coincide with an earlier piece of their layer, (n,)."""
    n = len(pieces)
    feature = np.column_stack([table.starts + table.ends, table.middles, table.lengths])
    cell = np.column_stack([layers, np.round(feature / FEATURE_GRID)])
    group = np.unique(cell, axis=0, return_inverse=True)[1].ravel()
    order = np.argsort(group, kind="stable")
    runs = np.flatnonzero(np.diff(group[order], prepend=-1))
    repeated = np.zeros(n, dtype=bool)
    for run in np.split(order, runs[1:]):
        if len(run) > 1:
            first = pieces[run[0]].path
            repeated[run[1:]] = [_coincide(first, pieces[i].path) for i in run[1:]]
    return repeated


def _coincide(a: Path, b: Path) -> bool:
    """Return whether two paths are equal within `SAME_PIECE`, in the same or opposite direction."""
    # The paths can have different numbers of segments, so points at equal fractions are compared.
    fractions = np.linspace(0, 1, 2 * max(len(a), len(b)) + 5)
    one = a(fractions * a.length)
    other = b(fractions * b.length)
    return any(float(np.abs(one - x).max(initial=0.0)) <= SAME_PIECE for x in (other, other[::-1]))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EntitySegments:
    """The segments of all pieces in one table."""

    segments: Segments
    # Index of each piece's first segment, and the total number of segments, (pieces + 1,).
    first: IntArray

    @property
    def starts(self) -> FloatArray:
        """Start points of the pieces [m], (pieces, dimension)."""
        return self.segments.starts[self.first[:-1]]

    @property
    def ends(self) -> FloatArray:
        """End points of the pieces [m], (pieces, dimension)."""
        return self.segments[self.first[1:] - 1].ends

    @property
    def tangents(self) -> FloatArray:
        """Unit tangents at the start points of the pieces, (pieces, dimension)."""
        return self.segments.tangents[self.first[:-1]]

    @property
    def end_tangents(self) -> FloatArray:
        """Unit tangents at the end points of the pieces, (pieces, dimension)."""
        return self.segments[self.first[1:] - 1].end_tangents

    @property
    def lengths(self) -> FloatArray:
        """Lengths of the pieces [m], (pieces,)."""
        return np.asarray(np.add.reduceat(self.segments.lengths, self.first[:-1]))

    @property
    def middles(self) -> FloatArray:
        """Points of the pieces at half of their lengths [m], (pieces, dimension)."""
        breaks = self.segments.breaks
        half = breaks[self.first[:-1]] + self.lengths / 2
        i = np.clip(np.searchsorted(breaks, half) - 1, self.first[:-1], self.first[1:] - 1)
        return self.segments.evaluate(i, np.clip(half - breaks[i], 0.0, self.segments.lengths[i]))

    def join(self, entries: Sequence[int], closed: bool, tolerance: float) -> Path:
        """Return the path through pieces in a given order, with the gaps between them closed.

        The origins of its segments are the positions of their pieces in this order.

        - `entries`: entry 2 i is piece i forwards, 2 i + 1 piece i backwards.
        - `closed`: whether the last piece is joined to the first.
        - `tolerance`: largest distance by which a point may move [m].
        """
        entered = np.asarray(entries, dtype=np.intp)
        piece = entered // 2
        backwards = entered % 2 == 1
        count = self.first[piece + 1] - self.first[piece]
        entry, within = number_parts(count)
        base = np.where(backwards, self.first[piece + 1] - 1, self.first[piece])
        rows = self.segments.reverse_rows(
            base[entry] + np.where(backwards, -1, 1)[entry] * within, backwards[entry]
        )
        rows = rows.replace(origins=entity_origins(entry))
        start = np.cumsum(count) - count
        return _join_rows(rows, start if closed else start[1:], tolerance)


def _join_rows(rows: Segments, vertices: IntArray, tolerance: float) -> Path:
    """Return the path of segments, with the gaps before the segments `vertices` closed."""
    ends = rows.ends
    gaps = np.linalg.norm(ends[vertices - 1] - rows.starts[vertices], axis=1)
    wide = gaps > MAX_OPEN_GAP
    return Path(segments=_close_gaps(rows, ends, vertices[wide], tolerance) if wide.any() else rows)


def _remove_hooks(path: Path, tolerance: float) -> Path:
    """Remove lines up to the tolerance [m] at which a path that crosses itself turns back."""
    rows = path.segments
    if not np.any((rows.curvatures == 0) & (rows.lengths <= tolerance)):
        return path
    # Whether the path turns back at the end of each segment.
    turns_back = np.sum(rows.end_tangents * np.roll(rows.tangents, -1, axis=0), axis=1) < 0
    turns_back[-1] &= rows.closed
    is_short_line = (rows.curvatures == 0) & (rows.lengths <= tolerance)
    is_hook = is_short_line & (turns_back | np.roll(turns_back, 1))
    # A longer sequence of such lines is a part of the drawing.
    sequence = np.cumsum(~is_hook)
    is_hook &= np.bincount(sequence, rows.lengths * is_hook)[sequence] <= tolerance
    stays = is_hook.all() or not is_hook.any() or rows.dimension == 3
    if stays or find_self_crossing(rows, closed=rows.closed) is None:
        return path
    vertices = np.arange(0 if rows.closed else 1, np.sum(~is_hook))
    return _join_rows(rows[~is_hook], vertices, tolerance)


def _close_gaps(rows: Segments, ends: FloatArray, vertices: IntArray, tolerance: float) -> Segments:
    """Close the gaps before the segments `vertices`: both ends are moved to the middle of the gap.

    An arc that would move by more than the tolerance [m] is not moved, but connected by lines.
    """
    to_start = rows.starts.copy()
    to_end = ends.copy()
    middle = (ends[vertices - 1] + rows.starts[vertices]) / 2
    to_start[vertices] = to_end[vertices - 1] = middle
    changed = np.zeros(len(rows), dtype=bool)
    changed[vertices] = changed[vertices - 1] = True
    line = changed & (rows.curvatures == 0)
    arc = changed & (rows.curvatures > 0)
    stays = arc.copy()
    stays[arc] = _shift(rows[arc], ends[arc], to_start[arc], to_end[arc]) > tolerance
    moves = arc & ~stays
    moved = rows.replace_rows(line, _connect(rows[line], to_start[line], to_end[line]))
    if moves.any():
        moved = moved.replace_rows(
            moves, _stretch(rows[moves], ends[moves], to_start[moves], to_end[moves])
        )
    # Lines connect an arc that is not moved to the middles of the gaps before and after the arc.
    # Lines without length are omitted.
    before = _connect(rows, to_start, rows.starts)
    after = _connect(rows, ends, to_end)
    used = [
        stays & (before.lengths > REPEATED_POINT),
        ~line | (moved.lengths > REPEATED_POINT),
        stays & (after.lengths > REPEATED_POINT),
    ]
    in_order = np.arange(3 * len(rows)).reshape(3, -1).T[np.column_stack(used)]
    return Segments.join([before, moved, after])[in_order]


def _connect(rows: Segments, starts: FloatArray, ends: FloatArray) -> Segments:
    """Return the lines between points, with the speeds and tolerances of the given segments."""
    chords = ends - starts
    lengths = np.linalg.norm(chords, axis=1)
    return rows.replace(
        starts=starts,
        tangents=chords / np.where(lengths > 0, lengths, 1.0)[:, None],
        normals=np.zeros_like(chords),
        curvatures=np.zeros(len(rows)),
        lengths=lengths,
    )


def _shift(
    arcs: Segments, ends: FloatArray, to_start: FloatArray, to_end: FloatArray
) -> FloatArray:
    """Return each arc's largest displacement if `_stretch` moves its ends [m], (n,)."""
    at_start = to_start - arcs.starts
    at_end = to_end - ends
    chord = np.linalg.norm(ends - arcs.starts, axis=1)
    reach = np.where(arcs.curvatures * arcs.lengths < np.pi, chord, 2 / arcs.curvatures)
    with np.errstate(divide="ignore", invalid="ignore"):
        change = np.linalg.norm(at_end - at_start, axis=1) / chord
        shift = np.linalg.norm(at_start, axis=1) + change * reach
    # The estimate is valid only for a small relative change of the chord.
    return np.where(change < 0.5, shift, np.inf)


def _stretch(
    arcs: Segments, ends: FloatArray, to_start: FloatArray, to_end: FloatArray
) -> Segments:
    """Scale and rotate arcs to new end points without a change of their swept angles.

    - `ends`: end points of the arcs [m], (n, dimension).
    - `to_start`, `to_end`: new start and end points [m], (n, dimension).
    """
    chords = ends - arcs.starts
    new_chords = to_end - to_start
    size = np.linalg.norm(chords, axis=1)
    new_size = np.linalg.norm(new_chords, axis=1)
    a = chords / size[:, None]
    b = new_chords / new_size[:, None]
    scale = new_size / size

    def rotate(v: FloatArray) -> FloatArray:
        """Rotate unit vectors v by the smallest rotation from a to b, (n, dimension)."""
        part = np.sum((a + b) * v, axis=1) / (1 + np.sum(a * b, axis=1))
        v = v - part[:, None] * (a + b) + 2 * np.sum(a * v, axis=1)[:, None] * b
        return np.asarray(v / np.linalg.norm(v, axis=1)[:, None])

    return arcs.replace(
        starts=to_start,
        tangents=rotate(arcs.tangents),
        normals=rotate(arcs.normals),
        curvatures=arcs.curvatures / scale,
        lengths=arcs.lengths * scale,
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EntityEnds:
    """The ends of all pieces: end 2 i is the start of piece i, end 2 i + 1 is its end point."""

    points: FloatArray  # Points of the ends [m], (2 n, dimension)
    inwards: FloatArray  # Unit tangents at the ends that point into the piece, same shape
    layers: IntArray  # Number of the layer and group of each end, (2 n,)
    lengths: FloatArray  # Lengths of the pieces [m], (n,)
    closed: BoolArray  # Mask of the pieces whose ends are one point, (n,)
    free: BoolArray  # Mask of the ends that may be joined, (2 n,)

    @classmethod
    def from_segments(
        cls, pieces: EntitySegments, layers: IntArray, omitted: BoolArray
    ) -> EntityEnds:
        """Return the ends of pieces.

        Ends of closed pieces and of omitted pieces are not free.

        - `layers`: number of the layer and group of each piece, (n,).
        - `omitted`: mask of the pieces that are omitted, (n,).
        """

        def alternate(a: FloatArray, b: FloatArray) -> FloatArray:
            """Return the rows of both arrays in turns, (2 n, dimension)."""
            return np.stack([a, b], axis=1).reshape(-1, a.shape[1])

        start, end = pieces.starts, pieces.ends
        closed = np.linalg.norm(end - start, axis=1) <= REPEATED_POINT
        return cls(
            points=alternate(start, end),
            inwards=alternate(pieces.tangents, -pieces.end_tangents),
            layers=np.repeat(layers, 2),
            lengths=pieces.lengths,
            closed=closed,
            free=np.repeat(~(closed | omitted), 2),
        )


def find_partners(ends: EntityEnds, tolerance: float) -> IntArray:
    """Return the end to which each end is joined, (2 n,); -1 for an end that is not joined.

    `tolerance`: largest distance of ends that are joined [m].
    """
    # Ends at the same point are joined first, then ends that touch, then ends with a gap.
    partner = np.full(len(ends.points), -1, dtype=np.intp)
    for distance in (REPEATED_POINT, TOUCHING_SHARE * tolerance, tolerance):
        free = np.flatnonzero(ends.free & (partner < 0))
        if len(free) > 1:
            find_candidates = _near_pairs if distance == tolerance else _touching_pairs
            _join_ends(ends, partner, find_candidates(ends, free, distance), tolerance)
    return partner


def _join_ends(ends: EntityEnds, partner: IntArray, candidates: IntArray, tolerance: float) -> None:
    """Join candidate pairs, (m, 2), of free ends in the order of their turns; writes `partner`."""
    a, b = candidates.min(axis=1), candidates.max(axis=1)
    gap = np.linalg.norm(ends.points[a] - ends.points[b], axis=1)
    # The ends of one piece are joined only if the piece is longer than the tolerance.
    allowed = (a != b) & (ends.layers[a] == ends.layers[b]) & (gap < tolerance)
    allowed &= (a // 2 != b // 2) | (ends.lengths[a // 2] > tolerance)
    a, b = a[allowed], b[allowed]
    # The turn is the angle between the tangents. The formula for its half is accurate near zero.
    u, v = ends.inwards[a], ends.inwards[b]
    turn = 2 * np.arctan2(np.linalg.norm(u + v, axis=1), np.linalg.norm(u - v, axis=1))
    order = np.lexsort([b, a, np.round(turn / SAME_TURN)])
    is_joined = (partner >= 0).tolist()
    for i, j in zip(a[order].tolist(), b[order].tolist(), strict=True):
        if not (is_joined[i] or is_joined[j]):
            is_joined[i] = is_joined[j] = True
            partner[i] = j
            partner[j] = i


def _touching_pairs(ends: EntityEnds, free: IntArray, near: float) -> IntArray:
    """Return the pairs of free ends that touch, with the smallest turns for each end, (m, 2)."""
    # Ends in one cell of a grid are merged, so that many ends at one point cause few pairs.
    keys = np.column_stack([ends.layers[free], np.round(ends.points[free] / (near / 2))])
    _, first, cell = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    centres = np.column_stack([ends.layers[free][first] * LAYER_DISTANCE, ends.points[free][first]])
    vertex = group_points(centres, near)[cell.ravel()]
    has_neighbour = np.bincount(vertex)[vertex] > 1
    free = free[has_neighbour]
    vertex = vertex[has_neighbour]
    return _pairs(free, *_smallest_turns(vertex, ends.inwards[free]))


def _smallest_turns(vertex: IntArray, inwards: FloatArray) -> tuple[IntArray, IntArray]:
    """Return for each end its pairs with ends at the same vertex that have the smallest turns.

    - `vertex`: number of the vertex of each end, (n,).
    - `inwards`: unit tangents at the ends that point into the pieces, (n, dimension).

    The result is the index of the first and of the second end of each pair, (m,) each.
    """
    if len(vertex) == 0:
        return np.empty(0, dtype=np.intp), np.empty(0, dtype=np.intp)
    # The first coordinates of ends at different vertices differ by at least 4. At the same vertex,
    # the distance is that of the tangents, which is at most 2. Therefore a neighbour within 3 is at
    # the same vertex.
    points, opposite = (np.column_stack([4.0 * vertex, x]) for x in (inwards, -inwards))
    count = min(MAX_CANDIDATES + 1, len(vertex))
    return _drop_missing(nearest_points(opposite, points, count, 3.0), len(vertex))


def _near_pairs(ends: EntityEnds, free: IntArray, near: float) -> IntArray:
    """Return the pairs of free ends within the distance `near` [m], (m, 2).

    Each end has pairs with at most MAX_CANDIDATES nearest ends.
    """
    points = np.column_stack([ends.layers[free] * LAYER_DISTANCE, ends.points[free]])
    count = min(MAX_CANDIDATES + 1, len(free))
    return _pairs(free, *_drop_missing(nearest_points(points, points, count, near), len(free)))


def _drop_missing(neighbours: IntArray, n: int) -> tuple[IntArray, IntArray]:
    """Return indices of points and neighbours without the entries n, which are no neighbours."""
    i = np.repeat(np.arange(n), neighbours.shape[1])
    k = neighbours.ravel()
    return i[k < n], k[k < n]


def _pairs(free: IntArray, a: IntArray, b: IntArray) -> IntArray:
    """Return the sorted unique pairs of ends, (m, 2), from indices `a` and `b` into `free`."""
    return np.unique(np.sort(np.column_stack([free[a], free[b]]), axis=1), axis=0)
