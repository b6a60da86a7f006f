"""Smooth connections across a vertex, from a place before it to a place after it.

A connection has the points, tangents, curvatures and changes of curvature of the segments at both
ends. It is a polynomial of degree 7, which is drawn as transitions: quintics between places on it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.core.quintics import rescale
from armcontour.core.sampling import number_parts
from armcontour.geometry.biarcs import (
    UNEVEN,
    Contact,
    contact_of,
    dot,
    join_up,
    largest_change,
    length,
    unit,
)
from armcontour.geometry.segments import EVERY, Segments, largest_bend

DEGREE = 7
# The last four coefficients over what the first four leave of the end's value and derivatives.
LAST = np.linalg.inv([[math.perm(j, k) for j in range(4, 8)] for k in range(4)])
# Places and weights by which lengths are integrated; they are exact to rounding errors for the
# bends that are drawn.
PLACES, WEIGHTS = np.polynomial.legendre.leggauss(16)
SHARES = (PLACES + 1) / 2
# The length of a connection is made to fit its parametrization so often: it need not fit exactly.
ROUNDS = 3
# Newton's steps to a place on a connection; they end at rounding errors.
STEPS = 8
# A connection is drawn in two halves of up to this many quintics each, and looked at in so many
# places of each to see whether its length is even.
MOST_PARTS = 64
LOOKS = np.linspace(0.1, 0.9, 5)
# Places at which the shape of a connection is judged.
MANY = np.linspace(0.0, 1.0, 33)
# A connection is none if its speed varies by more, if it turns farther from its middle direction,
# or if its largest curvature times its length is more: it would not be one even bend.
SLOWEST, FASTEST = 0.5, 1.6
FARTHEST = np.cos(np.radians(72))
TIGHTEST = 10.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Connections:
    """The connections across n vertices.

    Args:
        begin: Where they begin, relative to the vertices [m], (n, dimension).
        coefficients: Coefficients from 1 to x⁷ of the way from there, x from 0 to 1 [m],
            (n, 8, dimension).
    """

    begin: FloatArray
    coefficients: FloatArray

    def __len__(self) -> int:
        """Number of connections."""
        return len(self.begin)

    def at(self, i: IntArray | slice, x: FloatArray, order: int = 0) -> FloatArray:
        """Ways from the starts of connections `i` at x, or their derivatives by x."""
        c = self.coefficients[i]
        found = np.zeros(np.shape(x) + c.shape[-1:])
        for k in range(DEGREE, order - 1, -1):
            found = found * x[..., None] + math.perm(k, order) * c[..., k, :]
        return np.asarray(found)

    def lengths_to(self, i: IntArray | slice, x: FloatArray) -> FloatArray:
        """Arc lengths from the starts of connections `i` to x [m], (n,)."""
        return np.asarray(WEIGHTS @ length(self.at(i, SHARES[:, None] * x, 1)) * x / 2)

    @property
    def nearest(self) -> FloatArray:
        """Where the connections are nearest to their vertices, x from 0 to 1, (n,)."""
        places = self._many[1:-1]
        x = MANY[1 + length(self.begin + self.at(EVERY, places)).argmin(axis=0)]
        for _ in range(STEPS):
            off = self.begin + self.at(EVERY, x)
            first, second = self.at(EVERY, x, 1), self.at(EVERY, x, 2)
            slope = np.maximum(dot(first, first) + dot(off, second), 0.1 * dot(first, first))
            x = np.clip(x - dot(off, first) / slope, MANY[1], MANY[-2])
        return np.asarray(x)

    @property
    def largest_bend(self) -> FloatArray:
        """Largest curvatures at many places [1/m], (n,)."""
        return np.asarray(length(self.contact(EVERY, self._many)[2]).max(axis=0))

    @property
    def _many(self) -> FloatArray:
        """Many places on every connection, (places, n)."""
        return np.tile(MANY[:, None], len(self))

    @property
    def sound(self) -> BoolArray:
        """Mask of the connections that bend from end to end without loops or cusps, (n,)."""
        first = self.at(EVERY, self._many, 1)
        speeds = length(first)
        along = dot(first, unit(first[0] + first[-1])) / speeds
        mean = speeds.mean(axis=0)
        even = (speeds.min(axis=0) > SLOWEST * mean) & (speeds.max(axis=0) < FASTEST * mean)
        tight = self.largest_bend * mean > TIGHTEST
        return np.asarray(even & ~tight & (along.min(axis=0) > FARTHEST))

    def contact(self, i: IntArray | slice, x: FloatArray) -> Contact:
        """Ways from the starts, unit tangents and curvature vectors of connections `i` at x."""
        return self.at(i, x), *contact_of(self.at(i, x, 1), self.at(i, x, 2))


def connect(before: Segments, after: Segments, t: FloatArray) -> Connections:
    """Connections that replace the length t of the segments on either side of vertices.

    Args:
        before: Segments before the vertices, n.
        after: Segments after the vertices, n.
        t: Lengths, no longer than the segments [m], (n,).
    """
    every = np.arange(len(t))
    back, ahead = around_vertices(before, after)
    begin = [(-1) ** k * back.at(every, t, k) for k in range(4)]
    end = [ahead.at(every, t, k) for k in range(4)]
    way, size = end[0] - begin[0], 2 * t
    for _ in range(ROUNDS):
        scale = [size[:, None] ** k for k in range(4)]
        c = np.zeros((len(t), DEGREE + 1, way.shape[1]))
        for k, factor in ((1, 1), (2, 2), (3, 6)):
            c[:, k] = begin[k] * scale[k] / factor
        rest = [
            (way if k == 0 else end[k] * scale[k])
            - sum(math.perm(j, k) * c[:, j] for j in range(max(k, 1), 4))
            for k in range(4)
        ]
        c[:, 4:] = np.einsum("jk,knd->njd", LAST, np.stack(rest))
        found = Connections(begin=begin[0], coefficients=c)
        size = found.lengths_to(EVERY, np.ones(len(t)))
    return found


def around_vertices(before: Segments, after: Segments) -> tuple[Segments, Segments]:
    """Segments before vertices, run backwards, and those after them, all from an origin of zero.

    Places near a vertex then keep all their digits.
    """
    zero = np.zeros_like(after.starts)
    back = before.run(np.arange(len(before)), np.full(len(before), True))
    return back.replace(starts=zero), after.replace(starts=zero)


def draw_connections(
    found: Connections, vertices: FloatArray, middle: FloatArray
) -> tuple[Segments, IntArray, BoolArray]:
    """Transitions along connections, as evenly as `UNEVEN` asks for.

    Args:
        found: The connections, n.
        vertices: Their vertices [m], (n, dimension).
        middle: Where their halves meet, x from 0 to 1, (n,).

    Returns:
        The transitions in order, the connection of each, and the mask of those before the middle.
    """
    parts = np.full(len(found), 1)
    drawn, of, first = _draw(found, vertices, middle, parts)
    while True:
        speeds = [length(drawn.at(EVERY, share * drawn.lengths, 1)) for share in LOOKS]
        uneven = np.abs(np.stack(speeds) - 1).max(axis=0)
        rough = np.unique(of[uneven > UNEVEN / 2])
        rough = rough[parts[rough] < MOST_PARTS]
        if not len(rough):
            return drawn, of, first
        worst = np.zeros(len(found))
        np.maximum.at(worst, of, uneven)
        # The unevenness falls with about the fifth power of the lengths.
        more = np.ceil(parts[rough] * (worst[rough] / (UNEVEN / 2)) ** 0.2)
        parts[rough] = np.minimum(np.maximum(more, parts[rough] + 1), MOST_PARTS)
        drawn, of, first = _draw(found, vertices, middle, parts)


def _draw(
    found: Connections, vertices: FloatArray, middle: FloatArray, parts: IntArray
) -> tuple[Segments, IntArray, BoolArray]:
    """Transitions along connections, in halves of so many quintics each, (n,)."""
    every = np.arange(len(found))
    half = found.lengths_to(EVERY, middle)
    whole = found.lengths_to(EVERY, np.ones(len(found)))
    of, number = number_parts(2 * parts)
    first = number < parts[of]
    step = np.where(first, half[of], (whole - half)[of]) / parts[of]
    # Places on the connections at the ends of the quintics.
    node = np.where(first, number, number - parts[of])
    s = np.where(first, 0.0, half[of]) + node * step
    low, high = np.where(first, 0.0, middle[of]), np.where(first, middle[of], 1.0)
    x = low + (high - low) * node / parts[of]
    inner = node > 0
    i, place, goal = of[inner], x[inner], s[inner]
    for _ in range(STEPS):
        off = found.lengths_to(i, place) - goal
        place = np.clip(place - off / length(found.at(i, place, 1)), 0.0, 1.0)
    x[inner] = place
    begin = found.contact(of, x)
    last = number == 2 * parts[of] - 1
    final = found.contact(every, np.ones(len(found)))
    end = [np.empty_like(v) for v in begin]
    for k in range(3):
        end[k][:-1] = begin[k][1:]
        end[k][last] = final[k]
    way = end[0] - begin[0]
    starts = vertices[of] + found.begin[of] + begin[0]
    return join_up((starts, *begin[1:]), (way, end[1], end[2]), step), of, first


def bound_deviation(
    drawn: Segments, old: Segments, i: IntArray, ends: tuple[FloatArray, FloatArray], parts: int
) -> FloatArray:
    """Bounds of the distances between transitions and the parts of a path that they replace [m].

    Both are passed evenly. Along each of the parts in which they are looked at, the way D between
    their points is at most the larger one at its ends and an eighth of the largest D'' more.

    Args:
        drawn: The transitions, n.
        old: The segments of the path.
        i: The segment that each transition replaces a part of, (n,).
        ends: Distances along these segments of the ends of these parts [m], (n,) each.
        parts: Number of parts.

    Returns:
        Bounds of the distance of either from the other, (n,).
    """
    row, number = number_parts(np.full(len(drawn), parts))
    h = drawn.lengths[row] / parts
    step = ((ends[1] - ends[0]) / parts)[row]
    low = ends[0][row] + number * step
    which, ratio = i[row], step / h
    off = [
        length(drawn.at(row, (number + share) * h) - old.at(which, low + share * step))
        for share in (0, 1)
    ]
    # The second derivative of the old path, over the length of the transition, and how much it
    # changes to either side of the middle.
    bend = ratio[:, None] ** 2 * old.at(which, low + step / 2, 2)
    change = old.curvatures[which] ** 2
    if old.quintics.size:
        bent = old.bent[which]
        rows = which[bent]
        change[bent] = largest_change(old.quintics[rows], old.lengths[rows])
    more = ratio**2 * change * step / 2
    relative = rescale(drawn.quintics[row], number / parts, np.full(len(row), 1 / parts))
    relative[:, 2] -= bend * (h**2 / 2)[:, None]
    bound = np.maximum(*off) + h**2 / 8 * (largest_bend(relative, h) + more)
    return np.asarray(bound.reshape(len(drawn), parts).max(axis=1))
