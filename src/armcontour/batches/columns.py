"""The figures of a job that a batch may ask for: columns of its results."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from armcontour._text import suggest
from armcontour.errors import InvalidInput
from armcontour.jobs.axes import UNITS

if TYPE_CHECKING:
    from armcontour.certification import Certificate
    from armcontour.jobs import RunResult
    from armcontour.placement import Placement

# What is done with each job: each more than the one before, or something else.
TEACH, RUN, CERTIFY = RISING = ("teach", "run", "certify")
PLACE = "place"
WORKS = (*RISING, PLACE)


@dataclass(frozen=True, slots=True)
class Column:
    """A figure of a job; None where the job has no such figure.

    Args:
        unit: Its unit.
        since: The least work that gives it.
        value: The figure of what the work gives: a `RunResult`, a `Certificate` or a
            `Placement`.
    """

    unit: str
    since: str
    value: Callable[[Any], float | None]

    def comes_from(self, work: str) -> bool:
        """Whether some work gives it."""
        if PLACE in (work, self.since):
            return work == self.since
        return RISING.index(self.since) <= RISING.index(work)


def _largest(values: Iterable[float] | None) -> float | None:
    """The largest of some values; None if there is none."""
    return None if values is None else max((float(x) for x in values), default=None)


def _of_error(name: str, figure: str) -> Callable[[RunResult], float | None]:
    """A figure of an error over time."""

    def value(x: RunResult) -> float | None:
        found = getattr(x.evaluation, name)
        return None if found is None else float(getattr(found, figure))

    return value


def _of_evaluation(name: str) -> Callable[[RunResult], float | None]:
    """A figure of an evaluation; the largest of all joints, or of all limits."""

    def value(x: RunResult) -> float | None:
        found = getattr(x.evaluation, name)
        if hasattr(found, "values"):
            found = found.values()
        if hasattr(found, "__iter__"):
            return _largest(found)
        return None if found is None else float(found)

    return value


def _of_experiment(figure: str) -> Callable[[RunResult], float | None]:
    """A figure of the contour error on rigid bodies."""

    def value(x: RunResult) -> float | None:
        found = x.experiment
        return None if found is None else float(getattr(found.evaluation.contour_error, figure))

    return value


def _corner_error(x: RunResult) -> float | None:
    """The largest corner error of all contours [m]."""
    found = (getattr(y.path, "corners", None) for y in x.path.contours)
    return _largest(e for corners in found if corners is not None for e in corners.error)


def _orientation_error(x: RunResult) -> float | None:
    """The largest error of the tool's orientation [rad]."""
    found = x.evaluation.orientation_error
    return None if found is None else float(found.max)


def _left(x: Certificate) -> float:
    """What is left of the budget of the contour with the least."""
    return float(x.worst.budget.left)


def _axis(name: str) -> Callable[[Placement], float | None]:
    """A value of the best place; None for an axis that is not varied."""
    return lambda x: x.refined.values.get(name)


# Figures of a place.
VERDICT = {"duration": "s", "singular": "m/rad", "clearance": "m", "torque_margin": "1"}


def _there(figure: str) -> Callable[[Placement], float]:
    """A figure of the best place."""

    def value(x: Placement) -> float:
        return float(getattr(x.refined.verdict, figure))

    return value


def _at_own(figure: str) -> Callable[[Placement], float]:
    """A figure of the job's own place."""

    def value(x: Placement) -> float:
        return float(getattr(x.own, figure))

    return value


