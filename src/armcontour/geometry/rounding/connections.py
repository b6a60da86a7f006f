"""Smooth connections across a vertex, between a point before and a point after the vertex.

At both ends, a connection has the segment's point, tangent, curvature and curvature derivative. It
is a polynomial of degree 7, drawn as transitions: quintics between points on it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.core.quintics import rescale
from armcontour.core.sampled_data import number_parts
from armcontour.geometry.biarcs import (
    UNEVEN,
    Contact,
    bound_third_derivatives,
    dot,
    join_by_quintics,
    length,
    tangent_and_curvature,
    unit,
)
from armcontour.geometry.orientation import evaluate_polynomials
from armcontour.geometry.segments import EVERY, Segments, bound_second_derivatives

DEGREE = 7
# Matrix from residuals to the last four coefficients. The residuals are the value and the first
# three derivatives at the end, minus the contributions of the first four coefficients.
END_TO_COEFFICIENTS = np.linalg.inv([[math.perm(j, k) for j in range(4, 8)] for k in range(4)])
# Nodes and weights that integrate a connection's arc length exactly up to rounding errors.
NODES, WEIGHTS = np.polynomial.legendre.leggauss(16)
NODE_PARAMETERS = (NODES + 1) / 2
# Number of iterations that scale the end derivatives by the length of the connection. The scale
# need not be exact.
SCALE_ITERATIONS = 3
# Number of Newton steps in the search for a parameter of a connection; sufficient for an error at
# rounding level.
NEWTON_STEPS = 8
# Smallest slope in the search for the point nearest to a vertex, divided by the squared speed.
SMALLEST_SLOPE = 0.1
# Largest number of quintics in each connection half, and the fractions of each quintic at which its
# speed is checked.
MAX_PARTS = 64
SPEED_SAMPLES = np.linspace(0.1, 0.9, 5)
# Parameters at which the shape of a connection is checked.
SAMPLES = np.linspace(0.0, 1.0, 33)
# A connection has no loops or cusps if the following four conditions are satisfied. Its speed stays
# above SLOWEST times and below FASTEST times its mean speed.
SLOWEST = 0.5
FASTEST = 1.6
# Its direction stays within 72 deg of its mean direction: the cosine of that angle.
SMALLEST_COSINE = np.cos(np.radians(72))
# Its curvature times its mean speed is at most this.
LARGEST_CURVATURE = 10.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Connections:
    """Polynomial connections across n vertices."""

    begin: FloatArray  # Start points relative to the vertices [m], (n, dimension)
    # Coefficients [m] of the position relative to the start, a polynomial in x from 0 to 1, in
    # ascending order, (n, 8, dimension)
    coefficients: FloatArray

    def __len__(self) -> int:
        """Number of connections."""
        return len(self.begin)

    def evaluate(self, i: IntArray | slice, x: FloatArray, order: int = 0) -> FloatArray:
        """Return positions relative to the start, or derivatives by x, of connections `i`.

        - `i`: indices of connections, (n,), or a slice.
        - `x`: parameters from 0 to 1, (..., n).

        The shape is `x.shape + (dimension,)` [m].
        """
        return evaluate_polynomials(np.swapaxes(self.coefficients[i], -1, -2), x[..., None], order)

    def lengths_to(self, i: IntArray | slice, x: FloatArray) -> FloatArray:
        """Return arc lengths from the starts of connections `i` to x [m], (n,)."""
        return np.asarray(
            WEIGHTS @ length(self.evaluate(i, NODE_PARAMETERS[:, None] * x, 1)) * x / 2
        )

    @property
    def nearest(self) -> FloatArray:
        """Parameters x of the points nearest to the vertices, from 0 to 1, (n,)."""
        parameters = self._sample_parameters[1:-1]
        x = SAMPLES[1 + length(self.begin + self.evaluate(EVERY, parameters)).argmin(axis=0)]
        for _ in range(NEWTON_STEPS):
            offset = self.begin + self.evaluate(EVERY, x)
            velocity = self.evaluate(EVERY, x, 1)
            speed2 = dot(velocity, velocity)
            slope = speed2 + dot(offset, self.evaluate(EVERY, x, 2))
            # The lower bound keeps Newton's step towards the minimum.
            slope = np.maximum(slope, SMALLEST_SLOPE * speed2)
            x = np.clip(x - dot(offset, velocity) / slope, SAMPLES[1], SAMPLES[-2])
        return np.asarray(x)

    @property
    def largest_curvature(self) -> FloatArray:
        """Largest curvatures over the sampled parameters [1/m], (n,)."""
        return np.asarray(length(self.contact(EVERY, self._sample_parameters)[2]).max(axis=0))

    @property
    def _sample_parameters(self) -> FloatArray:
        """Sampled parameters of every connection, (samples, n)."""
        return np.tile(SAMPLES[:, None], len(self))

    @property
    def valid(self) -> BoolArray:
        """Mask of the connections without loops, cusps and strong variation of speed, (n,)."""
        velocities = self.evaluate(EVERY, self._sample_parameters, 1)
        speeds = length(velocities)
        cosines = dot(velocities, unit(velocities[0] + velocities[-1])) / speeds
        mean = speeds.mean(axis=0)
        even = (speeds.min(axis=0) > SLOWEST * mean) & (speeds.max(axis=0) < FASTEST * mean)
        tight = self.largest_curvature * mean > LARGEST_CURVATURE
        return np.asarray(even & ~tight & (cosines.min(axis=0) > SMALLEST_COSINE))

    def contact(self, i: IntArray | slice, x: FloatArray) -> Contact:
        """Return relative positions, unit tangents and curvature vectors at parameters x.

        `i` are indices of the connections, or a slice; x is between 0 and 1.
        """
        return self.evaluate(i, x), *tangent_and_curvature(
            self.evaluate(i, x, 1), self.evaluate(i, x, 2)
        )


def connect(before: Segments, after: Segments, t: FloatArray) -> Connections:
    """Make connections that replace the length t of the segments on either side of vertices.

    `t` are the lengths, no longer than the segments [m], (n,).
    """
    every = np.arange(len(t))
    back, ahead = around_vertices(before, after)
    begin = [(-1) ** k * back.evaluate(every, t, k) for k in range(4)]
    end = [ahead.evaluate(every, t, k) for k in range(4)]
    chord = end[0] - begin[0]
    size = 2 * t
    for _ in range(SCALE_ITERATIONS):
        scale = [size[:, None] ** k for k in range(4)]
        c = np.zeros((len(t), DEGREE + 1, chord.shape[1]))
        for k, factor in ((1, 1), (2, 2), (3, 6)):
            c[:, k] = begin[k] * scale[k] / factor
        # What the derivatives of order k at the end lack with the coefficients known so far.
        residuals = []
        for k in range(4):
            needed = chord if k == 0 else end[k] * scale[k]
            known = sum(math.perm(j, k) * c[:, j] for j in range(max(k, 1), 4))
            residuals.append(needed - known)
        c[:, 4:] = np.einsum("jk,knd->njd", END_TO_COEFFICIENTS, np.stack(residuals))
        connections = Connections(begin=begin[0], coefficients=c)
        size = connections.lengths_to(EVERY, np.ones(len(t)))
    return connections


def around_vertices(before: Segments, after: Segments) -> tuple[Segments, Segments]:
    """Return segments before vertices, reversed, and after them, all from the origin."""
    # Points near a vertex then have full precision.
    zero = np.zeros_like(after.starts)
    back = before.reverse_rows(np.arange(len(before)), np.full(len(before), True))
    return back.replace(starts=zero), after.replace(starts=zero)


def draw_connections(
    connections: Connections, vertices: FloatArray, middle: FloatArray
) -> tuple[Segments, IntArray, BoolArray]:
    """Draw connections as transitions, whose parameters equal arc lengths within `UNEVEN`.

    Returns the transitions in order, the index of each one's connection, and the mask of the
    transitions before the middle.

    - `vertices`: vertices of the connections [m], (n, dimension).
    - `middle`: parameters x at which both halves of each connection meet, from 0 to 1, (n,).
    """
    parts = np.full(len(connections), 1)
    drawn, owners, before_middle = _draw_halves(connections, vertices, middle, parts)
    while True:
        speeds = [
            length(drawn.evaluate(EVERY, share * drawn.lengths, 1)) for share in SPEED_SAMPLES
        ]
        unevenness = np.abs(np.stack(speeds) - 1).max(axis=0)
        uneven = np.unique(owners[unevenness > UNEVEN / 2])
        uneven = uneven[parts[uneven] < MAX_PARTS]
        if not len(uneven):
            return drawn, owners, before_middle
        largest = np.zeros(len(connections))
        np.maximum.at(largest, owners, unevenness)
        # The unevenness decreases approximately with the fifth power of the lengths.
        count = np.ceil(parts[uneven] * (largest[uneven] / (UNEVEN / 2)) ** 0.2)
        parts[uneven] = np.minimum(np.maximum(count, parts[uneven] + 1), MAX_PARTS)
        drawn, owners, before_middle = _draw_halves(connections, vertices, middle, parts)


def _draw_halves(
    connections: Connections, vertices: FloatArray, middle: FloatArray, parts: IntArray
) -> tuple[Segments, IntArray, BoolArray]:
    """Draw connections as transitions, with `parts` quintics in each half.

    Arguments and results are those of `draw_connections`.

    - `parts`: number of quintics in each half of each connection, (n,).
    """
    every = np.arange(len(connections))
    half = connections.lengths_to(EVERY, middle)
    whole = connections.lengths_to(EVERY, np.ones(len(connections)))
    owners, number = number_parts(2 * parts)
    first = number < parts[owners]
    step = np.where(first, half[owners], (whole - half)[owners]) / parts[owners]
    # Parameters of the connections at the ends of the quintics.
    node = np.where(first, number, number - parts[owners])
    s = np.where(first, 0.0, half[owners]) + node * step
    low = np.where(first, 0.0, middle[owners])
    high = np.where(first, middle[owners], 1.0)
    x = low + (high - low) * node / parts[owners]
    inner = node > 0
    i = owners[inner]
    parameter = x[inner]
    # Newton's method for the parameters at which the quintics have equal lengths.
    for _ in range(NEWTON_STEPS):
        error = connections.lengths_to(i, parameter) - s[inner]
        parameter = np.clip(
            parameter - error / length(connections.evaluate(i, parameter, 1)), 0.0, 1.0
        )
    x[inner] = parameter
    begin = connections.contact(owners, x)
    last = number == 2 * parts[owners] - 1
    final = connections.contact(every, np.ones(len(connections)))
    end = [np.empty_like(v) for v in begin]
    for k in range(3):
        end[k][:-1] = begin[k][1:]
        end[k][last] = final[k]
    chord = end[0] - begin[0]
    starts = vertices[owners] + connections.begin[owners] + begin[0]
    return join_by_quintics((starts, *begin[1:]), (chord, end[1], end[2]), step), owners, first


def bound_deviation(
    drawn: Segments, old: Segments, i: IntArray, ends: tuple[FloatArray, FloatArray], parts: int
) -> FloatArray:
    """Bound the distances between transitions and the path parts that they replace [m], (n,).

    Corresponding points move evenly along both. On each of the `parts`, of length h, the distance
    of corresponding points is at most the larger distance at the ends plus h² / 8 times the largest
    second derivative of their difference with respect to arc length.

    Returns bounds of the distance in both directions, (n,).

    - `i`: index of the segment that each transition replaces in part, (n,).
    - `ends`: distances along this segment at which the part starts and ends [m], (n,) each.
    """
    row, number = number_parts(np.full(len(drawn), parts))
    h = drawn.lengths[row] / parts
    step = ((ends[1] - ends[0]) / parts)[row]
    low = ends[0][row] + number * step
    segment = i[row]
    ratio = step / h
    distances = [
        length(
            drawn.evaluate(row, (number + share) * h) - old.evaluate(segment, low + share * step)
        )
        for share in (0, 1)
    ]
    # Second derivative of the old path in the middle of the part, with respect to the arc length of
    # the transition, and a bound of its change from the middle to either end.
    second_derivative = ratio[:, None] ** 2 * old.evaluate(segment, low + step / 2, 2)
    change = old.curvatures[segment] ** 2
    if old.quintics.size:
        bent = old.is_transition[segment]
        rows = segment[bent]
        change[bent] = bound_third_derivatives(old.quintics[rows], old.lengths[rows])
    allowance = ratio**2 * change * step / 2
    relative = rescale(drawn.quintics[row], number / parts, np.full(len(row), 1 / parts))
    relative[:, 2] -= second_derivative * (h**2 / 2)[:, None]
    bound = np.maximum(*distances) + h**2 / 8 * (bound_second_derivatives(relative, h) + allowance)
    return np.asarray(bound.reshape(len(drawn), parts).max(axis=1))
