"""Curves that replace the corner between two lines: an arc, a parabola, or a smooth bend.

All are symmetric about the bisector and replace the same length of either line, the tangent
length. Each is told by its smallest radius, that in the middle of the corner. h is half the turn.

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

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour._parts import number_parts
from armcontour.geometry.biarcs import biarcs, dot, unit
from armcontour.geometry.segments import REPEATED_POINT, TANGENT_TOLERANCE, Segments, share_demand
from armcontour.geometry.transitions import join_up, spread_out

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


class CornerCurve(ABC):
    """A kind of curve for corners between two lines, by smallest radius r and half turn h.

    Attributes:
        smooth: Whether its curvature is 0 at its ends and nowhere jumps.
    """

    smooth = False

    @abstractmethod
    def largest_radius(self, error: FloatArray, half: FloatArray) -> FloatArray:
        """Smallest radius of the curve with corner error `error` [m], (n,)."""

    @abstractmethod
    def error(self, radius: FloatArray, half: FloatArray) -> FloatArray:
        """Corner error [m], (n,)."""

    @abstractmethod
    def stretch(self, half: FloatArray) -> FloatArray:
        """Tangent length over smallest radius, (n,)."""

    @abstractmethod
    def length(self, half: FloatArray) -> FloatArray:
        """Length of what is drawn over smallest radius, (n,)."""

    @abstractmethod
    def shortest(self, half: FloatArray) -> FloatArray:
        """Tangent lengths up to which the curve is smaller than a point's resolution [m], (n,)."""

    @abstractmethod
    def draw(
        self, before: Segments, after: Segments, radius: FloatArray, half: FloatArray
    ) -> tuple[Segments, IntArray]:
        """The curves of n corners, and the corner of each of their segments.

        Args:
            before: The lines before the corners, n.
            after: The lines after the corners, n.
            radius: Smallest radii [m], (n,).
            half: Half of the turns [rad], (n,).
        """


class _CircularArc(CornerCurve):
    """One arc per corner, (10)-(16)."""

    def largest_radius(self, error: FloatArray, half: FloatArray) -> FloatArray:
        # (11), without cancellation at small turns.
        return np.asarray(error * np.cos(half) / (2 * np.sin(half / 2) ** 2))

    def error(self, radius: FloatArray, half: FloatArray) -> FloatArray:
        return corner_error(radius, half)

    def stretch(self, half: FloatArray) -> FloatArray:
        return np.asarray(np.tan(half))

    def length(self, half: FloatArray) -> FloatArray:
        return np.asarray(2 * half)

    def shortest(self, half: FloatArray) -> FloatArray:
        return np.full(len(half), REPEATED_POINT)

    def draw(
        self, before: Segments, after: Segments, radius: FloatArray, half: FloatArray
    ) -> tuple[Segments, IntArray]:
        across = np.sum(before.tangents * after.tangents, axis=1, keepdims=True)
        normals = after.tangents - across * before.tangents
        arcs = before.replace(
            starts=after.starts - (radius * np.tan(half))[:, None] * before.tangents,
            normals=normals / np.linalg.norm(normals, axis=1, keepdims=True),
            curvatures=1 / radius,
            lengths=radius * 2 * half,
            **share_demand(before, after),
        )
        return arcs, np.arange(len(radius))


class _Parabola(CornerCurve):
    """One parabola per corner, drawn as four or more tangent arcs."""

    def largest_radius(self, error: FloatArray, half: FloatArray) -> FloatArray:
        return np.asarray(2 * error / np.tan(half) ** 2)

    def error(self, radius: FloatArray, half: FloatArray) -> FloatArray:
        return np.asarray(radius * np.tan(half) ** 2 / 2)

    def stretch(self, half: FloatArray) -> FloatArray:
        return np.asarray(np.sin(half) / np.cos(half) ** 2)

    def length(self, half: FloatArray) -> FloatArray:
        arcs, corner = _draw_parabolas(half)
        return np.asarray(np.bincount(corner, arcs.lengths, minlength=len(half)), dtype=float)

    def shortest(self, half: FloatArray) -> FloatArray:
        # Its smallest radius must not be below that resolution either.
        return REPEATED_POINT * np.maximum(self.stretch(half), 1.0)

    def draw(
        self, before: Segments, after: Segments, radius: FloatArray, half: FloatArray
    ) -> tuple[Segments, IntArray]:
        arcs, corner = _draw_parabolas(half)
        along, across = _axes(before, after)
        apex = after.starts + self.error(radius, half)[:, None] * across
        along, across, scale = along[corner], across[corner], radius[corner]

        def lay(v: FloatArray) -> FloatArray:
            return np.asarray(v[:, :1] * along + v[:, 1:] * across)

        drawn = before[corner].replace(
            starts=apex[corner] + scale[:, None] * lay(arcs.starts),
            tangents=lay(arcs.tangents),
            normals=lay(arcs.normals),
            curvatures=arcs.curvatures / scale,
            lengths=arcs.lengths * scale,
            **share_demand(before[corner], after[corner]),
        )
        return drawn, corner


