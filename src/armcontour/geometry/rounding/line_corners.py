"""Curves that replace corners between two lines; arc_corners.py is for corners next to arcs.

ARC, PARABOLA and SMOOTH are symmetric about the bisector and replace the same length of both lines,
the tangent length. The size of each curve is its smallest radius, which is in the middle. h is half
the turn.

The parabola is a quadratic Bézier curve with the corner point as its middle control point: with
smallest radius r it is y = x² / (2 r) about its apex. Its tangent length is r sin h / cos² h, and
its corner error is r tan² h / 2, which is half the tangent length times sin h. It is drawn as
tangent arcs. At the same corner error it is longer than the arc, and its smallest radius is
smaller: a tool with constant acceleration moves on a parabola and is slower in the middle than at
the ends.

SMOOTH starts and ends straight. Over its length its curvature is (1 - x²)² / r, where x runs from
-1 to 1, so neither the curvature nor its derivative jumps. Its length is PEAK_RATIO times the
length of the arc with the radius r. It is drawn as transitions.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.core.sampled_data import number_parts
from armcontour.geometry.biarcs import (
    STRAIGHT,
    join_by_quintics,
    join_pairs,
    make_biarcs,
    unit,
    unit_across,
)
from armcontour.geometry.rounding.rounded_orientation import SLIVER, middle_fraction
from armcontour.geometry.segments import REPEATED_POINT, Segments, combine_limits

# Largest step of asinh(tan(angle of the tangent)) that two arcs of a parabola cover. The curvature
# then changes by a factor of at most 1.7 from arc to arc, 1.34 at a turn of 90°, and the distance
# of the arcs from the parabola is below 3e-4 of the corner error.
STEP = 0.25
# Relative rounding error of a tangent length.
LENGTH_ROUNDING = 1e-12
# Largest curvature of SMOOTH divided by its mean curvature.
PEAK_RATIO = 15 / 8
# Number of quintics in each SMOOTH half, divided by (half the turn)**0.45. With this number the
# parameter equals the arc length within 1e-6, see biarcs.py.
QUINTICS = 7.8
# Largest halves of turns for which one quintic is enough, and two [rad].
FEW_QUINTICS = 0.0094, 0.047
# Gauss-Legendre nodes and weights that integrate along one quintic (QUINTIC_NODES) and along half
# of SMOOTH (HALF_NODES) exactly up to rounding errors.
QUINTIC_NODES, HALF_NODES = (np.polynomial.legendre.leggauss(n) for n in (10, 32))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CornerBounds:
    """Constraints on n corners, and the segments next to them."""

    before: Segments
    after: Segments
    half: FloatArray  # Half of the turns [rad], (n,)
    error: FloatArray  # Largest corner errors [m], (n,)
    radius: FloatArray  # Radii that the corner speeds require [m], infinite without a speed, (n,)
    turn: FloatArray  # Largest `k` that the tool orientation allows [m], (n,); see `largest_blend`
    tangent: FloatArray  # Largest tangent lengths [m], (n,)

    def __getitem__(self, rows: IntArray) -> CornerBounds:
        """Return bounds of the corners with the increasing indices `rows`."""
        if len(rows) == len(self.half):
            return self
        return CornerBounds(**{name: getattr(self, name)[rows] for name in self.__slots__})


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CornerCurves:
    """Curves that replace n corners."""

    rows: Segments  # The segments of all curves, in path order
    corner: IntArray  # Index of the corner of each segment
    radius: FloatArray  # Smallest radius of each curve [m], infinite for a straight curve, (n,)
    error: FloatArray  # Corner errors [m], (n,)
    shrunk: BoolArray  # Mask of the corners whose curve is smaller than their bounds allow, (n,)


class CornerKind(ABC):
    """A kind of curve that replaces corners."""

    smooth: bool  # True if its curvature is continuous, also at its ends

    @abstractmethod
    def shortest(self, half: FloatArray) -> FloatArray:
        """Return tangent lengths at which curves are as small as a point's resolution [m], (n,)."""

    @abstractmethod
    def fit(self, bounds: CornerBounds) -> FloatArray:
        """Return the largest tangent lengths within bounds [m], (n,); 0 where no curve fits."""

    @abstractmethod
    def draw(self, bounds: CornerBounds, tangent: FloatArray) -> CornerCurves:
        """Draw curves with given tangent lengths, above 0 and at most the segments' [m], (n,)."""


