"""Samples of a path that depend on neither the arm's place nor its configuration."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.geometry import Path
from armcontour.planning.tracing.knots import Knots, first_knots, row_of_poses
from armcontour.planning.tracing.stations import Stations, choose_stations

# Largest turn of the path over a chord along which solutions are followed [rad].
CHORD_TURN = 0.1
# Largest number of segments of a path whose samples are kept, because the samples of a long path
# take much memory.
LONGEST_KEPT = 20_000
# Number of paths whose samples are kept. They are the contours that equally fast configurations, or
# the places of a part, trace again.
KEPT_PATHS = 16


# The class has no slots, because its properties are cached.
@dataclass(frozen=True, kw_only=True, eq=False)
class PathSamples:
    """Knots of a path with the tool poses there, its stations, and the poses that are followed.

    Args:
        path: The path, with the orientation that the tool has.
        knots: The n intervals between knots.
    """

    path: Path
    knots: Knots

    @cached_property
    def poses(self) -> FloatArray:
        """Tool poses at the starts of the intervals and at the end of the last, (n + 1, 3, 4)."""
        return row_of_poses(self.path, self.knots)

    @cached_property
    def s(self) -> FloatArray:
        """Arc lengths of the knots [m], (n + 1,)."""
        return np.append(self.knots.s0, self.path.length)

    @cached_property
    def stations(self) -> Stations:
        """Stations among the knots."""
        return choose_stations(self.path, self.knots, self.poses)

    @property
    def fine(self) -> Knots:
        """Subintervals whose chords are close to the path."""
        return self._subdivided[0]

    @property
    def knot_index(self) -> IntArray:
        """Index of each knot among the followed poses, (n + 1,)."""
        return self._subdivided[1]

    @cached_property
    def followed(self) -> FloatArray:
        """Tool poses at the starts of the subintervals and at the end of the last, (m, 3, 4)."""
        if len(self.fine) == len(self.knots):
            return self.poses
        return row_of_poses(self.path, self.fine)

    @cached_property
    def _subdivided(self) -> tuple[Knots, IntArray]:
        return subdivide(self.path, self.knots, self.poses)


def sample_path(path: Path, span: float, finer: int = 1) -> PathSamples:
    """Return the samples at the first knots of a path, from a cache unless the path is long.

    Args:
        path: The path, with the orientation that the tool has.
        span: Span of the arm [m].
        finer: Factor by which the knot intervals are shorter than required.
    """
    if len(path) > LONGEST_KEPT:
        return _make_samples(path, span, finer)
    return _kept_samples(path, span, finer)


@lru_cache(maxsize=KEPT_PATHS)
def _kept_samples(path: Path, span: float, finer: int) -> PathSamples:
    """Return the samples of a path from the cache; arguments as of `sample_path`."""
    return _make_samples(path, span, finer)


def _make_samples(path: Path, span: float, finer: int) -> PathSamples:
    """Make the samples of a path; arguments as of `sample_path`."""
    return PathSamples(path=path, knots=first_knots(path, span, finer))


def subdivide(path: Path, knots: Knots, poses: FloatArray) -> tuple[Knots, IntArray]:
    """Divide knot intervals into subintervals whose chords are close to the path.

    Returns the subintervals, and the index of each given knot among the knots of the subintervals.

    `poses` are the tool poses at the starts of the intervals and at the end of the last one, (n +
    1, 3, 4).
    """
    width = knots.u1 - knots.u0
    turn = width * path.curvatures[knots.segment]
    if path.orientation is not None and not path.orientation.constant:
        axes = poses[:, :, :3]
        turned = np.linalg.norm(axes[1:] - axes[:-1], axis=(1, 2)) / np.sqrt(2)
        turn = np.maximum(turn, turned)
    if turn.max() <= CHORD_TURN:
        return knots, np.arange(len(knots) + 1)
    return knots.cut(np.maximum(1, np.ceil(turn / CHORD_TURN)).astype(np.intp))
