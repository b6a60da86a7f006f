"""Derivatives and sampled coefficients of a joint path on a grid."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.kernel_cache import FUSED, compiled
from armcontour.core.pool import split_evenly
from armcontour.core.quintics import before_zeros
from armcontour.planning.path_grid import Grid
from armcontour.planning.topp.limit_forms import (
    BY_CONSTANT,
    BY_SLOPE,
    BY_U,
    BY_X,
    HIGH,
    LOW,
    X_ROUNDING,
    A,
    B,
    Intervals,
    LinearRows,
    Rounds,
    Squares,
)

Terms = tuple[FloatArray, FloatArray, FloatArray]
# Largest number of samples at which the joint motion is kept; at more, it is computed in groups of
# this many samples, because it would take most of the memory of a long plan.
SAMPLES_AT_ONCE = 16_384
# Largest number of intervals whose rows are computed at once; an interval has 2 or 3 samples.
INTERVALS_AT_ONCE = SAMPLES_AT_ONCE // 2


@compiled(fastmath=FUSED)
def write_linear_rows(
    s: FloatArray,
    piece: IntArray,
    after: IntArray,
    terms: tuple[FloatArray, ...],
    bounds: tuple[FloatArray, ...],
    rows: LinearRows,
) -> None:
    """Write rows `low <= a u + b x + c <= high` whose coefficients are sampled.

    `s` and `piece` are the arrays of the grid. `terms` are a, b and c at the samples, (samples,
    rows) each; `bounds` are low and high, (rows,) each. Of n intervals, interval i has its start at
    sample i, its middle at sample n + i, and its end at sample `after[i]`, as in
    `SampledJointPath.after`.
    """
    a, b, c = terms
    low, high = bounds
    n = len(piece)
    count = a.shape[1]
    second = np.empty((n, 3, count))
    for i in range(n):
        w = s[i + 1] - s[i]
        last = after[i]
        # `second` is twice the deviation of the middle from the chord, divided by w².
        inverse = 2 / (w * w)
        for r in range(count):
            second[i, 0, r] = inverse * abs(a[n + i, r] - (a[i, r] + a[last, r]) / 2)
            second[i, 1, r] = inverse * abs(b[n + i, r] - (b[i, r] + b[last, r]) / 2)
            second[i, 2, r] = inverse * abs(c[n + i, r] - (c[i, r] + c[last, r]) / 2)
    for i in range(n):
        w = s[i + 1] - s[i]
        last = after[i]
        previous = i - 1 if i > 0 and piece[i - 1] == piece[i] else i
        next_ = i + 1 if i < n - 1 and piece[i + 1] == piece[i] else i
        for r in range(count):
            for end in range(2):
                row = last if end else i
                rows.ends[i, end, r, A] = a[row, r]
                rows.ends[i, end, r, B] = b[row, r]
                rows.ends[i, end, r, LOW] = low[r] - c[row, r]
                rows.ends[i, end, r, HIGH] = high[r] - c[row, r]
            a0 = a[i, r]
            a1 = a[last, r]
            b0 = b[i, r]
            b1 = b[last, r]
            by_u = w * w * max(second[previous, 0, r], second[i, 0, r], second[next_, 0, r])
            by_x = w * w * max(second[previous, 1, r], second[i, 1, r], second[next_, 1, r])
            by_constant = w * w * max(second[previous, 2, r], second[i, 2, r], second[next_, 2, r])
            rows.rise[i, r, BY_U] = by_u + abs(b1 - b0) * w / 2
            rows.rise[i, r, BY_X] = by_x + X_ROUNDING * max(abs(a0), abs(a1)) / w
            rows.rise[i, r, BY_SLOPE] = w / 4 * (abs(a1 - a0) + w * max(abs(b0), abs(b1)))
            rows.rise[i, r, BY_CONSTANT] = by_constant


@compiled(fastmath=FUSED)
def write_derivatives(grid: Intervals, ends: FloatArray, bounds: FloatArray) -> None:
    """Write dq_ds and d2q_ds2 at interval ends, and bounds of |d3q_ds3| and |d4q_ds4| inside."""
    for i in range(len(grid.piece)):
        k = grid.piece[i]
        scale = 1 / (grid.breaks[k + 1] - grid.breaks[k])
        begin = grid.s[i] - grid.breaks[k]
        end = grid.s[i + 1] - grid.breaks[k]
        middle = scale * (begin + end) / 2
        half = (end - begin) / 2
        for j in range(grid.dof):
            at = 6 * k * grid.dof + j
            c1 = grid.coefficients[at + grid.dof]
            c2 = grid.coefficients[at + 2 * grid.dof]
            c3 = grid.coefficients[at + 3 * grid.dof]
            c4 = grid.coefficients[at + 4 * grid.dof]
            c5 = grid.coefficients[at + 5 * grid.dof]
            for e in range(2):
                x = scale * (end if e else begin)
                slope = c1 + x * (2 * c2 + x * (3 * c3 + x * (4 * c4 + x * 5 * c5)))
                ends[0, i, e, j] = scale * slope
                bend = 2 * c2 + x * (6 * c3 + x * (12 * c4 + x * 20 * c5))
                ends[1, i, e, j] = scale * scale * bend
            # The bounds use a Taylor expansion about the middle; the fifth derivative is constant.
            cube = scale * scale * scale
            third = cube * abs(6 * c3 + middle * (24 * c4 + middle * 60 * c5))
            fourth = cube * scale * abs(24 * c4 + middle * 120 * c5)
            fifth = cube * scale * scale * abs(120 * c5)
            bounds[0, i, j] = third + half * fourth + half * half / 2 * fifth
            bounds[1, i, j] = fourth + half * fifth


@dataclass(frozen=True)
class SampledJointPath:
    """A joint path on a grid, with the quantities that constraints need, computed at first use."""

    grid: Grid
    jumps: bool = False  # True if quantities may jump at every grid point, not only between pieces

    def __len__(self) -> int:
        """Number of intervals."""
        return len(self.grid)

    @cached_property
    def intervals(self) -> Intervals:
        """Arrays of the grid and the joint path for kernels."""
        path = self.grid.joint_path
        coefficients = before_zeros(path.coefficients)
        return Intervals(self.grid.s, self.grid.piece, path.breaks, coefficients, path.dof)

    @cached_property
    def derivatives(self) -> tuple[FloatArray, FloatArray]:
        """dq_ds and d2q_ds2 at interval ends, and bounds of |d3q_ds3| and |d4q_ds4| inside."""
        # Their shapes are (2, n, 2, dof) and (2, n, dof).
        n = len(self)
        dof = self.grid.joint_path.dof
        ends = np.empty((2, n, 2, dof))
        bounds = np.empty((2, n, dof))
        write_derivatives(self.intervals, ends, bounds)
        return ends, bounds

    @cached_property
    def after(self) -> IntArray:
        """Index of the sample at the end of each interval, (n,)."""
        piece = self.grid.piece
        n = len(self)
        after = np.arange(1, n + 1)
        alone = np.append(np.flatnonzero((piece[1:] != piece[:-1]) | self.jumps), n - 1)
        after[alone] = 2 * n + np.arange(len(alone))
        return after

    @cached_property
    def places(self) -> tuple[IntArray, FloatArray]:
        """Pieces and arc lengths [m] of the samples, (samples,) each."""
        # The samples are the starts of all intervals, the middles of all intervals, and the ends of
        # intervals that are not the start of an interval of the same piece. If quantities may jump,
        # they are the starts, the middles and the ends of all intervals.
        s = self.grid.s
        piece = self.grid.piece
        alone = self.after >= len(self)
        return (
            np.concatenate([piece, piece, piece[alone]]),
            np.concatenate([s[:-1], (s[:-1] + s[1:]) / 2, s[1:][alone]]),
        )

    @cached_property
    def motion(self) -> Terms:
        """q, dq_ds and d2q_ds2 at all samples, (samples, dof) each."""
        return self.grid.joint_path.motion(*self.places)

    def rows_of(
        self,
        function: Callable[[FloatArray, FloatArray, FloatArray], Terms],
        low: FloatArray,
        high: FloatArray,
    ) -> tuple[LinearRows, FloatArray]:
        """Return the rows `low <= a u + b x + c <= high`, and c at the ends of the intervals.

        The coefficients are computed for groups of intervals, because those at all samples would
        take as much memory as the rows. Returns c as an array (n, 2, rows).

        - `function`: computes a, b and c, (samples, rows) each, from q, dq_ds and d2q_ds2.
        - `low`, `high`: bounds, (rows,) each.
        """
        n = len(self)
        if n <= INTERVALS_AT_ONCE:
            terms = function(*self.motion)
            return self.rows(terms, low, high), self.at_ends(terms[2])
        count = len(low)
        rows = LinearRows(np.empty((n, 2, count, 4)), np.empty((n, count, 4)))
        constants = np.empty((n, 2, count))
        for group in split_evenly(n, -(-n // INTERVALS_AT_ONCE)):
            # The rise in an interval depends on the samples of both neighbours.
            first = max(group.start - 1, 0)
            last = min(group.stop + 1, n)
            part = SampledJointPath(self.grid.part(first, last), self.jumps)
            terms = function(*part.motion)
            found = part.rows(terms, low, high)
            inner = slice(group.start - first, group.stop - first)
            rows.ends[group] = found.ends[inner]
            rows.rise[group] = found.rise[inner]
            constants[group] = part.at_ends(terms[2])[inner]
        return rows, constants

    def rows(self, terms: Terms, low: FloatArray, high: FloatArray) -> LinearRows:
        """Return the rows `low <= a u + b x + c <= high` from samples of a, b and c.

        `terms` are the coefficients at all samples, (samples, rows) each.

        The deviation of a coefficient from its chord is measured in the middle of an interval.
        Close to an inflection point this deviation is too small. Therefore its bound is computed
        from twice the largest second derivative of the interval and both neighbours. `low` and
        `high`: bounds, (rows,) each.
        """
        n = len(self)
        count = terms[0].shape[1]
        rows = LinearRows(np.empty((n, 2, count, 4)), np.empty((n, count, 4)))
        write_linear_rows(self.grid.s, self.grid.piece, self.after, terms, (low, high), rows)
        return rows

    def at_ends(self, values: FloatArray) -> FloatArray:
        """Select the starts and ends of the intervals, (n, 2, ...), from values at all samples."""
        return np.stack([values[: len(self)], values[self.after]], axis=1)

    def round(self, a: FloatArray, b: FloatArray, radius: float) -> Rounds:
        """Make the limit `|a u + b x| <= radius` from vectors at all samples.

        - `a`, `b`: vectors at all samples, (samples, 2 or 3) each.
        """
        n = len(self)
        w = self.grid.width
        ends = np.zeros((n, 2, 1, 2, 3))
        rise = np.zeros((n, 1, 4))
        for column, vectors in ((A, a), (B, b)):
            ends[:, :, 0, column, : a.shape[1]] = self.at_ends(vectors)
        change = _length(ends[:, 1, 0] - ends[:, 0, 0])
        size = _length(ends[:, :, 0]).max(axis=1)
        rise[:, 0, BY_U] = self._chord_deviations(a) + change[:, B] * w / 2
        rise[:, 0, BY_X] = self._chord_deviations(b) + X_ROUNDING * size[:, A] / w
        rise[:, 0, BY_SLOPE] = w / 4 * (change[:, A] + w * size[:, B])
        return Rounds(ends, np.full((len(self), 1), radius), rise)

    def square(self, b: FloatArray) -> Squares:
        """Make the limit `b x <= 1` from one b >= 0 at all samples, (samples,)."""
        w = self.grid.width
        ends = self.at_ends(b)
        deviation = self._chord_deviations(b[:, None])
        rise = np.zeros((len(self), 1, 4))
        rise[:, 0, BY_U] = np.abs(ends[:, 1] - ends[:, 0]) * w / 2
        rise[:, 0, BY_X] = deviation
        rise[:, 0, BY_SLOPE] = w * w / 4 * ends.max(axis=1)
        return Squares(ends[..., None], (ends.max(axis=1) + deviation)[:, None], rise)

    def _chord_deviations(self, values: FloatArray) -> FloatArray:
        """Bound how far vectors at all samples are from their chords, (n,)."""
        n = len(self)
        square = self.grid.width**2
        piece = self.grid.piece
        middle = values[n : 2 * n] - self.at_ends(values).mean(axis=1)
        second = 2 * _length(middle) / square
        largest = second.copy()
        alike = piece[1:] == piece[:-1]
        largest[1:] = np.where(alike, np.maximum(largest[1:], second[:-1]), largest[1:])
        largest[:-1] = np.where(alike, np.maximum(largest[:-1], second[1:]), largest[:-1])
        return np.asarray(largest * square)


def _length(vectors: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.norm(vectors, axis=-1))
