"""What is wanted of a shaped path, and refusals of what makes no sense."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from armcontour import _checks
from armcontour.errors import InvalidInput
from armcontour.geometry import Path, Tube

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
        iterations = _checks.whole("iterations", self.iterations, 0, 10_000)
        object.__setattr__(self, "iterations", iterations)

    def cap(self, path: Path) -> Path:
        """A path with tolerances of at most half of its stretches between two sharp corners.

        A line that is drawn twice, a micrometre apart, leaves a stretch that bears no more.
        """
        sharp = np.flatnonzero(path.turns > SHARP) + 1
        ends = np.concatenate([[0], sharp, [len(path)]])
        half = np.repeat(np.diff(path.breaks[ends]) / 2, np.diff(ends))
        if (half >= self.tolerance).all():
            return path
        own = np.where(half < self.tolerance, np.fmin(path.tolerances, half), path.tolerances)
        return replace(path, segments=path.segments.replace(tolerances=own, checked=True))


def tube_of(objective: Path, within: Wishes) -> Tube:
    """The tube of the tolerance around an objective path."""
    return Tube.of(
        objective, within.tolerance, line_tolerance=within.line_tolerance, zone=within.zone
    )
