"""First screen of a report: drawing, verdict, important values and sentences."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from armcontour.core.render import compare, figure, number
from armcontour.core.result import VERDICT, Data
from armcontour.core.text import capitalise, count_noun, list_some
from armcontour.jobs import JobResult, RunResult, warnings_of
from armcontour.jobs.run_notes import unknown_notes
from armcontour.report.moving_arm import draw_arm
from armcontour.report.plan_drawing import draw_plan
from armcontour.report.section import Front, Section, TextTable, side_by_side, tiles
from armcontour.report.style import few

# Heading of advice.
HEADING = "What to change"


def front(job_result: JobResult) -> Front:
    """Make the first screen of a job result, with the drawing of one run."""
    name = _shown(job_result)
    data = job_result.figures[name]
    result = job_result.runs[name]
    alone = len(job_result.runs) == 1
    header, *rows = compare(job_result.figures, VERDICT, texts=True)
    drawing = draw_plan(result, job_result.job)
    return Front(
        verdict=("" if alone else f"Run {name}: ") + _verdict_sentence(result, data),
        good=result.kept,
        tiles=tiles(data, places=drawing.places) if alone else (),
        tables=() if alone else (TextTable(header=header, rows=tuple(rows)),),
        drawing=drawing,
        arm=draw_arm(result, job_result.job),
        sentences=tuple(_sentences(job_result, result)),
        advice=_missing_advice(job_result, result),
    )


def _shown(job_result: JobResult) -> str:
    """Choose the drawn run: the fastest run that keeps its accuracy, if any.

    Otherwise the fastest run with an explanation, or the fastest of all runs.
    """
    runs = job_result.runs
    accurate = [x for x in runs if runs[x].kept]
    candidates = accurate or [x for x in runs if runs[x].explanation is not None] or list(runs)
    return min(candidates, key=lambda x: runs[x].trajectory.duration)


def _verdict_sentence(result: RunResult, data: Data) -> str:
    """Compare the deviation from the drawing with the required accuracy, in one sentence."""
    if result.verdict.off_drawing is None:
        return "This report has no errors, because only the plan was computed."
    deviation = data["off_drawing"]
    verdict = data["kept"]
    words = f"{figure(deviation)} {deviation.label}"
    if verdict.value is None:
        return f"{words}; the job specifies no accuracy and no corner tolerance."
    note = verdict.note or deviation.note
    return f"{capitalise(figure(verdict))}: {words}" + f" ({note})" * bool(note) + "."


def _missing_advice(job_result: JobResult, result: RunResult) -> tuple[str, str] | None:
    """Return how to get advice, if it is possible and was not computed."""
    if result.advice is not None or result.explanation is None or not job_result.simulated:
        return None
    return HEADING, "Press Improve in the Studio, or add --changes to armcontour run."


def _sentences(job_result: JobResult, result: RunResult) -> Iterator[tuple[str, str]]:
    """Yield headings and sentences: active limits, advice, weakest point and assumptions."""
    changes = list[str]()
    if (advice := result.advice) is not None:
        for x in advice.improvements:
            changes.append(f"{x.label}: {x.effect}" + f", if {x.condition}" * bool(x.condition))
        changes += filter(None, [advice.note])
    yield from zip([HEADING, *[""] * len(changes)], changes, strict=False)
    # Notes of the drawing are no weak points of the plan.
    warnings = [x for x in result.warnings if x not in result.path.notes]
    if warnings:
        rest = f" {len(warnings) - 1} more under Warnings and notes." if len(warnings) > 1 else ""
        yield "Weakest point", f"{capitalise(warnings[0])}{rest}"
    yield "Assumed", _assumed(job_result)
    yield "", job_result.figures[result.run.name].not_proven


def _assumed(job_result: JobResult) -> str:
    """Return the state the assumptions on which the values are based, in one sentence."""
    if not job_result.simulated:
        if any(x.program is not None for x in job_result.runs.values()):
            return (
                "Controllers of the programs move in straight lines in joint space or along a "
                "cubic spline of the joints between the points, and have no lag."
            )
        return "Joints follow the plan exactly."
    servo = job_result.job.plant_servo
    if servo.order == "unknown":
        return "Errors are deviations of the executed tool position from the path."
    described = servo.describe_with_source(job_result.job.arm.chain.prismatic)
    estimates = [x.unknown_gains for x in job_result.runs.values() if x.unknown_gains is not None]
    largest = max(estimates, key=lambda x: x.max, default=None)
    how_large = ""
    if largest is not None:
        bound = "at least" if largest.saturates else "up to"
        how_large = (
            f": {bound} {number(largest.max, 'm')} (estimate; {largest.words} in each joint)"
        )
    return (
        f"The simulation uses an acceleration limit for each joint and the {described}. Contour "
        f"errors are larger on a robot with other gains{how_large}."
    )


def all_figures(job_result: JobResult) -> Section:
    """Make the section with all values of all runs side by side."""
    tables = side_by_side(job_result.figures)
    count = sum(len(x.rows) for x in tables)
    return Section(
        key="figures",
        title="All figures",
        summary=f"{count} figures of {list_some(list(job_result.runs), 6)}",
        parts=tables,
    )


def notes(job_result: JobResult, warnings: Sequence[str] = ()) -> Section | None:
    """Make the section with warnings, notes and assumptions; None without any.

    A certificate's `warnings` replace those of the runs.
    """
    runs = job_result.runs.values()
    uses_masses = any(
        x.run.experiment is not None or x.run.limits.joint_torque is not None for x in runs
    )
    assumed = job_result.job.arm.chain.assumed
    shown_warnings = tuple(warnings) or warnings_of(runs)
    remarks = list[str]()
    for result in runs:
        # Notes of the drawing are said once, and not for each run.
        of_drawing = result.path.remarks
        said = [f"Run {result.run.name}: {x}" for x in of_drawing]
        remarks += (*of_drawing, *(x for x in result.remarks if x not in said))
    others = (
        *dict.fromkeys(remarks),
        *unknown_notes(job_result.runs.values()),
        *((f"About the masses: {assumed}",) if assumed and uses_masses else ()),
    )
    if not shown_warnings and not others:
        return None
    return Section(
        key="notes",
        title="Warnings and notes",
        summary=f"{count_noun(len(shown_warnings), 'warning')}, {count_noun(len(others), 'note')}",
        notes=(*few(shown_warnings, "warnings"), *few(others, "notes")),
    )
