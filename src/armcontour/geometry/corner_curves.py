"""Kinds of curves that replace corners, one entry each; the kinds next to arcs are in blends.py.

ARC, PARABOLA and SMOOTH, a smooth bend, replace corners between two lines. They are symmetric about
the bisector and replace the same length of either line, the tangent length. Each is given by its
smallest radius, that in the middle of the corner. h is half the turn.

The parabola is that of a quadratic Bézier curve with the corner point as its middle control point:
with smallest radius r it is y = x² / (2 r) about its apex. Its tangent length is r sin h / cos² h,
and its corner error is r tan² h / 2, which is half the tangent length times sin h. It is drawn as
tangent arcs. At the same corner error it is longer than the arc, and its middle is tighter: a tool
with a constant acceleration moves on a parabola, slower in the middle than at its ends.

The smooth bend starts and ends straight. Over its length its curvature is (1 - x²)² / r, where x
runs from -1 to 1: neither the curvature nor its derivative jumps. Its length is BEND times that of
the arc with the radius r. It is drawn as transitions.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.core.sampling import number_parts
from armcontour.geometry.biarcs import biarcs, dot, join_up, unit
from armcontour.geometry.rounded_orientation import middle_of
from armcontour.geometry.segments import REPEATED_POINT, Segments, share_limits

# A parabola is drawn by two arcs for each step of asinh(tan(angle of its tangent)) up to this: from
# one arc to the next the curvature changes by a factor of 1.7 at most, 1.34 at a turn of 90°, and
# the arcs are within 3e-4 of its corner error from it.
STEP = 0.25
# Largest curvature of a smooth bend over its mean curvature.
BEND = 15 / 8
# Quintics in each half of a smooth bend: this times the power 0.45 of half the turn. The arc length
# then is that of the curve within 1e-6, see `transitions`.
QUINTICS = 7.8
# Places and weights by which smooth integrals over -1 to 1 are exact to rounding errors, and those
# for half of a smooth bend, which turns farther.
FEW, MANY = (np.polynomial.legendre.leggauss(n) for n in (10, 32))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Bounds:
    """What n corners have to keep, and the segments beside them.

    Args:
        before: Segments before the corners, n.
        after: Segments after the corners, n.
        half: Half of the turns [rad], (n,).
        error: Largest corner errors [m], (n,).
        radius: Radii that are large enough for the corner speeds [m], infinite without one, (n,).
        turn: Largest `t / 2 - middle length` for a tangent length t, which the tool's orientation
            allows [m], (n,); see `middle_of`.
        tangent: Largest tangent lengths [m], (n,).
    """

    before: Segments
    after: Segments
    half: FloatArray
    error: FloatArray
    radius: FloatArray
    turn: FloatArray
    tangent: FloatArray

    def __getitem__(self, rows: IntArray) -> Bounds:
        """The bounds of the selected corners, in increasing order."""
        if len(rows) == len(self.half):
            return self
        return Bounds(**{name: getattr(self, name)[rows] for name in self.__slots__})


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Drawn:
    """What replaces n corners.

    Args:
        rows: The segments, in order at each corner.
        of: The corner of each segment.
        radius: Smallest radii [m], infinite for a straight one, (n,).
        error: Corner errors [m], (n,).
        shrunk: Mask of the corners that are rounded less than their bounds allow, (n,).
    """

    rows: Segments
    of: IntArray
    radius: FloatArray
    error: FloatArray
    shrunk: BoolArray


class CornerKind(ABC):
    """A kind of curve that replaces corners.

    Attributes:
        smooth: Whether its curvature nowhere jumps, also at its ends.
    """

    smooth: bool

    @abstractmethod
    def shortest(self, half: FloatArray) -> FloatArray:
        """Tangent lengths up to which the curve is smaller than a point's resolution [m], (n,)."""

    @abstractmethod
    def fit(self, bounds: Bounds) -> FloatArray:
        """Largest tangent lengths of curves within bounds [m], (n,); 0 where none fits."""

    @abstractmethod
    def draw(self, bounds: Bounds, tangent: FloatArray) -> Drawn:
        """Curves with given tangent lengths [m], above 0 and no longer than the segments, (n,)."""


