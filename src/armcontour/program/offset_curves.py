"""Exact offsets of lines and arcs in the plane.

Points at distance d from a contour, on one of its sides, lie on its offset segments or on circles
around its vertices. These segments and circles are cut where they meet. The parts whose distance
from the whole contour is at least d form the offset.

A table of pieces has a row for each line or arc; its columns are named below.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.core.sampled_data import number_parts
from armcontour.geometry.projection import find_nearest, group_points
from armcontour.geometry.segments import Segments

# Points closer than this distance [m] count as equal.
SAME_POINT = 1e-9
# About this number of piece pairs are intersected together, to limit the memory.
PAIRS_AT_ONCE = 200_000

# Columns of a piece table: start x, y, unit tangent x, y, curvature (positive to the left) and
# length.
X, Y, TX, TY, CURVATURE, LENGTH = range(6)
# Rounding error of the distance between a part and the contour [m]. Points of a path have errors up
# to REPEATED_POINT.
SLACK = 3e-9
# Gaps wider than this are narrowed [m], because gaps of a path must not exceed REPEATED_POINT.
WIDE_GAP = 0.9e-9
# Width to which gaps wider than WIDE_GAP are narrowed [m].
NARROW_GAP = 0.5e-9
# A closed part with a smaller ratio of area to length [m] consists of coinciding lines.
THIN = 1e-8


def points_at(pieces: FloatArray, u: FloatArray, order: int = 0) -> FloatArray:
    """Return points of pieces, or their tangents, at distances u along them, (n, 2).

    - `u`: distances from the starts of the pieces [m], (n,).
    - `order`: 0 for the points [m], 1 for the unit tangents.
    """
    angle = pieces[:, CURVATURE] * u
    tangents = pieces[:, TX : TY + 1]
    normals = rotate_left(tangents)
    if order == 1:
        return np.asarray(np.cos(angle)[:, None] * tangents + np.sin(angle)[:, None] * normals)
    along = u * np.sinc(angle / np.pi)
    across = u * (angle / 2) * np.sinc(angle / (2 * np.pi)) ** 2
    return np.asarray(pieces[:, :2] + along[:, None] * tangents + across[:, None] * normals)


def offset_pieces(pieces: FloatArray, d: float) -> FloatArray:
    """Offset pieces by d to the left [m], (n, 6); length <= 0 if a radius became negative.

    The offset of an arc has the same centre.
    """
    offset = pieces.copy()
    # Ratio of the new radius, and of the new length, to the old one.
    ratio = 1 - pieces[:, CURVATURE] * d
    offset[:, :2] += d * rotate_left(pieces[:, TX : TY + 1])
    offset[:, CURVATURE] /= np.where(ratio > 0, ratio, 1.0)
    offset[:, LENGTH] *= ratio
    return offset


def turns_between(arriving: FloatArray, leaving: FloatArray) -> FloatArray:
    """Return angles from arriving to leaving tangents, positive to the left [rad], (n,)."""
    return np.asarray(np.arctan2(_cross(arriving, leaving), (arriving * leaving).sum(axis=1)))


@np.errstate(divide="ignore", invalid="ignore")  # The radius of a line is 1 / 0.
def find_crossings(pieces: FloatArray) -> tuple[IntArray, FloatArray]:
    """Find all points at which pieces cross or touch each other, including their ends.

    Returns the indices of both pieces at each point, (m, 2), and the distances of the point along
    both pieces [m], (m, 2).
    """
    low, high = _boxes(pieces)
    # In the order along an axis, the box of a piece can overlap only the boxes up to the first box
    # that starts beyond it. The axis is the one on which boxes overlap less.
    span = high.max(axis=0, initial=-np.inf) - low.min(axis=0, initial=np.inf)
    axis = int(np.argmin((high - low + SAME_POINT).sum(axis=0) / (span + SAME_POINT)))
    start, end = low[:, axis], high[:, axis]
    order = np.argsort(start)
    last = np.searchsorted(start[order], end[order] + SAME_POINT, side="right")
    count = np.maximum(last - np.arange(len(order)) - 1, 0)
    parts = np.cumsum(count) // PAIRS_AT_ONCE
    meetings = [np.empty((0, 2), np.intp)]
    distances = [np.empty((0, 2))]
    for part in np.unique(parts):
        owner, number = number_parts(np.where(parts == part, count, 0))
        i = order[owner]
        j = order[owner + 1 + number]
        near = (np.maximum(low[i], low[j]) <= np.minimum(high[i], high[j]) + SAME_POINT).all(axis=1)
        pairs = np.stack([i, j], axis=1)[near]
        points = _common_points(pieces[pairs[:, 0]], pieces[pairs[:, 1]])
        along = np.stack([_distances_along(pieces[x], points) for x in pairs.T], axis=2)
        ends = pieces[pairs, LENGTH][:, None, :]
        row, point = np.nonzero(((along >= -SAME_POINT) & (along <= ends + SAME_POINT)).all(axis=2))
        along = along[row, point]
        ends = ends[row, 0]
        # A point near the end of a piece is moved to this end.
        along = np.where(ends - along <= SAME_POINT, ends, along)
        meetings.append(pairs[row])
        distances.append(np.where(along <= SAME_POINT, 0.0, along))
    return np.concatenate(meetings), np.concatenate(distances)


def rotate_left(vectors: FloatArray) -> FloatArray:
    """Turn vectors to the left by a right angle, (..., 2)."""
    return np.stack([-vectors[..., 1], vectors[..., 0]], axis=-1)


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the cross products of plane vectors (..., 2), which are scalars, (...,)."""
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def _boxes(pieces: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return lower and upper corners of boxes around pieces, (n, 2) each."""
    radius = 1 / pieces[:, CURVATURE]
    centers = pieces[:, :2] + radius[:, None] * rotate_left(pieces[:, TX : TY + 1])
    radii = np.abs(radius)
    sides = centers[:, None] + radii[:, None, None] * [[1, 0], [-1, 0], [0, 1], [0, -1]]
    on_arc = _distances_along(pieces, sides) <= pieces[:, LENGTH, None]
    on_arc &= pieces[:, CURVATURE, None] != 0
    starts = pieces[:, None, :2]
    ends = points_at(pieces, pieces[:, LENGTH])[:, None]
    points = np.concatenate([starts, ends, np.where(on_arc[:, :, None], sides, starts)], axis=1)
    return points.min(axis=1), points.max(axis=1)


def _distances_along(pieces: FloatArray, points: FloatArray) -> FloatArray:
    """Return the distances of points (n, m, 2) along n extended pieces [m], (n, m)."""
    offset = points - pieces[:, None, :2]
    tangents = pieces[:, None, TX : TY + 1]
    along = (offset * tangents).sum(axis=2)
    k = pieces[:, CURVATURE, None]
    # Angle around the centre, 0 at the start and increasing along the arc.
    angle = np.arctan2(along * np.abs(k), 1 - _cross(tangents, offset) * k)
    radius = 1 / np.where(k == 0, np.inf, np.abs(k))
    u = angle * radius
    turn = 2 * np.pi * radius
    # A point just before the start has a small negative distance, not nearly a full turn. For a
    # large radius, a full turn has no digits for this distance.
    before = (u >= -SAME_POINT) & (turn + u > pieces[:, LENGTH, None])
    return np.asarray(np.where(k == 0, along, np.where((u < 0) & ~before, u + turn, u)))


def _common_points(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the points that pairs of extended pieces share [m], (n, 4, 2), or NaN.

    A line or circle through the origin with curvature k and left normal n there consists of the
    points x with k x.x / 2 = n.x. The difference of two such equations is the straight line w.x =
    r. This method uses neither centres nor radii, so nearly straight arcs lose no digits. Where
    pieces coincide, the result is their ends. The piece with more curvature is `a`.
    """
    swapped = (np.abs(b[:, CURVATURE]) > np.abs(a[:, CURVATURE]))[:, None]
    a, b = np.where(swapped, b, a), np.where(swapped, a, b)
    ka = a[:, CURVATURE]
    kb = b[:, CURVATURE]
    na = rotate_left(a[:, TX : TY + 1])
    nb = rotate_left(b[:, TX : TY + 1])
    gap = b[:, :2] - a[:, :2]
    ratio = kb / np.where(ka == 0, 1.0, ka)
    w = nb + kb[:, None] * gap - ratio[:, None] * na
    r = kb * (gap * gap).sum(axis=1) / 2 + (nb * gap).sum(axis=1)
    size = np.hypot(w[:, 0], w[:, 1])
    foot = (r / size**2)[:, None] * w
    along = rotate_left(w) / size[:, None]
    slope = (na * along).sum(axis=1)
    constant = ka * (foot * foot).sum(axis=1) / 2 - (na * foot).sum(axis=1)
    # The common points are foot + s along with ka s² / 2 - slope s + constant = 0. Rounding errors
    # can make the discriminant slightly negative where pieces touch.
    discriminant = slope**2 - 2 * ka * constant
    discriminant[discriminant < -2 * np.abs(ka) * SAME_POINT / size] = np.nan
    # Lines that depart from each other by less than SAME_POINT count as parallel.
    parallel = (ka == 0) & (np.abs(slope) * a[:, LENGTH] < SAME_POINT)
    slope = np.where(parallel, np.nan, slope)
    # The solution of larger magnitude, and from it the other one, without cancellation.
    larger = slope + np.copysign(np.sqrt(np.maximum(discriminant, 0.0)), slope)
    second = np.where(ka == 0, np.nan, larger / ka)
    first = np.where(discriminant > 0, 2 * constant / larger, second)
    points = np.full((len(a), 4, 2), np.nan)
    for i, s in enumerate((first, second)):
        points[:, i] = a[:, :2] + foot + s[:, None] * along
    one_circle = (size <= np.abs(kb) * SAME_POINT) & (
        np.abs(1 / ka) - np.abs(1 / kb) >= -SAME_POINT
    )
    coincide = np.where(ka == 0, parallel & (np.abs(constant) <= SAME_POINT), one_circle)
    ends: list[FloatArray] = []
    for pieces in (a[coincide], b[coincide]):
        ends += [pieces[:, :2], points_at(pieces, pieces[:, LENGTH])]
    points[coincide] = np.stack(ends, axis=1)
    return points


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OffsetPart:
    """A continuous part of an offset."""

    segments: Segments
    # Index of the source segment of each segment; for an arc around a vertex, index of the source
    # segment before the vertex, (n,)
    rows: IntArray
    closed: bool  # True if the part is closed


def offset_segments(source: Segments, distance: float, *, closed: bool) -> list[OffsetPart]:
    """Return the parts of a plane contour's offset, in its direction of travel.

    The list is empty if no point on this side has this distance from the contour.

    - `source`: the contour, which does not cross itself.
    - `distance`: the offset, to the left if positive [m].
    - `closed`: true if the contour is closed.
    """
    if distance == 0:
        return [OffsetPart(segments=source, rows=np.arange(len(source)), closed=closed)]
    mirror = np.array([1.0, np.sign(distance)])
    pieces, rows = _raw_pieces(to_pieces(source, mirror), abs(distance), closed)
    if not len(pieces):
        return []
    knives = np.empty((0, 6))
    if not closed:
        # The offset on the other side of an open contour, and circles around its ends, also cut the
        # parts.
        other, _ = _raw_pieces(to_pieces(source, mirror * [1, -1]), abs(distance), closed)
        ends = _end_circles(pieces, abs(distance))
        knives = np.concatenate([other * [1, -1, 1, -1, -1, 1], ends])
    parts = _cut_pieces(pieces, rows, knives)
    middles = points_at(parts.pieces, parts.pieces[:, LENGTH] / 2)
    clear = find_nearest(source, middles * mirror).distance >= abs(distance) - SLACK
    parts = parts.select(clear)
    parts = parts.without_dead_ends(
        None if closed else points_at(pieces[[0, -1]], pieces[[0, -1], LENGTH] * [0, 1])
    )
    return [_to_offset_part(x, ring, mirror) for x, ring in parts.chains()]


def find_self_crossing(source: Segments, *, closed: bool) -> FloatArray | None:
    """Find a point at which a plane path crosses or touches itself [m]; None without one."""
    table = to_pieces(source)
    # Without pieces that are points, the pieces before and after them are neighbours.
    table = table[table[:, LENGTH] > SAME_POINT]
    pairs, distances = find_crossings(table)
    n = len(table)
    ahead = (pairs[:, 1] - pairs[:, 0]) % n == 1
    behind = (pairs[:, 0] - pairs[:, 1]) % n == 1
    lengths = table[pairs, LENGTH]
    at_start = distances <= 2 * SAME_POINT
    at_end = distances >= lengths - 2 * SAME_POINT
    # Neighbours meet where one ends and the next one starts.
    is_joint = (ahead & at_end[:, 0] & at_start[:, 1]) | (behind & at_start[:, 0] & at_end[:, 1])
    if not closed:
        # The first and the last piece of an open path are no neighbours.
        is_joint &= ~(pairs.min(axis=1) == 0) | ~(pairs.max(axis=1) == n - 1) | (n == 2)
    if is_joint.all():
        return None
    k = int(np.argmin(is_joint))
    return np.asarray(points_at(table[pairs[k, :1]], distances[k, :1])[0])


def has_no_area(source: Segments) -> bool:
    """Return whether the area of a closed path in the plane is zero, except for rounding errors."""
    return _encloses_no_area(to_pieces(source))


def _encloses_no_area(pieces: FloatArray) -> bool:
    """Return whether a closed chain of pieces encloses no area, except for rounding errors."""
    starts = pieces[:, :2] - pieces[0, :2]
    ends = points_at(pieces, pieces[:, LENGTH]) - pieces[0, :2]
    # Twice the area of the polygon of the chords, and of the segments between chords and arcs.
    polygon = starts[:, 0] * ends[:, 1] - starts[:, 1] * ends[:, 0]
    curvatures = pieces[:, CURVATURE]
    angle = curvatures * pieces[:, LENGTH]
    bent = curvatures != 0
    radius = 1 / np.where(bent, curvatures, 1.0)
    circular_segments = np.where(bent, radius**2 * (angle - np.sin(angle)), 0.0)
    area = float(np.sum(polygon + circular_segments)) / 2
    return abs(area) <= THIN * float(pieces[:, LENGTH].sum())


def find_crossing_paths(paths: Sequence[Segments]) -> tuple[int, int] | None:
    """Find two plane paths that cross or touch each other; returns indices, or None."""
    table = np.concatenate([to_pieces(x) for x in paths])
    owner = np.repeat(np.arange(len(paths)), [len(x) for x in paths])
    pairs = owner[find_crossings(table)[0]]
    meet = pairs[pairs[:, 0] != pairs[:, 1]]
    return None if not len(meet) else (int(meet[0].min()), int(meet[0].max()))


def to_pieces(source: Segments, mirror: FloatArray | float = 1.0) -> FloatArray:
    """Return a plane path as a table of pieces, (n, 6).

    - `mirror`: factors of the coordinates, 1 or -1, (2,).
    """
    starts = source.starts * mirror
    tangents = source.tangents * mirror
    normals = source.normals * mirror
    turn = np.sign(tangents[:, 0] * normals[:, 1] - tangents[:, 1] * normals[:, 0])
    return np.column_stack([starts, tangents, turn * source.curvatures, source.lengths])


def _raw_pieces(table: FloatArray, d: float, closed: bool) -> tuple[FloatArray, IntArray]:
    """Return the offsets of pieces to the left, and arcs around their vertices, before cuts.

    The second result is the index of the source piece of each of them, (m,); see
    `OffsetPart.rows`.

    - `table`: pieces of the contour, (n, 6).
    - `d`: the offset [m].
    """
    n = len(table)
    offset = offset_pieces(table, d)
    # An arc to the left with a radius below d has no offset, because its points are nearer than d
    # to the arc.
    segment_mask = offset[:, LENGTH] > SAME_POINT
    ends = points_at(table, table[:, LENGTH])
    leaving = points_at(table, table[:, LENGTH], 1)
    turn = turns_between(leaving, np.roll(table, -1, axis=0)[:, TX : TY + 1])
    # Where the contour turns back by 180°, the vertex counts as an outside corner on both sides.
    turn = np.where(turn > np.pi - SAME_POINT, -np.pi, turn)
    vertex_arcs = np.column_stack(
        [ends + d * rotate_left(leaving), leaving, np.full(n, -1 / d), -turn * d]
    )
    arc_mask = vertex_arcs[:, LENGTH] > SAME_POINT
    if not closed:
        arc_mask[-1] = False
    both = np.stack([offset, vertex_arcs], axis=1).reshape(-1, 6)
    mask = np.stack([segment_mask, arc_mask], axis=1).reshape(-1)
    return both[mask], np.repeat(np.arange(n), 2)[mask]


class _Parts(NamedTuple):
    """The n parts into which pieces are cut where they meet."""

    pieces: FloatArray  # The parts as a table of pieces, (n, 6)
    rows: IntArray  # Index of the source segment of each part, (n,)
    owners: IntArray  # Index of the piece to which each part belongs, (n,)
    nodes: IntArray  # Numbers of the points at which each part starts and ends, (n, 2)

    def select(self, mask: BoolArray | IntArray) -> _Parts:
        """Select parts by a mask or by indices."""
        return _Parts._make(x[mask] for x in self)

    def without_dead_ends(self, ends: FloatArray | None) -> _Parts:
        """Discard parts that lead nowhere; an open offset starts and ends at `ends`, (2, 2)."""
        parts = self
        while len(parts.pieces):
            starts = parts.nodes[:, 0]
            stops = parts.nodes[:, 1]
            has_previous = np.isin(starts, stops)
            has_next = np.isin(stops, starts)
            if ends is not None:
                first = np.linalg.norm(parts.pieces[:, :2] - ends[0], axis=1) <= SAME_POINT
                tips = points_at(parts.pieces, parts.pieces[:, LENGTH])
                has_previous |= first
                has_next |= np.linalg.norm(tips - ends[1], axis=1) <= SAME_POINT
            mask = has_previous & has_next
            if mask.all():
                break
            parts = parts.select(mask)
        return parts

    def chains(self) -> list[tuple[_Parts, bool]]:
        """List the chains of consecutive parts, each with true if it is closed."""
        leaving: dict[int, list[int]] = {}
        for i, node in enumerate(self.nodes[:, 0].tolist()):
            leaving.setdefault(node, []).append(i)
        arriving = set(self.nodes[:, 1].tolist())
        # Open chains, which start at nodes without an arriving part, come first.
        order = np.argsort([x in arriving for x in self.nodes[:, 0].tolist()], kind="stable")
        used = np.zeros(len(self.pieces), dtype=bool)
        end_tangents = points_at(self.pieces, self.pieces[:, LENGTH], 1)
        chains = []
        for start in order.tolist():
            chain: list[int] = []
            part: int | None = start
            while part is not None and not used[part]:
                used[part] = True
                chain.append(part)
                next_parts = [k for k in leaving.get(int(self.nodes[part, 1]), ()) if not used[k]]
                # Where several parts continue, the chain turns to the left as much as possible.
                part = min(
                    next_parts, key=partial(self._right_turn, end_tangents[part]), default=None
                )
            if chain:
                closes = self.nodes[chain[-1], 1] == self.nodes[chain[0], 0]
                chains.append((self.select(np.array(chain)), bool(closes)))
        return [(x._merge_pieces(ring), ring) for x, ring in chains if not (ring and x._is_thin())]

    def _right_turn(self, tangent: FloatArray, k: int) -> float:
        """Return how far the path turns to the right from `tangent` into part k [rad]."""
        tx = self.pieces[k, TX]
        ty = self.pieces[k, TY]
        return -float(
            np.arctan2(tangent[0] * ty - tangent[1] * tx, tangent[0] * tx + tangent[1] * ty)
        )

    def _is_thin(self) -> bool:
        """Return whether the area of a closed chain is zero, except for rounding errors."""
        return _encloses_no_area(self.pieces)

    def _merge_pieces(self, ring: bool) -> _Parts:
        """Merge consecutive parts of a chain that belong to one piece."""
        chain = self
        if ring and len(chain.pieces) > 1:
            # Start the chain at the start of a piece.
            changes = chain.owners != np.roll(chain.owners, 1)
            if changes.any():
                first = int(np.argmax(changes & (chain.owners == chain.owners[changes].min())))
                chain = chain.select(np.roll(np.arange(len(chain.pieces)), -first))
        begins = np.append(True, chain.owners[1:] != chain.owners[:-1])
        group = np.cumsum(begins) - 1
        merged = chain.select(begins)
        pieces = merged.pieces.copy()
        pieces[:, LENGTH] = np.bincount(group, weights=chain.pieces[:, LENGTH])
        return merged._replace(pieces=pieces)


def _end_circles(pieces: FloatArray, d: float) -> FloatArray:
    """Return half circles around both ends of an open contour, as two pieces each, (4, 6).

    - `pieces`: offset pieces of the contour.
    - `d`: radius of the half circles [m].
    """
    ends = points_at(pieces[[0, -1]], pieces[[0, -1], LENGTH] * [0, 1])
    leaving = points_at(pieces[[0, -1]], pieces[[0, -1], LENGTH] * [0, 1], 1)
    across = 2 * d * np.column_stack([leaving[:, 1], -leaving[:, 0]])
    halves = [(ends, leaving), (ends + across, -leaving)]
    columns = np.tile([-1 / d, np.pi * d], (2, 1))
    return np.concatenate([np.column_stack([a, b, columns]) for a, b in halves])


def _cut_pieces(pieces: FloatArray, rows: IntArray, knives: FloatArray) -> _Parts:
    """Return the parts into which pieces are cut where they meet; ends at one point share a node.

    - `rows`: index of the source segment of each piece, (n,).
    - `knives`: further pieces, which also cut the pieces, (k, 6).
    """
    n = len(pieces)
    pairs, pair_distances = find_crossings(np.concatenate([pieces, knives]))
    owners = np.concatenate([np.arange(n), np.arange(n), pairs.reshape(-1)])
    distances = np.concatenate([np.zeros(n), pieces[:, LENGTH], pair_distances.reshape(-1)])
    # Sort the cuts of each piece along it. A part lies between two neighbouring cuts.
    order = np.lexsort((distances, owners))
    order = order[owners[order] < n]
    owners = owners[order]
    distances = distances[order]
    is_part = (owners[1:] == owners[:-1]) & (np.diff(distances) > SAME_POINT / 2)
    first = np.nonzero(is_part)[0]
    last = first + 1
    source = owners[first]
    parts = pieces[source].copy()
    parts[:, :2] = points_at(pieces[source], distances[first])
    parts[:, [TX, TY]] = points_at(pieces[source], distances[first], 1)
    parts[:, LENGTH] = distances[last] - distances[first]
    points = np.concatenate([parts[:, :2], points_at(pieces[source], distances[last])])
    # Both pieces at a crossing can end up to SAME_POINT away from it.
    nodes = group_points(points, 2 * SAME_POINT).reshape(2, -1).T
    return _Parts(pieces=parts, rows=rows[source], owners=source, nodes=nodes)


def _to_offset_part(chain: _Parts, ring: bool, mirror: FloatArray | float = 1.0) -> OffsetPart:
    """Convert a chain of parts to an `OffsetPart`."""
    pieces = chain.pieces
    starts = _close_gaps(pieces[:, :2], points_at(pieces, pieces[:, LENGTH]), ring)
    tangents = pieces[:, [TX, TY]]
    normals = np.sign(pieces[:, CURVATURE])[:, None] * np.column_stack(
        [-pieces[:, TY], pieces[:, TX]]
    )
    segments = Segments(
        starts=starts * mirror,
        tangents=tangents * mirror,
        normals=normals * mirror,
        curvatures=np.abs(pieces[:, CURVATURE]),
        lengths=pieces[:, LENGTH],
    )
    return OffsetPart(segments=segments, rows=chain.rows, closed=ring)


def _close_gaps(starts: FloatArray, ends: FloatArray, ring: bool) -> FloatArray:
    """Return the starts of segments, translated where gaps are too wide for a path [m], (n, 2).

    Gaps of the source and at its vertices add up. Whole segments are translated, because tangents
    must not change.

    - `starts`, `ends`: starts and ends of the segments [m], (n, 2) each.
    - `ring`: true if the last segment ends where the first one starts.
    """
    n = len(starts)
    starts = starts.copy()
    ends = ends.copy()
    for i in range(2 * n if ring else n - 1):
        before = i % n
        after = (i + 1) % n
        gap = starts[after] - ends[before]
        size = float(np.hypot(*gap))
        if size > WIDE_GAP:
            shift = gap * (1 - NARROW_GAP / size)
            starts[after] -= shift
            ends[after] -= shift
    return starts
