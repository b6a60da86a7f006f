"""A shaped path beside the paths that it could have been: their distances, speeds and times."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour._checks import FloatArray
from armcontour.arms import PlanarTwoLink
from armcontour.geometry import Path, ShapedPath
from armcontour.geometry.segments import TANGENT_TOLERANCE
from armcontour.geometry.shaped import SHAPED
from armcontour.jobs import Job, Run, RunResult
from armcontour.motion import Trajectory
from armcontour.timing import plan
from armcontour.timing.shaping.wishes import Wishes, tube_of

# Evenly spaced places at which distances are drawn, and at which the largest one is looked for.
PLACES = 1500
MANY_PLACES = 15_000
# On both sides of a jump of places, places are spread over this many times its length.
SPREAD = 2.0
# The own part of a corner reaches this many tolerances along the objective path, to either side.
REACH = 3.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ShapedContour:
    """A shaped contour of a run.

    Args:
        label: What it is called.
        result: The run.
        path: The shaped path.
        start: Joint positions in which its motion starts [rad], (dof,).
    """

    label: str
    result: RunResult
    path: ShapedPath
    start: FloatArray

    @property
    def saved(self) -> float:
        """Time that the shape saves [s]."""
        outcome = self.path.outcome
        return outcome.durations[outcome.start] - outcome.durations[SHAPED]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Variant:
    """A path within the tolerance of an objective path.

    Args:
        name: Name in the legend.
        path: The path.
        places: Arc lengths on the objective path and on this path that belong together [m], (n, 2).
    """

    name: str
    path: Path
    places: FloatArray

    def place(self, s: FloatArray) -> FloatArray:
        """Arc lengths on this path at arc lengths on the objective path [m]."""
        found = np.interp(s, self.places[:, 0], self.places[:, 1])
        return np.clip(found, 0.0, self.path.length)

    def origin(self, s: FloatArray) -> FloatArray:
        """Arc lengths on the objective path at arc lengths on this path [m]."""
        return np.interp(s, self.places[:, 1], self.places[:, 0])


def variant_of(path: ShapedPath) -> Variant:
    """A shaped path as a variant of its objective path."""
    return Variant(name="shaped path", path=path, places=without_jumps(path.places, path.objective))


def without_jumps(places: FloatArray, objective: Path) -> FloatArray:
    """Places that belong together, for figures: no point belongs to several places, (m, 2) [m].

    On the inside of a corner one point belongs to the places on both sides. Here it belongs to the
    corner only, and places nearby are spread evenly.

    Args:
        places: Arc lengths on the objective path and on the path [m], (n, 2).
        objective: The objective path.
    """
    jumps = np.flatnonzero((np.diff(places[:, 1]) == 0) & (np.diff(places[:, 0]) > 0))
    kept, corners = np.ones(len(places), dtype=bool), []
    for i in jumps:
        low, high = places[i : i + 2, 0]
        spread = SPREAD * (high - low)
        kept &= (places[:, 0] <= low - spread) | (places[:, 0] >= high + spread)
        inside = objective.breaks[(objective.breaks >= low) & (objective.breaks <= high)]
        corners += [(x, places[i, 1]) for x in inside]
    kept[[0, -1]] = True
    found = np.concatenate([places[kept], np.reshape(corners, (-1, 2))])
    return found[np.lexsort((found[:, 1], found[:, 0]))]


def starts_of(path: ShapedPath, run: Run) -> dict[str, Variant]:
    """The starts of a shaped path that its tolerance has room for, by their names; made again.

    Args:
        path: The shaped path.
        run: Its run, which has the angular tolerance.
    """
    from armcontour.timing.shaping.starts import make_starts

    wishes = Wishes(
        tolerance=path.tolerance,
        line_tolerance=path.line_tolerance,
        zone=path.zone,
        angular_tolerance=None if run.rounding is None else run.rounding.angular_tolerance,
    )
    starts = make_starts(path.objective, tube_of(path.objective, path), wishes)
    return {
        name: Variant(name=name, path=found, places=without_jumps(places, path.objective))
        for name, (found, places) in starts.items()
    }


def time_variant(variant: Variant, contour: ShapedContour, job: Job) -> Trajectory:
    """The fastest motion along a variant, under the limits of a run."""
    this = contour.result.run
    planar = isinstance(job.arm, PlanarTwoLink)
    return plan(
        variant.path,
        job.arm,
        this.limits,
        branch=job.branch,
        start=None if planar else contour.start,
        reserve=this.reserve,
    )


def distances(variant: Variant, objective: Path) -> tuple[FloatArray, FloatArray]:
    """Arc lengths on the objective path, and vectors from there to the point that belongs to it.

    Around a corner several points may belong to one arc length, or one point to several.

    Args:
        variant: The variant.
        objective: The objective path.

    Returns:
        Arc lengths, increasing, (n,), and vectors, (n, dimension) [m].
    """
    own, along = variant.places.T
    # Both advance evenly from one pair of places to the next.
    ends = np.concatenate([[0.0], np.cumsum(np.diff(own) + np.diff(along))])
    breaks = np.interp(objective.breaks, own, ends)
    at = np.unique(np.concatenate([np.linspace(0.0, ends[-1], PLACES), ends, breaks]))
    s, path = np.interp(at, ends, own), variant.path
    points = path(np.clip(np.interp(at, ends, along), 0.0, path.length))
    return s, points - objective(np.clip(s, 0.0, objective.length))


def largest_distance(path: ShapedPath) -> float:
    """Largest distance of points of a shaped path from their places on the objective path [m]."""
    s = np.union1d(np.linspace(0.0, path.length, MANY_PLACES), path.places[:, 1])
    places = path.objective(np.interp(s, path.places[:, 1], path.places[:, 0]))
    return float(np.linalg.norm(path(s) - places, axis=1).max())


def across(vectors: FloatArray, objective: Path, s: FloatArray) -> FloatArray:
    """The parts of vectors across the objective path [m], in the plane above 0 to the left."""
    along = objective(s, 1)
    if objective.dimension == 2:
        return np.asarray(along[:, 0] * vectors[:, 1] - along[:, 1] * vectors[:, 0])
    rest = vectors - np.einsum("ij,ij->i", vectors, along)[:, None] * along
    return np.asarray(np.linalg.norm(rest, axis=1))


def sharp_vertices(objective: Path) -> FloatArray:
    """Arc lengths of the vertices at which a path turns [m]."""
    return objective.breaks[1:-1][objective.turns > TANGENT_TOLERANCE]


def missed_vertices(path: ShapedPath) -> FloatArray:
    """Distances of the vertices at which the objective turns from their own parts of a path [m]."""
    tube = tube_of(path.objective, path)
    reach = np.full(len(path.places), REACH * path.tolerance)
    distance, _ = tube.nearest_to_corners(path, path.places, reach)
    return distance