@dataclass(frozen=True, slots=True)
class LineCorner(CornerKind):
    """A curve between two lines, given by its measures over its smallest radius.

    Args:
        gap: Corner error, by half the turn.
        stretch: Tangent length.
        length: Length of what is drawn.
        least: As `shortest`, over `REPEATED_POINT`.
        lay: Draws curves by bounds and smallest radii [m]; gives the segments and their corners.
        smooth: Whether its curvature nowhere jumps.
    """

    gap: Callable[[FloatArray], FloatArray]
    stretch: Callable[[FloatArray], FloatArray]
    length: Callable[[FloatArray], FloatArray]
    least: Callable[[FloatArray], FloatArray]
    lay: Callable[[Bounds, FloatArray], tuple[Segments, IntArray]]
    smooth: bool = False

    def shortest(self, half: FloatArray) -> FloatArray:
        """Tangent lengths up to which the curve is too small [m], (n,)."""
        return REPEATED_POINT * self.least(half)

    def fit(self, bounds: Bounds) -> FloatArray:
        """Largest tangent lengths within bounds [m], (n,)."""
        half, stretch = bounds.half, self.stretch(bounds.half)
        turn = bounds.turn / (0.5 - self.length(half) / stretch * middle_of(self.smooth))
        wide = self._radius(bounds) * stretch
        return np.asarray(np.minimum(np.minimum(wide, turn), bounds.tangent))

    def draw(self, bounds: Bounds, tangent: FloatArray) -> Drawn:
        """Curves with given tangent lengths [m], (n,)."""
        stretch, radius = self.stretch(bounds.half), self._radius(bounds)
        shrunk = tangent < radius * stretch * (1 - 1e-12)
        radius = np.where(shrunk, tangent / stretch, radius)
        rows, of = self.lay(bounds, radius)
        segment_limits = share_limits(bounds.before, bounds.after)
        rows = rows.replace(**{name: column[of] for name, column in segment_limits.items()})
        error = radius * self.gap(bounds.half)
        return Drawn(rows=rows, of=of, radius=radius, error=error, shrunk=shrunk)

    def _radius(self, bounds: Bounds) -> FloatArray:
        """Smallest radii of the curves by case I or case II [m], (n,)."""
        return np.asarray(np.minimum(bounds.error / self.gap(bounds.half), bounds.radius))


def _lay_arcs(bounds: Bounds, radius: FloatArray) -> tuple[Segments, IntArray]:
    """One arc per corner, (10)-(16)."""
    before, after, half = bounds.before, bounds.after, bounds.half
    normals = after.tangents - dot(before.tangents, after.tangents)[:, None] * before.tangents
    arcs = before.replace(
        starts=after.starts - (radius * np.tan(half))[:, None] * before.tangents,
        normals=unit(normals),
        curvatures=1 / radius,
        lengths=radius * 2 * half,
    )
    return arcs, np.arange(len(radius))


def _lay_parabolas(bounds: Bounds, radius: FloatArray) -> tuple[Segments, IntArray]:
    """One parabola per corner, drawn as four or more tangent arcs."""
    arcs, corner = _draw_parabolas(bounds.half)
    along, across = _axes(bounds)
    apex = bounds.after.starts + (radius * PARABOLA.gap(bounds.half))[:, None] * across
    along, across, scale = along[corner], across[corner], radius[corner]

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


def _lay_bends(bounds: Bounds, radius: FloatArray) -> tuple[Segments, IntArray]:
    """One smooth bend per corner, drawn as transitions."""
    half = bounds.half
    parts = _count_quintics(half)
    corner, number = number_parts(2 * parts)
    along, across = (x[corner] for x in _axes(bounds))
    h, size = half[corner], (half * BEND * radius)[corner]
    x = [(number + end) / parts[corner] - 1 for end in (0, 1)]

    def turned(cos: FloatArray, sin: FloatArray) -> FloatArray:
        return np.asarray(cos[:, None] * along + sin[:, None] * across)

    angles = [h * _share_of_turn(end) for end in x]
    tangents = [turned(np.cos(angle), np.sin(angle)) for angle in angles]
    bends = [
        turned(-np.sin(angle), np.cos(angle)) * (h * BEND * (1 - end * end) ** 2 / size)[:, None]
        for angle, end in zip(angles, x, strict=True)
    ]
    places = x[0] + (x[1] - x[0]) * (FEW[0][:, None] + 1) / 2
    angle = h * _share_of_turn(places)
    step = size / parts[corner]
    steps = turned(*(step / 2 * (FEW[1] @ of(angle)) for of in (np.cos, np.sin)))
    back = (radius * _stretch_of_bends(half))[:, None] * bounds.before.tangents
    sums = np.cumsum(steps, axis=0) - steps
    starts = (bounds.after.starts - back)[corner] + sums - sums[number == 0][corner]
    return join_up((starts, tangents[0], bends[0]), (steps, tangents[1], bends[1]), step), corner


