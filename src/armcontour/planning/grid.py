"""The grid of the optimal planner: arc lengths at which it chooses the path speed."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import Checked
from armcontour.motion import JointPath
from armcontour.planning._grid import cut, merge, turning_of

# By default the grid has this many intervals, and at least this many per piece of the joint path.
DEFAULT_INTERVALS = 4000
FEWEST_PER_PIECE = 2
# Some GB of data for an arm with six joints.
MOST_INTERVALS = 5_000_000
# Share of the intervals that is spread evenly over the length. The other intervals go where the
# joint path turns.
EVEN_SHARE = 0.5
# Below this share of the largest dq_ds no joint moves.
AT_REST = 1e-9


@dataclass(frozen=True)
class Grid(Checked):
    """Intervals of a joint path, each inside one of its polynomial pieces.

    Args:
        joint_path: The path.
        s: Interval ends [m], (n + 1,).
        piece: The joint path's piece that holds each interval, (n,).
    """

    joint_path: JointPath
    s: FloatArray
    piece: IntArray

    @cached_property
    def width(self) -> FloatArray:
        """Interval lengths [m], (n,)."""
        return np.asarray(self.s[1:] - self.s[:-1])

    def __len__(self) -> int:
        """Number of intervals."""
        return len(self.piece)


def place_grid(joint_path: JointPath, intervals: int | None = None) -> Grid:
    """Make a grid that is finer where the direction in joint space changes faster.

    Every break of the joint path is a grid point, so that each interval lies in one polynomial and
    both sides of a vertex between segments are seen.

    Args:
        joint_path: The joint path.
        intervals: Approximate number of intervals.

    Raises:
        InvalidInput: No joint moves along the joint path.
    """
    return cut_pieces(joint_path, share_out(joint_path, intervals))


def cut_pieces(joint_path: JointPath, count: IntArray) -> Grid:
    """Make a grid of so many equal intervals on every piece of a joint path, (pieces,)."""
    return _locked(joint_path, *cut(joint_path.breaks, count))


def share_out(joint_path: JointPath, intervals: int | None = None) -> IntArray:
    """How many intervals every piece of a joint path gets in `place_grid`, (pieces,).

    Args:
        joint_path: The joint path.
        intervals: As in `place_grid`.

    Raises:
        InvalidInput: As in `place_grid`.
    """
    breaks = joint_path.breaks
    pieces = len(breaks) - 1
    count = max(DEFAULT_INTERVALS, FEWEST_PER_PIECE * pieces)
    if intervals is not None:
        count = intervals
    width = breaks[1:] - breaks[:-1]
    turning = turning_of(breaks, joint_path.coefficients, AT_REST)
    if not len(turning):
        raise InvalidInput("No joint moves along the joint path: there is nothing to plan.")
    turn = width * turning
    share, turns = EVEN_SHARE * width / width.sum(), turn.sum()
    if turns > 0:
        share += (1 - EVEN_SHARE) * turn / turns
    per_piece = np.maximum(FEWEST_PER_PIECE, np.round(share / share.sum() * count))
    return np.asarray(per_piece, dtype=np.intp)


def grid_through(joint_path: JointPath, points: FloatArray) -> Grid:
    """Make a grid of given points [m] and of the breaks of the joint path.

    Raises:
        InvalidInput: A point does not lie on the path.
    """
    breaks = joint_path.breaks
    if points.ndim == 1 and not (points[1:] >= points[:-1]).all():
        points = np.sort(points)
    if points.ndim != 1 or not len(points) or points[0] < breaks[0] or points[-1] > breaks[-1]:
        raise InvalidInput(
            f"Grid points must be one row of arc lengths from {breaks[0]:g} to {breaks[-1]:g} m."
        )
    # A point that differs from a break or from the one before by rounding only is left out.
    s, piece, fewest = merge(points, breaks, 1e-12 * (breaks[-1] - breaks[0]))
    grid = _locked(joint_path, s, piece)
    # From rest to rest within one interval there is no motion, so every piece gets at least two.
    return grid if fewest > 1 else split(grid, np.where(np.bincount(piece)[piece] == 1, 2, 1))


def split(grid: Grid, parts: FloatArray | IntArray, points: FloatArray | None = None) -> Grid:
    """Split the intervals of a grid.

    Args:
        grid: The grid.
        parts: Into how many equal parts to split each interval, (n,).
        points: In place of equal parts: the point [m] at which to split each interval that has more
            than one part, where it lies inside, (n,).
    """
    parts = np.maximum(1, parts).astype(np.intp)
    if points is None:
        s, interval = cut(grid.s, parts)
        return _locked(grid.joint_path, s, grid.piece[interval])
    inside = (parts > 1) & (points > grid.s[:-1]) & (points < grid.s[1:])
    parts[inside] = 2
    s, interval = cut(grid.s, parts)
    s[(np.cumsum(parts) - 1)[inside]] = points[inside]
    return _locked(grid.joint_path, s, grid.piece[interval])


def _locked(joint_path: JointPath, s: FloatArray, piece: IntArray) -> Grid:
    """A grid of arrays that nobody else has, so that locking needs no copy."""
    s.setflags(write=False)
    return Grid(joint_path, s, piece)
