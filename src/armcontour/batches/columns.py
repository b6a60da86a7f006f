"""Results of a job that can be columns of a batch."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from armcontour.core.errors import InvalidInput
from armcontour.core.result import Row
from armcontour.core.text import suggest
from armcontour.jobs.placement_options import UNITS

# Kinds of work on each job. Each of INCREASING_WORKS includes the previous ones; PLACE is separate.
COMPENSATE, RUN, CERTIFY = INCREASING_WORKS = ("compensate", "run", "certify")
PLACE = "place"
WORKS = (*INCREASING_WORKS, PLACE)


@dataclass(frozen=True, slots=True)
class Column:
    """Column of a batch, which contains one result of each job."""

    # SI unit of the result; empty for counts
    unit: str
    # The smallest kind of work that computes the result
    smallest_work: str

    def is_computed_by(self, work: str) -> bool:
        """True if a kind of work computes the result."""
        if PLACE in (work, self.smallest_work):
            return work == self.smallest_work
        return INCREASING_WORKS.index(self.smallest_work) <= INCREASING_WORKS.index(work)


ERRORS = ("contour_error", "objective_error", "tracking_error", "experiment.contour_error")
PLACEMENT_UNITS = {"duration": "s", "singular": "m/rad", "clearance": "m", "torque_margin": "1"}
# Units of the results by name, grouped by the smallest kind of work that computes them.
UNITS_BY_WORK: dict[str, dict[str, str]] = {
    COMPENSATE: {
        **{"duration": "s", "length": "m", "corner_error": "m", "full_stops.count": ""},
        "set_points": "",
    },
    RUN: {
        "settled": "s",
        **{f"{x}.{figure}": "m" for x in ERRORS for figure in ("rms", "max")},
        **{"orientation_error.max": "rad", "speed": "m/s", "speed_ratio": "1"},
        **{"speed_overshoot": "m/s", "time_at_limit": "1", "limit_ratios": "1"},
        **{"demand": "rad/s^2", "demand_ratio": "1", "jerk": "rad/s^3", "saturated": "1"},
    },
    CERTIFY: {
        **{"uncertified.duration": "s", "cost": "s", "budget.executed": "m", "budget.left": "m"},
        **{"headroom.mean": "1", "trials": ""},
    },
    PLACE: {
        **{f"best.place.{x}": unit for x, unit in UNITS.items()},
        **{f"{x}.{y}": unit for x in ("best", "own_place") for y, unit in PLACEMENT_UNITS.items()},
        **{"gain": "1", "places": "", "planned": "", "refused_places": ""},
    },
}
COLUMNS = {
    x: Column(unit, smallest_work)
    for smallest_work, rows in UNITS_BY_WORK.items()
    for x, unit in rows.items()
}
DEFAULT_COLUMNS = {
    COMPENSATE: ("duration", "corner_error"),
    RUN: ("duration", "contour_error.rms", "contour_error.max", "corner_error", "demand_ratio"),
    PLACE: (
        *(f"best.place.{x}" for x in UNITS),
        "best.duration",
        "own_place.duration",
        "gain",
        "places",
        "planned",
        "refused_places",
    ),
    CERTIFY: ("duration", "uncertified.duration", "budget.executed", "corner_error"),
}


def read_columns(requested: Iterable[str] | None, work: str) -> tuple[str, ...]:
    """Names of the columns of a plan; by default the usual columns of its kind of work."""
    if requested is None:
        return DEFAULT_COLUMNS[work]
    available = [x for x, column in COLUMNS.items() if column.is_computed_by(work)]
    names = tuple(requested)
    for k, name in enumerate(names):
        location = f"columns (item {k + 1})"
        if name not in COLUMNS:
            hint = suggest(name, available, f"the columns are {', '.join(available)}.")
            raise InvalidInput(f"{location}: unknown column {name}: {hint}")
        if name not in available:
            raise InvalidInput(
                f"{location}: {name} requires do: {COLUMNS[name].smallest_work}, but the plan has "
                f"do: {work}. Change do, or remove the column."
            )
        if name in names[:k]:
            raise InvalidInput(f"{location}: the column {name} is repeated.")
    if not names:
        raise InvalidInput(
            f"columns is empty. Name at least one of {', '.join(available)}, or remove the key."
        )
    return names


def figures_of(result: Any, names: Iterable[str], work: str) -> tuple[float | None, ...]:
    """Results of a job in the order of the columns; None if missing or not finite."""
    from armcontour.jobs.job_result import judging_rows

    rows: list[Row] = []
    if work != PLACE:
        run = result.result if work == CERTIFY else result
        rows += judging_rows(run, run.to_data().rows)
    if work in (CERTIFY, PLACE):
        rows += result.to_data().rows
    figures_by_name = {x.name: x.figure for x in rows if COLUMNS.get(x.name)}
    figures = ((None if (x := figures_by_name.get(name)) is None else float(x)) for name in names)
    return tuple(None if x is None or not math.isfinite(x) else x for x in figures)