def corner_error(radius: FloatArray, half_turn: FloatArray) -> FloatArray:
    """Gap between corner point and arc [m], (10): `r (1 - cos h) / cos h`.

    Args:
        radius: Radius r of the arc [m].
        half_turn: Half h of the angle between the lines [rad].
    """
    return np.asarray(radius * 2 * np.sin(half_turn / 2) ** 2 / np.cos(half_turn))


def _axes(bounds: Bounds) -> tuple[FloatArray, FloatArray]:
    """Unit vectors along the middle tangents of corners between lines, and to their insides."""
    along = unit(bounds.before.tangents + bounds.after.tangents)
    across = unit(bounds.after.tangents - bounds.before.tangents)
    # At a slight turn rounding errors have tilted the direction across.
    return along, unit(across - dot(across, along)[:, None] * along)


def _share_of_turn(x: FloatArray) -> FloatArray:
    """Angle of the tangent of a smooth bend at x from -1 to 1, over half the turn."""
    return np.asarray(x * (15 - 10 * x**2 + 3 * x**4) / 8)


def _over_half(half: FloatArray, of: Callable[[FloatArray], FloatArray]) -> FloatArray:
    """Mean of a function of the tangent's angle over half of a smooth bend, (n,)."""
    angles = half * _share_of_turn((MANY[0][:, None] + 1) / 2)
    return np.asarray(MANY[1] @ of(angles) / 2)


def _stretch_of_bends(half: FloatArray) -> FloatArray:
    """Tangent lengths of smooth bends over their smallest radii, (n,)."""
    return np.asarray(half * BEND * _over_half(half, np.cos) / np.cos(half))


def _count_quintics(half: FloatArray) -> IntArray:
    """Number of quintics in half of a smooth bend, (n,)."""
    return np.maximum(np.ceil(QUINTICS * half**0.45), 1).astype(np.intp)


def _draw_parabolas(half: FloatArray) -> tuple[Segments, IntArray]:
    """Tangent arcs along the parabolas y = x² / 2, from tangent angle -h to h.

    Their nodes are on the parabola and have its tangents; one is the apex.

    Args:
        half: The angles h [rad], (n,).

    Returns:
        The arcs in the plane, in order, and the parabola of each.
    """
    # With w = asinh(tan(angle)) the curvature is cosh(w)**-3: it changes by 3 tanh(w) dw.
    most = np.arcsinh(np.tan(half))
    steps = 2 * np.maximum(np.ceil(most / STEP), 1.0).astype(np.intp)
    which, k = number_parts(steps)
    ends = []
    for node in (k, k + 1):
        w = most[which] * (2 * node / steps[which] - 1)
        tan = np.sinh(w)
        ends += [np.stack([tan, tan * tan / 2], axis=1)]
        ends += [np.stack([1 / np.cosh(w), np.tanh(w)], axis=1)]
    first, second = biarcs(*ends)
    order = np.arange(2 * len(which)).reshape(2, -1).T.ravel()
    return Segments.join([first, second])[order], np.repeat(which, 2)


def _length_of_parabolas(half: FloatArray) -> FloatArray:
    """Lengths of the arcs along parabolas over their smallest radii, (n,)."""
    arcs, corner = _draw_parabolas(half)
    return np.asarray(np.bincount(corner, arcs.lengths, minlength=len(half)), dtype=float)


ARC = LineCorner(
    # (11), without cancellation at small turns.
    gap=lambda h: corner_error(np.ones(1), h),
    stretch=np.tan,
    length=lambda h: 2 * h,
    least=np.ones_like,
    lay=_lay_arcs,
)
PARABOLA = LineCorner(
    gap=lambda h: np.tan(h) ** 2 / 2,
    stretch=lambda h: np.sin(h) / np.cos(h) ** 2,
    length=_length_of_parabolas,
    # Its smallest radius must not be below the resolution of a point either.
    least=lambda h: np.maximum(np.sin(h) / np.cos(h) ** 2, 1.0),
    lay=_lay_parabolas,
)
SMOOTH = LineCorner(
    # In the frame of the apex, without cancellation at small turns.
    gap=lambda h: h * BEND * _over_half(h, lambda angle: np.sin(h - angle)) / np.cos(h),
    stretch=_stretch_of_bends,
    length=lambda h: 2 * h * BEND,
    # Each of its quintics is longer than that resolution, and so is its smallest radius.
    least=lambda h: np.maximum(2 * _count_quintics(h), _stretch_of_bends(h)),
    lay=_lay_bends,
    smooth=True,
)
