"""A joint path on a grid, as limits need it to write their forms."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from armcontour.core._vectors import LANES
from armcontour.core.checks import FloatArray, IntArray
from armcontour.planning.grid import Grid
from armcontour.planning.topp._forms import ROUNDING, derivatives, write_sampled
from armcontour.planning.topp.limits import (
    BY_SLOPE,
    BY_U,
    BY_X,
    KEPT,
    A,
    B,
    Intervals,
    Rounds,
    Rows,
    Squares,
)

Terms = tuple[FloatArray, FloatArray, FloatArray]


@dataclass(frozen=True)
class OnGrid:
    """A joint path on a grid, as constraints need it; each property is computed at its first use.

    Args:
        grid: The grid.
        jumps: Whether quantities may jump at any grid point, not only where pieces meet.
    """

    grid: Grid
    jumps: bool = False

    def __len__(self) -> int:
        """Number of intervals."""
        return len(self.grid)

    @cached_property
    def intervals(self) -> Intervals:
        """The intervals, as kernels take them."""
        path = self.grid.joint_path
        flat, dof = path.coefficients.ravel(), path.dof
        last = np.zeros(6 * dof * KEPT + LANES)
        kept = flat[-6 * dof * KEPT :]
        last[6 * dof * KEPT - len(kept) : -LANES] = kept
        return Intervals(self.grid.s, self.grid.piece, path.breaks, flat, last, dof)

    @cached_property
    def derivatives(self) -> tuple[FloatArray, FloatArray]:
        """dq_ds and d2q_ds2 at the starts and ends of the intervals, (2, n, 2, dof).

        And bounds of |d3q_ds3| and |d4q_ds4| on the intervals, (2, n, dof).
        """
        path, n = self.grid.joint_path, len(self)
        ends, most = np.empty((2, n, 2, path.dof)), np.empty((2, n, path.dof))
        derivatives(path.breaks, path.coefficients, self.intervals, ends, most)
        return ends, most

    @cached_property
    def after(self) -> IntArray:
        """The place of `motion` at which each interval ends, (n,)."""
        piece, n = self.grid.piece, len(self)
        after = np.arange(1, n + 1)
        alone = np.append(np.flatnonzero((piece[1:] != piece[:-1]) | self.jumps), n - 1)
        after[alone] = 2 * n + np.arange(len(alone))
        return after

    @cached_property
    def places(self) -> tuple[IntArray, FloatArray]:
        """The pieces and arc lengths [m] of places, (places,) each.

        They are the starts of all intervals, their middles, and the ends at which no interval of
        the same piece starts; of all intervals where quantities may jump.
        """
        s, piece, alone = self.grid.s, self.grid.piece, self.after >= len(self)
        return (
            np.concatenate([piece, piece, piece[alone]]),
            np.concatenate([s[:-1], (s[:-1] + s[1:]) / 2, s[1:][alone]]),
        )

    @cached_property
    def motion(self) -> Terms:
        """q, dq_ds and d2q_ds2 at all places, (places, dof) each."""
        return self.grid.joint_path.motion(*self.places)

    def rows(self, terms: Terms, low: FloatArray, high: FloatArray) -> Rows:
        """Rows `low <= a u + b x + c <= high` whose coefficients are known at all places.

        How far a coefficient is off its chord is measured in the middle of an interval. Near an
        inflection this misses the third derivative, which the neighbours show: twice the largest
        second derivative of the three intervals counts.

        Args:
            terms: a, b and c, (places, rows) each.
            low: Lower bounds, (rows,).
            high: Upper bounds, (rows,).
        """
        n, count = len(self), terms[0].shape[1]
        rows = Rows(np.empty((n, 2, count, 4)), np.empty((n, count, 4)))
        write_sampled(self.intervals, self.after, terms, (low, high), rows)
        return rows

    def at_ends(self, values: FloatArray) -> FloatArray:
        """Values at the starts and ends of the intervals, (n, 2, ...), of those at all places."""
        return np.stack([values[: len(self)], values[self.after]], axis=1)

    def round(self, a: FloatArray, b: FloatArray, radius: float) -> Rounds:
        """`|a u + b x| <= radius` for vectors known at all places, (places, 2 or 3) each.

        The rise is bounded as in `rows`, with lengths of vectors.
        """
        n, w = len(self), self.grid.width
        ends, rise = np.zeros((n, 2, 1, 2, 3)), np.zeros((n, 1, 4))
        for column, vectors in ((A, a), (B, b)):
            ends[:, :, 0, column, : a.shape[1]] = self.at_ends(vectors)
        change = _length(ends[:, 1, 0] - ends[:, 0, 0])
        size = _length(ends[:, :, 0]).max(axis=1)
        rise[:, 0, BY_U] = self._bend(a) + change[:, B] * w / 2
        rise[:, 0, BY_X] = self._bend(b) + ROUNDING * size[:, A] / w
        rise[:, 0, BY_SLOPE] = w / 4 * (change[:, A] + w * size[:, B])
        return Rounds(ends, np.full((len(self), 1), radius), rise)

    def square(self, b: FloatArray) -> Squares:
        """`b x <= 1` for one b that is not below zero and is known at all places, (places,)."""
        w, ends = self.grid.width, self.at_ends(b)
        bend, rise = self._bend(b[:, None]), np.zeros((len(self), 1, 4))
        rise[:, 0, BY_U] = np.abs(ends[:, 1] - ends[:, 0]) * w / 2
        rise[:, 0, BY_X] = bend
        rise[:, 0, BY_SLOPE] = w * w / 4 * ends.max(axis=1)
        return Squares(ends[..., None], (ends.max(axis=1) + bend)[:, None], rise)

    def _bend(self, values: FloatArray) -> FloatArray:
        """Bound of the distances of vectors at all places, (places, m), from their chords, (n,)."""
        n, square, piece = len(self), self.grid.width**2, self.grid.piece
        middle = values[n : 2 * n] - self.at_ends(values).mean(axis=1)
        bend = 2 * _length(middle) / square
        most, alike = bend.copy(), piece[1:] == piece[:-1]
        most[1:] = np.where(alike, np.maximum(most[1:], bend[:-1]), most[1:])
        most[:-1] = np.where(alike, np.maximum(most[:-1], bend[1:]), most[:-1])
        return np.asarray(most * square)


def _length(vectors: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.norm(vectors, axis=-1))
