"""`judge`: the verdict on a run, from the contour errors of its executions.

Terminal, report, Studio, JSON and exit codes format a `Verdict`; none of them judges.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias, TypeVar

from armcontour.jobs.job import Experiment, Run

T = TypeVar("T")
# Names of the executions with the servo model, on rigid bodies (the experiment) and on the robot
# whose logs determined the servo.
SERVO = "servo"
BODIES = "rigid bodies"
EXPECTED = "expected"
# The largest error of each contour [m] by name of the execution.
Errors: TypeAlias = Mapping[str, Sequence[float]]
Requirement: TypeAlias = Literal["", "motion", "corners", "accuracy", "contour error"]
# Default of the allowed contour error, as a fraction of the smallest corner tolerance.
DEFAULT_ACCURACY = 0.1
# Relative excess of a limit that is ignored as a rounding error.
ROUNDING = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """Whether the tool stays within the allowed distance from the drawing.

    Args:
        kept: The verdict; None without an execution, or without an accuracy and a tolerance.
        requirement: The requirement that decides. "motion": the robot completes the motion;
            "corners": rounding stays within the tolerance of corners; "accuracy": the tool stays
            within the distance from the drawing; "contour error": the error of the execution stays
            within a tenth of the tolerance. Empty if only the last one applies and is satisfied,
            and without a verdict.
        allowed: Contour error that the run allows [m]; None if it specifies none.
        contour: Index of the contour with the largest distance from the drawing.
        rounding: Rounding error of this contour [m]; None if its corners are as drawn.
        errors: Contour error of this contour [m] in each execution that judges the run.
        others: Largest contour error [m] in each other execution.
    """

    kept: bool | None
    requirement: Requirement = ""
    allowed: float | None
    contour: int = 0
    rounding: float | None = None
    errors: Mapping[str, float]
    others: Mapping[str, float]

    @property
    def off_drawing(self) -> float | None:
        """Largest distance of the tool from the drawing [m]; None without an execution.

        It is the rounding error plus the contour error of the worst execution.
        """
        if not self.errors:
            return None
        return (self.rounding or 0.0) + max(self.errors.values())


def judge(
    run: Run, roundings: Sequence[float | None], errors: Errors | None, *, failed: bool = False
) -> Verdict:
    """Judge the executions of a run by the worst of them.

    Args:
        run: The run.
        roundings: Rounding error of each contour [m]; None if its corners are as drawn.
        errors: Contour errors of the executions; None without an execution.
        failed: Whether the simulated robot does not complete the motion.
    """
    tolerance = None if run.rounding is None else run.rounding.tolerance
    largest_rounding = max((x or 0.0 for x in roundings), default=0.0)
    allowed = allowed_error(run, largest_rounding)
    if errors is None:
        return Verdict(
            kept=False if failed else None,
            requirement="motion" if failed else "",
            allowed=allowed,
            errors={},
            others={},
        )
    judges = judging(run, errors)
    worst = [max(x) for x in zip(*judges.values(), strict=True)]
    distances = [(rounding or 0.0) + x for rounding, x in zip(roundings, worst, strict=True)]
    k = distances.index(max(distances))
    kept: bool | None = True
    requirement: Requirement = ""
    if failed:
        kept = False
        requirement = "motion"
    elif allowed is None:
        kept = None
    elif tolerance is not None and largest_rounding > tolerance * (1 + ROUNDING):
        kept = False
        requirement = "corners"
    elif run.accuracy is not None:
        kept = distances[k] <= run.accuracy * (1 + ROUNDING)
        requirement = "accuracy"
    elif max(worst) > allowed:
        kept = False
        requirement = "contour error"
    return Verdict(
        kept=kept,
        requirement=requirement,
        allowed=allowed,
        contour=k,
        rounding=roundings[k],
        errors={name: x[k] for name, x in judges.items()},
        others={name: max(x) for name, x in errors.items() if name not in judges},
    )


def allowed_error(run: Run, rounding: float) -> float | None:
    """Contour error that a run allows [m]; None if it specifies no accuracy and no tolerance.

    `rounding`: largest rounding error of the contours [m].
    """
    if run.accuracy is not None:
        return max(run.accuracy - rounding, 0.0)
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
    """Experiments of the executions that judge a run, by name; None for the servo model."""
    bodies = {} if run.experiment is None else {BODIES: run.experiment}
    return judging(run, {SERVO: None, **bodies})
