"""A shaped path beside the paths that it could have been: their distances, speeds and times."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour._checks import FloatArray
from armcontour.arms import PlanarTwoLink
from armcontour.geometry import Path, RoundedPath, ShapedPath
from armcontour.geometry.segments import TANGENT_TOLERANCE
from armcontour.jobs import Job, Run, RunResult
from armcontour.motion import Trajectory
from armcontour.timing import plan
from armcontour.timing.shaping.starts import ARCS, make_starts
from armcontour.timing.shaping.wishes import Wishes

# Evenly spaced places along the objective path at which distances are computed.
PLACES = 1500


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
    """The starts of a shaped path by their names, made again.

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
        for name, (found, places) in make_starts(path.objective, wishes).items()
    }


def arcs_among(starts: dict[str, Variant]) -> RoundedPath:
    """The arcs of the same tolerance."""
    found = starts[ARCS].path
    assert isinstance(found, RoundedPath)
    return found


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


def distances(variant: Variant, objective: Path) -> tuple[FloatArray, FloatArray]:
    """Arc lengths on the objective path, and vectors from there to a variant's place [m].

    Returns:
        Arc lengths, (n,), and vectors, (n, dimension).
    """
    even = np.linspace(0.0, objective.length, PLACES)
    s = np.unique(np.concatenate([even, objective.breaks, variant.places[:, 0]]))
    return s, variant.path(variant.place(s)) - objective(s)


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


def missed_vertices(variant: Variant, objective: Path) -> FloatArray:
    """Distances of the vertices at which the objective path turns from a variant [m]."""
    at = sharp_vertices(objective)
    return variant.path.project(objective(at)).distance if len(at) else np.zeros(0)
