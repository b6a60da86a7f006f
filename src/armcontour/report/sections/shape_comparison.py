"""A shaped path beside the paths that it could have been: their distances, speeds and times."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour._checks import FloatArray
from armcontour.arms import PlanarTwoLink
from armcontour.geometry import Path, ShapedPath, Tube
from armcontour.geometry.segments import TANGENT_TOLERANCE
from armcontour.jobs import Job, Run, RunResult
from armcontour.motion import Trajectory
from armcontour.report.sections.tolerance import tube_of
from armcontour.timing import plan
from armcontour.timing.shaping.starts import make_starts
from armcontour.timing.shaping.wishes import Wishes

# Evenly spaced places along the objective path at which distances are computed.
PLACES = 1500
# The own part of a point reaches this many tolerances along the objective path, to either side.
REACH = 3.0
# Relative excess of a distance that is a rounding error: a corner may be missed by its tolerance.
NO_MORE = 1e-6


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
        return fastest_start(self.path)[1] - self.path.outcome.durations["shaped"]


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


def fastest_start(path: ShapedPath) -> tuple[str, float]:
    """Name and duration [s] of the fastest of the starts of a shaped path."""
    starts = {name: x for name, x in path.outcome.durations.items() if name != "shaped"}
    name = min(starts, key=lambda x: starts[x])
    return name, starts[name]


def variant_of(path: ShapedPath) -> Variant:
    """A shaped path as a variant of its objective path."""
    return Variant(name="shaped path", path=path, places=path.places)


def starts_of(path: ShapedPath, run: Run) -> dict[str, Variant]:
    """The starts of a shaped path that its tolerance has room for, by their names; made again.

    Args:
        path: The shaped path.
        run: Its run, which has the angular tolerance.
    """
    wishes = Wishes(
        tolerance=path.tolerance,
        line_tolerance=path.line_tolerance,
        zone=path.zone,
        angular_tolerance=None if run.rounding is None else run.rounding.angular_tolerance,
    )
    return {
        name: Variant(name=name, path=found, places=places)
        for name, (found, places) in make_starts(path.objective, tube_of(path), wishes).items()
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
        ignore_jerk=this.ignore_jerk,
        reserve=this.reserve,
        memory=job.memory,
    )


def distances(variant: Variant, path: ShapedPath) -> tuple[FloatArray, FloatArray]:
    """Arc lengths on the objective path, and vectors from there to a variant's place [m].

    Between places that were computed a place is interpolated. Where its vector is longer than the
    tolerance it is shortened to the distance from its own part of the objective path.

    Args:
        variant: The variant.
        path: The shaped path, which has the objective path and the tolerance.

    Returns:
        Arc lengths, (n,), and vectors, (n, dimension).
    """
    objective = path.objective
    even = np.linspace(0.0, objective.length, PLACES)
    s = np.unique(np.concatenate([even, objective.breaks, variant.places[:, 0]]))
    points = variant.path(variant.place(s))
    vectors = points - objective(s)
    length = np.linalg.norm(vectors, axis=1)
    long = length > path.tolerance * (1 + NO_MORE)
    vectors[long] *= (_off_own_part(points[long], s[long], path) / length[long])[:, None]
    return s, vectors


def largest_distance(path: ShapedPath) -> float:
    """Largest distance of points of a shaped path from their own parts of the objective [m]."""
    s = np.unique(np.concatenate([np.linspace(0.0, path.length, PLACES), path.places[:, 1]]))
    own = np.interp(s, path.places[:, 1], path.places[:, 0])
    return float(_off_own_part(path(s), own, path).max())


def _off_own_part(points: FloatArray, s: FloatArray, path: ShapedPath) -> FloatArray:
    """Distances of points from the objective path near their places [m], (n,)."""
    exact = Tube.of(path.objective, 0.0)
    return 0.0 - exact.margin(points, exact.windows(s, REACH * path.tolerance))


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
    tube = tube_of(path)
    proof = tube.prove(path, path.places, REACH * path.tolerance)
    return proof.vertices + tube.vertex_tolerance
