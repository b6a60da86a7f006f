"""Initial paths of the shape search: exact corners, arcs or parabolas.

A shaped path is never slower than its initial path.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.errors import ArmContourError
from armcontour.core.sampled_data import number_parts
from armcontour.geometry import Path, Proof, RoundedPath, Tube, round_path
from armcontour.geometry.rounding.rounded_path import Curve
from armcontour.geometry.shaped_path import ARCS, PARABOLAS, STOPS
from armcontour.geometry.tube import ALL
from armcontour.motion import JointPath, Trajectory
from armcontour.planning.optimal_timing import Optimal, plan_optimal
from armcontour.planning.program_tracing import trace_by_duration
from armcontour.robot import Arm, Limits

# Angle between matched points along arcs [rad].
MATCH_TURN = 0.05
# Half length of the part of the objective, around the matching point, to which `prove` measures the
# distance of a point, divided by the tolerance
MATCH_TOLERANCE = 0.05
# Number of bisections of the rounding tolerance of corners that leave the tube, and largest number
# of later reductions by LESS.
TOLERANCE_BISECTIONS = 14
# If a corner also leaves the tube with the tolerance that is found, the tolerance is multiplied by
# this factor.
LESS = 0.9
# The tool stops at corners with smaller rounding tolerances [m], because no arm resolves such arcs,
# and rounding errors would exceed limits.
FINEST_TOLERANCE = 1e-8
# Rounded corners with smaller radii [m] count as outside the tube, for the same reason.
SMALLEST_RADIUS = 1e-10
# Largest distance along the objective between the exact and the approximate match of a point of a
# start, divided by the tolerance
MATCH_CORRECTION = 6.0


def match(
    tube: Tube,
    path: Path,
    matches: FloatArray,
    reach: FloatArray | float,
    corners: slice = ALL,
) -> FloatArray:
    """Match a path to the objective: arc lengths of nearest points on both [m], (m, 2).

    The path passes a corner at its point nearest to the corner. Points before this point match the
    stretch before the corner, points after it match the stretch after the corner.

    - `matches`: approximate matching arc lengths on the objective and on the path [m], increasing,
      (n, 2).
    - `reach`: largest distance along the objective between exact and approximate match [m], one
      number or one per row, (n,).
    - `corners`: the corners of the objective that the path passes; by default all, then the path
      follows the whole objective.
    """
    reaches = np.broadcast_to(np.asarray(reach, dtype=np.float64), len(matches))
    _, passed = tube.nearest_to_corners(path, matches, reaches, corners)
    passed = np.maximum.accumulate(passed)
    count = np.maximum(np.ceil(path.curvatures * path.lengths / MATCH_TURN).astype(np.intp), 1)
    segment, number = number_parts(count)
    even = path.breaks[segment] + path.lengths[segment] * number / count[segment]
    # The points that pass a corner belong to both stretches.
    s = np.concatenate([even, [path.length], passed, passed])
    corner = np.arange(len(passed))
    stretch = np.searchsorted(passed, s[: len(even) + 1])
    stretch = np.concatenate([stretch, corner, corner + 1])
    order = np.lexsort((stretch, s))
    s = s[order]
    stretch = stretch[order]
    guess, around = (np.interp(s, matches[:, 1], x) for x in (matches[:, 0], reaches))
    # The stretches of the part end at its corners, and at the corners next to the part.
    inner = tube.objective.breaks[tube.vertex]
    bounds = np.concatenate([[0.0], inner, [tube.breaks[-1]]])
    first = corners.indices(len(inner))[0]
    bounds = bounds[first : first + len(passed) + 2]
    low = np.clip(guess - around, bounds[stretch], bounds[stretch + 1])
    high = np.clip(guess + around, bounds[stretch], bounds[stretch + 1])
    s_objective = np.maximum.accumulate(tube.nearest(path(s), low, high))
    if corners == ALL:
        s_objective[0] = 0.0
        s_objective[-1] = tube.objective.length
    return np.stack([s_objective, s], axis=1)


def prove(tube: Tube, path: Path, matches: FloatArray, corners: slice = ALL) -> Proof:
    """Bound how far each point of a path is from the objective near its matching point.

    `corners` are those of the part of the objective that the path follows, by default all.
    """
    last = len(tube) - 1
    piece = np.clip(np.searchsorted(tube.breaks, matches[:, 0], side="right") - 1, 0, last)
    reach = MATCH_TOLERANCE * tube.tolerance[piece]
    if corners == ALL:
        return tube.prove(path, matches, reach)
    return tube.prove_part(path, matches, reach, corners)


@dataclass(frozen=True, slots=True)
class Tolerances:
    """Tolerances of a shaped path."""

    distance: float  # Largest distance from the objective, and of its vertices from the path [m]
    angle: float | None  # Largest angle from the required orientation [rad]; None: unlimited


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Candidate:
    """A path within the tolerance, with its fastest timing."""

    name: str
    path: Path
    places: FloatArray  # Matching arc lengths on the objective and on the path [m], (n, 2)
    joint_path: JointPath  # The joint path along the path
    trajectory: Trajectory  # The fastest motion along the path

    @property
    def duration(self) -> float:
        """Duration of the fastest motion [s]."""
        return self.trajectory.duration


@dataclass(frozen=True, slots=True)
class Timer:
    """Traces and times paths of one contour in one configuration of the arm."""

    arm: Arm
    limits: Limits  # The limits of the motion, one value per joint
    configuration: str | None  # For an arm in the plane, the branch of its inverse kinematics
    seed: FloatArray | None  # For an arm in space, joint positions at the start [rad], (dof,)
    # Approximate number of grid intervals of a plan; None for the default
    intervals: int | None = None

    def trace(self, path: Path) -> JointPath:
        """Trace a path in the configuration; of several joint paths, return the fastest."""
        joint_paths = trace_by_duration(
            path, self.arm, self.limits, configuration=self.configuration, seed=self.seed
        )
        return next(joint_paths)[0]

    def time(self, joint_path: JointPath) -> Trajectory:
        """Plan the fastest motion along a joint path."""
        return plan_optimal(joint_path, self.arm, self.limits, Optimal(intervals=self.intervals))

    def candidate(self, name: str, path: Path, matches: FloatArray) -> Candidate | None:
        """Time a path; None if the arm cannot follow it."""
        try:
            joint_path = self.trace(path)
            trajectory = self.time(joint_path)
        except ArmContourError:
            return None
        return Candidate(
            name=name, path=path, places=matches, joint_path=joint_path, trajectory=trajectory
        )


def make_starts(
    objective: Path, tube: Tube, tolerances: Tolerances, share: float = 1.0
) -> dict[str, tuple[Path, FloatArray]]:
    """Make the starts by name, all within the tube, each with its matching arc lengths.

    `share` is the fraction of the tolerance to which corners are rounded.
    """
    matches = np.array([[0.0, 0.0], [objective.length, objective.length]])
    starts: dict[str, tuple[Path, FloatArray]] = {STOPS: (objective, matches)}
    curves: dict[str, Curve] = {ARCS: "arc", PARABOLAS: "parabola"}
    for name, curve in curves.items():
        rounded = _round_within(objective, tube, tolerances, curve, share)
        if rounded is not None:
            starts[name] = rounded
    return starts


def _round_within(
    objective: Path, tube: Tube, tolerances: Tolerances, curve: Curve, share: float
) -> tuple[RoundedPath, FloatArray] | None:
    """Round corners within the tube; return path and matching arc lengths, or None for stops."""
    # Corners whose rounding leaves the tube get a smaller tolerance.
    requested = np.full(len(objective) - 1, share * tolerances.distance)
    requested[tube.vertex - 1] = share * tube.vertex_tolerance

    def outside(tolerance: FloatArray) -> tuple[RoundedPath, FloatArray, IntArray]:
        """Round the corners; return the path, its matches, and the corners outside the tube."""
        path = round_path(
            objective, tolerance=tolerance, angular_tolerance=tolerances.angle, curve=curve
        )
        matches = match(tube, path, _matching_lengths(path), MATCH_CORRECTION * tolerances.distance)
        return path, matches, _corners_outside(tube, path, matches)

    path, matches, outside_corners = outside(requested)
    if not len(outside_corners):
        return path, matches
    low = np.where(np.isin(np.arange(len(requested)), outside_corners), 0.0, requested)
    high = requested.copy()
    for _ in range(TOLERANCE_BISECTIONS):
        middle = np.where(low < high, (low + high) / 2, low)
        outside_corners = outside(middle)[2]
        low[outside_corners] = np.where(
            middle[outside_corners] > low[outside_corners],
            low[outside_corners],
            LESS * low[outside_corners],
        )
        high[outside_corners] = middle[outside_corners]
        good = np.setdiff1d(np.flatnonzero(low < high), outside_corners)
        low[good] = middle[good]
    for _ in range(TOLERANCE_BISECTIONS):
        low[low < FINEST_TOLERANCE] = 0.0
        path, matches, outside_corners = outside(low)
        if not len(outside_corners):
            return path, matches
        low[outside_corners] *= LESS
    return None


def _corners_outside(tube: Tube, path: RoundedPath, matches: FloatArray) -> IntArray:
    """Find the vertices at which a rounded path leaves the tube, or has a tiny radius."""
    proof = prove(tube, path, matches)
    middle = (path.breaks[:-1] + path.breaks[1:]) / 2
    s_objective = np.interp(middle[proof.segments > proof.slack], matches[:, 1], matches[:, 0])
    s_corners = tube.objective.breaks[tube.vertex]
    nearest = (
        np.abs(s_objective[:, None] - s_corners).argmin(axis=1)
        if len(s_corners)
        else np.zeros(0, dtype=np.intp)
    )
    corners = path.corners
    tiny = corners.vertex[(corners.radius > 0) & (corners.radius < SMALLEST_RADIUS)]
    missed = tube.vertex[proof.vertices > proof.slack]
    return np.unique(np.concatenate([tube.vertex[nearest], missed, tiny])) - 1


def _matching_lengths(rounded: RoundedPath) -> FloatArray:
    """Return matching arc lengths on the objective and on its rounded path [m], (n, 2)."""
    c = rounded.corners
    s_corners = rounded.objective.breaks[c.vertex]
    s = np.unique(
        np.concatenate(
            [
                [0.0],
                s_corners - c.tangent,
                s_corners,
                s_corners + c.tangent,
                [rounded.objective.length],
            ]
        )
    )
    return np.stack([s, np.maximum.accumulate(rounded.place(s))], axis=1)