COLUMNS: dict[str, Column] = {
    "duration": Column("s", TEACH, lambda x: x.trajectory.duration),
    "length": Column("m", TEACH, lambda x: x.path.length),
    "corner_error": Column("m", TEACH, _corner_error),
    "full_stops": Column("1", TEACH, lambda x: sum(x.full_stops.values())),
    "set_points": Column("1", TEACH, lambda x: len(x.taught)),
    "settled": Column("s", RUN, _of_evaluation("settled")),
    "contour_error.rms": Column("m", RUN, _of_error("contour_error", "rms")),
    "contour_error.max": Column("m", RUN, _of_error("contour_error", "max")),
    "objective_error.rms": Column("m", RUN, _of_error("objective_error", "rms")),
    "objective_error.max": Column("m", RUN, _of_error("objective_error", "max")),
    "tracking_error.rms": Column("m", RUN, _of_error("tracking_error", "rms")),
    "tracking_error.max": Column("m", RUN, _of_error("tracking_error", "max")),
    "orientation_error.max": Column("rad", RUN, _orientation_error),
    "speed": Column("m/s", RUN, _of_evaluation("speed")),
    "speed_ratio": Column("1", RUN, _of_evaluation("speed_ratio")),
    "speed_overshoot": Column("m/s", RUN, _of_evaluation("speed_overshoot")),
    "utilisation": Column("1", RUN, _of_evaluation("utilisation")),
    "limit_ratio": Column("1", RUN, _of_evaluation("limit_ratios")),
    "demand": Column("rad/s^2", RUN, _of_evaluation("demand")),
    "demand_ratio": Column("1", RUN, _of_evaluation("demand_ratio")),
    "jerk": Column("rad/s^3", RUN, _of_evaluation("jerk")),
    "saturated": Column("1", RUN, _of_evaluation("saturated")),
    "experiment.contour_error.rms": Column("m", RUN, _of_experiment("rms")),
    "experiment.contour_error.max": Column("m", RUN, _of_experiment("max")),
    "optimum": Column("s", CERTIFY, lambda x: x.uncertified.duration),
    "cost": Column("s", CERTIFY, lambda x: x.cost),
    "executed_error": Column("m", CERTIFY, lambda x: max(y.budget.executed for y in x.contours)),
    "budget_left": Column("m", CERTIFY, _left),
    "headroom": Column("1", CERTIFY, lambda x: x.headroom),
    "trials": Column("1", CERTIFY, lambda x: x.trials),
    **{f"place.{x}": Column(unit, PLACE, _axis(x)) for x, unit in UNITS.items()},
    **{f"place.{x}": Column(unit, PLACE, _there(x)) for x, unit in VERDICT.items()},
    **{f"own.{x}": Column(unit, PLACE, _at_own(x)) for x, unit in VERDICT.items()},
    "gain": Column("1", PLACE, lambda x: 1 - x.refined.verdict.duration / x.own.duration),
    "places": Column("1", PLACE, lambda x: len(x.verdicts)),
    "planned": Column("1", PLACE, lambda x: x.planned),
    "refused": Column("1", PLACE, lambda x: sum(x.refusals.values())),
}
USUAL = {
    TEACH: ("duration", "corner_error"),
    RUN: ("duration", "contour_error.rms", "contour_error.max", "corner_error", "demand_ratio"),
    PLACE: (
        *(f"place.{x}" for x in UNITS),
        "place.duration",
        "own.duration",
        "gain",
        "places",
        "planned",
        "refused",
    ),
    CERTIFY: ("duration", "optimum", "executed_error", "corner_error"),
}


def read_columns(given: Iterable[str] | None, work: str) -> tuple[str, ...]:
    """The names of the columns that a plan asks for, or the usual ones.

    Args:
        given: The names; None for the usual ones.
        work: What is done with each job.

    Raises:
        InvalidInput: No such column, one that this work does not give, or one twice.
    """
    if given is None:
        return USUAL[work]
    known = [x for x, column in COLUMNS.items() if column.comes_from(work)]
    names = tuple(given)
    for k, name in enumerate(names):
        where = f"columns (item {k + 1})"
        if name not in COLUMNS:
            hint = suggest(name, known, f"there are {', '.join(known)}.")
            raise InvalidInput(f"{where}: there is no column {name}: {hint}")
        if name not in known:
            raise InvalidInput(
                f"{where}: {name} comes from do: {COLUMNS[name].since}, but the plan does "
                f"{work}: change one of them."
            )
        if name in names[:k]:
            raise InvalidInput(f"{where}: {name} stands there twice.")
    if not names:
        raise InvalidInput(f"columns is empty: name some of {', '.join(known)}, or leave it out.")
    return names


def figures_of(found: Any, names: Iterable[str], work: str) -> tuple[float | None, ...]:
    """The figures of a job, in the order of the columns.

    Args:
        found: What the work gave.
        names: The columns.
        work: What was done.
    """
    figures = []
    for name in names:
        column = COLUMNS[name]
        of = found.result if work == CERTIFY and column.since != CERTIFY else found
        value = column.value(of)
        finite = value is not None and math.isfinite(value)
        figures.append(float(value) if finite and value is not None else None)
    return tuple(figures)
