"""Curves that replace the corners of a path: their kinds, tangent lengths and segments."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.geometry.rounding.line_corners import (
    CornerBounds,
    CornerKind,
    LineCorner,
    fit_lengths,
    replace_vertices,
)
from armcontour.geometry.rounding.rounded_orientation import NO_VERTICES
from armcontour.geometry.segments import Segments

# Smallest tangent length of a blend with continuous curvature [m]. A shorter blend has too few
# significant digits and saves no time compared with a full stop.
SHORTEST_SMOOTH = 1e-6
# Fraction of its smallest tangent length below which a curve is not drawn.
TOO_SHORT = 1 / 4


class _KindOption(NamedTuple):
    """A kind of curve that may replace some corners."""

    kind: CornerKind
    next_to_arc: bool  # True if it replaces corners next to an arc, false if between two lines
    shortest: float  # Smallest tangent length [m]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CurveChoice:
    """The kinds of curves that replace n corners."""

    kinds: tuple[CornerKind, ...]
    kind: IntArray  # Index in `kinds` for each corner; -1 for a corner that stays sharp, (n,)
    longest: FloatArray  # Largest tangent lengths within the bounds [m]; 0 if sharp, (n,)
    shortest: FloatArray  # Smallest tangent lengths that can be drawn [m]; 0 if sharp, (n,)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FittedLengths:
    """Lengths on either side of vertices that fit their segments."""

    tangent: FloatArray  # Tangent lengths of the n corners [m]; 0 if sharp, (n,)
    blend: FloatArray  # Half lengths of the k blends at kinks [m], (k,)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DrawnCurves:
    """The curves that replace n corners."""

    rows: Segments  # Segments of all curves
    corner: IntArray  # Index of the corner of each segment
    radius: FloatArray  # Smallest radius of each curve [m]; 0 if sharp, (n,)
    error: FloatArray  # Corner errors [m]; 0 if sharp, (n,)
    length: FloatArray  # Lengths of the curves [m]; 0 if sharp, (n,)
    shrunk: BoolArray  # Mask of the corners whose curve is smaller than their bounds allow, (n,)


def choose_curves(bounds: CornerBounds, curve: LineCorner, free: BoolArray) -> CurveChoice:
    """Choose the first kind of curve that fits each corner.

    - `bounds`: constraints on the n corners.
    - `curve`: the kind of curve between two lines.
    - `free`: mask of the corners that may be replaced, (n,).
    """
    bent = (bounds.before.curvatures > 0) | (bounds.after.curvatures > 0)
    options = _list_kinds(curve, bool((free & bent).any()))
    n = len(free)
    chosen = np.full(n, -1)
    longest = np.zeros(n)
    shortest = np.zeros(n)
    for k, option in enumerate(options):
        remaining = np.flatnonzero(free & (chosen < 0) & (bent == option.next_to_arc))
        if not len(remaining):
            continue
        lengths = option.kind.fit(bounds[remaining])
        smallest = option.kind.shortest(bounds.half[remaining])
        fits = lengths > np.maximum(smallest, option.shortest)
        fitting = remaining[fits]
        chosen[fitting] = k
        longest[fitting] = lengths[fits]
        shortest[fitting] = smallest[fits]
    kinds = tuple(option.kind for option in options)
    return CurveChoice(kinds=kinds, kind=chosen, longest=longest, shortest=shortest)


def _list_kinds(curve: LineCorner, next_to_arcs: bool) -> list[_KindOption]:
    """Return the kinds of curves in the order in which they are tried.

    - `curve`: the kind of curve between two lines.
    - `next_to_arcs`: true if a corner next to an arc may be replaced.
    """
    options = [_KindOption(curve, next_to_arc=False, shortest=0.0)]
    if next_to_arcs:
        # Imported on demand, because most paths have no corners next to arcs.
        from armcontour.geometry.rounding.arc_corners import CONNECTION, PAIR

        if curve.smooth:
            options.append(_KindOption(CONNECTION, next_to_arc=True, shortest=SHORTEST_SMOOTH))
        # Where a connection is too short or not possible, a pair of arcs replaces the corner.
        options.append(_KindOption(PAIR, next_to_arc=True, shortest=0.0))
    return options


def share_segments(
    segments: Segments, corner: IntArray, choice: CurveChoice, kinked: IntArray, blend: FloatArray
) -> FittedLengths:
    """Shorten curves at corners and blends at kinks until they fit their segments.

    Both are fitted together, because they replace parts of the same segments.

    - `corner`: index of the segment before each corner, (n,).
    - `kinked`: index of the segment before each kink of the orientation, (k,).
    - `blend`: largest half lengths of the blends at kinks [m], (k,).
    """
    n = len(corner)
    vertices = np.concatenate([corner, kinked])
    requested = np.concatenate([choice.longest, blend])
    order = np.argsort(vertices)
    fitted = np.empty(len(vertices))
    fitted[order] = fit_lengths(requested[order], vertices[order], segments.lengths)
    tangent = fitted[:n]
    # On a very short segment between two corners, a curve can be too small; then the corner stays
    # sharp.
    tangent[tangent <= choice.shortest * TOO_SHORT] = 0.0
    return FittedLengths(tangent=tangent, blend=fitted[n:])


def draw_curves(bounds: CornerBounds, choice: CurveChoice, tangent: FloatArray) -> DrawnCurves:
    """Draw the chosen curves.

    - `bounds`: constraints on the n corners.
    - `tangent`: tangent lengths [m]; 0 for a corner that stays sharp, (n,).
    """
    n = len(tangent)
    radius = np.zeros(n)
    error = np.zeros(n)
    length = np.zeros(n)
    shrunk = choice.longest > 0
    rows = [bounds.before[:0]]
    corner = [NO_VERTICES]
    for k, kind in enumerate(choice.kinds):
        rows_of_kind = np.flatnonzero((choice.kind == k) & (tangent > 0))
        if not len(rows_of_kind):
            continue
        drawn = kind.draw(bounds[rows_of_kind], tangent[rows_of_kind])
        radius[rows_of_kind] = drawn.radius
        error[rows_of_kind] = drawn.error
        shrunk[rows_of_kind] = drawn.shrunk
        length[rows_of_kind] = np.bincount(
            drawn.corner, drawn.rows.lengths, minlength=len(rows_of_kind)
        )
        rows.append(drawn.rows)
        corner.append(rows_of_kind[drawn.corner])
    return DrawnCurves(
        rows=Segments.join(rows),
        corner=np.concatenate(corner),
        radius=radius,
        error=error,
        length=length,
        shrunk=shrunk,
    )


def insert_curves(
    segments: Segments, corner: IntArray, tangent: FloatArray, drawn: DrawnCurves
) -> tuple[Segments, IntArray]:
    """Replace corners by drawn curves.

    Returns the new segments and, for each of them, the index of the segment that contains it, or
    that is before its corner.

    - `corner`: index of the segment before each corner, (n,).
    - `tangent`: tangent lengths [m], (n,).
    """
    cut = np.zeros(len(segments) + 1)
    cut[corner + 1] = tangent
    table, source, _ = replace_vertices(segments, cut, drawn.rows, corner[drawn.corner])
    return table.check(), source
