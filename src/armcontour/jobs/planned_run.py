"""The plan of a run: path, joint paths, motion, and active limits."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, Self

from armcontour.core.text import capitalise
from armcontour.geometry import ShapedPath, count_full_stops
from armcontour.geometry.shaped_path import SHAPED, describe_unfinished
from armcontour.jobs import run_warnings
from armcontour.jobs.job import Run
from armcontour.jobs.plan_quantities import (
    CURVATURE_JUMPS,
    JerkStop,
    Torques,
    Weaving,
    jerk_stops,
    planned_torques,
    weavings,
)
from armcontour.motion import Trajectory, arm_of
from armcontour.planning import Conventional, Explanation, Tracing
from armcontour.program import Program
from armcontour.robot import Arm, compare_limits
from armcontour.verification.clearance import Clearance

# Clearance of the arm from itself below which a note reports the clearance [m].
NEAR = 10e-3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ShapingGain:
    """Time that shaping the contours of a program saves; rapids and dwells are not included.

    Args:
        starts: Number of contours for which each start was best, by name of the start.
        durations: Sums over all contours of the shortest durations, of every start that all
            contours have and of the shaped paths as "shaped" [s].
        iterations: Largest number of iterations of a contour.
    """

    starts: Mapping[str, int]
    durations: Mapping[str, float]
    iterations: int

    @staticmethod
    def of(program: Program) -> ShapingGain | None:
        """Gain of a program; None if no contour is shaped."""
        outcomes = [x.path.outcome for x in program.contours if isinstance(x.path, ShapedPath)]
        if not outcomes:
            return None
        won = [x.start for x in outcomes]
        common = [
            name for name in outcomes[0].durations if all(name in x.durations for x in outcomes)
        ]
        return ShapingGain(
            starts={name: won.count(name) for name in dict.fromkeys(won)},
            durations={name: sum(x.durations[name] for x in outcomes) for name in common},
            iterations=max(max(len(x.history) - 1, 0) for x in outcomes),
        )

    @property
    def gain(self) -> float:
        """Share that shaping saves of the duration of the fastest initial shape."""
        starts = [x for name, x in self.durations.items() if name != SHAPED]
        return 1 - self.durations[SHAPED] / min(starts)

    def __str__(self) -> str:
        """Text with the durations, such as "shaped: 4.74 s (arcs 5.33 s, stops 5.23 s)"."""
        others = sorted(name for name in self.durations if name != SHAPED)
        text = ", ".join(f"{name} {self.durations[name]:.4g} s" for name in others)
        return f"shaped: {self.durations[SHAPED]:.4g} s ({text})"


@dataclass(frozen=True, kw_only=True, eq=False)
class Planned:
    """The plan of a run.

    Args:
        run: The run.
        objective: The program with sharp corners; a path becomes a program.
        path: The program that the tool follows: with rounded or shaped corners, if the run rounds
            corners.
        trajectory: The realizable trajectory.
        traced: Joint paths of all moves, if known.
        clearance: Planned clearance of the arm from itself and its cell; None for an arm with
            unknown shapes.
        avoided: Sentences on other joint paths that were taken to avoid collisions; without a
            clearance, on why it is not checked.
        explanation: Active limits along the path, for a plan of the method "optimal".
    """

    run: Run
    objective: Program
    path: Program
    trajectory: Trajectory
    traced: Tracing | None = None
    clearance: Clearance | None = None
    avoided: tuple[str, ...] = ()
    explanation: Explanation | None = None

    @classmethod
    def of(cls, planned: Planned, **changes: Any) -> Self:
        """Create an instance of this class from a plan and further or changed fields."""
        return cls(**{x.name: getattr(planned, x.name) for x in fields(Planned)} | changes)

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about deviations of the result from the request, without the run's name."""
        return tuple(filter(None, (*self._warnings(), *self.path.notes)))

    def _warnings(self, executed: Clearance | None = None) -> Iterator[str | None]:
        run, trajectory = self.run, self.trajectory
        yield from run_warnings.capped(self.objective, run)
        yield compare_limits(run.limits, self.arm)
        yield from run_warnings.stops(self.jerk_stops)
        # If a duration is specified, contours are slower than assigned on purpose.
        if run.duration is None:
            ends_only = bool(self.jerk_stops)
            yield from run_warnings.slow(self.path, trajectory, run, ends_only=ends_only)
        yield from (x.sentence for x in self.weaves if x.differs)
        yield from run_warnings.collisions(self.clearance, executed, self.avoided)
        yield from run_warnings.coarse(trajectory, run)

    @property
    def rounding_error(self) -> float | None:
        """Largest distance of the path from the objective [m]; None if corners are as drawn."""
        deviations = (getattr(x.path, "deviation", None) for x in self.path.contours)
        return max((x for x in deviations if x is not None), default=None)

    @property
    def tolerance(self) -> float | None:
        """Largest corner error that the run allows [m]; None if not specified."""
        rounding = self.run.rounding
        return None if rounding is None else rounding.tolerance

    @property
    def arm(self) -> Arm:
        """Arm of the plan."""
        return arm_of(self.trajectory)

    @cached_property
    def torques(self) -> Torques | None:
        """Torques of the plan over time; None if the masses of the arm are unknown."""
        return planned_torques(self.arm, self.trajectory)

    @cached_property
    def jerk_stops(self) -> tuple[JerkStop, ...]:
        """Full stops inside contours at jumps of the curvature, due to jerk limits."""
        return jerk_stops(self.path, self.traced, self.trajectory, self.run)

    @property
    def full_stops(self) -> dict[str, int]:
        """Number of full stops inside contours, by reason."""
        by_jerk = len(self.jerk_stops)
        return self._stops_of_path | ({CURVATURE_JUMPS: by_jerk} if by_jerk else {})

    @cached_property
    def _stops_of_path(self) -> dict[str, int]:
        """Number of full stops that the path requires regardless of limits, by reason."""
        if isinstance(self.run.timing, Conventional):
            # The conventional method does not stop, because it passes corners at uniform speed.
            return {}
        stops: Counter[str] = Counter()
        for contour in self.path.contours:
            stops.update(count_full_stops(contour.path))
        return dict(sorted(stops.items()))

    @property
    def stops_note(self) -> str | None:
        """Note about full stops inside contours, except those due to jerk limits; None without any.

        Stops due to jerk limits are reported by a warning.
        """
        stops = self._stops_of_path
        count = sum(stops.values())
        if not count:
            return None
        label = "1 full stop" if count == 1 else f"{count} full stops"
        why = ", ".join(f"{n} {reason}" for reason, n in stops.items())
        return f"Run {self.run.name}: {label} inside contours ({why})."

    @cached_property
    def weaves(self) -> tuple[Weaving, ...]:
        """Planned width and frequency of each weave."""
        return tuple(weavings(self.path, self.trajectory))

    @property
    def clearance_note(self) -> str | None:
        """Note about the clearance; None if it was not checked."""
        if self.clearance is None:
            return None
        done = "".join(f" {capitalise(x)}." for x in self.avoided)
        return f"Run {self.run.name}: {self.clearance.sentence}{done}"

    @property
    def _far_from_itself(self) -> bool:
        """True if only self-collision was checked and all distances exceed NEAR."""
        if self.clearance is None or self.avoided:
            return False
        return all(x.kind != "environment" and x.low > NEAR for x in self.clearance.nearest)

    @property
    def shaped(self) -> ShapingGain | None:
        """Time saved by shaping; None if no contour is shaped."""
        return ShapingGain.of(self.path)

    @property
    def shape_note(self) -> str | None:
        """Note about the time saved by shaping; None if no contour is shaped."""
        gain = self.shaped
        if gain is None:
            return None
        early = "".join(
            f" {capitalise(x)}" for x in describe_unfinished(x.path for x in self.path.contours)
        )
        return f"Run {self.run.name}: {gain}.{early}"
