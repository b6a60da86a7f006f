"""Grid of the optimal planner: arc lengths at which the planner chooses the path speed."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from armcontour.core.checks import FloatArray, Frozen, IntArray, make_unchecked
from armcontour.core.errors import InvalidInput
from armcontour.core.kernel_cache import compiled
from armcontour.motion import JointPath
from armcontour.motion.kernels import value_and_slopes

# Default number of intervals of a grid.
DEFAULT_INTERVALS = 4000
# Smallest number of intervals per piece of the joint path.
FEWEST_PER_PIECE = 2
# Largest number of intervals of a grid, which needs several GB for an arm with six joints.
MAX_INTERVALS = 5_000_000
# Fraction of the intervals that is distributed evenly over the length. The other intervals are
# distributed in proportion to the change of direction in joint space.
EVEN_SHARE = 0.5
# Points with a dq_ds below this fraction of the largest dq_ds have no direction.
RESTING_SLOPE = 1e-9
# Largest number of parts into which a refinement for loss divides an interval.
MAX_PARTS_AT_ONCE = 16
# Largest number of steps in which the numbers of parts are found.
PART_SEARCHES = 8
# Factor by which numbers of parts decrease until they fit.
FEWER = 0.8
# dq_ds counts as zero below this share of the sum of its terms, which is its rounding error.
VANISHED = 1e-12


@dataclass(frozen=True)
class Grid(Frozen):
    """Intervals of a joint path, each inside one of its polynomial pieces."""

    joint_path: JointPath
    s: FloatArray  # Interval ends [m], (n + 1,)
    piece: IntArray  # Piece of the joint path for each interval, (n,)

    @cached_property
    def width(self) -> FloatArray:
        """Interval lengths [m], (n,)."""
        return np.asarray(self.s[1:] - self.s[:-1])

    def __len__(self) -> int:
        """Number of intervals."""
        return len(self.piece)

    def part(self, first: int, last: int) -> Grid:
        """Return the grid of the intervals from `first` up to `last`, which is not included."""
        if first == 0 and last == len(self):
            return self
        return _make_grid(self.joint_path, self.s[first : last + 1], self.piece[first:last])


def place_grid(joint_path: JointPath, intervals: int | None = None) -> Grid:
    """Make a grid that is finer where the direction in joint space changes faster."""
    # Every break of the joint path is a grid point. Each interval therefore lies in one polynomial,
    # and both sides of a vertex between segments are sampled.
    breaks = joint_path.breaks
    pieces = len(breaks) - 1
    count = max(DEFAULT_INTERVALS, FEWEST_PER_PIECE * pieces)
    if intervals is not None:
        count = intervals
    per_piece = count_intervals(breaks, joint_path.coefficients, count)
    if not len(per_piece):
        raise InvalidInput("No joint moves along the joint path, so there is nothing to plan.")
    s, piece = divide_intervals(breaks, per_piece, breaks[:-1])
    return _make_grid(joint_path, s, piece)


def split(grid: Grid, parts: IntArray, points: FloatArray | None = None) -> Grid:
    """Split the intervals of a grid; returns the finer grid.

    - `parts`: number of equal parts of each interval, (n,).
    - `points`: if given, an interval with two parts is split at its point [m], (n,), if the point
      lies inside the interval.
    """
    s, interval = divide_intervals(grid.s, parts, grid.s[:-1] if points is None else points)
    return _make_grid(grid.joint_path, s, grid.piece[interval])


def _make_grid(joint_path: JointPath, s: FloatArray, piece: IntArray) -> Grid:
    """Make a grid of newly created arrays, which become read-only without a copy."""
    return make_unchecked(Grid, joint_path=joint_path, s=s, piece=piece)


@compiled(inner=True, allocates=True)
def _turning_rates(breaks: FloatArray, coefficients: FloatArray, at_rest: float) -> FloatArray:
    """Return the mean rate at which each piece turns in joint space [1/m], (pieces,).

    Returns the mean of |d2q_ds2| / |dq_ds| at both ends and the middle of each piece; an empty
    array if no joint moves.

    - `breaks`: breaks of the joint path [m], (pieces + 1,).
    - `coefficients`: coefficients of its pieces [rad], (pieces, 6, dof).
    - `at_rest`: fraction of the largest dq_ds below which the path has no direction.
    """
    n = len(breaks) - 1
    dof = coefficients.shape[2]
    size = np.empty((n, 3))
    curvature = np.empty((n, 3))
    fastest = 0.0
    for i in range(n):
        width = breaks[i + 1] - breaks[i]
        c = coefficients[i]
        for k in range(3):
            if k == 0:
                s = breaks[i]
            elif k == 1:
                s = (breaks[i] + breaks[i + 1]) / 2
            else:
                s = breaks[i + 1]
            x = (s - breaks[i]) / width
            first = second = 0.0
            for j in range(dof):
                c0 = c[0, j]
                c1 = c[1, j]
                c2 = c[2, j]
                c3 = c[3, j]
                c4 = c[4, j]
                c5 = c[5, j]
                _, slope, curve = value_and_slopes(c0, c1, c2, c3, c4, c5, x)
                slope = slope / width
                curve = curve / (width * width)
                first += slope * slope
                second += curve * curve
            size[i, k] = math.sqrt(first)
            curvature[i, k] = math.sqrt(second)
            fastest = max(fastest, size[i, k])
    if fastest == 0.0:
        return np.empty(0)
    rates = np.empty(n)
    for i in range(n):
        total = 0.0
        count = 0
        for k in range(3):
            if size[i, k] > at_rest * fastest:
                total += curvature[i, k] / size[i, k]
                count += 1
        rates[i] = total / max(count, 1)
    return rates


@compiled()
def count_intervals(breaks: FloatArray, coefficients: FloatArray, count: int) -> IntArray:
    """Return the number of intervals of each piece, (pieces,); empty if no joint moves.

    - `breaks`: breaks of the joint path [m], (pieces + 1,).
    - `coefficients`: coefficients of its pieces [rad], (pieces, 6, dof).
    - `count`: approximate number of all intervals.
    """
    n = len(breaks) - 1
    turning = _turning_rates(breaks, coefficients, RESTING_SLOPE)
    if len(turning) == 0:
        return np.empty(0, np.intp)
    length = 0.0
    turns = 0.0
    for i in range(n):
        width = breaks[i + 1] - breaks[i]
        length += width
        turns += width * turning[i]
    shares = np.empty(n)
    total = 0.0
    for i in range(n):
        width = breaks[i + 1] - breaks[i]
        shares[i] = EVEN_SHARE * width / length
        if turns > 0.0:
            shares[i] += (1 - EVEN_SHARE) * width * turning[i] / turns
        total += shares[i]
    counts = np.empty(n, np.intp)
    for i in range(n):
        counts[i] = max(FEWEST_PER_PIECE, round(shares[i] / total * count))
    return counts


@compiled()
def count_parts(loss: FloatArray, max_loss: float, most: int) -> IntArray:
    """Choose how many parts each interval needs for a total loss of at most `max_loss`, (n,).

    With p parts, an interval keeps 1 / p² of its loss. The fewest parts with a given total loss are
    in proportion to the cube root of the loss, apart from rounding to whole numbers.

    - `loss`: loss of each interval, (n,).
    - `most`: largest sum of the parts.
    """
    n = len(loss)
    roots = np.zeros(n)
    total = 0.0
    for i in range(n):
        # The comparison is false for a loss that is not a number.
        if loss[i] > 0.0:
            roots[i] = np.cbrt(loss[i])
            total += roots[i]
    scale = math.sqrt(total / max_loss)
    parts = np.ones(n)
    for _ in range(PART_SEARCHES):
        remaining = 0.0
        for i in range(n):
            if roots[i] > 0.0:
                parts[i] = min(max(np.rint(scale * roots[i]), 1.0), MAX_PARTS_AT_ONCE)
                remaining += loss[i] / parts[i] ** 2
        if remaining <= max_loss:
            break
        scale *= math.sqrt(remaining / max_loss)
    return round_parts(parts, most)


@compiled()
def round_parts(parts: FloatArray, most: int) -> IntArray:
    """Round numbers of parts up, after reducing them until their sum is at most `most`, (n,)."""
    counts = np.empty(len(parts), np.intp)
    factor = 1.0
    while True:
        total = 0
        for i in range(len(parts)):
            counts[i] = max(1, int(math.ceil(factor * parts[i])))
            total += counts[i]
        if total <= most:
            return counts
        factor *= FEWER


@compiled()
def divide_intervals(
    s: FloatArray, count: IntArray, points: FloatArray
) -> tuple[FloatArray, IntArray]:
    """Divide intervals into equal parts.

    Returns the ends of the parts, (parts + 1,), and the interval index of each part, (parts,).

    - `s`: ends of the intervals, (n + 1,).
    - `count`: number of parts of each interval, (n,).
    - `points`: an interval with two parts is divided at its point, (n,), if the point lies inside.
    """
    total = 0
    for i in range(len(count)):
        total += count[i]
    ends = np.empty(total + 1)
    interval = np.empty(total, np.intp)
    part = 0
    for i in range(len(count)):
        width = s[i + 1] - s[i]
        for k in range(count[i]):
            ends[part] = s[i] + width * k / count[i]
            interval[part] = i
            part += 1
        if count[i] == 2 and s[i] < points[i] < s[i + 1]:
            ends[part - 1] = points[i]
    ends[total] = s[len(count)]
    return ends, interval


@compiled()
def rests_at_ends(coefficients: FloatArray, vanished: float) -> tuple[bool, bool]:
    """Return whether dq_ds is zero at the start and the end, so that joints rest there at any ds.

    - `coefficients`: coefficients of the joint path, (n, 6, dof).
    - `vanished`: dq_ds counts as zero below this fraction of the sum of its terms.
    """
    start, _ = _resting_ends(coefficients[0], vanished)
    _, end = _resting_ends(coefficients[-1], vanished)
    return start, end


@compiled(inner=True)
def _resting_ends(piece: FloatArray, vanished: float) -> tuple[bool, bool]:
    """Return whether dq_ds is zero at the start and the end of a piece, (6, dof)."""
    sizes = 0.0
    for k in range(1, 6):
        square = 0.0
        for j in range(piece.shape[1]):
            square += (k * piece[k, j]) ** 2
        sizes += math.sqrt(square)
    start = 0.0
    end = 0.0
    for j in range(piece.shape[1]):
        slope = 0.0
        for k in range(1, 6):
            slope += k * piece[k, j]
        start += piece[1, j] ** 2
        end += slope**2
    return math.sqrt(start) <= vanished * sizes, math.sqrt(end) <= vanished * sizes
