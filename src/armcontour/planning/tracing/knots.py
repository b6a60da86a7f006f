"""Knots along a path: arc lengths at which tracing computes exact joint positions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour.core import checks
from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.geometry import Path

# Largest distance between the first knots, over the extent of the path.
FIRST_STEP = 1 / 16
# But it may be so long, over the span of the arm: on a short way the arm hardly bends.
SHORTEST_FIRST_STEP = 1 / 512
# Largest angle by which the tangent or the tool turns between the first knots [rad].
FIRST_TURN = 0.5
# Fractions of an interval at which the distance of the tool from the path is computed.
PLACES = checks.frozen_array([0.25, 0.5, 0.75])
MIDDLE = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Knots:
    """The n intervals between knots.

    Args:
        segment: Index of the path segment on which each interval lies, (n,).
        piece: Index of the piece of the path's orientation on which each interval lies, (n,);
            0 for a path without orientation.
        u0: Distance along the segment at the start of each interval [m], (n,).
        u1: Distance along the segment at the end of each interval [m], (n,).
        s0: Arc length at the start of each interval [m], (n,).
    """

    segment: IntArray
    piece: IntArray
    u0: FloatArray
    u1: FloatArray
    s0: FloatArray

    def __len__(self) -> int:
        """Number of intervals."""
        return len(self.segment)

    def part(self, which: BoolArray | IntArray) -> Knots:
        """The intervals selected by a mask or by indices."""
        return Knots(**{name: getattr(self, name)[which] for name in Knots.__slots__})

    def halve(self, which: BoolArray, u: FloatArray) -> tuple[Knots, IntArray, IntArray]:
        """The intervals, with the selected ones split in two.

        Args:
            which: Mask of the intervals to split, (n,).
            u: Distance along the segment at which each of these is split [m].

        Returns:
            The new intervals; for each of them, the index of its old interval; and the indices
            of the second halves among the new intervals.
        """
        parent = np.repeat(np.arange(len(self)), 1 + which)
        second = np.flatnonzero(np.diff(parent, prepend=-1) == 0)
        u0, u1, s0 = self.u0[parent], self.u1[parent], self.s0[parent]
        s0[second] = self.part(which).at(u)
        u0[second], u1[second - 1] = u, u
        segment, piece = self.segment[parent], self.piece[parent]
        return Knots(segment=segment, piece=piece, u0=u0, u1=u1, s0=s0), parent, second

    def cut(self, count: IntArray) -> tuple[Knots, IntArray]:
        """The intervals, each cut into equal ones.

        Args:
            count: Number of parts of every interval, (n,).

        Returns:
            The parts, and the indices of the given knots among their starts and last end, (n + 1,).
        """
        at = np.append(0, np.cumsum(count))
        of = np.repeat(np.arange(len(self)), count)
        number = np.arange(at[-1]) - at[of]
        share = ((self.u1 - self.u0) / count)[of]
        last = number + 1 == count[of]
        return Knots(
            segment=self.segment[of],
            piece=self.piece[of],
            u0=self.u0[of] + share * number,
            u1=np.where(last, self.u1[of], self.u0[of] + share * (number + 1)),
            s0=self.s0[of] + share * number,
        ), at

    def ends(self) -> tuple[IntArray, FloatArray, IntArray]:
        """Places of the starts of the intervals, and of those ends that are not starts of others.

        Returns:
            The interval of every place, (m,); the distances along the segments there [m], (m,); and
            the place of the end of every interval, (n,).
        """
        x, n = self, len(self)
        alone = np.append((np.diff(x.segment) != 0) | (np.diff(x.piece) != 0), True)
        alone[:-1] |= x.u0[1:] != x.u1[:-1]
        row, u = np.append(np.arange(n), np.flatnonzero(alone)), np.append(x.u0, x.u1[alone])
        return row, u, np.where(alone, n - 1 + np.cumsum(alone), np.arange(1, n + 1))

    def places(self) -> tuple[Knots, FloatArray]:
        """The intervals repeated for each of `PLACES`, and distances along the segments there [m].

        All intervals at the first place come before those at the second, (len(PLACES) n,).
        """
        columns = {x: [getattr(self, x)] * len(PLACES) for x in Knots.__slots__}
        repeated = Knots(**{name: np.concatenate(x) for name, x in columns.items()})
        u = self.u0 + PLACES[:, None] * (self.u1 - self.u0)
        return repeated, u.ravel()

    def at(self, u: FloatArray) -> FloatArray:
        """Arc lengths at distances `u` along the segments [m], (n,)."""
        return np.asarray(self.s0 + (u - self.u0))


def first_knots(path: Path, span: float, finer: int = 1) -> Knots:
    """The knot intervals that refinement starts from: at every break of the path, and between.

    Args:
        path: The path.
        span: As of the arm [m].
        finer: Factor by which the intervals are shorter than they need to be.
    """
    cells = _cells(path)
    # All vertices of a full circle are one point, so the extent takes in the arcs' diameters.
    diameter = np.minimum(path.lengths, 2 / np.where(path.curvatures > 0, path.curvatures, np.inf))
    extent = max(float(np.linalg.norm(np.ptp(path.vertices, axis=0))), float(diameter.max()))
    turning = path.curvatures[cells.segment]
    if path.orientation is not None and not path.orientation.fixed:
        i = cells.piece
        middle = cells.at((cells.u0 + cells.u1) / 2) - path.orientation.breaks[i]
        rate, _ = path.orientation.rates_on_piece(i, middle)
        turning = np.maximum(turning, 1.5 * np.linalg.norm(rate, axis=1))
    step = max(FIRST_STEP * extent, SHORTEST_FIRST_STEP * span)
    count = np.ceil(finer * (cells.u1 - cells.u0) * np.maximum(1 / step, turning / FIRST_TURN))
    return cells.cut(np.maximum(1, count).astype(np.intp))[0]


def _cells(path: Path) -> Knots:
    """Intervals between all breaks of the path's segments and of its orientation."""
    n, orientation = len(path), path.orientation
    whole = orientation is None or (len(orientation) == 1 and orientation.breaks[1] == path.length)
    if orientation is None or whole or np.array_equal(orientation.breaks, path.breaks):
        return Knots(
            segment=np.arange(n),
            piece=np.zeros(n, dtype=np.intp) if whole else np.arange(n),
            u0=np.zeros(n),
            u1=path.lengths,
            s0=path.breaks[:-1],
        )
    s = np.union1d(path.breaks, orientation.breaks)
    middle = (s[:-1] + s[1:]) / 2
    segment, piece = path.locate(middle), orientation.locate(middle)
    u0 = s[:-1] - path.breaks[segment]
    ends = s[1:] == path.breaks[segment + 1]
    u1 = np.where(ends, path.lengths[segment], s[1:] - path.breaks[segment])
    return Knots(segment=segment, piece=piece, u0=u0, u1=u1, s0=s[:-1])
