"""What is wanted of a shaped path, and refusals of what makes no sense."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour import _checks
from armcontour.errors import InvalidInput
from armcontour.geometry import Path, ShapedPath, Tube

# Iterations of the search, unless another number is given.
DEFAULT_ITERATIONS = 60
# Vertices that turn by more than this are corners of a contour; others may be points along a
# curve, however near they are [rad].
SHARP = np.radians(30)


@dataclass(frozen=True, slots=True, kw_only=True)
class Wishes:
    """What is wanted of a shaped path.

    Args:
        tolerance: Largest distance of the path from the objective, and of the vertices of the
            objective from the path [m].
        line_tolerance: The same outside the zones of the vertices [m]; None for no difference.
        zone: Distance from a vertex along the objective within which `tolerance` holds [m].
        angular_tolerance: Largest angle between the tool and its required orientation [rad]; None
            where no orientation needs one.
        iterations: Largest number of iterations.

    Raises:
        InvalidInput: A tolerance is negative or not a number, or one of line tolerance and zone is
            missing.
    """

    tolerance: float
    line_tolerance: float | None = None
    zone: float | None = None
    angular_tolerance: float | None = None
    iterations: int = DEFAULT_ITERATIONS

    def __post_init__(self) -> None:
        _checks.not_negative("tolerance", self.tolerance, "m")
        if (self.line_tolerance is None) != (self.zone is None):
            given, missing = ("line_tolerance", "zone")[:: 1 if self.zone is None else -1]
            raise InvalidInput(
                f"{given} is given without {missing}: line_tolerance holds farther from the "
                "vertices than zone, so give both or neither."
            )
        if self.line_tolerance is not None and self.zone is not None:
            _checks.not_negative("line_tolerance", self.line_tolerance, "m")
            _checks.positive("zone", self.zone, "m")
            if self.line_tolerance > self.tolerance:
                raise InvalidInput(
                    f"line_tolerance of {self.line_tolerance:g} m is above the tolerance of "
                    f"{self.tolerance:g} m: lines may not be less exact than corners.",
                    needed=self.line_tolerance,
                    allowed=self.tolerance,
                )
            if self.zone < self.tolerance:
                raise InvalidInput(
                    f"zone of {self.zone:g} m is below the tolerance of {self.tolerance:g} m, "
                    "which reaches that far from a vertex: give at least the tolerance.",
                    needed=self.tolerance,
                    allowed=self.zone,
                )
        if self.angular_tolerance is not None:
            _checks.not_negative("angular tolerance", self.angular_tolerance, "rad")
        _checks.whole("iterations", self.iterations, 0, 10_000)

    def refuse_too_large(self, path: Path) -> None:
        """Refuse a tolerance above half of a stretch between two sharp corners of a path.

        Raises:
            InvalidInput: Such a tolerance, with the largest one that the path bears.
        """
        sharp = np.flatnonzero(path.turns > SHARP) + 1
        ends = np.concatenate([[0], sharp, [len(path)]])
        lengths = np.diff(path.breaks[ends])
        i = int(np.argmin(lengths))
        if self.tolerance > lengths[i] / 2:
            first, last = int(ends[i]) + 1, int(ends[i + 1])
            what = f"segment {first}" if first == last else f"segments {first} to {last}"
            raise InvalidInput(
                f"The tolerance of {self.tolerance:g} m is above half of {what}, which "
                f"{'is' if first == last else 'are'} {lengths[i]:.6g} m long: give at most "
                f"{lengths[i] / 2:.6g} m.",
                index=int(ends[i]),
                needed=self.tolerance,
                allowed=float(lengths[i] / 2),
            )


def tube_of(objective: Path, within: Wishes | ShapedPath) -> Tube:
    """The tube of the tolerance around an objective path.

    Args:
        objective: The objective path.
        within: What is wanted, or a shaped path, which has the same tolerances.
    """
    return Tube.of(
        objective, within.tolerance, line_tolerance=within.line_tolerance, zone=within.zone
    )