@dataclass(frozen=True, slots=True)
class LineCorner(CornerKind):
    """A curve between two lines, described by ratios to its smallest radius."""

    # Functions of half the turn [rad], each divided by the smallest radius of the curve
    error_ratio: Callable[[FloatArray], FloatArray]  # Corner error
    tangent_ratio: Callable[[FloatArray], FloatArray]  # Tangent length
    length_ratio: Callable[[FloatArray], FloatArray]  # Length of the drawn curve
    # Function of half the turn [rad]: `shortest` divided by `REPEATED_POINT`
    shortest_ratio: Callable[[FloatArray], FloatArray]
    # Function that draws curves with given bounds and smallest radii [m]; it returns the segments,
    # and each segment's corner index
    draw_with_radius: Callable[[CornerBounds, FloatArray], tuple[Segments, IntArray]]
    smooth: bool = False  # True if its curvature is continuous

    def shortest(self, half: FloatArray) -> FloatArray:
        """Return tangent lengths at which curves are as small as a point's resolution [m], (n,)."""
        return REPEATED_POINT * self.shortest_ratio(half)

    def fit(self, bounds: CornerBounds) -> FloatArray:
        """Return the largest tangent lengths within bounds [m], (n,).

        With the smallest radius r of the curve, the tangent length is t = r `tangent_ratio` and the
        length is l = r `length_ratio`. The tool orientation allows `t / 2 - c l <= k`, with c from
        `middle_fraction` and k from `largest_blend`.
        """
        tangent_ratio = self.tangent_ratio(bounds.half)
        length_per_tangent = self.length_ratio(bounds.half) / tangent_ratio
        by_turn = bounds.turn / (0.5 - length_per_tangent * middle_fraction(self.smooth))
        by_radius = self._radius(bounds) * tangent_ratio
        return np.asarray(np.minimum(np.minimum(by_radius, by_turn), bounds.tangent))

    def draw(self, bounds: CornerBounds, tangent: FloatArray) -> CornerCurves:
        """Draw curves with given tangent lengths [m], (n,)."""
        tangent_ratio = self.tangent_ratio(bounds.half)
        radius = self._radius(bounds)
        shrunk = tangent < radius * tangent_ratio * (1 - LENGTH_ROUNDING)
        radius = np.where(shrunk, tangent / tangent_ratio, radius)
        rows, corner = self.draw_with_radius(bounds, radius)
        limits = combine_limits(bounds.before, bounds.after)
        rows = rows.replace(
            speeds=limits["speeds"][corner],
            tolerances=limits["tolerances"][corner],
            tags=limits["tags"][corner],
            origins=limits["origins"][corner],
        )
        error = radius * self.error_ratio(bounds.half)
        return CornerCurves(rows=rows, corner=corner, radius=radius, error=error, shrunk=shrunk)

    def _radius(self, bounds: CornerBounds) -> FloatArray:
        """Return the smallest radii of the curves by case I or case II [m], (n,).

        Case II: the radius is the corner error divided by `error_ratio`, as in (15). Case I: it is
        the radius that the corner speed requires, (13).
        """
        return np.asarray(np.minimum(bounds.error / self.error_ratio(bounds.half), bounds.radius))


def _draw_arcs(bounds: CornerBounds, radius: FloatArray) -> tuple[Segments, IntArray]:
    """Draw one arc per corner, by (10)-(16)."""
    before = bounds.before
    after = bounds.after
    half = bounds.half
    arcs = before.replace(
        starts=after.starts - (radius * np.tan(half))[:, None] * before.tangents,
        normals=unit_across(after.tangents, before.tangents),
        curvatures=1 / radius,
        lengths=radius * 2 * half,
    )
    return arcs, np.arange(len(radius))


def _draw_corner_parabolas(bounds: CornerBounds, radius: FloatArray) -> tuple[Segments, IntArray]:
    """Draw one parabola per corner as four or more tangent arcs."""
    arcs, corner = _draw_parabolas(bounds.half)
    along, across = _axes(bounds)
    apex = bounds.after.starts + (radius * PARABOLA.error_ratio(bounds.half))[:, None] * across
    along = along[corner]
    across = across[corner]
    scale = radius[corner]

    def turned(v: FloatArray) -> FloatArray:
        return np.asarray(v[:, :1] * along + v[:, 1:] * across)

    drawn = bounds.before[corner].replace(
        starts=apex[corner] + scale[:, None] * turned(arcs.starts),
        tangents=turned(arcs.tangents),
        normals=turned(arcs.normals),
        curvatures=arcs.curvatures / scale,
        lengths=arcs.lengths * scale,
    )
    return drawn, corner


