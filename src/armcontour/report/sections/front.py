"""The first screen of runs: drawing, verdict, important figures and sentences."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from armcontour.core.render import figure, number
from armcontour.core.result import Data, Row
from armcontour.core.text import capitalise, count_noun, list_some
from armcontour.jobs import JobResult, RunResult, warnings_of
from armcontour.jobs.plan_quantities import assumed_numbers
from armcontour.planning.explanation import BETWEEN, NAMES
from armcontour.report.plan_drawing import draw_plan
from armcontour.report.section import Front, Section, TextTable, side_by_side, tiles
from armcontour.report.style import few

# Figures in large print; the first three known ones are shown.
TILES = ("duration", "off_drawing", "time_limit", "speed")
# Columns of the table of several runs, and figures in them.
COLUMNS = {
    "verdict": "kept",
    "motion": "duration",
    "off the drawing": "off_drawing",
    "time limited by": "time_limit",
}
ON_BODIES = "experiment."
# Number of time shares on the first screen, and limits that a reserve reduces.
MAX_SHARES = 4
RESERVED_NAMES = (NAMES["joint_acceleration"], NAMES["joint_torque"])


def front(study: JobResult) -> Front:
    """The first screen of a study, with the drawing of one run."""
    name = _shown(study)
    data, result = study.figures[name], study.runs[name]
    alone = len(study.runs) == 1
    return Front(
        verdict=("" if alone else f"Run {name}: ") + _verdict(study, data),
        good=data["kept"].value,
        tiles=tiles(_large(data)) if alone else (),
        tables=() if alone else (_compared(study),),
        drawing=draw_plan(result, study.job),
        sentences=tuple(_sentences(study, result)),
    )


def _large(data: Data) -> list[Row]:
    """The figures in large print."""
    rows = {x.name.removeprefix(ON_BODIES): x for x in data.shown()}
    return [rows[x] for x in TILES if x in rows][:3]


def _shown(study: JobResult) -> str:
    """The drawn run: the fastest one within its accuracy, or the fastest explained one."""
    runs = study.runs
    accurate = [x for x in runs if runs[x].kept]
    candidates = accurate or [x for x in runs if runs[x].explanation is not None] or list(runs)
    return min(candidates, key=lambda x: runs[x].trajectory.duration)


def _verdict(study: JobResult, data: Data) -> str:
    """The deviation from the drawing, compared to the accuracy."""
    if not study.simulated:
        return "Plan only: no servo was simulated, so that there are no errors."
    rows = {x.name: x for x in data.shown()}
    deviation, verdict = rows["off_drawing"], rows.get("kept")
    words = f"{figure(deviation)} {deviation.label}"
    if verdict is None:
        return f"{words}: the job states no accuracy and no corner tolerance."
    note = verdict.note or deviation.note
    return f"{capitalise(figure(verdict))}: {words}" + f" ({note})" * bool(note) + "."


def _compared(study: JobResult) -> TextTable:
    """A row per run."""
    rows = []
    for name, data in study.figures.items():
        texts = {x.name.removeprefix(ON_BODIES): figure(x) for x in data.shown()}
        rows.append((name, *(texts.get(x, "-") for x in COLUMNS.values())))
    return TextTable(header=("run", *COLUMNS), rows=tuple(rows))


def _sentences(study: JobResult, result: RunResult) -> Iterator[tuple[str, str]]:
    """Reasons of the duration, advice, weakest point, and assumptions."""
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
            "The command run plans changes of a job of this size with --changes.",
        )
    warnings = warnings_of([result])
    if warnings:
        rest = f" {len(warnings) - 1} more under Warnings and notes." if len(warnings) > 1 else ""
        yield "Weakest point", f"{warnings[0]}{rest}"
    yield "Assumed", _assumed(study)


def time_sentences(result: RunResult) -> Iterator[tuple[str, str]]:
    """The largest shares of the time, then the slowest place."""
    explanation, reserve = result.explanation, result.run.timing.reserve
    if explanation is None:
        return
    largest = [x for x in explanation.shares if x.kind != BETWEEN][:MAX_SHARES]
    words = ", ".join(f"{x.name} {number(x.of_time, '1')}" for x in largest)
    text = f"{capitalise(words)} of the time."
    if reserve and any(x.kind in RESERVED_NAMES for x in largest):
        text += f" Joints are planned for {number(1 - reserve, '1')} of their accelerations."
    slowest = min(explanation.shortfalls, key=lambda x: x.speed / x.assigned, default=None)
    if slowest is not None:
        text += f" Slowest place: {slowest.sentence}."
    if largest:
        yield "Why it takes this long", text


def _assumed(study: JobResult) -> str:
    """Assumptions of the figures."""
    if not study.simulated:
        return "Joints follow the plan exactly."
    servo = study.job.plant_servo
    if servo.order == "unknown":
        return "Errors are those of the executed tool against its path."
    return (
        f"Simulated servos of {servo} and their acceleration limits. Errors are larger on a robot "
        "with other gains."
    )


def all_figures(study: JobResult) -> Section:
    """All figures of all runs side by side."""
    table = side_by_side(study.figures)
    return Section(
        key="figures",
        title="All figures",
        summary=f"{len(table.rows)} figures of {list_some(list(study.runs), 6)}",
        parts=table.halves if len(study.runs) == 1 else (table,),
    )


def notes(study: JobResult, warnings: Sequence[str] = ()) -> Section | None:
    """Warnings, notes and assumptions; `warnings` of a certificate replace those of the runs."""
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
