"""The grid of the optimal planner: where along the path it decides."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour.errors import InvalidInput
from armcontour.motion import JointPath

# By default the grid has this many intervals, and at least this many per piece of the joint path.
DEFAULT_INTERVALS = 4000
FEWEST_PER_PIECE = 2
# Share of the intervals that is spread evenly over the length; the rest goes where the path turns.
EVEN_SHARE = 0.5


@dataclass(frozen=True, slots=True)
class Grid:
    """Intervals of a joint path, each inside one of its polynomial pieces.

    Args:
        joint_path: The path.
        s: Interval ends [m], (n + 1,).
        piece: The joint path's piece that holds each interval, (n,).
    """

    joint_path: JointPath
    s: FloatArray
    piece: IntArray

    @property
    def width(self) -> FloatArray:
        """Interval lengths [m], (n,)."""
        return np.diff(self.s)

    def __len__(self) -> int:
        """Number of intervals."""
        return len(self.piece)


def place_grid(joint_path: JointPath, intervals: int | None = None) -> Grid:
    """A grid that is finer where the direction in joint space changes faster.

    Every break of the joint path is a grid point, so that each interval lies in one polynomial and
    both sides of a joint between segments are seen.

    Args:
        joint_path: The path.
        intervals: How many intervals, about.
    """
    breaks = joint_path.breaks
    pieces = len(breaks) - 1
    count = intervals or max(DEFAULT_INTERVALS, FEWEST_PER_PIECE * pieces)
    # Turning of the joint path per piece, from its ends and its middle.
    i = np.arange(pieces)
    places = np.stack([breaks[:-1], (breaks[:-1] + breaks[1:]) / 2, breaks[1:]])
    first = np.stack([joint_path.on_interval(i, s, 1) for s in places])
    second = np.stack([joint_path.on_interval(i, s, 2) for s in places])
    size = np.linalg.norm(first, axis=2)
    turning = np.mean(np.linalg.norm(second, axis=2) / np.maximum(size, 1e-12 * size.max()), axis=0)
    width = np.diff(breaks)
    turn = width * turning
    share = EVEN_SHARE * width / width.sum()
    if turn.sum() > 0:
        share += (1 - EVEN_SHARE) * turn / turn.sum()
    per_piece = np.maximum(FEWEST_PER_PIECE, np.round(share / share.sum() * count)).astype(np.intp)
    piece = np.repeat(i, per_piece)
    number = np.arange(len(piece)) - np.repeat(np.cumsum(per_piece) - per_piece, per_piece)
    s = breaks[piece] + width[piece] * number / per_piece[piece]
    return Grid(joint_path, np.append(s, breaks[-1]), piece)


def given_grid(joint_path: JointPath, points: FloatArray) -> Grid:
    """A grid of given points, and the breaks of the joint path.

    Raises:
        InvalidInput: Points that do not lie on the path.
    """
    breaks = joint_path.breaks
    if points.ndim != 1 or points.min() < breaks[0] or points.max() > breaks[-1]:
        raise InvalidInput(
            f"Grid points must be one row of arc lengths from {breaks[0]:g} to {breaks[-1]:g} m."
        )
    s = np.union1d(points, breaks)
    # A point that is a break but for rounding is that break.
    close = np.diff(s) < 1e-12 * (breaks[-1] - breaks[0])
    drop = np.zeros(len(s), dtype=bool)
    at_break = np.isin(s, breaks)
    drop[:-1] |= close & ~at_break[:-1]
    drop[1:] |= close & at_break[:-1] & ~at_break[1:]
    s = s[~drop]
    return Grid(joint_path, s, joint_path.locate(s[:-1]))