def _draw_smooth_curves(bounds: CornerBounds, radius: FloatArray) -> tuple[Segments, IntArray]:
    """Draw one SMOOTH curve per corner as transitions."""
    half = bounds.half
    parts = _count_quintics(half)
    corner, number = number_parts(2 * parts)
    along, across = (x[corner] for x in _axes(bounds))
    half_turn = half[corner]
    half_length = (half * PEAK_RATIO * radius)[corner]
    # Parameter from -1 to 1 at the start and at the end of each quintic.
    x = [(number + end) / parts[corner] - 1 for end in (0, 1)]

    def turned(cos: FloatArray, sin: FloatArray) -> FloatArray:
        return np.asarray(cos[:, None] * along + sin[:, None] * across)

    angles = [half_turn * _relative_angle(end) for end in x]
    tangents = [turned(np.cos(angle), np.sin(angle)) for angle in angles]
    curvature_vectors = [
        turned(-np.sin(angle), np.cos(angle))
        * (half_turn * PEAK_RATIO * (1 - end * end) ** 2 / half_length)[:, None]
        for angle, end in zip(angles, x, strict=True)
    ]
    # Steps from the start to the end of each quintic, by integration of the tangent.
    parameters = x[0] + (x[1] - x[0]) * (QUINTIC_NODES[0][:, None] + 1) / 2
    angle = half_turn * _relative_angle(parameters)
    step = half_length / parts[corner]
    steps = turned(
        *(step / 2 * (QUINTIC_NODES[1] @ function(angle)) for function in (np.cos, np.sin))
    )
    to_start = (radius * _smooth_tangent_ratio(half))[:, None] * bounds.before.tangents
    offsets = np.cumsum(steps, axis=0) - steps
    starts = (bounds.after.starts - to_start)[corner] + offsets - offsets[number == 0][corner]
    return join_by_quintics(
        (starts, tangents[0], curvature_vectors[0]),
        (steps, tangents[1], curvature_vectors[1]),
        step,
    ), corner


def corner_error(radius: FloatArray, half_turn: FloatArray) -> FloatArray:
    """Return the gap between corner point and arc [m], (10): `r (1 - cos h) / cos h`.

    - `radius`: radius r of the arc [m].
    - `half_turn`: half h of the angle between the lines [rad].
    """
    return np.asarray(radius * 2 * np.sin(half_turn / 2) ** 2 / np.cos(half_turn))


def _axes(bounds: CornerBounds) -> tuple[FloatArray, FloatArray]:
    """Return unit vectors along the mean tangents of corners, and towards their insides.

    The shape of both is (n, dimension).
    """
    along = unit(bounds.before.tangents + bounds.after.tangents)
    return along, unit_across(bounds.after.tangents, along)


def _relative_angle(x: FloatArray) -> FloatArray:
    """Return the tangent's angle on SMOOTH at x from -1 to 1, divided by half the turn.

    It is the integral of the curvature (1 - x²)², scaled to run from -1 to 1.
    """
    return np.asarray(x * (15 - 10 * x**2 + 3 * x**4) / 8)


def _mean_over_half(half: FloatArray, function: Callable[[FloatArray], FloatArray]) -> FloatArray:
    """Return the mean of a function of the tangent's angle over half of SMOOTH, (n,).

    - `half`: halves of the turns [rad], (n,).
    - `function`: function of the angle from the middle tangent [rad].
    """
    angles = half * _relative_angle((HALF_NODES[0][:, None] + 1) / 2)
    return np.asarray(HALF_NODES[1] @ function(angles) / 2)


def _smooth_tangent_ratio(half: FloatArray) -> FloatArray:
    """Return tangent lengths of SMOOTH divided by its smallest radii, (n,)."""
    return np.asarray(half * PEAK_RATIO * _mean_over_half(half, np.cos) / np.cos(half))


def _count_quintics(half: FloatArray) -> IntArray:
    """Return how many quintics draw half of SMOOTH, (n,)."""
    few = 1 + np.searchsorted(FEW_QUINTICS, half)
    return np.maximum(np.ceil(QUINTICS * half**0.45), few).astype(np.intp)


def _draw_parabolas(half: FloatArray) -> tuple[Segments, IntArray]:
    """Draw y = x² / 2 from tangent angle -h to h as arcs; also return each arc's parabola.

    The ends of the arc pairs are on the parabola and have its tangents; one end is the apex. With w
    = asinh(tan(angle)) the curvature is cosh(w)**-3, so its relative change is 3 tanh(w) dw.
    """
    largest = np.arcsinh(np.tan(half))
    steps = 2 * np.maximum(np.ceil(largest / STEP), 1.0).astype(np.intp)
    parabola, k = number_parts(steps)
    ends = []
    for node in (k, k + 1):
        w = largest[parabola] * (2 * node / steps[parabola] - 1)
        tan = np.sinh(w)
        ends += [np.stack([tan, tan * tan / 2], axis=1)]
        ends += [np.stack([1 / np.cosh(w), np.tanh(w)], axis=1)]
    return join_pairs(*make_biarcs(*ends)), np.repeat(parabola, 2)


