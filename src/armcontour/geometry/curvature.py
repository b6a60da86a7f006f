"""Paths with continuous curvature: transitions where lines and arcs meet without a corner.

Where the tangent is continuous and the curvature jumps by d, a connection of the length w on either
side leaves the path by about d w² / 130. So w is as long as the tolerance and the neighbours allow.
The deviation is proven, with both paths passed evenly (`bound_deviation`).
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from armcontour import _checks
from armcontour._checks import BoolArray, FloatArray, IntArray
from armcontour.errors import InvalidInput
from armcontour.geometry.biarcs import length
from armcontour.geometry.connecting import bound_deviation, connect, draw_connections
from armcontour.geometry.orientation import SAME_ORIENTATION
from armcontour.geometry.path import Path
from armcontour.geometry.replacing import fit_lengths, replace_vertices
from armcontour.geometry.rounded_orientation import find_kinks, follow_rounded, round_orientation
from armcontour.geometry.rounding import RoundedPath
from armcontour.geometry.segments import EVERY, TANGENT_TOLERANCE, Segments
from armcontour.geometry.shaped import ShapedPath

# Curvatures that differ by less than this share of them, or by less than the floor [1/m], are one:
# over a metre of path the floor turns the tangent by a nanoradian.
SAME_BEND, BEND_FLOOR = 1e-9, 1e-9
# Deviation of a connection from the path at a small turn, over its half length squared and the jump
# of the curvature.
SMALL = 0.0077
# Largest turn of either half of a connection [rad].
WIDEST = 1.2
# Connections shorter than this on either side are not made: motions pass them hardly faster than a
# full stop [m].
SHORTEST = 1e-6
# Those that leave the tolerance are made shorter, so often at most; by at least the first share,
# and less than what the deviation asks for by the second.
TRIES, SHORTER, SAFE = 20, 0.95, 0.99
# Those that are not sound become so much shorter.
HALF = 0.5
# Parts of each quintic in which deviations are bounded: first few, and many where that does not
# show that the tolerance is kept. And connections that are drawn at a time.
FEW, MANY, AT_A_TIME = 2, 16, 4000


def smooth_curvature(path: Path, tolerance: float) -> tuple[Path, FloatArray]:
    """The path with transitions where its curvature jumps without a corner.

    Args:
        path: The path.
        tolerance: Largest distance of either path from the other [m]; tolerances of the path's own
            segments cap it.

    Returns:
        The path, and arc lengths on both paths that belong together, from their starts to their
        ends and linear in between [m], (n, 2).

    Raises:
        InvalidInput: The tolerance is not above zero, or the path's tool orientation was rounded.
    """
    allowed = _checks.positive("tolerance of transitions", tolerance, "m")
    if isinstance(path, ShapedPath):
        raise InvalidInput(
            "A shaped path bends as its timing wants it, and cannot be given another curvature: "
            "smooth the curvature of a path that is not shaped."
        )
    vertex, bend = _find_jumps(path)
    vertex, bend = _leave_out_turning(path, vertex, bend)
    own = np.where(np.isnan(path.tolerances), np.inf, path.tolerances)
    most = np.minimum(allowed, np.minimum(own[vertex], own[vertex + 1]))
    w = _widest(path, vertex, bend, most)
    parts = [
        _draw(path, vertex[x : x + AT_A_TIME], w[x : x + AT_A_TIME], most[x : x + AT_A_TIME])
        for x in range(0, len(vertex), AT_A_TIME)
    ]
    if not any(len(x[0]) for x in parts):
        return path, np.array([[0.0, 0.0], [path.length, path.length]])
    drawn = Segments.join([x[0] for x in parts])
    after, first, w = (np.concatenate([x[k] for x in parts]) for k in (1, 2, 3))
    return _replace(path, vertex[w > 0], w[w > 0], drawn, after, first)


def _find_jumps(path: Path) -> tuple[IntArray, FloatArray]:
    """Segments after which the curvature jumps without a corner, and by how much [1/m]."""
    rows = path.segments
    vectors = [rows.at(EVERY, u, 2) for u in (rows.lengths, 0 * rows.lengths)]
    jump = length(vectors[0][:-1] - vectors[1][1:])
    size = length(vectors[0][:-1]) + length(vectors[1][1:])
    found = (jump > SAME_BEND * size + BEND_FLOOR) & (path.turns <= TANGENT_TOLERANCE)
    return np.flatnonzero(found), jump[found]


def _leave_out_turning(
    path: Path, vertex: IntArray, bend: FloatArray
) -> tuple[IntArray, FloatArray]:
    """The jumps without those at which the tool orientation makes the tool stop anyway.

    Raises:
        InvalidInput: The orientation was rounded, so that it does not fit the segments.
    """
    orientation = path.orientation
    if orientation is None or orientation.fixed or orientation.follows:
        return vertex, bend
    stopped = np.union1d(find_kinks(path), np.flatnonzero(orientation.jumps > SAME_ORIENTATION))
    kept = ~np.isin(vertex, stopped)
    return vertex[kept], bend[kept]


def _widest(path: Path, vertex: IntArray, bend: FloatArray, allowed: FloatArray) -> FloatArray:
    """Lengths on either side of vertices, by tolerance, turn and the neighbours' lengths [m]."""
    tight = np.maximum(path.curvatures[vertex], path.curvatures[vertex + 1])
    wanted = np.minimum(np.sqrt(allowed / (SMALL * bend)), WIDEST / tight)
    # Corners, which may be rounded later, keep half of their segments.
    every = np.zeros(len(path) - 1)
    every[path.turns > TANGENT_TOLERANCE] = np.inf
    every[vertex] = wanted
    return fit_lengths(every, np.arange(len(every)), path.lengths)[vertex]


