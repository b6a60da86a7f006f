"""`judge`: the verdict on a run, from the contour errors of its executions.

Terminal, report, Studio, JSON and exit codes format a `Verdict`; none of them judges.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias, TypeVar

from armcontour.geometry import Path
from armcontour.jobs.job import Experiment, Run
from armcontour.verification import Evaluation
from armcontour.verification.contour_errors import ContourExecution

T = TypeVar("T")
# Names of the executions with the servo model, on rigid bodies (the experiment) and on the robot
# whose logs determined the servo.
SERVO = "servo"
BODIES = "rigid bodies"
EXPECTED = "expected"
# Name of the motions that a controller may execute between the points of a program.
BETWEEN_POINTS = "between points"
Requirement: TypeAlias = Literal["", "motion", "corners", "accuracy", "contour error", "limits"]
# Default contour error that a run allows, as a fraction of the smallest corner tolerance.
DEFAULT_ACCURACY = 0.1
# Relative excess of a limit that is ignored as a rounding error.
VERDICT_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class Deviation:
    """Upper bounds of the distance between a contour of the path and the drawing.

    The drawing is the objective: the program with kerf, leads and weaves, before corners are
    rounded.

    Args:
        rounding: Rounding error of the corners, or deviation of a shaped path [m]; None if the
            corners are as drawn.
        smoothing: Distance by which transitions for jerk limits changed the path [m].
    """

    rounding: float | None
    smoothing: float = 0.0

    @classmethod
    def of_path(cls, path: Path, objective: Path) -> Deviation:
        """Return how far a path deviates from the objective path of which it was made."""
        rounding = getattr(path, "deviation", None)
        if path.segments is objective.segments:
            return cls(rounding=None if rounding is None else 0.0)
        return cls(rounding=rounding, smoothing=max(0.0, path.smoothing - objective.smoothing))

    @property
    def total(self) -> float:
        """Upper bound of the distance [m]."""
        return (self.rounding or 0.0) + self.smoothing


@dataclass(frozen=True, slots=True, kw_only=True)
class Errors:
    """For each contour, the largest errors of one execution.

    Args:
        contour: Contour errors [m].
        off_drawing: Distances between tool and drawing [m]; None if only contour errors are known.
    """

    contour: Sequence[float]
    off_drawing: Sequence[float] | None = None

    @classmethod
    def of_evaluation(cls, evaluation: Evaluation) -> Errors:
        """Return the errors of an evaluated execution."""
        return cls(
            contour=[x.max for x in evaluation.contours],
            off_drawing=[x.max for x in evaluation.drawing_errors] or None,
        )

    @classmethod
    def of_pieces(cls, pieces: Sequence[ContourExecution]) -> Errors:
        """Return the errors of an execution that is split into its contours."""
        distances = [x.drawing_error for x in pieces]
        return cls(
            contour=[x.contour_error.max for x in pieces],
            off_drawing=[x.max for x in distances if x is not None] or None,
        )

    def distances(self, deviations: Sequence[Deviation]) -> Sequence[float]:
        """Return the distance between tool and drawing for each contour [m].

        If it is unknown, it is at most the deviation of the path plus the contour error.
        """
        if self.off_drawing is not None:
            return self.off_drawing
        return [x.total + error for x, error in zip(deviations, self.contour, strict=True)]


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """Whether the tool stays within the allowed distance from the drawing, and limits are kept.

    Args:
        kept: The verdict; None without an execution, or without an accuracy and a tolerance.
        requirement: The requirement that decides. "motion": the robot completes the motion;
            "corners": rounding stays within the tolerance of corners; "accuracy": the tool stays
            within the distance from the drawing; "contour error": the error of the execution stays
            within a tenth of the tolerance; "limits": `violations` is empty. Empty if only the
            error of the execution applies and is satisfied, and without a verdict.
        allowed: Contour error that the run allows [m]; None if it specifies none.
        contour: Index of the contour with the largest distance from the drawing.
        off_drawing: This distance in the worst execution that judges the run [m], as measured
            between the tool and the drawing in both directions. For errors that are only expected,
            the upper bound `deviation.total` plus contour error. None without an execution.
        deviation: How far this contour of the path deviates from the drawing. The parts can be
            largest at different places, so their sum can be larger than `off_drawing`.
        errors: Contour error of this contour [m] in each execution that judges the run.
        others: Largest contour error [m] in each other execution.
        violations: Limits that set-points or the simulated robot violate, a clause for each. They
            decide only if all other requirements are satisfied.
    """

    kept: bool | None
    requirement: Requirement = ""
    allowed: float | None
    contour: int = 0
    off_drawing: float | None = None
    deviation: Deviation = Deviation(rounding=None)
    errors: Mapping[str, float]
    others: Mapping[str, float]
    violations: tuple[str, ...] = ()


def judge(
    run: Run,
    deviations: Sequence[Deviation],
    errors: Mapping[str, Errors] | None,
    *,
    failed: bool = False,
    violations: tuple[str, ...] = (),
) -> Verdict:
    """Judge the executions of a run by the worst of them.

    Args:
        run: The run.
        deviations: For each contour, how far the path deviates from the drawing.
        errors: Errors of each execution by its name; None without an execution.
        failed: Whether the simulated robot does not complete the motion.
        violations: Limits that set-points or the simulated robot violate, a clause for each.
    """
    tolerance = None if run.rounding is None else run.rounding.tolerance
    largest_rounding = max((x.rounding or 0.0 for x in deviations), default=0.0)
    allowed = allowed_error(run, max((x.total for x in deviations), default=0.0))
    if errors is None:
        return Verdict(
            kept=False if failed else None,
            requirement="motion" if failed else "",
            allowed=allowed,
            errors={},
            others={},
            violations=violations,
        )
    judges = judging(run, errors)
    distances_of_executions = [x.distances(deviations) for x in judges.values()]
    # Largest distance of each contour from the drawing.
    distances = [max(x) for x in zip(*distances_of_executions, strict=True)]
    k = distances.index(max(distances))
    largest_error = max(max(x.contour) for x in judges.values())
    kept: bool | None = True
    requirement: Requirement = ""
    if failed:
        kept = False
        requirement = "motion"
    elif allowed is None:
        kept = None
    elif tolerance is not None and largest_rounding > tolerance * (1 + VERDICT_ROUNDING):
        kept = False
        requirement = "corners"
    elif run.accuracy is not None:
        kept = distances[k] <= run.accuracy * (1 + VERDICT_ROUNDING)
        requirement = "accuracy"
    elif largest_error > allowed:
        kept = False
        requirement = "contour error"
    if violations and kept is not False:
        kept = False
        requirement = "limits"
    return Verdict(
        kept=kept,
        requirement=requirement,
        allowed=allowed,
        contour=k,
        off_drawing=distances[k],
        deviation=deviations[k],
        errors={name: x.contour[k] for name, x in judges.items()},
        others={name: max(x.contour) for name, x in errors.items() if name not in judges},
        violations=violations,
    )


def allowed_error(run: Run, deviation: float) -> float | None:
    """Return the contour error that a run allows [m]; None without accuracy and tolerance.

    If a contour error stays below it, the tool certainly stays within the accuracy.

    `deviation`: largest deviation of the path from the drawing [m].
    """
    if run.accuracy is not None:
        return max(run.accuracy - deviation, 0.0)
    if run.rounding is None or run.rounding.tolerance is None:
        return None
    return run.rounding.tolerance * DEFAULT_ACCURACY


def judging(run: Run, executions: Mapping[str, T]) -> dict[str, T]:
    """Select the executions that judge a run, by name; the worst of them is the verdict."""
    if run.for_bodies and BODIES in executions:
        # The servo model lacks the dynamics that set-points for rigid bodies compensate.
        return {BODIES: executions[BODIES]}
    return dict(executions)


def judging_executions(run: Run) -> dict[str, Experiment | None]:
    """Map the executions that judge a run to experiments; None for the servo model."""
    bodies = {} if run.experiment is None else {BODIES: run.experiment}
    return judging(run, {SERVO: None, **bodies})
