"""The first section: the most important figures of every run."""

from __future__ import annotations

from armcontour.jobs import Study, warnings_of
from armcontour.jobs.quantities import assumed_numbers
from armcontour.report.section import Section, side_by_side, tiles
from armcontour.report.style import few

# Largest number of runs with tiles; more runs are compared in the table alone.
MOST_TILED = 2


def overview(study: Study) -> Section:
    """The verdict on every run as tiles, and all figures side by side."""
    runs = study.figures
    uses_masses = any(
        x.run.experiment is not None or x.run.limits.joint_torque is not None
        for x in study.runs.values()
    )
    assumed = assumed_numbers(study.job.arm)
    return Section(
        key="overview",
        title="At a glance",
        text=_text(study),
        tiles=() if len(runs) > MOST_TILED else tuple((k, tiles(x)) for k, x in runs.items()),
        tables=(side_by_side(runs),),
        notes=(
            *few(dict.fromkeys(z for y in study.runs.values() for z in y.path.remarks), "notes"),
            *(y.stops_note for y in study.runs.values() if y.stops_note is not None),
            *few(warnings_of(study.runs.values()), "warnings"),
            *((f"About the masses: {assumed}",) if assumed and uses_masses else ()),
        ),
    )


def _text(study: Study) -> str:
    """What the figures are of."""
    if not study.simulated:
        return "The plan. No servo was simulated, so that there are no errors."
    text = "Contour error is the distance from the executed tool to its path"
    if study.job.plant_servo.order == "unknown":
        return f"{text}."
    return (
        f"{text}, simulated with servos of {study.job.plant_servo} and their acceleration limits. "
        "It is larger on a robot with other gains."
    )
