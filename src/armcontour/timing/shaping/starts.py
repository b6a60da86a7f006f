"""The paths of known shape that a shaped path starts from, and that it is never slower than."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour._checks import FloatArray
from armcontour.arms import Arm, Limits
from armcontour.errors import ArmContourError
from armcontour.geometry import Path, RoundedPath, round_corners, round_with_parabolas
from armcontour.motion import JointPath, Trajectory
from armcontour.timing.fastest_configuration import trace_fastest
from armcontour.timing.optimal import plan_optimal
from armcontour.timing.shaping.wishes import Wishes

ARCS = "arcs"
PARABOLAS = "parabolas"
STOPS = "stops"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Candidate:
    """A path within the tolerance, with its fastest timing.

    Args:
        name: Name of its shape.
        path: The path.
        places: Arc lengths on the objective and on the path that belong together [m], (n, 2).
        trajectory: The fastest motion along the path.
    """

    name: str
    path: Path
    places: FloatArray
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
        branch: For an arm in the plane, the branch of its inverse kinematics.
        start: For an arm in space, joint positions at the start [rad], (dof,).
        intervals: Approximate number of grid intervals of a plan; None for the default.
    """

    arm: Arm
    limits: Limits
    branch: str | None
    start: FloatArray | None
    intervals: int | None = None

    def trace(self, path: Path) -> JointPath:
        """The joint path along a path."""
        return trace_fastest(path, self.arm, self.limits, branch=self.branch, start=self.start)

    def time(self, joint_path: JointPath) -> Trajectory:
        """The fastest motion along a joint path."""
        return plan_optimal(joint_path, self.arm, self.limits, intervals=self.intervals)

    def candidate(self, name: str, path: Path, places: FloatArray) -> Candidate | None:
        """A path with its fastest timing; None where the arm cannot follow the path."""
        try:
            trajectory = self.time(self.trace(path))
        except ArmContourError:
            return None
        return Candidate(name=name, path=path, places=places, trajectory=trajectory)


def make_starts(
    objective: Path, wishes: Wishes, share: float = 1.0
) -> dict[str, tuple[Path, FloatArray]]:
    """The starts by their names, each with its places on the objective.

    Args:
        objective: The objective path.
        wishes: What is wanted of the shaped path.
        share: Share of the tolerance that corners are rounded to.
    """
    whole = np.array([[0.0, 0.0], [objective.length, objective.length]])
    found: dict[str, tuple[Path, FloatArray]] = {STOPS: (objective, whole)}
    for name, round_ in ((ARCS, round_corners), (PARABOLAS, round_with_parabolas)):
        rounded = round_(
            objective,
            tolerance=share * wishes.tolerance,
            angular_tolerance=wishes.angular_tolerance,
        )
        found[name] = (rounded, _places(rounded))
    return found


def _places(rounded: RoundedPath) -> FloatArray:
    """Arc lengths on the objective and on its rounded path that belong together [m], (n, 2)."""
    c = rounded.corners
    at = rounded.objective.breaks[c.vertex]
    s = np.unique(
        np.concatenate([[0.0], at - c.tangent, at, at + c.tangent, [rounded.objective.length]])
    )
    return np.stack([s, np.maximum.accumulate(rounded.place(s))], axis=1)