def _draw(
    path: Path, vertex: IntArray, w: FloatArray, allowed: FloatArray
) -> tuple[Segments, IntArray, BoolArray, FloatArray]:
    """Transitions within the tolerance, from connections that are made shorter until they are.

    Args:
        path: The path.
        vertex: Segments after which they are, (n,).
        w: Lengths on either side of the vertices [m], (n,).
        allowed: Tolerances [m], (n,).

    Returns:
        The transitions; the segment after which each comes; the mask of those before the vertex;
        and the lengths [m], (n,), 0 where there is none.
    """
    w = np.where(w < SHORTEST, 0.0, w)
    done = [np.zeros(0, dtype=np.intp)]
    drawn = [path.segments[:0]]
    first = [np.zeros(0, dtype=bool)]
    left = np.flatnonzero(w > 0)
    for _ in range(TRIES):
        if not len(left):
            break
        rows, of, before, off = _connect(path, vertex[left], w[left], allowed[left])
        good = off <= allowed[left]
        keep = good[of]
        drawn, done = [*drawn, rows[keep]], [*done, vertex[left[of[keep]]]]
        first = [*first, before[keep]]
        left, off = left[~good], off[~good]
        shorter = np.minimum(SHORTER, SAFE * np.sqrt(allowed[left] / off))
        w[left] *= np.where(np.isfinite(off), shorter, HALF)
        w[left[w[left] < SHORTEST]] = 0.0
        left = left[w[left] > 0]
    w[left] = 0.0
    return Segments.join(drawn), np.concatenate(done), np.concatenate(first), w