def _length_of_parabolas(half: FloatArray) -> FloatArray:
    """Return lengths of the arcs along parabolas divided by their smallest radii, (n,).

    - `half`: halves of the turns [rad], (n,).
    """
    arcs, corner = _draw_parabolas(half)
    return np.asarray(np.bincount(corner, arcs.lengths, minlength=len(half)), dtype=float)


ARC = LineCorner(
    # `corner_error` has no cancellation at small turns.
    error_ratio=lambda h: corner_error(np.ones(1), h),
    tangent_ratio=np.tan,
    length_ratio=lambda h: 2 * h,
    shortest_ratio=np.ones_like,
    draw_with_radius=_draw_arcs,
)
PARABOLA = LineCorner(
    error_ratio=lambda h: np.tan(h) ** 2 / 2,
    tangent_ratio=lambda h: np.sin(h) / np.cos(h) ** 2,
    length_ratio=_length_of_parabolas,
    # The smallest radius must not be below the resolution of a point either.
    shortest_ratio=lambda h: np.maximum(np.sin(h) / np.cos(h) ** 2, 1.0),
    draw_with_radius=_draw_corner_parabolas,
)
SMOOTH = LineCorner(
    # This form is in the frame of the apex and has no cancellation at small turns.
    error_ratio=lambda h: (
        h * PEAK_RATIO * _mean_over_half(h, lambda angle: np.sin(h - angle)) / np.cos(h)
    ),
    tangent_ratio=_smooth_tangent_ratio,
    length_ratio=lambda h: 2 * h * PEAK_RATIO,
    # Each quintic, and the smallest radius, must be longer than the resolution of a point.
    shortest_ratio=lambda h: np.maximum(2 * _count_quintics(h), _smooth_tangent_ratio(h)),
    draw_with_radius=_draw_smooth_curves,
    smooth=True,
)


def fit_lengths(requested: FloatArray, vertex: IntArray, lengths: FloatArray) -> FloatArray:
    """Reduce the lengths that vertices request on either side until they fit the segments [m].

    A vertex may use half of a segment, or more if the vertex at the other end requests less than
    half. This rule depends on direct neighbours only, gives the same result in both directions of
    travel, and always has a solution.

    Returns the reduced lengths, (n,).

    - `requested`: requested lengths on either side [m], (n,).
    - `vertex`: index of the segment before each vertex, increasing, (n,).
    - `lengths`: lengths of all segments [m].
    """
    by_vertex = np.zeros(len(lengths) + 1)
    by_vertex[vertex + 1] = requested
    # Length of each segment that is available for the vertex at its end, and at its start.
    room_before = np.maximum(lengths / 2, lengths - by_vertex[:-1])
    room_after = np.maximum(lengths / 2, lengths - by_vertex[1:])
    return np.asarray(
        np.minimum(requested, np.minimum(room_before[vertex], room_after[vertex + 1]))
    )


def replace_vertices(
    rows: Segments, cut: FloatArray, drawn: Segments, after: IntArray
) -> tuple[Segments, IntArray, IntArray]:
    """Replace the parts on both sides of vertices by other segments.

    Returns the new table and two indices for each of its segments. The first is an index in `rows`:
    of the segment that contains the new segment, or, for a segment from `drawn`, of the segment
    before the vertex. The second is the index in `drawn`; it is negative for a segment from `rows`.

    - `cut`: length that is replaced on either side of each of the n + 1 vertices [m], (n + 1,).
    - `drawn`: the replacing segments, in order at each vertex.
    - `after`: for each replacing segment, index of the segment in `rows` that is before its vertex.
    """
    n = len(rows)
    starts = rows.starts + cut[:-1, None] * rows.tangents
    lengths = rows.lengths - cut[:-1] - cut[1:]
    shorter = rows.replace(starts=starts, lengths=lengths)
    # On a curve, the tangent at the new start is different. A transition has other coefficients.
    changed = ((rows.curvatures > 0) & (cut[:-1] > 0)) | (rows.is_transition & (cut[1:] > 0))
    if changed.any():
        ends = (rows.lengths - cut[1:])[changed]
        shorter = shorter.replace_rows(
            changed, rows.cut(np.flatnonzero(changed), cut[:-1][changed], ends)
        )
    table = Segments.join([shorter, drawn])
    source = np.concatenate([np.arange(n), after])
    # A remainder of an arc is discarded only if the tangent turns along it by at most a rounding
    # error.
    used = table.lengths > SLIVER / np.maximum(1.0, SLIVER / STRAIGHT * table.curvatures)
    used[n:] = True
    order = np.argsort(source, kind="stable")
    order = order[used[order]]
    return table[order], source[order], order - n
