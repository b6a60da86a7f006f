"""First screen of a study: drawing, verdict, important values and sentences."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from armcontour.core.render import figure, number
from armcontour.core.result import Data, Row
from armcontour.core.text import capitalise, count_noun, list_some
from armcontour.jobs import JobResult, RunResult, warnings_of
from armcontour.jobs.plan_quantities import assumed_numbers
from armcontour.planning.explanation import BETWEEN
from armcontour.report.plan_drawing import draw_plan
from armcontour.report.section import Front, Section, TextTable, side_by_side, tiles
from armcontour.report.style import few
from armcontour.robot.limits import LIMITS

# Names of the values for tiles; the first three known values are shown.
TILES = ("duration", "off_drawing", "time_limit", "speed")
# Columns of the table of several runs, each with the name of its value in the data of a run.
COLUMNS = {
    "verdict": "kept",
    "motion": "duration",
    "off the drawing": "off_drawing",
    "time limited by": "time_limit",
}
# Prefix of the names of values from an experiment.
EXPERIMENT_PREFIX = "experiment."
# Maximum number of time shares on the first screen, and names of the limits that a reserve reduces.
MAX_SHARES = 4
RESERVED_NAMES = {x.label for x in LIMITS.values() if x.reserved}


def front(study: JobResult) -> Front:
    """First screen of a study, with the drawing of one run."""
    name = _shown(study)
    data, result = study.figures[name], study.runs[name]
    alone = len(study.runs) == 1
    return Front(
        verdict=("" if alone else f"Run {name}: ") + _verdict_sentence(study, data),
        good=data["kept"].value,
        tiles=tiles(_large(data)) if alone else (),
        tables=() if alone else (_compared(study),),
        drawing=draw_plan(result, study.job),
        sentences=tuple(_sentences(study, result)),
    )


def _large(data: Data) -> list[Row]:
    """Rows of the values that are shown as tiles."""
    rows = {x.name.removeprefix(EXPERIMENT_PREFIX): x for x in data.shown()}
    return [rows[x] for x in TILES if x in rows][:3]


def _shown(study: JobResult) -> str:
    """Name of the drawn run: the fastest run that keeps its accuracy, if any.

    Otherwise the fastest run with an explanation, or the fastest of all runs.
    """
    runs = study.runs
    accurate = [x for x in runs if runs[x].kept]
    candidates = accurate or [x for x in runs if runs[x].explanation is not None] or list(runs)
    return min(candidates, key=lambda x: runs[x].trajectory.duration)


def _verdict_sentence(study: JobResult, data: Data) -> str:
    """Sentence on the deviation from the drawing, compared with the required accuracy."""
    if not study.simulated:
        return "This report has no errors, because only the plan was computed."
    rows = {x.name: x for x in data.shown()}
    deviation, verdict = rows["off_drawing"], rows.get("kept")
    words = f"{figure(deviation)} {deviation.label}"
    if verdict is None:
        return f"{words}; the job specifies no accuracy and no corner tolerance."
    note = verdict.note or deviation.note
    return f"{capitalise(figure(verdict))}: {words}" + f" ({note})" * bool(note) + "."


def _compared(study: JobResult) -> TextTable:
    """Table with a row per run."""
    rows = []
    for name, data in study.figures.items():
        texts = {x.name.removeprefix(EXPERIMENT_PREFIX): figure(x) for x in data.shown()}
        rows.append((name, *(texts.get(x, "-") for x in COLUMNS.values())))
    return TextTable(header=("run", *COLUMNS), rows=tuple(rows))


def _sentences(study: JobResult, result: RunResult) -> Iterator[tuple[str, str]]:
    """Yield headings and sentences: active limits, advice, weakest point and assumptions."""
    explanation = result.explanation
    yield from time_sentences(result)
    if result.advice is not None:
        label = "What to change"
        for improvement in result.advice.improvements:
            yield (
                label,
                f"{improvement.label}: {improvement.effect}"
                + f", if {improvement.condition}" * bool(improvement.condition),
            )
            label = ""
        if result.advice.note:
            yield label, result.advice.note
    elif explanation is not None and study.simulated:
        yield (
            "What to change",
            "For a job of this size, proposals are computed only by armcontour run --changes.",
        )
    # Notes of the drawing are no weak points of the plan.
    warnings = [x for x in result.warnings if x not in result.path.notes]
    if warnings:
        rest = f" {len(warnings) - 1} more under Warnings and notes." if len(warnings) > 1 else ""
        yield "Weakest point", f"{capitalise(warnings[0])}{rest}"
    yield "Assumed", _assumed(study)


def time_sentences(result: RunResult) -> Iterator[tuple[str, str]]:
    """Yield a heading and its text: the largest time shares of limits, and the slowest point."""
    explanation, reserve = result.explanation, result.run.timing.reserve
    if explanation is None:
        return
    largest = [x for x in explanation.shares if x.kind != BETWEEN][:MAX_SHARES]
    words = ", ".join(f"{x.name} {number(x.of_time, '1')}" for x in largest)
    text = f"{capitalise(words)} of the time."
    if reserve and any(x.kind in RESERVED_NAMES for x in largest):
        text += f" The plan uses at most {number(1 - reserve, '1')} of the joint accelerations."
    slowest = min(explanation.shortfalls, key=lambda x: x.speed / x.assigned, default=None)
    if slowest is not None:
        text += f" Slowest point: {slowest.sentence}."
    if largest:
        yield "Why it takes this long", text


def _assumed(study: JobResult) -> str:
    """Sentence on the assumptions on which the values are based."""
    if not study.simulated:
        return "Joints follow the plan exactly."
    servo = study.job.plant_servo
    if servo.order == "unknown":
        return "Errors are deviations of the executed tool position from the path."
    return (
        f"The servos are simulated with {servo} and with their acceleration limits. Errors are "
        "larger on a robot with other gains."
    )


def all_figures(study: JobResult) -> Section:
    """Section with all values of all runs side by side."""
    table = side_by_side(study.figures)
    return Section(
        key="figures",
        title="All figures",
        summary=f"{len(table.rows)} figures of {list_some(list(study.runs), 6)}",
        parts=table.halves if len(study.runs) == 1 else (table,),
    )


def notes(study: JobResult, warnings: Sequence[str] = ()) -> Section | None:
    """Section with warnings, notes and assumptions; None if there are none.

    `warnings` of a certificate replace those of the runs.
    """
    runs = study.runs.values()
    uses_masses = any(
        x.run.experiment is not None or x.run.limits.joint_torque is not None for x in runs
    )
    assumed = assumed_numbers(study.job.arm)
    shown_warnings = tuple(warnings) or warnings_of(runs)
    others = (
        *dict.fromkeys(z for y in runs for z in (*y.path.remarks, *y.remarks)),
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
