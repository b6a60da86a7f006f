"""Verdict on a run: deviation of the tool from the drawing, compared with the allowed deviation."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from armcontour.core.render import number
from armcontour.core.result import JUDGED, VERDICT, Row

if TYPE_CHECKING:
    from armcontour.jobs.planned_run import Planned

# Default of the allowed contour error, as a share of the smallest corner tolerance.
DEFAULT_ACCURACY = 0.1
# Name of the assigned velocity in explanations.
ASSIGNED = "assigned velocity"
# Relative excess of a limit that is ignored as a rounding error.
ROUNDING = 1e-9


def off_drawing(
    rounding: float | None,
    tolerance: float | None,
    error: float,
    allowed: float | None = None,
    label: str = "off the drawing",
) -> Row:
    """Row with the distance of the tool from the drawing: sum, and parts in the note.

    `rounding` and `error` are the parts due to corners and servo [m], `tolerance` and `allowed`
    their limits [m].
    """
    parts = [("servo", error, allowed)]
    if rounding is not None:
        parts.insert(0, ("rounding", rounding, tolerance))
    note = ", ".join(
        f"{name} {number(value, 'm')}"
        + ("" if limit is None else f" of {number(limit, 'm')} allowed")
        for name, value, limit in parts
    )
    return Row("off_drawing", (rounding or 0.0) + error, "m", label, note, VERDICT)


def allowed_error(planned: Planned) -> float | None:
    """Contour error that the run allows [m]; None if neither accuracy nor tolerance is given."""
    run = planned.run
    if run.accuracy is not None:
        return max(run.accuracy - (planned.rounding_error or 0.0), 0.0)
    smallest = None if run.rounding is None else run.rounding.least_tolerance
    return None if smallest is None else smallest * DEFAULT_ACCURACY


def farthest(planned: Planned, errors: Sequence[float]) -> tuple[float | None, float]:
    """Rounding and contour error of the contour with the largest sum of both [m]."""
    roundings = [getattr(x.path, "deviation", None) for x in planned.path.contours]
    return max(zip(roundings, errors, strict=True), key=lambda x: (x[0] or 0.0) + x[1])


def judge(planned: Planned, errors: Sequence[float]) -> tuple[bool | None, str]:
    """Verdict on the contour errors of a run [m], and a sentence with the reason or the limit.

    The verdict is None if the run has neither an accuracy nor a tolerance.
    """
    rounding, tolerance, run = planned.rounding_error or 0.0, planned.tolerance, planned.run
    allowed = allowed_error(planned)
    if allowed is None:
        return None, ""
    if planned.clearance is not None and not planned.clearance.satisfied:
        return False, "the arm comes too near to itself or to its cell"
    if tolerance is not None and rounding > tolerance * (1 + ROUNDING):
        return False, f"the allowed corner error is {number(tolerance, 'm')}"
    if run.accuracy is not None:
        satisfied = sum(filter(None, farthest(planned, errors))) <= run.accuracy * (1 + ROUNDING)
        return satisfied, f"the allowed distance from the drawing is {number(run.accuracy, 'm')}"
    if max(errors) <= allowed:
        return True, ""
    return False, (
        f"the allowed contour error is {number(allowed, 'm')}, a tenth of the smallest corner "
        "tolerance"
    )


def verdict_rows(
    planned: Planned, errors: Sequence[float] | None, failure: str = ""
) -> Iterator[Row]:
    """Yield rows of the verdict and of the deviation from the drawing."""
    satisfied, note = (None, "") if errors is None else judge(planned, errors)
    if failure:
        satisfied, note = False, failure
    yield Row("kept", satisfied, JUDGED, "verdict", note, VERDICT)
    if errors is not None:
        # If an accuracy is specified, only the sum is limited, not the parts.
        free = planned.run.accuracy is not None
        limits = (None, None) if free else (planned.tolerance, allowed_error(planned))
        rounding, error = farthest(planned, errors)
        yield off_drawing(rounding, limits[0], error, limits[1])
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