class _SmoothBend(CornerCurve):
    """One smooth bend per corner, drawn as transitions."""

    smooth = True

    def largest_radius(self, error: FloatArray, half: FloatArray) -> FloatArray:
        return np.asarray(error / self.error(np.ones(1), half))

    def error(self, radius: FloatArray, half: FloatArray) -> FloatArray:
        # In the frame of the apex, without cancellation at small turns.
        rest = _over_half(half, lambda angle: np.sin(half - angle))
        return np.asarray(radius * half * BEND * rest / np.cos(half))

    def stretch(self, half: FloatArray) -> FloatArray:
        return np.asarray(half * BEND * _over_half(half, np.cos) / np.cos(half))

    def length(self, half: FloatArray) -> FloatArray:
        return np.asarray(2 * half * BEND)

    def shortest(self, half: FloatArray) -> FloatArray:
        # Each of its quintics is longer than that resolution, and so is its smallest radius.
        return REPEATED_POINT * np.maximum(2 * _count_quintics(half), self.stretch(half))

    def draw(
        self, before: Segments, after: Segments, radius: FloatArray, half: FloatArray
    ) -> tuple[Segments, IntArray]:
        parts = _count_quintics(half)
        corner, number = spread_out(2 * parts)
        along, across = (x[corner] for x in _axes(before, after))
        h, size = half[corner], (half * BEND * radius)[corner]
        x = [(number + end) / parts[corner] - 1 for end in (0, 1)]

        def lay(cos: FloatArray, sin: FloatArray) -> FloatArray:
            return np.asarray(cos[:, None] * along + sin[:, None] * across)

        angles = [h * _share_of_turn(end) for end in x]
        tangents = [lay(np.cos(angle), np.sin(angle)) for angle in angles]
        bends = [
            lay(-np.sin(angle), np.cos(angle)) * (h * BEND * (1 - end * end) ** 2 / size)[:, None]
            for angle, end in zip(angles, x, strict=True)
        ]
        places = x[0] + (x[1] - x[0]) * (FEW[0][:, None] + 1) / 2
        turned = h * _share_of_turn(places)
        step = size / parts[corner]
        steps = lay(*(step / 2 * (FEW[1] @ of(turned)) for of in (np.cos, np.sin)))
        first = after.starts - (radius * self.stretch(half))[:, None] * before.tangents
        sums = np.cumsum(steps, axis=0) - steps
        starts = first[corner] + sums - sums[number == 0][corner]
        drawn = join_up((starts, tangents[0], bends[0]), (steps, tangents[1], bends[1]), step)
        return drawn.replace(**share_demand(before[corner], after[corner])), corner


ARC = _CircularArc()
PARABOLA = _Parabola()
SMOOTH = _SmoothBend()


def corner_error(radius: FloatArray, half_turn: FloatArray) -> FloatArray:
    """Gap between corner point and arc [m], (10): `r (1 - cos h) / cos h`.

    Args:
        radius: Radius r of the arc [m].
        half_turn: Half h of the angle between the lines [rad].
    """
    return np.asarray(radius * 2 * np.sin(half_turn / 2) ** 2 / np.cos(half_turn))


def _axes(before: Segments, after: Segments) -> tuple[FloatArray, FloatArray]:
    """Unit vectors along the middle tangents of corners between lines, and to their insides."""
    along = unit(before.tangents + after.tangents)
    across = unit(after.tangents - before.tangents)
    # At a slight turn rounding errors have tilted the direction across.
    return along, unit(across - dot(across, along)[:, None] * along)


def _share_of_turn(x: FloatArray) -> FloatArray:
    """Angle of the tangent of a smooth bend at x from -1 to 1, over half the turn."""
    return np.asarray(x * (15 - 10 * x**2 + 3 * x**4) / 8)


def _over_half(half: FloatArray, of: Callable[[FloatArray], FloatArray]) -> FloatArray:
    """Mean of a function of the tangent's angle over half of a smooth bend, (n,)."""
    angles = half * _share_of_turn((MANY[0][:, None] + 1) / 2)
    return np.asarray(MANY[1] @ of(angles) / 2)


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
    # Where the path turns back no parabola is drawn, but its length is asked for.
    most = np.arcsinh(np.tan(np.minimum(half, (np.pi - TANGENT_TOLERANCE) / 2)))
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
