"""`Shaped`: what shaping the contours of a run gained."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from armcontour.geometry import ShapedPath
from armcontour.geometry.shaped import SHAPED
from armcontour.program import Program


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Shaped:
    """What shaping the contours of a program gained, without rapids and dwells between them.

    Args:
        starts: How many contours each start won, by the names of the starts.
        durations: Sums over all contours of the least durations, of every start that all contours
            have and of the shaped paths as "shaped" [s].
        iterations: Largest number of iterations of a contour.
    """

    starts: Mapping[str, int]
    durations: Mapping[str, float]
    iterations: int

    @staticmethod
    def of(program: Program) -> Shaped | None:
        """What shaping gained in a program; None if it has no shaped contour."""
        found = [x.path.outcome for x in program.contours if isinstance(x.path, ShapedPath)]
        if not found:
            return None
        won = [x.start for x in found]
        common = [name for name in found[0].durations if all(name in x.durations for x in found)]
        return Shaped(
            starts={name: won.count(name) for name in dict.fromkeys(won)},
            durations={name: sum(x.durations[name] for x in found) for name in common},
            iterations=max(max(len(x.history) - 1, 0) for x in found),
        )

    @property
    def gain(self) -> float:
        """Share of the duration of the fastest start that the shapes save."""
        starts = [x for name, x in self.durations.items() if name != SHAPED]
        return 1 - self.durations[SHAPED] / min(starts)

    def __str__(self) -> str:
        """The durations, such as "shaped: 4.74 s (arcs 5.33 s, stops 5.23 s)"."""
        others = sorted(name for name in self.durations if name != SHAPED)
        text = ", ".join(f"{name} {self.durations[name]:.4g} s" for name in others)
        return f"shaped: {self.durations[SHAPED]:.4g} s ({text})"
