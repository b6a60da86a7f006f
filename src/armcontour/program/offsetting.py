"""Offsets of lines and arcs in the plane, exact: arcs stay arcs, around the same centres.

Points at distance d from a contour, on one of its sides, lie on its offset segments or on circles
around its vertices. All of these are cut where they meet; the parts that no place of the contour is
nearer to than d make the offset.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.geometry.near_points import group_points
from armcontour.geometry.nearest import find_nearest
from armcontour.geometry.segments import Segments
from armcontour.program._crossings import (
    CURVATURE,
    LENGTH,
    SAME_PLACE,
    TX,
    TY,
    crossings,
    left_of,
    parallels,
    points_at,
    turns_between,
)

# By so much less than the offset a part may be away from the contour, by rounding [m]: points of
# a path may be off by REPEATED_POINT.
SLACK = 3e-9
# Gaps above the first are narrowed to the second; a path may have gaps of REPEATED_POINT [m].
WIDE_GAP, NARROW_GAP = 0.9e-9, 0.5e-9
# A closed part whose area is less than its length times this is two coinciding lines [m].
THIN = 1e-8


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OffsetPart:
    """A continuous part of an offset.

    Args:
        segments: Its segments, in the plane.
        rows: The segment of the source that each comes from, or, around a vertex, ends at it, (n,).
        closed: Whether it is closed.
    """

    segments: Segments
    rows: IntArray
    closed: bool


def offset_segments(source: Segments, distance: float, *, closed: bool) -> list[OffsetPart]:
    """The parts of the offset of a contour in the plane, in its direction of travel.

    Args:
        source: The contour, which does not cross itself.
        distance: The offset, to the left if positive [m].
        closed: Whether the contour is closed.

    Returns:
        The parts; none if no place at this side is so far from the contour.
    """
    if distance == 0:
        return [OffsetPart(segments=source, rows=np.arange(len(source)), closed=closed)]
    mirror = np.array([1.0, np.sign(distance)])
    pieces, rows = _raw_pieces(_table(source, mirror), abs(distance), closed)
    if not len(pieces):
        return []
    knives = np.empty((0, 6))
    if not closed:
        # The other side of an open contour may be in the way, and so may its ends.
        other, _ = _raw_pieces(_table(source, mirror * [1, -1]), abs(distance), closed)
        ends = _end_circles(pieces, abs(distance))
        knives = np.concatenate([other * [1, -1, 1, -1, -1, 1], ends])
    parts = _cut(pieces, rows, knives)
    middles = points_at(parts.pieces, parts.pieces[:, LENGTH] / 2)
    clear = find_nearest(source, middles * mirror).distance >= abs(distance) - SLACK
    parts = parts.only(clear)
    parts = parts.joined(
        None if closed else points_at(pieces[[0, -1]], pieces[[0, -1], LENGTH] * [0, 1])
    )
    return [_made(x, ring, mirror) for x, ring in parts.chains()]


def crosses_itself(source: Segments, *, closed: bool) -> FloatArray | None:
    """A point in which a path in the plane crosses or touches itself [m]; None if it does not."""
    table = _table(source, np.ones(2))
    which, places = crossings(table)
    n = len(table)
    ahead = (which[:, 1] - which[:, 0]) % n == 1
    behind = (which[:, 0] - which[:, 1]) % n == 1
    lengths = table[which, LENGTH]
    at_start, at_end = places <= 2 * SAME_PLACE, places >= lengths - 2 * SAME_PLACE
    meant = (ahead & at_end[:, 0] & at_start[:, 1]) | (behind & at_start[:, 0] & at_end[:, 1])
    if not closed:
        meant &= ~(which.min(axis=1) == 0) | ~(which.max(axis=1) == n - 1) | (n == 2)
    if meant.all():
        return None
    k = int(np.argmin(meant))
    return np.asarray(points_at(table[which[k, :1]], places[k, :1])[0])


def crossing_owners(paths: Sequence[Segments]) -> tuple[int, int] | None:
    """Two of several paths in the plane that cross or touch each other; None if none do."""
    table = np.concatenate([_table(x, np.ones(2)) for x in paths])
    owner = np.repeat(np.arange(len(paths)), [len(x) for x in paths])
    pairs = owner[crossings(table)[0]]
    meet = pairs[pairs[:, 0] != pairs[:, 1]]
    return None if not len(meet) else (int(meet[0].min()), int(meet[0].max()))


def _table(source: Segments, mirror: FloatArray) -> FloatArray:
    """The table of pieces of `_crossings` of a path, mirrored."""
    starts, tangents = source.starts * mirror, source.tangents * mirror
    normals = source.normals * mirror
    turn = np.sign(tangents[:, 0] * normals[:, 1] - tangents[:, 1] * normals[:, 0])
    return np.column_stack([starts, tangents, turn * source.curvatures, source.lengths])


def _raw_pieces(table: FloatArray, d: float, closed: bool) -> tuple[FloatArray, IntArray]:
    """The offset segments to the left by d [m], with circles around vertices; and their rows."""
    n = len(table)
    moved = parallels(table, d)
    # Arcs that the offset would turn inside out are nearer than d to themselves.
    left = moved[:, LENGTH] > SAME_PLACE
    ends, leaving = points_at(table, table[:, LENGTH]), points_at(table, table[:, LENGTH], 1)
    turn = turns_between(leaving, np.roll(table, -1, axis=0)[:, TX : TY + 1])
    # A turn back has the contour on both sides.
    turn = np.where(turn > np.pi - SAME_PLACE, -np.pi, turn)
    around = np.column_stack([ends + d * left_of(leaving), leaving, np.full(n, -1 / d), -turn * d])
    bent = around[:, LENGTH] > SAME_PLACE
    if not closed:
        bent[-1] = False
    both = np.stack([moved, around], axis=1).reshape(-1, 6)
    kept = np.stack([left, bent], axis=1).reshape(-1)
    return both[kept], np.repeat(np.arange(n), 2)[kept]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Parts:
    """Parts of the pieces of an offset, cut where pieces meet.

    Args:
        pieces: The parts, (n, 6).
        rows: Rows of the source, (n,).
        owners: Piece of each part, (n,).
        nodes: Places at which each part starts and ends, as numbers, (n, 2).
    """

    pieces: FloatArray
    rows: IntArray
    owners: IntArray
    nodes: IntArray

    def only(self, kept: BoolArray) -> _Parts:
        """Some of the parts."""
        return _Parts(
            pieces=self.pieces[kept],
            rows=self.rows[kept],
            owners=self.owners[kept],
            nodes=self.nodes[kept],
        )

    def joined(self, ends: FloatArray | None) -> _Parts:
        """The parts without those that lead nowhere.

        Args:
            ends: Points at which an open offset starts and ends [m], (2, 2).
        """
        found = self
        while len(found.pieces):
            starts, stops = found.nodes[:, 0], found.nodes[:, 1]
            comes, goes = np.isin(starts, stops), np.isin(stops, starts)
            if ends is not None:
                first = np.linalg.norm(found.pieces[:, :2] - ends[0], axis=1) <= SAME_PLACE
                tips = points_at(found.pieces, found.pieces[:, LENGTH])
                comes |= first
                goes |= np.linalg.norm(tips - ends[1], axis=1) <= SAME_PLACE
            kept = comes & goes
            if kept.all():
                break
            found = found.only(kept)
        return found

    def chains(self) -> list[tuple[_Parts, bool]]:
        """The parts, one after the other; and whether they close."""
        leaving: dict[int, list[int]] = {}
        for i, node in enumerate(self.nodes[:, 0].tolist()):
            leaving.setdefault(node, []).append(i)
        arriving = set(self.nodes[:, 1].tolist())
        # Open chains first: their starts are where nothing arrives.
        order = np.argsort([x in arriving for x in self.nodes[:, 0].tolist()], kind="stable")
        used = np.zeros(len(self.pieces), dtype=bool)
        tips = points_at(self.pieces, self.pieces[:, LENGTH], 1)
        found = []
        for start in order.tolist():
            chain: list[int] = []
            at: int | None = start
            while at is not None and not used[at]:
                used[at] = True
                chain.append(at)
                ways = [k for k in leaving.get(int(self.nodes[at, 1]), ()) if not used[k]]
                at = min(ways, key=partial(self._rightness, tips[at]), default=None)
            if chain:
                closes = self.nodes[chain[-1], 1] == self.nodes[chain[0], 0]
                found.append((self.only(np.array(chain)), bool(closes)))
        return [(x._merged(ring), ring) for x, ring in found if not (ring and x._is_thin())]

    def _rightness(self, tangent: FloatArray, k: int) -> float:
        """Angle by which the path turns to the right into part k; the leftmost way is taken."""
        tx, ty = self.pieces[k, TX], self.pieces[k, TY]
        return -float(
            np.arctan2(tangent[0] * ty - tangent[1] * tx, tangent[0] * tx + tangent[1] * ty)
        )

    def _is_thin(self) -> bool:
        """Whether a closed chain has no area."""
        p = self.pieces
        a, b = p[:, :2] - p[0, :2], points_at(p, p[:, LENGTH]) - p[0, :2]
        angle = p[:, CURVATURE] * p[:, LENGTH]
        bent = p[:, CURVATURE] != 0
        radius = 1 / np.where(bent, p[:, CURVATURE], 1.0)
        caps = np.where(bent, radius**2 * (angle - np.sin(angle)), 0.0)
        area = float(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0] + caps)) / 2
        return abs(area) <= THIN * float(p[:, LENGTH].sum())

    def _merged(self, ring: bool) -> _Parts:
        """The chain with consecutive parts of one piece as one part."""
        found = self
        if ring and len(found.pieces) > 1:
            # It starts where a piece does, if any of them is whole at its start.
            changes = found.owners != np.roll(found.owners, 1)
            if changes.any():
                first = int(np.argmax(changes & (found.owners == found.owners[changes].min())))
                found = found.only(np.roll(np.arange(len(found.pieces)), -first))
        begins = np.append(True, found.owners[1:] != found.owners[:-1])
        group = np.cumsum(begins) - 1
        merged = found.only(begins)
        pieces = merged.pieces.copy()
        pieces[:, LENGTH] = np.bincount(group, weights=found.pieces[:, LENGTH])
        return _Parts(pieces=pieces, rows=merged.rows, owners=merged.owners, nodes=merged.nodes)


def _end_circles(pieces: FloatArray, d: float) -> FloatArray:
    """Half circles with radius d [m] around the ends of the open contour of an offset, (4, 6)."""
    ends = points_at(pieces[[0, -1]], pieces[[0, -1], LENGTH] * [0, 1])
    leaving = points_at(pieces[[0, -1]], pieces[[0, -1], LENGTH] * [0, 1], 1)
    across = 2 * d * np.column_stack([leaving[:, 1], -leaving[:, 0]])
    halves = [(ends, leaving), (ends + across, -leaving)]
    more = np.tile([-1 / d, np.pi * d], (2, 1))
    return np.concatenate([np.column_stack([a, b, more]) for a, b in halves])


def _cut(pieces: FloatArray, rows: IntArray, knives: FloatArray) -> _Parts:
    """Pieces cut where they meet each other or `knives`; ends that are one place have one number.

    Args:
        pieces: The pieces, (n, 6).
        rows: Rows of the source, (n,).
        knives: Other pieces, which make no parts, (m, 6).
    """
    n = len(pieces)
    which, places = crossings(np.concatenate([pieces, knives]))
    owners = np.concatenate([np.arange(n), np.arange(n), which.reshape(-1)])
    at = np.concatenate([np.zeros(n), pieces[:, LENGTH], places.reshape(-1)])
    order = np.lexsort((at, owners))
    order = order[owners[order] < n]
    owners, at = owners[order], at[order]
    long = (owners[1:] == owners[:-1]) & (np.diff(at) > SAME_PLACE / 2)
    first, last = np.nonzero(long)[0], np.nonzero(long)[0] + 1
    own = owners[first]
    parts = pieces[own].copy()
    parts[:, :2] = points_at(pieces[own], at[first])
    parts[:, [TX, TY]] = points_at(pieces[own], at[first], 1)
    parts[:, LENGTH] = at[last] - at[first]
    points = np.concatenate([parts[:, :2], points_at(pieces[own], at[last])])
    nodes = group_points(points, SAME_PLACE).reshape(2, -1).T
    return _Parts(pieces=parts, rows=rows[own], owners=own, nodes=nodes)


def _made(chain: _Parts, ring: bool, mirror: FloatArray) -> OffsetPart:
    """A chain of parts as segments."""
    p = chain.pieces
    starts = _closed_up(p[:, :2], points_at(p, p[:, LENGTH]), ring)
    tangents = p[:, [TX, TY]]
    normals = np.sign(p[:, CURVATURE])[:, None] * np.column_stack([-p[:, TY], p[:, TX]])
    segments = Segments(
        starts=starts * mirror,
        tangents=tangents * mirror,
        normals=normals * mirror,
        curvatures=np.abs(p[:, CURVATURE]),
        lengths=p[:, LENGTH],
    )
    return OffsetPart(segments=segments, rows=chain.rows, closed=ring)


def _closed_up(starts: FloatArray, ends: FloatArray, ring: bool) -> FloatArray:
    """Starts of segments that are moved where gaps are wider than a path may have.

    Gaps of the source and those at its vertices add up. Whole segments are moved, because tangents
    must stay.
    """
    starts, ends, n = starts.copy(), ends.copy(), len(starts)
    for i in range(2 * n if ring else n - 1):
        before, after = i % n, (i + 1) % n
        gap = starts[after] - ends[before]
        size = float(np.hypot(*gap))
        if size > WIDE_GAP:
            shift = gap * (1 - NARROW_GAP / size)
            starts[after] -= shift
            ends[after] -= shift
    return starts
