"""What the refinement of knots needs to know of an arm on a path."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Generic, TypeVar

from armcontour._checks import FloatArray
from armcontour.arms import Arm
from armcontour.geometry import Path
from armcontour.tracing.knots import Knots

# q, dq_ds and d2q_ds2 at one end of intervals, (n, dof) each.
Ends = tuple[FloatArray, FloatArray, FloatArray]


A = TypeVar("A", bound=Arm, covariant=True)


class Solver(ABC, Generic[A]):
    """Joint positions and their derivatives at places of a path.

    Args:
        path: The path.
        arm: The arm.
    """

    def __init__(self, path: Path, arm: A) -> None:
        self.path = path
        self.arm = arm

    @abstractmethod
    def ends(
        self, knots: Knots, u: FloatArray, guess: FloatArray | None, *, at_end: bool = False
    ) -> Ends:
        """q, dq_ds and d2q_ds2 at places `u` on the knots' segments, one per knot.

        Args:
            knots: The intervals that the places lie in.
            u: Places on their segments [m], (n,).
            guess: Joint positions near to those wanted; None for the first knots.
            at_end: Whether the places of the first knots are the ends of the intervals.

        Raises:
            Unreachable: A place out of reach or singular, with its arc length.
        """

    @abstractmethod
    def tool_errors(self, knots: Knots, u: FloatArray, q: FloatArray) -> FloatArray:
        """How far the tool is from where it should be, in tolerances, (n,)."""

    def continuous(self, begin: Ends, end: Ends) -> tuple[Ends, Ends]:
        """The ends of neighbouring intervals with what joins them made continuous."""
        return begin, end
