"""Verdict on a run: deviation of the tool from the drawing, compared with the allowed deviation."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeAlias, TypeVar

from armcontour.core.render import number
from armcontour.core.result import JUDGED, VERDICT, Row
from armcontour.robot.limits import LIMITS

if TYPE_CHECKING:
    from armcontour.jobs.job import Experiment, Run
    from armcontour.jobs.planned_run import Planned

T = TypeVar("T")
# Names of the executions with the servo model, on rigid bodies (the experiment) and on the robot
# whose logs determined the servo, and the largest error of each contour [m] in each execution.
SERVO, BODIES, EXPECTED = "servo", "rigid bodies", "expected"
Errors: TypeAlias = Mapping[str, Sequence[float]]

# Default of the allowed contour error, as a share of the smallest corner tolerance.
DEFAULT_ACCURACY = 0.1
# Name of the assigned velocity in explanations.
ASSIGNED = LIMITS["speed"].label
# Relative excess of a limit that is ignored as a rounding error.
ROUNDING = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class ExpectedErrors:
    """Contour errors to expect of a robot whose servo was identified from its logs.

    Args:
        contours: Largest error of each contour [m].
        worst: Largest error if every joint deviates as far as it did at most in the logs [m].
    """

    contours: tuple[float, ...]
    worst: float

    def row(self, model: float) -> Row:
        """Row of the expected error; `model` is the largest error of the servo model alone [m]."""
        note = (
            f"with the largest errors of the logs {number(self.worst, 'm')}; servo model alone "
            f"{number(model, 'm')}"
        )
        value = max(self.contours)
        return Row("expected.max", value, "m", "contour error expected, largest", note, VERDICT)


def judging(run: Run, executions: Mapping[str, T]) -> dict[str, T]:
    """Executions that judge a run, by name; the worst of them is the verdict."""
    # The servo model lacks the dynamics that set-points for rigid bodies compensate.
    bodies_only = run.for_bodies and BODIES in executions
    return {name: x for name, x in executions.items() if name == BODIES or not bodies_only}


def judging_executions(run: Run) -> dict[str, Experiment | None]:
    """Experiments of the executions that judge a run, by name; None for the servo model."""
    bodies = {} if run.experiment is None else {BODIES: run.experiment}
    return judging(run, {SERVO: None, **bodies})


def off_drawing(
    rounding: float | None,
    tolerance: float | None,
    errors: Mapping[str, float],
    allowed: float | None = None,
    label: str = "off the drawing",
) -> Row:
    """Row with the distance of the tool from the drawing: sum, and parts in the note.

    `rounding` is the part due to corners and `errors` that due to each execution [m], `tolerance`
    and `allowed` are their limits [m]. The largest error counts.
    """
    parts = [(name, error, allowed) for name, error in errors.items()]
    if rounding is not None:
        parts.insert(0, ("rounding", rounding, tolerance))
    note = ", ".join(
        f"{name} {number(value, 'm')}"
        + ("" if limit is None else f" of {number(limit, 'm')} allowed")
        for name, value, limit in parts
    )
    return Row("off_drawing", (rounding or 0.0) + max(errors.values()), "m", label, note, VERDICT)


def allowed_error(planned: Planned) -> float | None:
    """Contour error that the run allows [m]; None if neither accuracy nor tolerance is given."""
    run = planned.run
    if run.accuracy is not None:
        return max(run.accuracy - (planned.rounding_error or 0.0), 0.0)
    smallest = None if run.rounding is None else run.rounding.tolerance
    return None if smallest is None else smallest * DEFAULT_ACCURACY


def worst_contour(planned: Planned, errors: Errors) -> Row:
    """`off_drawing` of the contour with the largest sum of rounding and contour error."""
    judges = judging(planned.run, errors)
    roundings = [getattr(x.path, "deviation", None) for x in planned.path.contours]
    worst = (max(x) for x in zip(*judges.values(), strict=True))
    sums = [(rounding or 0.0) + x for rounding, x in zip(roundings, worst, strict=True)]
    k = sums.index(max(sums))
    # If an accuracy is specified, only the sum is limited, not the parts.
    free = planned.run.accuracy is not None
    tolerance, allowed = (None, None) if free else (planned.tolerance, allowed_error(planned))
    row = off_drawing(roundings[k], tolerance, {n: x[k] for n, x in judges.items()}, allowed)
    others = (
        f"; {name} {number(max(x), 'm')}, not judged, because it lacks the compensated dynamics"
        for name, x in errors.items()
        if name not in judges
    )
    return replace(row, note=row.note + "".join(others))


def judge(planned: Planned, errors: Errors) -> tuple[bool | None, str]:
    """Verdict on the contour errors of a run [m], and a sentence with the reason or the limit.

    The verdict is None if the run has neither an accuracy nor a tolerance.
    """
    rounding, tolerance, run = planned.rounding_error or 0.0, planned.tolerance, planned.run
    allowed = allowed_error(planned)
    if allowed is None:
        return None, ""
    if tolerance is not None and rounding > tolerance * (1 + ROUNDING):
        return False, f"the allowed corner error is {number(tolerance, 'm')}"
    if run.accuracy is not None:
        satisfied = worst_contour(planned, errors).value <= run.accuracy * (1 + ROUNDING)
        return satisfied, f"the allowed distance from the drawing is {number(run.accuracy, 'm')}"
    if max(map(max, judging(run, errors).values())) <= allowed:
        return True, ""
    return False, (
        f"the allowed contour error is {number(allowed, 'm')}, a tenth of the smallest corner "
        "tolerance"
    )


def verdict_rows(planned: Planned, errors: Errors | None, failure: str = "") -> Iterator[Row]:
    """Yield rows of the verdict and of the deviation from the drawing."""
    satisfied, note = (None, "") if errors is None else judge(planned, errors)
    if failure:
        satisfied, note = False, failure
    yield Row("kept", satisfied, JUDGED, "verdict", note, VERDICT)
    if errors is not None:
        yield worst_contour(planned, errors)
        yield Row("judged_by", tuple(judging(planned.run, errors)))
    yield Row("accuracy", planned.run.accuracy, "m")
    yield Row("contour_error_allowed", allowed_error(planned), "m")


def weave_speed(planned: Planned) -> float | None:
    """Travel speed of the weaves [m/s]; None without weaves, or if the run limits the speed."""
    contours, fastest = planned.path.contours, planned.run.limits.speed
    if fastest is not None and any((x.path.speeds > fastest).any() for x in contours):
        return None
    speeds = [x.woven.frequency * x.woven.pitch for x in contours if x.woven is not None]
    return next((x for x in speeds if x > 0), None)


def time_limit_row(planned: Planned) -> Iterator[Row]:
    """Yield the row of the limit that is active longest; nothing if it is unknown."""
    why = planned.explanation
    if why is not None and why.longest is not None:
        limit, share = why.longest
        note = f"{number(share, '1')} of the time"
        if limit == ASSIGNED and (travel := weave_speed(planned)) is not None:
            note += f"; the weave travels at {number(travel, 'm/s')}"
        yield Row("time_limit", limit, "", "time limited by", note, VERDICT)
