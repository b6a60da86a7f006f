"""Results of placing: what is known of every place of a grid, and the best one."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import product

import numpy as np

from armcontour import _checks
from armcontour._checks import FloatArray
from armcontour._describing import line_up
from armcontour.core.fields import checked
from armcontour.frames import Frame
from armcontour.jobs.axes import Axis
from armcontour.jobs.job import Job, Run
from armcontour.placement.judging import Verdict
from armcontour.placement.moving import Moves, place_job
from armcontour.scene.scene import PART

# Values of a place that `Placement.values` gives.
FIGURES = ("duration", "bound", "singular", "clearance", "torque_margin")


@dataclass(frozen=True, slots=True, kw_only=True)
class Place:
    """A place and what is known of it.

    Args:
        values: Values of the axes [m, rad].
        verdict: What is known.
    """

    values: Mapping[str, float]
    verdict: Verdict

    def __str__(self) -> str:
        """The values, in mm and degrees."""
        return ", ".join(
            f"{name} {x * 1e3:.6g} mm" if name in "xyz" else f"{name} {np.degrees(x):.6g}°"
            for name, x in self.values.items()
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Placement:
    """Where a job's part, or the base of its arm, lies best.

    Args:
        job: The job in its own place.
        run: Its run.
        axes: The axes of the grid.
        moves: What coordinates of a place mean.
        what: What is moved, "part" or "base".
        objective: What is best: "cycle", "manipulability", "clearance" or "torque".
        uncertainty: Position error of the part [m, rad]; all figures then are of the
            worst of a place and the corners around it.
        verdicts: What is known of every place, the last axis fastest.
        best: The best place of the grid.
        refined: The best place found between those of the grid; that of the grid if none is better.
        own: The verdict on the job's own place, without the uncertainty.
        notes: Sentences on what was taken for granted.
    """

    job: Job
    run: Run
    axes: tuple[Axis, ...]
    moves: Moves
    what: str = PART
    objective: str
    uncertainty: Mapping[str, float] = field(default_factory=dict)
    verdicts: tuple[Verdict, ...]
    best: Place
    refined: Place
    own: Verdict
    notes: tuple[str, ...] = ()

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of places along each axis."""
        return tuple(len(x.values) for x in self.axes)

    @property
    def refusals(self) -> dict[str, int]:
        """How many places are refused, by the kinds of refusals, the most frequent first."""
        return dict(Counter(x.refusal for x in self.verdicts if x.refusal).most_common())

    @property
    def planned(self) -> int:
        """How many places of the grid have a plan."""
        return sum(x.planned for x in self.verdicts)

    def values(self, name: str) -> FloatArray:
        """One value of all places, not a number where it is not known, in the shape of the grid.

        Args:
            name: One of FIGURES.
        """
        _checks.choice("value", name, FIGURES)
        return np.array([getattr(x, name) for x in self.verdicts]).reshape(self.shape)

    def place(self, index: int) -> dict[str, float]:
        """The values of the axes at a place of the grid [m, rad].

        Args:
            index: Its index among the verdicts.
        """
        at = np.unravel_index(_checks.whole("index", index, 0, len(self.verdicts) - 1), self.shape)
        return {x.name: float(x.values[k]) for x, k in zip(self.axes, at, strict=True)}

    @checked
    def frame(self, place: Place | None = None) -> Frame:
        """Where the part, or the base, is taken, in the coordinates of the job's path.

        Args:
            place: A place; by default the refined one.
        """
        return self.moves.frame((place or self.refined).values)

    @checked
    def placed(self, place: Place | None = None) -> Job:
        """The job with its part or base in a place.

        Args:
            place: As in `frame`.
        """
        return place_job(self.job, self.frame(place), self.what)

    def __str__(self) -> str:
        """The best place, the job's own place, and how many places were refused."""
        refused = ", ".join(f"{n} by {kind}" for kind, n in self.refusals.items())
        own = self.own
        return line_up(
            f"Placement of the {self.what}: {self.job.title}, run {self.run.name}, for "
            f"{self.objective}",
            [
                ("best place", f"{self.refined}: {self.refined.verdict.duration:.4f} s"),
                ("best of the grid", f"{self.best}: {self.best.verdict.duration:.4f} s"),
                (
                    "the job's own",
                    f"refused by {own.refusal}" if own.refusal else f"{own.duration:.4f} s",
                ),
                ("places", f"{len(self.verdicts)}, {self.planned} planned"),
                ("refused", refused or "none"),
                *(("note", x) for x in self.notes),
            ],
        )

    def __repr__(self) -> str:
        """Job, best place and its value."""
        return (
            f"Placement({self.job.name!r}, {self.refined}, {self.refined.verdict.duration:.6g} s, "
            f"{len(self.verdicts)} places, {self.planned} planned)"
        )


def all_places(axes: tuple[Axis, ...]) -> list[dict[str, float]]:
    """All places of a grid, the last axis fastest."""
    names = [x.name for x in axes]
    return [dict(zip(names, x, strict=True)) for x in product(*(a.values.tolist() for a in axes))]
