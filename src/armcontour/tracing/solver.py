"""Interface of the inverse kinematics along a path, which the refinement of knots uses."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Generic, TypeVar

from armcontour._checks import FloatArray
from armcontour.arms import Arm
from armcontour.geometry import Path
from armcontour.tracing.knots import Knots

# q, dq_ds and d2q_ds2 at the starts, or at the ends, of n intervals, (n, dof) each.
Ends = tuple[FloatArray, FloatArray, FloatArray]


A = TypeVar("A", bound=Arm, covariant=True)


class Solver(ABC, Generic[A]):
    """Joint positions and their derivatives along a tool path.

    Args:
        path: The tool path.
        arm: The arm.
    """

    def __init__(self, path: Path, arm: A) -> None:
        self.path = path
        self.arm = arm

    @abstractmethod
    def ends(
        self, knots: Knots, u: FloatArray, guess: FloatArray | None, *, at_end: bool = False
    ) -> Ends:
        """q, dq_ds and d2q_ds2 at distances `u` along the segments of the knots.

        Args:
            knots: The knot intervals, n of them.
            u: Distance along the segment of each interval [m], (n,).
            guess: Joint positions near the solution, (n, dof); None for the first knots.
            at_end: For the first knots, True if `u` are the ends of the intervals.

        Raises:
            Unreachable: The arm cannot reach the path or is singular; with the arc length.
        """

    @abstractmethod
    def tool_errors(self, knots: Knots, u: FloatArray, q: FloatArray) -> FloatArray:
        """Error of the tool at joint positions `q`, over the tolerance, (n,)."""

    def continuous(self, start: Ends, end: Ends) -> tuple[Ends, Ends]:
        """Values at starts and ends of the intervals, without jumps from interval to interval."""
        return start, end
