"""Paths with continuous curvature: transitions where lines and arcs meet without a corner.

Where the tangent is continuous and the curvature jumps by d, a connection of the length w on either
side deviates from the path by approximately d w² / 130. Therefore w is as large as the tolerance
and the neighbours allow. `bound_deviation` proves that the deviation is within the tolerance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import checked
from armcontour.core.quantities import Tolerance
from armcontour.core.sampled_data import number_parts
from armcontour.geometry.biarcs import length
from armcontour.geometry.orientation import SAME_ORIENTATION
from armcontour.geometry.path import Path
from armcontour.geometry.rounding.connections import bound_deviation, connect, draw_connections
from armcontour.geometry.rounding.line_corners import fit_lengths, replace_vertices
from armcontour.geometry.rounding.rounded_orientation import (
    find_kinks,
    follow_rounded,
    jumps_at,
    round_orientation,
)
from armcontour.geometry.rounding.rounded_path import RoundedPath
from armcontour.geometry.segments import EVERY, TANGENT_TOLERANCE, Segments
from armcontour.geometry.shaped_path import ShapedPath

# Curvatures that differ by less than this fraction of their sum count as equal.
SAME_BEND = 1e-9
# Curvatures that differ by less than this [1/m] also count as equal, because over a metre of path
# it turns the tangent by a nanoradian only.
BEND_FLOOR = 1e-9
# Deviation of a connection from the path at a small turn, divided by the square of its half length
# and by the jump of the curvature.
DEVIATION = 0.0077
# Largest turn of either connection half [rad].
LARGEST_HALF_TURN = 1.2
# Smallest length of a connection on either side [m]. A shorter connection saves hardly any time
# compared with a full stop.
SHORTEST_CONNECTION = 1e-6
# Largest number of iterations that shorten a connection outside the tolerance.
MAX_ITERATIONS = 20
# Largest factor by which one iteration multiplies the length of such a connection.
LARGEST_FACTOR = 0.95
# Safety factor for the length of a connection that the deviation requires.
SAFETY = 0.99
# Factor by which connections with a loop or a cusp are shortened.
LOOP_FACTOR = 0.5
# Number of parts per quintic for the deviation's first bound.
FEW_PARTS = 2
# Number of parts per quintic for a second bound, if FEW_PARTS do not prove the tolerance.
MANY_PARTS = 16
# Largest number of connections that are computed together.
BATCH = 4000


@checked
def smooth_curvature(path: Path, tolerance: Tolerance) -> tuple[Path, FloatArray]:
    """Insert transitions where a path's curvature jumps without a corner.

    Returns the path, and corresponding arc lengths on both paths from start to end [m], (n, 2); the
    correspondence is linear between them.

    `tolerance` is the largest distance of either path from the other [m]; tolerances of the path's
    own segments cap it. The field `smoothing` of the new path is increased by the proven distance.
    """
    if isinstance(path, ShapedPath):
        raise InvalidInput(
            "The curvature of a shaped path was optimized together with its timing and cannot be "
            "changed. Smooth the curvature of a path that is not shaped."
        )
    vertex, limits, w = _find_jumps(path, tolerance)
    parts = [
        _draw_within_tolerance(path, vertex[x : x + BATCH], w[x : x + BATCH], limits[x : x + BATCH])
        for x in range(0, len(vertex), BATCH)
    ]
    if not any(len(x.rows) for x in parts):
        return path, np.array([[0.0, 0.0], [path.length, path.length]])
    drawn = _Transitions.join(parts)
    used = drawn.sizes > 0
    smooth, pairs = _insert_transitions(path, vertex[used], drawn.sizes[used], drawn)
    return replace(smooth, smoothing=path.smoothing + drawn.deviation), pairs


def _find_jumps(path: Path, tolerance: float) -> tuple[IntArray, FloatArray, FloatArray]:
    """Find the vertices where only the curvature jumps.

    Returns their indices, tolerances [m], and largest connection lengths per side [m], (k,) each.
    """
    rows = path.segments
    orientation = path.orientation
    # Curvature vectors before and after each vertex.
    before = rows.evaluate(EVERY, rows.lengths, 2)[:-1]
    after = rows.evaluate(EVERY, 0 * rows.lengths, 2)[1:]
    jump = length(before - after)
    size = length(before) + length(after)
    sharp = path.turns > TANGENT_TOLERANCE
    mask = (jump > SAME_BEND * size + BEND_FLOOR) & ~sharp
    if orientation is not None and not (orientation.fixed or orientation.follows):
        mask[find_kinks(path)] = False
        mask &= jumps_at(path, np.arange(len(mask))) <= SAME_ORIENTATION
    vertex = np.flatnonzero(mask)
    limits = np.minimum(tolerance, path.vertex_tolerances[vertex])
    largest_curvature = np.maximum(path.curvatures[vertex], path.curvatures[vertex + 1])
    # Half of each segment next to a corner is reserved, because the corner can be rounded later.
    requested = np.where(sharp, np.inf, 0.0)
    by_tolerance = np.sqrt(limits / (DEVIATION * jump[vertex]))
    requested[vertex] = np.minimum(by_tolerance, LARGEST_HALF_TURN / largest_curvature)
    w = fit_lengths(requested, np.arange(len(requested)), path.lengths)[vertex]
    return vertex, limits, w


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Transitions:
    """Transitions at n vertices, within the tolerance."""

    rows: Segments  # The m transitions
    vertex: IntArray  # Index of the segment before the vertex of each transition, (m,)
    before: BoolArray  # Mask of the transitions on the side before their vertex, (m,)
    sizes: FloatArray  # Length that is replaced on either side of each vertex [m]; 0 if none, (n,)
    deviation: float  # Upper bound of their distances from the path [m]

    @classmethod
    def join(cls, parts: Sequence[_Transitions]) -> _Transitions:
        """Join the transitions at consecutive vertices."""
        return cls(
            rows=Segments.join([x.rows for x in parts]),
            vertex=np.concatenate([x.vertex for x in parts]),
            before=np.concatenate([x.before for x in parts]),
            sizes=np.concatenate([x.sizes for x in parts]),
            deviation=max(x.deviation for x in parts),
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Trial:
    """Drawn transitions at n vertices, not yet compared with the tolerance."""

    rows: Segments  # The m transitions
    owner: IntArray  # Index of the vertex of each transition among the n vertices, (m,)
    before: BoolArray  # Mask of the transitions on the side before their vertex, (m,)
    # Upper bound of the distance from the path at each vertex [m], infinite with a loop, (n,)
    deviations: FloatArray


def _draw_within_tolerance(
    path: Path, vertex: IntArray, w: FloatArray, allowed: FloatArray
) -> _Transitions:
    """Draw transitions within a tolerance.

    - `vertex`: index of the segment before each vertex, (n,).
    - `w`: largest length on either side of each vertex [m], (n,).
    - `allowed`: largest distance from the path at each vertex [m], (n,).
    """
    # Connections outside the tolerance are shortened and drawn again; length 0 means that a vertex
    # has no connection.
    w = np.where(w < SHORTEST_CONNECTION, 0.0, w)
    drawn_vertex = [np.zeros(0, dtype=np.intp)]
    drawn = [path.segments[:0]]
    before = [np.zeros(0, dtype=bool)]
    largest = 0.0
    remaining = np.flatnonzero(w > 0)
    for _ in range(MAX_ITERATIONS):
        if not len(remaining):
            break
        trial = _draw_transitions(path, vertex[remaining], w[remaining], allowed[remaining])
        within = trial.deviations <= allowed[remaining]
        accepted = within[trial.owner]
        drawn.append(trial.rows[accepted])
        drawn_vertex.append(vertex[remaining[trial.owner[accepted]]])
        before.append(trial.before[accepted])
        largest = max(largest, float(trial.deviations[within].max(initial=0.0)))
        remaining = remaining[~within]
        deviations = trial.deviations[~within]
        shorter = np.minimum(LARGEST_FACTOR, SAFETY * np.sqrt(allowed[remaining] / deviations))
        w[remaining] *= np.where(np.isfinite(deviations), shorter, LOOP_FACTOR)
        w[remaining[w[remaining] < SHORTEST_CONNECTION]] = 0.0
        remaining = remaining[w[remaining] > 0]
    w[remaining] = 0.0
    return _Transitions(
        rows=Segments.join(drawn),
        vertex=np.concatenate(drawn_vertex),
        before=np.concatenate(before),
        sizes=w,
        deviation=largest,
    )


def _draw_transitions(path: Path, vertex: IntArray, w: FloatArray, allowed: FloatArray) -> _Trial:
    """Draw transitions with given lengths, and bound their distances from the path.

    A deviation is infinite if the connection has a loop or a cusp; bounds above `allowed` are
    refined. The arguments are those of `_draw_within_tolerance`.
    """
    rows = path.segments
    connections = connect(rows[vertex], rows[vertex + 1], w)
    valid = connections.valid
    middle = np.where(valid, connections.nearest, 0.5)
    drawn, owners, before = draw_connections(connections, rows.starts[vertex + 1], middle)
    # `ends`: ends of the path part that each transition replaces. All transitions of a half replace
    # the same length.
    half = 2 * owners + ~before
    count = np.bincount(half)
    _, number = number_parts(count)
    old = vertex[owners] + ~before
    shares = number / count[half], (number + 1) / count[half]
    base = np.where(before, path.lengths[old] - w[owners], 0.0)
    ends = base + shares[0] * w[owners], base + shares[1] * w[owners]
    bounds = bound_deviation(drawn, rows, old, ends, FEW_PARTS)
    uncertain = np.flatnonzero(bounds > allowed[owners])
    bounds[uncertain] = bound_deviation(
        drawn[uncertain], rows, old[uncertain], (ends[0][uncertain], ends[1][uncertain]), MANY_PARTS
    )
    deviations = np.zeros(len(vertex))
    np.maximum.at(deviations, owners, bounds)
    return _Trial(
        rows=drawn,
        owner=owners,
        before=before,
        deviations=np.where(valid, deviations, np.inf),
    )


def _insert_transitions(
    path: Path, vertex: IntArray, w: FloatArray, transitions: _Transitions
) -> tuple[Path, FloatArray]:
    """Insert transitions; returns the path, and corresponding arc lengths on both paths [m].

    - `vertex`: index of the segment before each replaced vertex, (k,).
    - `w`: length that is replaced on either side of each vertex [m], (k,).
    """
    drawn = transitions.rows
    after = transitions.vertex
    first = transitions.before
    # A transition has the speed, tolerance and tag of the segment on its side of the vertex.
    originals = path.segments[np.where(first, after, after + 1)]
    cut = np.zeros(len(path) + 1)
    cut[vertex + 1] = w
    table, source, _ = replace_vertices(
        path.segments, cut, drawn.replace(**originals.limit_columns), after
    )
    index = np.searchsorted(vertex, after)
    sides = [
        np.asarray(np.bincount(index, drawn.lengths * x, minlength=len(w)), dtype=float)
        for x in (first, ~first)
    ]
    growth = sides[0] + sides[1] - 2 * w
    s = path.breaks[vertex + 1]
    # Arc lengths on both paths of the start, the vertex and the end of each connection.
    old = np.stack([s - w, s, s + w], axis=1)
    steps = np.stack([0 * w, sides[0] - w, growth], axis=1)
    pairs = np.stack([old, old + (np.cumsum(growth) - growth)[:, None] + steps], axis=2).reshape(
        -1, 2
    )
    ends = [[0.0, 0.0]], [[path.length, path.length + float(growth.sum())]]
    matched_s = np.concatenate([ends[0], pairs, ends[1]])
    orientation = path.orientation
    if orientation is not None and orientation.follows:
        orientation = follow_rounded(table, path, source, cut[:-1], 0.0, smooth=True)
    elif orientation is not None:
        around = sides[0] + sides[1]
        orientation, _ = round_orientation(path, vertex, w, around, table.breaks[-1], smooth=True)
    s = np.interp(path.breaks[path.waypoints], *matched_s.T)
    changed: dict[str, Any] = {
        "segments": table,
        "waypoints": np.searchsorted((table.breaks[1:] + table.breaks[:-1]) / 2, s),
        "orientation": orientation,
    }
    if isinstance(path, RoundedPath):
        start = np.interp(path.corners.start, *matched_s.T)
        end = np.interp(path.corners.end, *matched_s.T)
        changed["corners"] = replace(path.corners, start=start, end=end)
    return replace(path, **changed), matched_s
