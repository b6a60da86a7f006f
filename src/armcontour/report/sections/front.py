"""The first screen of runs: the drawing, the verdict, three figures and three sentences."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from armcontour.core.render import figure, number
from armcontour.core.result import Data, Row
from armcontour.core.text import capitalise, count_noun, list_some
from armcontour.jobs import JobResult, RunResult, warnings_of
from armcontour.jobs.plan_quantities import assumed_numbers
from armcontour.planning.explanation import BETWEEN, NAMES
from armcontour.report.drawing import draw_plan
from armcontour.report.section import Front, Section, Table, side_by_side, tiles
from armcontour.report.style import few

# Figures in large print, of which the first three that are known are shown.
TILES = ("duration", "off_drawing", "time_limit", "speed")
# Columns of the table of several runs, and figures in them.
COLUMNS = {
    "verdict": "kept",
    "motion": "duration",
    "off the drawing": "off_drawing",
    "limits the time": "time_limit",
}
ON_BODIES = "experiment."
# Shares of the time that are named on the first screen, and limits of them that a reserve reduces.
MAX_SHARES = 4
RESERVED_NAMES = (NAMES["joint_acceleration"], NAMES["joint_torque"])


def front(study: JobResult) -> Front:
    """The first screen of a study: of several runs the fastest one that is kept."""
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
    """The run that is drawn: the fastest that is kept, or else the first explained one."""
    runs = study.runs
    kept = [x for x in runs if runs[x].kept]
    known = kept or [x for x in runs if runs[x].explanation is not None] or list(runs)
    return min(known, key=lambda x: runs[x].trajectory.duration)


def _verdict(study: JobResult, data: Data) -> str:
    """Whether the run is as near to the drawing as it may be."""
    if not study.simulated:
        return "Plan only: no servo was simulated, so that there are no errors."
    rows = {x.name: x for x in data.shown()}
    off, kept = rows["off_drawing"], rows.get("kept")
    words = f"{figure(off)} {off.label}"
    if kept is None:
        return f"{words}: the job states no accuracy and no corner tolerance."
    note = kept.note or off.note
    return f"{capitalise(figure(kept))}: {words}" + f" ({note})" * bool(note) + "."


def _compared(study: JobResult) -> Table:
    """A row for every run."""
    rows = []
    for name, data in study.figures.items():
        found = {x.name.removeprefix(ON_BODIES): figure(x) for x in data.shown()}
        rows.append((name, *(found.get(x, "-") for x in COLUMNS.values())))
    return Table(header=("run", *COLUMNS), rows=tuple(rows))


def _sentences(study: JobResult, result: RunResult) -> Iterator[tuple[str, str]]:
    """Why the motion takes so long, what to change, and what is assumed."""
    why = result.explanation
    yield from time_sentences(result)
    if result.advice is not None:
        label = "What to change"
        for x in result.advice.improvements:
            yield label, f"{x.label}: {x.effect}" + f", if {x.condition}" * bool(x.condition)
            label = ""
        if result.advice.note:
            yield label, result.advice.note
    elif why is not None and study.simulated:
        yield (
            "What to change",
            "The command run plans changes of a job of this size with --changes.",
        )
    found = warnings_of([result])
    if found:
        more = f" {len(found) - 1} more under Warnings and notes." if len(found) > 1 else ""
        yield "Weakest point", f"{found[0]}{more}"
    yield "Assumed", _assumed(study)


def time_sentences(result: RunResult) -> Iterator[tuple[str, str]]:
    """Why the motion takes so long: the largest shares of the time, then the slowest place."""
    why, reserve = result.explanation, result.run.timing.reserve
    if why is None:
        return
    largest = [x for x in why.shares if x.kind != BETWEEN][:MAX_SHARES]
    words = ", ".join(f"{x.name} {number(x.of_time, '1')}" for x in largest)
    text = f"{capitalise(words)} of the time."
    if reserve and any(x.kind in RESERVED_NAMES for x in largest):
        text += f" Joints are planned for {number(1 - reserve, '1')} of their accelerations."
    slowest = min(why.shortfalls, key=lambda x: x.speed / x.assigned, default=None)
    if slowest is not None:
        text += f" Slowest place: {slowest.sentence}."
    if largest:
        yield "Why it takes this long", text


def _assumed(study: JobResult) -> str:
    """What the figures are of."""
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
    """Warnings, notes and assumptions; None without any.

    Args:
        study: The study.
        warnings: Those of its certificate, in place of those of its runs.
    """
    runs = study.runs.values()
    uses_masses = any(
        x.run.experiment is not None or x.run.limits.joint_torque is not None for x in runs
    )
    assumed = assumed_numbers(study.job.arm)
    found = tuple(warnings) or warnings_of(runs)
    others = (
        *dict.fromkeys(z for y in runs for z in (*y.path.remarks, *y.remarks)),
        *((f"About the masses: {assumed}",) if assumed and uses_masses else ()),
    )
    if not found and not others:
        return None
    return Section(
        key="notes",
        title="Warnings and notes",
        summary=f"{count_noun(len(found), 'warning')}, {count_noun(len(others), 'note')}",
        notes=(*few(found, "warnings"), *few(others, "notes")),
    )
