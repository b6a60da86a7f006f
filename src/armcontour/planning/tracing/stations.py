"""Stations along a path: the knots between which null-space motion is interpolated.

Every break of a path is a knot, and rounding makes tiny arcs of noisy points. Smoothing and the
guide would divide rounding errors by these short distances. They use stations instead.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.geometry import Path
from armcontour.planning.tracing.knots import Knots

# Number of intervals between stations of a path that has little content.
STATIONS = 160
# Largest travel between stations of a longer path, divided by the extent of the path.
LONGEST_STEP = 1 / 16
# Largest angle by which the tangent or the tool turns between stations of a longer path [rad].
LARGEST_TURN = 0.5
# Smallest distance between stations, divided by the length of the path.
SMALLEST_GAP = 1e-5
# Turn of the tangent or of the tool that counts as much as the length of the path [rad].
FULL_TURN = 1.0
# Steps between the stations of each level, the coarsest level first.
STRIDES = (8, 4, 2, 1)
# A level that has fewer intervals is left out.
FEWEST_INTERVALS = 10


@dataclass(frozen=True, slots=True, kw_only=True)
class Stations:
    """Knots that are spread evenly over the travel and the turns of a path."""

    index: IntArray  # Index of each station among the knots, increasing, (stations,)
    # Travel and turns of the path up to each knot, from 0 to 1, increasing, (knots,)
    measure: FloatArray

    @property
    def place(self) -> FloatArray:
        """Measure of each station, (stations,)."""
        return self.measure[self.index]

    def levels(self) -> list[IntArray]:
        """Return the positions, among the stations, of the stations of each level.

        The last level has all stations; each level contains those of the level before.
        """
        last = len(self.index) - 1
        strides = [x for x in STRIDES if x == 1 or last >= x * FEWEST_INTERVALS]
        return [np.unique(np.append(np.arange(0, last, x), last)) for x in strides]


def choose_stations(path: Path, knots: Knots, poses: FloatArray) -> Stations:
    """Choose stations in even steps of the measure, at least `SMALLEST_GAP` apart, and all stops.

    The measure of a place is `s / L + turned / max(turned on the path, FULL_TURN)`, with the arc
    length s, the length L of the path, and the turns of the tool and of the tangent up to s.

    - `poses`: tool poses at the starts of the knot intervals and at the end of the last one, (n +
      1, 3, 4).
    """
    width = knots.u1 - knots.u0
    bend = width * path.curvatures[knots.segment]
    turn = np.linalg.norm(np.diff(poses[:, :, :3], axis=0), axis=(1, 2)) / np.sqrt(2)
    measure = width / path.length
    steps = path.length / (LONGEST_STEP * float(np.linalg.norm(np.ptp(poses[..., 3], axis=0))))
    parts = 1
    for turned in (bend, turn):
        total = float(turned.sum())
        measure = measure + turned / max(total, FULL_TURN)
        steps = max(steps, total / LARGEST_TURN)
        parts += total > FULL_TURN
    measure = np.append(0.0, np.cumsum(measure))
    count = max(STATIONS, int(np.ceil(parts * steps)))
    return Stations(
        index=_spread(path, np.append(knots.s0, path.length), measure, count),
        measure=measure / measure[-1],
    )


def _spread(path: Path, s: FloatArray, measure: FloatArray, count: int) -> IntArray:
    """Return the indices of the knots nearest to even steps of the measure, and of all stops.

    - `s`: arc lengths of the knots [m], (n,).
    - `measure`: measure of the knots, (n,).
    - `count`: number of steps.
    """
    last = len(s) - 1
    fixed = np.zeros(len(s), dtype=np.bool_)
    fixed[[0, last]] = True
    fixed[np.searchsorted(s, path.stops)] = True
    goals = np.linspace(0.0, measure[-1], count + 1)
    after = np.clip(np.searchsorted(measure, goals), 1, last)
    nearer = goals - measure[after - 1] < measure[after] - goals
    wanted = np.unique(np.concatenate([after - nearer, np.flatnonzero(fixed)]))
    gap = SMALLEST_GAP * path.length
    ends = s[fixed]
    following = ends[np.minimum(np.searchsorted(ends, s, side="right"), len(ends) - 1)]
    far_from_end = fixed | (following - s >= gap)
    if far_from_end[wanted].all() and (np.diff(s[wanted]) >= gap).all():
        return wanted
    chosen = [0]
    for i in wanted[1:].tolist():
        has_gap = s[i] - s[chosen[-1]] >= gap and far_from_end[i]
        if fixed[i] or has_gap:
            chosen.append(i)
    return np.array(chosen)
