"""Where tracing puts its first knots: on every break of the path, and between them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour._checks import BoolArray, FloatArray, IntArray
from armcontour.geometry import Path

# The first knots lie no farther apart than this part of the path's extent and these turns [rad].
FIRST_STEP = 1 / 16
FIRST_TURN = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class Knots:
    """Intervals between knots.

    Args:
        segment: Segment of the path that holds each, (n,).
        piece: Piece of the path's orientation that holds each, (n,); 0 without one.
        u0: Where on its segment each begins [m], (n,).
        u1: Where on its segment each ends [m], (n,).
        s0: Arc length at which each begins [m], (n,).
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
        """Some of the intervals."""
        return Knots(**{name: getattr(self, name)[which] for name in Knots.__slots__})

    def halve(self, which: BoolArray, u: FloatArray) -> tuple[Knots, IntArray, IntArray]:
        """The intervals with two in the place of some.

        Args:
            which: Those, (n,).
            u: Where on its segment each of those is cut [m].

        Returns:
            The intervals; which of these each was; and which of them are second halves.
        """
        of = np.repeat(np.arange(len(self)), 1 + which)
        second = np.flatnonzero(np.diff(of, prepend=-1) == 0)
        u0, u1, s0 = self.u0[of], self.u1[of], self.s0[of]
        s0[second] = self.part(which).at(u)
        u0[second], u1[second - 1] = u, u
        segment, piece = self.segment[of], self.piece[of]
        return Knots(segment=segment, piece=piece, u0=u0, u1=u1, s0=s0), of, second

    def at(self, u: FloatArray) -> FloatArray:
        """Arc lengths of places on the segments."""
        return np.asarray(self.s0 + (u - self.u0))


def first_knots(path: Path, finer: int = 1) -> Knots:
    """Intervals short enough to start with.

    Args:
        path: The path.
        finer: How many times as many as there need to be.
    """
    cells = _cells(path)
    # The vertices of a full circle span nothing: its diameter does.
    bulge = np.minimum(path.lengths, 2 / np.where(path.curvatures > 0, path.curvatures, np.inf))
    extent = max(float(np.linalg.norm(np.ptp(path.vertices, axis=0))), float(bulge.max()))
    width = cells.u1 - cells.u0
    turning = path.curvatures[cells.segment]
    if path.orientation is not None:
        i = cells.piece
        middle = cells.at((cells.u0 + cells.u1) / 2) - path.orientation.breaks[i]
        rate, _ = path.orientation.rates_on_piece(i, middle)
        turning = np.maximum(turning, 1.5 * np.linalg.norm(rate, axis=1))
    by_length, by_turn = (
        np.ceil(finer * width / (FIRST_STEP * extent)),
        np.ceil(finer * width * turning / FIRST_TURN),
    )
    count = np.maximum(1, np.maximum(by_length, by_turn)).astype(np.intp)
    of = np.repeat(np.arange(len(cells)), count)
    number = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    share = width[of] / count[of]
    begin = cells.u0[of] + share * number
    last = number + 1 == count[of]
    end = np.where(last, cells.u1[of], cells.u0[of] + share * (number + 1))
    s0 = np.where(number == 0, cells.s0[of], cells.s0[of] + share * number)
    return Knots(segment=cells.segment[of], piece=cells.piece[of], u0=begin, u1=end, s0=s0)


def _cells(path: Path) -> Knots:
    """The path cut at the breaks of its segments and of its orientation."""
    n = len(path)
    if path.orientation is None:
        return Knots(
            segment=np.arange(n),
            piece=np.zeros(n, dtype=np.intp),
            u0=np.zeros(n),
            u1=path.lengths,
            s0=path.breaks[:-1],
        )
    s = np.union1d(path.breaks, path.orientation.breaks)
    middle = (s[:-1] + s[1:]) / 2
    segment, piece = path.locate(middle), path.orientation.locate(middle)
    u0 = s[:-1] - path.breaks[segment]
    ends = s[1:] == path.breaks[segment + 1]
    u1 = np.where(ends, path.lengths[segment], s[1:] - path.breaks[segment])
    return Knots(segment=segment, piece=piece, u0=u0, u1=u1, s0=s[:-1])
