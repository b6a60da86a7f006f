"""The verdict on a run: deviation of the tool from the drawing, and its limit."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from armcontour.core.render import number
from armcontour.core.result import JUDGED, VERDICT, Row

if TYPE_CHECKING:
    from armcontour.jobs.planned_run import Planned

# Default limit of the contour error, as a share of the smallest corner tolerance.
DEFAULT_ACCURACY = 0.1
# Name of the assigned velocity in explanations.
ASSIGNED = "assigned velocity"
# Relative tolerance for rounding errors.
ROUNDING = 1e-9


def off_drawing(
    rounding: float | None,
    tolerance: float | None,
    error: float,
    allowed: float | None = None,
    label: str = "off the drawing",
) -> Row:
    """The distance of the tool from the drawing, in sum and in parts."""
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
    """The contour error that the run may have [m]; None without accuracy and tolerance."""
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
    """Verdict on contour errors, None without accuracy and tolerance, and a sentence on it."""
    rounding, tolerance, run = planned.rounding_error or 0.0, planned.tolerance, planned.run
    allowed = allowed_error(planned)
    if allowed is None:
        return None, ""
    if planned.clearance is not None and not planned.clearance.satisfied:
        return False, "the arm comes too near to itself or to its cell"
    if tolerance is not None and rounding > tolerance * (1 + ROUNDING):
        return False, f"corners may be {number(tolerance, 'm')} off the drawing"
    if run.accuracy is not None:
        satisfied = sum(filter(None, farthest(planned, errors))) <= run.accuracy * (1 + ROUNDING)
        return satisfied, f"{number(run.accuracy, 'm')} off the drawing is allowed"
    if max(errors) <= allowed:
        return True, ""
    return False, f"the servo may be {number(allowed, 'm')} off, a tenth of the smallest tolerance"


def verdict_rows(
    planned: Planned, errors: Sequence[float] | None, failure: str = ""
) -> Iterator[Row]:
    """Rows of the verdict and of the deviation from the drawing."""
    satisfied, note = (None, "") if errors is None else judge(planned, errors)
    if failure:
        satisfied, note = False, failure
    yield Row("kept", satisfied, JUDGED, "verdict", note, VERDICT)
    if errors is not None:
        # With an accuracy the parts have no limits of their own.
        free = planned.run.accuracy is not None
        limits = (None, None) if free else (planned.tolerance, allowed_error(planned))
        rounding, error = farthest(planned, errors)
        yield off_drawing(rounding, limits[0], error, limits[1])
    yield Row("accuracy", planned.run.accuracy, "m")
    yield Row("contour_error_allowed", allowed_error(planned), "m")


def weave_speed(planned: Planned) -> float | None:
    """Travel speed of the weaves if it is the assigned velocity everywhere [m/s], else None."""
    contours, fastest = planned.path.contours, planned.run.limits.speed
    if fastest is not None and any((x.path.speeds > fastest).any() for x in contours):
        return None
    speeds = [x.woven.frequency * x.woven.pitch for x in contours if x.woven is not None]
    return next((x for x in speeds if x > 0), None)


def time_limit_row(planned: Planned) -> Iterator[Row]:
    """Row of the limit that takes most of the time; none if it is unknown."""
    why = planned.explanation
    if why is not None and why.longest is not None:
        limit, share = why.longest
        note = f"{number(share, '1')} of the time"
        if limit == ASSIGNED and (travel := weave_speed(planned)) is not None:
            note += f"; the weave travels at {number(travel, 'm/s')}"
        yield Row("time_limit", limit, "", "time limited by", note, VERDICT)
