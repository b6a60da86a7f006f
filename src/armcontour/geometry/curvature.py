"""Paths with continuous curvature: transitions where lines and arcs meet without a corner.

Where the tangent is continuous and the curvature jumps by d, a connection of the length w on either
side leaves the path by about d w² / 130. So w is as long as the tolerance and the neighbours allow.
The deviation is proven, with both paths passed evenly (`bound_deviation`).
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import checked
from armcontour.core.quantities import Tolerance
from armcontour.core.sampling import number_parts
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


@checked
def smooth_curvature(path: Path, tolerance: Tolerance) -> tuple[Path, FloatArray]:
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
    allowed = tolerance
    if isinstance(path, ShapedPath):
        raise InvalidInput(
            "A shaped path bends as its timing wants it, and cannot be given another curvature: "
            "smooth the curvature of a path that is not shaped."
        )
    vertex, most, w = _find_jumps(path, allowed)
    parts = [
        _draw(path, vertex[x : x + AT_A_TIME], w[x : x + AT_A_TIME], most[x : x + AT_A_TIME])
        for x in range(0, len(vertex), AT_A_TIME)
    ]
    if not any(len(x[0]) for x in parts):
        return path, np.array([[0.0, 0.0], [path.length, path.length]])
    drawn = Segments.join([x[0] for x in parts])
    after, first, w = (np.concatenate([x[k] for x in parts]) for k in (1, 2, 3))
    return _replace(path, vertex[w > 0], w[w > 0], drawn, after, first)


def _find_jumps(path: Path, tolerance: float) -> tuple[IntArray, FloatArray, FloatArray]:
    """Jumps of the curvature without a corner, at which the orientation makes no tool stop anyway.

    Args:
        path: The path.
        tolerance: Largest distance of either path from the other [m].

    Returns:
        Segments after which they are; largest distances there [m]; and lengths on either side, by
        these, the turn and the neighbours' lengths [m], (n,) each.

    Raises:
        InvalidInput: The orientation was rounded, so that it does not fit the segments.
    """
    rows, orientation = path.segments, path.orientation
    vectors = [rows.at(EVERY, u, 2) for u in (rows.lengths, 0 * rows.lengths)]
    jump = length(vectors[0][:-1] - vectors[1][1:])
    size = length(vectors[0][:-1]) + length(vectors[1][1:])
    sharp = path.turns > TANGENT_TOLERANCE
    found = (jump > SAME_BEND * size + BEND_FLOOR) & ~sharp
    if orientation is not None and not (orientation.fixed or orientation.follows):
        found[find_kinks(path)] = False
        found &= orientation.jumps <= SAME_ORIENTATION
    vertex = np.flatnonzero(found)
    own = np.where(np.isnan(path.tolerances), np.inf, path.tolerances)
    most = np.minimum(tolerance, np.minimum(own[vertex], own[vertex + 1]))
    tight = np.maximum(path.curvatures[vertex], path.curvatures[vertex + 1])
    # Corners, which may be rounded later, keep half of their segments.
    every = np.where(sharp, np.inf, 0.0)
    every[vertex] = np.minimum(np.sqrt(most / (SMALL * jump[vertex])), WIDEST / tight)
    w = fit_lengths(every, np.arange(len(every)), path.lengths)[vertex]
    return vertex, most, w


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
    _, number = number_parts(count)
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
    # Arc lengths of the places before, at and after the vertices on both paths.
    more, at = sides[0] + sides[1] - 2 * w, path.breaks[vertex + 1]
    old = np.stack([at - w, at, at + w], axis=1)
    steps = np.stack([0 * w, sides[0] - w, more], axis=1)
    pairs = np.stack([old, old + (np.cumsum(more) - more)[:, None] + steps], axis=2).reshape(-1, 2)
    ends = [[0.0, 0.0]], [[path.length, path.length + float(more.sum())]]
    places = np.concatenate([ends[0], pairs, ends[1]])
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
        moved = {x: np.interp(getattr(path.corners, x), *places.T) for x in ("start", "end")}
        changed["corners"] = dataclasses.replace(path.corners, **moved)
    return dataclasses.replace(path, **changed), places
