"""The paths of known shape that a shaped path starts from, and that it is never slower than."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.errors import ArmContourError
from armcontour.core.sampling import number_parts
from armcontour.geometry import Path, Proof, RoundedPath, Tube, round_corners, round_with_parabolas
from armcontour.geometry.shaped import ARCS, PARABOLAS, STOPS
from armcontour.motion import JointPath, Trajectory
from armcontour.planning.optimal import plan_optimal
from armcontour.planning.options import Optimal, Shaped
from armcontour.planning.program_tracing import trace_fastest
from armcontour.robot import Arm, Limits

# Places are found at the ends of segments, and so often along arcs [rad].
TURN = 0.05
# A point may lie this share of the tolerance beside its place, along the objective.
BESIDE = 0.05


def match(tube: Tube, path: Path, places: FloatArray, reach: FloatArray | float) -> FloatArray:
    """Places at which points of a path are nearest to the objective, in order, (m, 2).

    The point of the path that is nearest to a corner passes it: points before it belong to the
    stretch before the corner, points after it to the stretch after the corner.

    Args:
        tube: The tube around the objective.
        path: The path.
        places: Arc lengths on the objective and on the path that nearly belong together [m],
            increasing, (n, 2).
        reach: How far the nearest point may be from the given place along the objective [m], one
            number or one per given place, (n,).
    """
    reaches = np.broadcast_to(np.asarray(reach, dtype=np.float64), len(places))
    _, passed = tube.nearest_to_corners(path, places, reaches)
    passed = np.maximum.accumulate(passed)
    count = np.maximum(np.ceil(path.curvatures * path.lengths / TURN).astype(np.intp), 1)
    segment, number = number_parts(count)
    even = path.breaks[segment] + path.lengths[segment] * number / count[segment]
    # The points that pass a corner are on both sides of it.
    s = np.concatenate([even, [path.length], passed, passed])
    corner = np.arange(len(passed))
    stretch = np.searchsorted(passed, s[: len(even) + 1])
    stretch = np.concatenate([stretch, corner, corner + 1])
    order = np.lexsort((stretch, s))
    s, stretch = s[order], stretch[order]
    guess, around = (np.interp(s, places[:, 1], x) for x in (places[:, 0], reaches))
    corners = np.concatenate([[0.0], tube.objective.breaks[tube.vertex], [tube.breaks[-1]]])
    low = np.clip(guess - around, corners[stretch], corners[stretch + 1])
    high = np.clip(guess + around, corners[stretch], corners[stretch + 1])
    at = np.maximum.accumulate(tube.nearest(path(s), low, high))
    at[0], at[-1] = 0.0, tube.objective.length
    return np.stack([at, s], axis=1)


def prove(tube: Tube, path: Path, places: FloatArray) -> Proof:
    """Proof that every point of a path is within the tolerance of its place.

    Args:
        tube: The tube around the objective.
        path: The path.
        places: Its places, as from `match`, (m, 2).
    """
    last = len(tube) - 1
    piece = np.clip(np.searchsorted(tube.breaks, places[:, 0], side="right") - 1, 0, last)
    return tube.prove(path, places, BESIDE * tube.tolerance[piece])


# Corners that leave their zones are rounded less, by so many halvings; where neighbours still make
# them leave, to this share.
HALVINGS, LESS = 14, 0.9
# The tool stops at corners that cannot be rounded by so much, or with so large a radius [m]: no arm
# resolves so small arcs, and rounding errors would exceed limits.
FINEST, SHARPEST = 1e-8, 1e-10
# A point of a start belongs to the objective this many tolerances to either side of its place.
REACH = 6.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Candidate:
    """A path within the tolerance, with its fastest timing.

    Args:
        name: Name of its shape.
        path: The path.
        places: Arc lengths on the objective and on the path that belong together [m], (n, 2).
        joint_path: The joint path along the path.
        trajectory: The fastest motion along the path.
    """

    name: str
    path: Path
    places: FloatArray
    joint_path: JointPath
    trajectory: Trajectory

    @property
    def duration(self) -> float:
        """Duration of the fastest motion [s]."""
        return self.trajectory.duration


@dataclass(frozen=True, slots=True)
class Timer:
    """Times paths of one contour, all in the same configuration of the arm.

    Args:
        arm: The arm.
        limits: The limits that the motion keeps, one value per joint.
        configuration: For an arm in the plane, the branch of its inverse kinematics.
        start: For an arm in space, joint positions at the start [rad], (dof,).
        intervals: Approximate number of grid intervals of a plan; None for the default.
    """

    arm: Arm
    limits: Limits
    configuration: str | None
    start: FloatArray | None
    intervals: int | None = None

    def trace(self, path: Path) -> JointPath:
        """The joint path along a path."""
        return trace_fastest(
            path, self.arm, self.limits, configuration=self.configuration, start=self.start
        )

    def time(self, joint_path: JointPath) -> Trajectory:
        """The fastest motion along a joint path."""
        return plan_optimal(joint_path, self.arm, self.limits, Optimal(intervals=self.intervals))

    def candidate(self, name: str, path: Path, places: FloatArray) -> Candidate | None:
        """A path with its fastest timing; None where the arm cannot follow the path."""
        try:
            joint_path = self.trace(path)
            trajectory = self.time(joint_path)
        except ArmContourError:
            return None
        return Candidate(
            name=name, path=path, places=places, joint_path=joint_path, trajectory=trajectory
        )


def tube_of(objective: Path, options: Shaped) -> Tube:
    """The tube of the tolerance around an objective path."""
    return Tube.of(
        objective, options.tolerance, line_tolerance=options.line_tolerance, zone=options.zone
    )


def make_starts(
    objective: Path, tube: Tube, options: Shaped, share: float = 1.0
) -> dict[str, tuple[Path, FloatArray]]:
    """The starts by their names, each with its places on the objective, all within the tube.

    Args:
        objective: The objective path.
        tube: The tube of the tolerance.
        options: Options of the shaped path.
        share: Share of the tolerance that corners are rounded to.
    """
    whole = np.array([[0.0, 0.0], [objective.length, objective.length]])
    found: dict[str, tuple[Path, FloatArray]] = {STOPS: (objective, whole)}
    for name, round_ in ((ARCS, round_corners), (PARABOLAS, round_with_parabolas)):
        rounded = _round_within(objective, tube, options, round_, share)
        if rounded is not None:
            found[name] = rounded
    return found


def _round_within(
    objective: Path,
    tube: Tube,
    options: Shaped,
    round_: Callable[..., RoundedPath],
    share: float,
) -> tuple[RoundedPath, FloatArray] | None:
    """A rounded path within the tube, with its places; None if there is none but with stops.

    A corner whose curve would leave its zone is rounded less.
    """
    wanted = np.full(len(objective) - 1, share * options.tolerance)
    wanted[tube.vertex - 1] = share * tube.vertex_tolerance

    def outside(tolerance: FloatArray) -> tuple[RoundedPath, FloatArray, IntArray]:
        path = round_(objective, tolerance=tolerance, angular_tolerance=options.angular_tolerance)
        places = match(tube, path, _places(path), REACH * options.tolerance)
        return path, places, _corners_outside(tube, path, places)

    path, places, bad = outside(wanted)
    if not len(bad):
        return path, places
    low, high = np.where(np.isin(np.arange(len(wanted)), bad), 0.0, wanted), wanted.copy()
    for _ in range(HALVINGS):
        middle = np.where(low < high, (low + high) / 2, low)
        bad = outside(middle)[2]
        low[bad] = np.where(middle[bad] > low[bad], low[bad], LESS * low[bad])
        high[bad] = middle[bad]
        good = np.setdiff1d(np.flatnonzero(low < high), bad)
        low[good] = middle[good]
    for _ in range(HALVINGS):
        low[low < FINEST] = 0.0
        path, places, bad = outside(low)
        if not len(bad):
            return path, places
        low[bad] *= LESS
    return None


def _corners_outside(tube: Tube, path: RoundedPath, places: FloatArray) -> IntArray:
    """Vertices between segments at which a rounded path leaves the tube or turns on the spot."""
    proof = prove(tube, path, places)
    middle = (path.breaks[:-1] + path.breaks[1:]) / 2
    place = np.interp(middle[proof.segments > proof.slack], places[:, 1], places[:, 0])
    at = tube.objective.breaks[tube.vertex]
    nearest = np.abs(place[:, None] - at).argmin(axis=1) if len(at) else np.zeros(0, dtype=np.intp)
    corners = path.corners
    tiny = corners.vertex[(corners.radius > 0) & (corners.radius < SHARPEST)]
    far = tube.vertex[proof.vertices > proof.slack]
    return np.unique(np.concatenate([tube.vertex[nearest], far, tiny])) - 1


def _places(rounded: RoundedPath) -> FloatArray:
    """Arc lengths on the objective and on its rounded path that belong together [m], (n, 2)."""
    c = rounded.corners
    at = rounded.objective.breaks[c.vertex]
    s = np.unique(
        np.concatenate([[0.0], at - c.tangent, at, at + c.tangent, [rounded.objective.length]])
    )
    return np.stack([s, np.maximum.accumulate(rounded.place(s))], axis=1)
