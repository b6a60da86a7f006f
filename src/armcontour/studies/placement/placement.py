"""Results of a placement: verdicts on the places of a grid, and the best place."""

# A place is a candidate position of the part or the base: values of the axes of the search.

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np

from armcontour._version import __version__
from armcontour.core import checks
from armcontour.core.checks import FloatArray
from armcontour.core.fields import checked
from armcontour.core.frames import Frame, quaternions
from armcontour.core.render import Result, number
from armcontour.core.result import TABLE, VERDICT, Data, Row, Table
from armcontour.core.text import short_repr
from armcontour.jobs.job import Job, Run
from armcontour.jobs.placement_options import DURATION, UNITS, Axis
from armcontour.robot.scene import PART
from armcontour.studies.placement.place_evaluation import COMPARED, Verdict
from armcontour.studies.placement.placed_job import Moves, place_job

# Figures of merit of a `Verdict` that `Placement.values` can return.
FIGURES = ("duration", "bound", "singular", "clearance", "torque_margin")


@dataclass(frozen=True, slots=True, kw_only=True)
class Place:
    """A candidate position of the part or the base, and its verdict.

    Args:
        values: Values of the axes [m, rad].
        verdict: Feasibility and figures of merit.
    """

    values: Mapping[str, float]
    verdict: Verdict

    def __str__(self) -> str:
        """Text with the values of the axes, in mm and degrees."""
        return ", ".join(f"{name} {number(x, UNITS[name])}" for name, x in self.values.items())


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Placement(Result):
    """The best position of a job's part, or of the base of its arm, and the compared places.

    Args:
        job: The job, with the part and the base where it defines them (its own place).
        run: The compared run.
        axes: The axes of the grid.
        moves: Displacement of part or base for values of the axes.
        moved: "part" or "base".
        objective: "duration", "manipulability", "clearance" or "torque".
        uncertainty: Position error of the part by axis [m, rad]. Figures of a place are the worst
            of the place and of the corners of this box around it.
        verdicts: Verdicts on all places of the grid; the last axis varies fastest.
        best: The best place of the grid.
        refined: The best place after refinement; `best` if the refinement finds no better one.
        own: The verdict on the job's own place.
        notes: Sentences about assumptions.
    """

    job: Job
    run: Run
    axes: tuple[Axis, ...]
    moves: Moves
    moved: str = PART
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
        """Number of refused places by kind of refusal, the most frequent first."""
        return dict(Counter(x.refusal for x in self.verdicts if x.refusal).most_common())

    @property
    def planned(self) -> int:
        """Number of places of the grid with a plan."""
        return sum(x.planned for x in self.verdicts)

    def values(self, name: str) -> FloatArray:
        """A figure of merit of all places, in the shape of the grid; NaN if unknown.

        Args:
            name: "duration", "bound", "singular", "clearance" or "torque_margin".
        """
        checks.check_choice("value", name, FIGURES)
        return np.array([getattr(x, name) for x in self.verdicts]).reshape(self.shape)

    def place(self, index: int) -> dict[str, float]:
        """Values of the axes at a place of the grid [m, rad].

        Args:
            index: Index of the place in `verdicts`.
        """
        indices = np.unravel_index(
            checks.check_int("index", index, 0, len(self.verdicts) - 1), self.shape
        )
        return {x.name: float(x.values[k]) for x, k in zip(self.axes, indices, strict=True)}

    @checked
    def frame(self, place: Place | None = None) -> Frame:
        """Displacement of the part or base, in the coordinates of the job's path.

        Args:
            place: A place; by default the refined one.
        """
        return self.moves.frame((place or self.refined).values)

    @checked
    def placed(self, place: Place | None = None) -> Job:
        """The job with its part or base moved to a place.

        Args:
            place: A place; by default the refined one.
        """
        return place_job(self.job, self.frame(place), self.moved)

    @checked
    def to_data(self, files: Sequence[str] = ()) -> Data:
        """Data of the best place, the job's own place, and the numbers of refusals.

        Args:
            files: Files of the result, relative to its folder.
        """
        compared = COMPARED[self.objective][0]
        refused = [f"{n} refused by {kind}" for kind, n in self.refusals.items()]
        rows: list[Row] = []
        for key, (label, place, verdict) in self._compared.items():
            rows += [
                replace(
                    x,
                    name=f"{key}.{x.name}",
                    label=f"{x.label}, {label}" if x.name in (compared, "refusal") else "",
                    note=str(place or ""),
                    level=TABLE if key == "best_of_grid" else VERDICT,
                )
                for x in verdict.to_data().rows
            ]
            if place is not None:
                rows += [Row(f"{key}.place.{x}", y, UNITS[x]) for x, y in place.values.items()]
        note = ", ".join([f"{self.planned} planned", *refused])
        if self.own.planned:
            gain = 1 - self.refined.verdict.duration / self.own.duration
            level = VERDICT if self.objective == DURATION else TABLE
            rows.append(Row("gain", gain, "1", "time saved", level=level))
        frame = self.frame()
        rows += [
            Row("places", len(self.verdicts), "", "places", note, VERDICT),
            Row("planned", self.planned),
            Row("refused", self.refusals),
            Row("refused_places", sum(self.refusals.values())),
            Row("armcontour", __version__),
            Row("job", self.job.name),
            Row("arm", self.job.arm.name),
            Row("run", self.run.name),
            Row("objective", self.objective),
            Row("moved", self.moved),
            Row("anchor", self.moves.anchor, "m"),
            Row("absolute", self.moves.absolute),
            Row("moved_by.position", frame.position, "m"),
            Row("moved_by.quaternion", quaternions(frame.rotation)),
            Row("notes", self.notes),
            Row("files", list(files)),
        ]
        uncertainty = Data("", tuple(Row(x, y, UNITS[x]) for x, y in self.uncertainty.items()))
        rows += uncertainty.with_prefix("uncertainty") or (Row("uncertainty", {}),)
        rows.append(Row("units", {x.name: x.unit for x in rows if x.unit}))
        axes = [(x.name, x.values[0], x.values[-1], len(x.values)) for x in self.axes]
        columns = tuple(Row(x, None) for x in ("name", "from", "to", "places"))
        return Data(
            f"Placement of the {self.moved}: {self.job.title}, run {self.run.name}, for "
            f"{self.objective}",
            tuple(rows),
            (Table("axes", columns, axes),),
            notes=self.notes,
        )

    @property
    def _compared(self) -> dict[str, tuple[str, Place | None, Verdict]]:
        """Label, place and verdict of the best places and the job's own place, by JSON key."""
        return {
            "best": ("best place", self.refined, self.refined.verdict),
            "best_of_grid": ("best of the grid", self.best, self.best.verdict),
            "own_place": ("the job's own place", None, self.own),
        }

    @property
    def comparison(self) -> dict[str, Data]:
        """Data of the best places and of the job's own place, by their labels."""
        return {
            label if place is None else f"{label}: {place}": verdict.to_data()
            for label, place, verdict in self._compared.values()
        }

    __repr__ = short_repr


def all_places(axes: tuple[Axis, ...]) -> list[dict[str, float]]:
    """All places of a grid; the last axis varies fastest."""
    names = [x.name for x in axes]
    return [dict(zip(names, x, strict=True)) for x in product(*(a.values.tolist() for a in axes))]