def _connect(
    path: Path, vertex: IntArray, w: FloatArray, allowed: FloatArray
) -> tuple[Segments, IntArray, BoolArray, FloatArray]:
    """Transitions of given lengths on either side of vertices, and their deviations.

    Args:
        path: The path.
        vertex: Segments after which they are, (n,).
        w: The lengths [m], (n,).
        allowed: Tolerances, up to which deviations are bounded roughly [m], (n,).

    Returns:
        The transitions; the vertex of each, from 0; the mask of those before it; and bounds of the
        deviations [m], (n,), infinite where no connection is sound.
    """
    rows = path.segments
    found = connect(rows[vertex], rows[vertex + 1], w)
    sound = found.sound
    middle = np.where(sound, found.nearest, 0.5)
    drawn, of, before = draw_connections(found, rows.starts[vertex + 1], middle)
    # The part of the path that each transition replaces: both halves are passed evenly.
    half = 2 * of + ~before
    count = np.bincount(half)
    number = np.arange(len(of)) - (np.cumsum(count) - count)[half]
    old = vertex[of] + ~before
    shares = number / count[half], (number + 1) / count[half]
    base = np.where(before, path.lengths[old] - w[of], 0.0)
    ends = base + shares[0] * w[of], base + shares[1] * w[of]
    bounds = bound_deviation(drawn, rows, old, ends, FEW)
    far = np.flatnonzero(bounds > allowed[of])
    bounds[far] = bound_deviation(drawn[far], rows, old[far], (ends[0][far], ends[1][far]), MANY)
    off = np.zeros(len(vertex))
    np.maximum.at(off, of, bounds)
    return drawn, of, before, np.where(sound, off, np.inf)


def _replace(
    path: Path,
    vertex: IntArray,
    w: FloatArray,
    drawn: Segments,
    after: IntArray,
    first: BoolArray,
) -> tuple[Path, FloatArray]:
    """The path with transitions, and the arc lengths on both that belong together [m], (m, 2).

    Args:
        path: The path.
        vertex: Segments after which there are transitions, increasing, (n,).
        w: Lengths on either side that they replace [m], (n,).
        drawn: The transitions.
        after: The segment after which each comes.
        first: Mask of the transitions before the vertex.
    """
    # Speeds, tolerances and tags stay on their sides of the vertex.
    own = path.segments[np.where(first, after, after + 1)]
    columns = {x: getattr(own, x) for x in ("speeds", "tolerances", "tags")}
    cut = np.zeros(len(path) + 1)
    cut[vertex + 1] = w
    table, source, _ = replace_vertices(path.segments, cut, drawn.replace(**columns), after)
    which = np.searchsorted(vertex, after)
    sides = [
        np.asarray(np.bincount(which, drawn.lengths * x, minlength=len(w)), dtype=float)
        for x in (first, ~first)
    ]
    places = _places(path, path.breaks[vertex + 1], w, sides)
    orientation = path.orientation
    if orientation is not None and orientation.follows:
        orientation = follow_rounded(table, path, source, cut[:-1], 0.0, smooth=True)
    elif orientation is not None:
        around = sides[0] + sides[1]
        orientation, _ = round_orientation(path, vertex, w, around, table.breaks[-1], smooth=True)
    at = np.interp(path.breaks[path.waypoints], *places.T)
    changed: dict[str, Any] = {
        "segments": table,
        "waypoints": np.searchsorted((table.breaks[1:] + table.breaks[:-1]) / 2, at),
        "orientation": orientation,
    }
    if isinstance(path, RoundedPath):
        ends = {x: np.interp(getattr(path.corners, x), *places.T) for x in ("start", "end")}
        changed["corners"] = dataclasses.replace(path.corners, **ends)
    return dataclasses.replace(path, **changed), places


def _places(path: Path, at: FloatArray, w: FloatArray, sides: list[FloatArray]) -> FloatArray:
    """Arc lengths on a path and on the one with transitions that belong together [m], (m, 2).

    Args:
        path: The path.
        at: Arc lengths of the vertices [m], (n,).
        w: Lengths on either side that are replaced [m], (n,).
        sides: Lengths of the transitions on either side [m], (n,) each.
    """
    more = sides[0] + sides[1] - 2 * w
    shift = np.cumsum(more) - more
    old = np.stack([at - w, at, at + w], axis=1)
    steps = np.stack([0 * w, sides[0] - w, more], axis=1)
    pairs = np.stack([old, old + shift[:, None] + steps], axis=2).reshape(-1, 2)
    ends = [[0.0, 0.0]], [[path.length, path.length + float(more.sum())]]
    return np.concatenate([ends[0], pairs, ends[1]])
