"""Interface of the inverse kinematics along a path, which the refinement of knots uses."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Generic, TypeVar

import numpy as np

from armcontour._checks import FloatArray
from armcontour.arms import Arm
from armcontour.geometry import Path
from armcontour.motion import quintic
from armcontour.tracing.knots import MIDDLE, PLACES, Knots

# Powers of the places of an interval, (places, 6).
POWERS = PLACES[:, None] ** np.arange(6)
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

    def first_ends(self, knots: Knots) -> tuple[Ends, Ends]:
        """q, dq_ds and d2q_ds2 at the starts and at the ends of the first intervals.

        Raises:
            Unreachable: As in `ends`.
        """
        return self.ends(knots, knots.u0, None), self.ends(knots, knots.u1, None)

    @abstractmethod
    def ends(self, knots: Knots, u: FloatArray, guess: FloatArray | None) -> Ends:
        """q, dq_ds and d2q_ds2 at distances `u` along the segments of the knots.

        Args:
            knots: The knot intervals, n of them.
            u: Distance along the segment of each interval [m], (n,).
            guess: Joint positions near the solution, (n, dof); None for the first knots.

        Raises:
            Unreachable: The arm cannot reach the path or is singular; with the arc length.
        """

    def guess(
        self, knots: Knots, u: FloatArray, middle: FloatArray, halfway: FloatArray
    ) -> FloatArray | None:
        """Joint positions near the solutions within intervals, (n, dof); None if none are needed.

        Args:
            knots: The knot intervals, n of them.
            u: Distance along the segment of each interval [m], (n,).
            middle: Joint positions in the middle of the quintics of the intervals, (n, dof).
            halfway: Means of the joint positions at both ends, (n, dof).
        """
        # Near a singularity the quintic may overshoot; the mean of the ends is the better guess.
        nearer = self.tool_errors(knots, u, halfway) < self.tool_errors(knots, u, middle)
        return np.where(nearer[:, None], halfway, middle)

    @abstractmethod
    def tool_errors(self, knots: Knots, u: FloatArray, q: FloatArray) -> FloatArray:
        """Error of the tool at joint positions `q`, over the tolerance, (n,)."""

    def errors_between(self, knots: Knots, start: Ends, end: Ends) -> tuple[FloatArray, FloatArray]:
        """Largest error of the tool on the quintics of intervals, over the tolerance, (n,).

        Args:
            knots: The intervals, n of them.
            start: Joint positions and derivatives at their starts.
            end: The same at their ends.

        Returns:
            The errors, and the joint positions in the middle of the intervals, (n, dof).
        """
        q = quintics_at_places(knots, start, end)
        errors = self.tool_errors(*knots.places(), q.reshape(-1, q.shape[2]))
        return largest_errors(errors, len(knots)), q[MIDDLE]

    def continuous(self, start: Ends, end: Ends) -> tuple[Ends, Ends]:
        """Values at starts and ends of the intervals, without jumps from interval to interval."""
        return start, end


def quintics_at_places(knots: Knots, start: Ends, end: Ends) -> FloatArray:
    """Joint positions on the quintics of n intervals at their places, (places, n, dof)."""
    coefficients = quintic(knots.u1 - knots.u0, start, end)
    return np.tensordot(POWERS, coefficients, (1, 1))


def largest_errors(errors: FloatArray, n: int) -> FloatArray:
    """The largest error of each of n intervals, from those at all their places, (n,)."""
    return np.asarray(errors.reshape(-1, n).max(axis=0))
